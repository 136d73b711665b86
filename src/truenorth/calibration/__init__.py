"""Where the antennas stand and which way things point: self-survey, theodolites, lever arms, boresight."""

import importlib

_PUBLIC = {
    "ArrayCalibration": "survey",
    "Boresight": "mounting",
    "LeverArm": "mounting",
    "PhaseMap": "phase_maps",
    "adjust_pointings": "theodolite",
    "align_attitudes": "mounting",
    "attitude_of_rows": "phase_centres",
    "body_coordinates": "marks",
    "boresight_from_axes": "mounting",
    "calibrate_array": "survey",
    "correct_phases": "phase_centres",
    "directions_of_rows": "phase_centres",
    "forward_intersection": "theodolite",
    "lever_arm_from_tracks": "mounting",
    "map_residuals": "phase_maps",
    "map_rows": "phase_maps",
    "phase_centre_correction_m": "phase_centres",
    "survey_session": "sources",
    "vectors_of_baselines": "sources",
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
