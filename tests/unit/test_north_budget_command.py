"""``truenorth north-budget``: predictions of every method, their budgets, and what is refused."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from truenorth.cli.app import app
from truenorth.formats import read_table
from truenorth.northfinding import Site, predict_budget, static_budget
from truenorth.northfinding.predict import PREDICTED
from truenorth.sensors import ImuDescription

pytestmark = pytest.mark.unit

SITE = Site(np.radians(40.0))


def _run(*arguments):
    result = CliRunner().invoke(app, ["north-budget", *map(str, arguments)])
    return result.exit_code, result.stdout, result.stderr


def test_one_combination_has_its_budget_and_verdict():
    code, said, _ = _run("--errors", "tactical", "--latitude", 40, "--method", "positions")
    assert code == 1
    assert "angle random walk, 0.15 deg/sqrt(h)" in said
    assert "verdict     NO" in said
    code, said, _ = _run("--errors", "navigation", "--latitude", 40, "--method", "positions")
    assert code == 0
    assert "verdict     YES" in said


def test_combinations_are_a_table(tmp_path):
    path = tmp_path / "plan.csv"
    code, said, _ = _run(
        "--errors", "navigation", "--latitude", "0,60", "--duration", "100,400", "--json", "--out", path,
        "--method", "static,velocity-fit",
    )  # fmt: skip
    assert code == 0
    rows = json.loads(said)["rows"]
    assert len(rows) == 8
    by = {(row["latitude_deg"], row["duration_s"], row["method"]): row["heading_sd_deg"] for row in rows}
    # The horizontal Earth rate halves, but for the deflection of the vertical and its like.
    assert by[60, 100, "static"] == pytest.approx(2.0 * by[0, 100, "static"], rel=0.01)
    assert by[0, 400, "velocity-fit"] < by[0, 100, "velocity-fit"]
    columns, _ = read_table(path)
    np.testing.assert_allclose(columns["heading_sd_deg"], [row["heading_sd_deg"] for row in rows])


@pytest.mark.parametrize("method", PREDICTED)
def test_every_method_is_predicted(method):
    good, poor = ImuDescription(grade="navigation"), ImuDescription(grade="tactical")
    sd = [predict_budget(errors, SITE, 300.0, method=method).angle_sd_rad() for errors in (good, poor)]
    assert np.all(np.isfinite(sd))
    assert np.all(sd[0] < sd[1])
    # Only turning takes a bias of 4 deg/h away, which is 20 degrees here.
    assert (np.degrees(sd[1][0]) < 5.0) == (method in ("positions", "carousel"))


def test_prediction_of_averages_is_their_budget():
    errors = ImuDescription(grade="tactical")
    predicted = predict_budget(errors, SITE, 300.0, method="static", heading_rad=0.0)
    np.testing.assert_allclose(
        predicted.cov_ned_rad2, static_budget(errors, np.eye(3), SITE, 300.0).cov_ned_rad2
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--errors", "tactical", "--latitude", "north"], "numbers"),
        (["--errors", "tactical", "--latitude", "90"], "no sensor can feel north"),
        (["--errors", "tactical", "--latitude", "40", "--duration", "3"], "30 s or more"),
        (["--errors", "tactical", "--latitude", "40", "--method", "fine"], "cannot be predicted"),
        (["--errors", "great", "--latitude", "40"], "great"),
        (["--errors", "tactical", "--latitude", "40", "--require-deg", "-1"], "positive"),
        (["--errors", "tactical", "--latitude", "40", "--method", "positions", "--positions", "1"], "two"),
        (["--errors", "tactical", "--latitude", "40", "--out", "plan.doc"], ".csv"),
    ],
)
def test_a_wrong_request_is_one_sentence(arguments, words):
    code, _, complaint = _run(*arguments)
    assert code == 2, complaint
    assert words in complaint
    assert complaint.strip().count("\n") == 0
