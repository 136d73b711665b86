"""North from the rotating accelerometer: geometry, methods, lean, speed, budget, verdict, and refusals."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from moving_bodies import HEIGHT, LONGITUDE, Resting, generators
from truenorth.errors import ConfigError, FormatError, NoSolutionError
from truenorth.northfinding import NorthSolution, Site
from truenorth.northfinding.turntable import (
    demodulate,
    describe_turntable,
    find_north_turntable,
    turntable_budget,
)
from truenorth.northfinding.turntable_design import (
    design_turntable,
    heading_crlb_rad,
    published_heading_sd_rad,
    square_wave_heading_sd_rad,
)
from truenorth.northfinding.turntable_fit import fit_harmonic, noise_spectrum, wandering_phase
from truenorth.northfinding.turntable_signal import first_harmonic_mps2, table_geometry
from truenorth.sensors import TurntableAccelerometerDescription, simulate_turntable_accelerometer
from truenorth.sensors.turntable_accelerometer import Vibration, coriolis_amplitude_mps2

FORTY = np.radians(40.0)
SITE = Site(FORTY, LONGITUDE, HEIGHT)
SENSOR = TurntableAccelerometerDescription()
SILENT = TurntableAccelerometerDescription(noise_mps2=0.0, revolutions=3)


def run(sensor, heading_deg=300.0, pitch_deg=0.0, roll_deg=0.0, seed=1):
    body = Resting(FORTY, heading_deg=heading_deg, pitch_deg=pitch_deg, roll_deg=roll_deg)
    return simulate_turntable_accelerometer(
        sensor, body, start_ns=0, duration_s=200.0, generator=generators(seed)
    )


def with_columns(log, **columns):
    return replace(log, columns={**log.columns, **columns})


def error_deg(solution, heading_deg=300.0):
    return float(
        np.degrees(np.mod(solution.heading_rad - np.radians(heading_deg) + np.pi, 2 * np.pi) - np.pi)
    )


# ------------------------------------------------------------------------------------ geometry


@pytest.mark.parametrize("rpm", [600.0, -250.0])
@pytest.mark.parametrize("lean", [(0.0, 0.0), (3.0, -2.0)])
def test_the_closed_harmonic_is_that_of_the_simulator(rpm, lean):
    sensor = msgspec.structs.replace(
        SILENT, table_rpm=rpm, axis_error_mrad=lean, tilt_pitch_deg=3.0, tilt_roll_deg=-5.0, mark_deg=77.0
    )
    log = run(sensor, heading_deg=211.0, pitch_deg=-4.0, roll_deg=7.0)
    geometry = table_geometry(sensor, SITE, tilt_rad=(np.radians(-4.0), np.radians(7.0)))
    h = first_harmonic_mps2(geometry, sensor.table_rate_radps, np.radians(211.0))
    alpha = log.truth["table_angle_rad"] + np.radians(77.0)
    closed = h[0] * np.cos(alpha) - h[1] * np.sin(alpha)
    signal = log.truth["signal_mps2"]
    # At 1.1 km the plumb line of the normal field is a microradian off: 1e-5 m/s^2 times the lean. Without
    # lean rho w^2 remains, 3e-10 m/s^2.
    bound = 1e-9 if lean == (0.0, 0.0) else 1e-7
    np.testing.assert_allclose(signal - signal.mean(), closed, atol=bound)


@pytest.mark.parametrize("rpm", [600.0, -600.0])
@pytest.mark.parametrize("heading_deg", [0.0, 120.0, 300.0])
def test_known_tilt_of_platform_and_table_is_taken_off_exactly(rpm, heading_deg):
    sensor = msgspec.structs.replace(
        SILENT, table_rpm=rpm, tilt_pitch_deg=3.0, tilt_roll_deg=-5.0, mark_deg=-20.0, noise_mps2=1e-9
    )
    log = run(sensor, heading_deg, -4.0, 7.0)
    tilt = (np.radians(-4.0), np.radians(7.0))
    found = find_north_turntable(log, SITE, description=sensor, tilt_rad=tilt)
    assert error_deg(found, heading_deg) == pytest.approx(0.0, abs=5e-5)
    np.testing.assert_allclose(found.angles_rad[1:], tilt, atol=1e-12)
    assert found.amplitude_mps2 == pytest.approx(found.expected_amplitude_mps2, rel=1e-5)
    square = find_north_turntable(log, SITE, description=sensor, tilt_rad=tilt, method="square-wave")
    assert error_deg(square, heading_deg) == pytest.approx(0.0, abs=1e-3)
    # Taken as level it is wrong.
    assert abs(error_deg(find_north_turntable(log, SITE), heading_deg)) > 0.2


def test_direction_and_mark_do_not_matter_to_either_method():
    for rpm in (600.0, -600.0):
        for mark in (0.0, 77.0):
            sensor = msgspec.structs.replace(SILENT, table_rpm=rpm, mark_deg=mark, noise_mps2=1e-10)
            log = run(sensor, 33.0)
            for method in ("maximum-likelihood", "square-wave"):
                assert error_deg(find_north_turntable(log, SITE, method=method), 33.0) == pytest.approx(
                    0.0, abs=1e-4
                )


def test_opposite_directions_separate_a_leaning_axis():
    leaning = msgspec.structs.replace(SENSOR, axis_error_mrad=(1.0, -2.0))
    back = msgspec.structs.replace(leaning, table_rpm=-600.0)
    logs = [run(leaning, roll_deg=0.1, pitch_deg=0.05), run(back, roll_deg=0.1, pitch_deg=0.05, seed=2)]
    tilt = (np.radians(0.05), np.radians(0.1))
    alone = find_north_turntable(logs[0], SITE, tilt_rad=tilt)
    both = find_north_turntable(logs, SITE, tilt_rad=tilt)
    assert abs(error_deg(alone)) > 10.0 * np.degrees(alone.heading_sd_rad)
    assert abs(error_deg(both)) < 4.0 * np.degrees(both.heading_sd_rad)
    # Both records together have the sigma of twenty revolutions: nothing is lost.
    assert both.heading_sd_rad == pytest.approx(alone.heading_sd_rad / np.sqrt(2.0), rel=0.02)
    assert both.measured["lean_outward_rad"] == pytest.approx(1e-3, abs=5e-5)
    assert both.measured["lean_along_rad"] == pytest.approx(-2e-3, abs=5e-5)
    assert len(both.revolution_heading_rad) == 20
    np.testing.assert_allclose(both.run.sd_rad[-1, 0], both.heading_sd_rad, rtol=1e-9)
    with pytest.raises(ConfigError, match="same speed"):
        find_north_turntable([logs[0], logs[0]], SITE)
    square = find_north_turntable(logs, SITE, tilt_rad=tilt, method="square-wave")
    assert abs(error_deg(square)) < 4.0 * np.degrees(square.heading_sd_rad)
    assert square.heading_sd_rad == pytest.approx(1.111 * both.heading_sd_rad, rel=0.02)


def test_a_lean_that_is_stated_is_corrected_and_one_that_is_not_is_paid_for():
    leaning = msgspec.structs.replace(SENSOR, axis_error_mrad=(1.0, 1.0))
    log = run(leaning, roll_deg=0.1)
    tilt = (0.0, np.radians(0.1))
    known = find_north_turntable(log, SITE, description=leaning, tilt_rad=tilt)
    assert abs(error_deg(known)) < 4.0 * np.degrees(known.heading_sd_rad)
    doubted = find_north_turntable(log, SITE, tilt_rad=tilt, lean_sd_rad=1e-3)
    # 1 mrad times 0.1 deg times gravity over the amplitude: 2.8 deg.
    felt = 1e-3 * SITE.gravity_mps2 * np.radians(0.1) / coriolis_amplitude_mps2(SENSOR, FORTY)
    assert doubted.heading_sd_rad == pytest.approx(felt, rel=0.01)
    assert abs(error_deg(doubted)) < 3.0 * np.degrees(felt)


# ------------------------------------------------------------------------------------ the fit


def test_without_an_encoder_the_speed_is_found_even_when_it_is_not_the_stated_one():
    log = run(msgspec.structs.replace(SENSOR, table_rpm=603.7))
    log = replace(log, meta={**log.meta, "table_rate_radps": 20.0 * np.pi})
    del (columns := dict(log.columns))["table_angle_rad"]
    found = find_north_turntable(replace(log, columns=columns), SITE, encoder=False)
    assert abs(error_deg(found)) < 4.0 * np.degrees(found.heading_sd_rad)
    fit = found.fits[0]
    assert abs(fit.rate_radps - 603.7 * np.pi / 30.0) < 4.0 * fit.rate_sd_radps
    # sqrt(24 / N) sigma / (A T): the bound of a frequency.
    bound = np.sqrt(24.0 / 5000.0) * 1e-5 / (coriolis_amplitude_mps2(SENSOR, FORTY) * 5000.0 / 5031.0)
    assert fit.rate_sd_radps == pytest.approx(bound, rel=0.1)
    known = heading_crlb_rad(coriolis_amplitude_mps2(SENSOR, FORTY), 1e-5, 500, 10)
    assert found.crlb_rad == pytest.approx(2.0 * known, rel=0.05)
    assert found.heading_sd_rad == pytest.approx(found.crlb_rad, rel=0.05)
    with pytest.raises(FormatError, match="no column table_angle_rad"):
        find_north_turntable(replace(log, columns=columns), SITE)


def test_vibration_is_fitted_and_leaves_the_bound_untouched():
    waves = (
        Vibration(frequency_hz=25.3, amplitude_mps2=1e-4),
        Vibration(frequency_hz=12.7, amplitude_mps2=5e-5, phase_deg=70.0),
    )
    log = run(msgspec.structs.replace(SENSOR, vibrations=waves))
    found = find_north_turntable(log, SITE)
    np.testing.assert_allclose(sorted(found.fits[0].vibrations[:, 0]), [12.7, 25.3], atol=0.01)
    np.testing.assert_allclose(sorted(found.fits[0].vibrations[:, 1]), [5e-5, 1e-4], atol=1.5e-6)
    assert abs(error_deg(found)) < 4.0 * np.degrees(found.heading_sd_rad) < 0.14
    square = find_north_turntable(log, SITE, method="square-wave")
    assert square.heading_sd_rad > 5.0 * found.heading_sd_rad
    assert abs(error_deg(square)) < 4.0 * np.degrees(square.heading_sd_rad)


def test_a_line_nearer_than_the_resolution_is_told_and_paid_for():
    wave = (Vibration(frequency_hz=10.3, amplitude_mps2=3e-5, phase_deg=10.0),)
    found = find_north_turntable(run(msgspec.structs.replace(SENSOR, vibrations=wave)), SITE)
    assert any("record longer" in note for note in found.notes)
    assert found.heading_sd_rad > np.radians(0.5)
    longer = msgspec.structs.replace(SENSOR, vibrations=wave, revolutions=80)
    found = find_north_turntable(run(longer), SITE)
    assert found.fits[0].vibrations[0, 0] == pytest.approx(10.3, abs=0.01)
    assert abs(error_deg(found)) < 4.0 * np.degrees(found.heading_sd_rad) < 0.06


def test_jitter_through_a_leaning_axis_is_read_from_the_encoder():
    sensor = msgspec.structs.replace(SENSOR, speed_jitter=1e-3, axis_error_mrad=(1.0, 0.0))
    log = run(sensor)
    modelled = find_north_turntable(log, SITE)
    plain = find_north_turntable(log, SITE, speed_terms=False)
    assert modelled.heading_sd_rad < np.radians(0.05)
    assert abs(error_deg(modelled)) < 4.0 * np.degrees(modelled.heading_sd_rad)
    assert modelled.measured["lean_outward_by_speed_rad"] == pytest.approx(1e-3, rel=0.01)
    assert plain.heading_sd_rad > 50.0 * modelled.heading_sd_rad
    # The coloured noise is that of a Gauss-Markov speed at 10 Hz, per sample; of 20 bins beside it.
    felt = 2.0 * 1e-3 * 0.05 * (20.0 * np.pi) ** 2 * 1e-3
    density = np.sqrt(2.0 * 0.05 * 5000.0 / (1.0 + (20.0 * np.pi * 0.05) ** 2)) * felt
    assert plain.fits[0].noise.signal_sd == pytest.approx(density, rel=0.6)
    budget = turntable_budget(sensor, SITE, method="square-wave")
    assert budget.lines[0].source == "speed jitter through the leaning axis"
    of_jitter = (
        density / SENSOR.noise_mps2 * heading_crlb_rad(coriolis_amplitude_mps2(SENSOR, FORTY), 1e-5, 500, 10)
    )
    assert budget.angle_sd_rad(budget.lines[0])[0] == pytest.approx(of_jitter, rel=1e-3)


def test_samples_that_are_missing_or_wild_are_left_out():
    log = run(SENSOR)
    plain = find_north_turntable(log, SITE)
    signal = log.columns["acceleration_mps2"].copy()
    signal[100:140] = np.nan
    signal[2000:2010] += 0.01
    found = find_north_turntable(with_columns(log, acceleration_mps2=signal), SITE)
    assert found.measured["samples_left_out"] == 50.0
    assert abs(error_deg(found) - error_deg(plain)) < 0.5 * np.degrees(plain.heading_sd_rad)


def test_higher_harmonics_can_be_fitted():
    log = run(SILENT)
    angle = log.columns["table_angle_rad"]
    # Half a revolution too much, so that a second harmonic does not fit the record.
    signal = (
        log.columns["acceleration_mps2"] + 1e-4 * np.cos(2.0 * angle) + 1e-9 * np.sin(0.1 * np.arange(1500))
    )
    cut = replace(log, time_ns=log.time_ns[:1250], columns={
        "acceleration_mps2": signal[:1250], "table_angle_rad": angle[:1250],
    })  # fmt: skip
    off = [abs(error_deg(find_north_turntable(cut, SITE, harmonics=k, max_vibrations=0))) for k in (1, 2)]
    assert off[0] > 0.5
    assert off[1] < 0.01


def test_white_residuals_have_the_sigma_of_the_samples_and_coloured_ones_that_of_their_spectrum():
    rng = np.random.default_rng(5)
    white = rng.standard_normal(10_000)
    spectrum = noise_spectrum(white, 500.0, 20.0, 10_000)
    assert spectrum.order == 0
    assert spectrum.signal_sd == pytest.approx(1.0, rel=0.04)
    red = np.empty(100_000)
    red[0] = 0.0
    share = np.exp(-1.0 / 250.0)
    for k, step in enumerate(rng.standard_normal(99_999)):
        red[k + 1] = share * red[k] + step
    spectrum = noise_spectrum(red, 500.0, 200.0, 100_000)
    at_signal = 1.0 / abs(1.0 - share * np.exp(-2j * np.pi / 500.0))
    assert spectrum.signal_sd == pytest.approx(at_signal, rel=0.2)
    assert spectrum.order > 0


def test_a_wandering_phase_is_told_from_noise():
    rng = np.random.default_rng(3)
    time = np.arange(40) + 0.5
    assert wandering_phase(time, 0.3 + 0.01 * time + 1e-3 * rng.standard_normal(40), 1e-3) is None
    assert wandering_phase(time[:4], time[:4], 1e-3) is None
    walk = np.cumsum(0.02 * rng.standard_normal(40))
    phase, sd = wandering_phase(time, 0.3 + walk, 1e-3)
    assert abs(phase - 0.3) < 4.0 * sd
    assert 0.01 < sd < 0.05


def test_a_fit_needs_samples():
    with pytest.raises(NoSolutionError, match="3 samples"):
        fit_harmonic(np.arange(3.0), np.ones(3), angle_rad=np.arange(3.0))


# ------------------------------------------------------------------------------------ result


def test_the_result_is_a_north_solution_that_grows_by_revolutions():
    found = find_north_turntable(run(SENSOR), SITE, description=SENSOR, tilt_sd_rad=1e-4, mark_sd_rad=2e-4)
    assert isinstance(found, NorthSolution)
    assert found.run.angles_rad.shape == found.run.sd_rad.shape == (10, 3)
    np.testing.assert_allclose(found.run.time_s, 0.1 * np.arange(1, 11), atol=1e-9)
    np.testing.assert_allclose(found.run.angles_rad[-1], found.angles_rad, atol=1e-9)
    np.testing.assert_allclose(found.run.sd_rad[-1], found.angle_sd_rad, rtol=1e-9)
    noise = found.revolution_sd_rad / np.sqrt(10.0)
    parts = [noise, 2e-4, 1e-4 * np.tan(FORTY)]
    assert found.heading_sd_rad == pytest.approx(np.linalg.norm(parts), rel=1e-9)
    # An error of the tilt about north is one of the azimuth.
    assert found.cov_ned_rad2[0, 2] == pytest.approx(-1e-8 * np.tan(FORTY))
    assert {line.source for line in found.budget.lines} == {"sensor noise", "tilt", "mark"}
    predicted = [heading_crlb_rad(coriolis_amplitude_mps2(SENSOR, FORTY), 1e-5, 500, 10), *parts[1:]]
    assert found.budget.angle_sd_rad()[0] == pytest.approx(np.linalg.norm(predicted), rel=1e-4)


def test_the_verdict_counts_the_revolutions_that_it_takes():
    log = run(SENSOR)
    yes = find_north_turntable(log, SITE, description=SENSOR)
    assert yes.verdict.able is True
    no = find_north_turntable(log, SITE, description=SENSOR, required_heading_sd_rad=np.radians(0.01))
    assert no.verdict.able is False
    words = no.verdict.sentence.split()
    needed = int(words[words.index("takes") + 1])
    assert needed == pytest.approx(10 * (0.0326 / 0.01) ** 2, rel=0.1)
    floor = find_north_turntable(
        log, SITE, description=SENSOR, required_heading_sd_rad=np.radians(0.01), mark_sd_rad=np.radians(0.1)
    )
    assert floor.verdict.able is False
    assert "takes" not in floor.verdict.sentence
    assert floor.budget.lines[0].source == "mark"
    assert find_north_turntable(log, SITE).verdict.able is None


def test_every_line_of_the_budget_is_the_effect_of_its_source():
    latitude_sd = np.radians(0.5)
    site = Site(FORTY, LONGITUDE, HEIGHT, latitude_sd)
    sensor = msgspec.structs.replace(
        SENSOR, tilt_roll_deg=2.0, angle_noise_deg=0.5, axis_error_mrad=(2.0, 0.0),
        vibrations=(Vibration(frequency_hz=10.4, amplitude_mps2=1e-5),),
    )  # fmt: skip
    budget = turntable_budget(sensor, site, heading_rad=1.0, tilt_sd_rad=1e-3, lean_sd_rad=1e-4)
    sd = {line.source: budget.angle_sd_rad(line)[0] for line in budget.lines}
    assert sd["encoder noise"] == pytest.approx(np.radians(0.5) / np.sqrt(5000.0))
    assert sd["tilt"] == pytest.approx(1e-3 * np.tan(FORTY))
    amplitude = coriolis_amplitude_mps2(sensor, FORTY)
    assert sd["vibration at 10.4 Hz"] == pytest.approx(
        1e-5 * np.sinc(0.4) / amplitude / np.sqrt(2.0), rel=0.05
    )
    # 2 mrad times an unknown mrad, and 0.1 mrad times 2 deg.
    g = SITE.gravity_mps2
    felt = np.hypot(2e-3 * 1e-3 * g, 1e-4 * np.sin(np.radians(2.0)) * g)
    assert sd["lean of the axis"] == pytest.approx(felt / amplitude, rel=0.02)
    # The latitude matters by the tilt only: solved with a wrong one.
    plain = msgspec.structs.replace(SILENT, tilt_roll_deg=2.0, noise_mps2=1e-12)
    log = run(plain, heading_deg=np.degrees(1.0))
    wrong = find_north_turntable(log, Site(FORTY + latitude_sd, LONGITUDE, HEIGHT), description=plain)
    assert sd["latitude"] == pytest.approx(abs(wrong.heading_rad - 1.0), rel=0.03)


# ------------------------------------------------------------------------------------ design


@pytest.mark.parametrize("speed_known", [True, False])
def test_the_bound_is_the_inverse_of_the_information(speed_known):
    amplitude, noise, per_turn, turns = 3.5e-4, 1e-5, 50, 8
    k = np.arange(per_turn * turns)
    alpha = 2.0 * np.pi * k / per_turn
    phase = alpha - 0.7
    columns = [np.ones(len(k)), np.cos(phase), amplitude * np.sin(phase)]
    if not speed_known:
        columns.append(-amplitude * k * np.sin(phase))
    information = np.stack(columns) @ np.stack(columns).T / noise**2
    exact = np.sqrt(np.linalg.inv(information)[2, 2])
    bound = heading_crlb_rad(amplitude, noise, per_turn, turns, speed_known=speed_known)
    assert bound == pytest.approx(exact, rel=1e-9 if speed_known else 0.03)


def test_the_square_wave_is_that_of_the_published_integrals():
    # T sigma / (8 w_N rho sqrt(M)) for one revolution.
    north = 7.292115e-5 * np.cos(FORTY)
    wanted = 0.1 * 1e-5 / (8.0 * north * 0.05 * np.sqrt(500.0))
    amplitude = coriolis_amplitude_mps2(SENSOR, FORTY)
    assert square_wave_heading_sd_rad(amplitude, 1e-5, 500, 1) == pytest.approx(wanted, rel=1e-6)
    ratio = square_wave_heading_sd_rad(amplitude, 1e-5, 500, 7) / heading_crlb_rad(amplitude, 1e-5, 500, 7)
    assert ratio**2 == pytest.approx(np.pi**2 / 8.0)
    # sigma over 2 Omega rho as a rate, over the north rate and sqrt(n).
    assert published_heading_sd_rad(amplitude, 1e-5, 10) == pytest.approx(
        1e-5 / (2.0 * 20.0 * np.pi * 0.05) / north / np.sqrt(10.0), rel=1e-6
    )


def test_a_design_is_solved_backwards():
    wanted = np.radians(0.02)
    design = design_turntable(
        np.radians([0.0, 40.0, 80.0]), inclination_sd_rad=[0.0, np.radians(0.01)], revolutions=(5, 10),
        required_heading_sd_rad=wanted,
    )  # fmt: skip
    assert len(design.heading_sd_rad) == 12
    for k in range(12):
        if not np.isfinite(design.needed_revolutions[k]):
            assert design.inclination_error_rad[k] >= wanted
            continue
        n = int(design.needed_revolutions[k])
        sds = [
            design_turntable(
                design.latitude_rad[k], inclination_sd_rad=design.inclination_sd_rad[k], revolutions=m
            ).heading_sd_rad[0]
            for m in (n, n - 1)
        ]
        assert sds[0] <= wanted * (1.0 + 1e-9) < sds[1]
    # At 80 deg, 0.01 deg of tilt cost 0.057 deg.
    assert np.isinf(design.needed_revolutions[-1])
    assert design.needed_s[0] == pytest.approx(0.1 * design.needed_revolutions[0])


def test_a_design_knows_density_lean_and_a_missing_encoder():
    density = 1e-5 / np.sqrt(2500.0)
    plain = design_turntable(FORTY)
    assert design_turntable(FORTY, noise_density_mps2_rthz=density).heading_sd_rad == pytest.approx(
        plain.heading_sd_rad
    )
    # The same noise at twice the speed has half the sigma for the amplitude, and more for the rate.
    fast = design_turntable(FORTY, noise_density_mps2_rthz=density, table_rate_radps=40.0 * np.pi)
    assert fast.heading_sd_rad == pytest.approx(plain.heading_sd_rad / np.sqrt(2.0))
    assert design_turntable(FORTY, speed_known=False).heading_sd_rad == pytest.approx(
        2.0 * plain.heading_sd_rad, rel=1e-3
    )
    lean = design_turntable(FORTY, inclination_sd_rad=1e-3, lean_rad=1e-3).inclination_error_rad[0]
    budget = turntable_budget(SENSOR, SITE, tilt_sd_rad=1e-3, lean_sd_rad=1e-3)
    parts = [budget.angle_sd_rad(line)[0] for line in budget.lines if line.source != "sensor noise"]
    assert lean == pytest.approx(np.linalg.norm(parts), rel=1e-3)
    for wrong in ({"radius_m": 0.0}, {"inclination_sd_rad": -1.0}, {"required_heading_sd_rad": 0.0}):
        with pytest.raises(ConfigError):
            design_turntable(FORTY, **wrong)
    with pytest.raises(ConfigError, match="no sensor can feel north"):
        design_turntable(np.radians(90.0))


# ------------------------------------------------------------------------------------ refusals


def refusals():
    log = run(msgspec.structs.replace(SENSOR, revolutions=4))
    signal, angle = log.columns["acceleration_mps2"], log.columns["table_angle_rad"]
    mean = signal.mean()
    short = replace(log, time_ns=log.time_ns[:400], columns={k: v[:400] for k, v in log.columns.items()})
    gap = np.r_[log.time_ns[:700], log.time_ns[700:] + 10**9]
    cut = {"acceleration_mps2": signal[:1900], "table_angle_rad": angle[:1900]}
    noise = np.random.default_rng(1).standard_normal(len(signal))
    missing = np.where(np.arange(len(signal)) % 3, signal, np.nan)
    slow = log.time_ns.copy()
    slow[5] = slow[4]
    yield "another sensor", replace(log, kind="gyro"), {}, FormatError, "'gyro'"
    yield "no column", replace(log, columns={"table_angle_rad": angle}), {}, FormatError, "acceleration_mps2"
    yield "no radius", replace(log, meta={"table_rate_radps": 62.8}), {}, FormatError, "radius_m"
    yield "too short", short, {}, NoSolutionError, "less than a revolution"
    yield "a gap", replace(log, time_ns=gap), {}, FormatError, "gap of 1 s after sample 700"
    yield "standing clock", replace(log, time_ns=slow), {}, FormatError, "do not increase"
    yield "missing", with_columns(log, acceleration_mps2=missing), {}, NoSolutionError, "667 of 2000"
    yield "degrees", with_columns(log, table_angle_rad=np.degrees(angle)), {}, FormatError, "in radians"
    yield (
        "stuck",
        with_columns(log, acceleration_mps2=np.full(2000, 9.8)),
        {},
        NoSolutionError,
        "every sample",
    )
    yield (
        "saturated", with_columns(log, acceleration_mps2=np.minimum(signal, mean + 1e-4)), {},
        NoSolutionError, "saturated",
    )  # fmt: skip
    yield (
        "nothing",
        with_columns(log, acceleration_mps2=mean + 1e-2 * noise),
        {},
        NoSolutionError,
        "no signal",
    )
    yield (
        "milli-g", with_columns(log, acceleration_mps2=signal / 9.80665e-3), {}, NoSolutionError,
        "the scale is wrong",
    )  # fmt: skip
    yield (
        "parts of turns", replace(log, time_ns=log.time_ns[:1900], columns=cut), {"method": "square-wave"},
        FormatError, "whole revolutions of 500 samples",
    )  # fmt: skip
    holed = np.where(np.arange(len(signal)) == 7, np.nan, signal)
    yield (
        "a hole", with_columns(log, acceleration_mps2=holed), {"method": "square-wave"}, FormatError,
        "1 are missing",
    )  # fmt: skip
    yield "no method", log, {"method": "best"}, ConfigError, "'best'"
    yield "nothing given", (), {}, ConfigError, "no log"


@pytest.mark.parametrize("case", list(refusals()), ids=lambda case: case[0])
def test_what_cannot_be_is_refused_in_one_sentence(case):
    _, log, options, kind, words = case
    with pytest.raises(kind, match=words) as caught:
        find_north_turntable(log, SITE, **options)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("step", [3e-6, 1e-4])
def test_a_sensor_of_coarse_steps_is_not_saturated(step):
    log = run(msgspec.structs.replace(SENSOR, noise_mps2=1e-7, revolutions=20))
    signal = np.rint(log.columns["acceleration_mps2"] / step) * step
    found = find_north_turntable(with_columns(log, acceleration_mps2=signal), SITE, max_vibrations=0)
    # A step that repeats with the revolutions is no noise: odd harmonics of the steps reach the signal.
    assert abs(error_deg(found)) < 0.1 * np.degrees(step / coriolis_amplitude_mps2(SENSOR, FORTY))


def test_a_scale_that_is_somewhat_off_is_told():
    log = run(msgspec.structs.replace(SENSOR, revolutions=40))
    signal = log.columns["acceleration_mps2"]
    found = find_north_turntable(with_columns(log, acceleration_mps2=0.9 * signal), SITE)
    assert any(note.startswith("The signal is 90 %") for note in found.notes)
    assert abs(error_deg(found)) < 4.0 * np.degrees(found.heading_sd_rad)


def test_the_log_describes_its_device():
    sensor = msgspec.structs.replace(SENSOR, radius_m=0.07, table_rpm=-450.0, mark_deg=12.0)
    found = describe_turntable(run(sensor))
    assert (found.radius_m, found.samples_per_revolution, found.mark_deg) == (0.07, 500, 12.0)
    assert found.table_rpm == pytest.approx(-450.0)
    np.testing.assert_allclose(demodulate(found, run(sensor))[0], np.radians(300.0), atol=0.01)
