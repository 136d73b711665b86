"""Satellite positions, clocks and the atmosphere between them and the antenna."""

import importlib

_PUBLIC = {
    "ORBIT_STATUS_SENTENCES": "selection",
    "OrbitStatus": "selection",
    "SatelliteStates": "broadcast",
    "compute_satellite_states": "broadcast",
    "compute_transmission_states": "transmission",
    "group_delay_s": "group_delay",
    "health_ok": "selection",
    "interpolate_precise": "precise",
    "select_ephemerides": "selection",
}
"""Public name and the module that holds it; loaded on first use."""

__all__ = list(_PUBLIC)


def __getattr__(name):
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_PUBLIC[name]}", __name__), name)
    globals()[name] = value
    return value
