"""Where the antennas stand and which way things point: self-survey, theodolites, lever arms, boresight."""

import importlib

_PUBLIC = {
    "ArrayCalibration": "survey",
    "calibrate_array": "survey",
    "survey_session": "sources",
    "vectors_of_solution": "sources",
}
"""Public name and the module that holds it; loaded on first use."""

__all__ = list(_PUBLIC)


def __getattr__(name):
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_PUBLIC[name]}", __name__), name)
    globals()[name] = value
    return value
