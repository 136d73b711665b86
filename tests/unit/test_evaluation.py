"""Solutions against references: alignment, wrapped errors, statistics, wrong epochs, consistency."""

import json
from dataclasses import replace

import numpy as np
import pytest

from synthetic_array import BODY_M, make_attitude, make_baselines, true_angles
from truenorth.cli.evaluate import evaluate_files, parse_vector
from truenorth.errors import ConfigError, FormatError, NoSolutionError, Status
from truenorth.evaluation import compare
from truenorth.evaluation.comparison import body_vector_beside
from truenorth.evaluation.statistics import consistency_of, effective_samples, error_statistics
from truenorth.formats import write_table
from truenorth.timescales import NS_PER_S


def truth_table(solution, *, every=1, offset_ns=0):
    """Truth at the epochs of a solution, or at fewer."""
    angles = np.degrees(true_angles(solution.n_epochs))[::every]
    return {
        "time_ns": solution.time_ns[::every] + offset_ns,
        "heading_deg": angles[:, 0],
        "pitch_deg": angles[:, 1],
        "roll_deg": angles[:, 2],
    }


@pytest.fixture(scope="module")
def solution():
    return make_attitude(400, length_sd_m=0.0)


def test_errors_are_solution_less_reference(solution):
    truth = truth_table(solution)
    truth["heading_deg"] = truth["heading_deg"] - 0.5
    comparison = compare(solution, truth)
    heading = comparison.statistics["accepted"]["heading"]
    assert heading.n == 400
    # The scatter is 0.07 deg, of the mean of 400 epochs 0.004 deg.
    assert heading.mean == pytest.approx(0.5, abs=0.02)
    assert heading.rms == pytest.approx(np.hypot(heading.mean, heading.sd), rel=1e-2)
    assert comparison.availability == 1.0
    assert comparison.longest_outage_s == 0.0


def test_errors_are_small_across_north(solution):
    """The heading passes north; no error may be taken the long way around."""
    comparison = compare(solution, truth_table(solution))
    assert np.max(np.abs(comparison.error_rad)) < np.radians(2.0)


def test_the_reference_is_interpolated_the_short_way_around(solution):
    comparison = compare(solution, truth_table(solution, every=2))
    assert comparison.n_epochs == 399  # The last truth is at epoch 398.
    # Sagitta of the angles' sinusoids between truths two seconds apart: below 0.001 rad.
    assert np.max(np.abs(comparison.error_rad[:, 0])) < np.radians(1.0)


def test_the_reference_is_not_interpolated_over_gaps(solution):
    truth = {name: np.delete(values, np.s_[100:200]) for name, values in truth_table(solution).items()}
    comparison = compare(solution, truth)
    assert comparison.n_epochs == 300
    assert compare(solution, truth, max_gap_s=200.0).n_epochs == 400


def test_consistency_of_honest_and_of_boasting_covariances(solution):
    truth = truth_table(solution)
    assert compare(solution, truth).consistency.verdict == "consistent"
    boasting = compare(replace(solution, cov_rad2=solution.cov_rad2 / 4.0), truth)
    assert boasting.consistency.verdict == "optimistic"
    assert boasting.consistency.nees == pytest.approx(4.0, rel=0.15)
    assert "2.0" in boasting.consistency_sentence()
    timid = compare(replace(solution, cov_rad2=solution.cov_rad2 * 4.0), truth)
    assert timid.consistency.verdict == "pessimistic"


def test_wrong_epochs_by_sigma_and_by_degrees(solution):
    heading = solution.heading_rad.copy()
    heading[[7, 70]] += np.radians(2.0)
    wrong = replace(solution, heading_rad=heading)
    comparison = compare(wrong, truth_table(solution))
    np.testing.assert_array_equal(np.flatnonzero(comparison.is_wrong), [7, 70])
    assert comparison.wrong_fraction == pytest.approx(2 / 400)
    assert not compare(wrong, truth_table(solution), wrong_sd=100.0).is_wrong.any()
    assert compare(wrong, truth_table(solution), wrong_sd=100.0, wrong_deg=1.5).is_wrong.sum() >= 2


def test_availability_counts_what_the_reference_has(solution):
    rows = np.r_[0:100, 150:400]
    part = replace(
        solution,
        **{
            name: getattr(solution, name)[rows]
            for name in ("time_ns", "status", "heading_rad", "pitch_rad", "roll_rad", "cov_rad2")
        },
    )
    status = part.status.copy()
    status[:10] = Status.NONE
    comparison = compare(replace(part, status=status), truth_table(solution))
    assert comparison.expected_epochs == 400
    assert comparison.availability == pytest.approx(340 / 400)
    assert comparison.longest_outage_s == 50.0


def test_a_missing_roll_counts_as_absent():
    baselines = make_baselines(60)
    for k in (1, 2):
        status = np.full(60, Status.FLOAT, np.uint8)
        baselines[k] = replace(baselines[k], status=status)
    comparison = compare(make_attitude(baselines=baselines), truth_table(baselines[0]))
    assert comparison.statistics["accepted"]["roll"].n == 0
    assert comparison.statistics["accepted"]["heading"].n == 60
    np.testing.assert_array_equal(comparison.dof, 2)
    assert np.isfinite(comparison.nees).all()
    json.dumps(comparison.to_dict(), allow_nan=False)


def test_a_baseline_is_compared_as_the_vector_that_it_is():
    baselines = make_baselines(200)
    truth = truth_table(baselines[0])
    comparison = compare(baselines[1], truth, baseline_body_m=BODY_M[2])
    assert comparison.angles == ("azimuth", "elevation")
    # 4.2 mm over 1.8 m, and twice that upwards.
    assert comparison.statistics["accepted"]["azimuth"].sd == pytest.approx(0.14, abs=0.05)
    assert comparison.consistency.verdict == "consistent"
    ahead = compare(baselines[0], truth)
    assert ahead.consistency.verdict == "consistent"
    # Not straight ahead at all.
    assert abs(compare(baselines[1], truth).statistics["accepted"]["azimuth"].mean) > 30.0


def test_files_give_what_objects_give(solution, tmp_path):
    truth = truth_table(solution)
    write_table(tmp_path / "truth.csv", truth)
    inside = compare(solution, truth)
    for name in ("result.csv", "result.parquet"):
        outside = compare(solution.write(tmp_path / name), tmp_path / "truth.csv")
        # Six decimals of a degree.
        np.testing.assert_allclose(outside.error_rad, inside.error_rad, atol=2e-8)
        np.testing.assert_allclose(outside.nees, inside.nees, rtol=1e-3)
        np.testing.assert_array_equal(outside.status, inside.status)
    baseline = make_baselines(60)[1]
    inside = compare(baseline, truth, baseline_body_m=BODY_M[2])
    outside = compare(baseline.write(tmp_path / "baseline.csv"), truth, baseline_body_m=BODY_M[2])
    np.testing.assert_allclose(outside.nees, inside.nees, rtol=0.05)


def test_another_solution_may_be_the_reference(solution):
    comparison = compare(solution, solution)
    assert comparison.statistics["accepted"]["roll"].max == 0.0


def test_radians_of_a_simulation_in_memory(solution):
    truth = truth_table(solution)
    in_memory = {"time_ns": truth["time_ns"]}
    for name in ("heading", "pitch", "roll"):
        in_memory[f"{name}_rad"] = np.radians(truth[f"{name}_deg"])
    np.testing.assert_allclose(
        compare(solution, in_memory).error_rad, compare(solution, truth).error_rad, atol=1e-12
    )


def test_says_what_is_wrong_with_its_input(solution, tmp_path):
    truth = truth_table(solution)
    with pytest.raises(NoSolutionError, match="no time in common"):
        compare(solution, {**truth, "time_ns": truth["time_ns"] + 86400 * NS_PER_S})
    with pytest.raises(FormatError, match="neither `heading_deg` nor `azimuth_deg`"):
        compare(solution, {"time_ns": truth["time_ns"]})
    with pytest.raises(FormatError, match="neither `time_ns` nor `time_gpst`"):
        compare(solution, {"heading_deg": truth["heading_deg"]})
    with pytest.raises(FormatError, match="do not rise"):
        compare(solution, {name: values[::-1] for name, values in truth.items()})
    with pytest.raises(FormatError, match="no such file"):
        compare(tmp_path / "absent.csv", truth)
    with pytest.raises(ConfigError, match="`wrong_sd` is 0"):
        compare(solution, truth, wrong_sd=0.0)
    with pytest.raises(ConfigError, match="cannot be compared"):
        compare(solution, make_baselines(10)[0])


def test_statistics_of_known_errors():
    found = error_statistics(np.array([1.0, -1.0, 3.0, np.nan, -3.0]))
    assert (found.n, found.mean, found.max) == (4, 0.0, 3.0)
    assert found.rms == pytest.approx(np.sqrt(5.0))
    assert found.sd == pytest.approx(np.sqrt(20.0 / 3.0))
    assert error_statistics(np.array([np.nan])).n == 0


def test_effective_samples_of_white_and_of_correlated_noise():
    rng = np.random.default_rng(1)
    white = rng.standard_normal(20_000)
    assert effective_samples(white) == pytest.approx(20_000, rel=0.1)
    correlated = np.empty_like(white)
    correlated[0] = white[0]
    for k in range(1, len(white)):
        correlated[k] = 0.9 * correlated[k - 1] + white[k]
    # (1 - 0.9) / (1 + 0.9) of the samples.
    assert effective_samples(correlated) == pytest.approx(20_000 / 19.0, rel=0.3)
    assert effective_samples(np.ones(10)) == 1.0


def test_consistency_without_epochs_is_unknown():
    found = consistency_of(np.array([np.nan]), np.array([3]))
    assert found.verdict == "unknown"


def test_the_command_prints_the_table_or_json(solution, tmp_path, capsys):
    write_table(tmp_path / "truth.csv", truth_table(solution))
    result = solution.write(tmp_path / "result.csv")
    evaluate_files(result, tmp_path / "truth.csv")
    text = capsys.readouterr().out
    assert text.startswith("available   100.0 %")
    assert "accepted  heading" in text
    evaluate_files(result, tmp_path / "truth.csv", as_json=True)
    table = json.loads(capsys.readouterr().out)
    assert table["errors_deg"]["accepted"]["roll"]["n"] == 400
    assert table["consistency"]["verdict"] == "consistent"


def test_the_body_vector_of_a_baseline_is_beside_its_result(tmp_path):
    assert body_vector_beside(tmp_path / "result.csv") is None
    (tmp_path / "result.settings.toml").write_text(
        '[platform]\n[[platform.antennas]]\nname = "a"\nobservations = "a.obs"\n'
        'position_body_m = [0.5, 0.0, 0.0]\n[[platform.antennas]]\nname = "b"\nobservations = "b.obs"\n'
        "position_body_m = [0.5, 1.5, 0.25]\n"
    )
    assert body_vector_beside(tmp_path / "result.csv") == (0.0, 1.5, 0.25)
    assert parse_vector("1,2,-3.5") == (1.0, 2.0, -3.5)
    with pytest.raises(ConfigError, match="three numbers"):
        parse_vector("1,2")
