"""The public laser-gyro log: the bars of the default form, sigma against scatter, the committed page."""

import re
from pathlib import Path

import numpy as np
import pytest

from truenorth.formats.imu_table import read_imu_table
from truenorth.northfinding import Site
from truenorth.northfinding.inertial import FORMS, align_inertial, estimate_latitude
from truenorth.northfinding.static import align_static
from truenorth.strapdown import InertialIncrements, compress_increments

TRUE_HEADING_DEG = 90.602
PAGE = Path(__file__).resolve().parents[2] / "docs" / "validation" / "laser_gyro.md"


@pytest.fixture(scope="module")
def log(data_dir):
    return read_imu_table(data_dir / "imu_laser_gyro" / "lasergyro.imu.gz")


@pytest.fixture(scope="module")
def site(log):
    return Site(log.latitude_rad, log.longitude_rad, log.height_m)


@pytest.fixture(scope="module")
def blocks(log):
    return compress_increments(log.increments, 100)


def window(blocks, first, length):
    """So many seconds from the first one."""
    part = slice(first, first + length)
    return InertialIncrements(
        blocks.time_s[first : first + length + 1], blocks.angle_rad[part], blocks.velocity_mps[part],
        blocks.position_m[part],
    )  # fmt: skip


def errors_deg(blocks, length, step, align, offset=0):
    """Heading errors of windows and their stated standard deviations, shape (2, n)."""
    rows = []
    for first in range(offset, len(blocks.angle_rad) - length + 1, step):
        found = align(window(blocks, first, length))
        error = (np.degrees(found.heading_rad) - TRUE_HEADING_DEG + 180.0) % 360.0 - 180.0
        rows.append((error, np.degrees(found.angle_sd_rad[0])))
    return np.array(rows).T


@pytest.mark.parametrize(("length", "largest", "median"), [(300, 0.05, 0.02), (120, 0.1, 0.03)])
def test_every_window_gives_north(blocks, site, length, largest, median):
    """A start every 29 s, which shares no period with anything; the page has every second."""
    errors, sd = errors_deg(blocks, length, 29, lambda of: align_inertial(of, site, running=False))
    assert np.max(np.abs(errors)) < largest
    assert np.median(np.abs(errors)) < median
    # Sigma of noise that each window shows itself: right to a factor of two over all of them.
    assert 0.4 < np.sqrt(np.mean((errors / sd) ** 2)) < 2.0


def test_the_worst_windows_of_the_page_are_within_the_bars(blocks, site):
    """The starts at which windows of 300 s and 120 s are worst, from every start of a second."""
    for length, first, bar in ((300, 705, 0.05), (120, 34, 0.1), (120, 685, 0.1)):
        errors, _ = errors_deg(
            window(blocks, first - 3, length + 6),
            length,
            1,
            lambda of: align_inertial(of, site, running=False),
        )
        assert np.max(np.abs(errors)) < bar


def test_plain_averaging_scatters_by_degrees(blocks, site):
    errors, _ = errors_deg(blocks, 300, 53, lambda of: align_static(of, site, running=False))
    assert 2.0 < np.std(errors) < 5.0


@pytest.mark.parametrize("form", FORMS)
def test_the_whole_record_gives_the_heading_by_every_form(log, site, form):
    found = align_inertial(log.increments, site, form=form)
    assert np.degrees(found.heading_rad) == pytest.approx(TRUE_HEADING_DEG, abs=0.006)
    # Five minutes on, the estimate has been within the bar ever since.
    late = found.run.time_s > 300.0
    bar = 0.05 if form in ("velocity-fit", "weighted") else 0.2
    assert np.max(np.abs(np.degrees(found.run.angles_rad[late, 0]) - TRUE_HEADING_DEG)) < bar
    assert np.degrees(found.angle_sd_rad[0]) < 0.02
    assert found.duration_s == pytest.approx(1847.0)


def test_what_the_record_says_of_itself(log, site):
    measured = align_inertial(log.increments, site, running=False).measured
    assert measured["gravity_mps2"] == pytest.approx(site.gravity_mps2, abs=1e-3)
    assert measured["horizontal_rate_dph"] == pytest.approx(12.43, abs=0.03)
    # A laser gyro: a few ten-thousandths of a degree per root hour.
    assert 2e-4 < measured["gyro_random_walk_deg_per_sqrt_h"] < 1.5e-3
    assert 5e-5 < measured["shaking_mps"] < 3e-4
    found = estimate_latitude(log.increments, height_m=log.height_m)
    assert found.latitude_rad == pytest.approx(site.latitude_rad, abs=np.radians(0.15))


def test_the_committed_page_keeps_the_bars(blocks, site):
    """And its rows come from this program: a dozen of its windows, run again, scatter as it says."""
    row = re.compile(r"\| velocity-fit \| (\d+) \| (\d+) \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|")
    dense = {
        int(m[1]): (int(m[2]), *map(float, m.groups()[2:]))
        for m in reversed(list(row.finditer(PAGE.read_text())))
    }
    assert dense[300][0] == 1548
    assert dense[300][1] <= 0.02
    assert dense[300][2] <= 0.05
    assert dense[120][2] <= 0.1
    for length, (_, _, largest, scatter) in dense.items():
        errors, _ = errors_deg(blocks, length, 120, lambda of: align_inertial(of, site, running=False))
        assert np.max(np.abs(errors)) <= largest + 1e-4
        assert np.std(errors) < 2.0 * scatter
    for name in FORMS:
        assert f"| {name} | 600 |" in PAGE.read_text()
