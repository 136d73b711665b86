"""TrueNorth: where a platform points, from raw GNSS carrier phases.

Conventions
-----------
- Navigation frame NED, body frame FRD (x forward, y right, z down). East-north-up (ENU) is used at
  the edges and for baselines, always by name. Names of rotations cancel:
  ``v_ned = rot_ned_from_body @ v_body``.
- Heading and azimuth are clockwise from true north in [0, 360) degrees; pitch and elevation are
  positive upwards; roll is positive right side down.
- Two antennas give the direction of their baseline: azimuth and elevation. The baseline points
  from the first antenna (base) to the second (rover).
- Radians, metres and seconds inside; degrees only at the edges with the suffix ``_deg``.
- Time is int64 nanoseconds of GPS time since 1980-01-06.
- Carrier phase is positive with range, Doppler positive for an approaching satellite (RINEX).
- No solution is NaN with a `Status` and a `Reason`, never zero.

In three lines::

    import truenorth as tn

    solution = tn.solve_baseline("base.obs", "rover.obs", "brdc.nav", length_m=0.99)
    print(solution)
"""

import importlib
from typing import Any

__version__ = "0.1.0"

_PUBLIC: dict[str, str | None] = {
    "read": "formats",
    "read_observations": "formats",
    "read_navigation": "formats",
    "summarize": "formats",
    "solve_baseline": "attitude",
    "solve_array": "attitude",
    "solve_session": "attitude",
    "solve_single_point": "positioning",
    "AttitudeSolution": "attitude.array_solution",
    "compare": "evaluation",
    "find_north": "northfinding",
    "Site": "northfinding",
    "read_imu_table": "formats",
    "simulate": "simulation",
    "write_simulation": "simulation",
    "BaselineSolution": "attitude.solution",
    "Observations": "observations",
    "Navigation": "navigation",
    "GnssSettings": "config",
    "StochasticSettings": "config",
    "Session": "config",
    "Status": "errors",
    "Reason": "errors",
    "TrueNorthError": "errors",
    "write_solution": "export",
    "datasets": None,
}
"""Public name and the module that holds it; None marks a module. Loaded on first use."""

__all__ = ["__version__", *_PUBLIC]  # noqa: PLE0604  (the keys are strings)


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home = _PUBLIC[name]
    if home is None:
        value = importlib.import_module(f".{name}", __name__)
    else:
        value = getattr(importlib.import_module(f".{home}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
