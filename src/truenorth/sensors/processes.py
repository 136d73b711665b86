r"""Stochastic processes of sensor errors, sampled exactly at a fixed step, and their Allan variance.

First-order Gauss-Markov process of standard deviation sigma and time constant T::

    x[k] = a x[k-1] + sigma sqrt(1 - a^2) w[k],    a = exp(-dt / T),    x[0] ~ N(0, sigma^2)

Random walk of coefficient K: ``x[k] = x[k-1] + K sqrt(dt) w[k]``. White noise of density N (unit of
the signal times the square root of a second): ``N / sqrt(dt)`` per sample. Flicker noise is the sum
of Gauss-Markov processes of equal variance with time constants in geometric progression, whose
spectra add up to 1/f between the shortest and the longest; the variance is chosen so that the Allan
deviation is flat at the floor asked for.

Allan variances, tau being the averaging time:

====================  =====================================================================
white noise           ``N^2 / tau``
Gauss-Markov          ``2 sigma^2 T / tau [1 - T/(2 tau) (3 - 4 exp(-tau/T) + exp(-2 tau/T))]``
flicker, ideal        ``2 ln(2) / pi B^2`` (``B`` is the coefficient, 0.664 B the floor)
random walk           ``K^2 tau / 3``
quantised angles      ``3 Q^2 / tau^2`` (``Q`` = step / sqrt(12))
====================  =====================================================================

They are those of the process averaged without a gap; averages of a few samples, each taken at a point, are
up to ``1 + 1 / (2 m^2)`` times as variable where the process is a walk within their time.

References
----------
IEEE Std 952-1997, annex C (the Allan variances).
M. S. Keshner, "1/f noise", Proceedings of the IEEE 70 (1982), 212-218 (sum of relaxation processes).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

__all__ = [
    "flicker",
    "flicker_components",
    "flicker_variance",
    "gauss_markov",
    "gauss_markov_mean_covariance",
    "gauss_markov_variance",
    "poisson_events",
    "quantisation_variance",
    "random_walk",
    "random_walk_variance",
    "sum_of_events",
    "white_variance",
]

FLICKER_RATIO = np.sqrt(10.0)
"""Ratio of neighbouring time constants; the Allan deviation then ripples by less than 0.3 %."""

Shape = int | tuple[int, ...]


def gauss_markov(
    rng: np.random.Generator, shape: Shape, step_s: float, sd: float | np.ndarray, time_constant_s: float
) -> np.ndarray:
    """Stationary first-order Gauss-Markov process.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of the draws.
    shape : int or tuple of int
        Samples first, then independent components.
    step_s : float
        Time between samples, seconds.
    sd : float or ndarray
        Standard deviation, of all components or of each.
    time_constant_s : float
        Time after which the correlation has fallen to 1/e; 0 gives white noise.

    Returns
    -------
    ndarray of the shape asked for
    """
    from scipy.signal import lfilter

    draws = rng.standard_normal(shape)
    if time_constant_s > 0.0 and len(draws):
        ratio = step_s / time_constant_s
        draws[1:] *= np.sqrt(-np.expm1(-2.0 * ratio))
        draws = lfilter([1.0], [1.0, -np.exp(-ratio)], draws, axis=0)
    return draws * sd


def random_walk(
    rng: np.random.Generator, shape: Shape, step_s: float, coefficient: float | np.ndarray
) -> np.ndarray:
    """Random walk that starts at zero.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of the draws.
    shape : int or tuple of int
        Samples first, then independent components.
    step_s : float
        Time between samples, seconds.
    coefficient : float or ndarray
        Growth of the standard deviation per square root of a second.

    Returns
    -------
    ndarray of the shape asked for
    """
    draws = rng.standard_normal(shape)
    draws[:1] = 0.0
    return np.cumsum(draws, axis=0) * (np.sqrt(step_s) * coefficient)


def flicker_components(
    floor: float, shortest_s: float = 1.0, longest_s: float = 1e5
) -> tuple[float, np.ndarray]:
    """Gauss-Markov processes whose sum has a flat Allan deviation.

    Parameters
    ----------
    floor : float
        Allan deviation between the shortest and the longest time constant.
    shortest_s, longest_s : float
        Range of the time constants, seconds.

    Returns
    -------
    sd : float
        Standard deviation of each process.
    time_constant_s : ndarray
        Time constants, in steps of `FLICKER_RATIO`.

    Notes
    -----
    Equal variances s^2 at time constants in the ratio r approach the spectrum ``s^2 / (ln(r) f)``
    (one-sided), whose Allan variance is ``2 ln(2) s^2 / ln(r)``.
    """
    n = max(1, round(np.log(longest_s / shortest_s) / np.log(FLICKER_RATIO)) + 1)
    sd = floor * np.sqrt(np.log(FLICKER_RATIO) / (2.0 * np.log(2.0)))
    return float(sd), shortest_s * FLICKER_RATIO ** np.arange(n)


def flicker(
    rng: np.random.Generator, shape: Shape, step_s: float, floor: float, **limits: float
) -> np.ndarray:
    """Flicker noise with a given floor of the Allan deviation.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of the draws.
    shape : int or tuple of int
        Samples first, then independent components.
    step_s : float
        Time between samples, seconds.
    floor : float
        Allan deviation between the shortest and the longest time constant.
    **limits : float
        `shortest_s` and `longest_s` of `flicker_components`.

    Returns
    -------
    ndarray of the shape asked for
    """
    sd, time_constants = flicker_components(floor, **limits)
    total = np.zeros(shape)
    if floor == 0.0:
        return total
    for time_constant_s in time_constants:
        total += gauss_markov(rng, shape, step_s, sd, time_constant_s)
    return total


def white_variance(tau_s: np.ndarray, density: float) -> np.ndarray:
    """Allan variance of white noise of a density (unit times square root of a second)."""
    return density**2 / np.asarray(tau_s, dtype=float)


def gauss_markov_variance(tau_s: np.ndarray, sd: float, time_constant_s: float) -> np.ndarray:
    """Allan variance of a Gauss-Markov process (IEEE Std 952-1997, annex C)."""
    ratio = np.asarray(tau_s, dtype=float) / time_constant_s
    # The bracket in terms that do not cancel: 3 - 4 e^-x + e^-2x = (1 - e^-x)(3 - e^-x).
    fall = -np.expm1(-ratio)
    bracket = np.where(
        ratio < 1e-3, ratio**2 / 3.0 * (1.0 - 0.75 * ratio), 1.0 - fall * (2.0 + fall) / (2.0 * ratio)
    )
    return 2.0 * sd**2 * bracket / ratio


def flicker_variance(tau_s: np.ndarray, floor: float, **limits: float) -> np.ndarray:
    """Allan variance of what `flicker` draws."""
    sd, time_constants = flicker_components(floor, **limits)
    return sum((gauss_markov_variance(tau_s, sd, t) for t in time_constants), np.zeros(np.shape(tau_s)))


def random_walk_variance(tau_s: np.ndarray, coefficient: float) -> np.ndarray:
    """Allan variance of a random walk (IEEE Std 952-1997, annex C)."""
    return coefficient**2 * np.asarray(tau_s, dtype=float) / 3.0


def quantisation_variance(tau_s: np.ndarray, step: float) -> np.ndarray:
    """Allan variance of increments read from an accumulating counter (IEEE Std 952-1997, annex C)."""
    return step**2 / 4.0 / np.asarray(tau_s, dtype=float) ** 2


def gauss_markov_mean_covariance(lag: ArrayLike, ratio: ArrayLike) -> np.ndarray:
    r"""Covariance of the means of a Gauss-Markov process of unit variance over equal intervals.

    With x the interval over the time constant it is :math:`2 (x - 1 + e^{-x}) / x^2` of an interval with
    itself, and :math:`e^{-(m-1)x} (1 - e^{-x})^2 / x^2` with the m-th after it.

    Parameters
    ----------
    lag : int or ndarray of int
        How many intervals apart, 0 or more.
    ratio : float or ndarray
        Interval over the time constant, positive.

    Returns
    -------
    ndarray
        Of the shape that both broadcast to.
    """
    m, x = np.asarray(lag), np.asarray(ratio, dtype=float)
    # x - 1 + exp(-x) cancels below 1e-3, where its series has long converged.
    wide = np.maximum(x, 1e-3)
    same = np.where(x < 1e-3, 1.0 - x / 3.0, 2.0 * (wide + np.expm1(-wide)) / wide**2)
    return np.where(m == 0, same, (np.expm1(-x) / x) ** 2 * np.exp(-np.maximum(m - 1, 0) * x))


def sum_of_events(
    time_s: np.ndarray, start_s: ArrayLike, duration_s: ArrayLike, peak: ArrayLike
) -> np.ndarray:
    """Smooth bumps (raised cosines) that come and go, added up.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Rising instants.
    start_s, duration_s : array-like, shape (m,)
        When each bump begins and how long it lasts, seconds.
    peak : array-like, shape (m, k)
        Height at its middle.

    Returns
    -------
    ndarray, shape (n, k)
    """
    heights = np.asarray(peak, dtype=float)
    total = np.zeros((len(time_s), heights.shape[-1]))
    for begin_s, length_s, height in zip(np.asarray(start_s), np.asarray(duration_s), heights, strict=True):
        rows = slice(*np.searchsorted(time_s, (begin_s, begin_s + length_s)))
        phase = (time_s[rows] - begin_s) / length_s
        total[rows] += np.multiply.outer(np.sin(np.pi * phase) ** 2, height)
    return total


def poisson_events(rng: np.random.Generator, rate_hz: float, duration_s: float) -> np.ndarray:
    """Instants of a Poisson process, rising, seconds.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of the draws.
    rate_hz : float
        Mean number of events in a second.
    duration_s : float
        Length of the record.

    Returns
    -------
    ndarray, shape (m,)
    """
    return np.sort(rng.uniform(0.0, duration_s, rng.poisson(rate_hz * duration_s)))
