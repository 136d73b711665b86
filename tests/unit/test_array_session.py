"""A session of four antennas from simulated files to attitude, by the command line and in Python."""

import json

import numpy as np
import pytest

from truenorth.attitude import solve_array, solve_session
from truenorth.cli.request import make_session
from truenorth.cli.run import run_solve
from truenorth.config import ArraySettings, GnssSettings
from truenorth.errors import ConfigError, NoSolutionError, Reason, Status
from truenorth.evaluation import compare
from truenorth.simulation import simulate, write_simulation
from truenorth.simulation.folder import SURVEYED_SD_M

# Hundreds of epochs through the engine: too slow without the JIT.
pytestmark = pytest.mark.jit

BODY_M = {
    "aft": (0.0, 0.0, 0.0),
    "fore": (2.0, 0.0, 0.0),
    "right": (1.0, 0.8, -0.3),
    "left": (1.0, -0.8, -0.3),
}
SCENARIO = {
    "name": "array",
    "seed": 5,
    "duration_s": 39.0,
    "place": {"latitude_deg": 47.0, "longitude_deg": 15.0},
    "platform": {
        "antennas": [{"name": name, "position_body_m": list(place)} for name, place in BODY_M.items()]
    },
    "motion": {"kind": "circle", "radius_m": 40.0, "speed_mps": 8.0, "heading_deg": 350.0},
    "sky": {"kind": "nominal", "systems": "GE"},
    "faults": [{"kind": "dead", "antenna": "left", "start_s": 20.0}],
    "output": {"signal_truth": False},
}


@pytest.fixture(scope="module")
def simulation():
    return simulate(SCENARIO)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_simulation(SCENARIO, tmp_path_factory.mktemp("array"))


@pytest.fixture(scope="module")
def solution(simulation):
    return solve_array(
        [simulation.observations[name] for name in BODY_M], list(BODY_M.values()), simulation.navigation,
        names=list(BODY_M), array=ArraySettings(position_sd_m=SURVEYED_SD_M),
    )  # fmt: skip


def test_the_attitude_is_the_truth_within_its_sigma(simulation, solution):
    comparison = compare(solution, simulation.truth)
    assert comparison.availability == 1.0
    assert not comparison.is_wrong.any()
    # Phase noise of 1 to 2 mm over 2 m and over 1.6 m across.
    limits_deg = {"heading": 0.15, "pitch": 0.3, "roll": 0.5}
    for name, limit_deg in limits_deg.items():
        assert comparison.statistics["accepted"][name].rms < limit_deg


def test_a_receiver_that_dies_leaves_the_attitude_to_the_others(solution):
    np.testing.assert_array_equal(solution.n_antennas_used, np.repeat([4, 3], 20))
    np.testing.assert_array_equal(solution.status, [Status.FIXED] + 39 * [Status.HELD])
    assert [event.text for event in solution.events if event.kind == "lost"] == [
        "left takes no part: it has no phases to go on"
    ]
    assert (solution.reason == Reason.OK).all()
    # What is left knows the angles less well.
    assert np.mean(solution.angle_sd_rad(2)[20:]) > np.mean(solution.angle_sd_rad(2)[:20])


def test_residuals_are_kept_on_request_only(simulation, solution):
    assert solution.residuals is None
    kept = solve_array(
        [simulation.observations[name] for name in ("aft", "fore")], [(0, 0, 0), (2, 0, 0)],
        simulation.navigation, keep_residuals=True,
    )  # fmt: skip
    assert len(kept.residuals.residual_m) > 1000
    # Millimetres, as simulated; integers that were wrong would leave centimetres.
    assert np.sqrt(np.mean(kept.residuals.residual_m**2)) < 0.003
    # Two antennas along the body: heading and pitch, and no roll.
    assert (kept.reason == Reason.ROLL_UNOBSERVABLE).all()
    assert not compare(kept, simulation.truth).is_wrong.any()


def test_files_give_what_memory_gives(folder, solution):
    steps = []
    found = solve_session(folder.session, progress=lambda done, total: steps.append((done, total)))
    np.testing.assert_array_equal(found.time_ns, solution.time_ns)
    # Files carry orbits with the digits of RINEX.
    np.testing.assert_allclose(found.pitch_rad, solution.pitch_rad, atol=1e-4)
    assert found.antennas == tuple(BODY_M)
    assert set(found.inputs["antennas"]) == set(BODY_M)
    assert found.seconds["solve"] > 0.0


def test_an_antenna_without_common_epochs_takes_no_part_and_that_is_said(simulation):
    late = simulate({**SCENARIO, "start": "2024-06-24T09:00:00", "duration_s": 5.0}).observations["fore"]
    antennas = [
        simulation.observations["aft"],
        late,
        *(simulation.observations[n] for n in ("right", "left")),
    ]
    solution = solve_array(antennas, list(BODY_M.values()), simulation.navigation, names=list(BODY_M))
    assert any(text.startswith("fore: took part in no epoch") for text in solution.warnings)
    assert not solution.is_used[:, 1].any()
    assert solution.is_accepted[:20].all()
    with pytest.raises(NoSolutionError, match="could not solve the array"):
        solve_array(antennas[:2], [(0, 0, 0), (2, 0, 0)], simulation.navigation)


def test_the_command_solves_an_array(folder, tmp_path, capsys):
    out, figure = tmp_path / "attitude.csv", tmp_path / "attitude.png"
    assert run_solve([folder.session], {}, [], out=out, figure=figure) == 0
    text = capsys.readouterr().out
    assert "100.0 % accepted" in text
    assert "left      1.315 m from the first" in text
    assert out.is_file()
    assert figure.stat().st_size > 20_000
    # The settings beside the result repeat the run.
    assert run_solve([tmp_path / "attitude.settings.toml"], {}, [], as_json=True) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["epochs"] == 40
    assert summary["antennas"]["left"]["used_epochs"] == 20


def test_the_command_explains_an_epoch_of_an_array(folder, capsys):
    assert run_solve([folder.session], {}, [], explain="08:00:30") == 0
    text = capsys.readouterr().out
    assert "left      not used" in text
    assert "fore      used" in text
    assert "mm, elevation" in text  # Residuals were kept.


def test_options_that_do_not_suit_an_array_are_refused(folder):
    with pytest.raises(ConfigError, match="`--length` is for two antennas; the platform has 4"):
        run_solve([folder.session], {"length_m": 2.0}, [])
    with pytest.raises(ConfigError, match=r"give a \.csv"):
        run_solve([folder.session], {}, [], out=folder.folder / "attitude.pos")


def test_no_attitude_ends_with_the_exit_code_of_no_solution(folder, capsys):
    assert run_solve([folder.session], {"elevation_mask_deg": 80.0}, []) == 1
    assert "0.0 % accepted" in capsys.readouterr().out


def test_every_method_gives_the_same_attitude(simulation, solution):
    antennas = [simulation.observations[name].select_epochs(slice(0, 10)) for name in BODY_M]
    for method in ("lambda", "filter", "lsast"):
        found = solve_array(
            antennas, list(BODY_M.values()), simulation.navigation, names=list(BODY_M),
            settings=GnssSettings(method=method),
        )  # fmt: skip
        both = found.is_accepted & solution.is_accepted[: found.n_epochs]
        assert np.count_nonzero(both) >= 8, method
        difference = (found.roll_rad - solution.roll_rad[: found.n_epochs])[both]
        # The same phases; the noise they are weighted by is estimated from other samples.
        assert np.max(np.abs(difference)) < np.radians(0.3), method


def test_settings_of_the_array_can_be_typed(folder):
    typed = ["array.success_probability=0.99", "reliability.integrity_risk=1e-4", "elevation_mask_deg=12"]
    session = make_session([folder.session], {}, typed)
    assert session.array.success_probability == 0.99
    assert session.array.position_sd_m == SURVEYED_SD_M
    assert session.reliability.integrity_risk == 1e-4
    assert session.gnss.elevation_mask_deg == 12
    with pytest.raises(ConfigError, match="sucess"):
        make_session([folder.session], {}, ["array.sucess=1"])
    pair = [paths[0] for paths in list(folder.observations.values())[:2]]
    with pytest.raises(ConfigError, match="session"):
        make_session([*pair, folder.navigation[0]], {}, typed)
