"""Double differences of single epochs of a run."""

from dataclasses import replace

import numpy as np
import pytest

import truenorth
from truenorth.errors import Status
from truenorth.simulation import simulate

pytestmark = pytest.mark.jit


@pytest.mark.parametrize("method", ["exhaustive", "kalman", "lsast"])
def test_an_epoch_without_position_has_no_rows_and_no_solution(method):
    simulation = simulate("oguz-kalman-1", {"duration_s": 2.0})
    master, slave = simulation.observations.values()
    code = master.code_m.copy()
    code[master.epoch_start[1] : master.epoch_start[2]] = np.nan
    solution = truenorth.solve_baseline(
        replace(master, code_m=code), slave, simulation.navigation,
        length_m=1.0, method=method, elevation_mask_deg=0.0,
    )  # fmt: skip
    assert solution.n_epochs == 3
    assert solution.status[1] == Status.NONE
    assert list(solution.n_signals) == [3, 0, 3]
