"""Half an hour of inertial log to north beside the published recursion: benchmarks/north_alignment.py."""

import statistics
import time

import numpy as np
from machine import conditions, parser, report, table

import truenorth as tn
from truenorth.northfinding.inertial import align_inertial
from truenorth.rotations import heading_pitch_roll, quaternion_multiply, rot_from_quaternion


def recursion(increments, site):
    """Optimisation-based alignment sample by sample (Wu et al. 2011, algorithm of section 4), in NumPy."""
    rate, force = site.earth_rate_ned_radps, site.force_ned_mps2
    step = float(np.diff(increments.time_s[:2])[0])
    body, frame = np.array([1.0, 0.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0])
    alpha, beta, matrix = np.zeros(3), np.zeros(3), np.zeros((4, 4))

    def turned(vector):
        angle = np.sqrt(vector @ vector)
        return np.concatenate([[np.cos(0.5 * angle)], np.sinc(0.5 * angle / np.pi) * 0.5 * vector])

    def left(vector):
        x, y, z = vector
        return np.array([[0, -x, -y, -z], [x, 0, -z, y], [y, z, 0, -x], [z, -y, x, 0]])

    def right(vector):
        x, y, z = vector
        return np.array([[0, -x, -y, -z], [x, 0, z, -y], [y, -z, 0, x], [z, y, -x, 0]])

    frame_turn = turned(rate * step)
    for angle, velocity in zip(increments.angle_rad, increments.velocity_mps, strict=True):
        alpha = alpha + rot_from_quaternion(body) @ velocity
        body = quaternion_multiply(body, turned(angle))
        beta = beta + rot_from_quaternion(frame) @ (force * step)
        frame = quaternion_multiply(frame, frame_turn)
        difference = left(beta) - right(alpha)
        matrix += difference.T @ difference
    start = rot_from_quaternion(np.linalg.eigh(matrix)[1][:, 0])
    rot = rot_from_quaternion(frame).T @ start @ rot_from_quaternion(body)
    return heading_pitch_roll(rot)[0]


def main():
    """Time reading, checking and aligning of the whole log, interleaved with the recursion on a part."""
    options = parser(__doc__.splitlines()[0])
    options.add_argument("--peer-s", type=float, default=300.0, help="seconds of log for the recursion")
    arguments = options.parse_args()
    dataset = tn.datasets.fetch("imu_laser_gyro")
    path = dataset.files["imu"]
    log = tn.read_imu_table(path)
    part = log.between(None, arguments.peer_s)
    site = tn.Site(log.latitude_rad, log.longitude_rad, log.height_m)
    names = ("read", "find_north", "align_inertial", "without the run", "part", "peer")
    jobs = dict(
        zip(
            names,
            (
                lambda: tn.read_imu_table(path),
                lambda: tn.find_north(log, site),
                lambda: align_inertial(log.increments, site),
                lambda: align_inertial(log.increments, site, running=False),
                lambda: align_inertial(part.increments, site, running=False),
                lambda: recursion(part.increments, site),
            ),
            strict=True,
        )
    )
    times = {name: [] for name in names}
    last = {}
    for _ in range(arguments.runs):
        for name, job in jobs.items():
            start = time.perf_counter()
            last[name] = job()
            times[name].append(time.perf_counter() - start)
    median = {name: statistics.median(values) for name, values in times.items()}
    part_s = f"{part.duration_s:.0f} s"
    rows = [
        [f"reading {log.duration_s:.0f} s at 100 Hz, packed text", f"{median['read']:.3f} s"],
        ["`find_north`: checks, fit, estimate after every second, verdict", f"{median['find_north']:.3f} s"],
        ["`align_inertial` alone, with the estimate after every second", f"{median['align_inertial']:.3f} s"],
        ["`align_inertial`, the end only", f"{median['without the run']:.3f} s"],
        [f"`align_inertial`, {part_s} of the log, the end only", f"{median['part']:.4f} s"],
        [f"recursion of Wu et al. (2011) sample by sample in NumPy, {part_s}", f"{median['peer']:.3f} s"],
        ["ratio of the last two", f"{median['peer'] / median['part']:.0f}"],
    ]
    difference = np.degrees(last["peer"] - last["part"].heading_rad)
    lines = [
        *conditions(),
        f"- log `imu_laser_gyro`; medians of {arguments.runs} interleaved runs in one process",
        f"- headings of the last two rows differ by {difference:.3f} degrees: another form of the same idea",
        "",
        *table(["what", "time"], rows),
    ]
    report("North by inertial alignment", lines, write=arguments.write)


if __name__ == "__main__":
    main()
