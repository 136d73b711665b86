"""Loading the package is cheap: NumPy at most, and nothing heavy for the help of the command line."""

import json
import subprocess
import sys

import pytest

import truenorth

HEAVY = (
    "numba",
    "scipy",
    "polars",
    "xarray",
    "matplotlib",
    "plotly",
    "hatanaka",
    "pyubx2",
    "pooch",
    "requests",
)

_REPORT = "import sys, json; print(json.dumps(sorted({name.partition('.')[0] for name in sys.modules})))"


def _loaded_by(code):
    """Top-level names in `sys.modules` after running code in a fresh interpreter."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", f"{code}\n{_REPORT}"],
        capture_output=True, text=True, check=True, timeout=120,
    )  # fmt: skip
    return set(json.loads(done.stdout.splitlines()[-1]))


def test_import_loads_numpy_at_most():
    assert not _loaded_by("import truenorth").intersection(HEAVY)


def test_containers_and_settings_are_cheap_too():
    code = "import truenorth as tn; tn.Observations, tn.Navigation, tn.GnssSettings, tn.Status, tn.datasets"
    assert not _loaded_by(code).intersection(HEAVY)


def test_help_of_the_command_line_is_cheap():
    code = """
import contextlib, io, sys
from truenorth.cli import main
sys.argv = ["truenorth", "--help"]
with contextlib.redirect_stdout(io.StringIO()) as said, contextlib.suppress(SystemExit):
    main()
assert "solve" in said.getvalue()
"""
    assert not _loaded_by(code).intersection(HEAVY)


@pytest.mark.parametrize("name", [name for name in truenorth.__all__ if name != "__version__"])
def test_every_public_name_can_be_loaded(name):
    value = getattr(truenorth, name)
    assert value.__doc__
    assert name in dir(truenorth)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'solve_everything'"):
        truenorth.solve_everything  # noqa: B018


def test_the_version_is_that_of_the_distribution():
    from importlib.metadata import version

    assert truenorth.__version__ == version("truenorth")
