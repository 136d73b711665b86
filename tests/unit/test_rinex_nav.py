"""RINEX navigation text of every version, on made-up records whose values are known."""

import gzip

import numpy as np
import pytest

from rinex_nav_text import LNAV, glonass_record, header, parse, record, record_2, with_row
from truenorth.errors import FormatError
from truenorth.formats.rinex_nav import read_rinex_nav
from truenorth.navigation import MessageType, build_navigation, merge_navigation
from truenorth.observations import NO_CHANNEL, sat_id
from truenorth.timescales import NS_PER_DAY, NS_PER_S, parse_gpst

TOC = parse_gpst("2024-06-24T10:00:00")  # Monday: 122400 s of week 2320


def row_values(rows, **places):
    """The rows with values put at flat places (3 is the first number of the second line)."""
    flat = [value for row in rows for value in row]
    for place, value in places.items():
        flat[int(place[1:]) - 3] = value
    return [tuple(flat[k : k + 4]) for k in range(0, len(flat), 4)]


def test_gps_lnav_of_rinex_3_keeps_every_number():
    navigation = parse(header() + record())
    kepler = navigation.kepler
    assert len(kepler) == 1
    assert len(navigation.states) == 0
    assert kepler.sat[0] == sat_id("G05")
    assert kepler.message[0] == MessageType.LNAV
    assert kepler.toe_ns[0] == kepler.toc_ns[0] == TOC
    assert kepler.transmission_ns[0] == TOC - (122_400 - 115_218) * NS_PER_S
    assert (kepler.iode[0], kepler.iodc[0], kepler.health[0]) == (72, 584, 0)
    wanted = {
        "af0_s": 1.5e-4, "af1_sps": -2.5e-12, "af2_sps2": 0.0, "crs_m": -98.2, "delta_n_radps": 4.3e-9,
        "m0_rad": 1.71, "cuc_rad": -5.3e-6, "eccentricity": 5.9e-3, "cus_rad": 1.8e-6, "sqrt_a": 5153.6,
        "cic_rad": 3.4e-8, "omega0_rad": 2.52, "cis_rad": -5.8e-8, "i0_rad": 0.97, "crc_m": 353.6,
        "omega_rad": 1.27, "omega_dot_radps": -8.3e-9, "idot_radps": -2.6e-10, "ura_m": 2.0,
        "tgd_s": -1.07e-8, "fit_interval_s": 14_400.0, "a_dot_mps": 0.0, "tgd2_s": 0.0,
    }  # fmt: skip
    for name, value in wanted.items():
        assert kepler.column(name)[0] == value, name
    assert navigation.paths == ("made.nav",)
    assert navigation.skipped == {}


@pytest.mark.parametrize("exponent", ["D", "d", "E"])
def test_exponent_letters_line_ends_and_short_lines_do_not_matter(exponent):
    plain = parse(header() + record())
    text = (header() + record(exponent=exponent)).replace("\n", "\r\n")
    stripped = "\n".join(line.rstrip() for line in (header() + record()).splitlines())
    for other in (parse(text), parse(stripped)):
        np.testing.assert_array_equal(other.kepler.elements, plain.kepler.elements)


def test_rinex_2_gives_the_same_as_rinex_3():
    navigation = parse(header("2.11", "N: GPS NAV DATA", "") + record_2())
    same = parse(header() + record())
    np.testing.assert_array_equal(navigation.kepler.elements, same.kepler.elements)
    assert navigation.kepler.sat[0] == sat_id("G05")
    assert navigation.kepler.toe_ns[0] == TOC


@pytest.mark.parametrize(("year", "full"), [("99", 1999), ("80", 1980), ("00", 2000), ("79", 2079)])
def test_two_digit_years(year, full):
    text = header("2.10", "N: GPS NAV DATA", "") + record_2(epoch=f"{year}  6 24 10  0  0.0")
    assert parse(text).kepler.toc_ns[0] == parse_gpst(f"{full}-06-24T10:00:00")


def test_rinex_2_glonass_is_utc_kilometres_and_unsigned_channels():
    rows = [(10_390.48, 0.3135, 1e-9, 0.0), (-3_906.96, 3.129, 0.0, 252.0), (22_971.85, 0.392, 0.0, 0.0)]
    text = header("2.11", "G: GLONASS NAV DATA", "") + record_2(
        3, "10  3 18  5 15  0.0", (1.6e-4, 9.1e-13, 18_000.0), rows
    )
    states = parse(text).states
    assert states.sat[0] == sat_id("R03")
    # GPST was 15 s ahead of UTC in 2010.
    assert states.toe_ns[0] == parse_gpst("2010-03-18T05:15:15")
    assert states.transmission_ns[0] == parse_gpst("2010-03-18T05:00:15")
    assert states.channel[0] == -4
    np.testing.assert_allclose(states.states[0, :3], [10_390_480.0, -3_906_960.0, 22_971_850.0])
    np.testing.assert_allclose(states.states[0, 3:9], [313.5, 3129.0, 392.0, 1e-6, 0.0, 0.0])
    np.testing.assert_array_equal(states.states[0, 9:], [1.6e-4, 9.1e-13, 0.0])


@pytest.mark.parametrize(("version", "lines", "delta_tau"), [("3.04", 4, 0.0), ("3.05", 5, -1.5e-9)])
def test_glonass_of_rinex_3_with_and_without_the_fifth_line(version, lines, delta_tau):
    navigation = parse(header(version) + glonass_record(lines=lines) + glonass_record("R04", lines=lines))
    states = navigation.states
    assert len(states) == 2
    assert states.toe_ns[0] == parse_gpst("2024-06-24T08:15:18")
    assert states.transmission_ns[0] == parse_gpst("2024-06-24T08:15:18")
    assert states.states[0, 11] == delta_tau
    assert navigation.glonass_channels()[3] == -4
    assert navigation.glonass_channels()[5] == NO_CHANNEL


def test_impossible_channel_and_unknown_group_delay():
    text = glonass_record(channel=60.0).replace(f"{-1.5e-9:19.12e}", f"{0.999999999999e9:19.12e}")
    states = parse(header("3.05") + text).states
    assert states.channel[0] == NO_CHANNEL
    assert states.states[0, 11] == 0.0


def test_sbas():
    rows = [(42_004.684, 0.0, 0.0, 63.0), (-3_674.93, 0.001, 0.0, 32_767.0), (10.0, 0.0, 1e-8, 242.0)]
    states = parse(header() + record("S21", "2024 06 24 00 00 48", (1e-7, 0.0, 86_460.0), rows)).states
    assert states.sat[0] == sat_id("S21")
    assert states.toe_ns[0] == parse_gpst("2024-06-24T00:00:48")
    assert states.transmission_ns[0] == parse_gpst("2024-06-24T00:01:00")
    assert (states.channel[0], states.health[0]) == (0, 63)
    np.testing.assert_allclose(states.states[0, [0, 4, 8]], [42_004_684.0, 1.0, 1e-5])


def test_beidou_time_and_messages():
    rows = row_values(LNAV["rows"], p3=1.0, p26=-1.0e-8, p28=7.0)
    text = record("C03", rows=rows) + record("C30", rows=rows) + record("C59", rows=rows)
    kepler = parse(header() + text).kepler
    assert list(kepler.message) == [MessageType.D2, MessageType.D1, MessageType.D2]
    assert set(kepler.toe_ns) == {TOC + 14 * NS_PER_S}
    assert set(kepler.toc_ns) == {TOC + 14 * NS_PER_S}
    assert set(kepler.transmission_ns) == {TOC + (14 - 122_400 + 115_218) * NS_PER_S}
    assert (kepler.column("tgd_s")[0], kepler.column("tgd2_s")[0]) == (-1.07e-8, -1.0e-8)
    assert (kepler.iode[0], kepler.iodc[0]) == (1, 7)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (513, MessageType.INAV),
        (516, MessageType.INAV),
        (517, MessageType.INAV),
        (258, MessageType.FNAV),
        (263, MessageType.FNAV),  # a simulator that marks every signal: the clock is of E5a/E1
        (1, MessageType.INAV),
        (2, MessageType.FNAV),
        (0, MessageType.INAV),
    ],
)
def test_galileo_data_source_decides(source, message):
    rows = row_values(LNAV["rows"], p20=float(source), p23=-1.0, p26=2.5e-9)
    kepler = parse(header() + record("E11", rows=rows)).kepler
    assert kepler.message[0] == message
    assert kepler.iodc[0] == kepler.iode[0] == 72
    assert (kepler.column("tgd_s")[0], kepler.column("tgd2_s")[0]) == (-1.07e-8, 2.5e-9)
    assert np.isnan(kepler.column("ura_m")[0])  # SISA -1: no accuracy prediction available


def test_fit_intervals():
    hours = {"G01": 6.0, "G02": 0.0, "G03": 1.0, "J02": 0.0, "J03": 1.0}
    text = "".join(record(sat, rows=row_values(LNAV["rows"], p28=value)) for sat, value in hours.items())
    kepler = parse(header() + text).kepler
    assert list(kepler.column("fit_interval_s") / 3600.0) == [6.0, 4.0, 6.0, 2.0, 4.0]


def test_times_of_week_across_the_week_end_ignore_the_week_number():
    # Clock epoch Sunday 00:00, orbit epoch the same, sent on Saturday; the week field is that of sending.
    rows = row_values(LNAV["rows"], p11=0.0, p21=2319.0, p27=597_600.0)
    kepler = parse(header() + record(epoch="2024 06 23 00 00 00", rows=rows)).kepler
    toc = parse_gpst("2024-06-23T00:00:00")
    assert kepler.toe_ns[0] == kepler.toc_ns[0] == toc
    assert kepler.transmission_ns[0] == toc - 7200 * NS_PER_S


@pytest.mark.parametrize("sent", [0.9999e9, None, 400_000.0])
def test_an_unknown_time_of_transmission_is_the_reference_time(sent):
    kepler = parse(header() + record(rows=row_values(LNAV["rows"], p27=sent))).kepler
    assert kepler.transmission_ns[0] == kepler.toe_ns[0]


def test_headers_of_rinex_2_and_3():
    lines = [
        ("    1.1176E-08  7.4506E-09 -5.9605D-08 -5.9605D-08", "ION ALPHA"),
        ("    9.0112E+04  0.0000E+00 -1.9661E+05 -6.5536E+04", "ION BETA"),
        ("    15", "LEAP SECONDS"),
    ]
    navigation = parse(header("2.10", "N", "", lines) + record_2())
    wanted = [1.1176e-8, 7.4506e-9, -5.9605e-8, -5.9605e-8, 9.0112e4, 0.0, -1.9661e5, -6.5536e4]
    np.testing.assert_array_equal(navigation.klobuchar["G"], wanted)
    assert navigation.leap_seconds == 15
    lines = [
        ("GPSA   1.8626E-08  2.2352E-08 -1.1921E-07 -5.9605E-08", "IONOSPHERIC CORR"),
        ("GPSB   1.2902E+05  1.6384E+05 -1.9661E+05 -2.6214E+05", "IONOSPHERIC CORR"),
        ("BDSA   1.0000E-08  2.0000E-08 -3.0000E-07 -4.0000E-08 A 12", "IONOSPHERIC CORR"),
        ("BDSB   1.0000E+05  2.0000E+05 -3.0000E+05 -4.0000E+05 A 12", "IONOSPHERIC CORR"),
        ("GAL    1.6175E+02  6.6016E-01  1.9379E-02  0.0000E+00", "IONOSPHERIC CORR"),
        ("QZSA   1.0000E-08  2.0000E-08 -3.0000E-07 -4.0000E-08", "IONOSPHERIC CORR"),
        ("     4    18  1929     7BDS", "LEAP SECONDS"),
    ]
    navigation = parse(header(lines=lines) + record())
    assert sorted(navigation.klobuchar) == ["C", "G"]  # QZSS lacks its second half
    assert navigation.klobuchar["C"][7] == -4e5
    np.testing.assert_array_equal(navigation.nequick, [161.75, 0.66016, 0.019379])
    assert navigation.leap_seconds == 18


def test_a_cut_last_record_is_counted_and_a_cut_inner_record_refused():
    text = header() + record() + record("G06")
    cut = "\n".join(text.splitlines()[:-3]) + "\n"
    navigation = parse(cut)
    assert list(navigation.kepler.sat) == [5]
    assert navigation.skipped == {"truncated": 1}
    lines = text.splitlines()
    inner = "\n".join(lines[:5] + lines[7:]) + "\n"
    with pytest.raises(FormatError, match="G05 has 6 lines, 8 needed") as caught:
        parse(inner)
    assert caught.value.line_number == 3
    assert caught.value.path == "made.nav"


def test_comments_and_blank_lines_among_the_data():
    text = header() + record() + f"{'a remark':<60}COMMENT\n\n" + record("G06")
    assert list(parse(text).kepler.sat) == [5, 6]


def test_orbits_of_impossible_size_are_counted():
    rows = with_row(LNAV["rows"], 1, (None, None, None, None))
    text = (
        header()
        + record(rows=rows)
        + glonass_record("R05").replace("1.039048", "0.000009").replace("2.297185", "0.000022")
    )
    navigation = parse(text)
    assert len(navigation.kepler) == 0
    assert len(navigation.states) == 0
    assert navigation.skipped == {"unusable": 2}


@pytest.mark.parametrize(
    ("change", "message", "line"),
    [
        (("1.710000000000e+00", "1.71000x000000e+00"), "is not a number", 4),
        (("1.710000000000e+00", "               nan"), "is not a number", 4),
        (("1.710000000000e+00", "1.7100000000e+300"), "is not a number", 4),
        (("2024 06 24", "2024 13 24"), "is not a time", 3),
        (("2024 06 24", "2024    24"), "is not a time", 3),
        (("G05", "G 0"), "is not a satellite", 3),
        (("G05", "?05"), "is not a satellite", 3),
        (("7.200000000000e+01", "7.250000000000e+01"), "is not a whole number", 4),
        (("1.224000000000e+05", "1.224000000000e+09"), "is out of range", 6),
    ],
)
def test_a_bad_value_names_its_line(change, message, line):
    text = header() + record()
    assert change[0] in text
    with pytest.raises(FormatError, match=message) as caught:
        parse(text.replace(*change))
    assert caught.value.line_number == line
    assert f"made.nav, line {line}" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not RINEX"),
        ("hello\n", "not RINEX"),
        (header(kind="OBSERVATION DATA"), "it holds observations"),
        (header("x.yz"), "is no number"),
        (header("7.00"), "version 7 is not known"),
        (header().replace("END OF HEADER", "COMMENT"), "no `END OF HEADER`"),
        (header(lines=[("    xx", "LEAP SECONDS")]), "not a whole number"),
        (header(lines=[("GPSA   1.8626?-08", "IONOSPHERIC CORR")]), "is no number"),
        (header() + "    1.0\n" + record(), "before the first record"),
        (header("4.00") + record(), "before the first `>` record"),
    ],
)
def test_what_is_not_navigation_data_is_refused(text, message):
    with pytest.raises(FormatError, match=message):
        parse(text)


MODERN = [
    (-3.8e-3, -98.2, 4.3e-9, 1.71),
    (-5.3e-6, 5.9e-3, 1.8e-6, 5153.6),
    (29_700.0, 3.4e-8, 2.52, -5.8e-8),
    (0.97, 353.6, 1.27, -8.3e-9),
    (-2.6e-10, -3.8e-14, -2.0, 3.0),
]


def test_gps_cnav_of_rinex_4():
    rows = [*MODERN, (-1.0, 1.0, -9.3e-9, 7.0), (1e-10, 2e-10, 3e-10, 4e-10), (115_218.0, 2320.0, 0.0, None)]
    kepler = parse(header("4.00") + "> EPH G05 CNAV\n" + record(rows=rows)).kepler
    assert kepler.message[0] == MessageType.CNAV
    assert kepler.toe_ns[0] == TOC  # 29700 is the time of prediction, not toe
    assert kepler.transmission_ns[0] == TOC - 7182 * NS_PER_S
    assert kepler.column("a_dot_mps")[0] == -3.8e-3
    assert kepler.column("delta_n_dot_radps2")[0] == -3.8e-14
    assert kepler.column("tgd_s")[0] == -9.3e-9
    assert kepler.health[0] == 1
    np.testing.assert_allclose(kepler.column("ura_m")[0], 2.0**0.5)  # index -1
    assert kepler.column("fit_interval_s")[0] == 10_800.0


def test_cnav_2_has_one_line_more():
    rows = [*MODERN, (15.0, 0.0, -9.3e-9, 7.0), (0.0,) * 4, (1e-10, 2e-10, None, None), (115_218.0, 2320.0)]
    kepler = parse(header("4.00") + "> EPH J02 CNV2\n" + record("J02", rows=rows)).kepler
    assert kepler.message[0] == MessageType.CNAV2
    assert kepler.transmission_ns[0] == TOC - 7182 * NS_PER_S
    assert np.isnan(kepler.column("ura_m")[0])


@pytest.mark.parametrize("message", ["CNV1", "CNV2", "CNV3"])
def test_modern_beidou_messages(message):
    rows = with_row(MODERN, 2, (122_400.0, 3.4e-8, 2.52, -5.8e-8))
    rows = [*rows, (0.0, -2.0, -1.0, -1.0)]
    if message == "CNV3":
        rows += [(3.0, 1.0, 0.0, 1.9e-9), (115_218.0, None, None, None)]
    else:
        rows += [(-8.7e-10, None, 9.5e-9, 1.2e-9), (0.0, 1.0, 0.0, 24.0), (115_218.0, None, None, 25.0)]
    kepler = parse(header("4.01") + f"> EPH C19 {message}\n" + record("C19", rows=rows)).kepler
    assert kepler.message[0] == MessageType[message]
    assert kepler.toe_ns[0] == TOC + 14 * NS_PER_S
    assert kepler.transmission_ns[0] == TOC + (14 - 7182) * NS_PER_S
    assert kepler.health[0] == 1
    assert kepler.column("tgd_s")[0] == (1.9e-9 if message == "CNV3" else 9.5e-9)
    assert kepler.column("tgd2_s")[0] == (0.0 if message == "CNV3" else 1.2e-9)
    assert (kepler.iode[0], kepler.iodc[0]) == ((0, 0) if message == "CNV3" else (25, 24))


def test_navic_messages():
    lnav = row_values(LNAV["rows"], p20=None, p26=None, p28=None)
    modern = with_row(MODERN, 2, (122_400.0, 3.4e-8, 2.52, -5.8e-8))
    modern = [*modern, (1.0, 0.0, -1e-9, 2e-9), (None,) * 4, (115_218.0, 2320.0)]
    text = "> EPH I02 LNAV\n" + record("I02", rows=lnav) + "> EPH I10 L1NV\n" + record("I10", rows=modern)
    kepler = parse(header("4.02") + text).kepler
    assert list(kepler.message) == [MessageType.LNAV, MessageType.L1NV]
    assert list(kepler.toe_ns) == [TOC, TOC]
    assert kepler.iodc[0] == kepler.iode[0] == 72


def test_rinex_4_other_records_are_counted_and_ionosphere_read():
    text = header("4.00")
    text += "> STO G01 LNAV\n    2024 06 24 10 00 00 GPUT\n    1.0\n> EOP J02 CNVX\n    junk\n"
    text += "> EPH R01 L3OC\n    junk\n"
    values = [k * 0.125e-8 for k in range(1, 9)]
    rows = [values[3:7], values[7:]]
    stamp = "> ION {} \n    2024 06 24 10 00 00"
    body = "".join(f"{v:19.12e}" for v in values[:3]) + "\n"
    body += "".join("    " + "".join(f"{v:19.12e}" for v in row) + "\n" for row in rows)
    for kind in ("G19 LNAV", "C34 D1D2", "J03 LNAV JAPN", "C50 CNVX"):
        text += stamp.format(kind) + body
    text += stamp.format("E06 IFNV") + body
    text += "> EPH G05 LNAV\n" + record()
    navigation = parse(text)
    assert len(navigation.kepler) == 1
    assert navigation.skipped == {"STO": 1, "EOP": 1, "EPH L3OC": 1, "ION J LNAV": 1, "ION C CNVX": 1}
    np.testing.assert_allclose(navigation.klobuchar["G"], values, rtol=1e-12)
    np.testing.assert_allclose(navigation.klobuchar["C"], values, rtol=1e-12)
    np.testing.assert_allclose(navigation.nequick, values[:3], rtol=1e-12)


def test_merging_sorts_and_removes_duplicates():
    later = record("G05", "2024 06 24 12 00 00", rows=row_values(LNAV["rows"], p11=129_600.0))
    first = parse(header(lines=[("    18", "LEAP SECONDS")]) + later + record("G05") + glonass_record())
    second = parse(header(lines=[("    17", "LEAP SECONDS")]) + record("G02") + record("G05"))
    merged = merge_navigation(first, second)
    assert list(merged.kepler.sat) == [2, 5, 5]
    assert list(merged.kepler.toe_ns) == [TOC, TOC, TOC + 7200 * NS_PER_S]
    assert len(merged.states) == 1
    assert merged.leap_seconds == 18
    again = merge_navigation(merged, second, first)
    np.testing.assert_array_equal(again.kepler.elements, merged.kepler.elements)
    assert again.kepler.sat.dtype == np.int16
    assert again.kepler.message.dtype == np.int8
    assert len(merge_navigation().kepler) == 0
    assert merge_navigation(first) is first


def test_of_the_same_ephemeris_sent_twice_the_first_stays_and_another_health_is_another():
    sent_later = record(rows=row_values(LNAV["rows"], p27=118_800.0))
    sick = record(rows=row_values(LNAV["rows"], p24=63.0))
    kepler = parse(header() + sent_later + record() + sick).kepler
    assert len(kepler) == 2
    healthy = np.flatnonzero(kepler.health == 0)
    assert list(kepler.transmission_ns[healthy]) == [TOC - 7182 * NS_PER_S]


def test_rows_of_the_wrong_size_are_refused():
    with pytest.raises(ValueError, match="kepler row"):
        build_navigation([(5, 0, 0, 0, 0, 0, 0, 0, np.zeros(3))])
    with pytest.raises(ValueError, match="state row"):
        build_navigation([], [(105, 0, 0, 0)])


def test_a_compressed_file_is_read_by_path(tmp_path):
    path = tmp_path / "made.nav.gz"
    path.write_bytes(gzip.compress((header() + record()).encode()))
    navigation = read_rinex_nav(path)
    assert navigation.paths == (str(path),)
    assert navigation.kepler.toe_ns[0] % NS_PER_DAY == 36_000 * NS_PER_S
