r"""Reliability of the attitude of an array, epoch by epoch: what its vectors could hide, and what that does.

The vectors b_i = R l_i + e_i are linear in a small turn p of the attitude, b_i - R l_i = -[R l_i]x p + e_i;
the covariance of e is that of the vectors and that of the body coordinates turned with the array. A wrong
integer, or anything else wrong with the phases of one antenna, shifts its vector by any amount in any
direction; of the antenna from which all vectors point it shifts them all alike, and that fault stands in its
column. So every antenna is tested, and which one is the reference plays no role.

An array on one line leaves the turn about it open: it is kept out of the unknowns, and roll out of the
results. Results of the filter take its prediction for an observation.

References
----------
C. Wang, G. Lachapelle, "GPS attitude determination reliability performance improvement using low cost
receivers", Journal of Global Positioning Systems 1 (2002), sec. on quality control; P. J. G. Teunissen, "The
affine constrained GNSS attitude model and its multivariate integer least-squares solution", Journal of
Geodesy 86 (2012).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...rotations import skew
from ..vector_methods import ALONG_X, MIN_ACROSS_M
from ..vectors import angle_jacobian, array_extent_m, total_covariance
from .linear import filter_model, least_squares_model
from .protection import ProtectionState, protection_level
from .settings import ReliabilitySettings

__all__ = [
    "AttitudeReliability",
    "antenna_shapes",
    "attitude_reliability",
    "filter_reliability",
]


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeReliability:
    """Reliability at n epochs of m antennas; NaN where an epoch has no attitude or an antenna no vector.

    Parameters
    ----------
    time_ns : ndarray of int64, shape (n,)
        GPS time.
    antennas : tuple of str
        Names.
    settings : ReliabilitySettings
        What was demanded.
    statistic, limit : ndarray, shape (n,)
        Global test and its limit.
    dof : ndarray of int64, shape (n,)
        Its degrees of freedom.
    w : ndarray, shape (n, m, 3)
        Standardised test of a shift of each antenna in north, east, down. Its limit is
        `ReliabilitySettings.rejection_limit`.
    estimated_m, residual_m : ndarray, shape (n, m, 3)
        Estimated shift of the antenna alone in that direction, and what the vector has more than computed
        after the adjustment (of a filter: before the update).
    antenna_statistic, antenna_limit : ndarray, shape (n, m)
        Test of a shift of an antenna in any direction.
    antenna_shift_m : ndarray, shape (n, m, 3)
        Estimated shift of the antenna.
    redundancy : ndarray, shape (n, m, 3)
        Redundancy numbers of the vectors' components; the reference has none.
    mdb_m : ndarray, shape (n, m, 3)
        Minimal detectable blunder of each component.
    antenna_mdb_m : ndarray, shape (n, m)
        Largest undetectable shift of the antenna, in its worst direction; infinite where one is not seen.
    external_rad : ndarray, shape (n, 3)
        Largest effect of a minimal detectable blunder of any component on heading, pitch and roll.
    antenna_external_rad : ndarray, shape (n, 3)
        Largest effect of an undetectable shift of any antenna in any direction.
    bias_to_noise : ndarray, shape (n, m, 3)
        Squared effect of the minimal detectable blunder on all angles in units of their noise.
    sd_rad : ndarray, shape (n, 3)
        Standard deviations of heading, pitch and roll.
    protection_rad : ndarray, shape (n, 3)
        Protection levels at `ReliabilitySettings.integrity_risk`, for epochs that pass the tests; infinite
        where there is none.
    protection_state : ndarray of uint8, shape (n, 3)
        Codes of `truenorth.attitude.reliability.ProtectionState`.
    wrong_integer_risk : ndarray, shape (n,)
        The probability of wrong integers that the levels allow for.
    """

    time_ns: np.ndarray
    antennas: tuple[str, ...]
    settings: ReliabilitySettings
    statistic: np.ndarray
    limit: np.ndarray
    dof: np.ndarray
    w: np.ndarray
    estimated_m: np.ndarray
    residual_m: np.ndarray
    antenna_statistic: np.ndarray
    antenna_limit: np.ndarray
    antenna_shift_m: np.ndarray
    redundancy: np.ndarray
    mdb_m: np.ndarray
    antenna_mdb_m: np.ndarray
    external_rad: np.ndarray
    antenna_external_rad: np.ndarray
    bias_to_noise: np.ndarray
    sd_rad: np.ndarray
    protection_rad: np.ndarray
    protection_state: np.ndarray
    wrong_integer_risk: np.ndarray

    @property
    def is_tested(self) -> np.ndarray:
        """Ndarray of bool, shape (n,): epochs with an attitude."""
        return np.isfinite(self.statistic)

    @property
    def is_passed(self) -> np.ndarray:
        """Ndarray of bool, shape (n,): epochs that pass the global and every antenna's test.

        The protection levels hold for these.
        """
        antenna = np.all(~(self.antenna_statistic > self.antenna_limit), axis=1)
        return self.is_tested & (self.statistic <= self.limit) & antenna

    @property
    def is_flagged(self) -> np.ndarray:
        """Ndarray of bool, shape (n, m, 3): components whose w exceeds its limit and the screen."""
        flagged = np.abs(self.w) > self.settings.rejection_limit
        if self.settings.mdb_screen == "innovation":
            flagged &= np.abs(self.residual_m) > self.mdb_m
        return flagged


def attitude_reliability(
    vectors, rot_ned_from_body, *, settings=None, is_used=None, wrong_integer_risk=None, fault_priors=None
):
    """Reliability of the adjustment of every epoch's vectors.

    Parameters
    ----------
    vectors : ArrayVectors
        Vectors of n epochs and their joint covariance.
    rot_ned_from_body : ndarray, shape (n, 3, 3)
        Adjusted attitude; NaN where there is none. Of antennas on one line any roll will do.
    settings : ReliabilitySettings, optional
        What is demanded.
    is_used : ndarray of bool, shape (n, m), optional
        Vectors on which the attitude rests; by default all that are there.
    wrong_integer_risk : float or ndarray, shape (n,), optional
        Probability that the integers are wrong, instead of that in the settings.
    fault_priors : ndarray, shape (m,), optional
        Prior probability of a fault of each antenna, instead of the one in the settings.

    Returns
    -------
    AttitudeReliability

    Examples
    --------
    >>> from truenorth.attitude.array_vectors import ArrayVectors
    >>> body = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    >>> sd = 0.005  # of each coordinate of each antenna; the first one's is in all vectors
    >>> cov = np.kron(np.eye(4) + 1.0, sd**2 * np.eye(3))[None]
    >>> zero = np.zeros(1, int)
    >>> vectors = ArrayVectors(zero, zero, body[None].copy(), cov, body, np.zeros((12, 12)))
    >>> vectors.vector_ned_m[0, 0] = np.nan
    >>> result = attitude_reliability(vectors, np.eye(3)[None])
    >>> np.round(1e3 * result.mdb_m[0, 1], 1).tolist()
    [26.1, 26.1, 41.3]
    >>> np.round(np.degrees(result.external_rad[0]), 3).tolist()
    [0.374, 1.184, 1.184]
    """
    return _all_blocks(vectors, rot_ned_from_body, None, settings, is_used, wrong_integer_risk, fault_priors)


def filter_reliability(
    vectors,
    rot_ned_from_body,
    prior_cov_rad2,
    *,
    settings=None,
    is_used=None,
    wrong_integer_risk=None,
    fault_priors=None,
):
    """Reliability of the update of an attitude filter by every epoch's vectors.

    Parameters
    ----------
    vectors : ArrayVectors
        Vectors of n epochs and their joint covariance.
    rot_ned_from_body : ndarray, shape (n, 3, 3)
        Predicted attitude; NaN where there is none.
    prior_cov_rad2 : ndarray, shape (n, s, s)
        Covariance of the prediction; its first three states are the small rotation in north, east, down
        of ``R = exp([p]x) R_predicted``, radians. The vectors contain no other state.
    settings, is_used, wrong_integer_risk, fault_priors
        As of `attitude_reliability`.

    Returns
    -------
    AttitudeReliability
        The tests are those of the innovations, and the effects those on the updated attitude.

    Notes
    -----
    A fault is one of this epoch: the levels take the prediction as free of faults, which a fault that grew
    unnoticed over epochs would contradict.
    """
    return _all_blocks(
        vectors,
        rot_ned_from_body,
        np.asarray(prior_cov_rad2),
        settings,
        is_used,
        wrong_integer_risk,
        fault_priors,
    )


def antenna_shapes(k):
    """Faults of the antennas of k vectors: of each one that a vector points to, and of the reference.

    Parameters
    ----------
    k : int
        Vectors.

    Returns
    -------
    ndarray, shape (3 k, k + 1, 3)
        The reference comes last: its shift is taken off every vector.
    """
    own = np.eye(3 * k).reshape(3 * k, k, 3)
    return np.concatenate([own, -np.tile(np.eye(3), (k, 1))[:, None]], axis=1)


def _all_blocks(vectors, rot, prior_cov, settings, is_used, wrong_integer_risk, fault_priors):
    """Fill the results block by block."""
    settings = ReliabilitySettings() if settings is None else settings
    n, m = vectors.vector_ned_m.shape[:2]
    risk = settings.wrong_integer_risk if wrong_integer_risk is None else wrong_integer_risk
    risk = np.broadcast_to(np.asarray(risk, dtype=float), (n,)).copy()
    prior = np.full(m, settings.fault_prior) if fault_priors is None else np.asarray(fault_priors, float)
    shapes = {
        "statistic": (n,), "limit": (n,), "w": (n, m, 3), "estimated_m": (n, m, 3), "residual_m": (n, m, 3),
        "antenna_statistic": (n, m), "antenna_limit": (n, m), "antenna_shift_m": (n, m, 3),
        "redundancy": (n, m, 3), "mdb_m": (n, m, 3), "antenna_mdb_m": (n, m), "external_rad": (n, 3),
        "antenna_external_rad": (n, 3), "bias_to_noise": (n, m, 3), "sd_rad": (n, 3),
        "protection_rad": (n, 3),
    }  # fmt: skip
    out = {name: np.full(shape, np.nan) for name, shape in shapes.items()}
    out["dof"] = np.zeros(n, np.int64)
    out["protection_state"] = np.full((n, 3), ProtectionState.NOT_SOLVED, np.uint8)
    out["protection_rad"][:] = np.inf
    names = vectors.names or tuple(str(k) for k in range(m))
    result = AttitudeReliability(vectors.time_ns, names, settings, wrong_integer_risk=risk, **out)
    present = vectors.is_present if is_used is None else is_used & vectors.is_present
    solved = np.isfinite(rot).all(axis=(1, 2))
    if prior_cov is not None:
        solved &= np.isfinite(prior_cov).all(axis=(1, 2))
    for block in vectors.blocks(present & solved[:, None]):
        cov = None if prior_cov is None else prior_cov[block.epochs]
        _fill(result, block, rot[block.epochs], cov, prior)
    return result


def _fill(result, block, rot, prior_cov, prior):
    """One block of epochs with the same antennas."""
    settings, at = result.settings, block.epochs
    fitted = np.einsum("eij,kj->eki", rot, block.body_m)
    misclosure = (block.vector_ned_m - fitted).reshape(len(at), -1)
    design = -skew(fitted).reshape(len(at), -1, 3)
    cov = total_covariance(block.cov_ned_m2, rot, block.body_cov_m2)
    angles = angle_jacobian(rot)
    _, across, axis = array_extent_m(block.body_m)
    is_line = prior_cov is None and across < MIN_ACROSS_M
    if is_line:
        # Turns about two axes across the line; the one about it is no unknown.
        basis = rot @ np.linalg.svd(axis[None])[2][1:].T
        design, angles = design @ basis, angles @ basis
    if prior_cov is None:
        model = least_squares_model(design, cov)
    else:
        model = filter_model(design, cov, prior_cov)
        angles = np.concatenate([angles, np.zeros((len(at), 3, prior_cov.shape[1] - 3))], axis=2)
    faults = model.faults(antenna_shapes(len(block.antennas)))
    antennas = np.append(block.antennas, block.reference)
    rows = np.ix_(at, antennas)
    delta0 = settings.delta0

    result.statistic[at], result.dof[at] = model.statistic(misclosure), model.dof
    result.limit[at] = settings.limit(model.dof)
    result.w[rows] = faults.local(misclosure)
    result.mdb_m[rows] = faults.mdb(delta0)
    result.estimated_m[rows] = (
        result.w[rows] * np.where(np.isinf(result.mdb_m[rows]), 0.0, result.mdb_m[rows]) / delta0
    )
    residual = (
        misclosure
        if prior_cov is not None
        else np.einsum("eij,ejk,ek->ei", model.cov, model.test, misclosure)
    )
    result.residual_m[np.ix_(at, block.antennas)] = residual.reshape(len(at), -1, 3)
    result.redundancy[np.ix_(at, block.antennas)] = model.redundancy.reshape(len(at), -1, 3)
    by_rank = np.array([settings.limit(q) for q in range(4)])
    limit = by_rank[faults.rank]
    result.antenna_statistic[rows], result.antenna_limit[rows] = faults.statistic(misclosure), limit
    result.antenna_shift_m[rows] = faults.estimate(misclosure)
    result.antenna_mdb_m[rows] = faults.worst_mdb(delta0)
    result.bias_to_noise[rows] = faults.bias_to_noise(delta0)
    effect = np.abs(_through(angles, faults.external(delta0)))
    result.external_rad[at] = effect.max(axis=(2, 3))
    separation = np.sqrt(faults.separation_variance(angles))
    result.antenna_external_rad[at] = delta0 * separation.max(axis=2)
    sd = np.sqrt(np.einsum("eau,euv,eav->ea", angles, model.cov_unknowns, angles))
    if is_line:
        # Only a line along the forward axis lets heading and pitch be told from the turn about it.
        lost = [2] if np.hypot(axis[1], axis[2]) < ALONG_X else [0, 1, 2]
        sd[:, lost] = np.nan
    # What both tests leave: the antenna's own, and the global one, of which it is a part.
    bound = np.minimum(limit, settings.limit(model.dof))
    level, state = protection_level(
        sd, separation, prior[antennas], bound, risk=settings.integrity_risk,
        wrong_integer_risk=result.wrong_integer_risk[at],
    )  # fmt: skip
    result.sd_rad[at], result.protection_rad[at], result.protection_state[at] = sd, level, state
    if is_line:
        for values in (result.external_rad, result.antenna_external_rad):
            values[np.ix_(at, lost)] = np.nan
        result.protection_state[np.ix_(at, lost)] = ProtectionState.NOT_OBSERVABLE


def _through(rows, effect):
    """Linear functions of effects on the unknowns, which may be infinite."""
    finite = np.isfinite(effect)
    plain = np.einsum("eau,eufq->eafq", rows, np.where(finite, effect, 0.0))
    # An unbounded unknown leaves every function of it unbounded.
    reaches = np.einsum("eau,eufq->eafq", np.abs(rows) > 1e-9, (~finite).astype(float))
    return np.where(reaches > 0.0, np.inf, plain)
