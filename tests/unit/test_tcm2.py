"""Sentences of the compass: the manual's example, missing fields, NMEA, damage, writing."""

import numpy as np
import pytest

import truenorth as tn
from truenorth.errors import FormatError
from truenorth.formats.tcm2 import encode_tcm2, parse_tcm2, read_tcm2, split_tcm2, write_tcm2
from truenorth.sensor_log import SensorLog
from truenorth.timescales import NS_PER_S, gpst_from_week

START_NS = gpst_from_week(929, 339_200.0)
STEP_NS = NS_PER_S // 10
# The example of the PNI manual, its checksum by hand.
EXAMPLE = b"$C328.3P28.4R-12.4X55.11Y12.33Z-18.43T22.3E001*29\r\n"


def sentence(body):
    """A sentence with its checksum."""
    return b"$%b*%02X\r\n" % (body, np.bitwise_xor.reduce(np.frombuffer(body, dtype=np.uint8), initial=0))


def compass(n=20, **columns):
    return SensorLog("compass", START_NS + STEP_NS * np.arange(n), columns)


def test_the_example_of_the_manual():
    log = parse_tcm2(EXAMPLE, start_ns=START_NS)
    expected = {
        "heading_magnetic_deg": 328.3,
        "pitch_deg": 28.4,
        "roll_deg": -12.4,
        "field_forward_nt": 55_110.0,
        "field_right_nt": 12_330.0,
        "field_down_nt": -18_430.0,
        "temperature_degc": 22.3,
        "anomaly": 1,
        "error_code": 1,
    }
    assert log.kind == "compass"
    assert log.time_ns.tolist() == [START_NS]
    assert {name: column[0] for name, column in log.columns.items()} == pytest.approx(expected)


def test_the_example_is_written_again():
    log = parse_tcm2(EXAMPLE, start_ns=START_NS)
    assert encode_tcm2(log, stamped=False) == EXAMPLE
    assert encode_tcm2(log) == b"929 339200.000000000 " + EXAMPLE


def test_fields_that_are_switched_off_are_missing():
    log = parse_tcm2(sentence(b"C328.3T22.3") + sentence(b"P1.0R-2.0"), start_ns=0)
    np.testing.assert_array_equal(log.columns["heading_magnetic_deg"], [328.3, np.nan])
    np.testing.assert_array_equal(log.columns["pitch_deg"], [np.nan, 1.0])
    assert "field_down_nt" not in log.columns
    assert log.columns["error_code"].tolist() == [0, 0]


def test_tilt_alone_is_a_tilt_meter():
    assert parse_tcm2(sentence(b"P1.0R-2.0"), start_ns=0).kind == "tilt"


def test_nmea_sentences():
    log = parse_tcm2(b"$HCHDM,182.3,M*21\r\n$HCHDT,200.9,T*22\r\n", start_ns=0)
    np.testing.assert_array_equal(log.columns["heading_magnetic_deg"], [182.3, np.nan])
    np.testing.assert_array_equal(log.columns["heading_true_deg"], [np.nan, 200.9])


def test_what_the_heading_counts_from_can_be_said():
    log = parse_tcm2(EXAMPLE + b"$HCHDM,182.3,M*21\r\n", start_ns=0, north="true")
    np.testing.assert_array_equal(log.columns["heading_true_deg"], [328.3, np.nan])
    np.testing.assert_array_equal(log.columns["heading_magnetic_deg"], [np.nan, 182.3])


@pytest.mark.parametrize(
    "line",
    [
        EXAMPLE.replace(b"*29", b"*28"),
        EXAMPLE.replace(b"328.3", b"329.3"),  # one digit, the checksum as before
        b"$C328.3P28.4",
        *map(sentence, (b"C4480", b"C-1.0", b"P99.0", b"R181.0", b"", b"E001", b"C1.0C1.0", b"P1.0C1.0")),
        *map(sentence, (b"HCHDM,182.3,T", b"HCHDM,,M", b"C1.0E00", b"C1..0")),
    ],
)
def test_damaged_lines_are_counted(line):
    log = parse_tcm2(EXAMPLE + line.rstrip() + b"\n" + EXAMPLE, start_ns=START_NS, rate_hz=10.0)
    # The damaged line takes its turn: the sentence after it is two tenths of a second after the first.
    assert log.time_ns.tolist() == [START_NS, START_NS + 2 * STEP_NS]
    assert log.meta["n_rejected_lines"] == 1
    assert log.meta["n_rejected_bytes"] == len(line.rstrip())


def test_the_last_sentence_of_a_line_counts():
    log = parse_tcm2(b"$C12.3P1\xff$C12" + EXAMPLE, start_ns=0)
    assert log.columns["heading_magnetic_deg"].tolist() == [328.3]


def test_a_line_without_stamp_in_a_stamped_log_is_damaged():
    log = parse_tcm2(b"# remark\n929 1.5 " + EXAMPLE + EXAMPLE + b"929 1.7 " + EXAMPLE)
    assert log.time_ns.tolist() == [gpst_from_week(929, 1.5), gpst_from_week(929, 1.7)]
    assert log.meta["n_rejected_lines"] == 1
    assert log.meta["time"] == "stamped"


@pytest.mark.parametrize("form", ["standard", "nmea"])
@pytest.mark.parametrize("stamped", [True, False])
def test_round_trip_to_the_digits_of_the_sentence(tmp_path, form, stamped):
    rng = np.random.default_rng(5)
    heading = np.append(rng.uniform(0.0, 360.0, 198), [359.97, 0.04])
    log = compass(200, heading_magnetic_deg=heading, anomaly=np.arange(200) % 3 == 0)
    tilt = compass(
        200,
        pitch_deg=rng.uniform(-50.0, 50.0, 200),
        roll_deg=rng.uniform(-50.0, 50.0, 200),
        temperature_degc=rng.uniform(-20.0, 70.0, 200),
    )
    path = tmp_path / "tcm2.log"
    write_tcm2(path, log, tilt=None if form == "nmea" else tilt, form=form, stamped=stamped)
    again = tn.read(path) if stamped else read_tcm2(path, start_ns=START_NS)
    np.testing.assert_array_equal(again.time_ns, log.time_ns)
    assert again.meta["n_rejected_lines"] == 0
    off = np.abs(again.columns["heading_magnetic_deg"] - heading)
    assert np.max(np.minimum(off, 360.0 - off)) <= 0.05 + 1e-9
    if form == "standard":
        np.testing.assert_array_equal(again.columns["anomaly"], log.columns["anomaly"])
        for name, column in tilt.columns.items():
            np.testing.assert_allclose(again.columns[name], column, rtol=0.0, atol=0.05 + 1e-9)


def test_split():
    both = parse_tcm2(EXAMPLE, start_ns=0)
    heading, tilt = split_tcm2(both)
    assert (heading.kind, tilt.kind) == ("compass", "tilt")
    assert set(heading.columns) & set(tilt.columns) == {"temperature_degc", "error_code"}
    assert encode_tcm2(heading, tilt=tilt, stamped=False) == EXAMPLE


def test_inventory(tmp_path):
    write_tcm2(tmp_path / "tcm2.log", compass(heading_magnetic_deg=np.linspace(10.0, 20.0, 20)))
    inventory = tn.summarize(tmp_path / "tcm2.log")
    assert inventory.format == "tcm2"
    assert inventory.start_gpst == "1997-10-29T22:13:20.000"
    assert inventory.sensor.rate_hz == pytest.approx(10.0)
    column = inventory.sensor.columns[0]
    assert (column.name, column.share, column.smallest, column.largest) == (
        "heading_magnetic_deg", 1.0, 10.0, 20.0,
    )  # fmt: skip


def test_refusals():
    with pytest.raises(FormatError, match="different times"):
        encode_tcm2(compass(3, heading_magnetic_deg=np.zeros(3)), tilt=compass(2, pitch_deg=np.zeros(2)))
    with pytest.raises(FormatError, match="nothing that a TCM2 sentence could say"):
        encode_tcm2(compass(1, heading_magnetic_deg=np.full(1, np.nan)))
    with pytest.raises(FormatError, match="a heading, and samples lack it"):
        encode_tcm2(compass(1, pitch_deg=np.zeros(1)), form="nmea")
    with pytest.raises(FormatError, match="`pitch_deg` reaches 91"):
        encode_tcm2(compass(1, pitch_deg=np.full(1, 91.0)))
    with pytest.raises(FormatError, match="no intact sentence") as caught:
        parse_tcm2(b"hello\n", path="tcm2.log")
    assert caught.value.path == "tcm2.log"
