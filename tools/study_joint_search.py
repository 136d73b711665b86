"""Study the joint search of an array: how often all integers are right, what it claims, and its time.

One epoch of GPS L1, the body coordinates exactly known, heading uniform, pitch and roll uniform within 6
degrees; undifferenced noise of 3 mm and 0.30 m at all elevations. Beside the joint search stand the
length-constrained search of each baseline by itself and, for fewer draws, integer least squares of all
baselines together without any geometry.

    python tools/study_joint_search.py --draws 10000 --seed 2012 --out docs/validation
"""

import argparse
import csv
import itertools
import platform
import sys
import time
from datetime import date
from pathlib import Path

import numpy as np
from study_constrained import AZIMUTH_ELEVATION_DEG, SATELLITES, wilson

import truenorth
from truenorth.ambiguity.array_model import ArrayEpoch
from truenorth.ambiguity.constrained import resolve_constrained
from truenorth.ambiguity.joint import SUCCESS_PROBABILITY, resolve_joint, resolve_joint_epochs
from truenorth.ambiguity.model import DoubleDifferences
from truenorth.errors import Status
from truenorth.rotations import rot_ned_from_body

WAVELENGTH_M = 299792458.0 / 1575.42e6
PHASE_SD_M, CODE_SD_M = 0.003, 0.30
TILT_DEG = 6.0

ARRAYS = {
    "three antennas, perpendicular 1 m arms": np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=float),
    "four antennas, 1 m square": np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype=float),
}

REFERENCE = {3: {6: (1.00, 0.87), 5: (0.95, 0.48), 4: (0.68, 0.08)},
             4: {6: (1.00, 0.87), 5: (0.98, 0.25), 4: (0.78, 0.05)}}  # fmt: skip
"""Shares of an independent implementation, joint and of every baseline by itself, 60 trials each."""

EDGES = (1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 5e-3, 2e-3, 1e-3, 1e-4, 0.0)
"""Bins of the stated probability of being wrong."""

COLUMNS = (
    "antennas satellites draws right baselines_draws baselines_right accepted wrong ms_median ms_95".split()
)


def directions(n_satellites):
    """Unit vectors to the first satellites of the sky in north, east, down."""
    azimuth, elevation = np.radians(AZIMUTH_ELEVATION_DEG[:n_satellites]).T
    return np.column_stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), -np.sin(elevation)]
    )


def draw_attitude(rng):
    """Uniform heading, pitch and roll within the tilt."""
    pitch, roll = np.radians(rng.uniform(-TILT_DEG, TILT_DEG, 2))
    return rot_ned_from_body(rng.uniform(0.0, 2.0 * np.pi), pitch, roll)


def draw_epoch(rng, body, n_satellites, integers=None):
    """One epoch and its true integers, (satellites, antennas) from the first of each."""
    m = len(body)
    sky = directions(n_satellites)
    if integers is None:
        integers = rng.integers(-20, 20, (n_satellites, m))
    geometry = -sky @ draw_attitude(rng) @ body.T
    common = rng.uniform(-50.0, 50.0, (n_satellites, 1))
    phase = geometry + common + rng.uniform(-9.0, 9.0, m) + WAVELENGTH_M * integers
    phase += PHASE_SD_M * rng.standard_normal((n_satellites, m))
    code = geometry + common + rng.uniform(-9.0, 9.0, m) + CODE_SD_M * rng.standard_normal((n_satellites, m))
    n = n_satellites * m
    satellite = np.repeat(np.arange(n_satellites), m)
    epoch = ArrayEpoch(
        np.tile(np.arange(m), n_satellites), satellite, np.zeros(n, np.int64), phase.ravel(), code.ravel(),
        -sky[satellite], np.full(n, WAVELENGTH_M), np.full(n, PHASE_SD_M**2), np.full(n, CODE_SD_M**2), body,
    )  # fmt: skip
    return epoch, integers


def double(values, n_satellites):
    """Double differences of rows sorted by satellite and antenna, (satellites - 1, antennas - 1)."""
    values = np.asarray(values).reshape(n_satellites, -1)
    single = values[:, 1:] - values[:, :1]
    return single[1:] - single[:1]


def baseline_problem(epoch, antenna, n_satellites):
    """Double differences of one baseline, in east, north, up."""
    sky = -epoch.design_ned.reshape(n_satellites, -1, 3)[:, 0][:, [1, 0, 2]] * [1.0, 1.0, -1.0]
    design = -(sky[1:] - sky[:1])
    one = np.eye(n_satellites - 1) + 1.0
    m = n_satellites - 1
    return DoubleDifferences(
        phase_m=double(epoch.phase_m, n_satellites)[:, antenna - 1], design=design,
        wavelength_m=np.full(m, WAVELENGTH_M), cov_phase_m2=2.0 * PHASE_SD_M**2 * one,
        code_m=double(epoch.code_m, n_satellites)[:, antenna - 1], code_design=design,
        cov_code_m2=2.0 * CODE_SD_M**2 * one, length_m=float(np.linalg.norm(epoch.positions_body_m[antenna])),
        length_sd_m=0.0,
    )  # fmt: skip


def every_baseline(epoch, n_satellites):
    """Integers of the length-constrained search of each baseline by itself."""
    found = [
        resolve_constrained(baseline_problem(epoch, a, n_satellites)).integers_cyc[:1]
        for a in range(1, epoch.n_antennas)
    ]
    if any(len(f) == 0 for f in found):
        return None
    return np.column_stack([f[0] for f in found])


def study_cell(body, n_satellites, n_draws, n_baseline_draws, seed):
    """Right or wrong, stated probability and time of each draw; right by baselines of the first ones."""
    rng = np.random.default_rng([seed, len(body), n_satellites])
    right, stated, accepted, seconds = (np.zeros(n_draws) for _ in range(4))
    alone = np.zeros(min(n_baseline_draws, n_draws), dtype=bool)
    for i in range(n_draws):
        epoch, integers = draw_epoch(rng, body, n_satellites)
        start = time.perf_counter()
        found = resolve_joint(epoch)
        seconds[i] = time.perf_counter() - start
        truth = double(integers, n_satellites)
        right[i] = np.array_equal(double(found.integers_cyc, n_satellites), truth)
        stated[i] = np.nan_to_num(found.success_probability * found.attitude_share)
        accepted[i] = found.status == Status.FIXED
        if i < len(alone):
            by_baseline = every_baseline(epoch, n_satellites)
            alone[i] = by_baseline is not None and np.array_equal(by_baseline, truth)
    return right.astype(bool), stated, accepted.astype(bool), seconds, alone


def study_accumulated(body, n_epochs, n_draws, seed, n_satellites=4):
    """Right, accepted, wrong among accepted of `n_epochs` with the same integers, a new attitude in each."""
    rng = np.random.default_rng([seed, 77, len(body), n_epochs])
    counts = np.zeros(3, dtype=int)
    arcs = np.arange(len(body) * n_satellites)
    for _ in range(n_draws):
        epoch, integers = draw_epoch(rng, body, n_satellites)
        epochs = [epoch] + [draw_epoch(rng, body, n_satellites, integers)[0] for _ in range(n_epochs - 1)]
        found = resolve_joint_epochs(epochs, [arcs] * n_epochs)
        right = np.array_equal(double(found.integers_cyc, n_satellites), double(integers, n_satellites))
        is_fixed = found.status == Status.FIXED
        counts += [right, is_fixed, is_fixed and not right]
    return counts


def calibration(right, stated):
    """Markdown rows by bin of the stated probability of being wrong."""
    wrong = 1.0 - stated
    lines = []
    for high, low in itertools.pairwise(EDGES):
        inside = (wrong <= high) & (wrong > low) if low > 0.0 else wrong <= high
        n = int(inside.sum())
        if n:
            bad = int(np.sum(~right[inside]))
            a, b = wilson(bad, n)
            lines.append(
                f"| {high:g} | {low:g} | {n:,} | {wrong[inside].mean():.3g} | {bad / n:.3g} "
                f"| {a:.3g}–{b:.3g} |"
            )
    return lines


def main():
    """Make the page and the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--draws", type=int, default=10_000, help="per cell (default 10000)")
    parser.add_argument("--baseline-draws", type=int, default=1000, help="of which also baseline by baseline")
    parser.add_argument("--accumulated-draws", type=int, default=200)
    parser.add_argument("--seed", type=int, default=2012)
    parser.add_argument("--out", type=Path, help="folder for the page; without it it is printed only")
    options = parser.parse_args()
    rows, all_right, all_stated = [], [], []
    for body in ARRAYS.values():
        for n in reversed(SATELLITES):
            right, stated, accepted, seconds, alone = study_cell(
                body, n, options.draws, options.baseline_draws, options.seed
            )
            all_right.append(right)
            all_stated.append(stated)
            ms = 1e3 * seconds[1:]
            counts = (right.sum(), len(alone), alone.sum(), accepted.sum(), np.sum(accepted & ~right))
            times = (np.median(ms), np.quantile(ms, 0.95))
            rows.append([len(body), n, options.draws, *map(int, counts), *map(float, times)])
            print(rows[-1], file=sys.stderr, flush=True)
    accumulated = []
    for body in ARRAYS.values():
        for n_epochs in (1, 2, 5, 10):
            counts = study_accumulated(body, n_epochs, options.accumulated_draws, options.seed)
            accumulated.append((len(body), n_epochs, *counts))
            print(accumulated[-1], file=sys.stderr, flush=True)
    made = (
        f"Made by `python tools/study_joint_search.py --draws {options.draws} --baseline-draws "
        f"{options.baseline_draws} --accumulated-draws {options.accumulated_draws} --seed {options.seed} "
        f"--out docs/validation` on {date.today()}: truenorth {truenorth.__version__}, "
        f"NumPy {np.__version__}, Python {platform.python_version()}; "
        "times with other programs running on the same two processors."
    )
    page = write_page(rows, accumulated, calibration(np.concatenate(all_right), np.concatenate(all_stated)),
                      options.draws, options.accumulated_draws, made)  # fmt: skip
    if options.out is None:
        sys.stdout.write(page)
        return
    (options.out / "joint_search.md").write_text(page, encoding="utf-8")
    with (options.out / "joint_search.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        writer.writerows([*row[:-2], *(f"{v:.3f}" for v in row[-2:])] for row in rows)


def write_page(rows, accumulated, calibrated, n_draws, n_accumulated, made):
    """The page as text."""
    lines = [
        "# One epoch of a rigid array, all baselines searched together",
        "",
        "GPS L1, one epoch, undifferenced noise of 3 mm and 0.30 m; body coordinates exactly known;",
        "heading uniform, pitch and roll uniform within 6 degrees; the sky of Wang & Lachapelle 2002 with",
        f"an eighth satellite at 290/40. Share of {n_draws:,} draws in which all integers of the optimum are",
        "right, without any acceptance test, with its 95 % interval; beside it an independent implementation",
        "(60 trials); the share in which every baseline by itself, its length known, is right; what is",
        f"accepted at a posterior probability of {SUCCESS_PROBABILITY:g} and a chi-square test at 1e-4; and",
        "wrong among these.",
        "",
        "| antennas | satellites | right | 95 % interval | independent | each baseline | independent "
        "| accepted | wrong among accepted | ms median | ms 95 % |",
        "| ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for m, n, draws, right, n_alone, alone, accepted, wrong, median, high in rows:
        low, up = wilson(right, draws)
        told = REFERENCE[m].get(n)
        joint, single = ("–", "–") if told is None else (f"{told[0]:.2f}", f"{told[1]:.2f}")
        lines.append(
            f"| {m} | {n} | {right / draws:.4f} | {low:.4f}–{up:.4f} | {joint} "
            f"| {alone / max(n_alone, 1):.3f} | {single} | {accepted / draws:.4f} "
            f"| {wrong} of {accepted:,} | {median:.2f} | {high:.2f} |"
        )
    lines += [
        "",
        "## Is the stated probability true?",
        "",
        "All draws of the table together, sorted by the stated probability that integers or attitude are",
        "wrong. The posterior takes all attitudes as equally likely; these, nearly level, contradict that.",
        "Among sure draws the stated probability of being wrong is then too large, since most rival",
        "candidates are tilted; among the unsure ones too small, since a tilted winner is always wrong.",
        "",
        "| stated wrong, from | to | draws | mean stated | observed wrong | 95 % interval |",
        "| ---: | ---: | ---: | ---: | ---: | ---: |",
        *calibrated,
        "",
        "## Four satellites, several epochs",
        "",
        "The same integers in all epochs, a new attitude in each, costs and volumes summed;",
        f"{n_accumulated} draws each.",
        "",
        "| antennas | epochs | right | accepted | wrong among accepted |",
        "| ---: | ---: | ---: | ---: | ---: |",
        *(
            f"| {m} | {k} | {right / n_accumulated:.3f} | {accepted / n_accumulated:.3f} | {wrong} |"
            for m, k, right, accepted, wrong in accumulated
        ),
        "",
        made,
        "",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
