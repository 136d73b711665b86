"""Malformed and contradictory inputs on the command line: one clear sentence and the documented exit code.

The inputs are made from ten epochs of a real pair. Codes: 1 nothing to solve, 2 usage, 3 unreadable.
"""

import bz2
import gzip
import json
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from typer.testing import CliRunner

from truenorth.cli.app import app

N_EPOCHS = 10
LENGTH_M = 0.9902


def read_text(path):
    return gzip.decompress(path.read_bytes()).decode("ascii")


def cut(text):
    """Header and the first epochs of a RINEX 3 observation file."""
    head, *epochs = text.split("\n>")
    return "\n>".join([head, *epochs[:N_EPOCHS]]) + "\n"


@dataclass
class Material:
    """The good files, their text, and a folder for bad ones."""

    folder: Path
    base_text: str
    rover_text: str
    navigation_text: str

    @property
    def base(self):
        return self.write("base.obs", self.base_text)

    @property
    def rover(self):
        return self.write("rover.obs", self.rover_text)

    @property
    def navigation(self):
        return self.write("brdc.nav", self.navigation_text)

    @property
    def good(self):
        return [self.base, self.rover, self.navigation]

    def write(self, name, content):
        path = self.folder / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return str(path)

    def session(self, text):
        """Arguments of a session file beside the good files; `text` replaces old by new pieces."""
        assert self.good
        content = (
            '[platform]\nname = "bar"\n'
            '[[platform.antennas]]\nname = "a"\nobservations = "base.obs"\n'
            '[[platform.antennas]]\nname = "b"\nobservations = "rover.obs"\n'
            '[gnss]\nnavigation = ["brdc.nav"]\n'
        )
        for old, new in text.items():
            assert old in content
            content = content.replace(old, new, 1)
        return [self.write("session.toml", content)]


@pytest.fixture(scope="module")
def texts(data_dir):
    folder = data_dir / "pair_1m_geodetic"
    return (
        cut(read_text(folder / "base.obs.gz")),
        cut(read_text(folder / "rover.obs.gz")),
        read_text(folder / "base.nav.gz"),
    )


@pytest.fixture
def material(tmp_path, texts):
    return Material(tmp_path, *texts)


def run(arguments):
    return CliRunner().invoke(app, ["solve", *(str(argument) for argument in arguments)])


@dataclass(frozen=True)
class Case:
    """One bad input: what it is, how its arguments are made, the exit code and a word of the sentence."""

    name: str
    make: Callable[[Material], list]
    code: int
    word: str


def as_base(name, content):
    """Arguments with a bad base file, whose content is made from the material."""
    return lambda m: [m.write(name, content(m) if callable(content) else content), m.rover, m.navigation]


def as_navigation(name, content):
    """Arguments with a bad navigation file."""
    return lambda m: [m.base, m.rover, m.write(name, content(m) if callable(content) else content)]


def options(*words):
    """Good files with bad options."""
    return lambda m: [*m.good, *words]


def session(**pieces):
    """A session file with one piece of its text replaced, given as ``old=..., new=...``."""
    return lambda m: m.session({pieces["old"]: pieces["new"]})


def two_members(m):
    path = m.folder / "both.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("base.obs", m.base_text)
        archive.writestr("rover.obs", m.rover_text)
    return [path, m.rover, m.navigation]


def no_members(m):
    path = m.folder / "none.zip"
    zipfile.ZipFile(path, "w").close()
    return [path, m.rover, m.navigation]


def a_folder(m):
    (m.folder / "folder.obs").mkdir()
    return [m.folder / "folder.obs", m.rover, m.navigation]


def keep_satellites(text, wanted):
    """Observation text with the satellites of `wanted` (names, or letters of systems) only."""
    lines = []
    for line in text.splitlines():
        if line.startswith(">"):
            lines.append(line)
            continue
        in_epochs = bool(lines) and any(old.startswith(">") for old in lines[-60:])
        if not in_epochs or line[:3] in wanted or line[:1] in wanted:
            lines.append(line)
    # The number of satellites in each epoch record follows.
    counted = []
    for k, line in enumerate(lines):
        if line.startswith(">"):
            count = 0
            while k + 1 + count < len(lines) and not lines[k + 1 + count].startswith(">"):
                count += 1
            line = f"{line[:32]}{count:3d}"
        counted.append(line)
    return "\n".join(counted) + "\n"


def another_hour(text):
    return text.replace("> 2024 06 24 08", "> 2024 06 24 11")


PNG = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR\x00\x00\x00\x01\x00\x00\x00\x01\x08\x06\x00\x00\x00" + bytes(64)
GARBAGE = bytes((17 * k * k + 31 * k) % 256 for k in range(4096))

UNREADABLE = [
    Case("missing base", lambda m: ["absent.obs", m.rover, m.navigation], 3, "no such file"),
    Case("missing rover", lambda m: [m.base, "absent.obs", m.navigation], 3, "no such file"),
    Case("missing navigation", lambda m: [m.base, m.rover, "absent.nav"], 3, "no such file"),
    Case("a folder", a_folder, 3, "folder"),
    Case("empty base", as_base("empty.obs", b""), 3, "empty"),
    Case("empty navigation", as_navigation("empty.nav", b""), 3, "empty"),
    Case("truncated gzip", as_base("cut.obs.gz", lambda m: gzip.compress(m.base_text.encode())[:5000]), 3,
         "cut.obs.gz"),
    Case("gzip in name only", as_base("fake.obs.gz", b"this is not gzip\n" * 9), 3, "fake.obs.gz"),
    Case("truncated bzip2", as_base("cut.obs.bz2", lambda m: bz2.compress(m.base_text.encode())[:5000]), 3,
         "cut.obs.bz2"),
    Case("binary garbage", as_base("garbage.obs", GARBAGE), 3, "garbage.obs"),
    Case("binary garbage as navigation", as_navigation("garbage.nav", GARBAGE), 3, "garbage.nav"),
    Case("a picture", as_base("picture.png", PNG), 3, "picture.png"),
    Case("a letter", as_base("letter.obs", b"Dear reader,\nplease find no data here.\n"), 3, "letter.obs"),
    Case("a table", as_base("table.csv", b"time,x,y\n1,2,3\n4,5,6\n"), 3, "table.csv"),
    Case("NMEA log", as_base("log.nmea", b"$GNHDT,193.028,T*1F\r\n" * 9), 3, "log.nmea"),
    Case("observations swapped with navigation", lambda m: [m.navigation, m.rover, m.base], 3,
         "navigation is expected"),
    Case("navigation as rover", lambda m: [m.base, m.navigation, m.write("more.nav", m.navigation_text)], 3,
         "brdc.nav"),
    Case("observations as navigation", as_navigation("again.obs", lambda m: m.base_text), 3, "again.obs"),
    Case("no navigation, and none in the logs", lambda m: [m.base, m.rover], 3, "navigation"),
    Case("archive of two files", two_members, 3, "both.zip"),
    Case("archive of no files", no_members, 3, "none.zip"),
    Case("a version of the future", as_base("v9.obs", lambda m: m.base_text.replace("3.04", "9.04", 1)), 3,
         "v9.obs"),
    Case("Hatanaka in name only", as_base("fake.crx", b"not compact at all\n" * 5), 3, "fake.crx"),
    Case("UBX in name only", as_base("fake.ubx", GARBAGE), 3, "fake.ubx"),
    Case("missing session", lambda m: ["absent.toml"], 3, "absent.toml"),
    Case("session of bytes", lambda m: [m.write("session.toml", GARBAGE)], 3, "session.toml"),
]  # fmt: skip

USAGE = [
    Case("one file", lambda m: [m.base], 2, "1 file"),
    Case("base is rover", lambda m: [m.base, m.base, m.navigation], 2, "same file"),
    Case("base is navigation", lambda m: [m.base, m.rover, m.base], 2, "both"),
    Case("session and files", lambda m: [*m.session({}), m.base], 2, "alone"),
    Case("negative length", options("--length", "-0.99"), 2, "--length"),
    Case("length zero", options("--length", "0"), 2, "--length"),
    Case("length in words", options("--length", "long"), 2, "--length"),
    Case("length not a number", options("--length", "nan"), 2, "--length"),
    Case("negative deviation", options("--length", "0.99", "--length-sd", "-0.1"), 2, "--length-sd"),
    Case("mask at the zenith", options("--mask", "95"), 2, "--mask"),
    Case("mask in words", options("--mask", "low"), 2, "--mask"),
    Case("unknown system", options("--systems", "X"), 2, "--systems"),
    Case("no system", options("--systems", ""), 2, "--systems"),
    Case("unknown band", options("--bands", "L9"), 2, "--bands"),
    Case("no band", options("--bands", ""), 2, "--bands"),
    Case("unknown method", options("--method", "magic"), 2, "constrained, lambda"),
    Case("unknown use of the length", options("--length-use", "maybe"), 2, "constrain, check"),
    Case("unknown ratio test", options("--ratio-test", "hope"), 2, "--ratio-test"),
    Case("unknown direction", options("--direction", "sideways"), 2, "--direction"),
    Case("certainty", options("--success-probability", "1.5"), 2, "--success-probability"),
    Case("unknown setting", options("--set", "elevation_maks_deg=10"), 2, "elevation_mask_deg"),
    Case("setting without value", options("--set", "elevation_mask_deg"), 2, "KEY=VALUE"),
    Case("setting of a wrong type", options("--set", "single_epoch=3"), 2, "single_epoch"),
    Case("setting within a number", options("--set", "single_epoch.x=3"), 2, "single_epoch"),
    Case("unknown option", options("--lenght", "1"), 2, "--lenght"),
    Case("unknown kind of result", options("--out", "result.xlsx"), 2, ".csv"),
    Case("result in no folder", options("--out", "absent/result.csv"), 2, "does not exist"),
    Case("result is a folder", lambda m: [*m.good, "--out", m.folder], 2, "no suffix"),
    Case("unknown kind of figure", options("--figure", "page.gif"), 2, ".html"),
    Case("a moment that is none", options("--explain", "noon"), 2, "noon"),
    Case("session not TOML", lambda m: [m.write("session.toml", "[platform\n")], 2, "TOML"),
    Case("session with unknown key", session(old="[gnss]", new="[gnss]\nmaks = 3"), 2, "gnss.maks"),
    Case("session without platform", lambda m: [m.write("session.toml", "[gnss]\n")], 2, "platform"),
    Case("session naming a missing file", session(old='"brdc.nav"', new='"absent.nav"'), 2, "absent.nav"),
    Case("session with impossible mask", session(old="[gnss]", new="[gnss]\nelevation_mask_deg = 95"), 2,
         "gnss.elevation_mask_deg"),
    Case("session of one antenna", session(
        old='[[platform.antennas]]\nname = "b"\nobservations = "rover.obs"\n', new=""), 2, "1 antenna"),
    Case("session with a table too many", session(old="[gnss]", new="[platform.more]\n[gnss]"), 2,
         "platform.more"),
    Case("session contradicting itself", lambda m: m.session(
        {'name = "bar"': "length_m = 0.99", "[gnss]": "[gnss]\nlength_m = 2.0"}), 2, "give one of them"),
]  # fmt: skip

UNSOLVABLE = [
    Case("header without end", as_base("head.obs", lambda m: m.base_text[:1200]), 1, "head.obs"),
    Case("header without epochs", as_base("none.obs", lambda m: m.base_text.partition("\n>")[0] + "\n"), 1,
         "none.obs"),
    Case("no common epochs", as_base("late.obs", lambda m: another_hour(m.base_text)), 1, "same time"),
    Case("no common signals", lambda m: [
        m.write("base_g.obs", keep_satellites(m.base_text, "G")),
        m.write("rover_e.obs", keep_satellites(m.rover_text, "E")), m.navigation], 1, "common"),
    Case("one satellite", lambda m: [
        m.write("base_1.obs", keep_satellites(m.base_text, ["G10"])),
        m.write("rover_1.obs", keep_satellites(m.rover_text, ["G10"])), m.navigation], 1, ""),
    Case("ephemerides of another day", as_navigation(
        "old.nav", lambda m: m.navigation_text.replace(" 2024 06 24", " 2023 01 15")), 1, ""),
    Case("no satellite above the mask", options("--mask", "89"), 1, ""),
    Case("no signal strong enough", options("--cn0-mask", "90"), 1, ""),
    Case("a system that was not tracked", options("--systems", "I"), 1, ""),
]  # fmt: skip


def identify(case):
    return case.name.replace(" ", "_")


@pytest.mark.parametrize("case", [*UNREADABLE, *USAGE], ids=identify)
def test_refused_with_one_sentence(case, material, monkeypatch):
    monkeypatch.chdir(material.folder)
    result = run(case.make(material))
    assert result.exit_code == case.code, result.output
    assert result.stdout == ""
    assert case.word in result.stderr
    assert "Traceback" not in result.stderr
    # Usage errors of the option parser have the usage above their sentence.
    lines = [line for line in result.stderr.splitlines() if line.strip()]
    assert len(lines) == 1 or (case.code == 2 and lines[0].startswith("Usage:"))
    assert len(lines[-1]) < 400


@pytest.mark.parametrize("case", UNSOLVABLE, ids=identify)
def test_nothing_to_solve_is_said(case, material):
    result = run(case.make(material))
    assert result.exit_code == case.code, result.output
    assert case.word in result.output
    assert "Traceback" not in result.output
    assert result.stderr.count("\n") <= 1
    # Either the run was refused in a sentence, or its summary says why no epoch was accepted.
    assert result.stderr.startswith("truenorth: ") or "no fix" in result.stdout


def test_there_are_more_than_fifty():
    names = [case.name for case in (*UNREADABLE, *USAGE, *UNSOLVABLE)]
    assert len(set(names)) == len(names) >= 50


@pytest.mark.parametrize("error_m", [-0.2, 0.2])
@pytest.mark.parametrize("use", ["constrain", "check", "compute"])
def test_a_length_that_is_20_cm_wrong_is_named(material, error_m, use):
    result = run([*material.good, "--length", LENGTH_M + error_m, "--length-use", use, "--json"])
    summary = json.loads(result.stdout)
    assert result.exit_code == (0 if summary["accepted_fraction"] else 1)
    assert summary["length_check"]["verdict"] == "disagrees"
    assert summary["length_check"]["measured_m"] == pytest.approx(LENGTH_M, abs=0.01)
    assert any("suspect the declared length" in text for text in summary["warnings"])
    if summary["accepted_fraction"]:
        # Accepted in spite of the declared length: then the measured one must be right, to its millimetres.
        assert summary["length_m"]["mean"] == pytest.approx(LENGTH_M, abs=0.01)
        assert use == "compute"


def test_a_right_length_is_not_suspected(material):
    result = run([*material.good, "--length", LENGTH_M, "--json"])
    assert result.exit_code == 0, result.output
    summary = json.loads(result.stdout)
    assert summary["length_check"]["verdict"] == "agrees"
    assert summary["accepted_fraction"] == 1.0
