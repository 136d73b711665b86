r"""North from a unit that is turned on a table, which tells its biases from the rate of the Earth.

The Earth rate and gravity keep their directions in the Earth, the biases of the sensors theirs in the body. A
turn of the body separates them: with the same unit at two headings half a turn apart, half the sum of the two
readings of an axis is its bias, half the difference what it feels of the Earth; any number of positions, or
a steady turn (carousel), does the same. What remains is the noise, what the bias does between the halts, and
what the turn brings in: its scale error where the gyros measure it.

All of them are one least-squares problem (`truenorth.northfinding.positions_model`), in which the attitude
and the biases are estimated together from the velocities of each halt, or of the whole record on a carousel.
The platform may sway; where it stands still, the gyros are held against the Earth rate directly too.

References
----------
Titterton, D. H., Weston, J. L., Strapdown Inertial Navigation Technology, 2nd ed. (2004), ch. 10.
Lee, J. G., Park, C. G., Park, H. W., "Multiposition alignment of strapdown inertial navigation system", IEEE
Trans. Aerospace and Electronic Systems 29 (1993) 1323-1328.
Renkoski, B. M., The effect of carouseling on MEMS IMU performance for gyrocompassing applications, M.Sc.
thesis, MIT (2008).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..constants import STANDARD_GRAVITY_MPS2
from ..errors import ConfigError, NoSolutionError
from ..rotations import exp_so3, heading_pitch_roll, log_so3, rot_ned_from_body
from ..sensors.imu import ImuDescription
from ..strapdown import InertialIncrements, accumulate_turns, compress_increments
from .budget import DEFLECTION_SD_RAD, deflection_sensitivity, wrapped_covariance
from .positions_errors import gyro_noise_kernel
from .positions_model import Estimate, Model, estimate, model_of, sway_mps
from .positions_record import Noise, TableRecord
from .site import Site
from .solution import BudgetLine, ErrorBudget, NorthRun, NorthSolution, angle_deviations

__all__ = ["align_carousel", "align_positions", "find_halts", "positions_budget", "turning_plan"]

BLOCKS = 400
"""At most as many blocks a record becomes, from within which the noise of the gyros is followed."""

SPANS = 100
"""About as many spans of blocks are looked at; shorter ones hold nothing more of a slow Earth."""

HALT_S = 5.0
"""A halt lasts at least as long."""

TURNING_RADPS = float(np.radians(0.5))
"""A mean rate over a second by which a platform turns rather than sways."""

LITTLE_TURN_RAD = float(np.radians(20.0))
"""Where no two halts are further apart, the bias is hardly told from the Earth rate."""

AXIS_RAD = float(np.radians(3.0))
"""A turn whose axis is further off is not about the stated one."""

TURN_MATCH_RAD = float(np.radians(3.0))
"""A turn that differs by more from what the table says is another one."""

ENCODER_SD_RAD = float(np.radians(5.0 / 3600.0))
"""Noise of the table's angles that is assumed."""

WOBBLE_SD_RAD = float(np.radians(5.0 / 3600.0))
"""Wobble of the axis of a carousel that is assumed."""

LEVER_ARM_SD_M = 0.1
"""How far from the axis of a carousel a unit is assumed to stand."""

PER_TURN = 12
"""Blocks in a turn of a carousel; the sensors' axes turn by 30 degrees in one."""

MOST_BLOCKS = 400
"""What takes a few seconds to solve."""

LEAST_PER_TURN = 8
"""Blocks in a turn where there are too many turns for more."""

TURN_MATCH_SHARE = 0.02
"""And of a carousel: no gyro has such a scale error."""

LOST_DEG = 30.0
"""Drift of a gyro on a carousel beyond which its turns cannot be followed without an encoder."""

SHAKEN = 4.0
"""Angles within a halt that wander by as much more than the gyro's noise makes them: the platform moves."""

MISFIT = 1.3
"""Residuals that are larger by more than stated widen sigma."""


def find_halts(increments: InertialIncrements) -> list[tuple[float, float]]:
    """Stretches of a record in which the unit does not turn.

    Parameters
    ----------
    increments : InertialIncrements
        The record.

    Returns
    -------
    list of (float, float)
        Start and end of each halt of 5 s or more, on the clock of the record. A second at each end is left
        out, in which a turn begins or ends.
    """
    blocks = _blocks(increments, 1.0)
    length = _step_s(blocks)
    rate = blocks.angle_rad / length
    window = max(1, round(HALT_S / length))
    if len(rate) < window:
        return []
    sums = np.cumsum(np.vstack([np.zeros(3), rate]), axis=0)
    means = (sums[window:] - sums[:-window]) / window
    spread = np.array([np.abs(rate[k : k + window] - mean).max() for k, mean in enumerate(means)])
    # A bias may be larger than any sway: a halt is where the rates are those of the quietest window.
    quiet = means[np.argmin(np.linalg.norm(means, axis=1) + spread)]
    off = np.linalg.norm(rate - quiet, axis=1)
    still = off < max(TURNING_RADPS, 5.0 * float(np.quantile(off, 0.25)))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    halts = []
    for first, last in edges.reshape(-1, 2):
        start = blocks.time_s[first] + (length if first > 0 else 0.0)
        end = blocks.time_s[last] - (length if last < len(still) else 0.0)
        if end - start >= HALT_S:
            halts.append((float(start), float(end)))
    return halts


def align_positions(
    increments: InertialIncrements,
    site: Site,
    *,
    table_angle_rad: np.ndarray | None = None,
    axis_body: np.ndarray | None = None,
    segments: Sequence[tuple[float, float]] | None = None,
    errors: ImuDescription | None = None,
    encoder_sd_rad: float = ENCODER_SD_RAD,
    running: bool = True,
) -> NorthSolution:
    """North from halts at two or more headings, with turns between them.

    Parameters
    ----------
    increments : InertialIncrements
        The whole record, turns included.
    site : Site
        Where.
    table_angle_rad : ndarray, shape (halts,), optional
        What the encoder of the table says at each halt, rising clockwise about `axis_body`. Without it the
        gyros measure the turns, with their scale errors.
    axis_body : ndarray, shape (3,), optional
        Axis of the table in the body; z (down) unless said. Turns are held against it only where it or the
        angles of the table are given; without them the unit may be turned by hand.
    segments : sequence of (float, float), optional
        Start and end of the halts on the clock of the record; found by `find_halts` unless given.
    errors : ImuDescription, optional
        What is stated of the sensors; without it the noise is taken from the record and the biases are free.
    encoder_sd_rad : float
        Noise of the encoder.
    running : bool
        Whether to give the estimate as it grew, after every second.

    Returns
    -------
    NorthSolution
        Attitude at the end of the record. `measured` holds ``halts``, ``turn_1_deg`` ... between them,
        ``still`` (1 where the gyros were held against the Earth rate directly), ``sway_mps``,
        ``residual_ratio``, and the biases with their standard deviations, ``gyro_bias_x_dph``,
        ``gyro_bias_sd_x_dph``, ..., ``accel_bias_sd_z_ug``.

    Raises
    ------
    NoSolutionError
        If there are not two halts, or the turns are not about the stated axis or not as the table says.
    ConfigError
        If the angles of the table are not one for each halt, or a segment is not in the record.
    """
    duration = float(increments.time_s[-1] - increments.time_s[0])
    halts = _halts_of(increments, segments)
    if len(halts) < 2:
        raise NoSolutionError(
            f"positions were to be compared, but the record of {duration:.0f} s shows "
            f"{'one halt' if halts else 'no halt'} and no turn between two; turn the unit between halts, or "
            "use a method for one position"
        )
    shortest = min(end - start for start, end in halts)
    blocks = _blocks(increments, _length_s(duration, shortest / 5.0))
    span = _span(duration, _step_s(blocks), shortest / 5.0)
    halt = _in_halts(blocks.time_s, halts)
    first = np.array([np.flatnonzero(halt == k)[0] for k in range(len(halts))])
    axis = _unit(axis_body)
    turns = _turns(blocks, halt, len(halts), axis)
    known = axis_body is not None or table_angle_rad is not None
    if known:
        _check_axis(blocks, halt, len(halts), axis)
    edges, angles = np.empty(0, dtype=int), np.empty(0)
    if table_angle_rad is not None:
        edges, angles = first, _table_angles(table_angle_rad, turns)
    table = _record(blocks, span, halt, edges, angles, axis)
    stated = errors if errors is not None else _free_errors(table)
    still = _stands_still(table, stated)
    if not still:
        table = _record(blocks, span, halt, edges, angles, axis, rest=False)
    notes: tuple[str, ...] = ()
    if not still:
        notes += (
            "The platform moves within the halts by more than the gyros' noise, so north comes from the "
            "accelerometers in the inertial frame alone.",
        )
    if _furthest(blocks, halt, len(halts)) < LITTLE_TURN_RAD:
        notes += (
            f"The positions differ by less than {np.degrees(LITTLE_TURN_RAD):.0f} deg, too little to tell "
            "the gyro bias from the Earth rate: sigma is little better than from one position; turn by half "
            "a turn.",
        )
    noise = Noise(sway_mps=sway_mps(table, site, stated), encoder_sd_rad=encoder_sd_rad)
    measured = {"halts": float(len(halts)), "still": float(still)}
    measured |= {f"turn_{k + 1}_deg": float(np.degrees(turn)) for k, turn in enumerate(turns)}
    found = estimate(table, site, stated, noise)
    return _solution("positions", increments, found, site, errors, noise, running, measured, notes)


def align_carousel(
    increments: InertialIncrements,
    site: Site,
    *,
    table_angle_rad: np.ndarray | None = None,
    axis_body: np.ndarray | None = None,
    errors: ImuDescription | None = None,
    encoder_sd_rad: float = ENCODER_SD_RAD,
    lever_arm_sd_m: float = LEVER_ARM_SD_M,
    wobble_rad: float | None = WOBBLE_SD_RAD,
    running: bool = True,
) -> NorthSolution:
    """North from a unit that turns steadily about an axis near the vertical, one way or to and fro.

    Parameters
    ----------
    increments : InertialIncrements
        The record.
    site : Site
        Where.
    table_angle_rad : ndarray, shape (n + 1,), optional
        What the encoder of the table says at the edges of the increments, rising clockwise about `axis_body`
        and not wrapped. Without it the scale error of the gyro makes the heading drift with every turn,
        unless the turns go to and fro.
    axis_body : ndarray, shape (3,), optional
        Axis of the table in the body; z (down) unless said.
    errors : ImuDescription, optional
        What is stated of the sensors; without it the noise is taken from the record and the biases are free.
    encoder_sd_rad : float
        Noise of the encoder.
    lever_arm_sd_m : float
        How far from the axis the unit may stand; its centripetal force is estimated with the rest.
    wobble_rad : float, optional
        How far the axis of the table wobbles, one sigma; None where the table itself may sway. A record that
        contradicts it is solved as with None.
    running : bool
        Whether to give the estimate as it grew, after every second.

    Returns
    -------
    NorthSolution
        Attitude at the end of the record. `measured` holds ``turned_deg`` (one way plus the other),
        ``turn_period_s``, ``sway_mps``, ``residual_ratio`` and the biases as `align_positions` has them,
        those of the gyros with what misalignments and scale errors make of the turning.

    Raises
    ------
    NoSolutionError
        If the record holds no whole turn, or turns too fast for its length.
    ConfigError
        If the angles of the table are not one for each edge.
    """
    axis = _unit(axis_body)
    duration = float(increments.time_s[-1] - increments.time_s[0])
    # Means over a second, in which the noise of a sample is gone.
    second = max(1, round(1.0 / _step_s(increments)))
    quiet = np.cumsum(increments.angle_rad @ axis)[second - 1 :: second]
    quiet = np.abs(np.diff(quiet, prepend=0.0)) / (second * _step_s(increments))
    rate = float(np.median(quiet)) if len(quiet) else 0.0
    turned = float(quiet.sum()) * second * _step_s(increments)
    # Noise and bias of any gyro make much less than a third of a degree in a second.
    if turned < 2.0 * np.pi or rate < np.radians(0.3):
        raise NoSolutionError(
            f"a carousel turns steadily, but the record of {duration:.0f} s turns by "
            f"{np.degrees(turned):.0f} deg in all about the stated axis; turn it by a whole turn or more, or "
            "use another method"
        )
    period = 2.0 * np.pi / rate
    length = period / PER_TURN
    if duration / length > MOST_BLOCKS:
        length = duration / MOST_BLOCKS
    if length > period / LEAST_PER_TURN:
        raise NoSolutionError(
            f"a carousel of {period:.2g} s a turn was to be solved over {duration:.0f} s, "
            f"{duration / period:.0f} turns; give {MOST_BLOCKS // LEAST_PER_TURN} turns or fewer, or turn "
            "more slowly"
        )
    blocks = _blocks(increments, _length_s(duration, length))
    span = _span(duration, _step_s(blocks), period / 4.0)
    n = len(blocks.angle_rad)
    edges, angles = np.empty(0, dtype=int), np.empty(0)
    if table_angle_rad is not None:
        given = np.asarray(table_angle_rad, dtype=float)
        if given.shape != increments.time_s.shape:
            raise ConfigError(
                f"{given.size} angles of the table are given for {len(increments.time_s)} edges of the "
                "record; give one for each",
                key="table_angle_rad",
                value=given.size,
            )
        seen, said = float(increments.angle_rad.sum(axis=0) @ axis), float(given[-1] - given[0])
        if not abs(said - seen) < TURN_MATCH_RAD + TURN_MATCH_SHARE * turned + _drift_rad(errors, duration):
            raise NoSolutionError(
                f"the table is said to have turned by {np.degrees(said):.0f} deg, but the gyros saw "
                f"{np.degrees(seen):.0f}; give angles that are not wrapped and rise clockwise about the axis"
            )
        samples = round(_step_s(blocks) / _step_s(increments))
        # One in a quarter turn is as good as all.
        edges = np.arange(0, n + 1, max(1, PER_TURN // 4))
        angles = given[::samples][: n + 1][edges]
    table = _record(blocks, span, np.full(n, -1), edges, angles, axis, fixed_axis=wobble_rad is not None)
    if errors is not None and table_angle_rad is None:
        net = abs(float(increments.angle_rad.sum(axis=0) @ axis))
        lost = np.degrees(np.hypot(_drift_rad(errors, duration), 1e-6 * errors.gyro_scale_sd_ppm * net))
        if lost > LOST_DEG:
            raise NoSolutionError(
                f"over {duration:.0f} s on the carousel a gyro as stated may lose its heading by "
                f"{lost:.0f} deg; give the angles of the table, or turn for a shorter time"
            )
    stated = errors if errors is not None else _free_errors(table)
    noise = Noise(
        sway_mps=sway_mps(table, site, stated),
        encoder_sd_rad=encoder_sd_rad,
        lever_arm_sd_m=lever_arm_sd_m,
        wobble_rad=wobble_rad or 0.0,
    )
    found = estimate(table, site, stated, noise)
    notes: tuple[str, ...] = ()
    if wobble_rad is not None and found.residual_ratio > MISFIT:
        table = _record(blocks, span, np.full(n, -1), edges, angles, axis)
        alone = estimate(table, site, stated, noise)
        if alone.residual_ratio < 0.9 * found.residual_ratio:
            found = alone
            notes += (
                "The axis of the table moves by more than its stated wobble, so north comes from the "
                "accelerometers in the inertial frame alone.",
            )
    measured = {"turned_deg": float(np.degrees(turned)), "turn_period_s": float(period)}
    return _solution("carousel", increments, found, site, errors, noise, running, measured, notes)


def _drift_rad(errors: ImuDescription | None, duration_s: float) -> float:
    """Heading that the bias of the gyros may lose, one sigma as stated, or what is hardly ever more."""
    if errors is None:
        return float(np.radians(LOST_DEG))
    return float(np.radians(errors.gyro_bias_sd_dph / 3600.0 * duration_s))


def turning_plan(duration_s: float, positions: int = 2, turn_s: float = 10.0) -> np.ndarray:
    """Table angles over time of halts at even headings.

    Parameters
    ----------
    duration_s : float
        Of all.
    positions : int
        How many halts.
    turn_s : float
        How long each turn takes.

    Returns
    -------
    ndarray, shape (2 positions, 2)
        Instants, s, and table angles, rad, between which the table turns steadily.
    """
    halt = (duration_s - (positions - 1) * turn_s) / positions
    if halt <= 0.0:
        raise ConfigError(
            f"{positions} positions with turns of {turn_s:g} s do not go into {duration_s:g} s; give "
            "more time",
            key="duration_s",
            value=duration_s,
        )
    starts = np.arange(positions) * (halt + turn_s)
    angles = np.arange(positions) * 2.0 * np.pi / positions
    return np.stack([np.stack([starts, starts + halt], axis=1).ravel(), np.repeat(angles, 2)], axis=1)


def positions_budget(
    errors: ImuDescription,
    site: Site,
    plan: np.ndarray,
    *,
    heading_rad: float = 0.0,
    encoder_sd_rad: float | None = None,
    still: bool = True,
    sway_mps: float = 0.0,
    lever_arm_sd_m: float = LEVER_ARM_SD_M,
    wobble_rad: float = WOBBLE_SD_RAD,
) -> ErrorBudget:
    """What `align_positions` or `align_carousel` will achieve, before anything turns.

    Parameters
    ----------
    errors : ImuDescription
        What is stated of the sensors.
    site : Site
        Where.
    plan : ndarray, shape (k, 2)
        Instants, s, and angles of a level table, rad, between which it turns steadily; where two angles are
        the same it halts. See `turning_plan`; a carousel is ``[[0, 0], [duration, angle]]``.
    heading_rad : float
        Heading at the start.
    encoder_sd_rad : float, optional
        Noise of the encoder of the table; None where the gyros measure the turns.
    still : bool
        Whether the platform stands still, in the halts or under the carousel.
    sway_mps : float
        Velocity of a swaying platform, mean over a block.
    lever_arm_sd_m : float
        How far from the axis of a carousel the unit may stand.
    wobble_rad : float
        How far the axis of a carousel wobbles.

    Returns
    -------
    ErrorBudget
        For the attitude at the end.
    """
    plan = np.asarray(plan, dtype=float)
    times, angles = plan[:, 0], plan[:, 1]
    duration = float(times[-1] - times[0])
    halts = [
        (float(times[k] - times[0]), float(times[k + 1] - times[0]))
        for k in range(len(plan) - 1)
        if angles[k] == angles[k + 1] and times[k + 1] > times[k]
    ]
    if halts:
        longest = min(end - start for start, end in halts) / 5.0
        step = _length_s(duration, longest)
    else:
        period = duration * 2.0 * np.pi / np.abs(np.diff(angles)).sum()
        longest = period / 4.0
        step = _length_s(duration, max(period / PER_TURN, duration / MOST_BLOCKS))
    n = max(4, round(duration / step))
    span = _span(duration, duration / n, longest)
    edges = np.linspace(0.0, duration, n + 1)
    table_rad = np.interp(edges, times - times[0], angles)
    rot = exp_so3(edges[:, None] * site.earth_rate_ned_radps) @ rot_ned_from_body(
        heading_rad + table_rad, 0.0, 0.0
    )
    velocity = np.tile([0.0, 0.0, -site.gravity_mps2 * duration / n], (n, 1))
    blocks = InertialIncrements(
        edges, log_so3(np.swapaxes(rot[:-1], -1, -2) @ rot[1:]), velocity, 0.5 * duration / n * velocity
    )
    halt = _in_halts(edges, halts)
    if halts:
        known = np.array([np.flatnonzero(halt == k)[0] for k in range(len(halts))])
    else:
        known = np.arange(0, n + 1, max(1, PER_TURN // 4))
    if encoder_sd_rad is None:
        known = known[:0]
    table = _record(
        blocks, span, halt, known, table_rad[known], np.array([0.0, 0.0, 1.0]), still, still and not halts
    )
    noise = Noise(
        sway_mps=sway_mps,
        encoder_sd_rad=encoder_sd_rad or 0.0,
        lever_arm_sd_m=0.0 if halts else lever_arm_sd_m,
        wobble_rad=wobble_rad,
    )
    model = model_of(
        table,
        site,
        errors,
        start=rot[0],
        earth_radps=site.earth_rate_ned_radps,
        gyro_rad=np.zeros((n, 3)),
        noise=noise,
    )
    return _budget(model, site, rot_ned_from_body(heading_rad + angles[-1], 0.0, 0.0), 1.0)


def _budget(model: Model, site: Site, rot: np.ndarray, residual_ratio: float) -> ErrorBudget:
    """All sources, largest effect on the heading first."""
    lines = model.lines()
    if residual_ratio > MISFIT:
        seen = sum((line.cov_ned_rad2 for line in lines), np.zeros((3, 3)))
        stated = f"residuals {residual_ratio:.2g} times as stated"
        lines.append(BudgetLine("unexplained scatter", stated, (residual_ratio**2 - 1.0) * seen))
    by = deflection_sensitivity(site)
    arcsec = 3600.0 * np.degrees(DEFLECTION_SD_RAD)
    lines.append(
        BudgetLine(
            "deflection of the vertical", f"{arcsec:.3g} arcsec (assumed)", DEFLECTION_SD_RAD**2 * by @ by.T
        )
    )
    lines.sort(key=lambda line: -line.cov_ned_rad2[2, 2])
    return ErrorBudget(tuple(lines), rot)


def _solution(
    method: str,
    increments: InertialIncrements,
    found: Estimate,
    site: Site,
    errors: ImuDescription | None,
    noise: Noise,
    running: bool,
    measured: dict[str, float],
    notes: tuple[str, ...],
) -> NorthSolution:
    """What was found, at the end of the record."""
    ratio = found.residual_ratio
    budget = _budget(found.model, site, found.rot_ned_from_body, ratio)
    if ratio > MISFIT:
        notes += (
            f"The observations scatter {ratio:.1f} times as much as stated of the sensors; sigma is "
            "widened by that.",
        )
    if errors is None:
        notes += (
            "The sensor's errors are not stated: sigma covers the noise of the record and free biases.",
        )
    used_s = float(found.model.geometry.table.edge_s[-1])
    rot = found.rot_ned_from_body
    return NorthSolution(
        method=method,
        site=site,
        time_s=used_s,
        duration_s=used_s,
        rot_ned_from_body=rot,
        cov_ned_rad2=wrapped_covariance(rot, budget.cov_ned_rad2),
        measured={**measured, "sway_mps": noise.sway_mps, "residual_ratio": ratio, **_biases(found, method)},
        run=_run(increments, found, site, ratio if ratio > MISFIT else 1.0) if running else None,
        budget=budget if errors is not None else None,
        notes=notes,
    )


def _biases(found: Estimate, method: str) -> dict[str, float]:
    """Biases and their standard deviations in the units of data sheets."""
    dph, ug = np.degrees(3600.0), 1e6 / STANDARD_GRAVITY_MPS2
    values: dict[str, float] = {}
    for name, unit, factor, (mean, sd) in (
        ("gyro", "dph", dph, found.gyro_bias(turning=method == "carousel")),
        ("accel", "ug", ug, found.accel_bias()),
    ):
        for i, axis in enumerate("xyz"):
            values[f"{name}_bias_{axis}_{unit}"] = float(factor * mean[i])
            values[f"{name}_bias_sd_{axis}_{unit}"] = float(factor * sd[i])
    return values


def _run(increments: InertialIncrements, found: Estimate, site: Site, widened: float) -> NorthRun:
    """The estimate after every second: that of the last block, carried on by the gyros."""
    geometry = found.model.geometry
    at_edge, cov_at_edge = found.attitudes()
    by = deflection_sensitivity(site)
    cov_at_edge = widened**2 * cov_at_edge + DEFLECTION_SD_RAD**2 * by @ by.T
    edge_s = geometry.table.edge_s
    seconds = _blocks(increments, min(1.0, geometry.table.step_s))
    time_s = seconds.time_s - seconds.time_s[0]
    time_s = time_s[time_s <= edge_s[-1] + 1e-6]
    rot = accumulate_turns(seconds.angle_rad[: len(time_s) - 1])
    last = np.clip(np.searchsorted(edge_s, time_s + 1e-6, side="right") - 1, 0, None)
    at_last = np.searchsorted(time_s, edge_s[last] - 1e-6)
    since = (time_s - edge_s[last])[:, None]
    bias = np.concatenate([found.gyro_rad, found.gyro_rad[-1:]])[last] / geometry.table.step_s
    own = np.swapaxes(rot[at_last], -1, -2) @ rot @ exp_so3(-since * bias)
    now = exp_so3(-since * site.earth_rate_ned_radps) @ at_edge[last] @ own
    angles, sd = np.full((len(now), 3), np.nan), np.full((len(now), 3), np.nan)
    for at in np.flatnonzero(np.isfinite(now).all(axis=(1, 2))):
        angles[at] = np.array(heading_pitch_roll(now[at]))
        cov = wrapped_covariance(now[at], cov_at_edge[last[at]])
        sd[at] = angle_deviations(now[at], cov)
    return NorthRun(time_s, angles, sd)


def _step_s(increments: InertialIncrements) -> float:
    """Interval of a record."""
    return float(np.median(np.diff(increments.time_s)))


def _length_s(duration_s: float, longest_s: float) -> float:
    """Length of a block: whole seconds, so that the estimate is known after each, or less than one."""
    # Of two seconds where one would make more than half of them: it costs a third.
    wanted = max(min(2.0, np.ceil(2.0 * duration_s / BLOCKS)), np.ceil(duration_s / BLOCKS), 1.0)
    length = min(wanted, longest_s)
    return float(np.floor(length)) if length > 1.0 else float(length)


def _span(duration_s: float, step_s: float, longest_s: float) -> int:
    """Blocks in a span."""
    return max(1, round(min(max(1.0, duration_s / SPANS), longest_s) / step_s))


def _blocks(increments: InertialIncrements, length_s: float) -> InertialIncrements:
    """Blocks of about a length."""
    return compress_increments(increments, max(1, round(length_s / _step_s(increments))))


def _unit(axis_body: np.ndarray | None) -> np.ndarray:
    """Axis of the table in the body."""
    if axis_body is None:
        return np.array([0.0, 0.0, 1.0])
    axis = np.asarray(axis_body, dtype=float)
    length = float(np.linalg.norm(axis))
    if axis.shape != (3,) or not length > 0.0:
        raise ConfigError(
            f"the axis of the table was given as {axis_body!r}; give three numbers in body axes",
            key="axis_body",
        )
    return axis / length


def _halts_of(
    increments: InertialIncrements, segments: Sequence[tuple[float, float]] | None
) -> list[tuple[float, float]]:
    """Halts as given, or as found."""
    if segments is None:
        return find_halts(increments)
    for start, end in segments:
        if not (increments.time_s[0] <= start and start + HALT_S <= end <= increments.time_s[-1]):
            raise ConfigError(
                f"a halt from {start:g} to {end:g} s was given; halts last {HALT_S:g} s or more within the "
                f"record, {increments.time_s[0]:g} to {increments.time_s[-1]:g} s",
                key="segments",
                value=(start, end),
            )
    return [(float(start), float(end)) for start, end in segments]


def _in_halts(edge_s: np.ndarray, halts: Sequence[tuple[float, float]]) -> np.ndarray:
    """Number of the halt that each block is wholly within, or -1."""
    number = np.full(len(edge_s) - 1, -1)
    slack = 1e-6
    for k, (start, end) in enumerate(halts):
        number[(edge_s[:-1] >= start - slack) & (edge_s[1:] <= end + slack)] = k
    return number


def _record(
    blocks: InertialIncrements,
    span: int,
    halt: np.ndarray,
    edges: np.ndarray,
    angles: np.ndarray,
    axis: np.ndarray,
    rest: bool = True,
    fixed_axis: bool = False,
) -> TableRecord:
    """Blocks with what is looked at: within each halt, or everywhere where there is none."""
    stretches = [np.flatnonzero(halt == k) for k in range(int(halt.max()) + 1)] or [np.arange(len(halt))]
    forces, still = [], []
    for stretch in stretches:
        first, end = stretch[0], stretch[-1] + 1
        forces.append(np.arange(first + span, end - span + 1, span))
        marks = np.unique(np.append(np.arange(first, end, span), end))
        still.append(np.stack([marks[:-1], marks[1:]], axis=1))
    spans, none = np.concatenate(still), np.empty((0, 2), dtype=int)
    return TableRecord(
        step_s=_step_s(blocks),
        edge_s=blocks.time_s - blocks.time_s[0],
        turn_rad=blocks.angle_rad,
        velocity_mps=blocks.velocity_mps,
        position_m=np.asarray(blocks.position_m),
        halt=halt,
        span=span,
        force_edges=np.concatenate(forces),
        rest=spans if rest and np.any(halt >= 0) else none,
        axis=spans if fixed_axis else none,
        table_edges=edges,
        table_rad=angles,
        axis_body=axis,
    )


def _between(blocks: InertialIncrements, halt: np.ndarray, halts: int) -> list[np.ndarray]:
    """Turns of the blocks from each halt to the next, without the bias that the halts show."""
    bias = np.median(blocks.angle_rad[halt >= 0], axis=0)
    last = [np.flatnonzero(halt == k)[-1] for k in range(halts)]
    first = [np.flatnonzero(halt == k)[0] for k in range(halts)]
    return [blocks.angle_rad[last[k] + 1 : first[k + 1]] - bias for k in range(halts - 1)]


def _turns(blocks: InertialIncrements, halt: np.ndarray, halts: int, axis: np.ndarray) -> list[float]:
    """Angle of each turn about the axis, not wrapped."""
    return [float(turn.sum(axis=0) @ axis) for turn in _between(blocks, halt, halts)]


def _furthest(blocks: InertialIncrements, halt: np.ndarray, halts: int) -> float:
    """Largest angle between two halts."""
    rot = [np.eye(3)]
    for turns in _between(blocks, halt, halts):
        now = rot[-1]
        for turn in exp_so3(turns):
            now = now @ turn
        rot.append(now)
    return max(float(np.linalg.norm(log_so3(a.T @ b))) for k, a in enumerate(rot) for b in rot[:k])


def _check_axis(blocks: InertialIncrements, halt: np.ndarray, halts: int, axis: np.ndarray) -> None:
    """Refuse turns that are not about the stated axis."""
    for k, turns in enumerate(_between(blocks, halt, halts)):
        # Block by block, because a turn to and fro has no direction of its own.
        along = turns @ axis
        across = np.linalg.norm(turns - along[:, None] * axis, axis=1).sum()
        off = float(np.arctan2(across, np.abs(along).sum()))
        if off > AXIS_RAD and np.abs(along).sum() + across > LITTLE_TURN_RAD:
            raise NoSolutionError(
                f"turn {k + 1} was to be about the body's axis {np.array2string(axis, precision=2)}, "
                f"but goes about one {np.degrees(off):.0f} deg off; state the right axis, or leave it and "
                "the table's angles out"
            )


def _table_angles(table_angle_rad: np.ndarray, turns: list[float]) -> np.ndarray:
    """Angles of the table, one for each halt, as the gyros saw the turns but for whole turns."""
    given = np.asarray(table_angle_rad, dtype=float)
    if given.shape != (len(turns) + 1,):
        raise ConfigError(
            f"{given.size} angles of the table are given, but the record has {len(turns) + 1} halts; give "
            "one for each",
            key="table_angle_rad",
            value=given.size,
        )
    for k, turn in enumerate(turns):
        miss = (given[k + 1] - given[k] - turn + np.pi) % (2.0 * np.pi) - np.pi
        if abs(miss) > TURN_MATCH_RAD:
            raise NoSolutionError(
                f"turn {k + 1} is {np.degrees(given[k + 1] - given[k]):.1f} deg by the table, but the "
                f"gyros saw {np.degrees(turn):.1f}; give the angles clockwise about the axis, in the "
                "order of the halts"
            )
    return given


def _stands_still(table: TableRecord, errors: ImuDescription) -> bool:
    """Whether the angles within the halts wander no more than by the noise of the gyros."""
    # A count or two of the gyro, and what no platform is free of.
    rounded = np.radians(errors.gyro_resolution_dps) / errors.rate_hz + 2e-6
    for k in range(int(table.halt.max()) + 1):
        blocks = np.flatnonzero(table.halt == k)
        n = len(blocks)
        sums = np.tril(np.ones((n, n)))
        line = np.stack([np.ones(n), np.arange(n) - 0.5 * (n - 1)], axis=1)
        off_line = (np.eye(n) - line @ np.linalg.pinv(line)) @ sums
        noise = gyro_noise_kernel(table.edge_s[blocks[0] : blocks[-1] + 2], errors)
        expected = np.einsum("ij,jk,ik->", off_line, noise, off_line, optimize=True) / n + rounded**2
        wander = np.mean((off_line @ table.turn_rad[blocks]) ** 2, axis=0)
        if np.max(wander) > SHAKEN**2 * expected:
            return False
    return True


def _free_errors(table: TableRecord) -> ImuDescription:
    """Errors of a unit of which nothing is stated: noise as it shows from block to block, biases free."""
    near = np.flatnonzero(table.halt[1:] == table.halt[:-1])

    def density(rows: np.ndarray) -> float:
        bend = rows[near][:-2] - 2.0 * rows[near][1:-1] + rows[near][2:]
        return float(1.4826 * np.median(np.abs(bend)) / np.sqrt(6.0 * table.step_s))

    return ImuDescription(
        grade="industrial",
        gyro_bias_sd_dph=1000.0,
        gyro_bias_instability_dph=0.0,
        gyro_random_walk_deg_per_sqrt_h=float(np.degrees(density(table.turn_rad))) * 60.0,
        gyro_g_sensitivity_dph_per_g=0.0,
        gyro_resolution_dps=0.0,
        accel_bias_sd_ug=10_000.0,
        accel_bias_instability_ug=0.0,
        accel_random_walk_mps_per_sqrt_h=density(table.velocity_mps) * 60.0,
    )
