"""Writing u-blox logs: measurements (RXM-RAWX) and broadcast navigation bits (RXM-SFRBX).

What such a log can hold is what a ZED-F9P says, so

- code and phase are doubles and come back unchanged; the Doppler is a single, the C/N0 whole dB-Hz;
- a slip is a lock counter that starts again, an unresolved half cycle a status bit. The counter stops
  at 64.5 s, so a signal that stays away for longer comes back flagged;
- there are codes for some signals only. Where the receiver tracks data and pilot together (RINEX
  attribute X), the pilot's code stands for it; other signals (GPS P(Y) among them) are left out and
  counted in `UbxWriter.skipped`;
- the standard deviations are those that an F9P states at such a C/N0.

A satellite's navigation frames are written with its first epoch, and then every 30 s, after the epoch in
which the frame was complete. It sends the ephemeris whose reference time is closest, which is the one
that a receiver takes. Ionosphere and leap seconds of GPS and QZSS (subframe 4 page 18) come with the
first frames and every 12.5 minutes.

References: u-blox, "ZED-F9P interface description" UBX-18010854, 3.15 and 3.17.
"""

import struct

import numpy as np

from ..constants import BEIDOU, GALILEO, GLONASS, GPS, QZSS, SYSTEMS
from ..errors import FormatError
from ..navigation import MessageType
from ..observations import LLI_HALF_CYCLE, LLI_SLIP, NO_CHANNEL, sat_name, signal_id, signal_name
from ..timescales import NS_PER_S, NS_PER_WEEK, format_gpst, leap_seconds
from . import navigation_frames as frames
from . import ubx
from .compression import open_for_writing

__all__ = ["UbxWriter", "encode_frame", "encode_sfrbx", "write_ubx"]

_MS_NS = 1_000_000
_LONGEST_LOCK_MS = 64_500
_NEVER = np.iinfo(np.int64).min // 2
_MOST_MEASUREMENTS = 255
_IONOSPHERE_FRAMES = 25  # a page of subframe 4 comes back after 25 frames
_REACH_NS = {GLONASS: 6 * 3600 * NS_PER_S}  # beyond, a reader would take the wrong day
_USUAL_REACH_NS = NS_PER_WEEK // 2 - 3600 * NS_PER_S  # or the wrong week

# Signals that stand for others of the same carrier.
_ALIKE = {
    "G": {"2X": "2L", "5X": "5Q"},
    "E": {"1X": "1C", "5X": "5Q", "7X": "7Q", "6X": "6C"},
    "C": {"1X": "1P", "2X": "2I", "5X": "5P", "6X": "6I", "7X": "7I"},
    "J": {"2X": "2L", "5X": "5Q"},
}


def _lookup_tables():
    """Our system and satellite to gnssId and svId; our system and signal to sigId; -1 for none."""
    gnss = np.full(len(SYSTEMS), -1, dtype=np.int64)
    offset = np.zeros(len(SYSTEMS), dtype=np.int64)
    sig = np.full((len(SYSTEMS), 1000), -1, dtype=np.int64)
    for number, (system, _, _, shift) in ubx.SYSTEM_OF_GNSS.items():
        gnss[system], offset[system] = number, shift
        for code, name in reversed(ubx.SIGNALS[number].items()):
            sig[system, signal_id(name)] = code
        for name, other in _ALIKE.get(SYSTEMS[system], {}).items():
            sig[system, signal_id(name)] = sig[system, signal_id(other)]
    return gnss, offset, sig


_GNSS, _OFFSET, _SIG = _lookup_tables()
# The geostationary satellites of BeiDou have codes of their own for the same signals.
_SIG_OF_D2 = {0: 1, 2: 3, 4: 10}


def encode_frame(kind, payload):
    """Frame a message: sync characters, class, identity, length and checksum around it.

    Parameters
    ----------
    kind : int
        ``256 * class + identity``.
    payload : bytes
        The message.

    Returns
    -------
    bytes
    """
    body = struct.pack("<BBH", kind >> 8, kind & 0xFF, len(payload)) + payload
    # Fletcher: the sum of the bytes, and of the sums after each byte.
    numbers = np.frombuffer(body, dtype=np.uint8).astype(np.int64)
    first = int(numbers.sum())
    second = int((numbers * np.arange(len(body), 0, -1)).sum())
    return b"\xb5\x62" + body + bytes([first & 0xFF, second & 0xFF])


def encode_sfrbx(gnss, sv, words, *, sig=0, channel=0, version=2):
    """RXM-SFRBX: the words of one frame of navigation bits.

    Parameters
    ----------
    gnss, sv, sig : int
        gnssId, svId and sigId of u-blox.
    words : sequence of int
        Words of 32 bits.
    channel : int
        GLONASS frequency channel, -7 to 6.
    version : int
        Of the message; 2 has the signal's identity.

    Returns
    -------
    bytes
        The whole frame.
    """
    head = struct.pack("<8B", gnss, sv, sig, channel + 7, len(words), 0, version, 0)
    return encode_frame(ubx.RXM_SFRBX, head + struct.pack(f"<{len(words)}I", *words))


def write_ubx(path, observations, navigation=None):
    """Write a u-blox log.

    Parameters
    ----------
    path : str or os.PathLike
        The file; packed by gzip when the name ends in ``.gz``.
    observations : Observations
        Measurements.
    navigation : Navigation, optional
        Ephemerides for the navigation bits.

    Returns
    -------
    dict of str to int
        What could not be written, as `UbxWriter.skipped`.

    Raises
    ------
    FormatError
        As `UbxWriter.write_block`, or if the file cannot be opened.
    """
    with UbxWriter(path, navigation) as writer:
        writer.write_block(observations)
    return writer.skipped


class UbxWriter:
    """A u-blox log that grows by blocks of epochs.

    Parameters
    ----------
    path : str or os.PathLike
        The file; packed by gzip when the name ends in ``.gz``.
    navigation : Navigation, optional
        Ephemerides for the navigation bits; without, the log has none.

    Attributes
    ----------
    skipped : dict of str to int
        What the log cannot hold: measurements by system and signal (``"G 2W"``), ephemerides by satellite
        and message (``"G05 CNAV"``).

    Raises
    ------
    FormatError
        If the file cannot be opened.
    """

    def __init__(self, path, navigation=None):
        self._path = path
        self._navigation = navigation
        self._ephemerides = {} if navigation is None else _by_satellite(navigation)
        self._sent_frame = {}
        self._refused = set()
        self._lock_since_ms = np.full((len(SYSTEMS) * 100, 1000), _NEVER, dtype=np.int64)
        self._last_ns = None
        self.skipped = {}
        self._file = open_for_writing(path)

    def __enter__(self):
        """Return the writer; leaving closes the file."""
        return self

    def __exit__(self, *_):
        """Close the file."""
        self.close()

    def close(self):
        """Finish the file."""
        self._file.close()

    def write_block(self, observations):
        """Append epochs with the navigation frames that come in their time.

        Parameters
        ----------
        observations : Observations
            Epochs later than those of the block before.

        Raises
        ------
        FormatError
            If an epoch is not later than the one before, or has more than 255 measurements.
        """
        time_ns = observations.time_ns
        if observations.n_epochs == 0:
            return
        times = time_ns if self._last_ns is None else np.concatenate(([self._last_ns], time_ns))
        if np.any(np.diff(times) <= 0):
            at = int(np.flatnonzero(np.diff(times) <= 0)[0]) + 1
            raise FormatError(
                f"the epoch {format_gpst(times[at])} GPST is not later than the one before; write the blocks "
                "in order of time",
                path=self._path,
            )
        if self._last_ns is None:
            self._file.write(_receiver_messages(observations))
        self._last_ns = int(time_ns[-1])
        rows, epoch, sat_of_row = self._measurements(observations)
        start = np.searchsorted(epoch, np.arange(observations.n_epochs + 1)).tolist()
        leap_s = observations.meta.leap_seconds
        for k, now_ns in enumerate(time_ns.tolist()):
            part = rows[start[k] : start[k + 1]]
            if len(part) > _MOST_MEASUREMENTS:
                raise FormatError(
                    f"the epoch {format_gpst(now_ns)} GPST has {len(part)} measurements and RXM-RAWX holds "
                    "255; leave out signals",
                    path=self._path,
                )
            week, in_week = divmod(now_ns, NS_PER_WEEK)
            leap = int(leap_seconds(now_ns)) if leap_s is None else leap_s
            head = struct.pack("<dHbBBB2x", in_week / NS_PER_S, week, leap, len(part), 1, 1)
            self._file.write(encode_frame(ubx.RXM_RAWX, head + part.tobytes()))
            if self._navigation is not None:
                begun = [frames.frame_start_ns(system, now_ns) for system in range(len(SYSTEMS))]
                for sat in np.unique(sat_of_row[start[k] : start[k + 1]]).tolist():
                    if self._sent_frame.get(sat) != begun[sat // 100]:
                        self._write_frames(sat, begun[sat // 100])

    def _measurements(self, observations):
        """Records of RXM-RAWX, their epochs and satellites."""
        sat, signal = observations.sat.astype(np.int64), observations.signal.astype(np.int64)
        system, number = sat // 100, sat % 100
        channels = observations.glonass_channel.astype(np.int64)
        if self._navigation is not None:
            broadcast = self._navigation.glonass_channels()
            channels = np.where(channels == NO_CHANNEL, broadcast, channels)
        channel = np.where(system == GLONASS, channels[number], 0)
        sig = _SIG[system, signal]
        is_d2 = (system == BEIDOU) & ((number <= 5) | (number >= 59))
        for usual, other in _SIG_OF_D2.items():
            sig = np.where(is_d2 & (sig == usual), other, sig)
        writable = (sig >= 0) & (channel != NO_CHANNEL)
        # Of two that one code stands for, the first of the satellite stays.
        key = (observations.epoch_of_row * 1000 + sat) * 256 + sig
        _, first = np.unique(np.where(writable, key, -1 - np.arange(len(key))), return_index=True)
        kept = np.zeros(len(key), dtype=bool)
        kept[first] = True
        kept &= writable
        for left in np.unique(system[~kept] * 1000 + signal[~kept]).tolist():
            name = f"{SYSTEMS[left // 1000]} {signal_name(left % 1000)}"
            count = int(np.sum(~kept & (system == left // 1000) & (signal == left % 1000)))
            self.skipped[name] = self.skipped.get(name, 0) + count
        taken = observations.select_rows(kept)
        epoch, lli = taken.epoch_of_row, taken.lli
        code, phase, cn0 = taken.code_m, taken.phase_cyc, taken.cn0_dbhz
        has_code, has_phase = np.isfinite(code), np.isfinite(phase)
        rows = np.zeros(taken.n_rows, dtype=ubx.MEASUREMENT)
        rows["code"] = np.where(has_code, code, 0.0)
        rows["phase"] = np.where(has_phase, phase, 0.0)
        rows["doppler"] = taken.doppler_hz
        rows["gnss"] = _GNSS[system[kept]]
        rows["sv"] = number[kept] + _OFFSET[system[kept]]
        rows["sig"] = sig[kept]
        rows["freq"] = np.where(system[kept] == GLONASS, channel[kept] + 7, 0)
        rows["lock_ms"] = self._lock(taken, epoch)
        cn0 = np.nan_to_num(cn0, nan=0.0)
        rows["cn0"] = np.clip(np.rint(cn0), 0, 255)
        # Codes of standard deviations: 1 cm, 0.2 mHz doubling, and 0.004 cycles each.
        rows["code_sd"] = np.clip(np.rint(3.0 + (46.0 - cn0) / 4.0), 3, 15)
        rows["phase_sd"] = np.clip(np.rint(10.0 ** ((44.0 - cn0) / 20.0)), 1, 15)
        rows["doppler_sd"] = np.clip(np.rint(5.0 + (46.0 - cn0) / 4.0), 1, 15)
        resolved = has_phase & ((lli & LLI_HALF_CYCLE) == 0)
        rows["track"] = 1 * has_code + 2 * has_phase + 4 * resolved
        return rows, epoch, sat[kept]

    def _lock(self, taken, epoch):
        """Milliseconds since each signal's last slip, which the counter and the block's state tell."""
        now_ms = taken.time_ns[epoch] // _MS_NS
        sat, signal = taken.sat.astype(np.int64), taken.signal.astype(np.int64)
        slip = (taken.lli & LLI_SLIP) != 0
        order = np.lexsort((epoch, signal, sat))
        key, now_ms = (sat * 1000 + signal)[order], now_ms[order]
        first = np.ones(len(key) + 1, dtype=bool)
        first[1:-1] = key[1:] != key[:-1]
        here = np.arange(len(key))
        group_start = np.maximum.accumulate(np.where(first[:-1], here, 0))
        last_slip = np.maximum.accumulate(np.where(slip[order], here, -1))
        before = self._lock_since_ms[sat[order], signal[order]]
        since = np.where(last_slip >= group_start, now_ms[last_slip], before)
        last = first[1:]
        self._lock_since_ms[sat[order][last], signal[order][last]] = since[last]
        lock = np.empty(len(key), dtype=np.int64)
        lock[order] = np.minimum(now_ms - since, _LONGEST_LOCK_MS)
        return lock

    def _write_frames(self, sat, start_ns):
        """Navigation frames of a satellite that began at a time."""
        system = sat // 100
        is_first = sat not in self._sent_frame
        self._sent_frame[sat] = start_ns
        gnss, sv = int(_GNSS[system]), sat % 100 + int(_OFFSET[system])
        for message, (table, rows, toe_ns) in self._ephemerides.get(sat, {}).items():
            best = int(np.argmin(np.abs(toe_ns - start_ns)))
            reach_ns = _REACH_NS.get(system, _USUAL_REACH_NS)
            if abs(int(toe_ns[best]) - start_ns) > reach_ns:
                continue
            row = int(rows[best])
            channel = int(self._navigation.states.channel[row]) if system == GLONASS else 0
            try:
                sent = frames.navigation_words(self._navigation, table, row, start_ns)
                messages = [
                    encode_sfrbx(gnss, sv, words, sig=_navigation_signal(sat, message), channel=channel)
                    for words in sent
                ]
            except (ValueError, struct.error):
                self._refuse(sat, message, row)
                continue
            self._file.write(b"".join(messages))
        letter = SYSTEMS[system]
        due = start_ns // frames.FRAME_NS % _IONOSPHERE_FRAMES == 0
        if system in (GPS, QZSS) and letter in self._navigation.klobuchar and (is_first or due):
            try:
                words = frames.ionosphere_words(self._navigation.klobuchar[letter], start_ns)
            except ValueError:
                self._refuse(sat, "ionosphere", 0)
            else:
                self._file.write(encode_sfrbx(gnss, sv, words))

    def _refuse(self, sat, message, row):
        if (sat, message, row) not in self._refused:
            self._refused.add((sat, message, row))
            name = f"{sat_name(sat)} {message}"
            self.skipped[name] = self.skipped.get(name, 0) + 1


def _by_satellite(navigation):
    """Ephemerides by satellite and message: table, rows, reference times; later ones first."""
    found = {}
    kepler, states = navigation.kepler, navigation.states
    for table, eph, message in (
        ("kepler", kepler, kepler.message),
        ("states", states, np.full(len(states), MessageType.FDMA)),
    ):
        # Of equal reference times that which was sent last wins, as in a receiver.
        order = np.lexsort((-eph.transmission_ns, eph.toe_ns))
        for sat in np.unique(eph.sat).tolist():
            for kind in np.unique(message[eph.sat == sat]).tolist():
                rows = order[(eph.sat[order] == sat) & (message[order] == kind)]
                name = "SBAS" if table == "states" and sat // 100 != GLONASS else MessageType(kind).name
                found.setdefault(sat, {})[name] = (table, rows, eph.toe_ns[rows])
    return found


def _navigation_signal(sat, message):
    """The sigId of u-blox whose bits carry a message."""
    if sat // 100 == GALILEO:
        return 3 if message == "FNAV" else 1
    return int(frames.is_geostationary(sat))


def _receiver_messages(observations):
    """MON-VER, and NAV-POSECEF where the place is known."""
    meta = observations.meta
    texts = [f"FWVER={meta.receiver_firmware}", f"MOD={meta.receiver_type}"]
    extensions = b"".join(_text(text, 30) for text in texts if not text.endswith("="))
    messages = encode_frame(ubx.MON_VER, _text("TrueNorth", 30) + _text("simulated", 10) + extensions)
    if meta.approx_position_ecef_m is not None:
        tow_ms = int(observations.time_ns[0]) % NS_PER_WEEK // _MS_NS
        place_cm = [round(100.0 * value) for value in meta.approx_position_ecef_m]
        messages += encode_frame(ubx.NAV_POSECEF, struct.pack("<I3iI", tow_ms, *place_cm, 100))
    return messages


def _text(text, size):
    """Text of a fixed size that ends in a zero."""
    return text.encode("ascii", "replace")[: size - 1].ljust(size, b"\0")
