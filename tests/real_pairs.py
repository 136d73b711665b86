"""The real two-antenna sets: files, truth, integers.

Used by the regression tests and by ``tools/make_real_data_tables.py``. Truth is as published with each set
(``truenorth.datasets``). Observations are read once per process.
"""

import csv
import functools
import gzip
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import truenorth as tn
from truenorth.constants import SPEED_OF_LIGHT_MPS
from truenorth.observations import frequency_hz, sat_id, signal_id


@dataclass(frozen=True)
class Pair:
    """Two antennas: folder, files, and what is known of their baseline."""

    folder: str
    base: str
    rover: str
    navigation: tuple[str, ...]
    length_m: float | None = None
    length_sd_m: float = 0.003
    truth_enu_m: tuple[float, float, float] | None = None


PAIRS = {
    "geodetic": Pair(
        "pair_1m_geodetic", "base.obs.gz", "rover.obs.gz", ("base.nav.gz",),
        0.990, 0.003, (-0.2232, -0.9647, 0.0096),
    ),
    "ublox": Pair(
        "pair_0.33m_ublox", "base.obs.gz", "rover.obs.gz", ("rover.nav.gz",),
        0.3296, 0.003, (-0.2367, 0.2292, 0.0013),
    ),
    # The logs hold their own ephemerides.
    "ublox_ubx": Pair(
        "pair_0.33m_ublox", "base.ubx.gz", "rover.ubx.gz", (),
        0.3296, 0.003, (-0.2367, 0.2292, 0.0013),
    ),
    "long": Pair(
        "pair_38m_gps", "UPC10770.11o.gz", "UPC20770.11o.gz", ("brdc0770.11n",),
        37.946, 0.005, (-27.417, -26.234, -0.030),
    ),
    "rose": Pair(
        "moving_simulator_rose", "Base-static_MO_Spirent.obs.gz", "Rover-dynamic_MO_Spirent.obs.gz",
        ("RINEX_GN_Spirent.23N.gz", "RINEX_EN_Spirent.23L.gz"),
    ),
    "two_kilometres": Pair(
        "moving_simulator_rose", "Base-static_MO_Spirent.obs.gz", "Rover-static-2km-east_MO_Spirent.obs.gz",
        ("RINEX_GN_Spirent.23N.gz", "RINEX_EN_Spirent.23L.gz"),
    ),
}  # fmt: skip

SIMULATOR_BASE_ECEF_M = (4157177.06580187, 671230.476590636, 4774767.03105544)
SIMULATOR_2KM_ECEF_M = (4156857.1195929, 673209.028774142, 4774767.03105544)


@functools.cache
def read_receiver(path):
    """Observations of one file."""
    return tn.read_observations(path)


@functools.cache
def load(data_dir, name):
    """Observations of base and rover, and the navigation data."""
    pair = PAIRS[name]
    folder = Path(data_dir) / pair.folder
    base, rover = folder / pair.base, folder / pair.rover
    navigation = [folder / file for file in pair.navigation] or [base, rover]
    return read_receiver(base), read_receiver(rover), tn.read_navigation(*navigation)


@functools.cache
def solve(data_dir, name, *, length=True, swap=False, **settings):
    """Solution of a pair: every epoch alone and with its known length, unless said otherwise."""
    pair = PAIRS[name]
    settings.setdefault("single_epoch", True)
    if length and pair.length_m is not None:
        settings.setdefault("length_m", pair.length_m)
        settings.setdefault("length_sd_m", pair.length_sd_m)
    base, rover, navigation = load(data_dir, name)
    if swap:
        base, rover = rover, base
    return tn.solve_baseline(base, rover, navigation, **settings)


def distance_to_truth_m(solution, name):
    """Distance of each epoch's baseline from the published one; NaN where there is none."""
    return np.linalg.norm(solution.baseline_enu_m - PAIRS[name].truth_enu_m, axis=1)


def angle_deg(angle_rad):
    """Circular mean and scatter of angles, degrees; the mean in [0, 360)."""
    mean = np.arctan2(np.mean(np.sin(angle_rad)), np.mean(np.cos(angle_rad)))
    off = np.mod(angle_rad - mean + np.pi, 2.0 * np.pi) - np.pi
    return np.degrees(mean) % 360.0, np.degrees(np.sqrt(np.mean(off**2)))


def _row_key(solution):
    """One number for the epoch, satellite and signal of each phase."""
    seconds = np.rint(solution.time_ns[solution.residual_epoch] / 1e9).astype(np.int64)
    return (seconds * 1000 + solution.residual_sat) * 1000 + solution.residual_signal


def integers_of(reference, solution):
    """Integers that a reference solution has for the phases of another; NaN where it has none."""
    keys = _row_key(reference)
    order = np.argsort(keys)
    wanted = _row_key(solution)
    at = order[np.clip(np.searchsorted(keys, wanted, sorter=order), 0, len(keys) - 1)]
    return np.where(keys[at] == wanted, reference.residual_integer_cyc[at], np.nan)


def has_right_integers(solution, truth_cyc):
    """Epochs whose best candidate, accepted or not, has the true integers at all its phases.

    Double differences against any satellite agree when integers and truth differ by one constant per
    signal and system. Epochs without a candidate, or with a phase of unknown truth, are not right.
    """
    off = solution.residual_integer_cyc - truth_cyc
    group = solution.residual_signal.astype(np.int64) * 10 + solution.residual_sat // 100
    key = solution.residual_epoch.astype(np.int64) * 100_000 + group
    order = np.argsort(key, kind="stable")
    start = np.flatnonzero(np.r_[True, np.diff(key[order]) != 0])
    spread = np.maximum.reduceat(off[order], start) - np.minimum.reduceat(off[order], start)
    right = np.zeros(solution.n_epochs, bool)
    right[solution.residual_epoch] = True
    right[solution.residual_epoch[order][start[~(spread < 0.5)]]] = False
    return right


# The long pair's published integers: satellite, N1, N2 against PRN06, UPC2 minus UPC1.
LONG_PAIR_REFERENCE = "G06"
LONG_PAIR_SIGNALS = (("1C", "1W"), ("2W", "2W"))
"""Tracking code of the phase (L1, L2 of RINEX 2) and of the code (P1, P2) it was aligned with."""


@functools.cache
def published_integers(data_dir):
    """The file ``N1N2.dat``: {satellite: (N1, N2)}."""
    table = np.loadtxt(Path(data_dir) / PAIRS["long"].folder / "N1N2.dat", dtype=int)
    return {f"G{prn:02d}": (int(n1), int(n2)) for prn, n1, n2 in table}


@functools.cache
def alignment_cycles(data_dir):
    """Whole cycles that the published integers have taken off the raw double differences.

    The teaching data's phases were aligned with their codes before differencing: each receiver's phase of
    each satellite was moved by trunc(phase - code) cycles of the first epoch, L1 with P1 and L2 with P2.

    Returns
    -------
    dict
        {satellite: (cycles of L1, cycles of L2)}, double differences UPC2 - UPC1 against PRN06.
    """
    base, rover, _ = load(data_dir, "long")

    def taken_off(observations, sat, phase, code):
        first = slice(0, observations.epoch_start[1])
        sat, phase, code = sat_id(sat), signal_id(phase), signal_id(code)
        row = {
            int(signal): k
            for k, signal in enumerate(observations.signal[first])
            if observations.sat[k] == sat
        }
        wavelength_m = SPEED_OF_LIGHT_MPS / float(frequency_hz(sat, phase))
        code_cyc = observations.code_m[row[code]] / wavelength_m
        return int(np.trunc(observations.phase_cyc[row[phase]] - code_cyc))

    def difference(sat, *signals):
        of_rover, of_base = (
            taken_off(receiver, sat, *signals) - taken_off(receiver, LONG_PAIR_REFERENCE, *signals)
            for receiver in (rover, base)
        )
        return of_rover - of_base

    return {
        sat: tuple(difference(sat, *signals) for signals in LONG_PAIR_SIGNALS)
        for sat in published_integers(data_dir)
    }


def long_pair_integers(data_dir, solution):
    """Published integers, as raw ones, for each phase of a solution of the long pair."""
    truth = {(sat_id(LONG_PAIR_REFERENCE), signal_id(phase)): 0 for phase, _ in LONG_PAIR_SIGNALS}
    aligned = alignment_cycles(data_dir)
    for sat, numbers in published_integers(data_dir).items():
        for k, (phase, _) in enumerate(LONG_PAIR_SIGNALS):
            truth[sat_id(sat), signal_id(phase)] = numbers[k] + aligned[sat][k]
    pairs = zip(solution.residual_sat.tolist(), solution.residual_signal.tolist(), strict=True)
    return np.array([truth.get(pair, np.nan) for pair in pairs])


@functools.cache
def simulator_truth(data_dir):
    """Seconds of the run, position and velocity of the simulator's moving rover, 10 Hz.

    Returns
    -------
    ndarray, shape (n, 7)
        Time of the run (s), ECEF position (m), ECEF velocity (m/s).
    """
    path = Path(data_dir) / PAIRS["rose"].folder / "Rover-dynamic_PVA_Spirent.csv.gz"
    with gzip.open(path, "rt") as stream:
        rows = list(csv.reader(stream))[1:]
    return np.array([[row[0], *row[4:10]] for row in rows], dtype=float)


def simulator_error(solution, truth):
    """Error of the baseline, true velocity and true baseline, each (n, 3), in the Earth's axes."""
    seconds = (solution.time_ns - solution.time_ns[0]) / 1e9
    row = np.searchsorted(truth[:, 0], seconds - 1e-6)
    np.testing.assert_allclose(truth[row, 0], seconds, atol=1e-6)
    baseline = truth[row, 1:4] - SIMULATOR_BASE_ECEF_M
    return solution.baseline_ecef_m - baseline, truth[row, 4:7], baseline


def regress_on_motion(error, velocity, baseline):
    """Time-tag error (s) and scale of the baseline, each with its sigma, beside a constant offset.

    Errors of neighbouring epochs are alike, so sigmas come from leaving out a minute at a time.
    """
    offset = np.broadcast_to(np.eye(3), (len(error), 3, 3))
    design = np.concatenate([velocity[..., None], baseline[..., None], offset], axis=-1)

    def solve_for(keep):
        return np.linalg.lstsq(design[keep].reshape(-1, 5), error[keep].ravel(), rcond=None)[0]

    every = solve_for(slice(None))
    blocks = np.array_split(np.arange(len(error)), 10)
    without = np.array([solve_for(np.setdiff1d(np.arange(len(error)), block)) for block in blocks])
    sigma = np.sqrt((len(blocks) - 1) * np.var(without, axis=0))
    return (every[0], sigma[0]), (every[1], sigma[1])
