"""Noise of the sensors is what their descriptions say: sizes, time constants, Allan deviations, counts.

Every bound is a two-sided limit of the statistic's own distribution with a false alarm of 1e-5, so that all
of them together raise fewer than one in a thousand runs; the seeds are fixed.
"""

import allantools
import numpy as np
import pytest
from scipy import stats

from moving_bodies import Circling, Resting, Wobbling, generators
from truenorth.northfinding.turntable import demodulate
from truenorth.sensors import (
    CompassDescription,
    FogDescription,
    ImuDescription,
    OdometerDescription,
    TiltDescription,
    TurntableAccelerometerDescription,
    allan_deviation,
    simulate_compass,
    simulate_gyro,
    simulate_imu,
    simulate_odometer,
    simulate_tilt,
    simulate_turntable_accelerometer,
)
from truenorth.sensors.imu import GRADES, draw_calibration
from truenorth.sensors.processes import (
    flicker,
    flicker_variance,
    gauss_markov,
    gauss_markov_variance,
    poisson_events,
    random_walk,
    random_walk_variance,
)
from truenorth.timescales import gpst_from_calendar

FALSE_ALARM = 1e-5
START_NS = gpst_from_calendar(1997, 10, 15, 22, 13, 0)


def check_variance(squares, degrees, what=""):
    """A sum of squares of standard normal numbers lies within the limits of its chi-square."""
    low, high = stats.chi2.ppf([FALSE_ALARM / 2.0, 1.0 - FALSE_ALARM / 2.0], degrees)
    assert low < squares < high, f"{what}: {squares / degrees:.4f} of the variance asked for"


def check_white(samples, sd, what=""):
    """Samples are white with a standard deviation: size, and neighbours alike no more than by chance."""
    unit = np.asarray(samples) / sd
    check_variance(np.sum(unit**2), unit.size, what)
    pairs = np.sum(unit[1:] * unit[:-1]) / np.sqrt(unit[1:].size)
    assert abs(pairs) < stats.norm.isf(FALSE_ALARM / 2.0) * 1.05, f"{what}: neighbours correlated"


def check_gauss_markov(samples, step_s, sd, time_constant_s, what=""):
    """Samples less their prediction by exp(-dt / T) are white with the variance that belongs to it."""
    fall = np.exp(-step_s / time_constant_s)
    check_white(samples[1:] - fall * samples[:-1], sd * np.sqrt(1.0 - fall**2), what)


def check_allan(samples, rate_hz, tau_s, wanted, alpha, what=""):
    """Overlapping Allan deviations of columns agree with those wanted, by their equivalent freedom."""
    for tau, deviation, power in zip(tau_s, wanted, alpha, strict=True):
        m = round(tau * rate_hz)
        squares, degrees = 0.0, 0.0
        for column in np.reshape(samples, (len(samples), -1)).T:
            _, found, _, _ = allantools.oadev(column, rate=rate_hz, data_type="freq", taus=[m / rate_hz])
            freedom = allantools.edf_simple(len(column) + 1, m, power)
            squares += freedom * (found[0] / deviation) ** 2
            degrees += freedom
        # The freedom is itself good to some per cent: limits a tenth wider than its chi-square.
        low, high = stats.chi2.ppf([FALSE_ALARM / 2.0, 1.0 - FALSE_ALARM / 2.0], degrees) / degrees
        assert 1.0 + 1.1 * (low - 1.0) < squares / degrees < 1.0 + 1.1 * (high - 1.0), (
            f"{what} at {tau} s: {np.sqrt(squares / degrees):.4f} of the Allan deviation asked for"
        )


@pytest.mark.parametrize(("step_s", "time_constant_s"), [(0.1, 10.0), (0.1, 0.25), (1.0, 0.1)])
def test_gauss_markov_has_its_size_from_the_first_sample_and_its_time_constant(step_s, time_constant_s):
    samples = gauss_markov(np.random.default_rng(1), (20_000, 5), step_s, 5.8, time_constant_s)
    check_gauss_markov(samples, step_s, 5.8, time_constant_s)
    many = gauss_markov(np.random.default_rng(2), (3, 4000), step_s, 5.8, time_constant_s)
    for k in (0, 2):
        check_white(many[k], 5.8, f"sample {k}")
    # And by the sample autocorrelation at one time constant, whose error Bartlett's formula bounds.
    lag = max(1, round(time_constant_s / step_s))
    unit = samples / 5.8
    found = np.mean(unit[lag:] * unit[:-lag])
    error = np.sqrt((1.0 + 2.0 * time_constant_s / step_s) / samples.size)
    assert abs(found - np.exp(-lag * step_s / time_constant_s)) < 4.5 * error


def test_random_walk_grows_as_asked():
    walk = random_walk(np.random.default_rng(3), (10_000, 4), 0.1, 0.002)
    assert np.all(walk[0] == 0.0)
    check_white(np.diff(walk, axis=0), 0.002 * np.sqrt(0.1))


def test_allan_variances_of_the_processes_are_those_of_the_formulas():
    rng = np.random.default_rng(4)
    tau = np.array([2.0, 10.0, 50.0])
    markov = gauss_markov(rng, (20_000, 20), 0.1, 3.0, 10.0)
    # Below its time constant a Gauss-Markov process is a random walk (alpha -2), above it white (0).
    wanted = np.sqrt(gauss_markov_variance(tau, 3.0, 10.0))
    check_allan(markov, 10.0, tau, wanted, (-2, -1, 0), "Gauss-Markov")
    walk = random_walk(rng, (20_000, 20), 0.1, 0.1)
    check_allan(walk, 10.0, tau, np.sqrt(random_walk_variance(tau, 0.1)), (-2, -2, -2), "random walk")


def test_flicker_has_a_flat_allan_deviation_at_its_floor():
    tau = np.array([10.0, 30.0, 100.0])
    wanted = np.sqrt(flicker_variance(tau, 2.0))
    assert np.all(np.abs(wanted / 2.0 - 1.0) < 0.04)
    assert np.all(np.abs(np.sqrt(flicker_variance(np.geomspace(30.0, 5e3, 50), 1.0)) - 1.0) < 0.015)
    samples = flicker(np.random.default_rng(5), (20_000, 40), 0.1, 2.0)
    check_allan(samples, 10.0, tau, wanted, (-1, -1, -1), "flicker")


@pytest.mark.parametrize("grade", list(GRADES))
def test_allan_deviation_of_an_imu_at_rest_matches_its_description(grade):
    imu = ImuDescription(grade=grade, rate_hz=20.0)
    still = {}
    for seed in range(4):
        log = simulate_imu(imu, Resting(), start_ns=0, duration_s=3600.0, generator=generators(seed))
        for name in log.columns:
            noise = log.columns[name] - log.truth[name]
            still.setdefault(name, []).append(noise - noise.mean())
    tau = np.array([0.05, 0.5, 5.0, 50.0, 400.0])
    names = [name for name in still if name.startswith(("delta_angle", "rate"))]
    per_increment = imu.rate_hz if imu.output == "increments" else 1.0
    for sensor, deviation in zip(
        (names, [n for n in still if n not in names]), allan_deviation(imu, tau), strict=True
    ):
        columns = np.transpose([column for name in sensor for column in still[name]]) * per_increment
        # Freedom is least where flicker rules; taking it so everywhere only widens the limits.
        check_allan(columns, imu.rate_hz, tau, deviation, (0, 0, 0, -1, -2), f"{grade} {sensor[0]}")


def test_bias_instability_of_an_imu_is_the_floor_of_its_allan_deviation():
    quiet = {key: 0.0 for key in GRADES["tactical"] if key != "output" and "_range_" not in key}
    imu = ImuDescription(rate_hz=1.0, **{**quiet, "gyro_bias_instability_dph": 0.5})
    columns = []
    for seed in range(10):
        log = simulate_imu(imu, Resting(), start_ns=0, duration_s=20_000.0, generator=generators(seed))
        columns += [log.columns[f"delta_angle_{a}_rad"] - log.truth[f"delta_angle_{a}_rad"] for a in "xyz"]
    floor = np.radians(0.5) / 3600.0
    tau = np.array([30.0, 100.0, 300.0])
    check_allan(np.transpose(columns), 1.0, tau, np.full(3, floor), (-1, -1, -1), "floor")


def test_constants_of_imus_are_drawn_with_their_sizes():
    imu, n = ImuDescription(grade="consumer"), 400
    drawn = [draw_calibration(imu, generators(seed)) for seed in range(n)]
    dph, ug = np.pi / 180.0 / 3600.0, 9.80665e-6
    check_white(np.ravel([c.gyro_bias_radps for c in drawn]), 3600.0 * dph)
    check_white(np.ravel([c.accel_bias_mps2 for c in drawn]), 25_000.0 * ug)
    check_white(np.ravel([c.gyro_g_sensitivity for c in drawn]), 360.0 * dph / 9.80665)
    off = ~np.eye(3, dtype=bool)
    for name, scale in (("gyro_matrix", 0.015), ("accel_matrix", 0.005)):
        matrices = np.array([getattr(c, name) for c in drawn]) - np.eye(3)
        check_white(np.ravel(matrices[:, ~off]), scale, name)
        check_white(np.ravel(matrices[:, off]), 0.02, name)


def test_gyro_noise_walk_and_turn_on_bias():
    gyro = FogDescription(bias_sd_count=0.3)
    turn_on = []
    for seed in range(60):
        log = simulate_gyro(gyro, Resting(), start_ns=START_NS, duration_s=60.0, generator=generators(seed))
        turn_on.append(
            log.truth["bias_count"][0]
            - np.interp(log.truth["temperature_degc"][0], *zip(*gyro.bias_table, strict=True))
        )
    check_white(turn_on, 0.3, "turn-on bias")
    gyro = FogDescription()
    log = simulate_gyro(gyro, Resting(), start_ns=START_NS, duration_s=2400.0, generator=generators())
    check_white(log.truth["noise_radps"], np.radians(0.12) / 60.0 / np.sqrt(0.1), "angle random walk")
    table = np.interp(log.truth["temperature_degc"], *zip(*gyro.bias_table, strict=True))
    check_white(np.diff(log.truth["bias_count"] - table), 0.002 * np.sqrt(0.1), "bias walk")


def test_quantisation_of_a_turning_gyro_is_uniform():
    log = simulate_gyro(
        FogDescription(), Wobbling(), start_ns=START_NS, duration_s=1200.0, generator=generators()
    )
    error = log.truth["quantisation_count"]
    assert np.abs(error).max() <= 0.5
    assert stats.kstest(error, stats.uniform(-0.5, 1.0).cdf).pvalue > FALSE_ALARM


def test_samples_of_the_gyro_fall_into_seconds_as_the_clock_says():
    log = simulate_gyro(
        FogDescription(), Resting(), start_ns=START_NS, duration_s=2400.0, generator=generators(3)
    )
    shares = np.bincount(np.bincount((log.time_ns - START_NS) // 10**9)[1:-1], minlength=12) / 2399.0
    # A stamp is up to 55 ms early, and the first sample of a second lies 30 ms after its start: it is stamped
    # in the second before with a chance of 25 in 55, and each such second is one sample richer at the cost
    # of the next.
    assert shares[[9, 10, 11]].sum() == pytest.approx(1.0, abs=1e-3)
    assert shares[9] == pytest.approx(shares[11], abs=0.02)
    assert shares[9] > 0.05


def test_compass_error_on_the_road_and_at_rest():
    compass = CompassDescription(anomalies_per_minute=0.0)
    for body, sd in ((Circling(), None), (Resting(), 2.0)):
        log = simulate_compass(compass, body, start_ns=START_NS, duration_s=7200.0, generator=generators(2))
        if sd is None:
            share = 100.0 / 101.0  # of moving, at 10 m/s
            sd = np.sqrt(share * 5.8**2 + (1.0 - share) * 2.0**2)
        check_gauss_markov(np.degrees(log.truth["wander_rad"]) + 1.2, 0.1, sd, 10.0, type(body).__name__)
        # The mean of a process with T = 10 s over two hours: sd sqrt(2 T / 7200 s).
        mean = np.degrees(log.truth["error_rad"]).mean()
        assert abs(mean + 1.2) < 4.5 * sd * np.sqrt(20.0 / 7200.0)


def test_passing_cars_come_as_often_and_last_as_long_as_asked():
    count = len(poisson_events(np.random.default_rng(6), 0.5 / 60.0, 1e6))
    low, high = stats.poisson.ppf([FALSE_ALARM / 2.0, 1.0 - FALSE_ALARM / 2.0], 1e6 * 0.5 / 60.0)
    assert low <= count <= high
    compass = CompassDescription(anomalies_per_minute=0.5, anomaly_sd_nt=3000.0)
    log = simulate_compass(compass, Resting(), start_ns=START_NS, duration_s=14_400.0, generator=generators())
    disturbed = log.truth["anomaly_nt"] > 0.0
    # Durations 4 s times 2^u, u uniform in (-1, 1): mean 4 * 1.5 / (2 ln 2) s; overlaps are some per cent.
    mean_s = 4.0 * 1.5 / (2.0 * np.log(2.0))
    covered = -np.expm1(-0.5 / 60.0 * mean_s)
    spread = np.sqrt(14_400.0 * 0.5 / 60.0 * (mean_s**2 * 1.2)) / 14_400.0
    assert abs(disturbed.mean() - covered) < 4.5 * spread
    starts = np.sum(np.diff(disturbed.astype(int)) == 1)
    low, high = stats.poisson.ppf([FALSE_ALARM / 2.0, 1.0 - FALSE_ALARM / 2.0], 14_400.0 * 0.5 / 60.0)
    assert low * (1.0 - covered) - 2.0 < starts <= high


def test_independent_anomaly_flag_is_raised_by_its_share_and_knows_nothing():
    log = simulate_compass(
        CompassDescription(), Circling(), start_ns=START_NS, duration_s=14_400.0, generator=generators()
    )
    raised = log.columns["anomaly"]
    # Thrown anew every 5 s: the variance of the mean is p (1 - p) 2 T / duration.
    spread = np.sqrt(0.61 * 0.39 * 10.0 / 14_400.0)
    assert abs(raised.mean() - 0.61) < 4.5 * spread
    error = np.abs(log.truth["error_rad"])
    effective = 14_400.0 / 2.0 / (1.0 / (1.0 / 5.0 + 2.0 / 10.0))
    assert abs(np.corrcoef(raised, error)[0, 1]) < 4.5 / np.sqrt(effective)
    changes = np.mean(np.diff(raised) != 0)
    # Neighbours differ when the flag is thrown and falls the other way.
    wanted = -np.expm1(-0.1 / 5.0) * 2.0 * 0.61 * 0.39
    assert changes == pytest.approx(wanted, abs=4.5 * np.sqrt(wanted / len(raised)))


def test_tilt_noise_moving_and_still():
    tilt = TiltDescription()
    for body, share in ((Circling(), 100.0 / 101.0), (Resting(), 0.0)):
        log = simulate_tilt(tilt, body, start_ns=0, duration_s=2400.0, generator=generators(5))
        for k, angle in enumerate(("pitch", "roll")):
            sd = np.sqrt(
                share * tilt.noise_moving_deg[k] ** 2 + (1.0 - share) * tilt.noise_static_deg[k] ** 2
            )
            check_gauss_markov(np.degrees(log.truth[f"{angle}_noise_rad"]), 0.1, sd, 0.25, angle)


def test_odometer_scale_and_slips():
    scales, slips = [], 0
    for seed in range(150):
        log = simulate_odometer(
            OdometerDescription(slips_per_minute=2.0), Circling(), start_ns=0, duration_s=60.0,
            generator=generators(seed),
        )  # fmt: skip
        scales.append(log.truth["scale"][0] - 1.0)
        slips += np.mean(log.truth["slip"] != 0.0) * 60.0
    check_white(scales, 0.005, "scale")
    # 300 slips of mean 1.5 * 1.5 / (2 ln 2) s, less what overlaps or ends with the record.
    assert slips == pytest.approx(300.0 * 1.623, rel=0.25)


@pytest.mark.parametrize("latitude_deg", [20.0, 30.0, 40.0])
def test_azimuth_noise_of_the_turntable_is_that_of_theory(latitude_deg):
    sensor = TurntableAccelerometerDescription(revolutions=600)
    body = Resting(np.radians(latitude_deg), heading_deg=-60.0)
    log = simulate_turntable_accelerometer(sensor, body, start_ns=0, duration_s=61.0, generator=generators())
    heading, _ = demodulate(sensor, log)
    error = np.mod(heading + np.radians(60.0) + np.pi, 2.0 * np.pi) - np.pi
    # One revolution by square waves: T sigma / (8 w_N rho sqrt(M)); 0.1147, 0.1014, 0.0935 deg at 40, 30, 20.
    north = 7.2921151467e-5 * np.cos(body.latitude)
    theory = 0.1 * 1e-5 / (8.0 * north * 0.05 * np.sqrt(500.0))
    assert np.degrees(theory) == pytest.approx(
        {20.0: 0.0935, 30.0: 0.1014, 40.0: 0.1147}[latitude_deg], abs=2e-4
    )
    check_white(error, theory)
