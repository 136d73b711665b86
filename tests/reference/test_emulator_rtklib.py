"""RTKLIB, which shares nothing with us, finds the emulator's truth in the emulator's files.

The table holds what ``rnx2rtkp`` found; tools/make_emulator_reference.py makes it and says the version. The
files are simulated again here, and must be those that RTKLIB read.
"""

import csv
import hashlib
import importlib.util
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import truenorth as tn
from truenorth.frames import geodetic_from_ecef, rot_enu_from_ecef
from truenorth.simulation import write_simulation
from truenorth.timescales import gpst_from_week

ROOT = Path(__file__).parents[2]
TABLE = Path(__file__).parent / "data" / "emulator_rtklib.csv"

_spec = importlib.util.spec_from_file_location(
    "make_emulator_reference", ROOT / "tools" / "make_emulator_reference.py"
)
reference = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(reference)

WEEK = 2320


@pytest.fixture(scope="module")
def solutions():
    lines = TABLE.read_text().splitlines()
    digests = {}
    for line in lines:
        if line.startswith("# sha256 of fore.obs of "):
            name, digest = line.removeprefix("# sha256 of fore.obs of ").split(": ")
            digests[name] = digest
    rows = {}
    for row in csv.DictReader(line for line in lines if not line.startswith("#")):
        rows.setdefault(row["case"], []).append(
            [float(row[key]) for key in ("tow_s", "first_m", "second_m", "third_m", "quality")]
        )
    return {name: (digests[name], np.array(values)) for name, values in rows.items()}


def _truth(folder):
    table = pl.read_csv(folder / "truth.csv")
    antennas = {
        name: np.stack([table[f"antenna_{axis}_ecef_m_{name}"].to_numpy() for axis in "xyz"], axis=1)
        for name in ("aft", "fore")
    }
    return table["time_ns"].to_numpy(), antennas


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    made = {}

    def simulate(name):
        if name not in made:
            made[name] = tmp_path_factory.mktemp(name)
            write_simulation(reference.CASES[name][2] | {"output": {"signal_truth": False}}, made[name])
        return made[name]

    return simulate


@pytest.mark.parametrize("name", reference.CASES)
def test_the_files_are_those_that_rtklib_read(name, solutions, simulated):
    digest, _ = solutions[name]
    content = (simulated(name) / "fore.obs").read_bytes()
    assert hashlib.sha256(content).hexdigest() == digest, (
        "the emulator's output has changed: make the table anew with tools/make_emulator_reference.py"
    )


@pytest.mark.parametrize("name", [name for name in reference.CASES if name.startswith("moving")])
def test_rtklib_fixes_the_moving_base_to_a_millimetre(name, solutions, simulated):
    _, rows = solutions[name]
    time_ns, antennas = _truth(simulated(name))
    epoch = np.searchsorted(time_ns, [gpst_from_week(WEEK, tow) for tow in rows[:, 0]])
    latitude, longitude, _ = geodetic_from_ecef(antennas["aft"][epoch])
    true = np.einsum(
        "nij,nj->ni", rot_enu_from_ecef(latitude, longitude), (antennas["fore"] - antennas["aft"])[epoch]
    )
    assert len(rows) >= 300
    assert np.all(rows[:, 4] == 1.0), "fixed"
    assert np.max(np.linalg.norm(rows[:, 1:4] - true, axis=1)) < 0.001


@pytest.mark.parametrize("name", [name for name in reference.CASES if name.startswith("single")])
def test_rtklib_positions_single_points_within_the_error_model(name, solutions, simulated):
    _, rows = solutions[name]
    folder = simulated(name)
    time_ns, antennas = _truth(folder)
    epoch = np.searchsorted(time_ns, [gpst_from_week(WEEK, tow) for tow in rows[:, 0]])
    ours = tn.solve_single_point(
        tn.read_observations(folder / "fore.obs"),
        tn.read_navigation(folder / "navigation.rnx"),
        systems=name.removeprefix("single_"),
        elevation_mask_deg=15.0,
    )
    error = np.linalg.norm(rows[:, 1:4] - antennas["fore"][epoch], axis=1)
    # Orbits and clocks of the nominal sky: 0.2 m radial, 0.8 along, 0.5 across, 0.4 clock make 0.5 m on the
    # ray; codes above 15 degrees 0.3 to 0.7 m, of GLONASS twice that. Three sigma of one axis in three.
    user_range_m = 1.3 if name == "single_R" else 0.8
    assert np.all(error < 3.5 * ours.pdop[epoch] * user_range_m)
    assert np.median(error) > 0.02, "errors are there to be seen"
