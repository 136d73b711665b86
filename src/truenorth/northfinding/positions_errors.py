"""Stated errors of a unit on a table, as covariances over the blocks of its record.

References
----------
P. D. Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed. (2013),
sec. 4.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..constants import DPH_RADPS, STANDARD_GRAVITY_MPS2, UG_MPS2
from ..sensors.imu import ImuDescription
from ..sensors.processes import flicker_components, gauss_markov_mean_covariance
from .positions_record import TableRecord, triangle_weights

__all__ = [
    "ANGLE_RANDOM_WALK",
    "DRIFT",
    "QUANTISATION",
    "Source",
    "gyro_noise_kernel",
    "stated_sources",
    "within_blocks",
]

ANGLE_RANDOM_WALK = "angle random walk"
QUANTISATION = "gyro quantisation"

DRIFT = ("gyro bias", "gyro bias instability", "rate random walk", "gyro g-sensitivity")
"""What is reported as the bias of the gyros."""


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """One source of error: what it does per block to the gyros and accelerometers, in axes of its middle.

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

    @property
    def is_there(self) -> bool:
        """bool: Whether it does anything."""
        effects = (self.gyro_kernel, self.accel_kernel, self.gyro, self.accel, self.rows)
        return any(effect is not None and bool(np.any(effect)) for effect in effects)


def flicker_kernel(edge_s: np.ndarray) -> np.ndarray:
    """Covariance of the means over blocks of flicker noise whose Allan deviation is one, shape (n, n)."""
    step = float(edge_s[1] - edge_s[0])
    lag = np.abs(np.arange(len(edge_s) - 1)[:, None] - np.arange(len(edge_s) - 1)[None, :])
    sd, constants = flicker_components(1.0)
    total = np.zeros(lag.shape)
    for constant in constants:
        total += sd**2 * gauss_markov_mean_covariance(lag, step / constant)
    return total


def _walk_kernel(edge_s: np.ndarray) -> np.ndarray:
    """Covariance at the middles of blocks of a walk that starts with the record, shape (n, n)."""
    middle = 0.5 * (edge_s[1:] + edge_s[:-1]) - edge_s[0]
    return np.asarray(np.minimum(middle[:, None], middle[None, :]))


def gyro_noise_kernel(edge_s: np.ndarray, errors: ImuDescription) -> np.ndarray:
    """Covariance of what changes from block to block in a gyro, shape (n, n), rad^2."""
    t, n = float(edge_s[1] - edge_s[0]), len(edge_s) - 1
    density = errors.gyro_density_rad_per_sqrt_s
    total = density**2 * t * np.eye(n)
    total += (DPH_RADPS * errors.gyro_bias_instability_dph * t) ** 2 * flicker_kernel(edge_s)
    total += (DPH_RADPS * errors.gyro_bias_walk_dph_per_sqrt_h * t) ** 2 / 3600.0 * _walk_kernel(edge_s)
    return np.asarray(total)


def within_blocks(step_s: float, span: int, errors: ImuDescription, gravity: float) -> tuple[float, float]:
    """What the sensors do within blocks, seen in the force: its variance, covariance from edge to edge.

    The response takes the angle between edges for a straight line and the errors of the accelerometers for
    constant within a block. What is left is computed on parts of blocks, for two force edges; (m/s)^2.
    """
    parts = 8 if span == 1 else 4
    blocks = 3 * span
    n = blocks * parts
    edge_s = np.linspace(0.0, blocks * step_s, n + 1)
    middle = (np.arange(n) + 0.5) / parts
    edges = span * np.array([1, 2])
    weight = np.maximum(1.0 - np.abs(middle[None, :] - edges[:, None]) / span, 0.0) / (span * parts)
    # The angle in the middle of a part is all that was gained before it and half of its own.
    gained = np.tril(np.ones((n, n)), -1) + 0.5 * np.eye(n)
    at_edge = np.array([(np.arange(n) < k * parts).astype(float) for k in range(blocks + 1)])
    in_block = np.diff(at_edge, axis=0) / parts
    at_edges, of_blocks = triangle_weights(span)
    straight = np.array([sum(w * at_edge[k + o] for o, w in at_edges) for k in edges])
    constant = np.array([sum(w / span * in_block[k + o] for o, w in of_blocks) for k in edges])
    bent = gravity * step_s * span * (weight @ gained - straight)
    floor = UG_MPS2 * errors.accel_bias_instability_ug * step_s * span
    uneven = floor * (weight - constant)
    total = bent @ gyro_noise_kernel(edge_s, errors) @ bent.T + uneven @ flicker_kernel(edge_s) @ uneven.T
    return float(total[0, 0]), float(total[0, 1])


def stated_sources(table: TableRecord, errors: ImuDescription, turn_rad: np.ndarray) -> list[Source]:
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
    density = errors.gyro_density_rad_per_sqrt_s
    instability = flicker_kernel(table.edge_s)
    walk = _walk_kernel(table.edge_s) / 3600.0
    by_force = DPH_RADPS / STANDARD_GRAVITY_MPS2 * errors.gyro_g_sensitivity_dph_per_g
    velocity = table.velocity_mps
    stated = [
        Source(
            "gyro bias",
            f"{errors.gyro_bias_sd_dph:g} deg/h",
            gyro=DPH_RADPS * errors.gyro_bias_sd_dph * t * unit,
        ),
        Source(
            "gyro bias instability",
            f"{errors.gyro_bias_instability_dph:g} deg/h",
            gyro_kernel=(DPH_RADPS * errors.gyro_bias_instability_dph * t) ** 2 * instability,
        ),
        Source(
            ANGLE_RANDOM_WALK,
            f"{errors.gyro_random_walk_deg_per_sqrt_h:g} deg/sqrt(h)",
            gyro_kernel=density**2 * t * np.eye(n),
        ),
        Source(
            "rate random walk",
            f"{errors.gyro_bias_walk_dph_per_sqrt_h:g} deg/h/sqrt(h)",
            gyro_kernel=(DPH_RADPS * errors.gyro_bias_walk_dph_per_sqrt_h * t) ** 2 * walk,
        ),
        Source(
            QUANTISATION,
            f"{errors.gyro_resolution_dps:g} deg/s",
            gyro_kernel=rounding**2 / (12.0 * errors.rate_hz) * t * np.eye(n),
        ),
        Source(
            "gyro scale",
            f"{errors.gyro_scale_sd_ppm:g} ppm",
            gyro=products(turn_rad, scale, 1e-6 * errors.gyro_scale_sd_ppm),
        ),
        Source(
            "gyro misalignment",
            f"{errors.gyro_misalignment_sd_mrad:g} mrad",
            gyro=products(turn_rad, cross, 1e-3 * errors.gyro_misalignment_sd_mrad),
        ),
        Source(
            "gyro g-sensitivity",
            f"{errors.gyro_g_sensitivity_dph_per_g:g} deg/h/g",
            gyro=products(velocity, pairs, by_force),
        ),
        Source(
            "accelerometer bias",
            f"{errors.accel_bias_sd_ug:g} ug",
            accel=UG_MPS2 * errors.accel_bias_sd_ug * t * unit,
        ),
        Source(
            "accelerometer bias instability",
            f"{errors.accel_bias_instability_ug:g} ug",
            accel_kernel=(UG_MPS2 * errors.accel_bias_instability_ug * t) ** 2 * instability,
        ),
        Source(
            "accelerometer bias walk",
            f"{errors.accel_bias_walk_ug_per_sqrt_h:g} ug/sqrt(h)",
            accel_kernel=(UG_MPS2 * errors.accel_bias_walk_ug_per_sqrt_h * t) ** 2 * walk,
        ),
        Source(
            "accelerometer scale",
            f"{errors.accel_scale_sd_ppm:g} ppm",
            accel=products(velocity, scale, 1e-6 * errors.accel_scale_sd_ppm),
        ),
        Source(
            "accelerometer misalignment",
            f"{errors.accel_misalignment_sd_mrad:g} mrad",
            accel=products(velocity, cross, 1e-3 * errors.accel_misalignment_sd_mrad),
        ),
    ]
    return [source for source in stated if source.is_there]
