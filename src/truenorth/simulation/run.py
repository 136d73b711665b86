"""From a scenario to raw data with the truth beside it: in memory, or block after block."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..frames import ecef_from_geodetic, geodetic_from_ecef
from ..navigation import Navigation
from ..observations import Observations
from ..sensor_log import SensorLog
from ..sensors import simulate_sensors
from .motion import Trajectory, build_trajectory
from .observe import AntennaBlock, AntennaSimulator, RaysInView
from .randomness import stream
from .scenario import Scenario, read_scenario
from .sky import Sky, build_sky
from .visibility import Visibility

__all__ = ["Simulation", "SimulationBlock", "Simulator", "join_blocks", "simulate"]

BLOCK_EPOCHS = 600
"""Epochs simulated at once; what comes out does not depend on it."""


@dataclass(frozen=True, slots=True, eq=False)
class SimulationBlock:
    """Some epochs of all receivers.

    Parameters
    ----------
    first, last : int
        Epochs of the scenario, ``last`` not included.
    antennas : dict of str to AntennaBlock
        By antenna, in the order of the platform.
    truth : dict of str to ndarray
        Where the platform was, one row an epoch; see `Simulation`.
    """

    first: int
    last: int
    antennas: dict[str, AntennaBlock]
    truth: dict[str, np.ndarray]


@dataclass(frozen=True, slots=True, eq=False)
class Simulation:
    """A simulated session.

    Parameters
    ----------
    scenario : Scenario
        What was simulated.
    observations : dict of str to Observations
        By antenna, in the order of the platform.
    navigation : Navigation
        What the satellites broadcast.
    truth : dict of str to ndarray, shape (n_epochs, ...)
        At the epochs of the scenario in GPS time: ``time_ns``, ``position_ecef_m``, ``velocity_ecef_mps``,
        ``acceleration_ecef_mps2``, ``latitude_rad``, ``longitude_rad``, ``height_m``, ``heading_rad``,
        ``pitch_rad``, ``roll_rad``, ``rate_body_radps`` (against the Earth), ``distance_m``, and for each
        antenna ``clock_offset_s:NAME``, ``clock_drift_sps:NAME`` and ``antenna_ecef_m:NAME`` (at its own
        time of reception).
    signal_truth : dict of str to dict of str to ndarray
        By antenna: every term of every row of its observations.
    sensors : dict of str to SensorLog
        What else is aboard.
    slips : tuple
        Slips on schedule that took place: (time_ns, antenna, satellite, signal, cycles).
    trajectory : Trajectory
        The motion, for any instant.
    """

    scenario: Scenario
    observations: dict[str, Observations]
    navigation: Navigation
    truth: dict[str, np.ndarray]
    signal_truth: dict[str, dict[str, np.ndarray]]
    sensors: dict[str, SensorLog] = field(default_factory=dict)
    slips: tuple[tuple[int, str, int, int, int], ...] = ()
    trajectory: Trajectory | None = None

    def __str__(self) -> str:
        """One line: name, epochs, antennas, observations."""
        rows = sum(o.n_rows for o in self.observations.values())
        return (
            f"{self.scenario.name}: {self.scenario.n_epochs} epochs, {len(self.observations)} antennas, "
            f"{rows} observations" + "".join(f", {name}" for name in self.sensors)
        )


class Simulator:
    """A scenario made ready: sky, motion, obstructions and receivers.

    Parameters
    ----------
    scenario : Scenario
        All settings.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        place = scenario.place
        latitude, longitude = np.radians(place.latitude_deg), np.radians(place.longitude_deg)
        self.origin_ecef_m = ecef_from_geodetic(latitude, longitude, place.height_m)
        self.trajectory = build_trajectory(
            scenario.motion,
            latitude_rad=float(latitude),
            longitude_rad=float(longitude),
            height_m=place.height_m,
            duration_s=scenario.duration_s,
            seed=scenario.seed,
            folder=scenario.folder,
        )
        self.sky: Sky = build_sky(
            scenario.sky,
            start_ns=scenario.start_ns,
            duration_s=scenario.duration_s,
            seed=scenario.seed,
            folder=scenario.folder,
            position_ecef_m=self.origin_ecef_m,
        )
        visibility = Visibility(scenario.visibility, self.trajectory, scenario.seed)
        antex = None
        if scenario.antex:
            from ..formats import read_antex

            antex = read_antex(os.path.join(scenario.folder, scenario.antex))
        self.antennas = {
            antenna.name: AntennaSimulator(
                scenario, k, self.sky, self.trajectory, visibility, self.origin_ecef_m, antex
            )
            for k, antenna in enumerate(scenario.platform.antennas)
        }

    def blocks(
        self, block_epochs: int = BLOCK_EPOCHS, progress: Callable[[int, int], None] | None = None
    ) -> Iterator[SimulationBlock]:
        """Simulate block after block; once, because receivers carry their state along.

        Parameters
        ----------
        block_epochs : int
            Epochs at once.
        progress : callable, optional
            Called with (epochs done, epochs in all).

        Yields
        ------
        SimulationBlock
        """
        n = self.scenario.n_epochs
        view = RaysInView(
            self.sky,
            self.trajectory,
            self.scenario.start_ns,
            phase_windup=self.scenario.environment.phase_windup,
        )
        for first in range(0, n, block_epochs):
            last = min(first + block_epochs, n)
            time_s = self.scenario.epoch_s(first, last)
            rays = view.step(time_s)
            antennas = {name: antenna.step(first, last, rays) for name, antenna in self.antennas.items()}
            yield SimulationBlock(first, last, antennas, self._truth(first, last, antennas))
            if progress is not None:
                progress(last, n)

    def sensors(self) -> dict[str, SensorLog]:
        """Logs of the sensors aboard, over the whole scenario."""
        scenario = self.scenario
        return simulate_sensors(
            scenario.sensors,
            self.trajectory,
            start_ns=scenario.start_ns,
            duration_s=scenario.duration_s,
            generator=lambda *names: stream(scenario.seed, "sensor", *names),
        )

    def _truth(self, first: int, last: int, antennas: dict[str, AntennaBlock]) -> dict[str, np.ndarray]:
        time_s = self.scenario.epoch_s(first, last)
        motion = self.trajectory.at(time_s)
        latitude, longitude, height = geodetic_from_ecef(motion.position_ecef_m)
        truth = {
            "time_ns": self.scenario.start_ns + np.arange(first, last) * self.scenario.interval_ns,
            "position_ecef_m": motion.position_ecef_m,
            "velocity_ecef_mps": motion.velocity_ecef_mps,
            "acceleration_ecef_mps2": motion.acceleration_ecef_mps2,
            "latitude_rad": latitude,
            "longitude_rad": longitude,
            "height_m": height,
            "heading_rad": motion.heading_rad,
            "pitch_rad": motion.pitch_rad,
            "roll_rad": motion.roll_rad,
            "rate_body_radps": motion.rate_body_radps,
            "distance_m": self.trajectory.distance_m(time_s),
        }
        for name, block in antennas.items():
            truth[f"clock_offset_s:{name}"] = block.clock_offset_s
            truth[f"clock_drift_sps:{name}"] = block.clock_drift_sps
            truth[f"antenna_ecef_m:{name}"] = block.position_ecef_m
        return truth


def simulate(
    scenario: str | os.PathLike[str] | Mapping[str, Any] | Scenario,
    overrides: Mapping[str, Any] | Iterable[str] = (),
    *,
    signal_truth: bool = True,
    block_epochs: int = BLOCK_EPOCHS,
    progress: Callable[[int, int], None] | None = None,
) -> Simulation:
    """Simulate a scenario in memory.

    Parameters
    ----------
    scenario : str, path-like, dict or Scenario
        As for `read_scenario`: a name of the package's, a TOML file, or its content.
    overrides : dict or sequence of str
        Dotted keys with values, e.g. ``{"duration_s": 60}``.
    signal_truth : bool
        Keep every term of every observation.
    block_epochs : int
        Epochs simulated at once; the result does not depend on it.
    progress : callable, optional
        Called with (epochs done, epochs in all).

    Returns
    -------
    Simulation

    Raises
    ------
    ConfigError
        For an unknown scenario or key or an impossible value.
    FormatError
        If a file that the scenario names cannot be read.

    Examples
    --------
    >>> from truenorth.simulation import simulate
    >>> simulation = simulate("oguz-search-1")  # doctest: +SKIP
    """
    simulator = Simulator(read_scenario(scenario, overrides))
    names = list(simulator.antennas)
    parts: dict[str, list[AntennaBlock]] = {name: [] for name in names}
    truths: list[dict[str, np.ndarray]] = []
    slips: list[tuple[int, str, int, int, int]] = []
    for block in simulator.blocks(block_epochs, progress):
        truths.append(block.truth)
        for name in names:
            one = block.antennas[name]
            slips += one.slips
            parts[name].append(one if signal_truth else replace(one, truth={}))
    return Simulation(
        scenario=simulator.scenario,
        observations={name: join_blocks([part.observations for part in parts[name]]) for name in names},
        navigation=simulator.sky.navigation,
        truth=_join_tables(truths),
        signal_truth={name: _join_tables([part.truth for part in parts[name]]) for name in names},
        sensors=simulator.sensors(),
        slips=tuple(sorted(slips)),
        trajectory=simulator.trajectory,
    )


def _join_tables(tables: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    return {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}


def join_blocks(blocks: list[Observations]) -> Observations:
    """One container of consecutive blocks of one receiver."""
    if len(blocks) == 1:
        return blocks[0]
    columns = (
        "time_ns",
        "sat",
        "signal",
        "code_m",
        "phase_cyc",
        "doppler_hz",
        "cn0_dbhz",
        "lli",
        "clock_offset_s",
    )
    counts = np.concatenate([np.diff(block.epoch_start) for block in blocks])
    joined: dict[str, Any] = {name: np.concatenate([getattr(b, name) for b in blocks]) for name in columns}
    start = np.concatenate(([0], np.cumsum(counts))).astype(np.int64)
    return replace(blocks[0], epoch_start=start, **joined)
