"""The two GPS experiments of Oguz 2006 in simulation, beside the thesis's own figures.

    python tools/make_oguz_tables.py --out docs/validation/oguz_2006.md

The thesis names neither its place, time nor satellites, so the sky is another one; what can be compared
exactly is the numbering of the integer sets, what can be compared in size is the rest. Everything
follows from the seed.
"""

import argparse
import datetime
from pathlib import Path

import numpy as np
from circular_sky import WAVELENGTH_M, directions_enu, highest

import truenorth
from truenorth.ambiguity.exhaustive import integer_bound, search_single_differences
from truenorth.ambiguity.kalman import KalmanIntegerEstimator, KalmanOptions, chain_covariance
from truenorth.ambiguity.model import DoubleDifferences
from truenorth.errors import Status

HEADING_RAD = np.radians(11.0)
THESIS_WAVELENGTH_M = 0.20

# Directions (north, east, down) of three satellites for which the thesis's digit sets are true integers.
SKY_NED = np.array(
    [
        (np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), -np.sin(e))
        for a, e in np.radians([(20.0, 40.0), (160.0, 55.0), (80.0, 30.0)])
    ]
)

# Length, phase noise of a single difference in cycles, set, place, azimuth in
# degrees, as printed in the thesis (exhaustive search).
SEARCH_CASES = (
    (0.20, 1, 0.0, (1, 0, 0), 23, 10.9877),
    (0.50, 2, 0.0, (2, -1, 1), 109, 10.9928),
    (0.76, 4, 0.0, (3, -2, 1), 591, 10.9928),
    (0.20, 1, 0.025, (1, 0, 0), 23, 10.5715),
    (0.50, 2, 0.025, (2, -1, 1), 109, 10.7027),
    (0.76, 4, 0.025, (3, -2, 1), 591, 11.1149),
)

# Length, phase noise of a single difference in radians, epoch of stable integers,
# heading in degrees, as printed in the thesis (Kalman filters).
FILTER_CASES = ((1.0, 0.1, 500, 11.0369), (0.5, 0.1, 500, 11.0560), (1.0, 0.2, 600, 10.9168))


def search_case(length_m, bound, sd_cyc, integers, rng=None, start="least_squares"):
    """One search with the thesis's satellites, wavelength and candidate sets."""
    along = np.array([np.cos(HEADING_RAD), np.sin(HEADING_RAD), 0.0])
    fraction = SKY_NED @ along * length_m / THESIS_WAVELENGTH_M - integers
    if rng is not None:
        fraction = fraction + sd_cyc * rng.standard_normal(3)
    return search_single_differences(
        fraction,
        SKY_NED,
        [length_m, 0.0, 0.0],
        THESIS_WAVELENGTH_M,
        bound=bound,
        # The thesis does not give its limit; noise-free cases get one that only rounding errors pass.
        cost_limit_cyc2=1e-12 if sd_cyc == 0.0 else None,
        single_difference_sd_cyc=max(sd_cyc, 1e-6),
        start=start,
    )


def azimuth_deg(sets, k=0):
    """Azimuth of candidate k's baseline, degrees."""
    north, east, _ = sets.direction_local[k, 0, 0]
    return float(np.degrees(np.arctan2(east, north)))


def filter_case(length_m, sd_rad, *, seed, n_epochs=1000, n_satellites=4, sky_phase_rad=0.0, interval_s=1.0):
    """One run of the two Kalman filters: first fixed epoch, last resolution, true integers, estimator."""
    rng = np.random.default_rng(seed)
    rays = directions_enu(np.arange(n_epochs) * interval_s, phase_rad=sky_phase_rad)
    rays = rays[:, highest(rays[n_epochs // 2], n_satellites)]
    baseline = length_m * np.array([np.sin(HEADING_RAD), np.cos(HEADING_RAD), 0.0])
    sd_m = sd_rad / (2.0 * np.pi) * WAVELENGTH_M
    # The chain 1-2, 2-3, 3-4 of the thesis.
    chain = np.diff(np.eye(n_satellites), axis=0)
    cov = chain_covariance(n_satellites - 1, sd_m**2)
    integers = rng.integers(-8, 9, n_satellites - 1)
    estimator = KalmanIntegerEstimator(KalmanOptions(use_code=False))
    first = None
    for k in range(n_epochs):
        design = -chain @ rays[k]
        phase = design @ baseline + WAVELENGTH_M * integers
        phase = phase + chain @ (sd_m * rng.standard_normal(n_satellites))
        problem = DoubleDifferences(
            phase_m=phase,
            design=design,
            wavelength_m=np.full(n_satellites - 1, WAVELENGTH_M),
            cov_phase_m2=cov,
            code_m=np.empty(0),
            code_design=np.empty((0, 3)),
            cov_code_m2=np.empty((0, 0)),
            length_m=length_m,
            length_sd_m=0.003,
        )
        result = estimator.update(problem)
        if result.status == Status.FIXED and first is None:
            first = k + 1
    return first, result, integers, estimator


def heading_error_deg(result):
    """Error of the best baseline's heading."""
    east, north, _ = result.baseline_enu_m[0]
    return float(np.degrees(np.arctan2(east, north)) - 11.0)


def page(seed, n_draws):
    """The page as text."""
    lines = [
        "# The GPS experiments of Oguz 2006",
        "",
        f"Made by `python tools/make_oguz_tables.py --seed {seed} --draws {n_draws} "
        f"--out docs/validation/oguz_2006.md`, truenorth {truenorth.__version__}, "
        f"{datetime.date.today().isoformat()}.",
        "",
        "P. Oguz, *Implementation of Northfinding Techniques*, METU 2006. The thesis does not name its "
        "place,",
        "time and satellites; ours are others, so single numbers differ and sizes compare.",
        "",
        "## Exhaustive search, three satellites, one epoch, azimuth 11 degrees",
        "",
        "Wavelength 20 cm and candidate sets as in the thesis; satellites at azimuth/elevation 20/40, "
        "160/55 and",
        "80/30 degrees, phases chosen so that the thesis's sets are the true integers.",
        f"With noise: rms over {n_draws} draws where the right set was best, and how often it was; "
        "our azimuth is the first of them.",
        "",
        "| length, m | noise, cycles | set | place | thesis azimuth | our azimuth | sets inside the gate |"
        " right set best | rms error | rule 0.5 cm / L |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for length, bound, sd, integers, place, thesis in SEARCH_CASES:
        rng = None if sd == 0.0 else np.random.default_rng([seed, round(100 * length)])
        draws = [search_case(length, bound, sd, integers, rng) for _ in range(1 if sd == 0.0 else n_draws)]
        right = [s for s in draws if s.index[0] == place]
        errors = np.array([azimuth_deg(s) - 11.0 for s in right])
        inside = np.mean([np.count_nonzero(s.cost_cyc2 <= s.cost_limit_cyc2) for s in draws])
        lines.append(
            f"| {length:g} | {sd:g} | {list(integers)} | {place} | {thesis:.4f} | "
            f"{azimuth_deg(right[0]):.4f} | {inside:.1f} | {100.0 * len(right) / len(draws):.0f} % | "
            f"{np.sqrt(np.mean(errors**2)):.4f} | {np.degrees(0.005 / length):.3f} |"
        )
    lines += [
        "",
        "Without noise the right set costs nothing and the azimuth is exact; the 0.007 to 0.012 degrees "
        "of the thesis",
        "may come from its early exit. With noise three satellites rarely make the set unique: the "
        "thesis says so in",
        "words, the columns say how often. Its candidate sets for 0.2 m and 0.5 m hold integers up to 1 "
        "and 2; at the",
        f"true wavelength of L1 the safe bounds are {integer_bound(0.2, WAVELENGTH_M)} and "
        f"{integer_bound(0.5, WAVELENGTH_M)}, and {integer_bound(0.76, WAVELENGTH_M)} for 0.76 m.",
        "",
        "## Kalman filters, four satellites, 1000 epochs of 1 s, heading 11 degrees",
        "",
        f"Four highest of 24 circular orbits, chained double differences; first of {n_draws // 4} draws, "
        "and the",
        "median and rms over them. Fixed: all float integers known to 0.1 cycle and rounded alike for "
        "10 epochs.",
        "",
        "| length, m | noise, rad | thesis: integers stable | ours: fixed at epoch | thesis heading | "
        "our heading |"
        " rms error | integers right |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for length, sd, stable, thesis in FILTER_CASES:
        runs = [filter_case(length, sd, seed=[seed, k]) for k in range(n_draws // 4)]
        errors = np.array([heading_error_deg(run[1]) for run in runs])
        right = np.mean([np.array_equal(run[1].integers_cyc[0], run[2]) for run in runs])
        first = np.median([run[0] for run in runs if run[0] is not None])
        lines.append(
            f"| {length:g} | {sd:g} | {stable} | {first:.0f} | {thesis:.4f} | {11.0 + errors[0]:.4f} | "
            f"{np.sqrt(np.mean(errors**2)):.4f} | {100.0 * right:.0f} % |"
        )
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=2006)
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    arguments.out.write_text(page(arguments.seed, arguments.draws))


if __name__ == "__main__":
    main()
