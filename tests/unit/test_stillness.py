"""Stillness: moves and slow turns are found, steady shaking is none of them."""

import numpy as np
import pytest

from shaken_records import QUIET, drawn_record, ideal_record, trajectory_at_site
from truenorth.errors import NoSolutionError
from truenorth.northfinding.stillness import detect_stillness
from truenorth.sensors.imu import ImuDescription
from truenorth.simulation.motion import Move, StaticMotion, SwayMotion, TurntableMotion

UNIT = ImuDescription(grade="tactical", rate_hz=50.0)
MOVES = (
    Move(at_s=20.0, duration_s=4.0, yaw_deg=10.0, sway_m=0.5),
    Move(at_s=40.0, duration_s=2.0, lasting=False, roll_deg=1.0),
)


@pytest.mark.parametrize("shaken", [False, True])
def test_moves_are_found_and_nothing_else(shaken):
    motion = SwayMotion(moves=MOVES) if shaken else SwayMotion(moves=MOVES, **QUIET)
    record, _ = drawn_record(trajectory_at_site(motion, 60.0), UNIT, 60.0, seed=1)
    still = detect_stillness(record, errors=UNIT)
    time_s = record.time_s[:-1]
    # The middle of each move; a smooth one begins and ends too gently to be felt.
    assert not still[(time_s > 21.0) & (time_s < 23.0)].any()
    assert not still[(time_s > 40.4) & (time_s < 41.6)].any()
    # A window and its neighbour around each.
    far = (time_s < 18.0) | ((time_s > 26.0) & (time_s < 38.0)) | (time_s > 44.0)
    assert still[far].all()


def test_a_slow_even_turn_is_a_motion():
    motion = TurntableMotion(steps=((0.0, 0.0), (40.0, 0.2), (50.0, 0.0)))
    record, _ = drawn_record(trajectory_at_site(motion, 90.0), UNIT, 90.0, seed=2)
    still = detect_stillness(record, errors=UNIT)
    # 0.2 deg/s is 24 times the noise of this gyro over a tenth of a second.
    assert not still[(record.time_s[:-1] > 41.0) & (record.time_s[:-1] < 49.0)].any()
    assert still[record.time_s[:-1] < 38.0].all()


def test_without_stated_noise_the_quiet_part_tells_it():
    record, _ = drawn_record(trajectory_at_site(SwayMotion(moves=MOVES), 60.0), UNIT, 60.0, seed=3)
    still = detect_stillness(record)
    assert not still[(record.time_s[:-1] > 21.0) & (record.time_s[:-1] < 23.0)].any()
    assert np.mean(still) > 0.7


def test_a_record_of_two_windows_is_refused():
    with pytest.raises(NoSolutionError, match="three windows"):
        detect_stillness(ideal_record(StaticMotion(), 2.5)[0])
