r"""Least squares of a unit on a table: observations, their covariance from all stated errors, the estimate.

The record is cut into blocks of a second or two. With the attitude :math:`C_k` integrated from the gyros in a
frame that was north, east, down at the start, and :math:`E_k` the turn of the Earth since, the error of the
integrated attitude at the k-th edge is

.. math:: \varphi_k = \varphi_0 + \sum_{j<k} \bar C_j\,e_j,

:math:`e_j` the error of the gyros over block j in the axes of its middle, :math:`\bar C_j`.
What ought to be zero and is observed:

* *force*: the horizontal part of the mean specific force around an edge, from second differences over some
  blocks of the doubly integrated force, so that the velocity of a swaying platform averages out:
  :math:`E_k^T(\varphi_k\times f)`, the mean over a triangle, and the errors of the accelerometers;
* *rest*, of a platform that stands still: the turn against the Earth over some blocks in a halt,
  :math:`E_l^T\varphi_l - E_k^T\varphi_k`;
* *axis*, of a table whose axis stands still while it turns: that axis in the Earth, from edge to edge,
  :math:`E_l^TC_la - E_k^TC_ka`, with the misalignment of a in the body;
* *table*, where an encoder gives its angles: the turn about the axis, less what the encoder says.

Everything that is stated of the sensors enters through the covariance of the observations, so the estimate is
the best linear one (Gauss and Markov), the errors of the gyros follow as conditional means, and the
covariance of the attitude is an exact sum over the sources: the error budget. The whitened observations are
in order of time: sums over the first of them give the estimate after every block.

References
----------
Koch, K.-R., Parameter Estimation and Hypothesis Testing in Linear Models, 2nd ed. (1999), sec. 3.2 and 3.4.
Groves, P. D., Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed. (2013),
sec. 4.4 and 5.6.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..constants import UG_MPS2
from ..gravity import EARTH_RATE_RADPS
from ..rotations import exp_so3
from ..sensors.imu import ImuDescription
from .positions_errors import (
    ANGLE_RANDOM_WALK,
    DRIFT,
    QUANTISATION,
    Source,
    stated_sources,
    within_blocks,
)
from .positions_record import Geometry, Noise, TableRecord
from .site import Site
from .solution import BudgetLine

__all__ = ["Estimate", "Model", "estimate", "model_of", "sway_mps"]

AXIS_SD_RAD = 0.1
"""How well a unit is set up along the axis of its table: as good as not known."""


def _spread(by: np.ndarray, kernels: list[np.ndarray], columns: list[np.ndarray]) -> np.ndarray:
    """Covariance of observations, which see errors of blocks by (m, n, 3), with those errors.

    Parameters
    ----------
    by : ndarray, shape (m, n, 3)
        Response to each error.
    kernels : list of ndarray, shape (n, n)
        Covariances of processes that each axis has by itself.
    columns : list of ndarray, shape (n, 3, q)
        Effects of constants of unit variance.
    """
    m, n, _ = by.shape
    total = np.zeros((m, n, 3))
    if kernels:
        apart = np.ascontiguousarray(np.swapaxes(by, 1, 2)).reshape(3 * m, n)
        spread = apart @ sum(kernels, np.zeros((n, n)))
        total += np.swapaxes(spread.reshape(m, 3, n), 1, 2)
    if columns:
        effects = np.concatenate(columns, axis=2).reshape(3 * n, -1)
        total += ((by.reshape(m, 3 * n) @ effects) @ effects.T).reshape(m, n, 3)
    return total


class Model:
    """Covariance of the observations, and what follows from it: gains, covariances, budget.

    Parameters
    ----------
    geometry : Geometry
        Attitudes about which all is linear.
    sources : list of Source
        What is stated of the sensors and the place.
    white : list of (str, str, ndarray of shape (m, m))
        Noise of the observations themselves: name, size, covariance.
    """

    def __init__(
        self, geometry: Geometry, sources: list[Source], white: list[tuple[str, str, np.ndarray]]
    ) -> None:
        self.geometry, self.sources, self.white = geometry, sources, white
        n = len(geometry.mid_rot)
        wide = np.zeros((n, 3, 3 * n))
        for i in range(3):
            wide[np.arange(n), :, 3 * np.arange(n) + i] = geometry.mid_rot[:, :, i]
        self.by_gyro = geometry.respond(wide, None).reshape(-1, n, 3)
        self.by_accel = geometry.respond(None, wide).reshape(-1, n, 3)
        m = len(self.by_gyro)
        covariance = sum((part for _, _, part in white), np.zeros((m, m)))
        for source in sources:
            if source.rows is not None:
                covariance += source.rows @ source.rows.T
        with_gyro = self.with_gyro()
        with_accel = _spread(
            self.by_accel,
            [source.accel_kernel for source in sources if source.accel_kernel is not None],
            [source.accel for source in sources if source.accel is not None],
        )
        flat = (m, 3 * n)
        covariance += with_gyro.reshape(flat) @ self.by_gyro.reshape(flat).T
        covariance += with_accel.reshape(flat) @ self.by_accel.reshape(flat).T
        self._lower = np.linalg.cholesky(0.5 * (covariance + covariance.T))
        self.start = self.whiten(geometry.start_columns())
        self.turn = np.swapaxes(geometry.mid_rot, 0, 1)
        """What the errors of the gyros add to the attitude error at the end, shape (3, n, 3)."""
        self.all_gyro = with_gyro

    @cached_property
    def _normal(self) -> np.ndarray:
        """Covariance of the attitude at the start by the observations alone."""
        return np.asarray(np.linalg.inv(self.start.T @ self.start))

    @cached_property
    def gain(self) -> np.ndarray:
        """ndarray, shape (3, m): Attitude error at the end, in the starting frame, per observation."""
        # The start's least-squares value, and what the gyros are then expected to have added.
        added = self.whiten(np.tensordot(self.all_gyro, self.turn, axes=([1, 2], [1, 2])))
        lean = np.eye(3) - added.T @ self.start
        return self._unwhiten((lean @ self._normal @ self.start.T + added.T).T).T

    def with_gyro(self, names: tuple[str, ...] | None = None, but: tuple[str, ...] = ()) -> np.ndarray:
        """Covariance of the observations with the errors of the gyros, shape (m, n, 3).

        Parameters
        ----------
        names : tuple of str, optional
            Sources that count; all unless said.
        but : tuple of str
            Sources that do not.
        """
        chosen = [s for s in self.sources if (names is None or s.name in names) and s.name not in but]
        return _spread(
            self.by_gyro,
            [source.gyro_kernel for source in chosen if source.gyro_kernel is not None],
            [source.gyro for source in chosen if source.gyro is not None],
        )

    def gyro_prior(self, function: np.ndarray, names: tuple[str, ...] | None = None) -> np.ndarray:
        """Covariance, before any observation, of linear functions of the errors of the gyros.

        Parameters
        ----------
        function : ndarray, shape (k, n, 3)
            Weights of the errors.
        names : tuple of str, optional
            Sources that count; all unless said.
        """
        total = np.zeros((len(function), len(function)))
        for source in self.sources:
            if names is not None and source.name not in names:
                continue
            if source.gyro_kernel is not None:
                total += np.einsum("ani,nk,bki->ab", function, source.gyro_kernel, function, optimize=True)
            if source.gyro is not None:
                effect = np.tensordot(function, source.gyro, 2)
                total += effect @ effect.T
        return total

    def whiten(self, columns: np.ndarray) -> np.ndarray:
        """Observations of unit variance without correlation."""
        from scipy.linalg import solve_triangular

        return np.asarray(solve_triangular(self._lower, columns, lower=True, check_finite=False))

    def _unwhiten(self, columns: np.ndarray) -> np.ndarray:
        """The transpose of what `whiten` does."""
        from scipy.linalg import solve_triangular

        return np.asarray(solve_triangular(self._lower, columns, lower=True, trans="T", check_finite=False))

    def fit(self, observed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Small turn of the start, and what it leaves, whitened."""
        white = self.whiten(observed)
        turn = self._normal @ (self.start.T @ white)
        return turn, white - self.start @ turn

    def expected(self, left: np.ndarray, cross: np.ndarray) -> np.ndarray:
        """Mean of anything, given its covariance with the observations and what the fit leaves of them."""
        return np.asarray(np.tensordot(self._unwhiten(left), cross, 1))

    def known(self, cross: np.ndarray, prior: np.ndarray) -> np.ndarray:
        """Covariance of anything that is left after the observations.

        Parameters
        ----------
        cross : ndarray, shape (m, k)
            Its covariance with them.
        prior : ndarray, shape (k, k)
            Its covariance before.
        """
        white = self.whiten(cross)
        lean = white.T @ self.start
        return np.asarray(prior - white.T @ white + lean @ self._normal @ lean.T)

    def lines(self) -> list[BudgetLine]:
        """What each source does to the attitude at the end, in north, east, down there."""
        back = self.geometry.earth[-1].T
        by_gyro = np.tensordot(self.gain, self.by_gyro, 1) - self.turn
        by_accel = np.tensordot(self.gain, self.by_accel, 1)
        lines = []
        for source in self.sources:
            cov = np.zeros((3, 3))
            for by, kernel in ((by_gyro, source.gyro_kernel), (by_accel, source.accel_kernel)):
                if kernel is not None:
                    cov += np.einsum("ani,nk,bki->ab", by, kernel, by, optimize=True)
            for by, columns in ((by_gyro, source.gyro), (by_accel, source.accel)):
                if columns is not None:
                    effect = np.tensordot(by, columns, 2)
                    cov += effect @ effect.T
            if source.rows is not None:
                effect = self.gain @ source.rows
                cov += effect @ effect.T
            lines.append(BudgetLine(source.name, source.stated, back @ cov @ back.T))
        for name, stated, part in self.white:
            lines.append(BudgetLine(name, stated, back @ self.gain @ part @ self.gain.T @ back.T))
        return lines

    def running(self, observed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Attitude error at each edge from the observations known there, and its covariance.

        Parameters
        ----------
        observed : ndarray, shape (m,)
            What ought to be zero.

        Returns
        -------
        error : ndarray, shape (n + 1, 3)
            In the starting frame; NaN while there are no more observations than unknowns.
        cov : ndarray, shape (n + 1, 3, 3)
        """
        n = self.by_gyro.shape[1]
        m = len(observed)
        rot = self.geometry.mid_rot
        turned = np.einsum("mnj,nij->mni", self.all_gyro, rot, optimize=True)
        added = self.whiten(np.cumsum(turned, axis=1).reshape(m, 3 * n)).reshape(m, n, 3)
        white = self.whiten(observed)
        prior = np.zeros((n, 3, n, 3))
        for source in self.sources:
            if source.gyro_kernel is not None:
                # An isotropic process: the attitudes alone turn one block's error into another's axes.
                prior += np.einsum("nik,mjk,nm->nimj", rot, rot, source.gyro_kernel, optimize=True)
            if source.gyro is not None:
                effect = (rot @ source.gyro).reshape(3 * n, -1)
                prior += (effect @ effect.T).reshape(n, 3, n, 3)
        prior = np.cumsum(np.cumsum(prior, axis=0), axis=2)
        error, cov = np.full((n + 1, 3), np.nan), np.full((n + 1, 3, 3), np.nan)
        counts = np.searchsorted(self.geometry.known, np.arange(n + 1), side="right")
        for k in range(1, n + 1):
            count = counts[k]
            if count < 6:
                continue
            h, c, z = self.start[:count], added[:count, k - 1], white[:count]
            information = h.T @ h
            if np.linalg.cond(information) > 1e12:
                continue
            normal = np.linalg.inv(information)
            start = normal @ (h.T @ z)
            lean = np.eye(3) - c.T @ h
            error[k] = start + c.T @ (z - h @ start)
            cov[k] = prior[k - 1, :, k - 1] - c.T @ c + lean @ normal @ lean.T
        return error, cov


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """Attitude at the end, and what is known besides.

    Parameters
    ----------
    rot_ned_from_body : ndarray, shape (3, 3)
        At the end of the record.
    model : Model
        At the estimate.
    errors : ImuDescription
        What was stated.
    observed : ndarray, shape (m,)
        What ought to be zero there.
    left : ndarray, shape (m,)
        What the fit leaves of it, whitened.
    gyro_rad : ndarray, shape (n, 3)
        Errors of the gyros that were taken out, per block, in axes of its middle.
    """

    rot_ned_from_body: np.ndarray
    model: Model
    errors: ImuDescription
    observed: np.ndarray
    left: np.ndarray
    gyro_rad: np.ndarray

    @property
    def residual_ratio(self) -> float:
        """float: Root mean square of the whitened residuals; one where all is as stated."""
        return float(np.sqrt(self.left @ self.left / max(len(self.left) - 3, 1)))

    def gyro_bias(self, turning: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Mean bias of the gyros over the record, and its standard deviation, rad/s, shape (3,).

        Parameters
        ----------
        turning : bool
            Whether to count what the scale errors and misalignments make of the turning, which of a steady
            turn is nothing else than a bias.
        """
        model, table = self.model, self.model.geometry.table
        names = DRIFT + (("gyro scale", "gyro misalignment") if turning else ())
        length = len(table.turn_rad) * table.step_s
        unshrunk = np.linalg.inv(model.geometry.shrink)
        cross = model.with_gyro(names)
        total = np.einsum("mni,nji->mj", cross, unshrunk) / length
        function = np.swapaxes(unshrunk, 0, 1) / length
        cov = model.known(total, model.gyro_prior(function, names))
        return model.expected(self.left, total), np.sqrt(np.maximum(np.diag(cov), 0.0))

    def accel_bias(self) -> tuple[np.ndarray, np.ndarray]:
        """Turn-on bias of the accelerometers and its standard deviation, m/s^2, shape (3,)."""
        model, sd = self.model, UG_MPS2 * self.errors.accel_bias_sd_ug
        for source in model.sources:
            if source.name == "accelerometer bias" and source.accel is not None:
                cross = np.tensordot(model.by_accel, source.accel, 2) * sd
                cov = model.known(cross, sd**2 * np.eye(3))
                return model.expected(self.left, cross), np.sqrt(np.maximum(np.diag(cov), 0.0))
        return np.zeros(3), np.zeros(3)

    def attitudes(self) -> tuple[np.ndarray, np.ndarray]:
        """Attitude at each edge from the observations known there, and its covariance."""
        geometry = self.model.geometry
        error, cov = self.model.running(self.observed)
        taken = np.zeros_like(error)
        taken[1:] = np.cumsum(np.einsum("nij,nj->ni", geometry.mid_rot, self.gyro_rad), axis=0)
        back = np.swapaxes(geometry.earth, -1, -2)
        rot = back @ exp_so3(-(error - taken)) @ geometry.rot
        return rot, back @ cov @ geometry.earth


def model_of(
    table: TableRecord,
    site: Site,
    errors: ImuDescription,
    *,
    start: np.ndarray,
    earth_radps: np.ndarray,
    gyro_rad: np.ndarray,
    noise: Noise,
) -> Model:
    """Model of a record about an attitude at its start.

    Parameters
    ----------
    table : TableRecord
        The record, or a planned one.
    site : Site
        Where.
    errors : ImuDescription
        What is stated of the sensors.
    start : ndarray, shape (3, 3)
        Attitude at the first edge.
    earth_radps : ndarray, shape (3,)
        Rate of the Earth in north, east, down.
    gyro_rad : ndarray, shape (n, 3)
        Errors of the gyros to take out.
    noise : Noise
        What is known of the platform and the table.
    """
    geometry = Geometry(table, start, earth_radps, site.gravity_mps2, gyro_rad)
    sources = [
        replace(
            source,
            gyro=None if source.gyro is None else geometry.shrink @ source.gyro,
            accel=None if source.accel is None else geometry.shrink @ source.accel,
        )
        for source in stated_sources(table, errors, table.turn_rad - gyro_rad)
    ]
    lat = site.latitude_rad
    change = EARTH_RATE_RADPS * np.array([-np.sin(lat), 0.0, -np.cos(lat)])
    wrong = site.latitude_sd_rad * table.edge_s[:, None, None] * change[None, :, None]
    arcsec = 3600.0 * np.degrees(site.latitude_sd_rad)
    lever = noise.lever_arm_sd_m
    extra = [
        Source("latitude", f"{arcsec:.3g} arcsec", rows=geometry.observe(wrong, None)),
        Source("lever arm", f"{lever:g} m", rows=lever * geometry.lever_columns()),
    ]
    sources += [source for source in extra if source.is_there]
    density = np.hypot(errors.accel_density_mps_per_sqrt_s, 1e-7)
    silent = Noise(rest_rad=0.0)
    walk = f"{errors.accel_random_walk_mps_per_sqrt_h:g} m/s/sqrt(h)"
    white = [("velocity random walk", walk, geometry.white_rows(silent, float(density)))]
    within = within_blocks(table.step_s, table.span, errors, site.gravity_mps2)
    white.append(
        ("noise within a block", f"of {table.step_s:.2g} s", geometry.white_rows(silent, within=within))
    )
    moved = replace(silent, sway_mps=noise.sway_mps, rest_rad=noise.rest_rad)
    white.append(("motion of the platform", f"{1e3 * noise.sway_mps:.2g} mm/s", geometry.white_rows(moved)))
    arcsec = 3600.0 * np.degrees(np.array([noise.encoder_sd_rad, noise.wobble_rad]))
    if len(table.table_edges) > 1:
        read = geometry.white_rows(replace(silent, encoder_sd_rad=noise.encoder_sd_rad))
        white.append(("table angle", f"{arcsec[0]:.3g} arcsec", read))
    if len(table.axis):
        wobbles = geometry.white_rows(replace(silent, wobble_rad=noise.wobble_rad))
        white.append(("wobble of the table", f"{arcsec[1]:.3g} arcsec", wobbles))
        off = AXIS_SD_RAD * geometry.axis_columns()
        sources.append(Source("axis in the body", f"{np.degrees(AXIS_SD_RAD):.2g} deg", rows=off))
    return Model(geometry, sources, white)


def estimate(table: TableRecord, site: Site, errors: ImuDescription, noise: Noise) -> Estimate:
    """Least squares: first with the horizontal Earth rate free, then iterated with it known.

    Parameters
    ----------
    table : TableRecord
        The record.
    site : Site
        Where.
    errors : ImuDescription
        What is stated of the sensors.
    noise : Noise
        What is known of the platform and the table.
    """
    gyro_rad = _first_gyro_error(table)
    start = _coarse(table, site, errors, noise, _level_start(table, gyro_rad), gyro_rad)
    earth = site.earth_rate_ned_radps
    # The covariances move with the attitude while that moves by more than a hundredth.
    moved = np.inf
    for round_ in range(5):
        if round_ < 3 and moved > 0.01:
            model = model_of(
                table, site, errors, start=start, earth_radps=earth, gyro_rad=gyro_rad, noise=noise
            )
            slow = model.with_gyro(but=(ANGLE_RANDOM_WALK, QUANTISATION))
        else:
            model.geometry = Geometry(table, start, earth, site.gravity_mps2, gyro_rad)
        geometry = model.geometry
        taken = np.einsum("nij,nj->ni", geometry.shrink, gyro_rad)
        observed = geometry.residuals() + np.tensordot(model.by_gyro, taken, 2)
        turn, left = model.fit(observed)
        if np.max(np.abs(turn)) < 1e-7:
            break
        start = exp_so3(-turn) @ start
        before = gyro_rad
        gyro_rad = np.linalg.solve(geometry.shrink, model.expected(left, slow)[:, :, None])[:, :, 0]
        drifted = np.abs(np.cumsum(gyro_rad - before, axis=0))
        moved = float(max(np.max(np.abs(turn)), np.max(drifted)))
    error = model.gain @ observed - np.tensordot(model.turn, taken, 2)
    end = geometry.earth[-1].T @ exp_so3(-error) @ geometry.rot[-1]
    return Estimate(end, model, errors, observed, left, taken)


def _coarse(
    table: TableRecord,
    site: Site,
    errors: ImuDescription,
    noise: Noise,
    start: np.ndarray,
    gyro_rad: np.ndarray,
) -> np.ndarray:
    """Attitude at the start of which only the level is known: the Earth rate as it is found tells north."""
    earth = site.earth_rate_ned_radps
    # The part of the Earth rate about the vertical does not depend on the heading.
    upright = np.array([0.0, 0.0, earth[2]])
    model = model_of(table, site, errors, start=start, earth_radps=upright, gyro_rad=gyro_rad, noise=noise)
    geometry = model.geometry
    rates = geometry.observe(table.edge_s[:, None, None] * np.eye(3)[None, :, :2], None)
    columns = np.hstack([model.start[:, :2], model.whiten(rates)])
    taken = np.einsum("nij,nj->ni", geometry.shrink, gyro_rad)
    white = model.whiten(geometry.residuals() + np.tensordot(model.by_gyro, taken, 2))
    normal = columns.T @ columns
    found = np.linalg.solve(normal, columns.T @ white)
    # Of all headings the one whose Earth rate fits best, whatever the level then is.
    grid = np.radians(np.arange(0.0, 360.0, 0.5))
    miss = earth[0] * np.stack([np.cos(grid), np.sin(grid)], axis=1) - found[2:]
    free = normal[2:, 2:] - normal[2:, :2] @ np.linalg.solve(normal[:2, :2], normal[:2, 2:])
    north = grid[np.argmin(np.einsum("ni,ij,nj->n", miss, free, miss))]
    level = exp_so3(np.array([-found[0], -found[1], 0.0])) @ start
    return np.asarray(exp_so3(np.array([0.0, 0.0, -north])) @ level)


def _first_gyro_error(table: TableRecord) -> np.ndarray:
    """Bias of gyros that turn faster than the Earth by themselves, as angle per block, shape (n, 3)."""
    turn = table.turn_rad
    if np.any(table.halt >= 0):
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


def sway_mps(table: TableRecord, site: Site, errors: ImuDescription) -> float:
    """Velocity of a swaying platform: what the force scatters by beyond the noise of the sensors.

    Parameters
    ----------
    table : TableRecord
        The record.
    site : Site
        Where.
    errors : ImuDescription
        What is stated of the sensors.

    Returns
    -------
    float
        Of the mean velocity over a span; 0 where nothing is seen.
    """
    k, span = table.force_edges, table.span
    near = np.flatnonzero(np.diff(k) == span)
    near = near[:-1][np.diff(near) == 1]
    if len(near) < 8:
        return 0.0
    gyro_rad = _first_gyro_error(table)
    earth = np.array([0.0, 0.0, site.earth_rate_ned_radps[2]])
    geometry = Geometry(table, _level_start(table, gyro_rad), earth, site.gravity_mps2, gyro_rad)
    force = geometry.forces()[:, :2]
    # Tilts by the gyros' drift change slowly, biases of the accelerometers turn with the body.
    slow = (table.edge_s[k] / table.edge_s[-1])[:, None] ** np.arange(4.0)
    columns = np.concatenate([np.kron(slow, np.eye(2)).reshape(len(k), 2, 8), geometry.rot[k, :2]], axis=2)
    columns = columns.reshape(-1, columns.shape[-1])
    force = force - (columns @ np.linalg.lstsq(columns, force.ravel(), rcond=None)[0]).reshape(-1, 2)
    bend = force[near] - 2.0 * force[near + 1] + force[near + 2]
    # The median of the squares of a normal variable of variance one is 0.455.
    variance = float(np.median(bend**2)) / 0.455
    # Variances of second differences of what has a variance and a covariance from one to the next.
    density = errors.accel_density_mps_per_sqrt_s
    noise = density**2 * table.step_s * span * (6.0 * 2.0 / 3.0 - 8.0 / 6.0)
    within = within_blocks(table.step_s, span, errors, site.gravity_mps2)
    noise += 6.0 * within[0] - 8.0 * within[1]
    # The angle random walk between edges: second differences of what walks.
    walk = errors.gyro_density_rad_per_sqrt_s
    noise += 2.0 * (walk * site.gravity_mps2 * table.step_s * span) ** 2 * table.step_s * span
    # A median of some hundred squares scatters by a tenth or two.
    return float(np.sqrt((variance - noise) / 20.0)) if variance > 1.6 * noise else 0.0


def _level_start(table: TableRecord, gyro_rad: np.ndarray) -> np.ndarray:
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
