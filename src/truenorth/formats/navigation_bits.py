"""Raw broadcast navigation bits of a receiver's log, assembled into ephemerides.

A satellite spreads one ephemeris over several short frames: three subframes (GPS and QZSS LNAV, BeiDou
D1), ten pages (BeiDou D2), four or five words (Galileo I/NAV and F/NAV), four strings (GLONASS). Each
frame reaches this module as one integer whose most significant bit was sent first, with the parity
of the GPS and BeiDou words already removed, so that every field is a run of bits, or two or three runs
where a field crosses a frame border:

    value = scale * (bits, as unsigned, two's complement, or sign and magnitude)

Frames are joined only when they provably belong together: equal issue of data (GPS, QZSS, Galileo), or
the same frame of the signal (BeiDou, GLONASS, whose frames carry no issue).

References
----------
IS-GPS-200N 20.3.3; IS-QZSS-PNT-005 4.3; Galileo OS SIS ICD 2.1 4.2-4.3 and 5.1; BDS-SIS-ICD-B1I-3.0
5.2-5.3; GLONASS ICD L1/L2 5.1 4.3-4.5.
"""

from typing import NamedTuple

import numpy as np

from ..constants import QZSS
from ..navigation import KEPLER_COLUMNS, STATE_COLUMNS, MessageType, build_navigation
from ..timescales import BDT_OFFSET_NS, NS_PER_DAY, NS_PER_S, NS_PER_WEEK, gpst_from_utc_ns, leap_seconds

__all__ = [
    "D1_BITS",
    "D2_BITS",
    "FNAV_BITS",
    "GLONASS_BITS",
    "INAV_BITS",
    "LNAV_BITS",
    "BitField",
    "BroadcastDecoder",
    "extract",
]

LNAV_BITS = 240
"""Bits of a GPS or QZSS subframe without parity: ten words of 24 bits."""
D1_BITS = 224
"""Bits of a BeiDou D1 subframe without parity: one word of 26 bits, nine of 22."""
D2_BITS = 224
"""Bits of a BeiDou D2 subframe without parity, as `D1_BITS`."""
INAV_BITS = 128
"""Bits of a Galileo I/NAV word: 112 of the even page part, 16 of the odd one."""
FNAV_BITS = 214
"""Bits of a Galileo F/NAV page before its checksum: 6 of type, 208 of data."""
GLONASS_BITS = 85
"""Bits of a GLONASS string, from bit 85 (idle) down to bit 1."""

GALILEO_WEEK = 1024
BEIDOU_WEEK = 1356
_GLONASS_FRAME_NS = 60 * NS_PER_S  # 30 s, and room for a log whose times come late
_PI = 3.1415926535898  # the value that all the interface documents prescribe


class BitField(NamedTuple):
    """Where a quantity stands in the frames and what its bits mean.

    Parameters
    ----------
    runs : tuple of tuple of int
        Runs of bits, most significant first: (frame, first bit, number of bits). Bit 0 was sent first.
    scale : float
        Value of the least significant bit in SI units (angles in radians).
    kind : {"u", "s", "m"}
        Unsigned, two's complement, or sign and magnitude.
    """

    runs: tuple[tuple[int, int, int], ...]
    scale: float = 1.0
    kind: str = "u"


def _field(*numbers, scale=1.0, kind="u"):
    return BitField(tuple(zip(numbers[::3], numbers[1::3], numbers[2::3], strict=True)), scale, kind)


def _signed(*numbers, scale):
    return _field(*numbers, scale=scale, kind="s")


def _magnitude(*numbers, scale):
    return _field(*numbers, scale=scale, kind="m")


def _klobuchar_fields(frame, first):
    """Alpha 0-3 and beta 0-3, eight bits each, which GPS, QZSS and BeiDou pack alike."""
    scales = [2.0**e for e in (-30, -27, -24, -24, 11, 14, 16, 16)]
    return [_signed(frame, first + 8 * k, 8, scale=scale) for k, scale in enumerate(scales)]


# IS-GPS-200N figures 20-1 sheets 1-3, tables 20-I and 20-III. The key of a run is the subframe.
LNAV_FIELDS = {
    "week": _field(1, 48, 10),
    "ura_index": _field(1, 60, 4),
    "health": _field(1, 64, 6),
    "iodc": _field(1, 70, 2, 1, 168, 8),
    "tgd_s": _signed(1, 160, 8, scale=2.0**-31),
    "toc_s": _field(1, 176, 16, scale=16.0),
    "af2_sps2": _signed(1, 192, 8, scale=2.0**-55),
    "af1_sps": _signed(1, 200, 16, scale=2.0**-43),
    "af0_s": _signed(1, 216, 22, scale=2.0**-31),
    "iode": _field(2, 48, 8),
    "crs_m": _signed(2, 56, 16, scale=2.0**-5),
    "delta_n_radps": _signed(2, 72, 16, scale=2.0**-43 * _PI),
    "m0_rad": _signed(2, 88, 32, scale=2.0**-31 * _PI),
    "cuc_rad": _signed(2, 120, 16, scale=2.0**-29),
    "eccentricity": _field(2, 136, 32, scale=2.0**-33),
    "cus_rad": _signed(2, 168, 16, scale=2.0**-29),
    "sqrt_a": _field(2, 184, 32, scale=2.0**-19),
    "toe_s": _field(2, 216, 16, scale=16.0),
    "fit_flag": _field(2, 232, 1),
    "cic_rad": _signed(3, 48, 16, scale=2.0**-29),
    "omega0_rad": _signed(3, 64, 32, scale=2.0**-31 * _PI),
    "cis_rad": _signed(3, 96, 16, scale=2.0**-29),
    "i0_rad": _signed(3, 112, 32, scale=2.0**-31 * _PI),
    "crc_m": _signed(3, 144, 16, scale=2.0**-5),
    "omega_rad": _signed(3, 160, 32, scale=2.0**-31 * _PI),
    "omega_dot_radps": _signed(3, 192, 24, scale=2.0**-43 * _PI),
    "iode3": _field(3, 216, 8),
    "idot_radps": _signed(3, 224, 14, scale=2.0**-43 * _PI),
}
_LNAV_PREAMBLE = _field(0, 0, 8)
_LNAV_TOW = _field(0, 24, 17, scale=6.0)
_LNAV_SUBFRAME = _field(0, 43, 3)
_LNAV_BODY = (1 << 192) - 1
# Subframe 4, page 18 (satellite identity 56): ionosphere and UTC.
LNAV_PAGE = _field(4, 50, 6)
LNAV_KLOBUCHAR = _klobuchar_fields(4, 56)
LNAV_LEAP = {
    "now_s": _signed(4, 192, 8, scale=1.0),
    "week": _field(4, 200, 8),
    "day": _field(4, 208, 8),
    "future_s": _signed(4, 216, 8, scale=1.0),
}

# Galileo OS SIS ICD 2.1 tables 39-45 (I/NAV); the key of a run is the word type.
INAV_FIELDS = {
    "iod1": _field(1, 6, 10),
    "toe_s": _field(1, 16, 14, scale=60.0),
    "m0_rad": _signed(1, 30, 32, scale=2.0**-31 * _PI),
    "eccentricity": _field(1, 62, 32, scale=2.0**-33),
    "sqrt_a": _field(1, 94, 32, scale=2.0**-19),
    "iod2": _field(2, 6, 10),
    "omega0_rad": _signed(2, 16, 32, scale=2.0**-31 * _PI),
    "i0_rad": _signed(2, 48, 32, scale=2.0**-31 * _PI),
    "omega_rad": _signed(2, 80, 32, scale=2.0**-31 * _PI),
    "idot_radps": _signed(2, 112, 14, scale=2.0**-43 * _PI),
    "iod3": _field(3, 6, 10),
    "omega_dot_radps": _signed(3, 16, 24, scale=2.0**-43 * _PI),
    "delta_n_radps": _signed(3, 40, 16, scale=2.0**-43 * _PI),
    "cuc_rad": _signed(3, 56, 16, scale=2.0**-29),
    "cus_rad": _signed(3, 72, 16, scale=2.0**-29),
    "crc_m": _signed(3, 88, 16, scale=2.0**-5),
    "crs_m": _signed(3, 104, 16, scale=2.0**-5),
    "sisa_index": _field(3, 120, 8),
    "iod4": _field(4, 6, 10),
    "svid": _field(4, 16, 6),
    "cic_rad": _signed(4, 22, 16, scale=2.0**-29),
    "cis_rad": _signed(4, 38, 16, scale=2.0**-29),
    "toc_s": _field(4, 54, 14, scale=60.0),
    "af0_s": _signed(4, 68, 31, scale=2.0**-34),
    "af1_sps": _signed(4, 99, 21, scale=2.0**-46),
    "af2_sps2": _signed(4, 120, 6, scale=2.0**-59),
    "tgd_s": _signed(5, 47, 10, scale=2.0**-32),
    "tgd2_s": _signed(5, 57, 10, scale=2.0**-32),
    "e5b_health": _field(5, 67, 2),
    "e1b_health": _field(5, 69, 2),
    "e5b_invalid": _field(5, 71, 1),
    "e1b_invalid": _field(5, 72, 1),
    "week": _field(5, 73, 12),
    "tow_s": _field(5, 85, 20),
}
_INAV_TYPE = _field(0, 0, 6)
INAV_NEQUICK = [
    _field(5, 6, 11, scale=2.0**-2),
    _signed(5, 17, 11, scale=2.0**-8),
    _signed(5, 28, 14, scale=2.0**-15),
]

# Galileo OS SIS ICD 2.1 tables 29-32 (F/NAV); the key of a run is the page type.
FNAV_FIELDS = {
    "svid": _field(1, 6, 6),
    "iod1": _field(1, 12, 10),
    "toc_s": _field(1, 22, 14, scale=60.0),
    "af0_s": _signed(1, 36, 31, scale=2.0**-34),
    "af1_sps": _signed(1, 67, 21, scale=2.0**-46),
    "af2_sps2": _signed(1, 88, 6, scale=2.0**-59),
    "sisa_index": _field(1, 94, 8),
    "tgd_s": _signed(1, 143, 10, scale=2.0**-32),
    "e5a_health": _field(1, 153, 2),
    "week": _field(1, 155, 12),
    "tow_s": _field(1, 167, 20),
    "e5a_invalid": _field(1, 187, 1),
    "iod2": _field(2, 6, 10),
    "m0_rad": _signed(2, 16, 32, scale=2.0**-31 * _PI),
    "omega_dot_radps": _signed(2, 48, 24, scale=2.0**-43 * _PI),
    "eccentricity": _field(2, 72, 32, scale=2.0**-33),
    "sqrt_a": _field(2, 104, 32, scale=2.0**-19),
    "omega0_rad": _signed(2, 136, 32, scale=2.0**-31 * _PI),
    "idot_radps": _signed(2, 168, 14, scale=2.0**-43 * _PI),
    "iod3": _field(3, 6, 10),
    "i0_rad": _signed(3, 16, 32, scale=2.0**-31 * _PI),
    "omega_rad": _signed(3, 48, 32, scale=2.0**-31 * _PI),
    "delta_n_radps": _signed(3, 80, 16, scale=2.0**-43 * _PI),
    "cuc_rad": _signed(3, 96, 16, scale=2.0**-29),
    "cus_rad": _signed(3, 112, 16, scale=2.0**-29),
    "crc_m": _signed(3, 128, 16, scale=2.0**-5),
    "crs_m": _signed(3, 144, 16, scale=2.0**-5),
    "toe_s": _field(3, 160, 14, scale=60.0),
    "iod4": _field(4, 6, 10),
    "cic_rad": _signed(4, 16, 16, scale=2.0**-29),
    "cis_rad": _signed(4, 32, 16, scale=2.0**-29),
}
FNAV_NEQUICK = [
    _field(1, 102, 11, scale=2.0**-2),
    _signed(1, 113, 11, scale=2.0**-8),
    _signed(1, 124, 14, scale=2.0**-15),
]

# BDS-SIS-ICD-B1I-3.0 figures 5-6 to 5-8, parity removed; the key of a run is the subframe.
D1_FIELDS = {
    "health": _field(1, 38, 1),
    "iodc": _field(1, 39, 5),
    "ura_index": _field(1, 44, 4),
    "week": _field(1, 48, 13),
    "toc_s": _field(1, 61, 17, scale=8.0),
    "tgd_s": _signed(1, 78, 10, scale=1e-10),
    "tgd2_s": _signed(1, 88, 10, scale=1e-10),
    "af2_sps2": _signed(1, 162, 11, scale=2.0**-66),
    "af0_s": _signed(1, 173, 24, scale=2.0**-33),
    "af1_sps": _signed(1, 197, 22, scale=2.0**-50),
    "iode": _field(1, 219, 5),
    "delta_n_radps": _signed(2, 38, 16, scale=2.0**-43 * _PI),
    "cuc_rad": _signed(2, 54, 18, scale=2.0**-31),
    "m0_rad": _signed(2, 72, 32, scale=2.0**-31 * _PI),
    "eccentricity": _field(2, 104, 32, scale=2.0**-33),
    "cus_rad": _signed(2, 136, 18, scale=2.0**-31),
    "crc_m": _signed(2, 154, 18, scale=2.0**-6),
    "crs_m": _signed(2, 172, 18, scale=2.0**-6),
    "sqrt_a": _field(2, 190, 32, scale=2.0**-19),
    "toe_s": _field(2, 222, 2, 3, 38, 15, scale=8.0),
    "i0_rad": _signed(3, 53, 32, scale=2.0**-31 * _PI),
    "cic_rad": _signed(3, 85, 18, scale=2.0**-31),
    "omega_dot_radps": _signed(3, 103, 24, scale=2.0**-43 * _PI),
    "cis_rad": _signed(3, 127, 18, scale=2.0**-31),
    "idot_radps": _signed(3, 145, 14, scale=2.0**-43 * _PI),
    "omega0_rad": _signed(3, 159, 32, scale=2.0**-31 * _PI),
    "omega_rad": _signed(3, 191, 32, scale=2.0**-31 * _PI),
}
D1_KLOBUCHAR = _klobuchar_fields(1, 98)
_BEIDOU_PREAMBLE = _field(0, 0, 11)
_BEIDOU_SUBFRAME = _field(0, 15, 3)
_BEIDOU_SOW = _field(0, 18, 20)

# BDS-SIS-ICD-B1I-3.0 figures 5-13 to 5-14, parity removed; the key of a run is the page of subframe 1.
D2_FIELDS = {
    "health": _field(1, 42, 1),
    "iodc": _field(1, 43, 5),
    "ura_index": _field(1, 48, 4),
    "week": _field(1, 52, 13),
    "toc_s": _field(1, 65, 17, scale=8.0),
    "tgd_s": _signed(1, 82, 10, scale=1e-10),
    "tgd2_s": _signed(1, 92, 10, scale=1e-10),
    "af0_s": _signed(3, 80, 24, scale=2.0**-33),
    "af1_sps": _signed(3, 104, 4, 4, 42, 18, scale=2.0**-50),
    "af2_sps2": _signed(4, 60, 11, scale=2.0**-66),
    "iode": _field(4, 71, 5),
    "delta_n_radps": _signed(4, 76, 16, scale=2.0**-43 * _PI),
    "cuc_rad": _signed(4, 92, 14, 5, 42, 4, scale=2.0**-31),
    "m0_rad": _signed(5, 46, 32, scale=2.0**-31 * _PI),
    "cus_rad": _signed(5, 78, 18, scale=2.0**-31),
    "eccentricity": _field(5, 96, 10, 6, 42, 22, scale=2.0**-33),
    "sqrt_a": _field(6, 64, 32, scale=2.0**-19),
    "cic_rad": _signed(6, 96, 10, 7, 42, 8, scale=2.0**-31),
    "cis_rad": _signed(7, 50, 18, scale=2.0**-31),
    "toe_s": _field(7, 68, 17, scale=8.0),
    "i0_rad": _signed(7, 85, 21, 8, 42, 11, scale=2.0**-31 * _PI),
    "crc_m": _signed(8, 53, 18, scale=2.0**-6),
    "crs_m": _signed(8, 71, 18, scale=2.0**-6),
    "omega_dot_radps": _signed(8, 89, 19, 9, 42, 5, scale=2.0**-43 * _PI),
    "omega0_rad": _signed(9, 47, 32, scale=2.0**-31 * _PI),
    "omega_rad": _signed(9, 79, 27, 10, 42, 5, scale=2.0**-31 * _PI),
    "idot_radps": _signed(10, 47, 14, scale=2.0**-43 * _PI),
}
_D2_PAGE = _field(0, 38, 4)
D2_KLOBUCHAR = _klobuchar_fields(2, 42)

# GLONASS ICD 5.1 table 4.5 and figure 4.3; ICD bit n is bit 85 - n here; the key is the string.
GLONASS_FIELDS = {
    "frame_time": _field(1, 9, 12),
    "vx_mps": _magnitude(1, 21, 24, scale=1e3 * 2.0**-20),
    "ax_mps2": _magnitude(1, 45, 5, scale=1e3 * 2.0**-30),
    "x_m": _magnitude(1, 50, 27, scale=1e3 * 2.0**-11),
    "health": _field(2, 5, 3),
    "tb_s": _field(2, 9, 7, scale=900.0),
    "vy_mps": _magnitude(2, 21, 24, scale=1e3 * 2.0**-20),
    "ay_mps2": _magnitude(2, 45, 5, scale=1e3 * 2.0**-30),
    "y_m": _magnitude(2, 50, 27, scale=1e3 * 2.0**-11),
    "clock_drift_sps": _magnitude(3, 6, 11, scale=2.0**-40),
    "unhealthy": _field(3, 20, 1),
    "vz_mps": _magnitude(3, 21, 24, scale=1e3 * 2.0**-20),
    "az_mps2": _magnitude(3, 45, 5, scale=1e3 * 2.0**-30),
    "z_m": _magnitude(3, 50, 27, scale=1e3 * 2.0**-11),
    # Tau is system time minus satellite time, our clock is the opposite: negative scale.
    "clock_s": _magnitude(4, 5, 22, scale=-(2.0**-30)),
    "delta_tau_s": _magnitude(4, 27, 5, scale=2.0**-30),
}
_GLONASS_STRING = _field(0, 1, 4)


def extract(frames, field, n_bits):
    """Read one field out of the frames that hold it.

    Parameters
    ----------
    frames : dict of int to int
        Frame bits by subframe, page, word or string number; the first bit sent is the highest.
    field : BitField
        Where to look.
    n_bits : int
        Length of every frame.

    Returns
    -------
    int or float
        Integer where the scale is 1, else scaled.
    """
    value = length = 0
    for frame, first, count in field.runs:
        run = frames[frame] >> (n_bits - first - count) & ((1 << count) - 1)
        value = value << count | run
        length += count
    if field.kind != "u" and value >> (length - 1):
        value = value - (1 << length) if field.kind == "s" else -(value - (1 << (length - 1)))
    return value if field.scale == 1.0 else value * field.scale


def _nearest(tow_s, near_ns):
    """GPS time closest to `near_ns` that has the given seconds of week."""
    offset_ns = round(tow_s * NS_PER_S) - near_ns
    return near_ns + (offset_ns + NS_PER_WEEK // 2) % NS_PER_WEEK - NS_PER_WEEK // 2


def _full_week(week, modulus, near_ns):
    """Week closest to `near_ns` that is congruent with the broadcast one."""
    near = near_ns // NS_PER_WEEK
    return near + (week - near + modulus // 2) % modulus - modulus // 2


def ura_m(index):
    """Nominal accuracy of a URA index: IS-GPS-200N 20.3.3.3.1.3; NaN for index 15 (no prediction)."""
    if index >= 15:
        return np.nan
    rounded = {1: 2.8, 3: 5.7, 5: 11.3}
    return rounded.get(index, 2.0 ** (1 + index / 2) if index <= 6 else 2.0 ** (index - 2))


def sisa_m(index):
    """Accuracy of a SISA index: Galileo OS SIS ICD 2.1 table 89; NaN where there is no statement."""
    if index <= 49:
        return index * 0.01
    if index <= 74:
        return 0.5 + (index - 50) * 0.02
    if index <= 99:
        return 1.0 + (index - 75) * 0.04
    if index <= 125:
        return 2.0 + (index - 100) * 0.16
    return np.nan


def _lnav_fit_s(sat, flag, iodc):
    """Curve fit interval: IS-GPS-200N table 20-XII; QZSS 2 h, or 4 h with the flag (IS-QZSS-PNT 4.3.2)."""
    if sat // 100 == QZSS:
        return 14_400.0 if flag else 7_200.0
    if not flag:
        return 14_400.0
    table = [
        (8, {*range(240, 248)}),
        (14, {*range(248, 256), 496}),
        (26, {*range(497, 504), *range(1021, 1024)}),
        (50, {*range(504, 511)}),
        (74, {511, *range(752, 757)}),
        (98, {757}),
    ]
    return 3600.0 * next((hours for hours, issues in table if iodc in issues), 6)


class BroadcastDecoder:
    """Collects frames of broadcast navigation messages and joins them into ephemerides.

    Every ``add_`` method takes one frame as an integer (the first bit sent is the highest), the
    satellite, and a GPS time close to its reception, which settles the week and the day. Frames
    that hold nothing of use are counted in `skipped` by kind.
    """

    def __init__(self):
        self._frames = {}
        self._kepler = {}
        self._states = {}
        self.klobuchar = {}
        self.nequick = None
        self.leap_seconds = None
        self.skipped = {}

    def skip(self, kind):
        """Count a frame that was not used."""
        self.skipped[kind] = self.skipped.get(kind, 0) + 1

    def add_lnav(self, sat, bits, near_ns):
        """Add a GPS or QZSS LNAV subframe.

        Parameters
        ----------
        sat : int
            Satellite.
        bits : int
            `LNAV_BITS` bits: the data bits of the ten words, polarity resolved, parity removed.
        near_ns : int
            GPS time of reception to within days, nanoseconds.
        """
        if extract({0: bits}, _LNAV_PREAMBLE, LNAV_BITS) != 0x8B:
            return self.skip("LNAV preamble")
        number = extract({0: bits}, _LNAV_SUBFRAME, LNAV_BITS)
        if number == 4:
            return self._add_lnav_page(sat, bits, near_ns)
        if not 1 <= number <= 3:
            return None
        frames = self._frames.setdefault((MessageType.LNAV, sat), {})
        # Words 3 to 10 unchanged: nothing new since the last time the three were compared.
        repeated = number in frames and not (frames[number] ^ bits) & _LNAV_BODY
        frames[number] = bits
        if len(frames) < 3 or repeated:
            return None
        issues = [extract(frames, LNAV_FIELDS[name], LNAV_BITS) for name in ("iode", "iode3", "iodc")]
        if not issues[0] == issues[1] == issues[2] & 0xFF:
            return None
        value = _extract_all(frames, LNAV_FIELDS, LNAV_BITS)
        # The count in the hand-over word is the start of the next subframe, the week that of this one.
        start_s = (extract({0: frames[1]}, _LNAV_TOW, LNAV_BITS) - 6.0) % 604_800.0
        week = _full_week(value["week"], 1024, near_ns)
        sent_ns = week * NS_PER_WEEK + round((start_s + 6.0) * NS_PER_S)
        if value["tgd_s"] == -128 * 2.0**-31:  # not available: IS-GPS-200N 20.3.3.3.3.2
            value["tgd_s"] = 0.0
        value["ura_m"] = ura_m(value["ura_index"])
        value["fit_interval_s"] = _lnav_fit_s(sat, value["fit_flag"], value["iodc"])
        return self._keep_kepler(sat, MessageType.LNAV, value, sent_ns, value["iode"], value["iodc"])

    def _add_lnav_page(self, sat, bits, near_ns):
        frames = {4: bits}
        if extract(frames, LNAV_PAGE, LNAV_BITS) != 56:
            return
        letter = "J" if sat // 100 == QZSS else "G"
        self.klobuchar[letter] = np.array([extract(frames, f, LNAV_BITS) for f in LNAV_KLOBUCHAR])
        leap = _extract_all(frames, LNAV_LEAP, LNAV_BITS)
        effective_ns = _full_week(leap["week"], 256, near_ns) * NS_PER_WEEK + leap["day"] * NS_PER_DAY
        self.leap_seconds = leap["future_s"] if near_ns >= effective_ns else leap["now_s"]

    def add_inav(self, sat, bits, near_ns):
        """Add a Galileo I/NAV word of E1-B or E5b-I, of `INAV_BITS` bits, its checksum verified."""
        word = extract({0: bits}, _INAV_TYPE, INAV_BITS)
        if not 1 <= word <= 5:
            return
        frames = self._frames.setdefault((MessageType.INAV, sat), {})
        repeated = frames.get(word) == bits
        frames[word] = bits
        if word == 5:
            self.nequick = np.array([extract(frames, f, INAV_BITS) for f in INAV_NEQUICK])
        if len(frames) < 5 or repeated:
            return
        issues = {extract(frames, INAV_FIELDS[f"iod{k}"], INAV_BITS) for k in (1, 2, 3, 4)}
        if len(issues) != 1 or extract(frames, INAV_FIELDS["svid"], INAV_BITS) != sat % 100:
            return
        value = _extract_all(frames, INAV_FIELDS, INAV_BITS)
        # RINEX 4.01 table A8: E1-B in bits 0-2, E5a in bits 3-5, E5b in bits 6-8.
        value["health"] = (
            value["e1b_invalid"]
            | value["e1b_health"] << 1
            | value["e5b_invalid"] << 6
            | value["e5b_health"] << 7
        )
        self._keep_galileo(sat, MessageType.INAV, value, issues.pop(), near_ns)

    def add_fnav(self, sat, bits, near_ns):
        """Add a Galileo F/NAV page of E5a-I, of `FNAV_BITS` bits, its checksum verified."""
        page = extract({0: bits}, _INAV_TYPE, FNAV_BITS)
        if not 1 <= page <= 4:
            return
        frames = self._frames.setdefault((MessageType.FNAV, sat), {})
        frames[page] = bits
        if page == 1 and self.nequick is None:
            self.nequick = np.array([extract(frames, f, FNAV_BITS) for f in FNAV_NEQUICK])
        if len(frames) < 4:
            return
        issues = {extract(frames, FNAV_FIELDS[f"iod{k}"], FNAV_BITS) for k in (1, 2, 3, 4)}
        if len(issues) != 1 or extract(frames, FNAV_FIELDS["svid"], FNAV_BITS) != sat % 100:
            return
        value = _extract_all(frames, FNAV_FIELDS, FNAV_BITS)
        value["health"] = value["e5a_invalid"] << 3 | value["e5a_health"] << 4
        self._keep_galileo(sat, MessageType.FNAV, value, issues.pop(), near_ns)

    def _keep_galileo(self, sat, message, value, issue, near_ns):
        week = _full_week(value["week"] + GALILEO_WEEK, 4096, near_ns)
        sent_ns = week * NS_PER_WEEK + round(value["tow_s"] * NS_PER_S)
        value["ura_m"] = sisa_m(value["sisa_index"])
        value["fit_interval_s"] = 28_800.0
        self._keep_kepler(sat, message, value, sent_ns, issue, issue)

    def add_d1(self, sat, bits, near_ns):
        """Add a BeiDou D1 subframe of `D1_BITS` bits, parity removed."""
        self._add_beidou(sat, bits, near_ns, MessageType.D1)

    def add_d2(self, sat, bits, near_ns):
        """Add a BeiDou D2 subframe of `D2_BITS` bits, parity removed."""
        self._add_beidou(sat, bits, near_ns, MessageType.D2)

    def _add_beidou(self, sat, bits, near_ns, message):
        if extract({0: bits}, _BEIDOU_PREAMBLE, D1_BITS) != 0x712:
            return self.skip(f"{message.name} preamble")
        number = extract({0: bits}, _BEIDOU_SUBFRAME, D1_BITS)
        sow = extract({0: bits}, _BEIDOU_SOW, D1_BITS)
        if message == MessageType.D1:
            fields, klobuchar, ionosphere_frame, n_frames, step_s = D1_FIELDS, D1_KLOBUCHAR, 1, 3, 6
        elif number == 1:
            fields, klobuchar, ionosphere_frame, n_frames, step_s = D2_FIELDS, D2_KLOBUCHAR, 2, 10, 3
            number = extract({0: bits}, _D2_PAGE, D2_BITS)
        else:
            return None
        if not 1 <= number <= n_frames:
            return None
        # No issue of data in the later frames: they belong together when sent in one sequence.
        start_s = (sow - step_s * (number - 1)) % 604_800
        key = (message, sat)
        if self._frames.get(key, {}).get("start_s") != start_s:
            self._frames[key] = {"start_s": start_s}
        frames = self._frames[key]
        frames[number] = bits
        if number == ionosphere_frame:
            self.klobuchar["C"] = np.array([extract(frames, f, D1_BITS) for f in klobuchar])
        # Page 2 of D2 holds only the ionosphere.
        needed = {run[0] for field in fields.values() for run in field.runs}
        if not needed <= frames.keys():
            return None
        value = _extract_all(frames, fields, D1_BITS)
        week = value["week"] + BEIDOU_WEEK
        sent_ns = week * NS_PER_WEEK + start_s * NS_PER_S + BDT_OFFSET_NS
        if abs(sent_ns - near_ns) > 4 * NS_PER_WEEK:
            return self.skip("BeiDou week")
        value["ura_m"] = ura_m(value["ura_index"])
        value["fit_interval_s"] = 14_400.0
        for name in ("toe_s", "toc_s"):
            value[name] += BDT_OFFSET_NS / NS_PER_S
        return self._keep_kepler(sat, message, value, sent_ns, value["iode"], value["iodc"])

    def add_glonass_string(self, sat, bits, near_ns, *, channel, frame):
        """Add a GLONASS string.

        Parameters
        ----------
        sat : int
            Satellite.
        bits : int
            `GLONASS_BITS` bits.
        near_ns : int
            GPS time of reception to within hours, nanoseconds.
        channel : int
            Frequency channel, -7 to 6.
        frame : hashable
            Name of the frame that the string belongs to; strings of one frame are joined.
        """
        number = extract({0: bits}, _GLONASS_STRING, GLONASS_BITS)
        if not 1 <= number <= 4:
            return
        key = (MessageType.FDMA, sat)
        frames = self._frames.get(key, {})
        if frames.get("frame") != frame or abs(near_ns - frames["since_ns"]) > _GLONASS_FRAME_NS:
            frames = self._frames[key] = {"frame": frame, "since_ns": near_ns}
        frames[number] = bits
        if not {1, 2, 3, 4} <= frames.keys():
            return
        value = _extract_all(frames, GLONASS_FIELDS, GLONASS_BITS)
        radius_m = np.sqrt(value["x_m"] ** 2 + value["y_m"] ** 2 + value["z_m"] ** 2)
        if not (1 <= value["tb_s"] / 900 <= 95 and 2.0e7 < radius_m < 3.0e7):
            self.skip("GLONASS values")
            return
        frame_time = value["frame_time"]
        frame_s = (frame_time >> 7) * 3600 + (frame_time >> 1 & 0x3F) * 60 + (frame_time & 1) * 30
        toe_ns = _gpst_from_moscow_day(value["tb_s"], near_ns)
        sent_ns = _gpst_from_moscow_day(frame_s, near_ns)
        # Only the highest bit of Bn concerns the user (ICD 4.4); l_n of string 3 says the same, faster.
        health = value["health"] >> 2 | value["unhealthy"] << 1
        state = [float(value[name]) for name in STATE_COLUMNS]
        self._states.setdefault((sat, toe_ns, health, tuple(state)), (sent_ns, channel))

    def _keep_kepler(self, sat, message, value, sent_ns, iode, iodc):
        if not (1000.0 < value["sqrt_a"] < 10_000.0 and value["eccentricity"] < 0.5):
            self.skip(f"{message.name} values")
            return
        toe_ns, toc_ns = _nearest(value["toe_s"], sent_ns), _nearest(value["toc_s"], sent_ns)
        elements = [float(value.get(name, 0.0)) for name in KEPLER_COLUMNS]
        key = (sat, int(message), toe_ns, toc_ns, iode, iodc, value["health"])
        self._kepler.setdefault(key, (sent_ns, elements))

    def build(self, *, paths=()):
        """Put all ephemerides received so far into the container.

        Parameters
        ----------
        paths : tuple of str
            Files that the frames came from.

        Returns
        -------
        Navigation
        """
        kepler_rows = [
            (*key[:4], sent_ns, *key[4:], elements) for key, (sent_ns, elements) in self._kepler.items()
        ]
        state_rows = [
            (sat, toe_ns, sent_ns, channel, health, state)
            for (sat, toe_ns, health, state), (sent_ns, channel) in self._states.items()
        ]
        return build_navigation(
            kepler_rows,
            state_rows,
            klobuchar=self.klobuchar,
            nequick=self.nequick,
            leap_seconds=self.leap_seconds,
            skipped=self.skipped,
            paths=paths,
        )


def _extract_all(frames, fields, n_bits):
    return {name: extract(frames, field, n_bits) for name, field in fields.items()}


def _gpst_from_moscow_day(second_of_day, near_ns):
    """GPS time closest to `near_ns` with the given second of the Moscow day (UTC + 3 h)."""
    utc_ns = near_ns - int(leap_seconds(near_ns)) * NS_PER_S
    moscow_ns = utc_ns + 3 * 3600 * NS_PER_S
    offset_ns = round(second_of_day * NS_PER_S) - moscow_ns
    moscow_ns += (offset_ns + NS_PER_DAY // 2) % NS_PER_DAY - NS_PER_DAY // 2
    return int(gpst_from_utc_ns(moscow_ns - 3 * 3600 * NS_PER_S))
