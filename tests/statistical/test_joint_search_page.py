"""The committed table of the joint search: what it must show, and that fresh draws agree with it."""

import csv
import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.jit


def load(name):
    """A module of tools/, which is no package."""
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
    return sys.modules[name]


for _name in ("model_geometry", "engine_run", "study_constrained"):
    load(_name)
study = load("study_joint_search")


def table():
    """Rows of the committed table by (antennas, satellites)."""
    with (ROOT / "docs/validation/joint_search.csv").open(encoding="utf-8") as file:
        return {
            (int(row["antennas"]), int(row["satellites"])): {k: float(v) for k, v in row.items()}
            for row in csv.DictReader(file)
        }


def test_the_table_is_as_good_as_the_independent_implementation_and_hardly_ever_wrong():
    rows = table()
    assert set(rows) == {(m, n) for m in (3, 4) for n in study.SATELLITES}
    for (m, n), row in rows.items():
        assert row["draws"] == 10_000
        assert row["wrong"] <= 1e-3 * max(row["accepted"], 1.0)
        if n in study.REFERENCE[m]:
            for share, told in zip(
                (row["right"] / row["draws"], row["baselines_right"] / row["baselines_draws"]),
                study.REFERENCE[m][n],
                strict=True,
            ):
                # 60 trials there: four standard deviations, and a trial where the share is 1.
                assert abs(share - told) < 4.0 * np.sqrt(share * (1.0 - share) / 60.0) + 1.0 / 60.0
    assert all(row["ms_median"] <= 5.0 for (_, n), row in rows.items() if n == 5)


@pytest.mark.parametrize(("antennas", "satellites"), [(3, 5), (3, 4), (4, 5), (4, 4)])
def test_fresh_draws_agree_with_the_table(antennas, satellites):
    row = table()[antennas, satellites]
    body = next(one for one in study.ARRAYS.values() if len(one) == antennas)
    n = 150
    right, stated, accepted, _, _ = study.study_cell(body, satellites, n, 0, seed=3)
    for count, told in ((right.sum(), row["right"]), (accepted.sum(), row["accepted"])):
        share = told / row["draws"]
        # 4.5 standard deviations of a binomial number: a false alarm of less than 1e-4 for all together.
        assert abs(count - n * share) < 4.5 * np.sqrt(n * share * (1.0 - share)) + 1.0
    assert np.sum(accepted & ~right) <= 1
    assert np.all(stated[accepted] >= 0.999)
