"""The first run compiles in two processes; both halves must be what a real run needs."""

import subprocess
import sys

import pytest

from truenorth.ambiguity.rehearsal import rehearse_engine, rehearse_search
from truenorth.attitude.array_run import compile_engine
from truenorth.cli import first_run
from truenorth.config import Session
from truenorth.errors import Status

SESSION = Session.for_pair("missing.obs", "missing_too.obs")


def test_an_array_is_searched_and_its_engine_run_without_data():
    assert rehearse_search().status == Status.FIXED
    compile_engine()


def test_rehearsal_resolves_its_made_up_epochs():
    resolved = rehearse_engine()
    assert list(resolved.status) == [Status.FIXED, Status.FIXED]


def test_nothing_is_started_where_the_kernels_are_compiled(monkeypatch):
    monkeypatch.setattr("truenorth.cli.progress.kernels_are_compiled", lambda kind="pair": True)
    monkeypatch.setattr(subprocess, "Popen", lambda *_, **__: pytest.fail("a process was started"))
    assert first_run.compile_kernels(SESSION) == 0.0


def test_a_session_that_cannot_be_read_leaves_no_process_behind(monkeypatch):
    started = []
    popen = subprocess.Popen

    def record(*args, **kwargs):
        started.append(popen(*args, **kwargs))
        return started[-1]

    monkeypatch.setattr("truenorth.cli.progress.kernels_are_compiled", lambda kind="pair": False)
    monkeypatch.setattr(subprocess, "Popen", record)
    monkeypatch.setitem(first_run._REHEARSALS, "pair", "import time; time.sleep(600)")
    # The run itself reports the missing files; here they only must not hang or raise.
    assert first_run.compile_kernels(SESSION) > 0.0
    assert started[0].args[0] == sys.executable
    assert started[0].poll() is not None
