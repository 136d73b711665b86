"""The table of file formats: how each is recognised and read.

A format is a record of a name, a function that looks at the first bytes of the unpacked content, and a
reader. Content decides, never the name of the file. Readers are imported when they are used.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from ..errors import FormatError

__all__ = [
    "FORMATS",
    "Format",
    "identify",
    "read",
    "read_navigation",
    "read_observations",
    "sniff",
    "sniff_bytes",
]

_LOOK_AT = 4096


@dataclass(frozen=True, slots=True)
class Format:
    """One file format.

    Parameters
    ----------
    name : str
        Short name, as `sniff` returns it.
    title : str
        Name in sentences.
    holds : str
        ``"observations"``, ``"navigation"``, ``"both"``, ``"orbits"`` or ``"sensor"``.
    recognise : callable
        Takes the first bytes of the content, tells whether they are of this format.
    read : callable
        Takes the unpacked content and, for messages, the path; returns what the file holds.
    """

    name: str
    title: str
    holds: str
    recognise: Callable[[bytes], bool]
    read: Callable[..., Any]


def _rinex_kind(head):
    """Type letter of a RINEX file; empty when it is none."""
    line = head.removeprefix(b"\xef\xbb\xbf").split(b"\n", 1)[0]
    if line[60:80].strip() != b"RINEX VERSION / TYPE":
        return ""
    return line[20:21].decode("latin-1").upper() or " "


def _is_rinex_obs(head):
    return _rinex_kind(head) == "O"


def _is_rinex_nav(head):
    kind = _rinex_kind(head)
    return kind != "" and kind in "NGHL"


def _is_sp3(head):
    return re.match(rb"#[abcd][PV ]\s?\d{3,4} ", head) is not None


def _is_ubx(head):
    """A UBX frame with a right checksum, possibly after other bytes (NMEA, RTCM)."""
    at = head.find(b"\xb5\x62")
    while 0 <= at < len(head) - 8:
        length = int.from_bytes(head[at + 4 : at + 6], "little")
        frame = head[at + 2 : at + 6 + length]
        if len(frame) == length + 4 and at + 8 + length <= len(head):
            a = b = 0
            for byte in frame:
                a = (a + byte) & 0xFF
                b = (b + a) & 0xFF
            if head[at + 6 + length] == a and head[at + 7 + length] == b:
                return True
        at = head.find(b"\xb5\x62", at + 1)
    return False


def _is_oem3(head):
    from .novatel_oem3 import is_oem3

    return is_oem3(head)


def _is_fog_log(head):
    from .fog_packet import is_fog_log

    return is_fog_log(head)


def _is_fog_packets(head):
    from .fog_packet import is_packet_stream

    return is_packet_stream(head)


def _is_sensor_table(head):
    from .sensor_table import is_sensor_table

    return is_sensor_table(head)


def _is_tcm2(head):
    from .tcm2 import is_tcm2

    return is_tcm2(head)


def _read_rinex_obs(data, path):
    from .rinex_obs import parse_rinex_obs

    return parse_rinex_obs(data, path=path)


def _read_rinex_nav(data, path):
    from .rinex_nav import parse_rinex_nav

    return parse_rinex_nav(data, path=path)


def _read_sp3(data, path):
    from .sp3 import parse_sp3

    return parse_sp3(data, path=path)


def _read_ubx(data, path):
    from .ubx import parse_ubx

    return parse_ubx(data, path=path)


def _read_oem3(data, path):
    from .novatel_oem3 import parse_oem3

    return parse_oem3(data, path=path)


def _read_fog_packets(data, path):
    from .fog_packet import parse_fog_packets

    return parse_fog_packets(data, path=path)


def _read_sensor_table(data, path):
    from .sensor_table import parse_sensor_table

    return parse_sensor_table(data, path=path)


def _read_tcm2(data, path):
    from .tcm2 import parse_tcm2

    return parse_tcm2(data, path=path)


FORMATS = (
    Format("rinex_obs", "a RINEX observation file", "observations", _is_rinex_obs, _read_rinex_obs),
    Format("rinex_nav", "a RINEX navigation file", "navigation", _is_rinex_nav, _read_rinex_nav),
    Format("sp3", "an SP3 orbit file", "orbits", _is_sp3, _read_sp3),
    Format("ubx", "a UBX log", "both", _is_ubx, _read_ubx),
    Format("novatel_oem3", "a NovAtel OEM3 log", "both", _is_oem3, _read_oem3),
    Format("fog_log", "a log of fibre-optic gyro packets", "sensor", _is_fog_log, _read_fog_packets),
    Format("tcm2", "a log of TCM2 compass sentences", "sensor", _is_tcm2, _read_tcm2),
    Format("sensor_table", "a table of sensor samples", "sensor", _is_sensor_table, _read_sensor_table),
    # Last: the stream has no mark but the pattern of its highest bits.
    Format(
        "fog_packets", "a stream of fibre-optic gyro packets", "sensor", _is_fog_packets, _read_fog_packets
    ),
)
"""All formats, in the order in which they are tried."""


def sniff_bytes(head):
    """Format of unpacked content.

    Parameters
    ----------
    head : bytes
        The first bytes; a few thousand are enough.

    Returns
    -------
    Format or None
        None when no format recognises them.
    """
    for form in FORMATS:
        if form.recognise(head[:_LOOK_AT]):
            return form
    return None


def identify(path):
    """Unpack a file and tell its format.

    Parameters
    ----------
    path : str or os.PathLike
        The file, packed or not.

    Returns
    -------
    form : Format
        Its format.
    data : bytes
        Its unpacked content.

    Raises
    ------
    FormatError
        If the file cannot be opened or unpacked, or no format recognises it.
    """
    from .compression import read_bytes

    data = read_bytes(path)
    form = sniff_bytes(data)
    if form is None:  # other messages may come before the first one of a receiver
        logs = [f for f in FORMATS if f.holds == "both"]
        form = next((f for f in logs if f.recognise(data[: 64 * _LOOK_AT])), None)
    if form is None:
        raise FormatError(_not_recognised(data), path=path, line_number=1 if _is_text(data) else None)
    return form, data


def _is_text(data):
    return not any(byte < 9 for byte in data[:200])


def _not_recognised(data):
    line = data.removeprefix(b"\xef\xbb\xbf").split(b"\n", 1)[0]
    if line[60:80].strip() == b"RINEX VERSION / TYPE":
        what = f"this is a RINEX file of type {line[20:40].decode('latin-1').strip()!r}"
    elif _is_text(data):
        shown = line[:30].decode("latin-1").strip()
        what = f"the format is not recognised, the file begins with {shown!r}"
    else:
        what = f"the format is not recognised, the file begins with bytes {data[:4].hex(' ')}"
    return what + (
        "; RINEX observations and navigation, UBX and NovAtel OEM3 logs, SP3 orbits, and logs of "
        "gyro packets and of TCM2 sentences, and tables of sensor samples are read"
    )


def sniff(path):
    """Tell the format of a file from its content.

    Parameters
    ----------
    path : str or os.PathLike
        The file, packed or not.

    Returns
    -------
    str
        The name of one of `FORMATS`: ``"rinex_obs"``, ``"rinex_nav"``, ``"sp3"``, ``"ubx"``...

    Raises
    ------
    FormatError
        If the file cannot be opened or unpacked, or its content is none of these.
    """
    return identify(path)[0].name


def read(path):
    """Read any file that the package knows.

    Parameters
    ----------
    path : str or os.PathLike
        The file, packed or not; its content decides how it is read.

    Returns
    -------
    Observations, Navigation, tuple, orbits or SensorLog
        `Observations` of a RINEX observation file, `Navigation` of a RINEX navigation file, both in a
        tuple of a receiver's own log, the orbit table of an SP3 file, `SensorLog` of a sensor's log.

    Raises
    ------
    FormatError
        If the file cannot be read or its format is not known.

    Examples
    --------
    >>> import truenorth as tn
    >>> pair = tn.datasets.fetch("pair_1m_geodetic")
    >>> tn.read(pair.files["base"]).n_epochs
    301
    """
    form, data = identify(path)
    return form.read(data, str(path))


def read_observations(path):
    """Read the observations of one receiver.

    Parameters
    ----------
    path : str or os.PathLike
        RINEX observation file (version 2, 3 or 4, plain, compressed, Hatanaka) or UBX log.

    Returns
    -------
    Observations

    Raises
    ------
    FormatError
        If the file cannot be read or holds no observations.
    """
    form, data = identify(path)
    if form.holds == "observations":
        return form.read(data, str(path))
    if form.holds == "both":
        return form.read(data, str(path))[0]
    advice = "give it as navigation, and" if form.holds == "navigation" else "give"
    raise FormatError(
        f"this is {form.title} and observations are expected; {advice} a RINEX observation file or UBX "
        "log here",
        path=path,
        line_number=1,
    )


def read_navigation(*paths):
    """Read broadcast ephemerides from one or several files and merge them.

    Parameters
    ----------
    *paths : str or os.PathLike
        RINEX navigation files (version 2, 3 or 4, plain or compressed) or UBX logs; an SP3 file puts
        precise orbits and clocks in the place of the broadcast ones.

    Returns
    -------
    Navigation

    Raises
    ------
    FormatError
        If no file is given, or one cannot be read or holds no navigation.
    """
    if not paths:
        raise FormatError("no navigation file was given; give at least one RINEX navigation file or UBX log")
    from ..navigation import build_navigation, merge_navigation

    parts = []
    for path in paths:
        form, data = identify(path)
        if form.holds == "navigation":
            parts.append(form.read(data, str(path)))
        elif form.holds == "both":
            parts.append(form.read(data, str(path))[1])
        elif form.holds == "orbits":
            parts.append(replace(build_navigation(paths=(str(path),)), precise=form.read(data, str(path))))
        else:
            advice = "give it as observations, and" if form.holds == "observations" else "give"
            raise FormatError(
                f"this is {form.title} and navigation is expected; {advice} a RINEX navigation file or UBX "
                "log here",
                path=path,
                line_number=1,
            )
    if len(parts) == 1:
        return parts[0]
    return merge_navigation(*parts)
