"""A few epochs of real data through everything, small enough to be run with the JIT off.

This is where coverage sees the engine at work, and where the compiled code is compared with what its
source says when Python runs it.
"""

import gzip
import json
import os
import subprocess
import sys

import numpy as np
import pytest

import truenorth as tn
from truenorth._kernels.jit import IS_COMPILED

N_EPOCHS = 3
# Few signals, so that the searches stay short without the JIT.
SETTINGS = {"systems": "G", "bands": ("L1",), "length_m": 0.990, "length_sd_m": 0.003}


def _first_epochs(path, target):
    """Write the header and the first epochs of a RINEX 3 file as a file of its own."""
    with gzip.open(path, "rt") as source, target.open("w") as copy:
        seen = 0
        for line in source:
            seen += line.startswith(">")
            if seen > N_EPOCHS:
                break
            copy.write(line)
    return target


@pytest.fixture(scope="module")
def pair(data_dir, tmp_path_factory):
    """Take the first epochs of the one-metre pair: paths of base, rover and navigation."""
    files = tn.datasets.fetch("pair_1m_geodetic", folder=data_dir).files
    folder = tmp_path_factory.mktemp("pair")
    base, rover = (_first_epochs(files[role], folder / f"{role}.obs") for role in ("base", "rover"))
    return base, rover, files["navigation"]


@pytest.mark.parametrize("single_epoch", [True, False], ids=["alone", "together"])
@pytest.mark.parametrize("method", ["constrained", "lambda", "filter"])
def test_a_few_epochs_by_each_method(pair, method, single_epoch):
    solution = tn.solve_baseline(*pair, method=method, single_epoch=single_epoch, **SETTINGS)
    assert solution.n_epochs == N_EPOCHS
    assert solution.is_accepted.all()
    # The truth is good to 0.1 degrees; one epoch of GPS L1 scatters by 0.1 degrees on a metre.
    assert np.rad2deg(solution.azimuth_rad) == pytest.approx(193.03, abs=0.7)
    # A phase is good to a few millimetres, and the length is measured from twelve of them.
    assert solution.length_m == pytest.approx(0.990, abs=0.01)


@pytest.mark.skipif(not IS_COMPILED, reason="nothing is compiled in this run")
def test_compiled_code_does_what_its_source_says(pair):
    code = """
import json, sys, truenorth as tn
*pair, settings = json.loads(sys.argv[1])
solution = tn.solve_baseline(*pair, single_epoch=False, **settings)
names = ("baseline_enu_m", "cov_enu_m2", "chi2")
print(json.dumps({name: getattr(solution, name).tolist() for name in names}))
"""
    arguments = json.dumps([*map(str, pair), {**SETTINGS, "bands": list(SETTINGS["bands"])}])
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code, arguments],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    readable = json.loads(done.stdout)
    compiled = tn.solve_baseline(*pair, single_epoch=False, **SETTINGS)
    # Ranges of 2e7 m carry a rounding of 4 nm, which the geometry magnifies to some 10 nm; the phases
    # are good to 3 mm, so a chi-square moves by parts in 1e5.
    for name, values in readable.items():
        np.testing.assert_allclose(getattr(compiled, name), values, rtol=1e-4, atol=1e-7)
