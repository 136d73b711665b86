"""ANTEX files written by hand: offsets and variations by direction, the choice of the antenna, refusals."""

import gzip

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from truenorth.errors import FormatError
from truenorth.formats import parse_antex, phase_centre_correction_m, read_antex
from truenorth.observations import sat_id
from truenorth.timescales import gpst_from_calendar

ZENITH_DEG = np.arange(0.0, 91.0, 10.0)
AZIMUTH_DEG = np.arange(0.0, 361.0, 45.0)


def line(content, label):
    return f"{content:<60}{label:<20}\n"


def noazi(value):
    return -0.1 * value


def variation(azimuth_deg, zenith_deg):
    """Millimetres; piecewise linear in both angles, so that interpolation is exact."""
    return -0.1 * zenith_deg + 0.02 * np.abs(azimuth_deg - 180.0) * zenith_deg / 90.0


def row(head, values):
    return f"{head:>8}" + "".join(f"{value:8.2f}" for value in values) + "\n"


def frequency(code, offset_mm, *, grid=False, zenith_deg=ZENITH_DEG, scale=1.0):
    text = line(f"   {code}", "START OF FREQUENCY")
    text += line("".join(f"{value:10.2f}" for value in offset_mm), "NORTH / EAST / UP")
    text += row("NOAZI", scale * noazi(zenith_deg))
    if grid:
        text += "".join(row(f"{az:.1f}", scale * variation(az, zenith_deg)) for az in AZIMUTH_DEG)
    return text + line(f"   {code}", "END OF FREQUENCY")


def antenna(kind, serial="", *, dazi=0.0, zenith="     0.0  90.0  10.0", body="", valid=""):
    return (
        line("", "START OF ANTENNA")
        + line(f"{kind:<20}{serial:<20}", "TYPE / SERIAL NO")
        + line(f"{'ROBOT':<20}{'made up':<20}{1:6d}    {'01-JAN-20':<10}", "METH / BY / # / DATE")
        + line(f"  {dazi:6.1f}", "DAZI")
        + line(zenith, "ZEN1 / ZEN2 / DZEN")
        + line(f"{body.count('START OF FREQUENCY'):6d}", "# OF FREQUENCIES")
        + valid
        + line("a remark", "COMMENT")
        + body
        + line("", "END OF ANTENNA")
    )


HEADER = (
    line("     1.4            M", "ANTEX VERSION / SYST")
    + line("A", "PCV TYPE / REFANT")
    + line("", "END OF HEADER")
)
RMS = (
    line("   G01", "START OF FREQ RMS")
    + line("      0.10      0.10      0.10", "NORTH / EAST / UP")
    + row("NOAZI", 0.1 + 0 * ZENITH_DEG)
    + line("   G01", "END OF FREQ RMS")
)
NADIR_DEG = np.arange(0.0, 15.0)
FILE = (
    HEADER
    + antenna(
        "BLOCK IIF", "G05", zenith="     0.0  14.0   1.0",
        body=frequency("G01", (394.0, 0.0, 1560.0), zenith_deg=NADIR_DEG),
        valid=line("  2009    12    17     0     0    0.0000000", "VALID FROM")
        + line("  2019    12    31    23    59   59.9999999", "VALID UNTIL"),
    )
    + antenna(
        "BLOCK IIIA", "G05", zenith="     0.0  14.0   1.0",
        body=frequency("G01", (0.0, 10.0, 1000.0), zenith_deg=NADIR_DEG),
        valid=line("  2020     1     1     0     0    0.0000000", "VALID FROM"),
    )
    + antenna(
        "TSTANT1         NONE", dazi=45.0,
        body=frequency("G01", (1.0, -2.0, 90.0), grid=True)
        + frequency("G02", (0.0, 0.0, 120.0), grid=True, scale=2)
        + RMS,
    )
    + antenna("TSTANT1         NONE", "4711", body=frequency("G01", (0.0, 0.0, 50.0)))
    + antenna("TSTANT1         SCIS", "0815", body=frequency("G01", (0.0, 0.0, 51.0)))
)  # fmt: skip
ANTEX = parse_antex(FILE.encode())


def test_offset_is_taken_off_along_the_ray():
    """Straight up the offset shortens the path by its height; towards the horizon by its horizontal part."""
    one = ANTEX.receiver("TSTANT1         NONE")
    np.testing.assert_allclose(phase_centre_correction_m(one, "G01", 0.3, np.pi / 2), -0.090, atol=1e-12)
    east = phase_centre_correction_m(one, "G01", np.pi / 2, 0.0)
    np.testing.assert_allclose(east, 0.002 + 1e-3 * variation(90.0, 90.0), atol=1e-12)
    north = phase_centre_correction_m(one, "G01", 0.0, 0.0)
    np.testing.assert_allclose(north, -0.001 + 1e-3 * variation(0.0, 90.0), atol=1e-12)


@given(st.floats(-720.0, 720.0), st.floats(0.0, 90.0))
def test_variation_is_bilinear(azimuth_deg, zenith_deg):
    pattern = ANTEX.receiver("TSTANT1 NONE").pattern("G01")
    found = pattern.variation_m(np.deg2rad(azimuth_deg), np.deg2rad(zenith_deg))
    # The grid of the file holds hundredths of a millimetre.
    assert abs(found - 1e-3 * variation(azimuth_deg % 360.0, zenith_deg)) < 1e-5


def test_arrays_and_angles_beyond_the_grid():
    azimuth = np.linspace(0.0, 2 * np.pi, 24).reshape(4, 6)
    found = ANTEX.range_correction_m("TSTANT1", "G01", azimuth, np.deg2rad(40.0))
    assert found.shape == (4, 6)
    pattern = ANTEX.receiver("TSTANT1").pattern("G01")
    np.testing.assert_allclose(
        pattern.variation_m(azimuth, np.deg2rad(97.0)), pattern.variation_m(azimuth, np.pi / 2), atol=1e-15
    )
    single = ANTEX.receiver("TSTANT1", "4711").pattern("G01")
    np.testing.assert_allclose(single.variation_m(azimuth, np.deg2rad(35.0)), 1e-3 * noazi(35.0))


def test_the_closest_calibrated_frequency_stands_for_others():
    one = ANTEX.receiver("TSTANT1")
    assert one.pattern("E01") is one.patterns["G01"]
    for code in ("E05", "C07", "J02", "R02"):
        assert one.pattern(code) is one.patterns["G02"]
    with pytest.raises(FormatError, match="not calibrated for 'E05'; it is for G01, G02"):
        one.pattern("E05", exact=True)
    with pytest.raises(FormatError, match="not calibrated for 'X9'"):
        one.pattern("X9")


def test_which_antenna():
    assert ANTEX.receiver("TSTANT1         NONE").serial == ""
    assert ANTEX.receiver("TSTANT1", "4711").serial == "4711"
    assert ANTEX.receiver("TSTANT1", "4712").serial == ""
    assert ANTEX.receiver("TSTANT1         SCIS", "0815").patterns["G01"].offset_m[2] == 51.0 * 1e-3
    for kind, message in (
        ("TSTANT1         SCIS", "only single antennas of type 'TSTANT1         SCIS', .* 0815"),
        ("TSTANT1         SNOW", "not with the radome 'SNOW' but with NONE, SCIS"),
        ("OTHER", "no antenna 'OTHER'"),
    ):
        with pytest.raises(FormatError, match=message):
            ANTEX.receiver(kind)


def test_satellites_have_their_times_and_axes():
    sat = sat_id("G05")
    old = ANTEX.satellite(sat, gpst_from_calendar(2012, 1, 1))
    new = ANTEX.satellite(sat, gpst_from_calendar(2024, 1, 1))
    assert (old.type, new.type) == ("BLOCK IIF", "BLOCK IIIA")
    # Azimuth runs from y to x: an offset along x is met at 90 degrees, one along y at 0.
    nadir = np.deg2rad(14.0)
    for one, azimuth, across in ((old, np.pi / 2, 0.394), (new, 0.0, 0.010)):
        found = phase_centre_correction_m(one, "G01", azimuth, np.pi / 2 - nadir)
        offset = across * np.sin(nadir) + one.patterns["G01"].offset_m[2] * np.cos(nadir)
        np.testing.assert_allclose(found, 1e-3 * noazi(14.0) - offset, atol=1e-12)
    with pytest.raises(FormatError, match="no antenna of G05 at 2001-"):
        ANTEX.satellite(sat, gpst_from_calendar(2001, 1, 1))
    with pytest.raises(FormatError, match="no antenna of E11"):
        ANTEX.satellite(sat_id("E11"), gpst_from_calendar(2024, 1, 1))


def test_a_packed_file_and_what_it_says(tmp_path):
    path = tmp_path / "a.atx.gz"
    path.write_bytes(gzip.compress(FILE.encode()))
    antex = read_antex(path)
    assert (antex.version, antex.is_absolute, antex.path, len(antex.antennas)) == ("1.4", True, str(path), 5)
    assert antex.antennas[2].method == "ROBOT"
    assert list(antex.antennas[2].patterns) == ["G01", "G02"]
    assert not parse_antex(FILE.replace("A   ", "R   ", 1).replace("\nA ", "\nR ").encode()).is_absolute


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("ANTEX VERSION / SYST", "RINEX VERSION / TYPE", "line 1: this is no ANTEX file"),
        ("     0.0  90.0  10.0", "     0.0  90.0   x.0", "this line of the antenna 'TSTANT1         NONE'"),
        ("  14.0   1.0  ", "  14.0   0.0  ", "this line of the antenna 'BLOCK IIF'"),
        ("   -9.00", "     nan", "this line of the antenna 'TSTANT1"),
        ("    45.0    0.00", "    46.0    0.00", "this line of the antenna 'TSTANT1"),
        ("   -9.00", "        ", "this line of the antenna 'TSTANT1"),
        ("    394.00      0.00   1560.00", "    394.00      0.00", "this line of the antenna 'BLOCK IIF'"),
        ("NORTH / EAST / UP", "COMMENT          ", "this line of the antenna 'BLOCK IIF'"),
        ("TYPE / SERIAL NO", "COMMENT         ", "no line 'TYPE / SERIAL NO'"),
    ],
)
def test_damaged_files_are_refused(old, new, message):
    text = FILE.replace(old, new)
    assert text != FILE
    with pytest.raises(FormatError, match=message):
        parse_antex(text.encode())


def test_cut_files_are_refused():
    with pytest.raises(FormatError, match="ends within an antenna"):
        parse_antex(FILE[:-200].encode())
    with pytest.raises(FormatError, match="has no antenna"):
        parse_antex(HEADER.encode())
