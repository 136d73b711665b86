"""The GPS experiments of Oguz 2006 on emulated raw data: his own methods, and the modern default.

Scenarios `oguz-search-1` to `-6` and `oguz-kalman-1` to `-3` give the raw observations of two antennas. The
thesis's searches take of them what the thesis takes: positions from the codes of four satellites, phases
cut to fractions of a cycle, single differences of three satellites for the search and chained double
differences of four for the filters. True integers come from the emulator.
"""

from dataclasses import dataclass
from itertools import combinations, pairwise

import msgspec
import numpy as np

import truenorth
from truenorth.ambiguity.differencing import build_single_differences
from truenorth.ambiguity.double_differences import double_differences
from truenorth.ambiguity.exhaustive import search_single_differences, set_index
from truenorth.ambiguity.kalman import KalmanAttitudeEstimator, KalmanIntegerEstimator, KalmanOptions
from truenorth.config import GnssSettings
from truenorth.constants import SPEED_OF_LIGHT_MPS
from truenorth.errors import Status
from truenorth.observations import sat_name
from truenorth.positioning import solve_single_point
from truenorth.simulation import simulate

HEADING_DEG = 11.0
WAVELENGTH_M = SPEED_OF_LIGHT_MPS / 1575.42e6
EXACT_CYC = 1e-4
"""Stands for the noise of the cases without: what positions and light time leave is far below."""
CHAIN = ("G20", "G10", "G16", "G06")
"""Satellites of the Kalman scenarios in the order in which the thesis's integers come out."""


@dataclass(frozen=True)
class SearchCase:
    """A row of table 3 of the thesis."""

    scenario: str
    length_m: float
    bound: int
    """Largest integer of its candidate sets."""
    noise_cyc: float
    integers: tuple[int, int, int]
    index: int
    azimuth_deg: float

    @property
    def sd_cyc(self):
        """float: Noise of a single difference; each antenna has its own."""
        return max(np.sqrt(2.0) * self.noise_cyc, EXACT_CYC)


@dataclass(frozen=True)
class FilterCase:
    """A row of tables 4 to 6 of the thesis."""

    scenario: str
    length_m: float
    noise_rad: float
    integers: tuple[int, int, int]
    stable: tuple[int, int, int]
    """Epochs after which its float integers stay."""
    heading_deg: float


SEARCH_CASES = (
    SearchCase("oguz-search-1", 0.20, 1, 0.0, (1, 0, 0), 23, 10.9877),
    SearchCase("oguz-search-2", 0.50, 2, 0.0, (2, -1, 1), 109, 10.9928),
    SearchCase("oguz-search-3", 0.76, 4, 0.0, (3, -2, 1), 591, 10.9928),
    SearchCase("oguz-search-4", 0.20, 1, 0.025, (1, 0, 0), 23, 10.5715),
    SearchCase("oguz-search-5", 0.50, 2, 0.025, (2, -1, 1), 109, 10.7027),
    SearchCase("oguz-search-6", 0.76, 4, 0.025, (3, -2, 1), 591, 11.1149),
)
FILTER_CASES = (
    FilterCase("oguz-kalman-1", 1.0, 0.1, (6, -5, 6), (400, 400, 500), 11.0369),
    FilterCase("oguz-kalman-2", 0.5, 0.1, (3, -3, 3), (500, 500, 500), 11.0560),
    FilterCase("oguz-kalman-3", 1.0, 0.2, (6, -5, 6), (600, 500, 600), 10.9168),
)


@dataclass(frozen=True)
class Trial:
    """One simulated data set with what the thesis's methods need of it."""

    simulation: object
    length_m: float

    @property
    def pair(self):
        """Tuple of Observations: master and slave."""
        return tuple(self.simulation.observations.values())

    def settings(self, **overrides):
        """GnssSettings: those of the scenario, with the length and what is overridden."""
        table = msgspec.to_builtins(self.simulation.scenario.solve) | {"length_m": self.length_m}
        return msgspec.convert(table | overrides, GnssSettings)

    def differences(self, settings):
        """SingleDifferences: of the solver, all epochs."""
        options = {"systems": settings.systems, "elevation_mask_deg": settings.elevation_mask_deg}
        points = [solve_single_point(one, self.simulation.navigation, **options) for one in self.pair]
        return build_single_differences(*self.pair, *points, settings)

    def directions(self):
        """Dict of str to ndarray: unit vectors to the satellites of a single epoch, in north, east, down."""
        differences = self.differences(self.settings())
        ned = -differences.design_enu[:, [1, 0, 2]] * [1.0, 1.0, -1.0]
        return {sat_name(int(sat)): unit for sat, unit in zip(differences.sat, ned, strict=True)}

    def whole_cycles(self):
        """Dict of str to (int, int): what the thesis cuts off, and the true integer, slave minus master.

        By satellite at its first epoch. Fractions are cut before the noise is added (thesis, fig. 15).
        """
        cut, integer = {}, {}
        for sign, observations, name in zip((-1, 1), self.pair, self.simulation.signal_truth, strict=True):
            truth = self.simulation.signal_truth[name]
            clean = observations.phase_cyc - truth["phase_noise_m"] / WAVELENGTH_M
            _, first = np.unique(observations.sat, return_index=True)
            for k in first:
                sat = sat_name(int(observations.sat[k]))
                cut[sat] = cut.get(sat, 0) + sign * int(np.floor(clean[k]))
                integer[sat] = integer.get(sat, 0) + sign * int(truth["integer_cyc"][k])
        return {sat: (cut[sat], integer[sat]) for sat in cut}

    def right(self, solution):
        """Ndarray of bool: epochs of a solution whose accepted integers are all the true ones."""
        true = {sat: integer for sat, (_, integer) in self.whole_cycles().items()}
        sat = np.array([true[sat_name(int(s))] for s in solution.residual_sat])
        known = np.isfinite(solution.residual_integer_cyc)
        off = np.where(known, solution.residual_integer_cyc - sat, np.nan)
        is_right = np.zeros(solution.n_epochs, dtype=bool)
        for epoch in np.flatnonzero(solution.is_accepted):
            here = off[(solution.residual_epoch == epoch) & known]
            is_right[epoch] = len(here) > 0 and np.ptp(here) == 0.0
        return is_right


def make_trial(case, seed, start=None, **overrides):
    """Simulate a case with a seed, at its own or another time."""
    overrides = {"seed": int(seed)} | overrides
    if start is not None:
        overrides["start"] = start
    return Trial(simulate(case.scenario, overrides), case.length_m)


def starts(count):
    """Texts of times spread over the day in which the sky comes round."""
    seconds = np.arange(count) * (86164 // count)
    return [f"2006-06-01T{s // 3600:02d}:{s // 60 % 60:02d}:{s % 60:02d}" for s in seconds]


# The exhaustive search.


def attitude_satellites(directions):
    """Three satellites whose directions span most, in the order of their azimuths."""
    best = max(
        combinations(directions, 3), key=lambda three: abs(np.linalg.det([directions[s] for s in three]))
    )
    return sorted(best, key=lambda s: np.arctan2(directions[s][1], directions[s][0]) % (2.0 * np.pi))


@dataclass(frozen=True)
class SearchResult:
    """One search of the thesis."""

    true_set: tuple
    true_index: int
    """0 where the thesis's candidate sets do not hold the true one."""
    index: int
    is_right: bool
    n_inside: int
    is_first_right: bool
    """The first set inside the gate, where the thesis stops, is the right one."""
    cost_cyc2: float
    azimuth_error_deg: float


def thesis_search(case, trial, start="least_squares"):
    """The thesis's search on a trial: three satellites, single differences, all its candidate sets.

    Raw phases as they are; the solver's own methods first bring both receivers to one instant. None where the
    satellites give no position.
    """
    directions = trial.directions()
    if len(directions) < 4:
        return None
    chosen = attitude_satellites(directions)
    cycles = trial.whole_cycles()
    master, slave = (dict(zip(map(sat_name, o.sat.tolist()), o.phase_cyc, strict=True)) for o in trial.pair)
    fraction = np.array([master[s] - slave[s] + cycles[s][0] for s in chosen])
    # Fractions of the master less those of the slave; the set adds what was cut off.
    true_set = tuple(cycles[s][1] - cycles[s][0] for s in chosen)
    known = max(map(abs, true_set)) <= case.bound
    true_index = int(set_index(true_set, case.bound)) if known else 0
    options = {"bound": case.bound, "single_difference_sd_cyc": case.sd_cyc, "start": start}
    arguments = (fraction, np.array([directions[s] for s in chosen]), [case.length_m, 0.0, 0.0], WAVELENGTH_M)
    sets = search_single_differences(*arguments, **options)
    early = search_single_differences(*arguments, **options, early_exit=True)
    north, east, _ = sets.direction_local[0, 0, 0]
    return SearchResult(
        true_set=true_set,
        true_index=true_index,
        index=int(sets.index[0]),
        is_right=int(sets.index[0]) == true_index,
        n_inside=int(np.count_nonzero(sets.cost_cyc2 <= sets.cost_limit_cyc2)),
        is_first_right=int(early.index[0]) == true_index,
        cost_cyc2=float(sets.cost_cyc2[0]),
        azimuth_error_deg=float(np.degrees(np.arctan2(east, north))) - HEADING_DEG,
    )


def thesis_iterations(directions, length_m, steps, orthonormal=False):
    """Azimuths and costs of the thesis's steps (3.9) to (3.18) for the right set and no noise.

    From A = I, with the step of least norm, and I + Theta as printed, or with the rotation next to it.
    """
    heading = np.radians(HEADING_DEG)
    baseline = np.array([length_m / WAVELENGTH_M, 0.0, 0.0])
    measured = directions @ [np.cos(heading), np.sin(heading), 0.0] * baseline[0]
    a, history = np.eye(3), []
    for _ in range(steps):
        residual = measured - directions @ a.T @ baseline
        history.append((float(np.degrees(np.arctan2(a[0, 1], a[0, 0]))), float(residual @ residual)))
        # b . (theta x A s) = theta . (A s x b)
        turn = np.linalg.pinv(np.cross(directions @ a.T, baseline)) @ residual
        x, y, z = turn
        a = (np.eye(3) + np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])) @ a
        if orthonormal:
            u, _, v = np.linalg.svd(a)
            a = u @ v
    return history


# The Kalman filters.


@dataclass(frozen=True)
class FilterResult:
    """One run of both Kalman filters."""

    integers: tuple
    """Rounded at the end, in the thesis's terms: chained, fractions of the first epoch cut."""
    true_integers: tuple
    stable: tuple
    """Epochs from which each float integer rounds to the truth for good; 0 for never."""
    fixed: int
    """Epoch at which the estimator first declared its integers fixed; 0 for never."""
    fixed_right: bool
    """They were the true ones then."""
    pointing_ned_m: np.ndarray
    float_cyc: np.ndarray
    """Float integers of every epoch, chained."""
    float_heading_deg: np.ndarray
    """Of the integer filter's baseline."""
    heading_deg: np.ndarray
    """Of the attitude filter, which starts anew with the integers of the end."""

    @property
    def is_right(self):
        """bool: Whether all integers are right at the end."""
        return self.integers == self.true_integers

    @property
    def heading_error_deg(self):
        """float: At the end."""
        return float((self.heading_deg[-1] - HEADING_DEG + 180.0) % 360.0 - 180.0)


def thesis_filters(trial, chain=None):
    """The thesis's two filters on a trial: integers over all epochs, then the attitude over all epochs.

    Epochs at which the satellites give no position are passed over; None where there is no other.
    """
    settings = trial.settings()
    differences = trial.differences(settings)
    usable = np.flatnonzero(np.diff(differences.start) >= 4)
    if len(usable) == 0:
        return None
    names = np.array([sat_name(int(s)) for s in differences.sat])
    chain = list(chain or sorted(set(names)))
    cycles = trial.whole_cycles()
    estimator = KalmanIntegerEstimator(KalmanOptions(use_code=False))
    floats, bases = np.full((len(usable), len(chain) - 1), np.nan), np.full((len(usable), 3), np.nan)
    problems, fixed, fixed_right = [], 0, False
    true = {s: cycles[s][1] for s in chain}
    for k, epoch in enumerate(usable):
        problem, row, reference, row_key, reference_key = double_differences(
            differences, epoch, length_m=settings.length_m, length_sd_m=settings.length_sd_m, use_code=False
        )
        found = estimator.update(problem, row_key, reference_key)
        of_row, of_reference = names[row], names[reference[0]]
        problems.append((problem, of_row, of_reference))
        by_sat = dict(zip(of_row, estimator.float_integers_cyc, strict=True)) | {of_reference: 0.0}
        # The thesis's integers are added to fractions.
        added = np.array([by_sat[s] - cycles[s][0] for s in chain])
        floats[k] = added[:-1] - added[1:]
        bases[k] = found.float_baseline_enu_m
        if found.status == Status.FIXED and not fixed:
            fixed = int(epoch) + 1
            expected = [true[s] - true[of_reference] for s in of_row]
            fixed_right = bool(np.array_equal(found.integers_cyc[0], expected))
    sets = {s: cycles[s][1] - cycles[s][0] for s in chain}
    truth = tuple(sets[a] - sets[b] for a, b in pairwise(chain))
    rounded = np.rint(floats[-1]).astype(np.int64)
    along = dict(zip(chain, -np.cumsum([0, *rounded]), strict=True))
    final = {s: along[s] + cycles[s][0] for s in chain}
    stable = []
    for k, value in enumerate(truth):
        wrong = np.flatnonzero(np.abs(floats[:, k] - value) >= 0.5)
        last = int(wrong[-1]) + 1 if len(wrong) else 0
        stable.append(int(usable[last]) + 1 if last < len(usable) else 0)
    east, north, up = _attitude_filter(problems, final).T
    return FilterResult(
        integers=tuple(rounded.tolist()),
        true_integers=truth,
        stable=tuple(stable),
        fixed=fixed,
        fixed_right=fixed_right,
        pointing_ned_m=np.array([north[-1], east[-1], -up[-1]]),
        float_cyc=floats,
        float_heading_deg=np.degrees(np.arctan2(bases[:, 0], bases[:, 1])) % 360.0,
        heading_deg=np.degrees(np.arctan2(east, north)) % 360.0,
    )


def _attitude_filter(problems, integers):
    """Baselines (east, north, up) of the thesis's second filter after every epoch."""
    estimator = KalmanAttitudeEstimator()
    baseline = np.empty((len(problems), 3))
    for epoch, (problem, sats, reference) in enumerate(problems):
        cycles = np.array([integers[s] - integers[reference] for s in sats])
        baseline[epoch], _ = estimator.update(
            problem.phase_m - problem.wavelength_m * cycles, problem.design, problem.cov_phase_m2
        )
    return baseline


# The solver as a user runs it.


@dataclass(frozen=True)
class Tally:
    """What a solution is worth; tallies add up."""

    epochs: int = 0
    accepted: int = 0
    right: int = 0
    """Accepted with all integers right."""
    square_deg2: float = 0.0
    """Sum of the squared azimuth errors of these."""

    def __add__(self, other):
        return Tally(*(getattr(self, f) + getattr(other, f) for f in self.__dataclass_fields__))

    @property
    def rms_deg(self):
        """float: Azimuth error of the right epochs."""
        return np.sqrt(self.square_deg2 / self.right) if self.right else np.nan


def solver_tally(trial, settings):
    """Solve a trial and count; epochs without a position are not accepted."""
    solution = truenorth.solve_baseline(*trial.pair, trial.simulation.navigation, settings=settings)
    right = trial.right(solution)
    error = (np.degrees(solution.azimuth_rad[right]) - HEADING_DEG + 180.0) % 360.0 - 180.0
    return Tally(
        solution.n_epochs,
        int(np.count_nonzero(solution.is_accepted)),
        int(np.count_nonzero(right)),
        float(np.sum(error**2)),
    )


def modern(length_m, **overrides):
    """GnssSettings: the defaults with the length."""
    return msgspec.convert({"length_m": length_m} | overrides, GnssSettings)
