"""Theodolite surveys: forward intersection, joint adjustment, blunders, planes and lines, the survey file."""

import json
from dataclasses import replace

import numpy as np
import pytest

from truenorth.calibration.marks import body_coordinates, fit_line, fit_plane, plane_line_point
from truenorth.calibration.survey_file import SurveyFile, solve_survey
from truenorth.calibration.theodolite import Pointing, Station, adjust_pointings, forward_intersection
from truenorth.errors import ConfigError, FormatError, NoSolutionError

PILLARS = (Station("east", 0.0, 0.0, 0.0, 0.20), Station("west", 6.0, 8.0, 0.1, 0.25))
MARKS = {"a": (4.0, 3.0, -1.0), "b": (4.5, 4.2, -1.1), "c": (5.4, 3.4, -0.9), "d": (3.0, 2.5, -1.0)}
SD_RAD = np.radians(1.0 / 3600.0)


def point_all(rng, *, sets=3, sd_rad=SD_RAD, marks=MARKS):
    """Pointings from every pillar to every mark and to the other pillar."""
    found = []
    for station in PILLARS:
        axis = np.array([station.north_m, station.east_m, station.height_m + station.instrument_height_m])
        for number in range(sets):
            turn = rng.uniform(0.0, 2.0 * np.pi)
            targets = dict(marks)
            for other in PILLARS:
                if other is not station:
                    targets[other.name] = (other.north_m, other.east_m, other.height_m)
            for name, place in targets.items():
                north, east, up = np.array(place) - axis
                angles = np.array([np.arctan2(east, north) - turn, np.arctan2(np.hypot(north, east), up)])
                angles += sd_rad * rng.standard_normal(2)
                found.append(
                    Pointing(
                        station.name, name, str(number), angles[0] % (2 * np.pi), angles[1], SD_RAD, SD_RAD
                    )
                )
    return found


def true_ned():
    return np.array(list(MARKS.values())) * [1.0, 1.0, -1.0]


def test_forward_intersection_is_that_of_the_triangle():
    a, b, point = np.array([100.0, 50.0]), np.array([90.0, 80.0]), np.array([130.0, 72.0])
    rays = [np.arctan2(point[1] - s[1], point[0] - s[0]) for s in (a, b)]
    found, from_a, from_b = forward_intersection(a, b, *rays)
    np.testing.assert_allclose(found, point, atol=1e-10)
    assert from_a == pytest.approx(np.hypot(*(point - a)))
    assert from_b == pytest.approx(np.hypot(*(point - b)))
    with pytest.raises(ConfigError, match="parallel"):
        forward_intersection(a, b, 0.3, 0.3)


def test_exact_pointings_give_exact_marks():
    network = adjust_pointings(PILLARS, point_all(np.random.default_rng(1), sd_rad=0.0))
    assert network.names == tuple(MARKS)
    np.testing.assert_allclose(network.position_ned_m, true_ned(), atol=1e-7)
    assert network.statistic < 1e-6
    # 2 pillars, 3 sets, 5 targets, 2 angles, less 12 coordinates and 6 orientations.
    assert network.degrees == 2 * 3 * 5 * 2 - 12 - 6
    # Orientations are those of the circles.
    assert len(network.orientation_rad) == 6
    assert not network.is_excluded.any()


def test_covariance_and_redundancy():
    total, statistic = 0.0, 0.0
    for seed in range(40):
        # At this limit nothing is left out by chance, which would bias the statistic.
        network = adjust_pointings(PILLARS, point_all(np.random.default_rng(seed)), significance=1e-7)
        error = (network.position_ned_m - true_ned()).ravel()
        total += error @ np.linalg.solve(network.cov_m2, error) / 12.0
        statistic += network.statistic / network.degrees
        assert np.nansum(network.redundancy) == pytest.approx(network.degrees, rel=1e-6)
    # Means of 40 chi-squares of 12 and 42 degrees: sd 0.065 and 0.035; five of them.
    assert abs(total / 40.0 - 1.0) < 0.33
    assert abs(statistic / 40.0 - 1.0) < 0.18
    # A second of arc at five metres is 0.024 mm.
    assert np.all(network.sd_m < 0.05e-3)


def test_blunders_are_found_and_named():
    pointings = point_all(np.random.default_rng(5))
    pointings[2] = replace(pointings[2], direction_rad=pointings[2].direction_rad + 20.0 * SD_RAD)
    pointings[8] = replace(pointings[8], zenith_rad=pointings[8].zenith_rad - 15.0 * SD_RAD)
    network = adjust_pointings(PILLARS, pointings)
    assert network.is_excluded[2, 0]
    assert network.is_excluded[8, 1]
    assert network.is_excluded.sum() == 2
    assert "direction of set 0 from east to c is left out" in network.events[0]
    assert network.statistic < network.limit
    np.testing.assert_allclose(network.position_ned_m, true_ned(), atol=0.15e-3)
    # The residual of what was left out is the blunder itself.
    assert network.residual_rad[2, 0] == pytest.approx(20.0 * SD_RAD, abs=6.0 * SD_RAD)


def test_pillars_may_be_uncertain():
    """Known to a millimetre: the marks are that uncertain, and far less against one another."""
    pillars = [replace(PILLARS[0]), replace(PILLARS[1], sd_m=0.001)]
    network = adjust_pointings(pillars, point_all(np.random.default_rng(6)))
    assert np.max(network.sd_m) > 0.3e-3
    held = adjust_pointings(PILLARS, point_all(np.random.default_rng(6)))
    assert np.max(held.sd_m) < 0.05e-3


def test_what_cannot_be_adjusted_is_said():
    pointings = point_all(np.random.default_rng(1))
    with pytest.raises(ConfigError, match="no pointings"):
        adjust_pointings(PILLARS, [])
    with pytest.raises(ConfigError, match="is no station"):
        adjust_pointings(PILLARS, [replace(pointings[0], station="north")])
    with pytest.raises(ConfigError, match="not oriented"):
        adjust_pointings(PILLARS, [p for p in pointings if p.target != "west"])
    with pytest.raises(NoSolutionError, match="of one station"):
        adjust_pointings(PILLARS, [p for p in pointings if p.station == "east" or p.target != "a"])
    with pytest.raises(NoSolutionError, match="no zenith angle to a"):
        adjust_pointings(
            PILLARS, [replace(p, zenith_rad=np.nan) if p.target == "a" else p for p in pointings]
        )
    with pytest.raises(ConfigError, match="standard deviation"):
        adjust_pointings(PILLARS, [replace(p, zenith_sd_rad=0.0) for p in pointings])
    with pytest.raises(ConfigError, match="one name"):
        adjust_pointings((PILLARS[0], PILLARS[0]), pointings)


def test_a_line_pierces_a_plane():
    plane = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [1.0, 1.2, 1.0]])
    line = np.array([[0.3, 0.2, -0.5], [0.4, 0.2, 0.5]])
    point, jacobian, cov = plane_line_point(plane, line, 1e-8 * np.eye(18))
    np.testing.assert_allclose(point, [0.45, 0.2, 1.0], atol=1e-12)
    # Moving all marks together moves the point as much.
    np.testing.assert_allclose(jacobian.reshape(3, 6, 3).sum(1), np.eye(3), atol=1e-9)
    rng = np.random.default_rng(3)
    flat = np.concatenate([plane.ravel(), line.ravel()])
    drawn = []
    for _ in range(300):
        noisy = flat + 1e-4 * rng.standard_normal(18)
        drawn.append(plane_line_point(noisy[:12].reshape(-1, 3), noisy[12:].reshape(-1, 3))[0] - point)
    # 300 draws give a variance within 8 %, one sigma.
    np.testing.assert_allclose(np.cov(np.transpose(drawn)), cov, atol=0.4 * np.max(cov))
    assert np.isnan(plane_line_point(plane, line)[2]).all()


def test_planes_and_lines_that_are_none():
    flat = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    assert fit_plane(flat).misfit_m == pytest.approx([0.0, 0.0, 0.0])
    np.testing.assert_allclose(fit_line(flat[:2]).direction, [1.0, 0.0, 0.0])
    np.testing.assert_allclose(fit_line(flat[1::-1]).direction, [-1.0, 0.0, 0.0])
    with pytest.raises(ConfigError, match="three marks"):
        fit_plane(flat[:2])
    with pytest.raises(ConfigError, match="one line"):
        fit_plane(flat[[0, 1, 1]])
    with pytest.raises(ConfigError, match="two marks"):
        fit_line(flat[:1])
    with pytest.raises(ConfigError, match="one place"):
        fit_line(flat[[0, 0]])
    with pytest.raises(ConfigError, match="runs along"):
        plane_line_point(flat, flat[:2] + np.array([0.0, 0.0, 1.0]))


def test_body_coordinates_are_lever_arms():
    """A platform at heading 30 degrees, level: an IMU 0.5 m aft and 0.4 m below the first antenna."""
    from truenorth.rotations import rot_ned_from_body

    body = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, -0.8, 0.0], [-0.5, 0.1, 0.4]])
    rot = rot_ned_from_body(np.radians(30.0), 0.02, -0.01)
    found, cov, turn = body_coordinates(body @ rot.T + [10.0, 20.0, -3.0], 1e-8 * np.eye(12))
    np.testing.assert_allclose(found, body, atol=1e-12)
    np.testing.assert_allclose(turn, rot.T, atol=1e-12)
    sd = np.sqrt(np.maximum(np.diag(cov), 0.0)).reshape(4, 3)
    np.testing.assert_allclose(sd[0], 0.0, atol=1e-12)
    # The IMU's own 0.1 mm, the origin's, and the turn of the axes by their marks.
    assert np.all((sd[3] > 0.12e-3) & (sd[3] < 0.25e-3))


SURVEY = """
pointings = "pointings.csv"
[[stations]]
name = "east"
north_m = 0.0
east_m = 0.0
height_m = 0.0
instrument_height_m = 0.20
[[stations]]
name = "west"
north_m = 6.0
east_m = 8.0
height_m = 0.1
instrument_height_m = 0.25
[[points]]
name = "centre"
plane = ["a", "b", "c"]
line = ["top", "bottom"]
[body]
axes = ["d", "centre", "c"]
offset_body_m = { centre = [0.0, 0.0, -0.06] }
"""


def write_survey(folder, text=SURVEY):
    marks = MARKS | {"top": (4.6, 3.5, -0.5), "bottom": (4.61, 3.52, -0.9)}
    rows = ["station,target,set,direction_deg,zenith_deg"]
    for p in point_all(np.random.default_rng(2), marks=marks):
        angles = np.degrees([p.direction_rad, p.zenith_rad])
        rows.append(f"{p.station},{p.target},{p.series},{angles[0]:.6f},{angles[1]:.6f}")
    (folder / "pointings.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    (folder / "survey.toml").write_text(text, encoding="utf-8")
    return folder / "survey.toml"


def test_a_survey_file_is_solved(tmp_path):
    points = solve_survey(SurveyFile.read(write_survey(tmp_path)))
    assert points.names == (*MARKS, "top", "bottom", "centre")
    exact, _, _ = plane_line_point(
        np.array([MARKS["a"], MARKS["b"], MARKS["c"]]), [[4.6, 3.5, -0.5], [4.61, 3.52, -0.9]]
    )
    np.testing.assert_allclose(points.position_ned_m[-1], exact * [1.0, 1.0, -1.0], atol=0.3e-3)
    # The phase centre is 6 cm above its reference point, on the forward axis.
    np.testing.assert_allclose(points.position_body_m[-1, 1:], [0.0, -0.06], atol=1e-9)
    assert points.cov_ned_m2.shape == (21, 21)


def test_pillars_in_plane_coordinates_give_the_same_platform(tmp_path):
    """North of a local frame turns by the convergence of the meridians; distances shrink by the scale."""
    local = solve_survey(SurveyFile.read(write_survey(tmp_path)))
    text = SURVEY.replace("north_m = 0.0", "north_m = 5214000.0").replace(
        "north_m = 6.0", "north_m = 5214006.0"
    )
    text = text.replace("east_m = 0.0", "east_m = -67000.0").replace("east_m = 8.0", "east_m = -66992.0")
    text += "[gauss_krueger]\ncentral_meridian_deg = 16.333333\n"
    plane = solve_survey(SurveyFile.read(write_survey(tmp_path, text)))
    apart = [np.linalg.norm(p.position_ned_m[1] - p.position_ned_m[0]) for p in (local, plane)]
    assert apart[1] / apart[0] - 1.0 == pytest.approx(-55e-6, abs=3e-6)
    np.testing.assert_allclose(local.position_body_m, plane.position_body_m, atol=0.15e-3)


def test_a_survey_file_with_faults_is_refused(tmp_path):
    for old, new, words in (
        ('"a", "b", "c"', '"a", "b", "x"', "names 'x'"),
        ('axes = ["d"', 'axes = ["y"', "names 'y'"),
        ("[body]", "[bodies]", "bodies"),
        ("pointings =", "direction_sd_arcsec = 0\npointings =", "positive angle"),
    ):
        with pytest.raises(ConfigError, match=words):
            solve_survey(SurveyFile.read(write_survey(tmp_path, SURVEY.replace(old, new))))
    path = write_survey(tmp_path)
    for text, words in (
        ("station,target\n", "no column"),
        ("station,target,set,direction_deg\na,b,1,x\n", "angle"),
    ):
        (tmp_path / "pointings.csv").write_text(text, encoding="utf-8")
        with pytest.raises(FormatError, match=words):
            solve_survey(SurveyFile.read(path))
    (tmp_path / "pointings.csv").unlink()
    with pytest.raises(FormatError, match="could not read the pointings"):
        solve_survey(SurveyFile.read(path))
    with pytest.raises(FormatError, match="could not read the survey"):
        SurveyFile.read(tmp_path / "nothing.toml")


def test_the_command_prints_tables_and_json(tmp_path):
    from typer.testing import CliRunner

    from truenorth.cli.app import app

    path = str(write_survey(tmp_path))
    said = CliRunner().invoke(app, ["calibrate", "theodolite", path])
    assert said.exit_code == 0
    assert "forward, right, down (m)" in said.output
    assert "as stated" in said.output
    told = json.loads(CliRunner().invoke(app, ["calibrate", "theodolite", path, "--json"]).output)
    assert told["names"][-1] == "centre"
    assert told["left_out"] == []
