"""The demo: one command from a scenario to a page with its verdict."""

import json

import numpy as np
import pytest

from truenorth.cli import demo
from truenorth.config import Session
from truenorth.evaluation import compare
from truenorth.simulation import read_scenario


@pytest.fixture(scope="module")
def short():
    """The scenario cut to a minute, so that it passes nothing and takes a second."""
    return read_scenario("demo", {"duration_s": 60.0})


@pytest.mark.jit
def test_a_page_a_session_and_a_verdict(short, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("truenorth.simulation.read_scenario", lambda *_: short)
    monkeypatch.setattr("webbrowser.open", lambda url: pytest.fail(f"a browser was opened at {url}"))
    folder = tmp_path / "out"
    assert demo.run_demo(folder, open_page=False, as_json=True) == 0
    outcome = json.loads(capsys.readouterr().out)
    assert outcome["expected_epochs"] == 61
    assert outcome["availability"] > 0.9
    assert outcome["wrong"] == 0
    # Phase multipath of 3 to 6 mm over 1.6 m and 1 m.
    assert outcome["errors_deg"]["accepted"]["heading"]["p95"] < 0.3
    page = (folder / demo.PAGE).read_text(encoding="utf-8")
    assert short.title in page
    assert "0 wrong" in page
    assert Session.read(folder / "session.toml").is_array
    again = compare(folder / "attitude.csv", folder / "truth.csv")
    assert again.availability == outcome["availability"]


@pytest.mark.jit
def test_the_page_is_opened_when_asked_and_named_in_words(short, tmp_path, monkeypatch, capsys):
    opened = []
    monkeypatch.setattr("truenorth.simulation.read_scenario", lambda *_: short)
    monkeypatch.setattr("webbrowser.open", opened.append)
    assert demo.run_demo(tmp_path, open_page=True) == 0
    assert opened == [(tmp_path / demo.PAGE).resolve().as_uri()]
    text = capsys.readouterr().out
    assert f"page        {tmp_path / demo.PAGE}" in text
    assert "available   " in text


def test_obstructions_are_marked_where_they_are_first_met(short):
    truth = {"time_ns": np.arange(5) * 10**9, "distance_m": np.array([0.0, 300.0, 600.0, 1300.0, 1400.0])}
    assert demo._places(short, truth) == [(2 * 10**9, "avenue"), (3 * 10**9, "bridge")]


def test_no_browser_where_nobody_looks(monkeypatch):
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    monkeypatch.setenv("CI", "1")
    assert not demo._has_a_viewer()
