"""Whatever happens to its bytes, an OEM3 log gives observations that hold together, or a `FormatError`."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulated_sky import START_NS, navigation
from truenorth.errors import FormatError
from truenorth.formats.novatel_oem3 import find_messages, parse_oem3
from truenorth.formats.novatel_oem3_writer import encode_oem3
from truenorth.observations import LLI_SLIP, NO_CHANNEL, Observations, signal_id
from truenorth.timescales import NS_PER_S


def message(identity, data):
    rest = struct.pack("<II", identity, 12 + len(data)) + data
    checksum = 0xAA ^ 0x44 ^ 0x11
    for byte in rest:
        checksum ^= byte
    return b"\xaa\x44\x11" + bytes([checksum]) + rest


def check(data):
    """Read, and hold the result to the promises of the containers; None when there was a refusal."""
    try:
        observations, nav = parse_oem3(data, path="log.oem3")
    except FormatError as error:
        refusal = error
    else:
        refusal = None
    if refusal is not None:
        assert refusal.path == "log.oem3"
        assert 0 <= refusal.byte_offset <= len(data)
        return None
    rows = observations.n_rows
    assert np.all(np.diff(observations.time_ns) > 0)
    assert observations.epoch_start[0] == 0
    assert observations.epoch_start[-1] == rows
    assert np.all(np.diff(observations.epoch_start) >= 0)
    key = (observations.epoch_of_row * 1000 + observations.sat) * 1000 + observations.signal
    assert np.all(np.diff(key) > 0)
    for name in ("code_m", "phase_cyc", "doppler_hz", "cn0_dbhz", "lli", "sat", "signal"):
        column = getattr(observations, name)
        assert len(column) == rows
        assert not np.any(np.isinf(column))
    assert np.all(observations.lli[np.isnan(observations.phase_cyc)] == 0)
    assert np.all(np.isfinite(nav.kepler.column("sqrt_a")))
    return observations


def small(seed=1, n_epochs=6, sats=(3, 7, 30), signals=("1C", "2W"), step_ns=NS_PER_S):
    """Ranges of random values that both kinds of message hold exactly."""
    rng = np.random.default_rng(seed)
    shape = (n_epochs, len(sats), len(signals))
    n = int(np.prod(shape))
    lli = np.where(rng.random(n) < 0.2, LLI_SLIP, 0).astype(np.uint8)
    return Observations(
        time_ns=START_NS + step_ns * np.arange(n_epochs),
        epoch_start=np.arange(n_epochs + 1) * (n // n_epochs),
        sat=np.broadcast_to(np.array(sats)[:, None], shape).reshape(-1).astype(np.int16),
        signal=np.broadcast_to(np.array([signal_id(s) for s in signals]), shape).reshape(-1).astype(np.int16),
        code_m=rng.integers(2_560_000_000, 3_200_000_000, n) / 128.0,
        phase_cyc=rng.integers(-(2**40), 2**40, n) / 256.0,
        doppler_hz=rng.integers(-1_000_000, 1_000_000, n) / 256.0,
        cn0_dbhz=rng.integers(20, 52, n).astype(float),
        lli=lli,
        clock_offset_s=np.full(n_epochs, np.nan),
        glonass_channel=np.full(100, NO_CHANNEL, dtype=np.int8),
    )


LOGS = {ranges: encode_oem3(small(), navigation((0,)), ranges=ranges)[0] for ranges in ("RGED", "RGEB")}


@pytest.mark.parametrize("ranges", LOGS)
@given(data=st.data())
def test_mutated_bytes(ranges, data):
    # The ranges are at the end: half of the damage goes there.
    log = bytearray(LOGS[ranges])
    for _ in range(data.draw(st.integers(1, 12))):
        at = data.draw(st.integers(0, len(log) - 1) | st.integers(max(len(log) - 1000, 0), len(log) - 1))
        action = data.draw(st.sampled_from(["replace", "delete", "insert", "size"]))
        if action == "replace":
            log[at] = data.draw(st.integers(0, 255))
        elif action == "delete":
            del log[at : at + data.draw(st.integers(1, 200))]
        elif action == "insert":
            log[at:at] = data.draw(st.binary(max_size=40))
        else:  # the size of a message, which all that follows would hang on
            start = log.find(b"\xaa\x44\x11", at)
            if 0 <= start < len(log) - 12:
                log[start + 8 : start + 12] = data.draw(st.binary(min_size=4, max_size=4))
        if not log:
            break
    check(bytes(log))


@pytest.mark.parametrize("ranges", LOGS)
@given(data=st.data())
def test_truncated(ranges, data):
    check(LOGS[ranges][: data.draw(st.integers(0, len(LOGS[ranges])))])


@given(st.binary(max_size=400))
def test_noise(data):
    check(data)
    check(b"\xaa\x44\x11" * 40 + data)


@given(
    st.lists(
        st.tuples(st.sampled_from([12, 14, 16, 17, 32, 33, 65, 2**31]), st.binary(max_size=150)), max_size=8
    )
)
def test_any_data_behind_a_right_checksum(messages):
    """A right checksum promises nothing about the content."""
    last = encode_oem3(small(n_epochs=1))[0]
    assert check(b"".join(message(*one) for one in messages) + last) is not None


@given(
    st.lists(
        st.tuples(
            st.integers(-(2**31), 2**31 - 1),
            *[st.floats(), st.floats(width=32)] * 2,
            *[st.floats(width=32)] * 3,
            st.integers(0, 2**32 - 1),
        ),
        max_size=6,
    ),
    st.integers(-(2**31), 2**31 - 1),
    st.floats(),
    st.integers(0, 2**32 - 1),
)
def test_any_plain_range(rows, week, tow_s, status):
    records = b"".join(struct.pack("<idfdffffI", *row) for row in rows)
    log = message(32, struct.pack("<idiI", week, tow_s, len(rows), status) + records)
    assert check(log + encode_oem3(small(n_epochs=1))[0]) is not None


@given(
    st.lists(st.binary(min_size=20, max_size=20), max_size=6),
    st.integers(0, 2**16 - 1),
    st.integers(0, 2**32 - 1),
    st.integers(0, 2**32 - 1),
)
def test_any_compressed_range(rows, week, tow_cs, status):
    log = message(65, struct.pack("<HHII", len(rows), week, tow_cs, status) + b"".join(rows))
    assert check(log + encode_oem3(small(n_epochs=1))[0]) is not None


@given(st.lists(st.tuples(st.integers(0, 40), st.binary(min_size=90, max_size=90)), max_size=6))
def test_any_ephemeris(ephemerides):
    log = encode_oem3(small(n_epochs=1))[0]
    for prn, data in ephemerides:
        data = bytearray(data)
        for k in range(3):  # preamble and number right, so that the decoder goes on
            data[30 * k] = 0x8B
            data[30 * k + 5] = data[30 * k + 5] & 0xE3 | (k + 1) << 2
        log += message(14, struct.pack("<i", prn) + bytes(data) + bytes(2))
    assert check(log) is not None


@given(st.lists(st.one_of(st.binary(max_size=30), st.binary(max_size=20).map(lambda d: message(99, d)))))
def test_every_intact_message_is_found(parts):
    """The plain way as the reference: go byte by byte, take every message whose checksum is right."""
    data = b"".join(parts)
    expected, at = [], 0
    while at + 12 <= len(data):
        identity, size = struct.unpack_from("<II", data, at + 4)
        whole = data[at : at + size]
        if data[at : at + 3] == b"\xaa\x44\x11" and size >= 12 and whole == message(identity, whole[12:]):
            expected.append((at, size, identity))
            at += size
        else:
            at += 1
    offset, size, kind, _ = find_messages(np.frombuffer(data, dtype=np.uint8))
    assert list(zip(offset.tolist(), size.tolist(), kind.tolist(), strict=True)) == expected


@pytest.mark.parametrize("ranges", LOGS)
@given(
    seed=st.integers(0, 10_000),
    n_epochs=st.integers(1, 12),
    sats=st.sets(st.integers(1, 32), min_size=1, max_size=8),
    step=st.sampled_from([5, 10, 100, 3000]),
)
def test_round_trip(ranges, seed, n_epochs, sats, step):
    original = small(seed, n_epochs, tuple(sorted(sats)), step_ns=step * NS_PER_S // 100)
    data, n_left_out = encode_oem3(original, ranges=ranges)
    again = check(data)
    assert n_left_out == 0
    for name in ("time_ns", "epoch_start", "sat", "signal", "code_m", "doppler_hz", "cn0_dbhz", "lli"):
        np.testing.assert_array_equal(getattr(again, name), getattr(original, name), err_msg=name)
    rolls = (again.phase_cyc - original.phase_cyc) / 2.0**23
    np.testing.assert_array_equal(rolls, np.rint(rolls))
    if ranges == "RGEB":
        np.testing.assert_array_equal(again.phase_cyc, original.phase_cyc)


@given(at=st.integers(0, 5), cut=st.integers(1, 100), noise=st.binary(max_size=30))
def test_one_cut_message_costs_one_epoch(at, cut, noise):
    log = encode_oem3(small())[0]
    offset, size, _, _ = find_messages(np.frombuffer(log, dtype=np.uint8))
    begin, end = int(offset[at]), int(offset[at] + size[at])
    observations = check(log[: end - cut] + noise + log[end:])
    whole = small()
    keep = np.arange(6) != at
    assert set(whole.time_ns[keep]) <= set(observations.time_ns)
    assert any("bytes belong to no intact message" in text for text in observations.meta.warnings)
    assert begin + 12 < end - cut
