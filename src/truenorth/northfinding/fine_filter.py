r"""The filter of the fine alignment: forward pass, backward pass, and where the final error comes from.

The displacement of a platform that stays about its place is zero but for the shaking, whose variance R is
that of the measurement. Where the platform has been moved, its new place is the new zero, and only the
velocity is carried over; so it is where an innovation is beyond any chance.

Backwards go two adjoint recursions over the same gains. The one of Bryson and Frazier gives the attitude at
every edge from all of the record, without the inverse of a covariance. The other follows the error of the
final attitude back to every noise that went in; with :math:`W_k` the derivative of the final error by the
error at edge k, noise of covariance q adds :math:`W_k\,q\,W_k^T`, and the sums by source add up to the
covariance of the filter.

References
----------
Bryson, A. E., Frazier, M., "Smoothing for linear and nonlinear dynamic systems", Proc. Optimum System
Synthesis Conf., TDR-ASD-63-119 (1963) 353-364.
Maybeck, P. S., Stochastic Models, Estimation, and Control 1 (1979), sec. 6.8 (error budgets).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..rotations import skew
from .fine_model import N_CORE, ErrorModel, Nominal

__all__ = ["FilterPass", "attitude_sources", "filter_errors", "smooth_attitude"]

_PLACE = slice(6, 9)

NOTHING, MEASURED, PLACED = 0, 1, 2
"""What was done at an edge: nothing, displacement measured, new place taken for zero."""

MOVED = 30.0
"""Normalised squared innovation beyond which the platform must have been moved; by chance 1 in 700 000."""


@dataclass(frozen=True, slots=True, eq=False)
class FilterPass:
    """What a forward pass leaves.

    Parameters
    ----------
    state : ndarray, shape (k + 1, n)
        Estimated errors of the nominal trajectory at the edges, after what was measured there.
    var : ndarray, shape (k + 1, n)
        Their variances.
    attitude_cov : ndarray, shape (k + 1, 3, n)
        Covariance of the attitude with every state.
    cov : ndarray, shape (n, n)
        Covariance at the end.
    action : ndarray of int, shape (k + 1,)
        What was done at each edge.
    nis : ndarray, shape (k + 1,)
        Normalised squared innovation, 3 degrees of freedom, also of a measurement that was refused; NaN
        where there was none.
    innovation, weight, gain : ndarray, shapes (k + 1, 3), (k + 1, 3, 3), (k + 1, n, 3)
        Of the measurements, the weight being the inverse of the innovation's covariance; zero where there
        was none.
    displacement_var : ndarray, shape (k + 1, 3)
        Variance of the measurements, north, east, down.
    drive : ndarray, shape (k, 9, n - 9)
        Of the transition, for the backward passes.
    """

    state: np.ndarray
    var: np.ndarray
    attitude_cov: np.ndarray
    cov: np.ndarray
    action: np.ndarray
    nis: np.ndarray
    innovation: np.ndarray
    weight: np.ndarray
    gain: np.ndarray
    displacement_var: np.ndarray
    drive: np.ndarray


def _replace(model: ErrorModel) -> np.ndarray:
    """Transition to a new zero of the displacement: u = v + w x r counts from the new place."""
    return skew(model.site.earth_rate_ned_radps)


def filter_errors(
    model: ErrorModel, nominal: Nominal, action: np.ndarray, displacement_var: np.ndarray
) -> FilterPass:
    """Estimate the errors of a nominal trajectory.

    Parameters
    ----------
    model : ErrorModel
        States and noises.
    nominal : Nominal
        Trajectory.
    action : ndarray of int, shape (k + 1,)
        What to do at each edge.
    displacement_var : ndarray, shape (k + 1, 3)
        Variance of the displacement of the shaken platform at the edges, north, east, down, m^2.

    Returns
    -------
    FilterPass
    """
    n, number = model.n, len(action)
    core, decay, drive = model.core, model.decay, model.drive(nominal)
    core_noise, rest_noise = model.process_cov
    decay2 = np.outer(decay, decay)
    noises = displacement_var[:, :, None] * np.eye(3)
    mover = np.empty((N_CORE, n))
    mover[:, :N_CORE] = core
    rest_diagonal = np.arange(N_CORE, n)
    turning = _replace(model)

    state, var = np.zeros((number, n)), np.empty((number, n))
    attitude_cov, gains = np.empty((number, 3, n)), np.zeros((number, n, 3))
    innovation, weights = np.zeros((number, 3)), np.zeros((number, 3, 3))
    nis, action = np.full(number, np.nan), action.copy()
    cov, x = model.start_cov.copy(), np.zeros(n)
    # Biases are known to be near zero, not near what was taken off.
    x[model.slices["gyro bias"]] = -nominal.gyro_bias_radps
    x[model.slices["accelerometer bias"]] = -nominal.accel_bias_mps2
    for k in range(number):
        if k:
            mover[:, N_CORE:] = drive[k - 1]
            moved = mover @ cov
            x[:N_CORE] = mover @ x
            x[N_CORE:] *= decay
            cov[:N_CORE, :N_CORE] = moved @ mover.T + core_noise
            cov[:N_CORE, N_CORE:] = moved[:, N_CORE:] * decay
            cov[N_CORE:, :N_CORE] = cov[:N_CORE, N_CORE:].T
            cov[N_CORE:, N_CORE:] *= decay2
            cov[rest_diagonal, rest_diagonal] += rest_noise
        if action[k] == MEASURED:
            weight = np.linalg.inv(cov[_PLACE, _PLACE] + noises[k])
            y = nominal.displacement_m[k] - x[_PLACE]
            nis[k] = y @ weight @ y
            if nis[k] > MOVED:
                action[k] = PLACED
            else:
                gain = cov[:, _PLACE] @ weight
                x = x + gain @ y
                cov = cov - gain @ cov[_PLACE]
                cov = 0.5 * (cov + cov.T)
                innovation[k], weights[k], gains[k] = y, weight, gain
        if action[k] == PLACED:
            x[3:6] += turning @ (nominal.displacement_m[k] - x[_PLACE])
            cov[3:6] -= turning @ cov[_PLACE]
            cov[:, 3:6] -= cov[:, _PLACE] @ turning.T
            x[_PLACE] = nominal.displacement_m[k]
            cov[_PLACE] = 0.0
            cov[:, _PLACE] = 0.0
            cov[_PLACE, _PLACE] = noises[k]
        state[k], var[k], attitude_cov[k] = x, np.diag(cov), cov[:3]
    return FilterPass(
        state, var, attitude_cov, cov, action, nis, innovation, weights, gains, displacement_var, drive
    )


def smooth_attitude(model: ErrorModel, forward: FilterPass) -> tuple[np.ndarray, np.ndarray]:
    """Attitude errors of the nominal trajectory at every edge from all of the record.

    Parameters
    ----------
    model : ErrorModel
        States and noises.
    forward : FilterPass
        What the forward pass left.

    Returns
    -------
    error_rad : ndarray, shape (k + 1, 3)
        Small rotations in north, east, down.
    cov_rad2 : ndarray, shape (k + 1, 3, 3)
        Their covariances.
    """
    n, number = model.n, len(forward.action)
    core, decay, decay2 = model.core, model.decay, np.outer(model.decay, model.decay)
    slope, curve = np.zeros(n), np.zeros((n, n))
    error, cov = np.empty((number, 3)), np.empty((number, 3, 3))
    turning = _replace(model)
    mover = np.empty((N_CORE, n))
    mover[:, :N_CORE] = core
    for k in range(number - 1, -1, -1):
        own = forward.attitude_cov[k]
        error[k] = forward.state[k, :3] - own @ slope
        cov[k] = own[:, :3] - own @ curve @ own.T
        if forward.action[k] == MEASURED:
            gain = forward.gain[k]
            inverse = forward.weight[k]
            slope[_PLACE] -= gain.T @ slope + inverse @ forward.innovation[k]
            # As a product: the same as a difference is not stable where little was known yet.
            rest = np.eye(n)
            rest[:, _PLACE] -= gain
            curve = rest.T @ curve @ rest
            curve[_PLACE, _PLACE] += inverse
            curve = 0.5 * (curve + curve.T)
        elif forward.action[k] == PLACED:
            curve[_PLACE] = 0.0
            curve[:, _PLACE] = 0.0
            slope[_PLACE] = -turning.T @ slope[3:6]
            curve[_PLACE] = -turning.T @ curve[3:6]
            curve[:, _PLACE] = -curve[:, 3:6] @ turning
        if k:
            mover[:, N_CORE:] = forward.drive[k - 1]
            slope_core, curve_core = slope[:N_CORE].copy(), mover.T @ curve[:N_CORE]
            rest = curve[N_CORE:, N_CORE:] * decay2
            lower = decay[:, None] * (curve[N_CORE:, :N_CORE] @ mover)
            slope = np.concatenate([np.zeros(N_CORE), decay * slope[N_CORE:]]) + mover.T @ slope_core
            curve = curve_core[:, :N_CORE] @ mover
            curve[N_CORE:] += lower
            curve[:, N_CORE:] += lower.T
            curve[N_CORE:, N_CORE:] += rest
    return error, cov


def attitude_sources(model: ErrorModel, forward: FilterPass) -> dict[str, np.ndarray]:
    """Covariance of the final attitude by source.

    Parameters
    ----------
    model : ErrorModel
        States and noises.
    forward : FilterPass
        What the forward pass left.

    Returns
    -------
    dict of str to ndarray, shape (3, 3)
        By the names of `ErrorModel.sources`, and ``shaking``; their sum is the covariance of the filter.
    """
    n, number = model.n, len(forward.action)
    turning = _replace(model)
    weight = np.zeros((3, n))
    weight[:, :3] = np.eye(3)
    # Derivative of the final error by the process noise of each interval, and by each measurement.
    by_noise, by_place = np.zeros((number, 3, n)), np.zeros((number, 3, 3))
    for k in range(number - 1, -1, -1):
        if forward.action[k] == MEASURED:
            by_place[k] = weight @ forward.gain[k]
            weight[:, _PLACE] -= by_place[k]
        elif forward.action[k] == PLACED:
            by_place[k] = weight[:, _PLACE]
            weight[:, _PLACE] = -weight[:, 3:6] @ turning
        by_noise[k] = weight
        if k:
            core = weight[:, :N_CORE]
            before = np.empty((3, n))
            before[:, :N_CORE] = core @ model.core
            before[:, N_CORE:] = core @ forward.drive[k - 1] + weight[:, N_CORE:] * model.decay
            weight = before
    start, later = by_noise[0], by_noise[1:]
    out = {}
    core_rows = later[:, :, :N_CORE]
    for source in model.sources:
        cov = (start * source.start_var) @ start.T
        if np.any(source.process_var):
            rest = later[:, :, N_CORE:]
            cov = cov + np.einsum("kin,n,kjn->ij", rest, source.process_var, rest, optimize=True)
        if source.core is not None:
            cov = cov + np.einsum("kim,mn,kjn->ij", core_rows, source.core, core_rows, optimize=True)
        out[source.name] = cov
    out["shaking"] = np.einsum("kin,kn,kjn->ij", by_place, forward.displacement_var, by_place, optimize=True)
    return out
