"""Exhaustive search: the thesis's numbering and cases, uniqueness, and the search on double differences."""

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import thesis_search as oguz
from truenorth.ambiguity.exhaustive import (
    ExhaustiveOptions,
    integer_bound,
    resolve_exhaustive,
    search_single_differences,
    set_index,
)
from truenorth.errors import ConfigError, ModelError, Reason, Status

TOOLS = Path(__file__).parents[2] / "tools"


def load(name):
    spec = importlib.util.spec_from_file_location(name, TOOLS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules.setdefault(name, module)
    spec.loader.exec_module(module)
    return module


load("circular_sky")
anchors = load("make_lsast_anchors")


@pytest.mark.parametrize(
    ("integers", "bound", "place"), [((1, 0, 0), 1, 23), ((2, -1, 1), 2, 109), ((3, -2, 1), 4, 591)]
)
def test_numbering_of_the_thesis(integers, bound, place):
    assert set_index(integers, bound) == place


def test_numbering_refuses_what_is_out_of_range():
    with pytest.raises(ModelError, match="larger bound"):
        set_index([2, 0, 0], 1)


def test_safe_bounds_exceed_those_of_the_thesis():
    # 1.05, 2.63 and 3.99 wavelengths of L1; the thesis takes 1, 2 and 4.
    bounds = [integer_bound(length, oguz.WAVELENGTH_M) for length in (0.2, 0.5, 0.76)]
    assert bounds == [2, 3, 4]


@pytest.mark.parametrize("start", ["least_squares", "identity"])
@pytest.mark.parametrize("case", oguz.SEARCH_CASES[:3])
def test_noise_free_cases_of_the_thesis(case, start):
    length, bound, sd, integers, place, printed = case
    sets = oguz.search_case(length, bound, sd, integers, start=start)
    assert sets.n_sets == sets.n_evaluated == {1: 27, 2: 125, 4: 729}[bound]
    assert sets.index[0] == place
    np.testing.assert_array_equal(sets.integers_cyc[0, 0], integers)
    assert sets.is_unique
    # The Gauss-Newton steps end at rounding errors; the thesis's early exit left 0.007 to 0.012 degrees.
    assert oguz.azimuth_deg(sets) == pytest.approx(11.0, abs=1e-6)
    assert oguz.azimuth_deg(sets) == pytest.approx(printed, abs=0.013)
    rot = sets.rot_body_from_local[0, 0]
    np.testing.assert_allclose(rot @ rot.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rot) == pytest.approx(1.0)


def test_noise_makes_three_satellites_ambiguous():
    # The thesis: "there may be more than one integer set solution".
    rng = np.random.default_rng(0)
    sets = oguz.search_case(0.76, 4, 0.025, (3, -2, 1), rng)
    assert not sets.is_unique
    assert 591 in sets.index
    assert np.all(np.diff(sets.cost_cyc2) >= 0.0)


def test_early_exit_stops_at_the_first_set_inside_the_gate():
    full = oguz.search_case(0.5, 2, 0.025, (2, -1, 1), np.random.default_rng(1))
    length, bound = 0.5, 2
    along = np.array([np.cos(oguz.HEADING_RAD), np.sin(oguz.HEADING_RAD), 0.0])
    noise = 0.025 * np.random.default_rng(1).standard_normal(3)
    fraction = oguz.SKY_NED @ along * length / 0.20 - np.array([2, -1, 1]) + noise
    early = search_single_differences(
        fraction, oguz.SKY_NED, [length, 0.0, 0.0], 0.20, bound=bound, early_exit=True
    )
    assert early.n_evaluated == full.index.min()
    assert early.index[0] == full.index.min()


@pytest.mark.jit
def test_two_baselines_and_two_epochs_give_the_whole_attitude():
    rng = np.random.default_rng(7)
    wavelength = 0.19
    baselines = np.array([[0.18, 0.0, 0.0], [0.02, 0.17, 0.0]])
    rots, rays = [], []
    for _ in range(2):
        # A rotation from a random matrix.
        q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
        rots.append(q * np.linalg.det(q))
        v = rng.standard_normal((4, 3))
        rays.append(v / np.linalg.norm(v, axis=1)[:, None])
    truth = np.stack([baselines @ rot @ ray.T / wavelength for rot, ray in zip(rots, rays, strict=True)])
    integers = rng.integers(-1, 2, (2, 4))
    sets = search_single_differences(truth - integers, np.array(rays), baselines, wavelength, bound=1)
    assert sets.n_sets == 3**8
    np.testing.assert_array_equal(sets.integers_cyc[0], integers)
    np.testing.assert_allclose(sets.rot_body_from_local[0], rots, atol=1e-6)


def test_too_many_sets_are_refused():
    with pytest.raises(ModelError, match="exceed the limit"):
        search_single_differences(np.zeros(8), np.eye(8, 3), [2.0, 0.0, 0.0], 0.19)
    with pytest.raises(ModelError, match="match them"):
        search_single_differences(np.zeros(3), np.eye(4, 3), [0.2, 0.0, 0.0], 0.19)
    with pytest.raises(ConfigError, match="least_squares or identity"):
        search_single_differences(np.zeros(3), np.eye(3), [0.2, 0.0, 0.0], 0.19, start="north")


def epoch(seed=1, n_satellites=7, sd_m=0.001, length=1.0):
    baseline = length * anchors.unit_enu(np.radians(33.0), np.radians(5.0))
    problem, integers = anchors.epoch(baseline, n_satellites, sd_m, length, np.random.default_rng(seed))
    return problem, integers, baseline


def test_double_differences_are_resolved():
    problem, integers, baseline = epoch()
    result = resolve_exhaustive(problem)
    assert (result.status, result.reason) == (Status.FIXED, Reason.OK)
    np.testing.assert_array_equal(result.integers_cyc[0], integers)
    np.testing.assert_allclose(result.baseline_enu_m[0], baseline, atol=0.02)


def test_exact_length_is_kept_exactly():
    problem, _, _ = epoch()
    result = resolve_exhaustive(replace(problem, length_sd_m=np.nan))
    np.testing.assert_allclose(np.linalg.norm(result.baseline_enu_m, axis=1), 1.0, rtol=1e-12)
    # Its direction carries no variance.
    along = result.baseline_enu_m[0]
    assert along @ result.cov_baseline_m2 @ along == pytest.approx(0.0, abs=1e-12)


def test_length_with_sigma_is_an_observation():
    # The same adjustment with the length as one more linear row, along the result.
    problem, integers, _ = epoch()
    result = resolve_exhaustive(problem)
    along = result.baseline_enu_m[0] / np.linalg.norm(result.baseline_enu_m[0])
    rows = np.vstack([problem.design, along])
    values = np.append(problem.phase_m - problem.wavelength_m * integers, problem.length_m)
    cov = np.zeros((7, 7))
    cov[:6, :6], cov[6, 6] = problem.cov_phase_m2, problem.length_sd_m**2
    weight = np.linalg.inv(cov)
    joint = np.linalg.inv(rows.T @ weight @ rows)
    baseline = joint @ rows.T @ weight @ values
    residual = values - rows @ baseline
    # Second order in the ratio of millimetres to the length.
    np.testing.assert_allclose(result.baseline_enu_m[0], baseline, atol=3e-5)
    assert result.chi2 == pytest.approx(residual @ weight @ residual, rel=1e-2)
    np.testing.assert_allclose(result.cov_baseline_m2, joint, rtol=1e-2, atol=1e-9)


def test_the_number_of_sets_is_what_the_length_allows():
    problem, _, _ = epoch()
    rows = slice(0, 4)
    reach = 1.0 * np.linalg.norm(problem.design[rows], axis=1)
    noise = 5.0 * np.sqrt(np.diag(problem.cov_phase_m2)[rows])
    counts = [
        sum(
            abs(problem.phase_m[i] - problem.wavelength_m[i] * n) <= reach[i] + noise[i]
            for n in range(-60, 60)
        )
        for i in range(4)
    ]
    assert resolve_exhaustive(problem).n_candidates == np.prod(counts)


def test_a_prior_direction_narrows_the_integers():
    problem, integers, baseline = epoch()
    prior = replace(problem, prior_baseline_enu_m=baseline + 0.03, cov_prior_m2=0.05**2 * np.eye(3))
    result = resolve_exhaustive(prior)
    assert result.n_candidates < resolve_exhaustive(problem).n_candidates / 10
    np.testing.assert_array_equal(result.integers_cyc[0], integers)


def test_long_and_unknown_lengths_are_refused():
    problem, _, _ = epoch(length=40.0)
    assert resolve_exhaustive(problem).reason == Reason.SEARCH_VOLUME_TOO_LARGE
    assert resolve_exhaustive(replace(problem, length_m=np.nan)).reason == Reason.SEARCH_VOLUME_TOO_LARGE


def test_verdicts():
    problem, _, _ = epoch(sd_m=0.004)
    assert resolve_exhaustive(problem, ExhaustiveOptions(ratio_threshold=1e6)).reason == Reason.RATIO_TEST
    optimistic = replace(problem, cov_phase_m2=problem.cov_phase_m2 / 1e3)
    assert resolve_exhaustive(optimistic).reason == Reason.RESIDUAL_TEST
    few, _, _ = epoch(n_satellites=3)
    assert resolve_exhaustive(few).reason == Reason.TOO_FEW_SATELLITES
    with pytest.raises(ConfigError):
        ExhaustiveOptions(n_satellites=2)
