"""``truenorth compare-north``: table, JSON, files, and one sentence for what cannot be."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from truenorth.cli.app import app
from truenorth.evaluation import compare_north
from truenorth.report.north_comparison_figures import north_comparison_figure

QUICK = ["--methods", "accelerometer, imu", "--runs", "3"]


def _run(*arguments):
    result = CliRunner().invoke(app, ["compare-north", *arguments])
    return result.exit_code, result.stdout, result.stderr


def test_the_table_is_told_written_and_drawn(tmp_path):
    table, figure = tmp_path / "north.csv", tmp_path / "north.png"
    code, said, _ = _run(*QUICK, "--out", str(table), "--figure", str(figure))
    assert code == 0
    lines = said.splitlines()
    assert lines[0].startswith("truth       level at 39.9167, 32.8000, heading 11 deg; 3 runs, seed 2006")
    assert len({len(line) for line in lines[1:5]}) == 1
    assert any(line.startswith("rotating accelerometer, square wave   0.20") for line in lines)
    rows = table.read_text().splitlines()
    assert rows[0].startswith("technique,title,published_deg,rms_deg,")
    assert [row.partition(",")[0] for row in rows[1:]] == ["accelerometer", "imu"]
    assert figure.read_bytes()[:4] == b"\x89PNG"


def test_json_holds_truth_and_numbers():
    code, said, _ = _run(*QUICK, "--json", "--latitude", "60", "--heading", "300", "--seed", "5")
    assert code == 0
    told = json.loads(said)
    assert (told["latitude_deg"], told["heading_deg"], told["seed"], told["runs"]) == (60.0, 300.0, 5, 3)
    accelerometer, unit = told["techniques"]
    assert accelerometer["data_s"] == pytest.approx(1.0)
    assert accelerometer["dependence"] == "internal"
    assert unit["published_cost"] == "expensive"
    # Stated by the error models: 3 percent of a degree over 1 / cos(60 deg), and 1 deg/h against 7.5.
    assert accelerometer["stated_sd_deg"] == pytest.approx(0.0553, abs=0.001)
    assert 7.5 < unit["stated_sd_deg"] < 8.5


def test_the_figure_leaves_out_what_is_hardly_ever_right():
    comparison = compare_north(runs=3, methods=["accelerometer", "imu"])
    # All answers of the unit wrong, everywhere.
    for answers in (comparison.results[1].answers, *comparison.results[1].elsewhere):
        answers.is_wrong[:] = True
    left, right = north_comparison_figure(comparison).axes
    assert [text.get_text() for text in left.texts] == ["3 wrong"]
    assert [line.get_label() for line in right.lines if not line.get_label().startswith("_")] == [
        "rotating accelerometer, square wave"
    ]
    assert np.isnan(comparison.results[1].numbers()["right_rms_deg"])


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--methods", "sextant"), "there is no technique 'sextant'; choose among search-20"),
        (("--runs", "1"), "`runs` is 1; give two or more"),
        (("--seed", "-1"), "`seed` is -1; give 0 or more"),
        ((*QUICK, "--latitude", "90"), "use satellites instead"),
        ((*QUICK, "--latitude", "95"), "give -90 to 90"),
        (("--figure", "north.html"), "north.html"),
        (("--out", "north.txt"), "north.txt"),
    ],
)
def test_what_cannot_be_is_one_sentence(arguments, sentence):
    code, said, told = _run(*arguments)
    assert code == 2
    assert said == ""
    assert sentence in told
    assert told.count("\n") == 1
