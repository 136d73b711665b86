"""OEM3 messages by hand, the manual's ephemeris, lock times and flags, quantisation, refusals."""

import struct

import numpy as np
import pytest

import truenorth as tn
from simulated_sky import KLOBUCHAR, START_NS, navigation
from truenorth.errors import FormatError
from truenorth.formats.novatel_oem3 import find_messages, parse_oem3, read_oem3
from truenorth.formats.novatel_oem3_writer import encode_oem3, write_oem3
from truenorth.navigation import KEPLER_COLUMNS, build_navigation
from truenorth.observations import LLI_HALF_CYCLE, LLI_SLIP, NO_CHANNEL, Observations, signal_id
from truenorth.timescales import NS_PER_S, gpst_from_week

L1_M = 299_792_458.0 / 1_575.42e6
TRACKED = 4 | 1 << 9 | 1 << 10 | 1 << 11  # phase lock loop, phase, parity, code
# NovAtel OM-20000041, page 192: the REPA example.
MANUAL_PRN = 14
MANUAL_SUBFRAMES = bytes.fromhex(
    "8B09DC17B9079DD7007D5DE404A9B2D04CF671C6036612560000021804FD"
    "8B09DC17B98A66FF713092F12B359DFF7A0254088E1656A10BE2FF125655"
    "8B09DC17B78F0027192056EAFFDF2724C9FE159675A8B468FFA8D066F743"
)


def message(identity, data):
    rest = struct.pack("<II", identity, 12 + len(data)) + data
    checksum = 0xAA ^ 0x44 ^ 0x11
    for byte in rest:
        checksum ^= byte
    return b"\xaa\x44\x11" + bytes([checksum]) + rest


def rgeb(tow_s, *ranges, week=925, status=0xFF):
    head = struct.pack("<idiI", week, tow_s, len(ranges), status)
    return message(32, head + b"".join(ranges))


def plain(prn, code_m=2.2e7, adr=-1.15e8, doppler=-1234.5, cn0=45.0, lock_s=10.0, status=TRACKED):
    return struct.pack("<idfdffffI", prn, code_m, 0.1, adr, 0.01, doppler, cn0, lock_s, status)


def rged(tow_cs, *ranges, week=925, status=0xFF):
    return message(65, struct.pack("<HHII", len(ranges), week, tow_cs, status) + b"".join(ranges))


def compressed(prn, code=2_816_000_000, adr=0, doppler=-316_032, cn0=25, lock=320, status=TRACKED):
    """One record of 160 bits, put together as one integer by the bit numbers of the manual."""
    bits = prn | cn0 << 6 | lock << 11 | (adr & 0xFFFFFFFF) << 32
    bits |= (code >> 32 & 0xF) << 64 | (doppler & 0xFFFFFFF) << 68 | (code & 0xFFFFFFFF) << 96
    bits |= 3 << 128 | 2 << 132 | (status & 0xFFFFFF) << 136
    return bits.to_bytes(20, "little")


def observations(n_epochs=5, sats=(3, 7), signals=("1C",), *, step_ns=NS_PER_S, **columns):
    n_rows = n_epochs * len(sats) * len(signals)
    shape = (n_epochs, len(sats), len(signals))
    epoch = np.broadcast_to(np.arange(n_epochs)[:, None, None], shape).reshape(-1)
    sat = np.broadcast_to(np.array(sats)[None, :, None], shape).reshape(-1)
    signal = np.broadcast_to(np.array([signal_id(s) for s in signals]), shape).reshape(-1)
    code_m = 2.1e7 + 3e5 * sat + 700.0 * epoch
    return Observations(
        time_ns=START_NS + step_ns * np.arange(n_epochs),
        epoch_start=np.arange(n_epochs + 1) * len(sats) * len(signals),
        sat=sat.astype(np.int16),
        signal=signal.astype(np.int16),
        **{
            "code_m": code_m,
            "phase_cyc": code_m / L1_M + 1000.0 * sat + 0.123,
            "doppler_hz": np.full(n_rows, -3678.4321),
            "cn0_dbhz": np.full(n_rows, 44.6),
            "lli": np.zeros(n_rows, dtype=np.uint8),
        }
        | columns,
        clock_offset_s=np.full(n_epochs, np.nan),
        glonass_channel=np.full(100, NO_CHANNEL, dtype=np.int8),
    )


def test_plain_ranges_by_hand():
    obs, nav = parse_oem3(rgeb(339_200.25, plain(5), plain(31, lock_s=0.0, status=TRACKED & ~(1 << 10))))
    assert obs.time_ns.tolist() == [gpst_from_week(925, 339_200.25)]
    assert obs.sat.tolist() == [5, 31]
    assert obs.signal.tolist() == [signal_id("1C")] * 2
    assert obs.code_m.tolist() == [2.2e7, 2.2e7]
    assert obs.phase_cyc.tolist() == [1.15e8, 1.15e8]
    assert obs.doppler_hz.tolist() == [-1234.5, -1234.5]
    assert obs.cn0_dbhz.tolist() == [45.0, 45.0]
    assert obs.lli.tolist() == [0, LLI_SLIP | LLI_HALF_CYCLE]
    assert len(nav.kepler) == 0
    assert "no REPB" in obs.meta.warnings[0]


def test_compressed_ranges_by_hand():
    code_m = 2_816_000_000 / 128.0  # 22,000 km; the phase is a whole number of rolls away
    rolls = round(code_m / L1_M / 2**23)
    obs, _ = parse_oem3(rged(33_920_025, compressed(5, adr=-256 * 1000)))
    assert obs.time_ns.tolist() == [gpst_from_week(925, 339_200.25)]
    assert obs.code_m.tolist() == [code_m]
    assert obs.phase_cyc.tolist() == [1000.0 + rolls * 2.0**23]
    assert obs.doppler_hz.tolist() == [-1234.5]
    assert obs.cn0_dbhz.tolist() == [45.0]
    assert obs.lli.tolist() == [0]


def test_tracking_status():
    status = {
        "1C": TRACKED,
        "2W": TRACKED | 1 << 20 | 2 << 21,
        "2P": TRACKED | 1 << 20 | 1 << 21,
    }
    log = rgeb(
        1.0,
        *(plain(k + 1, status=s) for k, s in enumerate(status.values())),
        plain(9, status=TRACKED & ~(1 << 9)),
        plain(10, status=TRACKED & ~(1 << 11)),
        plain(11, status=TRACKED | 1 << 15),  # GLONASS
        plain(33),
        plain(0),
    )
    obs, _ = parse_oem3(log)
    assert obs.sat.tolist() == [1, 2, 3, 9, 10]
    assert obs.signal[:3].tolist() == [signal_id(name) for name in status]
    np.testing.assert_array_equal(np.isnan(obs.phase_cyc), [False, False, False, True, False])
    np.testing.assert_array_equal(np.isnan(obs.code_m), [False, False, False, False, True])
    assert any("3 ranges of other systems" in text for text in obs.meta.warnings)


def test_the_ephemeris_of_the_manual():
    data = struct.pack("<i", MANUAL_PRN) + MANUAL_SUBFRAMES + bytes(2)
    obs, nav = parse_oem3(rgeb(1.0, plain(5), week=800) + message(14, data))
    assert nav.kepler.sat.tolist() == [MANUAL_PRN]
    # An orbit of the constellation: the fields stand where the reader looks for them.
    assert nav.kepler.column("sqrt_a")[0] == pytest.approx(5153.7, abs=2.0)
    assert 0.0 < nav.kepler.column("eccentricity")[0] < 0.03
    assert np.degrees(nav.kepler.column("i0_rad")[0]) == pytest.approx(55.0, abs=3.0)
    assert int(nav.kepler.iode[0]) == int(nav.kepler.iodc[0]) & 0xFF
    # Written again, the same ephemeris has the same 720 bits but for telemetry, alert and parity bits.
    log, _ = encode_oem3(obs, nav)
    offset, size, kind, _ = find_messages(np.frombuffer(log, dtype=np.uint8))
    begin = int(offset[kind == 14][0])
    assert size[kind == 14].tolist() == [108]
    written = log[begin + 16 : begin + 106]
    for k in range(3):
        ours, theirs = written[30 * k : 30 * k + 30], MANUAL_SUBFRAMES[30 * k : 30 * k + 30]
        assert ours[0] == theirs[0]
        # Bits of no field: code on L2, P data flag, reserved words of subframe 1, age of data offset.
        fields = {0: [*range(6, 7), *range(20, 29)], 1: [*range(6, 29)], 2: [*range(6, 29)]}[k]
        assert [ours[i] for i in fields] == [theirs[i] for i in fields]


def test_lock_times_say_where_lock_was_lost():
    times_and_locks = [
        (0, 0.0, True),  # just acquired
        (1, 1.0, False),
        (2, 2.0, False),
        (3, 0.5, True),  # lost and found between
        (4, 1.47, False),  # a quantum short
        (5, 2.40, True),  # more than a quantum short
        (9, 6.40, False),  # four seconds without messages, never lost
        (20, 3.0, True),
    ]
    for pack in (
        lambda t, lock: rgeb(t, plain(5, lock_s=lock)),
        lambda t, lock: rged(100 * t, compressed(5, lock=round(32 * lock))),
    ):
        obs, _ = parse_oem3(b"".join(pack(t, lock) for t, lock, _ in times_and_locks))
        assert ((obs.lli & LLI_SLIP) != 0).tolist() == [slip for _, _, slip in times_and_locks]


def test_the_lock_time_of_compressed_ranges_rolls_over():
    last = 2**21 - 16  # half a second before
    obs, _ = parse_oem3(rged(0, compressed(5, lock=last)) + rged(100, compressed(5, lock=16)))
    assert obs.lli.tolist() == [0, 0]
    obs, _ = parse_oem3(rged(0, compressed(5, lock=last)) + rged(100, compressed(5, lock=15 + 16)))
    assert obs.lli.tolist() == [0, LLI_SLIP]


def test_a_parity_that_becomes_known_may_turn_the_phase():
    log = rgeb(1.0, plain(5, lock_s=1.0, status=TRACKED & ~(1 << 10))) + rgeb(2.0, plain(5, lock_s=2.0))
    assert parse_oem3(log)[0].lli.tolist() == [LLI_HALF_CYCLE, LLI_SLIP]


def test_rolls_stay_within_an_arc():
    """Half a roll between code and phase, and code noise: the manual's rule would jump by 2^23 cycles."""
    n = 20
    code_m = 2.2e7 + np.where(np.arange(n) % 2, 3.0, -3.0)
    obs = observations(n, (3,), code_m=code_m, phase_cyc=2.2e7 / L1_M + 2.0**22 + np.zeros(n))
    again, _ = parse_oem3(encode_oem3(obs)[0])
    assert np.ptp(again.phase_cyc) == 0.0


@pytest.mark.parametrize("ranges", ["RGED", "RGEB"])
def test_round_trip(tmp_path, ranges):
    rng = np.random.default_rng(3)
    signals = ("1C", "2W")
    n = 50 * 3 * 2
    obs = observations(50, (1, 17, 32), signals, cn0_dbhz=rng.uniform(20.0, 51.0, n))
    band = np.array([1, 2])[obs.signal // 100 - 1]
    wavelength_m = 299_792_458.0 / np.array([np.nan, 1_575.42e6, 1_227.60e6])[band]
    obs.phase_cyc[:] = obs.code_m / wavelength_m + 1e6 * obs.sat + rng.uniform(size=n)
    obs.lli[rng.random(n) < 0.1] = LLI_SLIP
    obs.phase_cyc[rng.random(n) < 0.1] = np.nan
    obs.lli[np.isnan(obs.phase_cyc)] = 0
    path = tmp_path / "log.oem3"
    assert write_oem3(path, obs, navigation((0,)), ranges=ranges) == 0
    again, nav = read_oem3(path)
    for name in ("time_ns", "epoch_start", "sat", "signal", "lli"):
        np.testing.assert_array_equal(getattr(again, name), getattr(obs, name), err_msg=name)
    np.testing.assert_array_equal(np.isnan(again.phase_cyc), np.isnan(obs.phase_cyc))
    # Half a unit of each field; plain ranges are doubles and singles.
    limits = {"code_m": 1 / 256, "phase_cyc": 1 / 512, "doppler_hz": 1 / 512, "cn0_dbhz": 0.5}
    if ranges == "RGEB":
        limits = {"code_m": 0.0, "phase_cyc": 0.0, "doppler_hz": 1.3e-4, "cn0_dbhz": 2e-6}
    for name, limit in limits.items():
        off = getattr(again, name) - getattr(obs, name)
        if name == "phase_cyc":
            off -= 2.0**23 * np.rint(off / 2.0**23)
        assert np.nanmax(np.abs(off)) <= limit + 1e-9 * (limit > 0), name
    assert again.meta.warnings == ()
    np.testing.assert_allclose(nav.klobuchar["G"], KLOBUCHAR)
    assert tn.summarize(path).format == "novatel_oem3"


def test_ephemerides_come_back():
    original = navigation((0, 2))
    log, _ = encode_oem3(observations(), original)
    _, nav = parse_oem3(log)
    gps = original.kepler.sat < 100
    for name in ("sat", "toe_ns", "toc_ns", "transmission_ns", "iode", "iodc", "health"):
        np.testing.assert_array_equal(getattr(nav.kepler, name), getattr(original.kepler, name)[gps], name)
    # Half a unit of the coarsest fields: m0 and others 2^-31 pi, af0 2^-31 s, tgd 2^-31 s.
    scale = np.array([2.0**-20, 2.0**-34, *[2.0**-31] * 4, *[2.0**-43] * 3])
    off = nav.kepler.elements - original.kepler.elements[gps]
    off[:, 2:6] = (off[:, 2:6] + np.pi) % (2.0 * np.pi) - np.pi
    assert np.all(np.abs(off[:, :9]) <= 4.0 * scale)
    again, _ = encode_oem3(observations(), nav)
    assert parse_oem3(again)[1].kepler.elements.tolist() == nav.kepler.elements.tolist()


def test_ephemerides_stand_before_the_epochs_that_they_precede():
    nav = navigation((0,), klobuchar=False)
    rows = [
        (k + 1, 0, START_NS, START_NS, START_NS + 6 * k * NS_PER_S, 1, 1, 0, nav.kepler.elements[k])
        for k in (0, 1)
    ]
    log, _ = encode_oem3(observations(10), build_navigation(rows))
    _, _, kind, _ = find_messages(np.frombuffer(log, dtype=np.uint8))
    assert kind.tolist() == [14, *[65] * 6, 14, *[65] * 4]


def test_rows_that_a_log_cannot_hold_are_left_out():
    obs = observations(2, (3, 105, 207), ("1C", "5Q"))
    obs.doppler_hz[0] = np.nan
    data, n_left_out = encode_oem3(obs)
    again, _ = parse_oem3(data)
    assert n_left_out == obs.n_rows - 1
    assert (again.n_epochs, again.n_rows) == (2, 1)


def test_a_message_in_a_message_and_a_cut_one():
    inner = rgeb(1.0, plain(5))
    outer = message(99, inner)  # a pass-through of what came in at another port
    cut = rgeb(2.0, plain(6))[:-7]
    log = b"$POSA,...*00\r\n" + outer + cut + rgeb(3.0, plain(7))
    _, size, kind, n_damaged = find_messages(np.frombuffer(log, dtype=np.uint8))
    assert kind.tolist() == [99, 32]
    assert n_damaged == 1
    obs, _ = parse_oem3(log)
    assert obs.sat.tolist() == [7]
    n_rejected = len(log) - int(size.sum())
    assert f"{n_rejected} bytes belong to no intact message, 1 headers" in obs.meta.warnings[0]


@pytest.mark.parametrize(("n_ranges", "length"), [(1, 20), (2, 40)], ids=["reaches into", "holds"])
def test_a_cut_message_whose_checksum_is_right_by_chance(n_ranges, length):
    """It reaches into the next message, or holds it: the next one counts."""
    cut = bytearray(rgeb(2.0, *[plain(6)] * n_ranges)[:length])
    log = cut + rgeb(3.0, plain(7)) + bytes(4)
    size = int.from_bytes(cut[8:12], "little")
    log[3] ^= int(np.bitwise_xor.reduce(np.frombuffer(bytes(log[:size]), dtype=np.uint8)))
    assert (size < length + 76) == (n_ranges == 1)
    _, _, kind, n_damaged = find_messages(np.frombuffer(bytes(log), dtype=np.uint8))
    assert kind.tolist() == [32]
    assert n_damaged == 1
    assert parse_oem3(bytes(log))[0].sat.tolist() == [7]


def test_time_that_goes_back_or_repeats():
    log = rgeb(3.0, plain(5)) + rged(200, compressed(5)) + rged(300, compressed(5)) + rgeb(1.0, plain(5))
    obs, _ = parse_oem3(log)
    assert obs.time_ns.tolist() == [gpst_from_week(925, t) for t in (1.0, 2.0, 3.0)]
    assert obs.cn0_dbhz.tolist() == [45.0] * 3
    assert any("goes back or repeats at 2 places" in text for text in obs.meta.warnings)
    assert obs.phase_cyc[2] == 1.15e8  # the plain message


def test_refusals():
    with pytest.raises(FormatError, match="no intact OEM3 message"):
        parse_oem3(b"\xaa\x44\x11" * 30, path="log.oem3")
    with pytest.raises(FormatError, match=r"holds 1 OEM3 messages \(message 33\) but no ranges"):
        parse_oem3(message(33, bytes(12)))
    with pytest.raises(FormatError, match="no valid time"):
        parse_oem3(rgeb(1.0, plain(5), status=1 << 9))
    with pytest.raises(FormatError, match="RGED or RGEB, not as 'RGEC'"):
        encode_oem3(observations(), ranges="RGEC")
    with pytest.raises(FormatError, match="an OEM3 log holds nothing else"):
        encode_oem3(observations(2, (207,)))
    with pytest.raises(FormatError, match="holds times to 1/100 s"):
        encode_oem3(observations(3, step_ns=1_000_000))
    with pytest.raises(FormatError, match=r"the Doppler at 2024-06-24T08:00:00\.000 GPST does not fit"):
        encode_oem3(observations(1, (3,), doppler_hz=np.array([1e6])))
    nav = navigation((0,))
    nav.kepler.elements[0, KEPLER_COLUMNS.index("eccentricity")] = 0.9
    with pytest.raises(FormatError, match="an ephemeris of G01 does not fit"):
        encode_oem3(observations(), nav)
