"""Emulated epochs solved one by one and compared with the truth: the trials of `study_success_rates`.

A cell is a number of satellites, a baseline and a phase noise. Its epochs come from the emulator: two
antennas on a slow turntable at 55 degrees north, the nominal GPS constellation over whole days, only the
highest satellites tracked, white noise of one standard deviation. Every epoch is resolved by itself.
"""

from dataclasses import astuple, dataclass, fields

import msgspec
import numpy as np

import truenorth
from truenorth.config import GnssSettings, StochasticSettings
from truenorth.frames import geodetic_from_ecef, rot_enu_from_ecef
from truenorth.simulation import simulate

BANDS = (("L1",), ("L1", "L2"), ("L1", "L2", "L5"))
"""By the number of frequencies, counted from 0."""

METHODS = ("constrained", "lambda")
CODE_SD_M = 0.3
DAY_S = 86400
MAX_DAYS = 120

DEFAULT_DAYS = 2
"""Days that are solved with the default settings, where the figures need no tight bounds."""


@dataclass(frozen=True, order=True)
class Cell:
    """What one simulation is made with."""

    n_satellites: int
    length_m: float
    phase_sd_mm: float
    any_direction: bool = False
    """Baselines in all directions of the sphere; else level ones."""


@dataclass(frozen=True, order=True)
class Run:
    """How the epochs of a cell are solved."""

    method: str
    n_frequencies: int
    told: bool
    """The solver is told the true noise and length; else it runs with its defaults."""


@dataclass(frozen=True)
class Tally:
    """Counts and sums over epochs; tallies of different epochs add up."""

    draws: float = 0
    candidates: float = 0
    """Epochs with any integers to judge: the receivers could be positioned, and the search found some."""
    right: float = 0
    """Epochs whose integers are all right, accepted or not."""
    stated: float = 0.0
    """Sum of the stated probabilities of that."""
    stated_variance: float = 0.0
    """Variance of `right` if they are true."""
    accepted: float = 0
    wrong: float = 0
    """Accepted with wrong integers."""
    wrong_stated: float = 0.0
    """Sum over the accepted epochs of the stated probability of that."""
    headings: float = 0
    """Accepted with right integers; the rest is over these."""
    heading_square_rad2: float = 0.0
    heading_variance_rad2: float = 0.0
    heading_normalised: float = 0.0
    """Sum of (heading error / stated sigma)^2."""
    heading_inside: float = 0
    """Heading errors within 1.96 stated sigma."""
    nees: float = 0.0
    """Sum of the normalised square errors of the direction, 2 degrees of freedom each."""

    def __add__(self, other):
        return Tally(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))


TALLY_FIELDS = tuple(field.name for field in fields(Tally))


def scenario(cell, day, interval_s, seed):
    """One day of a cell; every day has its own noise, headings and eccentricities of the orbits."""
    rng = np.random.default_rng([seed, *_numbers(cell), day])
    # Uniform on the sphere: the sine of the elevation is uniform.
    elevation = np.arcsin(rng.uniform(-1.0, 1.0)) if cell.any_direction else 0.0
    fore = cell.length_m * np.array([np.cos(elevation), 0.0, -np.sin(elevation)])
    return {
        "name": "success_rates",
        "seed": int(rng.integers(2**31)),
        "duration_s": DAY_S - interval_s,
        "interval_s": interval_s,
        "place": {"latitude_deg": 55.0, "longitude_deg": 15.0, "height_m": 0.0},
        "platform": {
            "antennas": [
                {"name": "aft", "position_body_m": [0.0, 0.0, 0.0]},
                {"name": "fore", "position_body_m": fore.tolist()},
            ]
        },
        "motion": {"kind": "turntable", "rate_dps": 0.1, "heading_deg": float(rng.uniform(0.0, 360.0))},
        "sky": {"kind": "nominal", "systems": "G"},
        "visibility": {"elevation_mask_deg": 2.0},
        "receiver": {
            "signals": {"G": ["1C", "2W", "5Q"]},
            "channels": cell.n_satellites,
            "noise": {"kind": "constant", "code_sd_m": CODE_SD_M, "phase_sd_m": 1e-3 * cell.phase_sd_mm},
            # The same strength everywhere, as the noise.
            "horizon_cn0_dbhz": 50.0,
        },
        "output": {"quantise": False},
    }


def _numbers(cell):
    return (
        cell.n_satellites,
        round(1e3 * cell.length_m),
        round(1e3 * cell.phase_sd_mm),
        int(cell.any_direction),
    )


def solver_settings(cell, run):
    """Every epoch by itself, all satellites; the noise and the length told, or all else left alone."""
    settings = GnssSettings(
        method=run.method,
        bands=BANDS[run.n_frequencies - 1],
        systems="G",
        elevation_mask_deg=0.0,
        single_epoch=True,
        length_m=cell.length_m,
    )
    if not run.told:
        return settings
    noise = StochasticSettings(
        phase_sd_m=1e-3 * cell.phase_sd_mm,
        phase_elevation_sd_m=0.0,
        code_sd_m=CODE_SD_M,
        code_elevation_sd_m=0.0,
        cn0_slope=0.0,
        estimate=False,
    )
    return msgspec.structs.replace(settings, length_sd_m=0.0, stochastic=noise)


@dataclass(frozen=True)
class Day:
    """Epochs of one day at which both receivers track all satellites that the cell asks for.

    Parameters
    ----------
    base, rover : Observations
        Of the two receivers.
    navigation : Navigation
        What the satellites broadcast.
    key, integer_cyc : ndarray
        Epoch, satellite and signal of the rows as one sorted number, and their true single-difference
        integers.
    baseline_enu_m : ndarray, shape (n_epochs, 3)
        True baselines.
    """

    base: truenorth.Observations
    rover: truenorth.Observations
    navigation: truenorth.Navigation
    key: np.ndarray
    integer_cyc: np.ndarray
    baseline_enu_m: np.ndarray


def emulate(cell, day, interval_s, seed):
    """One day of a cell, epochs with fewer satellites left out."""
    simulation = simulate(scenario(cell, day, interval_s, seed))
    complete = np.ones(len(simulation.truth["time_ns"]), bool)
    for observations in simulation.observations.values():
        has_phase = np.isfinite(observations.phase_cyc)
        count = np.bincount(observations.epoch_of_row[has_phase], minlength=len(complete))
        complete &= count == cell.n_satellites * len(BANDS[-1])
    receivers, keys, integers, turns = [], [], [], []
    for name, observations in simulation.observations.items():
        rows = complete[observations.epoch_of_row]
        receivers.append(observations.select_epochs(complete))
        epoch = np.cumsum(complete)[observations.epoch_of_row[rows]] - 1
        keys.append(row_key(epoch, observations.sat[rows], observations.signal[rows]))
        integers.append(simulation.signal_truth[name]["integer_cyc"][rows])
        turns.append(simulation.signal_truth[name]["windup_cyc"][rows])
    # Satellites that only one of the two tracks have no single difference.
    key, at_base, at_rover = np.intersect1d(*keys, assume_unique=True, return_indices=True)
    # Two antennas that lost a satellite may count its wind-up from different whole cycles.
    windup = np.rint(turns[1][at_rover] - turns[0][at_base])
    aft, fore = (simulation.truth[f"antenna_ecef_m:{name}"][complete] for name in simulation.observations)
    latitude, longitude, _ = geodetic_from_ecef(aft)
    to_enu = rot_enu_from_ecef(latitude, longitude)
    return Day(
        *receivers,
        simulation.navigation,
        key,
        integers[1][at_rover] - integers[0][at_base] + windup,
        np.einsum("nij,nj->ni", to_enu, fore - aft),
    )


def row_key(epoch, sat, signal):
    """Epoch, satellite and signal as one number."""
    return epoch.astype(np.int64) * 1_000_000 + sat.astype(np.int64) * 1000 + signal


def integers_are_right(day, solution):
    """Whether all integers of each epoch's best candidate are those of the emulator."""
    found = np.isfinite(solution.residual_integer_cyc)
    epoch, sat, signal, integer = (
        column[found]
        for column in (
            solution.residual_epoch,
            solution.residual_sat,
            solution.residual_signal,
            solution.residual_integer_cyc,
        )
    )
    excess = integer - day.integer_cyc[np.searchsorted(day.key, row_key(epoch, sat, signal))]
    # Right integers differ from the true ones by one constant for each signal: that of the reference.
    _, group = np.unique(epoch.astype(np.int64) * 1000 + signal, return_inverse=True)
    first = np.zeros(group.max(initial=-1) + 1)
    first[group[::-1]] = excess[::-1]
    n_bad = np.bincount(epoch[excess != first[group]], minlength=solution.n_epochs)
    return (np.bincount(epoch, minlength=solution.n_epochs) > 0) & (n_bad == 0)


def score(day, solution):
    """Tally of a solved day."""
    right = integers_are_right(day, solution)
    # No candidate, no claim.
    stated = np.nan_to_num(solution.success_probability)
    accepted = solution.is_accepted
    good = accepted & right
    enu, truth, cov = (
        array[good] for array in (solution.baseline_enu_m, day.baseline_enu_m, solution.cov_enu_m2)
    )
    heading = np.arctan2(enu[:, 0], enu[:, 1]) - np.arctan2(truth[:, 0], truth[:, 1])
    heading = np.angle(np.exp(1j * heading))
    sigma = solution.azimuth_sd_rad[good]
    across = tangent(enu)
    offset = np.einsum("nai,ni->na", across, enu - truth)
    spread = np.einsum("nai,nij,nbj->nab", across, cov, across)
    nees = np.einsum("na,nab,nb->n", offset, np.linalg.inv(spread), offset)
    return Tally(
        draws=len(right),
        candidates=np.isfinite(solution.success_probability).sum(),
        right=right.sum(),
        stated=stated.sum(),
        stated_variance=np.sum(stated * (1.0 - stated)),
        accepted=accepted.sum(),
        wrong=np.sum(accepted & ~right),
        wrong_stated=np.sum(1.0 - stated[accepted]),
        headings=good.sum(),
        heading_square_rad2=np.sum(heading**2),
        heading_variance_rad2=np.sum(sigma**2),
        heading_normalised=np.sum((heading / sigma) ** 2),
        heading_inside=np.sum(np.abs(heading) <= 1.96 * sigma),
        nees=nees.sum(),
    )


def tangent(baseline_enu_m):
    """Two directions across each baseline: clockwise in azimuth, and upward; shape (n, 2, 3)."""
    unit = baseline_enu_m / np.linalg.norm(baseline_enu_m, axis=1, keepdims=True)
    level = np.hypot(unit[:, 0], unit[:, 1])
    clockwise = np.stack([unit[:, 1] / level, -unit[:, 0] / level, np.zeros(len(unit))], axis=-1)
    return np.stack([clockwise, np.cross(clockwise, -unit)], axis=1)


def try_cell(cell, runs, draws, seed, interval_s=60.0):
    """Tallies of a cell: day after day until there are enough epochs.

    Parameters
    ----------
    cell : Cell
        What is simulated.
    runs : sequence of Run
        How it is solved.
    draws : int
        Epochs wanted at least where the noise is told; whole days are taken. The defaults get the first
        `DEFAULT_DAYS`.
    seed : int
        Of the study.
    interval_s : float
        Between the epochs of a day.

    Returns
    -------
    dict of Run to Tally
    """
    tallies = dict.fromkeys(runs, Tally())
    for day in range(MAX_DAYS):
        wanted = [run for run in runs if tallies[run].draws < draws and (run.told or day < DEFAULT_DAYS)]
        if not wanted:
            break
        emulated = emulate(cell, day, interval_s, seed)
        if emulated.base.n_epochs == 0:
            continue
        for run in wanted:
            solution = truenorth.solve_baseline(
                emulated.base, emulated.rover, emulated.navigation, settings=solver_settings(cell, run)
            )
            tallies[run] += score(emulated, solution)
    return tallies
