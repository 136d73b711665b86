"""What simulated sensors say goes through their native formats, and the corrections take what comes back."""

import numpy as np
import pytest

import truenorth as tn
from moving_bodies import Circling, generators
from truenorth.config import convert_settings
from truenorth.formats import split_tcm2, write_fog_packets, write_tcm2
from truenorth.sensors import FogDescription, SensorsSection, correct_gyro, simulate_sensors
from truenorth.timescales import gpst_from_calendar

START_NS = gpst_from_calendar(1997, 10, 29, 22, 13, 0)


@pytest.fixture(scope="module")
def logs():
    section = convert_settings({"gyro": {}, "compass": {}, "tilt": {}}, SensorsSection, prefix="sensors.")
    return simulate_sensors(section, Circling(), start_ns=START_NS, duration_s=60.0, generator=generators(4))


def test_gyro(tmp_path, logs):
    write_fog_packets(tmp_path / "gyro.fog", logs["gyro"])
    again = tn.read(tmp_path / "gyro.fog")
    np.testing.assert_array_equal(again.time_ns, logs["gyro"].time_ns)
    assert set(again.columns) == set(logs["gyro"].columns)
    for name, column in logs["gyro"].columns.items():
        np.testing.assert_array_equal(again.columns[name], column)
    for name in ("temperature_step_degc", "temperature_zero_degc", "bits"):
        assert again.meta[name] == logs["gyro"].meta[name]
    gyro = FogDescription()
    np.testing.assert_array_equal(correct_gyro(gyro, again), correct_gyro(gyro, logs["gyro"]))


def test_compass_and_tilt_meter_in_one_sentence(tmp_path, logs):
    write_tcm2(tmp_path / "tcm2.log", logs["compass"], tilt=logs["tilt"])
    compass, tilt = split_tcm2(tn.read(tmp_path / "tcm2.log"))
    np.testing.assert_array_equal(compass.time_ns, logs["compass"].time_ns)
    # The module rounds as the sentence does, but for temperature and field: half a digit.
    limits = {"temperature_degc": 0.05, "field_forward_nt": 5.0, "field_right_nt": 5.0, "field_down_nt": 5.0}
    for log, again in ((logs["compass"], compass), (logs["tilt"], tilt)):
        for name, column in log.columns.items():
            np.testing.assert_allclose(
                again.columns[name] & ~1 if name == "error_code" else again.columns[name],
                column,
                rtol=0.0,
                atol=limits.get(name, 0.0) + 1e-9,
                err_msg=name,
            )
