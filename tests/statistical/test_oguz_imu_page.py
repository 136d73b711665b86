"""The page of the eight attitudes against a small run of its study and against the published numbers."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from truenorth.northfinding import Site
from truenorth.northfinding.budget import heading_sd_against_latitude, published_bound_rad, static_budget
from truenorth.rotations import rot_ned_from_body

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "validation" / "oguz_imu.md").read_text(encoding="utf-8")
UNITS, LATITUDE_UNITS, SECONDS, SEED = 200, 400, 300.0, 2006


@pytest.fixture(scope="module")
def study():
    spec = importlib.util.spec_from_file_location("study_north_imu", ROOT / "tools" / "study_north_imu.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def rows(heading):
    """Cells of every row of the first table below a heading."""
    section = PAGE.partition(f"## {heading}\n")[2]
    lines = re.search(r"\| -.*\n((?:\|.*\n)+)", section)[1].strip().split("\n")
    return [line.strip("| ").split(" | ") for line in lines]


def chi(dof):
    """Bounds of a standard deviation over its expectation, false alarm 1e-5."""
    return np.sqrt(stats.chi2.ppf([5e-6, 1.0 - 5e-6], dof) / dof)


def test_the_page_is_of_the_stated_run():
    assert (
        f"--seed {SEED} --units {UNITS} --duration {SECONDS:.0f} --latitude-units {LATITUDE_UNITS} " in PAGE
    )


def test_published_errors_and_bounds_are_those_printed(study):
    errors = np.array([attitude.heading_error_deg for attitude in study.ATTITUDES])
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(2.72, abs=5e-3)
    assert np.abs(errors).max() == pytest.approx(4.92, abs=5e-3)
    for text in ("5.0146°", "4.967°", "4.9615°", "| 2.72 |", "| 4.92 |"):
        assert text in PAGE
    # All eight lie within the bound, as it was printed and as it should be.
    assert np.all(np.abs(errors) < np.degrees(published_bound_rad(np.radians(39.0), earth_rate_dph=15.0)))


def test_eight_attitudes_have_the_predicted_spread(study):
    site = Site(*np.radians(study.PLACE_DEG_M[:2]), study.PLACE_DEG_M[2])
    low, high = chi(UNITS)
    for attitude, cells in zip(study.ATTITUDES, rows("Eight attitudes"), strict=True):
        rot = rot_ned_from_body(*np.radians([attitude.heading_deg, 0.0, attitude.roll_deg]))
        sd = np.degrees(static_budget(study.SENSOR, rot, site, SECONDS, deflection_sd_rad=0.0).angle_sd_rad())
        assert float(cells[6]) == pytest.approx(sd[0], abs=5.1e-3)
        assert low < float(cells[5]) / sd[0] < high
        # The direct form has the same azimuth but for the scale of the vertical accelerometer.
        assert float(cells[7]) == pytest.approx(float(cells[5]), abs=0.03)
        pitch, roll = (float(value) for value in cells[10].split(" / "))
        assert low < pitch / sd[1] < high
        assert low < roll / sd[2] < high
        inside = float(cells[9].rstrip("%")) / 100.0
        bound = np.degrees(published_bound_rad(site.latitude_rad))
        share = 2.0 * stats.norm.cdf(bound / sd[0]) - 1.0
        assert abs(inside - share) < 4.5 * np.sqrt(share * (1.0 - share) / UNITS) + 5e-3


def test_the_first_units_of_the_study_again(study):
    few = study.eight_attitudes(SEED, 12, SECONDS)
    for one, cells in zip(few, rows("Eight attitudes"), strict=True):
        # A part of the committed units: their squares cannot exceed the committed sum.
        assert np.sum(one.error[:, 0] ** 2) <= UNITS * (float(cells[5]) + 5e-3) ** 2
        assert np.abs(one.error[:, 0]).max() <= float(cells[8]) + 0.05
        assert one.sd[0] == pytest.approx(float(cells[6]), abs=5.1e-3)
    # One unit has the same bias in all attitudes: opposite headings are turned oppositely by it.
    opposite = np.corrcoef(few[0].error[:, 0], few[2].error[:, 0])[0, 1]
    assert opposite < -0.5


def test_the_curve_against_latitude(study):
    latitudes = np.radians(study.LATITUDES_DEG)
    linear, circle = (
        np.degrees(
            heading_sd_against_latitude(
                study.SENSOR, np.eye(3), latitudes, SECONDS, linear=straight, deflection_sd_rad=0.0
            )
        )
        for straight in (True, False)
    )
    low, high = chi(LATITUDE_UNITS)
    table = rows("Latitude")
    for k, cells in enumerate(table):
        values = np.array([float(cell) for cell in cells[:5]])
        expected = [
            np.degrees(latitudes[k]),
            np.degrees(published_bound_rad(latitudes[k])),
            linear[k],
            circle[k],
        ]
        np.testing.assert_allclose(values[:4], expected, atol=5.1e-3)
        # Errors on the circle are bounded and spread less than normal ones would.
        assert low < values[4] / circle[k] < high
    assert len(table) == len(latitudes)


def test_every_error_injected_alone_turns_as_the_sensitivities_say(study):
    site = Site(np.radians(study.LATITUDE_DEG))
    table = {cells[0]: cells[1:] for cells in rows("One error at a time")}
    assert len(table) >= 15
    for column, angles in ((0, study.INJECTED_ATTITUDES_DEG[1]), (2, study.INJECTED_ATTITUDES_DEG[4])):
        rot = rot_ned_from_body(*np.radians(angles))
        for name, sizes in study.injections(site, rot):
            got = np.degrees(study.injected(rot, site, "orthonormal", **sizes))
            said = np.degrees(study.predicted(rot, site, "orthonormal", name, sizes))
            # What is left is the third order: a rate of 1 deg/h is a twelfth of the horizontal Earth rate.
            np.testing.assert_allclose(got, said, atol=0.02 if "1°/h" in name else 2e-6)
            if name in table:
                for cell, value in zip(table[name][column : column + 2], (got, said), strict=True):
                    np.testing.assert_allclose([float(x) for x in cell.split(" / ")], value, atol=5.1e-5)
            else:
                assert np.abs(said).max() < 5e-5
