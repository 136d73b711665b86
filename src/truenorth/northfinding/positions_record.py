"""A record of a unit on a table, and what of it ought to be zero.

The observations of `truenorth.northfinding.positions_model`: how they follow from the blocks of the record,
and how they respond to errors of gyros and accelerometers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..rotations import exp_so3, log_so3, skew
from ..strapdown import accumulate_turns

__all__ = ["Geometry", "Noise", "TableRecord", "triangle_weights"]


@dataclass(frozen=True, slots=True, eq=False)
class TableRecord:
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
    span : int
        Blocks on either side of an edge in a second difference.
    force_edges : ndarray of int
        Edges around which the force is looked at, `span` apart.
    rest : ndarray of int, shape (k, 2)
        Edges between which the body does not turn against the Earth.
    axis : ndarray of int, shape (k, 2)
        Edges between which the axis of the table does not.
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
    span: int
    force_edges: np.ndarray
    rest: np.ndarray
    axis: np.ndarray
    table_edges: np.ndarray
    table_rad: np.ndarray
    axis_body: np.ndarray


@dataclass(frozen=True, slots=True)
class Noise:
    """What is known of the platform and the table, not of the unit.

    Parameters
    ----------
    sway_mps : float
        Velocity of a swaying platform, mean over a block, one sigma.
    encoder_sd_rad : float
        Noise of the angles of the table.
    rest_rad : float
        Angles of a platform at rest; even an ideal unit is read with some digits only.
    lever_arm_sd_m : float
        How far from the axis the unit may stand.
    wobble_rad : float
        How far the axis of the table wobbles, one sigma in each direction.
    """

    sway_mps: float = 0.0
    encoder_sd_rad: float = 0.0
    rest_rad: float = 1e-8
    lever_arm_sd_m: float = 0.0
    wobble_rad: float = 0.0


class Geometry:
    """Attitudes of all edges for an attitude at the start, and the linear responses about them."""

    def __init__(
        self,
        table: TableRecord,
        start: np.ndarray,
        earth_radps: np.ndarray,
        gravity: float,
        gyro_rad: np.ndarray,
    ) -> None:
        turn = table.turn_rad - gyro_rad
        rot = accumulate_turns(turn, start)
        self.table, self.gravity = table, gravity
        self.rot = rot
        half = exp_so3(0.5 * turn)
        self.mid_rot = rot[:-1] @ half
        # What is constant in axes that turn is shorter in those of the middle; white noise is not.
        self.shrink = np.swapaxes(half, -1, -2) @ _mean_turn(turn)
        self.earth = exp_so3(table.edge_s[:, None] * earth_radps)
        self.axis = rot[0] @ table.axis_body
        # The instant at which a row is known, and rows in that order.
        known = [np.repeat(table.force_edges + table.span, 2)]
        known += [np.repeat(table.rest[:, 1], 3), np.repeat(table.axis[:, 1], 2), table.table_edges[1:]]
        self.order = np.argsort(np.concatenate(known), kind="stable")
        self.known = np.concatenate(known)[self.order]

    def forces(self) -> np.ndarray:
        """Mean specific force around the edges times the length of a span, in north, east, down, m/s."""
        table, t = self.table, self.table.step_s
        velocity = np.einsum("nij,nj->ni", self.rot[:-1], table.velocity_mps)
        position = np.einsum("nij,nj->ni", self.rot[:-1], table.position_m)
        position[1:] += t * np.cumsum(velocity[:-1], axis=0)
        position = np.concatenate([np.zeros((1, 3)), np.cumsum(position, axis=0)])
        k, span = table.force_edges, table.span
        force = (position[k + span] - 2.0 * position[k] + position[k - span]) / (span * t)
        return np.asarray(np.einsum("nji,nj->ni", self.earth[k], force))

    def residuals(self) -> np.ndarray:
        """What ought to be zero, shape (m,)."""
        table = self.table
        still = np.swapaxes(self.earth, -1, -2) @ self.rot
        rest = log_so3(still[table.rest[:, 1]] @ np.swapaxes(still[table.rest[:, 0]], -1, -2))
        pointed = still @ table.axis_body
        axis = pointed[table.axis[:, 1]] - pointed[table.axis[:, 0]]
        return self._stack(self.forces()[:, :2], rest, axis[:, :2], self._table_residuals(still))

    def _table_residuals(self, still: np.ndarray) -> np.ndarray:
        """Turn about the axis since the first known angle less what the table says."""
        edges, table = self.table.table_edges, self.table
        if len(edges) < 2:
            return np.empty(0)
        turned = exp_so3((table.table_rad[1:] - table.table_rad[0])[:, None] * table.axis_body)
        expected = still[edges[0]] @ turned
        return np.asarray(log_so3(still[edges[1:]] @ np.swapaxes(expected, -1, -2)) @ self.axis)

    def respond(self, gyro: np.ndarray | None, accel: np.ndarray | None) -> np.ndarray:
        """Observations for errors per block.

        Parameters
        ----------
        gyro, accel : ndarray, shape (n, 3, q), or None
            Angles and velocities in the starting frame.

        Returns
        -------
        ndarray, shape (m, q)
        """
        columns = (gyro if gyro is not None else accel).shape[-1]  # type: ignore[union-attr]
        n = len(self.mid_rot)
        angle = np.zeros((n + 1, 3, columns))
        if gyro is not None:
            np.cumsum(gyro, axis=0, out=angle[1:])
        return self.observe(angle, accel)

    def observe(self, angle: np.ndarray, accel: np.ndarray | None) -> np.ndarray:
        """Observations for the attitude error at the edges, shape (n + 1, 3, q), in the starting frame."""
        table, back = self.table, np.swapaxes(self.earth, -1, -2)
        here = np.einsum("nij,njq->niq", back, angle)
        at_edges, of_blocks = triangle_weights(table.span)
        k = table.force_edges
        mean = sum((weight * here[k + o] for o, weight in at_edges), np.zeros((len(k), 3, here.shape[-1])))
        pull = self.gravity * table.step_s * table.span
        force = np.stack([-pull * mean[:, 1], pull * mean[:, 0]], axis=1)
        if accel is not None:
            felt = sum((weight * accel[k + o] for o, weight in of_blocks), np.zeros_like(mean))
            force = force + np.einsum("nij,njq->niq", back[k], felt)[:, :2]
        rest = here[table.rest[:, 1]] - here[table.rest[:, 0]]
        moved = here[table.axis[:, 1]] - here[table.axis[:, 0]]
        axis = -np.einsum("ij,njq->niq", skew(self.axis), moved)[:, :2]
        edges = table.table_edges
        turned = np.einsum("i,niq->nq", self.axis, here[edges[1:]] - here[edges[:1]])
        return self._stack(force, rest, axis, turned)

    def start_columns(self) -> np.ndarray:
        """Response to a small turn of the attitude at the start, shape (m, 3)."""
        return self.observe(np.broadcast_to(np.eye(3), (len(self.rot), 3, 3)), None)

    def lever_columns(self) -> np.ndarray:
        """Response of the observations to a lever arm in body axes, shape (m, 3)."""
        table, k, span = self.table, self.table.force_edges, self.table.span
        swung = (self.rot[k + span] - 2.0 * self.rot[k] + self.rot[k - span]) / (span * table.step_s)
        force = (np.swapaxes(self.earth[k], -1, -2) @ swung)[:, :2]
        return self._stack(
            force,
            np.zeros((len(table.rest), 3, 3)),
            np.zeros((len(table.axis), 2, 3)),
            np.zeros((max(len(table.table_edges) - 1, 0), 3)),
        )

    def axis_columns(self) -> np.ndarray:
        """Response of the observations to a misalignment of the axis in the body, shape (m, 3)."""
        table = self.table
        still = np.swapaxes(self.earth, -1, -2) @ self.rot
        # Along itself an axis cannot be misaligned; that column would be the axis' own motion.
        across = np.eye(3) - np.outer(table.axis_body, table.axis_body)
        return self._stack(
            np.zeros((len(table.force_edges), 2, 3)),
            np.zeros((len(table.rest), 3, 3)),
            (still[table.axis[:, 0]] - still[table.axis[:, 1]])[:, :2] @ across,
            np.zeros((max(len(table.table_edges) - 1, 0), 3)),
        )

    def white_rows(
        self, noise: Noise, velocity_density: float = 0.0, within: tuple[float, float] = (0.0, 0.0)
    ) -> np.ndarray:
        """Covariance of what is white in velocity or angle, or stays within a span, shape (m, m)."""
        table = self.table

        def neighbours(first: np.ndarray, last: np.ndarray, same: float, next_to: float) -> np.ndarray:
            chained = last[:, None] == first[None, :]
            return same * np.eye(len(first)) + next_to * (chained | chained.T)

        # A second difference of white noise's second integral; a first difference of what is white itself.
        noisy = velocity_density**2 * table.step_s * table.span
        edges = (table.force_edges, table.force_edges + table.span)
        force = neighbours(*edges, 2.0 / 3.0 * noisy, noisy / 6.0)
        force += noise.sway_mps**2 * neighbours(*edges, 2.0, -1.0) + neighbours(*edges, *within)
        rest = noise.rest_rad**2 * neighbours(table.rest[:, 0], table.rest[:, 1], 2.0, -1.0)
        axis = noise.wobble_rad**2 * neighbours(table.axis[:, 0], table.axis[:, 1], 2.0, -1.0)
        n_table = max(len(table.table_edges) - 1, 0)
        turned = noise.encoder_sd_rad**2 * (np.eye(n_table) + 1.0)
        parts = [np.kron(force, np.eye(2)), np.kron(rest, np.eye(3)), np.kron(axis, np.eye(2)), turned]
        size = sum(len(part) for part in parts)
        total, at = np.zeros((size, size)), 0
        for part in parts:
            total[at : at + len(part), at : at + len(part)] = part
            at += len(part)
        return np.asarray(total[np.ix_(self.order, self.order)])

    def _stack(self, force: np.ndarray, rest: np.ndarray, axis: np.ndarray, turned: np.ndarray) -> np.ndarray:
        """Rows in order of time."""
        tail = force.shape[2:]
        rows = [part.reshape(-1, *tail) for part in (force, rest, axis, turned)]
        return np.asarray(np.concatenate(rows)[self.order])


def _mean_turn(turn: np.ndarray) -> np.ndarray:
    """Mean of the rotation over a steady turn, shape (n, 3, 3)."""
    angle = np.linalg.norm(turn, axis=-1)[:, None, None]
    cross = skew(turn)
    small = angle < 1e-3
    safe = np.where(small, 1.0, angle)
    first = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    second = np.where(small, 1.0 / 6.0, (safe - np.sin(safe)) / safe**3)
    return np.asarray(np.eye(3) + first * cross + second * (cross @ cross))


def triangle_weights(span: int) -> tuple[list[tuple[int, float]], list[tuple[int, float]]]:
    """Mean over a triangle of what is straight between edges, and of what is constant within blocks.

    Returns
    -------
    at_edges, of_blocks : list of (int, float)
        Offset from the edge in the middle, and weight; each sums to one.
    """

    def height(offset: float) -> float:
        return max(1.0 - abs(offset) / span, 0.0)

    at_edges = [
        (o, (height(o - 1) + 4.0 * height(o) + height(o + 1)) / (6.0 * span)) for o in range(-span, span + 1)
    ]
    return at_edges, [(o, height(o + 0.5)) for o in range(-span, span)]
