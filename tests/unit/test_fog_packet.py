"""Gyro packets by hand, codings, resynchronisation, the log with time stamps, refusals."""

import numpy as np
import pytest

import truenorth as tn
from truenorth.errors import ConfigError, FormatError
from truenorth.formats.fog_packet import (
    FogCoding,
    decode_packets,
    encode_fog_log,
    encode_packets,
    implausible_packets,
    parse_fog_packets,
    read_fog_packets,
    write_fog_packets,
)
from truenorth.sensor_log import SensorLog
from truenorth.timescales import NS_PER_S, gpst_from_week

START_NS = gpst_from_week(929, 339_200.0)
STEP_NS = NS_PER_S // 10


def gyro(rates, temperatures=121, status=0, **meta):
    n = len(rates)
    columns = {
        "rate_count": np.array(rates, dtype=np.int64),
        "temperature_count": np.broadcast_to(np.int64(temperatures), n).copy(),
        "status": np.broadcast_to(np.int64(status), n).copy(),
    }
    return SensorLog("gyro", START_NS + STEP_NS * np.arange(n), columns, meta)


def same_columns(log, other):
    return all(np.array_equal(log.columns[name], other.columns[name]) for name in other.columns)


def test_one_packet_by_hand():
    # 1 F r11..r6 | 0 r5..r0 t7 | 0 t6..t0 with rotation 101010 011011 and temperature 1 0100101.
    offset, columns, rejected = decode_packets(bytes([0b1_0_101010, 0b0_011011_1, 0b0_0100101]))
    assert offset.tolist() == [0]
    assert columns["rate_count"].tolist() == [0b101010011011 - 2048]
    assert columns["temperature_count"].tolist() == [0b10100101]
    assert columns["status"].tolist() == [0]
    assert rejected == 0


def test_two_s_complement_by_hand():
    coding = FogCoding(rotation="twos_complement", temperature="twos_complement")
    _, columns, _ = decode_packets(bytes([0b1_1_111111, 0b0_111110_1, 0b0_1111111]), coding)
    assert columns["rate_count"].tolist() == [-2]
    assert columns["temperature_count"].tolist() == [-1]
    assert columns["status"].tolist() == [1]


@pytest.mark.parametrize("rotation", ["offset_binary", "twos_complement"])
@pytest.mark.parametrize("temperature", ["unsigned", "twos_complement"])
def test_all_values_come_back(rotation, temperature):
    coding = FogCoding(rotation=rotation, temperature=temperature)
    rates = np.arange(-2048, 2048)
    counts = np.arange(4096) % 256 - (128 if temperature == "twos_complement" else 0)
    log = gyro(rates, status=rates % 2)
    log.columns["temperature_count"][:] = counts
    _, columns, rejected = decode_packets(encode_packets(log, coding).reshape(-1), coding)
    assert rejected == 0
    for name, column in log.columns.items():
        np.testing.assert_array_equal(columns[name], column)


def test_a_lost_byte_costs_one_packet_and_a_surplus_one_too():
    stream = encode_packets(gyro(range(10))).tobytes()
    expected = {
        "lost": (stream[:13] + stream[14:], [0, 1, 2, 3, 5, 6, 7, 8, 9], 1),
        "lost first byte": (stream[:12] + stream[13:], [0, 1, 2, 5, 6, 7, 8, 9], 1),
        "surplus": (stream[:13] + b"\x00" + stream[13:], [0, 1, 2, 3, 5, 6, 7, 8, 9], 1),
        "sync bit in the middle": (
            stream[:13] + bytes([stream[13] | 0x80]) + stream[14:],
            [0, 1, 2, 3, 5, 6, 7, 8, 9],
            2,
        ),
        "cut at both ends": (stream[2:-1], list(range(1, 9)), 1),
    }
    for name, (damaged, rates, n_rejected) in expected.items():
        _, columns, rejected = decode_packets(damaged)
        assert columns["rate_count"].tolist() == rates, name
        assert rejected == n_rejected, name


def test_times_of_a_raw_stream_count_the_lost_packets():
    stream = bytearray(encode_packets(gyro(range(100))).tobytes())
    stream[30] &= 0x7F  # the first byte of packet 10: packet 9 has no end, packet 10 no beginning
    log = parse_fog_packets(bytes(stream), start_ns=START_NS, rate_hz=10.0)
    kept = [k for k in range(100) if k not in (9, 10)]
    np.testing.assert_array_equal(log.time_ns, START_NS + STEP_NS * np.array(kept))
    assert log.meta["time"] == "given"
    assert log.meta["n_rejected_packets"] == 1
    assert log.meta["n_rejected_bytes"] == 6


def test_log_with_time_stamps(tmp_path):
    coding = FogCoding("twos_complement", "unsigned", 0.25, -10.0)
    log = gyro(range(-50, 50), status=[k % 7 == 0 for k in range(100)])
    write_fog_packets(tmp_path / "gyro.fog", log, coding=coding)
    again = read_fog_packets(tmp_path / "gyro.fog")
    np.testing.assert_array_equal(again.time_ns, log.time_ns)
    assert same_columns(again, log)
    assert again.meta["temperature_step_degc"] == 0.25
    assert again.meta["rotation"] == "twos_complement"
    assert again.meta["warnings"] == ""
    by_content = tn.read(tmp_path / "gyro.fog")
    assert by_content.kind == "gyro"
    assert same_columns(by_content, log)


def test_the_coding_follows_from_the_log():
    log = gyro([0], temperature_step_degc=1.0, temperature_zero_degc=-30.0)
    again = parse_fog_packets(encode_fog_log(log))
    assert again.meta["temperature_step_degc"] == 1.0
    assert again.meta["temperature_zero_degc"] == -30.0


def test_a_packet_may_come_in_two_reads_of_the_port():
    one, two = (row.tobytes().hex() for row in encode_packets(gyro([7, 8])))
    text = f"# fog-packet 1\n929 10.0 {one}{two[:2]}\n929 10.1 {two[2:]}\n929 10.2 8000\n"
    log = parse_fog_packets(text.encode())
    assert log.columns["rate_count"].tolist() == [7, 8]
    assert log.time_ns.tolist() == [gpst_from_week(929, 10.0)] * 2
    assert log.meta["n_rejected_packets"] == 1


def test_damaged_lines_are_counted():
    lines = encode_fog_log(gyro(range(5))).decode().splitlines()
    head, body = lines[:5], lines[5:]
    body[1] = "gibberish"
    body[3] = body[3].replace("339200", "999999")  # no second of a week
    log = parse_fog_packets("\r\n".join([*head, *body]).encode())
    assert log.columns["rate_count"].tolist() == [0, 2, 4]
    assert log.meta["n_rejected_lines"] == 2
    assert "2 lines" in log.meta["warnings"]


def test_time_that_goes_back_is_sorted():
    lines = encode_fog_log(gyro(range(5))).decode().splitlines()
    lines[5], lines[6] = lines[6], lines[5]
    log = parse_fog_packets("\n".join(lines).encode())
    assert log.columns["rate_count"].tolist() == [0, 1, 2, 3, 4]
    assert "time goes back" in log.meta["warnings"]


def test_raw_stream_by_content_says_that_it_has_no_time(tmp_path):
    write_fog_packets(tmp_path / "gyro.bin", gyro(range(50)), stamped=False)
    assert (tmp_path / "gyro.bin").stat().st_size == 150
    log = tn.read(tmp_path / "gyro.bin")
    assert log.meta["time"] == "counted"
    assert "no time" in log.meta["warnings"]
    inventory = tn.summarize(tmp_path / "gyro.bin")
    assert inventory.start_gpst == ""
    assert inventory.sensor.has_time is False
    assert "assumed" in str(inventory)


def test_inventory_of_a_log_stamped_by_a_slow_clock(tmp_path):
    """A clock of 55 ms gives steps of 55 and 110 ms; the rate is ten a second, and a gap is a gap."""
    log = gyro(np.zeros(3000, dtype=int))
    keep = np.ones(3000, dtype=bool)
    keep[1000:1100] = False
    stamped_ns = log.time_ns // 55_000_000 * 55_000_000
    columns = {name: column[keep] for name, column in log.columns.items()}
    write_fog_packets(tmp_path / "gyro.fog", SensorLog("gyro", stamped_ns[keep], columns))
    inventory = tn.summarize(tmp_path / "gyro.fog")
    assert inventory.sensor.kind == "gyro"
    assert inventory.sensor.rate_hz == pytest.approx(10.0, rel=1e-3)  # 55 ms in 300 s
    assert [gap.n_missing for gap in inventory.gaps] == [100]
    assert inventory.sensor.rejected == {"bytes": 0, "packets": 0, "lines": 0}
    assert inventory.to_dict()["sensor"]["columns"][0]["name"] == "rate_count"
    assert "rejected         0 bytes" in str(inventory)


def test_implausible_packets():
    log = gyro([0, 5, 900, 8, 300, 600, 900, 910])
    log.columns["temperature_count"][5] = 249  # the highest bit flipped
    assert np.flatnonzero(implausible_packets(log)).tolist() == [2, 5]
    assert not implausible_packets(gyro([5])).any()


@pytest.mark.parametrize(
    ("name", "value"), [("rate_count", 2048), ("rate_count", -2049), ("temperature_count", 256)]
)
def test_values_that_do_not_fit(name, value):
    log = gyro([0, 0])
    log.columns[name][1] = value
    with pytest.raises(FormatError, match=f"`{name}` is {value}"):
        encode_packets(log)


def test_a_missing_column():
    with pytest.raises(FormatError, match="a gyro packet holds `rate_count`"):
        encode_packets(SensorLog("gyro", np.zeros(1, dtype=np.int64), {"rate_radps": np.zeros(1)}))


@pytest.mark.parametrize("data", [b"", b"# fog-packet 1\n", b"\x7f" * 100, b"\xff" * 100])
def test_no_packet(data):
    with pytest.raises(FormatError, match="no gyro packet"):
        parse_fog_packets(data, path="gyro.fog")


@pytest.mark.parametrize(
    "remark", ["rotation = grey_code", "temperature_step_degc = 0", "temperature_zero_degc = nan",
               "temperature_step_degc = much", "temperature_colour = 3"]
)  # fmt: skip
def test_a_head_that_makes_no_sense(remark):
    with pytest.raises(FormatError, match="does not say how the gyro codes"):
        parse_fog_packets(f"# fog-packet 1\n# {remark}\n929 1.0 a0107e\n".encode(), path="gyro.fog")


@pytest.mark.parametrize("values", [{"rotation": "x"}, {"temperature": "x"}, {"temperature_step_degc": 0.0}])
def test_impossible_codings(values):
    with pytest.raises(ConfigError, match=next(iter(values))):
        FogCoding(**values)
