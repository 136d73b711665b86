"""A declared length that is wrong must never yield an accepted baseline where the data can refute it."""

import pytest

import truenorth
from truenorth.errors import Reason


@pytest.fixture(scope="module")
def pair(data_dir):
    folder = data_dir / "pair_1m_geodetic"
    return (
        truenorth.read_observations(folder / "base.obs.gz"),
        truenorth.read_observations(folder / "rover.obs.gz"),
        truenorth.read_navigation(folder / "base.nav.gz"),
    )


@pytest.mark.parametrize("method", ["constrained", "filter"])
@pytest.mark.parametrize("single_epoch", [False, True])
@pytest.mark.parametrize("length_m", [0.79, 1.19])
def test_length_wrong_by_20_cm_is_refused_and_named(pair, length_m, single_epoch, method):
    # GPS L1 only: wrong integers of the wrong length win for minutes and pass every test of an epoch.
    solution = truenorth.solve_baseline(
        *pair, length_m=length_m, systems="G", bands=("L1",), single_epoch=single_epoch, method=method
    )
    assert not solution.is_accepted.any()
    assert Reason.LENGTH_TEST in solution.reason_counts()
    assert any("suspect the declared length" in text for text in solution.warnings)
    # The surveyed length is 0.9902 m, good to 2 mm; one epoch of GPS L1 measures it to 2 mm.
    assert solution.length_check["measured_m"] == pytest.approx(0.990, abs=0.005)


def test_right_length_raises_no_suspicion(pair):
    solution = truenorth.solve_baseline(*pair, length_m=0.99, systems="G", bands=("L1",))
    assert solution.is_accepted.all()
    assert solution.length_check["verdict"] == "agrees"
    assert not solution.warnings
