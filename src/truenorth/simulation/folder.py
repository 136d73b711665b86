"""A simulated session as a folder: what receivers and sensors wrote, and the truth that they did not know."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ..config import AntennaSection, ArraySettings, GnssSection, PlatformSection, Session
from ..constants import GPS
from ..errors import FormatError
from ..navigation import Navigation
from ..observations import Observations, sat_name, signal_name
from ..sensor_log import SensorLog
from ..sensors.error_file import write_errors
from ..timescales import format_gpst
from .observe import AntennaSimulator
from .run import BLOCK_EPOCHS, Simulator, join_blocks
from .scenario import Scenario, read_scenario
from .sky import FileSky

__all__ = ["SimulationFolder", "write_simulation"]

SURVEYED_SD_M = 0.0005
"""How well a session says that its antennas are known."""

_SUFFIX = {"rinex": ".obs", "ubx": ".ubx", "oem3": ".oem3"}
_TABLE_FOLDER = "truth"


@dataclass(frozen=True, slots=True)
class SimulationFolder:
    """What `write_simulation` wrote.

    Parameters
    ----------
    folder : Path
        Where everything is.
    session : Path or None
        What `truenorth solve` reads; None for a single antenna.
    observations : dict of str to tuple of Path
        Raw data by antenna.
    navigation : tuple of Path
        Orbits.
    truth : Path
        Table of the platform's motion and the receivers' clocks.
    sensors : dict of str to tuple of Path
        Sensor logs by name.
    n_epochs, n_rows : int
        Epochs of the scenario and observations of all antennas.
    seconds : float
        Wall time.
    """

    folder: Path
    session: Path | None
    observations: dict[str, tuple[Path, ...]]
    navigation: tuple[Path, ...]
    truth: Path
    sensors: dict[str, tuple[Path, ...]]
    n_epochs: int
    n_rows: int
    seconds: float


def write_simulation(
    scenario: str | os.PathLike[str] | Mapping[str, Any] | Scenario,
    folder: str | os.PathLike[str],
    overrides: Mapping[str, Any] | Iterable[str] = (),
    *,
    block_epochs: int = BLOCK_EPOCHS,
    progress: Callable[[int, int], None] | None = None,
) -> SimulationFolder:
    """Simulate a scenario into a folder that `truenorth solve` reads; memory is bounded by the block.

    Parameters
    ----------
    scenario : str, path-like, dict or Scenario
        As for `read_scenario`.
    folder : path-like
        Made if need be; files of the same names are written over.
    overrides : dict or sequence of str
        Dotted keys with values.
    block_epochs : int
        Epochs simulated at once; the files do not depend on it, but for the partition of ``truth/``.
    progress : callable, optional
        Called with (epochs done, epochs in all).

    Returns
    -------
    SimulationFolder

    Raises
    ------
    ConfigError
        For an unknown scenario or key or an impossible value.
    FormatError
        If a file cannot be read or written.
    """
    started = time.perf_counter()
    scenario = read_scenario(scenario, overrides)
    simulator = Simulator(scenario)
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "scenario.toml").write_text(scenario.to_toml(), encoding="utf-8")
        shutil.rmtree(folder / _TABLE_FOLDER, ignore_errors=True)
        navigation = _write_navigation(scenario, simulator.sky.navigation, folder)
        observations, n_rows = _write_epochs(simulator, folder, block_epochs, progress)
        sensors = _write_sensors(simulator, folder)
    except OSError as error:
        raise FormatError(
            f"could not write the simulation: {error.strerror}", path=str(error.filename or folder)
        ) from error
    session = None
    if len(observations) > 1:
        session = folder / "session.toml"
        session.write_text(
            _session(scenario, observations, navigation).to_toml(folder=folder), encoding="utf-8"
        )
    return SimulationFolder(
        folder=folder,
        session=session,
        observations=observations,
        navigation=navigation,
        truth=folder / "truth.csv",
        sensors=sensors,
        n_epochs=scenario.n_epochs,
        n_rows=n_rows,
        seconds=time.perf_counter() - started,
    )


def _session(
    scenario: Scenario, observations: dict[str, tuple[Path, ...]], navigation: tuple[Path, ...]
) -> Session:
    """What the solver needs to know, and nothing of the truth."""
    antennas = tuple(
        AntennaSection(
            name=antenna.name,
            observations=str(observations[antenna.name][0]),
            position_body_m=antenna.position_body_m,
        )
        for antenna in scenario.platform.antennas
    )
    return Session(
        platform=PlatformSection(name=scenario.platform.name, antennas=antennas),
        gnss=GnssSection(
            **msgspec.structs.asdict(scenario.solve), navigation=tuple(str(p) for p in navigation)
        ),
        # The coordinates are those of the antennas, as far as the platform does not bend.
        array=ArraySettings(position_sd_m=max(SURVEYED_SD_M, *scenario.platform.flexure.amplitude_m)),
    )


def _write_navigation(scenario: Scenario, navigation: Navigation, folder: Path) -> tuple[Path, ...]:
    """The broadcast as RINEX; tabulated orbits as the file that they came from."""
    from ..formats import write_rinex_navigation

    paths = []
    if not scenario.platform.antennas:
        return ()
    if len(navigation.kepler) or len(navigation.states):
        path = folder / "navigation.rnx"
        write_rinex_navigation(path, replace(navigation, precise=None))
        paths.append(path)
    if navigation.precise is not None and isinstance(scenario.sky, FileSky):
        source = Path(navigation.precise.path)
        shutil.copyfile(source, folder / source.name)
        paths.append(folder / source.name)
    return tuple(paths)


def _write_epochs(
    simulator: Simulator, folder: Path, block_epochs: int, progress: Callable[[int, int], None] | None
) -> tuple[dict[str, tuple[Path, ...]], int]:
    """Observations, tables of truth and the log of what was made to happen, block after block."""
    from ..formats import write_table

    scenario = simulator.scenario
    names = list(simulator.antennas)
    paths: dict[str, tuple[Path, ...]] = {}
    truths: list[dict[str, np.ndarray]] = []
    slips: list[tuple[int, str, int, int, int]] = []
    n_rows = 0
    with ExitStack() as stack:
        writers: dict[str, list[Any]] = {}
        for name in names:
            opened = [
                _open_writer(
                    stack, kind, folder, simulator.antennas[name], simulator.sky.navigation, scenario
                )
                for kind in scenario.output.observations
            ]
            paths[name] = tuple(path for path, _ in opened)
            writers[name] = [writer for _, writer in opened]
        if scenario.output.signal_truth and names:
            (folder / _TABLE_FOLDER).mkdir()
        for number, block in enumerate(simulator.blocks(block_epochs, progress)):
            truths.append(_truth_columns(block.truth, names))
            for name in names:
                one = block.antennas[name]
                slips += one.slips
                n_rows += one.observations.n_rows
                for writer in writers[name]:
                    writer.write_block(one.observations)
                if scenario.output.signal_truth:
                    table = folder / _TABLE_FOLDER / f"{name}-{number:04d}.parquet"
                    write_table(table, _signal_columns(one.truth))
    truth = {key: np.concatenate([part[key] for part in truths]) for key in truths[0]}
    write_table(folder / "truth.csv", truth)
    if slips:
        write_table(folder / "slips.csv", _slip_columns(sorted(slips)))
    return paths, n_rows


def _open_writer(
    stack: ExitStack,
    kind: str,
    folder: Path,
    antenna: AntennaSimulator,
    navigation: Navigation,
    scenario: Scenario,
) -> tuple[Path, Any]:
    """Path and writer of one antenna's observations in one format."""
    suffix = _SUFFIX[kind] + (".gz" if scenario.output.gzip and kind == "rinex" else "")
    path = folder / f"{antenna.meta.marker}{suffix}"
    if kind == "rinex":
        from ..formats import RinexObservationWriter

        fields = ("marker", "receiver_type", "antenna_type", "approx_position_ecef_m", "interval_s")
        writer = RinexObservationWriter(
            path,
            types=antenna.declared_signals,
            glonass_channel=navigation.glonass_channels(),
            program="TrueNorth",
            comments=(f"simulated: {scenario.name}, seed {scenario.seed}",),
            **{field: getattr(antenna.meta, field) for field in fields},
        )
    elif kind == "ubx":
        from ..formats import UbxWriter

        writer = UbxWriter(path, navigation)
    else:
        writer = _Oem3File(path, navigation)
    return path, stack.enter_context(writer)


class _Oem3File:
    """An OEM3 log, which is written as a whole: its lock times and ephemerides go through all epochs."""

    def __init__(self, path: Path, navigation: Navigation) -> None:
        self._path, self._navigation = path, navigation
        self._blocks: list[Observations] = []

    def __enter__(self) -> _Oem3File:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        from ..formats import write_oem3

        if kind is None and self._blocks:
            write_oem3(self._path, join_blocks(self._blocks), self._navigation)

    def write_block(self, observations: Observations) -> None:
        """Keep the epochs; GPS alone takes little room."""
        self._blocks.append(observations.select_rows(observations.sat // 100 == GPS))


def _truth_columns(truth: dict[str, np.ndarray], names: list[str]) -> dict[str, np.ndarray]:
    """The platform's truth with degrees and GPS time, as a person reads it."""
    columns = {
        "time_gpst": np.array([format_gpst(t, decimals=9) for t in truth["time_ns"]]),
        "time_ns": truth["time_ns"],
        "latitude_deg": np.degrees(truth["latitude_rad"]),
        "longitude_deg": np.degrees(truth["longitude_rad"]),
        "height_m": truth["height_m"],
        "heading_deg": np.degrees(truth["heading_rad"]),
        "pitch_deg": np.degrees(truth["pitch_rad"]),
        "roll_deg": np.degrees(truth["roll_rad"]),
        "distance_m": truth["distance_m"],
    }
    axes = (
        ("ecef_m", "position_ecef_m"),
        ("ecef_mps", "velocity_ecef_mps"),
        ("ecef_mps2", "acceleration_ecef_mps2"),
    )
    for (unit, key), word in zip(axes, ("", "v", "a"), strict=True):
        for k, axis in enumerate("xyz"):
            columns[f"{word}{axis}_{unit}"] = truth[key][:, k]
    for k, axis in enumerate(("roll", "pitch", "yaw")):
        columns[f"body_{axis}_rate_dps"] = np.degrees(truth["rate_body_radps"][:, k])
    for name in names:
        columns[f"clock_offset_s_{name}"] = truth[f"clock_offset_s:{name}"]
        columns[f"clock_drift_sps_{name}"] = truth[f"clock_drift_sps:{name}"]
        for k, axis in enumerate("xyz"):
            columns[f"antenna_{axis}_ecef_m_{name}"] = truth[f"antenna_ecef_m:{name}"][:, k]
    return columns


_WIDE = ("range_m", "satellite_clock_m", "receiver_clock_m", "phase_clock_m", "integer_cyc")


def _signal_columns(truth: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Terms of every observation; small ones in single precision, which is below a micrometre."""
    columns = {
        "time_ns": truth["time_ns"],
        "sat": truth["sat"].astype(np.int16),
        "signal": truth["signal"].astype(np.int16),
    }
    for name, values in truth.items():
        if name not in columns:
            columns[name] = values if name in _WIDE or values.dtype != float else values.astype(np.float32)
    return columns


def _slip_columns(slips: list[tuple[int, str, int, int, int]]) -> dict[str, np.ndarray]:
    return {
        "time_gpst": np.array([format_gpst(slip[0]) for slip in slips]),
        "antenna": np.array([slip[1] for slip in slips]),
        "satellite": np.array([sat_name(slip[2]) for slip in slips]),
        "signal": np.array([signal_name(slip[3]) for slip in slips]),
        "cycles": np.array([slip[4] for slip in slips]),
    }


def _write_sensors(simulator: Simulator, folder: Path) -> dict[str, tuple[Path, ...]]:
    """Sensor logs as tables, their truth beside, and in the format of the instrument where there is one."""
    from ..formats import write_sensor_table, write_table

    paths: dict[str, list[Path]] = {}
    logs = simulator.sensors()
    for name, log in logs.items():
        path = folder / "sensors" / f"{name}.csv"
        path.parent.mkdir(exist_ok=True)
        write_sensor_table(path, log)
        paths[name] = [path]
        if simulator.scenario.output.signal_truth and log.truth:
            table = folder / _TABLE_FOLDER / f"{name}.parquet"
            table.parent.mkdir(exist_ok=True)
            write_table(table, log.truth)
    for unit in simulator.scenario.sensors.imu:
        # What `truenorth northfind --errors` reads: this unit's own description.
        write_errors(unit, folder / "sensors" / f"{unit.name}-errors.toml")
    if simulator.scenario.output.native_sensors:
        _write_native(logs, paths)
    return {name: tuple(written) for name, written in paths.items()}


def _write_native(logs: dict[str, SensorLog], paths: dict[str, list[Path]]) -> None:
    """What gyro and compass module send over their serial lines; the module has the tilt meter in it."""
    from ..formats import write_fog_packets, write_tcm2

    if "gyro" in logs:
        paths["gyro"].append(paths["gyro"][0].with_suffix(".fog"))
        write_fog_packets(paths["gyro"][-1], logs["gyro"])
    module = [name for name in ("compass", "tilt") if name in logs]
    if module:
        path = paths[module[0]][0].with_suffix(".tcm2")
        tilt = logs["tilt"] if len(module) == 2 else None
        write_tcm2(path, logs[module[0]], tilt=tilt)
        for name in module:
            paths[name].append(path)
