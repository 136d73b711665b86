"""Study the constrained search of one baseline: how often all integers are right, and what it claims.

One epoch of GPS L1, a baseline whose length is exactly known, azimuth uniform; undifferenced noise,
the same for all elevations. The first table draws elevations within 5 degrees of level and applies no
acceptance test. The second sorts all draws by the stated probability of being wrong and counts how
often they are; there the baselines are also drawn uniformly on the sphere, the prior of the posterior.

    python tools/study_constrained.py --draws 10000 --seed 2010 --out docs/validation
"""

import argparse
import itertools
import platform
import sys
from datetime import date
from pathlib import Path

import numpy as np
from engine_run import WAVELENGTH_M, run_engine, single_frequency

import truenorth

AZIMUTH_ELEVATION_DEG = np.array(
    [[40, 65], [150, 48], [255, 55], [320, 30], [95, 22], [200, 18], [10, 15], [290, 40]], dtype=float
)
"""The sky of Wang & Lachapelle 2002, sec. 3.3, and an eighth satellite."""

SATELLITES = (4, 5, 6, 7, 8)
PHASE_SD_MM = (1, 2, 3, 4)
CODE_SD_M = 0.30
LENGTH_M = 1.0

REFERENCE = {
    (4, True): (0.56, 0.41, 0.32, 0.24), (4, False): (0.15, 0.09, 0.07, 0.05),
    (5, True): (0.93, 0.80, 0.70, 0.60), (5, False): (0.85, 0.56, 0.40, 0.26),
    (6, True): (1.00, 0.98, 0.93, 0.89), (6, False): (0.99, 0.94, 0.81, 0.64),
    (7, True): (1.00, 1.00, 0.99, 0.98), (7, False): (1.00, 1.00, 0.97, 0.90),
    (8, True): (1.00, 1.00, 1.00, np.nan), (8, False): (1.00, 1.00, 1.00, np.nan),
}  # fmt: skip
"""Shares of an independent implementation (search on the sphere), 400 trials each."""

REFERENCE_TRIALS = 400

EDGES = np.array([1.0, 0.7, 0.4, 0.2, 0.1, 0.04, 0.02, 0.01, 4e-3, 1e-3, 1e-4, 0.0])
"""Bins of the stated probability of being wrong."""


def directions(n_satellites):
    """Unit vectors to the first satellites of the sky, east, north, up."""
    azimuth, elevation = np.radians(AZIMUTH_ELEVATION_DEG[:n_satellites]).T
    return np.column_stack(
        [np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)]
    )


def simulate(n_satellites, phase_sd_m, n_draws, seed, *, on_sphere=False, length_m=LENGTH_M, length_sd_m=0.0):
    """Rows of `n_draws` epochs, their baselines and their integers against the first satellite."""
    rng = np.random.default_rng([seed, n_satellites, round(1e6 * phase_sd_m), on_sphere])
    azimuth = rng.uniform(0.0, 2.0 * np.pi, n_draws)
    up = rng.uniform(-1.0, 1.0, n_draws)
    if not on_sphere:
        up = np.sin(np.radians(5.0) * up)
    level = np.sqrt(1.0 - up**2)
    size = length_m + length_sd_m * rng.standard_normal(n_draws)
    baseline = size[:, None] * np.column_stack([level * np.sin(azimuth), level * np.cos(azimuth), up])
    sky = directions(n_satellites)
    integers = rng.integers(-20, 20, (n_draws, n_satellites))
    noise = np.sqrt(2.0) * rng.standard_normal((2, n_draws, n_satellites))
    phase = -baseline @ sky.T + WAVELENGTH_M * integers + phase_sd_m * noise[0]
    code = -baseline @ sky.T + CODE_SD_M * noise[1]
    return (single_frequency(sky, phase, code, phase_sd_m, CODE_SD_M), baseline, integers - integers[:, :1])


def resolve(n_satellites, phase_sd_mm, use_code, n_draws, seed, *, on_sphere=False):
    """Whether every draw's integers are right, and the stated probability that they are."""
    rows, _, truth = simulate(n_satellites, 1e-3 * phase_sd_mm, n_draws, seed, on_sphere=on_sphere)
    run = run_engine(rows, use_code=use_code, length_m=LENGTH_M)
    right = np.all(run.integer_cyc.reshape(truth.shape) == truth, axis=1)
    return right, np.nan_to_num(run.probability)


def wilson(hits, n, z=1.96):
    """Confidence interval of a share."""
    share = hits / n
    middle = (share + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * np.sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    return (middle - half if hits > 0 else 0.0), (middle + half if hits < n else 1.0)


def calibration(right, probability):
    """By bin of the stated probability of being wrong: number, mean stated, observed wrong."""
    stated = 1.0 - probability
    rows = []
    for high, low in itertools.pairwise(EDGES):
        inside = (stated <= high) & (stated > low) if low > 0.0 else stated <= high
        if inside.any():
            rows.append(
                (high, low, int(inside.sum()), float(stated[inside].mean()), int(np.sum(~right[inside])))
            )
    return rows


def share_table(results, n_draws):
    """Markdown of the shares of right integers."""
    lines = [
        "| satellites | phase, mm | observations | right | 95 % interval | reference (400 trials) |",
        "| ---: | ---: | --- | ---: | ---: | ---: |",
    ]
    for (n, sd, use_code), (right, _) in results.items():
        low, high = wilson(right.sum(), n_draws)
        reference = REFERENCE[n, use_code][PHASE_SD_MM.index(sd)]
        told = "–" if np.isnan(reference) else f"{reference:.2f}"
        kind = "phase and code" if use_code else "phase only"
        lines.append(f"| {n} | {sd} | {kind} | {right.mean():.4f} | {low:.4f}–{high:.4f} | {told} |")
    return lines


def calibration_table(rows):
    """Markdown of one calibration."""
    lines = [
        "| stated wrong, from | to | draws | mean stated | observed wrong | 95 % interval |",
        "| ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for high, low, n, stated, wrong in rows:
        a, b = wilson(wrong, n)
        lines.append(f"| {low:g} | {high:g} | {n:,} | {stated:.3g} | {wrong / n:.3g} | {a:.3g}–{b:.3g} |")
    return lines


def draw_calibration(tables, path):
    """Observed against stated share of wrong integers, on logarithmic axes."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(5.2, 4.6), layout="constrained")
    for (name, rows), colour, marker in zip(tables.items(), ("#0072B2", "#D55E00"), ("o", "s"), strict=True):
        rows = [row for row in rows if row[4] > 0]
        stated = [row[3] for row in rows]
        observed = np.array([row[4] / row[2] for row in rows])
        bounds = np.array([wilson(row[4], row[2]) for row in rows]).T
        error = np.maximum(np.abs(bounds - observed), 0.0)
        axes.errorbar(stated, observed, error, fmt=marker, color=colour, ms=4, capsize=2, label=name)
    axes.plot([1e-6, 1], [1e-6, 1], color="0.6", lw=1, zorder=0, label="calibrated")
    low = min(row[3] for rows in tables.values() for row in rows if row[4] > 0)
    axes.set(xscale="log", yscale="log", xlim=(0.5 * low, 1.3), ylim=(0.2 * low, 1.3),
             xlabel="stated probability of wrong integers, mean of the bin",
             ylabel="observed share of wrong integers")  # fmt: skip
    axes.grid(color="0.92")
    axes.legend(frameon=False)
    axes.set_title("Constrained search, one epoch, 1 m, 4 to 8 satellites", fontsize=10)
    figure.savefig(path, dpi=110)


def main():
    """Make the pages."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--draws", type=int, default=10_000, help="per cell (default 10000)")
    parser.add_argument("--seed", type=int, default=2010)
    parser.add_argument("--out", type=Path, help="folder for the pages; without it they are printed only")
    options = parser.parse_args()
    cells = [(n, sd, code) for n in SATELLITES for sd in PHASE_SD_MM for code in (True, False)]
    level, sphere = (
        {cell: resolve(*cell, options.draws, options.seed, on_sphere=on_sphere) for cell in cells}
        for on_sphere in (False, True)
    )
    made = (
        f"Made by `python tools/study_constrained.py --draws {options.draws} --seed {options.seed} --out "
        f"docs/validation` on {date.today()}: truenorth {truenorth.__version__}, NumPy {np.__version__}, "
        f"Python {platform.python_version()}."
    )
    shares = [
        "# One epoch of one baseline with its length in the search",
        "",
        "A baseline of 1 m, length exactly known, azimuth uniform, elevation within 5 degrees of level; the",
        "sky of Wang & Lachapelle 2002 with an eighth satellite at 290/40; GPS L1, code 0.30 m",
        f"undifferenced. Share of {options.draws:,} draws with all integers right, without any acceptance",
        "test, beside the shares of an independent implementation that searches the sphere (standard",
        "deviation up to 0.025).",
        "",
        *share_table(level, options.draws),
        "",
        made,
        "",
    ]
    tables = {
        "uniform on the sphere": calibration(*map(np.concatenate, zip(*sphere.values(), strict=True))),
        "within 5° of level": calibration(*map(np.concatenate, zip(*level.values(), strict=True))),
    }
    page = [
        "# Is the stated probability true?",
        "",
        "All cells of the table of [one baseline](constrained_one_baseline.md) together, without acceptance",
        "test: draws sorted by the stated probability that their integers are wrong, and how many were.",
        "The posterior takes all directions as equally likely. With baselines drawn so, it is exact but for",
        "the quadratic form of each candidate's minimum. Baselines within 5 degrees of level contradict that",
        "prior: among sure draws the stated probability of being wrong is then too large, since most rival",
        "candidates are tilted; among the unsure ones too small, since a tilted winner is always wrong.",
        "",
        "![Observed against stated share of wrong integers](constrained_calibration.png)",
        "",
    ]
    for name, rows in tables.items():
        page += [f"## Baselines {name}", "", *calibration_table(rows), ""]
    page += [made, ""]
    if options.out is None:
        sys.stdout.write("\n".join([*shares, *page]))
        return
    (options.out / "constrained_one_baseline.md").write_text("\n".join(shares), encoding="utf-8")
    (options.out / "constrained_calibration.md").write_text("\n".join(page), encoding="utf-8")
    draw_calibration(tables, options.out / "constrained_calibration.png")


if __name__ == "__main__":
    main()
