"""Words and figures: what is drawn is what was solved."""

import html.parser
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from synthetic_solution import make_solution
from truenorth.errors import ConfigError, Status
from truenorth.export import summarize_solution
from truenorth.report import check_figure_path, explain_epoch, find_epoch, summary_text, write_figure
from truenorth.report.figures import (
    figure_page,
    plot_elevation,
    plot_heading,
    plot_length_residual,
    plot_residuals,
    plot_satellites_dop,
    plot_sky,
)
from truenorth.report.page import page_html
from truenorth.report.style import STATUS_COLORS, azimuth_for_plot, caption, runs_of_epochs


@pytest.fixture(scope="module")
def solution():
    return make_solution()


def test_summary_in_words(solution):
    text = summary_text(summarize_solution(solution))
    assert "120, 87.5 % accepted (95 fixed, 10 held, 10 float, 5 none)" in text
    assert "they agree" in text
    assert "10  ratio_test: the second-best candidate is too close to the best" in text
    assert "warning     no GLONASS channel for R07" in text


def test_summary_suspects_a_wrong_length():
    wrong = make_solution(settings={"length_m": 1.19, "length_sd_m": 0.003})
    text = summary_text(summarize_solution(wrong))
    assert "DISAGREE" in text
    assert "suspect the declared length" in text


def test_story_of_an_epoch_gives_numbers_against_limits(solution):
    story = explain_epoch(solution, find_epoch(solution, "2024-06-24T08:20:03"))
    assert "float: the second-best candidate is too close to the best" in story
    assert "success probability  0.600000 against at least 0.99: FAILED" in story
    assert "30.00 against at most 40.00: passed" in story
    assert "slip G05 1C: phase jumped by 1.2 cycles (1.2 against 0.1)" in story
    fixed = explain_epoch(solution, 60)
    for name in ("G02", "E11", "C22", "reference"):
        assert name in fixed


def test_story_of_an_epoch_without_solution(solution):
    story = explain_epoch(solution, solution.n_epochs - 1)
    assert "none: fewer common satellites than the unknowns need" in story
    assert "azimuth  " not in story


@pytest.mark.parametrize(("text", "k"), [("08:20:00", 0), ("08:21:00.2", 60), ("2024-06-24 08:20:59.8", 60)])
def test_epochs_are_found_by_time(solution, text, k):
    assert find_epoch(solution, text) == k


@pytest.mark.parametrize("text", ["yesterday", "12:00:00", "2024-06-25T08:20:00", "", "08:99"])
def test_times_without_epoch_are_refused(solution, text):
    with pytest.raises(ConfigError, match=r"epoch|is not a time"):
        find_epoch(solution, text)


def plotted(ax, label):
    (line,) = [line for line in ax.get_lines() if line.get_label() == label]
    return line


def test_heading_is_drawn_by_status(solution):
    ax = plot_heading(solution)
    assert ax.get_ylabel() == "azimuth, deg"
    for status in (Status.FIXED, Status.HELD, Status.FLOAT):
        line = plotted(ax, status.label)
        assert line.get_color() == STATUS_COLORS[status]
        wanted = np.degrees(solution.azimuth_rad[solution.status == status])
        off = (np.asarray(line.get_ydata()) - wanted + 180.0) % 360.0 - 180.0
        np.testing.assert_allclose(off, 0.0, atol=1e-9)
    assert len(plotted(ax, "none").get_xdata()) == 5


def test_heading_through_north_is_not_torn_apart():
    azimuth_deg, is_whole_circle = azimuth_for_plot(make_solution(41, azimuth_deg=350.0, rate_deg=0.5))
    assert not is_whole_circle
    assert np.ptp(azimuth_deg[10:-5]) < 30.0


def test_heading_is_broken_at_the_wrap_on_a_whole_circle():
    turning = make_solution(200, azimuth_deg=0.0, rate_deg=5.0)
    azimuth_deg, is_whole_circle = azimuth_for_plot(turning)
    assert is_whole_circle
    runs = runs_of_epochs(turning.time_ns, np.where(turning.is_accepted, azimuth_deg, np.nan), jump=180.0)
    # Epochs 10 to 194 at 5 degrees a second pass north at 72 and 144.
    assert len(runs) == 3
    assert all(np.all(np.abs(np.diff(azimuth_deg[run])) < 180.0) for run in runs)


def test_band_is_three_sigma(solution):
    ax = plot_elevation(solution)
    (band,) = ax.collections
    vertices = band.get_paths()[0].vertices
    elevation_deg, sd_deg = np.degrees(solution.elevation_rad), np.degrees(solution.elevation_sd_rad)
    accepted = solution.is_accepted
    assert vertices[:, 1].max() == pytest.approx(np.max((elevation_deg + 3.0 * sd_deg)[accepted]))
    assert vertices[:, 1].min() == pytest.approx(np.min((elevation_deg - 3.0 * sd_deg)[accepted]))


def test_a_gap_breaks_the_band():
    solution = make_solution(60)
    solution.time_ns[40:] += 100_000_000_000
    assert len(plot_elevation(solution).collections) == 2


def test_length_is_drawn_against_the_declared_one(solution):
    ax = plot_length_residual(solution)
    assert ax.get_ylabel() == "length less declared, mm"
    wanted_mm = 1e3 * (solution.length_m - 0.99)[solution.status == Status.FIXED]
    np.testing.assert_allclose(plotted(ax, "fixed").get_ydata(), wanted_mm)
    assert plot_length_residual(make_solution(settings={})).get_ylabel() == "length less median, mm"
    flying = make_solution(30, settings={})
    flying.length_m[:] += np.arange(30)
    ax = plot_length_residual(flying)
    assert ax.get_ylabel() == "length, m"
    np.testing.assert_allclose(plotted(ax, "fixed").get_ydata(), flying.length_m)
    assert len(ax.collections) == 1  # a length in metres or millimetres may move by more than 180


def test_residuals_have_a_column_for_each_satellite(solution):
    ax = plot_residuals(solution)
    names = [label.get_text() for label in ax.get_xticklabels()]
    assert names == ["G02", "G05", "G12", "G25", "E03", "E11", "C19", "C22"]
    assert len(plotted(ax, "GPS").get_xdata()) == 4 * np.count_nonzero(solution.is_accepted)


def test_sky_puts_north_up_and_the_zenith_in_the_middle(solution):
    ax = plot_sky(solution)
    assert ax.get_theta_offset() == pytest.approx(np.pi / 2)
    assert ax.get_theta_direction() == -1
    last = ax.get_lines()[1]  # G02: track, then its last place
    row = np.flatnonzero(solution.residual_sat == 2)[-1]
    assert last.get_xdata()[0] == pytest.approx(solution.residual_azimuth_rad[row])
    assert last.get_ydata()[0] == pytest.approx(90.0 - np.degrees(solution.residual_elevation_rad[row]))


def test_satellites_and_dilution(solution):
    ax = plot_satellites_dop(solution)
    np.testing.assert_array_equal(plotted(ax, "satellites").get_ydata(), solution.n_sats)


def test_figures_draw_into_given_axes(solution):
    from matplotlib.figure import Figure

    given = Figure().add_subplot()
    for plot in (plot_heading, plot_elevation, plot_length_residual, plot_residuals, plot_satellites_dop):
        assert plot(solution, ax=given) is given


def test_caption_names_data_epochs_and_fix_rate(solution):
    text = caption(solution)
    assert "base.obs to rover.obs" in text
    assert "120 epochs, 87.5 % accepted" in text
    # Broken into lines that fit the page.
    assert figure_page(solution)._supxlabel.get_text().replace("\n", " ") == text


@pytest.mark.parametrize(
    ("suffix", "n_epochs"),
    [("png", 0), ("png", 1), ("html", 0), ("html", 1), ("html", 60), ("pdf", 60), ("svg", 60)],
)
def test_pages_of_any_length_are_written(tmp_path, suffix, n_epochs):
    path = write_figure(make_solution(n_epochs), tmp_path / f"page.{suffix}")
    assert path.stat().st_size > 5_000


def test_pages_of_a_run_without_any_solution_are_written(tmp_path):
    nothing = {
        f"residual_{name}": np.zeros(0) for name in ("m", "elevation_rad", "azimuth_rad", "integer_cyc")
    }
    nothing |= {f"residual_{name}": np.zeros(0, dtype=np.int64) for name in ("epoch", "sat", "signal")}
    solution = make_solution(50, residual_is_reference=np.zeros(0, dtype=bool), **nothing)
    solution.status[:] = Status.NONE
    for values in (solution.azimuth_rad, solution.elevation_rad, solution.length_m, solution.pdop):
        values[:] = np.nan
    for suffix in ("png", "html"):
        write_figure(solution, tmp_path / f"page.{suffix}")


def test_page_needs_nothing_else_and_puts_the_verdict_first(solution):
    text = page_html(solution)
    outside = []

    class Links(html.parser.HTMLParser):
        def handle_starttag(self, tag, attrs):
            outside.extend(value for name, value in attrs if name in ("src", "href"))

    Links().feed(text)
    assert outside == []
    places = [text.index(f"<h2>{word}") for word in ("Verdict", "Heading", "Sky", "Provenance", "Settings")]
    assert places == sorted(places)
    assert "87.5 % of 120 epochs" in text
    assert "&quot;length_m&quot;: 0.99" in text or '"length_m": 0.99' in text


def test_page_escapes_what_files_say():
    text = page_html(make_solution(5, warnings=("<script>alert(1)</script>",)))
    assert "<script>alert(1)" not in text


@pytest.mark.parametrize("name", ["page.xyz", "page", "absent/page.png"])
def test_a_page_that_cannot_be_written_is_refused(tmp_path, name):
    with pytest.raises(ConfigError):
        check_figure_path(tmp_path / name)


def test_figures_leave_the_global_state_of_matplotlib_alone(tmp_path):
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); from synthetic_solution import make_solution\n"
        "from truenorth.report import write_figure; write_figure(make_solution(50), sys.argv[2])\n"
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    tests = str(Path(__file__).parent.parent)
    subprocess.run([sys.executable, "-c", code, tests, str(tmp_path / "page.png")], check=True)


def test_rejected_candidates_are_told_and_not_drawn():
    solution = make_solution(60)
    rejected = int(np.flatnonzero(solution.is_accepted)[0])
    solution.status[rejected] = Status.FLOAT
    length_m = solution.length_m.copy()
    length_m[rejected] = 1.09  # what the length test saw: 10 cm too long
    told = replace(solution, candidate_length_m=length_m, candidate_length_sd_m=np.full(60, 0.004))
    story = explain_epoch(told, rejected)
    # Four joint standard deviations of 3 and 4 mm are 20 mm.
    assert "+100.0 mm (1.0900 measured, 0.9900 declared) against at most 20.0 mm: FAILED" in story
    assert "G02" in story
    drawn = plotted(plot_residuals(told), "GPS").get_xdata()
    assert len(drawn) == 4 * np.count_nonzero(told.is_accepted)
    assert len(drawn) == 4 * (np.count_nonzero(solution.status >= Status.HELD))


def test_a_single_epoch_between_gaps_keeps_its_band():
    solution = make_solution(30)
    solution.time_ns[15:] += 100_000_000_000
    solution.time_ns[16:] += 100_000_000_000
    assert len(plot_elevation(solution).collections) == 3
