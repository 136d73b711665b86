"""``truenorth plan`` and ``truenorth rates`` on the command line: tables, files, figures, sentences."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from truenorth.cli.app import app

ARRAY = ["--antenna", "0,0,0", "--antenna", "1,0,0", "--antenna", "0,1,0"]
PLACE = ["--latitude", "47.07", "--longitude", "15.44", "--date", "2024-06-24"]
SHORT = ["--hours", "2", "--step", "3600", "--systems", "G", "--bands", "L1", "--noise", "0.003,0.3"]


def _run(*arguments):
    result = CliRunner().invoke(app, list(arguments))
    return result.exit_code, result.stdout, result.stderr


def test_a_plan_is_told_written_and_drawn(tmp_path):
    table, figure = tmp_path / "day.csv", tmp_path / "day.png"
    code, said, _ = _run("plan", *ARRAY, *PLACE, *SHORT, "--out", str(table), "--figure", str(figure))
    assert code == 0
    assert "array       3 antennas" in said
    assert "sigma heading, deg" in said
    rows = table.read_text().splitlines()
    assert rows[0].startswith("time_gpst,n_satellites,n_integers,heading_sd_deg")
    assert len(rows) == 4
    assert rows[1].startswith("2024-06-24T00:00:00.000,")
    assert figure.read_bytes()[:4] == b"\x89PNG"


def test_a_plan_as_json_holds_demands_and_places():
    code, said, _ = _run(
        "plan", *ARRAY, *PLACE, *SHORT, "--json", "--require-heading-deg", "0.1", "--at", "worst",
        "--place-box", "0,0,-1,1,1,0", "--grid", "0.5", "--criterion", "roll",
    )  # fmt: skip
    assert code == 0
    told = json.loads(said)
    assert told["epochs"] == 3
    (required,) = told["required"]
    assert required["scale"] == pytest.approx(required["reached_deg"] / 0.1)
    assert told["placement"]["best"]["point_body_m"][2] < 0.0
    assert told["placement"]["best"]["roll_sd_deg"] < told["placement"]["without"]["roll_sd_deg"]


@pytest.mark.jit
def test_draws_of_the_joint_search_are_beside_the_bound():
    code, said, _ = _run("plan", *ARRAY, *PLACE, *SHORT, "--json", "--draws", "20")
    assert code == 0
    for entry in json.loads(said)["joint"]["epochs"]:
        low, high = entry["interval_95"]
        assert low <= entry["joint_success"] <= high
        # The geometry of the array only helps.
        assert high >= entry["baseline_success"]
        assert entry["wrong"] == 0


def test_candidates_are_written_and_drawn(tmp_path):
    table, figure = tmp_path / "places.parquet", tmp_path / "places.svg"
    code, said, _ = _run(
        "plan", *ARRAY, *PLACE, *SHORT, "--place", "1,1,0", "--place", "0,0,-1", "--out", str(table),
        "--figure", str(figure),
    )  # fmt: skip
    assert code == 0
    assert "one more    antenna, for the least trace (p95 epoch), of 2 points" in said
    import polars as pl

    assert pl.read_parquet(table)["in_plane"].sum() == 1
    assert "<svg" in figure.read_text()


@pytest.mark.parametrize("sweep", ["error", "coordinate", "length"])
def test_sweeps_need_no_place(sweep, tmp_path):
    code, said, _ = _run(
        "plan",
        "--sweep",
        sweep,
        "--out",
        str(tmp_path / "sweep.csv"),
        "--figure",
        str(tmp_path / "sweep.png"),
    )
    assert code == 0
    assert "adjusted" in said
    assert (tmp_path / "sweep.png").stat().st_size > 10_000
    table = np.genfromtxt(tmp_path / "sweep.csv", delimiter=",", names=True)
    assert len(table) > 10
    assert (tmp_path / "sweep-b_m.csv").exists() == (sweep == "length")


def test_a_sweep_takes_an_array_and_a_scenario():
    code, said, _ = _run("plan", *ARRAY, "--sweep", "coordinate", "--coordinate", "3,up", "--error", "0.05")
    assert code == 0
    assert "up of antenna 3 swept, 0.05 m everywhere else" in said
    code, said, _ = _run("plan", "wang-vehicle", "--sweep", "error", "--json")
    assert code == 0
    assert json.loads(said)["sweeps"][0]["title"].startswith("every coordinate of 4 antennas")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["plan"], "no array is given"),
        (["plan", *ARRAY, "--longitude", "1", "--date", "2024-01-01"], "`--latitude` is missing"),
        (["plan", *ARRAY, *PLACE[:4], "--date", "monday"], "`--date` is 'monday'"),
        (["plan", *ARRAY[:2], *PLACE], "`--antenna` holds 1"),
        (["plan", "--antenna", "0,0", *PLACE], "`--antenna 0,0` is not three numbers"),
        (["plan", *ARRAY, *PLACE, "--noise", "0.003"], "`--noise 0.003` is not two numbers"),
        (["plan", *ARRAY, *PLACE, "--noise", "-1,1"], "`--noise` is -1.0"),
        (["plan", *ARRAY, *PLACE, *SHORT, "--mask", "90"], "`--mask` is 90.0"),
        (["plan", *ARRAY, *PLACE, "--out", "day.txt"], "not one of .csv, .parquet"),
        (["plan", *ARRAY, *PLACE, "--figure", "day.html"], "not one of .png, .pdf, .svg"),
        (["plan", *ARRAY, *PLACE, *SHORT, "--place-box", "1,2,3"], "is not six numbers"),
        (["plan", *ARRAY, *PLACE, "--place", "1,1,1", "--place-box", "0,0,0,1,1,1"], "points or a box"),
        (["plan", *ARRAY, *PLACE, *SHORT, "--place", "1,1,1", "--criterion", "yaw"], "`--criterion` is"),
        (["plan", *ARRAY, *PLACE, *SHORT, "--require-roll-deg", "0"], "positive angle"),
        (["plan", "--sweep", "height"], "give error, coordinate or length"),
        (["plan", *ARRAY, "--sweep", "length"], "leave out the array"),
        (["plan", "--sweep", "coordinate", "--coordinate", "two"], "is not an antenna and an axis"),
        (["plan", "no-such-scenario"], "there is no scenario"),
        (["rates", "no-such.toml"], "could not read the session"),
        (["rates", "no-such.toml", "--rates", "fast"], "`--rates fast` are not numbers"),
    ],
)  # fmt: skip
def test_mistakes_are_one_sentence(arguments, said):
    code, _, told = _run(*arguments)
    assert code in (2, 3)
    assert said in told
    assert told.count("\n") == 1


def test_no_satellite_is_no_solution():
    code, _, told = _run("plan", *ARRAY, *PLACE, *SHORT, "--mask", "89.5")
    assert code == 1
    assert "lower the mask" in told


@pytest.mark.jit
def test_rates_of_a_session_are_told_written_and_drawn(tmp_path):
    scenario = tmp_path / "drive.toml"
    scenario.write_text(
        'name = "drive"\nduration_s = 12.0\ninterval_s = 0.2\n[place]\nlatitude_deg = 47.0\n'
        "longitude_deg = 15.0\n[platform]\n"
        '[[platform.antennas]]\nname = "aft"\nposition_body_m = [0.0, 0.0, 0.0]\n'
        '[[platform.antennas]]\nname = "fore"\nposition_body_m = [1.0, 0.0, 0.0]\n'
        "[[visibility.outages]]\nstart_s = 4.0\nduration_s = 2.0\n"
    )
    assert _run("simulate", str(scenario), "--out", str(tmp_path / "drive"))[0] == 0
    session = tmp_path / "drive" / "session.toml"
    code, said, _ = _run(
        "rates", str(session), "--rates", "1,5", "--reference", str(tmp_path / "drive" / "truth.csv"),
        "--out", str(tmp_path / "rates.csv"), "--figure", str(tmp_path / "rates.png"),
    )  # fmt: skip
    assert code == 0
    assert "recorded    5 Hz, 61 epochs" in said
    assert "time to re-fix, s, after 1 obstructions" in said
    assert (tmp_path / "rates.csv").read_text().startswith("rate_hz,")
    assert (tmp_path / "rates-refix.csv").read_text().count("\n") == 2
    assert (tmp_path / "rates.png").stat().st_size > 10_000
    code, _, told = _run("rates", str(session), "--rates", "50")
    assert code == 2
    assert "the recording has 5 Hz; give no more" in told
