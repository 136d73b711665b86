"""Writing RINEX observation files: the text by hand, blocks, events, packing, refusals."""

import gzip
import re
from dataclasses import replace

import numpy as np
import pytest

from truenorth.errors import FormatError
from truenorth.formats import RinexObservationWriter, read_observations, write_rinex_observations
from truenorth.formats.rinex_obs_writer import observation_types
from truenorth.observations import (
    LLI_HALF_CYCLE,
    LLI_SLIP,
    NO_CHANNEL,
    ObservationEvent,
    ObservationMeta,
    Observations,
    sat_id,
    signal_id,
)
from truenorth.timescales import NS_PER_S, gpst_from_calendar

START_NS = gpst_from_calendar(2024, 2, 29, 23, 59, 59.0)
COLUMNS = (
    "time_ns", "epoch_start", "sat", "signal", "code_m", "phase_cyc", "doppler_hz", "cn0_dbhz", "lli",
    "clock_offset_s", "glonass_channel",
)  # fmt: skip


def make(epochs, *, time_ns=None, clock_s=None, channel=None, **more):
    """Observations of lists of (satellite, signal, code, phase, Doppler, C/N0, lli)."""
    rows = [row for epoch in epochs for row in epoch]
    times = START_NS + NS_PER_S * np.arange(len(epochs)) if time_ns is None else np.array(time_ns)
    table = np.full(100, NO_CHANNEL, dtype=np.int8)
    for slot, number in (channel or {}).items():
        table[slot] = number
    values = np.array([row[2:6] for row in rows], dtype=float).reshape(-1, 4)
    return Observations(
        time_ns=times.astype(np.int64),
        epoch_start=np.concatenate(([0], np.cumsum([len(epoch) for epoch in epochs]))).astype(np.int64),
        sat=np.array([sat_id(row[0]) for row in rows], dtype=np.int16),
        signal=np.array([signal_id(row[1]) for row in rows], dtype=np.int16),
        code_m=values[:, 0].copy(),
        phase_cyc=values[:, 1].copy(),
        doppler_hz=values[:, 2].copy(),
        cn0_dbhz=values[:, 3].copy(),
        lli=np.array([row[6] for row in rows], dtype=np.uint8),
        clock_offset_s=np.full(len(epochs), np.nan) if clock_s is None else np.array(clock_s, dtype=float),
        glonass_channel=table,
        **more,
    )


def assert_same(one, other):
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


EPOCHS = [
    [("G05", "1C", 20437584.735, 107400233.901, 39.609, 47.031, 0),
     ("G05", "2W", 20437579.112, 83688469.715, np.nan, 11.9, LLI_SLIP),
     ("R01", "1C", 21338241.321, 1234567890.574, -0.001, 54.0, LLI_SLIP | LLI_HALF_CYCLE)],
    [],
    [("G05", "1C", np.nan, -12.5, -4321.5, np.nan, LLI_HALF_CYCLE)],
]  # fmt: skip
BODY = (
    "> 2024 02 29 23 59 59.0000000  0  2      -0.000123456789\n"
    "G05  20437584.735 7 107400233.901 7        39.609          47.031    20437579.112 1"
    "  83688469.71511        11.900\n"
    "R01  21338241.321 91234567890.57439        -0.001          54.000\n"
    "> 2024 03 01 00 00  0.0000000  0  0\n"
    "> 2024 03 01 00 00  1.0000000  0  1\n"
    "G05                       -12.5002      -4321.500\n"
)


def sample(**more):
    return make(EPOCHS, clock_s=[-1.23456789e-4, np.nan, np.nan], channel={1: -4}, **more)


def test_the_body_is_as_the_standard_says(tmp_path):
    path = tmp_path / "a.obs"
    write_rinex_observations(path, sample())
    text = path.read_text(encoding="ascii")
    header, body = text.split("END OF HEADER       \n")
    assert body == BODY
    lines = header.splitlines()
    assert all(len(line) == 80 for line in lines[:-1])
    assert lines[0].startswith("     3.05           OBSERVATION DATA    M: Mixed")
    assert "G    7 C1C L1C D1C S1C C2W L2W S2W                          SYS / # / OBS TYPES " in lines
    assert "R    4 C1C L1C D1C S1C                                      SYS / # / OBS TYPES " in lines
    assert "  2024     2    29    23    59   59.0000000     GPS         TIME OF FIRST OBS   " in lines
    assert "  1 R01 -4                                                  GLONASS SLOT / FRQ #" in lines
    assert "20240229 235941 UTC " in lines[1]
    assert_same(read_observations(path), sample())


def test_what_the_header_says_comes_back(tmp_path):
    meta = ObservationMeta(
        marker="FORE", receiver_type="SIMULATED", receiver_serial="7", receiver_firmware="0.1",
        antenna_type="TRM59800.00     NONE", antenna_serial="A1",
        approx_position_ecef_m=(-3817680.727, 3562839.5216, 3650159.2407),
        antenna_delta_hen_m=(0.1, 0.0, -0.02), interval_s=0.05, leap_seconds=18,
        glonass_code_phase_bias_m={"1C": -71.94, "2P": 1.5},
        phase_shift_cyc={"G2W": 0.25, "G052W": -0.25, "G062W": -0.25},
    )  # fmt: skip
    path = tmp_path / "a.obs"
    write_rinex_observations(path, sample(meta=meta))
    assert read_observations(path).meta == replace(meta, path=str(path), format="rinex_obs", version="3.05")
    write_rinex_observations(path, sample(meta=meta), marker="AFT", date_ns=0, comments=["made up"])
    assert read_observations(path).meta.marker == "AFT"
    assert "19800106 000000 UTC" in path.read_text()
    assert f"{'made up':<60}COMMENT" in path.read_text()


def test_blocks_give_the_bytes_of_the_whole(tmp_path):
    whole, parts = tmp_path / "a.obs", tmp_path / "b.obs"
    observations = sample(
        events=(
            ObservationEvent(START_NS, 1, "power failure before this epoch"),
            ObservationEvent(START_NS + NS_PER_S, 2, ""),
            ObservationEvent(START_NS + NS_PER_S, 3, f"{'HILL':<60}MARKER NAME"),
            ObservationEvent(None, 4, f"{'a remark':<60}COMMENT"),
        )
    )
    types = observation_types(observations)
    write_rinex_observations(whole, observations)
    with RinexObservationWriter(parts, types=types) as writer:
        for k in range(3):
            block = observations.select_epochs(slice(k, k + 1))
            when = {0: [0], 1: [1, 2, 3], 2: []}[k]
            writer.write_block(replace(block, events=tuple(observations.events[e] for e in when)))
    assert parts.read_bytes() == whole.read_bytes()
    again = read_observations(whole)
    assert sorted(event.flag for event in again.events) == [1, 2, 3, 4]
    assert {event.time_ns for event in again.events} == {START_NS, START_NS + NS_PER_S, None}
    assert [event.text for event in again.events if event.flag == 3] == [observations.events[2].text]


def test_an_event_cannot_change_the_columns(tmp_path):
    line = f"{'G    1 C5X':<60}SYS / # / OBS TYPES"
    path = tmp_path / "a.obs"
    write_rinex_observations(path, sample(events=(ObservationEvent(START_NS + 1, 4, line),)))
    assert_same(read_observations(path), sample())


def test_packed_files_hold_no_time_and_no_name(tmp_path):
    for name in ("a.obs", "b.obs.gz", "c.obs.gz"):
        write_rinex_observations(tmp_path / name, sample())
    packed = (tmp_path / "b.obs.gz").read_bytes()
    assert packed == (tmp_path / "c.obs.gz").read_bytes()
    assert gzip.decompress(packed) == (tmp_path / "a.obs").read_bytes()
    assert_same(read_observations(tmp_path / "b.obs.gz"), sample())


@pytest.mark.parametrize(
    ("system", "sat", "signal"),
    [("GPS", "G32", "5Q"), ("GLONASS", "R24", "2C"), ("Galileo", "E36", "8X"), ("BeiDou", "C62", "2I"),
     ("QZSS", "J07", "6L"), ("NavIC", "I14", "5A"), ("SBAS", "S58", "1C")],
)  # fmt: skip
def test_every_system_alone(tmp_path, system, sat, signal):
    path = tmp_path / "a.obs"
    observations = make([[(sat, signal, 3.9e7, 2.1e8, 100.0, 40.0, 0)]])
    write_rinex_observations(path, observations)
    assert f"{sat[0]}: {system}" in path.read_text().splitlines()[0]
    assert_same(read_observations(path), observations)


def test_many_types_continue_on_the_next_line(tmp_path):
    path = tmp_path / "a.obs"
    signals = ["1C", "1L", "1W", "2L", "2W", "5Q"]
    observations = make([[("G01", signal, 2e7 + 1, 1e8, 1.0, 40.0, 0) for signal in signals]])
    with RinexObservationWriter(path, types={"G": signals}) as writer:
        writer.write_block(observations)
    header = path.read_text().split("END OF HEADER")[0]
    assert [line[:6] for line in header.splitlines() if line[60:].startswith("SYS / #")] == [
        "G   24",
        " " * 6,
    ]
    assert_same(read_observations(path), observations)


def test_time_tags_have_a_tenth_of_a_microsecond(tmp_path):
    path = tmp_path / "a.obs"
    times = [START_NS + 999_999_949, START_NS + 999_999_951, START_NS + NS_PER_S + 123_456_700]
    row = ("G01", "1C", 2e7, 1e8, 1.0, 40.0, 0)
    write_rinex_observations(path, make([[row]] * 3, time_ns=times))
    stamps = [line[:29] for line in path.read_text().splitlines() if line[0] == ">"]
    assert stamps == [
        "> 2024 02 29 23 59 59.9999999",
        "> 2024 03 01 00 00  0.0000000",
        "> 2024 03 01 00 00  0.1234567",
    ]


@pytest.mark.parametrize(
    ("column", "value"),
    [("code_m", 1e10), ("phase_cyc", -1e9), ("phase_cyc", 9_999_999_999.9995), ("code_m", 1e300)],
)
def test_a_value_without_room_is_refused(tmp_path, column, value):
    observations = sample()
    getattr(observations, column)[2] = value
    with pytest.raises(
        FormatError,
        match=f"R01 [CL]1C at 2024-02-29T23:59:59.000 GPST has the value {re.escape(str(value))} ",
    ):
        write_rinex_observations(tmp_path / "a.obs", observations)


@pytest.mark.parametrize("clock_s", [-10.0, 100.0, 1e300])
def test_a_clock_offset_without_room_is_refused(tmp_path, clock_s):
    observations = make(EPOCHS, clock_s=[0.0, clock_s, np.nan])
    with pytest.raises(FormatError, match="receiver clock offset without room"):
        write_rinex_observations(tmp_path / "a.obs", observations)


def test_what_was_not_declared_is_refused(tmp_path):
    writer = RinexObservationWriter(tmp_path / "a.obs", types={"G": ["1C"], "R": ["C1C"]})
    with writer, pytest.raises(FormatError, match=r"G05 C2W at .* is not declared in the header"):
        writer.write_block(sample())
    with pytest.raises(FormatError, match="no satellite system 'X'"):
        RinexObservationWriter(tmp_path / "a.obs", types={"X": ["1C"]})


def test_epochs_must_go_forward(tmp_path):
    with RinexObservationWriter(tmp_path / "a.obs") as writer:
        writer.write_block(sample())
        with pytest.raises(FormatError, match="not later than the one before"):
            writer.write_block(sample())


def test_a_receiver_that_never_saw_a_satellite(tmp_path):
    path = tmp_path / "a.obs"
    with RinexObservationWriter(path, types={"G": ["1C"]}):
        pass
    assert read_observations(path).n_epochs == 0
    with pytest.raises(FormatError, match="declare its observation types"):
        write_rinex_observations(path, make([[]]))


def test_a_file_that_cannot_be_written(tmp_path):
    with pytest.raises(FormatError, match="cannot be written"):
        RinexObservationWriter(tmp_path / "nowhere" / "a.obs")
