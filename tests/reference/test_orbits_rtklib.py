"""Broadcast orbits and clocks against RTKLIB's, from the table that tools/make_orbit_reference.py wrote."""

import csv
from pathlib import Path

import numpy as np
import pytest

from truenorth.formats.rinex_nav import read_rinex_nav
from truenorth.navigation import MessageType
from truenorth.observations import sat_id
from truenorth.orbits import compute_satellite_states

TABLE = Path(__file__).parent / "data" / "orbits_rtklib.csv"
LEGACY = (MessageType.LNAV, MessageType.INAV, MessageType.FNAV, MessageType.D1, MessageType.D2)


def rows():
    with TABLE.open(encoding="ascii") as lines:
        yield from csv.DictReader(line for line in lines if not line.startswith("#"))


FILES = sorted({row["file"] for row in rows()})


def candidates(navigation, row):
    """Our ephemerides that may be the one RTKLIB used (health may differ between equal ones)."""
    sat, toe_ns = sat_id(row["sat"]), int(row["toe_gpst_s"]) * 10**9
    kepler, states = navigation.kepler, navigation.states
    if row["sat"][0] == "R":
        return np.flatnonzero((states.sat == sat) & (states.toe_ns == toe_ns)) + len(kepler)
    found = (kepler.sat == sat) & (kepler.toe_ns == toe_ns) & (kepler.iode == int(row["iode"]))
    found &= np.isin(kepler.message, LEGACY)
    if row["sat"][0] == "E":
        is_fnav = bool(int(row["source"]) & 0x100)
        found &= kepler.message == (MessageType.FNAV if is_fnav else MessageType.INAV)
    return np.flatnonzero(found)


@pytest.mark.parametrize("name", FILES)
def test_orbits_to_a_millimetre_and_clocks_to_ten_femtoseconds(name, data_dir):
    navigation = read_rinex_nav(data_dir / name)
    seen = set()
    for row in (row for row in rows() if row["file"] == name):
        index = candidates(navigation, row)
        assert len(index), f"no ephemeris for {row}"
        sat = np.full(len(index), sat_id(row["sat"]))
        time_ns = (int(row["toe_gpst_s"]) * 10**9) + round(float(row["offset_s"]) * 1e9)
        states = compute_satellite_states(navigation, sat, time_ns, ephemeris=index, include_unhealthy=True)
        wanted = np.array([float(row[axis]) for axis in ("x_m", "y_m", "z_m")])
        distance = np.linalg.norm(states.position_ecef_m - wanted, axis=1)
        clock = np.abs(states.clock_s - float(row["clock_s"]))
        # The table is rounded to 0.01 mm. RTKLIB takes 398600.44 km3/s2 for GLONASS where ICD 5.1 says
        # 398600.4418: 0.7 mm after 12 minutes.
        assert distance.min() <= (1e-3 if row["sat"][0] == "R" else 2e-5), row
        assert clock[np.argmin(distance)] <= 1e-14, row
        seen.add(row["sat"][0] + ("-geo" if states_of_geo(row["sat"]) else ""))
    assert seen >= ({"G"} if "brdc" in name else {"G", "R", "E", "C"})


def states_of_geo(name):
    return name[0] == "C" and (int(name[1:]) <= 5 or int(name[1:]) >= 59)


def test_the_table_covers_every_system_and_orbit_kind():
    sats = {row["sat"] for row in rows()}
    assert {sat[0] for sat in sats} == set("GRECJI")
    assert any(states_of_geo(sat) for sat in sats)
    assert any(sat in sats for sat in ("C06", "C07", "C08", "C09", "C10", "C13", "C16", "C38", "C39", "C40"))
