"""Success of the least-squares ambiguity search at single epochs, tabulated by satellites and noise.

    python tools/make_lsast_anchors.py --out docs/validation/lsast_anchors.md

The sky, the noise and the tests are those of the study of single-epoch resolution after Wang & Lachapelle
2002: seven fixed satellites, a 1 m baseline of random heading and an elevation within 5 degrees, white
noise, shell and fine length tolerance of 2 cm (1 mm noise), 2.4 cm (2 mm), 4.8 cm (4 mm), ratio 3, residual
test at 0.1 %. Everything follows from the seed.
"""

import argparse
import datetime
from pathlib import Path

import numpy as np

import truenorth
from truenorth.ambiguity.lsast import LsastOptions, primary_region_count, resolve_lsast
from truenorth.ambiguity.model import DoubleDifferences
from truenorth.errors import Status

WAVELENGTH_M = 299_792_458.0 / 1575.42e6

# Azimuth and elevation, degrees; the first is the reference satellite, fewer satellites drop the last ones.
SKY_DEG = np.array([(40, 65), (150, 48), (255, 55), (320, 30), (95, 22), (200, 18), (10, 15)], dtype=float)

TOLERANCE_M = {1.0: 0.020, 2.0: 0.024, 4.0: 0.048, 10.3: 0.120}

# Shares in per cent of an independent implementation of the same study with 400 headings:
# satellites, undifferenced phase noise in mm, best candidate right, accepted, right among accepted.
REFERENCE = (
    (7, 1.0, 99.8, 99.0, 100.0),
    (7, 2.0, 98.8, 94.8, 99.5),
    (7, 4.0, 74.0, 45.8, 86.9),
    (6, 1.0, 95.3, 88.5, 99.7),
    (6, 4.0, 32.8, 40.8, 36.8),
    (5, 2.0, 35.5, 56.5, 38.9),
)
CASES = (*((n, s) for n in (7, 6, 5) for s in (1.0, 2.0, 4.0)), (7, 10.3))

# Candidates inside the sphere and the shell for lengths of 1 m and 2 m, tolerance 2 cm, primaries: the four
# highest satellites; noise-free baseline at azimuth 33, elevation 5 degrees.
COUNTS = {(1.0, "sphere"): 230, (1.0, "shell"): 26, (2.0, "sphere"): 1808, (2.0, "shell"): 112}


def unit_enu(azimuth_rad, elevation_rad):
    """Unit vector of a direction."""
    return np.stack(
        [
            np.sin(azimuth_rad) * np.cos(elevation_rad),
            np.cos(azimuth_rad) * np.cos(elevation_rad),
            np.sin(elevation_rad),
        ],
        axis=-1,
    )


def epoch(baseline_enu_m, n_satellites, sd_m, length_m, rng=None):
    """Double differences of one epoch and their true integers; noise-free and without integers if no rng."""
    azimuth, elevation = np.radians(SKY_DEG[:n_satellites]).T
    rays = unit_enu(azimuth, elevation)
    design = -(rays[1:] - rays[0])
    m = n_satellites - 1
    cov = 2.0 * sd_m**2 * (np.eye(m) + 1.0)
    integers = np.zeros(m, dtype=np.int64) if rng is None else rng.integers(-20, 21, m)
    phase = design @ baseline_enu_m + WAVELENGTH_M * integers
    if rng is not None:
        phase = phase + np.linalg.cholesky(cov) @ rng.standard_normal(m)
    problem = DoubleDifferences(
        phase_m=phase,
        design=design,
        wavelength_m=np.full(m, WAVELENGTH_M),
        cov_phase_m2=cov,
        code_m=np.empty(0),
        code_design=np.empty((0, 3)),
        cov_code_m2=np.empty((0, 0)),
        elevation_rad=elevation[1:],
        length_m=length_m,
        length_sd_m=0.003,
    )
    return problem, integers


def region_counts():
    """Candidates that the primaries leave, by length and region."""
    counts = {}
    for length, region in COUNTS:
        baseline = length * unit_enu(np.radians(33.0), np.radians(5.0))
        problem, _ = epoch(baseline, 7, 0.001, length)
        options = LsastOptions(region=region, coarse_length_tolerance_m=0.02)
        counts[length, region] = primary_region_count(problem, options)
    return counts


def shares(n_satellites, sd_mm, n_headings, seed):
    """Numbers of epochs with the best candidate right, accepted, and accepted right."""
    tolerance = TOLERANCE_M[sd_mm]
    options = LsastOptions(coarse_length_tolerance_m=tolerance, fine_length_tolerance_m=tolerance)
    rng = np.random.default_rng([seed, n_satellites, round(10 * sd_mm)])
    right = accepted = both = 0
    for _ in range(n_headings):
        heading, elevation = rng.uniform(0.0, 2.0 * np.pi), np.radians(rng.uniform(-5.0, 5.0))
        problem, integers = epoch(unit_enu(heading, elevation), n_satellites, sd_mm / 1000.0, 1.0, rng)
        result = resolve_lsast(problem, options)
        is_right = len(result.objective) > 0 and np.array_equal(result.integers_cyc[0], integers)
        is_fixed = result.status == Status.FIXED
        right += is_right
        accepted += is_fixed
        both += is_right and is_fixed
    return right, accepted, both


def page(n_headings, seed):
    """The page as text."""
    reference = {(n, s): (a, b, c) for n, s, a, b, c in REFERENCE}
    lines = [
        "# Least-squares ambiguity search at single epochs",
        "",
        f"Made by `python tools/make_lsast_anchors.py --headings {n_headings} --seed {seed} "
        f"--out docs/validation/lsast_anchors.md`, truenorth {truenorth.__version__}, "
        f"{datetime.date.today().isoformat()}.",
        "",
        "Seven satellites at azimuth/elevation",
        ", ".join(f"{a:.0f}/{e:.0f}" for a, e in SKY_DEG) + " degrees, the first one the reference,",
        "fewer by dropping the last; baseline 1 m, random heading, elevation within 5 degrees; GPS L1, white",
        "noise; tolerance of shell and fine length test 2.0, 2.4, 4.8 and 12 cm for 1, 2, 4 and 10.3 mm of",
        "undifferenced phase noise; ratio 3; residual test at 0.1 %. A lone candidate is not accepted. "
        "The study",
        "follows Wang & Lachapelle 2002; 10.3 mm is the noise of their low-cost receivers. In brackets: an",
        "independent implementation of the same study with 400 headings, whose own binomial standard "
        "deviation",
        "is up to 2.5 points.",
        "",
        "| satellites | noise, mm | best right, % | accepted, % | right of accepted, % |",
        "| --- | --- | --- | --- | --- |",
    ]
    for n, s in CASES:
        right, accepted, both = shares(n, s, n_headings, seed)
        ours = (
            100.0 * right / n_headings,
            100.0 * accepted / n_headings,
            100.0 * both / accepted if accepted else np.nan,
        )
        theirs = reference.get((n, s))
        cells = [f"{v:.1f}" + (f" ({theirs[k]:.1f})" if theirs else "") for k, v in enumerate(ours)]
        lines.append(f"| {n} | {s:g} | " + " | ".join(cells) + " |")
    lines += [
        "",
        "With five satellites one degree of freedom is left; ratios above 3 then arise by chance, and most",
        "accepted epochs are wrong. That is the method's limit, not an error of the implementation.",
        "",
        "## Candidates of the primary satellites",
        "",
        "Baseline at azimuth 33, elevation 5 degrees, without noise, tolerance 2 cm; primaries are the four",
        "highest satellites. Expected from the volume: (4/3) pi (b + tol)^3 |det G| / wavelength^3, and the",
        "difference of two of these for the shell.",
        "",
        "| length, m | region | enumerated | by volume |",
        "| --- | --- | --- | --- |",
    ]
    problem, _ = epoch(unit_enu(0.0, 0.0), 7, 0.001, 1.0)
    density = 4.0 / 3.0 * np.pi * abs(np.linalg.det(problem.design[:3])) / WAVELENGTH_M**3
    for (length, region), count in region_counts().items():
        volume = (length + 0.02) ** 3 - (0.0 if region == "sphere" else (length - 0.02) ** 3)
        lines.append(f"| {length:g} | {region} | {count} | {density * volume:.1f} |")
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--headings", type=int, default=4000)
    parser.add_argument("--seed", type=int, default=2002)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    arguments.out.write_text(page(arguments.headings, arguments.seed))


if __name__ == "__main__":
    main()
