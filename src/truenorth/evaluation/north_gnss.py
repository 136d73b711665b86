"""North from satellites under the common truth of `truenorth.evaluation.north_comparison`.

One sky for all: every technique gets the phases of the same antennas, with the same noise. Receivers have one
oscillator and calibrated lines, as the thesis assumes; its own methods take the four highest GPS satellites
on L1, the modern ones whatever is in view. Runs are spread over the day in which the sky comes round.

References
----------
P. Oguz, Implementation of Northfinding Techniques, M.Sc. thesis, Middle East Technical University (2006),
ch. 3 and 4.
"""

import time
from collections.abc import Callable, Iterable
from dataclasses import fields, replace
from itertools import combinations
from typing import Any

import msgspec
import numpy as np

from ..ambiguity.differencing import build_single_differences
from ..ambiguity.double_differences import double_differences
from ..ambiguity.exhaustive import search_single_differences
from ..ambiguity.kalman import KalmanAttitudeEstimator, KalmanIntegerEstimator, KalmanOptions
from ..attitude import solve_array, solve_baseline
from ..config import ArraySettings, GnssSettings
from ..constants import SPEED_OF_LIGHT_MPS
from ..errors import NoSolutionError
from ..positioning import solve_single_point
from ..simulation import Simulation, simulate
from ..timescales import NS_PER_S, format_gpst, parse_gpst
from .north_answers import Answers, Scene, wrapped_deg

__all__ = ["KALMAN_EPOCHS", "NOISE_CYC", "SkyOfADay"]

NOISE_CYC = 0.025
"""White noise of the phase of each antenna (thesis, eq. 2.18), cycles of L1."""

KALMAN_EPOCHS = 1000
"""Of one second each (thesis, sec. 4.5)."""

KALMAN_LENGTH_M = 1.0
SEARCH_BOUNDS = {0.20: 1, 0.76: 4}
"""Largest integer of the thesis's candidate sets, by length."""

WAVELENGTH_M = SPEED_OF_LIGHT_MPS / 1575.42e6
NOISE_M = NOISE_CYC * WAVELENGTH_M
CODE_SD_M = 1.0
RULE_M = 0.005
"""The thesis's sigma of the azimuth is this over the length (eq. 3.21)."""

DAY_S = 86164.0
START = "2006-06-01T00:00:00"
ANTENNAS = {
    "master": (0.0, 0.0, 0.0),
    "ahead20": (0.20, 0.0, 0.0),
    "ahead76": (0.76, 0.0, 0.0),
    "ahead100": (KALMAN_LENGTH_M, 0.0, 0.0),
    "right": (0.0, 0.76, 0.0),
    "corner": (0.76, 0.76, 0.0),
}
AHEAD = {0.20: "ahead20", 0.76: "ahead76"}
ARRAY = ("master", "ahead76", "right", "corner")
ARRAY_POSITION_SD_M = 0.0005
"""Told to the array's search: the antennas are where they are said to be."""

TOLD = {
    "phase_sd_m": NOISE_M,
    "phase_elevation_sd_m": 0.0,
    "code_sd_m": CODE_SD_M,
    "code_elevation_sd_m": 0.0,
    "cn0_slope": 0.0,
    "estimate": False,
}
"""Every method knows the noise that there is."""


class SkyOfADay:
    """Raw phases of all antennas at a place; simulated when they are first asked for.

    Parameters
    ----------
    scene : Scene
        Place, heading, seed, and number of runs.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._day: Any = None

    def constrained(self, length_m: float) -> Answers:
        """Search of all satellites with the known length, one epoch a run, no memory.

        Parameters
        ----------
        length_m : float
            0.20 or 0.76.

        Returns
        -------
        Answers
        """
        day = self.day()
        base, rover = (day.observations[name] for name in ("master", AHEAD[length_m]))
        settings = _settings(length_m=length_m, single_epoch=True)
        started = time.process_time()
        solution = _solved(lambda: solve_baseline(base, rover, day.navigation, settings=settings))
        spent_s = time.process_time() - started
        return self._of_epochs(solution, spent_s, "azimuth_rad", lambda: np.degrees(solution.azimuth_sd_rad))

    def array(self) -> Answers:
        """All antennas of the square at once, one epoch a run.

        Returns
        -------
        Answers
        """
        day = self.day()
        receivers = [day.observations[name] for name in ARRAY]
        body_m = [ANTENNAS[name] for name in ARRAY]
        settings = _settings(single_epoch=True)
        known = ArraySettings(position_sd_m=ARRAY_POSITION_SD_M)
        started = time.process_time()
        solution = _solved(
            lambda: solve_array(receivers, body_m, day.navigation, settings=settings, array=known)
        )
        spent_s = time.process_time() - started
        return self._of_epochs(
            solution, spent_s, "heading_rad", lambda: np.degrees(np.sqrt(solution.cov_rad2[:, 0, 0]))
        )

    def search(self, length_m: float) -> Answers:
        """The thesis's search of all integer sets: three satellites, one epoch, the set that fits best.

        The thesis has no test; whatever comes out best is the answer. Its sigma is the rule (3.21).

        Parameters
        ----------
        length_m : float
            0.20 or 0.76.

        Returns
        -------
        Answers
        """
        day, scene = self.day(), self.scene
        names = ("master", AHEAD[length_m])
        pair = [day.observations[name] for name in names]
        settings = _settings(length_m=length_m, systems="G", bands=("L1",), elevation_mask_deg=0.0)
        started = time.process_time()
        differences = _differences(pair, day.navigation, settings)
        error, is_wrong = np.full(scene.runs, np.nan), np.zeros(scene.runs, dtype=bool)
        true_cyc = _true_integers(day, names, differences)
        for epoch in range(differences.n_epochs):
            rows = np.arange(differences.start[epoch], differences.start[epoch + 1])
            rows = rows[_is_l1(differences, rows)]
            rows = rows[np.argsort(-differences.elevation_rad[rows], kind="stable")][:4]
            if len(rows) < 4:
                continue
            ned = -differences.design_enu[:, [1, 0, 2]] * [1.0, 1.0, -1.0]
            rows = _widest_three(rows, ned, differences.azimuth_rad)
            master = pair[0].phase_cyc[differences.base_row[rows]]
            slave = pair[1].phase_cyc[differences.rover_row[rows]]
            # Fractions of the master less those of the slave; the set adds the whole cycles.
            sets = search_single_differences(
                np.mod(master, 1.0) - np.mod(slave, 1.0),
                ned[rows],
                [length_m, 0.0, 0.0],
                WAVELENGTH_M,
                bound=SEARCH_BOUNDS[length_m],
                single_difference_sd_cyc=np.sqrt(2.0) * NOISE_CYC,
            )
            north, east, _ = sets.direction_local[0, 0, 0]
            run = int(differences.base_epoch[epoch])
            error[run] = wrapped_deg(np.degrees(np.arctan2(east, north)) - scene.heading_deg)
            whole = true_cyc[rows] - (np.floor(slave) - np.floor(master))
            is_wrong[run] = not np.array_equal(sets.integers_cyc[0, 0], np.rint(whole))
        spent_s = time.process_time() - started
        sd = np.full(scene.runs, np.degrees(RULE_M / length_m))
        return Answers(error, sd, is_wrong, 0.0, 1e3 * spent_s / scene.runs)

    def kalman(self) -> Answers:
        """The thesis's two filters: integers over all epochs, rounded, then the baseline over all epochs.

        Returns
        -------
        Answers
        """
        n = self.scene.runs
        error, sd, is_wrong = np.full(n, np.nan), np.full(n, np.nan), np.zeros(n, dtype=bool)
        spent_s = 0.0
        for run in range(n):
            spent_s += self._filter(run, error, sd, is_wrong)
        return Answers(error, sd, is_wrong, float(KALMAN_EPOCHS), 1e3 * spent_s / n)

    def day(self) -> Any:
        """Simulate, once, an epoch a run of all antennas and systems."""
        if self._day is None:
            runs = self.scene.runs
            # Scenarios have an epoch an hour at least; what lies between the runs is left out.
            each = int(np.ceil(DAY_S / runs / 3600.0))
            interval_s = DAY_S / runs / each
            simulation = simulate(
                self._scenario(list(ANTENNAS), "GREC", 0, (runs - 1) * each * interval_s, interval_s)
            )
            self._day = _every(simulation, each)
        return self._day

    def _filter(self, run: int, error: np.ndarray, sd: np.ndarray, is_wrong: np.ndarray) -> float:
        """One run of both filters; seconds of processor time."""
        scene, names = self.scene, ("master", "ahead100")
        simulation = simulate(self._scenario(names, "G", run, KALMAN_EPOCHS - 1.0, 1.0))
        pair = [simulation.observations[name] for name in names]
        settings = _settings(length_m=KALMAN_LENGTH_M, systems="G", bands=("L1",), elevation_mask_deg=0.0)
        started = time.process_time()
        differences = _four_highest(_differences(pair, simulation.navigation, settings))
        if differences is None:
            return time.process_time() - started
        estimator = KalmanIntegerEstimator(KalmanOptions(use_code=False))
        problems = []
        for epoch in range(differences.n_epochs):
            problem, row, reference, row_key, reference_key = double_differences(
                differences, epoch, length_m=KALMAN_LENGTH_M, length_sd_m=0.0, use_code=False
            )
            estimator.update(problem, row_key, reference_key)
            problems.append(problem)
        integers = np.rint(estimator.float_integers_cyc)
        attitude = KalmanAttitudeEstimator()
        for problem in problems:
            baseline, cov = attitude.update(
                problem.phase_m - problem.wavelength_m * integers, problem.design, problem.cov_phase_m2
            )
        spent_s = time.process_time() - started
        east, north, _ = baseline
        across = np.array([north, -east, 0.0]) / (north**2 + east**2)
        error[run] = wrapped_deg(np.degrees(np.arctan2(east, north)) - scene.heading_deg)
        sd[run] = np.degrees(np.sqrt(across @ cov @ across))
        true_cyc = _true_integers(simulation, names, differences)
        is_wrong[run] = not np.array_equal(integers, np.rint(true_cyc[row] - true_cyc[reference]))
        return spent_s

    def _of_epochs(
        self, solution: Any, spent_s: float, angle: str, sd_deg: Callable[[], np.ndarray]
    ) -> Answers:
        """Answers of a solution whose epochs are the runs."""
        scene = self.scene
        error, sd = np.full(scene.runs, np.nan), np.full(scene.runs, np.nan)
        if solution is not None:
            run = np.searchsorted(self.day().truth["time_ns"], solution.time_ns - 1_000_000)
            good = solution.is_accepted
            error[run[good]] = wrapped_deg(np.degrees(getattr(solution, angle)[good]) - scene.heading_deg)
            sd[run[good]] = sd_deg()[good]
        return Answers.judged(error, sd, 0.0, 1e3 * spent_s / scene.runs)

    def _scenario(
        self, names: Iterable[str], systems: str, run: int, duration_s: float, interval_s: float
    ) -> dict[str, Any]:
        """Make a scenario of the common truth."""
        scene = self.scene
        shift_ns = round(run * DAY_S / scene.runs) * NS_PER_S
        receiver = {
            "clock": {"oscillator": "one"},
            "bias": {"code_sd_m": 0.0, "phase_sd_cyc": 0.0},
            "noise": {"kind": "constant", "code_sd_m": CODE_SD_M, "phase_sd_m": NOISE_M},
        }
        if systems == "G":
            receiver["signals"] = {"G": ("1C",)}
        return {
            "name": "north",
            "seed": scene.seed + run,
            "start": format_gpst(parse_gpst(START) + shift_ns),
            "duration_s": max(duration_s, 0.001),
            "interval_s": interval_s,
            "place": {
                "latitude_deg": scene.latitude_deg,
                "longitude_deg": scene.longitude_deg,
                "height_m": scene.height_m,
            },
            "platform": {"antennas": [{"name": name, "position_body_m": ANTENNAS[name]} for name in names]},
            "motion": {"kind": "static", "heading_deg": scene.heading_deg},
            "sky": {"kind": "nominal", "systems": systems},
            "receiver": receiver,
            "output": {"quantise": False},
        }


def _every(simulation: Simulation, step: int) -> Simulation:
    """Keep every so many epochs of a simulation."""
    observations, signal_truth = {}, {}
    for name, one in simulation.observations.items():
        keep = np.arange(one.n_epochs) % step == 0
        observations[name] = one.select_epochs(keep)
        rows = keep[one.epoch_of_row]
        signal_truth[name] = {term: values[rows] for term, values in simulation.signal_truth[name].items()}
    truth = {term: values[::step] for term, values in simulation.truth.items()}
    return replace(simulation, observations=observations, signal_truth=signal_truth, truth=truth)


def _settings(**changes: Any) -> GnssSettings:
    """Make settings of the solver that know the noise."""
    return msgspec.convert({"stochastic": TOLD} | changes, GnssSettings)


def _solved(solve: Callable[[], Any]) -> Any:
    """Return a solution, or None where no epoch can be solved at all."""
    try:
        return solve()
    except NoSolutionError:
        return None


def _differences(pair: list[Any], navigation: Any, settings: GnssSettings) -> Any:
    """Single differences of two receivers that stand still."""
    points = [
        solve_single_point(one, navigation, systems=settings.systems, elevation_mask_deg=0.0) for one in pair
    ]
    base, rover = pair
    return build_single_differences(base, rover, points[0], points[1], settings)


def _true_integers(simulation: Simulation, names: Iterable[str], differences: Any) -> np.ndarray:
    """Rover's less base's integer of every single difference, cycles."""
    base, rover = (simulation.signal_truth[name]["integer_cyc"] for name in names)
    return rover[differences.rover_row] - base[differences.base_row]


def _is_l1(differences: Any, rows: Any) -> np.ndarray:
    """Rows of the first carrier that have a phase."""
    return np.isclose(differences.wavelength_m[rows], WAVELENGTH_M) & np.isfinite(differences.phase_m[rows])


def _widest_three(rows: np.ndarray, direction: np.ndarray, azimuth_rad: np.ndarray) -> np.ndarray:
    """Three satellites whose directions span most, in the order of their azimuths."""
    best = max(combinations(rows, 3), key=lambda three: abs(np.linalg.det(direction[list(three)])))
    return np.array(sorted(best, key=lambda row: azimuth_rad[row]))


def _four_highest(differences: Any) -> Any:
    """Differences of the four satellites that are highest in the middle, of those there all the time."""
    n = differences.n_epochs
    rows = np.flatnonzero(_is_l1(differences, slice(None)))
    there = np.bincount(differences.sat[rows], minlength=1) == n
    epoch = differences.epoch_of_row
    middle = rows[(epoch[rows] == n // 2) & there[differences.sat[rows]]]
    if len(middle) < 4:
        return None
    highest = middle[np.argsort(-differences.elevation_rad[middle], kind="stable")][:4]
    # Satellites in one order at all epochs, so that the integers mean the same.
    keep = np.flatnonzero(np.isin(differences.sat, differences.sat[highest]))
    keep = keep[np.lexsort((differences.sat[keep], epoch[keep]))]
    n_rows = len(differences.sat)
    changed = {
        entry.name: getattr(differences, entry.name)[keep]
        for entry in fields(differences)
        if isinstance(getattr(differences, entry.name), np.ndarray)
        and len(getattr(differences, entry.name)) == n_rows
    }
    start = np.concatenate([[0], np.cumsum(np.bincount(epoch[keep], minlength=n))]).astype(np.int64)
    return replace(differences, **(changed | {"start": start}))
