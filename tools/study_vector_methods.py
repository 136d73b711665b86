"""What the methods for the attitude from vectors are worth, and which check finds a wrong vector.

    python tools/study_vector_methods.py --out docs/validation/vector_methods.md

Three studies. The first gives every method the same vectors of the roof cross of Landfahrer (2009): antennas
with equal errors, and antennas under the seven satellites of the study after Wang & Lachapelle (2002), whose
vectors have unequal and correlated errors. The second takes wrong integers of one vector as the
least-squares search finds them, of the right length, and asks each check. The third counts false alarms.
"""

import argparse
import datetime
import textwrap
from pathlib import Path

import numpy as np

import truenorth
from truenorth.ambiguity.lsast import LsastOptions, resolve_lsast
from truenorth.ambiguity.model import DoubleDifferences
from truenorth.attitude.adjustment import adjust_vectors
from truenorth.attitude.array_vectors import ArrayVectors
from truenorth.attitude.conventions import rot_from_convention
from truenorth.attitude.geometry_checks import GeometryCheckSettings, angle_between_rad, check_geometry
from truenorth.attitude.vector_methods import attitude_from_vectors
from truenorth.rotations import heading_pitch_roll, rot_ned_from_body

WAVELENGTH_M = 299_792_458.0 / 1575.42e6
SKY_DEG = np.array([(40, 65), (150, 48), (255, 55), (320, 30), (95, 22), (200, 18), (10, 15)], dtype=float)

# Forward, right, down: the long arm of 2.669 m ahead, the cross arm of 1.565 m, crossing at their middles.
CROSS_M = np.array([(0.0, 0.0, 0.0), (1.3345, 0.7825, 0.0), (0.0, 1.565, 0.0), (-1.3345, 0.7825, 0.0)])
THESIS_PAIRS = [(0, 1), (0, 2), (0, 3), (3, 1)]

# The first vector is the wrong one; the others stand at 90 and 45 degrees from it.
GUARDED_M = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.5**0.5, 0.5**0.5, 0.0)])
PHASE_SD_M = 0.003
LENGTH_TOLERANCE_M = 0.036

GUARDS = ("fixed two", "fixed three", "scaled two", "scaled three", "chi2 two", "chi2 three")


def rays_ned(n_satellites):
    """Unit vectors to the satellites."""
    azimuth, elevation = np.radians(SKY_DEG[:n_satellites]).T
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), -np.sin(elevation)], axis=1)


def antenna_covariance(n_satellites):
    """Covariance of a position under these satellites for phases of unit noise, clock estimated."""
    rays = rays_ned(n_satellites)
    centred = rays - rays.mean(0)
    return np.linalg.inv(centred.T @ centred)


def make_vectors(body_m, rot, antenna_cov_m2, rng):
    """Vectors from the first antenna, all antennas with independent errors of one covariance."""
    n, m = len(rot), len(body_m)
    error_m = rng.standard_normal((n, m, 3)) @ np.linalg.cholesky(antenna_cov_m2).T
    place_m = np.einsum("nij,kj->nki", rot, body_m) + error_m
    return as_vectors(place_m - place_m[:, :1], body_m, antenna_cov_m2)


def as_vectors(vector_m, body_m, antenna_cov_m2):
    """The container, with the joint covariance of vectors that share the first antenna."""
    n, m = vector_m.shape[:2]
    vector_m = vector_m.copy()
    vector_m[:, 0] = np.nan
    joint = np.full((3 * m, 3 * m), np.nan)
    joint[3:, 3:] = np.kron(np.eye(m - 1) + 1.0, antenna_cov_m2)
    return ArrayVectors(
        np.arange(n, dtype=np.int64), np.zeros(n, np.int64), vector_m,
        np.broadcast_to(joint, (n, 3 * m, 3 * m)), body_m, np.zeros((3 * m, 3 * m)),
    )  # fmt: skip


def method_spread(method, n_antennas, antenna_cov_m2, n_trials, seed):
    """Standard deviations of roll, pitch and heading in degrees: of the errors, and as stated."""
    rot = rot_from_convention("enu-rfu", *np.radians([2.0, 6.0, 12.0]))
    rng = np.random.default_rng([seed, n_antennas])
    vectors = make_vectors(CROSS_M[:n_antennas], np.broadcast_to(rot, (n_trials, 3, 3)), antenna_cov_m2, rng)
    pairs = THESIS_PAIRS if method == "pseudoinverse" and n_antennas == 4 else None
    fit = attitude_from_vectors(vectors, method, pairs=pairs)
    error = (fit.angles_rad - np.array(heading_pitch_roll(rot)) + np.pi) % (2.0 * np.pi) - np.pi
    stated = [np.mean(fit.angle_sd_rad(k)) for k in (2, 1, 0)]
    return np.degrees(np.std(error[:, ::-1], axis=0)), np.degrees(stated)


def wrong_vectors(n_satellites, n_wanted, seed):
    """Vectors of which the first has the integers of a wrong best candidate of the right length.

    Returns
    -------
    vector_m : ndarray, shape (n_wanted, 4, 3)
    turn_deg : ndarray, shape (n_wanted,)
        Angle between the wrong vector and the right one.
    """
    rng = np.random.default_rng([seed, n_satellites])
    rays = rays_ned(n_satellites)
    design = -(rays[1:] - rays[0])
    m = n_satellites - 1
    cov = 2.0 * PHASE_SD_M**2 * (np.eye(m) + 1.0)
    solve = np.linalg.inv(design.T @ np.linalg.solve(cov, design)) @ design.T @ np.linalg.inv(cov)
    options = LsastOptions(
        coarse_length_tolerance_m=LENGTH_TOLERANCE_M, fine_length_tolerance_m=LENGTH_TOLERANCE_M
    )
    elevation = np.radians(SKY_DEG[1:n_satellites, 1])
    wrong, turn_deg = [], []
    while len(wrong) < n_wanted:
        rot = rot_ned_from_body(rng.uniform(0.0, 2.0 * np.pi), np.radians(rng.uniform(-5.0, 5.0)), 0.0)
        noise_m = PHASE_SD_M * rng.standard_normal((4, n_satellites))
        phase_m = (GUARDED_M @ rot.T) @ design.T + (noise_m[:, 1:] - noise_m[:, :1])
        difference_m = phase_m - phase_m[0]
        problem = DoubleDifferences(
            phase_m=difference_m[1], design=design, wavelength_m=np.full(m, WAVELENGTH_M), cov_phase_m2=cov,
            code_m=np.empty(0), code_design=np.empty((0, 3)), cov_code_m2=np.empty((0, 0)),
            elevation_rad=elevation, length_m=1.0, length_sd_m=0.003,
        )  # fmt: skip
        result = resolve_lsast(problem, options)
        if len(result.objective) == 0 or not np.any(result.integers_cyc[0]):
            continue
        right_m = solve @ difference_m[1]
        difference_m[1] -= WAVELENGTH_M * result.integers_cyc[0]
        wrong.append(difference_m @ solve.T)
        turn_deg.append(np.degrees(angle_between_rad(wrong[-1][1], right_m)))
    return np.array(wrong), np.array(turn_deg)


def right_vectors(n_satellites, n_wanted, seed):
    """Vectors with the right integers, shape (n_wanted, 4, 3)."""
    rng = np.random.default_rng([seed, 100 + n_satellites])
    heading, pitch = rng.uniform(0.0, 2.0 * np.pi, n_wanted), np.radians(rng.uniform(-5.0, 5.0, n_wanted))
    rot = rot_ned_from_body(heading, pitch, np.zeros(n_wanted))
    cov = PHASE_SD_M**2 * antenna_covariance(n_satellites)
    vector_m = make_vectors(GUARDED_M, rot, cov, rng).vector_ned_m
    vector_m[:, 0] = 0.0
    return vector_m


def alarms(vector_m, n_satellites):
    """Whether each guard says that something is wrong, and whether it names the first vector.

    Returns
    -------
    detected : dict of str to ndarray of bool
    named : dict of str to ndarray of int
        The antenna named, 0 for none.
    """
    antenna_cov_m2 = PHASE_SD_M**2 * antenna_covariance(n_satellites)
    three = as_vectors(vector_m[:, :3], GUARDED_M[:3], antenna_cov_m2)
    four = as_vectors(vector_m, GUARDED_M, antenna_cov_m2)
    fixed = GeometryCheckSettings(angle_tolerance_deg=5.0, lengths=False)
    scaled = GeometryCheckSettings(lengths=False)
    detected, named = {}, {}
    for name, vectors, settings in (
        ("fixed two", three, fixed),
        ("fixed three", four, fixed),
        ("scaled two", three, scaled),
        ("scaled three", four, scaled),
    ):
        found = check_geometry(vectors, settings)
        detected[name], named[name] = found.is_detected, np.argmax(found.is_excluded, axis=1)
    for name, vectors in (("chi2 two", three), ("chi2 three", four)):
        found = adjust_vectors(vectors, false_alarm=6.3e-5, blame_reference=False)
        detected[name], named[name] = found.chi2 > found.chi2_limit, np.argmax(found.is_excluded, axis=1)
    return detected, named


METHODS_TEXT = """
The roof cross of Landfahrer (2009): arms of 2.669 m ahead and 1.565 m across, roll 2, pitch 6, yaw 12
degrees, {trials} draws. `equal`: 1 cm in every coordinate of every antenna. `sky`: phases of 3.5 mm under
the seven satellites of [lsast_anchors](lsast_anchors.md), so that heights are worse than the level and all
errors are correlated. Standard deviations of roll, pitch and heading in degrees; in brackets those that the
method states itself. The pseudoinverse of four takes v12, v13, v14, v42 and v12 x v13.
"""

METHODS_VERDICT = """
Without weights a fourth antenna makes the heading of the pseudoinverse worse than three antennas do; the
adjustment with the whole covariance is never worse than any other.
"""

WRONG_TEXT = """
Three vectors of 1 m, the wrong one at 90 and 45 degrees from the others; GPS L1, 3 mm of undifferenced
phase noise, heading at random, pitch within 5 degrees. Wrong integers are the best candidate of the
least-squares search where that is not the truth, length within 3.6 cm; the ratio test is not asked. {wrong}
such epochs for each number of satellites, with seven, where they are rare, a fifth. Share that the guard
does not see, in per cent; in brackets the share in which it names the wrong vector, and after the stroke a
right one. `fixed`: 5 degrees (Wang and Lachapelle 2002); `scaled`: four standard deviations of each angle;
`chi-square`: the adjustment of all vectors, leaving out each in turn. `two` have one angle, at 90 degrees,
and cannot name a vector; `three` have three angles.
"""

ALARMS_TEXT = """
Right integers, {trials} epochs; alarms in a million. Each scaled angle and each chi-square is set to 63.
"""

COLUMNS = (
    "fixed, two",
    "fixed, three",
    "scaled, two",
    "scaled, three",
    "chi-square, two",
    "chi-square, three",
)


def prose(text, **values):
    """A paragraph with its numbers."""
    return ["", textwrap.fill(" ".join(text.split()).format(**values), 110), ""]


def table_head(*columns):
    """Head of a table."""
    return [f"| {' | '.join(columns)} |", f"|{' --- |' * len(columns)}"]


def page(n_trials, n_wrong, seed):
    """The page as text."""
    lines = [
        "# Attitude from vectors: methods and guards",
        "",
        f"Made by `python tools/study_vector_methods.py --trials {n_trials} --wrong {n_wrong} --seed {seed} "
        "--out docs/validation/vector_methods.md`,",
        f"truenorth {truenorth.__version__}, {datetime.date.today().isoformat()}.",
        "",
        "## The published methods and the default on the same vectors",
        *prose(METHODS_TEXT, trials=n_trials),
        *table_head("errors", "antennas", "method", "roll", "pitch", "heading"),
    ]
    for errors, cov in (("equal", 1e-4 * np.eye(3)), ("sky", 0.0035**2 * antenna_covariance(7))):
        for n_antennas in (3, 4):
            for method in ("direct", "triad", "pseudoinverse", "wahba", "implicit", "adjustment"):
                if method in ("direct", "triad") and n_antennas == 4:
                    continue
                found, stated = method_spread(method, n_antennas, cov, n_trials, seed)
                cells = " | ".join(f"{a:.3f} ({b:.3f})" for a, b in zip(found, stated, strict=True))
                lines.append(f"| {errors} | {n_antennas} | {method} | {cells} |")
    lines += prose(METHODS_VERDICT)
    lines += ["## A wrong vector of the right length", *prose(WRONG_TEXT, wrong=n_wrong)]
    lines += table_head("satellites", "least turn, deg", "median", *COLUMNS)
    for n_satellites in (5, 6, 7):
        wrong, turn_deg = wrong_vectors(n_satellites, n_wrong if n_satellites < 7 else n_wrong // 5, seed)
        detected, named = alarms(wrong, n_satellites)
        cells = [f"{n_satellites}", f"{turn_deg.min():.1f}", f"{np.median(turn_deg):.0f}"]
        for guard in GUARDS:
            cell = f"{100.0 * np.mean(~detected[guard]):.1f}"
            if guard in ("fixed three", "scaled three", "chi2 three"):
                hit, other = 100.0 * np.mean(named[guard] == 1), 100.0 * np.mean(named[guard] > 1)
                cell += f" ({hit:.1f} / {other:.1f})"
            cells.append(cell)
        lines.append(f"| {' | '.join(cells)} |")
    lines += ["", "## False alarms", *prose(ALARMS_TEXT, trials=n_trials)]
    lines += table_head("satellites", *COLUMNS)
    for n_satellites in (5, 6, 7):
        detected = alarms(right_vectors(n_satellites, n_trials, seed), n_satellites)[0]
        cells = " | ".join(f"{1e6 * np.mean(detected[guard]):.0f}" for guard in GUARDS)
        lines.append(f"| {n_satellites} | {cells} |")
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=40_000)
    parser.add_argument("--wrong", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=2009)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    arguments.out.write_text(page(arguments.trials, arguments.wrong, arguments.seed))


if __name__ == "__main__":
    main()
