"""Navigation files written: what is read comes back digit by digit, and equal data give equal bytes."""

import gzip
from dataclasses import fields, replace

import numpy as np
import pytest

from truenorth.errors import FormatError
from truenorth.formats.rinex_nav import parse_rinex_nav, read_rinex_nav
from truenorth.formats.rinex_nav_writer import write_rinex_navigation
from truenorth.navigation import KEPLER_COLUMNS, STATE_COLUMNS, MessageType, build_navigation
from truenorth.observations import sat_id
from truenorth.simulation.sky import NominalSky, build_sky
from truenorth.timescales import BDT_OFFSET_NS, NS_PER_S, gpst_from_calendar

START_NS = gpst_from_calendar(2024, 6, 24, 8)


def assert_same(one, other):
    for table in ("kepler", "states"):
        for entry in fields(getattr(one, table)):
            mine, theirs = (
                getattr(getattr(one, table), entry.name),
                getattr(getattr(other, table), entry.name),
            )
            np.testing.assert_array_equal(mine, theirs, err_msg=f"{table}.{entry.name}")


def kepler_row(name, message, toe_ns, **values):
    elements = dict.fromkeys(KEPLER_COLUMNS, 0.0)
    elements |= {"sqrt_a": 5153.6, "ura_m": 2.0, "fit_interval_s": 4 * 3600.0, **values}
    return (
        sat_id(name), message, toe_ns, toe_ns, toe_ns - 7200 * NS_PER_S, 7, 7, 0, list(elements.values()),
    )  # fmt: skip


@pytest.fixture(scope="module")
def nominal():
    return build_sky(NominalSky(systems="GRECJI"), start_ns=START_NS, duration_s=3600.0, seed=3).navigation


def test_the_nominal_sky_comes_back_equal(tmp_path, nominal):
    assert write_rinex_navigation(tmp_path / "n.nav", nominal) == {}
    back = read_rinex_nav(tmp_path / "n.nav")
    assert_same(back, nominal)
    assert back.leap_seconds == 18
    np.testing.assert_array_equal(back.klobuchar["G"], nominal.klobuchar["G"])


def test_what_was_read_is_written_again_with_the_same_bytes(tmp_path, nominal):
    write_rinex_navigation(tmp_path / "one.nav", nominal, comments=("a sky",))
    write_rinex_navigation(tmp_path / "two.nav", read_rinex_nav(tmp_path / "one.nav"), comments=("a sky",))
    assert (tmp_path / "one.nav").read_bytes() == (tmp_path / "two.nav").read_bytes()
    write_rinex_navigation(tmp_path / "a.nav.gz", nominal, comments=("a sky",))
    write_rinex_navigation(tmp_path / "b.nav.gz", nominal, comments=("a sky",))
    packed = (tmp_path / "a.nav.gz").read_bytes()
    assert packed == (tmp_path / "b.nav.gz").read_bytes()
    assert gzip.decompress(packed) == (tmp_path / "one.nav").read_bytes()


def test_fields_stand_where_the_standard_puts_them(tmp_path):
    """Fields of table A5 (GPS), A8 (Galileo), A14 (BeiDou) counted by hand."""
    toe = gpst_from_calendar(2024, 6, 24, 10)
    rows = [
        kepler_row("G05", MessageType.LNAV, toe, tgd_s=-1e-8, af0_s=1.5e-4),
        kepler_row("E11", MessageType.INAV, toe, tgd_s=2e-9, tgd2_s=3e-9, sqrt_a=5440.6),
        kepler_row("E11", MessageType.FNAV, toe, tgd_s=2e-9, tgd2_s=3e-9, sqrt_a=5440.6),
        kepler_row("C20", MessageType.D1, toe + BDT_OFFSET_NS, tgd_s=2e-9, tgd2_s=4e-9, sqrt_a=5282.6),
    ]
    write_rinex_navigation(tmp_path / "n.nav", build_navigation(rows))
    lines = (tmp_path / "n.nav").read_text().splitlines()
    assert lines[0].startswith("     3.05           N: GNSS NAV DATA    M: MIXED")
    record = {line[:3]: k for k, line in reversed(list(enumerate(lines))) if line[:1] in "GEC" and k > 2}

    def value(name, line, column):
        return float(lines[record[name] + line][4 + 19 * column : 23 + 19 * column])

    assert lines[record["G05"]].startswith("G05 2024 06 24 10 00 00 1.500000000000E-04")
    assert value("G05", 3, 0) == 122_400.0
    assert value("G05", 5, 2) == 2320.0
    assert (value("G05", 6, 2), value("G05", 6, 3)) == (-1e-8, 7.0)
    assert (value("G05", 7, 0), value("G05", 7, 1)) == (115_200.0, 4.0)
    assert lines[record["C20"]].startswith("C20 2024 06 24 10 00 00")
    assert value("C20", 3, 0) == 122_400.0
    assert value("C20", 5, 2) == 2320.0 - 1356.0
    assert (value("C20", 6, 2), value("C20", 6, 3)) == (2e-9, 4e-9)
    # Bits of the data source: E1-B, E5b-I and the clock of E5b for I/NAV; E5a-I and its clock for F/NAV.
    sources = [float(lines[k + 5][23:42]) for k, line in enumerate(lines) if line.startswith("E11")]
    assert sources == [517.0, 258.0]


def test_times_near_the_ends_of_the_week_and_a_leap_second(tmp_path):
    week_end = gpst_from_calendar(2024, 6, 23)
    rows = [kepler_row("G05", MessageType.LNAV, week_end)]
    leap = gpst_from_calendar(2017, 1, 1, 0, 15) + 18 * NS_PER_S
    before = gpst_from_calendar(2016, 12, 31, 23, 45) + 17 * NS_PER_S
    states = dict.fromkeys(STATE_COLUMNS, 0.0) | {"x_m": 2.55e7, "vy_mps": 3000.0}
    state_rows = [
        (sat_id("R05"), time_ns, time_ns - 900 * NS_PER_S, -7, 1, list(states.values()))
        for time_ns in (before, leap)
    ]
    navigation = build_navigation(rows, state_rows)
    write_rinex_navigation(tmp_path / "n.nav", navigation)
    text = (tmp_path / "n.nav").read_text()
    assert "R05 2016 12 31 23 45 00" in text
    assert "R05 2017 01 01 00 15 00" in text
    assert "-7.200000000000E+03" in text  # of transmission, in the week of toe
    assert_same(read_rinex_nav(tmp_path / "n.nav"), navigation)


def test_statements_of_accuracy_and_fit_that_are_not_the_usual_ones(tmp_path):
    toe = gpst_from_calendar(2024, 6, 24, 10)
    rows = [
        kepler_row("G05", MessageType.LNAV, toe, ura_m=np.nan, fit_interval_s=6 * 3600.0),
        kepler_row("J02", MessageType.LNAV, toe, sqrt_a=6493.0, fit_interval_s=2 * 3600.0),
        kepler_row("J03", MessageType.LNAV, toe, sqrt_a=6493.0, fit_interval_s=4 * 3600.0),
    ]
    navigation = build_navigation(rows)
    write_rinex_navigation(tmp_path / "n.nav", navigation)
    assert_same(read_rinex_nav(tmp_path / "n.nav"), navigation)


def test_geostationary_augmentation_satellites_come_back(tmp_path):
    states = dict.fromkeys(STATE_COLUMNS, 0.0) | {"x_m": 4.2e7, "vz_mps": -0.25, "az_mps2": 6.25e-5}
    row = (sat_id("S23"), START_NS, START_NS + 3 * NS_PER_S, 0, 31, list(states.values()))
    navigation = build_navigation((), [row])
    write_rinex_navigation(tmp_path / "n.nav", navigation)
    assert_same(read_rinex_nav(tmp_path / "n.nav"), navigation)


def test_messages_without_a_record_are_counted_and_left_out(tmp_path):
    toe = gpst_from_calendar(2024, 6, 24, 10)
    rows = [kepler_row("G05", MessageType.LNAV, toe), kepler_row("G05", MessageType.CNAV, toe)]
    assert write_rinex_navigation(tmp_path / "n.nav", build_navigation(rows)) == {"CNAV": 1}
    assert len(read_rinex_nav(tmp_path / "n.nav").kepler) == 1


def test_header_coefficients(tmp_path, nominal):
    klobuchar = {letter: np.array([1e-8, -2e-8, 3e-8, 4e-8, 1e5, 2e5, -3e5, 4e5]) for letter in "GCJI"}
    both = replace(nominal, klobuchar=klobuchar, nequick=np.array([80.0, 0.5, -0.01]))
    write_rinex_navigation(tmp_path / "n.nav", both)
    back = read_rinex_nav(tmp_path / "n.nav")
    for letter, values in klobuchar.items():
        np.testing.assert_array_equal(back.klobuchar[letter], values)
    np.testing.assert_array_equal(back.nequick, both.nequick)


def test_no_ephemerides_give_a_header(tmp_path):
    write_rinex_navigation(tmp_path / "n.nav", build_navigation())
    assert len(parse_rinex_nav((tmp_path / "n.nav").read_bytes()).kepler) == 0


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(FormatError, match=r"nowhere.*could not write"):
        write_rinex_navigation(tmp_path / "nowhere" / "n.nav", build_navigation())
