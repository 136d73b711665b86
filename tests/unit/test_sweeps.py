"""Sweeps of error and length against Landfahrer (2009), sections 3.9, 3.10 and what follows from them."""

import numpy as np
import pytest

from truenorth.errors import ConfigError
from truenorth.planning import sweep_coordinate, sweep_error, sweep_length
from truenorth.planning.sweeps import LANDFAHRER_ANTENNAS


@pytest.mark.parametrize(
    ("which", "length_m", "angle", "wanted_deg"),
    [
        ("a", 0.1, "pitch", 5.73),
        ("a", 0.1, "heading", 5.73),
        ("a", 10.0, "pitch", 0.0573),
        ("a", 10.0, "heading", 0.0573),
        ("b", 0.1, "roll", 8.10),
        ("b", 10.0, "roll", 0.0810),
        ("a", 2.16, "pitch", 0.265),
        ("b", 1.57, "roll", 0.516),
    ],
)
def test_published_values_of_the_closed_form(which, length_m, angle, wanted_deg):
    found = sweep_length(which=which, lengths_m=[length_m])
    value = found.curves_deg["closed form"][0, ("heading", "pitch", "roll").index(angle)]
    # Half a unit of the last digit that is given.
    assert value == pytest.approx(wanted_deg, abs=0.5 * 10.0 ** -len(str(wanted_deg).split(".")[1]))


def test_two_centimetres_for_one_degree():
    # Requirement of the source: 0.516 degrees a centimetre.
    found = sweep_length(which="b", lengths_m=[1.57], error_m=0.02)
    assert found.curves_deg["closed form"][0, 2] == pytest.approx(1.03, abs=0.005)
    # Conclusion of the source: 1.5 m and 10 cm give 5.4 degrees; the sine at 45 degrees is the cosine.
    for form in ("sine", "cosine"):
        found = sweep_length(which="b", lengths_m=[1.5], error_m=0.1, form=form)
        assert found.curves_deg["closed form"][0, 2] == pytest.approx(5.40, abs=0.005)


def test_length_sweeps_are_inverse_in_the_length_and_constant_beside():
    found = sweep_length(which="a").curves_deg["closed form"]
    assert found[0, 1] / found[-1, 1] == pytest.approx(100.0)
    assert np.ptp(found[:, 2]) == 0.0


def test_the_error_sweep_is_linear():
    found = sweep_error(errors_m=[0.001, 0.01, 0.1, 0.5])
    for curve in found.curves_deg.values():
        np.testing.assert_allclose(curve / curve[0], np.outer([1.0, 10.0, 100.0, 500.0], np.ones(3)))


def test_three_vectors_and_their_adjustment_have_the_known_accuracy():
    found = sweep_error(errors_m=[0.01])
    # First order of the direct method at 12, 6 and 2 degrees: roll 0.521, pitch 0.526, yaw 0.521; the
    # adjustment of the same three antennas by singular values 0.517, 0.527, 0.370 in 40,000 draws.
    np.testing.assert_allclose(found.curves_deg["three vectors"][0], [0.521, 0.526, 0.521], atol=0.0006)
    np.testing.assert_allclose(found.curves_deg["adjusted"][0], [0.370, 0.527, 0.517], rtol=0.012)


def test_the_adjustment_of_four_antennas_has_the_known_accuracy():
    found = sweep_error((*LANDFAHRER_ANTENNAS, (-1.3345, 0.7825, 0.0)), errors_m=[0.01])
    # By singular values on centred points in 40,000 draws.
    np.testing.assert_allclose(found.curves_deg["adjusted"][0], [0.262, 0.304, 0.520], rtol=0.012)


def test_adjustment_of_unequal_errors_against_draws():
    rng = np.random.default_rng(5)
    from truenorth.rotations import heading_pitch_roll, rot_ned_from_body

    found = sweep_coordinate(
        antenna=1, axis="up", others_m=0.01, errors_m=[0.04], angles_deg=(20.0, 5.0, -4.0)
    )
    body = np.array(LANDFAHRER_ANTENNAS)
    rot = rot_ned_from_body(*np.radians((20.0, 5.0, -4.0)))
    sd = np.full((3, 3), 0.01)
    sd[1, 2] = 0.04
    # Gauss-Newton with the whole covariance of the differences from the first antenna.
    jump = np.kron([[-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]], np.eye(3))
    cov = jump @ np.diag(sd.ravel() ** 2) @ jump.T
    from truenorth.rotations import exp_so3, skew

    vectors = body[1:] - body[0]
    angles = []
    for _ in range(3000):
        measured = (jump @ (body @ rot.T + sd * rng.standard_normal((3, 3))).ravel()).reshape(2, 3)
        guess = rot
        for _ in range(3):
            fitted = vectors @ guess.T
            design = np.concatenate([-skew(fitted[0]), -skew(fitted[1])])
            weight = np.linalg.inv(cov)
            step = np.linalg.solve(
                design.T @ weight @ design, design.T @ weight @ (measured - fitted).ravel()
            )
            guess = exp_so3(step) @ guess
        angles.append(heading_pitch_roll(guess))
    scatter = np.degrees(np.std(np.array(angles), axis=0))
    # The standard deviation of 3,000 draws is good to 1.3 per cent; four of these.
    np.testing.assert_allclose(found.curves_deg["adjusted"][0], scatter, rtol=0.052)


def test_sweeps_refuse_what_cannot_be():
    with pytest.raises(ConfigError, match="needs three antennas"):
        sweep_error(((0, 0, 0), (1, 0, 0)))
    with pytest.raises(ConfigError, match="not all on one line"):
        sweep_error(((0, 0, 0), (1, 0, 0), (2, 0, 0)))
    with pytest.raises(ConfigError, match="north, east, up"):
        sweep_coordinate(axis="x")
    with pytest.raises(ConfigError, match="0 to 2"):
        sweep_coordinate(antenna=3)
    with pytest.raises(ConfigError, match="positive metres"):
        sweep_length(lengths_m=[0.0])
    with pytest.raises(ConfigError, match="between 0 and 180"):
        sweep_length(included_angle_deg=0.0)
    with pytest.raises(ConfigError, match="standard deviations in metres"):
        sweep_error(errors_m=[-1.0])
