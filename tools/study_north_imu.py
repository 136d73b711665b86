"""The eight attitudes of Oguz 2006 in simulation, beside the published errors and the published bound.

    python tools/study_north_imu.py --out docs/validation

Writes ``oguz_imu.md`` and its figure ``oguz_imu.png``; about a minute. Units drawn with the stated errors are
put into the eight attitudes at the stated latitude, their means are aligned, and the errors are compared with
the published ones, with the bound and with the budget. Everything follows from the seed.
"""

import argparse
import platform
import sys
import textwrap
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import NamedTuple

import numpy as np

import truenorth
from truenorth.northfinding import Site
from truenorth.northfinding.budget import (
    accelerometer_sensitivity,
    gyro_sensitivity,
    heading_sd_against_latitude,
    heading_sd_on_circle,
    latitude_sensitivity,
    matrix_sensitivity,
    published_bound_rad,
    static_budget,
)
from truenorth.northfinding.static import align_static
from truenorth.rotations import log_so3, rot_ned_from_body
from truenorth.sensors.imu import ImuDescription, imu_increments_from_log, simulate_imu
from truenorth.simulation.motion import StaticMotion, build_trajectory
from truenorth.simulation.randomness import stream
from truenorth.strapdown import InertialIncrements

LATITUDE_DEG = 39.0 + 55.0 / 60.0
PLACE_DEG_M = (LATITUDE_DEG, 32.78, 900.0)
"""Printed latitude; the rest stands for Ankara."""

SENSOR = ImuDescription(
    name="oguz",
    grade="tactical",
    rate_hz=10.0,
    output="rates",
    gyro_bias_sd_dph=1.0,
    gyro_bias_instability_dph=0.0,
    gyro_random_walk_deg_per_sqrt_h=0.1,
    gyro_bias_walk_dph_per_sqrt_h=0.0,
    gyro_scale_sd_ppm=500.0,
    gyro_misalignment_sd_mrad=1.0,
    gyro_g_sensitivity_dph_per_g=0.0,
    gyro_range_dps=1000.0,
    gyro_resolution_dps=0.0,
    accel_bias_sd_ug=1000.0,
    accel_bias_instability_ug=0.0,
    # 250 ug/sqrt(Hz), over a minute.
    accel_random_walk_mps_per_sqrt_h=250e-6 * 9.80665 * 60.0,
    accel_bias_walk_ug_per_sqrt_h=0.0,
    accel_scale_sd_ppm=500.0,
    accel_misalignment_sd_mrad=0.0,
    accel_range_g=10.0,
    accel_resolution_ug=0.0,
)
"""The stated fibre-optic gyros and accelerometers."""


class Attitude(NamedTuple):
    """One of the eight: axes, heading and roll, and what was published."""

    axes: str
    heading_deg: float
    roll_deg: float
    roll_error_deg: float
    pitch_error_deg: float
    heading_error_deg: float


ATTITUDES = (
    Attitude("W / N / D", -90.0, 0.0, -0.1211, -0.0394, -3.1806),
    Attitude("N / E / D", 0.0, 0.0, -0.1058, -0.0051, -1.8492),
    Attitude("E / S / D", 90.0, 0.0, -0.0704, -0.0142, 4.9229),
    Attitude("S / W / D", 180.0, 0.0, -0.0808, -0.0472, -4.1418),
    Attitude("W / Up / N", -90.0, -90.0, -0.1449, -0.0103, -1.3591),
    Attitude("N / Up / E", 0.0, -90.0, -0.1328, 0.0217, 1.0726),
    Attitude("E / Up / S", 90.0, -90.0, -0.0984, 0.0106, -1.1784),
    Attitude("S / Up / W", 180.0, -90.0, -0.1093, -0.0221, 0.1632),
)

SOURCES = (
    "gyro bias", "angle random walk", "gyro misalignment", "accelerometer bias", "velocity random walk"
)  # fmt: skip
TIMES_S = (10.0, 60.0, 300.0, 1800.0)
LATITUDES_DEG = (0.0, 20.0, LATITUDE_DEG, 60.0, 75.0, 85.0, 88.0, 89.5)
INJECTED_LATITUDES_DEG = (-60.0, 0.0, LATITUDE_DEG, 80.0)
INJECTED_ATTITUDES_DEG = (
    *((attitude.heading_deg, 0.0, attitude.roll_deg) for attitude in ATTITUDES),
    (130.0, 15.0, -25.0),
    (250.0, -40.0, 70.0),
)


@dataclass
class Found:
    """Errors of the estimates and what was predicted, degrees."""

    error: np.ndarray
    published: np.ndarray
    sd: np.ndarray
    non_orthonormality: np.ndarray


def wrapped(angle_deg):
    """Angles in [-180, 180)."""
    return (np.asarray(angle_deg) + 180.0) % 360.0 - 180.0


def unit_generator(seed, unit, turn):
    """Random streams of one unit: its constant errors stay, its noise is new in every record."""

    def generator(sensor, purpose, *more):
        own = (seed, unit) if purpose in ("bias", "matrix", "g_sensitivity") else (seed, unit, turn)
        return stream(*own, sensor, purpose, *more)

    return generator


def records(site, heading_deg, roll_deg, duration_s, seed, units, turn):
    """Increments of each unit at rest; units is a range of their numbers."""
    trajectory = build_trajectory(
        StaticMotion(heading_deg=heading_deg, roll_deg=roll_deg),
        latitude_rad=site.latitude_rad, longitude_rad=site.longitude_rad, height_m=site.height_m,
        duration_s=duration_s, seed=seed,
    )  # fmt: skip
    for unit in units:
        log = simulate_imu(
            SENSOR, trajectory, start_ns=0, duration_s=duration_s, generator=unit_generator(seed, unit, turn)
        )
        angle, velocity = imu_increments_from_log(SENSOR, log)
        yield InertialIncrements(np.arange(len(angle) + 1) / SENSOR.rate_hz, angle, velocity)


def aligned(site, heading_deg, roll_deg, duration_s, seed, units, turn):
    """Errors of heading, pitch and roll of both forms for each unit in one attitude."""
    truth = np.array([heading_deg, 0.0, roll_deg])
    error, published, skewed = [], [], []
    for increments in records(site, heading_deg, roll_deg, duration_s, seed, units, turn):
        error.append(np.degrees(align_static(increments, site, running=False).angles_rad) - truth)
        direct = align_static(increments, site, form="published", running=False).measured
        published.append(direct["published_heading_deg"] - heading_deg)
        skewed.append(direct["non_orthonormality"])
    rot = rot_ned_from_body(*np.radians(truth))
    # No deflection of the vertical is simulated.
    budget = static_budget(SENSOR, rot, site, duration_s, deflection_sd_rad=0.0)
    return Found(wrapped(error), wrapped(published), np.degrees(budget.angle_sd_rad()), np.array(skewed))


def eight_attitudes(seed, units, duration_s):
    """`Found` of every attitude, the same units in all."""
    site = Site(*np.radians(PLACE_DEG_M[:2]), PLACE_DEG_M[2])
    return [
        aligned(site, attitude.heading_deg, attitude.roll_deg, duration_s, seed, range(units), turn)
        for turn, attitude in enumerate(ATTITUDES)
    ]


def at_latitudes(seed, units, duration_s):
    """Errors of the heading of a level body towards north, others at each latitude, shape (k, units)."""
    errors = []
    for k, latitude in enumerate(LATITUDES_DEG):
        numbers = range(100_000 * (k + 1), 100_000 * (k + 1) + units)
        errors.append(
            aligned(Site(np.radians(latitude)), 0.0, 0.0, duration_s, seed, numbers, 100).error[:, 0]
        )
    return np.array(errors)


def injected(rot, site, form, *, rate=None, force=None, latitude_rad=0.0):
    """Small rotation in north, east, down that errors of rate and force cause, even part removed."""

    def turned(sign):
        true_rate, true_force = site.earth_rate_ned_radps @ rot, site.force_ned_mps2 @ rot
        there = Site(site.latitude_rad + sign * latitude_rad)
        increments = InertialIncrements(
            np.arange(2.0),
            (true_rate + sign * (0.0 if rate is None else rate))[None],
            (true_force + sign * (0.0 if force is None else force))[None],
        )
        found = align_static(increments, there, form=form, running=False)
        return log_so3(found.rot_ned_from_body @ rot.T)

    return 0.5 * (turned(1.0) - turned(-1.0))


DPH = np.radians(1.0 / 3600.0)
MILLI_G = 9.80665e-3


def injections(site, rot):
    """Name, injected error of rate and force, and error of latitude, in the axes of the body."""
    axes = ("forward", "right", "down")
    rate, force = site.earth_rate_ned_radps @ rot, site.force_ned_mps2 @ rot
    for j, axis in enumerate(axes):
        yield f"gyro bias {axis}, 1°/h", {"rate": DPH * np.eye(3)[j]}
    for j, axis in enumerate(axes):
        yield f"accelerometer bias {axis}, 1 mg", {"force": MILLI_G * np.eye(3)[j]}
    for j, axis in enumerate(axes):
        for k, other in enumerate(axes):
            what, size = ("scale", 500e-6) if j == k else (f"sees {other}", 1e-3)
            unit = "500 ppm" if j == k else "1 mrad"
            yield f"gyro {axis} {what}, {unit}", {"rate": size * rate[k] * np.eye(3)[j]}
            yield f"accelerometer {axis} {what}, {unit}", {"force": size * force[k] * np.eye(3)[j]}
            yield f"gyro {axis} by force {other}, 1°/h/g", {"rate": DPH * force[k] / 9.80665 * np.eye(3)[j]}
    yield "latitude, 1′", {"latitude_rad": np.radians(1.0 / 60.0)}


def predicted(rot, site, form, name, sizes):
    """Small rotation by the analytic sensitivities; matrices by `matrix_sensitivity`."""
    axes = ("forward", "right", "down")
    by_rate = gyro_sensitivity(rot, site, form=form)
    by_force = accelerometer_sensitivity(rot, site, form=form)
    if "latitude_rad" in sizes:
        return sizes["latitude_rad"] * latitude_sensitivity(form=form)
    j = axes.index(name.split(" bias ")[-1].split(",")[0] if " bias " in name else name.split()[1])
    if " bias " in name:
        return DPH * by_rate[:, j] if "rate" in sizes else MILLI_G * by_force[:, j]
    k = j if " scale" in name else axes.index(name.split(",")[0].split()[-1])
    if " by force " in name:
        return DPH / 9.80665 * matrix_sensitivity(by_rate, site.force_ned_mps2 @ rot)[:, j, k]
    by, sensed = (by_rate, site.earth_rate_ned_radps) if "rate" in sizes else (by_force, site.force_ned_mps2)
    return (500e-6 if j == k else 1e-3) * matrix_sensitivity(by, sensed @ rot)[:, j, k]


def worst_disagreements(form):
    """Largest difference of injected and predicted rotations by kind of error, and the largest rotation."""
    worst = {}
    for latitude in INJECTED_LATITUDES_DEG:
        site = Site(np.radians(latitude))
        pairs = {}
        for angles in INJECTED_ATTITUDES_DEG:
            rot = rot_ned_from_body(*np.radians(angles))
            for name, sizes in injections(site, rot):
                # A hundredth of the stated sizes keeps cubes below 1e-5.
                small = {key: 0.01 * value for key, value in sizes.items()}
                pair = (100.0 * injected(rot, site, form, **small), predicted(rot, site, form, name, sizes))
                kind = kind_of(name)
                pairs.setdefault(kind, []).append(pair)
        for kind, values in pairs.items():
            got, said = (np.array(part) for part in zip(*values, strict=True))
            difference, largest = np.abs(got - said).max(), np.abs(said).max()
            old = worst.get(kind, (0.0, 0.0))
            worst[kind] = (max(old[0], difference), max(old[1], largest))
    return worst


def kind_of(name):
    """Which kind of error a name belongs to."""
    sensor = name.split()[0]
    if name.startswith("latitude"):
        return "latitude, 1′"
    size = name.partition(", ")[2]
    words = {"bias": "bias", "scale": "scale", "sees": "misalignment", "by force": "g-sensitivity"}
    for word, kind in words.items():
        if word in name:
            return f"{sensor} {kind}, {size}"
    raise ValueError(name)


def paragraph(text):
    """Lines of a paragraph and an empty one."""
    return [*textwrap.wrap(" ".join(text.split()), 110, break_long_words=False, break_on_hyphens=False), ""]


def table(head, rows):
    """Lines of a table, the first column to the left."""
    lines = ["| " + " | ".join(head) + " |", "| --- |" + " ---: |" * (len(head) - 1)]
    return [*lines, *("| " + " | ".join(row) + " |" for row in rows), ""]


def rms(values, axis=None):
    """Root mean square."""
    return np.sqrt(np.mean(np.square(values), axis=axis))


def attitude_rows(found, bound_deg):
    """Rows of the table of the eight attitudes."""
    for k, (attitude, one) in enumerate(zip(ATTITUDES, found, strict=True)):
        heading = one.error[:, 0]
        yield [
            str(k + 1),
            attitude.axes,
            f"{attitude.heading_error_deg:.2f}",
            f"{np.mean(np.abs(heading) < abs(attitude.heading_error_deg)):.0%}",
            f"{heading.mean():.2f}",
            f"{rms(heading):.2f}",
            f"{one.sd[0]:.2f}",
            f"{rms(one.published):.2f}",
            f"{np.abs(heading).max():.1f}",
            f"{np.mean(np.abs(heading) <= bound_deg):.0%}",
            f"{rms(one.error[:, 1]):.3f} / {rms(one.error[:, 2]):.3f}",
            f"{one.sd[1]:.3f} / {one.sd[2]:.3f}",
            f"{attitude.pitch_error_deg:.3f} / {attitude.roll_error_deg:.3f}",
        ]


def units_part(found):
    """Sentences on one unit in all eight attitudes."""
    error = np.stack([one.error[:, 0] for one in found], axis=1)
    unit_rms, unit_max = rms(error, axis=1), np.abs(error).max(axis=1)
    published = np.array([attitude.heading_error_deg for attitude in ATTITUDES])
    halves = 0.5 * (published[2] - published[0]), 0.5 * (published[3] - published[1])
    means = published[[0, 2]].mean(), published[[1, 3]].mean()
    scale = np.degrees(1.0 / 15.041067 / np.cos(np.radians(LATITUDE_DEG)))
    forward, right = -halves[0] / scale, halves[1] / scale
    quartiles = np.percentile(unit_rms, (10, 50, 90))
    largest = np.percentile(unit_max, (10, 50, 90))
    return table(
        ["one unit in eight attitudes", "10 %", "median", "90 %", "published", "units below it"],
        [
            ["rms, °", *(f"{value:.2f}" for value in quartiles), f"{rms(published):.2f}",
             f"{np.mean(unit_rms < rms(published)):.0%}"],
            ["largest, °", *(f"{value:.2f}" for value in largest), f"{np.abs(published).max():.2f}",
             f"{np.mean(unit_max < np.abs(published).max()):.0%}"],
        ],
    ) + paragraph(
        f"""The published errors are those of a unit better than its data sheet. Half the difference of
        opposite headings is what a bias of the gyros does: {halves[0]:+.2f}° between 3 and 1 and
        {halves[1]:+.2f}° between 4 and 2, that is {forward:+.2f} °/h forward and {right:+.2f} °/h right. The
        means of the same pairs, {means[0]:+.2f}° and {means[1]:+.2f}°, no bias leaves: noise, drift between
        the records, or the fixture."""
    )  # fmt: skip


def times_part(site):
    """Table of the budget against averaging time."""
    rows = []
    for time_s in TIMES_S:
        budget = static_budget(SENSOR, np.eye(3), site, time_s, deflection_sd_rad=0.0)
        by = {line.source: np.degrees(budget.angle_sd_rad(line)[0]) for line in budget.lines}
        whole = np.degrees(budget.angle_sd_rad()[0])
        rows.append([f"{time_s:.0f}", *(f"{by[name]:.3f}" for name in SOURCES), f"{whole:.2f}"])
    return table(["averaging, s", *SOURCES, "all"], rows)


def latitude_rows(errors, duration_s):
    """Rows of the table against latitude."""
    latitudes = np.radians(LATITUDES_DEG)
    linear, circle = (
        np.degrees(heading_sd_against_latitude(
            SENSOR, np.eye(3), latitudes, duration_s, linear=straight, deflection_sd_rad=0.0
        ))
        for straight in (True, False)
    )  # fmt: skip
    for k, latitude in enumerate(LATITUDES_DEG):
        yield [
            f"{latitude:.2f}",
            f"{np.degrees(published_bound_rad(latitudes[k])):.2f}",
            f"{linear[k]:.2f}",
            f"{circle[k]:.2f}",
            f"{rms(errors[k]):.2f}",
            f"{np.mean(np.abs(errors[k]) <= np.degrees(published_bound_rad(latitudes[k]))):.0%}",
        ]


def figure(errors, duration_s, path):
    """The bound and the errors against latitude."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    fig = Figure(figsize=(7.2, 4.2), dpi=100, layout="constrained")
    FigureCanvasAgg(fig)
    ax = fig.add_subplot()
    latitude = np.concatenate([np.linspace(0.0, 80.0, 81), np.linspace(80.5, 89.8, 94)])
    rot = np.eye(3)
    linear = heading_sd_against_latitude(
        SENSOR, rot, np.radians(latitude), duration_s, linear=True, deflection_sd_rad=0.0
    )
    ax.plot(latitude, np.degrees(linear), color="#0072B2", label="σ, first order")
    ax.plot(latitude, np.degrees(heading_sd_on_circle(linear)), color="#009E73", label="σ, on the circle")
    bound = np.degrees(published_bound_rad(np.radians(latitude)))
    ax.plot(latitude, bound, color="#D55E00", linestyle="--", label="published bound (6.22)")
    ax.plot(LATITUDES_DEG, rms(errors, axis=1), "o", color="black", label=f"rms of {errors.shape[1]} units")
    ax.axhline(180.0 / np.sqrt(3.0), color="#999999", linewidth=0.8, linestyle=":", label="any direction")
    published = [abs(attitude.heading_error_deg) for attitude in ATTITUDES]
    ax.plot(np.full(8, LATITUDE_DEG), published, "x", color="#CC79A7", label="published errors")
    ax.set(
        yscale="log", ylim=(0.1, 1000.0), xlim=(0.0, 90.0), xlabel="latitude, °", ylabel="heading error, °"
    )
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8, loc="upper left")
    fig.savefig(path, metadata={"Software": None})


def injection_part():
    """Tables of the injected errors."""
    site = Site(np.radians(LATITUDE_DEG))
    rows = []
    north, upright = (rot_ned_from_body(*np.radians(INJECTED_ATTITUDES_DEG[k])) for k in (1, 4))
    for (name, at_north), (_, at_upright) in zip(
        injections(site, north), injections(site, upright), strict=True
    ):
        cells, shown = [name], False
        for rot, sizes in ((north, at_north), (upright, at_upright)):
            got = np.degrees(injected(rot, site, "orthonormal", **sizes))
            said = np.degrees(predicted(rot, site, "orthonormal", name, sizes))
            shown = shown or bool(np.abs(said).max() > 5e-5)
            cells += [" / ".join(f"{value + 0.0:.4f}" for value in part) for part in (got, said)]
        if shown:
            rows.append([cell.replace("-0.0000", "0.0000") for cell in cells])
    worst = {form: worst_disagreements(form) for form in ("orthonormal", "published")}
    kinds = [
        [kind, f"{np.degrees(largest):.4f}", f"{np.degrees(off):.1e}",
         f"{np.degrees(worst['published'][kind][1]):.4f}", f"{np.degrees(worst['published'][kind][0]):.1e}"]
        for kind, (off, largest) in worst["orthonormal"].items()
    ]  # fmt: skip
    latitudes = ", ".join(f"{value:.4g}°" for value in INJECTED_LATITUDES_DEG)
    tilted = "; ".join(
        "heading {:.0f}°, pitch {:.0f}°, roll {:.0f}°".format(*angles)
        for angles in INJECTED_ATTITUDES_DEG[len(ATTITUDES) :]
    )
    return [
        "## One error at a time",
        "",
        *paragraph(f"""Each error injected alone into ideal means, and the rotation that follows (half the
            difference of both signs) beside the analytic sensitivity: north / east / down, degrees; down is
            the error of the heading. Latitude {LATITUDE_DEG:.2f}°, attitudes 2 and 5 of the table above;
            errors that turn neither by 5e-5° are left out."""),
        *table(["error", "2: injected", "2: analytic", "5: injected", "5: analytic"], rows),
        *paragraph(f"""Differences at latitudes {latitudes}, in the eight attitudes and two tilted ones
            ({tilted}), for every element; a hundredth of the size is injected and the result scaled up.
            Degrees; both forms. With the latitude the published form also takes another normal gravity, which
            changes its turn by another 1 %."""),
        *table(["error", "largest turn", "largest difference", "published form, turn", "difference"], kinds),
    ]


def page(found, errors, seed, units, duration_s, latitude_units):
    """The whole page."""
    site = Site(np.radians(LATITUDE_DEG))
    bound = np.degrees(published_bound_rad(site.latitude_rad))
    rss = np.degrees(published_bound_rad(site.latitude_rad, rss=True))
    printed = np.degrees(published_bound_rad(np.radians(39.0), earth_rate_dph=15.0))
    every = np.concatenate([one.error[:, 0] for one in found])
    normal = inside_share(found, bound)
    nees = np.mean([(one.error[:, 0] / one.sd[0]) ** 2 for one in found])
    skewed = np.median([one.non_orthonormality for one in found])
    versions = (
        f"truenorth {truenorth.__version__}, NumPy {np.__version__}, Python {platform.python_version()}"
    )
    command = (
        f"python tools/study_north_imu.py --seed {seed} --units {units} --duration {duration_s:.0f}"
        f" --latitude-units {latitude_units} --out docs/validation"
    )
    return "\n".join([
        "# Static alignment: the eight attitudes of Oguz 2006",
        "",
        f"Made by `{command}`",
        f"on {date.today()}: {versions}.",
        "",
        *paragraph("""P. Oguz, M.Sc. thesis, Middle East Technical University (2006), sec. 6: means of three
            gyros and three accelerometers on a three-axis table in eight attitudes, the azimuth by the direct
            form, and a bound of its error. The published errors are measurements of one unit; how long was
            averaged is not said. Here units are drawn with the stated errors and put into the same
            attitudes."""),
        "## Sensor and bound",
        "",
        *paragraph(f"""Gyros: bias 1 °/h, angle random walk 0.1 °/√h, scale 500 ppm, misalignment 1 mrad (the
            stated stability; the absolute 10 mrad are taken as calibrated). Accelerometers: bias 1 mg, scale
            500 ppm, noise 250 µg/√Hz. All one sigma, latitude 39°55′. The bound (6.22), a gyro bias plus an
            accelerometer bias of one sigma each, is printed as 4.9615°; its stated inputs give {bound:.4f}°
            (as a root of squares {rss:.3f}°), and latitude 39.0° with 15.0 °/h gives {printed:.4f}°. It is no
            bound but about one sigma, and leaves out the angle random walk, which rules when the averaging is
            short. Heading of a level body towards north by source, one sigma, degrees:"""),
        *times_part(site),
        "## Eight attitudes",
        "",
        *paragraph(f"""{units} units, the same in all attitudes, {duration_s:.0f} s each at
            {SENSOR.rate_hz:.0f} Hz. Estimates with gravity exact; the column `direct form` is the rms of the
            azimuth as published (6.10). Inside is the share of errors within {bound:.2f}°; a normal error of
            the predicted σ would have {normal:.0%}. Degrees."""),
        *table(
            ["#", "X / Y / Z", "published error", "units below it", "mean", "rms", "predicted σ",
             "direct form, rms", "largest", "inside", "pitch / roll, rms", "predicted σ",
             "published pitch / roll error"],
            attitude_rows(found, bound),
        ),
        *paragraph(f"""All attitudes: heading rms {rms(every):.2f}°, inside the bound
            {np.mean(np.abs(every) <= bound):.0%}, mean of the squared error over the predicted variance
            {nees:.2f} (the units are the same in all attitudes, so this has the scatter of {units} units
            rather than of {8 * units} errors). Non-orthonormality of the direct matrix: median
            {skewed:.3f}."""),
        *units_part(found),
        "## Latitude",
        "",
        *paragraph(f"""A level body towards north, {duration_s:.0f} s, {latitude_units} other units at each
            latitude. To first order the error grows as 1/cos of the latitude and is singular at the pole; the
            error of a direction is not, and ends at 103.9°, where any direction is as likely
            (`heading_sd_on_circle`)."""),
        *table(
            ["latitude, °", "bound (6.22), °", "σ first order, °", "σ on the circle, °", "rms of units, °",
             "inside the bound"],
            latitude_rows(errors, duration_s),
        ),
        "![Heading error against latitude](oguz_imu.png)",
        "",
        *injection_part(),
    ]).rstrip() + "\n"  # fmt: skip


def inside_share(found, bound_deg):
    """Share of normal errors of the predicted standard deviations within the bound."""
    from scipy.special import erf

    return float(np.mean([erf(bound_deg / one.sd[0] / np.sqrt(2.0)) for one in found]))


def main():
    """Make the page and its figure."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, default=2006)
    parser.add_argument("--units", type=int, default=200)
    parser.add_argument("--duration", type=float, default=300.0, help="seconds of averaging (default 300)")
    parser.add_argument("--latitude-units", type=int, default=400)
    parser.add_argument("--out", type=Path, help="folder of the page; without it it is printed only")
    given = parser.parse_args()
    found = eight_attitudes(given.seed, given.units, given.duration)
    errors = at_latitudes(given.seed, given.latitude_units, given.duration)
    text = page(found, errors, given.seed, given.units, given.duration, given.latitude_units)
    if given.out is None:
        sys.stdout.write(text)
        return
    (given.out / "oguz_imu.md").write_text(text, encoding="utf-8")
    figure(errors, given.duration, given.out / "oguz_imu.png")


if __name__ == "__main__":
    main()
