"""Laws of rotations that hold for any angle."""

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from truenorth import rotations

ANGLE = st.floats(-np.pi, np.pi)
VECTOR = hnp.arrays(float, 3, elements=st.floats(-1e3, 1e3))
SMALL = hnp.arrays(float, 3, elements=st.floats(-1.8, 1.8))
QUATERNION = hnp.arrays(float, 4, elements=st.floats(-1.0, 1.0)).filter(lambda q: np.linalg.norm(q) > 1e-3)


def assert_rotation(rot, tolerance=4e-15):
    assert np.max(np.abs(rot @ rot.T - np.eye(3))) < tolerance
    assert abs(np.linalg.det(rot) - 1.0) < tolerance


@given(ANGLE, st.floats(-np.pi / 2, np.pi / 2), ANGLE)
@example(0.3, np.pi / 2, 0.4)
@example(0.3, -np.pi / 2, 0.4)
@example(-5e-324, 0.0, 0.0)
def test_angles_describe_the_attitude_they_came_from(heading, pitch, roll):
    rot = rotations.rot_ned_from_body(heading, pitch, roll)
    assert_rotation(rot)
    back = rotations.heading_pitch_roll(rot)
    assert 0.0 <= back[0] < 2 * np.pi
    # Near the vertical the angles are not determined, the attitude is.
    assert np.max(np.abs(rotations.rot_ned_from_body(*back) - rot)) < 4e-15


@given(VECTOR)
def test_exponential_is_a_rotation(vector):
    # The sine of a large angle has the rounding of the angle itself.
    assert_rotation(rotations.exp_so3(vector), 4e-15 * (1.0 + np.linalg.norm(vector)))
    assert np.allclose(rotations.exp_so3(vector) @ vector, vector, rtol=1e-13, atol=1e-12)


@given(SMALL)
@example(np.array([1e-160, 0.0, 0.0]))
@example(np.array([0.0, 1e-9, -1e-9]))
def test_logarithm_undoes_the_exponential(vector):
    # |vector| stays below pi, so the vector is unique.
    assert np.max(np.abs(rotations.log_so3(rotations.exp_so3(vector)) - vector)) < 8e-15


@given(QUATERNION, QUATERNION)
def test_quaternions_multiply_like_their_matrices(first, second):
    product = rotations.rot_from_quaternion(rotations.quaternion_multiply(first, second))
    matrices = rotations.rot_from_quaternion(first) @ rotations.rot_from_quaternion(second)
    assert np.max(np.abs(product - matrices)) < 4e-15
    assert_rotation(product)


@given(QUATERNION)
def test_quaternion_round_trip(quaternion):
    unit = quaternion / np.linalg.norm(quaternion)
    back = rotations.quaternion_from_rot(rotations.rot_from_quaternion(quaternion))
    assert back[0] >= 0.0
    assert min(np.max(np.abs(back - unit)), np.max(np.abs(back + unit))) < 2e-15


@given(VECTOR, VECTOR)
def test_skew_is_the_cross_product(a, b):
    # A last bit of each product where the processor fuses the multiplication with the addition.
    assert np.allclose(rotations.skew(a) @ b, np.cross(a, b), rtol=1e-12, atol=1e-9)


@given(ANGLE, st.floats(-1.5, 1.5), ANGLE, SMALL)
def test_euler_rates_give_the_body_rate(heading, pitch, roll, rates):
    def attitude(t):
        angles = np.array([heading, pitch, roll]) + rates * t
        return rotations.rot_ned_from_body(*angles)

    step = 1e-4
    turned = rotations.log_so3(attitude(-step).T @ attitude(step)) / (2 * step)
    rate = rotations.body_rate_from_euler_rates(pitch, roll, *rates)
    # A central difference: error of third order in the step, and the rounding divided by it.
    assert np.max(np.abs(turned - rate)) < 2e-7
