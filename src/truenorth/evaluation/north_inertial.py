"""North from the Earth's rotation under the common truth of `truenorth.evaluation.north_comparison`.

Every run is another unit: its biases, scales, misalignments and noise are drawn anew. All methods of a run
get the same draws; those on a turntable are turned meanwhile.

References
----------
P. Oguz, Implementation of Northfinding Techniques, M.Sc. thesis, Middle East Technical University (2006),
ch. 5 and 6.
"""

from __future__ import annotations

import contextlib
import functools
import time
from collections.abc import Callable, Sequence
from typing import Any

import msgspec
import numpy as np

from ..errors import NoSolutionError
from ..northfinding.site import Site
from ..sensor_log import SensorLog
from ..sensors.imu import ImuDescription, imu_increments_from_log, simulate_imu
from ..sensors.turntable_accelerometer import (
    TurntableAccelerometerDescription,
    coriolis_amplitude_mps2,
    simulate_turntable_accelerometer,
)
from ..simulation.motion import MotionSection, StaticMotion, TurntableMotion, build_trajectory
from ..simulation.randomness import stream
from ..simulation.scenario import read_scenario
from ..strapdown import InertialIncrements
from .north_answers import Answers, Scene, wrapped_deg

__all__ = ["INERTIAL_S", "UnitAtRest"]

INERTIAL_S = 300.0
"""Data that every method of an inertial unit gets."""

RATE_HZ = 10.0
"""Of the inertial units; what matters on a platform at rest is stated per root second."""

HALF_TURN = (18.0, 10.0)
"""From the first position to the second: degrees a second, seconds."""

CAROUSEL_DPS = 6.0


class UnitAtRest:
    """Records of inertial units and of a turning accelerometer; simulated when they are asked for.

    Parameters
    ----------
    scene : Scene
        Place, heading, seed, and number of runs.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.site = Site(np.radians(scene.latitude_deg), np.radians(scene.longitude_deg), scene.height_m)
        self._records: dict[tuple[str, str], list[InertialIncrements]] = {}

    def align(self, method: str, unit: str = "fog", motion: str = "rest", **options: Any) -> Answers:
        """Find north in every run.

        Parameters
        ----------
        method : str
            A name of `truenorth.northfinding.find.METHODS`.
        unit : str
            ``fog``, the sensors of the thesis, or a grade of `ImuDescription`.
        motion : str
            ``rest``, ``half turn`` or ``carousel``.
        **options
            Of the method.

        Returns
        -------
        Answers
        """
        from ..northfinding.find import METHODS

        solve, errors = METHODS[method][0], unit_errors(unit)
        mover, records = self._mover(motion), self._record(unit, motion)
        if motion != "rest":
            # The table has an encoder.
            options["table_angle_rad"] = self._table_angles(motion, mover, records[0].time_s)

        def find(increments: InertialIncrements) -> tuple[float, float, float]:
            solution = solve(increments, self.site, errors=errors, running=False, **options)
            heading_rad = solution.heading_rad
            if method == "published":
                # The thesis takes it from the elements of a matrix that is no rotation.
                heading_rad = float(np.radians(solution.measured["published_heading_deg"]))
            return heading_rad, float(solution.angle_sd_rad[0]), solution.time_s

        def truth_rad(time_s: np.ndarray) -> np.ndarray:
            return np.asarray(mover.at(time_s).heading_rad)

        return self._answers(find, records, INERTIAL_S, truth_rad)

    def square_wave(self) -> Answers:
        """Demodulate a turning accelerometer as published, in every run: the mean of the revolutions.

        Returns
        -------
        Answers
        """
        from ..northfinding.turntable import demodulate
        from ..northfinding.turntable_design import square_wave_heading_sd_rad

        sensor = turntable_sensor()
        sd_rad = square_wave_heading_sd_rad(
            coriolis_amplitude_mps2(sensor, self.site.latitude_rad),
            sensor.noise_mps2,
            sensor.samples_per_revolution,
            sensor.revolutions,
        )

        def find(log: SensorLog) -> tuple[float, float, float]:
            each_rad, _ = demodulate(sensor, log)
            return float(np.angle(np.mean(np.exp(1j * each_rad)))), sd_rad, 0.0

        return self._answers(find, self._turntable_logs(), _turntable_s(sensor))

    def turntable(self) -> Answers:
        """Find north by a turning accelerometer and maximum likelihood, in every run.

        Returns
        -------
        Answers
        """
        from ..northfinding.turntable import find_north_turntable

        sensor = turntable_sensor()

        def find(log: SensorLog) -> tuple[float, float, float]:
            solution = find_north_turntable(log, self.site, description=sensor)
            return solution.heading_rad, float(solution.angle_sd_rad[0]), 0.0

        return self._answers(find, self._turntable_logs(), _turntable_s(sensor))

    def _turntable_logs(self) -> list[SensorLog]:
        """What the turning accelerometer gives in every run."""
        sensor, mover = turntable_sensor(), self._mover("rest")
        return [
            simulate_turntable_accelerometer(
                sensor,
                mover,
                start_ns=0,
                duration_s=_turntable_s(sensor),
                generator=functools.partial(stream, self.scene.seed + run, "turntable"),
            )
            for run in range(self.scene.runs)
        ]

    def _answers(
        self,
        find: Callable[[Any], tuple[float, float, float]],
        records: Sequence[Any],
        data_s: float,
        truth_rad: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> Answers:
        """Answers of all runs (heading, sigma, instant) against the truth, and the time that they took."""
        found = np.full((len(records), 3), np.nan)
        started = time.process_time()
        for run, record in enumerate(records):
            with contextlib.suppress(NoSolutionError):
                found[run] = find(record)
        spent_s = time.process_time() - started
        heading, sd, instant = found.T
        true = np.radians(self.scene.heading_deg)
        if truth_rad is not None:
            true = truth_rad(np.nan_to_num(instant))
        error = np.asarray(wrapped_deg(np.degrees(heading - true)))
        return Answers.judged(error, np.degrees(sd), data_s, 1e3 * spent_s / len(records))

    def _table_angles(self, motion: str, mover: Any, time_s: np.ndarray) -> np.ndarray:
        """What the encoder says: at both halts, or at every edge of the record, not wrapped."""
        if motion == "half turn":
            return np.array([0.0, np.pi])
        heading = mover.at(time_s).heading_rad
        return np.unwrap(heading) - heading[0]

    def _record(self, unit: str, motion: str) -> list[InertialIncrements]:
        """What a unit gives in every run; the draws do not depend on the motion."""
        key = (unit, motion)
        if key not in self._records:
            imu, mover = unit_errors(unit), self._mover(motion)
            self._records[key] = [
                _increments(imu, mover, functools.partial(stream, self.scene.seed + run, "imu"))
                for run in range(self.scene.runs)
            ]
        return self._records[key]

    def _mover(self, motion: str) -> Any:
        """Make the trajectory of a motion."""
        heading = self.scene.heading_deg
        rate_dps, turn_s = HALF_TURN
        half_s = 0.5 * (INERTIAL_S - turn_s)
        motions: dict[str, MotionSection] = {
            "rest": StaticMotion(heading_deg=heading),
            "half turn": TurntableMotion(
                heading_deg=heading, steps=((0.0, 0.0), (half_s, rate_dps), (half_s + turn_s, 0.0))
            ),
            "carousel": TurntableMotion(heading_deg=heading, rate_dps=CAROUSEL_DPS),
        }
        return build_trajectory(
            motions[motion],
            latitude_rad=self.site.latitude_rad,
            longitude_rad=self.site.longitude_rad,
            height_m=self.site.height_m,
            duration_s=INERTIAL_S,
            seed=self.scene.seed,
        )


def unit_errors(unit: str) -> ImuDescription:
    """Errors of a unit by name: ``fog`` is that of the thesis (sec. 6.4), else a grade."""
    if unit == "fog":
        imu = read_scenario("oguz-imu").sensors.imu[0]
        return msgspec.structs.replace(imu, rate_hz=RATE_HZ)
    return ImuDescription(grade=unit, rate_hz=RATE_HZ)  # type: ignore[arg-type]


def turntable_sensor() -> TurntableAccelerometerDescription:
    """Rotating accelerometer of the thesis (sec. 5.3): 600 rpm, 5 cm, 1e-5 m/s^2, ten revolutions."""
    sensor = read_scenario("oguz-turntable").sensors.turntable_accelerometer
    assert sensor is not None  # the scenario has one
    return sensor


def _turntable_s(sensor: TurntableAccelerometerDescription) -> float:
    """Duration of the revolutions, seconds."""
    return sensor.revolutions * 60.0 / abs(sensor.table_rpm)


def _increments(imu: ImuDescription, mover: Any, generator: Any) -> InertialIncrements:
    """One record of a unit, body axes."""
    log = simulate_imu(imu, mover, start_ns=0, duration_s=INERTIAL_S, generator=generator)
    angle, velocity = imu_increments_from_log(imu, log)
    edges = np.arange(len(angle) + 1) / imu.rate_hz
    return InertialIncrements(edges, angle, velocity)
