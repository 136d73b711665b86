r"""Reliability of each carrier phase of an epoch: what slip could hide in it, and what it would do.

With right integers a phase of antenna a and satellite s is

    phase - lambda N = h . (R l_a) + c_s + t_ag + e

Every c_s and t_ag is eliminated, which is the adjustment of all double differences with their full
covariance. Two stages are looked at:

    attitude    the unknown is the rotation alone; the body coordinates of the antennas are known
    vectors     the unknowns are the vectors between the antennas, each as the phases give it

The first sees far more: what contradicts the shape of the array contradicts the model. A blunder that passes
the tests of the second moves the attitude by the same gain. A slip of one cycle is safe where the minimal
detectable blunder is below one.

References
----------
W. Baarda, "A testing procedure for use in geodetic networks", Netherlands Geodetic Commission 2/5 (1968);
C. Wang, G. Lachapelle, "GPS attitude determination reliability performance improvement using low cost
receivers", Journal of Global Positioning Systems 1 (2002); P. J. G. Teunissen, "Minimal detectable biases of
GPS data", Journal of Geodesy 72 (1998).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...errors import ConfigError
from ...rotations import skew
from ..vectors import angle_jacobian
from .linear import LinearModel
from .protection import protection_level
from .settings import ReliabilitySettings

__all__ = ["PhaseReliability", "phase_model", "phase_reliability"]

RANK = 1e-9
"""Singular values of the eliminated columns below this share of the largest are the known rank defects."""


@dataclass(frozen=True, slots=True, eq=False)
class PhaseReliability:
    """Reliability of the r phases of one epoch; rows without a phase are NaN.

    Parameters
    ----------
    stage : str
        ``attitude`` or ``vectors``.
    settings : ReliabilitySettings
        What was demanded.
    dof : int
        Degrees of freedom of the global test.
    statistic, limit : float
        Global test with its limit; NaN without integers.
    w : ndarray, shape (r,)
        Standardised test of each phase; NaN without integers.
    residual_m, estimated_m : ndarray, shape (r,)
        Residual, and estimated blunder of this phase alone.
    redundancy : ndarray, shape (r,)
        Redundancy numbers; their sum is `dof`, of a filter less by what the prediction takes.
    mdb_m, mdb_cyc : ndarray, shape (r,)
        Minimal detectable blunder; infinite where none can be seen.
    external_rad : ndarray, shape (r, 3)
        Its effect on heading, pitch and roll.
    bias_to_noise : ndarray, shape (r,)
        Its squared effect on the unknowns of the stage, in units of their noise.
    sd_rad : ndarray, shape (3,)
        Standard deviations of heading, pitch and roll from all phases.
    protection_rad : ndarray, shape (3,)
        Protection levels with each antenna, and each satellite and signal, at fault in turn.
    protection_state : ndarray of uint8, shape (3,)
        Codes of `truenorth.attitude.reliability.ProtectionState`.
    """

    stage: str
    settings: ReliabilitySettings
    dof: int
    statistic: float
    limit: float
    w: np.ndarray
    residual_m: np.ndarray
    estimated_m: np.ndarray
    redundancy: np.ndarray
    mdb_m: np.ndarray
    mdb_cyc: np.ndarray
    external_rad: np.ndarray
    bias_to_noise: np.ndarray
    sd_rad: np.ndarray
    protection_rad: np.ndarray
    protection_state: np.ndarray

    @property
    def hides_a_cycle(self) -> np.ndarray:
        """Ndarray of bool, shape (r,): phases in which a slip of one cycle is below the detectable."""
        return self.mdb_cyc > 1.0

    @property
    def is_flagged(self) -> np.ndarray:
        """Ndarray of bool, shape (r,): phases whose w exceeds its limit and the screen."""
        flagged = np.abs(self.w) > self.settings.rejection_limit
        if self.settings.mdb_screen == "innovation":
            flagged &= np.abs(self.residual_m) > self.mdb_m
        return flagged


def phase_model(epoch, rot_ned_from_body, *, stage="attitude", prior_cov_rad2=None):
    """Linear model of an epoch's phases with satellite constants and clocks eliminated.

    Parameters
    ----------
    epoch : ArrayEpoch
        Rows of all antennas; those without a phase take no part.
    rot_ned_from_body : ndarray, shape (3, 3)
        Attitude.
    stage : str
        ``attitude`` or ``vectors``.
    prior_cov_rad2 : ndarray, shape (s, s), optional
        Covariance of a filter's prediction, whose first three states are the small rotation; then the
        model is that of its update, with the prediction as an observation of the attitude.

    Returns
    -------
    model : LinearModel
        One model of the rows with a phase. Unknowns are the small rotation in north, east, down, in either
        stage: its gain is that from all phases through the known shape of the array.
    rows : ndarray of int64
        Rows with a phase.
    through : ndarray
        What the unknowns of the stage take of the weight of each row: the diagonal of C^-1 - M, the
        eliminated unknowns left out.

    Raises
    ------
    ConfigError
        The stage is unknown.
    """
    if stage not in ("attitude", "vectors"):
        raise ConfigError(
            f"`stage` is {stage!r}, which is neither attitude nor vectors; give one of them",
            key="stage",
            value=stage,
        )
    rows = np.flatnonzero(np.isfinite(epoch.phase_m) & np.isfinite(epoch.phase_variance_m2))
    antenna, h = epoch.antenna[rows], epoch.design_ned[rows]
    cov = np.diag(epoch.phase_variance_m2[rows])
    if epoch.position_sd_m > 0.0 and stage == "attitude":
        # An antenna misplaced by d shifts its phases by h . d; of the vectors it is part of what is sought.
        cov = cov + epoch.position_sd_m**2 * (antenna[:, None] == antenna) * (h @ h.T)
    factor = np.linalg.inv(np.linalg.cholesky(cov))
    _, clock = np.unique(antenna + epoch.n_antennas * epoch.group[rows], return_inverse=True)
    nuisance = np.hstack([_indicator(epoch.satellite[rows]), _indicator(clock)])
    free = _projector(factor @ nuisance)
    turn = np.einsum("ri,rij->rj", h, -skew(epoch.positions_body_m[antenna] @ rot_ned_from_body.T))
    prior = np.zeros((3, 3)) if prior_cov_rad2 is None else np.linalg.inv(np.asarray(prior_cov_rad2)[:3, :3])
    gain, cov_turn, test = _adjust(factor, free, turn, prior)
    weight = factor.T @ factor
    clear = factor.T @ free @ factor
    if stage == "vectors":
        antennas = _indicator(antenna)
        positions = (antennas[:, :, None] * h[:, None, :]).reshape(len(rows), -1)
        test = _adjust(factor, free, positions, None)[2]
        rank = np.linalg.matrix_rank(free @ factor @ positions, tol=1e-7 * np.abs(factor).max())
    else:
        rank = 3 if prior_cov_rad2 is None else 0
    dof = round(float(np.trace(free))) - rank
    model = LinearModel(cov[None], weight[None], test[None], gain[None], cov_turn[None], dof)
    return model, rows, np.diag(clear - test).copy()


def phase_reliability(
    epoch, rot_ned_from_body, integers=None, *, stage="attitude", settings=None, prior_cov_rad2=None
):
    """Internal and external reliability of every phase of an epoch.

    Parameters
    ----------
    epoch : ArrayEpoch
        Rows of all antennas.
    rot_ned_from_body : ndarray, shape (3, 3)
        Attitude.
    integers : ndarray, shape (r,), optional
        Ambiguities of the rows, cycles; without them nothing is tested, but all else is known.
    stage : str
        ``attitude``: the unknown is the rotation; ``vectors``: the vectors between the antennas.
    settings : ReliabilitySettings, optional
        What is demanded.
    prior_cov_rad2 : ndarray, shape (s, s), optional
        Covariance of a filter's prediction, `rot_ned_from_body`: the reliability is that of its update.

    Returns
    -------
    PhaseReliability
    """
    settings = ReliabilitySettings() if settings is None else settings
    rot = np.asarray(rot_ned_from_body, dtype=float)
    model, rows, through = phase_model(epoch, rot, stage=stage, prior_cov_rad2=prior_cov_rad2)
    n = len(epoch.antenna)
    delta0 = settings.delta0
    angles = angle_jacobian(rot[None])

    def whole(values):
        out = np.full((n, *np.shape(values)[1:]), np.nan)
        out[rows] = values
        return out

    mdb = model.mdb(delta0)[0]
    effect = np.abs(LinearModel.external(_in_angles(model, angles), delta0)[0]).T
    statistic, w, residual, estimated = np.nan, np.full(len(rows), np.nan), np.full(len(rows), np.nan), None
    if integers is not None:
        antenna = epoch.antenna[rows]
        computed = np.einsum("ri,ri->r", epoch.design_ned[rows], epoch.positions_body_m[antenna] @ rot.T)
        carried = epoch.wavelength_m[rows] * np.asarray(integers, dtype=float)[rows]
        misclosure = (epoch.phase_m[rows] - carried - computed)[None]
        statistic, w = float(model.statistic(misclosure)[0]), model.local(misclosure)[0]
        residual = np.einsum("ij,jk,k->i", model.cov[0], model.test[0], misclosure[0])
    estimated = np.where(np.isfinite(mdb), w * np.where(np.isfinite(mdb), mdb, 0.0) / delta0, 0.0)
    seen = through > RANK * np.diag(model.weight[0])
    ratio = np.where(seen, np.where(np.isfinite(mdb), mdb, 1.0) ** 2 * through, 0.0)
    ratio = np.where(seen & ~np.isfinite(mdb), np.inf, ratio)
    sd, level, state = _protection(epoch, rows, model, angles, settings)
    return PhaseReliability(
        stage=stage,
        settings=settings,
        dof=model.dof,
        statistic=statistic,
        limit=settings.limit(model.dof),
        w=whole(w),
        residual_m=whole(residual),
        estimated_m=whole(estimated),
        redundancy=whole(model.redundancy[0]),
        mdb_m=whole(mdb),
        mdb_cyc=whole(mdb / epoch.wavelength_m[rows]),
        external_rad=whole(effect),
        bias_to_noise=whole(ratio),
        sd_rad=sd,
        protection_rad=level,
        protection_state=state,
    )


def _protection(epoch, rows, model, angles, settings):
    """Protection levels with each antenna and each satellite at fault."""
    sd = np.sqrt(np.einsum("eau,euv,eav->ea", angles, model.cov_unknowns, angles))
    separation, limit, prior = [], [], []
    bound = settings.limit(model.dof)
    for number, each in ((epoch.antenna, settings.fault_prior), (epoch.satellite, settings.satellite_prior)):
        for value in np.unique(number[rows]):
            own = np.flatnonzero(number[rows] == value)
            faults = model.faults(np.eye(len(rows))[:, own][:, None, :])
            separation.append(np.sqrt(faults.separation_variance(angles)[:, :, 0]))
            limit.append(np.minimum(bound, settings.limit(int(faults.rank[0, 0]))))
            prior.append(each)
    level, state = protection_level(
        sd, np.stack(separation, axis=-1), np.array(prior), np.array(limit)[None],
        risk=settings.integrity_risk, wrong_integer_risk=settings.wrong_integer_risk,
    )  # fmt: skip
    return sd[0], level[0], state[0]


def _in_angles(model, angles):
    """The same model with heading, pitch and roll as unknowns."""
    cov = angles @ model.cov_unknowns @ np.swapaxes(angles, 1, 2)
    return LinearModel(model.cov, model.weight, model.test, angles @ model.gain, cov, model.dof)


def _indicator(number):
    """Columns of ones, one for each different number."""
    return (number[:, None] == np.unique(number)).astype(float)


def _projector(columns):
    """What is left of white rows when columns, possibly dependent ones, are eliminated."""
    u, size, _ = np.linalg.svd(columns, full_matrices=False)
    u = u[:, size > RANK * size.max()]
    return np.eye(len(columns)) - u @ u.T


def _adjust(factor, free, design, prior):
    """Gain, covariance and test matrix of an adjustment after the elimination.

    `prior` is the information on the unknowns from elsewhere, none for unknowns with a rank defect.
    """
    white = free @ factor @ design
    if prior is None:
        cov, gain = None, np.linalg.pinv(white, rcond=1e-7)
    else:
        cov = np.linalg.inv(white.T @ white + prior)
        gain = cov @ white.T
    test = factor.T @ (free - white @ gain) @ factor
    return gain @ factor, cov, 0.5 * (test + test.T)
