"""What an array can be expected to do, before it is built: accuracy, success, reliability over a day."""

import importlib
from typing import Any

_PUBLIC = {
    "JointSuccess": "joint_success",
    "Placement": "placement",
    "Plan": "plan",
    "PlanSettings": "settings",
    "Requirement": "requirements",
    "Sweep": "sweeps",
    "box_points": "placement",
    "draw_joint_success": "joint_success",
    "place_antenna": "placement",
    "plan_array": "plan",
    "plan_settings": "settings",
    "requirement": "requirements",
    "sweep_coordinate": "sweeps",
    "sweep_error": "sweeps",
    "sweep_length": "sweeps",
    "white_noise": "settings",
}
"""Public name and the module that holds it; loaded on first use."""

__all__ = list(_PUBLIC)


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_PUBLIC[name]}", __name__), name)
    globals()[name] = value
    return value
