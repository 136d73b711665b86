"""Real navigation files, read, written as RINEX 3.05 and read again."""

from dataclasses import fields, replace

import numpy as np
import pytest

from truenorth.formats.rinex_nav import read_rinex_nav
from truenorth.formats.rinex_nav_writer import write_rinex_navigation
from truenorth.navigation import MessageType

FILES = (
    "pair_1m_geodetic/base.nav.gz",
    "pair_38m_gps/brdc0770.11n",
    "pair_0.33m_ublox/rover.nav.gz",
    "moving_simulator_rose/RINEX_GN_Spirent.23N.gz",
    "moving_simulator_rose/RINEX_EN_Spirent.23L.gz",
    "rinex_samples/KMS300DNK_R_20221591000_01H_MN.rnx.gz",
    "rinex_samples/BRD400DLR_S_20260680000_01D_MN.rnx.gz",
)
LEGACY = [MessageType[name] for name in ("LNAV", "INAV", "FNAV", "D1", "D2")]


@pytest.mark.parametrize("name", FILES)
def test_every_number_comes_back(name, data_dir, tmp_path):
    given = read_rinex_nav(data_dir / name)
    left_out = write_rinex_navigation(tmp_path / "again.nav", given)
    keep = np.isin(given.kepler.message, LEGACY)
    assert sum(left_out.values()) == np.sum(~keep)
    kepler = replace(
        given.kepler,
        **{entry.name: getattr(given.kepler, entry.name)[keep] for entry in fields(given.kepler)},
    )
    again = read_rinex_nav(tmp_path / "again.nav")
    for mine, theirs in ((kepler, again.kepler), (given.states, again.states)):
        for entry in fields(mine):
            np.testing.assert_array_equal(getattr(mine, entry.name), getattr(theirs, entry.name), entry.name)
    assert again.leap_seconds == given.leap_seconds
    # The header holds five digits; RINEX 4 records held more.
    for letter, values in given.klobuchar.items():
        np.testing.assert_allclose(again.klobuchar[letter], values, rtol=5e-5)
