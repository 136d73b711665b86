"""Integers of all baselines of a rigid array at once, with the body geometry inside the search.

Objective of the integers N of one epoch, up to a constant (Teunissen 2012; Giorgi et al. 2012):

    C(N) = min over R in SO(3) of the weighted square sum of all rows,

every satellite constant and clock eliminated: the weighted residuals of the adjustment of the attitude with
the integers known, less those of the codes alone. The body coordinates enter as they are, lengths,
angles and handedness, and are never linearised;
where they are uncertain, the vectors R l + d deviate from them by d of the covariance that the coordinates
have. Found is the exact optimum and every candidate within a margin of it (see the compiled search).

The posterior probability integrates each candidate over its attitude by the curvature at the minimum
(Laplace), all attitudes equally likely beforehand. Antennas on one line leave the turn about the line free;
three satellites may leave the mirror image of an attitude as likely as itself: then nothing is accepted.

References: Teunissen 2012, J. Geodesy 86:41-54; Giorgi, Teunissen, Verhagen & Buist 2012, J. Guidance,
Control, Dynamics 35:51-67; Teunissen 2010, J. Geodesy 84:433-447.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..errors import Reason, Status
from .acceptance import chi2_quantile
from .array_model import ArrayEpoch

__all__ = ["JointResolution", "resolve_joint"]

SUCCESS_PROBABILITY = 0.999
"""Demanded posterior probability of integers and attitude together."""

POSTERIOR_MARGIN = 24.0
"""Candidates this much costlier than the best weigh less than 7e-6 and are left out of the posterior."""

REACH = 400.0
"""Objective above which a candidate is of no interest; such residuals belong to no model of noise."""

MAX_NODES = 20_000_000


@dataclass(frozen=True, slots=True, eq=False)
class JointResolution:
    """What the joint search found in one epoch.

    Parameters
    ----------
    status : Status
        `Status.FIXED` when accepted, `Status.FLOAT` when there is a winner that is not, else `Status.NONE`.
    reason : Reason
        Why.
    integers_cyc : ndarray of int64, shape (n,)
        Winner's integers of each row, up to constants of satellites and clocks: 0 at the rows that fix
        these, and at rows without phase.
    rot_ned_from_body : ndarray, shape (3, 3)
        Its attitude; NaN without one. Of antennas on one line the most level one.
    cov_rad2 : ndarray, shape (3, 3)
        Covariance of a small rotation of the attitude, in the frame north, east, down; a turn about the
        line of antennas on one line is not in it.
    rank : int
        Directions that the antennas span: 1 leaves the turn about their line free.
    objective, second_objective : float
        Least cost and the next (or the least that it can be).
    success_probability : float
        Posterior probability of the integers.
    attitude_share : float
        Share of the attitude in it, where the same integers have another one.
    chi2, chi2_limit, dof : float, float, int
        Residual test: the cost, its limit, and its degrees of freedom.
    n_candidates, n_nodes : int
        Candidates within the margin; nodes and checks of the search.
    candidates_cyc : ndarray of int64, shape (k, n)
        The best candidates, best first.
    candidate_cost, candidate_log_volume : ndarray, shape (k,)
        Their costs, and the logarithm of the volume of attitudes each has.
    complete_to : float
        Cost up to which none is missing.
    """

    status: Status
    reason: Reason
    integers_cyc: np.ndarray
    rot_ned_from_body: np.ndarray
    cov_rad2: np.ndarray
    rank: int
    objective: float
    second_objective: float
    success_probability: float
    attitude_share: float
    chi2: float
    chi2_limit: float
    dof: int
    n_candidates: int
    n_nodes: int
    candidates_cyc: np.ndarray
    candidate_cost: np.ndarray
    candidate_log_volume: np.ndarray
    complete_to: float


def resolve_joint(
    epoch: ArrayEpoch,
    *,
    use_code=True,
    success_probability=SUCCESS_PROBABILITY,
    residual_significance=1e-4,
    prior_rot=None,
    prior_information=None,
    candidates=0,
    margin=POSTERIOR_MARGIN,
    max_nodes=MAX_NODES,
) -> JointResolution:
    """Resolve the integers of one epoch of an array, all baselines together.

    Parameters
    ----------
    epoch : ArrayEpoch
        Rows of all antennas; two antennas are enough, and none need have all satellites.
    use_code : bool
        Whether pseudoranges take part.
    success_probability : float
        Posterior probability demanded, of integers and attitude.
    residual_significance : float
        False-alarm rate of the chi-square test of the winner.
    prior_rot, prior_information : ndarray, shape (3, 3), optional
        Attitude known beforehand, and the information on a small rotation of it in north, east, down,
        1/rad^2. An axis known better than the other two together counts as these do together.
    candidates : int
        How many of the best candidates to return.
    margin : float
        How far beyond the best candidates count for the posterior probability.
    max_nodes : int
        Nodes and checks after which the search stops, unfinished.

    Returns
    -------
    JointResolution
    """
    from .._kernels import joint_search as kernel

    n = len(epoch.antenna)
    integers = np.zeros(n, np.int64)
    rot, cov = np.empty((3, 3)), np.empty((3, 3))
    row = np.empty(kernel.N_COLUMNS)
    listed = np.zeros((candidates, n), np.int64)
    cost, volume = np.zeros(candidates), np.zeros(candidates)
    has_prior = prior_rot is not None and prior_information is not None
    reason = Reason(
        kernel.search_array(
            *(_integers(a) for a in (epoch.antenna, epoch.satellite, epoch.group)),
            _floats(epoch.phase_m),
            _floats(epoch.code_m) if use_code else np.full(n, np.nan),
            *(
                _floats(a)
                for a in (
                    epoch.design_ned,
                    epoch.wavelength_m,
                    epoch.phase_variance_m2,
                    epoch.code_variance_m2,
                    epoch.positions_body_m,
                )
            ),
            float(epoch.position_sd_m),
            _floats(prior_rot) if has_prior else np.eye(3),
            _floats(prior_information) if has_prior else np.zeros((3, 3)),
            float(margin),
            REACH,
            int(max_nodes),
            integers,
            rot,
            cov,
            row,
            listed,
            cost,
            volume,
        )
    )
    best = float(row[kernel.COST])
    probability, share = float(row[kernel.PROBABILITY]), float(row[kernel.ATTITUDE_SHARE])
    dof = int(row[kernel.DOF]) if math.isfinite(row[kernel.DOF]) else 0
    limit = chi2_quantile(residual_significance, dof, upper=True) if dof > 0 else math.nan
    status = Status.FLOAT if math.isfinite(best) else Status.NONE
    if reason is Reason.OK:
        if dof > 0 and best > limit:
            reason = Reason.RESIDUAL_TEST
        elif not probability * share >= success_probability:
            reason = Reason.PROBABILITY_TEST
        else:
            status = Status.FIXED
    k = int(row[kernel.N_LISTED])
    return JointResolution(
        status=status,
        reason=reason,
        integers_cyc=integers,
        rot_ned_from_body=rot,
        cov_rad2=cov,
        rank=int(row[kernel.RANK]) if math.isfinite(row[kernel.RANK]) else 0,
        objective=best,
        second_objective=float(row[kernel.SECOND_COST]),
        success_probability=probability,
        attitude_share=share,
        chi2=best,
        chi2_limit=float(limit),
        dof=dof,
        n_candidates=int(row[kernel.N_CANDIDATES]),
        n_nodes=int(row[kernel.N_NODES]),
        candidates_cyc=listed[:k],
        candidate_cost=cost[:k],
        candidate_log_volume=np.log(volume[:k]),
        complete_to=float(row[kernel.COMPLETE_TO]),
    )


def _integers(values):
    """Contiguous int64, as the kernel takes them."""
    return np.ascontiguousarray(values, dtype=np.int64)


def _floats(values):
    """Contiguous, writable float64, as the kernel takes them."""
    values = np.ascontiguousarray(values, dtype=np.float64)
    return values if values.flags.writeable else values.copy()
