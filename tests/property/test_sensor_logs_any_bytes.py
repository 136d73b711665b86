"""Whatever happens to its bytes, a sensor log gives samples that hold together, or a `FormatError`."""

import contextlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from truenorth.errors import FormatError
from truenorth.formats.fog_packet import decode_packets, encode_fog_log, encode_packets, parse_fog_packets
from truenorth.formats.registry import sniff_bytes
from truenorth.formats.tcm2 import encode_tcm2, parse_tcm2
from truenorth.sensor_log import SensorLog
from truenorth.timescales import NS_PER_S, gpst_from_week

N = 40
TIME_NS = gpst_from_week(929, 339_200.0) + NS_PER_S // 10 * np.arange(N)
GYRO = SensorLog(
    "gyro",
    TIME_NS,
    {
        "rate_count": np.arange(N) * 97 % 4096 - 2048,
        "temperature_count": 100 + np.arange(N),
        "status": np.arange(N) % 5 == 0,
    },
)
COMPASS = SensorLog(
    "compass",
    TIME_NS,
    {
        "heading_magnetic_deg": np.arange(N) * 8.7,
        "pitch_deg": np.linspace(-5.0, 5.0, N),
        "temperature_degc": np.full(N, 21.5),
        "anomaly": np.arange(N) % 3 == 0,
    },
)
LOGS = {
    "fog_log": (encode_fog_log(GYRO), parse_fog_packets),
    "fog_packets": (encode_packets(GYRO).tobytes(), parse_fog_packets),
    "tcm2": (encode_tcm2(COMPASS), parse_tcm2),
    "tcm2 unstamped": (encode_tcm2(COMPASS, stamped=False), parse_tcm2),
    "tcm2 nmea": (encode_tcm2(COMPASS, form="nmea"), parse_tcm2),
}


@st.composite
def mutated(draw, data):
    data = bytearray(data)
    for _ in range(draw(st.integers(1, 8))):
        at = draw(st.integers(0, max(len(data) - 1, 0)))
        action = draw(st.sampled_from(["replace", "flip", "delete", "insert", "repeat"]))
        if action == "replace" and data:
            data[at] = draw(st.integers(0, 255))
        elif action == "flip" and data:
            data[at] ^= 1 << draw(st.integers(0, 7))
        elif action == "delete":
            del data[at : at + draw(st.integers(1, 100))]
        elif action == "insert":
            data[at:at] = draw(st.binary(max_size=20))
        elif action == "repeat":
            data[at:at] = data[at : at + draw(st.integers(1, 60))]
    return bytes(data)


def check(data, parse):
    """Read, and hold the result to the promises of the container; the log, or None when refused."""
    try:
        log = parse(data, path="sensor.log")
    except FormatError as error:
        refusal, log = error, None
    if log is None:
        assert refusal.path == "sensor.log"
        return None
    assert log.n_samples > 0
    assert np.all(np.diff(log.time_ns) >= 0)
    for column in log.columns.values():
        assert column.shape == (log.n_samples,)
        assert not np.any(np.isinf(column))
    rejected = [value for name, value in log.meta.items() if name.startswith("n_rejected_")]
    assert all(value >= 0 for value in rejected)
    assert any(rejected) == ("damaged" in log.meta["warnings"])
    return log


@pytest.mark.parametrize("name", LOGS)
@given(data=st.data())
def test_mutated_bytes(name, data):
    whole, parse = LOGS[name]
    changed = data.draw(mutated(whole))
    check(changed, parse)
    form = sniff_bytes(changed)
    if form is not None and form.holds == "sensor":
        with contextlib.suppress(FormatError):
            form.read(changed, "sensor.log")


@given(st.binary(max_size=300))
def test_noise(data):
    for parse in (parse_fog_packets, parse_tcm2):
        check(data, parse)
    check(b"# fog-packet 1\n" + data, parse_fog_packets)
    check(b"929 1.0 $" + data, parse_tcm2)


@given(cut=st.integers(1, 3 * N - 1), noise=st.binary(max_size=30))
def test_gyro_packets_after_any_noise_are_found_again(cut, noise):
    """Noise between two packets costs at most the packet before it; all after it are there."""
    stream = encode_packets(GYRO).tobytes()
    at = cut // 3 * 3
    _, columns, _ = decode_packets(stream[:at] + noise + stream[at:])
    after = GYRO.columns["rate_count"][cut // 3 :]
    np.testing.assert_array_equal(columns["rate_count"][len(columns["rate_count"]) - len(after) :], after)
    n_before = max(cut // 3 - 1, 0)
    np.testing.assert_array_equal(columns["rate_count"][:n_before], GYRO.columns["rate_count"][:n_before])


@given(st.binary(max_size=200))
def test_bytes_of_a_gyro_stream_are_samples_or_counted(data):
    stream = data + encode_packets(GYRO).tobytes()
    log = parse_fog_packets(stream, start_ns=0)
    assert 3 * log.n_samples + log.meta["n_rejected_bytes"] == len(stream)


@pytest.mark.parametrize("name", ["tcm2", "tcm2 unstamped", "tcm2 nmea", "fog_log"])
@given(line=st.integers(6, N - 2), noise=st.binary(min_size=1, max_size=30))
def test_one_damaged_line_costs_one_sample(name, line, noise):
    """The line is overwritten by what is no line; the others are read, and the loss is counted."""
    whole, parse = LOGS[name]
    lines = whole.split(b"\n")
    noise = bytes(byte for byte in noise if byte not in b"\n#") or b"x"
    lines[line] = b"?" + noise
    log = parse(b"\n".join(lines))
    assert log.n_samples == N - 1
    assert log.meta["n_rejected_lines"] == 1


ROWS = st.tuples(st.integers(-2048, 2047), st.integers(0, 255), st.booleans(), st.integers(0, 2**62))


@given(st.lists(ROWS, min_size=1, max_size=30))
def test_gyro_round_trip(rows):
    rate, count, status, time_ns = map(np.array, zip(*rows, strict=True))
    time_ns = np.sort(time_ns % (9999 * 604_800 * NS_PER_S))
    log = SensorLog("gyro", time_ns, {"rate_count": rate, "temperature_count": count, "status": status})
    again = parse_fog_packets(encode_fog_log(log))
    np.testing.assert_array_equal(again.time_ns, time_ns)
    for name, column in log.columns.items():
        np.testing.assert_array_equal(again.columns[name], column)
