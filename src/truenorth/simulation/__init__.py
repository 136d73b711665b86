"""The emulator: raw data of any antenna array and sensor suite, with the truth beside it."""

import importlib

_PUBLIC = {
    "Motion": "motion",
    "Scenario": "scenario",
    "Simulation": "run",
    "Simulator": "run",
    "Trajectory": "motion",
    "read_scenario": "scenario",
    "scenario_names": "scenario",
    "simulate": "run",
    "write_simulation": "folder",
}
"""Public name and the module that holds it; loaded on first use."""

__all__ = list(_PUBLIC)


def __getattr__(name):
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_PUBLIC[name]}", __name__), name)
    globals()[name] = value
    return value
