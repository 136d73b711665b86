"""All sensors of a scenario: their tables, independence of their draws, cheap imports."""

import subprocess
import sys

import numpy as np
import pytest

from moving_bodies import Circling, generators
from truenorth import sensors
from truenorth.config import convert_settings
from truenorth.errors import ConfigError
from truenorth.sensors import SensorsSection, simulate_sensors
from truenorth.timescales import gpst_from_calendar

START_NS = gpst_from_calendar(2024, 6, 24, 8, 0, 0)
ALL = {
    "gyro": {}, "compass": {}, "tilt": {}, "turntable_accelerometer": {}, "odometer": {},
    "imu": [{"grade": "consumer", "name": "phone"}, {"rate_hz": 50}],
}  # fmt: skip


def run(table, seed=1, duration_s=20.0):
    section = convert_settings(table, SensorsSection, prefix="sensors.")
    return simulate_sensors(
        section, Circling(), start_ns=START_NS, duration_s=duration_s, generator=generators(seed)
    )


def same(first, second):
    pairs = [*first.columns.items(), *first.truth.items(), ("time", first.time_ns)]
    others = {**second.truth, **second.columns, "time": second.time_ns}
    others_truth = {**second.columns, **second.truth, "time": second.time_ns}
    return all(np.array_equal(v, others[k]) or np.array_equal(v, others_truth[k]) for k, v in pairs)


def test_every_sensor_gives_its_log_with_a_truth_of_the_same_length():
    logs = run(ALL)
    kinds = {name: log.kind for name, log in logs.items()}
    assert kinds == {**{k: k for k in ALL if k != "imu"}, "phone": "imu", "imu": "imu"}
    for log in logs.values():
        assert log.truth["time_ns"].dtype == np.int64
        for column in (*log.columns.values(), *log.truth.values()):
            assert column.shape == (log.n_samples,)
            assert np.isfinite(column).all()
        assert np.all(np.diff(log.time_ns) > 0)
    assert run({}) == {}


def test_what_is_added_leaves_the_other_sensors_alone_and_seeds_matter():
    logs = run(ALL)
    for name in ("gyro", "odometer", "turntable_accelerometer"):
        assert same(logs[name], run({name: {}})[name])
        assert not same(logs[name], run({name: {}}, seed=2)[name])
    assert same(logs["phone"], run({"imu": [ALL["imu"][0]]})["phone"])


def test_compass_and_tilt_meter_are_one_module_with_one_clock():
    logs = run(ALL)
    np.testing.assert_array_equal(logs["compass"].time_ns, logs["tilt"].time_ns)


@pytest.mark.parametrize(
    ("table", "key"),
    [
        ({"gyro": {"bitts": 12}}, "sensors.gyro.bitts"),
        ({"gyro": {"bits": 0}}, "sensors.gyro.bits"),
        ({"imu": [{}, {}]}, "sensors.imu"),
        ({"imu": [{"name": "gyro"}]}, "sensors.imu"),
        ({"imu": [{"grade": "good"}]}, "sensors.imu[0].grade"),
        ({"compass": {"tilt_compensation": "tilt"}}, "sensors.compass.tilt_compensation"),
        ({"compass": {"events": [{"start_s": 1, "duration_s": -1, "peak_body_nt": [0, 0, 0]}]}},
         "sensors.compass.events[0].duration_s"),
    ],
)  # fmt: skip
def test_impossible_tables_are_refused_with_their_place(table, key):
    with pytest.raises(ConfigError) as caught:
        run(table)
    assert caught.value.key == key


def test_a_record_shorter_than_a_sample_is_empty():
    for log in run(ALL, duration_s=0.001).values():
        assert log.n_samples == 0


def test_descriptions_load_without_heavy_libraries():
    code = (
        "import sys, truenorth.sensors as s; s.SensorsSection(); "
        "print([m for m in ('scipy', 'pandas', 'ppigrf', 'numba', 'polars') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
    assert set(sensors.__all__) <= set(dir(sensors))
    with pytest.raises(AttributeError, match="no attribute"):
        _ = sensors.barometer
