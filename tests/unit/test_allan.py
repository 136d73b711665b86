"""Allan analysis of records with known contents, and what it refuses."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from truenorth.cli.app import app
from truenorth.errors import ConfigError, NoSolutionError
from truenorth.export.planning import write_table
from truenorth.report.allan_figures import allan_figure
from truenorth.report.files import save_figure
from truenorth.sensors.allan import analyse_allan
from truenorth.sensors.error_file import read_errors
from truenorth.strapdown import InertialIncrements

RATE_HZ = 10.0
N = 18_000
TIME_S = np.arange(N + 1) / RATE_HZ
DPH = np.pi / 180.0 / 3600.0
GYRO_WALK = 0.01 * np.pi / 180.0 / 60.0
ACCEL_WALK = 0.02 / 60.0
GRAVITY = 9.80665


def _rest(seed=1):
    """White noise of 0.01 deg/sqrt(h) and 0.02 m/s/sqrt(h) on a level unit."""
    rng = np.random.default_rng(seed)
    angle = GYRO_WALK / np.sqrt(RATE_HZ) * rng.standard_normal((N, 3))
    velocity = ACCEL_WALK / np.sqrt(RATE_HZ) * rng.standard_normal((N, 3))
    return angle + np.array([10.0, 0.0, -11.0]) * DPH / RATE_HZ, velocity - [0.0, 0.0, GRAVITY / RATE_HZ]


def _swaying():
    """The same on a vehicle that settles, rocks slowly and is shaken."""
    rng = np.random.default_rng(2)
    angle, velocity = _rest()
    slow = np.cumsum(rng.standard_normal((N + 1, 2)), axis=0) * 1e-5
    slow += 2e-4 * np.sin(2.0 * np.pi * TIME_S / 70.0)[:, None]
    angle[:, :2] += np.diff(slow, axis=0)
    # Pitching up, the forward axis feels gravity; rolling right, the right axis less of it.
    tilt = 0.5 * (slow[1:] + slow[:-1])
    velocity[:, 0] += GRAVITY / RATE_HZ * tilt[:, 1]
    velocity[:, 1] -= GRAVITY / RATE_HZ * tilt[:, 0]
    shake = 1e-3 * np.sin(2.0 * np.pi * 1.7 * TIME_S)
    velocity[:, :2] += np.diff(shake)[:, None]
    return angle, velocity


def _analyse(angle, velocity):
    return analyse_allan(InertialIncrements(TIME_S[: len(angle) + 1], angle, velocity))


@pytest.fixture(scope="module")
def still():
    return _analyse(*_rest())


@pytest.fixture(scope="module")
def swaying():
    return _analyse(*_swaying())


def test_white_noise_is_that_and_nothing_else(still):
    for axis in (*still.axes, still.gyro, still.accelerometer):
        truth = 0.01 if axis.kind == "gyro" else 0.02
        white = axis.terms["random_walk"]
        assert abs(white.value - truth) < 5.0 * white.sd
        # The best that 18000 samples allow is 1 / sqrt(2 n).
        assert 0.9 < white.sd / truth * np.sqrt(2.0 * N * (3.0 if axis.name.endswith("s") else 1.0)) < 2.5
        assert [term.name for term in axis.terms.values() if term.is_determined] == ["random_walk"]
        assert np.all(np.isfinite(axis.fitted))
        low, high = axis.interval()
        assert np.all((low < axis.deviation) & (axis.deviation < high))
    assert "does not show in 1800 s" in " ".join(still.notes)


def test_a_counter_and_a_drift_are_named():
    angle, velocity = _rest()
    step = 0.5 * DPH
    angle = np.diff(np.rint(np.cumsum(angle, axis=0) / step), axis=0, prepend=0.0) * step
    velocity[:, 2] += 1e-6 * GRAVITY * 2000.0 / 3600.0 * TIME_S[1:] / RATE_HZ
    result = _analyse(angle, velocity)
    counted = result.gyro.terms["quantisation"]
    assert abs(counted.value - 0.5 / np.sqrt(12.0)) < 5.0 * counted.sd
    assert result.describe("tactical").gyro_resolution_dps == pytest.approx(0.5 / 3600.0 * RATE_HZ, rel=0.1)
    drift = result.axes[5].terms["drift"]
    # A drift has no scatter of its own; what noise does to it in half an hour is below a tenth.
    assert drift.value == pytest.approx(2000.0, rel=0.1)
    assert "Accelerometer z drifts by 2e+03 ug/h" in " ".join(result.notes)


def test_motion_is_told_and_does_not_hide_the_sensor(swaying):
    gyro, accelerometer = swaying.axes[0], swaying.axes[3]
    assert "the accelerometers feel most of it" in gyro.disturbance
    assert "the gyros feel most of it" in accelerometer.disturbance
    assert swaying.axes[2].disturbance is None
    assert np.all(np.isnan(gyro.fitted))
    for axis, truth in ((gyro, 0.01), (accelerometer, 0.02)):
        white = axis.terms["random_walk"]
        assert not white.is_determined
        # Above the truth, and far below what the gyro's curve itself would allow.
        assert truth < white.bound < 5.0 * truth
    allowed = np.min(gyro.deviation * np.sqrt(gyro.tau_s)) / gyro.terms["random_walk"].unit_si
    assert gyro.terms["random_walk"].bound < 0.5 * allowed
    assert swaying.gyro.terms["random_walk"].value == pytest.approx(0.01, rel=0.05)
    assert "The platform moved." in " ".join(swaying.notes)


def test_a_swing_is_seen_as_a_hump():
    angle, velocity = _rest()
    angle[:, 1] += np.diff(2e-5 * np.sin(2.0 * np.pi * 0.8 * TIME_S))
    axis = _analyse(angle, velocity).axes[1]
    assert "hump" in axis.disturbance
    hertz = float(axis.disturbance.split("about ")[1].split(" Hz")[0])
    # The times of the curve are a third of an octave apart.
    assert 0.55 < hertz < 1.1
    assert axis.terms["random_walk"].bound > 0.01


def test_a_description_takes_what_is_measured_and_says_so(still, swaying):
    found = still.describe("tactical")
    assert found.gyro_random_walk_deg_per_sqrt_h == pytest.approx(0.01, rel=0.03)
    assert found.gyro_bias_sd_dph == 4.0
    # The record excludes the floor of this grade, so its bound counts.
    assert found.gyro_bias_instability_dph == pytest.approx(
        still.gyro.terms["bias_instability"].bound, rel=1e-3
    )
    # A better grade is within the bound and stays.
    assert still.describe("navigation").gyro_bias_instability_dph == 0.001
    text = still.to_toml("tactical")
    assert "# gyro_random_walk_deg_per_sqrt_h: measured, 0.0" in text
    assert "# gyro_bias_instability_dph: the record only bounds it; the bound is taken." in text
    assert "those of grade tactical" in text
    with pytest.raises(ConfigError, match="no grade of sensor is called 'toy'"):
        still.describe("toy")


def test_tables_values_and_figure(still, swaying, tmp_path):
    columns = swaying.columns()
    assert list(columns)[:3] == ["tau_s", "gyro_x_dph", "gyro_x_low_dph"]
    assert columns["accelerometers_ug"].shape == columns["tau_s"].shape
    assert write_table(columns, tmp_path / "curves.parquet").stat().st_size > 1000
    told = json.loads(json.dumps(swaying.to_dict(), allow_nan=False))
    assert told["gyro_x"]["random_walk_deg_per_sqrt_h"]["value"] is None
    assert told["gyro_x"]["random_walk_deg_per_sqrt_h"]["bound"] > 0.01
    assert told["gyros"]["disturbance"] is None
    for k, result in enumerate((still, swaying)):
        figure = allan_figure(result, title="a unit")
        assert [ax.get_ylabel() for ax in figure.axes] == ["deg/h", "ug"]
        assert save_figure(figure, tmp_path / f"{k}.svg").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a, v: (a[:100], v[:100]), "needs 256 samples"),
        (lambda a, v: (a * [1.0, 0.0, 1.0], v), "gyro y never changes"),
        (lambda a, v: (np.where(np.arange(N)[:, None] == 7, np.nan, a), v), "gyro x has missing samples"),
        (lambda a, v: (a, v / GRAVITY), "feel 1 m/s.2 where gravity is 9.8"),
        (lambda a, v: (a, np.where(np.arange(N)[:, None] < N // 2, v, v[:, [2, 0, 1]])), "was tilted by"),
        (lambda a, v: (a + (np.arange(N) // 900 == 3)[:, None] * [0.0, 0.0, 1e-3], v), "turned by"),
    ],
)
def test_what_cannot_be_analysed_is_refused(change, message):
    with pytest.raises(NoSolutionError, match=message):
        _analyse(*change(*_rest()))


def test_gaps_are_refused():
    times = TIME_S.copy()
    times[500:] += 3.0
    with pytest.raises(NoSolutionError, match="equal intervals"):
        analyse_allan(InertialIncrements(times, *_rest()))


def test_the_command_tells_writes_and_draws(tmp_path):
    angle, velocity = _rest()
    names = [f"delta_angle_{axis}_rad" for axis in "xyz"] + [f"delta_velocity_{axis}_mps" for axis in "xyz"]
    log = tmp_path / "log.parquet"
    write_table(dict(zip(["time_s", *names], [TIME_S[1:], *angle.T, *velocity.T], strict=True)), log)

    def run(*arguments):
        done = CliRunner().invoke(app, ["allan", str(log), *arguments])
        return done.exit_code, done.stdout, done.stderr

    files = {"out": tmp_path / "e.toml", "table": tmp_path / "t.csv", "figure": tmp_path / "f.png"}
    options = [word for name, path in files.items() for word in (f"--{name}", str(path))]
    code, said, _ = run(*options, "--grade", "industrial")
    assert code == 0
    assert "18000 samples, 1800.0 s at 10 Hz" in said
    assert "random walk, deg/sqrt(h)" in said
    assert read_errors(files["out"]).grade == "industrial"
    assert files["table"].read_text().startswith("tau_s,gyro_x_dph")
    assert files["figure"].read_bytes()[:4] == b"\x89PNG"

    code, said, _ = run("--json", "--from", "100", "--until", "400")
    assert code == 0
    assert json.loads(said)["duration_s"] == pytest.approx(300.0)

    for arguments, expected, sentence in (
        (["--grade", "toy"], 2, "`--grade toy` is no grade"),
        (["--out", str(tmp_path / "errors.txt")], 2, "is not one of .toml"),
        (["--from", "0", "--until", "5"], 1, "needs 256 samples"),
    ):
        code, _, said = run(*arguments)
        assert code == expected
        assert sentence in said
        assert "Traceback" not in said
