"""Writing RINEX 3.05 navigation files.

One record per ephemeris, numbers as D19.12: 13 digits, so that what was read from such a file is written
back digit by digit. RINEX 3 knows the legacy messages only: GPS and QZSS LNAV, Galileo I/NAV and F/NAV,
BeiDou D1 and D2, NavIC LNAV, GLONASS FDMA, SBAS. Newer messages (CNAV, CNAV-2, B-CNAV, NavIC L1) are left
out, and counted. Of what `Navigation` does not hold the fields say "unknown" as the standard has it, or
what any receiver would write: code on L2 C/A, GLONASS age of data 0.

Reference: IGS/RTCM, RINEX 3.05, 2020, tables A5 to A21.
"""

import gzip

import numpy as np

from ..constants import BEIDOU, GALILEO, GLONASS, GPS, NAVIC, QZSS, SBAS, SYSTEM_NAMES, SYSTEMS
from ..errors import FormatError
from ..navigation import KEPLER_COLUMNS, MessageType
from ..observations import NO_CHANNEL, sat_name
from ..timescales import BDT_OFFSET_NS, NS_PER_S, NS_PER_WEEK, gpst_to_datetime64, leap_seconds

__all__ = ["write_rinex_navigation"]

VERSION = "3.05"

_ORDER = (GPS, GLONASS, GALILEO, QZSS, BEIDOU, NAVIC, SBAS)
_LEGACY = {
    GPS: (MessageType.LNAV,),
    GALILEO: (MessageType.INAV, MessageType.FNAV),
    QZSS: (MessageType.LNAV,),
    BEIDOU: (MessageType.D1, MessageType.D2),
    NAVIC: (MessageType.LNAV,),
}
_BDT_FIRST_WEEK = 1356

# Which signals an ephemeris came from: I/NAV of E1-B and E5b with the clock of E5b/E1; F/NAV of E5a.
_DATA_SOURCE = {MessageType.INAV: 517.0, MessageType.FNAV: 258.0}
_UNKNOWN_SBAS_ACCURACY = 32_767.0
_KLOBUCHAR_LABEL = {"G": "GPS", "C": "BDS", "J": "QZS", "I": "IRN"}


def write_rinex_navigation(path, navigation, *, program="TrueNorth", run_by="", date_ns=None, comments=()):
    """Write broadcast ephemerides to a RINEX 3.05 file.

    Parameters
    ----------
    path : str or os.PathLike
        The file; packed by gzip when the name ends in ``.gz``.
    navigation : Navigation
        What to write; precise orbits are not part of it.
    program, run_by : str
        For the header.
    date_ns : int, optional
        GPS time at which the file is said to be made; by default that of the first ephemeris, so that
        equal data give equal bytes.
    comments : sequence of str
        Comment lines, cut at 60 characters.

    Returns
    -------
    dict of str to int
        Ephemerides that RINEX 3 has no record for, by message name.

    Raises
    ------
    FormatError
        If the file cannot be written.
    """
    records, left_out = [], {}
    kepler, states = navigation.kepler, navigation.states
    for k in range(len(kepler)):
        system, message = int(kepler.sat[k]) // 100, MessageType(int(kepler.message[k]))
        if message not in _LEGACY[system]:
            left_out[message.name] = left_out.get(message.name, 0) + 1
            continue
        key = (_ORDER.index(system), int(kepler.sat[k]), int(kepler.toc_ns[k]))
        records.append((key, _kepler_record(kepler, k, system, message)))
    for k in range(len(states)):
        system = int(states.sat[k]) // 100
        key = (_ORDER.index(system), int(states.sat[k]), int(states.toe_ns[k]))
        record = _glonass_record if system == GLONASS else _sbas_record
        records.append((key, record(states, k)))
    records.sort(key=lambda record: record[0])
    if date_ns is None:
        date_ns = min((key[2] for key, _ in records), default=0)
    systems = sorted({key[0] for key, _ in records})
    header = _header(navigation, [_ORDER[k] for k in systems], program, run_by, date_ns, comments)
    data = (header + "".join(text for _, text in records)).encode("ascii", "replace")
    if str(path).endswith(".gz"):
        # Without name and time, so that equal data give equal bytes.
        data = gzip.compress(data, mtime=0)
    try:
        with open(path, "wb") as file:
            file.write(data)
    except OSError as error:
        raise FormatError(f"could not write the file: {error.strerror}", path=path) from error
    return left_out


def _line(content, label):
    return f"{content[:60]:<60}{label}\n"


def _header(navigation, systems, program, run_by, date_ns, comments):
    if len(systems) == 1:
        letter = SYSTEMS[systems[0]]
        kind = f"{letter}: {SYSTEM_NAMES[letter]}"
    else:
        kind = "M: MIXED"
    date = (
        str(gpst_to_datetime64(date_ns).astype("M8[s]")).replace("-", "").replace(":", "").replace("T", " ")
    )
    text = _line(f"{VERSION:>9}{'':11}{'N: GNSS NAV DATA':<20}{kind:<20}", "RINEX VERSION / TYPE")
    text += _line(f"{program[:20]:<20}{run_by[:20]:<20}{date} GPS", "PGM / RUN BY / DATE")
    for comment in comments:
        text += _line(comment, "COMMENT")
    for letter, label in _KLOBUCHAR_LABEL.items():
        if letter in navigation.klobuchar:
            values = navigation.klobuchar[letter]
            for half, four in (("A", values[:4]), ("B", values[4:])):
                text += _line(f"{label}{half} " + _coefficients(four), "IONOSPHERIC CORR")
    if navigation.nequick is not None:
        text += _line("GAL  " + _coefficients([*navigation.nequick, 0.0]), "IONOSPHERIC CORR")
    if navigation.leap_seconds is not None:
        text += _line(f"{navigation.leap_seconds:6d}", "LEAP SECONDS")
    return text + _line("", "END OF HEADER")


def _coefficients(values):
    return "".join(f"{value:12.4E}" for value in values)


def _record(sat, epoch_ns, clock, rows):
    """The text of a record; None is a blank field, blanks at the end of a line are left out."""
    stamp = str(gpst_to_datetime64(epoch_ns).astype("M8[s]"))
    for mark in "-T:":
        stamp = stamp.replace(mark, " ")
    lines = [f"{sat_name(sat)} {stamp}" + "".join(f"{value:19.12E}" for value in clock)]
    for row in rows:
        fields = "".join(" " * 19 if value is None else f"{value:19.12E}" for value in row)
        lines.append(("    " + fields).rstrip())
    return "\n".join(lines) + "\n"


def _kepler_record(kepler, k, system, message):
    el = dict(zip(KEPLER_COLUMNS, kepler.elements[k].tolist(), strict=True))
    shift_ns = BDT_OFFSET_NS if system == BEIDOU else 0
    toc_ns, toe_ns, sent_ns = (
        int(column[k]) - shift_ns for column in (kepler.toc_ns, kepler.toe_ns, kepler.transmission_ns)
    )
    week = toe_ns // NS_PER_WEEK
    toe_s = (toe_ns - week * NS_PER_WEEK) / NS_PER_S
    # Counted from the start of the week of toe, and so outside of it near its ends.
    sent_s = (sent_ns - week * NS_PER_WEEK) / NS_PER_S
    accuracy_m = -1.0 if np.isnan(el["ura_m"]) else el["ura_m"]
    issue, clock_issue = float(kepler.iode[k]), float(kepler.iodc[k])
    delay_s, second_delay_s = el["tgd_s"], el["tgd2_s"]
    idot, health = el["idot_radps"], float(kepler.health[k])
    fifth = (idot, None, float(week), None)
    sixth = (accuracy_m, health, delay_s, None)
    seventh = (sent_s,)
    if system in (GPS, QZSS):
        fifth = (idot, 1.0, float(week), 0.0)
        sixth = (accuracy_m, health, delay_s, clock_issue)
        fit_h = el["fit_interval_s"] / 3600.0
        # GPS writes the interval in hours, QZSS a flag: longer than two hours.
        seventh = (sent_s, fit_h if system == GPS else float(fit_h > 2.0))
    elif system == GALILEO:
        fifth = (idot, _DATA_SOURCE[message], float(week), None)
        sixth = (accuracy_m, health, delay_s, second_delay_s)
    elif system == BEIDOU:
        fifth = (idot, None, float(week - _BDT_FIRST_WEEK), None)
        sixth = (accuracy_m, health, delay_s, second_delay_s)
        seventh = (sent_s, clock_issue)
    rows = (
        (issue, el["crs_m"], el["delta_n_radps"], el["m0_rad"]),
        (el["cuc_rad"], el["eccentricity"], el["cus_rad"], el["sqrt_a"]),
        (toe_s, el["cic_rad"], el["omega0_rad"], el["cis_rad"]),
        (el["i0_rad"], el["crc_m"], el["omega_rad"], el["omega_dot_radps"]),
        fifth,
        sixth,
        seventh,
    )
    return _record(int(kepler.sat[k]), toc_ns, (el["af0_s"], el["af1_sps"], el["af2_sps2"]), rows)


def _kilometres(states, k, last):
    """Rows of position, velocity and acceleration by axis, each with a last number of its own."""
    values = states.states[k, :9].reshape(3, 3).T / 1e3
    return [(*axis.tolist(), value) for axis, value in zip(values, last, strict=True)]


def _utc_ns(time_ns):
    """UTC of an instant of GPS time."""
    utc_ns = time_ns - int(leap_seconds(time_ns)) * NS_PER_S
    return time_ns - int(leap_seconds(utc_ns)) * NS_PER_S


def _glonass_record(states, k):
    epoch_ns, sent_ns = _utc_ns(int(states.toe_ns[k])), _utc_ns(int(states.transmission_ns[k]))
    clock_s, drift_sps, delay_s = states.states[k, 9:].tolist()
    channel = int(states.channel[k])
    # Health; channel; age of the data: the last numbers of the lines.
    last = (float(states.health[k]), 0.0 if channel == NO_CHANNEL else float(channel), 0.0)
    rows = _kilometres(states, k, last)
    # Status and accuracy unknown; the delay of L2 against L1 is.
    rows.append((None, delay_s, None, None))
    sent_s = sent_ns % NS_PER_WEEK / NS_PER_S
    return _record(int(states.sat[k]), epoch_ns, (clock_s, drift_sps, sent_s), rows)


def _sbas_record(states, k):
    clock_s, drift_sps = states.states[k, 9:11].tolist()
    last = (float(states.health[k]), _UNKNOWN_SBAS_ACCURACY, 0.0)
    sent_s = int(states.transmission_ns[k]) % NS_PER_WEEK / NS_PER_S
    return _record(
        int(states.sat[k]),
        int(states.toe_ns[k]),
        (clock_s, drift_sps, sent_s),
        _kilometres(states, k, last),
    )
