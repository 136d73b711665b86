"""The joint search at its edges: too little, antennas on one line, priors, limits, one baseline."""

from dataclasses import replace

import numpy as np
import pytest

from joint_epochs import draw_epoch, draw_sky, same_integers
from truenorth.ambiguity.constrained import resolve_constrained
from truenorth.ambiguity.joint import resolve_joint
from truenorth.ambiguity.model import DoubleDifferences
from truenorth.errors import Reason, Status
from truenorth.rotations import heading_pitch_roll, log_so3, rot_ned_from_body

pytestmark = pytest.mark.jit

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype=float)


def test_one_antenna_or_no_phases_is_too_little():
    rng = np.random.default_rng(1)
    epoch, _, _ = draw_epoch(rng, SQUARE[:1], 6)
    assert resolve_joint(epoch).reason is Reason.TOO_FEW_SATELLITES
    epoch, _, _ = draw_epoch(rng, SQUARE, 6)
    found = resolve_joint(replace(epoch, phase_m=np.full_like(epoch.phase_m, np.nan)))
    assert found.reason is Reason.TOO_FEW_SATELLITES
    assert found.status is Status.NONE
    assert np.isnan(found.rot_ned_from_body).all()


def test_antennas_at_one_point_have_no_attitude():
    epoch, _, _ = draw_epoch(np.random.default_rng(1), np.zeros((2, 3)), 6)
    assert resolve_joint(epoch).reason is Reason.WEAK_GEOMETRY


def test_a_search_that_is_cut_short_says_so():
    epoch, _, _ = draw_epoch(np.random.default_rng(3), SQUARE, 4)
    found = resolve_joint(epoch, max_nodes=200)
    assert found.reason is Reason.SEARCH_LIMIT
    assert found.status is Status.NONE


def test_gross_errors_fail_the_residual_test():
    epoch, _, _ = draw_epoch(np.random.default_rng(3), SQUARE, 8)
    phase = epoch.phase_m.copy()
    phase[5] += 0.09
    found = resolve_joint(replace(epoch, phase_m=phase))
    assert found.reason is Reason.RESIDUAL_TEST
    assert found.chi2 > found.chi2_limit
    assert found.status is Status.FLOAT


@pytest.mark.parametrize("use_code", [True, False])
def test_two_antennas_are_one_baseline_of_known_length(use_code):
    rng = np.random.default_rng(6)
    for _ in range(5):
        epoch, _, _ = draw_epoch(rng, SQUARE[:2], 6, is_weighted=False)
        found = resolve_joint(epoch, use_code=use_code)
        single = [a.reshape(6, 2)[:, 1] - a.reshape(6, 2)[:, 0] for a in (epoch.phase_m, epoch.code_m)]
        design = epoch.design_ned[::2][1:] - epoch.design_ned[0]
        one = np.eye(5) + 1.0
        problem = DoubleDifferences(
            phase_m=single[0][1:] - single[0][0],
            design=design,
            wavelength_m=epoch.wavelength_m[2::2],
            cov_phase_m2=2.0 * epoch.phase_variance_m2[0] * one,
            code_m=single[1][1:] - single[1][0],
            code_design=design,
            cov_code_m2=2.0 * epoch.code_variance_m2[0] * one,
            length_m=1.0,
            length_sd_m=0.0,
        )
        alone = resolve_constrained(problem, use_code=use_code)
        integers = found.integers_cyc.reshape(6, 2)[:, 1]
        np.testing.assert_array_equal(integers[1:] - integers[0], alone.integers_cyc[0])
        assert found.objective == pytest.approx(alone.objective[0], abs=1e-6)
        # Both integrate over the same attitudes; one counts the mirror image of a flat minimum twice.
        assert found.success_probability == pytest.approx(alone.success_probability, abs=0.02)
        np.testing.assert_allclose(found.rot_ned_from_body[:, 0], alone.baseline_enu_m[0], atol=1e-6)


def test_antennas_on_one_line_leave_their_turn_open_and_come_back_most_level():
    rng = np.random.default_rng(2)
    line = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]], dtype=float)
    epoch, integers, _ = draw_epoch(rng, line, 8, rot=rot_ned_from_body(0.7, 0.2, 0.4))
    found = resolve_joint(epoch)
    assert found.status is Status.FIXED
    assert found.rank == 1
    assert same_integers(epoch, found.integers_cyc, integers)
    heading, pitch, roll = heading_pitch_roll(found.rot_ned_from_body)
    assert heading == pytest.approx(0.7, abs=0.02)
    assert pitch == pytest.approx(0.2, abs=0.02)
    assert roll == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(found.cov_rad2 @ found.rot_ned_from_body[:, 0], 0.0, atol=1e-9)
    np.testing.assert_allclose(found.rot_ned_from_body @ found.rot_ned_from_body.T, np.eye(3), atol=1e-12)


def test_the_error_of_the_attitude_is_what_the_covariance_says():
    rng = np.random.default_rng(9)
    squares = []
    for _ in range(60):
        epoch, _, rot = draw_epoch(rng, SQUARE, 8)
        found = resolve_joint(epoch)
        assert found.status is Status.FIXED
        error = log_so3(found.rot_ned_from_body @ rot.T)
        squares.append(error @ np.linalg.solve(found.cov_rad2, error))
    # 180 degrees of freedom: 4 standard deviations either side.
    assert abs(np.sum(squares) - 180.0) < 4.0 * np.sqrt(360.0)


def test_a_prior_attitude_decides_what_four_satellites_leave_open():
    rng = np.random.default_rng(12)
    sky = draw_sky(rng, 4)
    decided = 0
    for _ in range(10):
        epoch, integers, rot = draw_epoch(rng, SQUARE[:3], 4, sky=sky)
        alone = resolve_joint(epoch)
        helped = resolve_joint(epoch, prior_rot=rot, prior_information=np.eye(3) / 0.03**2)
        assert helped.dof == alone.dof + 3
        assert helped.success_probability >= alone.success_probability - 1e-6 or helped.n_candidates == 1
        decided += helped.status is Status.FIXED and same_integers(epoch, helped.integers_cyc, integers)
        if helped.status is Status.FIXED:
            assert same_integers(epoch, helped.integers_cyc, integers)
    assert decided >= 7


def test_an_antenna_that_sees_none_of_the_references_satellites_still_gets_its_integers():
    rng = np.random.default_rng(21)
    epoch, integers, _ = draw_epoch(rng, SQUARE, 9)
    # Antenna 3 has satellites 5 to 8 only, antenna 0 no longer these.
    gone = ((epoch.antenna == 3) & (epoch.satellite < 5)) | ((epoch.antenna == 0) & (epoch.satellite >= 5))
    phase = np.where(gone, np.nan, epoch.phase_m)
    found = resolve_joint(replace(epoch, phase_m=phase, code_m=np.where(gone, np.nan, epoch.code_m)))
    assert found.status is Status.FIXED
    assert same_integers(replace(epoch, phase_m=phase), found.integers_cyc, integers)


def test_four_systems_of_two_frequencies():
    rng = np.random.default_rng(5)
    sky = draw_sky(rng, 30)
    epoch, integers, _ = draw_epoch(rng, SQUARE, 30, n_groups=2, sky=sky)
    found = resolve_joint(epoch)
    assert found.status is Status.FIXED
    assert found.n_candidates == 1
    assert same_integers(epoch, found.integers_cyc, integers)
