"""Adjusting the vectors is adjusting the phases: the compiled engine against the default over its vectors."""

import numpy as np
import pytest

from truenorth.attitude import solve_array
from truenorth.attitude.adjustment import adjust_vectors
from truenorth.attitude.geometry_checks import check_geometry
from truenorth.attitude.vector_methods import attitude_from_vectors
from truenorth.simulation import simulate

# Epochs through the compiled engine: too slow without the JIT.
pytestmark = pytest.mark.jit

BODY_M = {
    "aft": (0.0, 0.0, 0.0),
    "fore": (2.0, 0.0, 0.0),
    "right": (1.0, 0.8, -0.3),
    "left": (1.0, -0.8, -0.3),
}


def solve(body_m):
    scenario = {
        "name": "vectors",
        "seed": 6,
        "duration_s": 9.0,
        "place": {"latitude_deg": 47.0, "longitude_deg": 15.0},
        "platform": {"antennas": [{"name": name, "position_body_m": list(p)} for name, p in body_m.items()]},
        "motion": {"kind": "circle", "radius_m": 40.0, "speed_mps": 8.0, "heading_deg": 350.0},
        "sky": {"kind": "nominal", "systems": "GE"},
        "faults": [{"kind": "dead", "antenna": "right", "start_s": 5.0}],
        "output": {"signal_truth": False},
    }
    simulation = simulate(scenario)
    observations = [simulation.observations[name] for name in body_m]
    return solve_array(observations, list(body_m.values()), simulation.navigation, names=list(body_m))


@pytest.mark.parametrize("names", [("aft", "fore", "right", "left"), ("aft", "fore", "right")])
def test_vectors_hold_all_that_the_phases_say(names):
    solution = solve({name: BODY_M[name] for name in names})
    assert solution.level == "joint"
    assert solution.is_accepted.all()
    fit = attitude_from_vectors(solution.vectors)
    angles = np.stack([solution.heading_rad, solution.pitch_rad, solution.roll_rad], axis=1)
    known = np.isfinite(angles)
    np.testing.assert_array_equal(np.isfinite(fit.angles_rad), known)
    np.testing.assert_array_equal(fit.reason, solution.reason)
    apart = (fit.angles_rad - angles + np.pi) % (2.0 * np.pi) - np.pi
    # The covariance is kept in single precision: 1e-7 of errors of milliradians.
    assert np.max(np.abs(apart[known])) < 1e-8
    both = known[:, :, None] & known[:, None, :]
    np.testing.assert_allclose(fit.cov_rad2[both], solution.cov_rad2[both], rtol=1e-3, atol=1e-10)
    assert not check_geometry(solution.vectors).is_detected.any()
    assert not adjust_vectors(solution.vectors).is_excluded.any()
