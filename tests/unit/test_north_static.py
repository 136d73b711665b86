"""Plain averaging: exact means give exact attitudes, the forms differ as derived, bad data are refused."""

import numpy as np
import pytest

from truenorth.errors import ConfigError, NoSolutionError
from truenorth.northfinding import Site
from truenorth.northfinding.budget import heading_sd_on_circle
from truenorth.northfinding.static import align_static, direct_matrix, two_vector_attitude
from truenorth.rotations import heading_pitch_roll, rot_ned_from_body
from truenorth.sensors import ImuDescription
from truenorth.strapdown import InertialIncrements

SITE = Site(np.radians(39.0 + 55.0 / 60.0), 0.57, 900.0)
DPH = np.radians(1.0 / 3600.0)


def still(rot, seconds=60.0, rate_hz=10.0, noise=(0.0, 0.0), bias=(0.0, 0.0), seed=1, site=SITE):
    """Increments of a body at rest; noise as densities."""
    n, step_s = round(seconds * rate_hz), 1.0 / rate_hz
    rng = np.random.default_rng(seed)
    angle, velocity = (
        (truth @ rot + offset) * step_s + density * np.sqrt(step_s) * rng.standard_normal((n, 3))
        for truth, offset, density in zip(
            (site.earth_rate_ned_radps, site.force_ned_mps2), bias, noise, strict=True
        )
    )
    return InertialIncrements(100.0 + step_s * np.arange(n + 1), angle, velocity)


@pytest.mark.parametrize("form", ["orthonormal", "published"])
@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (-90.0, 0.0, -90.0), (211.0, 30.0, 140.0)])
@pytest.mark.parametrize("latitude", [-70.0, 0.0, 39.9, 88.0])
def test_exact_means_give_the_attitude(form, angles, latitude):
    site, rot = Site(np.radians(latitude)), rot_ned_from_body(*np.radians(angles))
    found = align_static(still(rot, site=site), site, form=form)
    np.testing.assert_allclose(found.rot_ned_from_body, rot, atol=1e-10)
    assert found.measured["gravity_mps2"] == pytest.approx(site.gravity_mps2)
    assert found.measured["earth_rate_dph"] == pytest.approx(15.041067, abs=1e-5)
    assert found.measured["latitude_deg"] == pytest.approx(latitude, abs=1e-7)
    assert found.time_s == pytest.approx(160.0)
    assert found.duration_s == pytest.approx(60.0)
    if form == "published":
        assert found.measured["non_orthonormality"] < 1e-9
        assert found.measured["published_heading_deg"] == pytest.approx(angles[0] % 360.0, abs=1e-7)
        assert found.measured["published_pitch_deg"] == pytest.approx(angles[1], abs=1e-7)
        assert found.measured["published_roll_deg"] == pytest.approx(angles[2], abs=1e-7)


def test_direct_matrix_with_the_printed_third_column_is_singular_at_the_equator():
    force, rate = SITE.force_ned_mps2, SITE.earth_rate_ned_radps
    np.testing.assert_allclose(direct_matrix(force, rate, SITE), np.eye(3), atol=1e-12)
    at_equator, elsewhere = (
        np.stack([site.force_ned_mps2, 1e5 * site.earth_rate_ned_radps, [0.0, np.sin(latitude), 0.0]])
        for latitude, site in ((0.0, Site(0.0)), (0.3, Site(0.3)))
    )
    assert np.linalg.matrix_rank(at_equator) == 2
    assert np.linalg.matrix_rank(elsewhere) == 3


@pytest.mark.parametrize("heading", [0.0, 45.0, 100.0, 200.0, 300.0])
def test_published_azimuth_also_feels_a_vertical_accelerometer_error(heading):
    rot, off = rot_ned_from_body(np.radians(heading), 0.0, 0.0), 1e-3
    means = still(rot, bias=(np.zeros(3), np.array([0.0, 0.0, off])))
    exact = align_static(means, SITE)
    direct = align_static(means, SITE, form="published")
    assert np.degrees(exact.heading_rad) == pytest.approx(heading, abs=1e-8)
    expected = -off / SITE.gravity_mps2 * np.sin(np.radians(heading)) * np.cos(np.radians(heading))
    error = (direct.measured["published_heading_deg"] - heading + 180.0) % 360.0 - 180.0
    assert np.radians(error) == pytest.approx(expected, abs=1e-8)
    # The matrix in north, east, down: -off / g on the diagonal of east and down, and tan(latitude) of it
    # between north and down.
    size = off / SITE.gravity_mps2 * np.sqrt(8.0 + 2.0 * np.tan(SITE.latitude_rad) ** 2)
    assert direct.measured["non_orthonormality"] == pytest.approx(size, rel=1e-3)


def test_the_running_estimate_is_that_of_the_record_up_to_then():
    unit = ImuDescription(grade="tactical")
    whole = still(rot_ned_from_body(1.0, 0.1, 0.2), noise=(1e-5, 1e-3))
    cut = InertialIncrements(whole.time_s[:301], whole.angle_rad[:300], whole.velocity_mps[:300])
    for errors in (None, unit):
        found, part = align_static(whole, SITE, errors=errors), align_static(cut, SITE, errors=errors)
        assert len(found.run.time_s) == 60
        np.testing.assert_allclose(found.run.time_s, 101.0 + np.arange(60))
        np.testing.assert_allclose(found.run.angles_rad[29], part.angles_rad)
        np.testing.assert_allclose(found.run.angles_rad[-1], found.angles_rad)
        np.testing.assert_allclose(found.run.sd_rad[-1], found.angle_sd_rad)
        # The sensitivities are those at the last attitude, a degree or so apart.
        np.testing.assert_allclose(found.run.sd_rad[29], part.angle_sd_rad, rtol=0.2)
    assert align_static(whole, SITE, running=False).run is None


def test_short_and_odd_records_keep_a_running_estimate():
    found = align_static(still(np.eye(3), seconds=2.05, rate_hz=20.0), SITE)
    assert len(found.run.time_s) == 20
    assert found.run.time_s[-1] == pytest.approx(102.05)
    odd = align_static(still(np.eye(3), seconds=60.5), SITE)
    assert len(odd.run.time_s) == 61
    assert odd.run.time_s[-1] == pytest.approx(160.5)
    one = InertialIncrements(np.array([0.0, 300.0]), SITE.earth_rate_ned_radps[None] * 300.0,
                             SITE.force_ned_mps2[None] * 300.0)  # fmt: skip
    single = align_static(one, SITE)
    assert np.sin(single.heading_rad) == pytest.approx(0.0, abs=1e-9)
    assert np.isnan(single.angle_sd_rad).all()
    assert any("not known" in note for note in single.notes)


def test_without_stated_errors_sigma_covers_the_noise_seen_and_says_so():
    density = np.radians(0.05) / 60.0
    found = align_static(still(np.eye(3), seconds=400.0, noise=(density, 1e-3)), SITE)
    predicted = density / np.sqrt(400.0) / SITE.horizontal_rate_radps
    # 400 seconds show their scatter to 3.5 per cent; five of these.
    assert found.angle_sd_rad[0] == pytest.approx(predicted, rel=0.18)
    assert found.budget is None
    assert "only the noise" in found.notes[0]


def test_with_stated_errors_there_is_a_budget_and_the_heading_stays_on_the_circle():
    poor = align_static(still(np.eye(3)), SITE, errors=ImuDescription(grade="consumer"))
    assert poor.budget.lines[0].source == "gyro bias"
    assert poor.angle_sd_rad[0] == pytest.approx(
        float(heading_sd_on_circle(poor.budget.angle_sd_rad()[0])), rel=1e-9
    )
    assert poor.angle_sd_rad[0] < np.pi / np.sqrt(3.0) + 1e-9
    assert not poor.notes


def test_vectors_are_aligned_many_at_a_time():
    rot = rot_ned_from_body(*np.random.default_rng(2).uniform(-1.5, 1.5, (3, 7)))
    force, rate = (np.einsum("i,nij->nj", v, rot) for v in (SITE.force_ned_mps2, SITE.earth_rate_ned_radps))
    np.testing.assert_allclose(two_vector_attitude(force, rate), rot, atol=1e-12)
    assert np.isnan(two_vector_attitude(force[0], force[0])).any()
    assert np.allclose(heading_pitch_roll(direct_matrix(force, rate, SITE)), heading_pitch_roll(rot))


def test_what_cannot_be_aligned_is_refused_in_one_sentence():
    good = still(np.eye(3))
    n = len(good.angle_rad)
    zeros, holes = np.zeros((n, 3)), np.full((n, 3), np.nan)
    vertical = np.tile([0.0, 0.0, -1e-6], (n, 1))
    for angle, velocity, what in (
        (zeros, good.velocity_mps, "gyros say zero"),
        (good.angle_rad, zeros, "accelerometers say zero"),
        (holes, good.velocity_mps, "no numbers"),
        (vertical, np.tile([0.0, 0.0, -0.98], (n, 1)), "no north"),
    ):
        with pytest.raises(NoSolutionError, match=what):
            align_static(InertialIncrements(good.time_s, angle, velocity), SITE)
    for time in (np.zeros(0), np.zeros(1)):
        with pytest.raises(NoSolutionError, match="no samples"):
            align_static(InertialIncrements(time, np.zeros((0, 3)), np.zeros((0, 3))), SITE)
    with pytest.raises(ConfigError, match="form"):
        align_static(good, SITE, form="best")
