"""Whatever happens to its bytes, a UBX log gives observations that hold together, or a `FormatError`."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from truenorth.errors import FormatError
from truenorth.formats.navigation_frames import lnav_words
from truenorth.formats.ubx import find_frames, parse_ubx
from truenorth.formats.ubx_writer import encode_frame as frame
from truenorth.formats.ubx_writer import encode_sfrbx as sfrbx
from ubx_writer import measurement, rawx


def check(data):
    """Read, and hold the result to the promises of the containers; True when there was a result."""
    try:
        observations, navigation = parse_ubx(data, path="log.ubx")
    except FormatError as error:
        refusal = error
    else:
        refusal = None
    if refusal is not None:
        assert refusal.path == "log.ubx"
        assert 0 <= refusal.byte_offset <= len(data)
        return False
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
    assert np.all(np.isfinite(navigation.kepler.column("sqrt_a")))
    return True


@pytest.fixture(scope="module")
def short_log(data_dir):
    """The first 31 kB of the F9P log of five systems: 5 s of measurements and navigation bits."""
    return (data_dir / "receiver_logs" / "20230919-114418.ubx").read_bytes()[:31_000]


@given(data=st.data())
def test_mutated_bytes(short_log, data):
    log = bytearray(short_log)
    for _ in range(data.draw(st.integers(1, 12))):
        at = data.draw(st.integers(0, len(log) - 1))
        action = data.draw(st.sampled_from(["replace", "delete", "insert", "length"]))
        if action == "replace":
            log[at] = data.draw(st.integers(0, 255))
        elif action == "delete":
            del log[at : at + data.draw(st.integers(1, 600))]
        elif action == "insert":
            log[at:at] = data.draw(st.binary(max_size=40))
        else:  # the length of a frame, which all that follows would hang on
            start = log.find(b"\xb5\x62", at)
            if 0 <= start < len(log) - 6:
                log[start + 4 : start + 6] = data.draw(st.binary(min_size=2, max_size=2))
        if not log:
            break
    check(bytes(log))


@given(cut=st.integers(0, 31_000))
def test_truncated(short_log, cut):
    check(short_log[:cut])


@given(st.binary(max_size=600))
def test_noise(data):
    check(data)
    check(b"\xb5\x62" * 50 + data)


@given(
    st.lists(
        st.tuples(
            st.sampled_from([0x0215, 0x0210, 0x0213, 0x0A04, 0x0101, 0x0106, 0x0107, 0x0199]),
            st.binary(max_size=150),
        ),
        max_size=8,
    )
)
def test_any_payload_behind_a_right_checksum(messages):
    """A right checksum promises nothing about the content."""
    log = rawx(2021, 10.0, [measurement(0, 3)]) + b"".join(frame(*message) for message in messages)
    assert check(log)


@given(
    st.lists(
        st.builds(
            measurement,
            st.integers(0, 255),
            st.integers(0, 255),
            sig=st.integers(0, 255),
            code=st.floats(),
            phase=st.floats(),
            doppler=st.floats(width=32),
            channel=st.integers(-7, 248),
            lock_ms=st.integers(0, 65_535),
            track=st.integers(0, 255),
        ),
        max_size=6,
    ),
    st.integers(0, 65_535),
    st.floats(),
    st.integers(0, 255),
)
def test_any_measurement(rows, week, tow_s, version):
    log = rawx(week, tow_s, rows, version=version) + rawx(2021, 10.0, [measurement(0, 3)])
    assert check(log)


@given(
    st.lists(
        st.tuples(
            st.integers(0, 8),
            st.integers(0, 60),
            st.lists(st.integers(0, 2**32 - 1), max_size=10),
            st.integers(0, 10),
            st.integers(-7, 20),
        ),
        max_size=20,
    ),
    st.lists(st.tuples(st.integers(1, 5), st.integers(0, 2**240 - 1)), max_size=12),
)
def test_any_navigation_bits(frames, subframes):
    messages = [sfrbx(g, sv, words, sig=sig, channel=channel) for g, sv, words, sig, channel in frames]
    for number, bits in subframes:  # with preamble and number right, so that the decoder goes on
        bits = bits & (1 << 232) - 1 | 0x8B << 232
        bits = bits & ~(7 << 194) | number << 194
        messages.append(sfrbx(0, 3, lnav_words(bits)))
    assert check(rawx(2021, 10.0, [measurement(0, 3)]) + b"".join(messages))


@given(st.lists(st.one_of(st.binary(max_size=30), st.binary(max_size=20).map(lambda p: frame(0x0107, p)))))
def test_every_intact_frame_is_found(parts):
    """The plain way as the reference: go byte by byte, take every frame whose checksum is right."""
    data = b"".join(parts)
    expected, at = [], 0
    while at + 8 <= len(data):
        length = int.from_bytes(data[at + 4 : at + 6], "little")
        whole = data[at : at + 8 + length]
        kind = 256 * data[at + 2] + data[at + 3]
        if data[at : at + 2] == b"\xb5\x62" and whole == frame(kind, data[at + 6 : at + 6 + length]):
            expected.append((at, length, kind))
            at += len(whole)
        else:
            at += 1
    offset, length, kind, _ = find_frames(np.frombuffer(data, dtype=np.uint8))
    assert list(zip(offset.tolist(), length.tolist(), kind.tolist(), strict=True)) == expected
