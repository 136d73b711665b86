"""Plain averages on a vehicle that people rock: they say by how much they are wrong."""

import numpy as np
import pytest

from truenorth import Site, read_imu_table
from truenorth.northfinding.static import align_static
from truenorth.sensors import ImuDescription

pytestmark = pytest.mark.regression

HEADING_DEG = 90.602


def test_averages_know_that_the_body_was_rocked(data_dir):
    log = read_imu_table(data_dir / "imu_laser_gyro" / "lasergyro.imu.gz")
    site = Site(log.latitude_rad, log.longitude_rad, log.height_m)
    errors = ImuDescription(grade="navigation")
    off, sd = [], []
    for start_s in range(0, 1500, 300):
        found = align_static(log.between(start_s, start_s + 300.0).increments, site, errors=errors)
        off.append(np.degrees(found.heading_rad) - HEADING_DEG)
        sd.append(np.degrees(found.angle_sd_rad[0]))
        assert found.budget.lines[0].source == "rocking of the body"
        assert "did not stand still" in found.notes[0]
    assert np.std(off) > 1.0
    # The difference to the inertial frame is the error itself, whose own error is a hundredth of a degree.
    np.testing.assert_allclose(np.abs(off), sd, atol=0.1)
