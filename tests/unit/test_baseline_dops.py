"""Baseline DOPs against the numbers of a stated sky and against the covariance of double differences."""

import numpy as np
import pytest

from truenorth.positioning.dops import baseline_dops

# Azimuth and elevation of seven satellites, degrees, highest-weighted first.
SKY_DEG = np.array([(40, 65), (150, 48), (255, 55), (320, 30), (95, 22), (200, 18), (10, 15)], dtype=float)


def line_of_sight_enu(sky_deg):
    az, el = np.radians(sky_deg).T
    return np.stack([np.cos(el) * np.sin(az), np.cos(el) * np.cos(az), np.sin(el)], axis=-1)


@pytest.mark.parametrize(
    ("n_sats", "azimuth_dop", "elevation_dop"),
    [(7, 1.07, 2.23), (6, 1.07, 2.66), (5, 1.33, 3.54), (4, 2.02, 5.67)],
)
def test_level_baseline_to_north_has_the_dops_of_the_stated_sky(n_sats, azimuth_dop, elevation_dop):
    dops = baseline_dops(line_of_sight_enu(SKY_DEG[:n_sats]), 0.0, 0.0)
    # The anchors are printed with two decimals.
    assert dops.azimuth_dop[0] == pytest.approx(azimuth_dop, abs=0.005)
    assert dops.elevation_dop[0] == pytest.approx(elevation_dop, abs=0.005)


@pytest.mark.parametrize(("n_sats", "azimuth_dop"), [(7, 0.88), (6, 1.16), (5, 1.73), (4, 1.73)])
def test_level_baseline_to_east_has_the_dops_of_the_stated_sky(n_sats, azimuth_dop):
    dops = baseline_dops(line_of_sight_enu(SKY_DEG[:n_sats]), np.pi / 2, 0.0)
    assert dops.azimuth_dop[0] == pytest.approx(azimuth_dop, abs=0.005)


def test_groups_and_epochs_equal_explicit_double_differences():
    rng = np.random.default_rng(7)
    e = line_of_sight_enu(np.column_stack([rng.uniform(0, 360, 11), rng.uniform(10, 90, 11)]))
    group = np.array([0, 0, 0, 1, 1, 0, 0, 0, 1, 1, 1])
    start = np.array([0, 5, 11])
    azimuth, elevation = np.array([0.3, 4.0]), np.array([0.2, -0.5])
    dops = baseline_dops(e, azimuth, elevation, group=group, epoch_start=start)
    for k in range(2):
        normal = np.zeros((3, 3))
        for g in range(2):
            rows = e[start[k] : start[k + 1]][group[start[k] : start[k + 1]] == g]
            design = -(rows[1:] - rows[0])
            m = len(design)
            normal += design.T @ np.linalg.solve(2.0 * (np.eye(m) + np.ones((m, m))), design)
        q = np.linalg.inv(normal)
        # Gradients of the angles of b by finite differences on a unit baseline.
        b = np.array(
            [
                np.cos(elevation[k]) * np.sin(azimuth[k]),
                np.cos(elevation[k]) * np.cos(azimuth[k]),
                np.sin(elevation[k]),
            ]
        )
        step = 1e-6
        g_az, g_el = np.empty(3), np.empty(3)
        for i in range(3):
            plus, minus = b + step * np.eye(3)[i], b - step * np.eye(3)[i]
            g_az[i] = (np.arctan2(plus[0], plus[1]) - np.arctan2(minus[0], minus[1])) / (2 * step)
            g_el[i] = (
                np.arctan2(plus[2], np.hypot(plus[0], plus[1]))
                - np.arctan2(minus[2], np.hypot(minus[0], minus[1]))
            ) / (2 * step)
        assert dops.azimuth_dop[k] == pytest.approx(np.sqrt(g_az @ q @ g_az), rel=1e-6)
        assert dops.elevation_dop[k] == pytest.approx(np.sqrt(g_el @ q @ g_el), rel=1e-6)
        assert dops.pdop[k] == pytest.approx(np.sqrt(np.trace(q)), rel=1e-9)
        assert dops.pdop[k] ** 2 == pytest.approx(dops.hdop[k] ** 2 + dops.vdop[k] ** 2, rel=1e-9)


def test_a_sky_that_spans_no_volume_gives_nan():
    assert np.isnan(baseline_dops(line_of_sight_enu(SKY_DEG[:3]), 0.0, 0.0).azimuth_dop[0])
    assert np.isnan(baseline_dops(np.empty((0, 3)), 0.0, 0.0).pdop[0])
