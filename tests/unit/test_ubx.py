"""The UBX reader on logs written by hand: framing, measurement fields, loss of lock, refusals."""

import struct

import numpy as np
import pytest

from truenorth.errors import FormatError
from truenorth.formats.ubx import crc24q, find_frames, parse_ubx, read_ubx
from truenorth.formats.ubx_writer import encode_frame as frame
from truenorth.formats.ubx_writer import encode_sfrbx as sfrbx
from truenorth.observations import LLI_HALF_CYCLE, LLI_SLIP, NO_CHANNEL, sat_name, signal_name
from truenorth.timescales import NS_PER_S, NS_PER_WEEK
from ubx_writer import measurement, rawx

WEEK = 2021


def epochs(*lists, step_s=1.0, tow_s=391_088.991):
    return b"".join(rawx(WEEK, tow_s + step_s * k, rows) for k, rows in enumerate(lists))


def test_crc24q_of_a_known_rtcm_message():
    """The example of RTCM 10403: message 1005, 19 bytes, with its checksum 36 0B 98."""
    message = bytes.fromhex("D300133ED7D30202980EDEEF34B4BD62AC0941986F33360B98")
    assert crc24q(int.from_bytes(message[:-3], "big")) == int.from_bytes(message[-3:], "big")


def test_one_epoch_field_by_field():
    rows = [
        measurement(6, 7, channel=5, sig=2, code=2.1e7, phase=9.1e7, doppler=100.25, cn0=41),
        measurement(0, 3, code=2.2e7, phase=1.15e8, doppler=-1234.5, cn0=48),
    ]
    observations, navigation = parse_ubx(rawx(WEEK, 391_088.991, rows), path="here.ubx")
    assert observations.time_ns.tolist() == [WEEK * NS_PER_WEEK + 391_088_991_000_000]
    assert observations.epoch_start.tolist() == [0, 2]
    assert [sat_name(s) for s in observations.sat.tolist()] == ["G03", "R07"]
    assert [signal_name(s) for s in observations.signal.tolist()] == ["1C", "2C"]
    assert observations.code_m.tolist() == [2.2e7, 2.1e7]
    assert observations.phase_cyc.tolist() == [1.15e8, 9.1e7]
    assert observations.doppler_hz.tolist() == [-1234.5, 100.25]
    assert observations.cn0_dbhz.tolist() == [48.0, 41.0]
    assert observations.glonass_channel[7] == 5
    assert observations.glonass_channel[8] == NO_CHANNEL
    assert observations.meta.leap_seconds == navigation.leap_seconds == 18
    assert (observations.meta.path, observations.meta.format) == ("here.ubx", "ubx")
    assert len(navigation.kepler) == len(navigation.states) == 0
    assert any("RXM-SFRBX" in warning for warning in observations.meta.warnings)


@pytest.mark.parametrize(
    ("gnss", "sv", "sig", "name"),
    [
        (0, 32, 0, "G32 1C"), (0, 1, 3, "G01 2L"), (0, 1, 4, "G01 2S"), (0, 1, 6, "G01 5I"),
        (0, 1, 7, "G01 5Q"),
        (1, 131, 0, "S31 1C"),
        (2, 36, 0, "E36 1C"), (2, 1, 1, "E01 1B"), (2, 1, 3, "E01 5I"), (2, 1, 4, "E01 5Q"),
        (2, 1, 5, "E01 7I"),
        (2, 1, 6, "E01 7Q"), (2, 1, 8, "E01 6B"), (2, 1, 9, "E01 6C"),
        (3, 63, 0, "C63 2I"), (3, 2, 1, "C02 2I"), (3, 9, 2, "C09 7I"), (3, 2, 3, "C02 7I"),
        (3, 9, 4, "C09 6I"),
        (3, 9, 5, "C09 1P"), (3, 9, 6, "C09 1D"), (3, 9, 7, "C09 5P"), (3, 9, 8, "C09 5D"),
        (3, 2, 10, "C02 6I"),
        (5, 4, 0, "J04 1C"), (5, 4, 1, "J04 1Z"), (5, 4, 4, "J04 2S"), (5, 4, 5, "J04 2L"),
        (5, 4, 8, "J04 5I"),
        (5, 4, 9, "J04 5Q"),
        (6, 24, 0, "R24 1C"), (6, 24, 2, "R24 2C"),
        (7, 14, 0, "I14 5A"),
    ],
)  # fmt: skip
def test_signal_identities(gnss, sv, sig, name):
    observations, _ = parse_ubx(rawx(WEEK, 10.0, [measurement(gnss, sv, sig=sig)]))
    assert f"{sat_name(int(observations.sat[0]))} {signal_name(int(observations.signal[0]))}" == name


def test_version_0_has_no_signal_identity():
    """The byte was reserved: whatever it holds, the signal is L1."""
    observations, _ = parse_ubx(rawx(WEEK, 10.0, [measurement(0, 3, sig=3)], version=0))
    assert signal_name(int(observations.signal[0])) == "1C"


def test_invalid_parts_are_nan():
    rows = [measurement(0, 1, track=1), measurement(0, 2, track=6), measurement(0, 3, code=np.nan, cn0=0)]
    observations, _ = parse_ubx(rawx(WEEK, 10.0, rows))
    assert np.isnan(observations.phase_cyc).tolist() == [True, False, False]
    assert np.isnan(observations.code_m).tolist() == [False, True, True]
    assert np.isnan(observations.cn0_dbhz).tolist() == [False, False, True]


def test_unknown_satellites_and_signals_are_counted():
    rows = [measurement(6, 255), measurement(4, 1), measurement(0, 5, sig=99), measurement(0, 6)]
    observations, _ = parse_ubx(rawx(WEEK, 10.0, rows))
    assert [sat_name(s) for s in observations.sat.tolist()] == ["G06"]
    assert any(warning.startswith("3 measurements of unknown") for warning in observations.meta.warnings)


def lli_of(*second_epoch_arguments, first=None, step_s=1.0):
    """LLI of G03 in the second of two epochs."""
    log = epochs(
        [measurement(0, 3, **(first or {}))], [measurement(0, 3, **second_epoch_arguments[0])], step_s=step_s
    )
    return int(parse_ubx(log)[0].lli[1])


def test_loss_of_lock():
    steady = {"first": {"lock_ms": 20_000}}
    assert lli_of({"lock_ms": 21_000}, **steady) == 0
    assert lli_of({"lock_ms": 64_500}, first={"lock_ms": 64_500}) == 0
    # The counter went back, or restarted within the second.
    assert lli_of({"lock_ms": 19_999}, **steady) == LLI_SLIP
    assert lli_of({"lock_ms": 900}, first={"lock_ms": 100}) == LLI_SLIP
    assert lli_of({"lock_ms": 0}, first={"lock_ms": 0}) == LLI_SLIP
    # Over a gap the lock must be at least as old as the gap, however large the counter is.
    assert lli_of({"lock_ms": 30_000}, step_s=10.0, **steady) == 0
    assert lli_of({"lock_ms": 21_000}, step_s=30.0, **steady) == LLI_SLIP
    assert lli_of({"lock_ms": 64_500}, first={"lock_ms": 64_500}, step_s=65.0) == LLI_SLIP


def test_half_cycles():
    """Bit 4 of the tracking status: resolved; bit 8: half a cycle is subtracted, whose change is a jump."""
    assert lli_of({"track": 3}, first={"track": 3}) == LLI_HALF_CYCLE
    assert lli_of({"track": 7}, first={"track": 3}) == 0
    assert lli_of({"track": 15}, first={"track": 3}) == LLI_SLIP
    assert lli_of({"track": 15}, first={"track": 15}) == 0
    assert lli_of({"track": 7}, first={"track": 15}) == LLI_SLIP


def test_lock_is_compared_with_the_last_phase_not_the_last_row():
    """Between two phases the signal had only code: the lock must reach back to the older phase."""
    log = epochs(
        [measurement(0, 3, lock_ms=5_000)],
        [measurement(0, 3, lock_ms=6_000, track=1)],
        [measurement(0, 3, lock_ms=1_500)],
        [],
        [measurement(0, 3, lock_ms=3_500)],
    )
    observations, _ = parse_ubx(log)
    assert observations.lli.tolist() == [0, 0, LLI_SLIP, 0]
    assert np.diff(observations.epoch_start).tolist() == [1, 1, 1, 0, 1]


def test_cut_frames_do_not_hide_the_next_one():
    """The length of a cut frame reaches over the frames behind it; they are found all the same."""
    whole = epochs(*[[measurement(0, k + 1)] for k in range(5)])
    size = len(whole) // 5
    damaged = whole[: 2 * size + 20] + whole[3 * size :]
    observations, _ = parse_ubx(damaged)
    assert [sat_name(s) for s in observations.sat.tolist()] == ["G01", "G02", "G04", "G05"]
    assert any(warning.startswith("1 UBX messages are cut off") for warning in observations.meta.warnings)


def test_other_protocols_in_between():
    nmea = b"$GNGGA,,,,,,0,00,99.99,,,,,,*56\r\n"
    rtcm = bytes.fromhex("D300133ED7D30202980EDEEF34B4BD62AC0941986F33360B98")
    rows = [[measurement(0, k + 1)] for k in range(3)]
    parts = [rawx(WEEK, 10.0 + k, row) for k, row in enumerate(rows)]
    plain, _ = parse_ubx(b"".join(parts))
    mixed, _ = parse_ubx(b"\0\xb5" + nmea + rtcm.join(parts) + nmea + b"\xb5\x62\x02")
    np.testing.assert_array_equal(mixed.time_ns, plain.time_ns)
    np.testing.assert_array_equal(mixed.sat, plain.sat)


def test_a_frame_inside_a_payload_is_payload():
    inner = rawx(WEEK, 11.0, [measurement(0, 9)])
    log = rawx(WEEK, 10.0, [measurement(0, 3)]) + frame(0x0D01, b"text" + inner)
    observations, _ = parse_ubx(log)
    assert [sat_name(s) for s in observations.sat.tolist()] == ["G03"]
    assert observations.meta.warnings[0].startswith("the log holds no UBX-RXM-SFRBX")


def test_time_that_repeats_or_goes_back():
    parts = [
        rawx(WEEK, tow, [measurement(0, sv)]) for tow, sv in ((12.0, 1), (10.0, 2), (12.0, 3), (11.0, 4))
    ]
    observations, _ = parse_ubx(b"".join(parts))
    assert [sat_name(s) for s in observations.sat.tolist()] == ["G02", "G04", "G01"]
    assert np.all(np.diff(observations.time_ns) == NS_PER_S)
    (warning,) = (w for w in observations.meta.warnings if "time goes back" in w)
    assert "at 2 places" in warning
    assert "1 repeated ones left out" in warning


def test_epochs_without_valid_time_are_left_out():
    log = rawx(0, 7_835.0, [measurement(0, 1)], status=0) + rawx(WEEK, 10.0, [measurement(0, 2)])
    observations, _ = parse_ubx(log)
    assert observations.n_epochs == 1
    assert any("before the receiver knew the time" in warning for warning in observations.meta.warnings)


def test_count_that_contradicts_the_length():
    log = rawx(WEEK, 10.0, [measurement(0, 1)], count=2) + rawx(WEEK, 11.0, [measurement(0, 2)])
    observations, _ = parse_ubx(log)
    assert observations.n_epochs == 1
    assert any("whose length contradicts" in warning for warning in observations.meta.warnings)


def test_rxm_raw_of_older_receivers():
    def row(sv, quality, lli):
        return struct.pack("<ddfBbbB", 1.1e8, 2.2e7, 500.0, sv, quality, 44, lli)

    def raw(tow_ms, rows):
        return frame(0x0210, struct.pack("<ihBB", tow_ms, 1650, len(rows), 0) + b"".join(rows))

    log = raw(1000, [row(3, 7, 0), row(123, 7, 0), row(5, 4, 0)]) + raw(2000, [row(3, 7, 1), row(123, 7, 2)])
    observations, _ = parse_ubx(log)
    assert [sat_name(s) for s in observations.sat.tolist()] == ["G03", "G05", "S23", "G03", "S23"]
    assert observations.lli.tolist() == [0, 0, 0, LLI_SLIP, LLI_HALF_CYCLE]
    assert np.isnan(observations.phase_cyc).tolist() == [False, True, False, False, False]
    assert observations.time_ns.tolist() == [1650 * NS_PER_WEEK + NS_PER_S, 1650 * NS_PER_WEEK + 2 * NS_PER_S]


def test_receiver_and_position():
    version = b"EXT CORE 1.00".ljust(30, b"\0") + b"00190000".ljust(10, b"\0")
    version += b"FWVER=HPG 1.32".ljust(30, b"\0") + b"MOD=ZED-F9P".ljust(30, b"\0")
    solution = struct.pack("<IihBB3i", 0, 0, WEEK, 3, 0xDF, 377_408_900, -60_166_182, 508_932_138).ljust(
        52, b"\0"
    )
    log = frame(0x0A04, version) + frame(0x0106, solution) + rawx(WEEK, 10.0, [measurement(0, 3)])
    meta = parse_ubx(log)[0].meta
    assert (meta.receiver_type, meta.receiver_firmware) == ("ZED-F9P", "HPG 1.32")
    assert meta.approx_position_ecef_m == (3_774_089.0, -601_661.82, 5_089_321.38)


def test_navigation_bits_of_no_use_are_counted():
    log = rawx(WEEK, 10.0, [measurement(0, 3)])
    log += sfrbx(0, 3, [0x8B000000] * 10, sig=4) + sfrbx(1, 131, [0] * 9) + sfrbx(0, 3, [0] * 10)
    log += frame(0x0213, bytes([0, 3, 0, 0, 10, 0, 2, 0, 1, 2, 3, 4]))
    _, navigation = parse_ubx(log)
    assert navigation.skipped == {
        "GPS signal 4": 1,
        "SBAS signal 0": 1,
        "LNAV preamble": 1,
        "SFRBX of unknown form": 1,
    }


@pytest.mark.parametrize(
    ("content", "sentence", "byte_offset"),
    [
        (b"\0" * 300, "no intact UBX message was found in 300 bytes", 0),
        (b"     3.04           OBSERVATION DATA    M" * 9, "give a log of a u-blox receiver", 0),
        (frame(0x0107, bytes(92)) + frame(0x0135, bytes(8)), "enable UBX-RXM-RAWX and UBX-RXM-SFRBX", 116),
        (rawx(0, 7_835.0, [measurement(0, 1)]), "have no valid time", 0),
    ],
)
def test_refusals(tmp_path, content, sentence, byte_offset):
    path = tmp_path / "log.ubx"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=sentence) as caught:
        read_ubx(path)
    assert caught.value.path == str(path)
    assert caught.value.byte_offset == byte_offset
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_empty_file(tmp_path):
    path = tmp_path / "log.ubx"
    path.write_bytes(b"")
    with pytest.raises(FormatError, match=r"log\.ubx"):
        read_ubx(path)


def test_find_frames_counts_headers_outside_of_frames():
    buffer = np.frombuffer(b"\xb5\x62" + frame(0x0107, b"\xb5\x62ab") + b"\xb5", dtype=np.uint8)
    offset, length, kind, n_damaged = find_frames(buffer)
    assert (offset.tolist(), length.tolist(), kind.tolist(), n_damaged) == ([2], [4], [0x0107], 1)
