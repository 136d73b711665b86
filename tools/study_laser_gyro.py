"""North from the public log of a laser-gyro unit in a parked, disturbed vehicle: every window and form.

    python tools/study_laser_gyro.py --out docs/validation

Needs the real data (`TRUENORTH_DATA`). About ten minutes on one core with the defaults; no random numbers.
"""

import argparse
import os
import platform
import sys
import textwrap
import time
from datetime import date
from pathlib import Path

import numpy as np

import truenorth
from truenorth.formats.imu_table import read_imu_table
from truenorth.northfinding import Site
from truenorth.northfinding.inertial import FORMS, align_inertial, estimate_latitude
from truenorth.northfinding.static import align_static
from truenorth.sensors import ImuDescription
from truenorth.strapdown import InertialIncrements, compress_increments

LOG = "imu_laser_gyro/lasergyro.imu.gz"
TRUE_HEADING_DEG = 90.602
LENGTHS_S = (60, 120, 300, 600)
SEEN_WALK_DEG_PER_SQRT_H = 0.0005
"""What the whole record shows of the gyros, rounded; stated where a row says so."""

NOISE_ONLY = ImuDescription(
    grade="navigation",
    gyro_random_walk_deg_per_sqrt_h=SEEN_WALK_DEG_PER_SQRT_H,
    accel_random_walk_mps_per_sqrt_h=0.003,
    **dict.fromkeys(
        (
            "gyro_bias_sd_dph", "gyro_bias_instability_dph", "gyro_scale_sd_ppm", "gyro_misalignment_sd_mrad",
            "gyro_g_sensitivity_dph_per_g", "gyro_resolution_dps", "accel_bias_sd_ug",
            "accel_bias_instability_ug", "accel_scale_sd_ppm", "accel_misalignment_sd_mrad",
            "accel_resolution_ug",
        ),
        0.0,
    ),
)  # fmt: skip


def part(increments, first, number):
    """So many intervals from the first one."""
    last = first + number
    return InertialIncrements(
        increments.time_s[first : last + 1],
        increments.angle_rad[first:last],
        increments.velocity_mps[first:last],
        None if increments.position_m is None else increments.position_m[first:last],
    )


def heading_errors(blocks, length_s, step_s, align):
    """Error and stated standard deviation of the heading of every window, degrees, shape (2, n)."""
    rows = []
    for first in range(0, len(blocks.angle_rad) - length_s + 1, step_s):
        found = align(part(blocks, first, length_s))
        error = np.degrees(found.heading_rad) - TRUE_HEADING_DEG
        rows.append(((error + 180.0) % 360.0 - 180.0, np.degrees(found.angle_sd_rad[0])))
    return np.array(rows).T


def table(head, rows):
    """Markdown."""
    align = "| --- |" + " ---: |" * (len(head) - 1)
    return "\n".join(
        ["| " + " | ".join(head) + " |", align, *("| " + " | ".join(row) + " |" for row in rows)]
    )


def scatter_row(name, length_s, errors, sd):
    """One row of the table of windows."""
    size = np.abs(errors)
    return (
        name, str(length_s), str(len(errors)), f"{np.median(size):.4f}", f"{np.max(size):.4f}",
        f"{np.std(errors):.4f}", f"{np.mean(errors):+.4f}", f"{np.median(sd):.4f}",
        f"{np.sqrt(np.mean((errors / sd) ** 2)):.2f}",
    )  # fmt: skip


HEAD = (
    "form", "window, s", "windows", "median, °", "largest, °", "scatter, °", "mean, °", "stated σ, °",
    "rms error / σ",
)  # fmt: skip


def every_form(blocks, site, step_s):
    """Rows of all forms and of plain averaging."""
    methods = {name: {"form": name} for name in FORMS}
    methods["velocity-fit, noise stated"] = {"form": "velocity-fit", "errors": NOISE_ONLY}
    methods["weighted, noise stated"] = {"form": "weighted", "errors": NOISE_ONLY}
    rows = []
    for name, options in methods.items():
        for length_s in LENGTHS_S:
            found = heading_errors(
                blocks,
                length_s,
                step_s,
                lambda of: align_inertial(of, site, running=False, **options),  # noqa: B023
            )
            rows.append(scatter_row(name, length_s, *found))
    for length_s in LENGTHS_S:
        found = heading_errors(blocks, length_s, step_s, lambda of: align_static(of, site, running=False))
        rows.append(scatter_row("plain averaging", length_s, *found))
    return rows


def every_second(blocks, site):
    """Rows of the default, a window starting every second, and the errors of the windows of 300 s."""
    rows, kept = [], None
    for length_s in LENGTHS_S:
        found = heading_errors(blocks, length_s, 1, lambda of: align_inertial(of, site, running=False))
        rows.append(scatter_row("velocity-fit", length_s, *found))
        if length_s == 300:
            kept = found
    return rows, kept


def interval_rows(increments, site, step_s):
    """The default with other intervals."""
    samples_per_s = round(1.0 / np.median(np.diff(increments.time_s)))
    rows = []
    for samples in (10, 20, 50, 100, 200, 500):
        blocks = compress_increments(increments, samples)
        interval_s = samples / samples_per_s
        row = [f"{interval_s:g}"]
        for length_s in (120, 300):
            number, step = round(length_s / interval_s), max(1, round(step_s / interval_s))
            errors = []
            for first in range(0, len(blocks.angle_rad) - number + 1, step):
                window = part(blocks, first, number)
                found = align_inertial(window, site, running=False, interval_s=interval_s)
                errors.append(abs(np.degrees(found.heading_rad) - TRUE_HEADING_DEG))
            row += [f"{np.median(errors):.4f}", f"{np.max(errors):.4f}"]
        rows.append(tuple(row))
    return rows


def seconds(action, repeats):
    """Shortest time of an action."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return min(times)


def timing_rows(path, increments, site):
    """How long it takes, from samples of 100 Hz."""
    rows = [("reading the file", f"{seconds(lambda: read_imu_table(path), 3):.2f} s")]
    for length_s in (120, 300):
        window = part(increments, 10_000, length_s * 100)
        for form in ("velocity-fit", "weighted"):
            taken = seconds(lambda: align_inertial(window, site, form=form), 5)  # noqa: B023
            rows.append((f"window of {length_s} s, {form}, after every second", f"{1e3 * taken:.0f} ms"))
    for form in FORMS:
        taken = seconds(lambda: align_inertial(increments, site, form=form), 3)  # noqa: B023
        rows.append((f"whole file, {form}, after every second", f"{taken:.2f} s"))
    return rows


def draw(path, increments, site, every):
    """Convergence from the start of the record, and windows of 300 s by their start."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    fig, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.0), layout="constrained")
    shown = ("two-velocities", "velocity-optimised", "weighted", "velocity-fit")
    for form in shown:
        run = align_inertial(increments, site, form=form).run
        error = np.abs(np.degrees(run.angles_rad[:, 0]) - TRUE_HEADING_DEG)
        (line,) = left.loglog(run.time_s, error, lw=1.0, label=form)
        if form == "velocity-fit":
            left.loglog(run.time_s, np.degrees(run.sd_rad[:, 0]), "--", color=line.get_color(), label="its σ")
    run = align_static(increments, site).run
    error = np.abs((np.degrees(run.angles_rad[:, 0]) - TRUE_HEADING_DEG + 180.0) % 360.0 - 180.0)
    left.loglog(run.time_s, error, lw=1.0, color="0.6", label="plain averaging")
    left.set(
        xlabel="time since the start, s",
        ylabel="error of the heading, °",
        ylim=(1e-3, 200.0),
        xlim=(8.0, None),
    )
    left.legend(fontsize="small", loc="lower left")
    errors, sd = every
    start = np.arange(len(errors))
    right.fill_between(start, -sd, sd, alpha=0.25, lw=0.0, label="stated σ")
    right.plot(start, errors, lw=1.0, label="velocity-fit")
    right.axhline(0.05, color="0.6", lw=0.8, ls=":")
    right.axhline(-0.05, color="0.6", lw=0.8, ls=":")
    right.set(xlabel="start of the window of 300 s, s", ylabel="error of the heading, °", ylim=(-0.1, 0.1))
    right.legend(fontsize="small")
    fig.savefig(path, dpi=110)


def fill(text):
    """Paragraphs of the page."""
    return "\n\n".join(textwrap.fill(" ".join(part.split()), 110) for part in text.strip().split("\n\n"))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of the page")
    parser.add_argument("--step", type=int, default=10, help="seconds between the starts of windows")
    options = parser.parse_args()
    path = Path(os.environ.get("TRUENORTH_DATA", "../shared/data")) / LOG
    log = read_imu_table(path)
    site = Site(log.latitude_rad, log.longitude_rad, log.height_m)
    increments = log.increments
    blocks = compress_increments(increments, 100)

    whole = {form: align_inertial(increments, site, form=form) for form in ("velocity-fit", "weighted")}
    best = whole["velocity-fit"]
    found = estimate_latitude(increments, height_m=log.height_m)
    dense, every = every_second(blocks, site)
    forms = every_form(blocks, site, options.step)
    intervals = interval_rows(increments, site, 10)
    timings = timing_rows(path, increments, site)
    draw(options.out / "laser_gyro.png", increments, site, every)

    versions = (
        f"truenorth {truenorth.__version__}, NumPy {np.__version__}, Python {platform.python_version()}"
    )
    page = f"""# North from a laser-gyro log

Made by `python tools/study_laser_gyro.py --step {options.step} --out docs/validation`
on {date(2026, 11, 23).isoformat()}: {versions}.

"""
    page += fill(f"""
        The public log `lasergyro.imu` of the PSINS toolbox (BSD-2): a ring-laser-gyro unit in a parked
        vehicle, 100 Hz, {log.duration_s:.0f} s, latitude {np.degrees(log.latitude_rad):.4f}°. It is
        disturbed: roll and pitch jump by 0.05° to 0.15° and velocities by 10 mm/s, in the first nine minutes
        above all. The stated heading is 90.6°; {TRUE_HEADING_DEG}° is what inertial-frame alignments of the
        whole record agree on to 0.004°, so errors below that mean nothing.

        No errors of the sensor are stated where a row does not say so: σ is what the window itself shows.
        Windows overlap: of 300 s there are six independent ones, and the largest error belongs to one or two
        places of the record.
    """)
    page += "\n\n## Every window, default form\n\nA window starts every second.\n\n" + table(HEAD, dense)
    page += "\n\n![convergence and windows](laser_gyro.png)\n\n## All forms\n\n"
    page += fill(f"""
        A window starts every {options.step} s. `velocity-fit` and `weighted` take velocities averaged over
        seconds, all others velocities at instants (`displacement-optimised` their integral), as published. In
        the rows with noise stated the random walk of the gyros is given as {SEEN_WALK_DEG_PER_SQRT_H} °/√h,
        about what the whole record shows.
    """)
    page += "\n\n" + table(HEAD, forms) + "\n\n"
    page += fill("""
        Plain averaging takes the tilt of the vehicle between start and end for a rate: 0.1° in 300 s is
        1.2 °/h, where the Earth has 12.4 °/h. Of the published forms none reaches those with averaged
        velocities in short windows; in long ones gyro noise rules and they come close. The weighted form has
        the smallest scatter when it is told the noise of the gyros. Else it takes that from the window, and
        two minutes hold too little: a few windows are taken for noisier than they are, and the largest errors
        exceed those of the plain fit. Hence the default.
    """)
    page += "\n\n## Length of the intervals\n\n`velocity-fit`, errors in degrees, a window every 10 s.\n\n"
    page += table(
        ("interval, s", "120 s: median", "120 s: largest", "300 s: median", "300 s: largest"), intervals
    )
    page += "\n\n## What the whole record says\n\n"
    measured = best.measured
    rows = [
        (
            "heading, velocity-fit",
            f"{np.degrees(best.heading_rad):.4f}° ± {np.degrees(best.angle_sd_rad[0]):.4f}°",
        ),
        (
            "heading, weighted",
            f"{np.degrees(whole['weighted'].heading_rad):.4f}°"
            f" ± {np.degrees(whole['weighted'].angle_sd_rad[0]):.4f}°",
        ),
        ("pitch, roll at the end", f"{np.degrees(best.pitch_rad):.4f}°, {np.degrees(best.roll_rad):.4f}°"),
        ("gravity felt", f"{measured['gravity_mps2']:.4f} m/s² (normal: {site.gravity_mps2:.4f})"),
        (
            "horizontal Earth rate felt",
            f"{measured['horizontal_rate_dph']:.4f} °/h"
            f" (expected {np.degrees(site.horizontal_rate_radps) * 3600.0:.4f})",
        ),
        (
            "latitude from gravity's turn",
            f"{np.degrees(found.latitude_rad):.3f}° ± {np.degrees(found.latitude_sd_rad):.3f}°,"
            f" noise only; the difference is a bias of the gyro towards north",
        ),
        ("angle random walk seen", f"{measured['gyro_random_walk_deg_per_sqrt_h']:.5f} °/√h"),
        ("velocity random walk seen", f"{measured['accel_random_walk_mps_per_sqrt_h']:.4f} m/s/√h"),
        ("shaking, means over 1 s", f"{1e3 * measured['shaking_mps']:.3f} mm/s"),
        ("seconds with bumps", f"{measured['bumps']:.0f}"),
    ]  # fmt: skip
    page += table(("", ""), rows)
    page += "\n\n## Time\n\nOne core of a shared machine, the second run, best of a few.\n\n"
    page += table(("", "time"), timings) + "\n"
    (options.out / "laser_gyro.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
