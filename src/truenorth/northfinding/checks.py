r"""Whether a record can be what it claims to be: an inertial unit at rest that feels the Earth turn.

Before a search for north, what the data say by themselves is held against what the place says:

* the specific force of a body at rest is gravity; a wrong unit is off by a factor, not by a percent;
* seen from the inertial frame in which the gyros keep the body's first axes :math:`b_0`, gravity turns with
  the Earth. The velocity :math:`V(t) = \int C^{b_0}_b f\,dt` of a body at rest is that of gravity alone, so a
  quadratic fit :math:`V \approx c + a\tau + \dot a\tau^2/2` gives the horizontal Earth rate
  :math:`\omega_h = a \times \dot a / |a|^2`. Shaking enters V only by the velocity of the body, which is
  bounded, and a change of tilt is felt by gyros and accelerometers alike and cancels; both spoil a plain
  average of the rates;
* the vertical part is the slope of the angle turned about the vertical, right where the heading is kept.

What is refused is gross: saturation, dead axes, wrong units, a body that turns or drives. How far a small
error turns north is the business of the error budget.

References
----------
Wu, M., Wu, Y., Hu, X., Hu, D., "Optimization-based alignment for inertial navigation systems: theory and
algorithm", Aerospace Science and Technology 15 (2011) 1-17 (gravity in the inertial frame).
Groves, P. D., Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed. (2013),
sec. 5.6.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..constants import DPH_RADPS, STANDARD_GRAVITY_MPS2, UG_MPS2
from ..errors import NoSolutionError
from ..formats.imu_table import ImuTable
from ..gravity import EARTH_RATE_RADPS
from ..rotations import exp_so3
from ..sensors.imu import ImuDescription
from ..strapdown import InertialIncrements, accumulate_turns, compress_increments
from .site import Site

__all__ = ["RecordFigures", "check_record"]

SHORTEST_S = 10.0
"""A record below is not looked at: in this time the Earth turns by 0.04 degrees."""

SEGMENT_S = 900.0
"""The Earth's turn is fitted over parts of at most this length, where a parabola follows gravity to 5e-4."""

GRAVITY_TOLERANCE = 0.02
"""Relative, where nobody states the accelerometers' errors. Units differ by more."""

RATE_TOLERANCE = 0.5
"""Of the Earth rate, where nobody states the gyros' errors; more leaves no north to find without turning."""

LEAST_RATE_TOLERANCE = 0.1
"""Of the Earth rate, however good the gyros are said to be: yaw of the body is in it."""

TURNING_TOLERANCE = 20.0
"""Earth rates of gyro bias that a method with several positions may have to remove, where none is stated."""

TURNING_SHARE = 0.01
"""Of the usual rate of a turntable: what scale errors and misalignments may feign, where none are stated."""

TURN_LIMIT_RAD = np.radians(45.0)
"""What turns further is not at rest, but sways or is carried."""

VELOCITY_LIMIT_MPS = 2.0
"""Root mean square of a body's own velocity; moored ships stay far below, vehicles that drive above."""

TILT_LIMIT = 2.5
"""Tilts felt by accelerometers against those felt by gyros; a lever arm of a swaying body makes up to 2."""

_SIGMAS = 5.0
_AXES = ("x", "y", "z")
_PART = "select a part without it with --from and --until"


@dataclass(frozen=True, slots=True)
class RecordFigures:
    """What a record says of itself.

    Parameters
    ----------
    duration_s, interval_s : float
        Of the record and of its samples.
    gravity_mps2 : float
        Median over seconds of the magnitude of the mean specific force.
    horizontal_rate_radps, horizontal_rate_sd_radps : float
        Horizontal Earth rate from gravity's turn in the inertial frame, and one sigma of its noise.
    vertical_rate_radps, vertical_rate_sd_radps : float or None
        Rate about the upward vertical; None of a body that may turn.
    turned_rad : float
        Largest turn of the body against the Earth since the start.
    velocity_rms_mps : float
        What is left of the velocity after gravity: shaking.
    """

    duration_s: float
    interval_s: float
    gravity_mps2: float
    horizontal_rate_radps: float
    horizontal_rate_sd_radps: float
    vertical_rate_radps: float | None
    vertical_rate_sd_radps: float | None
    turned_rad: float
    velocity_rms_mps: float

    @property
    def earth_rate_radps(self) -> float | None:
        """Magnitude of the Earth rate as felt."""
        if self.vertical_rate_radps is None:
            return None
        return float(np.hypot(self.horizontal_rate_radps, self.vertical_rate_radps))

    @property
    def earth_rate_sd_radps(self) -> float:
        """One sigma of the Earth rate by what shakes the body."""
        return float(np.hypot(self.horizontal_rate_sd_radps, self.vertical_rate_sd_radps or 0.0))

    @property
    def latitude_rad(self) -> float | None:
        """Latitude at which the Earth rate is felt, from its elevation over the horizon."""
        if self.vertical_rate_radps is None:
            return None
        return float(np.arctan2(self.vertical_rate_radps, self.horizontal_rate_radps))

    def figures(self) -> dict[str, float]:
        """What is known, in the units of reports, by name."""
        known = {
            "gravity_mps2": self.gravity_mps2,
            "horizontal_rate_dph": self.horizontal_rate_radps / DPH_RADPS,
            "horizontal_rate_sd_dph": self.horizontal_rate_sd_radps / DPH_RADPS,
            "turned_deg": float(np.degrees(self.turned_rad)),
            "velocity_rms_mps": self.velocity_rms_mps,
        }
        if self.earth_rate_radps is not None and self.latitude_rad is not None:
            known["earth_rate_dph"] = self.earth_rate_radps / DPH_RADPS
            known["earth_rate_sd_dph"] = self.earth_rate_sd_radps / DPH_RADPS
            known["latitude_deg"] = float(np.degrees(self.latitude_rad))
        return known


def check_record(
    increments: InertialIncrements,
    site: Site,
    *,
    errors: ImuDescription | None = None,
    may_turn: bool = False,
    table: ImuTable | None = None,
) -> RecordFigures:
    """Refuse a record in which no north can be found because it is not what it seems.

    Parameters
    ----------
    increments : InertialIncrements
        In body axes.
    site : Site
        Where it was recorded.
    errors : ImuDescription, optional
        What is known of the sensor: ranges, biases, scale errors.
    may_turn : bool
        Whether the body is meant to turn (several positions, carousel).
    table : ImuTable, optional
        The table that the increments come from: the samples as the sensor gave them, and its ranges.

    Returns
    -------
    RecordFigures
        What was measured.

    Raises
    ------
    NoSolutionError
        In one sentence: missing numbers, too short, saturated, dead axes, specific force that is no gravity,
        Earth rate not felt or with a wrong factor, a body that turns or is driven.
    """
    angle, velocity, time_s = increments.angle_rad, increments.velocity_mps, increments.time_s
    _refuse_not_finite(increments)
    duration_s = float(time_s[-1] - time_s[0]) if len(time_s) > 1 else 0.0
    if duration_s < SHORTEST_S:
        raise NoSolutionError(
            f"the record is {duration_s:.3g} s long, and the Earth turns by {duration_s * 15.04 / 3.6:.2g}"
            f" thousandths of a degree in it; record at least {SHORTEST_S:g} s, better some minutes"
        )
    interval_s = duration_s / len(angle)
    samples = (angle, velocity) if table is None else (table.sensor_angle_rad, table.sensor_velocity_mps)
    _refuse_saturated(
        *samples, time_s=time_s, interval_s=interval_s, errors=errors, table=table, still=not may_turn
    )
    _refuse_dead(*samples)

    blocks = compress_increments(increments, max(1, round(min(1.0, duration_s / 100.0) / interval_s)))
    strength = np.linalg.norm(blocks.velocity_mps, axis=1) / np.diff(blocks.time_s)
    gravity = float(np.median(strength))
    _refuse_wrong_force(strength, site, interval_s, errors)

    turn = accumulate_turns(blocks.angle_rad)
    mean_rate_radps = float(np.mean(np.linalg.norm(angle, axis=1))) / interval_s
    sd_radps = _stated_rate_sd(errors, duration_s, mean_rate_radps)
    excess_radps = EARTH_RATE_RADPS
    if sd_radps is not None:
        excess_radps = max(excess_radps, _SIGMAS * sd_radps)
    elif may_turn:
        usual_radps = float(np.median(np.linalg.norm(blocks.angle_rad, axis=1))) / float(
            np.diff(blocks.time_s)[0]
        )
        excess_radps = TURNING_TOLERANCE * EARTH_RATE_RADPS + TURNING_SHARE * usual_radps
    _refuse_fast(blocks, turn, site, excess_radps, may_turn)
    felt = _felt(blocks, turn)
    limit_mps = VELOCITY_LIMIT_MPS + _velocity_of_errors(gravity, excess_radps, duration_s, may_turn)
    if felt.velocity_rms > limit_mps:
        raise NoSolutionError(
            f"the body is not at rest: beside gravity its velocity changes by {felt.velocity_rms:.3g} m/s"
            f" root mean square, and up to {limit_mps:.3g} are taken as shaking; select a part at rest with"
            f" --from and --until"
        )
    if felt.tilt - _SIGMAS * felt.tilt_sd > TILT_LIMIT:
        raise NoSolutionError(
            f"the accelerometers feel the body tilt {felt.tilt:.3g} +- {felt.tilt_sd:.2g} times as far as the"
            f" gyros say{_guess(1.0 / felt.tilt)}; check the unit and scale of the gyros' columns"
        )
    turned, when_s = _turned(blocks, turn, felt, site)
    figures = RecordFigures(
        duration_s=duration_s,
        interval_s=interval_s,
        gravity_mps2=gravity,
        horizontal_rate_radps=felt.horizontal,
        horizontal_rate_sd_radps=felt.horizontal_sd,
        vertical_rate_radps=None if may_turn else felt.vertical,
        vertical_rate_sd_radps=None if may_turn else felt.vertical_sd,
        turned_rad=turned,
        velocity_rms_mps=felt.velocity_rms,
    )
    if not may_turn and turned > TURN_LIMIT_RAD + excess_radps * duration_s:
        raise NoSolutionError(
            f"the body turns: at {when_s:.4g} s it stands {np.degrees(turned):.0f} degrees from its start;"
            f" select a part at rest with --from and --until, or take a method for several positions"
        )
    _refuse_wrong_rate(figures, site, sd_radps, excess_radps)
    return figures


# ---------------------------------------------------------------------------------- samples


def _refuse_not_finite(increments: InertialIncrements) -> None:
    for name, rows in (("gyros", increments.angle_rad), ("accelerometers", increments.velocity_mps)):
        bad = np.flatnonzero(~np.isfinite(rows).all(axis=1))
        if len(bad):
            raise NoSolutionError(
                f"the {name} have no number at {increments.time_s[bad[0]]:.3f} s ({len(bad)} such samples);"
                f" {_PART}"
            )


def _refuse_saturated(
    angle: np.ndarray,
    velocity: np.ndarray,
    *,
    time_s: np.ndarray,
    interval_s: float,
    errors: ImuDescription | None,
    table: ImuTable | None,
    still: bool,
) -> None:
    """Samples at the end of the range; where it is not stated, many at one value that ends a wide spread."""
    ranges: dict[str, float | None] = {"gyro": None, "accelerometer": None}
    if errors is not None:
        ranges = {
            "gyro": float(np.radians(errors.gyro_range_dps)),
            "accelerometer": errors.accel_range_g * 1e6 * UG_MPS2,
        }
    if table is not None:
        ranges["gyro"] = table.gyro_range_radps or ranges["gyro"]
        ranges["accelerometer"] = table.accelerometer_range_mps2 or ranges["accelerometer"]
    units = {"gyro": (np.radians(1.0), "deg/s"), "accelerometer": (1.0, "m/s^2")}
    for name, rows in (("gyro", angle), ("accelerometer", velocity)):
        limit = ranges[name]
        worth, unit = units[name]
        for axis, column in zip(_AXES, rows.T, strict=True):
            if limit is not None:
                # A step of the sensor may lie between its range and the last count.
                at = np.flatnonzero(np.abs(column) >= 0.999 * limit * interval_s)
                if len(at):
                    raise NoSolutionError(
                        f"{name} {axis} is saturated: {len(at)} of its samples are at the end of its range of"
                        f" {limit / worth:.4g} {unit}, the first at {time_s[at[0]]:.2f} s; {_PART}"
                    )
            elif still and (found := _ceiling(column)) is not None:
                value, share = found
                raise NoSolutionError(
                    f"{name} {axis} is saturated: {100.0 * share:.2g} % of its samples are"
                    f" {value / interval_s / worth:.4g} {unit} and none is beyond, which is no chance;"
                    f" {_PART}, or record with a wider range"
                )


def _ceiling(column: np.ndarray) -> tuple[float, float] | None:
    """The value at which a column is cut off, and the share of its samples there; None where it is not.

    The outermost value of noise is rarer than the next one, that of an oscillation at most 2.4 times as
    frequent (counts of a sine: 1 / (sqrt 2 - 1)). Coarse counts, few of which make up all of the record, say
    nothing.
    """
    if len(column) < 200:
        return None
    low, high = np.partition(column, [len(column) // 20, len(column) - 1 - len(column) // 20])[
        [len(column) // 20, len(column) - 1 - len(column) // 20]
    ]
    spread = float(high - low)
    if spread == 0.0:
        return None
    # Coning and sculling move equal counts apart, by less than this; a count is more where it matters.
    near = 0.02 * spread
    for sign in (1.0, -1.0):
        values = sign * column
        top = float(values.max())
        at = values > top - near
        n_top = int(np.count_nonzero(at))
        # Beyond a half it is not the end of the spread but the state of rest.
        if not max(50, 0.005 * len(values)) <= n_top <= 0.5 * len(values):
            continue
        below = values[~at]
        second = float(below.max())
        n_second = int(np.count_nonzero(below > second - near))
        # A turn or a knock far off all the rest is no clipping, and leaves the sum on its side.
        inside = top - sign * (high if sign > 0.0 else low) < 2.0 * spread
        middle = float(np.median(values))
        lasting = float(np.sum(values - middle)) > 0.5 * n_top * (top - middle)
        if n_top >= 3 * n_second and top - second < spread / 8.0 and inside and not lasting:
            return sign * top, n_top / len(values)
    return None


def _refuse_dead(angle: np.ndarray, velocity: np.ndarray) -> None:
    """An axis that says the same all the time while others do not."""
    if not angle.any():
        raise NoSolutionError(
            "the gyros give zero rate in every sample, not even the Earth's: they are off, or too coarse to"
            " feel it; check the log and the columns of the mapping"
        )
    for name, rows in (("gyro", angle), ("accelerometer", velocity)):
        # Sculling of a constant count is no life.
        still = np.ptp(rows, axis=0) <= 1e-5 * np.abs(rows).max()
        alive = [
            moves and len(np.unique(column[:2000])) >= 10
            for moves, column in zip(~still, rows.T, strict=True)
        ]
        if still.any() and sum(alive) >= 2:
            axis = _AXES[int(np.argmax(still))]
            raise NoSolutionError(
                f"{name} {axis} gives the same value in every sample while the other axes do not: it is dead,"
                f" or its column is the wrong one; check the log and the mapping"
            )


# ---------------------------------------------------------------------------------- gravity


def _refuse_wrong_force(
    strength: np.ndarray, site: Site, interval_s: float, errors: ImuDescription | None
) -> None:
    """Magnitudes of the mean specific force of blocks against gravity; shaking enters them squared only."""
    low, gravity, high = np.percentile(strength, [16.0, 50.0, 84.0])
    ratio = gravity / site.gravity_mps2
    tolerance = GRAVITY_TOLERANCE
    if errors is not None:
        stated = (
            errors.accel_bias_sd_ug * 1e-6,
            errors.accel_bias_instability_ug * 1e-6,
            errors.accel_scale_sd_ppm * 1e-6,
            errors.accel_misalignment_sd_mrad * 1e-3,
        )
        tolerance = max(tolerance, _SIGMAS * float(np.linalg.norm(stated)))
    if abs(ratio - 1.0) <= tolerance:
        return
    if abs(ratio - 1.0) < 0.2 and high - low > 0.02 * gravity:
        raise NoSolutionError(
            f"the body is not at rest: the specific force is {gravity:.4g} m/s^2 where gravity is"
            f" {site.gravity_mps2:.4f}, and changes by {0.5 * (high - low):.2g} m/s^2 from second to second;"
            f" select a part at rest with --from and --until"
        )
    g = STANDARD_GRAVITY_MPS2
    looks = {
        g: "looks like m/s^2 taken as g",
        1.0 / g: "looks like g taken as m/s^2",
        1e3: "looks like mg taken as g",
        1e-3: "looks like g taken as mg",
        1e6: "looks like ug taken as g",
        1e-6: "looks like g taken as ug",
        1e3 / g: "looks like mg taken as m/s^2",
        1e-3 * g: "looks like m/s^2 taken as mg",
        1.0 / 0.3048: "looks like feet taken as metres",
        0.3048: "looks like metres taken as feet",
        1.0 / interval_s: "looks like forces taken as velocity increments",
        interval_s: "looks like velocity increments taken as forces",
        2.0: "looks like a range of the sensor twice too large",
        0.5: "looks like a range of the sensor half of the true one",
    }
    nearest = min(looks, key=lambda factor: abs(ratio / factor - 1.0))
    guess = f", which {looks[nearest]}" if abs(ratio / nearest - 1.0) < tolerance else ""
    said = f"{100.0 * (ratio - 1.0):+.1f} %" if abs(ratio - 1.0) < 0.5 else f"a factor of {ratio:.4g}"
    raise NoSolutionError(
        f"the accelerometers feel {gravity:.4g} m/s^2 where gravity is {site.gravity_mps2:.4f}"
        f" ({said}{guess}); check the unit and scale of their columns"
        + (", or state their errors" if abs(ratio - 1.0) < 0.5 else "")
    )


# ---------------------------------------------------------------------------------- Earth rate


class _Felt(NamedTuple):
    """The Earth rate as felt; rad/s and m/s."""

    vector: np.ndarray
    """Horizontal part, in the body's first axes."""
    up: np.ndarray
    """Direction of the specific force in the same axes, in the middle."""
    horizontal: float
    horizontal_sd: float
    vertical: float
    vertical_sd: float
    velocity_rms: float
    tilt: float
    """How many times as far as the gyros say the accelerometers feel the body tilt."""
    tilt_sd: float


def _velocity_of_errors(gravity: float, rate_radps: float, duration_s: float, may_turn: bool) -> float:
    """What a rate that is none leaves of gravity over the parabola, root mean square.

    It leads gravity around a circle, whose next term is g w^2 t^3 / 6; of a body that turns it changes its
    direction at once, which leaves a share of g w t^2 / 2.
    """
    length_s = min(duration_s, SEGMENT_S)
    circle = 0.0032 * gravity * rate_radps**2 * length_s**3
    return circle + (0.03 * gravity * rate_radps * length_s**2 if may_turn else 0.0)


def _stated_rate_sd(errors: ImuDescription | None, duration_s: float, mean_rate_radps: float) -> float | None:
    """One sigma of the mean rate along one axis by the stated errors; None where none are stated."""
    if errors is None:
        return None
    parts = (
        errors.gyro_bias_sd_dph * DPH_RADPS,
        errors.gyro_bias_instability_dph * DPH_RADPS,
        errors.gyro_bias_walk_dph_per_sqrt_h * DPH_RADPS * np.sqrt(duration_s / 3600.0),
        errors.gyro_g_sensitivity_dph_per_g * DPH_RADPS,
        errors.gyro_density_rad_per_sqrt_s / np.sqrt(duration_s),
        errors.gyro_scale_sd_ppm * 1e-6 * mean_rate_radps,
        errors.gyro_misalignment_sd_mrad * 1e-3 * mean_rate_radps,
    )
    return float(np.linalg.norm(parts))


def _effective(residual: np.ndarray) -> float:
    """Number of independent samples in a residual, by its correlation from one to the next."""
    power = float(np.sum(residual**2))
    if power == 0.0:
        return float(len(residual))
    correlation = float(np.sum(residual[1:] * residual[:-1])) / power
    correlation = min(max(correlation, 0.0), 0.99)
    return max(4.0, len(residual) * (1.0 - correlation) / (1.0 + correlation))


def _fit(blocks: InertialIncrements, turn: np.ndarray, first: int, last: int) -> _Felt:
    """The Earth rate over blocks first to last (exclusive)."""
    time_s = blocks.time_s[first : last + 1]
    length_s = float(time_s[-1] - time_s[0])
    tau = time_s - 0.5 * (time_s[0] + time_s[-1])

    gained = np.einsum("nij,nj->ni", turn[first:last], blocks.velocity_mps[first:last])
    velocity = np.concatenate([np.zeros((1, 3)), np.cumsum(gained, axis=0)])
    basis = np.stack([np.ones_like(tau), tau, 0.5 * tau**2], axis=1)
    fitted = np.linalg.lstsq(basis, velocity, rcond=None)[0]
    left = velocity - basis @ fitted
    velocity_rms = float(np.sqrt(np.mean(np.sum(left**2, axis=1))))
    force, force_rate = fitted[1], fitted[2]
    strength = float(np.linalg.norm(force))
    up = force / strength
    vector = np.cross(up, force_rate) / strength
    # The coefficient of tau^2 / 2 has the variance 720 s^2 / (n T^4).
    noise = velocity_rms / np.sqrt(3.0 * _effective(left))
    horizontal_sd = noise * np.sqrt(720.0) / length_s**2 / strength

    turned = np.cumsum(np.einsum("nij,nj->ni", turn[first:last], blocks.angle_rad[first:last]), axis=0)
    # Gyros that say 1 / (1 + e) of a tilt leave -e times this in the velocity.
    steps = np.diff(time_s)[:, None] * np.cross(turned, force)
    missed = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    missed -= basis @ np.linalg.lstsq(basis, missed, rcond=None)[0]
    power = float(np.sum(missed**2))
    excess = -float(np.sum(missed * left)) / power if power > 0.0 else 0.0
    rest = left + excess * missed
    excess_sd = np.inf
    if power > 0.0:
        excess_sd = float(np.sqrt(np.mean(rest**2) * len(rest) / _effective(rest) / power))

    heading = np.concatenate([[0.0], turned @ up])
    line = np.stack([np.ones_like(tau), tau], axis=1)
    slope = np.linalg.lstsq(line, heading, rcond=None)[0]
    off = heading - line @ slope
    wobble = float(np.sqrt(np.mean(off**2) / _effective(off[:, None])))
    return _Felt(
        vector=vector,
        up=up,
        horizontal=float(np.linalg.norm(vector)),
        horizontal_sd=float(horizontal_sd),
        vertical=float(slope[1]),
        vertical_sd=wobble * float(np.sqrt(12.0)) / length_s,
        velocity_rms=velocity_rms,
        tilt=1.0 + excess,
        tilt_sd=excess_sd,
    )


def _felt(blocks: InertialIncrements, turn: np.ndarray) -> _Felt:
    """The Earth rate over the whole record, the mean of parts that a parabola follows."""
    n = len(blocks.angle_rad)
    n_parts = int(np.ceil((blocks.time_s[-1] - blocks.time_s[0]) / SEGMENT_S))
    edges = np.linspace(0, n, n_parts + 1).astype(int)
    parts = [_fit(blocks, turn, int(a), int(b)) for a, b in pairwise(edges)]
    middle = parts[len(parts) // 2]

    def joint_sd(values: list[float]) -> float:
        return float(np.linalg.norm(values)) / len(values)

    return _Felt(
        vector=middle.vector,
        up=middle.up,
        horizontal=float(np.mean([part.horizontal for part in parts])),
        horizontal_sd=joint_sd([part.horizontal_sd for part in parts]),
        vertical=float(np.mean([part.vertical for part in parts])),
        vertical_sd=joint_sd([part.vertical_sd for part in parts]),
        velocity_rms=max(part.velocity_rms for part in parts),
        tilt=middle.tilt,
        tilt_sd=middle.tilt_sd,
    )


def _refuse_fast(
    blocks: InertialIncrements, turn: np.ndarray, site: Site, excess_radps: float, may_turn: bool
) -> None:
    """Gyros that turn gravity much faster than the Earth does: a wrong factor.

    Looked at in parts so short that even then gravity turns by little in each.
    """
    n, length_s = len(blocks.angle_rad), float(blocks.time_s[-1] - blocks.time_s[0])
    block_s = length_s / n
    speed = float(np.median(np.linalg.norm(blocks.angle_rad, axis=1))) / block_s
    size = int(np.clip(np.radians(20.0) / max(speed, 1e-9) / block_s, 8, max(8.0, 120.0 / block_s)))
    parts = [_fit(blocks, turn, k, min(n, k + size)) for k in range(0, max(1, n - size + 1), size)]
    horizontal = float(np.median([part.horizontal for part in parts]))
    sd = float(np.median([part.horizontal_sd for part in parts]))
    if horizontal > site.horizontal_rate_radps + excess_radps + _SIGMAS * sd:
        vertical = float(np.median([part.vertical for part in parts]))
        if not may_turn and abs(vertical) > max(10.0 * horizontal, TURN_LIMIT_RAD / length_s):
            raise NoSolutionError(
                f"the body turns about the vertical by {np.degrees(abs(vertical)):.3g} deg/s, not at rest;"
                f" select a part at rest with --from and --until, or take a method for several positions"
            )
        raise NoSolutionError(_wrong_factor(horizontal / site.horizontal_rate_radps, horizontal, site))


_FACTORS = {
    180.0 / np.pi: "looks like degrees taken as radians",
    np.pi / 180.0: "looks like radians taken as degrees",
    3600.0: "looks like deg/h taken as deg/s, or arcsec as degrees",
    1.0 / 3600.0: "looks like deg/s taken as deg/h, or degrees as arcsec",
    60.0: "looks like minutes of arc taken as degrees",
    1.0 / 60.0: "looks like degrees taken as minutes of arc",
    1e3: "looks like thousandths taken as whole units",
    1e-3: "looks like whole units taken as thousandths",
}


def _guess(ratio: float) -> str:
    """What a factor of the gyros looks like, where it is a known one."""
    known = (what for factor, what in _FACTORS.items() if abs(ratio / factor - 1.0) < 0.1)
    return next((f", which {what}" for what in known), "")


def _wrong_factor(ratio: float, horizontal: float, site: Site) -> str:
    """The sentence of gyros with a wrong factor."""
    return (
        f"the gyros turn gravity by {horizontal / DPH_RADPS:.4g} deg/h where the Earth turns it by"
        f" {site.horizontal_rate_radps / DPH_RADPS:.2f} deg/h (a factor of {ratio:.3g}{_guess(ratio)});"
        f" check the unit and scale of their columns, or state their bias if it is larger than the Earth rate"
    )


def _turned(blocks: InertialIncrements, turn: np.ndarray, felt: _Felt, site: Site) -> tuple[float, float]:
    """Largest turn of the body against the Earth since the start, and when."""
    strength = float(np.linalg.norm(felt.vector))
    north = felt.vector / strength if strength > 0.0 else np.zeros(3)
    up_rate = -float(site.earth_rate_ned_radps[2])
    earth = site.horizontal_rate_radps * north + up_rate * felt.up
    since_s = blocks.time_s - blocks.time_s[0]
    back = exp_so3(-since_s[:, None] * earth)
    trace = np.einsum("nij,nji->n", back, turn)
    angle = np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))
    k = int(np.argmax(angle))
    return float(angle[k]), float(blocks.time_s[k])


def _refuse_wrong_rate(
    figures: RecordFigures, site: Site, stated_sd_radps: float | None, excess_radps: float
) -> None:
    """An Earth rate that is not felt, or not where the latitude says."""
    turning = figures.vertical_rate_radps is None
    if stated_sd_radps is None:
        allowed = excess_radps if turning else RATE_TOLERANCE * EARTH_RATE_RADPS
    else:
        allowed = max(LEAST_RATE_TOLERANCE * EARTH_RATE_RADPS, _SIGMAS * stated_sd_radps)
    expected = site.horizontal_rate_radps
    off = [figures.horizontal_rate_radps - expected]
    noise = figures.horizontal_rate_sd_radps
    if figures.vertical_rate_radps is not None and figures.vertical_rate_sd_radps is not None:
        off.append(figures.vertical_rate_radps + float(site.earth_rate_ned_radps[2]))
        noise = float(np.hypot(noise, figures.vertical_rate_sd_radps))
    least = 0.25 * expected if turning and stated_sd_radps is None else 0.0
    too_little = figures.horizontal_rate_radps + _SIGMAS * noise < least
    if not too_little and float(np.linalg.norm(off)) <= np.hypot(allowed, _SIGMAS * noise):
        return
    felt = figures.horizontal_rate_radps if figures.earth_rate_radps is None else figures.earth_rate_radps
    whole = expected if figures.earth_rate_radps is None else EARTH_RATE_RADPS
    ratio = felt / whole
    if ratio > 1.5:
        raise NoSolutionError(_wrong_factor(ratio, figures.horizontal_rate_radps, site))
    found_dph, noise_dph, whole_dph = (rate / DPH_RADPS for rate in (felt, noise, whole))
    if ratio < 0.5:
        raise NoSolutionError(
            f"the gyros do not feel the Earth turn: {found_dph:.3g} +- {noise_dph:.2g} deg/h where there are"
            f" {whole_dph:.2f} (a factor of {ratio:.2g}{_guess(ratio)}); check the unit and scale of their"
            f" columns, or take a better sensor"
        )
    where = f"{found_dph:.2f} +- {noise_dph:.2g} deg/h"
    if figures.latitude_rad is None:
        where += f" about the horizontal, not {whole_dph:.2f}"
    else:
        where += (
            f" as at latitude {np.degrees(figures.latitude_rad):.1f}, not {whole_dph:.2f} at"
            f" {np.degrees(site.latitude_rad):.1f}"
        )
    raise NoSolutionError(
        f"the gyros feel the Earth turn by {where}, and no stated error explains that; check the latitude,"
        f" the axes of gyros and accelerometers, and whether the body stood still"
    )
