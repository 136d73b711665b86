"""The rotating accelerometer is as good as its bound, and its sigma is true: noise, jitter, vibration, lean.

Bounds are two-sided limits of chi-square with a false alarm of 1e-5 each; the seeds are fixed. Where sigma is
estimated from few bins of a spectrum the mean of (error/sigma)^2 is above one, as that of Student's t is.
"""

import importlib.util
import re
from pathlib import Path

import msgspec
import numpy as np
import pytest
from scipy import stats

from moving_bodies import Resting, generators
from truenorth.northfinding import Site
from truenorth.northfinding.turntable import find_north_turntable, turntable_budget
from truenorth.sensors import TurntableAccelerometerDescription, simulate_turntable_accelerometer
from truenorth.sensors.turntable_accelerometer import Vibration

FALSE_ALARM = 1e-5
ROOT = Path(__file__).resolve().parents[2]
FORTY = np.radians(40.0)
SITE = Site(FORTY)
SENSOR = TurntableAccelerometerDescription()


def limits(degrees):
    """Of a mean square with so many degrees of freedom."""
    return stats.chi2.ppf([FALSE_ALARM / 2.0, 1.0 - FALSE_ALARM / 2.0], degrees) / degrees


@pytest.fixture(scope="module")
def study():
    spec = importlib.util.spec_from_file_location("study_turntable", ROOT / "tools" / "study_turntable.py")
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    return tool


@pytest.fixture(scope="module")
def sections():
    text = (ROOT / "docs" / "validation" / "oguz_turntable.md").read_text(encoding="utf-8")
    return dict(part.split("\n", 1) for part in text.split("\n## ")[1:])


def rows(section):
    """Cells of a table as numbers, by first cell."""
    found = {}
    for line in section.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("| ") and not cells[0].startswith("-"):
            numbers = [re.match(r"[-+]?[\d.]+", cell) for cell in cells[1:]]
            found[cells[0]] = [float(number[0]) if number else None for number in numbers]
    return found


# ------------------------------------------------------------------------------ the page, once more


def test_the_trials_of_the_page_are_the_simulator_and_the_solver(study):
    signal, solver = study.same_signal()
    # rho W^2 and rounding of 9.8 m/s^2.
    assert signal < 1e-9
    assert solver < 1e-10
    assert max(study.base_case()) < 1e-6


@pytest.mark.parametrize("latitude", [40.0, 30.0, 20.0])
def test_latitude(study, sections, latitude):
    row = study.white_row(latitude, 10, 600, "again")
    page = rows(sections["Latitude"])[f"{latitude:g}°"]
    assert page[0] == study.PUBLISHED_LATITUDE[latitude]
    assert page[2] == pytest.approx(row["revolution_theory"], abs=6e-5)
    for column, key, degrees in ((3, "revolution", 6000), (4, "square", 600), (5, "likelihood", 600)):
        low, high = limits(degrees)
        # The page has 4000 runs itself.
        assert low * 0.9 < (row[key] / page[column]) ** 2 < high * 1.1, key
    # Published scatters of ten revolutions: chi-square with nine degrees, one draw each.
    low, high = limits(9)
    assert low < (page[0] / page[2]) ** 2 < high


@pytest.mark.parametrize("periods", [3, 10, 20, 30])
def test_periods(study, sections, periods):
    row = study.white_row(40.0, periods, 300, "again")
    page = rows(sections["Periods"])[f"{periods}"]
    assert page[4] == pytest.approx(row["square_theory"], abs=6e-5)
    assert page[6] == pytest.approx(row["bound"], abs=6e-5)
    low, high = limits(300)
    for column, key in ((3, "square"), (5, "likelihood")):
        assert low * 0.9 < (row[key] / page[column]) ** 2 < high * 1.1, key
    low, high = limits(periods - 1)
    assert low < (page[0] / page[2]) ** 2 < high


@pytest.mark.parametrize("theta", [0.0, 0.2, 2.0, 5.0])
def test_inclination(study, sections, theta):
    page = rows(sections["Inclination"])[f"{theta:g}°"]
    found, north = study.inclination_row(theta, 400)
    # Mean of 400 records of five revolutions, sigma 0.05 deg each, beside 4000.
    for column, sense in ((2, 1.0), (3, -1.0)):
        assert found[sense][0] == pytest.approx(page[column], abs=5.0 * 0.0513 * np.sqrt(1 / 400 + 1 / 4000))
        assert abs(found[sense][1]) < 5.0 * 0.0462 / np.sqrt(400.0)
    assert page[6] == pytest.approx(north, abs=6e-5)
    # The formula lies between the two senses; about north it is exact to 0.006 deg.
    assert -page[2] - 0.01 > page[1] > page[3] + 0.01 or theta < 2.0
    assert page[5] == pytest.approx(page[6], abs=0.006)
    # Published is one record of five revolutions, about the formula.
    assert abs(page[0] - page[1]) < 4.5 * 0.0513


def test_the_page_is_within_five_per_cent_of_the_bound_and_shows_the_loss(sections):
    found = rows(sections["Against the Cramér–Rao bound"])
    assert len([name for name in found if "n =" in name]) == 8
    for name, (bound, likelihood, ratio, square, loss, blind, blind_ratio) in (
        (name, values) for name, values in found.items() if "n =" in name
    ):
        assert likelihood / bound == pytest.approx(ratio, abs=2e-3)
        assert abs(ratio - 1.0) < 0.05, name
        assert abs(blind_ratio - 1.0) < 0.05, name
        assert loss == pytest.approx(np.pi**2 / 8.0, rel=0.1), name
        assert square > likelihood
        assert blind == pytest.approx(2.0 * bound, rel=1e-3)


@pytest.mark.parametrize("latitude", [0.0, 75.0])
def test_maximum_likelihood_without_encoder_reaches_its_bound(study, latitude):
    bound, found = study.speed_row(latitude, 5, 300)
    low, high = limits(300)
    assert low < (found / bound) ** 2 < high


# ------------------------------------------------------------------------------ honest sigma


CASES = {
    "white": (SENSOR, {}, 1.0),
    "square wave": (SENSOR, {"method": "square-wave"}, 1.0),
    "three revolutions": (msgspec.structs.replace(SENSOR, revolutions=3), {}, 1.0),
    "no encoder": (SENSOR, {"encoder": False}, 1.0),
    "jitter, no encoder": (msgspec.structs.replace(SENSOR, speed_jitter=3e-4), {"encoder": False}, 1.3),
    "jitter, leaning axis, as noise": (
        msgspec.structs.replace(SENSOR, speed_jitter=1e-4, axis_error_mrad=(1.0, 0.0)),
        {"speed_terms": False},
        1.2,
    ),
    "jitter, leaning axis, from the encoder": (
        msgspec.structs.replace(SENSOR, speed_jitter=1e-3, axis_error_mrad=(1.0, 0.5)), {}, 1.0,
    ),
    "vibration": (
        msgspec.structs.replace(
            SENSOR,
            vibrations=(
                Vibration(frequency_hz=11.3, amplitude_mps2=2e-5),
                Vibration(frequency_hz=30.0, amplitude_mps2=1e-4, phase_deg=20.0),
            ),
        ),
        {},
        1.0,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_errors_are_as_large_as_sigma_says(name):
    sensor, options, more = CASES[name]
    runs = 40
    squares = []
    for seed in range(runs):
        heading = np.mod(0.3 + 1.7 * seed, 2.0 * np.pi)
        body = Resting(FORTY, heading_deg=float(np.degrees(heading)))
        log = simulate_turntable_accelerometer(
            sensor, body, start_ns=0, duration_s=10.0, generator=generators(1000 + seed)
        )
        found = find_north_turntable(log, SITE, **options)
        error = np.mod(found.heading_rad - heading + np.pi, 2.0 * np.pi) - np.pi
        squares.append((error / found.heading_sd_rad) ** 2)
    low, high = limits(runs)
    assert low < np.mean(squares) < more * high


def test_stated_errors_of_tilt_mark_and_lean_are_those_that_come():
    """Draws of what is not known: the budget and the stated covariance agree with them."""
    rng = np.random.default_rng(7)
    tilt_sd, lean_sd, mark_sd = np.radians(0.1), 1e-3, np.radians(0.05)
    runs, turns = 80, 0.0
    for seed in range(runs):
        pitch, roll = np.degrees(tilt_sd * rng.standard_normal(2))
        lean = tuple(1e3 * lean_sd * rng.standard_normal(2))
        device = msgspec.structs.replace(
            SENSOR, axis_error_mrad=lean, mark_deg=float(np.degrees(mark_sd) * rng.standard_normal())
        )
        body = Resting(FORTY, heading_deg=40.0, pitch_deg=float(pitch), roll_deg=float(roll))
        log = simulate_turntable_accelerometer(
            device, body, start_ns=0, duration_s=10.0, generator=generators(seed)
        )
        found = find_north_turntable(
            log, SITE, description=SENSOR, tilt_rad=(0.0, 0.0), tilt_sd_rad=tilt_sd, lean_sd_rad=lean_sd,
            mark_sd_rad=mark_sd,
        )  # fmt: skip
        error = np.mod(found.heading_rad - np.radians(40.0) + np.pi, 2.0 * np.pi) - np.pi
        turns += (error / found.heading_sd_rad) ** 2
    budget = turntable_budget(
        SENSOR, SITE, tilt_sd_rad=tilt_sd, lean_sd_rad=lean_sd, mark_sd_rad=mark_sd
    ).angle_sd_rad()[0]  # fmt: skip
    assert budget == pytest.approx(found.heading_sd_rad, rel=0.01)
    # A product of two normal variables has heavier tails than one: kurtosis 9 instead of 3.
    spread = np.sqrt(8.0 / runs)
    assert abs(turns / runs - 1.0) < 4.5 * spread
