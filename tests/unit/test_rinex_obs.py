"""The RINEX observation reader on small files written here, one rule of the format in each."""

import numpy as np
import pytest

from truenorth.errors import FormatError
from truenorth.formats.rinex_obs import parse_rinex_obs
from truenorth.observations import LLI_HALF_CYCLE, LLI_SLIP, sat_id, sat_name, signal_id, signal_name
from truenorth.timescales import NS_PER_S, gpst_from_calendar


def line(body, label):
    return f"{body:<60}{label:<20}".rstrip() + "\n"


def header3(types, *, version="3.04", system="M", scale="GPS", extra=""):
    text = line(f"{version:>9}{'':11}{'OBSERVATION DATA':<20}{system}", "RINEX VERSION / TYPE")
    for letter, names in types.items():
        names = names.split()
        for k in range(0, len(names), 13):
            start = f"{letter}  {len(names):3d}" if k == 0 else " " * 6
            text += line(start + "".join(f" {n:<3}" for n in names[k : k + 13]), "SYS / # / OBS TYPES")
    text += line(f"  2024     6    24     8    20    0.0000000     {scale}", "TIME OF FIRST OBS")
    return text + extra + line("", "END OF HEADER")


def header2(types, *, version="2.11", system="M", scale="GPS", extra=""):
    text = line(f"{version:>9}{'':11}{'OBSERVATION DATA':<20}{system}", "RINEX VERSION / TYPE")
    names = types.split()
    for k in range(0, len(names), 9):
        start = f"{len(names):6d}" if k == 0 else " " * 6
        text += line(start + "".join(f"    {n:<2}" for n in names[k : k + 9]), "# / TYPES OF OBSERV")
    text += line(f"  2010     3    18     5     0    0.0000000     {scale}", "TIME OF FIRST OBS")
    return text + extra + line("", "END OF HEADER")


def epoch3(second, n, *, flag=0, clock="", minute=20):
    tail = f"      {clock:>15}" if clock else ""
    return f"> 2024 06 24 08 {minute:02d}{second:11.7f}  {flag}{n:3d}{tail}\n"


def sat3(name, *fields):
    return (name + "".join(field3(f) for f in fields)).rstrip() + "\n"


def field3(value):
    """A number, or (number, loss-of-lock digit), or None."""
    if value is None:
        return " " * 16
    value, lli = value if isinstance(value, tuple) else (value, " ")
    return f"{value:14.3f}{lli} "


def epoch2(second, sats, *, flag=0, clock="", count=None):
    count = len(sats) if count is None else count
    text = ""
    for k in range(0, max(len(sats), 1), 12):
        listed = "".join(sats[k : k + 12])
        start = f" 10  3 18  5  0{second:11.7f}  {flag}{count:3d}" if k == 0 else " " * 32
        text += (start + (f"{listed:<36}{clock:>12}" if k == 0 and clock else listed)).rstrip() + "\n"
    return text


def rows2(*fields):
    text = ""
    for k in range(0, len(fields), 5):
        text += "".join(field3(f) for f in fields[k : k + 5]).rstrip() + "\n"
    return text


def parse(text):
    return parse_rinex_obs(text.encode("latin-1"), path="sample")


def names(observations):
    return [
        f"{sat_name(s)}:{signal_name(g)}" for s, g in zip(observations.sat, observations.signal, strict=True)
    ]


T0 = gpst_from_calendar(2024, 6, 24, 8, 20)
TYPES = {"G": "C1C L1C D1C S1C", "R": "C1C L1C"}


def test_rows_columns_and_order():
    text = header3(TYPES) + epoch3(0, 3)
    text += (
        sat3("R07", 19e6, (100.5, 1))
        + sat3("G12", 21e6, 110.25, -12.5, 45)
        + sat3("G03", 20e6, None, None, 40)
    )
    obs = parse(text)
    assert names(obs) == ["G03:1C", "G12:1C", "R07:1C"]
    np.testing.assert_array_equal(obs.code_m, [20e6, 21e6, 19e6])
    np.testing.assert_array_equal(obs.phase_cyc, [np.nan, 110.25, 100.5])
    np.testing.assert_array_equal(obs.doppler_hz, [np.nan, -12.5, np.nan])
    np.testing.assert_array_equal(obs.cn0_dbhz, [40, 45, np.nan])
    assert obs.lli.tolist() == [0, 0, LLI_SLIP]
    assert obs.time_ns.tolist() == [T0]
    assert obs.epoch_start.tolist() == [0, 3]
    assert np.isnan(obs.clock_offset_s[0])


@pytest.mark.parametrize(
    "text",
    ["0.001", "-0.001", "-9999999999.999"[:14], "12345678.901", "99999999.999", "-1.5", "0.5", "123.456",
     "9999999999.999", "-999999999.999", "100000000.000", "1.25", "-12345.6789", "7."],
)  # fmt: skip
def test_a_value_is_the_nearest_double(text):
    obs = parse(header3({"G": "L1C"}) + epoch3(0, 1) + f"G01{text:>14}\n")
    assert obs.phase_cyc[0] == float(text)


@pytest.mark.parametrize("text", ["", "0.000", "-0.000", "0.0"])
def test_blank_and_zero_are_missing(text):
    obs = parse(header3({"G": "C1C L1C"}) + epoch3(0, 1) + f"G01{21e6:14.3f}  {text:>14}\n")
    assert np.isnan(obs.phase_cyc[0])
    assert obs.meta.warnings == ()


@pytest.mark.parametrize(
    "text", ["1 2.345", "**********.***", "12a45.678", "1.2.3", "--1.000", "12345", "1.0e5"]
)
def test_an_unreadable_value_is_left_out_and_said(text):
    obs = parse(header3({"G": "C1C L1C"}) + epoch3(0, 1) + f"G01{21e6:14.3f}  {text:>14}\n")
    assert np.isnan(obs.phase_cyc[0])
    assert obs.code_m[0] == 21e6
    (warning,) = obs.meta.warnings
    assert "1 values" in warning
    assert "line 6" in warning


def test_loss_of_lock_bits():
    text = header3({"G": "L1C"}) + epoch3(0, 5)
    for k, digit in enumerate(" 1237"):
        text += sat3(f"G0{k + 1}", (1000.0, digit))
    obs = parse(text)
    # Bit 2 says something else (anti-spoofing, BOC) and is dropped.
    assert obs.lli.tolist() == [0, LLI_SLIP, LLI_HALF_CYCLE, 3, 3]


def test_power_failure_marks_phases_as_slipped():
    text = header3(TYPES) + epoch3(0, 1) + sat3("G01", 2e7, 1.5) + epoch3(1, 2, flag=1)
    text += sat3("G01", 2e7, 2.5) + sat3("G02", 2e7, None)
    obs = parse(text)
    assert obs.lli.tolist() == [0, LLI_SLIP, 0]
    assert [(e.flag, e.time_ns) for e in obs.events] == [(1, T0 + NS_PER_S)]


def test_epochs_off_the_second_and_clock_offsets():
    text = header3({"G": "C1C"})
    text += (
        epoch3(16.99, 1)
        + sat3("G01", 2e7)
        + epoch3(17.9910001, 1, clock="-0.000123456789")
        + sat3("G01", 2e7)
    )
    text += epoch3(18.5, 1, clock="0.000000000000") + sat3("G01", 2e7)
    obs = parse(text)
    assert (obs.time_ns - T0).tolist() == [16_990_000_000, 17_991_000_100, 18_500_000_000]
    np.testing.assert_array_equal(obs.clock_offset_s, [np.nan, -0.000123456789, 0.0])


def test_picoseconds_of_rinex_4():
    head = header3({"G": "C1C"}, version="4.02")
    first = f"> 2024 06 24 08 20  1.0000001  0  1      {'0.000000001000':>15} 23456\n"
    obs = parse(head + first + sat3("G01", 2e7))
    # 23456 ps are 23.456 ns.
    assert obs.time_ns[0] - T0 == NS_PER_S + 123
    assert obs.clock_offset_s[0] == 1e-9
    # The same digits behind the seconds, which moves what follows.
    obs = parse(head + "> 2024 06 24 08 20  1.000000123456  0  1\n" + sat3("G01", 2e7))
    assert obs.time_ns[0] - T0 == NS_PER_S + 123


@pytest.mark.parametrize(
    ("scale", "offset_s"),
    [("GPS", 0), ("GAL", 0), ("QZS", 0), ("IRN", 0), ("BDT", 14), ("GLO", 18), ("   ", 0)],
)
def test_time_systems(scale, offset_s):
    obs = parse(header3(TYPES, scale=scale) + epoch3(0, 1) + sat3("G01", 2e7))
    assert obs.time_ns[0] - T0 == offset_s * NS_PER_S


def test_a_pure_glonass_file_is_in_utc_by_default():
    obs = parse(header3(TYPES, scale="   ", system="R") + epoch3(0, 1) + sat3("R01", 2e7))
    assert obs.time_ns[0] - T0 == 18 * NS_PER_S


def test_scale_factors_and_phase_shifts():
    extra = line("G  100  2 L1C D1C", "SYS / SCALE FACTOR") + line("R   10", "SYS / SCALE FACTOR")
    extra += line("G L1C  0.25000", "SYS / PHASE SHIFT") + line("R L1C", "SYS / PHASE SHIFT")
    extra += line("G L2X -0.25000  02 G01 G05", "SYS / PHASE SHIFT")
    obs = parse(
        header3(TYPES, extra=extra) + epoch3(0, 2) + sat3("G01", 2e7, 110.0, 30.0) + sat3("R01", 2e8, 5.0)
    )
    np.testing.assert_array_equal(obs.code_m, [2e7, 2e7])
    np.testing.assert_array_equal(obs.phase_cyc, [1.1, 0.5])  # the shift is already in the phases
    np.testing.assert_array_equal(obs.doppler_hz, [0.3, np.nan])
    assert obs.meta.phase_shift_cyc == {"G1C": 0.25, "R1C": 0.0, "G012X": -0.25, "G052X": -0.25}


def test_glonass_header_records():
    extra = line("  3 R01  1 R02 -4 R24  2", "GLONASS SLOT / FRQ #")
    extra += line(" C1C  -71.940 C1P  -71.000 C2C              ", "GLONASS COD/PHS/BIS")
    obs = parse(header3(TYPES, extra=extra) + epoch3(0, 1) + sat3("R01", 2e7))
    assert obs.glonass_channel[[1, 2, 24]].tolist() == [1, -4, 2]
    assert obs.meta.glonass_code_phase_bias_m == {"1C": -71.94, "1P": -71.0}


def test_unknown_and_pseudo_types_are_skipped():
    types = {"G": "X1 C1C I1 L1C ZZZ D1C C1", "S": "C1C"}
    text = (
        header3(types) + epoch3(0, 2) + sat3("G01", 9.0, 2e7, 3.0, 4.5, 6.0, 7.5, 2.1e7) + sat3("S23", 3.8e7)
    )
    obs = parse(text)
    assert names(obs) == ["G01:1C", "G01:1?", "S23:1C"]
    np.testing.assert_array_equal(obs.phase_cyc, [4.5, np.nan, np.nan])
    np.testing.assert_array_equal(obs.doppler_hz, [7.5, np.nan, np.nan])
    np.testing.assert_array_equal(obs.code_m, [2e7, 2.1e7, 3.8e7])


def test_beidou_band_1_of_rinex_302_is_b1i():
    obs = parse(header3({"C": "C1I L1I C7I"}, version="3.02") + epoch3(0, 1) + sat3("C06", 2e7, 5.5, 2e7))
    assert names(obs) == ["C06:2I", "C06:7I"]
    assert obs.phase_cyc[0] == 5.5


def test_undeclared_system():
    obs = parse(header3({"G": "C1C"}) + epoch3(0, 2) + sat3("E11", 2e7) + sat3("G01", 2e7))
    assert names(obs) == ["G01:1C"]
    assert "1 satellite lines of systems without" in obs.meta.warnings[0]


def test_event_records():
    text = header3(TYPES) + epoch3(0, 1) + sat3("G01", 2e7)
    text += ">                              4  2\n"
    text += line("G    2 L1C C1C", "SYS / # / OBS TYPES") + line("antenna moved", "COMMENT")
    text += epoch3(0.5, 0, flag=5)
    text += epoch3(1, 1) + sat3("G01", 7.5, 2e7)
    text += epoch3(1.5, 2, flag=6) + sat3("G01", 3.0) + sat3("G02", 4.0)
    text += epoch3(2, 1, flag=3) + line("NEW", "MARKER NAME")
    text += epoch3(2, 1) + sat3("G01", 8.5, 2e7)
    obs = parse(text)
    np.testing.assert_array_equal(obs.code_m, [2e7, 2e7, 2e7])
    np.testing.assert_array_equal(obs.phase_cyc, [np.nan, 7.5, 8.5])
    assert [e.flag for e in obs.events] == [4, 5, 6, 3]
    assert obs.events[0].time_ns is None
    assert "antenna moved" in obs.events[0].text
    assert obs.events[1].time_ns == T0 + NS_PER_S // 2
    assert obs.events[2].text.split() == ["G01", "3.000", "G02", "4.000"]
    assert obs.meta.warnings == ()


def test_comments_blank_lines_and_crlf():
    text = header3(TYPES) + line("between header and data", "COMMENT") + epoch3(0, 2)
    text += sat3("G01", 2e7, 1.5) + line("G09 in an epoch", "COMMENT") + "\n" + sat3("G02", 2e7, 2.5)
    text += "\n" + line("between epochs", "COMMENT") + epoch3(1, 1) + sat3("G01", 2e7, 3.5)
    plain, windows = parse(text), parse(text.replace("\n", "\r\n"))
    for obs in (plain, windows):
        assert names(obs) == ["G01:1C", "G02:1C", "G01:1C"]
        assert obs.phase_cyc.tolist() == [1.5, 2.5, 3.5]
        assert obs.meta.warnings == ()


def test_more_satellites_than_a_line_or_a_table_expects():
    text = header3(dict.fromkeys("GRECJIS", "C1C"))
    sats = [f"{x}{n:02d}" for x in "SCERGJI" for n in range(1, 41)]
    text += epoch3(0, len(sats)) + "".join(sat3(s, 2e7 + k) for k, s in enumerate(sats))
    obs = parse(text)
    assert obs.n_rows == 280
    assert np.all(np.diff(obs.sat) > 0)
    assert obs.code_m[list(obs.sat).index(sat_id("C05"))] == 2e7 + 44


def test_arrays_grow():
    # Many short epochs: far more rows and epochs than the size of the file suggests.
    text = header3({"S": "C1C"}) + "".join(
        epoch3(k % 60, 1, minute=k // 60) + sat3("S20", 1.0 + k) for k in range(3000)
    )
    obs = parse(text)
    assert obs.code_m.tolist() == [1.0 + k for k in range(3000)]
    assert np.all(np.diff(obs.time_ns) == NS_PER_S)


def test_missing_end_of_header():
    text = header3(TYPES).replace(line("", "END OF HEADER"), "") + epoch3(0, 1) + sat3("G01", 2e7)
    obs = parse(text)
    assert names(obs) == ["G01:1C"]
    assert obs.meta.warnings == ("END OF HEADER is missing",)
    obs = parse(
        header2("C1 L1").replace(line("", "END OF HEADER"), "") + epoch2(0, ["G01"]) + rows2(2e7, 1.5)
    )
    assert names(obs) == ["G01:1C"]


def test_cut_off_in_a_line():
    text = header3(TYPES) + epoch3(0, 2) + sat3("G01", 2e7, 1.5) + sat3("G02", 2e7, 2.5)
    text += epoch3(1, 2) + sat3("G01", 2e7, 3.5) + sat3("G02", 2e7, 4.5)
    whole = parse(text)
    assert whole.n_rows == 4
    # Without the last line feed nothing is missing.
    assert parse(text[:-1]).n_rows == 4
    assert parse(text[:-1]).meta.warnings == ()
    cut = parse(text[:-6])
    assert names(cut) == ["G01:1C", "G02:1C", "G01:1C"]
    assert any("1 of 2 satellites kept" in w for w in cut.meta.warnings)
    cut = parse(text[: text.rindex(">") + 20])
    assert cut.n_epochs == 1


def test_short_epoch_does_not_swallow_the_next():
    text = header3(TYPES) + epoch3(0, 3) + sat3("G01", 2e7) + epoch3(1, 1) + sat3("G01", 2.1e7)
    obs = parse(text)
    assert obs.code_m.tolist() == [2e7, 2.1e7]
    assert "1 epochs have fewer satellites" in obs.meta.warnings[0]


def test_unreadable_epoch_and_satellite_lines():
    text = header3(TYPES) + epoch3(0, 2) + sat3("G01", 2e7) + sat3("Q01", 2e7)
    text += epoch3(1, 1).replace("2024 06", "2024 16") + sat3("G01", 2e7) + epoch3(2, 1) + sat3("G01", 2.2e7)
    obs = parse(text)
    assert obs.code_m.tolist() == [2e7, 2.2e7]
    assert "2 lines cannot be read" in obs.meta.warnings[0]


def test_repeated_and_backward_epochs_are_dropped():
    text = header3({"G": "C1C"})
    for second, code in ((0, 1.0), (1, 2.0), (1, 3.0), (40, 4.0), (2, 5.0), (3, 6.0)):
        text += epoch3(second, 1) + sat3("G01", code)
    obs = parse(text)
    assert obs.code_m.tolist() == [1.0, 2.0, 5.0, 6.0]
    assert np.all(np.diff(obs.time_ns) > 0)
    assert "2 epochs repeat a time or go back" in obs.meta.warnings[0]


def test_satellite_twice_in_an_epoch():
    obs = parse(header3(TYPES) + epoch3(0, 2) + sat3("G01", 2e7) + sat3("G01", 2.1e7))
    assert obs.code_m.tolist() == [2e7]
    assert obs.meta.warnings


# ------------------------------------------------------------------------------------ RINEX 2

T2 = gpst_from_calendar(2010, 3, 18, 5, 0)


def test_rinex2_signals_with_c1_and_p1():
    text = header2("C1 L1 L2 P2 P1 S1 S2") + epoch2(0, ["R05", "G07", "  3"])
    text += rows2(1.9e7, 10.5, 20.5, 1.91e7, 1.92e7, 41, 31)
    text += rows2(2.0e7, 11.5, 21.5, 2.01e7, 2.02e7, 42, 32)
    text += rows2(2.2e7, 12.5, None, None, 2.22e7, 43)
    text = text.rstrip("\n") + "\n"
    obs = parse(text)
    assert obs.time_ns.tolist() == [T2]
    assert names(obs) == ["G03:1C", "G03:1W", "G07:1C", "G07:1W", "G07:2W", "R05:1C", "R05:1P", "R05:2P"]
    np.testing.assert_array_equal(obs.phase_cyc, [12.5, np.nan, 11.5, np.nan, 21.5, 10.5, np.nan, 20.5])
    np.testing.assert_array_equal(obs.code_m, [2.2e7, 2.22e7, 2.0e7, 2.02e7, 2.01e7, 1.9e7, 1.92e7, 1.91e7])
    np.testing.assert_array_equal(obs.cn0_dbhz, [43, np.nan, 42, np.nan, 32, 41, np.nan, 31])


@pytest.mark.parametrize(
    ("types", "sat", "expected"),
    [
        ("P1 L1", "G01", ["G01:1W"]),
        ("P1 L1", "R01", ["R01:1P"]),
        ("L1", "G01", ["G01:1C"]),
        ("C2 L2", "G01", ["G01:2X"]),
        ("C2 L2", "R01", ["R01:2C"]),
        ("C5 L5", "G01", ["G01:5X"]),
        ("C1 L1", "E01", ["E01:1X"]),
        ("C7 L7", "E01", ["E01:7X"]),
        ("C8 L8", "E01", ["E01:8X"]),
        ("C6 L6", "E01", ["E01:6X"]),
        ("C1 L1", "S20", ["S20:1C"]),
        ("C1 L1", "C01", ["C01:2I"]),
        ("C2 L2", "C01", ["C01:2I"]),
        ("C7 L7", "C01", ["C01:7I"]),
        ("C6 L6", "C01", ["C01:6I"]),
        ("CA LA", "G01", ["G01:1C"]),
        ("CC LC", "G01", ["G01:2X"]),
    ],
)
def test_rinex2_names(types, sat, expected):
    n = len(types.split())
    obs = parse(header2(types) + epoch2(0, [sat]) + rows2(*[1.5e7 + k for k in range(n)]))
    assert names(obs) == expected
    assert np.all(np.isfinite(obs.phase_cyc))
    if n == 2:
        assert np.all(np.isfinite(obs.code_m))


def test_rinex2_continued_lists_and_blank_lines():
    sats = [f"G{k:02d}" for k in range(1, 15)] + [f"R{k:02d}" for k in range(1, 13)]
    text = header2("C1 L1 L2 P2 P1 D1 D2 S1 S2 C5 L5", extra=line("between", "COMMENT"))
    text += epoch2(0, sats, clock="-0.000000250")
    for k in range(len(sats)):
        full = rows2(2e7 + k, 1.5 + k, 2.5, 2e7, 2e7, 3.5, 4.5, 45, 40, None, None)
        text += full if k % 2 == 0 else rows2(2e7 + k, 1.5 + k) + "\n\n"
    text += epoch2(1, ["G01"]) + rows2(2e7, 9.5) + "\n\n"
    obs = parse(text)
    assert obs.meta.warnings == ()
    assert obs.n_epochs == 2
    assert obs.clock_offset_s[0] == -2.5e-7
    l1 = obs.signal == signal_id("1C")
    assert obs.phase_cyc[l1].tolist() == [1.5 + k for k in range(26)] + [9.5]
    assert len(np.unique(obs.sat)) == 26


def test_rinex2_events():
    text = header2("C1 L1") + epoch2(0, ["G01"]) + rows2(2e7, 1.5)
    text += f"{'':28}4  1\n" + line("     1    L1", "# / TYPES OF OBSERV")
    text += epoch2(1, ["G01"]) + rows2(2.5)
    text += f"{'':28}4  2\n" + line("     2    L1    C1", "# / TYPES OF OBSERV") + line("x", "COMMENT")
    sats = [f"G{k:02d}" for k in range(1, 14)]
    text += epoch2(1.5, sats, flag=6) + "".join(rows2(1.0, None) for _ in sats)
    text += epoch2(2, ["G01"]) + rows2(3.5, 2e7)
    obs = parse(text)
    np.testing.assert_array_equal(obs.phase_cyc, [1.5, 2.5, 3.5])
    np.testing.assert_array_equal(obs.code_m, [2e7, np.nan, 2e7])
    assert [e.flag for e in obs.events] == [4, 4, 6]
    assert obs.meta.warnings == ()


def test_rinex2_lost_lines_do_not_swallow_the_next_epoch():
    text = header2("C1 L1") + epoch2(0, ["G01", "G02", "G03"]) + rows2(2e7, 1.5)
    text += epoch2(1, ["G01"]) + rows2(2e7, 2.5)
    text += epoch2(2, ["G01", "G02"]) + rows2(2e7, 3.5) + f"{'':28}4  1\n" + line("x", "COMMENT")
    text += epoch2(3, ["G01"]) + rows2(2e7, 4.5)
    obs = parse(text)
    assert obs.phase_cyc.tolist() == [1.5, 2.5, 3.5, 4.5]
    assert "2 epochs have fewer satellites" in obs.meta.warnings[0]


def test_rinex2_two_digit_years_and_half_cycles():
    text = header2("C1 L1 L2", extra=line("     1     2", "WAVELENGTH FACT L1/2"))
    text += (epoch2(0, ["G01"]) + rows2(2e7, 1.5, 2.5)).replace(" 10  3 18", " 98  3 18")
    obs = parse(text)
    assert obs.time_ns[0] == gpst_from_calendar(1998, 3, 18, 5, 0)
    # A squaring receiver resolves half cycles on L2 only.
    assert obs.lli.tolist() == [0, LLI_HALF_CYCLE]


def test_both_ways_of_reading_fields_agree(monkeypatch):
    """The eight-byte path and the byte-by-byte path are the same function."""
    import sys

    rng = np.random.default_rng(1)
    text = header3({"G": "C1C L1C D1C S1C C2W L2W"})
    for k in range(40):
        text += epoch3(k, 8)
        for n in range(8):
            values = [float(v) for v in rng.normal(scale=10.0 ** rng.integers(-3, 8, 6))]
            text += sat3(
                f"G{n + 1:02d}", *[None if rng.random() < 0.2 else (v, rng.integers(0, 4)) for v in values]
            )
    fast = parse(text)
    monkeypatch.setattr(sys, "byteorder", "big")
    slow = parse(text)
    for column in ("time_ns", "sat", "signal", "code_m", "phase_cyc", "doppler_hz", "cn0_dbhz", "lli"):
        np.testing.assert_array_equal(getattr(fast, column), getattr(slow, column))
    assert fast.n_rows > 300


# ------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("text", "sentence", "line_number"),
    [
        ("hello\nworld\n", "not a RINEX file", 1),
        (line("     3.04           N: GNSS NAV DATA    M", "RINEX VERSION / TYPE"), "navigation file", 1),
        (line("     2.11           NAVIGATION DATA", "RINEX VERSION / TYPE"), "navigation file", 1),
        (line("     3.04           METEOROLOGICAL DATA", "RINEX VERSION / TYPE"), "meteorological", 1),
        (
            line("     7.00           OBSERVATION DATA    M", "RINEX VERSION / TYPE"),
            "version 7.00 is not known",
            1,
        ),
        (line("     x.yz           OBSERVATION DATA    M", "RINEX VERSION / TYPE"), "is not a number", 1),
        (header3({}), "no 'SYS / # / OBS TYPES' line", 3),
        (header2("C1").replace("# / TYPES OF OBSERV", "COMMENT"), "no '# / TYPES OF OBSERV' line", 4),
        (header3(TYPES) + "this is not\nan epoch\n", "no epoch can be read", 6),
        (header3(TYPES).replace("3.04", "2.11", 1), "no '# / TYPES OF OBSERV' line", None),
        (header3({"G": "C1C"}).replace("G    1", "G   xx"), "number of observation types", 2),
    ],
)
def test_refusals_name_path_line_and_remedy(text, sentence, line_number):
    with pytest.raises(FormatError, match=sentence) as caught:
        parse(text)
    assert caught.value.path == "sample"
    if line_number is not None:
        assert caught.value.line_number == line_number
    assert str(caught.value).count("\n") == 0


def test_header_only():
    obs = parse(header3(TYPES))
    assert obs.n_epochs == 0
    assert obs.n_rows == 0
    assert obs.epoch_start.tolist() == [0]
    assert obs.meta.warnings == ("the file holds a header and no observations",)


def test_a_header_without_end_is_refused():
    text = header3(TYPES).replace(line("", "END OF HEADER"), "") + line("x", "COMMENT") * 100_001
    with pytest.raises(FormatError, match="the header does not end"):
        parse(text)


def test_events_keep_the_order_of_the_file():
    text = header3({"G": "C1C"}) + epoch3(0, 1) + sat3("G01", 2e7) + epoch3(0.5, 0, flag=5)
    text += epoch3(1, 1, flag=1) + sat3("G01", 2e7) + epoch3(1.5, 0, flag=5) * 3
    assert [e.flag for e in parse(text).events] == [5, 1, 5, 5, 5]


def test_thousands_of_events_take_no_more_than_a_pass():
    text = header3({"G": "C1C"}) + (epoch3(0.5, 1, flag=5) + line("mark", "COMMENT")) * 5000
    text += epoch3(1, 1) + sat3("G01", 2e7)
    obs = parse(text)
    assert len(obs.events) == 5000
    assert obs.n_rows == 1


def test_warnings_are_bounded():
    text = header3({"G": "C1C"}) + (epoch3(0.5, 1, flag=4) + line("x", "INTERVAL")) * 200
    warnings = parse(text + epoch3(1, 1) + sat3("G01", 2e7)).meta.warnings
    assert len(warnings) == 51
    assert warnings[-1] == "and 150 more warnings"
