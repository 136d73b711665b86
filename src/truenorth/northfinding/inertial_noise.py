r"""Noise of velocities in an inertial frame: shaking, and the random walks of the sensors.

Let m be velocities felt less those expected, averaged over intervals of length T, along a horizontal axis. Of
a constant attitude and velocity error they hold a straight line, which second differences remove; what is
left of three independent noises is a moving average over three intervals:

* shaking, white with the variance :math:`s_k` of each mean;
* accelerometer noise of density :math:`N_a`, integrated once;
* gyro noise of density :math:`N_g`, which tilts the force of gravity g, integrated twice.

Their autocovariances at lags of 0, 1 and 2 intervals are those of B-splines,

.. math::
    s\,(6, -4, 1),\qquad N_a^2 T\,(1, -\tfrac13, -\tfrac16),\qquad
    g^2 N_g^2 T^3\,(\tfrac{66}{120}, \tfrac{26}{120}, \tfrac1{120}),

those at the start of the record, where both walks are zero, follow from the same integrals.

So the covariance of a whole record is a band of five diagonals. Its Cholesky factor turns measurements one by
one into independent ones of unit variance, each from earlier ones only: running sums of their products are
generalised least squares at every instant, for the cost of plain least squares. The same factor gives the
likelihood of the three variances (restricted: line and parabola are taken out).

References
----------
Unser, M., "Splines: a perfect fit for signal and image processing", IEEE Signal Processing Magazine 16
(1999) 22-38 (autocorrelation of B-splines).
Patterson, H. D., Thompson, R., "Recovery of inter-block information when block sizes are unequal",
Biometrika 58 (1971) 545-554 (restricted likelihood).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..sensors.processes import gauss_markov_mean_covariance

__all__ = [
    "VelocityNoise",
    "bump_factors",
    "drift_covariances",
    "estimate_noise",
    "ramble_covariance",
    "walk_covariance",
    "whiten",
]

_ACCELEROMETER = (np.array([2.0, 4.0, 6.0]) / 6.0, np.array([1.0, -3.0, -2.0]) / 6.0, -1.0 / 6.0)
_GYRO = (np.array([6.0, 92.0, 66.0]) / 120.0, np.array([19.0, 27.0, 26.0]) / 120.0, 1.0 / 120.0)
"""Diagonal and the two beside it, for unit variance; the last number of each goes on."""

BUMP_SD = 4.0
"""An interval that departs from its neighbours by more standard deviations than this was a bump."""
BUMP_NEIGHBOURS = 5
"""On each side."""
LEAST_USUAL_MPS = 1e-9
"""Below it there is only rounding."""
MOST_FACTOR = 1e3
"""Beyond it the interval counts for nothing anyway."""

_RATIOS = np.linspace(-3.0, 4.0, 5)
"""Variance by accelerometer noise over that by shaking, as tried, decades; the least is as good as none."""
_GYRO_RATIOS = np.linspace(-8.0, 2.0, 6)
"""Variance by gyro noise over that by the other two, as tried, decades; the least is as good as none."""
_NEGLIGIBLE = 8.0
"""What is less likely than the best by this logarithm is left out."""
_FINER = 7
"""How many of each are tried over what is left."""
_ZOOMS = 2


@dataclass(frozen=True, slots=True)
class VelocityNoise:
    """Noise of mean velocities.

    Parameters
    ----------
    interval_s : float
        Over which velocities are averaged.
    shaking_mps : float
        Standard deviation of each mean.
    velocity_walk_mps_per_sqrt_s : float
        Accelerometer noise.
    angle_walk_rad_per_sqrt_s : float
        Gyro noise.
    """

    interval_s: float
    shaking_mps: float
    velocity_walk_mps_per_sqrt_s: float
    angle_walk_rad_per_sqrt_s: float

    def variances(self, gravity_mps2: float) -> tuple[float, float, float]:
        """Factors of the three autocovariances, (m/s)^2."""
        return (
            self.shaking_mps**2,
            self.velocity_walk_mps_per_sqrt_s**2 * self.interval_s,
            (gravity_mps2 * self.angle_walk_rad_per_sqrt_s) ** 2 * self.interval_s**3,
        )


def _differences(rows: np.ndarray) -> np.ndarray:
    """The first row, the first difference, then second differences, shape (n, ...)."""
    result = np.array(rows, dtype=float)
    result[1:] -= rows[:-1]
    result[2:] -= rows[1:-1] - rows[:-2]
    return result


def _shaking_band(variance: np.ndarray) -> np.ndarray:
    """Covariance of `_differences` of independent rows of these variances, by diagonals, shape (3, n)."""
    first, second = np.full(len(variance), -2.0), np.ones(len(variance))
    first[:2] = 0.0, -1.0
    second[:2] = 0.0
    before = np.concatenate([[0.0], variance[:-1]])
    before2 = np.concatenate([[0.0, 0.0], variance[:-2]])
    band = np.zeros((3, len(variance)))
    band[0] = variance + first**2 * before + second**2 * before2
    band[1, :-1] = (first * before)[1:] + (second * before2)[1:] * first[:-1]
    band[2, :-2] = before2[2:]
    return band


def _walk_band(start: tuple[np.ndarray, np.ndarray, float], number: int) -> np.ndarray:
    """Covariance of `_differences` of a walk that is zero where the record starts, by diagonals."""
    own, beside, last = start
    band = np.empty((3, number))
    band[0], band[1], band[2] = own[-1], beside[-1], last
    band[0, : len(own)], band[1, : len(beside)] = own, beside
    return band


def _factor(shaking_band: np.ndarray, accelerometer: float, gyro: float) -> np.ndarray:
    """Cholesky factor of the covariance of `_differences` with both walks, by diagonals, shape (3, n)."""
    from scipy.linalg.lapack import dpbtrf

    number = shaking_band.shape[1]
    band = shaking_band + accelerometer * _walk_band(_ACCELEROMETER, number)
    return np.asarray(dpbtrf(band + gyro * _walk_band(_GYRO, number), lower=1)[0])


def _solved(factor: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Rows that the factor turns into those given."""
    from scipy.linalg.lapack import dtbtrs

    return np.asarray(dtbtrs(factor, rows, uplo="L")[0])


def whiten(columns: np.ndarray, noise: VelocityNoise, gravity_mps2: float, factors: np.ndarray) -> np.ndarray:
    """Columns as seen through the noise: their errors independent and of unit variance.

    Parameters
    ----------
    columns : ndarray, shape (n, m)
        Mean velocities, or what they are to be fitted by.
    noise : VelocityNoise
        Their noise.
    gravity_mps2 : float
        Gravity.
    factors : ndarray, shape (n,)
        How much the variance of the shaking exceeds the usual in each interval.

    Returns
    -------
    ndarray, shape (n, m)
        Row k depends on rows up to k only.
    """
    shaking, accelerometer, gyro = noise.variances(gravity_mps2)
    return _solved(_factor(_shaking_band(shaking * factors), accelerometer, gyro), _differences(columns))


def walk_covariance(noise: VelocityNoise, gravity_mps2: float, number: int) -> np.ndarray:
    """Covariance of mean velocities with the slope that the gyros' random walk has reached after all of them.

    It is the same for every later instant too, which makes it a column to `whiten`: with it the estimate of
    that slope is a running sum.

    Parameters
    ----------
    noise : VelocityNoise
        The noise.
    gravity_mps2 : float
        Gravity.
    number : int
        How many means.

    Returns
    -------
    ndarray, shape (number,)
        (m/s)(m/s^2).
    """
    k = np.arange(number)
    density = (gravity_mps2 * noise.angle_walk_rad_per_sqrt_s) ** 2
    return np.asarray(density * noise.interval_s**2 * (1.0 / 6.0 + 0.5 * k * (k + 1.0)))


def bump_factors(residual_mps: np.ndarray) -> np.ndarray:
    """How much more than usual each interval was shaken.

    Parameters
    ----------
    residual_mps : ndarray, shape (n, k)
        Mean velocities less those expected; slow changes do not matter.

    Returns
    -------
    ndarray, shape (n,)
        Factor of the variance: 1 but where an interval departs from the median of its neighbours by more than
        `BUMP_SD` of the usual departures.
    """
    n = len(residual_mps)
    width = min(2 * BUMP_NEIGHBOURS + 1, n)
    half = width // 2
    first = np.clip(np.arange(n) - half, 0, n - width)
    member = first[:, None] + np.arange(width)
    rows = residual_mps[member]
    # A line through each neighbourhood, by medians: its slope from halves, its height where the interval is.
    slope = np.median(rows[:, width - half :] - rows[:, :half], axis=1) / (width - half)
    away = (member - np.arange(n)[:, None])[:, :, None]
    departure = residual_mps - np.median(rows - slope[:, None, :] * away, axis=1)
    usual = 1.4826 * np.median(np.abs(departure), axis=0)
    relative = np.max(np.abs(departure) / np.maximum(usual, LEAST_USUAL_MPS), axis=1)
    return np.clip(relative / BUMP_SD, 1.0, MOST_FACTOR) ** 2


def _zoomed(decades: np.ndarray, likely: np.ndarray) -> np.ndarray:
    """Finer steps over what is likely and one step beyond on each side."""
    where = np.flatnonzero(likely)
    return np.linspace(decades[max(where[0] - 1, 0)], decades[min(where[-1] + 1, len(decades) - 1)], _FINER)


def _log_likelihood(
    rows: np.ndarray, shaking_band: np.ndarray, ratio: float, gyro_ratio: float
) -> tuple[float, float]:
    """Restricted log-likelihood of two ratios, and the variance of the shaking that goes with them.

    Of the rows, `_differences` all, the first three columns are the trend.
    """
    n, axes = len(rows), rows.shape[1] - 3
    factor = _factor(shaking_band, ratio, gyro_ratio * (1.0 + ratio))
    white = _solved(factor, rows)
    products = white.T @ white
    lower = np.linalg.cholesky(products[:3, :3])
    trend = np.linalg.solve(lower, products[:3, 3:])
    freedom = axes * (n - 3)
    variance = float(np.trace(products[3:, 3:]) - np.sum(trend**2)) / freedom
    logs = float(np.sum(np.log(factor[0])) + np.sum(np.log(np.diag(lower))))
    return -0.5 * freedom * np.log(variance) - axes * logs, variance


def estimate_noise(
    residual_mps: np.ndarray,
    interval_s: float,
    gravity_mps2: float,
    factors: np.ndarray,
    *,
    angle_walk_rad_per_sqrt_s: float | None = None,
    velocity_walk_mps_per_sqrt_s: float = 0.0,
) -> VelocityNoise:
    """Noise that the residuals of a fit show, by likelihood.

    Parameters
    ----------
    residual_mps : ndarray, shape (n, k)
        Horizontal mean velocities less those expected; lines and parabolas in them do not matter.
    interval_s : float
        Over which they are averaged.
    gravity_mps2 : float
        Gravity.
    factors : ndarray, shape (n,)
        Of `bump_factors`.
    angle_walk_rad_per_sqrt_s : float, optional
        Of the gyros, where it is known; else it is estimated too, which short records hardly allow.
    velocity_walk_mps_per_sqrt_s : float
        The least there is of accelerometer noise.

    Returns
    -------
    VelocityNoise
        Of each its mean standard deviation by the likelihood, every order of magnitude of the ratios being as
        likely beforehand.
    """
    time = np.linspace(-1.0, 1.0, len(residual_mps))
    # Legendre's line and parabola, and residuals without them: sums of squares lose no digits then.
    trend = np.stack([np.ones_like(time), time, 1.5 * time**2 - 0.5], axis=1)
    basis = np.linalg.qr(trend)[0]
    rows = _differences(np.hstack([trend, residual_mps - basis @ (basis.T @ residual_mps)]))
    shaking_band = _shaking_band(factors)

    def tried(ratios: np.ndarray, gyro_ratios: np.ndarray) -> np.ndarray:
        return np.array(
            [[_log_likelihood(rows, shaking_band, 10.0**a, 10.0**b) for b in gyro_ratios] for a in ratios]
        )

    ratios, gyro_ratios = _RATIOS, _GYRO_RATIOS
    surface = tried(ratios, gyro_ratios)
    for _ in range(_ZOOMS):
        likely = surface[..., 0] > surface[..., 0].max() - _NEGLIGIBLE
        ratios, gyro_ratios = _zoomed(ratios, likely.any(axis=1)), _zoomed(gyro_ratios, likely.any(axis=0))
        surface = tried(ratios, gyro_ratios)
    weight = np.exp(surface[..., 0] - surface[..., 0].max())
    shaking_sd = np.sqrt(surface[..., 1])
    ratio_sd, gyro_ratio_sd = 10.0 ** (0.5 * ratios[:, None]), 10.0 ** (0.5 * gyro_ratios)
    shaking, accelerometer, gyro = (
        float(np.sum(weight * sd) / weight.sum())
        for sd in (
            shaking_sd,
            shaking_sd * ratio_sd,
            shaking_sd * gyro_ratio_sd * np.sqrt(1.0 + ratio_sd**2),
        )
    )
    if angle_walk_rad_per_sqrt_s is None:
        angle_walk_rad_per_sqrt_s = gyro / interval_s**1.5 / gravity_mps2
    velocity_walk = max(accelerometer / np.sqrt(interval_s), velocity_walk_mps_per_sqrt_s)
    return VelocityNoise(interval_s, shaking, float(velocity_walk), angle_walk_rad_per_sqrt_s)


def drift_covariances(response: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """Covariance that slow drifts leave: Gauss-Markov processes of unit variance.

    Parameters
    ----------
    response : ndarray, shape (k, a, 3)
        Error of the attitude by a mean in each part of the record, for each of the axes.
    ratio : ndarray, shape (m,)
        Duration of the record over the time constant.

    Returns
    -------
    ndarray, shape (m, 3, 3)
    """
    parts = len(response)
    lag = np.abs(np.subtract.outer(np.arange(parts), np.arange(parts)))
    correlation = gauss_markov_mean_covariance(lag, np.asarray(ratio)[:, None, None] / parts)
    return np.einsum("iap,mij,jaq->mpq", response, correlation, response, optimize=True)


def ramble_covariance(response: np.ndarray) -> np.ndarray:
    """Covariance that a random walk leaves, which starts with the record and has unit variance at its end.

    Parameters
    ----------
    response : ndarray, shape (k, a, 3)
        Error of the attitude by a mean in each part of the record, for each of the axes.

    Returns
    -------
    ndarray, shape (3, 3)
    """
    parts = len(response)
    middle = (np.arange(parts) + 0.5) / parts
    # A walk covaries with itself later as with itself; within a part its mean lags by a sixth of the part.
    shared = np.minimum.outer(middle, middle) - np.eye(parts) / (6.0 * parts)
    return np.asarray(np.einsum("iap,ij,jaq->pq", response, shared, response, optimize=True))
