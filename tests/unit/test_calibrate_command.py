"""``truenorth calibrate array``: the survey of a session on disk, its table, its session file, its errors."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from truenorth.cli.app import app
from truenorth.cli.calibrate import session_with
from truenorth.config import Session
from truenorth.simulation import write_simulation

SCENARIO = {
    "name": "calibrated", "duration_s": 120.0, "interval_s": 1.0, "seed": 3,
    "place": {"latitude_deg": 47.0, "longitude_deg": 15.0, "height_m": 400.0},
    "platform": {
        "antennas": [
            {"name": "aft", "position_body_m": [0.0, 0.0, 0.0]},
            {"name": "fore", "position_body_m": [2.0, 0.0, 0.0]},
            {"name": "right", "position_body_m": [1.0, 1.0, 0.0]},
            {"name": "mast", "position_body_m": [0.8, -0.2, -0.9]},
        ]
    },
    "motion": {"kind": "turntable", "rate_dps": 10.0},
    "receiver": {"signals": {"G": ["1C"], "E": ["1C"]}},
    "sky": {"kind": "nominal", "systems": "GE"},
    "visibility": {"elevation_mask_deg": 10.0},
    "solve": {"method": "filter", "systems": "GE", "bands": ["L1"], "elevation_mask_deg": 10.0},
    "output": {"signal_truth": False},
}  # fmt: skip


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """A session whose third antenna is declared 2 cm too far forward."""
    folder = tmp_path_factory.mktemp("calibrated")
    write_simulation(SCENARIO, folder)
    path = folder / "session.toml"
    text = path.read_text(encoding="utf-8")
    assert "[1.0, 1.0, 0.0]" in text
    path.write_text(text.replace("[1.0, 1.0, 0.0]", "[1.02, 1.0, 0.0]"), encoding="utf-8")
    return path


def run(*arguments):
    return CliRunner().invoke(app, ["calibrate", "array", *map(str, arguments)])


@pytest.mark.jit
def test_the_wrong_antenna_is_told_and_the_new_session_has_its_place(session):
    out = session.parent / "measured.toml"
    maps, figure = session.parent / "maps.csv", session.parent / "maps.png"
    said = run(session, "--out", out, "--phase-maps", maps, "--figure", figure)
    assert said.exit_code == 0, said.output
    assert "right is off by" in said.output
    assert "mm aft" in said.output
    assert "an attitude of its own for every epoch" in said.output
    measured = Session.read(out)
    places = np.array([antenna.position_body_m for antenna in measured.platform.antennas])
    true = np.array([entry["position_body_m"] for entry in SCENARIO["platform"]["antennas"]])
    # 120 epochs of millimetres, in the frame of the three that are declared rightly.
    np.testing.assert_allclose(places, true, atol=0.004)
    assert maps.read_text(encoding="utf-8").count("\n") > 100
    assert figure.stat().st_size > 10_000


@pytest.mark.jit
def test_other_frames_and_lengths_and_json(session):
    said = run(session, "--rule", "axes", "--axes", "aft,fore,right", "--lengths", "approximate", "--json")
    told = json.loads(said.output)
    assert told["rule"] == "axes"
    assert told["declared"] is None
    assert told["positions_body_m"][1][0] == pytest.approx(2.0, abs=0.004)
    assert told["positions_body_m"][3][2] == pytest.approx(-0.9, abs=0.008)
    assert told["epochs_used"] > 100
    assert {tuple(pair["antennas"]) for pair in told["distances"]} >= {("aft", "fore"), ("right", "mast")}


@pytest.mark.jit
def test_a_dead_receiver_is_left_out_and_said(session, tmp_path):
    dead = {"kind": "dead", "antenna": "mast", "start_s": 0.0}
    write_simulation(SCENARIO | {"faults": [dead], "duration_s": 60.0}, tmp_path)
    path, out = tmp_path / "session.toml", tmp_path / "measured.toml"
    said = run(path, "--out", out)
    assert said.exit_code == 0, said.output
    assert "mast is left out" in said.output
    assert "fore - mast" not in said.output
    # It keeps its declared place; the others are measured in the declared frame.
    assert Session.read(out).platform.antennas[3].position_body_m == (0.8, -0.2, -0.9)
    assert run(path, "--rule", "axes", "--axes", "aft,fore,mast").exit_code == 2
    assert run(path, "--rule", "axes", "--out", out).exit_code == 2


@pytest.mark.jit
def test_two_antennas_without_coordinates_give_their_length(session):
    both = Session.read(session)
    import msgspec

    antennas = tuple(
        msgspec.structs.replace(antenna, position_body_m=None) for antenna in both.platform.antennas[:2]
    )
    pair = msgspec.structs.replace(both, platform=msgspec.structs.replace(both.platform, antennas=antennas))
    path, out = session.parent / "pair.toml", session.parent / "pair-measured.toml"
    path.write_text(pair.to_toml(folder=session.parent), encoding="utf-8")
    said = run(path, "--out", out)
    assert said.exit_code == 0, said.output
    assert "fore is forward of it" in said.output
    assert Session.read(out).settings.length_m == pytest.approx(2.0, abs=0.003)
    assert run(path, "--lengths", "approximate").exit_code == 2


def test_errors_are_one_sentence_with_an_exit_code(session, tmp_path):
    for arguments, code, words in (
        ((session, "--axes", "aft,bow,right"), 2, "--axes"),
        ((session, "--figure", tmp_path / "maps.txt"), 2, "--figure"),
        ((session, "--out", tmp_path / "none" / "out.toml"), 2, "none"),
        ((tmp_path / "nothing.toml",), 3, "could not read the session"),
        ((session, "--lengths", "guessed"), 2, "lengths"),
    ):
        said = run(*arguments)
        assert said.exit_code == code, said.output
        assert words in said.output
        assert said.output.startswith("truenorth: ")
        assert said.output.count("\n") == 1


def test_coordinates_are_written_to_a_tenth_of_a_millimetre(session):
    class Found:
        names = ("aft", "fore", "right", "mast")
        sd_body_m = np.array([[0.0, 0.0, 0.0], [0.001, 0.0, 0.0], [0.001, 0.001, 0.0], [0.0, 0.0, 0.001]])
        positions_body_m = np.array(
            [[0.0, -0.00001, 0.0], [2.00004, 0.0, 0.0], [1.0, 1.0, 0.0], [0.8, 0.0, 1.0]]
        )

    written = session_with(Session.read(session), Found)
    places = [antenna.position_body_m for antenna in written.platform.antennas]
    assert written.array.position_sd_m == pytest.approx(0.001)
    assert places[0] == (0.0, 0.0, 0.0)
    assert str(places[0][1]) == "0.0"
    assert places[1][0] == 2.0
