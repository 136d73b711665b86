"""Three satellites and a length leave two baselines, mirror images of each other: neither is accepted."""

from dataclasses import replace

import numpy as np
import pytest

import truenorth as tn
from simulated_sessions import pair
from truenorth.simulation import simulate

_TWO_BANDS = {"signals": {"G": ["1C", "2W"]}}


@pytest.mark.parametrize("method", ["constrained", "filter"])
def test_satellites_masked_to_three_are_not_enough(method):
    simulation = simulate(
        pair(
            duration_s=60.0,
            length_m=2.0,
            receiver=_TWO_BANDS,
            sky={"kind": "nominal", "systems": "G", "n_satellites": 5},
        ),
        signal_truth=False,
    )
    aft, fore = simulation.observations.values()
    # Code of all five positions the receivers; phases of three of them are left.
    kept = np.unique(aft.sat)[:3]
    clipped = []
    for observations in (aft, fore):
        phase = np.where(np.isin(observations.sat, kept), observations.phase_cyc, np.nan)
        clipped.append(replace(observations, phase_cyc=phase))
    solution = tn.solve_baseline(*clipped, simulation.navigation, length_m=2.0, method=method, systems="G")
    assert not np.any(solution.is_accepted)
    whole = tn.solve_baseline(aft, fore, simulation.navigation, length_m=2.0, method=method, systems="G")
    assert np.mean(whole.is_accepted) > 0.9
