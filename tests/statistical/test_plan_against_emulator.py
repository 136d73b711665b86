"""What a plan expects against what emulated receivers give: the scatter of the angles, by chi-square."""

import numpy as np
import pytest

import truenorth as tn
from truenorth.config import ArraySettings
from truenorth.planning import plan_array, white_noise

PLACE = {"latitude_deg": 47.07, "longitude_deg": 15.44, "height_m": 400.0}
ARRAY = ((0.0, 0.0, 0.0), (1.6, 0.0, 0.0), (0.8, 0.9, -0.3))
ANGLES_DEG = (60.0, 4.0, -3.0)
PHASE_SD_M, CODE_SD_M = 0.002, 0.3
N = 401
METHOD = {"baselines": "lambda", "joint": "constrained"}


@pytest.mark.jit
@pytest.mark.parametrize("resolution", ["baselines", "joint"])
def test_scatter_of_emulated_attitudes_is_that_of_the_plan(resolution):
    noise = white_noise(PHASE_SD_M, CODE_SD_M)
    heading_deg, pitch_deg, roll_deg = ANGLES_DEG
    scenario = {
        "name": "plan", "seed": 11, "duration_s": N - 1.0, "start": "2024-06-24T09:00:00", "place": PLACE,
        "platform": {
            "antennas": [{"name": f"A{k}", "position_body_m": list(point)} for k, point in enumerate(ARRAY)]
        },
        "motion": {
            "kind": "static", "heading_deg": heading_deg, "pitch_deg": pitch_deg, "roll_deg": roll_deg
        },
        "sky": {"kind": "nominal", "systems": "GE"},
        "visibility": {"elevation_mask_deg": 16.0},
        "receiver": {
            "signals": {"G": ["1C", "2W"], "E": ["1C", "7Q"]},
            "noise": {"kind": "constant", "phase_sd_m": PHASE_SD_M, "code_sd_m": CODE_SD_M},
        },
    }  # fmt: skip
    simulation = tn.simulate(scenario)
    settings = tn.GnssSettings(
        method=METHOD[resolution], single_epoch=True, systems="GE", bands=("L1", "L2"),
        elevation_mask_deg=16.0,
        length_sd_m=1e-4, stochastic=tn.StochasticSettings(
            phase_sd_m=PHASE_SD_M, phase_elevation_sd_m=0.0, code_sd_m=CODE_SD_M, code_elevation_sd_m=0.0,
            cn0_slope=0.0, estimate=False,
        ),
    )  # fmt: skip
    solution = tn.solve_array(
        list(simulation.observations.values()),
        ARRAY,
        simulation.navigation,
        settings=settings,
        array=ArraySettings(resolution=resolution, position_sd_m=0.0),
    )
    assert np.mean(solution.is_accepted) > 0.995
    plan = plan_array(
        antennas=ARRAY, **PLACE, start="2024-06-24T09:00:00", hours=(N - 1) / 3600.0, step_s=1.0,
        elevation_mask_deg=16.0, systems="GE", heading_deg=heading_deg, pitch_deg=pitch_deg,
        roll_deg=roll_deg, stochastic=noise, sky={"kind": "nominal", "systems": "GE"},
    )  # fmt: skip
    # Both have the same satellites all the time.
    used = solution.is_accepted
    angles = np.stack([solution.heading_rad, solution.pitch_rad, solution.roll_rad], axis=1)[used]
    error = (angles - np.radians(ANGLES_DEG) + np.pi) % (2.0 * np.pi) - np.pi
    planned = plan.sd_rad[used]
    n = len(error)
    for k in range(3):
        square = np.sum((error[:, k] / planned[:, k]) ** 2)
        # Chi-square of n degrees of freedom, nearly normal: four and a half standard deviations.
        assert abs(square - n) < 4.5 * np.sqrt(2.0 * n), (k, square / n)
    # What the solver states of itself is what was planned, but for the sky that turns within the travel time.
    stated = np.sqrt(np.einsum("nii->ni", solution.cov_rad2[used]))
    np.testing.assert_allclose(stated, planned, rtol=0.015)
    nees = np.sum(np.einsum("ni,nij,nj->n", error, np.linalg.inv(plan.cov_rad2[used]), error))
    assert abs(nees - 3 * n) < 4.5 * np.sqrt(6.0 * n)
