"""The command line with a made-up solver: options, outputs, words, exit codes."""

import json
import os
import signal
import subprocess
import sys
import time
import tomllib
import warnings

import pytest
from typer.testing import CliRunner

import truenorth.attitude
from synthetic_solution import make_solution
from truenorth import __version__
from truenorth.cli.app import app
from truenorth.cli.quick import parse_solve
from truenorth.config import GnssSettings
from truenorth.errors import (
    ConfigError,
    FormatError,
    ModelError,
    NoSolutionError,
    Status,
    TrueNorthWarning,
)


class Solver:
    """Stands where `solve_baseline` stands; remembers how it was called."""

    def __init__(self):
        self.solution = make_solution()
        self.error = None
        self.says = ()
        self.call = None
        self.settings = None

    def __call__(self, base, rover, navigation=(), *, settings=None, progress=None):
        self.call = (base, rover, tuple(navigation))
        self.settings = settings
        for text in self.says:
            warnings.warn(text, TrueNorthWarning, stacklevel=2)
        if self.error is not None:
            raise self.error
        return self.solution


@pytest.fixture
def solver(monkeypatch):
    fake = Solver()
    monkeypatch.setattr(truenorth.attitude.sessions, "solve_baseline", fake)
    return fake


@pytest.fixture
def files(tmp_path):
    names = [tmp_path / name for name in ("base.obs", "rover.obs", "brdc.nav")]
    for path in names:
        path.write_text(path.name)
    return [str(path) for path in names]


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_every_option_of_the_contract_reaches_the_solver(solver, files, tmp_path):
    out = tmp_path / "result.csv"
    result = run(
        "solve", *files, "--length", "0.99", "--length-sd", "0.003", "--method", "constrained",
        "--single-epoch", "--systems", "GEC", "--bands", "L1,L2", "--mask", "15", "--out", out, "--json",
    )  # fmt: skip
    assert result.exit_code == 0, result.stderr
    assert solver.call == (files[0], files[1], (files[2],))
    assert solver.settings == GnssSettings(
        length_m=0.99,
        length_sd_m=0.003,
        method="constrained",
        single_epoch=True,
        systems="GEC",
        bands=("L1", "L2"),
        elevation_mask_deg=15.0,
    )
    summary = json.loads(result.stdout)
    assert summary["epochs"] == 120
    assert summary["settings_file"] == str(tmp_path / "result.settings.toml")
    assert summary["seconds"]["write"] > 0.0
    assert out.read_text().startswith("time_gpst,azimuth_deg,")
    assert result.stderr == ""


def test_the_other_options_reach_the_solver(solver, files):
    result = run(
        "solve", *files, "--length", "0.99", "--length-use", "check", "--cn0-mask", "30",
        "--ratio-test", "fixed",
        "--ratio-threshold", "2.5", "--success-probability", "0.999", "--set", "stochastic.phase_sd_m=0.002",
        "--set", "direction_azimuth_deg = 90.0", "--set", "glonass_ambiguities=calibrated",
        "--method", "filter", "--direction", "combined",
    )  # fmt: skip
    assert result.exit_code == 0, result.stderr
    settings = solver.settings
    assert (settings.length_use, settings.cn0_mask_dbhz, settings.ratio_test) == ("check", 30.0, "fixed")
    assert (settings.ratio_threshold, settings.success_probability) == (2.5, 0.999)
    assert settings.stochastic.phase_sd_m == 0.002
    assert (settings.method, settings.direction) == ("filter", "combined")
    assert settings.direction_azimuth_deg == 90.0
    assert settings.glonass_ambiguities == "calibrated"


def test_observation_logs_need_no_navigation_file(solver, files):
    assert run("solve", *files[:2]).exit_code == 0
    assert solver.call[2] == ()


def test_several_navigation_files(solver, files, tmp_path):
    more = tmp_path / "more.nav"
    more.write_text("")
    assert run("solve", *files, more).exit_code == 0
    assert solver.call[2] == (files[2], str(more))


def test_the_settings_beside_a_result_repeat_the_run(solver, files, tmp_path):
    out = tmp_path / "result.pos"
    assert run("solve", *files, "--length", "0.99", "--mask", "20", "--out", out).exit_code == 0
    first = solver.settings
    settings_path = tmp_path / "result.settings.toml"
    assert tomllib.loads(settings_path.read_text())["gnss"]["elevation_mask_deg"] == 20.0
    result = run("solve", settings_path)
    assert result.exit_code == 0, result.stderr
    assert solver.settings == first
    assert solver.call == (files[0], files[1], (files[2],))


def test_options_win_over_the_session_file(solver, files, tmp_path):
    session = tmp_path / "session.toml"
    session.write_text(
        '[[platform.antennas]]\nname = "a"\nobservations = "base.obs"\nposition_body_m = [0.0, 0.0, 0.0]\n'
        '[[platform.antennas]]\nname = "b"\nobservations = "rover.obs"\nposition_body_m = [2.0, 0.0, 0.0]\n'
        '[gnss]\nnavigation = ["brdc.nav"]\nelevation_mask_deg = 5.0\n[gnss.stochastic]\ncode_sd_m = 0.5\n'
    )
    assert run("solve", session).exit_code == 0
    assert (solver.settings.length_m, solver.settings.elevation_mask_deg) == (2.0, 5.0)
    result = run("solve", session, "--length", "3", "--mask", "7", "--set", "stochastic.phase_sd_m=0.001")
    assert result.exit_code == 0, result.stderr
    assert (solver.settings.length_m, solver.settings.elevation_mask_deg) == (3.0, 7.0)
    assert solver.settings.stochastic.phase_sd_m == 0.001
    assert solver.settings.stochastic.code_sd_m == 0.5


def test_summary_for_people(solver, files, tmp_path):
    out = tmp_path / "result.csv"
    result = run("solve", *files, "--out", out)
    assert "87.5 % accepted" in result.stdout
    assert "they agree" in result.stdout
    assert str(out) in result.stdout


def test_explains_one_epoch(solver, files):
    result = run("solve", *files, "--explain", "08:20:03")
    assert result.exit_code == 0
    assert "success probability  0.600000 against at least 0.99: FAILED" in result.stdout
    document = json.loads(run("solve", *files, "--explain", "08:20:03", "--json").stdout)
    assert "FAILED" in document["explain"]
    late = run("solve", *files, "--explain", "12:00:00")
    assert late.exit_code == 2
    assert "no epoch at 12:00:00" in late.stderr


@pytest.mark.parametrize("suffix", ["png", "html"])
def test_draws_the_figure_page(solver, files, tmp_path, suffix):
    figure = tmp_path / f"page.{suffix}"
    assert run("solve", *files, "--figure", figure).exit_code == 0
    assert figure.stat().st_size > 10_000


def test_warnings_of_the_library_are_in_the_summary_once(solver, files):
    solver.solution = make_solution(warnings=("known",))
    solver.says = ("from below", "known", "from below")
    assert json.loads(run("solve", *files, "--json").stdout)["warnings"] == ["known", "from below"]


def test_no_accepted_epoch_exits_with_1(solver, files, tmp_path):
    solver.solution.status[:] = Status.FLOAT
    result = run("solve", *files, "--out", tmp_path / "result.csv")
    assert result.exit_code == 1
    assert "0.0 % accepted" in result.stdout
    assert (tmp_path / "result.csv").exists()


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (NoSolutionError("no common epochs"), 1),
        (ConfigError("bad setting", key="x"), 2),
        (FormatError("not RINEX", path="base.obs", line_number=1), 3),
        (ModelError("singular"), 4),
        (RuntimeError("boom"), 4),
        (MemoryError(), 4),
        (KeyboardInterrupt(), 130),
    ],
)
def test_errors_become_one_sentence_and_an_exit_code(solver, files, error, code):
    solver.error = error
    result = run("solve", *files)
    assert result.exit_code == code
    assert result.stdout == ""
    assert result.stderr.startswith("truenorth: ")
    assert len(result.stderr.splitlines()) == 1
    assert "Traceback" not in result.stderr


def test_the_traceback_can_be_asked_for(solver, files, monkeypatch):
    solver.error = RuntimeError("boom")
    assert "TRUENORTH_TRACEBACK=1" in run("solve", *files).stderr
    monkeypatch.setenv("TRUENORTH_TRACEBACK", "1")
    assert "Traceback (most recent call last)" in run("solve", *files).stderr


@pytest.mark.parametrize(
    "arguments", [["solv"], ["solve"], ["solve", "--nonsense"], ["solve", "a", "--mask", "x"]]
)
def test_usage_errors_exit_with_2(arguments):
    result = run(*arguments)
    assert result.exit_code == 2
    assert "Traceback" not in result.stderr


def test_version_and_help():
    assert run("--version").stdout.strip() == f"truenorth {__version__}"
    assert run("--help").exit_code == 0
    text = run("solve", "--help").stdout
    for option in (
        "--length",
        "--length-sd",
        "--method",
        "--single-epoch",
        "--systems",
        "--bands",
        "--mask",
        "--out",
    ):
        assert option in text


def test_help_loads_nothing_heavy():
    code = (
        "import sys\nfrom truenorth.cli.app import app\n"
        "try: app(['--help'])\nexcept SystemExit: pass\n"
        "heavy = {'numpy', 'numba', 'scipy', 'polars', 'xarray', 'matplotlib', 'plotly', 'rich'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)


def start(code, **options):
    return subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True, **options)


SLOW = """
import sys, time, types
import truenorth.cli.example as example
def wait(*, as_json):
    print("started", flush=True)
    time.sleep(60)
example.list_datasets = wait
from truenorth.cli import main
sys.argv = ["truenorth", "datasets"]
main()
"""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_interrupt_ends_without_a_traceback():
    process = start(SLOW, stdout=subprocess.PIPE)
    assert process.stdout.readline() == "started\n"
    time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=30)
    assert process.returncode == 130
    assert stderr.strip() == "truenorth: interrupted"


TALKATIVE = """
import sys
import truenorth.cli.example as example
def talk(*, as_json):
    for _ in range(100_000):
        print("a line that nobody reads")
example.list_datasets = talk
from truenorth.cli import main
sys.argv = ["truenorth", "datasets"]
main()
"""


@pytest.mark.skipif(os.name != "posix", reason="pipes of POSIX")
def test_a_reader_that_goes_away_is_no_error():
    process = start(TALKATIVE, stdout=subprocess.PIPE)
    process.stdout.readline()
    process.stdout.close()
    stderr = process.stderr.read()
    assert process.wait(timeout=30) == 0
    assert stderr == ""
    process.stderr.close()


COMMAND_LINES = [
    "base.obs rover.obs brdc.nav",
    "base.obs rover.obs brdc.nav --length 0.99 --length-sd=0.003 --json",
    "--mask 10 base.obs --systems GE --bands L1,L2 rover.obs brdc.nav --single-epoch",
    "base.obs rover.obs --method filter --direction combined --no-single-epoch --cn0-mask 30 --bands=L1",
    "base.obs rover.obs --set a.b=1 --set c=x --ratio-test fixed --ratio-threshold 2",
    "base.obs rover.obs --out r.csv --figure=p.png --explain 08:20:00 --length-use check --length -3",
    "base.obs rover.obs --success-probability .9 --ratio-test none",
    "session.toml --mask 5 --mask 7",
]


@pytest.mark.parametrize("line", COMMAND_LINES)
def test_the_quick_parser_reads_what_typer_reads(line, monkeypatch):
    calls = []

    def remember(files, overrides, assignments, **outputs):
        given = {key: value for key, value in overrides.items() if value is not None}
        wanted = {key: value for key, value in outputs.items() if value not in (None, False)}
        calls.append((files, given, assignments, wanted))
        return 0

    monkeypatch.setattr("truenorth.cli.solve.run_solve", remember)
    result = run("solve", *line.split())
    assert result.exit_code == 0, result.output
    quick = parse_solve(["solve", *line.split()])
    remember(*quick.arguments, **quick.outputs)
    assert calls[0] == calls[1]


@pytest.mark.parametrize(
    "line",
    ["", "info a", "--help", "solve", "solve --help", "solve a b -x", "solve a b --mask low",
     "solve a b --length", "solve a b --json=yes", "solve a b --unknown 3"],
)  # fmt: skip
def test_the_quick_parser_leaves_the_rest_to_typer(line):
    assert parse_solve(line.split()) is None


def test_the_quick_parser_knows_every_option():
    import inspect

    import truenorth.cli.quick as quick
    from truenorth.cli.request import OPTION_KEYS
    from truenorth.cli.solve import solve

    known = {*quick._VALUES, *quick._OUTPUTS, *quick._FLAGS, "--set", "--json"}
    named = {"assign": "--set", "as_json": "--json"}
    options = {named.get(name, "--" + name.replace("_", "-")) for name in inspect.signature(solve).parameters}
    assert known - {"--no-single-epoch"} == options - {"--files"}
    keys = {key: name for name, (key, _) in quick._VALUES.items()}
    assert {**keys, "single_epoch": "--single-epoch"} == OPTION_KEYS


def test_solving_does_not_load_the_parsing_library(tmp_path):
    code = (
        "import sys, truenorth.cli\nsys.argv = ['truenorth', 'solve', 'absent.obs', 'absent.obs']\n"
        "try: truenorth.cli.main()\nexcept SystemExit as end: assert end.code == 3\n"
        "assert not {'typer', 'rich', 'pydantic'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, stderr=subprocess.DEVNULL, cwd=tmp_path)
