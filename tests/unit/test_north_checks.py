"""Records of simulated units: the honest ones pass with what they feel, the others are told apart."""

import re

import numpy as np
import pytest

from moving_bodies import Body, Circling, Resting, generators
from truenorth.errors import NoSolutionError
from truenorth.northfinding import Site
from truenorth.northfinding.checks import check_record
from truenorth.sensors import ImuDescription, simulate_imu
from truenorth.sensors.imu import GRADES, imu_increments_from_log
from truenorth.simulation.motion import build_trajectory
from truenorth.simulation.motion.fixed import StaticMotion, TurntableMotion
from truenorth.strapdown import InertialIncrements, reference_increments

LATITUDE = np.radians(40.0)
SITE = Site(LATITUDE, 0.5, 100.0)
PERFECT = {key: 0.0 for key in GRADES["tactical"] if key != "output" and "_range_" not in key}


def record(imu, motion, duration_s=60.0, seed=1, latitude=LATITUDE):
    """Increments of a unit on a simulated body."""
    mover = motion
    if not isinstance(motion, Body):
        mover = build_trajectory(
            motion, latitude_rad=latitude, longitude_rad=0.5, height_m=100.0, duration_s=duration_s, seed=seed
        )
    log = simulate_imu(imu, mover, start_ns=0, duration_s=duration_s, generator=generators(seed))
    angle, velocity = imu_increments_from_log(imu, log)
    return InertialIncrements(np.arange(len(angle) + 1) / imu.rate_hz, angle, velocity)


@pytest.fixture(scope="module")
def quiet():
    """A navigation unit at rest."""
    imu = ImuDescription(grade="navigation", rate_hz=50.0)
    return record(imu, StaticMotion(heading_deg=70.0, pitch_deg=10.0, roll_deg=-20.0), 120.0)


def changed(increments, *, gyro=1.0, force=1.0, plus=0.0):
    return InertialIncrements(
        increments.time_s, gyro * increments.angle_rad + plus, force * increments.velocity_mps
    )


def refused(increments, said, **options):
    with pytest.raises(NoSolutionError, match=said) as caught:
        check_record(increments, SITE, **options)
    sentence = str(caught.value)
    assert "\n" not in sentence
    assert re.search("check|select|record|take", sentence), "nothing is advised"
    return sentence


@pytest.mark.parametrize("latitude_deg", [0.0, 40.0, -60.0, 89.0])
def test_an_ideal_unit_feels_gravity_and_the_earth(latitude_deg):
    latitude = np.radians(latitude_deg)
    site = Site(latitude, 0.5, 100.0)
    motion = StaticMotion(heading_deg=200.0, pitch_deg=-30.0, roll_deg=100.0)
    felt = check_record(record(ImuDescription(rate_hz=20.0, **PERFECT), motion, latitude=latitude), site)
    assert felt.gravity_mps2 == pytest.approx(site.gravity_mps2, abs=1e-6)
    assert felt.horizontal_rate_radps == pytest.approx(site.horizontal_rate_radps, rel=1e-4, abs=1e-10)
    assert felt.earth_rate_radps == pytest.approx(np.linalg.norm(site.earth_rate_ned_radps), rel=1e-4)
    assert np.degrees(felt.latitude_rad) == pytest.approx(latitude_deg, abs=0.01)
    assert np.degrees(felt.turned_rad) < 0.01
    assert set(felt.figures()) >= {"gravity_mps2", "earth_rate_dph", "latitude_deg", "turned_deg"}
    assert all(np.isfinite(list(felt.figures().values())))


@pytest.mark.parametrize("grade", list(GRADES))
@pytest.mark.parametrize("duration_s", [20.0, 120.0])
def test_every_grade_passes_by_its_own_statement(grade, duration_s):
    imu = ImuDescription(grade=grade, rate_hz=50.0)
    for seed in (1, 2, 3):
        motion = StaticMotion(heading_deg=70.0 * seed, pitch_deg=20.0, roll_deg=-60.0 * seed)
        check_record(record(imu, motion, duration_s, seed), SITE, errors=imu)


def test_a_large_bias_passes_only_where_it_is_stated():
    imu = ImuDescription(grade="industrial", rate_hz=50.0)
    biased = record(imu, StaticMotion(), seed=3)
    check_record(biased, SITE, errors=imu)
    refused(biased, "state their bias if it is larger than the Earth rate")
    refused(biased, "Earth turns it", errors=ImuDescription(grade="navigation", rate_hz=50.0))


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (180.0 / np.pi, "a factor of 57.*degrees taken as radians"),
        (1e3, r"which looks like thousandths taken as whole units"),
        (9.8, "a factor of 9.[78]"),
        (3.0, "a factor of (3|2.9)"),
        (np.pi / 180.0, "do not feel the Earth turn: 0.[23]"),
        (1e-3, "do not feel the Earth turn: 0.0"),
        (0.3, "do not feel the Earth turn: 4.[45]"),
    ],
)
def test_gyros_with_a_wrong_factor(quiet, factor, said):
    refused(changed(quiet, gyro=factor), said)
    # Stated errors of a good unit excuse nothing.
    refused(changed(quiet, gyro=factor), "Earth turn", errors=ImuDescription(grade="navigation"))


def test_gyros_and_accelerometers_that_contradict_each_other(quiet):
    refused(changed(quiet, force=-1.0), "as at latitude -40.*check the latitude, the axes")
    with pytest.raises(NoSolutionError, match=r"as at latitude 40.* at -40"):
        check_record(quiet, Site(-LATITUDE))


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (9.80665, "a factor of 9.8.*, which looks like m/s\\^2 taken as g"),
        (1.0 / 9.80665, "which looks like g taken as m/s\\^2"),
        (1e-3, "which looks like g taken as mg"),
        (1e3, "which looks like mg taken as g"),
        (50.0, "which looks like forces taken as velocity increments"),
        (0.02, "which looks like velocity increments taken as forces"),
        (57.3, r"a factor of 57.3\);"),
        (1.05, r"\+5.0 %\)"),
        (0.0, r"a factor of 0\)"),
    ],
)
def test_accelerometers_with_a_wrong_factor(quiet, factor, said):
    refused(changed(quiet, force=factor), said)


def test_accelerometers_as_poor_as_stated_pass(quiet):
    poor = ImuDescription(grade="navigation", accel_scale_sd_ppm=20_000.0)
    check_record(changed(quiet, force=1.05), SITE, errors=poor)


def test_dead_gyros_and_axes(quiet):
    refused(changed(quiet, gyro=0.0), "zero rate")
    for axis, name in enumerate("xyz"):
        alive = np.ones(3)
        alive[axis] = 0.0
        refused(changed(quiet, gyro=alive), f"gyro {name} gives the same value")
        refused(changed(quiet, force=alive), f"accelerometer {name} gives the same value|gravity is")
    # A constant that is no Earth rate is no life.
    refused(changed(quiet, gyro=0.0, plus=1e-9), "do not feel the Earth turn")


def test_missing_numbers_and_short_records(quiet):
    angle = quiet.angle_rad.copy()
    angle[70, 1] = np.nan
    refused(
        InertialIncrements(quiet.time_s, angle, quiet.velocity_mps),
        r"gyros have no number at 1.400 s \(1 such",
    )
    refused(
        InertialIncrements(quiet.time_s, quiet.angle_rad, quiet.velocity_mps * np.inf), "accelerometers have"
    )
    refused(
        InertialIncrements(quiet.time_s[:301], quiet.angle_rad[:300], quiet.velocity_mps[:300]), "is 6 s long"
    )
    refused(InertialIncrements(np.zeros(1), np.zeros((0, 3)), np.zeros((0, 3))), "is 0 s long")


# ---------------------------------------------------------------------------------------------- saturation


def noisy(n=6000, seed=5):
    """A shaken unit at rest: rates and forces with ample noise, 100 Hz."""
    rng = np.random.default_rng(seed)
    ideal = reference_increments(
        build_trajectory(
            StaticMotion(), latitude_rad=LATITUDE, longitude_rad=0.5, height_m=100.0, duration_s=60.0, seed=1
        ),
        np.arange(n + 1) * 0.01,
    )
    # Differences, so that the noise does not walk away.
    shake = np.diff(rng.normal(0.0, 1e-4, (n + 1, 3)), axis=0)
    push = np.diff(rng.normal(0.0, 2e-3, (n + 1, 3)), axis=0)
    return InertialIncrements(ideal.time_s, ideal.angle_rad + shake, ideal.velocity_mps + push)


def test_a_stated_range_that_is_reached():
    shaken = noisy()
    limit_dps = float(np.degrees(np.abs(shaken.angle_rad).max()) * 100.0)
    check_record(shaken, SITE, errors=ImuDescription(gyro_range_dps=1.01 * limit_dps))
    said = refused(
        shaken, "gyro [xyz] is saturated: 1 of its", errors=ImuDescription(gyro_range_dps=limit_dps)
    )
    assert f"range of {limit_dps:.4g} deg/s" in said
    refused(shaken, "accelerometer z is saturated: 6000", errors=ImuDescription(accel_range_g=0.5))


@pytest.mark.parametrize("step", [0.0, 2e-5])
@pytest.mark.parametrize("sigmas", [0.5, 1.0, 1.5])
def test_clipping_shows_where_no_range_is_stated(step, sigmas):
    shaken = noisy()
    angle = shaken.angle_rad if step == 0.0 else np.rint(shaken.angle_rad / step) * step
    check_record(InertialIncrements(shaken.time_s, angle, shaken.velocity_mps), SITE)
    limit = sigmas * np.std(angle[:, 1])
    limit = limit if step == 0.0 else np.rint(limit / step) * step
    angle = angle.copy()
    angle[:, 1] = np.clip(angle[:, 1], -limit, limit)
    refused(InertialIncrements(shaken.time_s, angle, shaken.velocity_mps), "gyro y is saturated")


@pytest.mark.parametrize("step", [0.0, 1e-5, 3e-5])
def test_an_oscillation_is_no_clipping(step):
    # A sine is often at its ends, and in counts up to 2.4 times as often as next to them.
    shaken = noisy()
    seconds = shaken.time_s
    for amplitude in np.linspace(1e-4, 2e-4, 7):
        angle = shaken.angle_rad.copy()
        angle[:, 0] = angle[:, 0].mean() + amplitude * np.sin(2.0 * np.pi * 3.217 * seconds[1:])
        if step > 0.0:
            total = np.cumsum(angle[:, 0])
            angle[:, 0] = np.rint(angle[:, 0] / step) * step
            angle[:, 0] += (total[-1] - angle[:, 0].sum()) / len(angle)
        check_record(InertialIncrements(seconds, angle, shaken.velocity_mps), SITE)


# ------------------------------------------------------------------------------------------------- moving


def test_a_body_that_turns_is_told_to_where_it_may_not():
    imu = ImuDescription(grade="navigation", rate_hz=50.0)
    two = record(imu, TurntableMotion(steps=((0.0, 0.0), (50.0, 18.0), (60.0, 0.0))), 120.0)
    sentence = refused(two, r"the body turns: at [\d.]+ s it stands 180 degrees from its start")
    assert "several positions" in sentence
    felt = check_record(two, SITE, may_turn=True)
    assert felt.latitude_rad is None
    assert felt.earth_rate_radps is None
    assert felt.horizontal_rate_radps == pytest.approx(SITE.horizontal_rate_radps, rel=0.05)
    assert np.degrees(felt.turned_rad) == pytest.approx(180.0, abs=1.0)
    assert "earth_rate_dph" not in felt.figures()


@pytest.mark.parametrize("grade", ["navigation", "tactical", "industrial"])
@pytest.mark.parametrize("stated", [True, False])
def test_turntables_pass_with_the_biases_that_they_remove(grade, stated):
    imu = ImuDescription(grade=grade, rate_hz=50.0)
    for motion in (
        TurntableMotion(rate_dps=10.0, tilt_deg=3.0),
        TurntableMotion(steps=((0.0, 0.0), (50.0, 18.0), (60.0, 0.0))),
    ):
        check_record(record(imu, motion, 110.0), SITE, errors=imu if stated else None, may_turn=True)


def test_a_turntable_with_gyros_in_wrong_units_is_refused():
    imu = ImuDescription(grade="navigation", rate_hz=50.0)
    two = record(imu, TurntableMotion(steps=((0.0, 0.0), (50.0, 18.0), (60.0, 0.0))), 120.0)
    refused(changed(two, gyro=np.pi / 180.0), "do not feel the Earth turn", may_turn=True)
    refused(changed(two, gyro=180.0 / np.pi), "gyros turn gravity by", may_turn=True)


def test_a_vehicle_that_drives_is_not_at_rest():
    class Shuttling(Resting):
        """Forth and back along a street of 76 m."""

        def way(self, t):
            size, rate = 38.0, 2.0 * np.pi / 60.0
            north = np.array([1.0, 0.0, 0.0])
            return (
                size * np.outer(np.sin(rate * t), north),
                size * rate * np.outer(np.cos(rate * t), north),
                -size * rate**2 * np.outer(np.sin(rate * t), north),
            )

    class Braking(Shuttling):
        def way(self, t):
            return tuple(12.0 * part for part in super().way(t))

    imu = ImuDescription(grade="navigation", rate_hz=20.0)
    refused(record(imu, Circling(speed_mps=5.0, radius_m=100.0)), "turns about the vertical by 2.86 deg/s")
    refused(
        record(imu, Shuttling(), 120.0),
        r"the body is not at rest: beside gravity its velocity changes by 2\.\d",
    )
    refused(
        record(imu, Braking(), 120.0), r"the body is not at rest: the specific force is .* changes by 0\.\d"
    )


def test_a_tilting_platform_does_not_feel_a_different_earth():
    """Plain averages take a tilt of 0.05 degrees in two minutes for 1.5 deg/h."""

    class Settling(Resting):
        def angles(self, t):
            heading, _, roll, heading_rate, _, roll_rate = super().angles(t)
            pitch = np.radians(0.05) * t / 120.0
            return heading, pitch, roll, heading_rate, np.full_like(t, np.radians(0.05) / 120.0), roll_rate

    body = Settling(heading_deg=30.0)
    site = Site(body.latitude)
    imu = ImuDescription(grade="navigation", rate_hz=50.0)
    increments = record(imu, body, 120.0)
    felt = check_record(increments, site)
    plain = np.linalg.norm(increments.angle_rad.sum(axis=0)[:2]) / 120.0
    assert abs(plain - site.horizontal_rate_radps) > 0.05 * site.horizontal_rate_radps
    assert felt.horizontal_rate_radps == pytest.approx(site.horizontal_rate_radps, rel=0.01)


def test_tilts_tell_the_factor_of_gyros_that_shaking_hides():
    """A rocking body: the accelerometers feel the same tilts as the gyros, if the gyros' unit is right."""

    class Rocking(Resting):
        def angles(self, t):
            heading, _, roll, heading_rate, _, roll_rate = super().angles(t)
            swing, rate = np.radians(1.0), 2.0 * np.pi / 25.0
            return (
                heading,
                swing * np.sin(rate * t),
                roll,
                heading_rate,
                swing * rate * np.cos(rate * t),
                roll_rate,
            )

    body = Rocking(heading_deg=30.0)
    site = Site(body.latitude)
    increments = record(ImuDescription(grade="navigation", rate_hz=20.0), body, 120.0)
    assert check_record(increments, site).horizontal_rate_radps == pytest.approx(
        site.horizontal_rate_radps, rel=0.02
    )
    with pytest.raises(
        NoSolutionError, match=r"tilt 5[67].*times as far as the gyros say, which looks like radians"
    ):
        check_record(changed(increments, gyro=np.pi / 180.0), site)
