"""Tables and figure of the page on the GPS experiments of Oguz 2006, from emulated raw data.

    python tools/make_oguz_tables.py --out docs/validation/oguz_2006.md

About a quarter of an hour on two cores; everything follows from the seed. The figure is written beside
the page, with the same name.
"""

import argparse
import datetime
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
from oguz_trials import (
    CHAIN,
    FILTER_CASES,
    HEADING_DEG,
    SEARCH_CASES,
    WAVELENGTH_M,
    Tally,
    attitude_satellites,
    make_trial,
    modern,
    solver_tally,
    starts,
    thesis_filters,
    thesis_iterations,
    thesis_search,
)

import truenorth

CAUSE_RUNS = 50
MODERN_FILTER_SEEDS = 5
STEPS = 6
SPREADS = (("noise", "its own"), ("geometry", "round the day"))
COLOURS = ("#0072B2", "#D55E00", "#009E73")


# Runs; functions of the module, so that other processes can be given them.


def search_run(case, run, spread):
    """One noise draw: the thesis's search, the solver's exhaustive search, the modern default."""
    seed, start = run
    trial = make_trial(case, seed, start if spread == "geometry" else None)
    found = thesis_search(case, trial)
    tallies = [solver_tally(trial, trial.settings()), solver_tally(trial, modern(case.length_m))]
    full = make_trial(case, seed, start if spread == "geometry" else None, **{"sky.n_satellites": None})
    return found, [*tallies, solver_tally(full, modern(case.length_m))]


def difference_noise_run(case, run):
    """The thesis's search, its noise taken as that of a single difference."""
    less = replace(case, noise_cyc=case.noise_cyc / np.sqrt(2.0))
    sd_m = float(less.noise_cyc * WAVELENGTH_M)
    found = thesis_search(less, make_trial(less, run[0], **{"receiver.noise.phase_sd_m": sd_m}))
    return found.is_right, found.n_inside


def filter_run(case, run, spread):
    """One noise draw of the Kalman filters, without the histories."""
    seed, start = run
    own = spread == "noise"
    result = thesis_filters(make_trial(case, seed, None if own else start), CHAIN if own else None)
    if result is None:
        return None
    return replace(result, float_cyc=result.float_cyc[-1:], heading_deg=result.heading_deg[-1:])


def modern_filter_run(case, seed):
    """Tallies of one seed: four satellites as installed and told of white noise, all satellites both ways."""
    trial = make_trial(case, seed)
    noise = msgspec.to_builtins(trial.settings().stochastic)
    white = noise | {"correlation_s": 1.0, "memory_epochs": 1000.0}
    full = make_trial(case, seed, **{"sky.n_satellites": None})
    return [
        solver_tally(trial, modern(case.length_m)),
        solver_tally(trial, modern(case.length_m, systems="G", stochastic=white)),
        solver_tally(full, modern(case.length_m, single_epoch=True)),
        solver_tally(full, modern(case.length_m)),
    ]


def cause_run(seed):
    """Azimuth errors of case 1 by the solver: rounded phases, as it is, codes without error."""
    case = SEARCH_CASES[0]
    errors = []
    for rounded, exact in ((True, False), (False, False), (False, True)):
        trial = make_trial(case, seed, **{"output.quantise": rounded})
        pair = trial.pair
        if exact:
            truth = trial.simulation.signal_truth.values()
            pair = [
                replace(one, code_m=t["range_m"] + t["receiver_clock_m"] - t["satellite_clock_m"])
                for one, t in zip(pair, truth, strict=True)
            ]
        solution = truenorth.solve_baseline(*pair, trial.simulation.navigation, settings=trial.settings())
        errors.append(np.degrees(solution.azimuth_rad[0]) - HEADING_DEG)
    return [*errors, thesis_search(case, make_trial(case, seed)).azimuth_error_deg]


# The page.


def percent(count, of):
    """Share as text, small ones with more digits."""
    if not of:
        return "–"
    share = 100.0 * count / of
    return f"{share:.0f} %" if count == 0 or share >= 9.95 else f"{share:.2g} %"


def rms(values):
    """Root mean square as text."""
    values = np.asarray(values, dtype=float)
    if len(values) == 0:
        return "–"
    size = np.sqrt(np.mean(values**2))
    return f"{size:.4f}" if size < 0.1 else f"{size:.2f}"


def table(head, rows):
    """Lines of a table."""
    lines = ["| " + " | ".join(head) + " |", "| " + " | ".join("---:" for _ in head) + " |"]
    return [*lines, *("| " + " | ".join(map(str, row)) + " |" for row in rows), ""]


def accepted(tally):
    """Three cells: accepted, wrong among them, error of the right ones."""
    wrong = percent(tally.accepted - tally.right, tally.accepted)
    return [percent(tally.accepted, tally.epochs), wrong, f"{tally.rms_deg:.2f}" if tally.right else "–"]


def search_section(runs, pool):
    """Tables of the search cases; ``runs`` are pairs of seed and start."""
    by_spread = {
        spread: [
            list(pool.map(partial(search_run, case, spread=spread), runs, chunksize=10))
            for case in SEARCH_CASES
        ]
        for spread in ("noise", "geometry")
    }
    first = []
    for k, case in enumerate(SEARCH_CASES):
        found = by_spread["noise"][k][0][0]
        first.append([
            k + 1, f"{case.length_m:.2f}", (2 * case.bound + 1) ** 3, f"{case.noise_cyc:g}",
            f"{list(case.integers)}", case.index, f"{case.azimuth_deg:.4f}",
            f"{list(found.true_set)}", found.true_index, found.index,
            f"{HEADING_DEG + found.azimuth_error_deg:.4f}", f"{found.cost_cyc2:.4f}", found.n_inside,
        ])  # fmt: skip
    head = [
        "case", "length, m", "sets", "noise, cycles", "thesis: set", "place", "azimuth",
        "ours: true set", "its place", "best place", "azimuth", "cost", "sets inside the gate",
    ]  # fmt: skip
    lines = table(head, first)
    second = []
    for spread, text in SPREADS:
        for k, case in enumerate(SEARCH_CASES):
            results = [result for result, _ in by_spread[spread][k] if result]
            n, right = len(results), [r for r in results if r.is_right]
            inside = [r.n_inside for r in results]
            second.append(
                [
                    text,
                    k + 1,
                    n,
                    percent(sum(r.true_index > 0 for r in results), n),
                    percent(len(right), n),
                    percent(sum(r.is_first_right for r in results), n),
                    f"{np.median(inside):.0f} (most {max(inside)})",
                    percent(inside.count(1), n),
                    rms([r.azimuth_error_deg for r in right]),
                    f"{abs(case.azimuth_deg - HEADING_DEG):.4f}",
                    f"{np.degrees(0.005 / case.length_m):.2f}",
                ]
            )
    head = [
        "time",
        "case",
        "runs",
        "true set among the candidates",
        "right set best",
        "right set first inside the gate",
        "sets inside the gate, median",
        "unique",
        "rms error where right",
        "thesis: error",
        "rule 0.5 cm / L",
    ]
    counts = table(head, second)
    third = []
    for spread, text in SPREADS:
        for k in range(len(SEARCH_CASES)):
            tallies = [tallies for _, tallies in by_spread[spread][k]]
            cells = [accepted(sum((t[j] for t in tallies), Tally())) for j in range(3)]
            third.append([text, k + 1, *(cell for three in cells for cell in three)])
    head = [
        "time", "case",
        "`exhaustive`, four: accepted", "wrong", "rms error",
        "`constrained`, four: accepted", "wrong", "rms error",
        "`constrained`, all: accepted", "wrong", "rms error",
    ]  # fmt: skip
    return lines, counts, table(head, third)


def filter_section(runs, pool):
    """Tables of the Kalman cases."""
    first, second, third = [], [], []
    histories = list(pool.map(_history, FILTER_CASES))
    for k, (case, one) in enumerate(zip(FILTER_CASES, histories, strict=True)):
        ours = [
            f"{list(one.true_integers)}", f"{list(one.integers)}", " / ".join(map(str, one.stable)),
            f"{one.heading_deg[-1]:.4f}", " ".join(f"{v:.4f}" for v in one.pointing_ned_m),
        ]  # fmt: skip
        first.append([
            k + 1, f"{case.length_m:.1f}", f"{case.noise_rad:.1f}", f"{list(case.integers)}",
            " / ".join(map(str, case.stable)), f"{case.heading_deg:.4f}", *ours,
        ])  # fmt: skip
    for spread, text in SPREADS:
        for k, case in enumerate(FILTER_CASES):
            results = list(pool.map(partial(filter_run, case, spread=spread), runs, chunksize=5))
            results = [r for r in results if r]
            n, right = len(results), [r for r in results if r.is_right]
            last = [max(r.stable) for r in right if min(r.stable) > 0]
            quantiles = np.quantile(last, [0.05, 0.5, 0.95]) if last else [np.nan] * 3
            fixed = [r for r in results if r.fixed]
            errors = np.abs([r.heading_error_deg for r in right])
            second.append([
                text, k + 1, n, percent(len(right), n), " / ".join(f"{q:.0f}" for q in quantiles),
                percent(len(fixed), n), percent(sum(not r.fixed_right for r in fixed), len(fixed)),
                rms(errors), f"{np.median(errors):.4f}" if len(errors) else "–",
                f"{np.quantile(errors, 0.95):.4f}" if len(errors) else "–",
                f"{abs(case.heading_deg - HEADING_DEG):.4f}",
            ])  # fmt: skip
    for k, case in enumerate(FILTER_CASES):
        seeds = [runs[0][0] + j for j in range(MODERN_FILTER_SEEDS)]
        tallies = list(pool.map(partial(modern_filter_run, case), seeds))
        cells = [accepted(sum((t[j] for t in tallies), Tally())) for j in range(4)]
        third.append([k + 1, *(cell for three in cells for cell in three)])
    head = [
        "case", "length, m", "noise, rad", "thesis: integers", "stable after", "heading",
        "ours: true integers", "rounded at the end", "right from epoch", "heading", "vector NED, m",
    ]  # fmt: skip
    lines = table(head, first)
    head = [
        "time", "case", "runs", "integers right at the end", "right for good from epoch: 5 / 50 / 95 %",
        "declared fixed by our rule", "wrong among these", "rms error where right", "median", "95 %",
        "thesis: error",
    ]  # fmt: skip
    counts = table(head, second)
    head = ["case"]
    for name in ("four", "four, noise told", "all, each epoch by itself", "all"):
        head += [f"{name}: accepted", "wrong", "rms error"]
    return lines, counts, table(head, third), histories


def _history(case):
    return thesis_filters(make_trial(case, 1), CHAIN)


def figure(histories, path):
    """Float integers and heading against epochs, one row a case."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(3, 2, figsize=(10.0, 8.5), sharex=True, layout="constrained")
    for case, result, (left, right) in zip(FILTER_CASES, histories, axes, strict=True):
        epoch = np.arange(1, len(result.float_cyc) + 1)
        for k, colour in enumerate(COLOURS):
            left.plot(epoch, result.float_cyc[:, k], color=colour, label=f"$K_{{{k + 1}{k + 2}}}$")
            left.axhline(result.true_integers[k], color=colour, linewidth=0.8, linestyle="--")
        low, high = min(result.true_integers), max(result.true_integers)
        left.set(ylim=(low - 4.0, high + 4.0), ylabel="float integers, cycles")
        left.set_title(f"{case.length_m:.1f} m, {case.noise_rad:.1f} rad", fontsize=10)
        for heading, colour, label in (
            (result.float_heading_deg, "0.6", "integer filter"),
            (result.heading_deg, COLOURS[0], "attitude filter, with the integers of the end"),
        ):
            error = np.abs((heading - HEADING_DEG + 180.0) % 360.0 - 180.0)
            right.semilogy(epoch, error, color=colour, label=label)
        right.axhline(abs(case.heading_deg - HEADING_DEG), color="black", linewidth=0.8, label="thesis, end")
        right.set(ylim=(1e-3, 3000.0), ylabel="heading error, degrees")
        right.set_title(f"{case.length_m:.1f} m, {case.noise_rad:.1f} rad", fontsize=10)
    axes[0, 0].legend(loc="upper right", ncols=3, fontsize=8)
    axes[0, 1].legend(loc="upper right", fontsize=8)
    for axis in axes[-1]:
        axis.set(xlabel="epoch (1 s)", xlim=(0, len(histories[0].float_cyc)))
    fig.savefig(path, dpi=110)
    plt.close(fig)


def step_table():
    """What the thesis's steps give on the way, for its three lengths."""
    directions = make_trial(SEARCH_CASES[0], 1).directions()
    three = np.array([directions[sat] for sat in attitude_satellites(directions)])
    rows = []
    for case in SEARCH_CASES[:3]:
        history = thesis_iterations(three, case.length_m, STEPS)
        rows.append([f"{case.length_m:.2f}, I + Θ", *(f"{a:.4f} ({c:.0e})" for a, c in history)])
    history = thesis_iterations(three, SEARCH_CASES[2].length_m, STEPS, orthonormal=True)
    rows.append([f"{SEARCH_CASES[2].length_m:.2f}, rotation", *(f"{a:.4f} ({c:.0e})" for a, c in history)])
    return table(["length, m", *(f"step {k}" for k in range(STEPS))], rows)


def tables(seed, n_runs, workers):
    """Parts of the page by name, and the histories of the figure."""
    runs = list(zip(range(seed, seed + n_runs), starts(n_runs), strict=True))
    with ProcessPoolExecutor(workers) as pool:
        search = search_section(runs, pool)
        halved = []
        for case in SEARCH_CASES[3:]:
            results = list(pool.map(partial(difference_noise_run, case), runs, chunksize=10))
            right, inside = zip(*results, strict=True)
            unique = percent(inside.count(1), n_runs)
            halved.append(
                [case.scenario[-1], percent(sum(right), n_runs), f"{np.median(inside):.0f}", unique]
            )
        *filters, histories = filter_section(runs, pool)
        causes = np.array(list(pool.map(cause_run, range(seed, seed + CAUSE_RUNS))))
    names = ("rounded phases", "as simulated", "codes without error", "the thesis's search, raw phases")
    cause_rows = [[name, rms(column)] for name, column in zip(names, causes.T, strict=True)]
    parts = {
        **dict(zip(("search", "search_counts", "search_solver"), search, strict=True)),
        **dict(zip(("filters", "filter_counts", "filter_solver"), filters, strict=True)),
        "halved": table(["case", "right set best", "sets inside, median", "unique"], halved),
        "causes": table(["azimuth of case 1 from", "rms error, degrees"], cause_rows),
        "steps": step_table(),
    }
    return {name: "\n".join(lines).rstrip() for name, lines in parts.items()}, histories


def write_page(parts, out):
    """Put the parts into the text of the page."""
    text = (Path(__file__).parent / "oguz_2006_page.txt").read_text(encoding="utf-8")
    for name, part in parts.items():
        text = text.replace("{" + name + "}", part)
    out.write_text(text, encoding="utf-8")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=2006)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    parts, histories = tables(given.seed, given.runs, given.workers)
    picture = given.out.with_suffix(".png")
    figure(histories, picture)
    parts |= {
        "command": f"python tools/make_oguz_tables.py --seed {given.seed} --runs {given.runs} "
        f"--out docs/validation/{given.out.name}",
        "version": truenorth.__version__,
        "date": datetime.date.today().isoformat(),
        "runs": str(given.runs),
        "causes_runs": str(CAUSE_RUNS),
        "seeds": str(MODERN_FILTER_SEEDS),
        "figure": picture.name,
    }
    write_page(parts, given.out)


if __name__ == "__main__":
    main()
