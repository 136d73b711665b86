"""Compile time is a budget: every kernel is used, and none is compiled for more than one set of types.

Writable, read-only and strided arrays, or an integer where a float is meant, would each make Numba
compile the same kernel again. A small solution by every method, with an empty cache of compiled
code, shows it; how long it takes is measured in `benchmarks/compile_time.py`.
"""

import json
import os
import subprocess
import sys

import pytest

_SOLVE_BY_EVERY_METHOD = """
import importlib, json, pkgutil, sys
import truenorth as tn
from truenorth import _kernels
from truenorth.config import METHODS

pair = tn.datasets.fetch("pair_1m_geodetic")
navigation = tn.read_navigation(*pair.navigation)
base, rover = (
    tn.read_observations(pair.files[role]).select_epochs(slice(0, 4)) for role in ("base", "rover")
)
for method in METHODS:
    for single_epoch in (True, False):
        tn.solve_baseline(
            base, rover, navigation, length_m=0.990, length_sd_m=0.003,
            method=method, single_epoch=single_epoch, systems="GR", bands=("L1",),
        )
# Three antennas, searched jointly and smoothed.
from truenorth.config import AttitudeFilterSettings
places = {"aft": (0, 0, 0), "fore": (1, 0, 0), "right": (0, 1, 0)}
drive = tn.simulate({
    "name": "three", "duration_s": 3.0, "place": {"latitude_deg": 47.0, "longitude_deg": 15.0},
    "platform": {"antennas": [{"name": k, "position_body_m": list(v)} for k, v in places.items()]},
    "motion": {"kind": "circle", "radius_m": 40.0, "speed_mps": 8.0},
    "sky": {"kind": "nominal", "systems": "G"}, "output": {"signal_truth": False},
})
tn.solve_array(
    [drive.observations[k] for k in places], list(places.values()), drive.navigation,
    attitude_filter=AttitudeFilterSettings(direction="smoother"),
)
found = {}
for info in pkgutil.iter_modules(_kernels.__path__):
    module = importlib.import_module(f"truenorth._kernels.{info.name}")
    for name, value in vars(module).items():
        if hasattr(value, "py_func") and value.py_func.__module__ == module.__name__:
            found[f"{info.name}.{name}"] = [str(signature) for signature in value.signatures]
print(json.dumps(found))
"""

# Kernels that a solution from RINEX by these methods has no use for, and which public function has.
_FACTORS = "ambiguity.lambda_ on a float solution and its covariance"
_WRITING = "formats.write_rinex_observations"
_ARRAYS = "ambiguity.exhaustive with several baselines at once"
UNUSED = {
    "exhaustive._attitude_step": _ARRAYS,
    "exhaustive._solve3": _ARRAYS,
    "exhaustive._triad": _ARRAYS,
    "exhaustive.attitude_of_integer_sets": _ARRAYS,
    "ils._condition": _FACTORS,
    "ils._first": _FACTORS,
    "ils.enumerate_within": _FACTORS,
    "ils.search_best": _FACTORS,
    "ldl.ldl_factor": _FACTORS,
    "ldl.reduce_": "the readable twin of `ldl.decorrelate`, compared with it in the tests",
    "orbits.interpolate_orbits": "orbits.precise, from SP3",
    "rinex_write._digits": _WRITING,
    "rinex_write.write_epochs": _WRITING,
}


@pytest.mark.jit
def test_every_kernel_is_compiled_once(data_dir, tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", _SOLVE_BY_EVERY_METHOD],
        env={**os.environ, "TRUENORTH_DATA": str(data_dir), "NUMBA_CACHE_DIR": str(tmp_path)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert found
    again = {name: signatures for name, signatures in found.items() if len(signatures) > 1}
    # A constant of a module is typed as a literal unless it is an np.int64, and compiles anew for each value.
    assert not again, json.dumps(again, indent=1)
    unused = {name for name, signatures in found.items() if not signatures}
    assert unused <= set(UNUSED), "a kernel that nothing uses is dead code; name it in UNUSED with its reason"


def test_every_kernel_uses_the_one_decorator():
    import ast
    from pathlib import Path

    from truenorth import _kernels

    # The decorator itself, and the fingerprint of the compiled code, are no kernels.
    not_kernels = ("jit.py", "__init__.py")
    for path in Path(_kernels.__file__).parent.glob("*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef) and path.name not in not_kernels:
                decorators = [ast.unparse(decorator) for decorator in node.decorator_list]
                assert decorators == ["kernel"], (
                    f"{path.name}: {node.name} is not decorated with `kernel` alone"
                )
