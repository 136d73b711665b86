"""Attitudes and comparisons as tables, texts, figures and pages."""

import csv
import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from synthetic_array import make_attitude, make_baselines, true_angles
from truenorth.config import Session
from truenorth.errors import ConfigError, Status
from truenorth.evaluation import compare
from truenorth.export import solution_columns, summarize_solution, to_xarray, write_solution
from truenorth.export.attitude_columns import ATTITUDE_CONTRACT
from truenorth.report import explain_epoch, figure_page, summary_text, write_figure
from truenorth.report.comparison_page import comparison_html
from truenorth.report.page import page_html

N = 120


@pytest.fixture(scope="module")
def solution():
    """Turns through north; one antenna left out for a while, one dead at the end, and some epochs empty."""
    baselines = make_baselines(N)
    enu_m = baselines[1].baseline_enu_m.copy()
    enu_m[30:50] += [0.12, -0.1, 0.05]
    baselines[1] = replace(baselines[1], baseline_enu_m=enu_m)
    for k, rows in ((0, slice(100, 105)), (1, slice(100, 105)), (2, slice(80, 105))):
        status = baselines[k].status.copy()
        status[rows] = Status.FLOAT
        baselines[k] = replace(baselines[k], status=status)
    return make_attitude(baselines=baselines, names=("aft", "fore", 'right, "new"', "left"))


@pytest.fixture(scope="module")
def comparison(solution):
    angles = true_angles(N)
    angles[60, 0] += 0.1  # A truth that makes one epoch wrong.
    heading = angles[:, 0]
    return compare(
        solution,
        {
            "time_ns": solution.time_ns,
            "heading_rad": heading,
            "pitch_rad": angles[:, 1],
            "roll_rad": angles[:, 2],
            "latitude_deg": 47.0 + 1e-5 * np.cumsum(np.cos(heading)),
            "longitude_deg": 15.0 + 1e-5 * np.cumsum(np.sin(heading)),
        },
    )


def test_csv_begins_with_the_columns_that_scripts_rely_on(solution, tmp_path):
    text = write_solution(solution, tmp_path / "attitude.csv").read_text()
    assert text.startswith(ATTITUDE_CONTRACT)
    rows = list(csv.DictReader(io.StringIO(text)))
    assert len(rows) == N
    assert rows[35]["excluded"] == 'right, "new"'
    assert rows[35]["n_antennas"] == "3"
    assert (rows[102]["status"], rows[102]["heading_deg"]) == ("none", "NaN")
    table = solution_columns(solution)
    np.testing.assert_allclose([float(row["roll_deg"]) for row in rows], table["roll_deg"], atol=6e-7)


def test_every_format_but_that_of_one_baseline_is_written(solution, tmp_path):
    for suffix in ("csv", "json", "parquet", "nc", "nmea"):
        assert write_solution(solution, tmp_path / f"attitude.{suffix}").stat().st_size > 1000
    with pytest.raises(ConfigError, match="one baseline, not the attitude of an array"):
        write_solution(solution, tmp_path / "attitude.pos")
    columns = json.loads((tmp_path / "attitude.json").read_text())["columns"]
    assert columns["heading_deg"][102] is None
    dataset = to_xarray(solution)
    np.testing.assert_allclose(
        np.sqrt(dataset["cov_deg2"][:, 2, 2]), solution_columns(solution)["roll_sd_deg"], rtol=1e-12
    )


def test_nmea_has_the_roll_and_says_nothing_without_attitude(solution, tmp_path):
    lines = write_solution(solution, tmp_path / "attitude.nmea").read_text().splitlines()
    roll_deg = solution_columns(solution)["roll_deg"]
    assert len(lines) == 3 * N
    fields = lines[3 * 20].split(",")
    assert float(fields[4]) == pytest.approx(roll_deg[20], abs=6e-4)
    assert re.fullmatch(r"\$PASHR,\d{6}\.\d{3},,T,,,,,,,0,0\*[0-9A-F]{2}", lines[3 * 102])


def test_the_summary_counts_antennas_and_reasons(solution):
    summary = summarize_solution(solution)
    json.dumps(summary, allow_nan=False)
    assert summary["epochs_by_status"] == {"fixed": N - 5, "held": 0, "float": 0, "none": 5}
    assert summary["antennas"]['right, "new"']["excluded_epochs"] == 20
    assert summary["antennas"]["left"]["used_epochs"] == N - 25
    text = summary_text(summary)
    assert "left out in 20" in text
    assert re.search(r"roll +-?\d+\.\d+ deg", text)


def test_an_epoch_is_explained_with_its_baselines(solution):
    text = explain_epoch(solution, 35)
    assert "FAILED" in text
    assert 'aft to right, "new": left out' in text
    assert "aft to fore: used" in text
    assert "heading" in text
    assert "none: " in explain_epoch(solution, 102)


def test_figures_of_attitude_and_comparison(solution, comparison, tmp_path):
    page = figure_page(solution)
    labels = [ax.get_ylabel() for ax in page.axes]
    assert labels[:3] == ["heading, deg", "pitch, deg", "roll, deg"]
    assert {"satellites used", "antennas used"} <= set(labels)
    page = figure_page(comparison)
    errors = [ax for ax in page.axes if "error, deg" in ax.get_ylabel()]
    assert len(errors) == 3
    for k, ax in enumerate(errors):
        low, high = ax.get_ylim()
        # Zero in the middle, and no accepted error outside.
        assert low == -high
        assert np.nanmax(np.abs(np.degrees(comparison.error_rad[:, k]))) < high
    for name in ("attitude.png", "attitude.html"):
        assert write_figure(solution, tmp_path / name).stat().st_size > 20_000
    assert write_figure(comparison, tmp_path / "errors.svg").stat().st_size > 20_000


def test_the_page_of_an_attitude_says_what_happened(solution):
    text = page_html(solution)
    assert "Attitude of the platform" in text
    assert "left out in 20 epochs" in text
    assert "contradicts the other antennas" in text
    assert 'right, "new"' not in text.split("<script", 1)[0].split("<h2>Verdict", 1)[1]  # escaped


def test_the_page_of_a_comparison_answers_first(solution, comparison):
    text = comparison_html(
        comparison, solution=solution, title="A <drive>", rows=[("Time", "2 s")],
        places=[(int(solution.time_ns[50]), "under the bridge")],
    )  # fmt: skip
    head = text.split("<script", 1)[0]
    assert "A &lt;drive&gt;" in head
    assert "1 wrong" in head
    assert "95.8 %" in head
    assert "under the bridge" in text
    for title in ("Track", "Error of the roll", "Satellites and antennas"):
        assert f"<h2>{title}</h2>" in text
    assert text.count("</html>") == 1
    assert "http://" not in re.sub(r"http://www\.w3\.org[^\"']*", "", head)


def test_a_comparison_without_positions_or_accepted_epochs_has_a_page(solution):
    nothing = replace(solution, status=np.zeros(N, np.uint8), heading_rad=np.full(N, np.nan))
    angles = true_angles(N)
    empty = compare(nothing, {"time_ns": solution.time_ns, "heading_rad": angles[:, 0]})
    text = comparison_html(empty)
    assert "0.0 %" in text
    assert "<h2>Track</h2>" not in text
    figure_page(empty)
    assert "unknown" in str(empty)


def test_a_long_run_is_thinned_but_its_wrong_epochs_stay(comparison):
    from truenorth.report.style import thin_epochs

    thinned, step = thin_epochs(comparison, 30, keep=comparison.is_wrong)
    assert step == 4
    assert set(comparison.time_ns[comparison.is_wrong]) <= set(thinned.time_ns)
    assert 30 <= thinned.n_epochs <= 31
    assert len(thinned.error_rad) == len(thinned.latitude_deg) == thinned.n_epochs
    same, step = thin_epochs(comparison, 1000)
    assert same is comparison
    assert step == 1


def test_an_array_session_repeats_itself(tmp_path):
    text = "[platform]\n" + "".join(
        f'[[platform.antennas]]\nname = "{name}"\nobservations = "{name}.obs"\nposition_body_m = {place}\n'
        for name, place in (("a", [0.0, 0.0, 0.0]), ("b", [1.0, 0.0, 0.0]), ("c", [0.0, 1.0, 0.0]))
    )
    session = Session.from_toml(text)
    assert Session.from_toml(session.to_toml()) == session
