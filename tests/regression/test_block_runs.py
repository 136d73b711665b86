"""Runs that are solved in blocks of epochs: the numbers do not depend on where they are cut."""

import gzip
from dataclasses import fields

import numpy as np
import pytest

import truenorth as tn
from real_pairs import PAIRS, load
from truenorth.ambiguity import resolution
from truenorth.attitude import runs
from truenorth.errors import NoSolutionError
from truenorth.formats import open_observations
from truenorth.formats.rinex_obs import RinexObservationBlocks

AS_DECLARED = {"estimate": False, "phase_sd_m": 0.001, "phase_elevation_sd_m": 0.001}
"""Noise that needs no sample of epochs, so that every number must be the same."""

METHODS = {
    "constrained, one epoch": {"method": "constrained", "single_epoch": True},
    "constrained": {"method": "constrained"},
    "lambda": {"method": "lambda"},
    "filter": {"method": "filter"},
    "filter, bound": {"method": "filter", "glonass_ambiguities": "calibrated", "min_epochs_to_fix": 3},
}


def solve(data_dir, name, epochs=slice(None), **options):
    """Solution of a pair with its known length."""
    pair = PAIRS[name]
    base, rover, navigation = load(data_dir, name)
    if pair.length_m is not None:
        options = {"length_m": pair.length_m, "length_sd_m": pair.length_sd_m, **options}
    return tn.solve_baseline(base.select_epochs(epochs), rover.select_epochs(epochs), navigation, **options)


def assert_same(one, two, apart=("seconds",)):
    for field in fields(one):
        if field.name in apart:
            continue
        here, there = getattr(one, field.name), getattr(two, field.name)
        if isinstance(here, np.ndarray):
            assert here.dtype == there.dtype
            np.testing.assert_array_equal(here, there, err_msg=field.name)
        else:
            # As text, because NaN differs from itself.
            assert str(here) == str(there)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["rose", "long"])
def test_blocks_of_a_hundred_epochs_give_the_same_bits(data_dir, name, method):
    options = {**METHODS[method], "stochastic": AS_DECLARED}
    whole = solve(data_dir, name, **options)
    cut = solve(data_dir, name, block_epochs=100, **options)
    # The length is checked with a sample, which a long run positions apart from the rest.
    assert_same(whole, cut, ("seconds", "length_check"))
    assert whole.length_check["verdict"] == cut.length_check["verdict"]
    assert np.mean(whole.is_accepted) > 0.9


@pytest.mark.parametrize("method", METHODS)
def test_live_mode_gives_the_same_bits(data_dir, method):
    options = {**METHODS[method], "stochastic": AS_DECLARED}
    epochs = slice(100, 140)
    whole = solve(data_dir, "geodetic", epochs, **options)
    live = solve(data_dir, "geodetic", epochs, block_epochs=1, **options)
    assert_same(whole, live, ("seconds", "length_check"))


@pytest.mark.parametrize("method", ["constrained", "lambda", "filter", "lsast", "kalman"])
def test_slips_and_epochs_of_one_receiver_cross_the_borders(data_dir, method):
    # The rover has four times the epochs of the base, whose log is damaged. It begins 15 minutes earlier:
    # a long run starts its positions later, so their iteration ends some nanometres apart.
    options = {"method": method, "stochastic": {"estimate": False}}
    whole = solve(data_dir, "ublox_ubx", **options)
    for block_epochs in (1, 40) if method == "filter" else (40,):
        cut = solve(data_dir, "ublox_ubx", block_epochs=block_epochs, **options)
        assert cut.status.tolist() == whole.status.tolist()
        assert cut.reason.tolist() == whole.reason.tolist()
        np.testing.assert_array_equal(cut.residual_integer_cyc, whole.residual_integer_cyc)
        assert np.nanmax(np.abs(cut.baseline_enu_m - whole.baseline_enu_m)) < 1e-6
        found = [(event.time_ns, event.kind, event.satellite) for event in cut.events]
        assert found == [(event.time_ns, event.kind, event.satellite) for event in whole.events]
        assert found or method == "kalman"


@pytest.mark.parametrize("name", ["rose", "long", "geodetic"])
def test_the_noise_is_estimated_from_epochs_of_the_whole_run(data_dir, name, monkeypatch):
    # As many epochs in either case: a run in blocks does not know how many rows it has and takes the most.
    most = resolution.SAMPLE_EPOCHS[1]
    monkeypatch.setattr(resolution, "SAMPLE_EPOCHS", (most, most))
    whole = solve(data_dir, name, single_epoch=True)
    cut = solve(data_dir, name, single_epoch=True, block_epochs=100)
    for kind, factor in whole.inputs["variance_factors"].items():
        assert cut.inputs["variance_factors"][kind] == pytest.approx(factor, rel=1e-5)
    assert cut.status.tolist() == whole.status.tolist()
    # A factor that is off by 1e-5 moves the weighted mean of phases and length by micrometres at most.
    assert np.max(np.abs(cut.baseline_enu_m - whole.baseline_enu_m)) < 1e-6


def test_estimated_length_in_blocks(data_dir):
    whole = solve(data_dir, "geodetic", length_m=None, estimate_length=True)
    cut = solve(data_dir, "geodetic", length_m=None, estimate_length=True, block_epochs=100)
    assert cut.settings["length_m"] == pytest.approx(whole.settings["length_m"], abs=1e-5)
    assert cut.is_accepted.all()


@pytest.mark.parametrize("method", ["constrained", "filter"])
def test_a_wrong_length_is_refused_in_blocks(data_dir, method):
    whole = solve(data_dir, "geodetic", length_m=1.290, method=method)
    cut = solve(data_dir, "geodetic", length_m=1.290, method=method, block_epochs=100)
    assert not cut.is_accepted.any()
    assert cut.reason.tolist() == whole.reason.tolist()
    assert cut.length_check["verdict"] == "disagrees"
    assert any("suspect the declared length" in text for text in cut.warnings)


@pytest.mark.parametrize("direction", ["backward", "combined"])
def test_other_directions_take_the_whole_run(data_dir, direction):
    options = {"method": "filter", "direction": direction}
    assert_same(
        solve(data_dir, "geodetic", **options), solve(data_dir, "geodetic", block_epochs=50, **options)
    )


def test_long_files_are_read_in_blocks(data_dir, tmp_path, monkeypatch):
    pair = PAIRS["long"]
    folder = data_dir / pair.folder
    packed = [folder / pair.base, folder / pair.rover]
    plain = []
    for path in packed:
        plain.append(tmp_path / path.stem)
        plain[-1].write_bytes(gzip.decompress(path.read_bytes()))
    options = {"length_m": pair.length_m, "length_sd_m": pair.length_sd_m, "single_epoch": True}
    navigation = folder / pair.navigation[0]
    whole = tn.solve_baseline(*packed, navigation, **options)
    monkeypatch.setattr(runs, "LONG_TEXT_BYTES", 1e6)
    assert isinstance(runs.open_receiver(packed[0]), RinexObservationBlocks)
    assert isinstance(runs.open_receiver(plain[0]), RinexObservationBlocks)
    monkeypatch.setattr(runs, "BLOCK_ROWS", 30_000)
    seen = []
    for files in (packed, plain, [open_observations(path) for path in packed]):
        seen.clear()
        cut = tn.solve_baseline(
            *files, navigation, progress=lambda done, total: seen.append((done, total)), **options
        )
        assert cut.status.tolist() == whole.status.tolist()
        assert np.max(np.abs(cut.baseline_enu_m - whole.baseline_enu_m)) < 1e-6
        assert cut.inputs["base"] == {**whole.inputs["base"], "path": cut.inputs["base"]["path"]}
        assert len(seen) >= 3
        assert all(total == 3600 for _, total in seen)
        assert cut.seconds["read"] > 0.0


@pytest.mark.parametrize("block_epochs", [None, 60])
def test_residuals_are_thinned_on_request(data_dir, block_epochs):
    full = solve(data_dir, "geodetic", single_epoch=True, block_epochs=block_epochs)
    rows = len(full.residual_m)
    thin = solve(data_dir, "geodetic", single_epoch=True, block_epochs=block_epochs, residual_rows=rows // 3)
    assert len(thin.residual_m) <= rows // 3
    keep = full.residual_epoch % 4 == 3
    for name in ("epoch", "sat", "signal", "m", "elevation_rad", "integer_cyc", "is_reference"):
        np.testing.assert_array_equal(
            getattr(thin, f"residual_{name}"), getattr(full, f"residual_{name}")[keep]
        )
    np.testing.assert_array_equal(thin.baseline_enu_m, full.baseline_enu_m)
    assert any("one epoch in 4" in text for text in thin.warnings)
    assert not any("residual" in text for text in full.warnings)
    none = solve(data_dir, "geodetic", slice(0, 20), block_epochs=block_epochs, residual_rows=0)
    assert len(none.residual_m) == 0
    assert (none.n_sats > 0).all()
    assert none.warnings == ()


def test_an_outage_longer_than_an_arc_begins_anew(data_dir):
    base, rover, navigation = load(data_dir, "geodetic")
    # The rover is away for 100 s, while the base goes on.
    rover = rover.select_epochs(np.r_[0:100, 200:301])
    options = {"length_m": 0.990, "method": "filter", "stochastic": AS_DECLARED}
    whole = tn.solve_baseline(base, rover, navigation, **options)
    cut = tn.solve_baseline(base, rover, navigation, block_epochs=64, **options)
    assert cut.status.tolist() == whole.status.tolist()
    assert np.nanmax(np.abs(cut.baseline_enu_m - whole.baseline_enu_m)) < 1e-6


def test_receivers_with_nothing_in_common(data_dir):
    base, rover, navigation = load(data_dir, "geodetic")
    with pytest.raises(NoSolutionError, match="could not pair the two receivers"):
        tn.solve_baseline(
            base.select_epochs(slice(0, 100)),
            rover.select_epochs(slice(150, 200)),
            navigation,
            block_epochs=10,
        )
    with pytest.raises(NoSolutionError, match="no common signal"):
        tn.solve_baseline(base, rover, navigation, systems="I", block_epochs=10)
    nothing = base.select_epochs(slice(0, 0))
    with pytest.raises(NoSolutionError, match="holds no epochs"):
        tn.solve_baseline(nothing, rover, navigation, block_epochs=10)
