"""North from the Earth's rotation: gyrocompassing and the rotating accelerometer.

Every method takes increments of an inertial unit in body axes (`truenorth.strapdown.InertialIncrements`;
the turntable its own log), a `Site`, and what is known of the sensor's errors
(`truenorth.sensors.ImuDescription`), and returns a `NorthSolution`.
"""

import importlib
from typing import Any

_PUBLIC = {
    "DEFAULT_METHOD": "find",
    "ErrorBudget": "solution",
    "FineAlignment": "fine",
    "METHODS": "find",
    "NorthRun": "solution",
    "NorthSolution": "solution",
    "Site": "site",
    "TURNING": "find",
    "TurntableNorth": "turntable",
    "Verdict": "solution",
    "align_carousel": "positions",
    "align_fine": "fine",
    "align_inertial": "inertial",
    "align_positions": "positions",
    "align_static": "static",
    "design_turntable": "turntable_design",
    "detect_stillness": "stillness",
    "estimate_latitude": "inertial",
    "find_north": "find",
    "find_north_turntable": "turntable",
    "judge": "budget",
    "predict_budget": "predict",
    "static_budget": "budget",
}
"""Public name and the module that holds it; loaded on first use."""

__all__ = list(_PUBLIC)


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_PUBLIC[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
