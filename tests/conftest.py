"""Shared fixtures: where the real data is, the level of each test, and the Hypothesis profile."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

TESTS = Path(__file__).resolve().parent
LEVELS = ("unit", "property", "reference", "statistical", "regression")

# Compilation makes the first example of a property slow, so a deadline per example would only measure Numba.
settings.register_profile(
    "local", deadline=None, max_examples=25, suppress_health_check=[HealthCheck.too_slow], print_blob=True
)
settings.register_profile("ci", settings.get_profile("local"), derandomize=True, database=None)
settings.load_profile("ci" if os.environ.get("CI") else "local")


def find_data_dir() -> Path | None:
    """Folder of the real data: TRUENORTH_DATA, else `shared/data` beside the checkout, else None."""
    named = os.environ.get("TRUENORTH_DATA")
    folder = Path(named) if named else TESTS.parent.parent / "shared" / "data"
    return folder.resolve() if folder.is_dir() else None


_DATA = find_data_dir()
if _DATA is not None:
    # Exported here, not in the fixture, so that child processes and collection see it too.
    os.environ["TRUENORTH_DATA"] = str(_DATA)


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder of the real data sets; the test is skipped where there is none."""
    if _DATA is None:
        pytest.skip("real data absent: set TRUENORTH_DATA to the folder that holds the data sets")
    return _DATA


def pytest_configure(config: pytest.Config) -> None:
    """Let kernels that run as plain Python wrap, divide by zero and make NaN as silently as compiled ones."""
    if os.environ.get("NUMBA_DISABLE_JIT") == "1":
        for what in ("overflow", "divide by zero", "invalid value"):
            config.addinivalue_line("filterwarnings", f"ignore:{what} encountered in scalar:RuntimeWarning")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark every test with its level, the name of the folder it is in, and with its need of real data."""
    for item in items:
        folder = item.path.relative_to(TESTS).parts[0] if item.path.is_relative_to(TESTS) else ""
        if folder in LEVELS:
            item.add_marker(getattr(pytest.mark, folder))
        if "data_dir" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.real_data)


def pytest_report_header() -> str:
    """Say in the header of the run where the real data was found."""
    return f"truenorth data: {_DATA or 'absent (tests on real data are skipped)'}"
