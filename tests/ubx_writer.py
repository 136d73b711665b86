"""UBX messages of any content, also such as the package's own writer would not write."""

import struct

from truenorth.formats.ubx_writer import encode_frame


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
    return encode_frame(0x0215, head + b"".join(measurements))


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
