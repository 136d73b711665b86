"""Single-point position, velocity and clock on real and hardware-simulated data."""

import gzip

import numpy as np
import pytest

from truenorth.formats import read_navigation, read_observations
from truenorth.frames import ecef_from_geodetic, geodetic_from_ecef, rot_enu_from_ecef
from truenorth.navigation import merge_navigation
from truenorth.positioning import PointStatus, solve_single_point
from truenorth.timescales import gpst_from_calendar

ROSE_ECEF_M = np.array([4157177.06580187, 671230.476590636, 4774767.03105544])


def enu(vector_ecef_m, place_ecef_m):
    lat, lon, _ = geodetic_from_ecef(place_ecef_m)
    return vector_ecef_m @ rot_enu_from_ecef(lat, lon).T


@pytest.fixture(scope="module")
def rose_nav(data_dir):
    folder = data_dir / "moving_simulator_rose"
    names = ("RINEX_GN_Spirent.23N.gz", "RINEX_EN_Spirent.23L.gz")
    return merge_navigation(*[read_navigation(folder / name) for name in names])


def test_simulated_static_receiver_is_found_to_centimetres(data_dir, rose_nav):
    obs = read_observations(data_dir / "moving_simulator_rose" / "Base-static_MO_Spirent.obs.gz")
    point = solve_single_point(obs, rose_nav)
    assert (point.status == PointStatus.OK).all()
    error = enu(point.position_ecef_m - ROSE_ECEF_M, ROSE_ECEF_M)
    # Noise free. What is left is the simulator's zenith troposphere, 2 cm above ours.
    assert np.abs(error[:, :2]).max() < 0.02
    assert np.abs(error[:, 2]).max() < 0.15
    # The simulated receiver's clock is perfect; so is its rate.
    assert np.abs(point.clock_s).max() < 1e-9
    assert np.abs(point.system_offset_s[:, 1]).max() < 1e-10
    assert np.abs(point.velocity_ecef_mps).max() < 0.005
    assert point.n_rejected.max() == 0


def test_simulated_moving_receiver_agrees_with_its_trajectory(data_dir, rose_nav):
    folder = data_dir / "moving_simulator_rose"
    obs = read_observations(folder / "Rover-dynamic_MO_Spirent.obs.gz")
    with gzip.open(folder / "Rover-dynamic_PVA_Spirent.csv.gz", "rt") as file:
        truth = np.loadtxt(file, delimiter=",", skiprows=1)
    point = solve_single_point(obs, rose_nav)
    assert (point.status == PointStatus.OK).all()
    start_ns = gpst_from_calendar(2023, 1, 8, 10)
    at = np.rint((point.time_ns - start_ns) / 1e8).astype(int)
    inside = at < len(truth)
    assert np.count_nonzero(inside) > 590
    position, velocity = truth[at[inside], 4:7], truth[at[inside], 7:10]
    error = enu(point.position_ecef_m[inside] - position, ROSE_ECEF_M)
    assert np.abs(error[:, :2]).max() < 0.03
    assert np.abs(error[:, 2]).max() < 0.15
    # A time error would show along the velocity: regress it. 1 ms would be 1e-3 s.
    speed = velocity - velocity.mean(axis=0)
    moved = point.position_ecef_m[inside] - position
    moved = moved - moved.mean(axis=0)
    lag_s = np.sum(moved * speed) / np.sum(speed * speed)
    assert abs(lag_s) < 5e-4
    # The trajectory file gives velocity to 0.1 mm/s; jerk within the simulator's step is some mm/s.
    rate_error = point.velocity_ecef_mps[inside] - velocity
    assert np.percentile(np.linalg.norm(rate_error, axis=1), 99) < 0.05


def test_geodetic_receivers_a_metre_apart_see_the_same_sky(data_dir):
    folder = data_dir / "pair_1m_geodetic"
    nav = read_navigation(folder / "base.nav.gz")
    latitude, longitude, height = map(float, (folder / "base_position.txt").read_text().split())
    place = ecef_from_geodetic(np.radians(latitude), np.radians(longitude), height)
    points = [
        solve_single_point(read_observations(folder / f"{name}.obs.gz"), nav) for name in ("base", "rover")
    ]
    for point in points:
        assert (point.status == PointStatus.OK).all()
        assert point.n_sats.min() >= 40
        error = enu(point.position_ecef_m - place, place)
        # The author's coordinates are of another datum: RTKLIB too is 2.7 to 3.0 m north of them.
        assert np.percentile(np.linalg.norm(error, axis=1), 99) < 4.0
        assert np.all(error.std(axis=0) < [0.2, 0.2, 0.8])
        # Static: Doppler noise of geodetic receivers.
        assert np.percentile(np.linalg.norm(point.velocity_ecef_mps, axis=1), 95) < 0.05
        # The clock's rate from Doppler is the rate of the clock from codes, to 3 cm/s.
        rate = np.polyfit(np.arange(len(point.clock_s)), point.clock_s, 1)[0]
        assert point.clock_drift_sps.mean() == pytest.approx(rate, abs=1e-10)
    # 0.99 m apart: what both receivers share is gone.
    apart = enu((points[1].position_ecef_m - points[0].position_ecef_m).mean(axis=0), place)
    assert apart == pytest.approx([-0.2232, -0.9647, 0.0096], abs=0.6)


def test_receivers_with_clocks_milliseconds_apart_see_satellites_at_one_true_time(data_dir):
    """Steered clocks of the 38 m pair are 2 ms apart: codes differ by 570 km, ranges by 38 m."""
    folder = data_dir / "pair_38m_gps"
    nav = read_navigation(folder / "brdc0770.11n")
    points = []
    for name in ("UPC10770.11o.gz", "UPC20770.11o.gz"):
        obs = read_observations(folder / name)
        point = solve_single_point(obs, nav)
        assert (point.status == PointStatus.OK).all()
        assert (point.velocity_status == PointStatus.NO_DOPPLER).all()
        place = np.array(obs.meta.approx_position_ecef_m)
        error = enu(point.position_ecef_m - place, place)
        # Broadcast ephemerides and ionosphere of 2010, one frequency.
        assert np.percentile(np.linalg.norm(error, axis=1), 95) < 7.0
        assert point.n_rejected.sum() == 0
        points.append(point)
    gap_s = points[1].clock_s - points[0].clock_s
    assert np.abs(gap_s).max() > 1e-3
    # Single differences of the residuals' common part: the two clocks differ smoothly from epoch to
    # epoch, so each is good to the noise of a code position, well below 30 ns.
    curvature = np.diff(gap_s, 2)
    # A receiver may steer by whole steps; leave the few epochs where it does.
    assert np.percentile(np.abs(curvature), 95) < 30e-9


def test_tags_off_the_second_give_true_times_on_it(data_dir):
    """The u-blox tags end in .991 s; the true time of reception differs by the 9 ms of the clock."""
    folder = data_dir / "pair_0.33m_ublox"
    nav = read_navigation(folder / "rover.nav.gz")
    for name in ("base.obs.gz", "rover.obs.gz"):
        point = solve_single_point(read_observations(folder / name), nav)
        assert (point.status == PointStatus.OK).mean() > 0.99
        middle = np.median(point.position_ecef_m, axis=0)
        scatter = np.percentile(np.linalg.norm(point.position_ecef_m - middle, axis=1), 95)
        assert scatter < 6.0
        true_ns = point.time_ns - np.rint(1e9 * point.clock_s).astype(np.int64)
        off_second_s = (true_ns + 500_000_000) % 1_000_000_000 / 1e9 - 0.5
        # The receiver measures on its own second and tags it afterwards to a millisecond.
        assert np.abs(off_second_s).max() < 1e-3
        assert np.percentile(np.linalg.norm(point.velocity_ecef_mps, axis=1), 95) < 0.15
