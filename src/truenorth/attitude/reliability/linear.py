r"""Reliability of linear models: what a test sees, what may hide from it, and what that does to the unknowns.

Both the adjustment of an epoch and the update of a filter map a misclosure y (observed less computed) to
corrections of the unknowns by a gain K, and test it by a matrix M that weighs what contradicts:

    least squares    Q = (A^T C^-1 A)^-1,       K = Q A^T C^-1,         M = C^-1 - C^-1 A Q A^T C^-1
    filter           C_v = H P H^T + R,         K = P H^T C_v^-1,       M = C_v^-1

A fault of the shape F d (one observation: F a unit vector; a vector with wrong integers: three columns) has

    statistic        T = (F^T M y)^T (F^T M F)^-1 (F^T M y)  ~  chi2(q, d^T F^T M F d)
    estimate         d = (F^T M F)^-1 F^T M y
    minimal detectable blunder       delta0 / sqrt(F^T M F)               (q = 1)
    effect on the unknowns           K F d
    bias to noise    d^T F^T (C^-1 - M) F d        = (K F d)^T Q^-1 (K F d), of the filter with its P+.

The filter's are those of least squares that take the prediction for an observation; C stands for R. The
redundancy number of an observation is (M C)_ii: the share of its error that its residual shows.

References
----------
W. Baarda, "A testing procedure for use in geodetic networks", Netherlands Geodetic Commission 2/5 (1968);
P. J. G. Teunissen, "Testing theory: an introduction", Delft (2000); C. Wang, G. Lachapelle, "GPS attitude
determination reliability performance improvement using low cost receivers", Journal of Global Positioning
Systems 1 (2002), eqs. 11-15.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["FaultShape", "LinearModel", "filter_model", "least_squares_model"]

BLIND = 1e-9
"""A direction in which a test sees less than this share of the weight of the observations sees nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class LinearModel:
    """A stack of e models of r observations and u unknowns.

    Parameters
    ----------
    cov : ndarray, shape (e, r, r)
        Covariance of the observations.
    weight : ndarray, shape (e, r, r)
        Inverse of `cov`.
    test : ndarray, shape (e, r, r)
        M.
    gain : ndarray, shape (e, u, r)
        K.
    cov_unknowns : ndarray, shape (e, u, u)
        Covariance of the unknowns after the observations.
    dof : int
        Of the global test.
    """

    cov: np.ndarray
    weight: np.ndarray
    test: np.ndarray
    gain: np.ndarray
    cov_unknowns: np.ndarray
    dof: int

    @property
    def redundancy(self) -> np.ndarray:
        """Ndarray, shape (e, r): redundancy numbers; their sum is `dof` for least squares."""
        return np.einsum("eij,eji->ei", self.test, self.cov)

    @property
    def cov_residual(self) -> np.ndarray:
        """Ndarray, shape (e, r, r): covariance of the residuals after the adjustment or update."""
        return self.cov @ self.test @ self.cov

    def statistic(self, misclosure):
        """Global test of misclosures, shape (e, r): ndarray, shape (e,)."""
        return np.einsum("ei,eij,ej->e", misclosure, self.test, misclosure)

    def local(self, misclosure):
        """Standardised w of every observation for misclosures, shape (e, r): ndarray, shape (e, r)."""
        own = np.einsum("eii->ei", self.test)
        return _ratio(np.einsum("eij,ej->ei", self.test, misclosure), np.sqrt(_seen(own, self._own_weight)))

    def mdb(self, delta0):
        """Minimal detectable blunder of each observation: ndarray, shape (e, r); infinite where none is."""
        return _ratio(delta0, np.sqrt(_seen(np.einsum("eii->ei", self.test), self._own_weight)), np.inf)

    def external(self, delta0):
        """Effect of each minimal detectable blunder on the unknowns: ndarray, shape (e, u, r).

        Infinite where a blunder is not detectable and reaches the unknown, 0 where it does not.
        """
        return _product(self.mdb(delta0)[:, None, :], self.gain, np.sqrt(self._scale()))

    def bias_to_noise(self, delta0):
        """Squared effect of each minimal detectable blunder in units of the noise: ndarray, shape (e, r)."""
        through = self._own_weight - np.einsum("eii->ei", self.test)
        through = np.where(through > BLIND * self._own_weight, through, 0.0)
        return _product(self.mdb(delta0) ** 2, through, 0.0)

    def faults(self, shape):
        """Faults that have a shape.

        Parameters
        ----------
        shape : ndarray, shape (r, f, q) or (e, r, f, q)
            Columns of f faults with q dimensions each.

        Returns
        -------
        FaultShape
        """
        shape = np.broadcast_to(shape, (len(self.test), *shape.shape[-3:]))
        seen = np.einsum("erfp,ers,esfq->efpq", shape, self.test, shape, optimize=True)
        weight = np.einsum("erfp,ers,esfq->efpq", shape, self.weight, shape, optimize=True)
        gain = np.einsum("eur,erfq->eufq", self.gain, shape)
        value, axis = np.linalg.eigh(seen)
        own = np.einsum("efpi,efpq,efqi->efi", axis, weight, axis, optimize=True)
        value = np.where(value > BLIND * own, value, 0.0)
        return FaultShape(shape, self, seen, weight, gain, value, axis)

    @property
    def _own_weight(self):
        return np.einsum("eii->ei", self.weight)

    def _scale(self):
        """Effect on an unknown that is nothing, by that of its noise; squared, shape (e, u, 1)."""
        return BLIND * np.einsum("euu->eu", self.cov_unknowns)[:, :, None] * self._own_weight[:, None, :]


@dataclass(frozen=True, slots=True, eq=False)
class FaultShape:
    """Faults of f shapes with q dimensions in each of e models; made by `LinearModel.faults`.

    Parameters
    ----------
    shape : ndarray, shape (e, r, f, q)
        F.
    model : LinearModel
        To which they belong.
    seen : ndarray, shape (e, f, q, q)
        F^T M F, the information about the fault.
    weight : ndarray, shape (e, f, q, q)
        F^T C^-1 F, what it would be if the unknowns were known.
    gain : ndarray, shape (e, u, f, q)
        K F.
    value, axis : ndarray, shape (e, f, q) and (e, f, q, q)
        Principal axes of `seen`; values of axes that nothing is seen of are 0.
    """

    shape: np.ndarray
    model: LinearModel
    seen: np.ndarray
    weight: np.ndarray
    gain: np.ndarray
    value: np.ndarray
    axis: np.ndarray

    @property
    def rank(self) -> np.ndarray:
        """Ndarray of int, shape (e, f): dimensions of the fault that can be seen."""
        return np.count_nonzero(self.value, axis=-1)

    def statistic(self, misclosure):
        """Test of each fault for misclosures, shape (e, r): ndarray, shape (e, f), chi-square of `rank`."""
        rhs = np.einsum("erfq,ers,es->efq", self.shape, self.model.test, misclosure, optimize=True)
        along = np.einsum("efpi,efp->efi", self.axis, rhs)
        return np.sum(_ratio(along**2, self.value), axis=-1)

    def estimate(self, misclosure):
        """Estimated faults for misclosures, shape (e, r): ndarray, shape (e, f, q); 0 along blind axes."""
        rhs = np.einsum("erfq,ers,es->efq", self.shape, self.model.test, misclosure, optimize=True)
        along = _ratio(np.einsum("efpi,efp->efi", self.axis, rhs), self.value)
        return np.einsum("efpi,efi->efp", self.axis, along)

    def local(self, misclosure):
        """Standardised w of each single dimension for misclosures, shape (e, r): ndarray, shape (e, f, q)."""
        rhs = np.einsum("erfq,ers,es->efq", self.shape, self.model.test, misclosure, optimize=True)
        return _ratio(rhs, np.sqrt(self._own()))

    def mdb(self, delta0):
        """Minimal detectable blunder of each single dimension: ndarray, shape (e, f, q)."""
        return _ratio(delta0, np.sqrt(self._own()), np.inf)

    def external(self, delta0):
        """Effect of those blunders on the unknowns: ndarray, shape (e, u, f, q)."""
        scale = np.einsum("euu->eu", self.model.cov_unknowns)[:, :, None, None]
        scale = scale * np.einsum("efqq->efq", self.weight)[:, None]
        return _product(self.mdb(delta0)[:, None], self.gain, np.sqrt(BLIND * scale))

    def bias_to_noise(self, delta0):
        """Squared effect of those blunders in units of the noise: ndarray, shape (e, f, q)."""
        own = np.einsum("efqq->efq", self.weight)
        through = own - np.einsum("efqq->efq", self.seen)
        return _product(self.mdb(delta0) ** 2, np.where(through > BLIND * own, through, 0.0), 0.0)

    def worst_mdb(self, delta0):
        """Largest fault, over all its directions, of the detectable non-centrality: ndarray, shape (e, f)."""
        return _ratio(delta0, np.sqrt(self.value.min(axis=-1)), np.inf)

    def separation_variance(self, rows):
        """Variance of the difference between linear functions of the unknowns with and without the fault.

        Parameters
        ----------
        rows : ndarray, shape (e, a, u)
            The functions.

        Returns
        -------
        ndarray, shape (e, a, f)
            g (F^T M F)^-1 g^T with g = rows K F; infinite where a blind direction reaches the function. Times
            a non-centrality it is the square of the largest effect of a fault with it.
        """
        through = np.einsum("eau,eufq->eafq", rows, self.gain)
        along = np.einsum("eafq,efqi->eafi", through, self.axis) ** 2
        variance = np.einsum("eau,euv,eav->ea", rows, self.model.cov_unknowns, rows, optimize=True)
        own = np.einsum("efpi,efpq,efqi->efi", self.axis, self.weight, self.axis, optimize=True)
        nothing = BLIND * variance[:, :, None, None] * own[:, None]
        value = np.broadcast_to(self.value[:, None], along.shape)
        return np.sum(
            np.where((value == 0.0) & (along <= nothing), 0.0, _ratio(along, value, np.inf)), axis=-1
        )

    def _own(self):
        """Information about each single dimension, 0 where it is blind."""
        return _seen(np.einsum("efqq->efq", self.seen), np.einsum("efqq->efq", self.weight))


def least_squares_model(design, cov):
    """Adjustment of observations y = A x + e.

    Parameters
    ----------
    design : ndarray, shape (e, r, u)
        A, of full column rank.
    cov : ndarray, shape (e, r, r)
        C.

    Returns
    -------
    LinearModel
    """
    weight = _symmetric(np.linalg.inv(cov))
    normal_gain = np.swapaxes(design, 1, 2) @ weight
    cov_unknowns = _symmetric(np.linalg.inv(normal_gain @ design))
    gain = cov_unknowns @ normal_gain
    test = _symmetric(weight - np.swapaxes(normal_gain, 1, 2) @ gain)
    return LinearModel(cov, weight, test, gain, cov_unknowns, design.shape[1] - design.shape[2])


def filter_model(design, cov, prior_cov):
    """Update of a filter with observations y = H x + e.

    Parameters
    ----------
    design : ndarray, shape (e, r, u)
        H. Further states which the observations do not contain may be left out of it: then `prior_cov`
        has more rows than H columns, and these come first.
    cov : ndarray, shape (e, r, r)
        R.
    prior_cov : ndarray, shape (e, s, s)
        P of the prediction, s >= u.

    Returns
    -------
    LinearModel
        With the gain of all s states.
    """
    extra = prior_cov.shape[-1] - design.shape[-1]
    if extra:
        design = np.concatenate([design, np.zeros((*design.shape[:2], extra))], axis=2)
    weight = _symmetric(np.linalg.inv(cov))
    spread = prior_cov @ np.swapaxes(design, 1, 2)
    test = _symmetric(np.linalg.inv(design @ spread + cov))
    gain = spread @ test
    cov_unknowns = _symmetric(prior_cov - gain @ np.swapaxes(spread, 1, 2))
    return LinearModel(cov, weight, test, gain, cov_unknowns, design.shape[1])


def _symmetric(matrix):
    return 0.5 * (matrix + np.swapaxes(matrix, 1, 2))


def _seen(value, weight):
    """Information, 0 where rounding is all there is of it."""
    return np.where(value > BLIND * weight, value, 0.0)


def _ratio(top, bottom, otherwise=0.0):
    """Quotient, and another value where the divisor is 0."""
    bottom = np.asarray(bottom)
    return np.where(bottom > 0.0, top / np.where(bottom > 0.0, bottom, 1.0), otherwise)


def _product(size, factor, nothing):
    """Product in which an infinite size times a factor of nothing is 0."""
    return np.where(np.abs(factor) <= nothing, 0.0, np.where(np.isinf(size), 1.0, size) * factor) * np.where(
        np.isinf(size) & (np.abs(factor) > nothing), np.inf, 1.0
    )
