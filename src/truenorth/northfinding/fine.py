r"""Fine alignment: a filter on the rotation group with biases of gyros and accelerometers.

The attitude is a rotation and its error a small rotation, :math:`\hat C = \exp([\varphi])C`; the model is in
`truenorth.northfinding.fine_model`, the recursions are in `truenorth.northfinding.fine_filter`. What is
measured is that the platform stays about its place: its displacement is zero but for the shaking. That a
velocity is zero would be the weaker statement, because a velocity shakes by the amplitude times the circular
frequency, and neither grows.

The filter runs along a nominal trajectory that a coarse alignment of the same record gives. The start of the
filter takes its tilt to be wrong by up to 0.3 rad and its heading not to be known at all, so that the record
is counted once: the nominal trajectory is a place to linearise at and no information. The filter runs again
along the trajectory that it found itself, until that moves by less than matters; each run begins anew with
what was known before the record, and the last one is the maximum-likelihood estimate of the whole.

Where an innovation is beyond chance, the platform has been moved and has a new place from then on. With
``updates="still"`` the displacement is zero only where the record is still
(`truenorth.northfinding.stillness`); between halts the strapdown runs freely, and each halt has a place of
its own.

References
----------
Groves, P. D., Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed. (2013),
sec. 5.6.3 and 15.2.
Titterton, D. H., Weston, J. L., Strapdown Inertial Navigation Technology, 2nd ed. (2004), ch. 10.
Bar-Itzhack, I. Y., Berman, N., "Control theoretic approach to inertial navigation systems", J. Guidance,
Control, and Dynamics 11 (1988) 237-245 (what is observable at rest).
Bell, B. M., Cathey, F. W., "The iterated Kalman filter update as a Gauss-Newton method", IEEE Transactions on
Automatic Control 38 (1993) 294-297.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..constants import DPH_RADPS, UG_MPS2
from ..errors import ConfigError, NoSolutionError
from ..rotations import exp_so3
from ..sensors.imu import ImuDescription
from ..strapdown import InertialIncrements, compress_increments
from .budget import DEFLECTION_SD_RAD, deflection_sensitivity, heading_sd_on_circle, wrapped_covariance
from .fine_filter import (
    MEASURED,
    MOVED,
    NOTHING,
    PLACED,
    FilterPass,
    attitude_sources,
    filter_errors,
    smooth_attitude,
)
from .fine_model import ErrorModel, Nominal
from .inertial import align_inertial
from .observability import Observability, observe
from .site import Site
from .solution import BudgetLine, ErrorBudget, NorthRun, NorthSolution
from .stillness import detect_stillness

__all__ = ["FineAlignment", "FineHistory", "align_fine", "detect_stillness"]

MOST_PASSES = 8
FEWEST_INTERVALS = 10
TURNED_RAD = 0.1
"""A body that turns by more shows the errors of scale and axes."""
GRAVITY_SD_MPS2 = 3e-4
"""Gravity is known from the place to 30 mGal."""
BURST = 3.0
"""Times the usual variance of 20 intervals that is no chance (1 in 20 000)."""
MOVE = 1e4
"""Times the usual variance that is no shaking any more: the innovations tell when the platform was moved."""
FAR_TOO_LARGE = 10.0
"""Squared innovations so many times too large keep a trajectory from settling."""
PATIENCE = 4
"""A start that was far off needs so many passes before its innovations say anything of the shaking."""
MOVED_SHARE = 0.2
"""A platform whose displacement jumps more often is shaken more than was thought, and not moved."""
SETTLED = 5
"""So many measurements only fill in what is not known at the start, and are no test of it."""
SMALLEST_SHAKING_M = 1e-5
"""No platform stands stiller than this."""
STAYS_RAD = 1e-3
"""A trajectory that moves by less at its end stays: the square of it is a microgravity."""
DRIFTS_RAD = 5e-3
"""The same of the drift over the record by what was found of the gyro biases."""
UNKNOWN_RAD = 0.5
"""A heading that is less certain is none: the nominal one is kept, and the run gives none."""


@dataclass(frozen=True, slots=True, eq=False)
class FineHistory:
    """What the filter had at every edge, and the attitude from all of the record.

    Parameters
    ----------
    time_s : ndarray, shape (k,)
        Edges of the intervals.
    rot_ned_from_body : ndarray, shape (k, 3, 3)
        Attitude from the record up to each edge.
    cov_ned_rad2 : ndarray, shape (k, 3, 3)
        Covariance of its error, without the deflection of the vertical.
    gyro_bias_radps, accel_bias_mps2 : ndarray, shape (k, 3)
        Errors of the axes as estimated by then, body axes.
    nis : ndarray, shape (k,)
        Normalised squared innovation (3 degrees of freedom); NaN where nothing was measured. Beyond 30 the
        platform was taken to have been moved.
    still : ndarray of bool, shape (k,)
        Whether the displacement was measured.
    smooth_rot_ned_from_body, smooth_cov_ned_rad2 : ndarray, shape (k, 3, 3), or None
        Attitude at each edge from all of the record; only if it was asked for.
    """

    time_s: np.ndarray
    rot_ned_from_body: np.ndarray
    cov_ned_rad2: np.ndarray
    gyro_bias_radps: np.ndarray
    accel_bias_mps2: np.ndarray
    nis: np.ndarray
    still: np.ndarray
    smooth_rot_ned_from_body: np.ndarray | None = None
    smooth_cov_ned_rad2: np.ndarray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class FineAlignment(NorthSolution):
    """Attitude of a platform with the errors of the sensor as found by the filter.

    Parameters
    ----------
    gyro_bias_radps, gyro_bias_sd_radps : ndarray, shape (3,)
        Errors of the gyros at the end of the record, body axes, and their standard deviations.
    accel_bias_mps2, accel_bias_sd_mps2 : ndarray, shape (3,)
        The same of the accelerometers.
    displacement_sd_m : ndarray, shape (3,)
        Shaking that was stated or found, north, east, down, in the mean of the record.
    passes : int
        How often the filter ran until the trajectory stayed.
    observability : Observability or None
        What of the states the record tells.
    history : FineHistory or None
        How the estimates grew.
    """

    gyro_bias_radps: np.ndarray = None  # type: ignore[assignment]
    gyro_bias_sd_radps: np.ndarray = None  # type: ignore[assignment]
    accel_bias_mps2: np.ndarray = None  # type: ignore[assignment]
    accel_bias_sd_mps2: np.ndarray = None  # type: ignore[assignment]
    displacement_sd_m: np.ndarray = None  # type: ignore[assignment]
    passes: int = 0
    observability: Observability | None = None
    history: FineHistory | None = None


def align_fine(
    increments: InertialIncrements,
    site: Site,
    *,
    errors: ImuDescription,
    start: NorthSolution | None = None,
    updates: Literal["always", "still"] = "always",
    interval_s: float = 1.0,
    running: bool = True,
    displacement_sd_m: float | None = None,
    gravity_sd_mps2: float = GRAVITY_SD_MPS2,
    deflection_sd_rad: float = DEFLECTION_SD_RAD,
    smooth: bool = False,
) -> FineAlignment:
    """North, roll and pitch with the biases of the sensor, of a platform that stays or moves between halts.

    Parameters
    ----------
    increments : InertialIncrements
        What the unit felt, body axes.
    site : Site
        Where.
    errors : ImuDescription
        Errors of the sensor.
    start : NorthSolution, optional
        Attitude within the record to linearise at; otherwise an inertial-frame alignment finds one.
    updates : {"always", "still"}
        Whether the platform stays about its place throughout, turning or not, or only where the record is
        still.
    interval_s : float
        Length over which increments are summed, seconds.
    running : bool
        Whether to give the estimate after every interval too.
    displacement_sd_m : float, optional
        Standard deviation of the shaking's displacement along each axis; otherwise it is found from the
        record. One that the record belies throughout is not kept to.
    gravity_sd_mps2 : float
        How far gravity may be off the normal one.
    deflection_sd_rad : float
        Of each component of the deflection of the vertical; 0 where north is to be the astronomic one.
    smooth : bool
        Also the attitude at every edge from all of the record.

    Returns
    -------
    FineAlignment
        At the end of the record.

    Raises
    ------
    ConfigError
        If ``updates`` is unknown or no errors are stated.
    NoSolutionError
        If the record is too short or never still.
    """
    if updates not in ("always", "still"):
        raise ConfigError(f"`updates` is {updates!r}; give always or still", key="updates", value=updates)
    if errors is None:
        raise ConfigError("the filter weighs biases and noise; state the sensor's errors", key="errors")
    step_s = float(np.median(np.diff(increments.time_s)))
    samples = max(1, round(interval_s / step_s))
    number = len(increments.angle_rad) // samples
    if number < FEWEST_INTERVALS:
        raise NoSolutionError(
            f"fine alignment got {len(increments.angle_rad) * step_s:.1f} s of data; give at least"
            f" {FEWEST_INTERVALS * samples * step_s:.0f} s"
        )
    record = increments.part(len(increments.angle_rad) - number * samples)
    blocks = compress_increments(record, samples)
    action = _actions(record, errors, samples, updates)
    index, rot = _coarse(blocks, site, action) if start is None else _given(blocks, start)
    turned = _largest_turn(blocks) > TURNED_RAD
    none = np.zeros(3)
    # What acts like a bias needs the level of the platform, which the first intervals give.
    first = ErrorModel(
        blocks, site, errors, gravity_sd_mps2=gravity_sd_mps2, turned=False, level_from_body=rot
    ).nominal(rot, index, none, none)
    model = ErrorModel(
        blocks,
        site,
        errors,
        gravity_sd_mps2=gravity_sd_mps2,
        turned=turned,
        level_from_body=first.rot_ned_from_body[0],
    )
    forward, nominal, passes = _iterate(model, first, action, displacement_sd_m)
    return _solution(
        model,
        forward,
        nominal,
        passes,
        method="fine" if updates == "always" else "strapdown",
        running=running,
        smooth=smooth,
        displacement_sd_m=displacement_sd_m,
        deflection_sd_rad=deflection_sd_rad,
    )


def _actions(record: InertialIncrements, errors: ImuDescription, samples: int, updates: str) -> np.ndarray:
    """What to do at each edge."""
    number = len(record.angle_rad) // samples
    if updates == "always":
        return np.full(number + 1, MEASURED)
    still = np.all(detect_stillness(record, errors=errors).reshape(number, samples), axis=1)
    # An edge is still where the intervals on both sides are.
    edges = np.concatenate([still[:1], still[1:] & still[:-1], still[-1:]])
    action = np.where(edges, MEASURED, NOTHING)
    begins = edges & ~np.concatenate([[True], edges[:-1]])
    action[begins] = PLACED
    if np.count_nonzero(action == MEASURED) < FEWEST_INTERVALS:
        raise NoSolutionError(
            f"the record is still at {np.count_nonzero(edges)} of {number + 1} instants only;"
            f" let the platform rest, or use updates everywhere if it stays about its place"
        )
    return action


def _coarse(blocks: InertialIncrements, site: Site, action: np.ndarray) -> tuple[int, np.ndarray]:
    """Edge and attitude there of a coarse alignment, over the longest halt."""
    moving = np.flatnonzero(action != MEASURED)
    bounds = np.concatenate([[-1], moving, [len(action)]])
    longest = int(np.argmax(np.diff(bounds)))
    # A halt begins with the edge at which its place was taken.
    begin = max(int(bounds[longest]), 0)
    if bounds[longest] >= 0 and action[begin] == NOTHING:
        begin += 1
    end = int(bounds[longest + 1]) - 1
    if end - begin < FEWEST_INTERVALS // 2:
        raise NoSolutionError(
            f"the longest halt lasts {blocks.time_s[end] - blocks.time_s[begin]:.1f} s; let the platform rest"
        )
    assert blocks.position_m is not None  # compressed increments have it
    halt = blocks.part(begin, end)
    interval_s = float(blocks.time_s[1] - blocks.time_s[0])
    return end, align_inertial(halt, site, running=False, interval_s=interval_s).rot_ned_from_body


def _given(blocks: InertialIncrements, start: NorthSolution) -> tuple[int, np.ndarray]:
    """Edge nearest to a given attitude."""
    if not blocks.time_s[0] <= start.time_s <= blocks.time_s[-1]:
        raise ConfigError(
            f"`start` is of instant {start.time_s:g} s, outside of the record from {blocks.time_s[0]:g}"
            f" to {blocks.time_s[-1]:g} s",
            key="start",
            value=start.time_s,
        )
    return int(np.argmin(np.abs(blocks.time_s - start.time_s))), start.rot_ned_from_body


def _largest_turn(blocks: InertialIncrements) -> float:
    """Largest angle between the attitude at the start and any other."""
    turn = exp_so3(blocks.angle_rad)
    rot, least = np.eye(3), 3.0
    for step in turn:
        rot = rot @ step
        least = min(least, rot[0, 0] + rot[1, 1] + rot[2, 2])
    return float(np.arccos(np.clip(0.5 * (least - 1.0), -1.0, 1.0)))


def _shaking(displacement_m: np.ndarray, action: np.ndarray, force_var: float) -> np.ndarray:
    """Variance of the displacement at the edges, about quartic curves over 20 intervals.

    What the velocity random walk makes of it, a variance of the velocity by interval, is taken off. Bursts
    have their own variance; elsewhere it is that of the median window.
    """
    window = 20
    t = np.linspace(-1.0, 1.0, window)
    basis, _ = np.linalg.qr(np.vander(t, 5))
    # Covariance of the integral of a random walk at two instants: s^2 (3 t - s) / 6, s the earlier one.
    early, late = np.minimum(*np.indices((window, window))), np.maximum(*np.indices((window, window)))
    walked = early**2 * (3.0 * late - early) / 6.0
    of_noise = force_var * np.trace(walked - basis @ (basis.T @ walked)) / (window - 5)
    runs = np.split(np.arange(len(action)), np.flatnonzero(action != MEASURED))
    edges = [
        run[begin : begin + window] for run in runs for begin in range(1, len(run) - window + 1, window // 4)
    ]
    if not edges:
        return np.full((len(action), 3), 1e-6)
    found = np.empty((len(edges), 3))
    for k, rows in enumerate(displacement_m[np.array(edges)]):
        found[k] = np.sum((rows - basis @ (basis.T @ rows)) ** 2, axis=0) / (window - 5)
    # The median of chi-square of 15 degrees of freedom is 0.956 of its mean.
    usual = np.median(found, axis=0) / 0.956
    seen = np.tile(usual, (len(action), 1))
    for rows, variance in zip(edges, found, strict=True):
        burst = (variance > BURST * usual) & (variance < MOVE * usual)
        seen[rows] = np.maximum(seen[rows], np.where(burst, variance, 0.0))
    return np.maximum(np.maximum(seen - of_noise, 0.1 * usual), SMALLEST_SHAKING_M**2)


def _iterate(
    model: ErrorModel, nominal: Nominal, action: np.ndarray, displacement_sd_m: float | None
) -> tuple[FilterPass, Nominal, int]:
    """Filter along the trajectory that the filter finds, until it stays."""
    force_var = model.process_cov[0][3, 3] * model.interval_s**2
    factor = 1.0
    gyro, accel = model.slices["gyro bias"], model.slices["accelerometer bias"]
    last = len(action) - 1
    for passes in range(1, MOST_PASSES + 1):
        if displacement_sd_m is None:
            shaking = factor * _shaking(nominal.displacement_m, action, force_var)
        else:
            shaking = np.full((len(action), 3), factor * max(displacement_sd_m, SMALLEST_SHAKING_M) ** 2)
        forward = filter_errors(model, nominal, action, shaking)
        state = _states_of_known_heading(forward)[-1]
        excess, chance = _excess(forward, action)
        # What was stated is doubted only where the platform would jump all the time.
        inflate = excess > (chance if displacement_sd_m is None else FAR_TOO_LARGE)
        small = np.maximum(STAYS_RAD, 0.1 * np.sqrt(forward.var[-1, :3]))
        drifts = float(np.max(np.abs(state[gyro]))) * model.duration_s
        stays = bool(np.all(np.abs(state[:3]) < small)) and drifts < DRIFTS_RAD
        if (stays and not inflate) or passes == MOST_PASSES:
            break
        if inflate and (stays or (excess > FAR_TOO_LARGE and passes >= PATIENCE)):
            # Slower than the curves, or larger at times: what is unexplained is laid to the shaking.
            factor *= min(excess**1.5, 1000.0)
        nominal = model.nominal(
            exp_so3(-state[:3]) @ nominal.rot_ned_from_body[last],
            last,
            nominal.gyro_bias_radps + state[gyro],
            nominal.accel_bias_mps2 + state[accel],
        )
    return forward, nominal, passes


def _excess(forward: FilterPass, action: np.ndarray) -> tuple[float, float]:
    """Squared innovations as a multiple of what they should be, and what multiple chance may give."""
    asked = forward.nis[SETTLED:][action[SETTLED:] == MEASURED]
    taken = asked[asked <= MOVED]
    if len(taken) < (1.0 - MOVED_SHARE) * len(asked):
        # More than a platform is moved: 2.37 is the median of chi-square of 3 degrees of freedom.
        return max(float(np.median(asked)) / 2.37, 2.0 * FAR_TOO_LARGE), 1.0
    return float(np.mean(taken)) / 3.0, 1.0 + 5.0 * float(np.sqrt(2.0 / (3.0 * len(taken))))


def _states_of_known_heading(forward: FilterPass) -> np.ndarray:
    """Estimated errors at the edges, given the nominal heading where the record hardly tells another one.

    A heading error of radians would be no small rotation, and would spoil the tilts that are known.
    """
    heading_var = forward.attitude_cov[:, 2, 2]
    pinned = np.where(heading_var > UNKNOWN_RAD**2, forward.state[:, 2] / heading_var, 0.0)
    return forward.state - forward.attitude_cov[:, 2] * pinned[:, None]


def _solution(
    model: ErrorModel,
    forward: FilterPass,
    nominal: Nominal,
    passes: int,
    *,
    method: str,
    running: bool,
    smooth: bool,
    displacement_sd_m: float | None,
    deflection_sd_rad: float,
) -> FineAlignment:
    """What is returned."""
    time_s, site = model.blocks.time_s, model.site
    states = _states_of_known_heading(forward)
    rots = exp_so3(-states[:, :3]) @ nominal.rot_ned_from_body
    covs = forward.attitude_cov[:, :, :3]
    by_deflection = deflection_sensitivity(site)
    deflection = deflection_sd_rad**2 * by_deflection @ by_deflection.T
    gyro = states @ model.gyro_sum.T + nominal.gyro_bias_radps
    accel = states @ model.accel_sum.T + nominal.accel_bias_mps2
    gyro_sd, accel_sd = (
        np.sqrt(np.diag(rows @ forward.cov @ rows.T)) for rows in (model.gyro_sum, model.accel_sum)
    )
    nis, rot = forward.nis, rots[-1]
    smoothed: tuple[np.ndarray | None, np.ndarray | None] = (None, None)
    if smooth:
        error, cov = smooth_attitude(model, forward)
        smoothed = exp_so3(-error) @ nominal.rot_ned_from_body, cov
    observability = observe(model, forward, rot)
    shaking_sd = np.sqrt(np.mean(forward.displacement_var, axis=0))
    measured = {
        **{f"gyro_bias_{axis}_dph": float(gyro[-1, k] / DPH_RADPS) for k, axis in enumerate("xyz")},
        **{f"gyro_bias_{axis}_sd_dph": float(gyro_sd[k] / DPH_RADPS) for k, axis in enumerate("xyz")},
        **{f"accel_bias_{axis}_ug": float(accel[-1, k] / UG_MPS2) for k, axis in enumerate("xyz")},
        **{f"accel_bias_{axis}_sd_ug": float(accel_sd[k] / UG_MPS2) for k, axis in enumerate("xyz")},
        "displacement_sd_m": float(np.sqrt(np.mean(forward.displacement_var))),
        "nis_mean": _mean_nis(forward),
        "moved_instants": float(np.count_nonzero(nis > MOVED)),
        "still_share": float(np.mean(forward.action != NOTHING)),
        "passes": float(passes),
    }
    return FineAlignment(
        method=method,
        site=site,
        time_s=float(time_s[-1]),
        duration_s=model.duration_s,
        rot_ned_from_body=rot,
        cov_ned_rad2=wrapped_covariance(rot, covs[-1] + deflection),
        measured=measured,
        run=_run(time_s, rots, covs + deflection) if running else None,
        budget=_budget(model, forward, rot, deflection, deflection_sd_rad),
        notes=_notes(model, forward, passes, displacement_sd_m),
        gyro_bias_radps=gyro[-1],
        gyro_bias_sd_radps=gyro_sd,
        accel_bias_mps2=accel[-1],
        accel_bias_sd_mps2=accel_sd,
        displacement_sd_m=shaking_sd,
        passes=passes,
        observability=observability,
        history=FineHistory(
            time_s, rots, covs, gyro, accel, nis, forward.action != NOTHING, smoothed[0], smoothed[1]
        ),
    )


def _mean_nis(forward: FilterPass) -> float:
    """Mean normalised squared innovation of the displacements that were taken."""
    taken = forward.nis[SETTLED:][forward.action[SETTLED:] == MEASURED]
    return float(np.mean(taken)) if len(taken) else float("nan")


def _run(time_s: np.ndarray, rots: np.ndarray, covs: np.ndarray) -> NorthRun:
    """The estimate as it grew; nothing while the heading is hardly known."""
    run = NorthRun.of_attitudes(time_s, rots, covs)
    run.angles_rad[run.sd_rad[:, 0] > UNKNOWN_RAD] = np.nan
    run.sd_rad[:, 0] = heading_sd_on_circle(run.sd_rad[:, 0])
    return run


def _budget(
    model: ErrorModel, forward: FilterPass, rot: np.ndarray, deflection: np.ndarray, deflection_sd_rad: float
) -> ErrorBudget:
    """Where the error of the final attitude comes from, by the filter's own gains."""
    covs = attitude_sources(model, forward)
    stated = {source.name: source.stated for source in model.sources}
    stated["shaking"] = f"{1e3 * np.sqrt(np.mean(forward.displacement_var)):.2g} mm"
    lines = [BudgetLine(name, stated[name], cov) for name, cov in covs.items()]
    if deflection_sd_rad > 0.0:
        arcsec = 3600.0 * np.degrees(deflection_sd_rad)
        lines.append(BudgetLine("deflection of the vertical", f"{arcsec:.3g} arcsec (assumed)", deflection))
    budget = ErrorBudget(tuple(lines), rot)
    lines.sort(key=lambda line: -budget.angle_sd_rad(line)[0])
    return ErrorBudget(tuple(lines), rot)


def _notes(
    model: ErrorModel, forward: FilterPass, passes: int, displacement_sd_m: float | None
) -> tuple[str, ...]:
    """Sentences for the user."""
    notes = []
    if passes == MOST_PASSES:
        notes.append(
            f"After {passes} runs of the filter its trajectory, or the size of the shaking, had not settled."
        )
    moved = int(np.count_nonzero(forward.action == NOTHING))
    if moved:
        share = f"{moved} of {len(forward.action)} instants"
        notes.append(f"The platform moved at {share}; the strapdown ran freely there.")
    jumps = model.blocks.time_s[forward.nis > MOVED]
    if len(jumps):
        first = ", ".join(f"{instant:.0f}" for instant in jumps[:5])
        more = ", ..." if len(jumps) > 5 else ""
        notes.append(f"The platform was moved at {first}{more} s; it was given a new place there.")
    taken = float(np.sqrt(np.mean(forward.displacement_var)))
    if displacement_sd_m is not None and taken > 1.5 * max(displacement_sd_m, SMALLEST_SHAKING_M):
        notes.append(
            f"The platform is shaken by more than the {1e3 * displacement_sd_m:.2g} mm stated;"
            f" {1e3 * taken:.2g} mm were taken."
        )
    return tuple(notes)
