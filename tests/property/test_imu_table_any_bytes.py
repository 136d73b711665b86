"""Whatever happens to its bytes, an inertial log gives increments that hold together, or a sentence."""

import contextlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from truenorth.errors import TrueNorthError
from truenorth.formats import write_table
from truenorth.formats.imu_mapping import ImuMapping
from truenorth.formats.imu_table import read_imu_table

N = 30
RNG = np.random.default_rng(8)
PSINS = (
    "% PSINS-format SIMU log file.\n0 0 -90.6 0 0 0\n34.2 108.9 380 0 10 9.780327\n0.1 0.1 0.1 125 125 125\n"
    + "".join(" ".join(map(str, row)) + "\n" for row in RNG.integers(-90, 90, (N, 6)))
).encode()
OURS = ("time_s", *(f"rate_{a}_radps" for a in "xyz"), *(f"force_{a}_mps2" for a in "xyz"))
FOREIGN = tuple("tabcdef")


def mapping(columns, separator):
    return ImuMapping.from_table(
        {
            "axes": "RFU",
            "separator": separator,
            "time": {"column": columns[0], "unit": "s"},
            "gyro": {"columns": columns[1:4], "unit": "deg/s"},
            "accelerometer": {"columns": columns[4:], "unit": "g"},
        }
    )


def cells(names):
    rows = np.column_stack([0.01 * np.arange(1, N + 1), RNG.normal(size=(N, 6)).round(4)])
    return dict(zip(names, rows.T, strict=True))


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Good logs of all kinds with the mapping that each needs."""
    folder = tmp_path_factory.mktemp("logs")
    made = {"psins": (PSINS, None)}
    for name, suffix, names, of in (
        ("own", "csv", OURS, None),
        ("packed", "csv.gz", OURS, None),
        ("parquet", "parquet", OURS, None),
        ("foreign", "csv", FOREIGN, mapping(FOREIGN, "comma")),
        ("numbers", "csv", FOREIGN, mapping((1, 2, 3, 4, 5, 6, 7), "comma")),
    ):
        path = folder / f"{name}.{suffix}"
        write_table(path, cells(names))
        data = path.read_bytes()
        made[name] = (data.split(b"\n", 1)[1] if name == "numbers" else data, of)
    spaced = made["numbers"][0].replace(b",", b"  ")
    made["spaces"] = (spaced, mapping((1, 2, 3, 4, 5, 6, 7), "space"))
    return folder, made


KINDS = ("psins", "own", "packed", "parquet", "foreign", "numbers", "spaces")


@st.composite
def harm(draw):
    """What is done to a file, in shares of its length."""
    actions = st.sampled_from(["replace", "flip", "delete", "insert", "repeat", "cut", "cell"])
    share = st.floats(0.0, 1.0, exclude_max=True)
    return draw(
        st.lists(
            st.tuples(actions, share, st.integers(0, 255), st.binary(max_size=12)), min_size=1, max_size=6
        )
    )


def harmed(data, steps):
    data = bytearray(data)
    for action, share, number, piece in steps:
        at = int(share * len(data))
        if action == "replace" and data:
            data[at] = number
        elif action == "flip" and data:
            data[at] ^= 1 << number % 8
        elif action == "delete":
            del data[at : at + number]
        elif action == "insert":
            data[at:at] = piece
        elif action == "repeat":
            data[at:at] = data[at : at + number]
        elif action == "cut":
            del data[at:]
        else:
            data[at:at] = (b"nan", b"inf", b",", b" ", b"\n", b"-", b"e99", b"\r")[number % 8]
    return bytes(data)


def holds_together(log):
    n = log.n_samples
    assert n >= 1
    assert log.increments.time_s.shape == (n + 1,)
    assert log.increments.angle_rad.shape == log.increments.velocity_mps.shape == (n, 3)
    assert log.sensor_velocity_mps.shape == (n, 3)
    assert np.isfinite(log.sensor_angle_rad).all()
    assert np.isfinite(log.sensor_velocity_mps).all()
    assert log.interval_s > 0.0
    assert np.all(np.diff(log.increments.time_s) > 0.0)


@pytest.mark.parametrize("kind", KINDS)
def test_unharmed(logs, kind):
    folder, made = logs
    data, of = made[kind]
    path = folder / "unharmed"
    path.write_bytes(data)
    log = read_imu_table(path, of)
    holds_together(log)
    assert log.n_samples == N


# Not Parquet: where its lengths are damaged, the library that reads it may ask for all memory and abort.
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "parquet"])
@given(steps=harm())
def test_harmed(logs, kind, steps):
    folder, made = logs
    data, of = made[kind]
    path = folder / f"harmed-{kind}"
    path.write_bytes(harmed(data, steps))
    # Nothing but the package's own errors gets out.
    with contextlib.suppress(TrueNorthError):
        holds_together(read_imu_table(path, of))


@given(share=st.floats(0.0, 1.0, exclude_max=True))
def test_a_cut_parquet_file_is_refused(logs, share):
    folder, made = logs
    data, of = made["parquet"]
    path = folder / "cut"
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(TrueNorthError):
        read_imu_table(path, of)
