"""Self-surveys of simulated arrays, one of whose antennas is declared 2 cm off: errors and stated sigma.

    python tools/calibration_study.py --seeds 12

prints the table of docs/calibration.md.
"""

import argparse

import numpy as np

from truenorth.attitude.baselines import solve_baseline
from truenorth.calibration import calibrate_array
from truenorth.calibration.sources import vectors_of_baselines
from truenorth.config import GnssSettings
from truenorth.simulation import simulate

WRONG_M = 0.02

CASES = {
    "cross on a car, 4 min at 2 Hz": {
        "scenario": "landfahrer-oeamtc",
        "overrides": {"duration_s": 240.0, "interval_s": 0.5, "faults": [], "sensors": {}},
        "wrong": ("flexpak2", 1),
    },
    "cross on a car, 8 min at 1 Hz": {
        "scenario": "landfahrer-oeamtc",
        "overrides": {"duration_s": 480.0, "interval_s": 1.0, "faults": [], "sensors": {}},
        "wrong": ("flexpak2", 1),
    },
    "three arms at rest, 20 min at 0.5 Hz": {
        "scenario": "wang-angles",
        "overrides": {"duration_s": 1200.0, "interval_s": 2.0, "faults": []},
        "wrong": ("right", 1),
    },
    "the same with multipath of 3 mm for 60 s": {
        "scenario": "wang-angles",
        "overrides": {
            "duration_s": 1200.0, "interval_s": 2.0, "faults": [],
            "receiver.multipath.gauss_markov": {"phase_sd_m": 0.003, "code_sd_m": 0.5, "tau_s": 60.0},
        },
        "wrong": ("right", 1),
    },
}  # fmt: skip


def survey(case, seed, common_sd_m=0.0):
    """One simulated run: the calibration, the true coordinates and the wrong antenna."""
    simulation = simulate(case["scenario"], {**case["overrides"], "seed": seed})
    antennas = simulation.scenario.platform.antennas
    names = [antenna.name for antenna in antennas]
    true_m = np.array([antenna.position_body_m for antenna in antennas])
    systems = "".join(sorted(simulation.scenario.receiver.signals))
    settings = GnssSettings(
        method="filter", systems=systems, bands=("L1", "L2"), elevation_mask_deg=10.0, length_use="off"
    )
    observations = simulation.observations
    baselines = [
        solve_baseline(
            observations[names[0]],
            observations[name],
            simulation.navigation,
            settings=settings,
            residual_rows=0,
        )
        for name in names[1:]
    ]
    vectors = vectors_of_baselines(baselines, true_m, observations[names[0]].time_ns, names=names)
    declared_m = true_m.copy()
    antenna, axis = case["wrong"]
    declared_m[names.index(antenna), axis] -= WRONG_M
    found = calibrate_array(vectors, declared_m=declared_m, declared_sd_m=0.002, common_sd_m=common_sd_m)
    return found, true_m, names.index(antenna)


def nees(found, true_m, wrong):
    """Normalised square of the errors of the found coordinates, in the frame of the other antennas."""
    rank = 3 * len(true_m) - 6
    error = (found.positions_body_m - true_m).ravel()
    return float(error @ np.linalg.pinv(found.cov_body_m2, rcond=1e-8, hermitian=True) @ error) / rank


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=12)
    parser.add_argument("--case", type=int, help="only this one, counted from 0")
    arguments = parser.parse_args()
    print("| run | rms error of the antenna (mm) | stated sigma (mm) | found alone | NEES | worth epochs |")
    print("| --- | --- | --- | --- | --- | --- |")
    for k, (name, case) in enumerate(CASES.items()):
        if arguments.case is not None and k != arguments.case:
            continue
        errors, stated, alone, consistency, worth = [], [], 0, [], []
        for seed in range(1, arguments.seeds + 1):
            found, true_m, wrong = survey(case, seed)
            errors.append(found.positions_body_m[wrong] - true_m[wrong])
            stated.append(found.sd_body_m[wrong])
            alone += bool(found.declared.is_wrong[wrong]) and int(found.declared.is_wrong.sum()) == 1
            consistency.append(nees(found, true_m, wrong))
            worth.append(found.effective_epochs)
        rms = 1e3 * np.sqrt(np.mean(np.square(errors), axis=0))
        sd = 1e3 * np.sqrt(np.mean(np.square(stated), axis=0))
        print(
            f"| {name} | {', '.join(f'{x:.2f}' for x in rms)} | {', '.join(f'{x:.2f}' for x in sd)} | "
            f"{alone} of {arguments.seeds} | {np.mean(consistency):.2f} | {np.mean(worth):.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
