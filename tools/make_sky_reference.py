"""Write the table of satellite states that RTKLIB computes from a navigation file of the nominal sky.

The emulator's nominal constellations are written as RINEX 3.05 by the package and read by RTKLIB through
pyrtklib (``pip install pyrtklib``), which no part of the package needs; RTKLIB evaluates every ephemeris
around its reference time.

Usage::

    python tools/make_sky_reference.py tests/reference/data/nominal_sky_rtklib.csv
"""

import csv
import io
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path

import pyrtklib
from make_orbit_reference import evaluate, name_of, read

from truenorth.formats import write_rinex_navigation
from truenorth.simulation.sky import NominalSky, build_sky
from truenorth.timescales import gpst_from_calendar

SYSTEMS, START, DURATION_S, SEED = "GRECJI", (2024, 6, 24, 8), 600.0, 7
OFFSETS_S = {"R": (-700.0, 730.0), "other": (-3600.0, 3599.875)}


def rows():
    """All rows of the table."""
    sky = build_sky(
        NominalSky(systems=SYSTEMS), start_ns=gpst_from_calendar(*START), duration_s=DURATION_S, seed=SEED
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "nominal.nav"
        write_rinex_navigation(path, sky.navigation)
        navigation = read(path)
    groups = (
        (navigation.eph, navigation.n, pyrtklib.eph2pos),
        (navigation.geph, navigation.ng, pyrtklib.geph2pos),
    )
    for table, n, function in groups:
        for k in range(n):
            ephemeris = table[k]
            sat = name_of(ephemeris.sat)
            toe_s = ephemeris.toe.time + ephemeris.toe.sec - 315_964_800
            for offset_s in OFFSETS_S.get(sat[0], OFFSETS_S["other"]):
                state = evaluate(function, ephemeris, ephemeris.toe, offset_s)
                yield [sat, f"{toe_s:.0f}", offset_s, *(f"{x:.5f}" for x in state[:3]), f"{state[3]:.15e}"]


def main(out):
    """Write the table."""
    text = io.StringIO()
    text.write(
        f"# RTKLIB {pyrtklib.VER_RTKLIB} patch {pyrtklib.PATCH_LEVEL} through pyrtklib {version('pyrtklib')};"
        " made by tools/make_sky_reference.py\n"
    )
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow("sat toe_gpst_s offset_s x_m y_m z_m clock_s".split())
    # Galileo has each ephemeris twice, of I/NAV and F/NAV, with the same orbit and clock.
    writer.writerows(list(map(list, dict.fromkeys(map(tuple, rows())))))
    Path(out).write_text(text.getvalue())


if __name__ == "__main__":
    main(*sys.argv[1:])
