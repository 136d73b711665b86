"""Boresight and lever arms: from attitude series, from axes, from trajectories."""

import json

import numpy as np
import pytest

from truenorth.calibration.mounting import (
    align_attitudes,
    axes_of_marks,
    boresight_from_axes,
    lever_arm_from_tracks,
)
from truenorth.errors import ConfigError, FormatError, NoSolutionError
from truenorth.evaluation.boresight import boresight_of_tracks
from truenorth.report.calibration_text import boresight_text
from truenorth.rotations import exp_so3, heading_pitch_roll, log_so3, rot_ned_from_body

MOUNT_DEG = np.array([47.0, 3.0, -8.0])
MOUNT = rot_ned_from_body(*np.radians(MOUNT_DEG))
TABLE_7_1_DEG = np.array([0.199, 0.138, 0.078])
"""Landfahrer 2009, misalignment of the IMU: yaw, pitch, roll."""


def ship(n):
    k = np.arange(n)
    return rot_ned_from_body(0.01 * k, 0.05 * np.sin(0.1 * k), 0.1 * np.cos(0.07 * k))


def noisy(rot, sd_deg, rng):
    return exp_so3(np.radians(sd_deg) * rng.standard_normal((len(rot), 3))) @ rot


def test_a_constant_rotation_is_recovered_to_a_thousandth_of_a_degree():
    """5000 epochs of 0.03 to 0.05 degrees and 47, 3, -8 degrees (McMillan et al. 1994)."""
    truth = ship(5000)
    errors, nees = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        sd_deg = np.array([0.03, 0.04, 0.05])
        found = align_attitudes(noisy(truth, sd_deg, rng), truth @ MOUNT.T)
        errors.append(np.degrees(found.angles_rad) - MOUNT_DEG)
        left = log_so3(found.rot_b_from_a @ MOUNT.T)
        nees.append(left @ np.linalg.solve(found.cov_rad2, left))
        # By sqrt(5000) less than one epoch, and what is stated.
        assert np.all(np.degrees(found.sd_rad) < 0.001)
    assert np.sqrt(np.mean(np.square(errors))) < 0.001
    # Mean of 20 chi-squares of 3 degrees: sd sqrt(6 / 20) = 0.55; four of them.
    assert abs(np.mean(nees) - 3.0) < 2.2


def test_the_test_part_takes_no_part():
    rng = np.random.default_rng(3)
    truth = ship(2000)
    drift = np.zeros((2000, 3))
    drift[1400:, 2] = np.radians(0.2)
    found = align_attitudes(noisy(truth, 0.04, rng), truth @ MOUNT.T @ exp_so3(drift), test_share=0.3)
    assert found.is_test.sum() == 600
    np.testing.assert_allclose(np.degrees(found.angles_rad), MOUNT_DEG, atol=0.01)
    # The drift of the reference shows in the mean of the test part, which aligning on all would hide.
    assert np.degrees(np.linalg.norm(found.test_mean_rad)) == pytest.approx(0.2, abs=0.01)
    np.testing.assert_allclose(np.degrees(found.test_sd_rad), 0.04, rtol=0.15)
    whole = align_attitudes(noisy(truth, 0.04, rng), truth @ MOUNT.T)
    assert np.isnan(whole.test_mean_rad).all()
    np.testing.assert_allclose(np.nanmean(whole.residual_rad, axis=0), 0.0, atol=1e-5)


def test_covariances_of_epochs_weigh_them():
    rng = np.random.default_rng(4)
    truth, sd_deg = ship(600), np.where(np.arange(600) % 2, 0.02, 0.5)
    attitude = exp_so3(np.radians(sd_deg)[:, None] * rng.standard_normal((600, 3))) @ truth
    cov = np.radians(sd_deg)[:, None, None] ** 2 * np.eye(3)
    weighted = align_attitudes(attitude, truth @ MOUNT.T, cov_rad2=cov)
    left_deg = np.degrees(np.linalg.norm(log_so3(weighted.rot_b_from_a @ MOUNT.T)))
    # Of 300 epochs of 0.02 degrees: 0.0012 on each axis.
    assert left_deg < 0.006


def test_gaps_and_spikes_do_no_harm():
    rng = np.random.default_rng(5)
    truth = ship(1000)
    attitude = noisy(truth, 0.03, rng)
    attitude[100:200] = np.nan
    attitude[300:310] = exp_so3(np.array([0.3, 0.0, 0.2])) @ attitude[300:310]
    found = align_attitudes(attitude, truth @ MOUNT.T)
    assert 880 <= found.n_used <= 890
    assert np.isnan(found.residual_rad[150]).all()
    np.testing.assert_allclose(np.degrees(found.angles_rad), MOUNT_DEG, atol=0.008)
    with pytest.raises(NoSolutionError, match="2 common epochs"):
        align_attitudes(attitude[:2], truth[:2])
    with pytest.raises(ConfigError, match="test_share"):
        align_attitudes(attitude, truth, test_share=1.0)


@pytest.mark.parametrize("method", ["triad", "least_squares"])
def test_axes_give_the_misalignment_and_its_covariance(method):
    mount = rot_ned_from_body(*np.radians(TABLE_7_1_DEG))
    axes = np.array([[1.0, 0.0, 0.0], [0.3, 0.95, 0.0], [0.1, 0.1, 1.0]])
    exact = boresight_from_axes(axes, axes @ mount.T, method=method)
    np.testing.assert_allclose(np.degrees(exact.angles_rad), TABLE_7_1_DEG, atol=1e-9)
    rng = np.random.default_rng(1)
    unit = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    nees = []
    for _ in range(1500):
        found = boresight_from_axes(
            unit, unit @ mount.T + 1e-3 * rng.standard_normal((3, 3)), method=method, sd_rad=1e-3
        )
        left = log_so3(found.rot_b_from_a @ mount.T)
        nees.append(left @ np.linalg.solve(found.cov_rad2, left))
    # Mean of 1500 chi-squares of 3 degrees: sd 0.063; four of them.
    assert abs(np.mean(nees) - 3.0) < 0.26


def test_axes_from_marks_and_what_is_no_pair_of_axes():
    lines = [[[0.0, 0.0, 0.0], [2.0, 0.1, 0.0]], [[0.0, 1.0, 0.0], [0.0, 0.5, 0.0], [0.0, -1.0, 0.0]]]
    axes = axes_of_marks(lines)
    np.testing.assert_allclose(axes[1], [0.0, -1.0, 0.0], atol=1e-12)
    assert axes[0, 0] > 0.99
    for kwargs, words in (
        ({"method": "guess"}, "method"),
        ({"axes_b": axes[:1]}, "same two axes"),
        ({"axes_a": axes[[0, 0]]}, "parallel"),
    ):
        with pytest.raises(ConfigError, match=words):
            boresight_from_axes(**({"axes_a": axes, "axes_b": axes} | kwargs))


def test_lever_arm_from_two_trajectories():
    lever, offset = np.array([-0.8, 0.3, 1.1]), np.array([0.5, -0.2, 0.3])
    rot = ship(800)
    nees = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        track = np.cumsum(rng.standard_normal((800, 3)), axis=0)
        other = track + rot @ lever + offset + 0.02 * rng.standard_normal((800, 3))
        other[seed] += 1.0
        found = lever_arm_from_tracks(track, other, rot, with_offset=True)
        left = found.lever_body_m - lever
        nees.append(left @ np.linalg.solve(found.cov_m2, left))
        assert found.n_used < 800
    np.testing.assert_allclose(found.offset_ned_m, offset, atol=0.05)
    # Forward and right of 800 epochs of 2 cm; down is told from the offset by little tilts only.
    assert np.all(found.sd_m[:2] < 0.0015)
    assert found.sd_m[2] > 0.005
    # Mean of 30 chi-squares of 3 degrees: sd 0.45; four of them.
    assert abs(np.mean(nees) - 3.0) < 1.8
    plain = lever_arm_from_tracks(track, other - offset, rot)
    np.testing.assert_allclose(plain.lever_body_m, lever, atol=0.005)
    assert plain.sd_m[2] < 0.0015
    level = rot_ned_from_body(np.zeros(50), 0.0, 0.0)
    with pytest.raises(NoSolutionError, match="turned too little"):
        lever_arm_from_tracks(track[:50], other[:50], level, with_offset=True)
    with pytest.raises(NoSolutionError, match="0 common epochs"):
        lever_arm_from_tracks(track[:5] * np.nan, other[:5], rot[:5])


def table(rot, time_ns):
    heading, pitch, roll = np.degrees(heading_pitch_roll(rot))
    return {"time_ns": time_ns, "heading_deg": heading, "pitch_deg": pitch, "roll_deg": roll}


def test_tables_are_matched_in_time(tmp_path):
    """A reference at 12.5 Hz off the epochs of the array is turned evenly between its own."""
    mount = rot_ned_from_body(*np.radians(TABLE_7_1_DEG))
    time_ns = np.arange(300) * 1_000_000_000
    fine_ns = np.arange(-5, 3760) * 80_000_000 + 13_000_000

    def attitude(at_ns):
        t = at_ns * 1e-9
        return rot_ned_from_body(0.02 * t, 0.03 * np.sin(0.5 * t), 0.05 * np.cos(0.6 * t))

    array, imu = table(attitude(time_ns), time_ns), table(attitude(fine_ns) @ mount.T, fine_ns)
    found = boresight_of_tracks(array, imu, test_share=0.2)
    # Linear interpolation over 80 ms bends by less than a ten-thousandth of a degree.
    np.testing.assert_allclose(np.degrees(found.angles_rad), TABLE_7_1_DEG, atol=2e-4)
    assert "heading         0.199" in boresight_text(found)
    assert "took no part" in boresight_text(found)
    with pytest.raises(FormatError, match="no heading, pitch and roll"):
        boresight_of_tracks(array, {"time_ns": fine_ns, "azimuth_deg": imu["heading_deg"]})
    for name, columns in (("array.csv", array), ("imu.csv", imu)):
        rows = [",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values(), strict=True))]
        (tmp_path / name).write_text("\n".join(rows) + "\n", encoding="utf-8")
    from typer.testing import CliRunner

    from truenorth.cli.app import app

    files = [str(tmp_path / name) for name in ("array.csv", "imu.csv")]
    told = json.loads(CliRunner().invoke(app, ["calibrate", "boresight", *files, "--json"]).output)
    assert told["pitch_deg"] == pytest.approx(TABLE_7_1_DEG[1], abs=2e-4)
    assert CliRunner().invoke(app, ["calibrate", "boresight", files[0], "nothing.csv"]).exit_code == 3
