"""Vectors and phases of arrays with known attitude and declared noise, for tests of the reliability."""

import numpy as np

from truenorth.ambiguity.array_model import ArrayEpoch
from truenorth.attitude.array_vectors import ArrayVectors
from truenorth.rotations import rot_ned_from_body

SQUARE_M = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
TRIANGLE_M = SQUARE_M[:3]
LINE_M = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])

ANTENNA_COV_M2 = 1e-5 * np.array([[1.0, 0.3, 0.1], [0.3, 1.2, -0.2], [0.1, -0.2, 4.0]])
"""Of the position of an antenna: some 3 mm horizontally, twice that vertically, correlated."""

# The sky of seven satellites of the published study: azimuth and elevation, degrees.
SKY_DEG = ((40, 65), (150, 48), (255, 55), (320, 30), (95, 22), (200, 18), (10, 15))
WAVELENGTH_M = 0.19029367


def attitudes(n, rng, tilt_rad=0.1):
    """Random headings with some pitch and roll: ndarray, shape (n, 3, 3)."""
    return rot_ned_from_body(
        rng.uniform(0.0, 2.0 * np.pi, n), tilt_rad * rng.standard_normal(n), tilt_rad * rng.standard_normal(n)
    )


def make_vectors(rot, rng, *, body_m=SQUARE_M, shift_m=0.0, antenna=0, body_sd_m=0.0, names=()):
    """Vectors of arrays whose antennas have independent errors; one antenna may be shifted in each epoch."""
    n, m = len(rot), len(body_m)
    true_body_m = body_m + body_sd_m * rng.standard_normal((n, m, 3))
    position = np.einsum("nij,nkj->nki", rot, true_body_m)
    position += rng.standard_normal((n, m, 3)) @ np.linalg.cholesky(ANTENNA_COV_M2).T
    position[np.arange(n), antenna] += shift_m
    vector = position - position[:, :1]
    vector[:, 0] = np.nan
    cov = np.tile(np.kron(np.eye(m) + 1.0, ANTENNA_COV_M2), (n, 1, 1))
    cov[:, :3], cov[:, :, :3] = np.nan, np.nan
    return ArrayVectors(
        np.arange(n) * 10**9, np.zeros(n, np.int64), vector, cov, body_m, body_sd_m**2 * np.eye(3 * m), names
    )


def make_epoch(rng, *, body_m=SQUARE_M, n_sats=7, phase_sd_m=0.003, rot=None, position_sd_m=0.0):
    """One epoch of GPS L1 phases with clocks and satellite constants: epoch, attitude, integers."""
    azimuth, elevation = np.radians(SKY_DEG[:n_sats]).T
    unit = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), -np.sin(elevation)], 1
    )
    m = len(body_m)
    satellite, antenna = np.repeat(np.arange(n_sats), m), np.tile(np.arange(m), n_sats)
    rot = rot_ned_from_body(0.7, 0.05, -0.03) if rot is None else rot
    n, design = len(satellite), -unit[satellite]
    integers = rng.integers(-50, 50, n)
    placed = body_m + position_sd_m * rng.standard_normal((m, 3))
    phase = WAVELENGTH_M * integers + np.einsum("ri,ri->r", design, placed[antenna] @ rot.T)
    phase += rng.standard_normal(n_sats)[satellite] + rng.standard_normal(m)[antenna]
    phase += phase_sd_m * rng.standard_normal(n)
    epoch = ArrayEpoch(
        antenna, satellite, np.zeros(n, np.int64), phase, np.full(n, np.nan), design,
        np.full(n, WAVELENGTH_M), np.full(n, phase_sd_m**2), np.full(n, 1.0), body_m, position_sd_m,
    )  # fmt: skip
    return epoch, rot, integers
