"""Statistics of errors, and the consistency of errors with their stated covariance.

The normalised estimation error squared of an epoch, e^T P^-1 e, is chi-square distributed with as many
degrees of freedom as e has components when P is honest. Its mean over a run is compared with the
bounds of that distribution for the number of epochs that count as independent: errors by multipath stay
alike for many epochs, so the autocorrelation of the normalised errors squared shortens the run.

References
----------
Y. Bar-Shalom, X. R. Li, T. Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001,
sec. 5.4; A. Sokal, "Monte Carlo methods in statistical mechanics", 1997 (integrated autocorrelation).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Consistency", "ErrorStatistics", "consistency_of", "effective_samples", "error_statistics"]

MAX_LAGS = 4096


@dataclass(frozen=True, slots=True)
class ErrorStatistics:
    """Statistics of one kind of error, in the unit of the errors.

    Parameters
    ----------
    n : int
        Errors that there were.
    mean, sd, rms : float
        Mean, standard deviation about it, root mean square; NaN without errors.
    p68, p95, p99, max : float
        Percentiles and largest of the absolute errors.
    """

    n: int
    mean: float
    sd: float
    rms: float
    p68: float
    p95: float
    p99: float
    max: float


def error_statistics(error: np.ndarray) -> ErrorStatistics:
    """Summarise errors.

    Parameters
    ----------
    error : ndarray, shape (n,)
        Errors; NaN counts as absent.

    Returns
    -------
    ErrorStatistics
    """
    error = np.asarray(error, dtype=float)
    error = error[np.isfinite(error)]
    if len(error) == 0:
        return ErrorStatistics(0, *[np.nan] * 7)
    size = np.abs(error)
    percentiles = np.quantile(size, [0.68, 0.95, 0.99])
    return ErrorStatistics(
        n=len(error),
        mean=float(np.mean(error)),
        sd=float(np.std(error, ddof=1)) if len(error) > 1 else 0.0,
        rms=float(np.sqrt(np.mean(error**2))),
        p68=float(percentiles[0]),
        p95=float(percentiles[1]),
        p99=float(percentiles[2]),
        max=float(np.max(size)),
    )


def effective_samples(values: np.ndarray) -> float:
    """Number of independent samples that determine a mean as well as these correlated ones.

    The run is divided by 1 + 2 times the sum of its autocorrelation, up to the first lag at which that is
    not positive.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Samples in time order.

    Returns
    -------
    float
        From 1 to n.
    """
    values = np.asarray(values, dtype=float)
    n = len(values)
    if n < 3:
        return float(n)
    off = values - np.mean(values)
    lags = min(n - 1, MAX_LAGS)
    spectrum = np.fft.rfft(off, 2 * n)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2)[: lags + 1]
    if not correlation[0] > 0.0:
        return 1.0
    correlation /= correlation[0]
    negative = np.flatnonzero(correlation <= 0.0)
    end = negative[0] if len(negative) else len(correlation)
    return float(np.clip(n / (1.0 + 2.0 * np.sum(correlation[1:end])), 1.0, n))


@dataclass(frozen=True, slots=True)
class Consistency:
    """Whether errors agree with their stated covariance.

    Parameters
    ----------
    nees : float
        Mean normalised error squared per degree of freedom; 1 is expected.
    lower, upper : float
        Its bounds at `confidence`, for the effective number of epochs.
    n, n_effective : int, float
        Epochs, and how many independent ones they count for.
    confidence : float
        Probability of the bounds.
    """

    nees: float
    lower: float
    upper: float
    n: int
    n_effective: float
    confidence: float

    @property
    def verdict(self) -> str:
        """str: ``consistent``, ``optimistic`` (errors larger than stated), ``pessimistic`` or ``unknown``."""
        if not np.isfinite(self.nees):
            return "unknown"
        if self.nees > self.upper:
            return "optimistic"
        return "pessimistic" if self.nees < self.lower else "consistent"


def consistency_of(nees: np.ndarray, dof: np.ndarray, *, confidence: float = 0.99) -> Consistency:
    """Compare normalised errors squared with their distribution.

    Parameters
    ----------
    nees : ndarray, shape (n,)
        Normalised error squared of each epoch, in time order.
    dof : ndarray of int, shape (n,)
        Components of each error.
    confidence : float
        Probability of the bounds.

    Returns
    -------
    Consistency
    """
    from scipy.stats import chi2

    known = np.isfinite(nees) & (dof > 0)
    nees, dof = nees[known], dof[known]
    if len(nees) == 0:
        return Consistency(np.nan, np.nan, np.nan, 0, 0.0, confidence)
    n_effective = effective_samples(nees / dof)
    freedom = float(np.mean(dof)) * n_effective
    lower, upper = chi2.ppf([0.5 * (1.0 - confidence), 0.5 * (1.0 + confidence)], freedom) / freedom
    return Consistency(
        nees=float(np.sum(nees) / np.sum(dof)),
        lower=float(lower),
        upper=float(upper),
        n=len(nees),
        n_effective=n_effective,
        confidence=confidence,
    )
