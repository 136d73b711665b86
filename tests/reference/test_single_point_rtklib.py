"""Single-point positions beside RTKLIB's on the same files (table by tools/make_single_point_reference.py).

The programs differ by intent: weights, outlier rules, and the mapping of the troposphere (RTKLIB's 1/sin
of the elevation against Black & Eisner), so they agree to the noise of a code position, not to digits.
"""

import csv
from pathlib import Path

import numpy as np
import pytest

from truenorth.formats import read_navigation, read_observations
from truenorth.navigation import merge_navigation
from truenorth.positioning import solve_single_point
from truenorth.timescales import gpst_from_week

TABLE = Path(__file__).parent / "data" / "single_point_rtklib.csv"

# Set: folder, observations, navigation, systems, bounds of the mean and of any 3-D difference, metres.
SETS = {
    "pair_1m_gps": ("pair_1m_geodetic", "base.obs.gz", ["base.nav.gz"], "G", 0.15, 0.2),
    # Galileo's clock offset weighs: RTKLIB corrects E1 by the delay of E5a, we by that of the I/NAV clock.
    "pair_1m_gps_galileo": ("pair_1m_geodetic", "rover.obs.gz", ["base.nav.gz"], "GE", 0.4, 0.5),
    "pair_38m_upc1": ("pair_38m_gps", "UPC10770.11o.gz", ["brdc0770.11n"], "G", 1.2, 2.0),
    "pair_38m_upc2": ("pair_38m_gps", "UPC20770.11o.gz", ["brdc0770.11n"], "G", 1.2, 2.0),
    "rose_base": (
        "moving_simulator_rose",
        "Base-static_MO_Spirent.obs.gz",
        ["RINEX_GN_Spirent.23N.gz", "RINEX_EN_Spirent.23L.gz"],
        "G",
        0.4,
        0.6,
    ),
}


def rtklib(name):
    """Time (GPS nanoseconds) and ECEF position of the table's rows of one set."""
    with TABLE.open() as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    rows = [row for row in rows if row["set"] == name]
    time_ns = np.array([gpst_from_week(row["week"], row["tow_s"]) for row in rows])
    return time_ns, np.array([[float(row[axis]) for axis in ("x_m", "y_m", "z_m")] for row in rows])


@pytest.mark.parametrize("name", SETS)
def test_positions_agree_with_rtklib_to_the_noise_of_codes(data_dir, name):
    folder, observations, navigation, systems, mean_m, any_m = SETS[name]
    obs = read_observations(data_dir / folder / observations)
    nav = merge_navigation(*[read_navigation(data_dir / folder / path) for path in navigation])
    point = solve_single_point(obs, nav, systems=systems)
    time_ns, position_ecef_m = rtklib(name)
    # RTKLIB writes true time, rounded to the millisecond; tags are off by up to some milliseconds.
    true_ns = point.time_ns - np.rint(point.clock_s * 1e9).astype(np.int64)
    nearest = np.abs(true_ns[:, None] - time_ns).argmin(axis=0)
    assert np.abs(true_ns[nearest] - time_ns).max() <= 0.6e6
    difference = point.position_ecef_m[nearest] - position_ecef_m
    assert np.linalg.norm(difference.mean(axis=0)) < mean_m
    assert np.linalg.norm(difference, axis=1).max() < any_m
