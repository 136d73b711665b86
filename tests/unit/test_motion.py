"""Motions: derivatives without a gap, limits kept, and each kind as it is described."""

import msgspec
import numpy as np
import pytest

from motions import HEIGHT_M, KINDS, LATITUDE_RAD, LONGITUDE_RAD, SECTIONS, table_trajectory, trajectory
from truenorth.errors import ConfigError, FormatError
from truenorth.frames import ecef_from_geodetic, geodetic_from_ecef, rot_enu_from_ecef, rot_ned_from_ecef
from truenorth.gravity import normal_gravity_mps2
from truenorth.rotations import log_so3, rot_ned_from_body
from truenorth.simulation import motion as motions
from truenorth.simulation.motion import (
    AircraftMotion,
    CircleMotion,
    MotionSection,
    Move,
    ShipMotion,
    StaticMotion,
    SuburbanMotion,
    SwayMotion,
    TableMotion,
    TableTrajectory,
    TurntableMotion,
    build_trajectory,
    specific_force_body_mps2,
)

DURATION_S = 300.0
PLACE = {"latitude_rad": LATITUDE_RAD, "longitude_rad": LONGITUDE_RAD, "height_m": HEIGHT_M}
RNG = np.random.Generator(np.random.PCG64(7))
INSTANTS = np.sort(RNG.uniform(-2.0, DURATION_S + 2.0, 400))


def build(section, duration_s=DURATION_S, seed=3, folder=""):
    return build_trajectory(section, **PLACE, duration_s=duration_s, seed=seed, folder=folder)


def local(motion):
    """Positions in the east, north, up of the start."""
    origin = ecef_from_geodetic(LATITUDE_RAD, LONGITUDE_RAD, HEIGHT_M)
    return (motion.position_ecef_m - origin) @ rot_enu_from_ecef(LATITUDE_RAD, LONGITUDE_RAD).T


def body(motion, vectors):
    return np.einsum("nji,nj->ni", motion.rot_ecef_from_body, vectors)


def differences(kind, step):
    """Largest disagreement of each derivative with a central difference."""
    moving = trajectory(kind, DURATION_S)
    now, after, before = (moving.at(INSTANTS + shift) for shift in (0.0, step, -step))
    velocity = (after.position_ecef_m - before.position_ecef_m) / (2.0 * step)
    acceleration = (after.velocity_ecef_mps - before.velocity_ecef_mps) / (2.0 * step)
    turned = np.swapaxes(before.rot_ecef_from_body, -1, -2) @ after.rot_ecef_from_body
    return np.array(
        [
            np.max(np.abs(velocity - now.velocity_ecef_mps)),
            np.max(np.abs(acceleration - now.acceleration_ecef_mps2)),
            np.max(np.abs(log_so3(turned) / (2.0 * step) - now.rate_body_radps)),
        ]
    )


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_are_those_of_the_position_and_attitude(kind):
    steps = np.array([1e-2, 1e-3])
    errors = np.array([differences(kind, step) for step in steps])
    # The error of a central difference falls with the square of the step, down to the rounding: a nanometre
    # of position, 1e-12 of velocity, 1e-14 of attitude (of a heading of many turns).
    rounding = np.array([4e-9, 2e-12, 1e-14])[None, :] / steps[:, None]
    assert np.all(errors[1] < errors[0] / 50.0 + rounding[1])
    # A vehicle shaken at 14 Hz has jerks of some 40 m/s^3, whose second derivative is 3e5 m/s^5.
    assert np.all(errors[0] < [0.02, 0.1, 0.02])
    assert np.all(errors[1] < [1e-5, 2e-3, 2e-4])


@pytest.mark.parametrize("kind", KINDS)
def test_no_steps_in_acceleration_and_rate(kind):
    moving = trajectory(kind, DURATION_S)
    # A hundred times finer, a smooth function changes a hundred times less from sample to sample, a step does
    # not change less. Every stop, corner, lap and spline knot of a minute is passed.
    for name in ("acceleration_ecef_mps2", "rate_body_radps"):
        largest = {}
        for step in (1e-1, 1e-3):
            values = getattr(moving.at(np.arange(25.0, 85.0, step)), name)
            largest[step] = np.max(np.abs(np.diff(values, axis=0)))
        # Coarse samples of a vibration miss part of its slope, hence the factor 5.
        assert largest[1e-3] < 0.05 * largest[1e-1] + 1e-9


@pytest.mark.parametrize("kind", KINDS)
def test_attitude_is_against_the_local_level(kind):
    motion = trajectory(kind, DURATION_S).at(INSTANTS)
    latitude, longitude, _ = geodetic_from_ecef(motion.position_ecef_m)
    level = rot_ned_from_ecef(latitude, longitude)
    angles = rot_ned_from_body(motion.heading_rad, motion.pitch_rad, motion.roll_rad)
    # Bowring's latitude comes back to some 1e-15 rad.
    assert np.max(np.abs(level @ motion.rot_ecef_from_body - angles)) < 1e-14
    assert np.all((motion.heading_rad >= 0.0) & (motion.heading_rad < 2.0 * np.pi))


@pytest.mark.parametrize("kind", KINDS)
def test_distance_is_the_length_of_the_way(kind):
    moving = trajectory(kind, DURATION_S)
    time_s = np.arange(0.0, DURATION_S + 0.005, 0.01)
    motion = moving.at(time_s)
    latitude, longitude, _ = geodetic_from_ecef(motion.position_ecef_m)
    east, north, _ = np.einsum("nij,nj->in", rot_enu_from_ecef(latitude, longitude), motion.velocity_ecef_mps)
    # What a platform does about its place is no way.
    speed = 0.0 * east if kind == "sway" else np.hypot(east, north)
    length = np.sum(0.5 * (speed[1:] + speed[:-1])) * 0.01
    ends = moving.distance_m(time_s[[0, -1]])
    # A far flight is shortened by the height and the tangent plane: (75 km)^2 / 2 R^2 at its end.
    assert ends[1] - ends[0] == pytest.approx(length, rel=1e-4 if "far" in kind else 5e-6, abs=1e-6)
    assert np.all(np.diff(moving.distance_m(time_s)) >= -1e-9)
    assert ends[0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("kind", ["waypoints", "closed waypoints", "suburban", "circuit", "aircraft"])
def test_heading_follows_the_velocity_and_is_held_at_stops(kind):
    moving = trajectory(kind, DURATION_S)
    motion = moving.at(INSTANTS)
    speed = np.linalg.norm(motion.velocity_ecef_mps, axis=1)
    sideways = body(motion, motion.velocity_ecef_mps)[:, 1]
    going = speed > 1e-3
    if kind != "aircraft":
        # Across the heading on the map: in a rolled body the vertical velocity has a part to the side.
        latitude, longitude, _ = geodetic_from_ecef(motion.position_ecef_m)
        enu = np.einsum("nij,nj->ni", rot_enu_from_ecef(latitude, longitude), motion.velocity_ecef_mps)
        sideways = enu[:, 0] * np.cos(motion.heading_rad) - enu[:, 1] * np.sin(motion.heading_rad)
        assert np.max(np.abs(sideways[going])) < 1e-9
        assert not np.all(going)
    assert np.allclose(np.exp(1j * moving.course_rad(INSTANTS)), np.exp(1j * motion.heading_rad), atol=1e-9)
    assert np.max(np.abs(motion.rate_body_radps[speed == 0.0]), initial=0.0) < 1e-12


def test_side_offset():
    section = SECTIONS["circle"]
    motion, course = build(section).at(INSTANTS), build(section).course_rad(INSTANTS)
    off = np.angle(np.exp(1j * (motion.heading_rad - course)))
    assert np.degrees(off) == pytest.approx(section.body.side_offset_deg)


@pytest.mark.parametrize("kind", ["suburban", "circuit", "ship", "sway"])
def test_same_seed_same_motion(kind):
    first, again, other = (trajectory(kind, DURATION_S, seed).at(INSTANTS) for seed in (3, 3, 4))
    assert np.array_equal(first.position_ecef_m, again.position_ecef_m)
    assert np.array_equal(first.rot_ecef_from_body, again.rot_ecef_from_body)
    assert not np.array_equal(first.rot_ecef_from_body, other.rot_ecef_from_body)


@pytest.mark.parametrize("kind", ["suburban", "closed waypoints", "ship"])
def test_a_longer_scenario_begins_like_a_shorter_one(kind):
    inside = INSTANTS[INSTANTS < DURATION_S - 20.0]
    short = trajectory(kind, DURATION_S).at(inside)
    long = trajectory(kind, 4.0 * DURATION_S).at(inside)
    # The ship's curve is laid through points that divide its whole length.
    assert np.max(np.abs(short.position_ecef_m - long.position_ecef_m)) < (1.0 if kind == "ship" else 1e-6)


def test_static():
    motion = build(StaticMotion(heading_deg=30.0, pitch_deg=2.0, roll_deg=-5.0)).at(INSTANTS)
    origin = ecef_from_geodetic(LATITUDE_RAD, LONGITUDE_RAD, HEIGHT_M)
    assert np.all(motion.position_ecef_m == origin)
    assert not motion.velocity_ecef_mps.any()
    assert not motion.rate_body_radps.any()
    angles = np.degrees([motion.heading_rad[0], motion.pitch_rad[0], motion.roll_rad[0]])
    assert angles == pytest.approx([30.0, 2.0, -5.0])


def test_level_platform_feels_gravity_upwards():
    force = specific_force_body_mps2(build(StaticMotion()).at(INSTANTS[:1]))[0]
    # Somigliana's formula on the ellipsoid and the free-air gradient, which is 3.086e-6 /s^2 within 0.1 %.
    gravity = normal_gravity_mps2(LATITUDE_RAD) - 3.086e-6 * HEIGHT_M
    assert force == pytest.approx([0.0, 0.0, -gravity], abs=1e-5)


def test_turntable_turns_about_its_axis():
    section = TurntableMotion(rate_dps=9.0, tilt_deg=20.0, tilt_azimuth_deg=70.0, heading_deg=10.0)
    motion = build(section).at(np.arange(0.0, 40.0, 0.5))
    ned = rot_ned_from_ecef(LATITUDE_RAD, LONGITUDE_RAD) @ motion.rot_ecef_from_body
    tilt, lean = np.radians(20.0), np.radians(70.0)
    # The axis, upwards: 20 degrees from the zenith towards azimuth 70.
    axis = np.array([np.sin(tilt) * np.cos(lean), np.sin(tilt) * np.sin(lean), -np.cos(tilt)])
    assert np.max(np.abs(-ned[:, :, 2] - axis)) < 1e-15
    assert motion.rate_body_radps == pytest.approx(np.tile([0.0, 0.0, np.radians(9.0)], (80, 1)))
    # The nose dips most where it points to the azimuth the axis leans to.
    assert np.degrees(np.min(motion.pitch_rad)) == pytest.approx(-20.0, abs=0.1)


def test_a_shaken_platform_stays_about_its_place():
    section = SwayMotion(heading_deg=75.0, pitch_deg=3.0, roll_drift_deg_per_h=6.0)
    time_s = np.arange(0.0, 3600.0, 0.25)
    motion = build(section, 3600.0).at(time_s)
    east, north, up = local(motion).T
    turn = np.radians(75.0)
    surge, sway = np.sin(turn) * east + np.cos(turn) * north, np.cos(turn) * east - np.sin(turn) * north
    # An amplitude is the standard deviation times the root of two; the sums of 32 lines have it in the mean
    # over a time that is long against the distance of the lines.
    for values, amplitude in ((surge, 0.002), (sway, 0.004), (up, 0.001)):
        assert np.mean(values) == pytest.approx(0.0, abs=0.01 * amplitude)
        assert np.std(values) == pytest.approx(amplitude / np.sqrt(2.0), rel=0.02)
    degrees = np.degrees([motion.heading_rad, motion.pitch_rad, motion.roll_rad])
    degrees[2] -= 6.0 * time_s / 3600.0
    for values, mean, amplitude in zip(degrees, (75.0, 3.0, 0.0), (0.02, 0.05, 0.1), strict=True):
        assert np.mean(values) == pytest.approx(mean, abs=0.01 * amplitude)
        assert np.std(values) == pytest.approx(amplitude / np.sqrt(2.0), rel=0.02)


def test_moves_of_a_platform_last_or_come_back():
    still = {"yaw": (), "pitch": (), "roll": (), "surge": (), "sway": (), "heave": ()}
    section = SwayMotion(
        heading_deg=90.0,
        moves=(
            Move(at_s=10.0, duration_s=4.0, yaw_deg=30.0, surge_m=2.0),
            Move(at_s=20.0, duration_s=4.0, lasting=False, pitch_deg=5.0, heave_m=0.5),
        ),
        **still,
    )
    motion = build(section).at(np.array([9.9, 12.0, 14.1, 22.0, 24.1]))
    assert np.degrees(motion.heading_rad) == pytest.approx([90.0, 105.0, 120.0, 120.0, 120.0], abs=1e-6)
    assert np.degrees(motion.pitch_rad) == pytest.approx([0.0, 0.0, 0.0, 5.0, 0.0], abs=1e-6)
    # Forward along the mean heading, whatever the platform is turned to.
    assert local(motion)[:, 0] == pytest.approx([0.0, 1.0, 2.0, 2.0, 2.0], abs=1e-6)
    assert local(motion)[:, 2] == pytest.approx([0.0, 0.0, 0.0, 0.5, 0.0], abs=1e-6)


def test_turntable_steps():
    turning = build(TurntableMotion(steps=((0.0, 0.0), (20.0, 30.0), (60.0, -10.0), (80.0, 0.0)), ramp_s=1.0))
    at = turning.at(np.array([10.0, 40.0, 70.0, 90.0, 300.0]))
    assert np.degrees(at.rate_body_radps[:, 2]) == pytest.approx([0.0, 30.0, -10.0, 0.0, 0.0], abs=1e-9)
    # 40 s at 30 deg/s and 20 s back at 10: 1000 degrees; the ramps are symmetric about the instants.
    assert np.degrees(at.heading_rad) == pytest.approx([0.0, 240.0, 20.0, 280.0, 280.0], abs=1e-6)


@pytest.mark.parametrize("clockwise", [True, False])
def test_circle(clockwise):
    moving = build(CircleMotion(radius_m=30.0, speed_mps=6.0, clockwise=clockwise, heading_deg=20.0))
    lap_s = 2.0 * np.pi * 30.0 / 6.0
    enu = local(moving.at(np.array([0.0, lap_s / 4.0, lap_s / 2.0, lap_s])))
    side = 1.0 if clockwise else -1.0
    right = side * np.array([np.cos(np.radians(20.0)), -np.sin(np.radians(20.0))])
    ahead = np.array([np.sin(np.radians(20.0)), np.cos(np.radians(20.0))])
    expected = 30.0 * np.array([0.0 * right, right + ahead, 2.0 * right, 0.0 * right])
    # A tangent plane of 60 m: shorter by its square over twice that of the Earth's radius, nanometres.
    assert np.max(np.abs(enu[:, :2] - expected)) < 1e-7
    motion = moving.at(INSTANTS)
    assert np.linalg.norm(motion.velocity_ecef_mps, axis=1) == pytest.approx(6.0, rel=1e-9)
    assert np.degrees(motion.rate_body_radps[:, 2]) == pytest.approx(side * np.degrees(0.2), rel=1e-3)
    assert body(motion, motion.acceleration_ecef_mps2)[:, 1] == pytest.approx(side * 1.2, rel=1e-3)
    # A car rolls out of the turn: left side down in a right turn.
    assert np.degrees(motion.roll_rad) == pytest.approx(-side * 0.6)


@pytest.mark.parametrize("kind", ["coordinated circle", "aircraft"])
def test_coordinated_turns_have_no_side_force(kind):
    moving = trajectory(kind, DURATION_S)
    motion = moving.at(INSTANTS)
    force = specific_force_body_mps2(motion)
    # While a bank is held. The rest is the Coriolis acceleration, the curvature of the Earth (below 0.01) and
    # gravity that is not the standard one.
    steady = np.abs(np.gradient(motion.roll_rad, INSTANTS)) < 1e-4
    assert np.count_nonzero(steady) > 200
    assert np.max(np.abs(force[steady, 1])) < 0.03
    bank = np.degrees(motion.roll_rad)
    if kind == "aircraft":
        assert np.min(bank) == pytest.approx(-35.0, abs=0.01)
        assert np.max(bank) == pytest.approx(25.0, abs=0.01)
        climb = np.gradient(geodetic_from_ecef(motion.position_ecef_m)[2], INSTANTS)
        assert np.max(climb) == pytest.approx(3.0, abs=0.01)
    else:
        assert bank == pytest.approx(np.degrees(np.arctan(50.0**2 / 500.0 / 9.80665)))


def test_heights_stay_heights_far_away():
    far = build(AircraftMotion(speed_mps=250.0, heading_deg=80.0, legs=AircraftMotion().legs[:1]))
    motion = far.at(np.array([0.0, DURATION_S]))
    latitude, longitude, height = geodetic_from_ecef(motion.position_ecef_m)
    assert np.linalg.norm(np.diff(motion.position_ecef_m, axis=0)) == pytest.approx(75_000.0, rel=3e-4)
    assert height == pytest.approx([HEIGHT_M, HEIGHT_M], abs=1e-6)
    # A great circle leaves its first azimuth: the meridians converge.
    converged = np.diff(longitude)[0] * np.sin(np.mean(latitude))
    turned = np.diff(np.unwrap(far.course_rad(np.array([0.0, DURATION_S]))))[0]
    assert turned == pytest.approx(converged, rel=0.01)


def test_limits_of_speed_and_acceleration():
    section = SECTIONS["closed waypoints"]
    motion = build(section).at(np.arange(0.0, DURATION_S, 0.02))
    acceleration = body(motion, motion.acceleration_ecef_mps2)
    speed = np.linalg.norm(motion.velocity_ecef_mps, axis=1)
    # Speed and acceleration are along the map, so that grades of 2 % add their part.
    assert np.max(speed) <= section.speed_mps * 1.001
    assert np.max(np.abs(acceleration[:, 0])) <= section.acceleration_mps2 * 1.03
    assert np.max(np.abs(acceleration[:, 1])) <= section.lateral_acceleration_mps2 * 1.03
    # And they are used.
    assert np.max(speed) > 0.95 * section.speed_mps
    assert np.max(acceleration[:, 0]) > 0.95 * section.acceleration_mps2
    assert np.max(np.abs(acceleration[:, 1])) > 0.8 * section.lateral_acceleration_mps2


def test_waypoints_are_passed_and_stopped_at():
    section = SECTIONS["waypoints"]
    moving = build(section)
    time_s = np.arange(-2.0, DURATION_S, 0.05)
    motion = moving.at(time_s)
    enu = local(motion)
    for k, point in enumerate(section.points_m):
        near = np.min(np.hypot(*(enu[:, :2] - np.array(point[:2])).T))
        # Turns of 10 m radius cut their corners by r (1 / cos(turn / 2) - 1).
        assert near < (1e-3 if k in (0, 3) else 5.0)
    resting = np.linalg.norm(motion.velocity_ecef_mps, axis=1) < 1e-9
    assert np.all(resting[time_s < section.wait_s])
    edges = np.flatnonzero(np.diff(resting.astype(int)))
    # At rest, away, halt, away, at the end.
    halts = np.diff(time_s[edges])
    assert len(edges) == 4
    assert halts[1] == pytest.approx(8.0, abs=0.11)
    assert np.max(np.abs(enu[-1, :2] - [300.0, 0.0])) < 1e-3
    height = geodetic_from_ecef(motion.position_ecef_m)[2] - HEIGHT_M
    assert np.max(height) == pytest.approx(3.0, abs=0.3)
    assert height[-1] == pytest.approx(0.0, abs=0.02)


def test_closed_route_of_one_lap_returns():
    section = msgspec.structs.replace(SECTIONS["closed waypoints"], laps=1)
    enu = local(build(section).at(np.array([0.0, DURATION_S])))
    assert np.max(np.abs(enu[1] - enu[0])) < 1e-6


def test_suburban_route():
    section = SuburbanMotion(stop_share=0.5)
    moving = build(section, duration_s=1500.0)
    time_s = np.arange(0.0, 1500.0, 0.1)
    motion = moving.at(time_s)
    speed_kmh = 3.6 * np.linalg.norm(motion.velocity_ecef_mps, axis=1)
    assert 40.0 < np.max(speed_kmh) <= 50.1
    # It drives along the streets, four directions, with 90 degree turns between them.
    heading = np.degrees(motion.heading_rad[speed_kmh > 20.0])
    assert np.mean(np.abs(np.mod(heading + 45.0, 90.0) - 45.0) < 0.1) > 0.9
    assert {0, 1, 2, 3} <= set(np.mod(np.rint(heading / 90.0), 4).astype(int))
    # Laps coincide.
    way = moving.distance_m(time_s)
    enu = local(motion)
    back = np.flatnonzero((way > 500.0) & (np.hypot(enu[:, 0], enu[:, 1]) < 2.0))
    lap_m = way[back[0]]
    assert 1000.0 < lap_m < 8000.0
    once = np.searchsorted(way, 300.0)
    again = np.interp(way[once] + lap_m, way, np.arange(len(way)))
    assert np.hypot(*(enu[once, :2] - enu[round(again), :2])) < 3.0
    assert np.percentile(np.abs(np.degrees(motion.pitch_rad)), 99) < 4.0
    stops = np.count_nonzero(np.diff((speed_kmh < 1e-6).astype(int)) == 1)
    assert stops >= 4


@pytest.mark.parametrize("seed", range(3, 12))
def test_suburban_halt_on_request(seed):
    section = SuburbanMotion(blocks=4 + 3 * seed, stationary_at_s=400.0 + seed, stationary_for_s=350.0)
    moving = build(section, duration_s=900.0, seed=seed)
    inside = moving.at(np.arange(400.0 + seed, 750.1 + seed, 1.0))
    assert not inside.velocity_ecef_mps.any()
    # It stops not much earlier, and goes on soon.
    way = moving.distance_m(np.array([350.0, 400.0, 780.0]) + seed)
    assert way[1] - way[0] > 20.0
    assert way[2] - way[1] > 20.0


def test_circuit_as_described():
    time_s = np.arange(0.0, 600.0, 0.05)
    motion = build(SECTIONS["circuit"], duration_s=600.0).at(time_s)
    enu = local(motion)
    assert np.max(np.abs(enu[-1, :2] - enu[0, :2])) < 0.1
    moving = time_s[np.linalg.norm(motion.velocity_ecef_mps, axis=1) > 1e-9]
    assert 7.0 < (moving[-1] - moving[0]) / 60.0 < 9.0
    # Four laps over the hillock, last; nearly 6 degrees, up and down.
    pitch = np.degrees(motion.pitch_rad)
    assert 5.3 < np.max(pitch) < 6.3
    assert -6.3 < np.min(pitch) < -5.3
    tops = np.flatnonzero(np.diff((pitch > 4.0).astype(int)) == 1)
    assert len(tops) == 4
    assert time_s[tops[0]] > 300.0
    assert np.mean(np.abs(np.degrees(motion.roll_rad)) < 4.0) > 0.99


def test_ship_oscillates_as_asked():
    section = ShipMotion()
    moving = build(section, duration_s=7200.0)
    time_s = np.arange(0.0, 7200.0, 0.5)
    motion = moving.at(time_s)
    yaw = np.angle(np.exp(1j * (motion.heading_rad - moving.course_rad(time_s))))
    heave = geodetic_from_ecef(motion.position_ecef_m)[2] - HEIGHT_M
    for name, values in (
        ("roll", np.degrees(motion.roll_rad)),
        ("pitch", np.degrees(motion.pitch_rad)),
        ("yaw", np.degrees(yaw)),
        ("heave", heave),
    ):
        asked = getattr(section, name)
        # 32 components beat: over two hours their variance is met to some per cent.
        assert np.std(values) == pytest.approx(asked.amplitude / np.sqrt(2.0), rel=0.05)
        ups = np.count_nonzero((values[1:] > 0.0) & (values[:-1] <= 0.0))
        # Zero crossings of a sea are more frequent than its peak: by 1.28 for JONSWAP.
        ratio = asked.period_s * ups / 7200.0
        assert 0.97 < ratio < (1.03 if asked.spectrum == "narrow" else 1.35)
    assert np.linalg.norm(motion.velocity_ecef_mps, axis=1).mean() == pytest.approx(5.0, rel=0.02)
    assert set(np.rint(np.degrees(moving.course_rad(time_s)))) >= {35.0, 80.0, 350.0, 245.0, 170.0, 290.0}


def test_pure_sinusoid_at_sea():
    roll = motions.Oscillation(amplitude=4.0, period_s=9.0, bandwidth=0.0)
    motion = build(ShipMotion(roll=roll)).at(np.arange(0.0, 90.0, 0.05))
    assert np.degrees(np.max(motion.roll_rad)) == pytest.approx(4.0, abs=0.01)


def test_table_goes_through_its_rows():
    moving = table_trajectory(60.0)
    time_s = np.arange(0.0, 60.0, 0.1)
    motion = moving.at(time_s)
    latitude, _, height = geodetic_from_ecef(motion.position_ecef_m)
    assert np.max(np.abs(latitude - LATITUDE_RAD - 2e-5 * np.sin(0.05 * time_s))) < 1e-14
    assert np.max(np.abs(height - HEIGHT_M - 3.0 * np.cos(0.05 * time_s))) < 1e-8
    between = moving.at(time_s + 0.05)
    # Quintic splines at 10 Hz of a roll at 0.7 rad/s: the error is below (0.07)^6.
    assert np.max(np.abs(between.roll_rad - 0.1 * np.sin(0.7 * (time_s + 0.05)))) < 1e-9
    assert np.max(np.abs(between.rate_body_radps[:, 2])) < 0.2


TABLE = """time_s,latitude_deg,longitude_deg,height_m,heading_deg
0,51.0,-114.0,1000,350
1,51.0001,-114.0,1000,355
2,51.0002,-114.0,1000,0
3,51.0003,-114.0,1000,5
4,51.0004,-114.0,1000,10
5,51.0005,-114.0,1000,15
6,51.0006,-114.0,1000,20
"""


def test_table_from_a_file(tmp_path):
    (tmp_path / "motion.csv").write_text(TABLE)
    moving = build(TableMotion(file="motion.csv", start_s=1.0), duration_s=5.0, folder=str(tmp_path))
    motion = moving.at(np.array([0.0, 1.0, 2.5]))
    # The heading passes north without turning back.
    turned = np.angle(np.exp(1j * motion.heading_rad))
    assert np.degrees(turned) == pytest.approx([-5.0, 0.0, 7.5], abs=1e-6)
    assert np.degrees(geodetic_from_ecef(motion.position_ecef_m)[0]) == pytest.approx(
        [51.0001, 51.0002, 51.00035], abs=1e-9
    )
    assert not motion.pitch_rad.any()
    assert np.sin(moving.course_rad(np.array([2.0]))) == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize(
    ("section", "text", "error", "words"),
    [
        (TableMotion(file="none.csv"), TABLE, ConfigError, "there is no"),
        (TableMotion(file="motion.csv"), TABLE.replace("time_s", "t"), FormatError, "no column for time_s"),
        (TableMotion(file="motion.csv"), TABLE.replace("height_m", "z"), FormatError, "no column for x_m"),
        (TableMotion(file="motion.csv"), TABLE.replace("1000,5\n", "1000,five\n"), FormatError, "line 5"),
        (TableMotion(file="motion.csv"), TABLE.replace("1000,5\n", "1000\n"), FormatError, "line 5"),
        (TableMotion(file="motion.csv", start_s=3.0), TABLE, ConfigError, "covers -3 to 3 s"),
        (TableMotion(file="motion.csv"), TABLE.replace("\n3,", "\n9,"), ConfigError, "ascending"),
        (TableMotion(file="motion.csv"), TABLE.replace("1000,5\n", "nan,5\n"), ConfigError, "gaps"),
        (TableMotion(file="motion.csv"), "", FormatError, "no column"),
    ],
)
def test_unusable_tables_are_refused(tmp_path, section, text, error, words):
    (tmp_path / "motion.csv").write_text(text)
    with pytest.raises(error, match=words):
        build(section, duration_s=6.0, folder=str(tmp_path))


def test_table_refuses_the_vertical():
    n = np.zeros(20)
    position = np.tile(ecef_from_geodetic(LATITUDE_RAD, LONGITUDE_RAD, HEIGHT_M), (20, 1))
    with pytest.raises(ConfigError, match="85 degrees"):
        TableTrajectory(np.arange(20.0), position, n, n + np.radians(88.0), n)


def test_course_of_a_table_is_held_at_rest():
    time_s = np.arange(0.0, 60.0)
    share = np.clip((time_s - 20.0) / 25.0, 0.0, 1.0)
    way = 15.0 * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    position = ecef_from_geodetic(LATITUDE_RAD, LONGITUDE_RAD + way * 1e-7, HEIGHT_M)
    moving = TableTrajectory(time_s, position, 0.0 * time_s, 0.0 * time_s, 0.0 * time_s)
    course = np.degrees(moving.course_rad(np.array([2.0, 30.0, 57.0])))
    # Heading before the first movement; then east, also after it.
    assert course == pytest.approx([0.0, 90.0, 90.0], abs=0.5)
    assert moving.distance_m(np.array([59.0]))[0] == pytest.approx(
        15.0 * 1e-7 * np.cos(LATITUDE_RAD) * 6.39e6, rel=0.005
    )


POINTS = '"points_m": [[0, 0], [0, 50]]'


@pytest.mark.parametrize(
    ("kind", "settings", "key"),
    [
        ("turntable", '"tilt_deg": 181', "tilt_deg"),
        ("turntable", '"ramp_s": 0', "ramp_s"),
        ("turntable", '"steps": [[10, 1], [5, 2]]', "steps"),
        ("sway", '"moves": [{"at_s": 5, "duration_s": 0}]', "duration_s"),
        ("sway", '"heave": [{"amplitude": 1, "period_s": 0}]', "period_s"),
        ("circle", '"radius_m": 0', "radius_m"),
        ("circle", '"body": {"unevenness_mps2": -1}', "unevenness_mps2"),
        ("waypoints", '"points_m": [[0, 0]]', "points_m"),
        ("waypoints", '"points_m": [[0, 0], [1]]', "points_m"),
        ("waypoints", '"points_m": [[0, 0], [0, 0.5]]', "points_m"),
        ("waypoints", '"points_m": [[0, 0], [0, 50], [0, 10]]', "points_m"),
        ("waypoints", POINTS + ', "laps": 2', "laps"),
        ("waypoints", POINTS + ', "stops": [{"waypoint": 2, "duration_s": 1}]', "stops"),
        ("waypoints", POINTS + ', "wait_s": -1', "wait_s"),
        ("suburban", '"blocks": 0', "blocks"),
        ("suburban", '"block_m": [10, 100]', "block_m"),
        ("suburban", '"speed_kmh": [50, 20]', "speed_kmh"),
        ("suburban", '"stop_share": 1.5', "stop_share"),
        ("suburban", '"grade_percent": 50', "grade_percent"),
        ("suburban", '"stationary_at_s": 5', "stationary_at_s"),
        ("suburban", '"wait_s": -1', "wait_s"),
        ("circuit", '"laps": []', "laps"),
        ("circuit", '"wait_s": -1', "wait_s"),
        ("circuit", '"hillock_height_m": 20', "hillock_height_m"),
        ("ship", '"legs": []', "legs"),
        ("ship", '"legs": [{"course_deg": 0, "length_m": 99}, {"course_deg": 180, "length_m": 9}]', "legs"),
        ("ship", '"roll": {"amplitude": -1, "period_s": 9}', "amplitude"),
        ("ship", '"roll": {"amplitude": 1, "period_s": 9, "bandwidth": 2}', "bandwidth"),
        ("aircraft", '"legs": []', "legs"),
        ("aircraft", '"legs": [{"duration_s": 9, "bank_deg": 80}]', "bank_deg"),
        ("aircraft", '"legs": [{"duration_s": 9, "climb_mps": 40}]', "climb_mps"),
        ("table", '"file": "a.csv", "columns": {"lat": "b"}', "columns"),
    ],
)
def test_impossible_settings_are_refused(kind, settings, key):
    # Errors of __post_init__ that are ValueErrors come back as msgspec's own, with the sentence.
    with pytest.raises((ConfigError, msgspec.ValidationError), match=f"`{key}`"):
        msgspec.json.decode(f'{{"kind": "{kind}", {settings}}}', type=MotionSection)


def test_every_kind_can_be_written_and_read():
    for section in SECTIONS.values():
        assert msgspec.json.decode(msgspec.json.encode(section), type=MotionSection) == section
