"""Write the table of satellite states that RTKLIB computes, for the reference tests of the orbits.

RTKLIB is driven through pyrtklib (``pip install pyrtklib``), which no part of the package needs. It reads
the navigation files of the data folder and evaluates single ephemerides (``eph2pos``, ``geph2pos``) at
times around their reference times. RINEX 4 files are handed to it as RINEX 3.05, record by record,
because it reads no RINEX 4; only records that RINEX 3 knows go through.

Usage::

    python tools/make_orbit_reference.py DATA_FOLDER tests/reference/data/orbits_rtklib.csv
"""

import csv
import gzip
import io
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path

import pyrtklib

FILES = (
    ("pair_1m_geodetic/base.nav.gz", {"G": 1, "R": 1, "E": 3, "C": 1, "J": 1}),
    ("pair_38m_gps/brdc0770.11n", {"G": 8}),
    ("rinex_samples/KMS300DNK_R_20221591000_01H_MN.rnx.gz", {"G": 2, "R": 2, "E": 8, "C": 2, "J": 1}),
    (
        "rinex_samples/BRD400DLR_S_20260680000_01D_MN.rnx.gz",
        {"G": 20, "R": 40, "E": 300, "C": 17, "J": 5, "I": 30},
    ),
)
"""File, and the share of the ephemerides taken of each system: every so many."""

OFFSETS_S = {"R": (-700.0, -0.25, 730.0), "other": (-5400.0, 0.5, 3599.875)}
"""Times relative to the reference time; those of GLONASS stay within its window of 15 minutes."""

RINEX_3_MESSAGES = {"LNAV", "INAV", "FNAV", "D1", "D2", "FDMA"}


def as_rinex_3(text):
    """RINEX 4 text with the records that RINEX 3 knows, as RINEX 3.05."""
    lines = text.splitlines()
    if float(lines[0][:9]) < 4.0:
        return text
    out = ["     3.05           N: GNSS NAV DATA    M: MIXED            RINEX VERSION / TYPE"]
    out.append(" " * 60 + "END OF HEADER")
    keep = False
    for line in lines:
        if line.startswith(">"):
            words = line.split()
            keep = words[1] == "EPH" and words[3] in RINEX_3_MESSAGES
        elif keep:
            out.append(line)
    return "\n".join(out) + "\n"


def read(path):
    """Navigation data of a file as RTKLIB reads it."""
    raw = path.read_bytes()
    text = gzip.decompress(raw) if raw[:2] == b"\x1f\x8b" else raw
    navigation, observations, station = pyrtklib.nav_t(), pyrtklib.obs_t(), pyrtklib.sta_t()
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "file.nav"
        copy.write_text(as_rinex_3(text.decode("ascii")))
        if pyrtklib.readrnx(str(copy), 1, "", observations, navigation, station) != 1:
            raise SystemExit(f"RTKLIB could not read {path}")
    return navigation


def evaluate(function, ephemeris, toe, offset_s):
    """Position and clock by RTKLIB at an offset from the reference time."""
    time = pyrtklib.timeadd(toe, offset_s)
    position = pyrtklib.Arr1Ddouble(3)
    clock = pyrtklib.Arr1Ddouble(1)
    variance = pyrtklib.Arr1Ddouble(1)
    function(time, ephemeris, position, clock, variance)
    return [position[0], position[1], position[2], clock[0]]


def name_of(sat):
    """RINEX name of an RTKLIB satellite number."""
    text = pyrtklib.Arr1Dchar(8)
    pyrtklib.satno2id(sat, text)
    return text.ptr


def rows(data):
    """All rows of the table."""
    for name, steps in FILES:
        navigation = read(data / name)
        count = dict.fromkeys(steps, 0)
        groups = (
            (navigation.eph, navigation.n, pyrtklib.eph2pos),
            (navigation.geph, navigation.ng, pyrtklib.geph2pos),
        )
        for table, n, function in groups:
            for k in range(n):
                ephemeris = table[k]
                sat = name_of(ephemeris.sat)
                if sat[0] not in count:
                    continue
                count[sat[0]] += 1
                if count[sat[0]] % steps[sat[0]]:
                    continue
                toe_s = ephemeris.toe.time + ephemeris.toe.sec - 315_964_800
                source = ephemeris.code if sat[0] == "E" else 0
                for offset_s in OFFSETS_S.get(sat[0], OFFSETS_S["other"]):
                    state = evaluate(function, ephemeris, ephemeris.toe, offset_s)
                    yield (
                        [name, sat, f"{toe_s:.0f}", ephemeris.iode, source, offset_s]
                        + [f"{value:.5f}" for value in state[:3]]
                        + [f"{state[3]:.15e}"]
                    )


def main(data, out):
    """Write the table."""
    text = io.StringIO()
    text.write(
        f"# RTKLIB {pyrtklib.VER_RTKLIB} patch {pyrtklib.PATCH_LEVEL} through pyrtklib {version('pyrtklib')};"
    )
    text.write(" made by tools/make_orbit_reference.py\n")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow("file sat toe_gpst_s iode source offset_s x_m y_m z_m clock_s".split())
    writer.writerows(rows(Path(data)))
    Path(out).write_text(text.getvalue())


if __name__ == "__main__":
    main(*sys.argv[1:])
