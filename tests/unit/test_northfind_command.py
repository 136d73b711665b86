"""``truenorth northfind`` on the command line: numbers, files, words, one sentence for whatever is wrong."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from truenorth.cli.app import app
from truenorth.formats import read_table, write_table
from truenorth.northfinding import METHODS, Site
from truenorth.simulation import write_simulation

pytestmark = pytest.mark.unit

LATITUDE_DEG = 46.55
SCENARIO = {
    "name": "tunnel",
    "seed": 3,
    "duration_s": 120.0,
    "interval_s": 60.0,
    "place": {"latitude_deg": LATITUDE_DEG, "longitude_deg": 8.56, "height_m": 1150.0},
    "motion": {"kind": "sway", "heading_deg": 211.0, "pitch_deg": 1.5, "roll_deg": -0.8},
    "sensors": {"imu": [{"grade": "navigation", "rate_hz": 50.0}]},
    "output": {"signal_truth": False},
}
STEP_S = 0.02


def _run(*arguments):
    result = CliRunner().invoke(app, ["northfind", *map(str, arguments)])
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_simulation({"platform": {}, **SCENARIO}, tmp_path_factory.mktemp("tunnel"))


@pytest.fixture(scope="module")
def log(folder):
    return folder.sensors["imu"][0]


def _changed(log, tmp_path, change):
    """The log with its columns changed, as a new file."""
    columns, meta = read_table(log)
    path = tmp_path / "changed.csv"
    write_table(path, change(dict(columns)), meta=meta)
    return path


def test_heading_budget_and_verdict_are_told_written_and_drawn(log, tmp_path):
    table, figure = tmp_path / "run.csv", tmp_path / "north.png"
    code, said, _ = _run(
        log,
        "--latitude",
        LATITUDE_DEG,
        "--errors",
        log.with_name("imu-errors.toml"),
        "--out",
        table,
        "--figure",
        figure,
    )
    assert code == 0
    assert "verdict     YES" in said
    assert "gyro bias, 0.0035 deg/h" in said
    columns, _ = read_table(table)
    error_deg = columns["heading_deg"][-1] - 211.0
    # Four sigma, and what the platform swings within the last second.
    assert abs(error_deg) < 4.0 * columns["heading_sd_deg"][-1] + 0.05
    assert len(columns["heading_deg"]) > 60
    assert figure.read_bytes()[:4] == b"\x89PNG"


def test_json_holds_the_same(log, folder):
    scenario = folder.folder / "scenario.toml"
    code, said, _ = _run(log, "--position", scenario, "--errors", "navigation", "--json", "--from", 10)
    told = json.loads(said)
    assert code == 0
    assert told["verdict"]["able"] is True
    assert told["site"]["latitude_deg"] == pytest.approx(LATITUDE_DEG)
    assert told["duration_s"] == pytest.approx(110.0)
    assert told["seconds"] > 0.0
    parts = [source["heading_sd_deg"] or 0.0 for source in told["budget"]["sources"]]
    assert np.sqrt(np.sum(np.square(parts))) == pytest.approx(told["budget"]["total"]["heading_sd_deg"])


@pytest.mark.parametrize("method", [name for name in METHODS if name not in ("positions", "carousel")])
def test_every_method_finds_the_heading_of_a_shaken_body(log, method):
    code, said, _ = _run(
        log, "--latitude", LATITUDE_DEG, "--errors", "navigation", "--method", method, "--json",
        "--require-deg", 30,
    )  # fmt: skip
    told = json.loads(said)
    assert (code, told["method"]) == (0, method)
    assert abs(told["heading_deg"] - 211.0) < max(0.3, 4.0 * told["heading_sd_deg"])


def test_the_filter_tells_what_could_be_observed(log):
    wanted = ["--latitude", LATITUDE_DEG, "--errors", "navigation", "--method", "fine"]
    _, said, _ = _run(log, *wanted)
    assert "observed    tilt about north is observed" in said
    assert "gyro bias east is not observed" in said
    told = {state["state"]: state for state in json.loads(_run(log, *wanted, "--json")[1])["observability"]}
    assert told["heading"]["sd_after"] < 0.01 * told["heading"]["sd_before"]
    assert json.loads(_run(log, "--latitude", LATITUDE_DEG, "--json")[1])["observability"] == []


def test_a_wrong_latitude_is_told(log):
    code, said, _ = _run(log, "--latitude", 30)
    assert code == 0
    assert "as at latitude 46." in said
    assert "feel the Earth turn as at" not in _run(log, "--latitude", LATITUDE_DEG)[1]
    assert "feel the Earth turn as at" not in _run(log, "--latitude", LATITUDE_DEG, "--errors", "tactical")[1]


def test_without_stated_errors_the_verdict_is_open(log):
    code, said, _ = _run(log, "--latitude", LATITUDE_DEG)
    assert code == 0
    assert "verdict     open" in said
    assert "only the noise" in said


def test_a_sensor_that_cannot_ends_with_exit_code_1(log):
    code, said, _ = _run(log, "--latitude", LATITUDE_DEG, "--errors", "industrial")
    assert code == 1
    assert "verdict     NO" in said
    code, said, _ = _run(log, "--latitude", LATITUDE_DEG, "--errors", "navigation", "--require-deg", 1e-4)
    assert code == 1


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ([], 2, "--latitude"),
        (["--latitude", 95], 2, "-90 to 90"),
        (["--latitude", 89.95], 2, "no sensor can feel north"),
        (["--latitude", 46, "--errors", "splendid"], 2, "splendid"),
        (["--latitude", 46, "--method", "divine"], 2, "velocity-fit"),
        (["--latitude", 46, "--method", "fine"], 2, "errors"),
        (["--latitude", 46, "--require-deg", 0], 2, "positive"),
        (["--latitude", 46, "--latitude-sd", -1], 2, "standard deviation"),
        (["--latitude", 46, "--out", "run.docx"], 2, ".csv"),
        (["--latitude", 46, "--figure", "run.gif"], 2, ".png"),
        (["--latitude", 46, "--from", 500], 3, "500"),
        (["--latitude", 46, "--from", 117], 1, "at least 10 s"),
        (["--latitude", 46, "--method", "positions", "--errors", "navigation"], 1, "position"),
        (["--latitude", 46, "--method", "carousel", "--errors", "navigation"], 1, "carousel"),
        (["--latitude", 46, "--table-angles", "0,half"], 2, "with commas"),
        (["--latitude", -46], 1, "latitude"),
    ],
)
def test_a_wrong_request_is_one_sentence(log, arguments, code, words):
    got, said, complaint = _run(log, *arguments)
    assert got == code, complaint + said
    assert words in complaint
    assert complaint.strip().count("\n") == 0
    assert "Traceback" not in complaint


def _scaled(prefix, factor):
    def change(columns):
        return {
            name: values * factor if name.startswith(prefix) else values for name, values in columns.items()
        }

    return change


def _clipped(columns):
    name = "delta_velocity_z_mps"
    low = np.quantile(columns[name], 0.1)
    return {**columns, name: np.maximum(columns[name], low)}


def _with_gap(columns):
    keep = np.ones(len(columns["time_ns"]), dtype=bool)
    keep[2000:2100] = False
    return {name: values[keep] for name, values in columns.items()}


def _with_nan(columns):
    values = columns["delta_angle_y_rad"].copy()
    values[1234] = np.nan
    return {**columns, "delta_angle_y_rad": values}


def _renamed(columns):
    return {name.removesuffix("_rad").removesuffix("_mps"): values for name, values in columns.items()}


@pytest.mark.parametrize(
    ("change", "code", "words"),
    [
        (_scaled("delta_angle", 0.0), 1, "gyro"),
        (_scaled("delta_angle", 57.29578), 1, "gyro"),
        (_scaled("delta_angle", 0.01745329), 1, "gyro"),
        (_scaled("delta_velocity", 1.0 / 9.80665), 1, "g"),
        (_scaled("delta_velocity", 1e3), 1, "gravity"),
        (_clipped, 1, "saturated"),
        (_with_gap, 3, "--from"),
        (_with_nan, 3, "no number"),
        (_renamed, 3, "mapping"),
    ],
)
def test_data_that_cannot_be_are_refused_in_one_sentence(log, tmp_path, change, code, words):
    got, said, complaint = _run(_changed(log, tmp_path, change), "--latitude", LATITUDE_DEG)
    assert got == code, complaint + said
    assert words in complaint
    assert complaint.strip().count("\n") == 0
    assert "Traceback" not in complaint


def test_the_place_of_a_search_is_not_at_a_pole():
    assert Site(np.radians(89.8)).horizontal_rate_radps > 0.0
