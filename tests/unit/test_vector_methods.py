"""Attitude from vectors by every method: exact data, covariances by differences, what cannot be observed."""

from dataclasses import replace

import numpy as np
import pytest

from synthetic_vectors import (
    antenna_covariance,
    make_vectors,
    random_rotations,
    turn_between,
    vector_covariance,
)
from truenorth.attitude.classical_vectors import (
    angles_of_matrix,
    direct_matrix,
    point_a_distance_m,
    triad_matrix,
)
from truenorth.attitude.conventions import angles_213, local_axes
from truenorth.attitude.vector_methods import VECTOR_METHODS, attitude_from_vectors
from truenorth.attitude.vectors import fit_rotation, mirrored_rotation, total_covariance
from truenorth.errors import ConfigError, Reason
from truenorth.rotations import exp_so3, rot_ned_from_body

BODY_M = np.array([[0.0, 0.0, 0.0], [2.0, 0.1, 0.0], [1.0, 1.5, -0.3], [0.5, -1.2, 0.4]])
FLAT_M = BODY_M * [1.0, 1.0, 0.0]


def correlated(n_antennas, seed=3, scale_m=0.003):
    """A joint covariance of antennas without any structure."""
    rng = np.random.default_rng(seed)
    factor = rng.standard_normal((3 * n_antennas, 3 * n_antennas))
    return scale_m**2 * (factor @ factor.T / (3 * n_antennas) + 0.3 * np.eye(3 * n_antennas))


@pytest.mark.parametrize("method", VECTOR_METHODS)
@pytest.mark.parametrize("body_m", [BODY_M, FLAT_M, BODY_M[:3]])
@pytest.mark.parametrize("reference", [0, 1])
def test_vectors_without_errors_give_the_attitude(method, body_m, reference):
    rot = random_rotations(40)
    fit = attitude_from_vectors(make_vectors(body_m, rot, noise=False, reference=reference), method)
    assert fit.is_solved.all()
    assert (fit.reason == Reason.OK).all()
    np.testing.assert_allclose(fit.rot_ned_from_body, rot, atol=1e-9)
    np.testing.assert_allclose(
        rot_ned_from_body(fit.heading_rad, fit.pitch_rad, fit.roll_rad), rot, atol=1e-9
    )
    assert np.nanmax(fit.chi2) < 1e-9
    assert fit.is_used.sum() == 40 * (len(body_m) - 1)
    np.testing.assert_array_equal(fit.dof, 3 * len(body_m) - 6)


@pytest.mark.parametrize("method", VECTOR_METHODS)
def test_the_covariance_is_that_of_finite_differences(method):
    """Each component of each vector and of the body is moved; what the angles do is added up."""
    body_m, step = BODY_M, 1e-6
    rot = random_rotations(1, seed=5)
    antenna_cov = correlated(4)
    body_cov = correlated(4, seed=8, scale_m=0.002)
    clean = make_vectors(body_m, rot, antenna_cov_m2=antenna_cov, noise=False)
    clean = replace(clean, body_cov_m2=body_cov)
    reference = attitude_from_vectors(clean, method)
    vector = np.repeat(clean.vector_ned_m, 18, axis=0)
    for k in range(9):
        vector[2 * k, 1 + k // 3, k % 3] += step
        vector[2 * k + 1, 1 + k // 3, k % 3] -= step
    many = replace(
        clean, time_ns=np.zeros(18, np.int64), reference=np.zeros(18, np.int64), vector_ned_m=vector,
        cov_ned_m2=np.repeat(clean.cov_ned_m2, 18, axis=0),
    )  # fmt: skip
    angles = attitude_from_vectors(many, method).angles_rad
    jacobian = ((angles[::2] - angles[1::2]) / (2.0 * step)).T
    expected = jacobian @ clean.cov_ned_m2[0, 3:, 3:] @ jacobian.T
    moved = np.empty((3, 12))
    for k in range(12):
        change = step * np.eye(12)[k].reshape(4, 3)
        ahead, behind = (
            attitude_from_vectors(replace(clean, positions_body_m=body_m + side * change), method).angles_rad
            for side in (1.0, -1.0)
        )
        moved[:, k] = (ahead - behind)[0] / (2.0 * step)
    expected += moved @ body_cov @ moved.T
    # Second derivatives times the step: 1e-6.
    np.testing.assert_allclose(reference.cov_rad2[0], expected, rtol=1e-4, atol=1e-12)
    sd = np.sqrt(np.diagonal(expected))
    assert [reference.angle_sd_rad(k)[0] for k in range(3)] == pytest.approx(sd, rel=1e-4)


def test_implicit_least_squares_is_the_adjustment_in_angles():
    vectors = make_vectors(BODY_M, random_rotations(200), antenna_cov_m2=correlated(4, scale_m=0.02))
    vectors = replace(vectors, body_cov_m2=correlated(4, seed=9, scale_m=0.01))
    default, implicit = (attitude_from_vectors(vectors, method) for method in ("adjustment", "implicit"))
    turn = turn_between(default.rot_ned_from_body, implicit.rot_ned_from_body)
    assert np.max(np.abs(turn)) < 1e-8
    np.testing.assert_allclose(implicit.cov_rad2, default.cov_rad2, rtol=1e-6, atol=1e-11)


def test_points_of_equal_weight_are_the_adjustment_for_alike_antennas():
    vectors = make_vectors(BODY_M, random_rotations(100), sd_m=0.01)
    default, wahba = (attitude_from_vectors(vectors, method) for method in ("adjustment", "wahba"))
    np.testing.assert_allclose(wahba.rot_ned_from_body, default.rot_ned_from_body, atol=1e-9)
    np.testing.assert_allclose(wahba.cov_ned_rad2, default.cov_ned_rad2, rtol=1e-4, atol=1e-10)


def test_the_default_is_the_least_of_all():
    # A tenth of a millimetre, so that all have their covariance at the same attitude.
    vectors = make_vectors(BODY_M, random_rotations(100), antenna_cov_m2=correlated(4, scale_m=1e-4))
    vectors = replace(vectors, body_cov_m2=correlated(4, seed=4, scale_m=5e-5))
    best = attitude_from_vectors(vectors)
    for method in VECTOR_METHODS[2:]:
        other = attitude_from_vectors(vectors, method)
        assert (other.chi2 >= best.chi2 * (1.0 - 1e-3)).all()
        # Less variance in every direction; the share is that of the noise in the vectors.
        more = np.linalg.eigvalsh(other.cov_ned_rad2 - best.cov_ned_rad2)
        assert more.min() > -1e-3 * np.trace(best.cov_ned_rad2, axis1=1, axis2=2).max()
        assert more.max(1).min() > 0.0


def test_the_minimum_is_stationary_under_the_joint_covariance():
    vectors = make_vectors(BODY_M, random_rotations(20), antenna_cov_m2=correlated(4, scale_m=0.02))
    (block,) = vectors.blocks()
    fit = fit_rotation(block.vector_ned_m, block.cov_ned_m2, block.body_m)
    inverse = np.linalg.inv(block.cov_ned_m2)
    residual = fit.residual_m.reshape(20, 9)
    np.testing.assert_allclose(np.einsum("ni,nij,nj->n", residual, inverse, residual), fit.chi2, rtol=1e-9)
    for axis in np.eye(3):
        for side in (-1e-4, 1e-4):
            turned = exp_so3(side * axis) @ fit.rot_ned_from_body
            moved = (block.vector_ned_m - np.einsum("nij,kj->nki", turned, block.body_m)).reshape(20, 9)
            assert (np.einsum("ni,nij,nj->n", moved, inverse, moved) > fit.chi2).all()


def test_covariances_that_turn_with_the_body():
    rot = random_rotations(3)
    body_cov = correlated(4)[3:, 3:]
    cov = np.tile(np.eye(9), (3, 1, 1))
    whole = total_covariance(cov, rot, body_cov)
    for k in range(3):
        turn = np.kron(np.eye(3), rot[k])
        np.testing.assert_allclose(whole[k], np.eye(9) + turn @ body_cov @ turn.T, rtol=1e-12, atol=1e-15)


def test_the_point_a_of_the_thesis():
    """Arms of 2.669 m and 1.565 m that cross at their middles: 1.547 m, 59.6 degrees, 1.3345 m."""
    s12 = np.hypot(0.7825, 1.3345)
    assert s12 == pytest.approx(1.547, abs=5e-4)
    assert np.degrees(np.arctan2(1.3345, 0.7825)) == pytest.approx(59.6, abs=0.05)
    assert point_a_distance_m(s12, 1.565, s12) == pytest.approx(1.3345, abs=1e-12)


def test_the_triad_keeps_its_second_vector():
    """Heading and roll come from the cross arm alone, the pitch from the one ahead."""
    body_m = np.array([[1.3345, 0.7825, 0.0], [0.0, 1.565, 0.0]])
    rot = random_rotations(30)
    rng = np.random.default_rng(1)
    measured = np.einsum("nij,kj->nki", rot, body_m)
    disturbed = measured.copy()
    disturbed[:, 0] += 0.05 * rng.standard_normal((30, 3))
    across = rot[:, :, 1]
    matrix = triad_matrix(disturbed, body_m).rot_body_from_ned
    np.testing.assert_allclose(matrix[:, 1], across, atol=1e-12)
    heading, pitch, roll = angles_of_matrix(matrix).T
    # A true cross arm comes back as it is in the body frame.
    np.testing.assert_allclose(
        np.einsum("nij,nj->ni", matrix, measured[:, 1]), np.tile(body_m[1], (30, 1)), atol=1e-12
    )
    assert np.isfinite(heading + pitch + roll).all()
    assert (
        np.linalg.norm(direct_matrix(disturbed, body_m).rot_body_from_ned[:, 1] - across, axis=1).max() > 1e-3
    )


def test_left_and_right_handed_axes_must_not_be_mixed():
    """On north, east, up and forward, right, up alike, the triad is right; on one of them only, it fails."""
    body_m = np.array([[1.3345, 0.7825, 0.1], [0.0, 1.565, 0.0]])
    flip = local_axes("neu-fru")
    rot = random_rotations(20, seed=9)
    measured = np.einsum("nij,kj->nki", rot, body_m)
    right = triad_matrix(measured, body_m).rot_body_from_ned
    both = triad_matrix(measured @ flip, body_m @ flip).rot_body_from_ned
    np.testing.assert_allclose(flip @ both @ flip, right, atol=1e-12)
    mixed = flip @ triad_matrix(measured @ flip, body_m).rot_body_from_ned
    # The cross product points down in one frame and up in the other: no rotation of the body at all.
    assert np.max(np.abs(np.abs(mixed - np.swapaxes(rot, 1, 2)).max((1, 2)))) > 0.5


def test_thesis_angles_are_read_from_the_same_elements():
    rng = np.random.default_rng(4)
    matrix = rng.standard_normal((50, 3, 3))
    axes = local_axes("enu-rfu")
    roll, pitch, yaw = angles_213(axes @ matrix @ axes)
    heading = np.mod(-yaw, 2.0 * np.pi)
    np.testing.assert_allclose(angles_of_matrix(matrix), np.stack([heading, pitch, roll], axis=1), atol=1e-12)


def test_pairs_choose_the_vectors():
    vectors = make_vectors(BODY_M, random_rotations(10), sd_m=0.01)
    default = attitude_from_vectors(vectors, "direct")
    same = attitude_from_vectors(vectors, "direct", pairs=[(0, 1), (0, 2)])
    other = attitude_from_vectors(vectors, "direct", pairs=[(1, 3), (1, 2)])
    np.testing.assert_array_equal(default.rot_ned_from_body, same.rot_ned_from_body)
    # Other vectors see other errors: a centimetre over a metre or two.
    apart = np.abs(turn_between(default.rot_ned_from_body, other.rot_ned_from_body))
    assert 1e-3 < apart.max() < 0.2
    without = attitude_from_vectors(
        vectors, "direct", pairs=[(0, 1), (0, 3)], is_used=np.array([True, True, True, False])
    )
    assert not without.is_solved.any()
    assert (without.reason == Reason.NO_VECTORS).all()
    flat = attitude_from_vectors(vectors, "pseudoinverse", with_cross=False)
    assert flat.is_solved.all()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"method": "quest"}, "give one of adjustment"),
        ({"method": "direct", "pairs": [(0, 1)]}, "takes two"),
        ({"method": "direct", "pairs": [(0, 1), (0, 7)]}, "4 antennas"),
    ],
)
def test_refuses_what_cannot_be(options, words):
    with pytest.raises(ConfigError, match=words):
        attitude_from_vectors(make_vectors(BODY_M, random_rotations(2)), **options)


@pytest.mark.parametrize("method", VECTOR_METHODS)
def test_two_antennas_have_no_roll(method):
    body_m = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    rot = random_rotations(50, tilt_rad=0.3)
    fit = attitude_from_vectors(make_vectors(body_m, rot, sd_m=1e-6), method)
    assert (fit.reason == Reason.ROLL_UNOBSERVABLE).all()
    assert np.isnan(fit.roll_rad).all()
    assert np.isnan(fit.rot_ned_from_body).all()
    assert np.isnan(fit.cov_rad2[:, 2]).all()
    if method == "adjustment":
        assert fit.is_solved.all()
        np.testing.assert_allclose(np.cos(fit.heading_rad) * np.cos(fit.pitch_rad), rot[:, 0, 0], atol=1e-5)
        np.testing.assert_allclose(-np.sin(fit.pitch_rad), rot[:, 2, 0], atol=1e-5)
        np.testing.assert_array_equal(fit.dof, 1)
    else:
        assert not fit.is_solved.any()


def test_antennas_on_a_line_across_give_no_angle_but_a_test():
    body_m = np.array([[0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, -1.0, 0.0]])
    fit = attitude_from_vectors(make_vectors(body_m, random_rotations(50), sd_m=0.003))
    assert (fit.reason == Reason.DIRECTION_ONLY).all()
    assert not fit.is_solved.any()
    assert np.isnan(fit.angles_rad).all()
    assert np.isfinite(fit.chi2).all()
    np.testing.assert_array_equal(fit.dof, 4)


def weak_vectors(body_m, rot, weak_sd_m, seed=1):
    """Vectors that the phases measure to 3 mm, but not their heights."""
    cov = antenna_covariance((0.003, 0.003, weak_sd_m), len(body_m))
    return make_vectors(body_m, rot, antenna_cov_m2=cov, seed=seed)


def test_vectors_measured_in_a_plane_only_have_two_attitudes():
    rot = random_rotations(60, tilt_rad=0.3)
    fit = attitude_from_vectors(weak_vectors(FLAT_M, rot, 100.0))
    # Where the array is level there is but one, whose tilt is not known.
    assert np.isin(fit.reason, [Reason.MIRROR_AMBIGUOUS, Reason.WEAK_GEOMETRY]).all()
    assert np.mean(fit.reason == Reason.MIRROR_AMBIGUOUS) > 0.8
    said = fit.reason == Reason.MIRROR_AMBIGUOUS
    assert np.isnan(fit.angles_rad[said]).all()
    assert not fit.is_solved[said].any()
    # Three centimetres of the height tell them apart.
    fit = attitude_from_vectors(weak_vectors(FLAT_M, rot, 0.03))
    assert fit.is_solved.all()
    assert np.max(np.abs(turn_between(fit.rot_ned_from_body, rot))) < 0.2


def test_a_weak_direction_does_not_lead_to_the_mirror_image():
    """The start knows nothing of the weak direction and may fall on the wrong side; both are tried."""
    rot = random_rotations(300, tilt_rad=0.5)
    fit = attitude_from_vectors(weak_vectors(FLAT_M, rot, 0.3, seed=6))
    solved = fit.is_solved
    assert 0.1 < np.mean(solved) < 0.999
    sd = np.sqrt(np.einsum("nii->ni", fit.cov_ned_rad2[solved]))
    turn = turn_between(fit.rot_ned_from_body[solved], rot[solved])
    assert np.max(np.abs(turn) / sd) < 6.0


def test_height_of_the_array_tells_the_mirror_images_apart():
    rot = random_rotations(60, tilt_rad=0.3)
    fit = attitude_from_vectors(weak_vectors(BODY_M, rot, 100.0))
    good = fit.is_solved
    assert np.mean(good) > 0.8
    assert np.max(np.abs(turn_between(fit.rot_ned_from_body[good], rot[good]))) < 0.3


def test_a_direction_measured_in_a_plane_only_has_two_sides():
    """Two antennas under three satellites: the sphere of the length meets a line twice."""
    body_m = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    rot = rot_ned_from_body(np.full(20, 0.8), np.full(20, 0.1), np.zeros(20))
    fit = attitude_from_vectors(weak_vectors(body_m, rot, 100.0))
    assert (fit.reason == Reason.MIRROR_AMBIGUOUS).all()
    assert attitude_from_vectors(weak_vectors(body_m, rot, 0.01)).is_solved.all()


def test_mirrored_vectors_are_those_of_the_mirrored_attitude():
    rot = random_rotations(10)
    direction = np.random.default_rng(2).standard_normal((10, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    other = mirrored_rotation(rot, FLAT_M[1:], direction)
    np.testing.assert_allclose(np.linalg.det(other), 1.0, atol=1e-12)
    mirror = np.eye(3) - 2.0 * direction[:, :, None] * direction[:, None, :]
    np.testing.assert_allclose(other @ FLAT_M[1:].T, mirror @ rot @ FLAT_M[1:].T, atol=1e-12)


def test_an_attitude_known_to_a_radian_is_not_known():
    fit = attitude_from_vectors(make_vectors(BODY_M, random_rotations(30), sd_m=3.0))
    assert np.isin(fit.reason, [Reason.WEAK_GEOMETRY, Reason.MIRROR_AMBIGUOUS]).all()
    assert not fit.is_solved.any()


def test_epochs_without_vectors_or_covariance_say_so():
    vectors = make_vectors(BODY_M, random_rotations(6))
    vector, cov = vectors.vector_ned_m.copy(), vectors.cov_ned_m2.copy()
    vector[0] = np.nan
    cov[1] = np.nan
    cov[2, 3:, 3:] = np.ones((9, 9))
    fit = attitude_from_vectors(replace(vectors, vector_ned_m=vector, cov_ned_m2=cov))
    np.testing.assert_array_equal(fit.is_solved, [False, False, False, True, True, True])
    np.testing.assert_array_equal(
        fit.reason[:3], [Reason.NO_VECTORS, Reason.WEAK_GEOMETRY, Reason.WEAK_GEOMETRY]
    )
    assert not fit.is_used[:3].any()
    assert fit.n_epochs == 6
    none = attitude_from_vectors(replace(vectors, cov_ned_m2=np.full_like(cov, np.nan)))
    assert not none.is_solved.any()


def test_epochs_with_other_antennas_and_references_are_solved_side_by_side():
    rot = random_rotations(12)
    parts = [make_vectors(BODY_M, rot, reference=k, noise=False) for k in range(4)]
    pick = np.arange(12) % 4
    mixed = replace(
        parts[0],
        reference=pick,
        vector_ned_m=np.stack([parts[k].vector_ned_m[n] for n, k in enumerate(pick)]),
        cov_ned_m2=np.stack([vector_covariance(antenna_covariance(0.003, 4), k) for k in pick]),
    )
    is_used = np.ones((12, 4), bool)
    is_used[5:, 3] = False
    fit = attitude_from_vectors(mixed, is_used=is_used)
    np.testing.assert_allclose(fit.rot_ned_from_body, rot, atol=1e-9)
    assert fit.is_used.sum(1).tolist() == [3] * 5 + [2, 2, 3, 2, 2, 2, 3]


def test_the_nose_straight_up_has_a_rotation():
    rot = rot_ned_from_body(np.array([0.3]), np.array([0.5 * np.pi]), np.array([0.0]))
    fit = attitude_from_vectors(make_vectors(BODY_M, rot, noise=False))
    np.testing.assert_allclose(fit.rot_ned_from_body, rot, atol=1e-9)
    assert np.isfinite(fit.cov_ned_rad2).all()


@pytest.mark.parametrize("method", ["adjustment", "implicit", "wahba"])
def test_it_does_not_matter_which_antenna_is_the_reference(method):
    """The same positions, written as vectors from any antenna with their joint covariance."""
    rot = random_rotations(30)
    cov = correlated(4, scale_m=0.01)
    body_cov = correlated(4, seed=8, scale_m=0.005)
    fits = [
        attitude_from_vectors(
            replace(make_vectors(BODY_M, rot, antenna_cov_m2=cov, reference=k, seed=7), body_cov_m2=body_cov),
            method,
        )
        for k in range(4)
    ]
    for fit in fits[1:]:
        np.testing.assert_allclose(fit.rot_ned_from_body, fits[0].rot_ned_from_body, atol=1e-8)
        np.testing.assert_allclose(fit.chi2, fits[0].chi2, rtol=1e-6)
        np.testing.assert_allclose(fit.cov_rad2, fits[0].cov_rad2, rtol=1e-5, atol=1e-9)


def test_a_turned_world_turns_the_attitude():
    """Vectors and covariance turned together: the same chi-square and covariance, turned."""
    vectors = make_vectors(BODY_M, random_rotations(20), antenna_cov_m2=correlated(4, scale_m=0.01))
    turn = rot_ned_from_body(1.0, 0.4, -2.0)
    whole = np.kron(np.eye(4), turn)
    other = replace(
        vectors,
        vector_ned_m=vectors.vector_ned_m @ turn.T,
        cov_ned_m2=whole @ np.nan_to_num(vectors.cov_ned_m2) @ whole.T,
    )
    here, there = attitude_from_vectors(vectors), attitude_from_vectors(other)
    np.testing.assert_allclose(there.rot_ned_from_body, turn @ here.rot_ned_from_body, atol=1e-8)
    np.testing.assert_allclose(there.chi2, here.chi2, rtol=1e-6)
    np.testing.assert_allclose(there.cov_ned_rad2, turn @ here.cov_ned_rad2 @ turn.T, rtol=1e-5, atol=1e-11)


def test_vectors_with_poor_heights_converge():
    """Heights of 2 cm on a third of a metre: Gauss-Newton alone does not come to rest in one of ten."""
    body_m = np.array([[0.0, 0.0, 0.0], [0.33, 0.0, 0.0], [0.0, 0.33, 0.0]])
    rot = random_rotations(2000, tilt_rad=0.15)
    cov = antenna_covariance((0.005, 0.005, 0.02), 3)
    vectors = make_vectors(body_m, rot, antenna_cov_m2=cov)
    (block,) = vectors.blocks()
    assert fit_rotation(block.vector_ned_m, block.cov_ned_m2, block.body_m).is_converged.all()
    fit = attitude_from_vectors(vectors)
    assert np.mean(fit.is_solved) > 0.998
    turn = turn_between(fit.rot_ned_from_body, rot)[fit.is_solved]
    cov = fit.cov_ned_rad2[fit.is_solved]
    nees = np.einsum("ni,ni->n", turn, np.linalg.solve(cov, turn[..., None])[..., 0])
    # 3 to first order; the bend adds a sixth here.
    assert 2.7 < np.mean(nees) < 4.0
