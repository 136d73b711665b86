"""The chain from position errors to angle errors: every Jacobian, the published sweeps, the closed form."""

import numpy as np
import pytest

from truenorth.attitude.conventions import angles_213, rot_213
from truenorth.attitude.error_chain import (
    angles_213_jacobian,
    baseline_length_model,
    columns_jacobian,
    cross_product_jacobian,
    difference_jacobian,
    local_level_jacobian,
    matrix_jacobians,
    propagate,
    three_antenna_chain,
)
from truenorth.errors import ConfigError
from truenorth.frames import rot_enu_from_ecef

ATTITUDE = np.radians([2.0, 6.0, 12.0])
BODY_M = np.array([[0.0, 0.0, 0.0], [0.7825, 1.3345, 0.0], [1.565, 0.0, 0.0]])
"""Right, forward, up; the cross of the thesis, its four arms at right angles."""


def finite_differences(function, at, step=1e-6):
    """Central differences of a vector function of a vector."""
    columns = []
    for direction in np.eye(len(at)):
        columns.append((function(at + step * direction) - function(at - step * direction)) / (2.0 * step))
    return np.column_stack(columns)


def test_each_step_is_the_derivative_of_what_it_says():
    rng = np.random.default_rng(1)
    u, v, body_u, body_v = rng.standard_normal((4, 3))

    def columns(x):
        return np.concatenate([x, np.cross(x[:3], x[3:])])

    at = np.concatenate([u, v])
    np.testing.assert_allclose(
        cross_product_jacobian(u, v), finite_differences(lambda x: np.cross(x[:3], x[3:]), at), atol=1e-8
    )
    np.testing.assert_allclose(columns_jacobian(u, v), finite_differences(columns, at), atol=1e-8)
    local = columns(at).reshape(3, 3).T
    body = columns(np.concatenate([body_u, body_v])).reshape(3, 3).T
    by_local, by_body = matrix_jacobians(local, body)

    def matrix(left, right):
        return (right.reshape(3, 3).T @ np.linalg.inv(left.reshape(3, 3).T)).T.ravel()

    np.testing.assert_allclose(
        by_local, finite_differences(lambda x: matrix(x, body.T.ravel()), local.T.ravel()), atol=1e-6
    )
    np.testing.assert_allclose(
        by_body, finite_differences(lambda x: matrix(local.T.ravel(), x), body.T.ravel()), atol=1e-7
    )
    rot = rot_213(*ATTITUDE)
    np.testing.assert_allclose(
        angles_213_jacobian(rot),
        finite_differences(lambda x: np.array(angles_213(x.reshape(3, 3).T)), rot.T.ravel()),
        atol=1e-9,
    )


def test_the_printed_jacobian_of_the_cross_product():
    u, v = np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0])
    printed = [[0, 6, -5, 0, -3, 2], [-6, 0, 4, 3, 0, -1], [5, -4, 0, -2, 1, 0]]
    np.testing.assert_array_equal(cross_product_jacobian(u, v), printed)


def test_differences_keep_the_correlation_of_the_common_point():
    rng = np.random.default_rng(2)
    blocks = [np.cov(rng.standard_normal((3, 20))) for _ in range(3)]
    whole = np.zeros((9, 9))
    for k, block in enumerate(blocks):
        whole[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = block
    found = propagate(difference_jacobian([(0, 1), (0, 2)], 3), whole)
    expected = np.block([[blocks[0] + blocks[1], blocks[0]], [blocks[0], blocks[0] + blocks[2]]])
    np.testing.assert_allclose(found, expected, atol=1e-14)


def test_the_local_axes_of_the_thesis_are_left_handed():
    latitude, longitude = np.radians([47.0, 15.5])
    neu = local_level_jacobian(latitude, longitude, 1, convention="neu-fru")
    sp, cp, sl, cl = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    np.testing.assert_allclose(
        neu, [[-sp * cl, -sp * sl, cp], [-sl, cl, 0], [cp * cl, cp * sl, sp]], atol=1e-15
    )
    assert np.linalg.det(neu) == pytest.approx(-1.0)


def chain(local_cov_m2, *, body_cov_m2=None, at=None):
    """The chain for the thesis attitude, points in east, north, up or on the ellipsoid."""
    points_m = BODY_M @ rot_213(*ATTITUDE)
    body_cov_m2 = np.zeros((9, 9)) if body_cov_m2 is None else body_cov_m2
    if at is None:
        return three_antenna_chain(points_m, local_cov_m2, BODY_M, body_cov_m2)
    down = np.kron(np.eye(3), rot_enu_from_ecef(*at).T)
    ecef_m = np.array([4.2e6, 1.1e6, 4.6e6]) + points_m @ down[:3, :3].T
    return three_antenna_chain(
        ecef_m, propagate(down, local_cov_m2), BODY_M, body_cov_m2, latitude_rad=at[0], longitude_rad=at[1]
    )


def test_the_whole_chain_is_the_derivative_of_the_whole_computation():
    points_m = BODY_M @ rot_213(*ATTITUDE)

    def angles(x):
        p, b = x[:9].reshape(3, 3), x[9:].reshape(3, 3)
        columns = [
            np.column_stack([q[1] - q[0], q[2] - q[0], np.cross(q[1] - q[0], q[2] - q[0])]) for q in (p, b)
        ]
        return np.array(angles_213(columns[1] @ np.linalg.inv(columns[0])))

    rng = np.random.default_rng(3)
    cov, body_cov = (np.cov(rng.standard_normal((9, 30))) * 1e-4 for _ in range(2))
    jacobian = finite_differences(angles, np.concatenate([points_m.ravel(), BODY_M.ravel()]))
    expected = jacobian[:, :9] @ cov @ jacobian[:, :9].T + jacobian[:, 9:] @ body_cov @ jacobian[:, 9:].T
    found = chain(cov, body_cov_m2=body_cov)
    np.testing.assert_allclose(found.cov_rad2, expected, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(found.angle_rad, ATTITUDE, atol=1e-13)


def test_the_place_on_earth_changes_nothing():
    rng = np.random.default_rng(4)
    cov = np.cov(rng.standard_normal((9, 30))) * 1e-4
    here, there = chain(cov), chain(cov, at=np.radians([47.0, 15.5]))
    # Coordinates of millions of metres leave nine digits of a metre.
    np.testing.assert_allclose(there.cov_rad2, here.cov_rad2, rtol=1e-7)
    np.testing.assert_allclose(there.angle_rad, ATTITUDE, atol=1e-8)


def test_the_chain_agrees_with_monte_carlo():
    rng = np.random.default_rng(5)
    n, sd_m = 20_000, 0.01
    points_m = BODY_M @ rot_213(*ATTITUDE) + sd_m * rng.standard_normal((n, 3, 3))
    body_m = BODY_M + sd_m * rng.standard_normal((n, 3, 3))
    u, v = np.moveaxis(points_m[:, 1:] - points_m[:, :1], 1, 0)
    b_u, b_v = np.moveaxis(body_m[:, 1:] - body_m[:, :1], 1, 0)
    local = np.stack([u, v, np.cross(u, v)], axis=2)
    body = np.stack([b_u, b_v, np.cross(b_u, b_v)], axis=2)
    angles = np.stack(angles_213(body @ np.linalg.inv(local)), axis=1)
    found = chain(sd_m**2 * np.eye(9), body_cov_m2=sd_m**2 * np.eye(9))
    # Five standard deviations of a standard deviation from 20,000 draws, 0.5 %, and 0.2 % of second order.
    np.testing.assert_allclose(np.std(angles, axis=0), found.sd_rad, rtol=0.027)


def test_common_errors_scale_the_angles_and_their_order_is_that_of_the_thesis():
    """Table 3.6: exactly linear in the error; the geometry of the table is lost, its shape is not."""
    error_m = np.array([0.001, 0.01, 0.1, 0.5])
    found = chain(error_m[:, None, None] ** 2 * np.eye(9))
    np.testing.assert_allclose(found.sd_rad / error_m[:, None], found.sd_rad[0] / 0.001 * np.ones((4, 1)))
    # The first-order values of the reference geometry at 1 cm, printed with three decimals.
    np.testing.assert_allclose(np.degrees(found.sd_rad[1]), [0.521, 0.526, 0.521], atol=6e-4)
    # Magnitude of the table: 0.34, 0.25, 0.25 degrees for 1 cm with longer arms.
    assert np.all((np.degrees(found.sd_rad[1]) > 0.25) & (np.degrees(found.sd_rad[1]) < 1.0))


def test_one_bad_coordinate_spoils_the_angle_that_rests_on_it():
    """Fig. 3.7: all coordinates 10 cm, one of one point from 1 mm to 50 cm; the yaw rises, the others hardly.

    The direct method takes the forward axis across the second vector and the cross product, so the yaw rests
    on the second vector: with right angles the point is P3 and the coordinate the one across that arm.
    """
    sd_m = np.full((3, 9), 0.1)
    sd_m[:, 7] = [0.001, 0.1, 0.5]
    # With the arms of the thesis: the long one ahead, the other across.
    body_m = np.array([[0.0, 0.0, 0.0], [0.0, 2.669, 0.0], [1.565, 0.0, 0.0]])
    found = three_antenna_chain(
        body_m @ rot_213(*ATTITUDE), sd_m[:, :, None] ** 2 * np.eye(9), body_m, np.zeros((9, 9))
    )
    roll, pitch, yaw = found.sd_rad.T
    assert yaw[2] > 4.0 * yaw[0]
    assert abs(pitch[2] / pitch[0] - 1.0) < 0.05
    # "A small rise": 5 % where the yaw grows fivefold.
    assert 0.0 < roll[2] / roll[0] - 1.0 < 0.1


@pytest.mark.parametrize(
    ("sd_m", "a_m", "b_m", "roll_deg", "pitch_deg", "decimals"),
    [
        (0.01, 0.1, 1.57, None, 5.73, 2),
        (0.01, 10.0, 1.57, None, 0.0573, 4),
        (0.01, 2.16, 0.1, 8.10, None, 2),
        (0.01, 2.16, 10.0, 0.0810, None, 4),
        (0.01, 2.16, 1.57, 0.516, 0.265, 3),
        (0.10, 2.16, 1.5, 5.40, None, 2),
    ],
)
@pytest.mark.parametrize("form", ["sine", "cosine"])
def test_the_closed_form_has_the_printed_values(sd_m, a_m, b_m, roll_deg, pitch_deg, decimals, form):
    found = np.degrees(baseline_length_model(sd_m, a_m, b_m, np.radians(45.0), form=form))
    tolerance = 0.51 * 10.0**-decimals
    if roll_deg is not None:
        assert found[0] == pytest.approx(roll_deg, abs=tolerance)
    if pitch_deg is not None:
        assert found[1] == pytest.approx(pitch_deg, abs=tolerance)
        assert found[2] == pytest.approx(pitch_deg, abs=tolerance)


def test_the_requirement_of_the_thesis():
    """Two centimetres are about one degree of roll."""
    assert np.degrees(baseline_length_model(0.02, 2.16, 1.57, np.radians(45.0)).roll_rad) == pytest.approx(
        1.03, abs=0.005
    )


def test_the_closed_form_over_lengths_and_its_forms():
    a_m = np.array([0.1, 1.0, 10.0])
    found = baseline_length_model(0.01, a_m, 1.57, np.radians(45.0))
    np.testing.assert_allclose(found.pitch_rad * a_m, 0.01)
    right = baseline_length_model(0.01, 2.0, 1.5, np.radians(90.0))
    assert right.roll_rad == pytest.approx(0.01 / 1.5)
    assert baseline_length_model(0.01, 2.0, 1.5, np.radians(90.0), form="cosine").roll_rad > 1e10
    steep = baseline_length_model(0.01, 2.0, 1.5, 1.0, elevation_rad=np.radians(60.0))
    assert steep.yaw_rad == pytest.approx(2.0 * steep.pitch_rad)
    with pytest.raises(ConfigError, match="give `sine` or `cosine`"):
        baseline_length_model(0.01, 1.0, 1.0, 1.0, form="tangent")
