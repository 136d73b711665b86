"""A true length is kept where a single frequency, without it, fixes wrongly and to many lengths."""

import numpy as np
import pytest

import truenorth as tn
from truenorth.simulation import simulate


@pytest.mark.parametrize(
    ("name", "duration_s", "rover"), [("wang-minivan", 100.0, "front"), ("harvey-suburban", 300.0, "remote")]
)
def test_contradicting_lengths_do_not_speak_against_the_true_one(name, duration_s, rover):
    overrides = {"duration_s": duration_s, "solve.method": "constrained"}
    simulation = simulate(name, overrides, signal_truth=False)
    antennas = {antenna.name: antenna.position_body_m for antenna in simulation.scenario.platform.antennas}
    base = next(iter(antennas))
    solution = tn.solve_baseline(
        simulation.observations[base],
        simulation.observations[rover],
        simulation.navigation,
        settings=simulation.scenario.solve,
        length_m=float(np.linalg.norm(np.subtract(antennas[rover], antennas[base]))),
    )
    assert solution.length_check["verdict"] != "disagrees"
    assert np.count_nonzero(solution.is_accepted) > 0.1 * solution.n_epochs
