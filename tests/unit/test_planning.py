"""Plans of arrays: against double differences written out, against the tests of single phases, and by law."""

import numpy as np
import pytest

from truenorth.ambiguity.success_rate import success_rates
from truenorth.attitude.reliability import phase_reliability
from truenorth.attitude.vectors import angle_covariance
from truenorth.errors import ConfigError, NoSolutionError
from truenorth.planning import (
    PlanSettings,
    box_points,
    place_antenna,
    plan_array,
    plan_settings,
    requirement,
    white_noise,
)
from truenorth.rotations import rot_ned_from_body, skew

ARRAY = ((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (1.0, 1.2, -0.4), (0.3, -1.0, 0.1))
GRAZ = {"latitude_deg": 47.07, "longitude_deg": 15.44, "height_m": 400.0, "start": "2024-06-24"}


def _plan(antennas=ARRAY, **changes):
    given = {**GRAZ, "hours": 2.0, "step_s": 3600.0, "systems": "GE", "bands": ("L1", "L2"), **changes}
    return plan_array(antennas=antennas, **given)


def _double_differences(plan, epoch):
    """All double differences of an epoch against the first antenna and the group's first satellite."""
    rows = plan.array_epoch(epoch)
    k = rows.n_antennas
    jump = []
    for group in np.unique(rows.group):
        signals = np.unique(rows.satellite[rows.group == group])
        for antenna in range(1, k):
            for signal in signals[1:]:
                line = np.zeros(len(rows.antenna))
                for a, s, sign in (
                    (antenna, signal, 1), (0, signal, -1), (antenna, signals[0], -1), (0, signals[0], 1)
                ):  # fmt: skip
                    line[(rows.antenna == a) & (rows.satellite == s)] = sign
                jump.append(line)
    return rows, np.array(jump)


@pytest.mark.parametrize("position_sd_m", [0.0, 0.002])
def test_covariance_is_that_of_all_double_differences(position_sd_m):
    plan = _plan(heading_deg=30.0, pitch_deg=5.0, roll_deg=-7.0, position_sd_m=position_sd_m)
    rot = rot_ned_from_body(*plan.angles_rad)
    for epoch in range(plan.n_epochs):
        rows, jump = _double_differences(plan, epoch)
        h = rows.design_ned
        cov = np.diag(rows.phase_variance_m2)
        cov = cov + position_sd_m**2 * (rows.antenna[:, None] == rows.antenna) * (h @ h.T)
        turned = rows.positions_body_m @ rot.T
        design = np.einsum("ri,rij->rj", h, -skew(turned[rows.antenna]))
        a = jump @ design
        normal = a.T @ np.linalg.solve(jump @ cov @ jump.T, a)
        expected = angle_covariance(rot[None], np.linalg.inv(normal)[None])[0]
        np.testing.assert_allclose(plan.cov_rad2[epoch], expected, rtol=1e-8)


@pytest.mark.parametrize("position_sd_m", [0.0, 0.002])
def test_blunders_are_those_of_the_phases_one_by_one(position_sd_m):
    plan = _plan(heading_deg=200.0, pitch_deg=-3.0, roll_deg=4.0, position_sd_m=position_sd_m)
    for epoch in range(plan.n_epochs):
        found = phase_reliability(plan.array_epoch(epoch), rot_ned_from_body(*plan.angles_rad))
        assert plan.reliability.mdb_m[epoch] == pytest.approx(np.nanmax(found.mdb_m), rel=1e-8)
        assert plan.reliability.mdb_cyc[epoch] == pytest.approx(np.nanmax(found.mdb_cyc), rel=1e-8)
        np.testing.assert_allclose(
            plan.reliability.external_rad[epoch], np.nanmax(found.external_rad, axis=0), rtol=1e-8
        )
        np.testing.assert_allclose(plan.sd_rad[epoch], found.sd_rad, rtol=1e-8)


def test_success_is_that_of_the_float_ambiguities_written_out():
    plan = _plan(ARRAY[:2], systems="G", bands=("L1",), stochastic=white_noise(0.003, 0.3))
    view = plan.view
    for epoch in range(plan.n_epochs):
        e = view.line_of_sight_ned[view.rows(epoch)]
        m = len(e) - 1
        d = np.hstack([-np.ones((m, 1)), np.eye(m)])
        # Unknowns: baseline and ambiguities in metres; observations: codes, phases.
        design = np.block([[d @ e, np.zeros((m, m))], [d @ e, np.eye(m)]])
        weight = np.linalg.inv(2.0 * d @ d.T)
        zero = np.zeros((m, m))
        normal = design.T @ np.block([[weight / 0.3**2, zero], [zero, weight / 0.003**2]]) @ design
        cov_cyc2 = np.linalg.inv(normal)[3:, 3:] / view.wavelength_m[0] ** 2
        rates = success_rates(cov_cyc2)
        assert plan.success[epoch] == pytest.approx(rates.bootstrapped, rel=1e-6)
        assert plan.adop_cyc[epoch] == pytest.approx(rates.adop_cyc, rel=1e-6)
        assert plan.n_integers[epoch] == m


@pytest.mark.parametrize(("heading_deg", "pitch_deg"), [(0.0, 0.0), (70.0, 20.0)])
def test_two_antennas_against_the_azimuth_and_elevation_dop(heading_deg, pitch_deg):
    sd_m, length_m = 0.003, 1.5
    plan = _plan(
        ((0.0, 0.0, 0.0), (length_m, 0.0, 0.0)), bands=("L1",), systems="G", heading_deg=heading_deg,
        pitch_deg=pitch_deg, stochastic=white_noise(sd_m, 0.3),
    )  # fmt: skip
    heading, pitch = np.radians([heading_deg, pitch_deg])
    unit = np.array([np.cos(pitch) * np.cos(heading), np.cos(pitch) * np.sin(heading), -np.sin(pitch)])
    azimuth = np.array([-np.sin(heading), np.cos(heading), 0.0])
    elevation = np.cross(unit, azimuth)
    cov_m2 = 2.0 * np.linalg.inv(plan.information)
    for value, axis, lever_m in (
        (plan.azimuth_dop, azimuth, length_m * np.cos(pitch)),
        (plan.elevation_dop, elevation, length_m),
    ):
        free_rad = np.sqrt(np.einsum("i,nij,j->n", axis, cov_m2, axis)) / lever_m
        np.testing.assert_allclose(free_rad, value * sd_m / length_m, rtol=1e-9)
    # The plan knows the length, which the dilutions do not: what it says is the direction given the length.
    tangent = np.stack([azimuth * length_m * np.cos(pitch), elevation * length_m], axis=1)
    cov_rad2 = np.linalg.inv(tangent.T @ (0.5 * plan.information) @ tangent)
    np.testing.assert_allclose(plan.sd_rad[:, :2], np.sqrt(np.einsum("nii->ni", cov_rad2)), rtol=1e-9)
    assert np.all(plan.sd_rad[:, 0] <= plan.azimuth_dop * sd_m / length_m * (1.0 + 1e-12))


def test_what_the_antennas_do_not_observe_is_nan_and_said():
    ahead = _plan(((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    assert np.isnan(ahead.sd_rad[:, 2]).all()
    assert np.isfinite(ahead.sd_rad[:, :2]).all()
    assert "roll: these antennas do not observe it" in str(ahead)
    across = _plan(((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 2.0, 0.0)))
    assert np.isnan(across.sd_rad[:, 1]).all()
    assert np.isfinite(across.sd_rad[:, [0, 2]]).all()
    slanted = _plan(((0.0, 0.0, 0.0), (1.0, 1.0, 0.0)))
    assert np.isnan(slanted.sd_rad[:, 1:]).all()
    assert np.isfinite(slanted.sd_rad[:, 0]).all()


def test_errors_fall_with_size_and_rise_with_noise():
    plan = _plan(stochastic=white_noise(0.002, 0.3))
    twice = _plan(
        tuple(tuple(2.0 * value for value in point) for point in ARRAY), stochastic=white_noise(0.002, 0.3)
    )
    np.testing.assert_allclose(twice.sd_rad, plan.sd_rad / 2.0, rtol=1e-9)
    louder = _plan(stochastic=white_noise(0.006, 0.3))
    np.testing.assert_allclose(louder.sd_rad, 3.0 * plan.sd_rad, rtol=1e-9)
    np.testing.assert_allclose(louder.reliability.mdb_m, 3.0 * plan.reliability.mdb_m, rtol=1e-9)


def test_masks_and_systems_take_satellites_away():
    open_sky = _plan()
    skyline = _plan(visibility={"horizon_deg": [[0.0, 50.0], [179.0, 50.0], [180.0, 0.0], [359.0, 0.0]]})
    azimuth = np.degrees(skyline.view.azimuth_rad)
    elevation = np.degrees(skyline.view.elevation_rad)
    assert not np.any((azimuth > 1.0) & (azimuth < 178.0) & (elevation < 49.9))
    assert np.all(skyline.n_satellites < open_sky.n_satellites)
    assert np.all(skyline.sd_rad > open_sky.sd_rad)
    assert np.all(_plan(elevation_mask_deg=40.0).n_satellites < open_sky.n_satellites)
    gps = _plan(systems="G")
    assert set(gps.view.groups) == {"G L1", "G L2"}
    assert np.all(gps.n_satellites < open_sky.n_satellites)
    # A mast before the antennas turns with them.
    mast = {"body_masks": [{"azimuth_deg": [-60.0, 60.0]}]}
    for heading_deg in (0.0, 180.0):
        masked = _plan(visibility=mast, heading_deg=heading_deg)
        off = (np.degrees(masked.view.azimuth_rad) - heading_deg + 180.0) % 360.0 - 180.0
        assert np.abs(off).min() > 60.0


def test_phases_of_glonass_count_only_where_calibrated():
    float_ = _plan(systems="GR")
    np.testing.assert_allclose(float_.sd_rad, _plan(systems="G").sd_rad, rtol=1e-12)
    calibrated = _plan(systems="GR", glonass_ambiguities="calibrated")
    assert np.all(calibrated.sd_rad < float_.sd_rad)
    # Its codes help to resolve all the same.
    assert np.all(float_.success >= _plan(systems="G").success)


def test_a_scenario_says_place_day_array_and_what_stands_in_the_way():
    settings = plan_settings("landfahrer-update-rate", hours=0.0)
    assert settings.latitude_deg == 46.885
    assert settings.start == "2009-05-20T10:00:00"
    assert settings.antenna_names == ("javad", "dlv3")
    free = plan_array(settings)
    village = plan_array("landfahrer-update-rate", hours=0.0, along_m=2600.0)
    assert village.n_satellites[0] < free.n_satellites[0]
    with pytest.raises(NoSolutionError, match="no satellite of GR is in view"):
        plan_array("landfahrer-update-rate", hours=0.0, along_m=3305.0)  # in the underpass


def test_a_session_gives_its_array_and_its_settings(tmp_path):
    (tmp_path / "session.toml").write_text(
        '[gnss]\nsystems = "G"\nbands = ["L1"]\nelevation_mask_deg = 12.0\nlength_m = 1.25\n'
        '[[platform.antennas]]\nname = "aft"\nobservations = "a.obs"\n'
        '[[platform.antennas]]\nname = "fore"\nobservations = "b.obs"\n'
    )
    for name in ("a.obs", "b.obs"):
        (tmp_path / name).touch()
    settings = plan_settings(tmp_path / "session.toml", **GRAZ)
    assert settings.antennas == ((0.0, 0.0, 0.0), (1.25, 0.0, 0.0))
    assert (settings.systems, settings.bands, settings.elevation_mask_deg) == ("G", ("L1",), 12.0)
    assert settings.position_sd_m == 0.0  # two antennas have a length, and no coordinates
    (tmp_path / "array.toml").write_text(
        "[array]\nposition_sd_m = 0.004\n"
        + "".join(
            f'[[platform.antennas]]\nname = "n{k}"\nobservations = "a.obs"\nposition_body_m = {point}\n'
            for k, point in enumerate(([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
        )
    )
    assert plan_settings(tmp_path / "array.toml", **GRAZ).position_sd_m == 0.004


def test_a_real_sky_is_taken_from_files(tmp_path):
    from truenorth.simulation import write_simulation

    scenario = {
        "name": "sky", "duration_s": 1.0, "start": "2024-06-24T00:00:00",
        "sky": {"kind": "nominal", "systems": "G"},
        "place": {"latitude_deg": 47.07, "longitude_deg": 15.44, "height_m": 400.0},
        "platform": {"antennas": [{"name": "a", "position_body_m": [0.0, 0.0, 0.0]}]},
    }  # fmt: skip
    files = write_simulation(scenario, tmp_path).navigation
    real = _plan(systems="G", navigation=files, hours=0.0)
    nominal = _plan(systems="G", hours=0.0, sky={"kind": "nominal", "systems": "G"})
    # The file holds the broadcast of the same constellation; its rounding is a matter of millimetres.
    np.testing.assert_allclose(real.sd_rad, nominal.sd_rad, rtol=1e-6)
    # Another day: the file is moved by whole days, and the sky with it.
    later = _plan(systems="G", navigation=files, hours=0.0, start="2024-06-26")
    np.testing.assert_allclose(later.sd_rad, real.sd_rad, rtol=1e-3)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"latitude_deg": 91.0}, "`latitude_deg` is 91.0"),
        ({"start": "whenever"}, "a date such as 2024-06-24"),
        ({"start": "1970-01-01"}, "a date from 1980"),
        ({"antennas": [(0, 0, 0)]}, "holds 1"),
        ({"antennas": [(0, 0, 0), (0, 0, 0.001)]}, "each its own place"),
        ({"antennas": [(0, 0, 0), (0, 0, float("nan"))]}, "coordinates in metres"),
        ({"hours": -1.0}, "0 to 168"),
        ({"hours": 100.0, "step_s": 1.0}, "longer step"),
        ({"systems": "X"}, "letters among"),
        ({"bands": ("L9",)}, "names among"),
        ({"pitch_deg": 90.0}, "where heading and roll exist"),
        ({"names": ("one",)}, "4 names"),
    ],
)
def test_impossible_settings_are_refused_in_a_sentence(changes, said):
    with pytest.raises(ConfigError, match=said):
        _plan(**changes)


def test_without_satellites_or_array_there_is_no_plan():
    with pytest.raises(NoSolutionError, match="lower the mask"):
        _plan(elevation_mask_deg=89.9)
    with pytest.raises(ConfigError, match="no array is given"):
        plan_array(**GRAZ)
    with pytest.raises(ConfigError, match="`latitude_deg` is missing"):
        plan_array(antennas=ARRAY, longitude_deg=15.0, start="2024-06-24")


def test_epochs_with_too_few_satellites_are_nan_and_counted():
    plan = _plan(systems="G", elevation_mask_deg=55.0, hours=6.0, step_s=1800.0)
    poor = plan.n_satellites < 4
    assert poor.any()
    assert np.isnan(plan.sd_rad[poor]).all()
    assert np.all(plan.success[poor] == 0.0)
    assert "too few satellites" in str(plan)


def test_a_requirement_is_met_by_what_it_demands():
    for angle, k in (("heading", 0), ("pitch", 1), ("roll", 2)):
        plan = _plan(hours=4.0)
        found = requirement(plan, angle, 0.05, at="worst")
        assert found.reached_deg == pytest.approx(np.degrees(plan.sd_rad[:, k].max()))
        enlarged = _plan(tuple(tuple(found.scale * value for value in point) for point in ARRAY), hours=4.0)
        assert np.degrees(enlarged.sd_rad[:, k].max()) == pytest.approx(0.05)
        noise = plan.settings.stochastic
        quiet = {
            key: getattr(noise, key) * found.noise_factor for key in ("phase_sd_m", "phase_elevation_sd_m")
        }
        assert np.degrees(_plan(hours=4.0, stochastic=quiet).sd_rad[:, k].max()) == pytest.approx(0.05)
        assert str(found).count("\n") == 2


def test_a_requirement_knows_when_body_coordinates_forbid_it():
    plan = _plan(position_sd_m=0.01)
    found = requirement(plan, "heading", 0.05, at="median")
    assert np.isnan(found.noise_factor)
    assert "body coordinates are too uncertain" in str(found)
    easier = requirement(_plan(position_sd_m=0.001), "heading", 0.1, at="worst")
    noise = _plan().settings.stochastic
    quiet = {key: getattr(noise, key) * easier.noise_factor for key in ("phase_sd_m", "phase_elevation_sd_m")}
    met = _plan(position_sd_m=0.001, stochastic=quiet)
    assert np.degrees(met.sd_rad[:, 0].max()) == pytest.approx(0.1, rel=1e-6)


def test_a_requirement_refuses_what_cannot_be():
    plan = _plan(ARRAY[:2])
    with pytest.raises(NoSolutionError, match="its antennas do not observe it"):
        requirement(plan, "roll", 0.1)
    with pytest.raises(ConfigError, match="`angle`"):
        requirement(plan, "yaw", 0.1)
    with pytest.raises(ConfigError, match="positive angle"):
        requirement(plan, "heading", 0.0)
    with pytest.raises(ConfigError, match="median, p95, worst"):
        requirement(plan, "heading", 0.1, at="best")


def test_the_best_place_is_that_of_the_plan_with_it():
    plan = _plan((*ARRAY[:2], (1.0, 1.2, 0.0)))
    points = box_points((0.0, -1.0, -0.8), (2.0, 1.0, 0.0), 1.0)
    assert len(points) == 3 * 3 * 2
    found = place_antenna(plan, points, criterion="roll", at="median")
    for rank in (0, len(found.value_deg) - 1):
        point = tuple(found.point_body_m[rank].tolist())
        with_it = _plan((*plan.settings.antennas, point))
        assert np.median(np.degrees(with_it.sd_rad[:, 2])) == pytest.approx(found.value_deg[rank])
    assert np.all(np.diff(found.value_deg) >= 0.0)
    assert not np.any(np.linalg.norm(found.point_body_m, axis=1) < 0.1)  # an antenna stands there


def test_an_antenna_above_the_plane_gains_what_none_in_it_can():
    plan = _plan((*ARRAY[:2], (1.0, 1.2, 0.0)))
    found = place_antenna(plan, box_points((0.0, -1.2, -1.0), (2.0, 1.2, 0.0), 0.4), criterion="pitch")
    best_in_plane = found.value_deg[found.is_in_plane].min()
    assert found.best_body_m[2] < 0.0
    assert found.value_deg[0] < 0.8 * best_in_plane
    assert "off plane" in str(found)


def test_a_place_makes_roll_observable():
    plan = _plan(ARRAY[:2])
    found = place_antenna(plan, [(1.0, 1.0, 0.0), (3.0, 0.0, 0.0)], criterion="roll")
    assert found.best_body_m.tolist() == [1.0, 1.0, 0.0]
    assert np.isnan(found.value_deg[1])
    assert "roll become observable" in str(found)
    with pytest.raises(NoSolutionError, match="is it observed"):
        place_antenna(plan, [(3.0, 0.0, 0.0)], criterion="roll")
    with pytest.raises(ConfigError, match="no candidate"):
        place_antenna(plan, [(0.0, 0.0, 0.01)])
    with pytest.raises(ConfigError, match="coarser grid"):
        box_points((0, 0, 0), (10, 10, 10), 0.01)
    with pytest.raises(ConfigError, match="lower corner first"):
        box_points((1, 0, 0), (0, 1, 1), 0.1)


def test_settings_are_the_same_with_and_without_defaults():
    plan = _plan()
    assert isinstance(plan.settings, PlanSettings)
    again = plan_array(plan.settings)
    np.testing.assert_array_equal(again.cov_rad2, plan.cov_rad2)
    turned = plan_array(plan.settings, heading_deg=90.0)
    assert turned.settings.heading_deg == 90.0
    assert not np.array_equal(turned.cov_rad2, plan.cov_rad2)
