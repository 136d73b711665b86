"""The 1 m pair of geodetic receivers, every epoch alone: all fixed and right, also with few satellites.

Wrong means an integer that is not the true one, which moves the baseline by centimetres or more. The true
integers are those of the solution with all signals, whose baselines all lie within 2 cm of the truth.
"""

import numpy as np
import pytest

import truenorth as tn
from real_pairs import PAIRS, angle_deg, distance_to_truth_m, has_right_integers, integers_of, load, solve
from truenorth.errors import Reason

NAME = "geodetic"
WRONG_M = 0.05
GPS_L1 = {"systems": "G", "bands": ("L1",)}

# Right best candidates demanded of 301, by mask; plain integer least squares of another
# implementation: 301, 296, 279, 84; RTKLIB demo5 fixes 91 right at 25 degrees.
BEST_RIGHT = {15.0: 301, 20.0: 301, 25.0: 301, 28.0: 297}


@pytest.fixture(scope="module")
def truth(data_dir):
    solution = solve(data_dir, NAME)
    assert distance_to_truth_m(solution, NAME).max() < 0.02
    return solution


@pytest.mark.parametrize(
    "signals", [{}, GPS_L1, {"systems": "E", "bands": ("L1",)}], ids=["all", "gps", "galileo"]
)
@pytest.mark.parametrize("length", [True, False], ids=["length", "free"])
def test_every_epoch_fixed_and_right(data_dir, truth, signals, length):
    solution = solve(data_dir, NAME, length=length, **signals)
    right = has_right_integers(solution, integers_of(truth, solution))
    if length or signals != {"systems": "E", "bands": ("L1",)}:
        assert solution.is_accepted.all()
        assert right.all()
        assert distance_to_truth_m(solution, NAME).max() < WRONG_M
    else:
        # Six Galileo satellites on one frequency are too few without the length, and few are believed:
        # measured 28 of 301, one of them wrong.
        assert np.mean(solution.is_accepted) < 0.2
        assert np.count_nonzero(solution.is_accepted & ~right) <= 3


def test_azimuth_and_its_stated_sigma(truth):
    mean, scatter = angle_deg(truth.azimuth_rad)
    assert abs(mean - 193.03) < 0.1
    assert scatter <= 0.05
    stated = np.degrees(np.sqrt(np.mean(truth.azimuth_sd_rad**2)))
    assert 1 / 1.5 < stated / scatter < 1.5


@pytest.mark.parametrize("use", ["constrain", "check", "compute", "off"])
def test_measured_length_does_not_lean_on_the_declared_one(data_dir, use):
    # The truth is 0.9902 m, good to 1-2 mm.
    solution = solve(data_dir, NAME, length_use=use)
    assert solution.is_accepted.all()
    assert np.mean(solution.length_m) == pytest.approx(0.990, abs=0.001)


@pytest.mark.parametrize(("mask_deg", "demanded"), BEST_RIGHT.items())
def test_best_candidate_with_few_satellites(data_dir, truth, mask_deg, demanded):
    solution = solve(data_dir, NAME, elevation_mask_deg=mask_deg, **GPS_L1)
    right = has_right_integers(solution, integers_of(truth, solution))
    assert np.count_nonzero(right) >= demanded
    accepted = solution.is_accepted
    assert np.count_nonzero(accepted & ~right) <= 0.01 * np.count_nonzero(accepted)
    # Measured 301, 301, 292, 264; a tenth less would be another solver.
    assert np.mean(accepted) > {15.0: 0.999, 20.0: 0.999, 25.0: 0.9, 28.0: 0.8}[mask_deg]


def test_length_helps_where_plain_least_squares_fails(data_dir, truth):
    for mask_deg, most in ((25.0, 290), (28.0, 150)):
        plain = solve(data_dir, NAME, method="lambda", elevation_mask_deg=mask_deg, **GPS_L1)
        right = has_right_integers(plain, integers_of(truth, plain))
        assert np.count_nonzero(right) < most
        assert not np.any(plain.is_accepted & ~right)


def test_length_twenty_centimetres_wrong(data_dir):
    wrong_m = PAIRS[NAME].length_m + 0.2

    def with_use(use):
        return solve(data_dir, NAME, length_m=wrong_m, length_use=use, **GPS_L1)

    constrained = with_use("constrain")
    assert np.mean(constrained.is_accepted) < 0.1
    checked = with_use("check")
    assert not checked.is_accepted.any()
    assert set(checked.reason_counts()) == {Reason.LENGTH_TEST}
    computed = with_use("compute")
    assert computed.is_accepted.all()
    assert distance_to_truth_m(computed, NAME).max() < WRONG_M
    for solution in (constrained, checked, computed):
        assert solution.length_check["verdict"] == "disagrees"
        assert solution.length_check["difference_m"] == pytest.approx(-0.2, abs=0.01)
        assert any("suspect the declared length" in text for text in solution.summary()["warnings"])
    off = with_use("off")
    assert off.is_accepted.all()
    assert not off.warnings
    np.testing.assert_array_equal(off.baseline_enu_m, computed.baseline_enu_m)


def test_swapped_receivers_give_the_opposite_vector(data_dir, truth):
    swapped = solve(data_dir, NAME, swap=True)
    assert swapped.is_accepted.all()
    # The receivers' own positions, metres apart by their codes, turn a metre by less than a micrometre.
    np.testing.assert_allclose(swapped.baseline_ecef_m, -truth.baseline_ecef_m, atol=1e-6)


def test_some_epochs_alone_give_the_same_numbers(data_dir):
    base, rover, navigation = load(data_dir, NAME)
    fixed_noise = tn.StochasticSettings(estimate=False)
    whole = solve(data_dir, NAME, stochastic=fixed_noise)
    part = slice(100, 120)
    alone = tn.solve_baseline(
        base.select_epochs(part), rover.select_epochs(part), navigation, length_m=PAIRS[NAME].length_m,
        length_sd_m=PAIRS[NAME].length_sd_m, single_epoch=True, stochastic=fixed_noise,
    )  # fmt: skip
    np.testing.assert_array_equal(alone.time_ns, whole.time_ns[part])
    np.testing.assert_array_equal(alone.status, whole.status[part])
    # Seconds are counted from the first epoch, so orbits differ in their last bits: nanometres.
    np.testing.assert_allclose(alone.baseline_ecef_m, whole.baseline_ecef_m[part], atol=1e-7)
    np.testing.assert_allclose(alone.azimuth_sd_rad, whole.azimuth_sd_rad[part], rtol=1e-6)
    np.testing.assert_allclose(alone.success_probability, whole.success_probability[part], atol=1e-6)
