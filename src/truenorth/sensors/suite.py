"""The sensors aboard a platform: their tables in a scenario, and all their logs at once."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import msgspec
import numpy as np

from ..sensor_log import SensorLog
from .checks import refuse
from .compass import CompassDescription, simulate_compass
from .gyro import FogDescription, simulate_gyro
from .imu import ImuDescription, simulate_imu
from .kinematics import Mover
from .odometer import OdometerDescription, simulate_odometer
from .sampling import GeneratorByName
from .tilt import TiltDescription, simulate_tilt
from .turntable_accelerometer import TurntableAccelerometerDescription, simulate_turntable_accelerometer

__all__ = ["SensorsSection", "simulate_sensors"]

_OTHERS = ("gyro", "tilt", "compass", "turntable_accelerometer", "odometer")


class SensorsSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The ``[sensors]`` tables of a scenario: what is aboard."""

    gyro: FogDescription | None = None
    compass: CompassDescription | None = None
    tilt: TiltDescription | None = None
    imu: tuple[ImuDescription, ...] = ()
    turntable_accelerometer: TurntableAccelerometerDescription | None = None
    odometer: OdometerDescription | None = None

    def __post_init__(self) -> None:
        names = [unit.name for unit in self.imu]
        for name in names:
            if names.count(name) > 1 or name in _OTHERS:
                refuse("imu", name, "each unit a `name` of its own")
        if self.compass is not None and self.compass.tilt_compensation == "tilt":
            tilt, compass = self.tilt, self.compass
            if tilt is None or (tilt.rate_hz, tilt.phase_s) != (compass.rate_hz, compass.phase_s):
                refuse(
                    "compass.tilt_compensation",
                    "tilt",
                    '"attitude", or describe a tilt meter with the rate and phase of the compass',
                )


def simulate_sensors(
    section: SensorsSection,
    mover: Mover,
    *,
    start_ns: int,
    duration_s: float,
    generator: GeneratorByName,
) -> dict[str, SensorLog]:
    """Logs of all sensors aboard.

    Parameters
    ----------
    section : SensorsSection
        What is aboard.
    mover : object with ``at(time_s)``
        Motion of the body.
    start_ns : int
        GPS time of the start, nanoseconds.
    duration_s : float
        Length of the record, seconds.
    generator : callable
        ``generator(sensor, purpose, ...)`` gives the random generator of one purpose: adding a sensor leaves
        the others as they are.

    Returns
    -------
    dict of str to SensorLog
        By name of the table; IMUs by their own names.
    """
    logs: dict[str, SensorLog] = {}

    def run(name: str, simulate: Callable[..., SensorLog], description: Any, **extra: Any) -> None:
        logs[name] = simulate(
            description,
            mover,
            start_ns=start_ns,
            duration_s=duration_s,
            generator=partial(_draws, generator, name),
            **extra,
        )

    if section.gyro is not None:
        run("gyro", simulate_gyro, section.gyro)
    if section.tilt is not None:
        run("tilt", simulate_tilt, section.tilt)
    if section.compass is not None:
        readings = logs["tilt"].columns if "tilt" in logs else None
        run("compass", simulate_compass, section.compass, tilt_readings=readings)
    for unit in section.imu:
        run(unit.name, simulate_imu, unit)
    if section.turntable_accelerometer is not None:
        run("turntable_accelerometer", simulate_turntable_accelerometer, section.turntable_accelerometer)
    if section.odometer is not None:
        run("odometer", simulate_odometer, section.odometer)
    return logs


def _draws(generator: GeneratorByName, name: str, *purpose: str) -> np.random.Generator:
    """Generator of one purpose of a sensor; compass and tilt meter are one module with one clock."""
    shared = purpose == ("clock_phase",) and name in ("compass", "tilt")
    return generator("compass_module" if shared else name, *purpose)
