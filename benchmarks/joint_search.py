"""Time of one epoch: the joint search beside its rivals: python benchmarks/joint_search.py [--write].

All see the same epochs of four antennas on a 1 m square, GPS L1, 3 mm and 0.30 m. The rivals are the
length-constrained search baseline by baseline, and integer least squares of all baselines stacked, without
any geometry (LAMBDA). The last row is four systems on two frequencies, 60 phases an antenna.
"""

import sys
import time
from pathlib import Path

import numpy as np
from machine import conditions, parser, report, table

sys.path[:0] = [str(Path(__file__).parents[1] / "tools"), str(Path(__file__).parents[1] / "tests")]

from study_joint_search import (  # noqa: E402
    ARRAYS,
    CODE_SD_M,
    PHASE_SD_M,
    WAVELENGTH_M,
    double,
    every_baseline,
)
from study_joint_search import draw_epoch as draw_gps  # noqa: E402

from joint_epochs import draw_epoch, draw_sky  # noqa: E402
from truenorth.ambiguity.joint import resolve_joint  # noqa: E402
from truenorth.ambiguity.lambda_ import integer_least_squares  # noqa: E402


def stacked_lambda(epoch, n_satellites):
    """Integer least squares of all baselines stacked, their vectors free."""
    m = epoch.n_antennas - 1
    design = np.kron(np.eye(m), epoch.design_ned[:: m + 1][1:] - epoch.design_ned[0])
    cov = np.kron(np.eye(m) + 1.0, np.eye(n_satellites - 1) + 1.0)
    phase, code = (double(v, n_satellites).T.ravel() for v in (epoch.phase_m, epoch.code_m))
    weight = np.linalg.inv(cov) / CODE_SD_M**2
    normal = np.linalg.inv(design.T @ weight @ design)
    vectors = normal @ design.T @ weight @ code
    float_cyc = (phase - design @ vectors) / WAVELENGTH_M
    cov_cyc2 = (cov * PHASE_SD_M**2 + design @ normal @ design.T) / WAVELENGTH_M**2
    return integer_least_squares(float_cyc, cov_cyc2).integers_cyc[0].reshape(m, -1).T


def timed(solve, epochs):
    """Median milliseconds over the epochs, and the results."""
    solve(epochs[0])
    seconds, results = [], []
    for epoch in epochs:
        start = time.perf_counter()
        results.append(solve(epoch))
        seconds.append(time.perf_counter() - start)
    return 1e3 * float(np.median(seconds)), results


def main():
    """Time all of them and print the table."""
    arguments = parser(__doc__.splitlines()[0]).parse_args()
    body = ARRAYS["four antennas, 1 m square"]
    n_epochs = 40 * arguments.runs
    rows = []
    for n in (8, 7, 6, 5, 4):
        rng = np.random.default_rng([1, n])
        drawn = [draw_gps(rng, body, n) for _ in range(n_epochs)]
        epochs = [epoch for epoch, _ in drawn]
        truth = [double(integers, n) for _, integers in drawn]
        joint, found = timed(resolve_joint, epochs)
        rivals = [timed(lambda e, n=n: every_baseline(e, n), epochs)]
        rivals.append(timed(lambda e, n=n: stacked_lambda(e, n), epochs))
        right = np.mean(
            [np.array_equal(double(f.integers_cyc, n), t) for f, t in zip(found, truth, strict=True)]
        )
        cells = [f"{n}", f"{joint:.2f}", f"{right:.2f}"]
        for ms, results in rivals:
            share = np.mean(
                [r is not None and np.array_equal(r, t) for r, t in zip(results, truth, strict=True)]
            )
            cells += [f"{ms:.2f} ({ms / joint:.1f})", f"{share:.2f}"]
        rows.append(cells)
    rng = np.random.default_rng(2)
    many = [draw_epoch(rng, body, 30, n_groups=2, sky=draw_sky(rng, 30))[0] for _ in range(10)]
    rows.append(["2 x 30", f"{timed(resolve_joint, many)[0]:.2f}", "", "", "", "", ""])
    header = ["satellites", "joint, ms", "right", "each baseline, ms (ratio)", "right"]
    header += ["stacked LAMBDA, ms (ratio)", "right"]
    lines = [*conditions(), f"- median of {n_epochs} epochs", "", *table(header, rows)]
    report("Integers of four antennas in one epoch", lines, write=arguments.write)


if __name__ == "__main__":
    main()
