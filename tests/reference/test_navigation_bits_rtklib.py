"""Frames of random bits, decoded by us and by RTKLIB (tools/make_navigation_bits_reference.py)."""

import json
from pathlib import Path

import numpy as np
import pytest

from truenorth.formats.navigation_bits import BroadcastDecoder
from truenorth.navigation import KEPLER_COLUMNS
from truenorth.observations import sat_id
from truenorth.timescales import NS_PER_S, NS_PER_WEEK, gpst_from_calendar

TABLE = json.loads((Path(__file__).parent / "data" / "navigation_bits_rtklib.json").read_text())
COLUMN_OF = {
    "e": "eccentricity", "i0": "i0_rad", "OMG0": "omega0_rad", "omg": "omega_rad", "M0": "m0_rad",
    "deln": "delta_n_radps", "OMGd": "omega_dot_radps", "idot": "idot_radps", "crc": "crc_m", "crs": "crs_m",
    "cuc": "cuc_rad", "cus": "cus_rad", "cic": "cic_rad", "cis": "cis_rad",
    "f0": "af0_s", "f1": "af1_sps", "f2": "af2_sps2",
}  # fmt: skip
# Name of the satellite, method, and a GPS time within the week of the broadcast time.
KEPLER = {
    "lnav": ("G07", "add_lnav", (1024 + 300) * NS_PER_WEEK),
    "inav": ("E11", "add_inav", (1024 + 1000) * NS_PER_WEEK + 300_000 * NS_PER_S),
    "fnav": ("E11", "add_fnav", (1024 + 1000) * NS_PER_WEEK + 300_000 * NS_PER_S),
    "d1": ("C21", "add_d1", (1356 + 1000) * NS_PER_WEEK),
    "d2": ("C02", "add_d2", (1356 + 1000) * NS_PER_WEEK),
}


def cases(*messages):
    return [
        pytest.param(case, id=f"{case['message']}-{k}")
        for k, case in enumerate(TABLE["cases"])
        if case["message"] in messages
    ]


@pytest.mark.parametrize("case", cases(*KEPLER))
def test_kepler_elements_of_random_frames(case):
    name, method, near_ns = KEPLER[case["message"]]
    decoder = BroadcastDecoder()
    for frame in case["frames"]:
        getattr(decoder, method)(sat_id(name), int(frame, 16), near_ns)
    navigation = decoder.build()
    expected = case["rtklib"]
    assert len(navigation.kepler) == 1, navigation.skipped
    eph = navigation.kepler
    # Both sides do one product per field; a few units in the last place of a double are left.
    tight = {"rtol": 4e-16 * 8, "atol": 0.0}
    np.testing.assert_allclose(eph.column("sqrt_a")[0] ** 2, expected["A"], **tight)
    for theirs, ours in COLUMN_OF.items():
        np.testing.assert_allclose(eph.column(ours)[0], expected[theirs], err_msg=ours, **tight)
    np.testing.assert_allclose(
        [eph.column("tgd_s")[0], eph.column("tgd2_s")[0]], expected["tgd"], rtol=1e-14, atol=0.0
    )
    assert (eph.iode[0], eph.iodc[0], eph.health[0]) == (expected["iode"], expected["iodc"], expected["svh"])
    bdt_s = 14 if name[0] == "C" else 0
    assert (eph.toe_ns[0] // NS_PER_S - bdt_s) % 604_800 == expected["toes"]
    assert abs(eph.toe_ns[0] - eph.transmission_ns[0]) <= NS_PER_WEEK // 2
    assert eph.elements.shape == (1, len(KEPLER_COLUMNS))
    if "klobuchar" in expected:
        np.testing.assert_array_equal(navigation.klobuchar[name[0]], expected["klobuchar"])


@pytest.mark.parametrize("case", cases("glonass"))
def test_glonass_states_of_random_strings(case):
    decoder = BroadcastDecoder()
    near_ns = gpst_from_calendar(2023, 9, 19, 8, 30, 18)
    for frame in case["frames"]:
        decoder.add_glonass_string(sat_id("R07"), int(frame, 16), near_ns, channel=5, frame=1)
    states = decoder.build().states
    expected = case["rtklib"]
    assert len(states) == 1
    ours = states.states[0]
    theirs = [*expected["pos"], *expected["vel"], *expected["acc"]]
    np.testing.assert_allclose(ours[:9], theirs, rtol=1e-15, atol=0.0)
    np.testing.assert_allclose(ours[9:], [-expected["taun"], expected["gamn"], expected["dtaun"]], rtol=1e-15)
    # The highest bit of Bn on both sides; ours adds the flag of string 3.
    assert states.health[0] & 1 == expected["svh"]
    unix_of_gps_epoch_s = 315_964_800
    assert states.toe_ns[0] // NS_PER_S + unix_of_gps_epoch_s == expected["toe_unix_gpst"]
    assert states.channel[0] == 5
