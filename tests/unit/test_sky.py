"""Skies: published slots, hand formulas for circular orbits, smooth truth, files moved in time."""

import numpy as np
import pytest

from truenorth.config import convert_settings
from truenorth.constants import SPEED_OF_LIGHT_MPS
from truenorth.errors import ConfigError
from truenorth.formats import write_rinex_navigation
from truenorth.frames import ecef_from_geodetic, geodetic_from_ecef
from truenorth.navigation import PreciseOrbits
from truenorth.observations import sat_id
from truenorth.orbits import compute_satellite_states
from truenorth.simulation.sky import DirectionsSky, FileSky, NominalSky, OguzSky, OrbitErrors, build_sky
from truenorth.simulation.sky.almanac import (
    greenwich_angle_rad,
    nominal_slots,
    orbit_elements,
    repeat_semi_major_axis_m,
)
from truenorth.simulation.sky.orbit_fit import fit_broadcast
from truenorth.simulation.sky.tracks import tracks
from truenorth.timescales import NS_PER_DAY, NS_PER_S, gpst_from_calendar

START_NS = gpst_from_calendar(2024, 6, 24, 8)
EARTH_RATE = 7.292115e-5
GRAZ = ecef_from_geodetic(np.radians(47.07), np.radians(15.44), 400.0)
EXACT = OrbitErrors()


def nominal(systems="GRECJI", *, start_ns=START_NS, duration_s=7200.0, seed=1, **settings):
    section = NominalSky(systems=systems, **settings)
    return build_sky(section, start_ns=start_ns, duration_s=duration_s, seed=seed, position_ecef_m=GRAZ)


@pytest.fixture(scope="module")
def exact_sky():
    return nominal(errors=EXACT)


# GPS SPS Performance Standard 2020, tables 3.2-1 and 3.2-2: where the ground tracks cross the equator.
CROSSINGS_DEG = [
    127.85, 74.68, 179.63, 14.69, 94.27, 140.46, 28.78, 155.98, 169.73, 119.69, 103.62, 54.57,
    61.40, 126.51, 11.37, 77.47, 152.31, 25.09, 86.82, 40.63, 53.23, 106.40, 166.39, 1.46,
]  # fmt: skip
EXPANDED_DEG = {"B1F": 101.25, "D2F": 135.13, "F2F": 114.02, "A2F": 80.28, "C4F": 58.30, "E3F": 94.18}
SPARES_DEG = [67.06, 86.97, 45.95, 122.78, 79.84, 100.80]


def crossing_deg(slot):
    return (slot.node_deg + 0.5 * slot.latitude_argument_deg) % 180.0


def test_gps_slots_cross_the_equator_where_the_standard_says():
    """Back at the equator the node is half the argument of latitude further east."""
    slots = nominal_slots("G", gps_slots=24)
    difference = (np.array([crossing_deg(slot) for slot in slots]) - CROSSINGS_DEG + 90.0) % 180.0 - 90.0
    # The tables are rounded to 0.01 degree, each of three numbers.
    assert np.abs(difference).max() < 0.02
    full = nominal_slots("G", gps_slots=30)
    places = dict(
        zip("A1 A2 A3 A4 B1 B2 B3 B4 C1 C2 C3 C4 D1 D2 D3 D4 E1 E2 E3 E4 F1 F2".split(), full, strict=False)
    )
    for name, crossing in EXPANDED_DEG.items():
        # The longitude of E3F is printed 0.055 degrees off its own argument of latitude.
        assert abs(crossing_deg(places[name[:2]]) - crossing) < (0.06 if name == "E3F" else 0.02)
    difference = np.array([crossing_deg(slot) for slot in full[24:]]) - SPARES_DEG
    assert np.abs(difference).max() < 0.02


def test_repeating_ground_tracks_give_the_published_axes():
    """Of GPS, GLONASS (by its period), Galileo, BeiDou and geosynchronous satellites, kilometres."""
    for (turns, days, inclination), published_km in {
        (2, 1, 55.0): 26_559.8,
        (17, 8, 64.8): 25_508.2,
        (17, 10, 56.0): 29_599.8,
        (13, 7, 55.0): 27_906.1,
        (1, 1, 41.0): 42_164.2,
    }.items():
        assert abs(repeat_semi_major_axis_m(turns, days, np.radians(inclination)) / 1e3 - published_km) < 0.7


def test_greenwich_angle():
    """At the epochs of the GPS slots: 100.765 degrees (SPS PS 2020), 18 h 36 min 14.4 s (SPS PS 2001)."""
    assert np.degrees(greenwich_angle_rad(gpst_from_calendar(2017, 1, 1))) == pytest.approx(
        100.765, abs=0.004
    )
    old = np.degrees(greenwich_angle_rad(gpst_from_calendar(1993, 7, 1, 0, 0, 9)))
    assert old == pytest.approx(15.0 * (18 + 36 / 60 + 14.4 / 3600), abs=0.006)


def test_glonass_planes_and_galileo_phases():
    """Three planes 120 degrees apart, eight satellites 45 degrees apart, 15 degrees from plane to plane."""
    for letter in "REC":
        slots = [slot for slot in nominal_slots(letter) if slot.days > 1]
        nodes = np.array([slot.node_deg for slot in slots])[::8]
        assert np.allclose(np.diff(nodes) % 360.0, 120.0)
        arguments = np.array([slot.latitude_argument_deg for slot in slots]).reshape(3, 8)
        assert np.allclose(np.abs((np.diff(arguments, axis=1) + 180.0) % 360.0 - 180.0), 45.0)
        assert np.allclose(np.diff(arguments[:, 0]) % 45.0, 15.0)


def test_positions_by_hand(exact_sky):
    """A circular orbit with the oblateness to first order, written out for two satellites."""
    later_s = 3000.5
    for name in ("E07", "C39"):
        slot = next(slot for slot in nominal_slots(name[0]) if slot.sat == sat_id(name))
        el = orbit_elements(slot, START_NS)
        u = el["m0_rad"] + el["argument_rate_radps"] * later_s
        r = el["sqrt_a"] ** 2 + el["crc_m"] * np.cos(2 * u)
        u = u + el["cus_rad"] * np.sin(2 * u)
        node = el["node_rad"] + (el["omega_dot_radps"] - EARTH_RATE) * later_s
        i = np.radians(slot.inclination_deg)
        expected = r * np.array(
            [
                np.cos(node) * np.cos(u) - np.sin(node) * np.cos(i) * np.sin(u),
                np.sin(node) * np.cos(u) + np.cos(node) * np.cos(i) * np.sin(u),
                np.sin(i) * np.sin(u),
            ]
        )
        position, *_ = exact_sky.true_states([slot.sat], START_NS, -later_s)
        # The almanac counts seven years of orbits from its epoch: 0.1 mm of rounding.
        assert np.linalg.norm(position[0] - expected) < 1e-3


def test_the_oblate_earth_pulls_as_the_orbits_say(exact_sky):
    """The second difference of a GPS and a Galileo orbit is the attraction of the Earth with J2."""
    sat, h = np.array([sat_id("G03"), sat_id("E07"), sat_id("C20"), sat_id("C38")]), 4.0
    at = [exact_sky.true_states(sat, START_NS, -600.0 - k * h)[0] for k in (-1, 0, 1)]
    angle = [EARTH_RATE * (600.0 + k * h) for k in (-1, 0, 1)]
    inertial = [
        np.stack(
            [np.cos(a) * p[:, 0] - np.sin(a) * p[:, 1], np.sin(a) * p[:, 0] + np.cos(a) * p[:, 1], p[:, 2]], 1
        )
        for a, p in zip(angle, at, strict=True)
    ]
    found = (inertial[2] - 2.0 * inertial[1] + inertial[0]) / h**2
    p = inertial[1]
    r2 = np.sum(p * p, axis=1, keepdims=True)
    g = 3.986004418e14 / r2**1.5
    bulge = 1.5 * 1.082626e-3 * g * 6378137.0**2 / r2
    lean = 5.0 * p[:, 2:] ** 2 / r2
    expected = -g * p - bulge * p * np.column_stack([1 - lean, 1 - lean, 3 - lean])
    # First order in J2; what the oblateness does to an eccentric orbit (GPS) is left out.
    assert np.abs(found - expected)[1:].max() < 3e-8
    assert np.abs(found - expected)[0].max() < 1e-6


def test_consecutive_ephemerides_agree(exact_sky):
    """Half way between reference times both give the same place, to the rounding of the file."""
    navigation = exact_sky.navigation
    n_kepler = len(navigation.kepler)
    for table, first, limit_m in ((navigation.kepler, 0, 1e-4), (navigation.states, n_kepler, 1e-3)):
        for k in range(len(table) - 1):
            later = np.flatnonzero((table.sat == table.sat[k]) & (table.toe_ns > table.toe_ns[k]))
            if len(later) == 0:
                continue
            middle_ns = int(table.toe_ns[k] + table.toe_ns[later[0]]) // 2
            pair = np.array([k, later[0]]) + first
            states = compute_satellite_states(
                navigation, np.repeat(table.sat[k], 2), middle_ns, ephemeris=pair
            )
            assert np.linalg.norm(states.position_ecef_m[0] - states.position_ecef_m[1]) < limit_m
            assert abs(states.clock_s[0] - states.clock_s[1]) * SPEED_OF_LIGHT_MPS < 1e-3


def test_messages_hold_over_the_whole_scenario():
    sky = nominal(start_ns=START_NS + 1700 * NS_PER_S, duration_s=5.0 * 3600.0)
    for later_s in (-60, 0, 9000, 18_000, 18_060):
        time_ns = START_NS + (1700 + later_s) * NS_PER_S
        broadcast = compute_satellite_states(sky.navigation, sky.satellites, time_ns)
        assert np.all(broadcast.status == 0)
        assert np.all(sky.true_states(sky.satellites, time_ns)[4] == 0)


def test_regional_satellites_stay_over_their_places(exact_sky):
    times = START_NS + np.arange(0, 7200, 600) * NS_PER_S
    for name, longitude in (("C59", 140.0), ("C60", 80.0), ("C61", 110.5), ("J07", 127.0), ("I03", 83.0)):
        position, *_ = exact_sky.true_states(np.full(12, sat_id(name)), times)
        latitude, lon, _ = geodetic_from_ecef(position)
        np.testing.assert_allclose(np.degrees(lon), longitude, atol=1e-4)
        np.testing.assert_allclose(np.degrees(latitude), 0.0, atol=1e-4)
    day = nominal("J", duration_s=86_400.0)
    followed = tracks(day, ecef_from_geodetic(np.radians(35.7), np.radians(139.7), 0.0), times * 0 + START_NS)
    assert np.sum(followed.elevation_rad[0, :3] > np.radians(20.0)) >= 2


def test_velocities_and_drifts_are_derivatives_with_the_errors():
    sky = nominal(errors=OrbitErrors(radial_sd_m=50.0, along_sd_m=50.0, cross_sd_m=50.0, clock_sd_m=5.0))
    before, after = (sky.true_states(sky.satellites, START_NS, 100.0 + h) for h in (0.5, -0.5))
    _, velocity, _, drift, status = sky.true_states(sky.satellites, START_NS, 100.0)
    assert np.all(status == 0)
    # A central difference over 1 s errs by v'''/24: 1e-5 m/s.
    np.testing.assert_allclose(after[0] - before[0], velocity, atol=2e-5)
    np.testing.assert_allclose(after[2] - before[2], drift, atol=1e-16)


def test_errors_have_the_sizes_asked_for_and_the_orbit_period():
    asked = OrbitErrors(radial_sd_m=0.2, along_sd_m=0.8, cross_sd_m=0.5, clock_sd_m=0.4)
    sky, plain = nominal(errors=asked), nominal(errors=EXACT)
    here, velocity, clock, *_ = plain.true_states(plain.satellites, START_NS)
    there, _, wrong_clock, *_ = sky.true_states(sky.satellites, START_NS)
    inertial = velocity + EARTH_RATE * np.column_stack([-here[:, 1], here[:, 0], 0 * here[:, 0]])
    radial = here / np.linalg.norm(here, axis=1)[:, None]
    normal = np.cross(here, inertial)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    axes = np.stack([radial, np.cross(normal, radial), normal], axis=1)
    parts = np.einsum("nij,nj->ni", axes, there - here)
    n = len(sky.satellites)
    sizes = np.append(np.sqrt(np.mean(parts**2, axis=0)), np.std(wrong_clock - clock) * SPEED_OF_LIGHT_MPS)
    # 119 satellites: a standard deviation is known to 1/sqrt(2 * 119) = 6.5 %; 4.4 sigma.
    assert n == 119
    np.testing.assert_allclose(sizes / [0.2, 0.8, 0.5, 0.4], 1.0, atol=0.285)
    # Over a minute nothing changes by more than 60 s times 2 pi / 11 h times the size.
    later = (
        sky.true_states(sky.satellites, START_NS, -60.0)[0]
        - plain.true_states(sky.satellites, START_NS, -60.0)[0]
    )
    assert np.abs(np.linalg.norm(later, axis=1) - np.linalg.norm(there - here, axis=1)).max() < 0.1


def test_equal_seeds_give_equal_skies_and_systems_do_not_disturb_each_other():
    one, two, other = nominal("GREC"), nominal("GREC"), nominal("GREC", seed=2)
    np.testing.assert_array_equal(one.navigation.kepler.elements, two.navigation.kepler.elements)
    assert not np.array_equal(one.navigation.kepler.elements, other.navigation.kepler.elements)
    alone = nominal("G")
    rows = one.navigation.kepler.sat // 100 == 0
    np.testing.assert_array_equal(one.navigation.kepler.elements[rows], alone.navigation.kepler.elements)
    for mine, theirs in zip(
        one.true_states(alone.satellites, START_NS),
        alone.true_states(alone.satellites, START_NS),
        strict=True,
    ):
        np.testing.assert_array_equal(mine, theirs)


def test_the_highest_are_kept_for_the_whole_run():
    whole, four = nominal("GE"), nominal("GE", n_satellites=4)
    seen = tracks(whole, GRAZ, START_NS)
    highest = seen.sat[np.argsort(-seen.elevation_rad[0])[:4]]
    assert sorted(highest.tolist()) == four.satellites.tolist()
    assert sorted(set(four.navigation.kepler.sat.tolist())) == four.satellites.tolist()
    without = nominal("GE", leave_out=("G05", "E11"))
    assert set(whole.satellites) - set(without.satellites) == {5, 211}
    with pytest.raises(ConfigError, match="n_satellites"):
        build_sky(NominalSky(n_satellites=4), start_ns=START_NS, duration_s=1.0, seed=1)


def test_as_many_satellites_as_in_reality():
    """Over 24 h in Graz above 10 degrees: GPS 7 to 12 of about 30, the others of 24 somewhat fewer."""
    times = gpst_from_calendar(2024, 6, 24) + np.arange(0, 86_400, 900) * NS_PER_S
    sky = nominal("GREC", start_ns=int(times[0]), duration_s=86_400.0)
    followed = tracks(sky, GRAZ, times)
    above = followed.elevation_rad > np.radians(10.0)
    means = [above[:, sky.satellites // 100 == k].sum(axis=1).mean() for k in range(4)]
    np.testing.assert_allclose(means, [8.5, 7.2, 7.1, 7.6], atol=0.5)
    gps = above[:, sky.satellites // 100 == 0].sum(axis=1)
    assert gps.min() >= 6
    assert gps.max() <= 12
    # GPS repeats after a sidereal day; among the stars each orbit stays in its plane.
    again, *_ = sky.true_states(sky.satellites[:30], int(times[0]) + round(86_155.4 * NS_PER_S))
    first, *_ = sky.true_states(sky.satellites[:30], int(times[0]))
    assert np.linalg.norm(again - first, axis=1).max() < 5e3
    track = followed.position_eci_m[:, 3]
    normal = np.cross(track[0], track[10])
    height = track @ normal / np.linalg.norm(normal) / np.linalg.norm(track, axis=1)
    assert np.abs(height).max() < 1e-3


def test_oguz_by_his_equations():
    """Equations 2.2 and 2.3 with the arguments of latitude of our reading, and his satellite clock bias."""
    section = OguzSky(greenwich_angle_deg=0.0, plane_phase_deg=10.0)
    sky = build_sky(section, start_ns=START_NS, duration_s=1000.0, seed=1)
    assert sky.satellites.tolist() == list(range(1, 25))
    r, later_s = section.orbit_radius_m, 777.0
    position, _, clock, drift, _ = sky.true_states(sky.satellites, START_NS, -later_s)
    for plane in range(6):
        for k in range(4):
            u = np.radians(45.0 * (2 * k + plane % 2) + 10.0 * plane) + np.sqrt(3.986005e14 / r**3) * later_s
            node, i = np.radians(60.0 * plane) - EARTH_RATE * later_s, np.radians(55.0)
            x = r * np.cos(node) * np.cos(u) - r * np.sin(node) * np.cos(i) * np.sin(u)
            y = r * np.sin(node) * np.cos(u) + r * np.cos(node) * np.cos(i) * np.sin(u)
            z = r * np.sin(i) * np.sin(u)
            assert np.linalg.norm(position[4 * plane + k] - [x, y, z]) < 1e-3
    np.testing.assert_allclose(clock, -2.0 / SPEED_OF_LIGHT_MPS, rtol=1e-12)
    np.testing.assert_allclose(drift, 0.0, atol=1e-20)
    four = build_sky(
        OguzSky(phasing="published_slots", n_satellites=4), start_ns=START_NS, duration_s=1000.0, seed=1,
        position_ecef_m=GRAZ,
    )  # fmt: skip
    assert len(four.satellites) == 4


def test_directions_are_those_asked_for():
    """The seven satellites of Wang and Lachapelle (2002) as assumed for their search."""
    wanted = ((40, 65), (150, 48), (255, 55), (320, 30), (95, 22), (200, 18), (10, 15))
    section = DirectionsSky(
        azimuth_elevation_deg=wanted, names=("G01", "G05", "G09", "G12", "G17", "G23", "G30")
    )
    sky = build_sky(section, start_ns=START_NS, duration_s=600.0, seed=1, position_ecef_m=GRAZ)
    seen = tracks(sky, GRAZ, START_NS)
    np.testing.assert_allclose(np.degrees(seen.azimuth_rad[0]), [a for a, _ in wanted], atol=1e-7)
    np.testing.assert_allclose(np.degrees(seen.elevation_rad[0]), [e for _, e in wanted], atol=1e-7)
    radius = np.linalg.norm(sky.true_states(sky.satellites, START_NS, -300.0)[0], axis=1)
    np.testing.assert_allclose(radius, section.orbit_radius_m, atol=1e-3)
    polar = DirectionsSky(azimuth_elevation_deg=((0.0, 90.0),))
    far_north = ecef_from_geodetic(np.radians(80.0), 0.0, 0.0)
    sky = build_sky(polar, start_ns=START_NS, duration_s=1.0, seed=1, position_ecef_m=far_north)
    assert tracks(sky, far_north, START_NS).elevation_rad[0, 0] > np.radians(89.9)
    with pytest.raises(ConfigError, match="azimuth_elevation_deg"):
        build_sky(polar, start_ns=START_NS, duration_s=1.0, seed=1)


@pytest.fixture
def written(tmp_path):
    sky = nominal("GRECJI", errors=EXACT)
    write_rinex_navigation(tmp_path / "day.nav", sky.navigation)
    return tmp_path, sky


def test_files_give_the_sky_that_they_hold(written):
    folder, sky = written
    section = FileSky(files=("day.nav",), systems="GREC")
    again = build_sky(section, start_ns=START_NS, duration_s=3600.0, seed=1, folder=folder)
    assert set(again.satellites // 100) == {0, 1, 2, 3}
    for later_s in (0.0, 1234.5, 3600.0):
        mine = again.true_states(again.satellites, START_NS, -later_s)
        theirs = sky.true_states(again.satellites, START_NS, -later_s)
        assert np.all(mine[4] == 0)
        assert np.abs(mine[0] - theirs[0]).max() < 1e-4
        assert np.abs(mine[2] - theirs[2]).max() * SPEED_OF_LIGHT_MPS < 1e-3


@pytest.mark.parametrize("n_days", [-3000, -7, 1, 100])
def test_files_are_moved_by_whole_days_over_the_same_places(written, n_days):
    folder, sky = written
    moved = build_sky(
        FileSky(files=("day.nav",)),
        start_ns=START_NS + n_days * NS_PER_DAY,
        duration_s=3600.0,
        seed=1,
        folder=folder,
    )
    time_ns = START_NS + 1000 * NS_PER_S
    mine = moved.true_states(moved.satellites, time_ns + n_days * NS_PER_DAY)
    theirs = sky.true_states(moved.satellites, time_ns)
    assert np.abs(mine[0] - theirs[0]).max() < 1e-4
    assert f"{n_days:+d} days" in moved.source
    if n_days == -3000:
        assert moved.navigation.leap_seconds == 17


def test_files_of_another_time_are_refused_with_the_times(written):
    folder, _ = written
    fixed = FileSky(files=("day.nav",), time_shift="none")
    with pytest.raises(ConfigError, match=r"2024-06-24T.* none at the start, 2024-06-25T08:00:00"):
        build_sky(fixed, start_ns=START_NS + NS_PER_DAY, duration_s=1.0, seed=1, folder=folder)
    with pytest.raises(ConfigError, match="no orbits of the systems S"):
        build_sky(
            FileSky(files=("day.nav",), systems="S"), start_ns=START_NS, duration_s=1.0, seed=1, folder=folder
        )


def test_the_truth_passes_smoothly_where_ephemerides_jump(tmp_path):
    """Ephemerides of one satellite that disagree by 100 m: velocities remain the derivative of positions."""
    sky = nominal("G", errors=EXACT, duration_s=4 * 3600.0)
    kepler = sky.navigation.kepler
    kepler.elements[(kepler.sat == 5) & (kepler.toe_ns == START_NS + 7200 * NS_PER_S), 5] += 4e-6
    write_rinex_navigation(tmp_path / "jump.nav", sky.navigation)
    times = START_NS + np.arange(0, 4 * 3600, 20) * NS_PER_S
    sat = np.full(len(times), 5)

    def residual(smooth):
        section = FileSky(files=("jump.nav",), smooth=smooth)
        new = build_sky(section, start_ns=START_NS, duration_s=4 * 3600.0, seed=1, folder=tmp_path)
        _, velocity, *_ = new.true_states(sat, times)
        later, earlier = (new.true_states(sat, times + k * 10 * NS_PER_S)[0] for k in (1, -1))
        return np.nanmax(np.abs((later - earlier) / 20.0 - velocity))

    assert residual(smooth=True) < 0.01  # of v''' h^2 / 24 alone
    assert residual(smooth=False) > 1.0


@pytest.mark.jit
def test_broadcast_ephemerides_fitted_to_precise_orbits():
    sky = nominal("GRECJI", errors=EXACT, duration_s=86_400.0, start_ns=gpst_from_calendar(2024, 6, 24))
    times = gpst_from_calendar(2024, 6, 24, 4) + np.arange(0, 8 * 3600, 900) * NS_PER_S
    sat = np.tile(sky.satellites, len(times))
    position, velocity, clock, *_ = sky.true_states(sat, np.repeat(times, len(sky.satellites)))
    inertial = velocity + EARTH_RATE * np.column_stack([-position[:, 1], position[:, 0], 0 * clock])
    clock = clock + 2.0 * np.sum(position * inertial, axis=1) / SPEED_OF_LIGHT_MPS**2
    shape = (len(times), len(sky.satellites))
    precise = PreciseOrbits(
        times, sky.satellites, position.reshape(*shape, 3), clock.reshape(shape), np.full(shape[1], np.nan)
    )
    fitted = fit_broadcast(precise, start_ns=START_NS, duration_s=1800.0)
    later_ns = START_NS + 1000 * NS_PER_S
    states = compute_satellite_states(fitted, sky.satellites, later_ns)
    truth = sky.true_states(sky.satellites, later_ns)
    assert np.all(states.status == 0)
    # Orbits that the message can hold are found to the error of the interpolation (and of GLONASS, whose
    # acceleration is constant, too).
    assert np.linalg.norm(states.position_ecef_m - truth[0], axis=1).max() < 0.05
    # GLONASS clocks and the QZSS orbit (e = 0.075) hold a relativistic part that no line follows.
    assert np.abs(states.clock_s - truth[2]).max() * SPEED_OF_LIGHT_MPS < 0.3


@pytest.mark.parametrize(
    ("kind", "table", "key"),
    [
        (NominalSky, {"systems": "GX"}, "systems"),
        (NominalSky, {"gps_slots": 31}, "gps_slots"),
        (NominalSky, {"gps_eccentricity": 0.2}, "gps_eccentricity"),
        (NominalSky, {"klobuchar": [1.0]}, "klobuchar"),
        (NominalSky, {"n_satellites": 0}, "n_satellites"),
        (NominalSky, {"leave_out": ["X05"]}, "leave_out"),
        (NominalSky, {"leave_out": ["G5"]}, "leave_out"),
        (NominalSky, {"errors": {"radial_sd_m": -1.0}}, "errors.radial_sd_m"),
        (FileSky, {"files": []}, "files"),
        (FileSky, {"files": ["a"], "systems": "Q"}, "systems"),
        (FileSky, {"files": ["a"], "time_shift": "weeks"}, "time_shift"),
        (OguzSky, {"orbit_radius_m": 1e6}, "orbit_radius_m"),
        (DirectionsSky, {"azimuth_elevation_deg": []}, "azimuth_elevation_deg"),
        (DirectionsSky, {"azimuth_elevation_deg": [[0.0, 95.0]]}, "azimuth_elevation_deg"),
        (DirectionsSky, {"azimuth_elevation_deg": [[0.0, 5.0]], "names": ["E01"]}, "names"),
        (DirectionsSky, {"azimuth_elevation_deg": [[0.0, 5.0]], "inclination_deg": 0.0}, "inclination_deg"),
    ],
)
def test_impossible_settings_are_refused_by_name(kind, table, key):
    with pytest.raises(ConfigError, match=rf"`sky\.{key}`"):
        convert_settings(table, kind, prefix="sky.")


def test_a_sky_without_satellites_is_refused():
    with pytest.raises(ConfigError, match="no satellite is left"):
        nominal("J", leave_out=("J02", "J03", "J04", "J07"))
