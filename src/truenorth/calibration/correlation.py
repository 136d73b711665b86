r"""How much a mean of correlated epochs is worth.

An estimate l = sum_k u_k of contributions of epochs has the variance

    var l = N g_0 (1 + 2 sum_j (1 - j / N) r_j)

with the variance g_0 of the contributions and their autocorrelation r_j. The sum ends where the
autocorrelation has vanished: before the first pair of lags with a negative sum (Geyer 1992). Taking the mean
off lowers the whole sample autocorrelation by the variance of the mean; that is put back.

References
----------
C. J. Geyer, "Practical Markov chain Monte Carlo", Statistical Science 7 (1992); B. J. McMillan et al., "GPS
attitude determination error analysis", Proc. ION GPS (1994), for the shape of attitude errors: white noise
and a Markov process of minutes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..timescales import NS_PER_S

__all__ = ["Correlation", "correlation_of", "markov_inflation"]

MAX_SHARE = 3
"""Correlation is followed over at most this part (one third) of a run."""


class Correlation(NamedTuple):
    """Correlation in time of what epochs contribute.

    Parameters
    ----------
    inflation : float
        By how much the variance of the mean exceeds that of independent epochs.
    time_s : float
        Integrated correlation time: epochs this far apart count as independent; 0 where neighbours do.
    is_resolved : bool
        Whether the correlation vanished within the part of the run that was looked at.
    """

    inflation: float
    time_s: float
    is_resolved: bool


def correlation_of(contribution, time_ns):
    """Correlation in time of contributions of epochs, pooled over their components.

    Parameters
    ----------
    contribution : ndarray, shape (n, q)
        Of each epoch, mean near zero.
    time_ns : ndarray of int64, shape (n,)
        Increasing; gaps may be in it.

    Returns
    -------
    Correlation
    """
    n = len(time_ns)
    size = np.sqrt(np.mean(contribution**2, axis=0))
    known = size > 1e-6 * size.max(initial=0.0)
    if n < 8 or not known.any():
        return Correlation(1.0, 0.0, True)
    white = contribution[:, known] / size[known]
    step_ns = float(np.median(np.diff(time_ns)))
    slot = np.rint((time_ns - time_ns[0]) / step_ns).astype(np.int64)
    if slot[-1] > 50 * n:  # a few epochs here and there: no grid holds them
        return Correlation(1.0, 0.0, True)
    length = int(slot[-1]) + 1
    grid, mask = np.zeros((length, white.shape[1])), np.zeros(length)
    grid[slot], mask[slot] = white, 1.0
    lags = max(length // MAX_SHARE, 2)
    width = 1 << int(length + lags).bit_length()
    power = np.abs(np.fft.rfft(grid, width, axis=0)) ** 2
    products = np.fft.irfft(power.mean(1), width)[:lags]
    pairs = np.rint(np.fft.irfft(np.abs(np.fft.rfft(mask, width)) ** 2, width)[:lags])
    # Divided by the pairs there are, times the share of pairs in a full run: a gap is not a decay.
    acf = products / np.maximum(pairs, 1.0)
    acf = acf / acf[0]
    end, is_resolved = lags, False
    for lag in range(1, lags - 1, 2):
        if acf[lag] + acf[lag + 1] < 0.0:
            end, is_resolved = lag, True
            break
    weight = 2.0 * pairs[1:end] / n
    inflation = 1.0 + weight @ acf[1:end]
    # The mean that was taken off carries this share of each lag.
    taken = (1.0 + weight.sum()) / n
    inflation = inflation / max(1.0 - taken, 0.25)
    inflation = float(max(inflation, 1.0))
    time_s = inflation * step_ns / NS_PER_S if inflation > 1.0 else 0.0
    return Correlation(inflation, time_s, is_resolved)


def markov_inflation(time_ns, correlation_s):
    """What a declared correlation time does to the variance of a mean of epochs.

    Parameters
    ----------
    time_ns : ndarray of int64, shape (n,)
        Epochs.
    correlation_s : float
        Time in which the correlation falls to 1/e, seconds.

    Returns
    -------
    float
        1 + 2 sum_j (1 - j / n) exp(-j dt / tau), 1 or more.
    """
    n = len(time_ns)
    if n < 2 or correlation_s <= 0.0:
        return 1.0
    step_s = float(np.median(np.diff(time_ns))) / NS_PER_S
    lag = np.arange(1, n)
    return float(1.0 + 2.0 * np.sum((1.0 - lag / n) * np.exp(-lag * step_s / correlation_s)))
