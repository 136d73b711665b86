"""North from one position, two, four and a carousel: what is left of the gyro bias, and the stated sigma.

    python tools/study_multi_position.py --draws 100 --seed 2026 --out docs/validation/multi_position.md

Every draw is a unit of its own (biases, scales, misalignments, instability, noise), at a heading of its own,
on a turntable simulated by `TurntableMotion`. Everything follows from the seed.
"""

import argparse
import functools
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from datetime import date
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from scipy.stats import chi2

import truenorth
from truenorth.northfinding.budget import heading_sd_on_circle
from truenorth.northfinding.positions import (
    ENCODER_SD_RAD,
    align_carousel,
    align_positions,
    find_halts,
    positions_budget,
    turning_plan,
)
from truenorth.northfinding.site import Site
from truenorth.northfinding.static import align_static
from truenorth.rotations import heading_pitch_roll, log_so3, rot_ned_from_body
from truenorth.sensors.imu import ImuDescription, imu_increments_from_log, simulate_imu
from truenorth.simulation.motion import TurntableMotion, build_trajectory
from truenorth.simulation.randomness import stream
from truenorth.strapdown import InertialIncrements

RATE_HZ = 20.0
TURN_S = 10.0
SPIN_DPS = 10.0

FOG = {
    "output": "increments",
    "gyro_bias_sd_dph": 1.0,
    "gyro_bias_walk_dph_per_sqrt_h": 0.0,
    "gyro_scale_sd_ppm": 500.0,
    "gyro_misalignment_sd_mrad": 1.0,
    "gyro_g_sensitivity_dph_per_g": 0.0,
    "gyro_resolution_dps": 1e-5,
}
SENSORS = {
    "FOG 0.1": ImuDescription(
        rate_hz=RATE_HZ,
        **FOG,
        gyro_bias_instability_dph=0.05,
        gyro_random_walk_deg_per_sqrt_h=0.1,
        accel_bias_sd_ug=1000.0,
        accel_bias_instability_ug=200.0,
        accel_random_walk_mps_per_sqrt_h=0.147,
        accel_scale_sd_ppm=500.0,
    ),
    "FOG 0.01": ImuDescription(
        rate_hz=RATE_HZ,
        **FOG,
        gyro_bias_instability_dph=0.01,
        gyro_random_walk_deg_per_sqrt_h=0.01,
        accel_bias_sd_ug=1000.0,
        accel_bias_instability_ug=20.0,
        accel_random_walk_mps_per_sqrt_h=0.06,
        accel_scale_sd_ppm=500.0,
    ),
    "tactical": ImuDescription(grade="tactical", rate_hz=RATE_HZ),
    "industrial": ImuDescription(grade="industrial", rate_hz=RATE_HZ),
}
"""The first is that of Oguz (2006, sec. 4.5): 1 deg/h, 0.1 deg/sqrt(h), 500 ppm, accelerometers of 1 mg, 0.2
mg and 250 ug/sqrt(Hz); instability of the gyro is ours, misalignment is what he calls its stability."""

QUIET = {
    "gyro_bias_instability_dph": 0.0,
    "gyro_random_walk_deg_per_sqrt_h": 0.0,
    "gyro_bias_walk_dph_per_sqrt_h": 0.0,
    "gyro_resolution_dps": 0.0,
    "accel_bias_instability_ug": 0.0,
    "accel_random_walk_mps_per_sqrt_h": 0.0,
    "accel_bias_walk_ug_per_sqrt_h": 0.0,
    "accel_resolution_ug": 0.0,
}
"""Without all that changes in a record."""

METHODS = ("one", "two", "two, encoder", "four", "carousel, encoder", "carousel to and fro")


class Case(NamedTuple):
    """One cell of a table."""

    sensor: str
    latitude_deg: float
    duration_s: float
    method: str
    quiet: bool = False


class Outcome(NamedTuple):
    """Of all draws of a case."""

    error_deg: np.ndarray
    sd_deg: np.ndarray
    nees: np.ndarray
    predicted_deg: float
    plain_deg: np.ndarray
    """Errors of the plain estimator on the same records; empty where there is none."""
    seconds: float


def sensor_of(case):
    """What the estimator is told, and what is simulated."""
    told = SENSORS[case.sensor]
    if not case.quiet:
        return told, told
    fields = {name: getattr(told, name) for name in told.__struct_fields__}
    return told, ImuDescription(**{**fields, **QUIET})


def plan_of(case):
    """Instants and table angles, and the steps of rate that make them."""
    duration = case.duration_s
    if case.method == "one":
        return None, TurntableMotion(rate_dps=0.0)
    if case.method == "carousel, encoder":
        return np.array([[0.0, 0.0], [duration, np.radians(SPIN_DPS * duration)]]), TurntableMotion(
            rate_dps=SPIN_DPS
        )
    if case.method == "carousel to and fro":
        quarter = duration / 4.0
        far = np.radians(SPIN_DPS * quarter)
        plan = np.array([[0.0, 0.0], [quarter, far], [3.0 * quarter, -far], [duration, 0.0]])
        steps = ((0.0, SPIN_DPS), (quarter, -SPIN_DPS), (3.0 * quarter, SPIN_DPS))
        return plan, TurntableMotion(steps=steps, ramp_s=0.5)
    positions = 4 if case.method == "four" else 2
    plan = turning_plan(duration, positions, TURN_S)
    rate = 360.0 / positions / (TURN_S - 1.0)
    steps = [(0.0, 0.0)]
    for end, start in zip(plan[1:-1:2, 0], plan[2::2, 0], strict=True):
        # A ramp is half a second long at both ends of a turn.
        steps += [(end + 0.5, rate), (start - 0.5, 0.0)]
    return plan, TurntableMotion(steps=tuple(steps), ramp_s=0.5)


def record(case, seed, heading_deg):
    """Increments of one unit, true angle of the table, true attitude at the end."""
    _, simulated = sensor_of(case)
    _, motion = plan_of(case)
    motion = TurntableMotion(
        rate_dps=motion.rate_dps, steps=motion.steps, ramp_s=motion.ramp_s, heading_deg=heading_deg
    )
    trajectory = build_trajectory(
        motion,
        latitude_rad=np.radians(case.latitude_deg),
        longitude_rad=0.0,
        height_m=0.0,
        duration_s=case.duration_s,
        seed=1,
    )
    log = simulate_imu(
        simulated,
        trajectory,
        start_ns=0,
        duration_s=case.duration_s,
        generator=functools.partial(stream, seed),
    )
    angle, velocity = imu_increments_from_log(simulated, log)
    time_s = np.arange(len(angle) + 1) / simulated.rate_hz
    heading = np.unwrap(trajectory.at(time_s).heading_rad)
    return InertialIncrements(time_s, angle, velocity), heading - heading[0], heading[-1]


def solve(case, increments, table_rad, site, told, seed):
    """The solution of a method."""
    if case.method == "one":
        return align_static(increments, site, errors=told, running=False)
    noisy = ENCODER_SD_RAD * stream(seed, "encoder").standard_normal(len(table_rad))
    if case.method.startswith("carousel"):
        table = table_rad + noisy if "encoder" in case.method else None
        return align_carousel(increments, site, errors=told, table_angle_rad=table, running=False)
    table = np.array([0.0, np.pi]) + noisy[:2] if "encoder" in case.method else None
    return align_positions(increments, site, errors=told, table_angle_rad=table, running=False)


def plain_heading(case, increments, table_rad):
    """Heading at the end from mean rates alone: those of positions, or demodulated at the table's angle."""
    angle = increments.angle_rad
    middle = 0.5 * (table_rad[1:] + table_rad[:-1])
    turned = np.stack(
        [
            np.cos(middle) * angle[:, 0] - np.sin(middle) * angle[:, 1],
            np.sin(middle) * angle[:, 0] + np.cos(middle) * angle[:, 1],
        ],
        axis=1,
    )
    if case.method == "carousel, encoder":
        # Whole turns, in which what is constant in the body is gone.
        whole = np.searchsorted(table_rad, 2.0 * np.pi * np.floor(table_rad[-1] / (2.0 * np.pi)) - 1e-9)
        north, east = turned[:whole].sum(axis=0)
    elif case.method == "two, encoder":
        # Halts of the same length, evenly spread: the mean of the turned means.
        halts = find_halts(increments)
        edges = [np.searchsorted(increments.time_s, np.array(halt) - 1e-6) for halt in halts]
        north, east = np.mean([turned[a:b].mean(axis=0) for a, b in edges], axis=0)
    else:
        return None
    # The table's own axes see the Earth rate to the north: its heading is the opposite of that direction.
    return float(table_rad[-1] - np.arctan2(east, north))


def wrapped_deg(angle_rad):
    """Into -180 to 180 degrees."""
    return float(np.degrees((angle_rad + np.pi) % (2.0 * np.pi) - np.pi))


def run_case(case, draws, seed):
    """All draws of a case."""
    site = Site(np.radians(case.latitude_deg))
    told, _ = sensor_of(case)
    error, sd, nees, plain = [], [], [], []
    begin = time.perf_counter()
    spent = 0.0
    for draw in range(draws):
        own = seed + 1000 * draw
        increments, table_rad, heading = record(case, own, 360.0 * (draw + 0.5) / draws)
        begin = time.perf_counter()
        solution = solve(case, increments, table_rad, site, told, own)
        spent += time.perf_counter() - begin
        truth = rot_ned_from_body(heading, 0.0, 0.0)
        turn = log_so3(solution.rot_ned_from_body @ truth.T)
        error.append(wrapped_deg(heading_pitch_roll(solution.rot_ned_from_body)[0] - heading))
        sd.append(np.degrees(solution.angle_sd_rad[0]))
        nees.append(turn @ np.linalg.solve(solution.cov_ned_rad2, turn))
        other = plain_heading(case, increments, table_rad)
        if other is not None:
            plain.append(wrapped_deg(other - heading))
    predicted = np.nan
    if case.method != "one":
        encoder = ENCODER_SD_RAD if "encoder" in case.method else None
        budget = positions_budget(told, site, plan_of(case)[0], encoder_sd_rad=encoder)
        predicted = float(np.degrees(heading_sd_on_circle(budget.angle_sd_rad()[0])))
    return Outcome(np.array(error), np.array(sd), np.array(nees), predicted, np.array(plain), spent / draws)


def rms(values):
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def equivalent_dph(error_deg, latitude_deg):
    """Gyro bias to the east that would turn the heading by as much, degrees per hour."""
    return np.radians(error_deg) * 15.041 * np.cos(np.radians(latitude_deg))


def cases():
    """Every case of the page."""
    quiet = [Case("FOG 0.01", lat, 240.0, method, True) for lat in (40.0, 60.0) for method in METHODS]
    every, some = METHODS, ("one", "two", "four", "carousel, encoder")
    noisy = [
        Case(sensor, 40.0, 240.0, method)
        for sensor in SENSORS
        for method in (every if sensor in ("FOG 0.01", "industrial") else some)
    ]
    noisy += [Case("FOG 0.01", 40.0, 600.0, method) for method in some]
    noisy += [Case("FOG 0.1", 40.0, 600.0, method) for method in ("one", "two")]
    north = [Case("FOG 0.01", 60.0, 240.0, method) for method in ("one", "two", "carousel, encoder")]
    return quiet, noisy + north


def nees_bounds(draws, level=1e-3):
    """Bounds of the mean NEES of three angles, each side missed with half the level."""
    return tuple(chi2.ppf([0.5 * level, 1.0 - 0.5 * level], 3 * draws) / 3.0 / draws)


def digits(value):
    """Three significant digits, without an exponent."""
    return f"{value:#.3g}".rstrip(".") if value < 1000.0 else f"{value:.0f}"


def page(quiet, noisy, draws, quiet_draws, seed, command):
    """Markdown."""
    low, high = nees_bounds(draws)
    good = 100.0 / np.sqrt(2.0 * draws)
    text = f"""\
# North from several positions and from a carousel

Made by `{command}`,
truenorth {truenorth.__version__}, {DATE}.

A level turntable under the unit; the headings at the start go evenly round the circle, one to each draw. One
position: the orthonormal two-vector alignment (`align_static`). Two and four positions: halts of the same
length, with turns of {TURN_S:.0f} s between them that the gyro measures (with its scale error), or an encoder
of 5 arc seconds. Carousel: {SPIN_DPS:.0f} deg/s throughout, with the encoder; or to and fro without one (a
quarter of the time one way, half of it back, a quarter as at first). The total time is the same for all.

FOG 0.1 is the unit of Oguz (2006): gyro bias 1 deg/h, random walk 0.1 deg/sqrt(h), scale 500 ppm,
misalignment 1 mrad (what he calls its stability), accelerometers of 1 mg, 0.2 mg and 250 ug/sqrt(Hz);
instability of the gyro 0.05 deg/h is ours. FOG 0.01 has the same bias, scale and misalignment, a tenth of the
random walk, an instability of 0.01 deg/h, and accelerometers of 1 mg, 20 ug and 0.06 m/s/sqrt(h). tactical
and industrial are grades of `ImuDescription` (gyro bias 4 and 70 deg/h, instability 0.5 and 7 deg/h).

## What is left of a bias of 1 deg/h

Constant errors only: biases, scale errors and misalignments of FOG 0.01 as drawn, without noise or
instability; {quiet_draws} draws of 240 s. The estimator is told the errors of FOG 0.01 with its noise, so its
gains are those of the noisy case. Equivalent: the bias of an east gyro that would turn the heading by as
much. The demand is 0.05 deg/h.

| latitude | method | rms heading error, deg | equivalent, deg/h |
| --- | --- | --- | --- |"""
    lines = text.splitlines()
    for case, found in quiet.items():
        error = rms(found.error_deg)
        lines.append(
            f"| {case.latitude_deg:.0f} | {case.method} | {digits(error)} | "
            f"{digits(equivalent_dph(error, case.latitude_deg))} |"
        )
    text = f"""
## With all errors

{draws} draws each. Predicted: `positions_budget` before the fact. Stated: mean of the solutions' sigma. NEES
of the three angles, divided by three: within {low:.2f} and {high:.2f} with a probability of 99.9 % where
covariances are right and errors small. An rms of {draws} draws is good to {good:.0f} % (one sigma). The draws
of a sensor are the same units in every row. Above some 30 deg of heading nothing is linear, and sigma is that
of an angle on the circle, of which 104 deg says nothing at all.

| sensor | latitude | s | method | predicted, deg | stated, deg | rms, deg | NEES/3 | equivalent, deg/h |
| --- | --- | --- | --- | --- | --- | --- | --- | --- |"""
    lines += text.splitlines()
    for case, found in noisy.items():
        error = rms(found.error_deg)
        predicted = "" if np.isnan(found.predicted_deg) else digits(found.predicted_deg)
        nees = np.mean(found.nees) / 3.0
        lines.append(
            f"| {case.sensor} | {case.latitude_deg:.0f} | {case.duration_s:.0f} | {case.method} | "
            f"{predicted} | {digits(np.mean(found.sd_deg))} | {digits(error)} | {nees:.2f} | "
            f"{digits(equivalent_dph(error, case.latitude_deg))} |"
        )
    text = """
What remains after the turns is noise: a random walk of 0.1 deg/sqrt(h) alone leaves 0.39 deg/h in the mean of
240 s, so that no turning brings FOG 0.1 below 0.05 deg/h in this time; with 0.01 deg/sqrt(h) all of them do.
A bias that wanders (industrial) wants turns faster than it wanders: there the carousel is better than two
positions by more than twice.

## The estimator

The same records by mean rates alone, rms heading error in degrees. Two: the mean over the halts of the mean
rates turned by the angle of the table; carousel: the horizontal rates demodulated at that angle over whole
turns. Both take the table for level. Least squares, the default, is as good or better in every row, most
where the bias wanders.

| sensor | time, s | method | least squares | mean rates |
| --- | --- | --- | --- | --- |"""
    lines += text.splitlines()
    for case, found in noisy.items():
        if len(found.plain_deg) and case.latitude_deg == 40.0:
            lines.append(
                f"| {case.sensor} | {case.duration_s:.0f} | {case.method} | {digits(rms(found.error_deg))} | "
                f"{digits(rms(found.plain_deg))} |"
            )
    return "\n".join(lines)


DATE = date(2026, 11, 23).isoformat()


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=100)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    quiet_draws = max(1, options.draws // 5)
    quiet, noisy = cases()
    with ProcessPoolExecutor(options.jobs) as pool:
        first = [pool.submit(run_case, case, quiet_draws, options.seed) for case in quiet]
        second = [pool.submit(run_case, case, options.draws, options.seed) for case in noisy]
        found = []
        for case, future in zip(quiet + noisy, first + second, strict=True):
            found.append(future.result())
            print(
                case, rms(found[-1].error_deg), f"{found[-1].seconds:.2f} s each", file=sys.stderr, flush=True
            )
    command = (
        f"python tools/study_multi_position.py --draws {options.draws} --seed {options.seed} "
        f"--out docs/validation/multi_position.md"
    )
    quiet_found = dict(zip(quiet, found[: len(quiet)], strict=True))
    noisy_found = dict(zip(noisy, found[len(quiet) :], strict=True))
    text = page(quiet_found, noisy_found, options.draws, quiet_draws, options.seed, command)
    options.out.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
