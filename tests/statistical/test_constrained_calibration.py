"""The constrained search against its committed table, its stated probability, and its covariance."""

import importlib.util
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

ROOT = Path(__file__).parents[2]


def load(name):
    """A module of tools/, which is no package."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules.setdefault(name, module)
    spec.loader.exec_module(module)
    return module


engine_run = load("engine_run")
study = load("study_constrained")

FALSE_ALARM = 1e-4
"""Of each test, both sides together."""


def committed_table():
    """Number of draws and shares of right integers of the committed page."""
    text = (ROOT / "docs" / "validation" / "constrained_one_baseline.md").read_text(encoding="utf-8")
    draws = int(re.search(r"--draws (\d+)", text)[1])
    rows = re.findall(r"^\| (\d) \| (\d) \| (phase[a-z ]*) \| ([\d.]+) \|", text, re.MULTILINE)
    return draws, {(int(n), int(sd), kind == "phase and code"): float(share) for n, sd, kind, share in rows}


def z_score(hits, n, share, n_share):
    """Difference of an observed share from one observed elsewhere, in standard deviations."""
    pooled = (hits + share * n_share) / (n + n_share)
    # A share of 0 or 1 has no spread; one hit more or less stands for it.
    sd = np.sqrt(max(pooled * (1.0 - pooled), 1.0 / (n + n_share)) * (1.0 / n + 1.0 / n_share))
    return (hits / n - share) / sd


def test_committed_table_agrees_with_the_independent_implementation():
    draws, table = committed_table()
    assert set(table) == {
        (n, sd, c) for n in study.SATELLITES for sd in study.PHASE_SD_MM for c in (True, False)
    }
    scores = []
    for (n, sd, use_code), share in table.items():
        reference = study.REFERENCE[n, use_code][study.PHASE_SD_MM.index(sd)]
        if np.isfinite(reference):
            # Two decimals: half a hundredth of the difference may be rounding.
            gap = np.sign(share - reference) * max(abs(share - reference) - 0.005, 0.0)
            hits = draws * (reference + gap)
            scores.append(z_score(hits, draws, reference, study.REFERENCE_TRIALS))
    assert np.max(np.abs(scores)) < stats.norm.isf(FALSE_ALARM / 2 / len(scores))
    # No drift of all cells together either.
    assert abs(np.sum(scores)) < stats.norm.isf(FALSE_ALARM / 2) * np.sqrt(len(scores))


CELLS = [(4, 2, True), (5, 1, False), (5, 3, True), (6, 3, False), (6, 4, True), (7, 4, False)]


@pytest.mark.parametrize(("n_satellites", "sd_mm", "use_code"), CELLS)
def test_small_run_agrees_with_the_committed_table(n_satellites, sd_mm, use_code):
    draws, table = committed_table()
    right, _ = study.resolve(n_satellites, sd_mm, use_code, 1000, seed=77)
    score = z_score(right.sum(), 1000, table[n_satellites, sd_mm, use_code], draws)
    assert abs(score) < stats.norm.isf(FALSE_ALARM / 2 / len(CELLS))


def outcomes(n_draws, *, on_sphere):
    """Right or wrong and the stated probability, over cells of all strengths."""
    found = [
        study.resolve(n, sd, use_code, n_draws, seed=78, on_sphere=on_sphere)
        for n in (4, 5, 6, 7)
        for sd in (1, 3)
        for use_code in (True, False)
    ]
    right, probability = (np.concatenate(x) for x in zip(*found, strict=True))
    return right, probability


def test_stated_probability_is_the_observed_share_under_its_prior():
    right, probability = outcomes(1500, on_sphere=True)
    stated = 1.0 - probability
    rows = study.calibration(right, probability)
    for high, low, n, _, wrong in rows:
        inside = (stated <= high) & (stated > low) if low > 0.0 else stated <= high
        expected = stated[inside].sum()
        # A sum of independent rare events: Poisson bounds where few, binomial ones are narrower.
        level = FALSE_ALARM / 2 / len(rows)
        assert wrong >= stats.poisson.ppf(level, expected), (high, low, n, wrong, expected)
        assert wrong <= stats.poisson.isf(level, expected), (high, low, n, wrong, expected)
    # All draws together, by their own variance.
    z = (np.sum(~right) - stated.sum()) / np.sqrt(np.sum(stated * probability))
    assert abs(z) < stats.norm.isf(FALSE_ALARM / 2)


def test_accepted_epochs_of_level_baselines_are_as_right_as_stated():
    # The prior is wrong here, and on the safe side for those that are accepted.
    right, probability = outcomes(1500, on_sphere=False)
    accepted = probability >= 0.99
    assert accepted.sum() > 5000
    assert np.sum(~right[accepted]) <= stats.poisson.isf(FALSE_ALARM, np.sum(1.0 - probability[accepted]))


def nees_is_honest(error, cov, dof):
    """Normalised square errors against chi-square: their sum, and their tail."""
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(cov), error)
    n = len(nees)
    low, high = stats.chi2.ppf([FALSE_ALARM / 4, 1 - FALSE_ALARM / 4], dof * n)
    assert low < nees.sum() < high, nees.mean()
    beyond = np.sum(nees > stats.chi2.isf(0.01, dof))
    assert stats.binom.ppf(FALSE_ALARM / 4, n, 0.01) <= beyond <= stats.binom.isf(FALSE_ALARM / 4, n, 0.01)


def tangent(baseline):
    """Directions across each baseline: towards larger azimuth, and larger elevation; shape (n, 2, 3)."""
    unit = baseline / np.linalg.norm(baseline, axis=1, keepdims=True)
    level = np.hypot(unit[:, 0], unit[:, 1])
    zero = np.zeros(len(unit))
    along = np.stack([unit[:, 1] / level, -unit[:, 0] / level, zero], axis=-1)
    upward = np.cross(along, -unit)
    return np.stack([along, upward], axis=1)


@pytest.mark.parametrize("length_sd_m", [0.0, 0.002, 0.02])
def test_covariance_with_the_length_is_honest(length_sd_m):
    rows, baseline, truth = study.simulate(8, 0.002, 2000, seed=5, length_sd_m=length_sd_m)
    run = engine_run.run_engine(rows, length_m=1.0, length_sd_m=length_sd_m, probability=0.5)
    right = np.all(run.integer_cyc.reshape(truth.shape) == truth, axis=1)
    assert right.mean() > 0.99
    error, cov = (run.baseline_m - baseline)[right], run.cov_m2[right]
    if length_sd_m > 0.0:
        nees_is_honest(error, cov, 3)
    across = tangent(run.baseline_m[right])
    flat = np.einsum("nai,nij,nbj->nab", across, cov, across)
    offset = np.einsum("nai,ni->na", across, error)
    # Azimuth and elevation together, then each by its own standard deviation.
    nees_is_honest(offset, flat, 2)
    for k in range(2):
        nees_is_honest(offset[:, k : k + 1], flat[:, k : k + 1, k : k + 1], 1)
    # An exact length leaves no error along the baseline.
    if length_sd_m == 0.0:
        unit = run.baseline_m[right] / np.linalg.norm(run.baseline_m[right], axis=1, keepdims=True)
        assert np.linalg.norm(run.baseline_m[right], axis=1) == pytest.approx(1.0, abs=1e-9)
        radial = np.sqrt(np.einsum("ni,nij,nj->n", unit, cov, unit))
        assert radial == pytest.approx(0.0, abs=2e-7)


def test_covariance_and_measured_length_without_the_length_are_honest():
    rows, baseline, truth = study.simulate(8, 0.002, 2000, seed=7)
    # Codes as good as phases make every integer certain: choosing the right ones would bend the noise.
    model = np.einsum("nsi,ni->ns", rows.design.reshape(2000, 8, 3), baseline).ravel()
    noise = np.random.default_rng(8).standard_normal(len(model))
    rows = replace(
        rows,
        code_m=model + np.sqrt(rows.phase_variance_m2) * noise,
        code_variance_m2=rows.phase_variance_m2,
    )
    run = engine_run.run_engine(rows, length_m=1.0, use_length=False, probability=0.5)
    assert np.all(run.integer_cyc.reshape(truth.shape) == truth)
    nees_is_honest(run.baseline_m - baseline, run.cov_m2, 3)
    error = (run.length - 1.0)[:, None]
    nees_is_honest(error, (run.length_sd**2)[:, None, None], 1)
    # The length test's statistic is the same number.
    assert run.length_statistic == pytest.approx(np.abs(error[:, 0]) / run.length_sd)


def test_residual_test_alarms_as_often_as_it_says():
    rows, _, truth = study.simulate(8, 0.002, 4000, seed=9)
    run = engine_run.run_engine(rows, length_m=1.0, probability=0.5, significance=0.05)
    right = np.all(run.integer_cyc.reshape(truth.shape) == truth, axis=1)
    # Integers that fit better than the true ones take a little of the tail away: below 1 % of the draws.
    alarms = np.sum(run.chi2[right] > run.chi2_limit[right])
    low, high = stats.binom.ppf([FALSE_ALARM / 2, 1 - FALSE_ALARM / 2], right.sum(), 0.05)
    assert low - 0.01 * len(right) <= alarms <= high
    dof = run.chi2_dof[right]
    assert np.all(dof == 8 - 1 - 3 + 1)
    assert run.chi2[right].mean() == pytest.approx(5.0, rel=0.05)
