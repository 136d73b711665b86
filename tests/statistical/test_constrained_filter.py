"""Held integers over many epochs: honest covariance, in both directions, while satellites come and go."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from truenorth.errors import Status

ROOT = Path(__file__).parents[2]
FALSE_ALARM = 1e-4


def load(name, folder):
    """A module that is in no package."""
    spec = importlib.util.spec_from_file_location(name, ROOT / folder / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules.setdefault(name, module)
    spec.loader.exec_module(module)
    return module


many = load("test_engine", "tests/unit")


def held_epochs(*, reverse=False, slips=(), **options):
    """Errors and covariances of the held epochs of some runs, all integers right."""
    errors, covariances, lengths = [], [], []
    for seed in range(4):
        rows, baseline, truth, time_s = many.simulate(
            n_epochs=120, step_s=20.0, seed=100 + seed, slips=slips, told=True
        )
        if reverse:
            rows, turn = many.select_epochs(rows, range(119, -1, -1))
            truth, baseline, time_s = truth[turn], baseline[::-1], time_s[::-1]
        run = many.run_filter(rows, time_s, **options)
        assert len(many.wrong_rows(rows, run, truth)) == 0
        held = run.status == Status.HELD
        assert held.sum() >= 110
        errors.append((run.baseline_m - baseline)[held])
        covariances.append(run.cov_m2[held])
        lengths.append(((run.length - 1.0) / run.length_sd)[held])
    return np.concatenate(errors), np.concatenate(covariances), np.concatenate(lengths)


def bounds(dof):
    """Two-sided limits of a chi-square."""
    return stats.chi2.ppf([FALSE_ALARM / 2, 1 - FALSE_ALARM / 2], dof)


@pytest.mark.parametrize("reverse", [False, True], ids=["forward", "backward"])
def test_covariance_of_held_epochs_is_honest_in_both_directions(reverse):
    error, cov, length = held_epochs(
        reverse=reverse, use_length=False, slips=[(30, 1, 2), (60, 6, -1), (61, 3, 5)]
    )
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(cov), error)
    low, high = bounds(3 * len(nees))
    assert low < nees.sum() < high, nees.mean()
    low, high = bounds(len(length))
    assert low < np.sum(length**2) < high
    # Held epochs do not lean on each other: their errors are not correlated.
    white = np.einsum("nij,nj->ni", np.linalg.inv(np.linalg.cholesky(cov)), error)
    lag = np.mean(white[1:] * white[:-1])
    assert abs(lag) < stats.norm.isf(FALSE_ALARM / 2) / np.sqrt(white[1:].size)


def test_covariance_of_held_epochs_with_the_length_is_honest():
    error, cov, _ = held_epochs(length_sd_m=0.0005)
    # The length is exactly 1 m here: across the baseline only phases speak.
    angle = 1e-12 + np.linalg.eigvalsh(cov)
    assert np.all(angle[:, 0] > 0.0)
    direction = np.linalg.eigh(cov)[1][:, :, 1:]
    offset = np.einsum("nia,ni->na", direction, error)
    flat = np.einsum("nia,nij,njb->nab", direction, cov, direction)
    nees = np.einsum("na,nab,nb->n", offset, np.linalg.inv(flat), offset)
    low, high = bounds(2 * len(nees))
    assert low < nees.sum() < high, nees.mean()
