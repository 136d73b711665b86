"""The ring-laser log of a parked, disturbed vehicle: what it says of itself, and harm done to it is told."""

import gzip

import numpy as np
import pytest

from truenorth.errors import FormatError, NoSolutionError
from truenorth.formats.imu_table import read_imu_table
from truenorth.northfinding import Site
from truenorth.northfinding.checks import check_record
from truenorth.sensors import ImuDescription
from truenorth.strapdown import InertialIncrements

COUNT_RAD = 0.1 * np.pi / 180.0 / 3600.0


@pytest.fixture(scope="module")
def log(data_dir):
    return read_imu_table(data_dir / "imu_laser_gyro" / "lasergyro.imu.gz")


@pytest.fixture(scope="module")
def site(log):
    return Site(log.latitude_rad, log.longitude_rad, log.height_m)


def windows(log, length_s=120.0, every_s=60.0):
    last = log.duration_s - length_s
    return [log.between(start, start + length_s) for start in np.arange(0.0, last, every_s)]


def test_header_and_samples(log):
    assert log.n_samples == 184_718
    assert log.interval_s == 0.01
    assert np.degrees([log.latitude_rad, log.longitude_rad]) == pytest.approx([34.246048, 108.909664])
    assert log.height_m == 380.0
    # Whole counts; the first sample holds two counts of gyro z, and 80 of accelerometer z.
    np.testing.assert_allclose(
        log.sensor_angle_rad / COUNT_RAD, np.rint(log.sensor_angle_rad / COUNT_RAD), atol=1e-6
    )
    np.testing.assert_allclose(log.sensor_angle_rad[0] / COUNT_RAD, [0.0, 0.0, 2.0], atol=1e-9)
    np.testing.assert_allclose(log.sensor_velocity_mps[0], [0.0, 0.0, 80.0 * 125e-6 * 9.780327])


def test_the_whole_log_feels_gravity_and_the_earth(log, site):
    felt = check_record(log.increments, site, table=log)
    # Counts of 125 ug and an unstated accelerometer scale: 1e-4 of gravity.
    assert felt.gravity_mps2 == pytest.approx(site.gravity_mps2, rel=5e-4)
    # Gyros of 0.01 deg/h.
    assert felt.horizontal_rate_radps == pytest.approx(site.horizontal_rate_radps, rel=3e-3)
    assert np.degrees(felt.latitude_rad) == pytest.approx(34.246, abs=0.2)


def test_every_window_passes(log, site):
    parts = windows(log)
    assert len(parts) == 29
    for part in parts:
        felt = check_record(part.increments, site, table=part)
        assert felt.horizontal_rate_radps == pytest.approx(site.horizontal_rate_radps, rel=5e-3)
    # Also where only the increments are at hand, and in other lengths.
    for part in windows(log, 30.0, 100.0) + windows(log, 300.0, 300.0):
        check_record(part.increments, site)


def harmed(part, *, gyro=1.0, force=1.0, limit_counts=None):
    angle = gyro * part.increments.angle_rad
    if limit_counts is not None:
        angle = np.clip(angle, -limit_counts * COUNT_RAD, limit_counts * COUNT_RAD)
    return InertialIncrements(part.increments.time_s, angle, force * part.increments.velocity_mps)


GYRO = (
    "gyros turn gravity by|do not feel the Earth turn|as far as the gyros say|as at latitude|is not at rest"
)


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        *(({"gyro": factor}, GYRO) for factor in (57.29578, 0.0174533, 9.80665, 1e-3, 1e3, 0.3, 2.0, -1.0)),
        *(
            ({"force": factor}, "gravity is")
            for factor in (57.29578, 0.0174533, 9.80665, 0.101972, 1e-3, 1e3, 0.0)
        ),
        ({"force": -1.0}, "as at latitude -3[2-6]"),
        ({"gyro": 0.0}, "zero rate"),
        ({"limit_counts": 5}, "gyro [xyz] is saturated"),
    ],
)
def test_harm_is_told_in_every_window(log, site, harm, said):
    for part in windows(log, every_s=240.0):
        with pytest.raises(NoSolutionError, match=said):
            check_record(harmed(part, **harm), site)


def test_a_reached_range_is_told(log, site):
    part = log.between(0.0, 120.0)
    harm = harmed(part, limit_counts=40)
    stated = ImuDescription(grade="navigation", gyro_range_dps=40 * np.degrees(COUNT_RAD) / 0.01)
    with pytest.raises(NoSolutionError, match=r"saturated: .* at the end of its range"):
        check_record(harm, site, errors=stated)


def test_lines_that_are_lost_or_cut_are_told(data_dir, tmp_path):
    with gzip.open(data_dir / "imu_laser_gyro" / "lasergyro.imu.gz", "rb") as file:
        lines = file.read().split(b"\n")[:3000]
    path = tmp_path / "cut.imu"
    path.write_bytes(b"\n".join([*lines[:-1], lines[-1][:5]]))
    with pytest.raises(FormatError, match="numbers where 6 belong") as caught:
        read_imu_table(path)
    assert caught.value.line_number == 3000
    lines[1000] = b"0 0 nan 0 0 80"
    path.write_bytes(b"\n".join(lines))
    with pytest.raises(FormatError, match=r"`gyro z` holds no number in sample 987 at 9.870 s"):
        read_imu_table(path)
    assert read_imu_table(path, start_s=10.0).n_samples == 3000 - 14 - 1000
