"""What a file holds: span, interval, satellites, signals, gaps, slips, and what it says of itself.

The interval is taken from the data: the shortest step between epochs (to 10 ms) that makes up at least a
tenth of all steps. A gap is a step longer than one and a half intervals. The samples of a sensor carry the
clock of the computer that logged them, which may go in steps as long as half the interval: there the
interval is the mean of the steps that are no gaps.
"""

from dataclasses import asdict, dataclass, field

import numpy as np

from ..constants import SYSTEM_NAMES, SYSTEMS
from ..frames import geodetic_from_ecef
from ..navigation import MessageType
from ..observations import LLI_HALF_CYCLE, LLI_SLIP, NO_CHANNEL, sat_name, signal_name
from ..timescales import NS_PER_S, format_gpst

__all__ = [
    "ColumnContent",
    "Gap",
    "Inventory",
    "NavigationContent",
    "SensorContent",
    "SignalContent",
    "SystemContent",
    "summarize",
]

_STEP_NS = NS_PER_S // 100
_MIN_SHARE_OF_STEPS = 0.1
_GAP_INTERVALS = 1.5


@dataclass(frozen=True, slots=True)
class SignalContent:
    """One signal of one system.

    Parameters
    ----------
    name : str
        Band and attribute, e.g. ``"1C"``.
    n_sats, n_rows : int
        Satellites that send it, and rows of all of them.
    code_share, phase_share, doppler_share, cn0_share : float
        Share of the rows that have the observable, 0 to 1.
    mean_cn0_dbhz : float or None
        Mean carrier-to-noise density.
    n_slips, n_half_cycles : int
        Rows with the loss-of-lock and the half-cycle bit.
    """

    name: str
    n_sats: int
    n_rows: int
    code_share: float
    phase_share: float
    doppler_share: float
    cn0_share: float
    mean_cn0_dbhz: float | None
    n_slips: int
    n_half_cycles: int


@dataclass(frozen=True, slots=True)
class SystemContent:
    """One satellite system.

    Parameters
    ----------
    letter, name : str
        ``"G"``, ``"GPS"``.
    sats : tuple of str
        Satellites observed at any time.
    signals : tuple of SignalContent
        Signals in increasing order.
    """

    letter: str
    name: str
    sats: tuple[str, ...]
    signals: tuple[SignalContent, ...]


@dataclass(frozen=True, slots=True)
class Gap:
    """A step between epochs that is too long.

    Parameters
    ----------
    start_gpst, end_gpst : str
        Last epoch before and first after.
    duration_s : float
        Time between them.
    n_missing : int
        Epochs that the interval would have put between.
    """

    start_gpst: str
    end_gpst: str
    duration_s: float
    n_missing: int


@dataclass(frozen=True, slots=True)
class NavigationContent:
    """Broadcast ephemerides.

    Parameters
    ----------
    n_by_system : dict of str to dict of str to int
        Ephemerides by system letter and message name.
    sats_by_system : dict of str to list of str
        Satellites by system letter.
    n_unhealthy : int
        Ephemerides marked as not to be used.
    start_gpst, end_gpst : str
        First and last reference time.
    ionosphere : list of str
        Sources of ionosphere coefficients.
    leap_seconds : int or None
        GPS minus UTC as broadcast.
    skipped : dict of str to int
        Records without a usable orbit.
    """

    n_by_system: dict[str, dict[str, int]]
    sats_by_system: dict[str, list[str]]
    n_unhealthy: int
    start_gpst: str
    end_gpst: str
    ionosphere: list[str]
    leap_seconds: int | None
    skipped: dict[str, int]


@dataclass(frozen=True, slots=True)
class ColumnContent:
    """One column of a sensor log.

    Parameters
    ----------
    name : str
        Name with its unit.
    share : float
        Share of the samples that have a value, 0 to 1.
    smallest, mean, largest : float or None
        Of the values; of a flag, the mean is the share of the samples that raise it.
    """

    name: str
    share: float
    smallest: float | None
    mean: float | None
    largest: float | None


@dataclass(frozen=True, slots=True)
class SensorContent:
    """Samples of a sensor.

    Parameters
    ----------
    kind : str
        ``gyro``, ``compass``, ``tilt``... as `truenorth.sensor_log.SensorLog` has it.
    n_samples : int
        Number of samples.
    rate_hz : float or None
        One over the interval of the time stamps.
    has_time : bool
        Whether the log has time stamps; without, the samples are counted at the nominal rate.
    columns : tuple of ColumnContent
        What the samples hold.
    rejected : dict of str to int
        Damaged packets, bytes, lines... that are left out, by name; only those that were counted.
    """

    kind: str
    n_samples: int
    rate_hz: float | None
    has_time: bool
    columns: tuple[ColumnContent, ...]
    rejected: dict[str, int]


@dataclass(frozen=True, slots=True)
class Inventory:
    """What a file holds; None and empty where it is silent.

    Parameters
    ----------
    path, format, version : str
        The file and its format, see `truenorth.formats.sniff`.
    marker, receiver, receiver_serial, receiver_firmware, antenna, antenna_serial : str
        What the file says of the station.
    antenna_delta_hen_m : tuple of float or None
        Antenna height, east and north eccentricity, metres.
    approx_position_ecef_m : tuple of float or None
        Approximate position, metres.
    approx_position_deg_m : tuple of float or None
        The same as latitude, longitude (degrees) and ellipsoidal height (metres).
    n_epochs, n_rows : int
        Epochs, and rows of one signal of one satellite at one epoch.
    start_gpst, end_gpst : str
        First and last epoch, GPS time.
    duration_s : float or None
        Time between them.
    interval_s, header_interval_s : float or None
        Interval of the data, and that of the header.
    n_sats_min, n_sats_max : int
        Fewest and most satellites of an epoch.
    systems : tuple of SystemContent
        Satellites and signals.
    n_slips, n_half_cycles : int
        Rows with the loss-of-lock and the half-cycle bit.
    slips_by_sat : dict of str to int
        Rows with the loss-of-lock bit by satellite.
    gaps : tuple of Gap
        Steps that are too long.
    has_clock_offsets : bool
        Whether the file gives receiver clock offsets.
    glonass_channels : dict of str to int
        Frequency channel by GLONASS satellite.
    events : tuple of dict
        Event records: ``time_gpst``, ``flag``, ``text``.
    navigation : NavigationContent or None
        Broadcast ephemerides.
    sensor : SensorContent or None
        Samples of a sensor; then the epochs are the samples.
    warnings : tuple of str
        What had to be mended or left out.
    """

    path: str
    format: str
    version: str = ""
    marker: str = ""
    receiver: str = ""
    receiver_serial: str = ""
    receiver_firmware: str = ""
    antenna: str = ""
    antenna_serial: str = ""
    antenna_delta_hen_m: tuple[float, float, float] | None = None
    approx_position_ecef_m: tuple[float, float, float] | None = None
    approx_position_deg_m: tuple[float, float, float] | None = None
    n_epochs: int = 0
    n_rows: int = 0
    start_gpst: str = ""
    end_gpst: str = ""
    duration_s: float | None = None
    interval_s: float | None = None
    header_interval_s: float | None = None
    n_sats_min: int = 0
    n_sats_max: int = 0
    systems: tuple[SystemContent, ...] = ()
    n_slips: int = 0
    n_half_cycles: int = 0
    slips_by_sat: dict[str, int] = field(default_factory=dict)
    gaps: tuple[Gap, ...] = ()
    has_clock_offsets: bool = False
    glonass_channels: dict[str, int] = field(default_factory=dict)
    events: tuple[dict[str, str | int | None], ...] = ()
    navigation: NavigationContent | None = None
    sensor: SensorContent | None = None
    warnings: tuple[str, ...] = ()

    def to_dict(self):
        """Plain dictionaries, lists, numbers and strings, ready for JSON.

        Returns
        -------
        dict
        """
        return _plain(asdict(self))

    def __str__(self):
        """Aligned text, as ``truenorth info`` prints it."""
        return "\n".join(_lines(self))


def _plain(value):
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value


def summarize(path):
    """Tell what a file holds.

    Parameters
    ----------
    path : str or os.PathLike
        Any file that `truenorth.formats.read` knows.

    Returns
    -------
    Inventory

    Raises
    ------
    FormatError
        If the file cannot be read.
    """
    from .registry import identify

    form, data = identify(path)
    content = form.read(data, str(path))
    fields = {"path": str(path), "format": form.name}
    if form.holds == "observations":
        fields |= _of_observations(content)
    elif form.holds == "navigation":
        fields |= {"navigation": _of_navigation(content)}
        fields |= {"version": _version_of(data)}
    elif form.holds == "both":
        observations, navigation = content
        fields |= _of_observations(observations)
        if len(navigation.kepler) + len(navigation.states):
            fields |= {"navigation": _of_navigation(navigation)}
    elif form.holds == "sensor":
        fields |= _of_sensor(content)
    else:
        fields |= _of_orbits(content)
    return Inventory(**fields)


def _version_of(data):
    return data[:20].decode("latin-1").strip().split(" ")[0]


def _span(time_ns):
    """Fields of `Inventory` that follow from the epochs alone."""
    if len(time_ns) == 0:
        return {}
    fields = {
        "n_epochs": len(time_ns),
        "start_gpst": format_gpst(time_ns[0]),
        "end_gpst": format_gpst(time_ns[-1]),
        "duration_s": float(time_ns[-1] - time_ns[0]) / NS_PER_S,
    }
    steps = np.diff(time_ns)
    if len(steps) == 0:
        return fields
    rounded, counts = np.unique((steps + _STEP_NS // 2) // _STEP_NS, return_counts=True)
    common = rounded[(counts >= _MIN_SHARE_OF_STEPS * len(steps)) & (rounded > 0)]
    interval_ns = int(common[0]) * _STEP_NS if len(common) else int(np.median(steps))
    return fields | {"interval_s": interval_ns / NS_PER_S, "gaps": _gaps(time_ns, interval_ns)}


def _gaps(time_ns, interval_ns):
    """All steps that are too long for the interval."""
    steps = np.diff(time_ns)
    gaps = []
    for k in np.flatnonzero(steps > _GAP_INTERVALS * interval_ns):
        missing = round(float(steps[k]) / interval_ns) - 1
        gaps.append(
            Gap(format_gpst(time_ns[k]), format_gpst(time_ns[k + 1]), float(steps[k]) / NS_PER_S, missing)
        )
    return tuple(gaps)


def _of_sensor(log):
    """Fields of `Inventory` of a sensor log."""
    time_ns = log.time_ns
    has_time = log.meta.get("time") != "counted"
    fields = _span(time_ns)
    interval_s = None
    steps = np.diff(time_ns)
    if len(steps):
        regular = steps[steps <= _GAP_INTERVALS * np.median(steps)]
        interval_ns = max(float(np.mean(regular)), 1.0)
        interval_s = round(interval_ns / NS_PER_S, 6)
        fields |= {"interval_s": interval_s, "gaps": _gaps(time_ns, interval_ns)}
    if not has_time:
        fields |= {"start_gpst": "", "end_gpst": ""}
    columns = []
    for name, column in log.columns.items():
        values = np.asarray(column, dtype=float)
        values = values[np.isfinite(values)]
        columns.append(
            ColumnContent(
                name=name,
                share=len(values) / max(log.n_samples, 1),
                smallest=float(values.min()) if len(values) else None,
                mean=float(values.mean()) if len(values) else None,
                largest=float(values.max()) if len(values) else None,
            )
        )
    prefix = "n_rejected_"
    sensor = SensorContent(
        kind=log.kind,
        n_samples=log.n_samples,
        rate_hz=None if not interval_s else round(1.0 / interval_s, 4),
        has_time=has_time,
        columns=tuple(columns),
        rejected={k.removeprefix(prefix): int(v) for k, v in log.meta.items() if k.startswith(prefix)},
    )
    warnings = tuple(filter(None, str(log.meta.get("warnings", "")).split("\n")))
    return fields | {"sensor": sensor, "warnings": warnings}


def _of_observations(observations):
    meta = observations.meta
    fields = {
        "version": meta.version,
        "marker": meta.marker,
        "receiver": meta.receiver_type,
        "receiver_serial": meta.receiver_serial,
        "receiver_firmware": meta.receiver_firmware,
        "antenna": meta.antenna_type,
        "antenna_serial": meta.antenna_serial,
        "antenna_delta_hen_m": meta.antenna_delta_hen_m,
        "approx_position_ecef_m": meta.approx_position_ecef_m,
        "header_interval_s": meta.interval_s,
        "n_rows": observations.n_rows,
        "has_clock_offsets": bool(np.any(np.isfinite(observations.clock_offset_s))),
        "warnings": meta.warnings,
        "events": tuple(
            {
                "time_gpst": None if event.time_ns is None else format_gpst(event.time_ns),
                "flag": event.flag,
                "text": event.text,
            }
            for event in observations.events
        ),
    }
    if meta.approx_position_ecef_m is not None:
        latitude, longitude, height = geodetic_from_ecef(np.array(meta.approx_position_ecef_m))
        fields["approx_position_deg_m"] = (
            float(np.degrees(latitude)),
            float(np.degrees(longitude)),
            float(height),
        )
    fields |= _span(observations.time_ns)
    slipped = (observations.lli & LLI_SLIP) > 0
    half = (observations.lli & LLI_HALF_CYCLE) > 0
    fields["n_slips"], fields["n_half_cycles"] = int(np.sum(slipped)), int(np.sum(half))
    sats, counts = np.unique(observations.sat[slipped], return_counts=True)
    fields["slips_by_sat"] = {sat_name(int(s)): int(n) for s, n in zip(sats, counts, strict=True)}
    fields["systems"] = _systems(observations, slipped, half)
    if observations.n_rows:
        # A satellite begins where the satellite or the epoch of the row changes.
        epoch = observations.epoch_of_row
        new = np.ones(observations.n_rows, dtype=bool)
        new[1:] = (np.diff(observations.sat) != 0) | (np.diff(epoch) != 0)
        per_epoch = np.bincount(epoch[new], minlength=observations.n_epochs)
        fields["n_sats_min"], fields["n_sats_max"] = int(per_epoch.min()), int(per_epoch.max())
    channels = observations.glonass_channel
    fields["glonass_channels"] = {
        f"R{slot:02d}": int(channels[slot]) for slot in np.flatnonzero(channels != NO_CHANNEL)
    }
    return fields


def _systems(observations, slipped, half):
    result = []
    system = observations.sat // 100
    for code in np.unique(system):
        rows = np.flatnonzero(system == code)
        signals = []
        for signal in np.unique(observations.signal[rows]):
            chosen = rows[observations.signal[rows] == signal]

            def share(column, chosen=chosen):
                return float(np.mean(np.isfinite(column[chosen])))

            cn0 = observations.cn0_dbhz[chosen]
            known = np.isfinite(cn0)
            signals.append(
                SignalContent(
                    name=signal_name(int(signal)),
                    n_sats=len(np.unique(observations.sat[chosen])),
                    n_rows=len(chosen),
                    code_share=share(observations.code_m),
                    phase_share=share(observations.phase_cyc),
                    doppler_share=share(observations.doppler_hz),
                    cn0_share=share(observations.cn0_dbhz),
                    mean_cn0_dbhz=float(np.mean(cn0[known])) if np.any(known) else None,
                    n_slips=int(np.sum(slipped[chosen])),
                    n_half_cycles=int(np.sum(half[chosen])),
                )
            )
        letter = SYSTEMS[code]
        sats = tuple(sat_name(int(s)) for s in np.unique(observations.sat[rows]))
        result.append(SystemContent(letter, SYSTEM_NAMES[letter], sats, tuple(signals)))
    return tuple(result)


def _of_navigation(navigation):
    kepler, states = navigation.kepler, navigation.states
    sats = np.concatenate((kepler.sat, states.sat)).astype(int)
    toe_ns = np.concatenate((kepler.toe_ns, states.toe_ns))
    health = np.concatenate((kepler.health, states.health))
    names = [MessageType(int(m)).name for m in kepler.message]
    names += ["SBAS" if SYSTEMS[s // 100] == "S" else "FDMA" for s in states.sat.astype(int)]
    counts, of_system = {}, {}
    for sat, name in zip(sats.tolist(), names, strict=True):
        letter = SYSTEMS[sat // 100]
        per_message = counts.setdefault(letter, {})
        per_message[name] = per_message.get(name, 0) + 1
        of_system.setdefault(letter, set()).add(sat_name(sat))
    order = [letter for letter in SYSTEMS if letter in counts]
    sources = sorted(navigation.klobuchar) + (["NeQuick"] if navigation.nequick is not None else [])
    return NavigationContent(
        n_by_system={letter: counts[letter] for letter in order},
        sats_by_system={letter: sorted(of_system[letter]) for letter in order},
        n_unhealthy=int(np.sum(health != 0)),
        start_gpst=format_gpst(toe_ns.min()) if len(toe_ns) else "",
        end_gpst=format_gpst(toe_ns.max()) if len(toe_ns) else "",
        ionosphere=sources,
        leap_seconds=None if navigation.leap_seconds is None else int(navigation.leap_seconds),
        skipped={str(k): int(v) for k, v in navigation.skipped.items()},
    )


def _of_orbits(orbits):
    letters = {}
    for sat in orbits.sat.astype(int):
        letters.setdefault(SYSTEMS[sat // 100], []).append(sat_name(int(sat)))
    systems = tuple(SystemContent(x, SYSTEM_NAMES[x], tuple(letters[x]), ()) for x in SYSTEMS if x in letters)
    return _span(orbits.time_ns) | {"systems": systems}


# ----------------------------------------------------------------------------------------- text

_SHOWN = 5
_FLAGS = {
    1: "power failure",
    2: "start of moving",
    3: "new site",
    4: "header information",
    5: "external event",
    6: "cycle slips",
}


def _lines(inventory):
    """Lines of text of an inventory."""
    pairs = [("format", " ".join(filter(None, (inventory.format, inventory.version))))]
    pairs.append(("marker", inventory.marker))
    serial = [inventory.receiver_serial and f"serial {inventory.receiver_serial}"]
    firmware = [inventory.receiver_firmware and f"firmware {inventory.receiver_firmware}"]
    pairs.append(("receiver", ", ".join(filter(None, [inventory.receiver, *serial, *firmware]))))
    serial = [inventory.antenna_serial and f"serial {inventory.antenna_serial}"]
    pairs.append(("antenna", ", ".join(filter(None, [inventory.antenna, *serial]))))
    if inventory.antenna_delta_hen_m:
        h, e, n = inventory.antenna_delta_hen_m
        pairs.append(("antenna offset", f"{h:.4f} m up, {e:.4f} m east, {n:.4f} m north"))
    if inventory.approx_position_ecef_m:
        x, y, z = inventory.approx_position_ecef_m
        latitude, longitude, height = inventory.approx_position_deg_m
        pairs.append(("position", f"{latitude:.8f} deg, {longitude:.8f} deg, {height:.3f} m"))
        pairs.append(("", f"ECEF {x:.4f}, {y:.4f}, {z:.4f} m"))
    if inventory.start_gpst:
        span = f"{inventory.start_gpst} to {inventory.end_gpst} GPST ({_duration(inventory.duration_s)})"
        pairs.append(("span", span))
    if inventory.sensor is not None:
        pairs += _sensor_pairs(inventory.sensor)
    elif inventory.n_epochs:
        text = f"{inventory.n_epochs}"
        if inventory.interval_s is not None:
            text += f", every {inventory.interval_s:g} s"
        if inventory.header_interval_s is not None:
            text += f" (header: {inventory.header_interval_s:g} s)"
        pairs.append(("epochs", text))
    if inventory.n_sats_max:
        n_sats = sum(len(system.sats) for system in inventory.systems)
        pairs.append(("satellites", f"{n_sats}, {inventory.n_sats_min} to {inventory.n_sats_max} at a time"))
    if inventory.n_epochs and inventory.n_rows:
        worst = sorted(inventory.slips_by_sat.items(), key=lambda item: -item[1])[:_SHOWN]
        text = f"{inventory.n_slips} flagged"
        if worst:
            text += " (most: " + ", ".join(f"{sat} {n}" for sat, n in worst) + ")"
        pairs.append(("slips", text))
        pairs.append(("half cycles", f"{inventory.n_half_cycles} flagged"))
        pairs.append(("clock offsets", "given" if inventory.has_clock_offsets else "none"))
    if inventory.n_epochs:
        missing = sum(gap.n_missing for gap in inventory.gaps)
        pairs.append(
            ("gaps", f"{len(inventory.gaps)}, {missing} epochs missing" if inventory.gaps else "none")
        )
        for gap in inventory.gaps[:_SHOWN]:
            pairs.append(("", f"{gap.start_gpst} to {gap.end_gpst} ({gap.duration_s:g} s)"))
        if len(inventory.gaps) > _SHOWN:
            pairs.append(("", f"and {len(inventory.gaps) - _SHOWN} more"))
    if inventory.glonass_channels:
        items = [f"{sat} {channel:+d}" for sat, channel in inventory.glonass_channels.items()]
        pairs += _wrapped("channels", items)
    if inventory.events:
        pairs.append(("events", str(len(inventory.events))))
        for event in inventory.events[:_SHOWN]:
            first = event["text"].split("\n", 1)[0].strip()
            what = _FLAGS.get(event["flag"], f"flag {event['flag']}")
            pairs.append(("", f"{event['time_gpst'] or 'no time'}, {what}: {first}"))
        if len(inventory.events) > _SHOWN:
            pairs.append(("", f"and {len(inventory.events) - _SHOWN} more"))
    if inventory.navigation is not None:
        pairs += _navigation_pairs(inventory.navigation)
    pairs += [("warning", text) for text in inventory.warnings]
    lines = [inventory.path]
    lines += [f"  {name:<17}{text}".rstrip() for name, text in pairs if text]
    if inventory.sensor is not None:
        lines += _column_table(inventory.sensor)
    return lines + _signal_table(inventory.systems)


def _sensor_pairs(sensor):
    text = f"{sensor.n_samples}"
    if sensor.rate_hz is not None:
        text += f", {sensor.rate_hz:g} Hz" + ("" if sensor.has_time else " (assumed; no time stamps)")
    pairs = [("sensor", sensor.kind), ("samples", text)]
    if sensor.rejected:
        pairs.append(("rejected", ", ".join(f"{n} {name}" for name, n in sensor.rejected.items())))
    return pairs


def _column_table(sensor):
    width = max([18, *(len(column.name) for column in sensor.columns)])
    lines = [f"  {'column':<{width}}{'given':>7}{'smallest':>14}{'mean':>14}{'largest':>14}"]
    for column in sensor.columns:
        values = [column.smallest, column.mean, column.largest]
        cells = "".join(f"{'' if value is None else f'{value:.6g}':>14}" for value in values)
        lines.append(f"  {column.name:<{width}}{column.share:>7.0%}{cells}".rstrip())
    return lines


def _wrapped(name, items, per_line=8):
    parts = [", ".join(items[k : k + per_line]) for k in range(0, len(items), per_line)]
    return [(name if k == 0 else "", part) for k, part in enumerate(parts)]


def _duration(seconds):
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min {rest:02d} s" if hours else f"{minutes} min {rest:02d} s"


def _navigation_pairs(navigation):
    pairs = []
    for letter, messages in navigation.n_by_system.items():
        text = ", ".join(f"{n} {name}" for name, n in messages.items())
        n_sats = len(navigation.sats_by_system[letter])
        pairs.append((SYSTEM_NAMES[letter], f"{n_sats} satellites, ephemerides: {text}"))
    if navigation.start_gpst:
        pairs.append(("reference times", f"{navigation.start_gpst} to {navigation.end_gpst} GPST"))
        pairs.append(("unhealthy", str(navigation.n_unhealthy)))
    else:
        pairs.append(("ephemerides", "none"))
    pairs.append(("ionosphere", ", ".join(navigation.ionosphere)))
    if navigation.leap_seconds is not None:
        pairs.append(("leap seconds", str(navigation.leap_seconds)))
    pairs.append(("skipped", ", ".join(f"{n} {name}" for name, n in navigation.skipped.items())))
    return pairs


def _signal_table(systems):
    if not any(system.signals for system in systems):
        return [f"  {system.name:<17}{' '.join(system.sats)}" for system in systems]
    lines = [
        f"  {'system':<9}{'sats':>4}  {'signal':<6}{'sats':>5}{'rows':>9}{'code':>7}{'phase':>7}"
        f"{'doppler':>9}{'C/N0':>7}{'mean':>7}{'slips':>7}{'half':>7}"
    ]
    for system in systems:
        start = f"  {system.name:<9}{len(system.sats):>4}  "
        for signal in system.signals:
            mean = "" if signal.mean_cn0_dbhz is None else f"{signal.mean_cn0_dbhz:.1f}"
            lines.append(
                f"{start}{signal.name:<6}{signal.n_sats:>5}{signal.n_rows:>9}{signal.code_share:>7.0%}"
                f"{signal.phase_share:>7.0%}{signal.doppler_share:>9.0%}{signal.cn0_share:>7.0%}{mean:>7}"
                f"{signal.n_slips:>7}{signal.n_half_cycles:>7}"
            )
            start = " " * len(start)
    return lines
