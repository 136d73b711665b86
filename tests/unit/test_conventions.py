"""Published angles against our own: round trips, what each angle means, and the sign of R31."""

import numpy as np
import pytest

from truenorth.attitude.conventions import (
    CONVENTIONS,
    angles_213,
    angles_in_convention,
    body_axes,
    local_axes,
    rot_213,
    rot_from_convention,
)
from truenorth.errors import ConfigError
from truenorth.rotations import rot_ned_from_body


def passive(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    return {
        1: np.array([[1, 0, 0], [0, c, s], [0, -s, c]]),
        2: np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]),
        3: np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]),
    }[axis]


def test_the_published_sequence_is_the_product_of_three_turns():
    r, p, y = 0.3, -0.4, 2.0
    np.testing.assert_allclose(rot_213(r, p, y), passive(2, r) @ passive(1, p) @ passive(3, y), atol=1e-15)


def test_the_printed_sign_of_one_element_makes_no_rotation():
    rot = rot_213(*np.radians([2.0, 6.0, 12.0]))
    assert np.linalg.det(rot) == pytest.approx(1.0, abs=1e-14)
    r, p, y = np.radians([2.0, 6.0, 12.0])
    rot[2, 0] = -np.sin(r) * np.cos(y) + np.cos(r) * np.sin(p) * np.sin(y)
    # Four digits are stated.
    assert np.linalg.det(rot) == pytest.approx(0.9962, abs=5e-5)


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_angles_go_round(convention):
    rng = np.random.default_rng(1)
    angles = rng.uniform(-1.5, 1.5, (3, 200))
    angles[2] = rng.uniform(0.0, np.pi, 200)
    rot = rot_from_convention(convention, *angles)
    np.testing.assert_allclose(
        rot @ np.swapaxes(rot, 1, 2), np.broadcast_to(np.eye(3), rot.shape), atol=1e-14
    )
    np.testing.assert_allclose(np.linalg.det(rot), 1.0, atol=1e-14)
    np.testing.assert_allclose(angles_in_convention(convention, rot), angles, atol=1e-12)


def test_east_north_up_is_ours_with_the_yaw_turned_round():
    """R2(r) R1(p) R3(-h) on right, forward, up is the sequence heading, pitch, roll itself."""
    rng = np.random.default_rng(2)
    heading, pitch, roll = rng.uniform(-1.5, 1.5, (3, 100))
    ours = rot_ned_from_body(heading, pitch, roll)
    np.testing.assert_allclose(rot_from_convention("enu-rfu", roll, pitch, -heading), ours, atol=1e-15)
    # The second row of the matrix is the forward axis in east, north, up.
    rot = rot_213(roll, pitch, -heading)
    np.testing.assert_allclose(rot[:, 1], (local_axes("enu-rfu") @ ours[..., 0].T).T, atol=1e-15)


def test_the_left_handed_axes_turn_the_meaning_of_roll_and_pitch():
    small = 1e-6
    ours = rot_ned_from_body(0.7, 2.0 * small, 3.0 * small)
    r, p, y = angles_in_convention("neu-fru", ours)
    # The products of small angles are 1e-12.
    assert (r, p, y) == pytest.approx((-2.0 * small, -3.0 * small, 0.7), abs=1e-11)
    assert np.linalg.det(local_axes("neu-fru")) == -1.0
    assert np.linalg.det(body_axes("enu-rfu")) == pytest.approx(1.0)


def test_angles_of_a_published_matrix_are_those_of_its_elements():
    assert np.degrees(angles_213(rot_213(*np.radians([2.0, 6.0, 12.0])))) == pytest.approx([2.0, 6.0, 12.0])


def test_refuses_other_names():
    with pytest.raises(ConfigError, match="give one of ned-frd"):
        local_axes("xyz")
