"""The electronic compass: heading from the field, the vehicle's iron, disturbances and the anomaly flag."""

import numpy as np
import pytest

from moving_bodies import HEIGHT, LATITUDE, LONGITUDE, Circling, Resting, generators
from truenorth.errors import ConfigError
from truenorth.sensors import (
    CompassDescription,
    TiltDescription,
    declination_rad,
    magnetic_heading,
    simulate_compass,
    simulate_tilt,
)
from truenorth.sensors.compass import MagneticEvent, correct_iron, earth_field_ned_nt
from truenorth.timescales import gpst_from_calendar

START_NS = gpst_from_calendar(1997, 10, 15, 22, 13, 0)
CLEAN = {
    "mean_error_deg": 0.0, "error_moving_deg": 0.0, "error_static_deg": 0.0, "noise_nt": 0.0,
    "anomalies_per_minute": 0.0, "resolution_deg": 0.0,
}  # fmt: skip


def run(compass, body, duration_s=60.0, **extra):
    return simulate_compass(
        compass, body, start_ns=START_NS, duration_s=duration_s, generator=generators(), **extra
    )


def fields(log):
    return np.stack([log.columns[f"field_{axis}_nt"] for axis in ("forward", "right", "down")], axis=-1)


def test_a_clean_compass_shows_the_magnetic_heading_in_any_attitude():
    for attitude in ((0.0, 0.0, 0.0), (123.0, 10.0, -20.0), (300.0, -35.0, 40.0)):
        log = run(CompassDescription(**CLEAN), Resting(LATITUDE, *attitude), 1.0)
        declination = log.meta["declination_deg"]
        shown = log.columns["heading_magnetic_deg"] + declination
        np.testing.assert_allclose(np.mod(shown - attitude[0] + 180.0, 360.0), 180.0, atol=1e-9)
        np.testing.assert_allclose(log.truth["error_rad"], 0.0, atol=1e-12)


def test_hard_and_soft_iron_deviate_as_the_textbook_says_and_come_off_again():
    earth = earth_field_ned_nt(LATITUDE, LONGITUDE, HEIGHT, START_NS)
    level = np.hypot(earth[0], earth[1])
    hard = run(CompassDescription(hard_iron_body_nt=(500.0, 0.0, 0.0), **CLEAN), Circling())
    magnetic = hard.truth["heading_rad"] - np.radians(hard.meta["declination_deg"])
    # A magnet ahead: semicircular deviation, tan = -h sin / (H + h cos).
    wanted = np.arctan2(-500.0 * np.sin(magnetic), level + 500.0 * np.cos(magnetic))
    # The circle starts 50 m from the place whose field was asked for: 1e-6 of it.
    np.testing.assert_allclose(hard.truth["error_rad"], wanted, atol=1e-6)
    iron = CompassDescription(
        hard_iron_body_nt=(500.0, -300.0, 200.0),
        soft_iron=((1.05, 0.02, 0.0), (0.01, 0.95, 0.03), (0.0, -0.02, 1.0)),
        **CLEAN,
    )
    log = run(iron, Circling())
    freed = correct_iron(iron, fields(log))
    zero = np.zeros(log.n_samples)
    np.testing.assert_allclose(np.linalg.norm(freed, axis=1), np.linalg.norm(earth), rtol=1e-5)
    back = magnetic_heading(freed, zero, zero) - magnetic
    np.testing.assert_allclose(np.mod(back + 1.0, 2.0 * np.pi), 1.0, atol=1e-9)


def test_wander_stands_in_heading_and_field_alike():
    log = run(CompassDescription(**{**CLEAN, "error_moving_deg": 5.8, "mean_error_deg": -1.2}), Circling())
    zero = np.zeros(log.n_samples)
    np.testing.assert_allclose(log.truth["error_rad"], log.truth["wander_rad"], atol=1e-9)
    np.testing.assert_allclose(
        np.degrees(magnetic_heading(fields(log), zero, zero)), log.columns["heading_magnetic_deg"], atol=1e-9
    )


def test_a_false_tilt_turns_the_heading_by_the_dip():
    settings = {**CLEAN, "tilt_compensation": "tilt"}
    tilt = TiltDescription(
        noise_static_deg=(0.0, 0.0), resolution_deg=0.0, offset_deg=(0.0, 1.0), noise_moving_deg=(0.0, 0.0)
    )
    body = Resting(heading_deg=0.0)
    readings = simulate_tilt(tilt, body, start_ns=START_NS, duration_s=2.0, generator=generators()).columns
    log = run(CompassDescription(**settings), body, 2.0, tilt_readings=readings)
    earth = earth_field_ned_nt(LATITUDE, LONGITUDE, HEIGHT, START_NS)
    # Levelled by 1 deg of roll too much: the field's vertical part leaks to the right by its sine. (At 1100 m
    # the plumb line of normal gravity is 2e-7 rad off the ellipsoid's, and the tilt meter feels it.)
    roll = np.radians(1.0)
    wrong = np.arctan2(-(earth[1] * np.cos(roll) - earth[2] * np.sin(roll)), earth[0])
    right = np.arctan2(-earth[1], earth[0])
    np.testing.assert_allclose(log.truth["error_rad"], wrong - right, atol=2e-6)
    assert np.degrees(wrong - right) > 2.9  # at 74 deg of dip a degree of tilt costs three of heading
    with pytest.raises(ConfigError, match="tilt meter"):
        run(CompassDescription(**settings), body, 2.0)


def test_readings_are_whole_tenths_within_the_circle():
    heading = run(CompassDescription(), Circling(), 300.0).columns["heading_magnetic_deg"]
    np.testing.assert_allclose(heading * 10.0, np.rint(heading * 10.0), atol=1e-9)
    assert heading.min() >= 0.0
    assert heading.max() < 360.0


def test_threshold_flag_rises_with_a_disturbance_on_schedule_and_only_then():
    event = MagneticEvent(start_s=20.0, duration_s=10.0, peak_body_nt=(0.0, 0.0, 8000.0))
    compass = CompassDescription(**CLEAN, anomaly_flag="threshold", events=(event,))
    log = run(compass, Circling())
    raised = log.columns["anomaly"] == 1
    # sin^2 passes a quarter of the peak at a third of the half width.
    np.testing.assert_array_equal(raised, np.abs(fields(log)[:, 2] - fields(log)[0, 2]) > 2000.0)
    assert 60 < raised.sum() < 70
    assert log.truth["anomaly_nt"].max() == pytest.approx(8000.0, rel=1e-3)
    off = run(CompassDescription(**CLEAN, anomaly_flag="off", events=(event,)), Circling())
    assert not off.columns["anomaly"].any()


def test_declination_of_the_source_and_of_today():
    # Harvey's Calgary lay at 18 to 19 deg east in 1997; the pole has moved on since.
    assert 18.0 < np.degrees(declination_rad(LATITUDE, LONGITUDE, HEIGHT, START_NS)) < 19.0
    today = declination_rad(LATITUDE, LONGITUDE, HEIGHT, gpst_from_calendar(2024, 6, 24))
    assert 12.5 < np.degrees(today) < 14.5


def test_dates_beyond_the_model_are_refused():
    with pytest.raises(ConfigError, match="the model holds"):
        declination_rad(LATITUDE, LONGITUDE, HEIGHT, gpst_from_calendar(2039, 1, 1))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("soft_iron", ((0.0, 0.0, 0.0),) * 3),
        ("anomaly_flag_share", 1.1),
        ("anomaly_duration_s", 0.0),
        ("error_moving_deg", -1.0),
        ("hard_iron_body_nt", (float("inf"), 0.0, 0.0)),
    ],
)
def test_impossible_settings_are_refused_by_name(key, value):
    with pytest.raises(ConfigError, match=f"`{key}`"):
        CompassDescription(**{key: value})
