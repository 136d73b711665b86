"""Single differences between two receivers, each referred to its own true time of reception.

    y = (observed - modelled)_rover - (observed - modelled)_base  =  H b + clock + lambda N + e

The modelled ranges use the base position, the baseline from which b is linearised, the velocity of
the antennas over the (milliseconds of) time between the two receptions, and one ephemeris per
satellite for both receivers. Double differences follow by referring the rows of a group (system,
band, tracking) to one of them, or by eliminating the group's clock; both are the same adjustment.

References: Harvey 1998, eqs. (3.6)-(3.13); Landfahrer 2009, eqs. (2.15)-(2.21).
"""

from dataclasses import dataclass

import numpy as np

from ..constants import BAND_CLASSES, BEIDOU, GLONASS, SPEED_OF_LIGHT_MPS, SYSTEMS
from ..errors import NoSolutionError
from ..frames import geodetic_from_ecef, rot_enu_from_ecef
from ..observations import LLI_HALF_CYCLE, NO_CHANNEL, frequency_hz, signal_id, signal_name
from ..timescales import NS_PER_S, format_gpst

__all__ = [
    "SingleDifferences",
    "build_single_differences",
    "count_phases",
    "is_long_baseline",
    "match_epochs",
    "match_receivers",
    "match_signals",
    "pair_signals",
    "split_variances",
]

EARTH_ROTATION_RADPS = 7.2921151467e-5
EARTH_GM_M3PS2 = 3.986004418e14

LINEARISE_AT_CODE_BASELINE_M = 20.0
"""Longer baselines are linearised at the difference of the two code positions; for shorter ones the
parallel-ray error b^2 / 2 rho stays below 10 micrometres."""

GLONASS_CHANNEL_SD_M = 0.0007
"""Noise of GLONASS FDMA phases for each channel away from zero, between receivers of one make."""

# Order of preference among the trackings of one band, where both receivers have several.
_PREFERENCE = "CSLXPWIQDZABMNYE"


@dataclass(frozen=True, slots=True, eq=False)
class SingleDifferences:
    """Single differences of all common epochs, rows sorted by (epoch, group, reference first).

    Parameters
    ----------
    time_ns : ndarray of int64, shape (n_epochs,)
        The rover's time tags, GPS time.
    base_epoch, rover_epoch : ndarray of int64, shape (n_epochs,)
        Epoch indices in the two containers.
    position_ecef_m : ndarray, shape (n_epochs, 3)
        Base antenna, single-point.
    rot_enu_from_ecef : ndarray, shape (n_epochs, 3, 3)
        Local level at the base.
    has_position : ndarray of bool, shape (n_epochs,)
        Epochs whose base position is known.
    start : ndarray of int64, shape (n_epochs + 1,)
        Row offsets of the epochs.
    sat, signal : ndarray of int16, shape (n_rows,)
        Satellite and the rover's signal.
    group : ndarray of int64, shape (n_rows,)
        Rows that share a receiver clock and hardware delay: index into ``group_names``.
    phase_m, code_m : ndarray, shape (n_rows,)
        Single differences minus model, metres; NaN where missing.
    design_enu : ndarray, shape (n_rows, 3)
        ``-e`` in east, north, up; e points from the receiver to the satellite.
    wavelength_m : ndarray, shape (n_rows,)
        Carrier wavelength.
    phase_variance_m2, code_variance_m2 : ndarray, shape (n_rows,)
        Of the single differences.
    elevation_rad, azimuth_rad : ndarray, shape (n_rows,)
        Direction of the satellite from the base.
    doppler_mps : ndarray, shape (n_rows,)
        Single-difference range rate from Doppler, m/s; NaN where missing.
    lli : ndarray of uint8, shape (n_rows,)
        Loss-of-lock bits of both receivers, or'ed.
    integer_ok : ndarray of bool, shape (n_rows,)
        Phases whose ambiguity is an integer (not GLONASS FDMA unless calibrated).
    group_names : tuple of str
        For example ``"G 1C"`` or ``"C 2I"``.
    glonass_channel : ndarray, shape (n_rows,)
        Frequency channel of GLONASS FDMA rows, 0 elsewhere.
    base_row, rover_row : ndarray of int64, shape (n_rows,)
        Rows of the raw observations.
    """

    time_ns: np.ndarray
    base_epoch: np.ndarray
    rover_epoch: np.ndarray
    position_ecef_m: np.ndarray
    rot_enu_from_ecef: np.ndarray
    has_position: np.ndarray
    start: np.ndarray
    sat: np.ndarray
    signal: np.ndarray
    group: np.ndarray
    phase_m: np.ndarray
    code_m: np.ndarray
    design_enu: np.ndarray
    wavelength_m: np.ndarray
    phase_variance_m2: np.ndarray
    code_variance_m2: np.ndarray
    elevation_rad: np.ndarray
    azimuth_rad: np.ndarray
    doppler_mps: np.ndarray
    lli: np.ndarray
    integer_ok: np.ndarray
    group_names: tuple[str, ...]
    glonass_channel: np.ndarray
    base_row: np.ndarray
    rover_row: np.ndarray

    @property
    def n_epochs(self):
        """int: Number of common epochs."""
        return len(self.time_ns)

    @property
    def epoch_of_row(self):
        """Ndarray of int64, shape (n_rows,): epoch index of every row."""
        return np.repeat(np.arange(self.n_epochs), np.diff(self.start))


def match_epochs(base_time_ns, rover_time_ns, max_difference_s):
    """Pair the epochs of two receivers by their time tags.

    Parameters
    ----------
    base_time_ns, rover_time_ns : ndarray of int64
        Increasing time tags.
    max_difference_s : float
        Tags further apart do not pair.

    Returns
    -------
    base_epoch, rover_epoch : ndarray of int64
        Indices of the pairs; each epoch is used at most once.
    """
    if len(base_time_ns) == 0 or len(rover_time_ns) == 0:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    right = np.clip(np.searchsorted(base_time_ns, rover_time_ns), 1, max(len(base_time_ns) - 1, 1))
    right = np.minimum(right, len(base_time_ns) - 1)
    left = np.maximum(right - 1, 0)
    nearer_left = np.abs(rover_time_ns - base_time_ns[left]) <= np.abs(base_time_ns[right] - rover_time_ns)
    base_epoch = np.where(nearer_left, left, right)
    gap = np.abs(base_time_ns[base_epoch] - rover_time_ns)
    keep = gap <= round(max_difference_s * NS_PER_S)
    base_epoch, rover_epoch = base_epoch[keep], np.flatnonzero(keep)
    # Two rover epochs must not share one base epoch: the nearer keeps it.
    order = np.lexsort((gap[keep], base_epoch))
    first = np.ones(len(order), bool)
    first[1:] = base_epoch[order][1:] != base_epoch[order][:-1]
    chosen = np.sort(order[first])
    return base_epoch[chosen].astype(np.int64), rover_epoch[chosen].astype(np.int64)


def match_receivers(base, rover, settings):
    """Pair the epochs of two receivers, as `match_epochs`.

    Parameters
    ----------
    base, rover : Observations
        The two receivers.
    settings : GnssSettings
        With the greatest difference of the time tags.

    Returns
    -------
    base_epoch, rover_epoch : ndarray of int64
        Indices of the pairs.

    Raises
    ------
    NoSolutionError
        If there is none.
    """
    epochs = match_epochs(base.time_ns, rover.time_ns, settings.max_time_difference_s)
    if len(epochs[0]) == 0:
        raise NoSolutionError(_no_common_epochs(base, rover, settings))
    return epochs


def _common_signal(observations):
    """Signals with BeiDou's B1I under one name: ``1I``/``1Q`` of RINEX 3.02 is ``2I``/``2Q``."""
    signal = observations.signal.astype(np.int64)
    beidou_b1 = (observations.sat // 100 == BEIDOU) & (signal // 100 == 1)
    old_names = [signal_id("1I"), signal_id("1Q")]
    if observations.meta.version.startswith(("3.00", "3.01", "3.02")):
        old_names.append(signal_id("1X"))
    return np.where(beidou_b1 & np.isin(signal, old_names), signal + 100, signal)


def _band_table(systems, bands):
    """Boolean table (system, band digit) of what the settings ask for."""
    table = np.zeros((len(SYSTEMS), 10), bool)
    for band in bands:
        for system, digits in BAND_CLASSES[band].items():
            if system in systems:
                table[SYSTEMS.index(system), list(digits)] = True
    return table


def _candidates(observations, epochs, settings):
    """Rows of matched epochs that the settings admit: rows, epoch, system and signal, has a phase."""
    wanted = _band_table(settings.systems, settings.bands)
    index = np.full(observations.n_epochs, -1, np.int64)
    index[epochs] = np.arange(len(epochs))
    epoch = index[observations.epoch_of_row]
    system = observations.sat.astype(np.int64) // 100
    signal = _common_signal(observations)
    has_phase = np.isfinite(observations.phase_cyc)
    keep = (epoch >= 0) & wanted[system, np.clip(signal // 100, 0, 9)]
    keep &= has_phase | np.isfinite(observations.code_m)
    if settings.cn0_mask_dbhz > 0.0:
        keep &= ~(observations.cn0_dbhz < settings.cn0_mask_dbhz)
    rows = np.flatnonzero(keep)
    return rows, epoch[rows], system[rows] * 1000 + signal[rows], has_phase[rows]


def count_phases(observations, epochs, settings):
    """Count the phases of each system and signal at matched epochs.

    Parameters
    ----------
    observations : Observations
        Of one receiver.
    epochs : ndarray of int64
        Its matched epochs, see `match_epochs`.
    settings : GnssSettings
        Systems, bands and C/N0 mask.

    Returns
    -------
    ndarray of int64, shape (7000,)
        By 1000 * system + signal; blocks of a run add up.
    """
    _, _, kind, has_phase = _candidates(observations, epochs, settings)
    return np.bincount(kind[has_phase], minlength=7000)


def pair_signals(base_count, rover_count):
    """Choose the signals that are differenced, the preferred ones of each system and band first.

    Where both receivers track the same signal it is used; the one with most common phases first. Where
    they share none on a band (``1C`` in one file, ``1W`` in the other), the signals of the same frequency
    pair.

    Parameters
    ----------
    base_count, rover_count : ndarray of int64, shape (7000,)
        Of the whole run, see `count_phases`.

    Returns
    -------
    list of tuple
        (system code, base signal, rover signal).
    """
    pairs = []
    for kind_band in np.unique(np.flatnonzero(base_count + rover_count) // 100):
        span = np.arange(kind_band * 100, kind_band * 100 + 100)
        system = kind_band // 10

        def rank(signal):
            letter = signal_name(int(signal) % 1000)[1]
            return _PREFERENCE.find(letter) % 99

        common = [k for k in span if base_count[k] and rover_count[k]]
        common.sort(key=lambda k: (-min(base_count[k], rover_count[k]), rank(k)))
        if common:
            pairs += [(system, k % 1000, k % 1000) for k in common]
        elif base_count[span].any() and rover_count[span].any():
            best_b = max(span, key=lambda k: base_count[k]) % 1000
            best_r = max(span, key=lambda k: rover_count[k]) % 1000
            pairs.append((system, best_b, best_r))
    return pairs


def match_signals(base, rover, base_epoch, rover_epoch, settings, pairs=None):
    """Rows of the same satellite and band in both receivers, one signal per satellite and band.

    Parameters
    ----------
    base, rover : Observations
        The two receivers.
    base_epoch, rover_epoch : ndarray of int64
        Matched epochs, see `match_epochs`.
    settings : GnssSettings
        Systems, bands and C/N0 mask.
    pairs : list of tuple, optional
        Of `pair_signals`; by default from these epochs.

    Returns
    -------
    epoch : ndarray of int64
        Index of the matched epoch of each pair of rows.
    base_row, rover_row : ndarray of int64
        Row indices.
    group : ndarray of int64
        Index into the pairs.
    pairs : list of tuple
        (system code, base signal, rover signal) of each group.
    """
    rows_b, epoch_b, kinds_b, phase_b = _candidates(base, base_epoch, settings)
    rows_r, epoch_r, kinds_r, phase_r = _candidates(rover, rover_epoch, settings)
    if pairs is None:
        counts = (np.bincount(kind, minlength=7000) for kind in (kinds_b[phase_b], kinds_r[phase_r]))
        pairs = pair_signals(*counts)

    found = []
    taken = {}
    key_b = epoch_b * 1000 + base.sat[rows_b]
    key_r = epoch_r * 1000 + rover.sat[rows_r]
    for group, (system, signal_base, signal_rover) in enumerate(pairs):
        in_b = np.flatnonzero(kinds_b == system * 1000 + signal_base)
        in_r = np.flatnonzero(kinds_r == system * 1000 + signal_rover)
        common, at_b, at_r = np.intersect1d(key_b[in_b], key_r[in_r], assume_unique=True, return_indices=True)
        band = (system, signal_base // 100)
        if band in taken:
            fresh = ~np.isin(common, taken[band])
            common, at_b, at_r = common[fresh], at_b[fresh], at_r[fresh]
        if len(common) == 0:
            continue
        taken[band] = np.concatenate((taken[band], common)) if band in taken else common
        pick_b, pick_r = in_b[at_b], in_r[at_r]
        found.append((epoch_b[pick_b], rows_b[pick_b], rows_r[pick_r], np.full(len(pick_b), group)))
    if not found:
        empty = np.empty(0, np.int64)
        return empty, empty, empty, empty, pairs
    epoch, base_row, rover_row, group = (np.concatenate(column) for column in zip(*found, strict=True))
    return epoch, base_row, rover_row, group, pairs


def _modelled_range(satellite_m, receiver_m):
    """Geometric range with the Earth's rotation during the flight (Sagnac), and unit vector."""
    line = satellite_m - receiver_m
    distance = np.linalg.norm(line, axis=1)
    sagnac = EARTH_ROTATION_RADPS / SPEED_OF_LIGHT_MPS * (
        satellite_m[:, 0] * receiver_m[:, 1] - satellite_m[:, 1] * receiver_m[:, 0]
    )  # fmt: skip
    return distance + sagnac, line / distance[:, None]


def _variance(stochastic, elevation_rad, cn0_dbhz, constant_m, elevation_m):
    """Undifferenced variance by elevation and C/N0; see `StochasticSettings`."""
    sin_el = np.maximum(np.sin(elevation_rad), 0.05)
    variance = constant_m**2 + (elevation_m / sin_el) ** 2
    if stochastic.cn0_slope:
        # Files without signal strengths (RINEX 2 often) must not be taken for weak ones.
        known = np.nan_to_num(cn0_dbhz, nan=stochastic.cn0_reference_dbhz)
        deficit = np.maximum(stochastic.cn0_reference_dbhz - known, 0.0)
        variance = variance * 10.0 ** (0.1 * stochastic.cn0_slope * deficit)
    return variance


def _undifferenced_variances(stochastic, elevation_rad, cn0_dbhz):
    """Variances of phases and of codes of one receiver."""
    phase = stochastic.phase_sd_m, stochastic.phase_elevation_sd_m
    code = stochastic.code_sd_m, stochastic.code_elevation_sd_m
    return [_variance(stochastic, elevation_rad, cn0_dbhz, *sd) for sd in (phase, code)]


def split_variances(differences, base, rover, settings):
    """Variances of single differences as those of the two receivers.

    Parameters
    ----------
    differences : SingleDifferences
        Of the two.
    base, rover : Observations
        Their raw observations.
    settings : GnssSettings
        With the stochastic model.

    Returns
    -------
    of_base, of_rover : tuple of ndarray, shape (n_rows,)
        Variances of phases and codes, metres squared; what is of neither counts for the rover.
    """
    d = differences
    of_base = _undifferenced_variances(settings.stochastic, d.elevation_rad, base.cn0_dbhz[d.base_row])
    return tuple(of_base), (d.phase_variance_m2 - of_base[0], d.code_variance_m2 - of_base[1])


def build_single_differences(
    base, rover, base_point, rover_point, settings, *,
    epochs=None, pairs=None, at_code_baseline=None, position_before=None,
):  # fmt: skip
    """Match two receivers and form their single differences, row by row.

    What is chosen from the whole run can be given, for a block of one.

    Parameters
    ----------
    base, rover : Observations
        Raw observations.
    base_point, rover_point : PointSolution
        Their single-point solutions, with receiver clocks and satellite states.
    settings : GnssSettings
        Systems, bands, masks and the stochastic model.
    epochs : tuple of ndarray of int64, optional
        Matched epochs of base and rover, see `match_epochs`.
    pairs : list of tuple, optional
        Signals that are differenced, see `pair_signals`.
    at_code_baseline : bool, optional
        Whether the baseline is linearised at the difference of the code positions, see
        `is_long_baseline`.
    position_before : ndarray, shape (3,), optional
        Base position before these epochs, for those that have none.

    Returns
    -------
    SingleDifferences

    Raises
    ------
    NoSolutionError
        If the receivers have no common epochs, or no common signals on the bands asked for.
    """
    if epochs is None:
        epochs = match_receivers(base, rover, settings)
    base_epoch, rover_epoch = epochs
    is_block = bool(pairs)
    epoch, base_row, rover_row, group, pairs = match_signals(
        base, rover, base_epoch, rover_epoch, settings, pairs or None
    )
    if len(epoch) == 0 and not is_block:
        raise NoSolutionError(_no_common_signals(base, rover, settings))

    time_ns = rover.time_ns[rover_epoch]
    n_epochs = len(time_ns)
    position, has_position = _hold_position(base_point.position_ecef_m[base_epoch], position_before)
    latitude, longitude, _ = geodetic_from_ecef(position)
    rot_enu = rot_enu_from_ecef(latitude, longitude)

    # Satellite states at the base's reception, joined by (epoch, satellite).
    view = base_point.satellites
    view_epoch = np.repeat(np.arange(base.n_epochs), np.diff(view.epoch_start))
    view_key = view_epoch * 1000 + view.sat
    row_key = base_epoch[epoch] * 1000 + base.sat[base_row]
    at = np.zeros(len(row_key), np.int64)
    known = np.zeros(len(row_key), bool)
    if len(view_key):
        at = np.minimum(np.searchsorted(view_key, row_key), len(view_key) - 1)
        known = (view_key[at] == row_key) & np.isfinite(view.position_ecef_m[at, 0]) & has_position[epoch]
        known &= view.elevation_rad[at] >= np.radians(settings.elevation_mask_deg)
    at, epoch, base_row, rover_row, group = (v[known] for v in (at, epoch, base_row, rover_row, group))

    # Times of reception: tag minus clock; without a clock solution the tag itself.
    base_clock = np.nan_to_num(base_point.clock_s[base_epoch])
    rover_clock = np.nan_to_num(rover_point.clock_s[rover_epoch])
    tag_difference = (rover.time_ns[rover_epoch] - base.time_ns[base_epoch]) / NS_PER_S
    dt_receive = tag_difference - rover_clock + base_clock
    base_velocity = np.nan_to_num(base_point.velocity_ecef_mps[base_epoch])
    rover_velocity = np.nan_to_num(rover_point.velocity_ecef_mps[rover_epoch])
    # Both antennas are referred to the rover's tag, the epoch's nominal time.
    shift = -rover_velocity * rover_clock[:, None] + base_velocity * (tag_difference + base_clock)[:, None]
    approximate = np.zeros((n_epochs, 3))
    if is_long_baseline(base_point, rover_point, epochs) if at_code_baseline is None else at_code_baseline:
        difference = rover_point.position_ecef_m[rover_epoch] - base_point.position_ecef_m[base_epoch]
        approximate = np.nan_to_num(difference)
    base_m = position[epoch]
    rover_m = base_m + (approximate + shift)[epoch]

    satellite = view.position_ecef_m[at]
    velocity = view.velocity_ecef_mps[at]
    base_range, line = _modelled_range(satellite, base_m)
    range_rate = np.sum(line * velocity, axis=1)
    dt_transmit = dt_receive[epoch] * (1.0 - range_rate / SPEED_OF_LIGHT_MPS)
    omega = np.array([0.0, 0.0, EARTH_ROTATION_RADPS])
    radius = np.linalg.norm(satellite, axis=1)
    acceleration = (
        -EARTH_GM_M3PS2 * satellite / radius[:, None] ** 3
        - 2.0 * np.cross(omega, velocity)
        - np.cross(omega, np.cross(omega, satellite))
    )
    satellite_rover = (
        satellite + velocity * dt_transmit[:, None] + 0.5 * acceleration * dt_transmit[:, None] ** 2
    )
    rover_range, line_rover = _modelled_range(satellite_rover, rover_m)
    clock_change = view.clock_drift_sps[at] * dt_transmit
    elevation, azimuth = view.elevation_rad[at], view.azimuth_rad[at]
    model = rover_range - base_range - SPEED_OF_LIGHT_MPS * np.nan_to_num(clock_change)
    model += _troposphere_difference(base_m, rover_m, elevation, approximate)

    sat = rover.sat[rover_row]
    signal = np.array([p[1] for p in pairs])[group]
    channels = np.where(rover.glonass_channel == NO_CHANNEL, base.glonass_channel, rover.glonass_channel)
    wavelength = SPEED_OF_LIGHT_MPS / frequency_hz(sat, signal, channels)
    design_ecef = -line_rover
    phase = wavelength * (rover.phase_cyc[rover_row] - base.phase_cyc[base_row]) - model
    code = rover.code_m[rover_row] - base.code_m[base_row] - model
    # Linearised at the approximate baseline: b is counted from zero all the same.
    offset = np.sum(design_ecef * approximate[epoch], axis=1)
    phase += offset
    code += offset
    doppler = -wavelength * (rover.doppler_hz[rover_row] - base.doppler_hz[base_row])
    lli = base.lli[base_row] | rover.lli[rover_row]
    phase[(lli & LLI_HALF_CYCLE) > 0] = np.nan
    phase[~np.isfinite(wavelength)] = np.nan

    of_base = _undifferenced_variances(settings.stochastic, elevation, base.cn0_dbhz[base_row])
    of_rover = _undifferenced_variances(settings.stochastic, elevation, rover.cn0_dbhz[rover_row])
    variances = [one + two for one, two in zip(of_base, of_rover, strict=True)]
    is_fdma = (sat // 100 == GLONASS) & (signal // 100 <= 2)
    integer_ok = ~is_fdma | (settings.glonass_ambiguities == "calibrated")
    channel = np.where(is_fdma, channels[sat % 100], 0).astype(float)
    # Inter-channel bias, and the reference's own integer: (lambda_j - lambda_ref) N_ref stays behind, with
    # N_ref known from the code to some ten cycles and 0.066 mm of wavelength for each channel.
    variances[0] = variances[0] + np.where(is_fdma, (GLONASS_CHANNEL_SD_M * channel) ** 2, 0.0)

    keep = np.isfinite(code) | np.isfinite(phase)
    # Reference first: rows of a group fall by elevation; phases before rows that have none.
    order = np.lexsort((sat, -elevation, ~np.isfinite(phase), group, epoch))
    order = order[keep[order]]
    counts = np.bincount(epoch[order], minlength=n_epochs)
    design_enu = np.einsum("nij,nj->ni", rot_enu[epoch[order]], design_ecef[order])
    if not np.any(approximate):
        # A rover that stands higher has less air above it; the height is part of the baseline.
        design_enu[:, 2] += _troposphere_lapse(position, epoch[order], elevation[order])
    names = []
    for system, signal_base, signal_rover in pairs:
        name = f"{SYSTEMS[system]} {signal_name(signal_rover)}"
        names.append(name if signal_base == signal_rover else f"{name}/{signal_name(signal_base)}")
    return SingleDifferences(
        time_ns=time_ns,
        base_epoch=base_epoch,
        rover_epoch=rover_epoch,
        position_ecef_m=position,
        rot_enu_from_ecef=rot_enu,
        has_position=has_position,
        start=np.concatenate(([0], np.cumsum(counts))).astype(np.int64),
        sat=sat[order].astype(np.int16),
        signal=signal[order].astype(np.int16),
        group=group[order].astype(np.int64),
        phase_m=phase[order],
        code_m=code[order],
        design_enu=np.ascontiguousarray(design_enu),
        wavelength_m=wavelength[order],
        phase_variance_m2=variances[0][order],
        code_variance_m2=variances[1][order],
        elevation_rad=elevation[order],
        azimuth_rad=azimuth[order],
        doppler_mps=doppler[order],
        lli=lli[order],
        integer_ok=integer_ok[order],
        group_names=tuple(names),
        glonass_channel=channel[order],
        base_row=base_row[order],
        rover_row=rover_row[order],
    )


def is_long_baseline(base_point, rover_point, epochs):
    """Tell whether a run's baseline is linearised at the difference of the code positions.

    Parameters
    ----------
    base_point, rover_point : PointSolution
        Single-point solutions.
    epochs : tuple of ndarray of int64
        Matched epochs of base and rover, of the run or a sample of it.

    Returns
    -------
    bool
    """
    difference = rover_point.position_ecef_m[epochs[1]] - base_point.position_ecef_m[epochs[0]]
    distance_m = np.linalg.norm(difference, axis=1)
    distance_m = distance_m[np.isfinite(distance_m)]
    return bool(len(distance_m) and np.median(distance_m) > LINEARISE_AT_CODE_BASELINE_M)


def _hold_position(position, before=None):
    """Fill gaps of the base position with the last known one, those at the start with the first."""
    known = np.isfinite(position[:, 0])
    if before is None:
        if not known.any():
            return np.full_like(position, np.nan), known
        before = position[known][0]
    index = np.where(known, np.arange(len(position)) + 1, 0)
    np.maximum.accumulate(index, out=index)
    return np.concatenate((before[None], position))[index], np.ones(len(position), bool)


def _troposphere_difference(base_m, rover_m, elevation, approximate):
    """Zenith delay by the height difference, mapped; only long baselines have one worth a name."""
    if not np.any(approximate):
        return 0.0
    from ..orbits.atmosphere import saastamoinen_delay_m

    latitude, _, base_height = geodetic_from_ecef(base_m)
    _, _, rover_height = geodetic_from_ecef(rover_m)
    rover_delay = saastamoinen_delay_m(latitude, rover_height, elevation)
    return rover_delay - saastamoinen_delay_m(latitude, base_height, elevation)


def _troposphere_lapse(position_m, epoch, elevation_rad):
    """Change of the tropospheric delay with the height of the receiver, metres for each metre."""
    from ..orbits.atmosphere import saastamoinen_zenith_delay_m, troposphere_mapping

    latitude, _, height = geodetic_from_ecef(position_m)
    above, below = (saastamoinen_zenith_delay_m(latitude, height + step) for step in (50.0, -50.0))
    return np.nan_to_num((above - below) / 100.0)[epoch] * troposphere_mapping(elevation_rad)


def _no_common_epochs(base, rover, settings):
    def span(observations):
        if observations.n_epochs == 0:
            return "no epochs"
        return " to ".join(format_gpst(observations.time_ns[k]) for k in (0, -1))

    return (
        f"could not pair the two receivers: the base has {span(base)}, the rover {span(rover)} (GPST), and "
        f"no two time tags lie within {settings.max_time_difference_s:g} s; give files of the same time"
    )


def _no_common_signals(base, rover, settings):
    def signals(observations):
        kinds = np.unique(observations.sat.astype(np.int64) // 100 * 1000 + observations.signal)
        return " ".join(SYSTEMS[k // 1000] + signal_name(int(k % 1000)) for k in kinds) or "none"

    return (
        f"could not difference the two receivers: no common signal on systems {settings.systems} and bands "
        f"{','.join(settings.bands)}; the base has {signals(base)}, the rover {signals(rover)}; "
        "widen `systems` or `bands`"
    )
