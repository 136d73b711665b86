"""One recording at several rates: thinning, obstructions, gaps, and the study as a whole."""

import dataclasses

import numpy as np
import pytest

import truenorth as tn
from simulated_sessions import pair
from truenorth.errors import ConfigError, NoSolutionError, Status
from truenorth.evaluation import compare_rates
from truenorth.evaluation.decimation import decimate, point_spacing_m
from truenorth.observations import LLI_SLIP
from truenorth.timescales import NS_PER_S


@pytest.mark.parametrize(
    ("speed_kmh", "rate_hz", "wanted_m"),
    # Landfahrer 2009, table 6.2, which cuts where others round.
    [(60, 1, 16.66), (60, 10, 1.66), (60, 20, 0.83), (30, 1, 8.33), (30, 10, 0.83), (30, 20, 0.41)],
)
def test_published_point_spacings(speed_kmh, rate_hz, wanted_m):
    assert np.trunc(100.0 * point_spacing_m(speed_kmh / 3.6, rate_hz)) / 100.0 == pytest.approx(wanted_m)


@pytest.fixture(scope="module")
def recording():
    """Two antennas driving straight on, twenty epochs a second, all satellites gone for four seconds."""
    scenario = pair(
        duration_s=24.0,
        interval_s=0.05,
        motion={
            "kind": "waypoints", "points_m": [[0.0, 0.0], [600.0, 0.0]], "speed_mps": 15.0,
            "acceleration_mps2": 5.0, "wait_s": 2.0,
        },
        sky={"kind": "nominal", "systems": "GE"},
        visibility={"elevation_mask_deg": 15.0, "outages": [{"start_s": 10.02, "duration_s": 4.0}]},
        receiver={"signals": {"G": ["1C", "2W"], "E": ["1C", "7Q"]}},
        solve={"systems": "GE", "bands": ["L1", "L2"]},
    )  # fmt: skip
    return tn.simulate(scenario)


def test_thinned_epochs_lie_on_the_grid(recording):
    full = recording.observations["aft"]
    for rate_hz in (1.0, 2.0, 10.0):
        thin = decimate(full, rate_hz)
        step_ns = round(NS_PER_S / rate_hz)
        assert np.all(thin.time_ns % step_ns == 0)
        whole = full.time_ns[full.time_ns % step_ns == 0]
        np.testing.assert_array_equal(thin.time_ns, whole)
        row = full.epoch_start[np.searchsorted(full.time_ns, thin.time_ns[3])]
        assert thin.code_m[thin.epoch_start[3]] == full.code_m[row]
    assert decimate(full, 20.0) is full
    # A rate that does not divide the recorded one takes the nearest epochs, each once.
    uneven = np.diff(decimate(full, 3.0).time_ns) / NS_PER_S
    assert set(uneven.round(2)) == {0.3, 0.35}


def test_a_loss_of_lock_between_kept_epochs_is_told_at_the_next(recording):
    full = recording.observations["aft"]
    epoch = 47  # between seconds 2 and 3
    row = int(full.epoch_start[epoch])
    lli = np.zeros_like(full.lli)
    lli[row] = LLI_SLIP
    slipped = dataclasses.replace(full, lli=lli)
    thin = decimate(slipped, 1.0)
    flagged = np.flatnonzero(thin.lli & LLI_SLIP)
    assert len(flagged) == 1
    assert thin.time_ns[thin.epoch_of_row[flagged[0]]] == full.time_ns[0] + 3 * NS_PER_S
    assert thin.sat[flagged[0]] == full.sat[row]
    assert thin.signal[flagged[0]] == full.signal[row]
    # One in a kept epoch stays where it is, and none is made up.
    lli[:] = 0
    lli[full.epoch_start[40]] = LLI_SLIP
    thin = decimate(dataclasses.replace(full, lli=lli), 1.0)
    assert np.flatnonzero(thin.lli).tolist() == [thin.epoch_start[2]]
    assert not np.any(decimate(dataclasses.replace(full, lli=np.zeros_like(lli)), 1.0).lli)


def test_impossible_rates_are_refused(recording):
    full = recording.observations["aft"]
    with pytest.raises(ConfigError, match="the recording has 20 Hz; give no more"):
        decimate(full, 50.0)
    with pytest.raises(ConfigError, match="positive rates"):
        decimate(full, 0.0)
    with pytest.raises(ConfigError, match="no rate is given"):
        compare_rates(recording, [])
    with pytest.raises(NoSolutionError, match="fewer than two epochs"):
        decimate(full.select_epochs(slice(0, 1)), 1.0)


@pytest.mark.jit
def test_a_study_counts_the_outage_alike_at_every_rate(recording, tmp_path):
    study = compare_rates(recording, [1, 4, 20], recording.truth)
    assert [result.rate_hz for result in study.results] == [1.0, 4.0, 20.0]
    assert study.recorded_hz == 20.0
    (outage,) = study.obstructions
    start_ns = study.time_ns[0]
    assert outage.fewest == 0
    assert (outage.start_ns - start_ns) / NS_PER_S == pytest.approx(10.05)
    # Gone for four seconds; phases come back three seconds after the signals.
    assert 4.0 <= outage.duration_s <= 8.0
    for result in study.results:
        interval_s = 1.0 / result.rate_hz
        assert result.n_expected == round(24.0 * result.rate_hz) + 1
        assert result.solution.n_epochs <= result.n_expected
        # Open sky and dual-frequency phases: accepted at the first epoch of that rate.
        assert 0.0 <= result.refix_s[0] < interval_s + 1e-9
        assert len(result.gaps_s) == 1
        assert result.gaps_s[0] == pytest.approx(outage.duration_s, abs=interval_s)
        shares = sum(result.status_share(status) for status in Status)
        assert shares == pytest.approx(1.0)
        assert sum(result.quality_share(k) for k in range(7)) == pytest.approx(1.0)
        assert result.availability == pytest.approx(1.0 - outage.duration_s / 24.0, abs=2.0 / 24.0)
        assert result.spacing_m == pytest.approx(15.0 * interval_s, rel=0.05)
        assert result.largest_spacing_m == pytest.approx(15.0 * outage.duration_s, rel=0.3)
        assert np.count_nonzero(result.comparison.is_wrong) == 0
        assert 0.0 < result.consistency < 1.2  # the emulated noise is below what the settings expect
        assert 0.5 < np.nanmedian(result.pdop) < 5.0
    # What is solved at the lower rate is what the higher one has at the same epochs, of the same satellites.
    slow, fast = study.results[0].solution, study.results[2].solution
    both = np.isin(fast.time_ns, slow.time_ns)
    np.testing.assert_array_equal(fast.n_sats[both], slow.n_sats)
    text = str(study)
    assert "time to re-fix, s, after 1 obstructions" in text
    assert "point spacing, m" in text

    from truenorth.export.planning import write_table
    from truenorth.report.files import save_figure
    from truenorth.report.planning_figures import rates_figure

    table = write_table(study.columns(), tmp_path / "rates.csv").read_text()
    assert table.startswith("rate_hz,epochs_expected")
    assert len(table.splitlines()) == 4
    refix = write_table(study.refix_columns(), tmp_path / "refix.parquet")
    import polars as pl

    assert pl.read_parquet(refix).columns[-1] == "refix_s_20hz"
    assert save_figure(rates_figure(study), tmp_path / "rates.svg").stat().st_size > 10_000
    assert study.to_dict()["rates"][2]["rate_hz"] == 20.0
