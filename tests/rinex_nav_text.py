"""Made-up RINEX navigation text: records of given numbers, in the columns of each version."""

import numpy as np

# A circular-ish orbit of plausible size; the places are those of `KEPLER_COLUMNS` where they matter.
LNAV = {
    "af": (1.5e-4, -2.5e-12, 0.0),
    "rows": [
        (72.0, -98.2, 4.3e-9, 1.71),
        (-5.3e-6, 5.9e-3, 1.8e-6, 5153.6),
        (122_400.0, 3.4e-8, 2.52, -5.8e-8),
        (0.97, 353.6, 1.27, -8.3e-9),
        (-2.6e-10, 1.0, 2320.0, 0.0),
        (2.0, 0.0, -1.07e-8, 584.0),
        (115_218.0, 4.0, None, None),
    ],
}


def field(value, exponent="e"):
    """One number of 19 columns; None is blank."""
    return " " * 19 if value is None else f"{value:19.12e}".replace("e", exponent)


def header(version="3.04", kind="N: GNSS NAV DATA", system="M: MIXED", lines=()):
    """Header with the given extra lines, each a (content, label)."""
    text = f"{version:>9}{'':11}{kind:<20}{system:<20}RINEX VERSION / TYPE\n"
    for content, label in lines:
        text += f"{content:<60}{label}\n"
    return text + f"{'':60}END OF HEADER\n"


def record(sat="G05", epoch="2024 06 24 10 00 00", af=LNAV["af"], rows=LNAV["rows"], exponent="e"):
    """A record of RINEX 3 and 4 (without its ``>`` line)."""
    text = f"{sat} {epoch}" + "".join(field(value, exponent) for value in af) + "\n"
    for row in rows:
        text += "    " + "".join(field(value, exponent) for value in row) + "\n"
    return text


def record_2(number=5, epoch="24  6 24 10  0  0.0", af=LNAV["af"], rows=LNAV["rows"], exponent="D"):
    """A record of RINEX 2."""
    text = f"{number:2d} {epoch}" + "".join(field(value, exponent) for value in af) + "\n"
    for row in rows:
        text += "   " + "".join(field(value, exponent) for value in row) + "\n"
    return text


def glonass_record(sat="R03", epoch="2024 06 24 08 15 00", lines=5, health=0.0, channel=-4.0):
    """A GLONASS record of RINEX 3 (4 lines) or 3.05 and later (5)."""
    rows = [
        (10_390.48, 0.3135, 1e-9, health),
        (-3_906.96, 3.129, -9.3e-10, channel),
        (22_971.85, 0.392, -1.86e-9, 0.0),
        (183.0, -1.5e-9, 2.0, 3.0),
    ][: lines - 1]
    return record(sat, epoch, (1.6e-4, 9.1e-13, 116_100.0), rows)


def with_row(rows, index, values):
    """The rows with one replaced."""
    rows = list(rows)
    rows[index] = values
    return rows


def parse(text):
    """Read text by the package's reader."""
    from truenorth.formats.rinex_nav import parse_rinex_nav

    return parse_rinex_nav(text.encode() if isinstance(text, str) else text, path="made.nav")


def kepler_row(sat, toe_ns, *, message=0, sent_ns=None, health=0, iode=1, **changes):
    """A row for `build_navigation`: the orbit of `LNAV`, with changed elements."""
    from truenorth.navigation import KEPLER_COLUMNS

    values = dict.fromkeys(KEPLER_COLUMNS, 0.0)
    values |= {
        "sqrt_a": 5153.6,
        "eccentricity": 5.9e-3,
        "i0_rad": 0.97,
        "omega0_rad": 2.52,
        "omega_rad": 1.27,
        "m0_rad": 1.71,
        "delta_n_radps": 4.3e-9,
        "omega_dot_radps": -8.3e-9,
        "idot_radps": -2.6e-10,
        "cuc_rad": -5.3e-6,
        "cus_rad": 1.8e-6,
        "crc_m": 353.6,
        "crs_m": -98.2,
        "cic_rad": 3.4e-8,
        "cis_rad": -5.8e-8,
        "af0_s": 1.5e-4,
        "af1_sps": -2.5e-12,
        "ura_m": 2.0,
        "fit_interval_s": 14_400.0,
    }
    values |= changes
    sent_ns = toe_ns if sent_ns is None else sent_ns
    elements = np.array([values[name] for name in KEPLER_COLUMNS])
    return (sat, message, toe_ns, toe_ns, sent_ns, iode, iode, health, elements)
