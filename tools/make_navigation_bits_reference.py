"""Write the table of broadcast frames that RTKLIB decodes, for the reference tests of the bit decoders.

Frames of random bits, with only what ties the frames of one ephemeris together set (preambles, numbers,
issues, times, a plausible orbit), go through RTKLIB's decoders by pyrtklib (``pip install pyrtklib``),
which no part of the package needs. Random bits reach every bit and sign of every field.

Usage::

    python tools/make_navigation_bits_reference.py tests/reference/data/navigation_bits_rtklib.json
"""

import json
import random
import sys
from importlib.metadata import version
from pathlib import Path

import pyrtklib

SEED = 20260101
N_CASES = 6
_Bytes = getattr(pyrtklib, "Arr1Dunsigned char")
_EPH = (
    "A", "e", "i0", "OMG0", "omg", "M0", "deln", "OMGd", "idot", "crc", "crs", "cuc", "cus", "cic", "cis",
    "f0", "f1", "f2", "toes", "iode", "iodc", "sva", "svh",
)  # fmt: skip


class Frame:
    """Random bits that can be overwritten; bit 0 is sent first."""

    def __init__(self, rng, n_bits):
        self.n_bits = n_bits
        self.bits = rng.getrandbits(n_bits)

    def put(self, first, count, value):
        shift = self.n_bits - first - count
        mask = (1 << count) - 1
        self.bits = self.bits & ~(mask << shift) | (value & mask) << shift
        return self

    def hex(self):
        return f"{self.bits:0{(self.n_bits + 3) // 4}x}"


def to_bytes(rows, row_bytes, first=0):
    """RTKLIB's buffer: rows of bits, each from the start of its row of bytes."""
    buffer = _Bytes(row_bytes * (first + len(rows)) + 64)
    for k, (bits, n_bits) in enumerate(rows):
        raw = (bits << (row_bytes * 8 - n_bits)).to_bytes(row_bytes, "big")
        for i, byte in enumerate(raw):
            buffer[(first + k) * row_bytes + i] = byte
    return buffer


def beidou_words(bits):
    """224 information bits as ten 30-bit words; the parity, which RTKLIB does not look at, is zero."""
    words = (bits >> 198) << 4
    for k in range(9):
        words = words << 30 | (bits >> (198 - 22 * (k + 1)) & 0x3FFFFF) << 8
    return words


def values(eph):
    got = {name: getattr(eph, name) for name in _EPH}
    got["tgd"] = [eph.tgd[0], eph.tgd[1]]
    return got


def lnav(rng):
    iodc, toe = rng.getrandbits(10), rng.randrange(37_800)
    frames = []
    for number in (1, 2, 3):
        frame = Frame(rng, 240).put(0, 8, 0x8B).put(24, 17, 1000 + number).put(43, 3, number)
        frames.append(frame)
    frames[0].put(70, 2, iodc >> 8).put(168, 8, iodc).put(176, 16, toe).put(48, 10, 300)
    frames[1].put(48, 8, iodc).put(216, 16, toe).put(136, 6, 0).put(184, 32, rng.randrange(5 << 29, 6 << 29))
    frames[2].put(216, 8, iodc)
    # It takes a whole frame, with almanac and ionosphere.
    rest = [
        Frame(rng, 240).put(0, 8, 0x8B).put(43, 3, k).put(48, 8, 64 + page) for k, page in ((4, 56), (5, 1))
    ]
    eph = pyrtklib.eph_t()
    buffer = to_bytes([(f.bits, 240) for f in [*frames, *rest]], 30)
    ion, utc = pyrtklib.Arr1Ddouble(8), pyrtklib.Arr1Ddouble(9)
    state = pyrtklib.decode_frame(buffer, eph, pyrtklib.Arr1Dalm_t(64)[0], ion, utc)
    return state, [*frames, rest[0]], values(eph) | {"klobuchar": [ion[k] for k in range(8)], "leap": utc[4]}


def inav(rng):
    iod, toe = rng.getrandbits(10), rng.randrange(10_080)
    frames = [Frame(rng, 128).put(0, 6, number) for number in range(7)]
    for frame in frames[1:5]:
        frame.put(6, 10, iod)
    frames[0].put(6, 2, 2).put(96, 12, 1000).put(108, 20, 300_000)
    frames[1].put(16, 14, toe).put(62, 6, 0).put(94, 32, rng.randrange(5 << 29, 6 << 29))
    frames[4].put(16, 6, 11).put(54, 14, toe)
    frames[5].put(73, 12, 1000).put(85, 20, 300_000)
    eph = pyrtklib.eph_t()
    buffer = to_bytes([(f.bits, 128) for f in frames], 16)
    state = pyrtklib.decode_gal_inav(buffer, eph, pyrtklib.Arr1Ddouble(4), pyrtklib.Arr1Ddouble(8))
    return state, frames[1:6], values(eph)


def fnav(rng):
    iod, toe = rng.getrandbits(10), rng.randrange(10_080)
    frames = [Frame(rng, 214).put(0, 6, number) for number in range(1, 5)]
    frames[0].put(6, 6, 11).put(12, 10, iod).put(22, 14, toe).put(155, 12, 1000).put(167, 20, 300_000)
    for frame in frames[1:]:
        frame.put(6, 10, iod)
    frames[1].put(72, 6, 0).put(104, 32, rng.randrange(5 << 29, 6 << 29)).put(182, 12, 1000).put(
        194, 20, 300_010
    )
    frames[2].put(160, 14, toe).put(174, 12, 1000).put(186, 20, 300_020)
    frames[3].put(189, 20, 300_030)
    eph = pyrtklib.eph_t()
    buffer = to_bytes([(f.bits, 214) for f in frames], 31)
    state = pyrtklib.decode_gal_fnav(buffer, eph, pyrtklib.Arr1Ddouble(4), pyrtklib.Arr1Ddouble(8))
    return state, frames, values(eph)


def d1(rng):
    toe = rng.randrange(75_600)
    frames = []
    for number in (1, 2, 3):
        frame = Frame(rng, 224).put(0, 11, 0x712).put(15, 3, number).put(18, 20, 8 * toe + 6 * (number - 1))
        frames.append(frame)
    frames[0].put(48, 13, 1000).put(61, 17, toe)
    frames[1].put(104, 6, 0).put(190, 32, rng.randrange(5 << 29, 6 << 29)).put(222, 2, toe >> 15)
    frames[2].put(38, 15, toe)
    eph = pyrtklib.eph_t()
    # It takes two more, subframe 5 page 10 among them, for the time relation.
    rest = [Frame(rng, 224).put(0, 11, 0x712).put(15, 3, k).put(39, 7, page) for k, page in ((4, 1), (5, 10))]
    buffer = to_bytes([(beidou_words(f.bits), 300) for f in [*frames, *rest]], 38)
    ion = pyrtklib.Arr1Ddouble(8)
    state = pyrtklib.decode_bds_d1(buffer, eph, ion, pyrtklib.Arr1Ddouble(9))
    return state, frames, values(eph) | {"klobuchar": [ion[k] for k in range(8)]}


def d2(rng):
    toe = rng.randrange(75_600)
    start = 8 * toe // 30 * 30
    frames = []
    for number in range(1, 11):
        frame = Frame(rng, 224).put(0, 11, 0x712).put(15, 3, 1).put(18, 20, start + 3 * (number - 1))
        frames.append(frame.put(38, 4, number))
    frames[0].put(52, 13, 1000).put(65, 17, toe)
    frames[4].put(96, 6, 0)
    frames[5].put(64, 32, rng.randrange(5 << 29, 6 << 29))
    frames[6].put(68, 17, toe)
    eph = pyrtklib.eph_t()
    # It takes one more, subframe 5 page 102, for the time relation.
    rest = Frame(rng, 224).put(0, 11, 0x712).put(15, 3, 5).put(39, 7, 102)
    buffer = to_bytes([(beidou_words(f.bits), 300) for f in [*frames, rest]], 38)
    state = pyrtklib.decode_bds_d2(buffer, eph, pyrtklib.Arr1Ddouble(9))
    return state, frames, values(eph)


def glonass(rng):
    frames = [Frame(rng, 85).put(0, 1, 0).put(1, 4, number) for number in (1, 2, 3, 4, 5)]
    frames[0].put(9, 5, 11).put(14, 6, 30)
    frames[1].put(9, 7, 47)
    frames[3].put(70, 5, 7)
    for frame in frames[:3]:  # a radius of a real orbit
        frame.put(51, 26, (14_700 * 2**11) + rng.getrandbits(18))
    geph = pyrtklib.geph_t()
    # RTKLIB wants the day: 2023-09-19 08:30 UTC.
    day = pyrtklib.Arr1Ddouble(6)
    for k, value in enumerate((2023, 9, 19, 8, 30, 0)):
        day[k] = value
    geph.tof = pyrtklib.utc2gpst(pyrtklib.epoch2time(day))
    buffer = to_bytes([(f.bits >> 5, 80) for f in frames], 10)
    state = pyrtklib.decode_glostr(buffer, geph, pyrtklib.Arr1Ddouble(8))
    got = {name: [getattr(geph, name)[k] for k in range(3)] for name in ("pos", "vel", "acc")}
    got |= {name: getattr(geph, name) for name in ("taun", "gamn", "dtaun", "svh")}
    got["toe_unix_gpst"] = geph.toe.time + geph.toe.sec
    return state, frames[:4], got


def main(target):
    cases = []
    for maker in (lnav, inav, fnav, d1, d2, glonass):
        for k in range(N_CASES):
            state, frames, got = maker(random.Random(f"{SEED} {maker.__name__} {k}"))
            if not state:
                raise SystemExit(f"RTKLIB refused case {k} of {maker.__name__}")
            cases.append({"message": maker.__name__, "frames": [f.hex() for f in frames], "rtklib": got})
    by = {"program": "pyrtklib", "version": version("pyrtklib"), "seed": SEED}
    lines = ",\n".join(json.dumps(case) for case in cases)
    Path(target).write_text(f'{{"by": {json.dumps(by)}, "cases": [\n{lines}\n]}}\n')


if __name__ == "__main__":
    main(sys.argv[1])
