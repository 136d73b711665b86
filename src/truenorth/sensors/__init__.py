"""Error models of gyro, compass, tilt meter, IMU, turntable accelerometer and odometer.

The simulator draws from these descriptions, and an estimator builds its noise model from the same ones. Each
module holds a description (a table of the scenario file), a simulation that gives a `SensorLog` with every
error term, and the deterministic way back from readings to quantities.
"""

import importlib
from typing import Any

_PUBLIC = {
    "CompassDescription": "compass",
    "FogDescription": "gyro",
    "ImuDescription": "imu",
    "OdometerDescription": "odometer",
    "SensorsSection": "suite",
    "TiltDescription": "tilt",
    "TurntableAccelerometerDescription": "turntable_accelerometer",
    "allan_deviation": "imu",
    "analyse_allan": "allan",
    "correct_gyro": "gyro",
    "correct_imu": "imu",
    "correct_tilt": "tilt",
    "declination_rad": "compass",
    "heading_rate": "gyro",
    "magnetic_heading": "compass",
    "read_errors": "error_file",
    "simulate_compass": "compass",
    "simulate_gyro": "gyro",
    "simulate_imu": "imu",
    "simulate_odometer": "odometer",
    "simulate_sensors": "suite",
    "simulate_tilt": "tilt",
    "simulate_turntable_accelerometer": "turntable_accelerometer",
    "spline_acceleration": "tilt",
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
