"""Horizon, masks, obstructions, outages: hand cases, and the same answer however the run is cut."""

from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from truenorth.config import convert_settings
from truenorth.errors import ConfigError
from truenorth.frames import ecef_from_geodetic
from truenorth.observations import sat_id
from truenorth.simulation.obstructions import Obstruction, shadowing
from truenorth.simulation.visibility import BodyMask, Outage, Visibility, VisibilitySection

G05 = sat_id("G05")


class Straight:
    """Eastward at 10 m/s from latitude 45 degrees; laps of 1000 m."""

    lap_m = 1000.0

    def at(self, time_s):
        position = ecef_from_geodetic(np.radians(45.0), 0.3, 100.0)
        return SimpleNamespace(position_ecef_m=np.broadcast_to(position, (len(time_s), 3)))

    def distance_m(self, time_s):
        return 10.0 * np.asarray(time_s)

    def course_rad(self, time_s):
        return np.full(len(time_s), 0.5 * np.pi)


def loss_db(section, time_s=0.0, azimuth=0.0, elevation=45.0, *, body=None, sat=G05, seed=1, trajectory=None):
    """Attenuation of rays given in degrees; on a level platform that points north unless `body` says else."""
    time_s, azimuth, elevation, sat = np.broadcast_arrays(time_s, azimuth, elevation, sat)
    body_azimuth, body_elevation = (azimuth, elevation) if body is None else body
    visibility = Visibility(section, trajectory or Straight(), seed)
    angles = (
        np.radians(np.broadcast_to(x, time_s.shape)).ravel()
        for x in (azimuth, elevation, body_azimuth, body_elevation)
    )
    return visibility.attenuation_db(time_s.ravel().astype(float), sat.ravel(), *angles)


def obstructed(**values):
    return VisibilitySection(elevation_mask_deg=-90.0, obstructions=(Obstruction(**values),))


def test_the_mask_blocks_what_is_lower():
    section = VisibilitySection(elevation_mask_deg=15.0)
    assert loss_db(section, elevation=[14.9, 15.1, 90.0]).tolist() == [np.inf, 0.0, 0.0]
    assert loss_db(VisibilitySection(), elevation=[-0.1, 0.1]).tolist() == [np.inf, 0.0]


def test_the_second_criterion_turns_with_the_platform():
    """A platform rolled by 60 degrees to the right loses what stands low on its left."""
    section = VisibilitySection(antenna_mask_deg=0.0)
    # Elevation above the deck of satellites 20 degrees high: to the left it is 20 - 60, to the right 80.
    assert loss_db(section, elevation=[20.0] * 2, body=([270.0, 90.0], [-40.0, 80.0])).tolist() == [
        np.inf,
        0.0,
    ]
    assert loss_db(VisibilitySection(), elevation=20.0, body=(270.0, -40.0)).tolist() == [0.0]


def test_up_from_the_centre_of_the_earth_leans_to_the_equator():
    """At 45 degrees by 0.1924 degrees: a satellite 0.1 degrees above the southern horizon gains that much."""
    geocentric = VisibilitySection(up="geocentric")
    azimuths, elevations = [0.0, 0.0, 180.0, 180.0, 90.0], [0.19, 0.195, -0.19, -0.195, 0.001]
    assert loss_db(geocentric, 0.0, azimuths, elevations).tolist() == [np.inf, 0.0, 0.0, np.inf, 0.0]


def test_a_skyline_is_joined_by_lines_and_closed_over_north():
    section = VisibilitySection(horizon_deg=((90.0, 0.0), (270.0, 20.0), (350.0, 30.0)))
    # Half way from 90 to 270: 10; from 350 over north to 90 the line falls by 0.3 degrees a degree.
    azimuths = [180.0, 180.0, 20.0, 20.0, 350.0]
    assert loss_db(section, 0.0, azimuths, [9.9, 10.1, 20.9, 21.1, 29.9]).tolist() == [
        np.inf, 0.0, np.inf, 0.0, np.inf,
    ]  # fmt: skip


def test_masks_of_the_platform_count_from_its_axes():
    mast = BodyMask(azimuth_deg=(170.0, 190.0), elevation_deg=(-90.0, 60.0))
    cabin = BodyMask(azimuth_deg=(350.0, 10.0), elevation_deg=(-90.0, 30.0), attenuation_db=6.0)
    section = VisibilitySection(body_masks=(mast, cabin))
    body = ([180.0, 180.0, 169.0, 0.0, 355.0, 11.0], [59.0, 61.0, 59.0, 29.0, 29.0, 29.0])
    assert loss_db(section, np.zeros(6), body=body).tolist() == [np.inf, 0.0, 0.0, 6.0, 6.0, 0.0]


def test_a_range_of_azimuth_may_be_the_whole_turn():
    assert loss_db(VisibilitySection(body_masks=(BodyMask(),)), azimuth=[0.0, 200.0]).tolist() == [np.inf] * 2


def test_an_underpass_takes_everything_on_its_stretch_in_every_lap():
    section = obstructed(kind="underpass", start_m=100.0, end_m=120.0, every_lap=True)
    times = np.array([9.9, 10.0, 11.9, 12.0, 110.5, 312.0])
    assert np.isinf(loss_db(section, times, elevation=90.0)).tolist() == [
        False,
        True,
        True,
        False,
        True,
        False,
    ]
    once = obstructed(kind="underpass", start_m=100.0, end_m=120.0)
    assert np.isinf(loss_db(once, times, elevation=90.0)).tolist() == [False, True, True] + [False] * 3
    over_the_end = obstructed(kind="underpass", start_m=990.0, end_m=1010.0, lap_m=1000.0)
    assert np.isinf(loss_db(over_the_end, [0.5, 1.5, 99.5, 199.5])).tolist() == [True, False, True, True]


def test_a_building_rises_beside_the_road():
    """Eastward: the right side is south. 10 m at 8 m: 51.3 degrees abeam, less along it."""
    section = obstructed(kind="building", start_s=0.0, end_s=100.0)
    abeam = np.degrees(np.arctan(10.0 / 8.0))
    oblique = np.degrees(np.arctan(10.0 / 8.0 * np.sin(np.radians(30.0))))
    azimuths = [180.0, 180.0, 0.0, 120.0, 120.0]
    elevations = [abeam - 0.1, abeam + 0.1, 10.0, oblique - 0.1, oblique + 0.1]
    assert np.isinf(loss_db(section, 1.0, azimuths, elevations)).tolist() == [True, False, False, True, False]
    left = obstructed(kind="building", side="left")
    assert np.isinf(loss_db(left, 1.0, azimuths, elevations)).tolist() == [False, False, True, False, False]
    both = obstructed(kind="building", side="both")
    assert np.isinf(loss_db(both, 1.0, [0.0, 180.0, 90.0], 20.0)).tolist() == [True, True, False]


def test_azimuths_may_count_from_the_course():
    ahead = obstructed(kind="custom", azimuth_deg=(-10.0, 10.0), azimuth_from="course", attenuation_db=3.0)
    assert loss_db(ahead, 0.0, [81.0, 99.0, 79.0, 0.0]).tolist() == [3.0, 3.0, 0.0, 0.0]
    world = obstructed(
        kind="custom", azimuth_deg=(-10.0, 10.0), elevation_deg=(0.0, 40.0), attenuation_db=3.0
    )
    assert loss_db(world, 0.0, [359.0, 9.0, 9.0, 90.0], [20.0, 20.0, 41.0, 20.0]).tolist() == [3.0, 3.0, 0, 0]


def test_attenuations_add_up():
    section = VisibilitySection(
        obstructions=(
            Obstruction(kind="custom", attenuation_db=3.0),
            Obstruction(kind="custom", attenuation_db=4.0),
        ),
        body_masks=(BodyMask(attenuation_db=2.0),),
    )
    assert loss_db(section).tolist() == [9.0]


def test_outages_once_and_on_and_off():
    once = VisibilitySection(outages=(Outage(start_s=100.0, duration_s=50.0),))
    assert np.isinf(loss_db(once, [99.9, 100.0, 149.9, 150.0])).tolist() == [False, True, True, False]
    # Harvey (1998): 200 s off, 200 s on, again and again.
    periodic = VisibilitySection(outages=(Outage(start_s=200.0, duration_s=200.0, period_s=400.0),))
    times = np.array([0.0, 199.0, 200.0, 399.0, 400.0, 600.0, 1000.0, 1200.0])
    expected = [False, False, True, True, False, True, True, False]
    assert np.isinf(loss_db(periodic, times)).tolist() == expected
    glonass = VisibilitySection(outages=(Outage(start_s=0.0, systems="R"),))
    assert np.isinf(loss_db(glonass, 5.0, sat=[G05, sat_id("R05")])).tolist() == [False, True]


@pytest.mark.parametrize("where", [{"start_m": 0.0, "end_m": 5000.0}, {"start_s": 0.0, "end_s": 500.0}])
def test_fading_is_the_same_in_any_blocks_and_differs_between_satellites_and_seeds(where):
    section = obstructed(kind="forest", **where)
    times = np.linspace(0.0, 400.0, 4001)
    whole = loss_db(section, times)
    pieces = np.concatenate([loss_db(section, part) for part in np.array_split(times, 7)])
    np.testing.assert_array_equal(whole, pieces)
    np.testing.assert_array_equal(loss_db(section, times[::-1])[::-1], whole)
    for other in (loss_db(section, times, sat=sat_id("E05")), loss_db(section, times, seed=2)):
        # Independent fading: the differences scatter by sqrt(2) times its standard deviation.
        assert 6.0 < np.std(other - whole) < 14.0


def test_trees_of_every_lap_fade_alike():
    section = obstructed(kind="tree", start_m=200.0, end_m=260.0, every_lap=True)
    times = np.linspace(20.0, 25.9, 60)
    first = loss_db(section, times, azimuth=180.0, elevation=20.0)
    np.testing.assert_allclose(
        loss_db(section, times + 300.0, azimuth=180.0, elevation=20.0), first, atol=1e-6
    )
    assert np.all(first >= 0.0)
    assert np.ptp(first) > 1.0


def test_shadowing_has_unit_variance_and_the_correlation_length():
    """20000 lengths: mean, variance and correlations are known to about 0.01 (one sigma)."""
    step = 0.125
    values = shadowing(np.full(160_000, 12345, dtype=np.uint64), 7.0 * step * np.arange(160_000), 7.0)
    assert abs(np.mean(values)) < 0.06
    assert abs(np.var(values) - 1.0) < 0.08
    assert abs(np.mean(values[:-8] * values[8:]) - np.exp(-1.0)) < 0.05
    assert abs(np.mean(values[:-20] * values[20:])) < 0.05
    assert np.max(np.abs(np.diff(values))) < 1.5


def test_nothing_is_asked_of_the_trajectory_without_need():
    section = VisibilitySection(
        horizon_deg=((0.0, 5.0),), obstructions=(Obstruction(kind="forest", start_s=0.0),)
    )
    visibility = Visibility(section, None, 1)
    assert visibility.attenuation_db(np.zeros(1), np.array([5]), *np.full((4, 1), 0.5)).shape == (1,)


@pytest.mark.parametrize(
    ("table", "key"),
    [
        ({"elevation_mask_deg": 90.0}, "elevation_mask_deg"),
        ({"horizon_deg": [[0.0, 5.0], [360.0, 7.0]]}, "horizon_deg"),
        ({"horizon_deg": [[0.0, 91.0]]}, "horizon_deg"),
        ({"body_masks": [{"elevation_deg": [20.0, 10.0]}]}, r"body_masks\[0\].elevation_deg"),
        ({"body_masks": [{"attenuation_db": -1.0}]}, r"body_masks\[0\].attenuation_db"),
        ({"outages": [{"start_s": 0.0, "duration_s": 0.0}]}, r"outages\[0\].duration_s"),
        ({"outages": [{"start_s": 0.0, "duration_s": 9.0, "period_s": 9.0}]}, r"outages\[0\].period_s"),
        ({"outages": [{"start_s": 0.0, "systems": "GX"}]}, r"outages\[0\].systems"),
        ({"obstructions": [{"kind": "tree", "start_m": 0.0, "start_s": 0.0}]}, r"obstructions\[0\].start_m"),
        ({"obstructions": [{"kind": "tree", "start_m": 5.0, "end_m": 5.0}]}, r"obstructions\[0\].end_m"),
        ({"obstructions": [{"kind": "tree", "lap_m": 0.0}]}, r"obstructions\[0\].lap_m"),
        ({"obstructions": [{"kind": "tree", "lap_m": 9.0, "every_lap": True}]}, r"obstructions\[0\].lap_m"),
        (
            {"obstructions": [{"kind": "tree", "fading_sd_db": float("inf")}]},
            r"obstructions\[0\].fading_sd_db",
        ),
        ({"obstructions": [{"kind": "tree", "height_m": -1.0}]}, r"obstructions\[0\].height_m"),
        ({"obstructions": [{"kind": "custom", "side": "left"}]}, r"obstructions\[0\].height_m"),
        (
            {"obstructions": [{"kind": "tree", "elevation_deg": [5.0, 5.0]}]},
            r"obstructions\[0\].elevation_deg",
        ),
    ],
)
def test_impossible_settings_are_refused_by_name(table, key):
    with pytest.raises(ConfigError, match=f"`visibility.{key}`"):
        convert_settings(table, VisibilitySection, prefix="visibility.")


def test_every_lap_needs_a_closed_route():
    section = obstructed(kind="tree", every_lap=True)
    with pytest.raises(ConfigError, match="every_lap"):
        Visibility(section, SimpleNamespace(lap_m=None), 1)


def test_a_section_survives_being_written_and_read():
    section = VisibilitySection(
        horizon_deg=((0.0, 5.0),), body_masks=(BodyMask(),), obstructions=(Obstruction(kind="tree"),)
    )
    assert convert_settings(msgspec.to_builtins(section), VisibilitySection) == section
