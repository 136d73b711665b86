"""NMEA 0183 sentences of a solution: ``PASHR``, ``HDT`` and ``THS`` for every epoch.

Of two antennas the azimuth of the baseline is given as heading and its elevation as pitch: this is
the attitude of a platform whose second antenna stands straight ahead of the first. Roll is unknown and
stays empty; three antennas and more give it.
A heading goes out for validated integers only; otherwise the fields are empty, ``THS`` says ``V``
and the quality of ``PASHR`` is 1 for a float solution and 0 for none.

References
----------
NMEA 0183 version 4.10 (HDT, THS); Trimble, BD9xx receiver help, message PASHR.
"""

import numpy as np

from ..attitude.array_solution import AttitudeSolution
from ..errors import Status
from ..timescales import NS_PER_DAY, NS_PER_S, leap_seconds

__all__ = ["checksum", "nmea_text", "utc_clock"]

_TALKERS = {"G": "GP", "R": "GL", "E": "GA", "C": "GB"}


def checksum(body):
    """Two hexadecimal digits: exclusive or of the characters between ``$`` and ``*``."""
    value = 0
    for byte in body.encode("ascii"):
        value ^= byte
    return f"{value:02X}"


def utc_clock(time_ns):
    """UTC time of day of GPS times, as ``hhmmss.sss``; a leap second reads ``235960.sss``.

    Parameters
    ----------
    time_ns : ndarray of int64, shape (n,)
        GPS time, nanoseconds.

    Returns
    -------
    list of str
    """
    # Rounded first, so that no field reads 60 seconds by rounding.
    time_ns = (np.asarray(time_ns, dtype=np.int64) + 500_000) // 1_000_000 * 1_000_000
    leap = leap_seconds(time_ns)
    leap = leap_seconds(time_ns - leap * NS_PER_S)
    utc_ns = time_ns - leap * NS_PER_S
    # Within the inserted second UTC repeats itself: the count disagrees with the one before it.
    inserted = leap_seconds(utc_ns) != leap
    milliseconds = (utc_ns - inserted * NS_PER_S) % NS_PER_DAY // 1_000_000
    seconds, fraction = milliseconds // 1000, milliseconds % 1000
    fields = (seconds // 3600, seconds // 60 % 60, seconds % 60 + inserted, fraction)
    return [
        f"{hour:02d}{minute:02d}{second:02d}.{thousandth:03d}"
        for hour, minute, second, thousandth in zip(*(field.tolist() for field in fields), strict=True)
    ]


def nmea_text(solution):
    """The result as NMEA sentences.

    Parameters
    ----------
    solution : BaselineSolution or AttitudeSolution
        Result of `truenorth.solve_session`.

    Returns
    -------
    str
        Sentences ended by carriage return and line feed.
    """
    systems = str(solution.settings.get("systems", ""))
    talker = _TALKERS.get(systems, "GN")
    angles = np.degrees(_angles(solution))
    heading_deg = np.mod(np.round(angles[0], 3), 360.0)
    rows = zip(
        utc_clock(solution.time_ns),
        heading_deg.tolist(),
        *angles[1:].tolist(),
        solution.is_accepted.tolist(),
        (solution.status == Status.FLOAT).tolist(),
        strict=True,
    )
    lines = []
    for clock, heading, pitch, roll, heading_sd, pitch_sd, roll_sd, accepted, is_float in rows:
        if accepted:
            roll_text = f"{roll:+.3f}" if roll == roll else ""
            roll_sd_text = f"{roll_sd:.3f}" if roll_sd == roll_sd else ""
            bodies = (
                f"PASHR,{clock},{heading:.3f},T,{roll_text},{pitch:+.3f},,{roll_sd_text},{pitch_sd:.3f},"
                f"{heading_sd:.3f},2,0",
                f"{talker}HDT,{heading:.3f},T",
                f"{talker}THS,{heading:.3f},A",
            )
        else:
            bodies = (
                f"PASHR,{clock},,T,,,,,,,{int(is_float)},0",
                f"{talker}HDT,,T",
                f"{talker}THS,,V",
            )
        lines += [f"${body}*{checksum(body)}\r\n" for body in bodies]
    return "".join(lines)


def _angles(solution):
    """Heading, pitch, roll and their standard deviations, ndarray, shape (6, n)."""
    if isinstance(solution, AttitudeSolution):
        angles = (solution.heading_rad, solution.pitch_rad, solution.roll_rad)
        return np.stack([*angles, *(solution.angle_sd_rad(k) for k in range(3))])
    unknown = np.full(solution.n_epochs, np.nan)
    return np.stack(
        [
            solution.azimuth_rad, solution.elevation_rad, unknown,
            solution.azimuth_sd_rad, solution.elevation_sd_rad, unknown,
        ]
    )  # fmt: skip
