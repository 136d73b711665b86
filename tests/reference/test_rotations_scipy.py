"""Rotations against SciPy's `Rotation`, which was written by others."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truenorth import rotations

RNG = np.random.Generator(np.random.PCG64(20240624))
VECTORS = np.concatenate(
    [scale * RNG.standard_normal((200, 3)) for scale in (1e-12, 1e-7, 1e-3, 0.1, 1.0)]
    # Angles up to pi; beyond, the vector is not unique.
)
VECTORS = VECTORS[np.linalg.norm(VECTORS, axis=1) < np.pi]


def test_euler_angles():
    heading, pitch, roll = RNG.uniform([0, -1.5, -3], [6.28, 1.5, 3], (500, 3)).T
    theirs = Rotation.from_euler("ZYX", np.stack([heading, pitch, roll], axis=1))
    ours = rotations.rot_ned_from_body(heading, pitch, roll)
    # Rounding of products of three sines.
    assert np.max(np.abs(ours - theirs.as_matrix())) < 1e-15
    back = np.stack(rotations.heading_pitch_roll(ours))
    assert np.max(np.abs(back - [heading, pitch, roll])) < 1e-14


def test_exponential_and_quaternion():
    theirs = Rotation.from_rotvec(VECTORS)
    assert np.max(np.abs(rotations.exp_so3(VECTORS) - theirs.as_matrix())) < 1e-15
    quaternion = theirs.as_quat(canonical=True, scalar_first=True)
    ours = rotations.quaternion_from_rot(theirs.as_matrix())
    assert np.max(np.abs(ours - quaternion)) < 1e-15
    assert np.max(np.abs(rotations.rot_from_quaternion(quaternion) - theirs.as_matrix())) < 1e-15


def test_logarithm():
    theirs = Rotation.from_rotvec(VECTORS)
    assert np.max(np.abs(rotations.log_so3(theirs.as_matrix()) - theirs.as_rotvec())) < 2e-15


@pytest.mark.parametrize("below_pi", [1e-3, 1e-6, 1e-9, 1e-12, 0.0])
def test_logarithm_near_the_half_turn(below_pi):
    axis = np.concatenate([RNG.standard_normal((100, 3)), np.eye(3), -np.eye(3)])
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    vector = (np.pi - below_pi) * axis
    back = rotations.log_so3(Rotation.from_rotvec(vector).as_matrix())
    # At the half turn itself the sign of the axis is free; just below it, rounding may decide it.
    error = np.linalg.norm(back - vector, axis=1)
    if below_pi < 1e-15:
        error = np.minimum(error, np.linalg.norm(back + vector, axis=1))
    assert np.max(error) < 3e-15


def test_products():
    a, b = Rotation.from_rotvec(VECTORS), Rotation.from_rotvec(VECTORS[::-1])
    ours = rotations.quaternion_multiply(a.as_quat(scalar_first=True), b.as_quat(scalar_first=True))
    assert np.max(np.abs(rotations.rot_from_quaternion(ours) - (a * b).as_matrix())) < 2e-15
