"""`truenorth simulate` as a user runs it: a folder that `truenorth solve` reads, bytes that repeat."""

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import truenorth as tn
from simulated_sessions import pair
from truenorth.errors import FormatError
from truenorth.simulation import simulate, write_simulation


def _run(*arguments, cwd=None):
    return subprocess.run(
        [sys.executable, "-c", "from truenorth.cli import main; main()", *map(str, arguments)],
        check=False, capture_output=True, text=True, cwd=cwd, env={**os.environ, "COLUMNS": "200"},
    )  # fmt: skip


def _digests(folder):
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(Path(folder).rglob("*"))
        if path.is_file() and path.suffix != ".parquet"
    }


def test_a_named_scenario_is_simulated_solved_and_compared(tmp_path):
    made = _run("simulate", "harvey-parking", "--out", tmp_path / "out", "--set", "duration_s=60", "--json")
    assert made.returncode == 0, made.stderr
    told = json.loads(made.stdout)
    assert told["epochs"] == 61
    assert set(told["sensors"]) == {"gyro", "compass", "tilt"}
    solved = _run("solve", told["session"], "--out", tmp_path / "solution.csv", "--json")
    assert solved.returncode == 0, solved.stderr
    assert json.loads(solved.stdout)["accepted_fraction"] > 0.9
    compared = _run("evaluate", tmp_path / "solution.csv", told["truth"], "--json")
    assert compared.returncode == 0, compared.stderr


def test_the_files_hold_what_the_python_objects_hold(tmp_path):
    scenario = pair(duration_s=20.0, output={"observations": ["rinex", "ubx"]})
    written = write_simulation(scenario, tmp_path)
    simulation = simulate(scenario)
    for name, paths in written.observations.items():
        expected = simulation.observations[name]
        from_rinex = tn.read_observations(paths[0])
        for column in ("time_ns", "sat", "signal", "code_m", "phase_cyc", "doppler_hz", "cn0_dbhz", "lli"):
            np.testing.assert_array_equal(getattr(from_rinex, column), getattr(expected, column))
        assert tn.read_observations(paths[1]).n_epochs == expected.n_epochs
    truth = pl.read_csv(tmp_path / "truth.csv")
    np.testing.assert_allclose(truth["heading_deg"].to_numpy(), np.degrees(simulation.truth["heading_rad"]))
    signals = pl.read_parquet(tmp_path / "truth" / "fore-*.parquet")
    np.testing.assert_array_equal(signals["integer_cyc"], simulation.signal_truth["fore"]["integer_cyc"])


def test_the_same_seed_gives_the_same_bytes(tmp_path):
    scenario = pair(duration_s=10.0, sensors={"gyro": {}, "compass": {}, "tilt": {}})
    write_simulation(scenario, tmp_path / "a")
    write_simulation(scenario, tmp_path / "b", block_epochs=3)
    assert _digests(tmp_path / "a") == _digests(tmp_path / "b")
    write_simulation(scenario, tmp_path / "c", {"seed": 2})
    differ = {
        name for name, digest in _digests(tmp_path / "c").items() if _digests(tmp_path / "a")[name] != digest
    }
    assert {"aft.obs", "fore.obs", "scenario.toml", "sensors/gyro.csv"} <= differ
    assert "session.toml" not in differ


def test_the_written_scenario_makes_the_same_session(tmp_path):
    write_simulation(pair(duration_s=10.0), tmp_path / "a")
    write_simulation(tmp_path / "a" / "scenario.toml", tmp_path / "b")
    assert _digests(tmp_path / "a") == _digests(tmp_path / "b")


def test_scenarios_are_listed_one_to_a_line():
    listed = _run("simulate", "--list")
    assert listed.returncode == 0
    lines = listed.stdout.splitlines()
    for name in ("oguz-search-1", "harvey-suburban", "landfahrer-oeamtc", "mcmillan-ship", "wang-vehicle"):
        assert any(line.startswith(name + " ") for line in lines)
    assert all(len(line) < 125 for line in lines)


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["nowhere"], 2, "there is no scenario 'nowhere'"),
        (["demo", "--set", "duration=3"], 2, "did you mean `duration_s`"),
        (["demo", "--set", "motion.kind=flying"], 2, "give one of"),
        (["missing.toml"], 3, "could not read the scenario"),
        ([], 2, "name a scenario"),
    ],
)
def test_wrong_requests_are_one_sentence(arguments, code, said, tmp_path):
    refused = _run("simulate", *arguments, cwd=tmp_path)
    assert refused.returncode == code, refused.stderr
    assert said in refused.stderr
    assert refused.stderr.strip().count("\n") == 0
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_written_is_said(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FormatError, match="could not write"):
        write_simulation(pair(duration_s=1.0), tmp_path / "file")
