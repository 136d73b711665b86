"""Study success rate and heading error against satellites, baseline, phase noise and frequencies.

Epochs of the emulator, each resolved by itself with the `constrained` and the `lambda` search: how often
all integers are right, how far the heading is off, and whether the stated probability and sigma are true.
Writes ``success_rates.md``, its figure ``.png`` and the numbers of every cell as ``.csv``. The numbers
follow from the seed, whatever the number of processes.

    python tools/study_success_rates.py --draws 10000 --seed 2012 --out docs/validation
"""

import argparse
import csv
import platform
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import astuple
from datetime import date
from functools import partial
from pathlib import Path

import numpy as np
from success_rate_page import draw_figure, write_page
from success_rate_trials import METHODS, TALLY_FIELDS, Cell, Run, Tally, try_cell

import truenorth

SATELLITES = (4, 5, 6, 7, 8, 10, 12)
NOISE_MM = (1.0, 2.0, 3.0, 5.0, 10.0)
LENGTHS_M = (0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 36.0)
MAIN_NOISE_MM = (1.0, 3.0, 10.0)
"""Of the baselines other than a metre, and of those in all directions."""

FREQUENCIES = (1, 2, 3)
INTERVAL_S, SPHERE_INTERVAL_S = 60.0, 240.0
"""Each day has one elevation of the baseline, so that those of all directions need many days."""

CELL_FIELDS = (
    "any_direction",
    "told",
    "method",
    "frequencies",
    "satellites",
    "length_m",
    "phase_sd_mm",
)


def cells():
    """All cells of the study, level baselines first."""
    level = {Cell(n, 1.0, sd) for n in SATELLITES for sd in NOISE_MM}
    level |= {Cell(7, length, sd) for length in LENGTHS_M for sd in MAIN_NOISE_MM}
    sphere = {Cell(n, 1.0, sd, True) for n in (4, 5, 6, 7, 8) for sd in MAIN_NOISE_MM}
    sphere |= {Cell(7, length, sd, True) for length in (0.2, 5.0, 36.0) for sd in MAIN_NOISE_MM}
    return sorted(level) + sorted(sphere)


def runs(cell):
    """How a cell is solved: baselines of all directions only with the noise told."""
    tolds = (True,) if cell.any_direction else (True, False)
    return [Run(method, n, told) for told in tolds for n in FREQUENCIES for method in METHODS]


def study_cell(cell, draws, seed):
    """Tallies of one cell by (cell, run)."""
    interval_s = SPHERE_INTERVAL_S if cell.any_direction else INTERVAL_S
    return {(cell, run): tally for run, tally in try_cell(cell, runs(cell), draws, seed, interval_s).items()}


def study(draws, seed, jobs):
    """Tallies of all cells."""
    table, work = {}, cells()
    one = partial(study_cell, draws=draws, seed=seed)
    with ProcessPoolExecutor(jobs) as pool:
        for done, found in enumerate(pool.map(one, work), 1):
            table |= found
            sys.stderr.write(f"\r{done} of {len(work)} cells")
            sys.stderr.flush()
    sys.stderr.write("\n")
    return table


def write_numbers(table, made, path):
    """All tallies, one row per cell and run, under a comment that says how they were made."""
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(f"# {made}\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(CELL_FIELDS + TALLY_FIELDS)
        for (cell, run), tally in table.items():
            writer.writerow(
                [
                    int(cell.any_direction),
                    int(run.told),
                    run.method,
                    run.n_frequencies,
                    cell.n_satellites,
                    f"{cell.length_m:g}",
                    f"{cell.phase_sd_mm:g}",
                    *(f"{value:.8g}" for value in astuple(tally)),
                ]
            )


def read_numbers(path):
    """What `write_numbers` wrote: the tallies, and how they were made."""
    with path.open(encoding="utf-8", newline="") as file:
        made = file.readline().removeprefix("# ").rstrip("\n")
        table = {}
        for row in csv.DictReader(file):
            cell = Cell(
                int(row["satellites"]),
                float(row["length_m"]),
                float(row["phase_sd_mm"]),
                row["any_direction"] == "1",
            )
            run = Run(row["method"], int(row["frequencies"]), row["told"] == "1")
            table[cell, run] = Tally(*(float(row[name]) for name in TALLY_FIELDS))
    return table, made


def main():
    """Run the study and write page, figure and numbers."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--draws", type=int, default=10_000, help="per cell at least (default 10000)")
    parser.add_argument("--seed", type=int, default=2012)
    parser.add_argument("--jobs", type=int, default=1, help="processes (default 1)")
    parser.add_argument("--out", type=Path, default=Path("docs/validation"), help="folder of the page")
    parser.add_argument("--page-only", action="store_true", help="page and figure from the numbers there")
    options = parser.parse_args()
    numbers = options.out / "success_rates.csv"
    if options.page_only:
        table, made = read_numbers(numbers)
    else:
        table = study(options.draws, options.seed, options.jobs)
        made = (
            f"Made by `python tools/study_success_rates.py --draws {options.draws} --seed {options.seed} "
            f"--out docs/validation` on {date.today()}: truenorth {truenorth.__version__}, "
            f"NumPy {np.__version__}, Python {platform.python_version()}."
        )
        write_numbers(table, made, numbers)
    (options.out / "success_rates.md").write_text(write_page(table, made), encoding="utf-8")
    draw_figure(table, options.out / "success_rates.png")


if __name__ == "__main__":
    main()
