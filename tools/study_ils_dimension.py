"""Study the integer search at 20 to 60 ambiguities: does it return the two best, as RTKLIB does not.

Draws float ambiguities from single-epoch models (random skies, `model_geometry`), searches the two best
with ours and, where pyrtklib is installed, with RTKLIB's `lambda`, which stops after 10,000 loops.

    python tools/study_ils_dimension.py --draws 500 --out docs/validation/ils_dimension.md
"""

import argparse
import importlib.metadata
import os
import platform
import sys
import time
from contextlib import contextmanager
from datetime import date
from pathlib import Path

import numpy as np
from model_geometry import float_covariance

import truenorth
from truenorth.ambiguity.lambda_ import MAX_NODES, integer_least_squares

DIMENSIONS = (20, 30, 40, 60)


def rtklib_lambda():
    """RTKLIB's search as a function of floats and covariance, or None where pyrtklib is absent."""
    try:
        import pyrtklib
    except ImportError:
        return None

    def search(floats, cov):
        n = len(floats)
        a, q = pyrtklib.Arr1Ddouble(n), pyrtklib.Arr1Ddouble(n * n)
        f, s = pyrtklib.Arr1Ddouble(2 * n), pyrtklib.Arr1Ddouble(2)
        for i in range(n):
            a[i] = floats[i]
            for j in range(n):
                q[i + j * n] = cov[i, j]
        info = getattr(pyrtklib, "lambda")(n, 2, a, q, f, s)
        return info, np.array([[f[i + j * n] for i in range(n)] for j in range(2)]), np.array([s[0], s[1]])

    return search


@contextmanager
def quiet_stderr():
    """RTKLIB reports every overflow on the C level's stderr."""
    saved, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 2)
    try:
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(nothing)


def study(n, n_bands, n_draws, seed, rival):
    """One row of the table."""
    rng = np.random.default_rng([seed, n, n_bands])
    complete, right, nodes, seconds, gave_up, same = 0, 0, [], [], 0, 0
    for _ in range(n_draws):
        cov = float_covariance(n, n_bands, rng=rng)
        floats = np.linalg.cholesky(cov) @ rng.standard_normal(n)
        start = time.perf_counter()
        ours = integer_least_squares(floats, cov, 2)
        seconds.append(time.perf_counter() - start)
        complete += ours.is_complete
        right += not ours.integers_cyc[0].any()
        nodes.append(ours.n_nodes)
        if rival is not None:
            info, integers, cost = rival(floats, cov)
            if info:
                gave_up += 1
            elif np.array_equal(np.rint(integers), ours.integers_cyc) and np.allclose(
                cost, ours.cost, rtol=1e-6
            ):
                same += 1
    finished = n_draws - gave_up
    theirs = f"{gave_up} | {same} of {finished}" if rival is not None else "not run | not run"
    return (
        f"| {n} | {n_bands} | {complete} of {n_draws} | {right / n_draws:.3f} | {int(np.median(nodes)):,} | "
        f"{max(nodes):,} | {np.median(seconds) * 1e3:.2f} | {max(seconds) * 1e3:.0f} | {theirs} |"
    )


def main():
    """Run the study and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=500)
    parser.add_argument("--seed", type=int, default=60)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    rival = rtklib_lambda()
    rows = []
    with quiet_stderr():
        integer_least_squares([0.0, 0.0], np.eye(2))
        for n_bands in (1, 2):
            rows += [study(n, n_bands, arguments.draws, arguments.seed, rival) for n in DIMENSIONS]
    peer = f"pyrtklib {importlib.metadata.version('pyrtklib')}" if rival else "pyrtklib absent"
    text = f"""# The integer search at 20 to 60 ambiguities

Float ambiguities of one epoch, code 0.30 m and phase 3 mm undifferenced, satellites at random places
above 10 degrees, a new sky for every draw. Two candidates are asked for. "Completed" means that the
search proved both to be the best; the limit is {MAX_NODES:,} nodes. RTKLIB's search stops without a
result after 10,000 loops. "Same" compares both integer vectors and both costs where RTKLIB finished.

| ambiguities | bands | completed | best is right | nodes, median | nodes, max | ms, median | ms, max \
| RTKLIB gave up | same as RTKLIB |
| ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |
{chr(10).join(rows)}

Times are of the whole Python call (decorrelation, search, copying) on the machine of the run, shared
with other work; they are for orientation.

Made by `python tools/study_ils_dimension.py --draws {arguments.draws} --seed {arguments.seed} --out \
docs/validation/ils_dimension.md` on {date.today()}: truenorth {truenorth.__version__}, {peer}, \
NumPy {np.__version__}, Python {platform.python_version()}.
"""
    if arguments.out is None:
        sys.stdout.write(text)
    else:
        arguments.out.write_text(text)


if __name__ == "__main__":
    main()
