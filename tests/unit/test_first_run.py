"""The first run compiles in two processes; both halves must be what a real run needs."""

import subprocess
import sys

import pytest

from truenorth.ambiguity.rehearsal import rehearse_engine
from truenorth.cli import first_run
from truenorth.errors import Status


def test_rehearsal_resolves_its_made_up_epochs():
    resolved = rehearse_engine()
    assert list(resolved.status) == [Status.FIXED, Status.FIXED]


def test_nothing_is_started_where_the_kernels_are_compiled(monkeypatch):
    monkeypatch.setattr("truenorth.cli.progress.kernels_are_compiled", lambda: True)
    monkeypatch.setattr(subprocess, "Popen", lambda *_, **__: pytest.fail("a process was started"))
    assert first_run.compile_kernels(None) == 0.0


def test_a_session_that_cannot_be_read_leaves_no_process_behind(monkeypatch):
    started = []
    popen = subprocess.Popen

    def record(*args, **kwargs):
        started.append(popen(*args, **kwargs))
        return started[-1]

    monkeypatch.setattr("truenorth.cli.progress.kernels_are_compiled", lambda: False)
    monkeypatch.setattr(subprocess, "Popen", record)
    monkeypatch.setattr(first_run, "_ENGINE", "import time; time.sleep(600)")
    # The run itself reports the missing files; here they only must not hang or raise.
    assert first_run.compile_kernels(None) > 0.0
    assert started[0].args[0] == sys.executable
    assert started[0].poll() is not None
