"""A small writer of UBX messages and broadcast frames, the opposite of what the reader does."""

import struct

from truenorth.formats.ubx import crc24q


def frame(kind, payload):
    body = struct.pack("<BBH", kind >> 8, kind & 0xFF, len(payload)) + payload
    a = b = 0
    for byte in body:
        a = (a + byte) & 0xFF
        b = (b + a) & 0xFF
    return b"\xb5\x62" + body + bytes([a, b])


def measurement(
    gnss, sv, *, sig=0, code=2.2e7, phase=1.1e8, doppler=-1234.5, channel=0, lock_ms=64_500, cn0=45, track=7
):
    """One measurement of RXM-RAWX; `track` has code valid (1), phase valid (2), half cycle resolved (4)."""
    return struct.pack(
        "<ddfBBBBHBBBBBB",
        code, phase, doppler, gnss, sv, sig, channel + 7, lock_ms, cn0, 4, 2, 5, track, 0,
    )  # fmt: skip


def rawx(week, tow_s, measurements, *, leap_s=18, status=1, version=1, count=None):
    count = len(measurements) if count is None else count
    head = struct.pack("<dHbBBBH", tow_s, week, leap_s, count, status, version, 0)
    return frame(0x0215, head + b"".join(measurements))


def sfrbx(gnss, sv, words, *, sig=0, channel=0, version=2):
    head = struct.pack("<8B", gnss, sv, sig, channel + 7, len(words), 0, version, 0)
    return frame(0x0213, head + struct.pack(f"<{len(words)}I", *words))


def pack(fields, values):
    """Concatenate (name, bits, kind) fields; unnamed ones are filler and take their third entry as value."""
    bits = 0
    for name, count, kind in fields:
        value = kind if name is None else values[name]
        if kind == "m" and name is not None:
            value = (1 << (count - 1)) | -value if value < 0 else value
        bits = bits << count | (value & ((1 << count) - 1))
    return bits


def width(fields):
    return sum(count for _, count, _ in fields)


def lnav_words(bits):
    """Ten words of 24 data bits; all parity bits are one, to show that they do not count."""
    return [(bits >> (216 - 24 * k) & 0xFFFFFF) << 6 | 0x3F for k in range(10)]


def beidou_words(bits):
    return [(bits >> 198) << 4 | 0xF] + [(bits >> (176 - 22 * k) & 0x3FFFFF) << 8 | 0xFF for k in range(9)]


def inav_words(word):
    even = word >> 16  # even page part, nominal: both leading bits are zero
    odd = 0b10 << 80 | (word & 0xFFFF) << 64 | 0x123456789ABCDEF0  # SAR and reserved bits are protected too
    odd = odd << 24 | crc24q(even << 82 | odd)
    even, odd = even << 14, odd << 22
    return _words32(even << 128 | odd, 8)


def fnav_words(page):
    return _words32((page << 24 | crc24q(page)) << 18, 8)


def glonass_words(bits, superframe, number):
    return [*_words32(bits << 11, 3), superframe << 16 | number]


def _words32(bits, count):
    return [bits >> 32 * (count - 1 - k) & 0xFFFFFFFF for k in range(count)]
