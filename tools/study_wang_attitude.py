"""Attitude and reliability of Wang & Lachapelle 2002 on the emulator, beside their figures.

    python tools/study_wang_attitude.py --out docs/validation/wang_2002_attitude.md

Three experiments: a vector with wrong integers and the angles that find it (``wang-angles``), the vehicle
with four receivers by least squares and by the filter, with and without 80 slips (``wang-vehicle``), and the
minivan with two systems of different quality side by side (``wang-minivan``). What is right is told by the
true integers and the true attitude. Everything follows from the seed.
"""

import argparse
import itertools
import platform
import sys
import textwrap
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
import study_wang as earlier

import truenorth
from truenorth.attitude import attitude_from_baselines, solve_array
from truenorth.attitude.adjustment import free_of_length
from truenorth.attitude.array_vectors import ArrayVectors
from truenorth.attitude.filter import AttitudeFilterSettings, FilterStatus, filter_attitude
from truenorth.attitude.geometry_checks import GeometryCheckSettings, check_geometry
from truenorth.attitude.reliability import ReliabilitySettings, attitude_reliability, filter_reliability
from truenorth.attitude.vector_methods import attitude_from_vectors
from truenorth.attitude.vectors import shared_reference_covariance
from truenorth.config import ArraySettings, GnssSettings
from truenorth.errors import Status
from truenorth.observations import sat_name
from truenorth.simulation import simulate
from truenorth.timescales import NS_PER_S

WAVELENGTH_M = 299_792_458.0 / 1575.42e6
PUBLISHED_ANGLES = ((2.1, 0.3, -0.2), (2.8, 3.4, 3.3))
"""Mean and rms errors of heading, pitch and roll after the exclusion, arc minutes."""
PUBLISHED_VEHICLE = {"LS 10 Hz": (3.9, 11.8, 9.9), "KF 10 Hz": (3.9, 9.8, 7.9), "KF 1 Hz": (31.9, 11.8, 9.0)}
"""Table 2, rms, arc minutes."""
PUBLISHED_RESIDUALS_MM = {"Beeline": (5, 5, 5), "CMC": (17, 12, 15)}
"""Table 3, double differences of the three vectors."""
PUBLISHED_DIFFERENCES_DEG = ((0.94, 2.26, 2.17), (4.56, 8.64, 9.44))
"""Table 4, Beeline less CMC: rms and largest."""

TOLERANCE_DEG = 5.0
WRONG_DEG = 10.0
"""An attitude with an angle off by more is wrong whatever its integers are: far beyond five standard
deviations of any epoch with right ones, less than the 13.6 degrees by which a wrong integer turns at
least."""

LOST_S, RETURN_S = 332, 452
"""Seconds from the start between which the vector is made wrong."""

UNGATED = AttitudeFilterSettings(gate=False)
GATED = AttitudeFilterSettings()
NED_FROM_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
GRADES = {"Beeline": 0.0029, "CMC": 0.0095}
"""Multipath of a phase, metres; with the thermal noise 3.5 and 9.7 mm."""


class Errors(NamedTuple):
    """Errors of attitudes: how many epochs of how many, and their mean, rms and largest, arc minutes."""

    epochs: int
    total: int
    mean: np.ndarray
    rms: np.ndarray
    largest: np.ndarray
    wrong: int


def angle_errors(session, time_ns, angles, reference):
    """Angles less the truth at the instant of reception, shape (n, 3), degrees.

    Parameters
    ----------
    session : Simulation
    time_ns : ndarray of int64, shape (n,)
        Time tags of the reference receiver.
    angles : sequence of ndarray
        Heading, pitch, roll; radians.
    reference : str
        Name of that receiver.
    """
    time_s = (time_ns - session.scenario.start_ns) / NS_PER_S
    grid_s = (session.truth["time_ns"] - session.scenario.start_ns) / NS_PER_S
    clock_s = session.truth[f"clock_offset_s:{reference}"][np.searchsorted(grid_s, time_s - 1e-6)]
    truth = session.trajectory.at(time_s - clock_s)
    true = (truth.heading_rad, truth.pitch_rad, truth.roll_rad)
    error = np.stack([a - b for a, b in zip(angles, true, strict=True)], axis=1)
    return np.degrees((error + np.pi) % (2.0 * np.pi) - np.pi)


def summary(error_deg, n_epochs):
    """`Errors` of attitudes that were given out; NaN where none was."""
    given = np.isfinite(error_deg).all(1)
    error = 60.0 * error_deg[given]
    if not given.any():
        none = np.full(3, np.nan)
        return Errors(0, n_epochs, none, none, none, 0)
    wrong = int(np.count_nonzero(np.abs(error).max(1) > 60.0 * WRONG_DEG))
    size = np.abs(error)
    return Errors(len(error), n_epochs, error.mean(0), np.sqrt(np.mean(error**2, 0)), size.max(0), wrong)


def solve(session, names, *, every=1, array=None, **settings):
    """Solve some antennas of a session, the first of them the reference."""
    body = {antenna.name: antenna.position_body_m for antenna in session.scenario.platform.antennas}
    return solve_array(
        [session.observations[name].select_epochs(slice(None, None, every)) for name in names],
        np.array([body[name] for name in names]) - np.array(body[names[0]]),
        session.navigation, names=names, systems="G", bands=("L1",),
        elevation_mask_deg=session.scenario.solve.elevation_mask_deg, keep_residuals=True,
        array=array or ArraySettings(), **settings,
    )  # fmt: skip


def solution_errors(session, solution):
    """Errors of a solution; NaN where it accepted nothing."""
    angles = (solution.heading_rad, solution.pitch_rad, solution.roll_rad)
    error = angle_errors(session, solution.time_ns, angles, solution.antennas[0])
    error[solution.status < Status.HELD] = np.nan
    return error


def filter_errors(session, filtered, reference):
    """Errors of filtered attitudes; NaN where there is none."""
    angles = (filtered.heading_rad, filtered.pitch_rad, filtered.roll_rad)
    error = angle_errors(session, filtered.time_ns, angles, reference)
    error[filtered.status == FilterStatus.NONE] = np.nan
    return error


def has_wrong_integers(solution, signal_truth):
    """Epochs whose integers, as double differences between any antennas, are not all true.

    The integers of a joint solution are known up to a constant of each satellite and of each antenna: less
    the true cycles they must be such a sum, which is followed from row to row.
    """
    found = solution.residuals
    sats = np.unique(found.sat)
    off = np.full((solution.n_epochs, len(solution.antennas), len(sats)), np.nan)
    for k, name in enumerate(solution.antennas):
        here = np.flatnonzero(found.antenna == k)
        true = earlier.true_cycles(
            signal_truth[name], solution.time_ns[found.epoch[here]], found.sat[here].astype(np.int64)
        )
        column = np.searchsorted(sats, found.sat[here])
        off[found.epoch[here], k, column] = found.integer_cyc[here] - true
    filled = np.where(np.isnan(off), 1e9, off).reshape(solution.n_epochs, -1)
    patterns, which = np.unique(filled, axis=0, return_inverse=True)
    wrong = np.array([not is_two_way_sum(pattern.reshape(off.shape[1:])) for pattern in patterns])
    return wrong[which.ravel()]


def is_two_way_sum(table):
    """Whether a table is a sum of one number for its row and one for its column; 1e9 where it is empty."""
    rows, columns = np.nonzero(table < 1e8)
    of_row, of_column = {}, {}
    cells = list(zip(rows.tolist(), columns.tolist(), strict=True))
    while cells:
        left = []
        for row, column in cells:
            value = table[row, column]
            if row in of_row and column in of_column:
                if abs(value - of_row[row] - of_column[column]) > 0.1:
                    return False
            elif row in of_row:
                of_column[column] = value - of_row[row]
            elif column in of_column:
                of_row[row] = value - of_column[column]
            else:
                left.append((row, column))
        if len(left) == len(cells):
            # A part that hangs together with nothing known.
            of_row[left[0][0]] = 0.0
        cells = left
    return True


# ---------------------------------------------------------------------------------------------------- angles


def wrong_shift(baseline, epoch, length_m, skip):
    """Integers of one baseline's satellites that turn it and leave its length right, and the satellites.

    Three of the satellites are shifted by any integers that keep the length within 2 cm, the others follow by
    rounding; of these the shift with the smallest residuals, as a search after a restart might accept it.

    Parameters
    ----------
    baseline : BaselineSolution
    epoch : int
    length_m : float
    skip : int
        Satellite that is lost.

    Returns
    -------
    dict of int to int
        Cycles by satellite, 0 for the first.
    """
    rows = np.flatnonzero((baseline.residual_epoch == epoch) & (baseline.residual_sat != skip))
    rows = rows[np.argsort(-baseline.residual_elevation_rad[rows])]
    design = double_difference_design(baseline, rows)
    vector = baseline.baseline_enu_m[epoch]
    reach = int(np.ceil(2.1 * length_m / WAVELENGTH_M))
    triples = np.array(list(itertools.product(range(-reach, reach + 1), repeat=3)), float)
    shift = WAVELENGTH_M * triples @ np.linalg.inv(design[:3]).T
    good = np.abs(np.linalg.norm(vector + shift, axis=1) - length_m) < 0.02
    good &= np.any(triples != 0.0, axis=1)
    triples, shift = triples[good], shift[good]
    cycles = np.hstack([triples, np.rint(shift @ design[3:].T / WAVELENGTH_M)])
    # Double differences share the reference satellite.
    weight = np.eye(len(design)) - 1.0 / (len(design) + 1.0)
    project = np.linalg.solve(design.T @ weight @ design, design.T @ weight)
    turned = WAVELENGTH_M * cycles @ project.T
    left = WAVELENGTH_M * cycles - turned @ design.T
    square = np.einsum("ni,ij,nj->n", left, weight, left)
    square[np.abs(np.linalg.norm(vector + turned, axis=1) - length_m) > 0.02] = np.inf
    best = cycles[np.argmin(square)].astype(int)
    return {int(sat): int(n) for sat, n in zip(baseline.residual_sat[rows], [0, *best], strict=True)}


def double_difference_design(baseline, rows):
    """Derivative of double differences to east, north, up; the first row's satellite is the reference."""
    azimuth, elevation = baseline.residual_azimuth_rad[rows], baseline.residual_elevation_rad[rows]
    level = np.cos(elevation)
    rays = np.stack([level * np.sin(azimuth), level * np.cos(azimuth), np.sin(elevation)], axis=1)
    return -(rays[1:] - rays[0])


def with_wrong_integers(baseline, cycles, epochs):
    """The baseline with its integers shifted in some epochs."""
    vector = baseline.baseline_enu_m.copy()
    for epoch in epochs:
        rows = np.flatnonzero(baseline.residual_epoch == epoch)
        rows = rows[np.isin(baseline.residual_sat[rows], list(cycles))]
        rows = rows[np.argsort([cycles[int(s)] != 0 for s in baseline.residual_sat[rows]], kind="stable")]
        n = np.array([cycles[int(sat)] for sat in baseline.residual_sat[rows]], float)
        design = double_difference_design(baseline, rows)
        weight = np.eye(len(design)) - 1.0 / (len(design) + 1.0)
        project = np.linalg.solve(design.T @ weight @ design, design.T @ weight)
        vector[epoch] += project @ (WAVELENGTH_M * (n[1:] - n[0]))
    return replace(baseline, baseline_enu_m=vector)


def angles_experiment(seed, duration_s=600.0, *, joint=True):
    """The lost satellite as it comes, then a wrong vector put in its place.

    Returns
    -------
    dict of str to dict
        By case: whole, inside (the errors of all epochs, and of those between the loss and the return),
        excluded (those of the latter without the vector), others (epochs without another one) and more.
    """
    session = simulate("wang-angles", {"seed": seed, "duration_s": duration_s})
    names = list(session.observations)
    at = names.index("right")
    inside = slice(LOST_S, min(RETURN_S, session.scenario.n_epochs))
    found = {}

    def enter(case, solution, **more):
        error = solution_errors(session, solution)
        found[case] = {
            "whole": summary(error, len(error)),
            "inside": summary(error[inside], inside.stop - inside.start),
            "excluded": int(np.sum(solution.is_excluded[inside, at])),
            "others": int(np.count_nonzero(np.delete(solution.is_excluded, at, axis=1))),
            **more,
        }

    array = ArraySettings(resolution="baselines", method="implicit")
    solution = solve(session, names, array=array, method="lsast")
    false = [
        earlier.wrong_integers(b, session.signal_truth[names[0]], session.signal_truth[n])[b.is_accepted]
        for b, n in zip(solution.baselines, names[1:], strict=True)
    ]
    wrong_vectors = sum(int(np.sum(f > 0)) for f in false)
    common = {"names": names, "settings": GnssSettings(method="lsast")}

    def adjust(baselines, tolerance_deg):
        array = ArraySettings(resolution="baselines", method="implicit", angle_tolerance_deg=tolerance_deg)
        return attitude_from_baselines(
            baselines, solution.positions_body_m, solution.time_ns, array=array, **common
        )

    modes = {"5 degrees": TOLERANCE_DEG, "default": None}
    for name, tolerance in modes.items():
        enter(f"as it comes, {name}", adjust(solution.baselines, tolerance), wrong_vectors=wrong_vectors)
    lost = 7
    right = solution.baselines[at - 1]
    cycles = wrong_shift(right, inside.start, 1.0, lost)
    wrong = with_wrong_integers(right, cycles, range(inside.start, inside.stop))
    turn = turn_between_deg(right.baseline_enu_m[inside.start], wrong.baseline_enu_m[inside.start])
    baselines = [*solution.baselines[: at - 1], wrong, *solution.baselines[at:]]
    for name, tolerance in modes.items():
        enter(f"wrong vector, {name}", adjust(baselines, tolerance))
    vectors = all_vectors(baselines, solution)
    fit = attitude_from_vectors(vectors, "implicit")
    error = angle_errors(session, fit.time_ns, (fit.heading_rad, fit.pitch_rad, fit.roll_rad), names[0])
    found["wrong vector, unchecked"] = {
        "whole": summary(error, len(error)),
        "inside": summary(error[inside], inside.stop - inside.start),
        "excluded": 0,
        "others": 0,
    }
    length_m = np.linalg.norm(wrong.baseline_enu_m[inside], axis=1)
    found["shift"] = {
        "cycles": cycles, "turn_deg": turn, "length_mm": 1e3 * (np.nanmean(length_m) - 1.0),
        "epochs": int(np.sum(wrong.is_accepted[inside])),
    }  # fmt: skip
    if joint:
        solution = solve(session, names)
        enter("as it comes, joint", solution,
              wrong_vectors=int(np.sum(has_wrong_integers(solution, session.signal_truth))))  # fmt: skip
        # The same integers as slips of all phases of the receiver at once, none of them flagged.
        faults = [msgspec.to_builtins(fault) for fault in session.scenario.faults]
        faults += [
            {"kind": "slip", "antenna": "right", "time_s": float(LOST_S), "satellite": sat_name(sat)}
            | {"cycles": n}
            for sat, n in cycles.items()
            if n
        ]  # fmt: skip
        slipped = simulate(
            "wang-angles", {"seed": seed, "duration_s": min(duration_s, RETURN_S + 28.0), "faults": faults}
        )
        solution = solve(slipped, names)
        false = has_wrong_integers(solution, slipped.signal_truth)
        enter("slipped, joint", solution, wrong_vectors=int(np.sum(false)))
        out = np.flatnonzero(solution.is_excluded[:, at])
        found["slipped, joint"]["out_epochs"] = len(out)
    return found


def turn_between_deg(u, v):
    """Angle between two vectors."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v)))


def all_vectors(baselines, solution, length_sd_m=0.003):
    """All accepted baselines of a solution as vectors, none checked against another.

    A baseline from too few satellites, uncertain by a fifth of its length, is left out as the solver does.
    """
    time_ns, body_m = solution.time_ns, solution.positions_body_m
    n, m = len(time_ns), len(body_m)
    vector, cov = np.full((n, m, 3), np.nan), np.full((n, 3 * m, 3 * m), np.nan)
    each, known = np.full((n, m - 1, 3, 3), np.nan), np.zeros((n, m - 1), bool)
    for k, baseline in enumerate(baselines):
        rows = np.flatnonzero(baseline.is_accepted)
        enu_m, cov_m2 = free_of_length(baseline, rows)
        good = np.isfinite(cov_m2).all((1, 2))
        largest = np.linalg.eigvalsh(np.where(good[:, None, None], cov_m2, np.eye(3)))[:, 2]
        good &= largest < (0.2 * np.linalg.norm(body_m[k + 1] - body_m[0])) ** 2
        at = np.searchsorted(time_ns, baseline.time_ns[rows[good]])
        vector[at, k + 1] = enu_m[good] @ NED_FROM_ENU.T
        each[at, k], known[at, k] = NED_FROM_ENU @ cov_m2[good] @ NED_FROM_ENU.T, True
    joint = shared_reference_covariance(np.where(known[:, :, None, None], each, np.eye(3)))
    wide = np.repeat(known, 3, axis=1)
    cov[:, 3:, 3:] = np.where(wide[:, :, None] & wide[:, None, :], joint, np.nan)
    reference = np.where(known.any(1), 0, -1)
    body_cov_m2 = 0.5 * length_sd_m**2 * np.eye(3 * m)
    return ArrayVectors(time_ns, reference, vector, cov, body_m, body_cov_m2, solution.antennas)


# --------------------------------------------------------------------------------------------------- vehicle


def every_nth(vectors, n):
    """Vectors of every n-th epoch."""
    part = slice(None, None, n)
    return replace(
        vectors, time_ns=vectors.time_ns[part], reference=vectors.reference[part],
        vector_ned_m=vectors.vector_ned_m[part], cov_ned_m2=vectors.cov_ned_m2[part],
    )  # fmt: skip


def wang_filter(step_dps, *, gate):
    """The filter as printed: the same step of the rates at every epoch."""
    return AttitudeFilterSettings(process="wang", rate_step_dps=(step_dps,) * 3, gate=gate)


VEHICLE_FILTERS = {
    "KF 10 Hz, as printed: 2 °/s an epoch": (1, wang_filter(2.0, gate=False)),
    "KF 10 Hz, default": (1, GATED),
    "smoother 10 Hz, default": (1, AttitudeFilterSettings(direction="smoother")),
    "KF 1 Hz, as printed: 2 °/s an epoch": (10, wang_filter(2.0, gate=False)),
    "KF 1 Hz, as printed: 2 °/s an epoch, gated": (10, wang_filter(2.0, gate=True)),
    "KF 1 Hz, as printed but tight: 0.1 °/s an epoch": (10, wang_filter(0.1, gate=False)),
    "KF 1 Hz, as printed but tight: 0.05 °/s an epoch": (10, wang_filter(0.05, gate=False)),
    "KF 1 Hz, default": (10, GATED),
    "smoother 1 Hz, default": (10, AttitudeFilterSettings(direction="smoother")),
}
"""Every how manyth epoch of 10 Hz, and the settings."""


def vehicle_experiment(seed, duration_s=1200.0, filters=VEHICLE_FILTERS):
    """Errors without slips, by method; without multipath, as in the hardware simulator."""
    session = simulate("wang-vehicle", {"seed": seed, "duration_s": duration_s, "slips.count": 0})
    names = list(session.observations)
    found = {}
    solution = solve(session, names)
    false = np.count_nonzero(has_wrong_integers(solution, session.signal_truth))
    found["LS 10 Hz, joint"] = summary(solution_errors(session, solution), solution.n_epochs)
    implicit = attitude_from_vectors(solution.vectors, "implicit")
    angles = (implicit.heading_rad, implicit.pitch_rad, implicit.roll_rad)
    error = angle_errors(session, implicit.time_ns, angles, names[0])
    found["LS 10 Hz, implicit least squares"] = summary(error, solution.n_epochs)
    restarts = {}
    for name, (every, settings) in filters.items():
        vectors = every_nth(solution.vectors, every)
        filtered = filter_attitude(vectors, settings)
        found[name] = summary(filter_errors(session, filtered, names[0]), vectors.n_epochs)
        restarts[name] = sum(event.kind in ("restart", "widened") for event in filtered.events)
    return found, restarts, int(false)


class JointSlips(NamedTuple):
    """What became of slips under the joint engine.

    Detected: at that epoch the log says slip, outlier or release of that phase, or leaves out its antenna.
    Harmless: not detected, and no accepted epoch of the next 30 s has a wrong integer. Missed: the others.
    ``false`` are phases released without a slip, ``struck`` single phases left out of an epoch without one.
    """

    slips: int
    detected: int
    harmless: int
    missed: int
    false: int
    struck: int
    sat_hours: float
    epochs: int
    accepted: int
    wrong: int
    squares: np.ndarray
    near: np.ndarray
    n_near: int
    largest: np.ndarray
    filtered: np.ndarray
    rejected: int


def joint_slip_run(seed, rate_hz, overrides=(), duration_s=1200.0, stochastic=None):
    """Solve the vehicle with its slips jointly and count what became of them."""
    session = simulate("wang-vehicle", {"seed": seed, "duration_s": duration_s, **dict(overrides)})
    scenario = session.scenario
    every = round(1.0 / (rate_hz * scenario.interval_s))
    names = list(session.observations)
    more = {} if stochastic is None else {"stochastic": stochastic}
    solution = solve(session, names, every=every, **more)
    step_ns = every * scenario.interval_ns
    slipped = {}
    for time_ns, antenna, sat, _, cycles in session.slips:
        at = scenario.start_ns - (scenario.start_ns - time_ns) // step_ns * step_ns
        slipped[at, antenna, sat] = slipped.get((at, antenna, sat), 0) + cycles
    slipped = [key for key, cycles in slipped.items() if cycles]
    broken, struck, out = set(), set(), set()
    for event in solution.events:
        antenna = next((name for name in names if f" at {name} " in event.text), "")
        key = (event.time_ns, antenna, event.satellite)
        if event.kind in ("slip", "released") and event.satellite:
            broken.add(key)
        elif event.kind == "outlier":
            struck.add(key)
        elif event.kind == "excluded":
            out.add((event.time_ns, event.text.partition(" contradicts")[0]))
        elif event.kind == "released":
            out.add((event.time_ns, ""))
    expected = {(at, antenna, sat_name(sat)) for at, antenna, sat in slipped}
    false = has_wrong_integers(solution, session.signal_truth)
    detected = harmless = 0
    for key in expected:
        if key in broken | struck or (key[0], key[1]) in out or (key[0], "") in out:
            detected += 1
            continue
        soon = (solution.time_ns >= key[0]) & (solution.time_ns < key[0] + 30 * NS_PER_S)
        harmless += not np.any(false[soon] & solution.is_accepted[soon])
    error = 60.0 * solution_errors(session, solution)
    since = np.array([at for at, _, _ in slipped], dtype=np.int64) - solution.time_ns[:, None]
    near = np.any((since <= 0) & (since > -NS_PER_S), axis=1) & np.isfinite(error).all(1)
    filtered = filter_attitude(solution.vectors, GATED)
    smooth = 60.0 * filter_errors(session, filtered, names[0])
    # After a slip the phase is out until its new integer has repeated.
    after = {(e, a, s) for at, a, s in expected for e in range(at, at + 10 * step_ns, step_ns)}
    return JointSlips(
        slips=len(slipped), detected=detected, harmless=harmless, missed=len(slipped) - detected - harmless,
        false=len(broken - after), struck=len(struck - after - broken),
        sat_hours=len(solution.residuals.sat) / rate_hz / 3600.0, epochs=solution.n_epochs,
        accepted=int(solution.is_accepted.sum()), wrong=int(np.sum(false & solution.is_accepted)),
        squares=np.nansum(error**2, axis=0), near=np.sum(error[near] ** 2, axis=0), n_near=int(near.sum()),
        largest=np.nanmax(np.abs(error), axis=0), filtered=np.nanmean(smooth**2, axis=0) * solution.n_epochs,
        rejected=int(filtered.is_rejected.any(1).sum()),
    )  # fmt: skip


def total(runs):
    """Counts of several runs."""
    return JointSlips(
        **{
            field: max(np.stack([getattr(run, field) for run in runs]).tolist(), key=max)
            if field == "largest"
            else sum(getattr(run, field) for run in runs)
            for field in JointSlips._fields
        }
    )


# --------------------------------------------------------------------------------------------------- minivan


def minivan_session(seed, duration_s):
    """Two arrays of the same shape on one vehicle, the antennas of the second 0.2 m behind the first's."""
    shape = {"primary": (0, 0), "front": (2, 0), "front_right": (2, 1), "right": (0, 1)}
    antennas = []
    for grade, sd_m in GRADES.items():
        for name, (x, y) in shape.items():
            back = 0.0 if grade == "Beeline" else -0.2
            multipath = {"phase_sd_m": sd_m, "code_sd_m": 1.0, "tau_s": 60.0, "tau_moving_s": 4.0}
            antennas.append(
                {
                    "name": f"{grade}-{name}",
                    "position_body_m": [x + back, float(y), 0.0],
                    "receiver": {"multipath": {"gauss_markov": multipath}},
                }
            )
    return simulate("wang-minivan", {"seed": seed, "duration_s": duration_s, "platform.antennas": antennas})


class Stage(NamedTuple):
    """One processing stage of one system: errors in degrees by epoch (NaN: no attitude), false integers."""

    time_ns: np.ndarray
    error_deg: np.ndarray
    false: np.ndarray
    angles_rad: np.ndarray


def minivan_stages(session, grade):
    """All stages of one system; the first four with baselines resolved one by one as published.

    These are told the noise that is simulated; the joint engine finds its own, and is told it as well.
    """
    names = [name for name in session.observations if name.startswith(grade)]
    noise = earlier.declared(float(np.hypot(GRADES[grade], earlier.thermal_sd_m(2))), 1.1, 4.0)
    stages = {}

    def enter(name, fit, error, false):
        angles = np.stack([fit.heading_rad, fit.pitch_rad, fit.roll_rad], axis=1)
        stages[name] = Stage(fit.time_ns, error, false, np.where(np.isfinite(error), angles, np.nan))

    array = ArraySettings(resolution="baselines")
    solution = solve(session, names, array=array, method="lsast", stochastic=noise)
    vectors = all_vectors(solution.baselines, solution)
    wrong = np.zeros((solution.n_epochs, len(names)), bool)
    for k, baseline in enumerate(solution.baselines):
        false = earlier.wrong_integers(
            baseline, session.signal_truth[names[0]], session.signal_truth[names[k + 1]]
        )
        wrong[np.searchsorted(solution.time_ns, baseline.time_ns), k + 1] = false > 0
    fit = attitude_from_vectors(vectors, "implicit")
    angles = (fit.heading_rad, fit.pitch_rad, fit.roll_rad)
    enter(
        "LS", fit, angle_errors(session, fit.time_ns, angles, names[0]), (wrong & vectors.is_present).any(1)
    )
    checks = check_geometry(vectors, GeometryCheckSettings(angle_tolerance_deg=TOLERANCE_DEG))
    filters = {
        "KF": (UNGATED, None), "KF + QC": (GATED, None), "KF + QC + angles": (GATED, checks.is_trusted),
    }  # fmt: skip
    for name, (settings, is_used) in filters.items():
        filtered = filter_attitude(vectors, settings, is_used=is_used)
        error = filter_errors(session, filtered, names[0])
        enter(name, filtered, error, (wrong & filtered.is_used).any(1))
    shares, levels = {}, {}
    for name, more in (("joint", {}), ("joint, noise declared", {"stochastic": noise})):
        joint = solve(session, names, **more)
        levels[name] = joint.level, joint.inputs.get("variance_factors", {})
        false = has_wrong_integers(joint, session.signal_truth)
        enter(name, joint, solution_errors(session, joint), false)
        filtered = filter_attitude(joint.vectors, GATED)
        error = filter_errors(session, filtered, names[0])
        enter(f"{name} + KF + QC", filtered, error, false & filtered.is_used.any(1))
        shares |= reliability_shares(name, joint, filtered, stages)
    return stages, {
        "residuals_mm": [1e3 * residual_rms_m(baseline) for baseline in solution.baselines],
        "wrong_vectors": float(wrong[vectors.is_present].mean()), "reliability": shares, "levels": levels,
        "few": [float(np.mean(baseline.n_sats <= 5)) for baseline in solution.baselines],
    }  # fmt: skip


def residual_rms_m(baseline):
    """Root mean square of the double-difference phase residuals of accepted epochs."""
    rows = np.flatnonzero(np.isfinite(baseline.residual_m) & baseline.is_accepted[baseline.residual_epoch])
    epoch = baseline.residual_epoch[rows]
    reference = np.full(baseline.n_epochs, np.nan)
    is_reference = baseline.residual_is_reference[rows]
    reference[epoch[is_reference]] = baseline.residual_m[rows][is_reference]
    double = (baseline.residual_m[rows] - reference[epoch])[~is_reference]
    return float(np.sqrt(np.nanmean(double**2)))


def reliability_shares(name, joint, filtered, stages):
    """External reliability of a joint solution and of its filter beside the true errors; see `_shares`."""
    settings = ReliabilitySettings()
    alone = attitude_reliability(joint.vectors, joint.rot_ned_from_body, settings=settings)
    rot = filtered.predicted_rot
    cov = rot @ filtered.predicted_cov[:, :3, :3] @ np.swapaxes(rot, 1, 2)
    both = filter_reliability(joint.vectors, rot, cov, settings=settings, is_used=filtered.is_used)
    return {
        name: _shares(alone, stages[name].error_deg),
        f"{name} + KF + QC": _shares(both, stages[f"{name} + KF + QC"].error_deg),
    }


def _shares(reliability, error_deg):
    """How often errors stay within the external effect plus k sigma, and within the protection level."""
    effect, sd = np.degrees(reliability.external_rad), np.degrees(reliability.sd_rad)
    known = np.isfinite(effect).all(1) & np.isfinite(sd).all(1) & np.isfinite(error_deg).all(1)
    size, effect, sd = np.abs(error_deg[known]), effect[known], sd[known]
    passed = reliability.is_passed[known]
    beyond = (size > np.degrees(reliability.protection_rad[known]))[passed].any(1)
    return {
        "epochs": int(known.sum()),
        "effect_deg": np.median(effect, axis=0),
        "sd_deg": np.median(sd, axis=0),
        "within": [100.0 * np.mean(size <= effect + k * sd, axis=0) for k in (0.0, 1.0, 3.0)],
        "passed": 100.0 * float(np.mean(passed)),
        "beyond": (int(np.sum(beyond)), int(np.sum(passed))),
        "level_deg": np.median(np.degrees(reliability.protection_rad[known][passed]), axis=0),
    }


def differences_deg(first, second):
    """Angles of one system less those of the other where both have them, degrees, shape (k, 3)."""
    _, a, b = np.intersect1d(first.time_ns, second.time_ns, return_indices=True)
    difference = np.degrees((first.angles_rad[a] - second.angles_rad[b] + np.pi) % (2.0 * np.pi) - np.pi)
    return difference[np.isfinite(difference).all(1)]


# ------------------------------------------------------------------------------------------------------ page


SLIP_RUNS = {
    "simulator, 10 Hz": (10, (), 2),
    "simulator, 1 Hz": (1, (), 2),
    "multipath of 9.5 mm, 10 Hz": (10, earlier.MINIVAN, 1),
    "multipath of 9.5 mm, no slips, 10 Hz": (10, (*earlier.MINIVAN, ("slips.count", 0)), 1),
}
"""By case: rate, what is laid over the scenario, runs of 80 slips by the joint engine."""

BASELINE_RUNS = {"simulator, 10 Hz": ((), 1), "multipath of 9.5 mm, 10 Hz": (earlier.MINIVAN, 1)}
"""The same baseline by baseline with the method ``filter``."""


def minivan_experiment(seed, duration_s, grade):
    """All stages of one system; the other one is simulated with it."""
    return minivan_stages(minivan_session(seed, duration_s), grade)


def study(seed, vehicle_s, minivan_s, jobs=1):
    """All experiments."""
    tasks = {("minivan", grade): (minivan_experiment, (seed, minivan_s, grade)) for grade in GRADES}
    tasks["vehicle"] = vehicle_experiment, (seed, vehicle_s)
    tasks["angles"] = angles_experiment, (seed,)
    for case, (rate, overrides, n) in SLIP_RUNS.items():
        for k in range(n):
            tasks["slips", case, k] = joint_slip_run, (seed + k, rate, overrides, vehicle_s)
    for case, (overrides, n) in BASELINE_RUNS.items():
        for k in range(n):
            tasks["baselines", case, k] = (
                earlier.slip_run,
                (seed + k, 10, "filter", overrides, None, vehicle_s),
            )
    if jobs == 1:
        done = {key: function(*arguments) for key, (function, arguments) in tasks.items()}
    else:
        with ProcessPoolExecutor(jobs) as pool:
            waiting = {key: pool.submit(function, *arguments) for key, (function, arguments) in tasks.items()}
            done = {key: future.result() for key, future in waiting.items()}
    return {
        "angles": done["angles"],
        "vehicle": done["vehicle"],
        "slips": {c: total([done["slips", c, k] for k in range(SLIP_RUNS[c][2])]) for c in SLIP_RUNS},
        "baselines": {
            c: earlier.total([done["baselines", c, k] for k in range(BASELINE_RUNS[c][1])])
            for c in BASELINE_RUNS
        },
        "minivan": {grade: done["minivan", grade] for grade in GRADES},
    }


def three(values, digits=1):
    """Three numbers with strokes between them."""
    return " / ".join(f"{value:.{digits}f}" for value in values)


def paragraph(text):
    """One paragraph of the page, wrapped, and the empty line after it."""
    return [*textwrap.wrap(" ".join(text.split()), 110, break_long_words=False, break_on_hyphens=False), ""]


def angles_part(found):
    """The wrong vector."""
    shift = found["shift"]
    mean, rms = PUBLISHED_ANGLES
    lines = [
        "## A vector with wrong integers",
        "",
        *paragraph(f"""`wang-angles`: four antennas, three arms of 1 m at right angles, at rest, 1 Hz, 600 s,
            one satellite lost at the antenna `right` for three seconds (and three more until its phase is
            back). Published: the restart of that vector gave wrong integers of the right length, which the
            angles to the other two found and excluded. In this sky seven satellites are left, and no method
            takes a wrong vector for it. So one is put in its place: from second {LOST_S} to {RETURN_S} the
            integers of the vector to `right` are shifted to those of the best wrong candidate whose length is
            right, which turns it by {shift["turn_deg"]:.1f}° and changes its length by
            {shift["length_mm"]:+.0f} mm; {shift["epochs"]} epochs have that vector. The joint search looks at
            all antennas at once, where such a vector cannot come up; its phases of `right` are made to slip
            by the same integers instead, all at once and none of them flagged."""),
        "| case | epochs with attitude | vector excluded | another excluded | mean, whole run, ′ | "
        "rms, whole run, ′ | rms, wrong vector, ′ | largest, ′ |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
        f"| published, after exclusion | – | – | – | {three(mean)} | {three(rms)} | – | – |",
    ]
    words = {
        "as it comes, 5 degrees": "as it comes, `lsast`, angles within 5°",
        "as it comes, default": "as it comes, `lsast`, default tests",
        "as it comes, joint": "as it comes, joint",
        "wrong vector, unchecked": "wrong vector, no check",
        "wrong vector, 5 degrees": "wrong vector, angles within 5°",
        "wrong vector, default": "wrong vector, default tests",
        "slipped, joint": "all phases slip, joint",
    }
    for case, name in words.items():
        one = found[case]
        whole, inside = one["whole"], one["inside"]
        lines.append(
            f"| {name} | {whole.epochs} of {whole.total} | {one['excluded']} of {inside.total} | "
            f"{one['others']} | {three(whole.mean)} | {three(whole.rms)} | {three(inside.rms)} | "
            f"{three(whole.largest)} |"
        )
    natural = {case: found[case]["wrong_vectors"] for case in words if "wrong_vectors" in found[case]}
    return [
        *lines,
        "",
        *paragraph(f"""Heading / pitch / roll. Epochs with an integer that is not true, of those accepted:
            {sum(natural.values())} in all runs that are not forced, the joint one with the slips among them.
            After these slips the joint engine leaves the antenna out for
            {found["slipped, joint"]["out_epochs"]} epochs, then it takes part again with true integers."""),
    ]


def vehicle_part(found, restarts, false, vehicle_s):
    """Table 2."""
    lines = [
        "## Vehicle: least squares and filter",
        "",
        *paragraph(f"""`wang-vehicle` without slips: a rectangle of 2 m by 1 m, {
            vehicle_s
            / 60.0:.0f} minutes at 10 Hz, turns of up to 20°/s, no multipath. The integers are those of the
            joint engine, {false} epochs with a false one. The printed filter adds the same variance to the
            rates at every epoch, so what suits 10 Hz is ten times too tight at 1 Hz; ours adds it per
            second. Ungated unless said. Errors at the epochs of the rate; heading / pitch / roll."""),
        "| method | rms, ′ | largest, ′ | new starts |",
        "| --- | ---: | ---: | ---: |",
    ]
    lines += [
        f"| published, {name} | {three(values)} | – | – |" for name, values in PUBLISHED_VEHICLE.items()
    ]
    lines += [
        f"| {name} | {three(one.rms)} | {three(one.largest)} | {restarts.get(name, '–')} |"
        for name, one in found.items()
    ]
    least, kalman = found["LS 10 Hz, joint"].rms, found["KF 10 Hz, as printed: 2 °/s an epoch"].rms
    ours = ", ".join(f"{ratio:.2f}" for ratio in kalman / least)
    theirs = ", ".join(
        f"{a / b:.2f}"
        for a, b in zip(PUBLISHED_VEHICLE["KF 10 Hz"], PUBLISHED_VEHICLE["LS 10 Hz"], strict=True)
    )
    return [
        *lines,
        "",
        *paragraph(f"""Filter over least squares at 10 Hz: {ours}; published {theirs}. Their layout and noise
            are lost, so the angles themselves are not to be compared closely."""),
    ]


def slips_part(joint, baselines, vehicle_s):
    """80 slips."""
    lines = [
        "## Vehicle: 80 slips",
        "",
        *paragraph(f"""Runs of {vehicle_s / 60.0:.0f} minutes with 80 unflagged slips of 1 to 8
            cycles each at random instants, receivers and satellites. Detected: the log of that epoch names
            the phase (slip, outlier, release) or its antenna. Harmless: not named, and no accepted epoch of
            the next 30 s has a false integer. Missed: not named and with such an epoch. False: phases
            released without a slip; left out: single phases left out of an epoch without one, at a limit of
            four standard deviations. Wrong: accepted epochs with a false double-difference integer.
            Published: 79 of 80 detected or recovered before the filter, which removed the last."""),
        "| case | slips | detected | harmless | missed | false | left out | satellite-hours | accepted, % | "
        "wrong epochs | rms, ′ | rms within 1 s of a slip, ′ | after KF + QC, ′ | largest, ′ |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for case, one in joint.items():
        near = three(np.sqrt(one.near / one.n_near)) if one.n_near else "–"
        lines.append(
            f"| {case} | {one.slips} | {one.detected} | {one.harmless} | {one.missed} | {one.false} | "
            f"{one.struck} | {one.sat_hours:.1f} | {100.0 * one.accepted / one.epochs:.2f} | {one.wrong} | "
            f"{three(np.sqrt(one.squares / one.accepted))} | {near} | "
            f"{three(np.sqrt(one.filtered / one.epochs))} | {three(one.largest)} |"
        )
    lines += [
        "",
        *paragraph("""Baseline by baseline for comparison (`filter`, which carries integers; more cases stand
            in [wang_2002](wang_2002.md)). Wrong are accepted baselines:"""),
        "| case | slips | detected | absorbed | missed | false | accepted, % | wrong, % | rms, ′ |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for case, one in baselines.items():
        squares, n = one.squares
        lines.append(
            f"| {case} | {one.slips} | {one.detected} | {one.absorbed} | {one.missed} | {one.false} | "
            f"{100.0 * one.accepted / one.epochs:.2f} | {100.0 * one.wrong / one.accepted:.2f} | "
            f"{three(np.sqrt(squares / n))} |"
        )
    return [
        *lines,
        "",
        *paragraph("""The largest pitch of the joint engine with slips and multipath is no matter of integers,
            which are true in all accepted epochs: where slips have left one antenna two held phases and
            another one, two attitudes fit them, and the wrong one of the two stood for about a second."""),
    ]


def minivan_part(found, minivan_s):
    """Two systems side by side."""
    lines = [
        "## Minivan: two systems",
        "",
        *paragraph(f"""`wang-minivan`, {minivan_s:.0f} s at 10 Hz through suburban streets, the last of them
            under trees: two
            arrays of 2 m by 1 m on one vehicle, the second 0.2 m behind the first. Beeline has
            {1e3 * GRADES["Beeline"]:.1f} mm of multipath with a memory of 4 s on the move, CMC
            {1e3 * GRADES["CMC"]:.1f} mm, both 1.9 mm of thermal noise. LS, KF, QC and angles as
            published: `lsast` for every vector with the ratio 3 and one epoch, implicit least squares;
            filter without and with tests of its innovations; angles within {TOLERANCE_DEG:.0f}°. These are
            told the noise. Joint is the package's default, which finds the noise itself, or is told it.
            Wrong attitude: an angle off by more than {WRONG_DEG:.0f}°; false integers: epochs that gave an
            attitude and took a vector with a false integer. Errors are those of all attitudes given out, the
            wrong ones among them."""),
        "| system | stage | availability, % | wrong attitude, % of given | false integers, % of given | "
        "rms, ° | largest, ° |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for grade, (stages, _) in found.items():
        for name, stage in stages.items():
            one = summary(stage.error_deg, len(stage.error_deg))
            given = np.isfinite(stage.error_deg).all(1)
            false = int(np.sum(stage.false & given))
            lines.append(
                f"| {grade} | {name} | {100.0 * one.epochs / one.total:.2f} | "
                f"{100.0 * one.wrong / max(one.epochs, 1):.2f} | {100.0 * false / max(one.epochs, 1):.2f} | "
                f"{three(one.rms / 60.0, 2)} | {three(one.largest / 60.0, 1)} |"
            )
    lines += ["", "Root mean square of the double-difference residuals of the three vectors (table 3):", ""]
    lines += [
        "| system | published, mm | ours, mm | false of the accepted vectors, % | 5 satellites or fewer, % |",
        "| --- | ---: | ---: | ---: | ---: |",
    ]
    for grade, (_, more) in found.items():
        lines.append(
            f"| {grade} | {three(PUBLISHED_RESIDUALS_MM[grade], 0)} | {three(more['residuals_mm'])} | "
            f"{100.0 * more['wrong_vectors']:.2f} | {100.0 * max(more['few']):.1f} |"
        )
    rms, largest = PUBLISHED_DIFFERENCES_DEG
    lines += [
        "",
        *paragraph("""Beeline less CMC, where both have an attitude (table 4; the published mean of the
            heading, 0.68°, is taken for the mounting):"""),
        "| stage | epochs | mean, ° | rms, ° | largest, ° |",
        "| --- | ---: | ---: | ---: | ---: |",
        f"| published | – | 0.68 / – / – | {three(rms, 2)} | {three(largest, 2)} |",
    ]
    stages = {grade: one[0] for grade, one in found.items()}
    for name in stages["CMC"]:
        off = differences_deg(stages["Beeline"][name], stages["CMC"][name])
        lines.append(
            f"| {name} | {len(off)} | {three(off.mean(0), 2)} | {three(np.sqrt(np.mean(off**2, 0)), 2)} | "
            f"{three(np.abs(off).max(0), 2)} |"
        )
    lines += [
        "",
        *paragraph("""External reliability: the largest effect on an angle of an error of one component of one
            vector that the tests find with a power of 0.8 (false alarm 0.001). Share of epochs whose true
            error stays within it, and within it and three standard deviations; all epochs with right
            integers. The protection level holds for epochs that pass all tests, at a risk of 1e-5:"""),
        "| system | stage | epochs | sigma, ° | external, ° | within, % | within + 3 sigma, % | "
        "pass the tests, % | protection level, ° | beyond it |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for grade, (_, more) in found.items():
        for name, one in more["reliability"].items():
            beyond, passed = one["beyond"]
            lines.append(
                f"| {grade} | {name} | {one['epochs']} | {three(one['sd_deg'], 2)} | "
                f"{three(one['effect_deg'], 2)} | {three(one['within'][0], 2)} | "
                f"{three(one['within'][2], 2)} | {one['passed']:.1f} | {three(one['level_deg'], 2)} | "
                f"{beyond} of {passed} |"
            )
    return [
        *lines,
        "",
        *paragraph("""Multipath lasts for many epochs of 10 Hz. The filter takes errors of successive epochs
            for independent, so its sigma, its external reliability and its protection level are too small on
            such data; least squares forgets."""),
    ]


def page(found, seed, vehicle_s, minivan_s):
    """Markdown of the study."""
    versions = (
        f"truenorth {truenorth.__version__}, NumPy {np.__version__}, Python {platform.python_version()}"
    )
    lines = [
        "# Attitude and reliability of Wang and Lachapelle 2002",
        "",
        f"Made by `python tools/study_wang_attitude.py --seed {seed} --vehicle {vehicle_s:.0f} "
        f"--minivan {minivan_s:.0f} --out docs/validation/wang_2002_attitude.md`",
        f"on {date.today()}: {versions}.",
        "",
        *paragraph("""C. Wang, G. Lachapelle, *GPS attitude determination reliability performance improvement
            using low cost receivers*, Journal of Global Positioning Systems 1 (2002), section on angles
            (figures 4 to 6), table 2 and figures 9 to 11, tables 3 and 4 and figures 13 to 18. Their layout,
            sky and noise are not given; the scenarios say what is assumed. Right is what has the true
            integers and the true attitude."""),
        *angles_part(found["angles"]),
        *vehicle_part(*found["vehicle"], vehicle_s),
        *slips_part(found["slips"], found["baselines"], vehicle_s),
        *minivan_part(found["minivan"], minivan_s),
    ]
    return "\n".join(lines).rstrip() + "\n"


def main():
    """Make the page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, default=2002)
    parser.add_argument("--vehicle", type=float, default=600.0, help="seconds of the vehicle (default 600)")
    parser.add_argument("--minivan", type=float, default=175.0, help="seconds of the minivan (default 175)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (default 1)")
    parser.add_argument("--out", type=Path, help="the page; without it it is printed only")
    options = parser.parse_args()
    found = study(options.seed, options.vehicle, options.minivan, options.jobs)
    text = page(found, options.seed, options.vehicle, options.minivan)
    if options.out is None:
        sys.stdout.write(text)
    else:
        options.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
