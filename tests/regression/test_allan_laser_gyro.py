"""Allan deviation of a laser gyro unit on a parked vehicle whose people move: the vehicle told apart."""

import numpy as np
import pytest

from truenorth.formats.imu_table import read_imu_table
from truenorth.sensors.allan import analyse_allan


@pytest.fixture(scope="module")
def result(data_dir):
    return analyse_allan(read_imu_table(data_dir / "imu_laser_gyro" / "lasergyro.imu.gz").increments)


def test_motion_of_the_vehicle_is_told(result):
    for axis in result.axes:
        assert axis.disturbance is not None
        assert not any(term.is_determined for term in axis.terms.values())
    # The vertical has no gravity to compare with; its swing near 2 Hz shows all the same.
    assert "feel most of it" in result.axes[0].disturbance
    assert "feel most of it" not in result.axes[2].disturbance
    assert "hump" in result.axes[2].disturbance


def test_the_sensors_are_bounded_below_the_motion(result):
    raw = np.min(result.axes[0].deviation * np.sqrt(result.axes[0].tau_s)) * 60.0 * np.degrees(1.0)
    for axis in result.axes[:2]:
        # A laser gyro: the vehicle alone would let 0.05 deg/sqrt(h) pass.
        assert axis.terms["random_walk"].bound < 0.006 < raw
        assert axis.terms["bias_instability"].bound < 0.03
    described = result.describe("tactical")
    assert described.gyro_random_walk_deg_per_sqrt_h < 0.006
    assert described.accel_bias_instability_ug < 10.0
    assert described.gyro_bias_sd_dph == 4.0
