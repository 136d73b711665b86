"""What RTKLIB makes of emulated RINEX files: python tools/make_emulator_reference.py.

Simulates the cases of `CASES` into files, runs RTKLIB's ``rnx2rtkp`` (Debian package ``rtklib``) on them and
writes its solutions to tests/reference/data/emulator_rtklib.csv. The emulator is deterministic, so the tests
simulate the same files again and compare the truth with what RTKLIB found.
"""

import hashlib
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "tests" / "reference" / "data" / "emulator_rtklib.csv"
sys.path.insert(0, str(ROOT / "tests"))

from simulated_sessions import NOISELESS  # noqa: E402

_SIGNALS = {"G": ["1C", "2W"], "R": ["1C", "2C"], "E": ["1C", "5Q"], "C": ["2I", "7I"]}
_TURNING = {
    "duration_s": 300.0,
    "place": {"latitude_deg": 47.0, "longitude_deg": 15.0, "height_m": 400.0},
    "platform": {
        "antennas": [
            {"name": "aft", "position_body_m": [0.0, 0.0, 0.0]},
            {"name": "fore", "position_body_m": [2.0, 0.0, 0.0]},
        ]
    },
    "motion": {"kind": "circle", "radius_m": 50.0, "speed_mps": 8.0},
    "visibility": {"elevation_mask_deg": 10.0},
}

# By name: mode and systems of RTKLIB, scenario. The moving pairs are without noise, but with clocks,
# atmosphere and orbit errors; the single points have all that a receiver has.
CASES = {
    f"moving_{systems}": (
        "movingbase",
        systems,
        _TURNING | {"name": f"moving_{systems}", "receiver": NOISELESS | {"signals": _SIGNALS}},
    )
    for systems in ("G", "R", "E", "C", "GREC")
} | {
    f"single_{systems}": (
        "single",
        systems,
        _TURNING | {"name": f"single_{systems}", "receiver": {"signals": _SIGNALS}},
    )
    for systems in ("G", "R", "E", "C", "GREC")
}

_RTKLIB_SYSTEMS = {"G": 1, "R": 4, "E": 8, "C": 32}


def configuration(mode, systems):
    """Options of rnx2rtkp."""
    code = sum(_RTKLIB_SYSTEMS[letter] for letter in systems)
    return "\n".join(
        (
            f"pos1-posmode={mode}", "pos1-frequency=l1+l2", "pos1-soltype=forward", "pos1-elmask=15",
            "pos1-dynamics=off", "pos1-ionoopt=brdc", "pos1-tropopt=saas", "pos1-sateph=brdc",
            f"pos1-navsys={code}", "pos2-armode=instantaneous", "pos2-gloarmode=on", "pos2-arthres=3.0",
            f"out-solformat={'enu' if mode == 'movingbase' else 'xyz'}",
            "out-outhead=off", "out-timesys=gpst",
            "out-timeform=tow", "out-timendec=3", "",
        )
    )  # fmt: skip


def run_rtklib(folder, mode, systems):
    """Rows of (seconds of the week, three coordinates, quality) of one case."""
    (folder / "rtk.conf").write_text(configuration(mode, systems))
    subprocess.run(
        ["rnx2rtkp", "-k", "rtk.conf", "-o", "out.pos", "fore.obs", "aft.obs", "navigation.rnx"],
        cwd=folder, stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True,
    )  # fmt: skip
    rows = [line.split() for line in (folder / "out.pos").read_text().splitlines() if line[:1] != "%"]
    return [(row[1], *row[2:5], row[5]) for row in rows]


def main():
    """Simulate, run, write the table."""
    from truenorth import __version__
    from truenorth.simulation import write_simulation

    version = subprocess.run(
        ["dpkg-query", "--show", "--showformat=${Version}", "rtklib"],
        capture_output=True,
        text=True,
        check=False,
    ).stdout
    lines = [
        f"# rnx2rtkp of Debian's rtklib {version or 'unknown'}, on files of truenorth {__version__}; made by",
        "# tools/make_emulator_reference.py; moving: east, north, up of fore from aft; single: ECEF of fore",
        "case,tow_s,first_m,second_m,third_m,quality",
    ]
    for name, (mode, systems, scenario) in CASES.items():
        with tempfile.TemporaryDirectory() as work:
            folder = Path(work)
            write_simulation(scenario, folder)
            digest = hashlib.sha256((folder / "fore.obs").read_bytes()).hexdigest()
            rows = run_rtklib(folder, mode, systems)
        lines.insert(2, f"# sha256 of fore.obs of {name}: {digest}")
        lines += [",".join((name, *row)) for row in rows[:: 1 if mode == "movingbase" else 10]]
        print(name, len(rows))
    TABLE.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
