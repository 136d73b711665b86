"""A search for north in words, values, tables and pictures."""

import dataclasses
import json

import numpy as np
import pytest

from truenorth.errors import ConfigError
from truenorth.export.planning import table_csv
from truenorth.northfinding.site import Site
from truenorth.northfinding.solution import BudgetLine, ErrorBudget, NorthRun, NorthSolution, Verdict
from truenorth.report.north_figures import north_figure, save_figure
from truenorth.report.north_text import north_columns, north_dict, north_text, quantity_words, sigma_word
from truenorth.rotations import rot_ned_from_body

ANGLES_RAD = np.radians([359.99996, 0.62, -1.24])


def _line(source, stated, *sd_deg):
    return BudgetLine(source, stated, np.radians(np.diag(sd_deg)) ** 2)


@pytest.fixture
def solution():
    attitude = rot_ned_from_body(*ANGLES_RAD)
    lines = (
        _line("gyro bias", "0.5 deg/h", 0.0, 0.0, 2.0),
        _line("angle random walk", "0.15 deg/sqrt(h)", 0.0, 0.0, 1.5),
        _line("accelerometer bias", "750 ug", 0.043, 0.043, 0.0),
        _line("latitude", "0.0001 deg", 0.0, 0.0, 1e-7),
    )
    time_s = np.arange(2.0, 301.0)
    sd = np.radians(np.stack([2.5 * (300.0 / time_s) ** 1.5, np.full(299, 0.05), np.full(299, 0.05)], axis=1))
    angles = ANGLES_RAD + 0.3 * sd * np.sin(time_s / 40.0)[:, None]
    angles[:, 0] %= 2.0 * np.pi
    angles[:3] = np.nan
    return NorthSolution(
        method="static",
        site=Site(np.radians(-33.5), np.radians(-70.6), 500.0, np.radians(1e-4)),
        time_s=300.0,
        duration_s=300.0,
        rot_ned_from_body=attitude,
        cov_ned_rad2=sum(line.cov_ned_rad2 for line in lines),
        measured={"gravity_mps2": 9.79612, "gyro_bias_x_dph": 0.013, "chi_square": 1.25},
        run=NorthRun(time_s, angles, sd),
        budget=ErrorBudget(lines, attitude),
        verdict=Verdict(False, "It cannot: 2.5 deg.", np.radians(2.5), np.radians(1.0)),
        notes=("Sigma covers what is stated.", "word " * 40),
    )


def test_text_has_the_outcome_the_budget_and_the_verdict(solution):
    said = north_text(solution)
    lines = said.splitlines()
    assert "static, 300 s of data" in lines[0]
    assert "33.5000 S 70.6000 W, 500 m, latitude sigma 0.00010 deg; the Earth turns 12.54 deg/h" in lines[1]
    # A heading just short of a turn is north, not 360.
    assert lines[2].split()[:5] == ["heading", "0.000", "deg", "sigma", "2.5"]
    assert lines[4].split()[:5] == ["roll", "-1.240", "deg", "sigma", "0.043"]
    assert [line.split()[-3:] for line in lines if "gyro bias, 0.5" in line] == [["2.0", "0", "0"]]
    assert [line.split()[-3:] for line in lines if line.startswith("  total")] == [["2.5", "0.043", "0.043"]]
    assert "< 0.00001" in said
    assert "verdict     NO: It cannot: 2.5 deg." in lines
    assert any(line.startswith("measured") and line.endswith("9.79612 m/s^2") for line in lines)
    assert any(line.strip().startswith("gyro bias x") and line.endswith("0.013 deg/h") for line in lines)
    assert max(map(len, lines)) <= 110
    bare = dataclasses.replace(solution, run=None, budget=None, verdict=None, measured={}, notes=())
    assert north_text(bare).splitlines() == lines[:6]


def test_values_survive_json(solution):
    endless = dataclasses.replace(
        solution,
        verdict=Verdict(None, "Open.", float("inf"), np.radians(1.0)),
        measured={"residual_mps": float("nan")},
    )
    told = json.loads(json.dumps(north_dict(endless), allow_nan=False))
    assert told["heading_deg"] == pytest.approx(359.99996)
    assert told["heading_sd_deg"] == pytest.approx(2.5, rel=1e-3)
    assert told["site"]["latitude_deg"] == pytest.approx(-33.5)
    assert told["budget"]["sources"][2]["source"] == "accelerometer bias"
    assert told["budget"]["sources"][2]["pitch_sd_deg"] == pytest.approx(0.043)
    assert told["budget"]["total"]["heading_sd_deg"] == pytest.approx(2.5, rel=1e-3)
    assert told["verdict"]["achievable_heading_sd_deg"] is None
    assert told["verdict"]["able"] is None
    assert told["measured"] == {"residual_mps": None}
    bare = north_dict(dataclasses.replace(solution, budget=None, verdict=None))
    assert bare["budget"] is None
    assert bare["verdict"] is None


def test_the_run_is_a_table(solution):
    columns = north_columns(solution)
    assert list(columns) == [
        "time_s", "heading_deg", "pitch_deg", "roll_deg", "heading_sd_deg", "pitch_sd_deg", "roll_sd_deg",
    ]  # fmt: skip
    assert table_csv(columns).splitlines()[1].startswith("2,NaN,")
    assert np.nanmin(columns["heading_deg"]) >= 0.0
    assert np.nanmax(columns["heading_deg"]) < 360.0
    only = north_columns(dataclasses.replace(solution, run=None))
    assert only["time_s"].tolist() == [300.0]
    assert only["roll_deg"] == pytest.approx(-1.24)


def test_sigmas_and_quantities_read_well():
    words = [sigma_word(value) for value in (0.0, 3e-9, 0.00012, 0.0999, 1.234, 45.6, np.inf, np.nan)]
    assert words == ["0", "3.0e-09", "0.00012", "0.10", "1.2", "46", "infinite", "unknown"]
    assert quantity_words("gyro_random_walk_deg_per_sqrt_h", 0.002) == (
        "gyro random walk",
        "0.002 deg/sqrt(h)",
    )
    assert quantity_words("count", 3.0) == ("count", "3")


def test_figure_shows_the_settled_heading_and_the_sources(solution, tmp_path):
    figure = north_figure(solution, title="log.csv")
    heading, pitch, roll, sigma, bars, level = figure.axes
    assert "log.csv: heading 0.00° ± 2.5°" in figure.get_suptitle()
    assert "the sensor cannot do it" in figure.get_suptitle()
    low, high = heading.get_ylim()
    # The first seconds, hundreds of degrees, do not set the scale; the band at the end shows.
    assert 10.0 < high - low < 90.0
    assert low < 359.99996 < high
    figure.canvas.draw()
    labels = [float(text.get_text()) for text in heading.get_yticklabels()]
    assert all(0.0 <= label < 360.0 for label in labels)
    assert np.diff(pitch.get_ylim()) < 1.0
    assert roll.get_xlim() == heading.get_xlim() == (0.0, 300.0)
    assert sigma.get_yscale() == "log"
    sources = [text.get_text() for text in bars.get_yticklabels()]
    assert (sources[0], sources[-1]) == ("gyro bias, 0.5 deg/h", "total")
    assert (bars.get_xlabel(), level.get_xlabel()) == ("deg", "arcmin")
    assert save_figure(figure, tmp_path / "north.svg").stat().st_size > 10_000


def test_figure_of_a_part_and_of_nothing(solution):
    assert len(north_figure(dataclasses.replace(solution, run=None)).axes) == 2
    assert len(north_figure(dataclasses.replace(solution, budget=None)).axes) == 4
    endless = ErrorBudget(
        (*solution.budget.lines, _line("gyro scale", "", 0.0, 0.0, np.inf)), solution.rot_ned_from_body
    )
    with np.errstate(invalid="ignore"):
        figure = north_figure(dataclasses.replace(solution, budget=endless))
    assert any("infinite" in text.get_text() for text in figure.axes[4].texts)
    with pytest.raises(ConfigError, match="nothing to draw"):
        north_figure(dataclasses.replace(solution, run=None, budget=None))
    with pytest.raises(ConfigError, match=r"is not one of \.png"):
        save_figure(figure, "north.gif")
