r"""North from a unit that is turned on a table: what stays with its axes is told from what stays with the Earth.

The Earth rate and gravity keep their directions in the Earth, the biases of the sensors theirs in the body. A
turn of the body separates them: after half a turn the mean of two readings holds the one, their difference
the other (two positions), any number of positions or a steady turn (carousel) does the same. Here all of
them are one least-squares problem, on blocks of the record of about a second.

With the attitude :math:`C_k` integrated from the gyros in a frame that was north, east, down at the start, and
:math:`E_k` the turn of the Earth since, the error of the integrated attitude at the k-th edge is

.. math:: \varphi_k = \varphi_0 + \sum_{j<k} \bar C_j\,e_j,

:math:`e_j` the error of the gyros over block j in body axes and :math:`\bar C_j` the mean attitude in it. What
ought to be zero and is observed:

* *force*: the horizontal part of the mean specific force around edge k, from second differences of the
  doubly integrated force, so that the velocity of a swaying platform averages out:
  :math:`E_k^T(\varphi_k\times f) + \dots`;
* *rest*, of a platform that stands still: the turn against the Earth over a block in a halt,
  :math:`E_{k+1}^T\varphi_{k+1} - E_k^T\varphi_k`, with what the Earth turns;
* *table*, where an encoder gives its angles: the turn about the axis, less what the encoder says.

Everything that is stated of the sensors (biases, scales, misalignments, sensitivity to force, noise, walk and
instability of the biases, lever arm, latitude) enters through the covariance of the observations, so the
estimate is the best linear one, the biases follow as conditional means, and the covariance of the attitude is
an exact sum over the sources: the error budget. The whitened observations are in order of time; their running
sums give the estimate after every block.

References
----------
Titterton, D. H., Weston, J. L., Strapdown Inertial Navigation Technology, 2nd ed. (2004), sec. 10.
Groves, P. D., Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed. (2013),
sec. 5.6.
Lee, J. G., Park, C. G., Park, H. W., "Multiposition alignment of strapdown inertial navigation system", IEEE
Trans. Aerospace and Electronic Systems 29 (1993) 1323-1328.
Renkoski, B. M., The effect of carouseling on MEMS IMU performance for gyrocompassing applications, M.Sc.
thesis, MIT (2008).
Wu, M., Wu, Y., Hu, X., Hu, D., "Optimization-based alignment for inertial navigation systems: theory and
algorithm", Aerospace Science and Technology 15 (2011) 1-17.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import ConfigError, NoSolutionError
from ..gravity import EARTH_RATE_RADPS
from ..rotations import exp_so3, log_so3, skew
from ..sensors.imu import STANDARD_GRAVITY_MPS2, ImuDescription
from ..sensors.processes import flicker_components
from ..strapdown import InertialIncrements, compress_increments
from .site import Site
from .solution import BudgetLine, ErrorBudget, NorthRun, NorthSolution

__all__ = ["align_positions", "find_halts"]

_DPH = np.pi / 180.0 / 3600.0
_UG = 1e-6 * STANDARD_GRAVITY_MPS2

BLOCKS = 160
"""About as many blocks a record becomes; shorter ones hold nothing more of a slow Earth."""

HALT_S = 5.0
"""A halt lasts at least as long."""

TURNING_RADPS = np.radians(0.5)
"""A mean rate over a second by which a platform turns rather than sways."""

LITTLE_TURN_RAD = np.radians(20.0)
"""Below it the positions hardly differ, and the bias is hardly told from the Earth rate."""

ENCODER_SD_RAD = np.radians(5.0 / 3600.0)
LEVER_ARM_SD_M = 0.1
CAROUSEL_BLOCKS_PER_TURN = 12


@dataclass(frozen=True, slots=True, eq=False)
class _Source:
    """One source of error: what it does per block to the gyros and accelerometers, in body axes.

    Parameters
    ----------
    name, stated : str
        For the budget.
    gyro_kernel, accel_kernel : ndarray, shape (n, n), or None
        Covariance over the blocks of a process that each axis has by itself, rad^2 or (m/s)^2.
    gyro, accel : ndarray, shape (n, 3, q), or None
        Effect of q constants of unit variance.
    rows : ndarray, shape (m, q), or None
        Effect of q constants on the observations themselves.
    """

    name: str
    stated: str
    gyro_kernel: np.ndarray | None = None
    accel_kernel: np.ndarray | None = None
    gyro: np.ndarray | None = None
    accel: np.ndarray | None = None
    rows: np.ndarray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    """Blocks of a record on a table, and which of them are looked at.

    Parameters
    ----------
    step_s : float
        Length of a block.
    edge_s : ndarray, shape (n + 1,)
        Edges since the start.
    turn_rad, velocity_mps, position_m : ndarray, shape (n, 3)
        Increments of each block, in its first axes.
    halt : ndarray of int, shape (n,)
        Number of the halt that a block belongs to, -1 while it turns.
    force_edges : ndarray of int
        Edges around which the force is looked at.
    rest_blocks : ndarray of int
        Blocks that do not turn against the Earth.
    table_edges : ndarray of int
        Edges at which the table's angle is known, the first of them the reference.
    table_rad : ndarray
        Those angles.
    axis_body : ndarray, shape (3,)
        The table turns clockwise about it.
    """

    step_s: float
    edge_s: np.ndarray
    turn_rad: np.ndarray
    velocity_mps: np.ndarray
    position_m: np.ndarray
    halt: np.ndarray
    force_edges: np.ndarray
    rest_blocks: np.ndarray
    table_edges: np.ndarray
    table_rad: np.ndarray
    axis_body: np.ndarray


class _Geometry:
    """Attitudes of all edges for an attitude at the start, and the linear responses about them."""

    def __init__(
        self, table: _Table, start: np.ndarray, earth_radps: np.ndarray, gravity: float, gyro_rad: np.ndarray
    ) -> None:
        turn = table.turn_rad - gyro_rad
        n = len(turn)
        steps = exp_so3(turn)
        rot = np.empty((n + 1, 3, 3))
        rot[0] = start
        for k in range(n):
            rot[k + 1] = rot[k] @ steps[k]
        self.table, self.gravity = table, gravity
        self.rot = rot
        self.mean_rot = rot[:-1] @ _mean_turn(turn)
        self.earth = exp_so3(table.edge_s[:, None] * earth_radps)
        self.axis = rot[0] @ table.axis_body
        blocks, edges = table.rest_blocks, table.force_edges
        # The instant at which a row is known, and rows in that order.
        known = np.concatenate([np.repeat(edges + 1, 2), np.repeat(blocks + 1, 3), table.table_edges[1:]])
        self.order = np.argsort(known, kind="stable")
        self.known = known[self.order]

    def residuals(self) -> np.ndarray:
        """What ought to be zero, shape (m,)."""
        table, earth, rot = self.table, self.earth, self.rot
        back = np.swapaxes(earth, -1, -2)
        velocity = np.einsum("nij,nj->ni", rot[:-1], table.velocity_mps)
        position = np.einsum("nij,nj->ni", rot[:-1], table.position_m)
        k = table.force_edges
        force = velocity[k - 1] + (position[k] - position[k - 1]) / table.step_s
        force = np.einsum("nij,nj->ni", back[k], force)[:, :2]
        still = back @ rot
        j = table.rest_blocks
        rest = log_so3(still[j + 1] @ np.swapaxes(still[j], -1, -2))
        return self._stack(force, rest, self._table_residuals(still))

    def _table_residuals(self, still: np.ndarray) -> np.ndarray:
        """Turn about the axis since the first known angle less what the table says."""
        edges, table = self.table.table_edges, self.table
        if len(edges) < 2:
            return np.empty(0)
        turned = exp_so3((table.table_rad[1:] - table.table_rad[0])[:, None] * table.axis_body)
        expected = still[edges[0]] @ turned
        return log_so3(still[edges[1:]] @ np.swapaxes(expected, -1, -2)) @ self.axis

    def respond(self, gyro: np.ndarray | None, accel: np.ndarray | None) -> np.ndarray:
        """Observations, and the attitude gained at the end, for errors per block in the starting frame.

        Parameters
        ----------
        gyro, accel : ndarray, shape (n, 3, q), or None

        Returns
        -------
        ndarray, shape (m + 3, q)
        """
        columns = (gyro if gyro is not None else accel).shape[-1]  # type: ignore[union-attr]
        n = len(self.mean_rot)
        angle = np.zeros((n + 1, 3, columns))
        if gyro is not None:
            np.cumsum(gyro, axis=0, out=angle[1:])
        return self._observe(angle, accel)

    def _observe(self, angle: np.ndarray, accel: np.ndarray | None) -> np.ndarray:
        """Observations for the attitude error at the edges, shape (n + 1, 3, q), in the starting frame."""
        table, back = self.table, np.swapaxes(self.earth, -1, -2)
        k, j = table.force_edges, table.rest_blocks
        here = np.einsum("nij,njq->niq", back, angle)
        mean = (here[k - 1] + 4.0 * here[k] + here[k + 1]) / 6.0
        pull = self.gravity * table.step_s
        force = np.stack([-pull * mean[:, 1], pull * mean[:, 0]], axis=1)
        if accel is not None:
            force = force + np.einsum("nij,njq->niq", back[k], 0.5 * (accel[k - 1] + accel[k]))[:, :2]
        rest = here[j + 1] - here[j]
        edges = table.table_edges
        turned = np.einsum("i,niq->nq", self.axis, here[edges[1:]] - here[edges[:1]])
        return np.concatenate([self._stack(force, rest, turned), angle[-1]])

    def start_columns(self) -> np.ndarray:
        """Response to a small turn of the attitude at the start, shape (m + 3, 3)."""
        return self._observe(np.broadcast_to(np.eye(3), (len(self.rot), 3, 3)), None)

    def lever_columns(self) -> np.ndarray:
        """Response of the observations to a lever arm in body axes, shape (m + 3, 3)."""
        table, k = self.table, self.table.force_edges
        swung = (self.rot[k + 1] - 2.0 * self.rot[k] + self.rot[k - 1]) / table.step_s
        force = (np.swapaxes(self.earth[k], -1, -2) @ swung)[:, :2]
        rest, turned = (
            np.zeros((len(table.rest_blocks), 3, 3)),
            np.zeros((max(len(table.table_edges) - 1, 0), 3)),
        )
        return np.concatenate([self._stack(force, rest, turned), np.zeros((3, 3))])

    def white_rows(
        self, velocity_density: float, sway_mps: float, sway_rad: float, table_rad: float
    ) -> np.ndarray:
        """Covariance of what is white in velocity or angle, shape (m, m)."""
        table, t = self.table, self.table.step_s
        k, j = table.force_edges, table.rest_blocks
        near = np.abs(k[:, None] - k[None, :])
        force = velocity_density**2 * t * np.select([near == 0, near == 1], [2.0 / 3.0, 1.0 / 6.0], 0.0)
        force += sway_mps**2 * np.select([near == 0, near == 1], [2.0, -1.0], 0.0)
        close = np.abs(j[:, None] - j[None, :])
        rest = sway_rad**2 * np.select([close == 0, close == 1], [2.0, -1.0], 0.0)
        n_table = max(len(table.table_edges) - 1, 0)
        turned = table_rad**2 * (np.eye(n_table) + 1.0)
        parts = [np.kron(force, np.eye(2)), np.kron(rest, np.eye(3)), turned]
        size = sum(len(part) for part in parts)
        total, at = np.zeros((size, size)), 0
        for part in parts:
            total[at : at + len(part), at : at + len(part)] = part
            at += len(part)
        return total[np.ix_(self.order, self.order)]

    def _stack(self, force: np.ndarray, rest: np.ndarray, turned: np.ndarray) -> np.ndarray:
        """Rows in order of time."""
        tail = force.shape[2:]
        rows = [part.reshape(-1, *tail) for part in (force, rest, turned)]
        return np.concatenate(rows)[self.order]


def _mean_turn(turn: np.ndarray) -> np.ndarray:
    """Mean of the rotation over a steady turn, shape (n, 3, 3)."""
    angle = np.linalg.norm(turn, axis=-1)[:, None, None]
    cross = skew(turn)
    small = angle < 1e-3
    safe = np.where(small, 1.0, angle)
    first = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    second = np.where(small, 1.0 / 6.0, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) + first * cross + second * (cross @ cross)


def _drift_kernel(edge_s: np.ndarray, floor: float, walk: float) -> np.ndarray:
    """Covariance of the means over blocks of a bias instability and a random walk of the bias."""
    step = float(edge_s[1] - edge_s[0])
    lag = np.abs(np.arange(len(edge_s) - 1)[:, None] - np.arange(len(edge_s) - 1)[None, :])
    sd, constants = flicker_components(floor)
    total = np.zeros(lag.shape)
    for constant in constants:
        x = step / constant
        same = 2.0 / x * (1.0 + np.expm1(-x) / x)
        total += sd**2 * np.where(lag == 0, same, (np.expm1(-x) / x) ** 2 * np.exp(-(lag - 1.0) * x))
    middle = 0.5 * (edge_s[1:] + edge_s[:-1]) - edge_s[0]
    return total + walk**2 * np.minimum(middle[:, None], middle[None, :])


def _sources(
    table: _Table, errors: ImuDescription, turn_rad: np.ndarray, lever_arm_sd_m: float
) -> list[_Source]:
    """What is stated of the sensors, per block; noise of the accelerometers stands with the rows."""
    t, n = table.step_s, len(table.velocity_mps)
    unit = np.broadcast_to(np.eye(3), (n, 3, 3))
    # Nine columns e_i x_j: the diagonal ones are scales, the others misalignments.
    pairs = [(i, j) for i in range(3) for j in range(3)]

    def products(values: np.ndarray, wanted: list[tuple[int, int]], sd: float) -> np.ndarray:
        columns = np.zeros((n, 3, len(wanted)))
        for q, (i, j) in enumerate(wanted):
            columns[:, i, q] = sd * values[:, j]
        return columns

    scale = [(i, j) for i, j in pairs if i == j]
    cross = [(i, j) for i, j in pairs if i != j]
    # Steps of a rate are lost one by one; those of increments are carried and never add up.
    rounding = np.radians(errors.gyro_resolution_dps) if errors.output == "rates" else 0.0
    density = np.hypot(
        np.radians(errors.gyro_random_walk_deg_per_sqrt_h) / 60.0,
        rounding / np.sqrt(12.0 * errors.rate_hz),
    )
    gyro_drift = _drift_kernel(
        table.edge_s,
        _DPH * errors.gyro_bias_instability_dph,
        _DPH * errors.gyro_bias_walk_dph_per_sqrt_h / 60.0,
    )
    accel_drift = _drift_kernel(
        table.edge_s,
        _UG * errors.accel_bias_instability_ug,
        _UG * errors.accel_bias_walk_ug_per_sqrt_h / 60.0,
    )
    g, a = "gyro", "accelerometer"
    return [
        _Source(
            f"{g} bias", f"{errors.gyro_bias_sd_dph:g} deg/h", gyro=_DPH * errors.gyro_bias_sd_dph * t * unit
        ),
        _Source(
            "angle random walk",
            f"{errors.gyro_random_walk_deg_per_sqrt_h:g} deg/sqrt(h)",
            gyro_kernel=density**2 * t * np.eye(n),
        ),
        _Source(
            f"{g} bias instability",
            f"{errors.gyro_bias_instability_dph:g} deg/h",
            gyro_kernel=t * t * gyro_drift,
        ),
        _Source(
            f"{g} scale",
            f"{errors.gyro_scale_sd_ppm:g} ppm",
            gyro=products(turn_rad, scale, 1e-6 * errors.gyro_scale_sd_ppm),
        ),
        _Source(
            f"{g} misalignment",
            f"{errors.gyro_misalignment_sd_mrad:g} mrad",
            gyro=products(turn_rad, cross, 1e-3 * errors.gyro_misalignment_sd_mrad),
        ),
        _Source(
            f"{g} g-sensitivity",
            f"{errors.gyro_g_sensitivity_dph_per_g:g} deg/h/g",
            gyro=products(
                table.velocity_mps, pairs, _DPH / STANDARD_GRAVITY_MPS2 * errors.gyro_g_sensitivity_dph_per_g
            ),
        ),
        _Source(
            f"{a} bias", f"{errors.accel_bias_sd_ug:g} ug", accel=_UG * errors.accel_bias_sd_ug * t * unit
        ),
        _Source(
            f"{a} bias instability",
            f"{errors.accel_bias_instability_ug:g} ug",
            accel_kernel=t * t * accel_drift,
        ),
        _Source(
            f"{a} scale",
            f"{errors.accel_scale_sd_ppm:g} ppm",
            accel=products(table.velocity_mps, scale, 1e-6 * errors.accel_scale_sd_ppm),
        ),
        _Source(
            f"{a} misalignment",
            f"{errors.accel_misalignment_sd_mrad:g} mrad",
            accel=products(table.velocity_mps, cross, 1e-3 * errors.accel_misalignment_sd_mrad),
        ),
    ]


class _Model:
    """Covariance of the observations, and what follows from it: gains, covariances, budget."""

    def __init__(
        self, geometry: _Geometry, sources: list[_Source], white: list[tuple[str, str, np.ndarray]]
    ) -> None:
        self.geometry, self.sources, self.white = geometry, sources, white
        n = len(geometry.mean_rot)
        wide = np.zeros((n, 3, 3 * n))
        for i in range(3):
            wide[np.arange(n), :, 3 * np.arange(n) + i] = geometry.mean_rot[:, :, i]
        self.by_gyro = geometry.respond(wide, None)[:-3].reshape(-1, n, 3)
        self.by_accel = geometry.respond(None, wide)[:-3].reshape(-1, n, 3)
        m = len(self.by_gyro)
        self.with_gyro = np.zeros((m, n, 3))
        """Covariance of the observations with the errors of the gyros."""
        self.with_slow = np.zeros((m, n, 3))
        """The same without their white noise."""
        self.with_accel = np.zeros((m, n, 3))
        covariance = sum((part for _, _, part in white), np.zeros((m, m)))
        self.gyro_cov = np.zeros((3 * n, 3 * n))
        for source in sources:
            gyro, accel = np.zeros((m, n, 3)), np.zeros((m, n, 3))
            if source.gyro_kernel is not None:
                gyro = np.einsum("mni,nk->mki", self.by_gyro, source.gyro_kernel, optimize=True)
            if source.accel_kernel is not None:
                accel = np.einsum("mni,nk->mki", self.by_accel, source.accel_kernel, optimize=True)
            if source.gyro is not None:
                gyro = np.tensordot(self._columns(source), source.gyro, axes=(1, 2))
            if source.accel is not None:
                accel = np.tensordot(self._columns(source), source.accel, axes=(1, 2))
            if source.rows is not None:
                covariance += source.rows @ source.rows.T
            self.with_gyro += gyro
            self.with_accel += accel
            if source.name != "angle random walk":
                self.with_slow += gyro
        flat = (m, 3 * n)
        covariance += self.with_gyro.reshape(flat) @ self.by_gyro.reshape(flat).T
        covariance += self.with_accel.reshape(flat) @ self.by_accel.reshape(flat).T
        self.covariance = 0.5 * (covariance + covariance.T)
        self.lower = np.linalg.cholesky(self.covariance)

    def _columns(self, source: _Source) -> np.ndarray:
        """Observations of the constants of a source, shape (m, q)."""
        if source.rows is not None:
            return source.rows
        total: Any = 0.0
        if source.gyro is not None:
            total = total + np.tensordot(self.by_gyro, source.gyro, axes=2)
        if source.accel is not None:
            total = total + np.tensordot(self.by_accel, source.accel, axes=2)
        return np.asarray(total)

    def whiten(self, columns: np.ndarray) -> np.ndarray:
        """Observations of unit variance without correlation."""
        from scipy.linalg import solve_triangular

        return solve_triangular(self.lower, columns, lower=True, check_finite=False)

    def gyro_prior(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Covariance of two linear functions of the errors of the gyros, each of shape (k, n, 3)."""
        total: Any = 0.0
        for source in self.sources:
            if source.gyro_kernel is not None:
                total = total + np.einsum("ani,nk,bki->ab", left, source.gyro_kernel, right, optimize=True)
            if source.gyro is not None:
                total = total + np.tensordot(left, source.gyro, 2) @ np.tensordot(right, source.gyro, 2).T
        return np.asarray(total)

    def budget_lines(self, gain: np.ndarray, turn: np.ndarray, back: np.ndarray) -> list[BudgetLine]:
        """What each source does to the attitude at the end.

        Parameters
        ----------
        gain : ndarray, shape (3, m)
            Of the estimate of the attitude error at the end.
        turn : ndarray, shape (3, n, 3)
            What the errors of the gyros themselves do to it.
        back : ndarray, shape (3, 3)
            From the starting frame into north, east, down.
        """
        by_gyro = np.tensordot(gain, self.by_gyro, 1) - turn
        by_accel = np.tensordot(gain, self.by_accel, 1)
        lines = []
        for source in self.sources:
            cov = np.zeros((3, 3))
            if source.gyro_kernel is not None:
                cov += np.einsum("ani,nk,bki->ab", by_gyro, source.gyro_kernel, by_gyro, optimize=True)
            if source.accel_kernel is not None:
                cov += np.einsum("ani,nk,bki->ab", by_accel, source.accel_kernel, by_accel, optimize=True)
            effect: Any = 0.0
            if source.gyro is not None:
                effect = effect + np.tensordot(by_gyro, source.gyro, 2)
            if source.accel is not None:
                effect = effect + np.tensordot(by_accel, source.accel, 2)
            if source.rows is not None:
                effect = effect + gain @ source.rows
            if np.ndim(effect):
                cov += effect @ effect.T
            lines.append(BudgetLine(source.name, source.stated, back @ cov @ back.T))
        for name, stated, part in self.white:
            lines.append(BudgetLine(name, stated, back @ gain @ part @ gain.T @ back.T))
        return lines


@dataclass(frozen=True, slots=True, eq=False)
class _Estimate:
    """Attitude at the end and what came with it."""

    start: np.ndarray
    end: np.ndarray
    cov: np.ndarray
    gyro_rad: np.ndarray
    residual_ratio: float
    model: _Model
    whitened: np.ndarray
    """Columns: response to the start, residuals that are left at a start error of zero."""


def _gain_at_end(model: _Model) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gain of the attitude error at the end, effect of the gyros on it, covariance; in the starting frame."""
    geometry = model.geometry
    start = geometry.start_columns()[:-3]
    turn = np.swapaxes(geometry.mean_rot, 0, 1)
    cross = np.einsum("mni,ani->ma", model.with_gyro, turn)
    first = model.whiten(np.hstack([start, cross]))
    h, c = first[:, :3], first[:, 3:]
    normal = np.linalg.inv(h.T @ h)
    lean = np.eye(3) - c.T @ h
    gain_white = lean @ normal @ h.T + c.T
    cov = model.gyro_prior(turn, turn) - c.T @ c + lean @ normal @ lean.T
    from scipy.linalg import solve_triangular

    gain = solve_triangular(model.lower, gain_white.T, lower=True, trans="T", check_finite=False).T
    return gain, turn, cov


def _estimate(
    table: _Table,
    site: Site,
    errors: ImuDescription,
    *,
    sway_mps: float,
    sway_rad: float,
    encoder_sd_rad: float,
    lever_arm_sd_m: float,
) -> _Estimate:
    """Least squares: first with the horizontal Earth rate free, then iterated with it known."""
    gravity = site.gravity_mps2
    earth = site.earth_rate_ned_radps
    gyro_rad = _first_gyro_error(table)
    start = _level_start(table, gyro_rad)

    def model_at(geometry: _Geometry) -> _Model:
        sources = _sources(table, errors, table.turn_rad - gyro_rad, lever_arm_sd_m)
        sources.append(_latitude_source(geometry, site))
        if lever_arm_sd_m > 0.0:
            rows = lever_arm_sd_m * geometry.lever_columns()[:-3]
            sources.append(_Source("lever arm", f"{lever_arm_sd_m:g} m", rows=rows))
        return _Model(geometry, sources, _white(geometry, errors, sway_mps, sway_rad, encoder_sd_rad))

    # The Earth rate about the vertical does not depend on the heading; its horizontal part is found.
    geometry = _Geometry(table, start, np.array([0.0, 0.0, earth[2]]), gravity, gyro_rad)
    model = model_at(geometry)
    spin = table.edge_s[:, None, None] * np.eye(3)[None, :, :2]
    columns = np.hstack([geometry.start_columns()[:-3, :2], geometry._observe(spin, None)[:-3]])
    observed = geometry.residuals() + np.tensordot(model.by_gyro, gyro_rad, 2)
    white = model.whiten(np.column_stack([columns, observed]))
    normal = white[:, :4].T @ white[:, :4]
    found = np.linalg.solve(normal, white[:, :4].T @ white[:, 4])
    # Of all headings the one whose Earth rate fits best, the tilts free.
    grid = np.radians(np.arange(0.0, 360.0, 0.5))
    rate = earth[0] * np.stack([np.cos(grid), np.sin(grid)], axis=1) - found[2:]
    free = normal[2:, 2:] - normal[2:, :2] @ np.linalg.solve(normal[:2, :2], normal[:2, 2:])
    north = grid[np.argmin(np.einsum("ni,ij,nj->n", rate, free, rate))]
    start = exp_so3(np.array([0.0, 0.0, -north])) @ exp_so3(-np.array([found[0], found[1], 0.0])) @ start

    for iteration in range(6):
        geometry = _Geometry(table, start, earth, gravity, gyro_rad)
        if iteration < 2:
            model = model_at(geometry)
            gain, turn, cov = _gain_at_end(model)
            response = model.whiten(geometry.start_columns()[:-3])
        observed = geometry.residuals() + np.tensordot(model.by_gyro, gyro_rad, 2)
        white = model.whiten(observed)
        tilt = np.linalg.solve(response.T @ response, response.T @ white)
        left = white - response @ tilt
        total = gain @ observed
        from scipy.linalg import solve_triangular

        weights = solve_triangular(model.lower, left, lower=True, trans="T", check_finite=False)
        end_tilt = total - np.tensordot(turn, gyro_rad, 2)
        end = geometry.earth[-1].T @ exp_so3(-end_tilt) @ geometry.rot[-1]
        start = exp_so3(-tilt) @ start
        gyro_rad = np.tensordot(weights, model.with_slow, 1)
        if iteration >= 2 and np.max(np.abs(tilt)) < 1e-8:
            break
    ratio = float(np.sqrt(left @ left / max(len(left) - 3, 1)))
    back = geometry.earth[-1].T
    return _Estimate(
        start, end, back @ cov @ back.T, gyro_rad, ratio, model, np.column_stack([response, white])
    )


def _first_gyro_error(table: _Table) -> np.ndarray:
    """Bias of gyros that turn faster than the Earth by themselves, as angle per block, shape (n, 3)."""
    turn = table.turn_rad
    if len(table.rest_blocks) or not np.all(table.halt < 0):
        mean = turn[table.halt >= 0].mean(axis=0)
    else:
        # On a carousel the mean force lies along the axis; what is across it is no spin.
        force = table.velocity_mps.sum(axis=0)
        force /= np.linalg.norm(force)
        mean = turn.mean(axis=0)
        mean = mean - (mean @ force) * force
    if np.linalg.norm(mean) < 5.0 * EARTH_RATE_RADPS * table.step_s:
        mean = np.zeros(3)
    return np.tile(mean, (len(turn), 1))


def _level_start(table: _Table, gyro_rad: np.ndarray) -> np.ndarray:
    """Attitude at the start with the force upwards and some heading, shape (3, 3)."""
    first = min(len(table.halt), max(4, round(60.0 / table.step_s)))
    rot, force = np.eye(3), np.zeros(3)
    turn = exp_so3(table.turn_rad[:first] - gyro_rad[:first])
    for k in range(first):
        force += rot @ table.velocity_mps[k]
        rot = rot @ turn[k]
    down = -force / np.linalg.norm(force)
    ahead = np.eye(3)[0 if abs(down[0]) < 0.8 else 1]
    east = np.cross(down, ahead)
    east /= np.linalg.norm(east)
    return np.stack([np.cross(east, down), east, down])


def _latitude_source(geometry: _Geometry, site: Site) -> _Source:
    """What a wrong latitude does to the Earth rate that is taken out."""
    lat = site.latitude_rad
    change = EARTH_RATE_RADPS * np.array([-np.sin(lat), 0.0, -np.cos(lat)])
    angle = site.latitude_sd_rad * geometry.table.edge_s[:, None, None] * change[None, :, None]
    stated = f"{np.degrees(site.latitude_sd_rad):.3g} deg"
    return _Source("latitude", stated, rows=geometry._observe(angle, None)[:-3])


def _white(
    geometry: _Geometry, errors: ImuDescription, sway_mps: float, sway_rad: float, encoder_sd_rad: float
) -> list[tuple[str, str, np.ndarray]]:
    """Noise that stands with the observations: of the accelerometers, the platform, the encoder."""
    # Even an ideal unit is read with some digits only.
    density = np.hypot(errors.accel_random_walk_mps_per_sqrt_h / 60.0, 1e-7)
    noise = geometry.white_rows(float(density), 0.0, 0.0, 0.0)
    moved = geometry.white_rows(0.0, sway_mps, max(sway_rad, 1e-8), 0.0)
    lines = [
        ("velocity random walk", f"{errors.accel_random_walk_mps_per_sqrt_h:g} m/s/sqrt(h)", noise),
        ("motion of the platform", f"{1e3 * sway_mps:.2g} mm/s", moved),
    ]
    if len(geometry.table.table_edges) > 1:
        table = geometry.white_rows(0.0, 0.0, 0.0, encoder_sd_rad)
        lines.append(("table angle", f"{np.degrees(encoder_sd_rad):.2g} deg", table))
    return lines


def find_halts(increments: InertialIncrements) -> list[tuple[float, float]]:
    """Stretches of a record in which the unit does not turn.

    Parameters
    ----------
    increments : InertialIncrements
        The record.

    Returns
    -------
    list of (float, float)
        Start and end of each halt of 5 s or more, seconds on the clock of the record. A second at each end
        is left out, in which the turn begins or ends.
    """
    step = float(np.median(np.diff(increments.time_s)))
    samples = max(1, round(1.0 / step))
    blocks = compress_increments(increments, samples)
    length = samples * step
    rate = blocks.angle_rad / length
    window = max(1, round(HALT_S / length))
    if len(rate) < window:
        return []
    sums = np.cumsum(np.vstack([np.zeros(3), rate]), axis=0)
    means = (sums[window:] - sums[:-window]) / window
    spread = np.array([np.abs(rate[k : k + window] - means[k]).max() for k in range(len(means))])
    # The bias may be larger than the Earth rate: a halt is where the rates are those of the quietest window.
    quiet = means[np.argmin(np.linalg.norm(means, axis=1) + spread)]
    off = np.linalg.norm(rate - quiet, axis=1)
    still = off < max(TURNING_RADPS, 5.0 * float(np.median(off[off <= np.median(off)])))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(int)))
    halts = []
    for first, last in edges.reshape(-1, 2):
        start = blocks.time_s[first] + (length if first > 0 else 0.0)
        end = blocks.time_s[last] - (length if last < len(still) else 0.0)
        if end - start >= HALT_S:
            halts.append((float(start), float(end)))
    return halts


def _blocks(increments: InertialIncrements, length_s: float) -> InertialIncrements:
    """Blocks of about a length."""
    step = float(np.median(np.diff(increments.time_s)))
    return compress_increments(increments, max(1, round(length_s / step)))


def _in_halts(edge_s: np.ndarray, halts: Sequence[tuple[float, float]]) -> np.ndarray:
    """Number of the halt that each block is wholly within, or -1."""
    number = np.full(len(edge_s) - 1, -1)
    slack = 1e-6
    for k, (start, end) in enumerate(halts):
        number[(edge_s[:-1] >= start - slack) & (edge_s[1:] <= end + slack)] = k
    return number


def _force_edges(halt: np.ndarray) -> np.ndarray:
    """Edges between two blocks of one halt."""
    return np.flatnonzero((halt[1:] == halt[:-1]) & (halt[1:] >= 0)) + 1


def align_positions(
    increments: InertialIncrements,
    site: Site,
    *,
    table_angle_rad: np.ndarray | None = None,
    axis_body: np.ndarray | None = None,
    segments: Sequence[tuple[float, float]] | None = None,
    errors: ImuDescription | None = None,
    encoder_sd_rad: float = ENCODER_SD_RAD,
    running: bool = True,
) -> NorthSolution:
    """North from halts at two or more headings, with turns between them.

    Parameters
    ----------
    increments : InertialIncrements
        The whole record, turns included.
    site : Site
        Where.
    table_angle_rad : ndarray, shape (halts,), optional
        What the encoder of the table says at each halt, about `axis_body`. Without it the gyros measure the
        turns, with their scale errors.
    axis_body : ndarray, shape (3,), optional
        Axis of the table in the body; z (down) unless said. Turns are measured against it only where it or
        the angles of the table are given.
    segments : sequence of (float, float), optional
        Start and end of the halts on the clock of the record; found by `find_halts` unless given.
    errors : ImuDescription, optional
        What is stated of the sensors; without it the noise is taken from the record and the biases are free.
    encoder_sd_rad : float
        Noise of the encoder.
    running : bool
        Whether to give the estimate after every block too.

    Returns
    -------
    NorthSolution
        Attitude at the end of the record.

    Raises
    ------
    NoSolutionError
        If there are not two halts, or the turns are not about the stated axis.
    ConfigError
        If the angles of the table are not one for each halt.
    """
    start_s = float(increments.time_s[0])
    halts = list(segments) if segments is not None else find_halts(increments)
    if len(halts) < 2:
        raise NoSolutionError(
            f"positions were to be compared, but the record of {increments.time_s[-1] - start_s:.0f} s shows "
            f"{len(halts) or 'no'} halt{'' if len(halts) == 1 else 's'} and no turn between two; "
            "turn the unit between halts or use a method for one position"
        )
    duration = float(increments.time_s[-1] - start_s)
    shortest = min(end - start for start, end in halts)
    blocks = _blocks(increments, min(max(1.0, duration / BLOCKS), shortest / 5.0))
    halt = _in_halts(blocks.time_s, halts)
    axis = np.array([0.0, 0.0, 1.0]) if axis_body is None else np.asarray(axis_body, dtype=float)
    axis = axis / np.linalg.norm(axis)
    first = np.array([np.flatnonzero(halt == k)[0] for k in range(len(halts))])
    table_edges, table_rad = np.empty(0, dtype=int), np.empty(0)
    if table_angle_rad is not None:
        table_rad = np.asarray(table_angle_rad, dtype=float)
        if table_rad.shape != (len(halts),):
            raise ConfigError(
                f"{table_rad.size} angles of the table are given for {len(halts)} halts; give one for each",
                key="table_angle_rad",
                value=table_rad.size,
            )
        table_edges = first
    table = _Table(
        step_s=float(blocks.time_s[1] - blocks.time_s[0]),
        edge_s=blocks.time_s - blocks.time_s[0],
        turn_rad=blocks.angle_rad,
        velocity_mps=blocks.velocity_mps,
        position_m=np.asarray(blocks.position_m),
        halt=halt,
        force_edges=_force_edges(halt),
        rest_blocks=np.flatnonzero(halt >= 0),
        table_edges=table_edges,
        table_rad=table_rad,
        axis_body=axis,
    )
    return _solve("positions", increments, table, site, errors, encoder_sd_rad, 0.0, running, len(halts))


def _solve(
    method: str,
    increments: InertialIncrements,
    table: _Table,
    site: Site,
    errors: ImuDescription | None,
    encoder_sd_rad: float,
    lever_arm_sd_m: float,
    running: bool,
    halts: int,
) -> NorthSolution:
    """From blocks to a solution."""
    stated = errors if errors is not None else _free_errors(table, site)
    found = _estimate(
        table,
        site,
        stated,
        sway_mps=0.0,
        sway_rad=0.0,
        encoder_sd_rad=encoder_sd_rad,
        lever_arm_sd_m=lever_arm_sd_m,
    )
    model = found.model
    gain, turn, _ = _gain_at_end(model)
    lines = model.budget_lines(gain, turn, model.geometry.earth[-1].T)
    lines.sort(key=lambda line: -line.cov_ned_rad2[2, 2])
    budget = ErrorBudget(tuple(lines), found.end)
    duration = float(table.edge_s[-1])
    return NorthSolution(
        method=method,
        site=site,
        time_s=duration,
        duration_s=duration,
        rot_ned_from_body=found.end,
        cov_ned_rad2=found.cov,
        measured={"halts": float(halts), "residual_ratio": found.residual_ratio},
        budget=budget if errors is not None else None,
    )


def _free_errors(table: _Table, site: Site) -> ImuDescription:
    """Errors of a unit of which nothing is stated: noise as it shows, biases free."""
    rest = table.rest_blocks
    turn = np.diff(table.turn_rad[rest], axis=0)
    angle = 1.4826 * np.median(np.abs(turn)) / np.sqrt(2.0 * table.step_s)
    velocity = np.diff(table.velocity_mps[rest], axis=0)
    force = 1.4826 * np.median(np.abs(velocity)) / np.sqrt(2.0 * table.step_s)
    return ImuDescription(
        grade="industrial",
        gyro_bias_sd_dph=1000.0,
        gyro_bias_instability_dph=0.0,
        gyro_random_walk_deg_per_sqrt_h=float(np.degrees(angle) * 60.0),
        gyro_g_sensitivity_dph_per_g=0.0,
        accel_bias_sd_ug=10_000.0,
        accel_bias_instability_ug=0.0,
        accel_random_walk_mps_per_sqrt_h=60.0 * force,
        gyro_resolution_dps=0.0,
    )
