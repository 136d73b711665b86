"""Noises of an Allan variance: which a curve determines, how well, and bounds of the others.

See `truenorth.sensors.allan` for the model, the weighting and the references.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Literal

import numpy as np

from .processes import flicker_variance

__all__ = [
    "TERMS",
    "TOLERANCE",
    "Curve",
    "Kind",
    "NoiseFit",
    "ceiling_of",
    "edf_of_curve",
    "edf_of_noise",
    "fit_noises",
    "noise_basis",
]

Kind = Literal["gyro", "accelerometer"]

TERMS = ("quantisation", "random_walk", "bias_instability", "bias_walk", "drift")

DRIFT = 4
"""Place of the one term that is no noise."""

SIGNIFICANT = 12.0
"""Misfit, chi-square of one degree of freedom, that a noise must take away to be a number."""

ONE_SIDED_95 = 1.6449

TOLERANCE = 0.1
"""Real sensors keep the five laws to a tenth of the variance only; allowed where they miss them."""


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Measured variances of one axis at ``samples * interval_s``."""

    name: str
    kind: Kind
    variance: np.ndarray
    samples: np.ndarray
    interval_s: float
    n: int
    alike: float = 1.0
    """Number of axes that were averaged."""

    @classmethod
    def of(
        cls, name: str, kind: Kind, increments: np.ndarray, interval_s: float, samples: np.ndarray
    ) -> Curve:
        """Overlapping Allan variances of the increments of one axis."""
        import allantools

        # The mean is a constant rate, which no variance sees; without it the sum keeps its digits.
        phase = np.concatenate([[0.0], np.cumsum(increments - increments.mean())])
        _, deviation, _, _ = allantools.oadev(
            phase, rate=1.0 / interval_s, data_type="phase", taus=samples * interval_s
        )
        # Counts that only alternate have averages without any scatter; a logarithm needs a trace of it.
        variance = np.maximum(deviation, 1e-9 * deviation.max()) ** 2
        return cls(name, kind, variance, samples, interval_s, len(increments))

    @property
    def tau_s(self) -> np.ndarray:
        """ndarray: Averaging times."""
        return self.samples * self.interval_s

    @property
    def octaves(self) -> np.ndarray:
        """Which averaging times take part in the fit."""
        return np.flatnonzero(np.bitwise_and(self.samples, self.samples - 1) == 0)


@functools.lru_cache(maxsize=4096)
def edf_of_noise(alpha: int, differences: int, samples: int, n: int, modified: bool) -> float:
    """Degrees of freedom of a variance in one kind of noise (Greenhall and Riley 2003)."""
    from allantools.ci import edf_greenhall

    while True:
        try:
            edf = float(edf_greenhall(alpha, differences, samples, n + 1, True, modified))
            return max(edf, 1.0)
        except NotImplementedError:
            # Phase noise at the longest times, where it never rules.
            alpha -= 2


def edf_of_curve(curve: Curve, rows: np.ndarray, squares: np.ndarray) -> np.ndarray:
    """Degrees of freedom of variances in a sum of noises, which weigh by their shares."""
    shares = noise_basis(curve.tau_s[rows]) * squares
    # Drift is no noise: it takes no part.
    total = np.maximum(shares[:, :DRIFT].sum(axis=1), np.finfo(float).tiny)
    scatter = np.zeros(len(rows))
    for column, alpha in enumerate((2, 0, -1, -2)):
        edf = [edf_of_noise(alpha, 2, int(m), curve.n, False) for m in curve.samples[rows]]
        scatter += shares[:, column] / total / np.sqrt(edf)
    empty = shares[:, :DRIFT].sum(axis=1) <= 0.0
    if np.any(empty):
        white = [edf_of_noise(0, 2, int(m), curve.n, False) for m in curve.samples[rows][empty]]
        scatter[empty] = 1.0 / np.sqrt(white)
    return curve.alike / scatter**2


def noise_basis(tau_s: np.ndarray) -> np.ndarray:
    """Allan variance of each noise of coefficient 1, shape (k, 5)."""
    return np.stack(
        [3.0 / tau_s**2, 1.0 / tau_s, flicker_variance(tau_s, 1.0), tau_s / 3.0, tau_s**2 / 2.0], axis=1
    )


@functools.lru_cache(maxsize=8)
def _responses(interval_s: float, n: int, octaves: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights of a logarithmic grid of frequencies, spectra of the noises, responses of the variances."""
    tau_s = interval_s * 2.0 ** np.arange(octaves)
    frequency = np.geomspace(0.02 / (n * interval_s), 0.5 / interval_s, 2000)
    turn = 2.0 * np.pi * frequency
    spectra = np.stack(
        [
            8.0 * np.sin(0.5 * turn * interval_s) ** 2 / interval_s,
            np.full(len(turn), 2.0),
            1.0 / (2.0 * np.log(2.0) * frequency),
            2.0 / turn**2,
        ]
    )
    half = 0.5 * np.outer(tau_s, turn)
    response = 2.0 * np.sin(half) ** 4 / half**2
    return frequency, spectra, response


def _correlation(curve: Curve, octaves: int, squares: np.ndarray) -> np.ndarray:
    """Correlation between the variances at octaves, from the spectrum of the model."""
    frequency, spectra, response = _responses(curve.interval_s, curve.n, octaves)
    spectrum = (squares[:DRIFT] if np.any(squares[:DRIFT]) else np.array([0.0, 1.0, 0.0, 0.0])) @ spectra
    weighted = response * spectrum * np.sqrt(frequency)
    covariance = weighted @ weighted.T
    sd = np.sqrt(np.diag(covariance))
    correlation: np.ndarray = covariance / np.outer(sd, sd)
    return correlation


@dataclass(frozen=True, slots=True, eq=False)
class NoiseFit:
    """Squared coefficients with their sigmas, upper bounds, and the probability of the misfit."""

    squares: np.ndarray
    sd: np.ndarray
    bound: np.ndarray
    edf: np.ndarray
    misfit: float
    probability: float


def fit_noises(curve: Curve, tolerance: float) -> NoiseFit:
    """Noises that the curve determines; the others are left out and bounded one by one."""
    found = _adjust(curve, list(range(len(TERMS))), tolerance)
    while True:
        chosen = [k for k in range(len(TERMS)) if found.squares[k] > 0.0]
        if len(chosen) < 2:
            break
        without = [_adjust(curve, [k for k in chosen if k != left], tolerance) for left in chosen]
        least = min(without, key=lambda fit: fit.misfit)
        if chosen[-1] == DRIFT and without[-1].misfit <= found.misfit + SIGNIFICANT:
            # A walk within a record looks much like a drift; what a walk explains is none.
            least = without[-1]
        if least.misfit > found.misfit + SIGNIFICANT:
            break
        found = least
    bound = found.squares + ONE_SIDED_95 * found.sd
    for k in set(range(len(TERMS))) - set(chosen):
        with_it = _adjust(curve, sorted([*chosen, k]), tolerance)
        bound[k] = with_it.squares[k] + ONE_SIDED_95 * with_it.sd[k]
    return NoiseFit(found.squares, found.sd, bound, found.edf, found.misfit, found.probability)


def _adjust(curve: Curve, chosen: list[int], tolerance: float) -> NoiseFit:
    """Non-negative least squares of the relative misfit, weighted anew from each model."""
    from scipy.optimize import nnls
    from scipy.stats import chi2, norm

    rows = curve.octaves
    measured = curve.variance[rows]
    basis = noise_basis(curve.tau_s[rows])
    scale = np.max(measured[:, None] / basis, axis=0)
    scaled = (basis * scale)[:, chosen]
    # The first weights are those of white noise about the curve itself.
    squares, model = np.array([0.0, 1.0, 0.0, 0.0, 0.0]) * scale, measured
    for _ in range(20):
        edf = edf_of_curve(curve, rows, squares)
        sd = np.sqrt(2.0 / edf)
        correlation = _correlation(curve, len(rows), squares)
        covariance = correlation * np.outer(sd, sd)
        covariance[np.diag_indices(len(rows))] += tolerance**2 + 1e-6 * sd**2
        root = np.linalg.cholesky(covariance)
        design = np.linalg.solve(root, scaled / model[:, None])
        found, _ = nnls(design, np.linalg.solve(root, measured / model))
        previous, squares = squares, np.zeros(len(TERMS))
        squares[chosen] = found * scale[chosen]
        model = np.maximum(basis @ squares, 1e-6 * measured)
        if np.allclose(squares, previous, rtol=1e-3, atol=1e-9 * np.min(scale)):
            break
    spread = np.full(len(TERMS), np.inf)
    # By singular values: the normal matrix would square the spread of the weights.
    _, size, turn = np.linalg.svd(design, full_matrices=False)
    spread[chosen] = scale[chosen] * np.linalg.norm(turn.T / np.maximum(size, 1e-300), axis=1)
    # Chi-square variates as normal ones, so that few degrees of freedom raise no false alarm.
    above, below = chi2.sf(edf * measured / model, edf), chi2.cdf(edf * measured / model, edf)
    deviate = np.where(above < below, norm.isf(above), norm.ppf(below)).clip(-30.0, 30.0)
    share = sd / np.sqrt(sd**2 + tolerance**2)
    deviate *= share
    covariance = correlation * np.outer(share, share)
    covariance[np.diag_indices(len(rows))] += 1.0 - share**2 + 1e-6
    misfit = float(deviate @ np.linalg.solve(covariance, deviate))
    freedom = max(len(rows) - int(np.count_nonzero(squares)), 1)
    return NoiseFit(squares, spread, spread, edf, misfit, float(chi2.sf(misfit, freedom)))


def ceiling_of(variance: np.ndarray, edf: np.ndarray) -> np.ndarray:
    """What the variances are not above, with 95 % for all together."""
    from scipy.stats import chi2

    ceiling: np.ndarray = variance * edf / chi2.ppf(0.05 / len(variance), edf)
    return ceiling
