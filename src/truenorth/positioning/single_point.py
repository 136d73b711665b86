"""Position, velocity and clock of one receiver from one epoch's codes and Dopplers.

    P = |R3(omega tau) s(t_s) - x| + c dt_r(system) - c (dt_s - group delay) + I + T + e
    t_s = tag - P / c - dt_s,                       tag = t_r + dt_r

``tag`` is the receiver's time tag, ``t_r`` the true time of reception in GPS time; ``dt_r`` is one
clock for each satellite system. R3 turns the satellite's position, given in the Earth's axes at
transmission, by the Earth's rotation during the travel time tau. Ionosphere: Klobuchar's broadcast
model scaled by ``(f_L1 / f)^2``; troposphere: Saastamoinen (`truenorth.orbits.atmosphere`).

    (1 + lambda D / c) (1 + dt_r') = (1 + dt_s') (1 - rho' / c)
    rho' = e . (v_s - v_r) / (1 + e . v_s,inertial / c)

relates the Doppler D to velocity and clock drift, with no term left out above a micrometre per
second but the change of the atmosphere. Weighted least squares by Gauss-Newton; the weights are

    var = (a^2 + b^2 / sin^2 el) 10^((C0 - C/N0) s / 10) + sis^2 + (I / 2)^2 + (0.1 m * m(el))^2

with a, b, C0, s of `truenorth.config.StochasticSettings`, sis the error of orbit and clock, and I / 2
because Klobuchar's model takes away about half of the ionosphere. When the chi-square test of the
residuals fails and the redundancy allows it, the observation with the largest normalised residual, if
above 4, is removed and the adjustment repeated (Baarda's data snooping).

References
----------
IS-GPS-200N, 20.3.3. Harvey 1998, UCGE 20117, 6.2.1 and appendix A (position and velocity).
Baarda 1968, "A testing procedure for use in geodetic networks". Kaplan & Hegarty 2017, chapter 7
(dilution of precision).
"""

import math
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache

import numpy as np

from ..constants import (
    BEIDOU,
    FREQUENCY_HZ,
    GALILEO,
    GLONASS,
    GPS,
    NAVIC,
    QZSS,
    SBAS,
    SPEED_OF_LIGHT_MPS,
    SYSTEMS,
)
from ..observations import NO_CHANNEL, frequency_hz, signal_id
from ..timescales import NS_PER_DAY

__all__ = [
    "CODE_PRIORITY",
    "POINT_STATUS_SENTENCES",
    "PointSolution",
    "PointStatus",
    "SatelliteView",
    "select_codes",
    "solve_single_point",
]

CODE_PRIORITY = {
    "G": ("1CPWYLSXMN", "2WPYCDLSXMN", "5QIX"),
    "R": ("1CP", "4ABX", "2CP", "6ABX", "3IQX"),
    "E": ("1CXBAZ", "5QIX", "7QIX", "8QIX", "6CXBAZ"),
    "C": ("2IXQ", "1PXDSLZAN", "6IXQDPZA", "7IXQDPZ", "5PXD", "8PXD"),
    "J": ("1CEXLSZB", "2LXS", "5QIXDPZ", "6LXSEZ"),
    "I": ("5ABCX", "1DPX", "9ABCX"),
    "S": ("1C", "5IQX"),
}
"""Which pseudorange of a satellite is used: bands in order, in each band the tracking attributes in
order. Band 1 first, because single-frequency users' group delays and the ionosphere model are
defined there; the civil code first, because every receiver has it. Attributes that are not listed
come last in their band, bands that are not listed are not used."""

SIGNAL_IN_SPACE_SD_M = {"G": 1.0, "R": 2.5, "E": 0.7, "C": 1.5, "J": 1.5, "I": 2.5, "S": 3.0}
"""Range error of broadcast orbit, clock and group delay, one sigma: somewhat above the figures of
Montenbruck et al. 2018, Advances in Space Research 61(8), to hold for data of 2010 too."""

_URA_NOMINAL_M = 3.0
"""A stated accuracy above this replaces `SIGNAL_IN_SPACE_SD_M`; up to it, it is only a ceiling."""

_CLOCK_GROUP = {GPS: 0, QZSS: 0, SBAS: 0, GALILEO: 1, BEIDOU: 2, GLONASS: 3, NAVIC: 4}
CLOCK_GROUPS = ("G", "E", "C", "R", "I")
"""Systems with a receiver clock of their own, in the order in which they serve as the reference."""

_NO_RANK = 32_000
_F_L1_HZ = 1575.42e6


class PointStatus(IntEnum):
    """What one epoch's single-point position is. The numbers are stable."""

    OK = 0
    NO_CODE = 1
    NO_NAVIGATION = 2
    TOO_FEW_SATELLITES = 3
    WEAK_GEOMETRY = 4
    NOT_CONVERGED = 5
    INCONSISTENT = 6
    NO_DOPPLER = 7


POINT_STATUS_SENTENCES = {
    PointStatus.OK: "solved",
    PointStatus.NO_CODE: "no pseudoranges of the wanted systems",
    PointStatus.NO_NAVIGATION: "no valid broadcast ephemeris for enough satellites",
    PointStatus.TOO_FEW_SATELLITES: "fewer satellites above the mask than unknowns",
    PointStatus.WEAK_GEOMETRY: "the satellites do not span the four unknowns",
    PointStatus.NOT_CONVERGED: "the iteration did not settle on a place near the Earth",
    PointStatus.INCONSISTENT: "solved, but the residuals are too large and the outlier cannot be told",
    PointStatus.NO_DOPPLER: "no Doppler observations",
}
"""One sentence for each `PointStatus`."""


@dataclass(frozen=True, slots=True, eq=False)
class SatelliteView:
    """Satellites as one receiver saw them: one row per epoch and satellite with a pseudorange.

    Rows are sorted by (epoch, satellite). What needs the receiver's position is NaN where there is
    none; satellites without an ephemeris have NaN states.

    Parameters
    ----------
    sat : ndarray of int16, shape (m,)
        Satellite, see `truenorth.observations.sat_id`.
    epoch_start : ndarray of int64, shape (n + 1,)
        Rows of epoch k are ``epoch_start[k]:epoch_start[k + 1]``.
    observation_row : ndarray of int64, shape (m,)
        Row of the `Observations` whose pseudorange was used.
    position_ecef_m, velocity_ecef_mps : ndarray, shape (m, 3)
        Of the satellite at transmission, in the Earth's axes of that instant: not yet turned by
        the Earth's rotation during the travel time.
    clock_s, clock_drift_sps : ndarray, shape (m,)
        Satellite clock minus system time, with relativity, without group delay.
    ephemeris_index : ndarray of int64, shape (m,)
        Ephemeris used, -1 where none.
    line_of_sight_ecef : ndarray, shape (m, 3)
        Unit vector from receiver to satellite, in the Earth's axes at reception.
    elevation_rad, azimuth_rad : ndarray, shape (m,)
        Direction in the local level; azimuth in [0, 2 pi).
    is_used : ndarray of bool, shape (m,)
        Took part in the position.
    is_outlier : ndarray of bool, shape (m,)
        Removed by the residual test.
    code_residual_m : ndarray, shape (m,)
        Observed minus computed pseudorange; NaN where no used satellite shares its clock.
    code_sd_m : ndarray, shape (m,)
        Standard deviation that the weights stand for.
    is_velocity_used : ndarray of bool, shape (m,)
        Its Doppler took part in the velocity.
    doppler_residual_mps : ndarray, shape (m,)
        Observed minus computed range rate.
    """

    sat: np.ndarray
    epoch_start: np.ndarray
    observation_row: np.ndarray
    position_ecef_m: np.ndarray
    velocity_ecef_mps: np.ndarray
    clock_s: np.ndarray
    clock_drift_sps: np.ndarray
    ephemeris_index: np.ndarray
    line_of_sight_ecef: np.ndarray
    elevation_rad: np.ndarray
    azimuth_rad: np.ndarray
    is_used: np.ndarray
    is_outlier: np.ndarray
    code_residual_m: np.ndarray
    code_sd_m: np.ndarray
    is_velocity_used: np.ndarray
    doppler_residual_mps: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class PointSolution:
    """Single-point position, velocity and clock of every epoch; NaN where there is none.

    Parameters
    ----------
    time_ns : ndarray of int64, shape (n,)
        Receiver time tags, GPS time, nanoseconds.
    status, velocity_status : ndarray of uint8, shape (n,)
        Codes of `PointStatus`.
    position_ecef_m, velocity_ecef_mps : ndarray, shape (n, 3)
        ECEF position and velocity.
    clock_s : ndarray, shape (n,)
        Time tag minus true time of reception in GPS time: the signals of an epoch were received at
        ``time_ns - 1e9 * clock_s``. Of the first system present in the order of `CLOCK_GROUPS`.
    clock_drift_sps : ndarray, shape (n,)
        Its rate.
    system_offset_s : ndarray, shape (n, 5)
        Receiver clock of each system of `CLOCK_GROUPS` minus ``clock_s``; NaN where absent.
    covariance_m2 : ndarray, shape (n, 4, 4)
        Of position and ``c * clock_s``, metres squared.
    velocity_covariance_m2ps2 : ndarray, shape (n, 4, 4)
        Of velocity and ``c * clock_drift_sps``.
    gdop, pdop, hdop, vdop, tdop : ndarray, shape (n,)
        Dilution of precision of the satellites used, unit weights, a clock for each system.
    n_sats, n_rejected, dof : ndarray of int64, shape (n,)
        Satellites used, removed as outliers, and redundancy.
    chi2 : ndarray, shape (n,)
        Weighted square sum of the residuals.
    n_velocity_sats : ndarray of int64, shape (n,)
        Satellites whose Doppler was used.
    velocity_chi2 : ndarray, shape (n,)
        Weighted square sum of the Doppler residuals.
    satellites : SatelliteView
        The satellites of every epoch.
    """

    time_ns: np.ndarray
    status: np.ndarray
    velocity_status: np.ndarray
    position_ecef_m: np.ndarray
    velocity_ecef_mps: np.ndarray
    clock_s: np.ndarray
    clock_drift_sps: np.ndarray
    system_offset_s: np.ndarray
    covariance_m2: np.ndarray
    velocity_covariance_m2ps2: np.ndarray
    gdop: np.ndarray
    pdop: np.ndarray
    hdop: np.ndarray
    vdop: np.ndarray
    tdop: np.ndarray
    n_sats: np.ndarray
    n_rejected: np.ndarray
    dof: np.ndarray
    chi2: np.ndarray
    n_velocity_sats: np.ndarray
    velocity_chi2: np.ndarray
    satellites: SatelliteView

    @property
    def n_epochs(self):
        """int: Number of epochs."""
        return len(self.time_ns)

    @property
    def is_solved(self):
        """Ndarray of bool, shape (n,): epochs with a position."""
        return np.isfinite(self.position_ecef_m[:, 0])

    def __str__(self):
        """One line: epochs, how many solved."""
        return f"single-point solution: {self.n_epochs} epochs, {np.count_nonzero(self.is_solved)} solved"


@lru_cache(maxsize=1)
def _rank_table():
    """Rank of (system, signal) in `CODE_PRIORITY`, shape (n_systems, 1000); `_NO_RANK` = unused."""
    table = np.full((len(SYSTEMS), 1000), _NO_RANK, dtype=np.int16)
    for system, bands in CODE_PRIORITY.items():
        row = table[SYSTEMS.index(system)]
        for order, (band, *attributes) in enumerate(bands):
            row[int(band) * 100 : int(band) * 100 + 100] = order * 100 + 99
            for place, attribute in enumerate(attributes):
                row[signal_id(band + attribute)] = order * 100 + place
    return table


def _first_by_rank(observations, rank):
    """Row of the lowest rank of each (epoch, satellite), and the epoch offsets of these rows."""
    sat, epoch = observations.sat, observations.epoch_of_row
    keep = np.flatnonzero(rank < _NO_RANK)
    if len(keep) == 0:
        return keep, np.zeros(observations.n_epochs + 1, dtype=np.int64)
    key = epoch[keep] * 1000 + sat[keep]
    first = np.flatnonzero(np.concatenate(([True], key[1:] != key[:-1])))
    # The rank in the high digits and the place in the low ones: the least is the first of the best.
    packed = rank[keep].astype(np.int64) * len(sat) + keep
    row = np.minimum.reduceat(packed, first) % len(sat)
    start = np.searchsorted(epoch[row], np.arange(observations.n_epochs + 1)).astype(np.int64)
    return row, start


def select_codes(observations, *, systems=SYSTEMS, cn0_mask_dbhz=0.0):
    """Choose one pseudorange of every satellite at every epoch, by `CODE_PRIORITY`.

    Parameters
    ----------
    observations : Observations
        Of one receiver.
    systems : str
        Letters of the systems wanted.
    cn0_mask_dbhz : float
        Codes known to be weaker are passed over; unknown strength passes.

    Returns
    -------
    row : ndarray of int64, shape (m,)
        Rows of the observations, sorted by (epoch, satellite).
    epoch_start : ndarray of int64, shape (n_epochs + 1,)
        Their epoch offsets.
    """
    rank = _rank_table()[observations.sat // 100, observations.signal]
    wanted = np.isin(np.arange(len(SYSTEMS)), [SYSTEMS.index(s) for s in systems])
    bad = ~np.isfinite(observations.code_m) | ~wanted[observations.sat // 100]
    bad |= observations.cn0_dbhz < cn0_mask_dbhz
    return _first_by_rank(observations, np.where(bad, _NO_RANK, rank))


def _select_dopplers(observations, code_row, code_start):
    """Doppler row for each code row, -1 where the satellite has none."""
    row = np.where(np.isfinite(observations.doppler_hz[code_row]), code_row, -1)
    if np.all(row >= 0) or not np.any(np.isfinite(observations.doppler_hz)):
        return row
    rank = _rank_table()[observations.sat // 100, observations.signal]
    other, start = _first_by_rank(
        observations, np.where(np.isfinite(observations.doppler_hz), rank, _NO_RANK)
    )
    if len(other) == 0:
        return row
    epochs = np.arange(observations.n_epochs)
    key = np.repeat(epochs, np.diff(code_start)) * 1000 + observations.sat[code_row]
    other_key = np.repeat(epochs, np.diff(start)) * 1000 + observations.sat[other]
    place = np.minimum(np.searchsorted(other_key, key), len(other_key) - 1)
    return np.where((row < 0) & (other_key[place] == key), other[place], row)


@lru_cache(maxsize=8)
def _chi2_limits(n, significance):
    """Upper chi-square limits for 0 to n degrees of freedom; the first is infinite."""

    def upper_tail(x, dof):
        # Finite sums: Abramowitz & Stegun 26.4.4 and 26.4.5.
        half = x / 2.0
        if dof % 2:
            total, term = math.erfc(math.sqrt(half)), math.exp(-half) * math.sqrt(half / math.pi) * 2.0
            first = 3
        else:
            total, term = 0.0, math.exp(-half)
            first = 2
        for k in range(first, dof + 1, 2):
            total += term
            term *= x / k
        return total

    limits = [math.inf]
    for dof in range(1, n + 1):
        low, high = 0.0, 20.0 * dof + 200.0
        while high - low > 1e-9 * high:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if upper_tail(middle, dof) > significance else (low, middle)
        limits.append(high)
    table = np.array(limits)
    table.setflags(write=False)
    return table


def _signal_in_space_variance(sat, ura_m):
    """Variance of orbit and clock of each row, metres squared."""
    nominal = np.array([SIGNAL_IN_SPACE_SD_M[s] for s in SYSTEMS])[sat // 100]
    return np.where(ura_m > _URA_NOMINAL_M, ura_m, nominal) ** 2


def _klobuchar(navigation, ionosphere):
    """Coefficients of the ionosphere model, or None. QZSS broadcasts the same model for its region."""
    if ionosphere == "klobuchar":
        for source in "GJ":
            coefficients = navigation.klobuchar.get(source)
            if coefficients is not None and np.any(coefficients):
                return np.array(coefficients, dtype=np.float64)
    return None


def solve_single_point(
    observations,
    navigation,
    *,
    systems="GRECJ",
    elevation_mask_deg=10.0,
    cn0_mask_dbhz=0.0,
    stochastic=None,
    doppler_sd_mps=0.05,
    ionosphere="klobuchar",
    humidity=0.7,
    significance=1e-4,
    max_rejected=6,
    max_pdop=30.0,
    initial_position_ecef_m=None,
):
    """Solve position, velocity and clock of a receiver at every epoch.

    Parameters
    ----------
    observations : Observations
        Of one receiver.
    navigation : Navigation
        Broadcast ephemerides.
    systems : str
        Letters of the systems to use.
    elevation_mask_deg : float
        Lower satellites do not take part; they are in the table of satellites all the same.
    cn0_mask_dbhz : float
        Weaker codes do not take part and are not in the table.
    stochastic : StochasticSettings, optional
        Code noise, its growth at low elevation and its dependence on C/N0.
    doppler_sd_mps : float
        Noise of the range rate, in the same form: ``sd^2 (1 + 1 / sin^2 el)`` times the C/N0 factor.
    ionosphere : {"klobuchar", "off"}
        ``klobuchar`` uses the coefficients of the navigation data; where it has none, nothing is
        corrected and the weights allow for that. ``off`` takes the data to be free of it.
    humidity : float
        Relative humidity of the standard atmosphere, 0 to 1.
    significance : float
        False-alarm rate of the chi-square test of an epoch's residuals.
    max_rejected : int
        Most satellites removed from one epoch.
    max_pdop : float
        Weaker geometry gives no position.
    initial_position_ecef_m : array_like, shape (3,), optional
        First guess; by default the file's approximate position. Need not be good, or known.

    Returns
    -------
    PointSolution

    Raises
    ------
    ConfigError
        If an option has an impossible value.

    Examples
    --------
    >>> import truenorth as tn
    >>> point = tn.solve_single_point(tn.read("base.obs"), tn.read("brdc.nav"))  # doctest: +SKIP
    >>> point.position_ecef_m.shape  # doctest: +SKIP
    (301, 3)
    """
    from ..config import StochasticSettings
    from ..errors import ConfigError
    from ..orbits import compute_transmission_states, group_delay_s

    if ionosphere not in ("klobuchar", "off"):
        raise ConfigError(
            f"`ionosphere` is {ionosphere!r}; give 'klobuchar' or 'off'", key="ionosphere", value=ionosphere
        )
    if not 0.0 < significance < 1.0:
        raise ConfigError(
            f"`significance` is {significance!r}; give a probability above 0 and below 1",
            key="significance",
            value=significance,
        )
    if not systems or set(systems) - set(SYSTEMS):
        raise ConfigError(
            f"`systems` is {systems!r}; give letters among {SYSTEMS}", key="systems", value=systems
        )
    stochastic = StochasticSettings() if stochastic is None else stochastic

    code_row, start = select_codes(observations, systems=systems, cn0_mask_dbhz=cn0_mask_dbhz)
    sat = observations.sat[code_row].astype(np.int64)
    signal = observations.signal[code_row].astype(np.int64)
    code_m = observations.code_m[code_row]
    epoch = np.repeat(np.arange(observations.n_epochs), np.diff(start))
    states = compute_transmission_states(navigation, sat, observations.time_ns[epoch], code_m)
    delay_s = group_delay_s(navigation, states.ephemeris_index, sat, signal)

    channels = np.where(
        observations.glonass_channel != NO_CHANNEL,
        observations.glonass_channel,
        navigation.glonass_channels(),
    )
    doppler_row = _select_dopplers(observations, code_row, start)
    doppler_hz = np.where(doppler_row >= 0, observations.doppler_hz[doppler_row], np.nan)
    wavelength_m = SPEED_OF_LIGHT_MPS / frequency_hz(sat, observations.signal[doppler_row], channels)

    carrier_hz = frequency_hz(sat, signal, channels)
    carrier_hz = np.where(np.isnan(carrier_hz), FREQUENCY_HZ[sat // 100, signal // 100], carrier_hz)
    coefficients = _klobuchar(navigation, ionosphere)
    cn0 = np.fmin(observations.cn0_dbhz[code_row], stochastic.cn0_reference_dbhz)
    cn0 = np.where(np.isnan(cn0), stochastic.cn0_reference_dbhz, cn0)
    noise_scale = 10.0 ** ((stochastic.cn0_reference_dbhz - cn0) / 10.0 * stochastic.cn0_slope)
    given = np.column_stack(
        [
            states.position_ecef_m,
            states.velocity_ecef_mps,
            code_m + SPEED_OF_LIGHT_MPS * (states.clock_s - np.nan_to_num(delay_s)),
            np.zeros(len(sat)) if ionosphere == "off" else (_F_L1_HZ / carrier_hz) ** 2,
            noise_scale,
            _signal_in_space_variance(sat, states.ura_m),
            (1.0 + wavelength_m * doppler_hz / SPEED_OF_LIGHT_MPS) / (1.0 + states.clock_drift_sps),
        ]
    )
    if initial_position_ecef_m is None:
        initial_position_ecef_m = observations.meta.approx_position_ecef_m or (0.0, 0.0, 0.0)
    settings = (
        math.radians(elevation_mask_deg),
        stochastic.code_sd_m**2,
        stochastic.code_elevation_sd_m**2,
        # Without coefficients the ionosphere is in the noise: twice the model's 5 ns, 3 m at the zenith.
        2.0 if coefficients is None else 0.5,
        0.1,
        doppler_sd_mps**2,
        doppler_sd_mps**2,
        humidity,
        max_pdop,
        float(max_rejected),
        0.0 if coefficients is None else 1.0,
    )
    result = _run_kernel(
        observations.time_ns,
        start,
        sat,
        given,
        states.status == 0,
        coefficients,
        settings,
        significance,
        initial_position_ecef_m,
    )
    return _assemble(observations.time_ns, start, code_row, sat, states, *result)


def _run_kernel(time_ns, start, sat, given, is_usable, klobuchar, settings, significance, initial):
    """Allocate, and call the kernel over all epochs; returns its flag, row, epoch and count arrays."""
    from .._kernels import positioning as kernels

    n, m = len(time_ns), len(sat)
    group = np.array([_CLOCK_GROUP[s] for s in range(len(SYSTEMS))])[sat // 100].astype(np.int64)
    n_code = np.diff(start).astype(np.int64)
    flag = np.zeros((m, kernels.N_FLAGS), dtype=np.uint8)
    is_usable = is_usable & np.isfinite(given[:, : kernels.RATE]).all(axis=1)
    flag[:, kernels.STATE] = np.where(is_usable, kernels.CANDIDATE, kernels.UNUSABLE)
    row = np.full((m, kernels.N_ROW), np.nan)
    epoch = np.full((n, kernels.N_EPOCH), np.nan)
    count = np.zeros((n, kernels.N_COUNTS), dtype=np.int64)
    given = np.array(given, dtype=np.float64, order="C")
    start = np.array(start, dtype=np.int64)
    settings = np.array(settings, dtype=np.float64)
    chi2_limit = np.array(_chi2_limits(int(n_code.max(initial=1)), float(significance)))
    kernels.solve_positions(
        start,
        (np.asarray(time_ns) % NS_PER_DAY) / 1e9,
        np.array(initial, dtype=np.float64),
        given,
        group,
        np.zeros(8) if klobuchar is None else klobuchar,
        settings,
        chi2_limit,
        flag,
        row,
        epoch,
        count,
    )
    kernels.solve_rates(start, given, settings, chi2_limit, flag, row, epoch, count)

    # Why there were too few: nothing observed, or nothing known of what was observed.
    n_candidates = np.diff(np.concatenate(([0], np.cumsum(is_usable)))[start])
    status = count[:, kernels.STATUS]
    lacking = status == kernels.TOO_FEW
    status[lacking & (n_candidates < 4) & (n_code >= 4)] = kernels.NO_NAVIGATION
    status[lacking & (n_code == 0)] = kernels.NO_CODE
    solved = np.isin(status, (kernels.OK, kernels.INCONSISTENT))
    epoch[~solved, kernels.CHI2 :] = np.nan
    count[~solved, kernels.RATE_STATUS] = status[~solved]
    return flag, row, epoch, count


def _assemble(time_ns, start, code_row, sat, states, flag, row, epoch, count):
    """Name the columns of the kernel's arrays."""
    from .._kernels import positioning as kernels

    satellites = SatelliteView(
        sat=sat.astype(np.int16),
        epoch_start=start,
        observation_row=code_row,
        position_ecef_m=states.position_ecef_m,
        velocity_ecef_mps=states.velocity_ecef_mps,
        clock_s=states.clock_s,
        clock_drift_sps=states.clock_drift_sps,
        ephemeris_index=states.ephemeris_index,
        line_of_sight_ecef=row[:, kernels.LOS : kernels.LOS + 3].copy(),
        elevation_rad=row[:, kernels.ELEVATION].copy(),
        azimuth_rad=row[:, kernels.AZIMUTH].copy(),
        is_used=flag[:, kernels.USED].astype(np.bool_),
        is_outlier=flag[:, kernels.STATE] == kernels.REJECTED,
        code_residual_m=row[:, kernels.RESIDUAL].copy(),
        code_sd_m=np.sqrt(row[:, kernels.VARIANCE]),
        is_velocity_used=flag[:, kernels.RATE_USED].astype(np.bool_),
        doppler_residual_mps=row[:, kernels.RATE_RESIDUAL].copy(),
    )
    n = len(time_ns)
    clock_m = epoch[:, kernels.CLOCK]
    group_clock_m = epoch[:, kernels.GROUP_CLOCK : kernels.GROUP_CLOCK + kernels.N_GROUPS]
    gdop, pdop, hdop, vdop, tdop = epoch[:, kernels.DOPS : kernels.DOPS + 5].T.copy()
    return PointSolution(
        time_ns=time_ns,
        status=count[:, kernels.STATUS].astype(np.uint8),
        velocity_status=count[:, kernels.RATE_STATUS].astype(np.uint8),
        position_ecef_m=epoch[:, kernels.POSITION : kernels.POSITION + 3].copy(),
        velocity_ecef_mps=epoch[:, kernels.VELOCITY : kernels.VELOCITY + 3].copy(),
        clock_s=clock_m / SPEED_OF_LIGHT_MPS,
        clock_drift_sps=epoch[:, kernels.VELOCITY + 3] / SPEED_OF_LIGHT_MPS,
        system_offset_s=(group_clock_m - clock_m[:, None]) / SPEED_OF_LIGHT_MPS,
        covariance_m2=epoch[:, kernels.COV : kernels.COV + 16].reshape(n, 4, 4).copy(),
        velocity_covariance_m2ps2=epoch[:, kernels.RATE_COV : kernels.RATE_COV + 16].reshape(n, 4, 4).copy(),
        gdop=gdop,
        pdop=pdop,
        hdop=hdop,
        vdop=vdop,
        tdop=tdop,
        n_sats=count[:, kernels.N_USED].copy(),
        n_rejected=count[:, kernels.N_REJECTED].copy(),
        dof=count[:, kernels.DOF].copy(),
        chi2=epoch[:, kernels.CHI2].copy(),
        n_velocity_sats=count[:, kernels.N_RATE_USED].copy(),
        velocity_chi2=epoch[:, kernels.RATE_CHI2].copy(),
        satellites=satellites,
    )
