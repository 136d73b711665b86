"""Solutions against references: errors aligned in time, their statistics, and whether sigma was honest."""

import importlib
from typing import Any

_PUBLIC = {
    "Comparison": "comparison",
    "NorthComparison": "north_comparison",
    "RateStudy": "update_rates",
    "compare": "comparison",
    "compare_north": "north_comparison",
    "compare_rates": "update_rates",
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
