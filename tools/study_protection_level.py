"""Reliability of an array: rates of its tests, what slips could hide, and whether protection levels hold.

    python tools/study_protection_level.py --epochs 1000000 --out docs/validation
    python tools/study_protection_level.py --multipath 1800 --out docs/validation

White noise: each epoch has its own attitude and one of four skies, and is adjusted, tested and, where an
antenna contradicts, adapted by the functions that users call. Multipath: scenarios are simulated and solved
from their raw phases. Everything follows from the seed.
"""

import argparse
import platform
import sys
import textwrap
from datetime import date
from pathlib import Path

import numpy as np

import truenorth
from truenorth.ambiguity.array_model import ArrayEpoch
from truenorth.attitude import solve_array
from truenorth.attitude.array_vectors import ArrayVectors
from truenorth.attitude.reliability import (
    Outcome,
    ReliabilitySettings,
    adapt_attitude,
    attitude_reliability,
    b_method_significance,
    least_squares_model,
    multiple_fault_risk,
    phase_reliability,
    protection_level,
)
from truenorth.attitude.reliability.array_adaptation import fit_block
from truenorth.attitude.reliability.array_reliability import antenna_shapes
from truenorth.attitude.vectors import angle_jacobian
from truenorth.rotations import heading_pitch_roll, rot_ned_from_body, skew
from truenorth.simulation import simulate

ANGLES = ("heading", "pitch", "roll")
SQUARE_M = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
TRIANGLE_M = SQUARE_M[:3]
WAVELENGTH_M = 0.19029367
PHASE_SD_M = 0.003

SKY_DEG = ((40, 65), (150, 48), (255, 55), (320, 30), (95, 22), (200, 18), (10, 15))
"""Azimuth and elevation of the satellites of the published study."""

SKIES = ((0, 1, 2, 3, 4, 5, 6), (0, 1, 2, 3, 4, 5), (0, 1, 2, 3, 4), (0, 2, 3, 4, 5))
"""Satellites in view, one choice for each epoch."""

FAULTS = ((1e-2, 1e-3), (1e-3, 1e-4), (1e-4, 1e-5))
"""Prior probability of a fault of each antenna, and integrity risk."""

RISKS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)

WORST = (1e-3, 1e-4)
"""Prior and risk of the study of the worst fault."""

SIZES = (2.0, 3.0, 4.0, 5.0, 6.0, 7.0)
"""Of the worst fault, in standard deviations of its test."""

SCENARIOS = ("wang-vehicle", "wang-minivan", "mcmillan-ship-four")

WRONG_DEG = 10.0

LEVELS = ((1e-2, 0.0), (1e-3, 0.0), (1e-5, 0.0), (1e-5, 1e-4))
"""Risk and fault prior of the levels that are compared with errors under multipath, the defaults last."""

SHIFTS_M = (1e-3, 1.0)
"""Sizes of faults, uniform in the logarithm."""

BLOCK = 20_000


def units_ned(chosen):
    """Directions to satellites."""
    azimuth, elevation = np.radians(np.array(SKY_DEG)[list(chosen)]).T
    return np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), -np.sin(elevation)], axis=1
    )


def antenna_cov_m2(chosen):
    """Covariance of what one receiver's phases say about its antenna, its clock eliminated."""
    e = units_ned(chosen)
    centred = e - e.mean(axis=0)
    return PHASE_SD_M**2 * np.linalg.inv(centred.T @ centred)


def random_vectors(rng, n, shift_m=None):
    """Vectors of the square at random attitudes and skies: vectors, attitudes."""
    rot = rot_ned_from_body(
        rng.uniform(0.0, 2.0 * np.pi, n), np.radians(5.0) * rng.standard_normal(n),
        np.radians(5.0) * rng.standard_normal(n),
    )  # fmt: skip
    covs = np.stack([antenna_cov_m2(sky) for sky in SKIES])
    sky = rng.integers(0, len(SKIES), n)
    position = np.einsum("nij,kj->nki", rot, SQUARE_M)
    noise = rng.standard_normal((n, 4, 3))
    position += np.einsum("nij,nkj->nki", np.linalg.cholesky(covs)[sky], noise)
    if shift_m is not None:
        position += shift_m
    vector = position - position[:, :1]
    vector[:, 0] = np.nan
    joint = np.stack([np.kron(np.eye(4) + 1.0, cov) for cov in covs])[sky]
    zero = np.zeros(n, np.int64)
    return ArrayVectors(np.arange(n), zero, vector, joint, SQUARE_M, np.zeros((12, 12))), rot


def errors(rot, true_rot):
    """Absolute errors of heading, pitch and roll."""
    difference = np.stack(heading_pitch_roll(rot), 1) - np.stack(heading_pitch_roll(true_rot), 1)
    return np.abs((difference + np.pi) % (2.0 * np.pi) - np.pi)


def adjusted(vectors):
    """Attitudes from all vectors, whatever the tests say."""
    return np.concatenate([fit_block(block)[0] for block in vectors.blocks(max_epochs=BLOCK)])


def rates_of_tests(rng, n):
    """Rows of the table of tests: false alarms, and power at the minimal detectable blunder."""
    settings = ReliabilitySettings()
    cov = np.kron(np.eye(3) + 1.0, antenna_cov_m2(SKIES[0]))
    design = np.concatenate([-skew(vector) for vector in SQUARE_M[1:]])
    model = least_squares_model(design[None], cov[None])
    faults = model.faults(antenna_shapes(3))
    factor = np.linalg.cholesky(cov)
    mdb = faults.mdb(settings.delta0)[0, 0, 0]
    counts = np.zeros((2, 4))
    for _ in range(n // BLOCK):
        for row, shift in enumerate((0.0, mdb)):
            y = rng.standard_normal((BLOCK, 9)) @ factor.T
            y[:, 0] += shift
            right = y @ model.test[0]
            w = right[:, 0] / np.sqrt(faults.seen[0, 0, 0, 0])
            antenna = np.einsum("ni,ij,nj->n", right[:, :3], np.linalg.inv(faults.seen[0, 0]), right[:, :3])
            counts[row] += [
                np.count_nonzero(np.abs(w) > settings.local_limit),
                np.count_nonzero(np.abs(w) > settings.delta0),
                np.count_nonzero(antenna > settings.limit(3)),
                np.count_nonzero(np.einsum("ni,ni->n", y, right) > settings.limit(6)),
            ]
    return counts / (n // BLOCK * BLOCK)


def levels_without_faults(rng, n, risks):
    """Epochs that exceed the level of each risk, with no prior probability of a fault: (risks, angles)."""
    exceeded, total = np.zeros((len(risks), 3)), 0
    for _ in range(n // BLOCK):
        vectors, rot = random_vectors(rng, BLOCK)
        fitted = adjusted(vectors)
        error = errors(fitted, rot)
        total += BLOCK
        sd = attitude_reliability(vectors, fitted).sd_rad
        for row, risk in enumerate(risks):
            level, _ = protection_level(
                sd, np.zeros((BLOCK, 3, 0)), np.zeros(0), np.zeros((BLOCK, 0)), risk=risk
            )
            exceeded[row] += np.count_nonzero(error > level, axis=0)
    return exceeded, total


def levels_with_faults(rng, n, prior, risk):
    """One row of the table of levels: counts, misleading epochs, median levels in units of the noise."""
    settings = ReliabilitySettings(fault_prior=prior, integrity_risk=risk)
    count = dict.fromkeys(("faulty", "passed", "adapted", "lost", "passed_faulty"), 0)
    beyond, beyond_adapted, ratios = np.zeros(3, int), np.zeros(3, int), []
    for _ in range(n // BLOCK):
        is_faulty = rng.random((BLOCK, 4)) < prior
        shift = rng.standard_normal((BLOCK, 4, 3))
        size = np.exp(rng.uniform(*np.log(SHIFTS_M), (BLOCK, 4))) / np.linalg.norm(shift, axis=2)
        vectors, rot = random_vectors(rng, BLOCK, shift * (size * is_faulty)[..., None])
        found = adapt_attitude(vectors, settings=settings)
        result = attitude_reliability(found.vectors, found.rot_ned_from_body, settings=settings)
        passed, adapted = found.outcome == Outcome.PASSED, found.outcome == Outcome.ADAPTED
        misleading = errors(found.rot_ned_from_body, rot) > result.protection_rad
        any_fault = is_faulty.any(axis=1)
        count["faulty"] += np.count_nonzero(any_fault)
        count["passed"] += np.count_nonzero(passed)
        count["adapted"] += np.count_nonzero(adapted)
        count["lost"] += np.count_nonzero(~passed & ~adapted)
        count["passed_faulty"] += np.count_nonzero(passed & any_fault)
        beyond += np.count_nonzero(misleading & passed[:, None], axis=0)
        beyond_adapted += np.count_nonzero(misleading & adapted[:, None], axis=0)
        ratios.append((result.protection_rad / result.sd_rad)[passed][::50])
    return count, beyond, beyond_adapted, np.median(np.vstack(ratios), axis=0)


def worst_faults(rng, n, prior, risk, sizes):
    """Share of epochs that a fault in its worst direction misleads unnoticed, by its non-centrality.

    For each angle the fault of the fourth antenna points where it moves that angle most for what its test
    sees of it, and has the given size in units of that test.
    """
    settings = ReliabilitySettings(fault_prior=prior, integrity_risk=risk)
    rows = []
    blocks = max(n // BLOCK, 1)
    for size in sizes:
        missed, hidden = np.zeros(3), np.zeros(3)
        for angle in [0, 1, 2] * blocks:
            vectors, rot = random_vectors(rng, BLOCK)
            block = next(vectors.blocks())
            design = -skew(np.einsum("nij,kj->nki", rot, block.body_m)).reshape(BLOCK, 9, 3)
            faults = least_squares_model(design, block.cov_ned_m2).faults(antenna_shapes(3))
            seen = faults.seen[:, 2]
            through = np.einsum("nu,nuq->nq", angle_jacobian(rot)[:, angle], faults.gain[:, :, 2])
            shift = np.linalg.solve(seen, through[..., None])[..., 0]
            shift *= size / np.sqrt(np.einsum("ni,nij,nj->n", shift, seen, shift))[:, None]
            vectors.vector_ned_m[:, 3] += shift
            fitted = adjusted(vectors)
            result = attitude_reliability(vectors, fitted, settings=settings)
            misleading = errors(fitted, rot)[:, angle] > result.protection_rad[:, angle]
            missed[angle] += np.count_nonzero(misleading & result.is_passed)
            hidden[angle] += np.count_nonzero(result.is_passed)
        rows.append((size, hidden / (blocks * BLOCK), missed / (blocks * BLOCK)))
    return rows


def phase_table():
    """Rows of the table of phases: what a slip can hide in, by antennas, satellites and stage."""
    rows = []
    for body in (SQUARE_M, TRIANGLE_M):
        for n_sats in (7, 6, 5, 4):
            e, m = units_ned(range(n_sats)), len(body)
            satellite, antenna = np.repeat(np.arange(n_sats), m), np.tile(np.arange(m), n_sats)
            n = len(satellite)
            epoch = ArrayEpoch(
                antenna, satellite, np.zeros(n, np.int64), np.zeros(n), np.full(n, np.nan), -e[satellite],
                np.full(n, WAVELENGTH_M), np.full(n, PHASE_SD_M**2), np.full(n, 1.0), body,
            )  # fmt: skip
            for stage in ("vectors", "attitude"):
                result = phase_reliability(epoch, rot_ned_from_body(0.5, 0.03, -0.02), stage=stage)
                rows.append((m, n_sats, stage, result))
    return rows


def multipath_rows(seed, duration_s):
    """Solve scenarios with multipath from their raw phases and compare errors with levels."""
    rows = []
    for name in SCENARIOS:
        session = simulate(
            name, {"seed": seed, "duration_s": duration_s, "interval_s": 1.0}, signal_truth=False
        )
        names, scenario = list(session.observations), session.scenario
        solution = solve_array(
            [session.observations[antenna] for antenna in names],
            [antenna.position_body_m for antenna in scenario.platform.antennas],
            session.navigation, names=names, systems="G", bands=("L1",),
            elevation_mask_deg=scenario.solve.elevation_mask_deg,
        )  # fmt: skip
        at = np.searchsorted(session.truth["time_ns"], solution.time_ns)
        true_rot = rot_ned_from_body(*(session.truth[f"{angle}_rad"][at] for angle in ANGLES))
        found = adapt_attitude(solution.vectors)
        error = errors(found.rot_ned_from_body, true_rot)
        out = []
        for risk, prior in LEVELS:
            settings = ReliabilitySettings(integrity_risk=risk, fault_prior=prior)
            result = attitude_reliability(found.vectors, found.rot_ned_from_body, settings=settings)
            use = result.is_passed[:, None] & np.isfinite(result.protection_rad)
            beyond = np.count_nonzero(use & (error > result.protection_rad), axis=0)
            level = [np.degrees(np.median(result.protection_rad[use[:, k], k])) for k in range(3)]
            part = np.max((error / result.protection_rad)[use], initial=0.0)
            out.append((risk, prior, np.count_nonzero(use, axis=0).max(), beyond, part, level))
            if prior == 0.0:
                known = use
        rms = [np.degrees(np.sqrt(np.mean(error[known[:, k], k] ** 2))) for k in range(3)]
        ratio = [np.mean((error / result.sd_rad)[known[:, k], k] ** 2) for k in range(3)]
        outcome = np.bincount(found.outcome, minlength=len(Outcome))
        wrong = np.count_nonzero(np.any(known & (error > np.radians(WRONG_DEG)), axis=1))
        passed = np.count_nonzero(result.is_passed)
        safe = result.is_passed & (1.0 - solution.success_probability < LEVELS[-1][0])
        safe = 100.0 * np.count_nonzero(safe) / max(passed, 1)
        rows.append((name, len(error), passed, wrong, safe, outcome, rms, ratio, out))
    return rows


def paragraph(text):
    """Lines of running text."""
    return [*textwrap.wrap(text, 110, break_on_hyphens=False), ""]


def heading(title):
    """Lines of a heading."""
    return [f"## {title}", ""]


def table(columns, rows, n_left=0):
    """Lines of a table; `n_left` columns of words."""
    head = ["| " + " | ".join(columns) + " |"]
    head.append("| " + " | ".join(["---"] * n_left + ["---:"] * (len(columns) - n_left)) + " |")
    return head + ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows] + [""]


def angles(what):
    """Column titles of the three angles."""
    return [f"{what}: heading", "pitch", "roll"]


def made_by(options):
    """The line that says where a page comes from."""
    return paragraph(
        f"Made by `python tools/study_protection_level.py {options}` on {date.today()}: truenorth "
        f"{truenorth.__version__}, NumPy {np.__version__}, Python {platform.python_version()}."
    )


def page(seed, n, rates, free, faulty, worst, phases):
    """The page on white noise."""
    exceeded, total = free
    settings = ReliabilitySettings()
    lines = ["# Reliability of an array: tests, slips that could hide, protection levels", ""]
    lines += made_by(f"--epochs {n} --seed {seed} --out docs/validation")
    lines += paragraph(
        "Four antennas on a square of 1 m, phases of 3 mm, GPS L1, the sky of seven satellites of Wang and "
        "Lachapelle (2002), unless said otherwise. Tests of one component have a significance of 0.001 and a "
        "power of 0.8; all others follow from these by the B-method (Baarda 1968)."
    )
    lines += heading("Tests")
    lines += paragraph(
        f"{n} epochs of white noise, without a blunder, and with one component of one vector off by its "
        "minimal detectable blunder. All tests find it alike, whatever they look at; that is what the "
        "B-method is for. Demanding that the estimated blunder exceed the minimal detectable one (the screen "
        "of the paper) costs three tenths of the power."
    )
    limits = (settings.local_limit, settings.delta0, settings.limit(3), settings.limit(6))
    expected = (1e-3, 2.0 * 1.797e-5, b_method_significance(3), b_method_significance(6))
    names = ("component, w", "component, w with the screen", "antenna", "all vectors")
    lines += table(
        ["test", "limit", "false alarms, expected", "counted", "power at the detectable blunder"],
        [
            (names[k], f"{limits[k]:.2f}", f"{expected[k]:.2g}", f"{rates[0, k]:.2g}", f"{rates[1, k]:.3f}")
            for k in range(4)
        ],
        1,
    )
    lines += heading("What a slip can hide in")
    lines += paragraph(
        "The largest minimal detectable blunder of any phase, and the largest effect of one on the attitude: "
        "first where each vector is resolved by itself and only its own phases are tested, then where all "
        "phases are tested against the attitude of the known array. Slips hidden is the share of phases in "
        "which a slip of one cycle stays below its detectable blunder. With five satellites and vectors by "
        "themselves, one satellite hides any slip; the array sees a tenth of a cycle with four."
    )
    lines += table(
        ["antennas", "satellites", "tested against", "redundancy", "median, mm", "largest, mm",
         "largest, cycles", "slips hidden, %", *angles("largest effect, deg")],
        [
            (m, n_sats, "the array" if stage == "attitude" else "its vector", r.dof,
             number(1e3 * np.median(r.mdb_m), 0), number(1e3 * r.mdb_m.max(), 0), number(r.mdb_cyc.max(), 2),
             f"{100.0 * r.hides_a_cycle.mean():.0f}",
             *(number(value, 2) for value in np.degrees(r.external_rad.max(axis=0))))
            for m, n_sats, stage, r in phases
        ],
    )  # fmt: skip
    lines += heading("Protection levels in white noise, no faults")
    lines += paragraph(
        f"{total} epochs with random headings, 5 deg of pitch and roll, five to seven satellites in view, "
        "adjusted by the functions of the package. With a fault prior of 0 the level is no bound but the "
        "quantile of the error: errors exceed it as often as stated."
    )
    lines += table(
        ["stated risk", *angles("beyond the level"), "stated", "its scatter"],
        [
            (f"{risk:g}", *(f"{count:.0f}" for count in row), f"{risk * total:.0f}",
             f"±{np.sqrt(risk * (1.0 - risk) * total):.0f}")
            for risk, row in zip(RISKS, exceeded, strict=True)
        ],
    )  # fmt: skip
    lines += heading("Protection levels in white noise, with faults")
    lines += paragraph(
        "Each antenna is at fault in an epoch with the prior probability that the levels are told, by 1 mm "
        "to 1 m (uniform in the logarithm) in any direction. Beyond are epochs that passed all tests and "
        "whose error exceeds the level: the misleading ones; allowed is the stated risk times all epochs. "
        "The levels allow for the worst fault, so that faults of any size and direction leave room. Where an "
        "antenna was left out, three remain; they cannot see a fault across their plane, and with such "
        "priors there is no level."
    )
    lines += table(
        ["prior", "risk", "epochs", "with a fault", "passed", "of these faulty", "antenna left out",
         "given up", "allowed", *angles("beyond"), "beyond after leaving out", *angles("level / sd")],
        [
            (f"{prior:g}", f"{risk:g}", total, count["faulty"], count["passed"], count["passed_faulty"],
             count["adapted"], count["lost"], f"{risk * total:.0f}", *beyond, max(adapted),
             *(f"{value:.1f}" for value in ratios))
            for prior, risk, (count, beyond, adapted, ratios) in faulty
        ],
    )  # fmt: skip
    prior, risk, rows = worst
    many = multiple_fault_risk(np.full(4, prior))
    lines += paragraph(
        "The worst fault: one antenna has, in every epoch, a fault in the direction that moves an angle most "
        "for what the test of that antenna sees. The share of epochs that it misleads unnoticed, times the "
        "prior probability of all four antennas, must stay below the risk: with a prior of "
        f"{prior:g} and a risk of {risk:g}, less {many:.1e} for two faults at once, the share may be "
        f"{(risk - many) / (4.0 * prior):.4f}."
    )
    lines += table(
        ["size, sd of its test", "passes the tests, %", *angles("share misled")],
        [
            (f"{size:g}", f"{100.0 * hidden.mean():.1f}", *(f"{value:.5f}" for value in missed))
            for size, hidden, missed in rows
        ],
    )
    return "\n".join(lines).rstrip("\n") + "\n"


def multipath_page(seed, duration_s, rows):
    """The page on multipath."""
    lines = ["# Protection levels under multipath: where they do not hold", ""]
    lines += made_by(f"--multipath {duration_s:g} --seed {seed} --out docs/validation")
    lines += paragraph(
        f"Scenarios of {duration_s:g} s at 1 Hz, GPS L1, simulated and solved from their raw phases with the "
        "default settings; the noise of the phases is estimated from the run itself. Multipath is correlated "
        "in time and differs in size from satellite to satellite: it is not the white noise of declared size "
        "that the levels assume. Squared error over variance is 1 where the stated covariance is right. "
        f"Wrong is an attitude off by more than {WRONG_DEG:g} deg, which passed all the same. The levels "
        "are those of right integers; safe integers are those whose own stated probability of being wrong is "
        f"below {LEVELS[-1][0]:g}: where it is not, a level of that risk does not exist."
    )
    lines += table(
        ["scenario", "epochs", "without attitude", "contradicted", "antenna left out", "passed", "wrong",
         "safe integers, %",
         *angles("rms error, deg"), *angles("squared error / variance")],
        [
            (name, n, outcome[Outcome.NOT_TESTED], outcome[Outcome.NOT_IDENTIFIED : Outcome.NOT_TESTED].sum(),
             outcome[Outcome.ADAPTED], passed, wrong, f"{safe:.0f}", *(f"{value:.3f}" for value in rms),
             *(f"{value:.2f}" for value in ratio))
            for name, n, passed, wrong, safe, outcome, rms, ratio, _ in rows
        ],
        1,
    )  # fmt: skip
    lines += table(
        ["scenario", "risk", "fault prior", "epochs with a level", "allowed", *angles("beyond"),
         "largest error / level", *angles("median level, deg")],
        [
            (name, f"{risk:g}", f"{prior:g}", some, f"{risk * some:.2f}", *beyond, f"{part:.2f}",
             *(number(v, 2) for v in level))
            for name, *_, levels in rows
            for risk, prior, some, beyond, part, level in levels
        ],
        1,
    )  # fmt: skip
    failed = [
        f"{name} at {risk:g} with a fault prior of {prior:g} ({ANGLES[k]}: {beyond[k]} of {some} epochs)"
        for name, *_, levels in rows
        for risk, prior, some, beyond, _, _ in levels
        for k in range(3)
        # More than white noise scatters: one in ten thousand would.
        if beyond[k] > risk * some + 3.7 * np.sqrt(risk * some) + 0.5
    ]
    if failed:
        lines += paragraph("Exceeded more often than stated: " + "; ".join(failed) + ".")
    return "\n".join(lines).rstrip("\n") + "\n"


def number(value, digits):
    """A number, or the word for one without bound."""
    return f"{value:.{digits}f}" if np.isfinite(value) else "unbounded"


def main():
    """Run the study and write its page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--epochs", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=2002)
    parser.add_argument("--multipath", type=float, help="seconds of each scenario; this page only")
    parser.add_argument("--out", type=Path, default=Path("docs/validation"))
    options = parser.parse_args()
    n, seed = options.epochs, options.seed

    def stream(part):
        return np.random.default_rng([seed, part])

    def said(what):
        print(what, file=sys.stderr, flush=True)

    if options.multipath:
        rows = multipath_rows(seed, options.multipath)
        text = multipath_page(seed, options.multipath, rows)
        (options.out / "reliability_multipath.md").write_text(text, encoding="utf-8")
        return
    rates = rates_of_tests(stream(1), n)
    said("tests")
    free = levels_without_faults(stream(2), n, RISKS)
    said("levels without faults")
    faulty = []
    for k, (prior, risk) in enumerate(FAULTS):
        faulty.append((prior, risk, levels_with_faults(stream(3 + k), n, prior, risk)))
        said(f"levels with faults, prior {prior:g}")
    prior, risk = WORST
    worst = prior, risk, worst_faults(stream(9), n // 50, prior, risk, SIZES)
    said("worst faults")
    text = page(seed, n, rates, free, faulty, worst, phase_table())
    (options.out / "reliability.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
