"""The rotating accelerometer of Oguz 2006, section 5, beside the published table and the Cramer-Rao bound.

    python tools/study_turntable.py --out docs/validation

Writes ``oguz_turntable.md`` and ``oguz_turntable.png``; some minutes. The trials of white noise are made
by the closed form of the signal, which is compared with the simulator first; those of jitter, vibration, tilt
and lean run through the simulator and `find_north_turntable`. Everything follows from the seed.
"""

import argparse
import platform
import sys
import textwrap
import time
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import msgspec
import numpy as np

import truenorth
from truenorth.errors import NoSolutionError
from truenorth.northfinding import Site
from truenorth.northfinding.turntable import demodulate, find_north_turntable
from truenorth.northfinding.turntable_design import (
    heading_crlb_rad,
    published_heading_sd_rad,
    square_wave_heading_sd_rad,
)
from truenorth.northfinding.turntable_signal import (
    first_harmonic_mps2,
    heading_from_harmonic_rad,
    inclination_error_rad,
    table_geometry,
)
from truenorth.sensors import TurntableAccelerometerDescription, simulate_turntable_accelerometer
from truenorth.sensors.turntable_accelerometer import Vibration, coriolis_amplitude_mps2
from truenorth.simulation.motion import StaticMotion, build_trajectory
from truenorth.simulation.randomness import stream

SEED = 2006
PSI_DEG = 60.0
"""The azimuth of the source, counted counter-clockwise: a heading of -60 degrees."""

SENSOR = TurntableAccelerometerDescription()
"""600 revolutions a minute, 5 cm, 1e-5 m/s^2 a sample, 500 samples a revolution, ten revolutions."""

PUBLISHED_LATITUDE = {40.0: 0.1252, 30.0: 0.0699, 20.0: 0.0474}
PUBLISHED_PERIODS = {3: 0.1569, 10: 0.1172, 20: 0.1147, 30: 0.0936}
PUBLISHED_INCLINATION = {0.0: 0.0288, 0.2: 0.1114, 2.0: 0.8832, 5.0: 2.1997}
PUBLISHED_INCLINATION_SD = {0.0: 0.1091, 0.2: 0.0989, 2.0: 0.0887, 5.0: 0.0806}
"""Degrees: sigma by latitude and by periods, error of the mean and sigma by inclination."""


def with_(sensor=SENSOR, **changes):
    """A description with changes."""
    return msgspec.structs.replace(sensor, **changes)


def site_of(latitude_deg):
    return Site(np.radians(latitude_deg), np.radians(32.78), 0.0)


def wrapped(angle_rad):
    """Within half a turn of zero."""
    return np.mod(np.asarray(angle_rad) + np.pi, 2.0 * np.pi) - np.pi


# ------------------------------------------------------------------------------ white noise, closed form


@dataclass
class Trials:
    """Errors of the heading in degrees: each revolution by square waves, their mean, maximum likelihood."""

    revolution: np.ndarray
    square_wave: np.ndarray
    likelihood: np.ndarray


def closed_form(sensor, site, heading_rad):
    """Signal of a steady table without its mean, and the angle of the table with the mark."""
    k = np.arange(sensor.revolutions * sensor.samples_per_revolution)
    turn = np.sign(sensor.table_rpm) * 2.0 * np.pi * k / sensor.samples_per_revolution
    angle = turn + np.radians(sensor.mark_deg)
    harmonic = first_harmonic_mps2(table_geometry(sensor, site), sensor.table_rate_radps, heading_rad)
    return harmonic[0] * np.cos(angle) - harmonic[1] * np.sin(angle), angle


def white_trials(sensor, latitude_deg, runs, *names, known=None):
    """Monte Carlo with white noise; ``known`` is the device as the solver knows it."""
    site, heading = site_of(latitude_deg), -np.radians(PSI_DEG)
    known = sensor if known is None else known
    clean, angle = closed_form(sensor, site, heading)
    per_turn, turns = sensor.samples_per_revolution, sensor.revolutions
    design = np.stack([np.ones(len(angle)), np.cos(angle), -np.sin(angle)], axis=1)
    solve = np.linalg.pinv(design)[1:]
    late = np.pi / per_turn
    first = angle[:per_turn] - np.radians(sensor.mark_deg)
    waves = np.stack([np.sign(np.cos(first + late)), -np.sign(np.sin(first + late))], axis=1)
    geometry = table_geometry(known, site)
    rng = stream(SEED, "turntable", *names)
    parts = []
    for first_run in range(0, runs, 200):
        n = min(200, runs - first_run)
        samples = clean + sensor.noise_mps2 * rng.standard_normal((n, len(clean)))
        harmonic = samples @ solve.T
        rate = (harmonic - geometry.lean_mps2) / geometry.gain_mps(known.table_rate_radps)
        likelihood = heading_from_harmonic_rad(geometry, rate)[0]
        turned = samples.reshape(n, turns, per_turn)
        sums = (turned - turned.mean(axis=2, keepdims=True)) @ waves
        each = np.radians(sensor.mark_deg) - late - np.arctan2(sums[..., 1], sums[..., 0])
        total = sums.sum(axis=1)
        mean = np.radians(sensor.mark_deg) - late - np.arctan2(total[:, 1], total[:, 0])
        parts.append([np.degrees(wrapped(x - heading)) for x in (each, mean, likelihood)])
    return Trials(*(np.concatenate([part[i] for part in parts]) for i in range(3)))


def unknown_speed_trials(sensor, latitude_deg, runs, *names):
    """Errors of maximum likelihood without an encoder, degrees: the speed is estimated too."""
    site, heading = site_of(latitude_deg), -np.radians(PSI_DEG)
    clean, angle = closed_form(sensor, site, heading)
    rng = stream(SEED, "turntable", "speed", *names)
    found = []
    for first_run in range(0, runs, 100):
        n = min(100, runs - first_run)
        samples = clean + sensor.noise_mps2 * rng.standard_normal((n, len(clean)))
        samples -= samples.mean(axis=1, keepdims=True)
        factor = np.ones(n)
        for _ in range(4):
            turned = factor[:, None] * angle
            cos, sin = np.cos(turned), -np.sin(turned)
            one = np.ones_like(cos)
            h = _least_squares([one, cos, sin], samples)[:, 1:3]
            slope = angle * (h[:, :1] * sin - h[:, 1:] * cos)
            full = _least_squares([one, cos, sin, slope], samples)
            factor = factor + full[:, 3]
        found.append(np.arctan2(-full[:, 2], full[:, 1]))
    return np.degrees(wrapped(np.concatenate(found) - heading))


def _least_squares(columns, samples):
    """Solve each row of samples by its own columns."""
    size = [np.sqrt(np.mean(column**2)) for column in columns]
    matrix = np.stack([column / scale for column, scale in zip(columns, size, strict=True)], axis=-1)
    normal = np.einsum("rni,rnj->rij", matrix, matrix)
    right = np.einsum("rni,rn->ri", matrix, samples)
    return np.linalg.solve(normal, right[..., None])[..., 0] / size


# ------------------------------------------------------------------------------ the whole chain


def resting(latitude_deg, heading_deg=-PSI_DEG, pitch_deg=0.0, roll_deg=0.0):
    """A platform at rest."""
    site = site_of(latitude_deg)
    return build_trajectory(
        StaticMotion(heading_deg=heading_deg, pitch_deg=pitch_deg, roll_deg=roll_deg),
        latitude_rad=site.latitude_rad,
        longitude_rad=site.longitude_rad,
        height_m=site.height_m,
        duration_s=300.0,
        seed=SEED,
    )


def simulated(sensor, body, *names):
    """Log of the simulator."""
    return simulate_turntable_accelerometer(
        sensor,
        body,
        start_ns=0,
        duration_s=300.0,
        generator=lambda *purpose: stream(SEED, "turntable", *names, *purpose),
    )


@dataclass
class Chain:
    """Errors and stated sigmas of whole solutions, degrees."""

    error: np.ndarray
    sd: np.ndarray
    seconds: float
    refused: int

    @property
    def rms(self):
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def nees(self):
        return float(np.mean((self.error / self.sd) ** 2))


def chain_trials(name, runs, sensors, *, latitude_deg=40.0, tilt_deg=(0.0, 0.0), **options):
    """Simulate and solve; several sensors are runs of one table at several speeds."""
    body = resting(latitude_deg, pitch_deg=tilt_deg[0], roll_deg=tilt_deg[1])
    site = site_of(latitude_deg)
    error, sd, seconds = np.empty(runs), np.empty(runs), 0.0
    for run in range(runs):
        logs = [simulated(sensor, body, name, run, k) for k, sensor in enumerate(sensors)]
        started = time.perf_counter()
        try:
            found = find_north_turntable(logs, site, **options)
        except NoSolutionError:
            error[run], sd[run] = np.nan, np.nan
            continue
        seconds += time.perf_counter() - started
        error[run] = np.degrees(wrapped(found.heading_rad + np.radians(PSI_DEG)))
        sd[run] = np.degrees(found.heading_sd_rad)
    solved = np.isfinite(error)
    return Chain(error[solved], sd[solved], seconds / runs, int(np.count_nonzero(~solved)))


# ------------------------------------------------------------------------------ studies


def same_signal():
    """Largest difference of the closed form from the simulator, and of the trials from the solver."""
    body, site = resting(40.0), site_of(40.0)
    log = simulated(with_(noise_mps2=0.0), body, "same")
    signal = log.truth["signal_mps2"]
    clean, _ = closed_form(SENSOR, site, -np.radians(PSI_DEG))
    noisy = simulated(SENSOR, body, "same")
    design = np.stack([np.ones(len(clean)), *_sine_columns(SENSOR)], axis=1)
    h = np.linalg.lstsq(design, noisy.columns["acceleration_mps2"], rcond=None)[0][1:]
    heading = np.arctan2(-h[1], h[0])
    solved = find_north_turntable(noisy, site).heading_rad
    return float(np.max(np.abs(signal - signal.mean() - clean))), float(abs(wrapped(heading - solved)))


def _sine_columns(sensor):
    _, angle = closed_form(sensor, site_of(40.0), 0.0)
    return np.cos(angle), -np.sin(angle)


def base_case():
    """Ten revolutions without noise: largest errors of both methods, degrees."""
    sensor = with_(noise_mps2=0.0)
    log = simulated(sensor, resting(40.0), "base")
    each = demodulate(sensor, log)[0]
    likelihood = find_north_turntable(log, site_of(40.0)).revolution_heading_rad
    return [float(np.max(np.abs(np.degrees(wrapped(x + np.radians(PSI_DEG)))))) for x in (each, likelihood)]


def amplitude_of(latitude_deg, sensor=SENSOR):
    return coriolis_amplitude_mps2(sensor, np.radians(latitude_deg))


def sd_of(values):
    """Root mean square: the truth is known."""
    return float(np.sqrt(np.mean(np.asarray(values) ** 2)))


def white_row(latitude_deg, revolutions, runs, name):
    """Everything about white noise at a latitude with so many revolutions, degrees."""
    sensor = with_(revolutions=revolutions)
    amplitude, noise, per_turn = amplitude_of(latitude_deg), sensor.noise_mps2, sensor.samples_per_revolution
    trials = white_trials(sensor, latitude_deg, runs, name, f"{latitude_deg:g}", revolutions)
    return {
        "formula": np.degrees(published_heading_sd_rad(amplitude, noise, revolutions)),
        "revolution_theory": np.degrees(square_wave_heading_sd_rad(amplitude, noise, per_turn, 1)),
        "revolution": sd_of(trials.revolution),
        "spread": float(np.std(np.std(trials.revolution, axis=1, ddof=1))),
        "square_theory": np.degrees(square_wave_heading_sd_rad(amplitude, noise, per_turn, revolutions)),
        "square": sd_of(trials.square_wave),
        "bound": np.degrees(heading_crlb_rad(amplitude, noise, per_turn, revolutions)),
        "likelihood": sd_of(trials.likelihood),
    }


def speed_row(latitude_deg, revolutions, runs):
    """Maximum likelihood without encoder beside its bound, degrees."""
    sensor = with_(revolutions=revolutions)
    bound = heading_crlb_rad(
        amplitude_of(latitude_deg), sensor.noise_mps2, sensor.samples_per_revolution, revolutions,
        speed_known=False,
    )  # fmt: skip
    error = unknown_speed_trials(sensor, latitude_deg, runs, f"{latitude_deg:g}", revolutions)
    return np.degrees(bound), sd_of(error)


def inclination_row(theta_deg, runs):
    """One inclination: mean error of square waves with the axis at 60 degrees, either sense, and at north."""
    found = {}
    for sense in (1.0, -1.0):
        sensor = with_(tilt_roll_deg=sense * theta_deg, revolutions=5)
        trials = white_trials(sensor, 40.0, runs, "tilt", f"{theta_deg:g}", int(sense > 0), known=SENSOR)
        exact = white_trials(sensor, 40.0, runs, "tilt", f"{theta_deg:g}", int(sense > 0))
        # Errors of the heading are opposite to those of the counter-clockwise azimuth.
        found[sense] = (
            -float(np.mean(trials.square_wave)),
            -float(np.mean(exact.likelihood)),
            sd_of(exact.likelihood),
            float(np.mean(np.std(trials.revolution, axis=1, ddof=1))),
        )
    trials = white_trials(with_(revolutions=5), 40.0, 1, "north", known=SENSOR)
    geometry = table_geometry(with_(tilt_roll_deg=theta_deg), site_of(40.0))
    rate = geometry.rate_plane_radps(0.0)
    north = float(abs(np.degrees(np.arctan2(rate[1], rate[0]))))
    return found, north


CHAINS = {
    "white noise": ([SENSOR], {}),
    "white noise, square wave": ([SENSOR], {"method": "square-wave"}),
    "white noise, no encoder": ([SENSOR], {"encoder": False}),
}
"""Cases of the whole chain that need no other setting."""


def jitter_cases():
    """Speed jitter: name, sensors, options."""
    for jitter in (1e-4, 1e-3, 1e-2):
        level = with_(speed_jitter=jitter)
        leaning = with_(speed_jitter=jitter, axis_error_mrad=(1.0, 0.0))
        yield f"{jitter:g}, axis upright, encoder", [level], {}
        yield f"{jitter:g}, axis upright, no encoder", [level], {"encoder": False}
        yield f"{jitter:g}, axis leans 1 mrad, square wave", [leaning], {"method": "square-wave"}
        yield f"{jitter:g}, axis leans 1 mrad, speed not modelled", [leaning], {"speed_terms": False}
        yield f"{jitter:g}, axis leans 1 mrad, speed from the encoder", [leaning], {}
    noisy = with_(speed_jitter=1e-3, axis_error_mrad=(1.0, 0.0), angle_noise_deg=0.001)
    yield "0.001, axis leans 1 mrad, encoder with 0.001 deg of noise", [noisy], {}
    yield "none, encoder with 0.1 deg of noise", [with_(angle_noise_deg=0.1)], {}


VIBRATIONS_HZ = (10.3, 10.7, 11.3, 12.7, 20.0, 25.3, 30.0, 50.0)


def vibration_cases():
    """A vibration of a tenth of the signal at several frequencies, by both methods."""
    for hz in VIBRATIONS_HZ:
        shaken = with_(vibrations=(Vibration(frequency_hz=hz, amplitude_mps2=3.5e-5, phase_deg=47.0),))
        for method in ("square-wave", "maximum-likelihood"):
            yield hz, method, [shaken]


def lean_cases():
    """A leaning axis on a tilted table: one direction and both."""
    leaning = with_(axis_error_mrad=(1.0, 1.0))
    back = with_(axis_error_mrad=(1.0, 1.0), table_rpm=-600.0)
    slow = with_(axis_error_mrad=(1.0, 1.0), table_rpm=300.0)
    tilt = {"tilt_deg": (0.0, 0.1), "tilt_rad": (0.0, float(np.radians(0.1)))}
    yield "one direction, lean not known", [leaning], tilt
    yield "one direction, lean stated as 1 mrad", [leaning], {**tilt, "lean_sd_rad": 1e-3}
    yield "one direction, lean known", [leaning], {**tilt, "description": leaning}
    yield "600 and 300 rpm, lean not known", [leaning, slow], tilt
    yield "600 rpm both ways, lean not known", [leaning, back], tilt


# ------------------------------------------------------------------------------ the page


def table(head, rows):
    """Markdown."""
    return [
        "| " + " | ".join(head) + " |",
        "| --- |" + " ---: |" * (len(head) - 1),
        *("| " + " | ".join(row) + " |" for row in rows),
        "",
    ]


def paragraph(text):
    """One paragraph of the page, wrapped, and the empty line after it."""
    return [*textwrap.wrap(" ".join(text.split()), 110, break_long_words=False, break_on_hyphens=False), ""]


def bounds_section(rows, speed):
    """Maximum likelihood and square wave against the Cramer-Rao bound."""
    lines = [
        "## Against the Cramér–Rao bound",
        "",
        *paragraph("""Sigma of the combined heading, degrees. The bound knows the angle of the table; the last
            columns know only the mark at the first sample and estimate the speed, whose bound is
            sqrt((4N - 2)/(N + 1)) times larger. The square wave's loss is pi^2/8 = 1.234 in variance,
            1.111 in sigma."""),
    ]
    cells = []
    for (latitude, turns), row in rows.items():
        bound_speed, likelihood_speed = speed[latitude, turns]
        cells.append([
            f"{latitude:g}°, n = {turns}", f"{row['bound']:.5f}", f"{row['likelihood']:.5f}",
            f"{row['likelihood'] / row['bound']:.3f}", f"{row['square']:.5f}",
            f"{(row['square'] / row['bound']) ** 2:.3f}", f"{bound_speed:.5f}",
            f"{likelihood_speed / bound_speed:.3f}",
        ])  # fmt: skip
    head = ["", "bound", "likelihood", "over bound", "square wave", "variance over bound",
            "bound, no encoder", "likelihood over it"]  # fmt: skip
    return [*lines, *table(head, cells)]


def latitude_section(found):
    head = ["latitude", "published", "formula (5.19)", "theory, one revolution", "found, one revolution",
            "found, mean of 10", "likelihood of 10", "bound"]  # fmt: skip
    cells = [
        [f"{latitude:g}°", f"{PUBLISHED_LATITUDE[latitude]:.4f}", f"{row['formula']:.4f}",
         f"{row['revolution_theory']:.4f}", f"{row['revolution']:.4f} ± {row['spread']:.3f}",
         f"{row['square']:.4f}", f"{row['likelihood']:.4f}", f"{row['bound']:.4f}"]
        for latitude, row in found.items()
    ]  # fmt: skip
    return table(head, cells)


def periods_section(found):
    head = ["periods", "published", "formula (5.19)", "found, one revolution", "found, mean of n",
            "theory, mean of n", "likelihood of n", "bound"]  # fmt: skip
    cells = [
        [f"{turns}", f"{PUBLISHED_PERIODS[turns]:.4f}", f"{row['formula']:.4f}",
         f"{row['revolution']:.4f} ± {row['spread']:.3f}", f"{row['square']:.4f}",
         f"{row['square_theory']:.4f}",
         f"{row['likelihood']:.4f}", f"{row['bound']:.4f}"]
        for turns, row in found.items()
    ]  # fmt: skip
    return table(head, cells)


def inclination_section(runs):
    head = ["inclination", "published", "(5.20), axis at 60°", "found, rolled right", "found, rolled left",
            "tilt known", "(5.20), axis north", "exact, axis north",
            "published sigma", "found, one revolution"]  # fmt: skip
    cells = []
    for theta, published in PUBLISHED_INCLINATION.items():
        found, north = inclination_row(theta, runs)
        formula = np.degrees(inclination_error_rad(np.radians(theta), np.radians(40.0), np.radians(60.0)))
        north_formula = np.degrees(inclination_error_rad(np.radians(theta), np.radians(40.0), 0.0))
        worst = max((mean for _, mean, _, _ in found.values()), key=abs)
        cells.append([
            f"{theta:g}°", f"{published:.4f}", f"{formula:.4f}",
            f"{found[1.0][0]:+.4f}",
            f"{found[-1.0][0]:+.4f}", f"{worst:+.4f} ± {found[1.0][2]:.4f}", f"{north_formula:.4f}",
            f"{north:.4f}", f"{PUBLISHED_INCLINATION_SD[theta]:.4f}", f"{found[1.0][3]:.4f}",
        ])  # fmt: skip
    return table(head, cells)


def chain_section(cases, runs, label):
    """Rows of whole solutions."""
    cells = []
    for name, sensors, options in cases:
        chain = chain_trials(name, runs, sensors, **options)
        words = ["–", "–", "–"]
        if len(chain.error):
            words = [f"{chain.rms:.4f}", f"{sd_of(chain.sd):.4f}", f"{chain.nees:.2f}"]
        cells.append([name, *words, f"{chain.refused}"])
    return table([label, "rms error, deg", "stated sigma, deg", "mean (error/sigma)²", "refused"], cells)


def vibration_section(runs):
    cells = {hz: [f"{hz:g}"] for hz in VIBRATIONS_HZ}
    for hz, method, sensors in vibration_cases():
        chain = chain_trials(f"vibration {hz:g}", runs, sensors, method=method)
        cells[hz] += [f"{chain.rms:.4f}", f"{sd_of(chain.sd):.4f}"]
    head = ["Hz", "square wave, rms error", "its stated sigma", "likelihood, rms error", "its stated sigma"]
    return table(head, list(cells.values()))


def page(runs, chain_runs, command):
    """The page as text, and what the figure shows."""
    latitudes = {latitude: white_row(latitude, 10, runs, "latitude") for latitude in PUBLISHED_LATITUDE}
    periods = {turns: white_row(40.0, turns, runs, "periods") for turns in PUBLISHED_PERIODS}
    bounds = {(40.0, turns): row for turns, row in periods.items()}
    bounds |= {(latitude, 10): white_row(latitude, 10, runs, "bound") for latitude in (0.0, 60.0, 75.0, 85.0)}
    speed = {key: speed_row(*key, runs if key[1] < 20 else runs // 2) for key in bounds}
    signal_off, solver_off = same_signal()
    square_off, likelihood_off = base_case()
    seconds = chain_trials("time", 20, [SENSOR]).seconds
    lines = [
        "# The rotating accelerometer",
        "",
        f"Made by `{command}` on {date.today().isoformat()}: truenorth {truenorth.__version__}, NumPy "
        f"{np.__version__}, Python {platform.python_version()}; seed {SEED}.",
        "",
        *paragraph(f"""P. Oguz, *Implementation of Northfinding Techniques*, METU 2006, section 5.4: an
            accelerometer on a table of 600 rpm at 5 cm, azimuth 60° (counter-clockwise: a heading of 300°),
            noise 1e-5 m/s² a sample, square-wave demodulation. The number of samples in a revolution is not
            published; 500 fit its scatter. White noise: {runs} runs a case, by the closed form of the signal,
            which differs from the simulator by {signal_off:.0e} m/s² at most; its likelihood solution differs
            from `find_north_turntable` by {solver_off:.0e} rad. Everything else: {chain_runs} runs a case
            through the simulator and `find_north_turntable`, {1e3 * seconds:.0f} ms a solution of ten
            revolutions."""),
        "## Without noise",
        "",
        *paragraph(f"""Ten revolutions at latitude 40° (published: plot only): the worst revolution is off by
            {square_off:.0e}° with square waves and by {likelihood_off:.0e}° with maximum likelihood."""),
        "## Latitude",
        "",
        *latitude_section(latitudes),
        *paragraph("""Degrees. Each published sigma is the scatter of the ten revolutions of one record; ± is
            the scatter of such a scatter. The published formula leaves the samples of a revolution out. The
            published values fall faster with latitude than 1/cos, but each is a single draw; that at 20°
            lies two of the ± below theory."""),
        "## Periods",
        "",
        *periods_section(periods),
        *paragraph("""Degrees, latitude 40°. The scatter of single revolutions does not fall with their
            number; the mean does. The published values are the former."""),
        "## Inclination",
        "",
        *inclination_section(runs),
        *paragraph("""Degrees counter-clockwise, latitude 40°, five revolutions; the table is rolled about the
            axis at azimuth 60° (the source uses one letter for this azimuth and for the wanted one). Exactly
            rotated, the two senses differ; the published formula is of first order. "Tilt known"
            solves the exact geometry with the tilt given: mean error of the worse sense, ± the sigma of one
            record."""),
        *bounds_section(bounds, speed),
        "## Speed jitter and encoder",
        "",
        *chain_section(jitter_cases(), chain_runs, "jitter, share of the speed"),
        *paragraph("""Gauss–Markov, 0.05 s; ten revolutions at latitude 40°. An upright axis feels jitter only
            through the angle: with an encoder it does no harm, with a mark alone the angle wanders away from
            it. A leaning axis feels the centripetal acceleration of 197 m/s² change: the noise is
            coloured, and what counts is its spectrum at 10 Hz. The encoder tells the speed, so its effect is
            fitted, and the lean comes out with it. Refused are records in which no signal stands out, or one
            whose size cannot be that of the Earth's rotation."""),
        "## Vibration",
        "",
        *vibration_section(chain_runs),
        *paragraph("""Degrees; a sine of 3.5e-5 m/s², a tenth of the signal, ten revolutions (one hertz is the
            resolution). The square wave suffers lines near 10, 30 and 50 Hz, and all that do not fit the
            record; maximum likelihood takes every line that it can resolve for unknown. A line within the
            resolution, or at the speed of the table, cannot be told from the signal: only a longer
            record helps, and the solution says so. Sigma of the square wave comes from the lines that the fit
            sees, whatever their phase; here every run has the same phase."""),
        "## Axis leaning on a tilted table",
        "",
        *chain_section(lean_cases(), chain_runs, "axis leans 1 mrad each way, tilt of 0.1° known"),
        *paragraph("""Gravity felt by the leaning axis once a revolution does not depend on the speed of the
            table, the Coriolis term does: two speeds separate them, and opposite directions lose nothing.
            Known means that the description of the device was given to the solver."""),
        "## Whole chain with white noise",
        "",
        *chain_section(
            [(name, sensors, options) for name, (sensors, options) in CHAINS.items()], chain_runs, "method"
        ),
        "## What it takes",
        "",
        *paragraph(f"""Noise of 1e-5 m/s² a sample at 5000 samples a second is a density of
            {1e-5 / np.sqrt(2500.0) / 9.80665 * 1e6:.3f} µg/√Hz. With 1 µg/√Hz, a very good sensor, ten
            revolutions at latitude 40° give {density_sigma(10):.2f}° and {density_sigma(640):.2f}° takes 640
            (64 s). `truenorth turntable design` answers such questions."""),
        "![Latitude, periods, inclination, bound](oguz_turntable.png)",
    ]
    return "\n".join(lines) + "\n", latitudes, periods


def density_sigma(revolutions):
    """Sigma with 1 micro-g/sqrt(Hz) at latitude 40, degrees."""
    from truenorth.northfinding.turntable_design import design_turntable

    design = design_turntable(
        np.radians(40.0), noise_density_mps2_rthz=9.80665e-6, revolutions=revolutions
    )  # fmt: skip
    return float(np.degrees(design.heading_sd_rad[0]))


def figure(latitudes, periods, runs):
    """Latitude, periods and inclination beside the published values, and the likelihood against the bound."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

    blue, orange, green = "#0072B2", "#D55E00", "#009E73"
    drawn = Figure(figsize=(11.0, 7.6), dpi=120, layout="constrained")
    (one, two), (three, four) = drawn.subplots(2, 2)
    log = simulated(with_(noise_mps2=0.0, revolutions=2), resting(40.0), "base")
    signal = log.truth["signal_mps2"]
    one.plot(log.time_ns * 1e-6, 1e6 * (signal - signal.mean()), color=blue)
    one.set(xlabel="ms", ylabel="signal without its mean, µm/s²")
    at = np.arange(0.0, 88.1, 2.0)
    for turns, color in ((1, orange), (10, blue), (100, green)):
        for theory, style in ((heading_crlb_rad, "-"), (square_wave_heading_sd_rad, "--")):
            values = [np.degrees(theory(amplitude_of(x), SENSOR.noise_mps2, 500, turns)) for x in at]
            label = f"{turns} revolution{'s' if turns > 1 else ''}" if style == "-" else None
            two.plot(at, values, style, color=color, linewidth=1.2, label=label)
    two.plot(list(latitudes), [row["revolution"] for row in latitudes.values()], "o", color=orange)
    two.plot(list(latitudes), [row["likelihood"] for row in latitudes.values()], "o", color=blue)
    two.plot(
        list(PUBLISHED_LATITUDE), list(PUBLISHED_LATITUDE.values()), "kx", label="published, one record of 10"
    )
    two.set(yscale="log", xlabel="latitude, deg (solid: bound; dashed: square wave)", ylabel="sigma, deg")
    turns = list(periods)
    three.plot(
        turns, [row["revolution"] for row in periods.values()], "o--", color=orange, label="one revolution"
    )
    three.plot(
        turns, [row["square"] for row in periods.values()], "s--", color=green, label="mean, square wave"
    )
    three.plot(turns, [row["likelihood"] for row in periods.values()], "o-", color=blue, label="likelihood")
    three.plot(turns, list(PUBLISHED_PERIODS.values()), "kx", label="published")
    three.set(xscale="log", yscale="log", xlabel="revolutions", ylabel="sigma at latitude 40°, deg")
    theta = np.linspace(0.0, 5.0, 26)
    for sense, color in ((1.0, orange), (-1.0, green)):
        values = []
        for tilt in theta:
            geometry = table_geometry(with_(tilt_roll_deg=sense * tilt), site_of(40.0))
            rate = geometry.rate_plane_radps(-np.radians(PSI_DEG))
            off = np.arctan2(-rate[1], rate[0]) + np.radians(PSI_DEG)
            values.append(abs(np.degrees(wrapped(off))))
        four.plot(theta, values, color=color, label=f"exact, rolled {'right' if sense > 0 else 'left'}")
    formula = [inclination_error_rad(np.radians(x), np.radians(40.0), np.radians(60.0)) for x in theta]
    four.plot(theta, np.degrees(formula), "--", color=blue, label="formula (5.20)")
    four.plot(
        list(PUBLISHED_INCLINATION),
        list(PUBLISHED_INCLINATION.values()),
        "kx",
        label="published",
    )
    four.set(xlabel="inclination about the axis at 60°, deg", ylabel="azimuth error, deg")
    for ax in (one, two, three, four):
        ax.grid(alpha=0.3)
    three.xaxis.set_major_locator(FixedLocator(turns))
    three.yaxis.set_major_locator(FixedLocator([0.02, 0.03, 0.05, 0.1, 0.15]))
    two.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    for axis in (three.xaxis, three.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    for ax in (two, three, four):
        ax.legend(fontsize="small")
    drawn.suptitle(f"Rotating accelerometer, {runs} runs a case", fontsize="large", fontweight="bold")
    return drawn


def main():
    """Make the page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, help="folder for the page; without it it is printed only")
    parser.add_argument("--runs", type=int, default=4000, help="of white noise, each case")
    parser.add_argument("--chain-runs", type=int, default=100, help="through the whole chain, each case")
    options = parser.parse_args()
    command = "python tools/study_turntable.py --out docs/validation"
    text, latitudes, periods = page(options.runs, options.chain_runs, command)
    if options.out is None:
        sys.stdout.write(text)
        return
    from truenorth.report.files import save_figure

    (options.out / "oguz_turntable.md").write_text(text, encoding="utf-8")
    save_figure(figure(latitudes, periods, options.runs), options.out / "oguz_turntable.png")


if __name__ == "__main__":
    main()
