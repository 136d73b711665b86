"""Make `truenorth/ambiguity/failure_rate_table.py`: ratio-test thresholds for a fixed failure rate.

For several models of each number of ambiguities, the covariance is scaled until integer bootstrapping
would fail at chosen rates; integer least squares is then run on float ambiguities drawn from it, and
the smallest threshold is sought at which the share of accepted and wrong draws meets the failure rate.
Between the scalings the threshold is interpolated over the logarithm of the failure rate of integer
least squares; of the models the most careful threshold is kept (method: Verhagen & Teunissen 2013,
GPS Solutions 17:535-548; the numbers are our own).

    python tools/make_failure_rate_table.py            # 20,000 draws a cell, some minutes
"""

import argparse
import platform
import sys
from datetime import date
from pathlib import Path

import numpy as np
from model_geometry import float_covariance

import truenorth
from truenorth.ambiguity.acceptance import ratio_threshold_of_draws, simulate_ratios
from truenorth.ambiguity.lambda_ import decorrelate
from truenorth.ambiguity.success_rate import bootstrapped_success_rate

DIMENSIONS = (2, 3, 5, 7, 10, 14, 20, 28)
NODES = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1)
FAILURE_RATES = (0.01, 0.001)
BOOTSTRAP_FAILURE = (0.001, 0.003, 0.01, 0.03, 0.08, 0.2, 0.4)
"""Up to 0.4, because least squares fails much less often than bootstrapping at 20 ambiguities and more."""
MODELS = ((1, 0.30), (1, 0.30), (2, 0.30), (3, 0.60))
"""Number of frequencies and code noise in metres, each with a sky of its own."""


def scale_for_failure(d, failure):
    """Factor of the covariance at which bootstrapping fails at this rate."""
    low, high = 1e-6, 1e6
    for _ in range(100):
        middle = np.sqrt(low * high)
        if 1.0 - bootstrapped_success_rate(d * middle) > failure:
            high = middle
        else:
            low = middle
    return middle


def thresholds_of_model(cov, n_draws, seed):
    """Failure rate of integer least squares and thresholds, at every scaling."""
    d = decorrelate(cov).d_cyc2
    rates, thresholds = [], []
    for k, failure in enumerate(BOOTSTRAP_FAILURE):
        scaled = cov * scale_for_failure(d, failure)
        # Where half of the draws are wrong, fewer draws give the threshold as well, and each takes longer.
        draws = n_draws if failure < 0.2 else n_draws // 4
        ratio, is_right = simulate_ratios(scaled, n_draws=draws, seed=seed + k)
        rates.append(max(np.mean(~is_right), 0.5 / n_draws))
        thresholds.append([ratio_threshold_of_draws(ratio, is_right, rate) for rate in FAILURE_RATES])
    order = np.argsort(rates)
    return np.array(rates)[order], np.array(thresholds)[order]


def main():
    """Simulate and write the module."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=20130401)
    default = Path(truenorth.__file__).parent / "ambiguity" / "failure_rate_table.py"
    parser.add_argument("--out", type=Path, default=default)
    arguments = parser.parse_args()

    table = np.ones((len(FAILURE_RATES), len(DIMENSIONS), len(NODES)))
    for i, n in enumerate(DIMENSIONS):
        for j, (n_bands, code_sd_m) in enumerate(MODELS):
            seed = arguments.seed + 1000 * i + 100 * j
            cov = float_covariance(n, n_bands, code_sd_m=code_sd_m, rng=np.random.default_rng(seed))
            rates, thresholds = thresholds_of_model(cov, arguments.draws, seed)
            for f, failure_rate in enumerate(FAILURE_RATES):
                at_nodes = np.interp(np.log(NODES), np.log(rates), thresholds[:, f])
                at_nodes[np.array(NODES) <= failure_rate] = 1.0
                table[f, i] = np.maximum(table[f, i], at_nodes)
        # A weaker model never needs a milder threshold; what says so is noise of the simulation.
        table[:, i] = np.maximum.accumulate(table[:, i], axis=1)
        print(f"{n} ambiguities done", file=sys.stderr)

    lines = [
        '"""Thresholds of the ratio test for a fixed failure rate; generated, do not edit.',
        "",
        "Rows follow `DIMENSIONS`, columns `ILS_FAILURE_RATES`; values are second-best over best cost.",
        f"Made by tools/make_failure_rate_table.py --draws {arguments.draws} --seed {arguments.seed}",
        f"on {date.today()}, truenorth {truenorth.__version__}, NumPy {np.__version__}, "
        f"Python {platform.python_version()}.",
        '"""',
        "",
        f"DIMENSIONS = {DIMENSIONS}",
        f"ILS_FAILURE_RATES = {NODES}",
        "RATIO = {",
    ]
    for f, failure_rate in enumerate(FAILURE_RATES):
        lines.append(f"    {failure_rate}: (")
        lines += ["        (" + ", ".join(f"{v:.2f}" for v in row) + ")," for row in table[f]]
        lines.append("    ),")
    lines.append("}")
    arguments.out.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
