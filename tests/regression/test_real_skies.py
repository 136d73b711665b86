"""Skies of real files: moved in time, smooth, and broadcast ephemerides fitted to an SP3 file."""

import numpy as np

from truenorth.constants import SPEED_OF_LIGHT_MPS
from truenorth.frames import ecef_from_geodetic
from truenorth.orbits import compute_satellite_states
from truenorth.simulation.sky import FileSky, build_sky
from truenorth.simulation.sky.tracks import tracks
from truenorth.timescales import NS_PER_S, gpst_from_calendar

GRAZ = ecef_from_geodetic(np.radians(47.07), np.radians(15.44), 400.0)
DAY = "rinex_samples/BRD400DLR_S_20260680000_01D_MN.rnx.gz"
SP3 = "rinex_samples/ESA0OPSRAP_20232390000_01D_15M_ORB.SP3.gz"


def test_a_day_of_all_systems(data_dir):
    start_ns = gpst_from_calendar(2026, 3, 9, 12)
    section = FileSky(files=(DAY,), systems="GREC")
    sky = build_sky(section, start_ns=start_ns, duration_s=3600.0, seed=1, folder=data_dir)
    times = start_ns + np.arange(0, 3600, 60) * NS_PER_S
    seen = tracks(sky, GRAZ, times)
    count = [np.sum(seen.elevation_rad[:, sky.satellites // 100 == k] > 0.17, axis=1) for k in range(4)]
    assert all(one.min() >= 6 and one.max() <= 14 for one in count), count
    sat = np.tile(sky.satellites, len(times))
    truth = sky.true_states(sat, np.repeat(times, len(sky.satellites)))
    broadcast = compute_satellite_states(sky.navigation, sat, np.repeat(times, len(sky.satellites)))
    both = (truth[4] == 0) & (broadcast.status == 0)
    assert np.mean(both) > 0.9
    # What passes from one ephemeris to the next stays as near to them as they are to each other.
    away = np.linalg.norm(truth[0] - broadcast.position_ecef_m, axis=1)[both]
    assert np.quantile(away, 0.95) < 2.0
    earlier, later = (sky.true_states(sat, np.repeat(times, len(sky.satellites)), h) for h in (0.5, -0.5))
    assert np.nanmax(np.abs(later[0] - earlier[0] - truth[1])) < 1e-4


def test_broadcast_ephemerides_fitted_to_an_sp3_file(data_dir):
    start_ns = gpst_from_calendar(2023, 8, 27, 9)
    sky = build_sky(FileSky(files=(SP3,)), start_ns=start_ns, duration_s=3600.0, seed=1, folder=data_dir)
    assert np.bincount(sky.satellites // 100).tolist() == [32, 22]
    times = np.repeat(start_ns + np.arange(0, 3600, 300) * NS_PER_S, len(sky.satellites))
    sat = np.tile(sky.satellites, 12)
    position, _, clock, _, status = sky.true_states(sat, times)
    broadcast = compute_satellite_states(sky.navigation, sat, times)
    assert np.all(status == 0)
    assert np.all(broadcast.status == 0)
    away = np.linalg.norm(position - broadcast.position_ecef_m, axis=1)
    # Fifteen numbers hold four hours of a GPS orbit to decimetres, nine half an hour of GLONASS to 0.1 m.
    assert np.sqrt(np.mean(away[sat // 100 == 0] ** 2)) < 0.4
    assert away[sat // 100 == 0].max() < 1.5
    assert away[sat // 100 == 1].max() < 0.15
    assert np.abs(clock - broadcast.clock_s).max() * SPEED_OF_LIGHT_MPS < 1.0
