r"""Maximum-likelihood fit of a once-per-revolution signal in coloured noise.

The samples are modelled as

.. math::
    f = c + q\, h \cdot (\cos\alpha, -\sin\alpha) + \sum_k h_k \cdot (\cos k\alpha, -\sin k\alpha)
    + s_1 (q^2 - 1) + s_2 \dot q + \sum_j \text{vibration}_j(t) + \varepsilon

with the table's angle alpha and its speed q relative to the mean. Without an encoder alpha is
:math:`\alpha_0 + \Omega t` and Omega one more unknown, found from the periodogram and improved by
Gauss-Newton steps. The terms of q are what a leaning axis feels of an uneven speed:
:math:`s_1 = -a\rho\Omega^2` and :math:`s_2 = b\rho\Omega`.

A sine is an eigenvector of stationary noise, so least squares is asymptotically as good as weighting by the
inverse covariance (Grenander and Rosenblatt 1957), and what the noise costs is its spectrum at the frequency
of the signal: that spectrum, not the scatter of the samples, gives sigma. It comes from an autoregressive
model of the residuals, averaged to sixteen a revolution; from the periodogram beside the signal where that is
significantly higher; and is that of the raw samples where the residuals are white. Vibration lines that stand
out of the periodogram are fitted as sines with unknown frequency, together with the signal, so that a line
too near is paid for in sigma.

References
----------
U. Grenander and M. Rosenblatt, Statistical Analysis of Stationary Time Series, Wiley, 1957, ch. 7.
D. C. Rife and R. R. Boorstyn, "Single-tone parameter estimation from discrete-time observations", IEEE
Trans. Inf. Theory 20 (1974) 591-598.
B. G. Quinn and E. J. Hannan, The Estimation and Tracking of Frequency, Cambridge University Press, 2001.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from ..errors import NoSolutionError

__all__ = ["HarmonicFit", "NoiseSpectrum", "fit_harmonic", "noise_spectrum", "wandering_phase"]

_WINDOWS = (3, 5, 11, 27, 67)
"""Samples of the encoder through which parabolas are laid for the speed."""

_PER_TURN = 16
"""Residuals in a revolution from which the spectrum is modelled."""

_MAX_ORDER = 6
"""Of the autoregressive model."""

_FALSE_LINE = 1e-4
"""Probability to see a vibration line in white noise."""

_WANDERS = 3.0
"""Twice the logarithm of the likelihood ratio from which a phase is taken to wander."""

_OUTLIER_SD = 7.0
"""Samples further off are left out; of a million good ones none is."""


@dataclass(frozen=True, slots=True, eq=False)
class NoiseSpectrum:
    """Noise of the samples, as a function of frequency.

    Parameters
    ----------
    white_sd : float
        Scatter of the samples, m/s^2.
    signal_sd : float
        Standard deviation of white noise that would disturb the signal as much, m/s^2.
    harmonics_sd : ndarray, shape (4,)
        The same at the first, third, fifth and seventh harmonic.
    order : int
        Of the autoregressive model; 0 is white.
    is_raised : bool
        Whether the periodogram beside the signal is higher than the model by more than chance.
    """

    white_sd: float
    signal_sd: float
    harmonics_sd: np.ndarray
    order: int
    is_raised: bool


@dataclass(frozen=True, slots=True, eq=False)
class HarmonicFit:
    """Signal at the frequency of the table.

    Parameters
    ----------
    harmonic_mps2 : ndarray, shape (2,)
        Vector h of ``h . (cos alpha, -sin alpha)``.
    cov_harmonic : ndarray, shape (2, 2)
        Its covariance, (m/s^2)^2.
    mean_mps2 : float
        Constant part.
    rate_radps : float
        Mean speed of the table, signed.
    rate_sd_radps : float
        Of the speed where it was estimated; 0 where an encoder gave it.
    angle_rad : ndarray, shape (n,)
        The table's angle that was used.
    relative_speed : ndarray, shape (n,)
        Speed over its mean.
    cleaned_mps2 : ndarray, shape (n,)
        Samples less everything but the signal and the residuals.
    disturbance_mps2 : ndarray, shape (n,)
        What was fitted beside constant and signal: harmonics, vibration, effects of an uneven speed.
    residual_mps2 : ndarray, shape (n,)
        What is left; 0 where a sample was left out.
    used : ndarray of bool, shape (n,)
        Samples that were used.
    noise : NoiseSpectrum
        Of the residuals.
    vibrations : ndarray, shape (k, 2)
        Frequency in hertz and amplitude in m/s^2 of the lines that were found.
    speed_terms_mps2 : ndarray, shape (2,) or None
        Coefficients ``s_1`` and ``s_2`` (the latter per second) where an uneven speed showed.
    speed_terms_sd_mps2 : ndarray, shape (2,) or None
        Their standard deviations.
    """

    harmonic_mps2: np.ndarray
    cov_harmonic: np.ndarray
    mean_mps2: float
    rate_radps: float
    rate_sd_radps: float
    angle_rad: np.ndarray
    relative_speed: np.ndarray
    cleaned_mps2: np.ndarray
    disturbance_mps2: np.ndarray
    residual_mps2: np.ndarray
    used: np.ndarray
    noise: NoiseSpectrum
    vibrations: np.ndarray
    speed_terms_mps2: np.ndarray | None = None
    speed_terms_sd_mps2: np.ndarray | None = None


def fit_harmonic(
    time_s: np.ndarray,
    signal_mps2: np.ndarray,
    *,
    angle_rad: np.ndarray | None = None,
    rate_radps: float | None = None,
    start_angle_rad: float = 0.0,
    harmonics: int = 1,
    max_vibrations: int = 4,
    speed_terms: bool = True,
) -> HarmonicFit:
    """Fit constant, signal, higher harmonics, effects of an uneven speed and vibration lines.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Instants, evenly spaced, seconds.
    signal_mps2 : ndarray, shape (n,)
        Samples; those that are not finite are left out.
    angle_rad : ndarray, shape (n,), optional
        The table's angle, counter-clockwise, growing over the revolutions; without it the speed is
        estimated.
    rate_radps : float, optional
        Speed about which it is sought; by default the strongest line.
    start_angle_rad : float
        Angle of the table at ``time_s[0]`` where there is no encoder.
    harmonics : int
        Up to which multiple of the revolution sines are fitted.
    max_vibrations : int
        So many vibration lines at most.
    speed_terms : bool
        Whether an uneven speed is looked for in the encoder.

    Returns
    -------
    HarmonicFit

    Raises
    ------
    NoSolutionError
        If the samples are too few.
    """
    time = np.asarray(time_s, dtype=float) - float(time_s[0])
    signal = np.asarray(signal_mps2, dtype=float)
    used = np.isfinite(signal)
    if angle_rad is not None:
        used &= np.isfinite(angle_rad)
    if np.count_nonzero(used) < 4 * (harmonics + 2):
        raise NoSolutionError(
            f"a harmonic cannot be fitted to {np.count_nonzero(used)} samples; record whole revolutions"
        )
    step_s = float(np.median(np.diff(time)))
    offset = float(np.mean(signal[used]))
    values = np.where(used, signal - offset, 0.0)
    speed = np.ones(len(time))
    if angle_rad is not None:
        angle = np.where(used, angle_rad, np.interp(time, time[used], np.asarray(angle_rad)[used]))
        # Of a steady table with a noisy encoder the line is the better angle by far, but who knows that it
        # is steady; the noise of an encoder only adds to that of the samples.
        rate = float(np.polyfit(time - time.mean(), angle, 1)[0])
        if speed_terms:
            speed, _ = _relative_speed(time, angle, step_s, rate, _WINDOWS[3])
    else:
        rate = _strongest_rate(values, step_s, rate_radps)
        rate = _refined_rate(time, values, used, rate, start_angle_rad)
        angle = start_angle_rad + rate * time
    per_turn = 2.0 * np.pi / abs(rate) / step_s

    columns = [np.ones(len(time)), speed * np.cos(angle), -speed * np.sin(angle)]
    for k in range(2, harmonics + 1):
        columns += [np.cos(k * angle), -np.sin(k * angle)]
    if angle_rad is None:
        n_rate = len(columns)
        columns.append(np.zeros(len(time)))
    else:
        n_rate = -1
    fit = _Fit(values, used)
    fit.solve(columns, n_rate, time)
    n_uneven = -1
    if angle_rad is not None and speed_terms and np.ptp(speed) > 1e-9:
        # How much an encoder must be smoothed depends on its noise and on the table: the residuals decide.
        plain = columns
        for window in _WINDOWS:
            if window > len(time):
                break
            q, change = _relative_speed(time, angle, step_s, rate, window)
            trial = _Fit(values, used)
            trial.solve([*plain, q**2 - 1.0, change], n_rate, time)
            # Two columns of noise take 2 sigma^2 off on average; 40 is beyond chance.
            limit = 40.0 * trial.rss / max(1, int(np.count_nonzero(used)) - len(plain) - 2)
            if fit.rss - trial.rss > limit:
                n_uneven, columns, fit = len(plain), [*plain, q**2 - 1.0, change], trial
    frequencies: list[float] = []
    for _ in range(max_vibrations):
        # Without an encoder an uneven speed puts lines beside the signal that are none.
        line_hz = _line(fit.residual, step_s, None if angle_rad is not None else abs(rate) / (2.0 * np.pi))
        if line_hz is None:
            break
        tried = _refined_lines(
            time, values, used, columns, n_rate, [*frequencies, line_hz], len(time) * step_s
        )
        trial = _Fit(values, used)
        trial.solve([*columns, *_line_columns(time, tried)], n_rate, time)
        frequencies, fit = tried, trial
    scale = 1.4826 * float(np.median(np.abs(fit.residual[used])))
    wild = used & (np.abs(fit.residual) > _OUTLIER_SD * scale)
    if scale > 0.0 and 0 < np.count_nonzero(wild) < 0.02 * len(time):
        used = used & ~wild
        fit = _Fit(values, used)
        fit.solve([*columns, *_line_columns(time, frequencies)], n_rate, time)

    found, cov = fit.parameters, fit.unit_cov
    noise = noise_spectrum(
        fit.residual, per_turn, len(time) / per_turn, int(np.count_nonzero(used)) - len(found)
    )
    variance = noise.signal_sd**2
    everything = fit.columns
    kept = np.zeros(len(found))
    kept[1:3] = found[1:3]
    rest = everything @ np.where(kept != 0.0, 0.0, found)
    if n_rate >= 0:
        # The column of the speed is linearised about the speed itself: its coefficient is nothing but noise.
        rest = rest - everything[:, n_rate] * found[n_rate]
    lines = [
        (hz, float(np.hypot(*found[len(columns) + 2 * k : len(columns) + 2 * k + 2])))
        for k, hz in enumerate(frequencies)
    ]
    return HarmonicFit(
        harmonic_mps2=found[1:3].copy(),
        cov_harmonic=variance * cov[1:3, 1:3],
        mean_mps2=offset + float(found[0]),
        rate_radps=rate,
        rate_sd_radps=float(np.sqrt(variance * cov[n_rate, n_rate])) if n_rate >= 0 else 0.0,
        angle_rad=angle,
        relative_speed=speed,
        cleaned_mps2=np.where(used, values - rest, 0.0),
        disturbance_mps2=rest - found[0],
        residual_mps2=fit.residual,
        used=used,
        noise=noise,
        vibrations=np.array(lines, dtype=float).reshape(-1, 2),
        speed_terms_mps2=found[n_uneven : n_uneven + 2].copy() if n_uneven >= 0 else None,
        speed_terms_sd_mps2=(
            np.sqrt(variance * np.diag(cov)[n_uneven : n_uneven + 2]) if n_uneven >= 0 else None
        ),
    )


class _Fit:
    """Linear least squares by scaled normal equations; few columns, many rows."""

    def __init__(self, values: np.ndarray, used: np.ndarray) -> None:
        self.values, self.used = values, used
        self.columns = np.empty((len(values), 0))
        self.parameters = np.empty(0)
        self.unit_cov = np.empty((0, 0))
        self.residual = values
        self.rss = np.inf

    def solve(self, columns: list[np.ndarray], n_rate: int, time: np.ndarray) -> None:
        """Solve; the column of the speed, if any, is made from the signal that a first solution finds."""
        matrix = np.stack(columns, axis=1)
        if n_rate >= 0:
            without = np.delete(matrix, n_rate, axis=1)
            first = self._solved(without)[0]
            # d/dOmega of h . (cos, -sin)(alpha_0 + Omega t)
            slope = time * (first[1] * matrix[:, 2] - first[2] * matrix[:, 1])
            matrix[:, n_rate] = slope
        self.parameters, self.unit_cov = self._solved(matrix)
        self.columns = matrix
        self.residual = np.where(self.used, self.values - matrix @ self.parameters, 0.0)
        self.rss = float(self.residual @ self.residual)

    def _solved(self, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rows = matrix if self.used.all() else matrix[self.used]
        values = self.values if self.used.all() else self.values[self.used]
        size = np.sqrt(np.einsum("ij,ij->j", rows, rows))
        size[size == 0.0] = 1.0
        scaled = rows / size
        inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-12, hermitian=True)
        return inverse @ (scaled.T @ values) / size, inverse / np.outer(size, size)


def _relative_speed(
    time: np.ndarray, angle: np.ndarray, step_s: float, rate: float, window: int
) -> tuple[np.ndarray, np.ndarray]:
    """Speed of the table over its mean and its derivative, per second, from local parabolas."""
    from scipy.signal import savgol_filter

    if window > len(angle):
        return np.ones(len(angle)), np.zeros(len(angle))
    uneven = angle - rate * (time - time[0])
    speed = 1.0 + savgol_filter(uneven, window, 2, deriv=1, delta=step_s) / rate
    return speed, savgol_filter(uneven, window, 2, deriv=2, delta=step_s) / rate


def _strongest_rate(values: np.ndarray, step_s: float, near_radps: float | None) -> float:
    """Start of the search for the speed: the highest point of the padded periodogram."""
    n = 8 * len(values)
    power = np.abs(np.fft.rfft(values, n)) ** 2
    rates = 2.0 * np.pi * np.fft.rfftfreq(n, step_s)
    # Below one revolution in the record there is no harmonic but the drift of the sensor.
    allowed = rates > 2.0 * np.pi / (len(values) * step_s) * 0.75
    if near_radps is not None:
        allowed &= np.abs(rates - abs(near_radps)) < 0.2 * abs(near_radps)
    if not allowed.any():
        raise NoSolutionError(
            "the record is shorter than one revolution at the stated speed; record whole revolutions"
        )
    rate = float(rates[np.argmax(np.where(allowed, power, -1.0))])
    return -rate if near_radps is not None and near_radps < 0.0 else rate


def _refined_rate(
    time: np.ndarray, values: np.ndarray, used: np.ndarray, rate: float, start_angle: float
) -> float:
    """Speed that maximises the likelihood, by Gauss-Newton steps on constant, signal and speed."""
    length = float(time[-1])
    for _ in range(12):
        angle = start_angle + rate * time
        fit = _Fit(values, used)
        fit.solve([np.ones(len(time)), np.cos(angle), -np.sin(angle), np.zeros(len(time))], 3, time)
        change = float(np.clip(fit.parameters[3], -1.0 / length, 1.0 / length))
        rate += change
        if abs(change) * length < 1e-10:
            break
    return rate


def _line(residual: np.ndarray, step_s: float, carrier_hz: float | None) -> float | None:
    """Frequency of a line that stands out of the residuals, hertz."""
    n = len(residual)
    power = np.abs(np.fft.rfft(residual)) ** 2
    first = 2
    if len(power) < first + 32:
        return None
    floor = _floor(power[first:])
    ratio = power[first:] / np.maximum(floor, 1e-300)
    if carrier_hz is not None:
        offset = np.arange(first, len(power)) / (n * step_s) - carrier_hz
        ratio[np.abs(offset) < 0.5 * carrier_hz] = 0.0
    peak = int(np.argmax(ratio))
    # The floor itself scatters, so the threshold has a margin.
    if ratio[peak] <= 0.0 or ratio[peak] < 1.5 * np.log(len(power) / _FALSE_LINE):
        return None
    return (first + peak) / (n * step_s)


def _floor(power: np.ndarray) -> np.ndarray:
    """Smooth level of a periodogram: medians of runs of bins, short ones where it may be steep."""
    edges = [0]
    while edges[-1] < len(power):
        edges.append(edges[-1] + int(np.clip(edges[-1] // 2, 12, 200)))
    if len(edges) > 2 and len(power) - edges[-2] < 12:
        edges.pop(-2)
    runs = [slice(low, min(high, len(power))) for low, high in itertools.pairwise(edges)]
    # The median of an exponential variable is ln 2 of its mean.
    level = np.array([float(np.median(power[run])) for run in runs]) / np.log(2.0)
    centre = np.array([0.5 * (run.start + run.stop - 1) for run in runs])
    return np.asarray(np.interp(np.arange(len(power)), centre, level))


def _line_columns(time: np.ndarray, frequencies: list[float]) -> list[np.ndarray]:
    columns = []
    for hz in frequencies:
        columns += [np.cos(2.0 * np.pi * hz * time), np.sin(2.0 * np.pi * hz * time)]
    return columns


def _refined_lines(
    time: np.ndarray,
    values: np.ndarray,
    used: np.ndarray,
    columns: list[np.ndarray],
    n_rate: int,
    frequencies: list[float],
    length_s: float,
) -> list[float]:
    """Gauss-Newton on the frequencies of all lines, together with everything else."""
    centre = time - 0.5 * time[-1]
    found = list(frequencies)
    for _ in range(8):
        lines = _line_columns(time, found)
        fit = _Fit(values, used)
        fit.solve([*columns, *lines], n_rate, time)
        amplitudes = fit.parameters[len(columns) :]
        slopes = [
            2.0
            * np.pi
            * centre
            * (amplitudes[2 * k + 1] * lines[2 * k] - amplitudes[2 * k] * lines[2 * k + 1])
            for k in range(len(found))
        ]
        wide = _Fit(values, used)
        wide.solve([*columns, *lines, *slopes], n_rate, time)
        changes = np.clip(wide.parameters[-len(found) :], -0.3 / length_s, 0.3 / length_s)
        found = [hz + float(change) for hz, change in zip(found, changes, strict=True)]
        if np.max(np.abs(changes)) * length_s < 1e-6:
            break
    return found


def noise_spectrum(
    residual_mps2: np.ndarray, samples_per_turn: float, turns: float, degrees: int
) -> NoiseSpectrum:
    """Noise of residuals at the frequency of the signal and at its odd multiples.

    Parameters
    ----------
    residual_mps2 : ndarray, shape (n,)
        Residuals of a fit of the signal.
    samples_per_turn, turns : float
        Samples in a revolution, and revolutions.
    degrees : int
        Degrees of freedom of the residuals.

    Returns
    -------
    NoiseSpectrum
    """
    n = len(residual_mps2)
    white = float(np.sqrt(residual_mps2 @ residual_mps2 / max(1, degrees)))
    size = max(1, round(samples_per_turn / _PER_TURN))
    blocks = residual_mps2[: n // size * size].reshape(-1, size).mean(axis=1) * np.sqrt(size)
    per_turn = samples_per_turn / size
    cycles = np.array([1.0, 3.0, 5.0, 7.0]) / per_turn
    coefficients, variance = _autoregression(blocks)
    order = len(coefficients)
    if order == 0:
        # The residuals of the fit have lost what the fit took; blocks and samples agree where all is white.
        ratio = variance / max(white**2, 1e-300)
        alike = abs(ratio - 1.0) < 4.0 * np.sqrt(2.0 / max(1, len(blocks)))
        density = np.full(4, white**2 if alike else variance)
    else:
        turn = np.exp(-2j * np.pi * np.outer(cycles, np.arange(1, order + 1)))
        density = variance / np.abs(1.0 - turn @ coefficients) ** 2
    # Averaging over a block passes this share of the amplitude at the frequency of the signal.
    density = np.where(cycles < 0.5, density, white**2)
    # The periodogram beside the signal, where it is higher than the model by more than chance: of a line
    # that is nearer than the resolution the two next bins see most.
    bins = round(turns)
    half = int(np.clip(bins // 2, 1, 25))
    power = np.abs(np.fft.rfft(residual_mps2)) ** 2 / n
    raised, level = float(density[0]), float(density[0])
    next_two = [k for k in (bins - 1, bins + 1) if 0 < k < len(power) - 1]
    wider = [
        k for k in range(max(1, bins - half), bins + half + 1) if abs(k - bins) > 1 and k < len(power) - 1
    ]
    if wider:
        ratio = float(np.mean(power[wider])) / max(level, 1e-300)
        if _chance(ratio, len(wider)) < 1e-3:
            raised = ratio * level
        level = float(np.mean(power[wider]))
    if next_two:
        beside = float(np.mean(power[next_two]))
        if _chance(beside / max(level, 1e-300), len(next_two)) < 1e-3:
            # A line at an unknown offset within one bin reaches the signal with four times the power, on
            # average, that it leaves in the two next bins.
            raised = max(raised, 4.0 * beside)
    is_raised = bool(raised > density[0])
    density[0] = raised
    return NoiseSpectrum(white, float(np.sqrt(density[0])), np.sqrt(density), order, is_raised)


def _chance(ratio: float, bins: int) -> float:
    """Probability that a mean of so many bins of a periodogram is so many times its expectation."""
    from scipy.special import gammaincc

    return float(gammaincc(bins, bins * ratio))


def _autoregression(samples: np.ndarray) -> tuple[np.ndarray, float]:
    """Coefficients and innovation variance by Levinson's recursion, order by the Bayesian criterion."""
    n = len(samples)
    highest = min(_MAX_ORDER, n // 24)
    lags = np.array([samples[: n - k] @ samples[k:] for k in range(highest + 1)]) / n
    variance = float(lags[0])
    best, coefficients = np.empty(0), np.empty(0)
    if variance <= 0.0:
        return best, variance
    best_variance, best_score = variance, n * np.log(variance)
    for order in range(1, highest + 1):
        reflection = (lags[order] - coefficients @ lags[order - 1 : 0 : -1]) / variance
        coefficients = np.append(coefficients - reflection * coefficients[::-1], reflection)
        variance *= 1.0 - reflection**2
        if variance <= 0.0:
            break
        score = n * np.log(variance) + order * np.log(n)
        if score < best_score:
            best, best_variance, best_score = coefficients, variance, score
    return best, float(best_variance)


def wandering_phase(time: np.ndarray, phase_rad: np.ndarray, noise_rad: float) -> tuple[float, float] | None:
    """Phase at time zero of a series that has an unknown rate and wanders like a random walk.

    Restricted likelihood of ``phase = a + b t + walk(t) + noise``, the density of the walk unknown, the walk
    beginning at time zero.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Instants, counted from where the phase is wanted.
    phase_rad : ndarray, shape (n,)
        Phases, unwrapped.
    noise_rad : float
        White noise of one of them.

    Returns
    -------
    tuple of float, or None
        Phase a and its standard deviation, radians; None where no walk shows or there are fewer than five.
    """
    if len(time) < 5:
        return None
    groups = np.array_split(np.arange(len(time)), min(len(time), 60))
    instants = np.array([float(time[rows].mean()) for rows in groups])
    values = np.array([float(phase_rad[rows].mean()) for rows in groups])
    design = np.stack([np.ones(len(instants)), instants], axis=1)
    noise = np.diag([noise_rad**2 / len(rows) for rows in groups])
    walk = np.minimum.outer(instants, instants) / instants[-1]
    scores, answers = [], []
    for wandered_rad in (0.0, *np.logspace(-5.0, 1.0, 61)):
        cov = noise + wandered_rad**2 * walk
        weight = np.linalg.inv(cov)
        inverse = np.linalg.inv(design.T @ weight @ design)
        found = inverse @ (design.T @ weight @ values)
        misfit = values - design @ found
        scores.append(
            float(misfit @ weight @ misfit)
            + float(np.linalg.slogdet(cov)[1])
            - float(np.linalg.slogdet(inverse)[1])
        )
        answers.append((float(found[0]), float(np.sqrt(inverse[0, 0]))))
    if scores[0] - min(scores) < _WANDERS:
        return None
    # A short record hardly knows how much the phase wanders: mean over what it may be, by likelihood.
    weight = np.exp(-0.5 * (np.array(scores) - min(scores)))
    weight /= weight.sum()
    phases, sds = np.array(answers).T
    phase = float(weight @ phases)
    return phase, float(np.sqrt(weight @ (sds**2 + (phases - phase) ** 2)))
