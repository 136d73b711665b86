"""``truenorth turntable``: solving logs as `simulate` writes them, design, files, words and exit codes."""

import json

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from moving_bodies import HEIGHT, Resting, generators
from truenorth.cli.app import app
from truenorth.formats.sensor_table import write_sensor_table
from truenorth.sensors import TurntableAccelerometerDescription, simulate_turntable_accelerometer

PLACE = ["--latitude", "40", "--longitude", "-114.15", "--height", f"{HEIGHT:g}"]


def call(*words):
    return CliRunner().invoke(app, ["turntable", *map(str, words)])


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("turntable")
    found = []
    for rpm, name in ((600.0, "there.csv"), (-600.0, "back.parquet")):
        sensor = TurntableAccelerometerDescription(table_rpm=rpm, axis_error_mrad=(1.0, 1.0))
        body = Resting(np.radians(40.0), heading_deg=300.0, roll_deg=0.1)
        log = simulate_turntable_accelerometer(
            sensor, body, start_ns=10**18, duration_s=9.0, generator=generators(3)
        )
        write_sensor_table(folder / name, log, truth=name.endswith(".parquet"))
        found.append(folder / name)
    (folder / "device.toml").write_text(
        "[turntable_accelerometer]\nnoise_mps2 = 1e-5\naxis_error_mrad = [1.0, 1.0]\n", encoding="utf-8"
    )
    return found


def test_a_log_is_solved_with_words_table_and_figure(logs, tmp_path):
    out, figure = tmp_path / "revolutions.csv", tmp_path / "page.png"
    done = call(
        "solve", logs[0], *PLACE, "--roll", "0.1", "--device", logs[0].parent / "device.toml",
        "--require-deg", "0.05", "--out", out, "--figure", figure,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    for words in ("heading", "sensor noise", "verdict     YES", "revolution  10 of them", "Cramer-Rao"):
        assert words in done.output
    table = pl.read_csv(out)
    assert table["revolution"].to_list() == list(range(1, 11))
    assert table["combined_heading_deg"][-1] == pytest.approx(300.0, abs=0.15)
    assert np.all(np.diff(table["combined_heading_sd_deg"]) < 0.0)
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_two_directions_as_json(logs):
    done = call("solve", *logs, *PLACE, "--roll", "0.1", "--json")
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert told["heading_deg"] == pytest.approx(300.0, abs=0.1)
    assert told["roll_deg"] == pytest.approx(0.1)
    assert told["measured"]["lean_outward_rad"] == pytest.approx(1e-3, abs=1e-4)
    assert len(told["revolutions"]["heading_deg"]) == 20
    alone = json.loads(call("solve", logs[0], *PLACE, "--roll", "0.1", "--json").stdout)
    assert abs(alone["heading_deg"] - 300.0) > 1.0


def test_methods_and_the_encoder_can_be_chosen(logs):
    told = {}
    for options in (("--method", "square-wave"), ("--no-encoder",), ()):
        done = call("solve", logs[0], *PLACE, *options, "--json")
        assert done.exit_code == 0, done.output
        told[options[:1]] = json.loads(done.stdout)["heading_sd_deg"]
    assert told[("--method",)] == pytest.approx(1.111 * told[()], rel=0.05)
    assert told[("--no-encoder",)] == pytest.approx(2.0 * told[()], rel=0.05)


def test_what_the_device_cannot_do_ends_with_one(logs):
    device = logs[0].parent / "device.toml"
    done = call("solve", logs[0], *PLACE, "--device", device, "--require-deg", "0.001")
    assert done.exit_code == 1
    assert "verdict     NO" in done.output


def test_wrong_input_is_one_sentence(logs, tmp_path):
    bad = tmp_path / "gyro.csv"
    bad.write_text('# kind = "gyro"\ntime_ns,rate_count\n1,2\n2,3\n', encoding="utf-8")
    few = tmp_path / "few.csv"
    lines = logs[0].read_text(encoding="utf-8").splitlines(keepends=True)
    few.write_text("".join(lines[:300]), encoding="utf-8")
    other = tmp_path / "other.toml"
    other.write_text("[imu]\n", encoding="utf-8")
    log = logs[0]
    for words, code, said in (
        (("solve", bad, *PLACE), 3, "kind 'gyro'"),
        (("solve", tmp_path / "none.csv", *PLACE), 3, "none.csv"),
        (("solve", few, *PLACE), 1, "less than a revolution"),
        (("solve", log, "--latitude", "89.95"), 2, "no sensor can feel north"),
        (("solve", log, "--latitude", "95"), 2, "latitude"),
        (("solve", log, *PLACE, "--method", "best"), 2, "'best'"),
        (("solve", log, *PLACE, "--tilt-sd", "-1"), 2, "--tilt-sd"),
        (("solve", log, *PLACE, "--roll", "90"), 2, "below 90"),
        (("solve", log, *PLACE, "--harmonics", "0"), 2, "--harmonics"),
        (("solve", log, *PLACE, "--require-deg", "0"), 2, "--require-deg"),
        (("solve", log, *PLACE, "--out", "x.doc"), 2, "x.doc"),
        (("solve", log, *PLACE, "--device", other), 2, "[turntable_accelerometer]"),
        (("solve", log, *PLACE, "--device", tmp_path / "none.toml"), 2, "none.toml"),
        (("solve", log, *PLACE, "--device", log), 2, "not valid TOML"),
        (("design", "--latitude", "forty"), 2, "--latitude forty"),
        (("design", "--radius", "0"), 2, "radius"),
        (("design", "--latitude", "90"), 2, "no sensor can feel north"),
    ):
        done = call(*words)
        assert done.exit_code == code, (words, done.output)
        assert said in done.stderr, words
        assert len(done.stderr.strip().splitlines()) == 1


def test_a_design_is_a_table(tmp_path):
    out, figure = tmp_path / "design.csv", tmp_path / "design.svg"
    done = call(
        "design", "--latitude", "20,40", "--inclination", "0,0.1", "--require-deg", "0.05", "--out", out,
        "--figure", figure,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "same for all: radius, m 0.05; rpm 600" in done.output
    # Of 0.1 deg of tilt 0.084 deg come at latitude 40.
    assert done.output.count("never") == 2
    table = pl.read_csv(out)
    assert table.shape == (4, 15)
    assert table["likelihood_sd_deg"][2] == pytest.approx(0.0326, abs=1e-4)
    assert figure.read_text(encoding="utf-8").lstrip().startswith("<?xml")
    told = json.loads(call("design", "--latitude", "40", "--noise-density", "1", "--json").stdout)
    assert told["designs"][0]["heading_sd_deg"] == pytest.approx(1.601, abs=2e-3)
    never = call("design", "--latitude", "80", "--inclination", "1", "--require-deg", "0.05")
    assert never.exit_code == 1
