"""Broadcast frames packed by hand in the order of the documents, sent through a UBX log and back."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from truenorth.formats.navigation_frames import (
    beidou_words,
    fnav_words,
    glonass_words,
    inav_words,
    lnav_words,
)
from truenorth.formats.ubx import parse_ubx
from truenorth.formats.ubx_writer import encode_sfrbx as sfrbx
from truenorth.navigation import STATE_COLUMNS, MessageType
from truenorth.observations import sat_id
from truenorth.timescales import NS_PER_S, NS_PER_WEEK, gpst_from_calendar, week_from_gpst
from ubx_writer import measurement, pack, rawx, width

PI = 3.1415926535898  # of the interface documents
SEMI = PI * 2.0**-31
RATE = PI * 2.0**-43


def filler(count, value=0):
    return (None, count, value)


# Order and width of all fields, from the figures of IS-GPS-200N (20-1), parity left out.
def lnav_head(number):
    return [filler(8, 0x8B), filler(16), ("tow", 17, "u"), filler(2), filler(3, number), filler(2)]


LNAV = {
    1: [*lnav_head(1), ("week", 10, "u"), filler(2, 1), ("ura", 4, "u"), ("health", 6, "u"),
        ("iodc_high", 2, "u"), filler(1), filler(23), filler(24), filler(24), filler(16), ("tgd", 8, "s"),
        ("iode", 8, "u"), ("toe", 16, "u"), ("af2", 8, "s"), ("af1", 16, "s"), ("af0", 22, "s"), filler(2)],
    2: [*lnav_head(2), ("iode", 8, "u"), ("crs", 16, "s"), ("delta_n", 16, "s"), ("m0", 32, "s"),
        ("cuc", 16, "s"), ("e", 32, "u"), ("cus", 16, "s"), ("sqrt_a", 32, "u"), ("toe", 16, "u"),
        filler(1), filler(5), filler(2)],
    3: [*lnav_head(3), ("cic", 16, "s"), ("omega0", 32, "s"), ("cis", 16, "s"), ("i0", 32, "s"),
        ("crc", 16, "s"), ("omega", 32, "s"), ("omega_dot", 24, "s"), ("iode", 8, "u"), ("idot", 14, "s"),
        filler(2)],
}  # fmt: skip
LNAV_SCALES = {
    "crs_m": ("crs", 2.0**-5), "delta_n_radps": ("delta_n", RATE), "m0_rad": ("m0", SEMI),
    "cuc_rad": ("cuc", 2.0**-29), "eccentricity": ("e", 2.0**-33), "cus_rad": ("cus", 2.0**-29),
    "sqrt_a": ("sqrt_a", 2.0**-19), "cic_rad": ("cic", 2.0**-29), "omega0_rad": ("omega0", SEMI),
    "cis_rad": ("cis", 2.0**-29), "i0_rad": ("i0", SEMI), "crc_m": ("crc", 2.0**-5),
    "omega_rad": ("omega", SEMI), "omega_dot_radps": ("omega_dot", RATE), "idot_radps": ("idot", RATE),
    "af0_s": ("af0", 2.0**-31), "af1_sps": ("af1", 2.0**-43), "af2_sps2": ("af2", 2.0**-55),
}  # fmt: skip

# Galileo OS SIS ICD 2.1, tables 39-43.
INAV = {
    1: [filler(6, 1), ("iod", 10, "u"), ("toe", 14, "u"), ("m0", 32, "s"), ("e", 32, "u"),
        ("sqrt_a", 32, "u"), filler(2)],
    2: [filler(6, 2), ("iod", 10, "u"), ("omega0", 32, "s"), ("i0", 32, "s"), ("omega", 32, "s"),
        ("idot", 14, "s"), filler(2)],
    3: [filler(6, 3), ("iod", 10, "u"), ("omega_dot", 24, "s"), ("delta_n", 16, "s"), ("cuc", 16, "s"),
        ("cus", 16, "s"), ("crc", 16, "s"), ("crs", 16, "s"), ("sisa", 8, "u")],
    4: [filler(6, 4), ("iod", 10, "u"), ("svid", 6, "u"), ("cic", 16, "s"), ("cis", 16, "s"),
        ("toe", 14, "u"),
        ("af0", 31, "s"), ("af1", 21, "s"), ("af2", 6, "s"), filler(2)],
    5: [filler(6, 5), filler(11), filler(11), filler(14), filler(5), ("tgd", 10, "s"), ("tgd2", 10, "s"),
        ("e5b_hs", 2, "u"), ("e1b_hs", 2, "u"), ("e5b_dvs", 1, "u"), ("e1b_dvs", 1, "u"), ("week", 12, "u"),
        ("tow", 20, "u"), filler(23)],
}  # fmt: skip
# The same, tables 29-32.
FNAV = {
    1: [filler(6, 1), ("svid", 6, "u"), ("iod", 10, "u"), ("toe", 14, "u"), ("af0", 31, "s"),
        ("af1", 21, "s"),
        ("af2", 6, "s"), ("sisa", 8, "u"), filler(36), filler(5), ("tgd", 10, "s"), ("e5a_hs", 2, "u"),
        ("week", 12, "u"), ("tow", 20, "u"), ("e5a_dvs", 1, "u"), filler(26)],
    2: [filler(6, 2), ("iod", 10, "u"), ("m0", 32, "s"), ("omega_dot", 24, "s"), ("e", 32, "u"),
        ("sqrt_a", 32, "u"), ("omega0", 32, "s"), ("idot", 14, "s"), ("week", 12, "u"), ("tow", 20, "u")],
    3: [filler(6, 3), ("iod", 10, "u"), ("i0", 32, "s"), ("omega", 32, "s"), ("delta_n", 16, "s"),
        ("cuc", 16, "s"), ("cus", 16, "s"), ("crc", 16, "s"), ("crs", 16, "s"), ("toe", 14, "u"),
        ("week", 12, "u"), ("tow", 20, "u"), filler(8)],
    4: [filler(6, 4), ("iod", 10, "u"), ("cic", 16, "s"), ("cis", 16, "s"), filler(32), filler(24), filler(8),
        filler(8), filler(8), filler(8), filler(3), filler(8), filler(8), filler(16), filler(12), filler(6),
        filler(20), filler(5)],
}  # fmt: skip
GALILEO_SCALES = {**LNAV_SCALES, "af0_s": ("af0", 2.0**-34), "af1_sps": ("af1", 2.0**-46),
                  "af2_sps2": ("af2", 2.0**-59)}  # fmt: skip


# BDS-SIS-ICD-B1I-3.0, figures 5-6 to 5-8.
def d1_head(number):
    return [filler(11, 0x712), filler(4), filler(3, number), (f"sow{number}", 20, "u")]


D1 = {
    1: [*d1_head(1), ("health", 1, "u"), ("aodc", 5, "u"), ("ura", 4, "u"), ("week", 13, "u"),
        ("toe", 17, "u"),
        ("tgd", 10, "s"), ("tgd2", 10, "s"), filler(64), ("af2", 11, "s"), ("af0", 24, "s"), ("af1", 22, "s"),
        ("aode", 5, "u")],
    2: [*d1_head(2), ("delta_n", 16, "s"), ("cuc", 18, "s"), ("m0", 32, "s"), ("e", 32, "u"),
        ("cus", 18, "s"),
        ("crc", 18, "s"), ("crs", 18, "s"), ("sqrt_a", 32, "u"), ("toe_high", 2, "u")],
    3: [*d1_head(3), ("toe", 15, "u"), ("i0", 32, "s"), ("cic", 18, "s"), ("omega_dot", 24, "s"),
        ("cis", 18, "s"), ("idot", 14, "s"), ("omega0", 32, "s"), ("omega", 32, "s"), filler(1)],
}  # fmt: skip
D1_SCALES = {
    **LNAV_SCALES, "crs_m": ("crs", 2.0**-6), "crc_m": ("crc", 2.0**-6), "cuc_rad": ("cuc", 2.0**-31),
    "cus_rad": ("cus", 2.0**-31), "cic_rad": ("cic", 2.0**-31), "cis_rad": ("cis", 2.0**-31),
    "af0_s": ("af0", 2.0**-33), "af1_sps": ("af1", 2.0**-50), "af2_sps2": ("af2", 2.0**-66),
    "tgd_s": ("tgd", 1e-10), "tgd2_s": ("tgd2", 1e-10),
}  # fmt: skip

# GLONASS ICD 5.1, table 4.6 and figure 4.3, from bit 85 down.
STRINGS = {
    1: [filler(1), filler(4, 1), filler(2), filler(2), ("hour", 5, "u"), ("minute", 6, "u"), filler(1),
        ("vx", 24, "m"), ("ax", 5, "m"), ("x", 27, "m"), filler(8)],
    2: [filler(1), filler(4, 2), ("bn", 3, "u"), filler(1), ("tb", 7, "u"), filler(5), ("vy", 24, "m"),
        ("ay", 5, "m"), ("y", 27, "m"), filler(8)],
    3: [filler(1), filler(4, 3), filler(1), ("gamma", 11, "m"), filler(1), filler(2, 3), ("ln", 1, "u"),
        ("vz", 24, "m"), ("az", 5, "m"), ("z", 27, "m"), filler(8)],
    4: [filler(1), filler(4, 4), ("tau", 22, "m"), ("dtau", 5, "m"), filler(5), filler(14), filler(1),
        filler(4), filler(3), filler(11), filler(5), filler(2), filler(8)],
}  # fmt: skip


def test_layouts_have_the_lengths_of_the_documents():
    assert {width(fields) for fields in LNAV.values()} == {240}
    assert {width(fields) for fields in INAV.values()} == {128}
    assert {width(fields) for fields in FNAV.values()} == {214}
    assert {width(fields) for fields in D1.values()} == {224}
    assert {width(fields) for fields in STRINGS.values()} == {85}


@st.composite
def values_of(draw, frames):
    """Integers for every field, over its whole range; the orbit stays one that a satellite can have."""
    values = {}
    for fields in frames.values():
        for name, count, kind in fields:
            if name is None or name in values:
                continue
            low, high = 0, (1 << count) - 1
            if kind == "s":
                low, high = -(1 << (count - 1)), (1 << (count - 1)) - 1
            elif kind == "m":
                low, high = -((1 << (count - 1)) - 1), (1 << (count - 1)) - 1
            values[name] = draw(st.integers(low, high))
    if "sqrt_a" in values:
        values["sqrt_a"] = draw(st.integers(5_000 * 2**19, 6_600 * 2**19))
        values["e"] = draw(st.integers(0, 2**31))
    return values


def log_of(time_ns, messages):
    week, tow_s = week_from_gpst(time_ns)
    epoch = [measurement(0, 3), measurement(6, 7, channel=-4)]
    return rawx(week, tow_s, epoch) + b"".join(messages) + rawx(week, tow_s + 1, epoch)


def check_elements(eph, values, scales):
    for column, (name, scale) in scales.items():
        # One product each: equal up to the order of multiplication.
        assert math.isclose(eph.column(column)[0], values[name] * scale, rel_tol=1e-15, abs_tol=0.0), column


@given(values_of(LNAV), st.integers(1100, 4000), st.integers(0, 100_799))
def test_lnav(values, week, count):
    """Every field comes back; the ten-bit week and the toe near a week's border find their place."""
    start_s = count * 6 % 604_800 // 30 * 30
    time_ns = week * NS_PER_WEEK + (start_s + 18) * NS_PER_S
    toe = values["toe"] = values["toe"] % 37_800
    values["week"] = week % 1024
    messages = []
    for number, fields in LNAV.items():
        values["tow"] = (start_s // 6 + number) % 100_800
        messages.append(sfrbx(0, 3, lnav_words(pack(fields, values))))
    _, navigation = parse_ubx(log_of(time_ns, messages))
    eph = navigation.kepler
    assert (eph.sat.tolist(), eph.message.tolist()) == ([3], [MessageType.LNAV])
    check_elements(eph, values, LNAV_SCALES)
    tgd = 0 if values["tgd"] == -128 else values["tgd"]
    assert eph.column("tgd_s")[0] == tgd * 2.0**-31
    assert (eph.iode[0], eph.iodc[0]) == (values["iode"], values["iodc_high"] << 8 | values["iode"])
    assert eph.health[0] == values["health"]
    assert eph.transmission_ns[0] == week * NS_PER_WEEK + (start_s + 6) * NS_PER_S
    assert eph.toe_ns[0] == eph.toc_ns[0]
    assert eph.toe_ns[0] // NS_PER_S % 604_800 == toe * 16
    assert abs(eph.toe_ns[0] - eph.transmission_ns[0]) <= NS_PER_WEEK // 2


@given(values_of(LNAV), st.integers(1, 255))
def test_lnav_subframes_of_different_issues_are_not_joined(values, difference):
    messages = []
    for number, fields in LNAV.items():
        other = dict(values, iode=values["iode"] ^ difference) if number == 3 else values
        messages.append(sfrbx(0, 3, lnav_words(pack(fields, other))))
    _, navigation = parse_ubx(log_of(2000 * NS_PER_WEEK, messages))
    assert len(navigation.kepler) == 0


@given(values_of(INAV), st.sampled_from([1, 5]))
def test_inav(values, sig):
    values |= {"svid": 11, "week": 1200, "tow": 300_000, "toe": values["toe"] % 10_080}
    messages = [sfrbx(2, 11, inav_words(pack(fields, values)), sig=sig) for fields in INAV.values()]
    time_ns = (1024 + 1200) * NS_PER_WEEK + 300_010 * NS_PER_S
    _, navigation = parse_ubx(log_of(time_ns, messages))
    eph = navigation.kepler
    assert (eph.sat.tolist(), eph.message.tolist()) == ([sat_id("E11")], [MessageType.INAV])
    scales = GALILEO_SCALES | {"tgd_s": ("tgd", 2.0**-32), "tgd2_s": ("tgd2", 2.0**-32)}
    check_elements(eph, values, scales)
    health = values["e1b_dvs"] | values["e1b_hs"] << 1 | values["e5b_dvs"] << 6 | values["e5b_hs"] << 7
    assert (eph.iode[0], eph.health[0]) == (values["iod"], health)
    assert eph.toe_ns[0] // NS_PER_S % 604_800 == values["toe"] * 60
    assert eph.transmission_ns[0] == time_ns - 10 * NS_PER_S


@given(values_of(FNAV))
def test_fnav(values):
    values |= {"svid": 11, "week": 1200, "tow": 300_000, "toe": values["toe"] % 10_080}
    messages = [sfrbx(2, 11, fnav_words(pack(fields, values)), sig=3) for fields in FNAV.values()]
    _, navigation = parse_ubx(log_of((1024 + 1200) * NS_PER_WEEK + 300_010 * NS_PER_S, messages))
    eph = navigation.kepler
    assert (eph.sat.tolist(), eph.message.tolist()) == ([sat_id("E11")], [MessageType.FNAV])
    check_elements(eph, values, GALILEO_SCALES | {"tgd_s": ("tgd", 2.0**-32)})
    assert eph.health[0] == values["e5a_dvs"] << 3 | values["e5a_hs"] << 4


@given(values_of(INAV), st.integers(0, 127))
def test_a_flipped_bit_in_a_galileo_page_is_noticed(values, bit):
    """The checksum of the page is verified, so no wrong orbit comes of it."""
    values["svid"] = 11
    messages = []
    for number, fields in INAV.items():
        words = inav_words(pack(fields, values))
        if number == 2:
            words[bit // 32] ^= 0x80000000 >> bit % 32 if bit < 114 else 0x40000000
        messages.append(sfrbx(2, 11, words, sig=1))
    _, navigation = parse_ubx(log_of(2224 * NS_PER_WEEK, messages))
    assert len(navigation.kepler) == 0
    assert navigation.skipped == {"I/NAV page": 1}


@given(values_of(D1), st.integers(0, 20_159))
def test_d1(values, frame_number):
    """BeiDou time is 14 s behind GPS time; toe crosses from subframe 2 to 3."""
    start_s = 30 * frame_number
    toe = (start_s // 3600 * 3600) // 8
    values |= {f"sow{k}": start_s + 6 * (k - 1) for k in (1, 2, 3)}
    values |= {"week": 900, "toe": toe, "toe_high": toe >> 15}
    messages = [sfrbx(3, 21, beidou_words(pack(fields, values))) for fields in D1.values()]
    time_ns = (1356 + 900) * NS_PER_WEEK + (start_s + 20) * NS_PER_S
    _, navigation = parse_ubx(log_of(time_ns, messages))
    eph = navigation.kepler
    assert (eph.sat.tolist(), eph.message.tolist()) == ([sat_id("C21")], [MessageType.D1])
    check_elements(eph, values, D1_SCALES)
    assert (eph.iode[0], eph.iodc[0], eph.health[0]) == (values["aode"], values["aodc"], values["health"])
    assert eph.toe_ns[0] == (1356 + 900) * NS_PER_WEEK + (toe * 8 + 14) * NS_PER_S
    assert eph.transmission_ns[0] == (1356 + 900) * NS_PER_WEEK + (start_s + 14) * NS_PER_S


@given(values_of(D1), st.sampled_from([-30, 30, 3600]))
def test_d1_subframes_of_different_frames_are_not_joined(values, shift_s):
    values |= {"sow1": 7200, "sow2": 7206, "sow3": 7212 + shift_s, "week": 900}
    messages = [sfrbx(3, 21, beidou_words(pack(fields, values))) for fields in D1.values()]
    _, navigation = parse_ubx(log_of((1356 + 900) * NS_PER_WEEK + 7300 * NS_PER_S, messages))
    assert len(navigation.kepler) == 0


@given(values_of(STRINGS), st.integers(1, 95), st.integers(-7, 6))
def test_glonass(values, tb, channel):
    """Signs and magnitudes, the channel, and Moscow time: UTC + 3 h, 18 s behind GPS time in 2023."""
    for axis, sign in zip("xyz", (1, -1, 1), strict=True):
        values[axis] = sign * (14_500 * 2**11 + abs(values[axis]) % 2**20)
    moscow_s = 900 * tb - 420
    values |= {"tb": tb, "hour": moscow_s // 3600, "minute": moscow_s % 3600 // 60}
    midnight_ns = gpst_from_calendar(2023, 9, 19) + (18 - 3 * 3600) * NS_PER_S
    time_ns = midnight_ns + moscow_s * NS_PER_S
    messages = [
        sfrbx(6, 7, glonass_words(pack(fields, values), 77, 2), channel=channel)
        for fields in STRINGS.values()
    ]
    _, navigation = parse_ubx(log_of(time_ns + 10 * NS_PER_S, messages))
    eph = navigation.states
    assert (eph.sat.tolist(), eph.channel.tolist()) == ([sat_id("R07")], [channel])
    assert eph.toe_ns[0] == midnight_ns + 900 * tb * NS_PER_S
    assert eph.transmission_ns[0] == time_ns
    assert eph.health[0] == values["bn"] >> 2 | values["ln"] << 1
    scales = dict.fromkeys(("x", "y", "z"), 1e3 * 2.0**-11)
    scales |= dict.fromkeys(("vx", "vy", "vz"), 1e3 * 2.0**-20)
    scales |= dict.fromkeys(("ax", "ay", "az"), 1e3 * 2.0**-30)
    scales |= {"tau": -(2.0**-30), "gamma": 2.0**-40, "dtau": 2.0**-30}
    for value, (name, scale), column in zip(eph.states[0], scales.items(), STATE_COLUMNS, strict=True):
        assert math.isclose(value, values[name] * scale, rel_tol=1e-15, abs_tol=0.0), column


@pytest.mark.parametrize(("tow_count", "week_of_log"), [(100_799, 2100), (0, 2101), (1, 2101)])
def test_lnav_week_at_its_border(tow_count, week_of_log):
    """The hand-over word counts to the start of the next subframe; its zero is sent in the old week."""
    values = {name: 0 for fields in LNAV.values() for name, _, _ in fields if name}
    values |= {"sqrt_a": 5153 * 2**19, "week": 2100 % 1024, "toe": 0}
    if tow_count == 1:
        values["week"] = 2101 % 1024
    messages = []
    for number, fields in LNAV.items():
        values["tow"] = (tow_count + number - 1) % 100_800
        messages.append(sfrbx(0, 3, lnav_words(pack(fields, values))))
    _, navigation = parse_ubx(log_of(week_of_log * NS_PER_WEEK, messages))
    expected_ns = (2100 if tow_count == 100_799 else 2101) * NS_PER_WEEK + 6 * tow_count * NS_PER_S
    assert navigation.kepler.transmission_ns.tolist() == [expected_ns]
    assert navigation.kepler.toe_ns.tolist() == [2101 * NS_PER_WEEK]
