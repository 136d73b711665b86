"""Recognising files by content, and what is said of a file in the wrong place."""

import json
import subprocess
import sys

import numpy as np
import pytest

import truenorth as tn
from truenorth.errors import FormatError
from truenorth.formats import FORMATS, sniff
from truenorth.formats.registry import sniff_bytes

OBS = b"     3.04           OBSERVATION DATA    M                   RINEX VERSION / TYPE\n"
NAV = b"     3.04           N: GNSS NAV DATA    M                   RINEX VERSION / TYPE\n"
MET = b"     3.04           METEOROLOGICAL DATA                     RINEX VERSION / TYPE\n"
SP3 = b"#dP2023  8 27  0  0  0.00000000      96 ORBIT IGS20 FIT AIUB\n"
# UBX-NAV-EOE with its checksum by hand: class 01, id 61, length 4.
UBX = bytes.fromhex("b562016104000000000066c7")
# An OEM3 message without data: identity 99, twelve bytes, the exclusive or of all is zero.
OEM3 = bytes.fromhex("aa441190630000000c000000")


@pytest.mark.parametrize(
    ("head", "name"),
    [
        (OBS, "rinex_obs"),
        (b"\xef\xbb\xbf" + OBS, "rinex_obs"),
        (OBS.replace(b"\n", b"\r\n"), "rinex_obs"),
        (NAV, "rinex_nav"),
        (b"     2.11           G: GLONASS NAV DATA                     RINEX VERSION / TYPE\n", "rinex_nav"),
        (SP3, "sp3"),
        (UBX, "ubx"),
        (b"$GNGGA,,,,\r\n" * 20 + UBX, "ubx"),
        (OEM3, "novatel_oem3"),
        (b"$POSA,1,2*00\r\n" * 20 + OEM3, "novatel_oem3"),
        (b"# fog-packet 1\n929 1.0 a0107e\n", "fog_log"),
        (b"929 339200.0 $C328.3P28.4R-12.4*41\r\n", "tcm2"),
        (b"#\xff\r\n$HCHDM,182.3,M*21\r\n", "tcm2"),
        (b"\x10\x7e" + b"\xa0\x10\x7e" * 30, "fog_packets"),
    ],
)
def test_formats_by_first_bytes(head, name):
    assert sniff_bytes(head).name == name


@pytest.mark.parametrize(
    "head",
    [
        *(b"", b"hello", MET, UBX[:-1] + b"\x00", b"\xb5\x62", b"\xff" * 100),
        *(OEM3[:-1] + b"\x01", b"$HCHDM,182.3,M\n", b"\xa0\x10\x7e" * 5, "Bäume, Äste, Öl".encode() * 20),
    ],
)
def test_unknown_bytes(head):
    assert sniff_bytes(head) is None


def test_names_are_unique():
    assert len({form.name for form in FORMATS}) == len(FORMATS)


@pytest.mark.parametrize(
    ("content", "read", "sentence"),
    [
        (
            NAV,
            tn.read_observations,
            "this is a RINEX navigation file and observations are expected; give it as",
        ),
        (SP3, tn.read_observations, "this is an SP3 orbit file and observations are expected"),
        (OBS, tn.read_navigation, "this is a RINEX observation file and navigation is expected; give it as"),
        (MET, tn.read, "this is a RINEX file of type 'METEOROLOGICAL DATA'"),
        (b"time,azimuth\n1,2\n", tn.read, "the file begins with 'time,azimuth'"),
        (b"\x00\x01\x02\x03", tn.read, "begins with bytes 00 01 02 03"),
    ],
)
def test_wrong_files(tmp_path, content, read, sentence):
    path = tmp_path / "file"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=sentence) as caught:
        read(path)
    assert caught.value.path == str(path)


def test_no_navigation_file():
    with pytest.raises(FormatError, match="no navigation file was given"):
        tn.read_navigation()


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("pair_1m_geodetic/base.obs.gz", "rinex_obs"),
        ("pair_1m_geodetic/base.nav.gz", "rinex_nav"),
        ("pair_38m_gps/brdc0770.11n", "rinex_nav"),
        ("moving_simulator_rose/RINEX_EN_Spirent.23L.gz", "rinex_nav"),
        ("pair_0.33m_ublox/base.ubx.gz", "ubx"),
        ("receiver_logs/20230919-114418.ubx", "ubx"),
        ("rinex_samples/delf0010.21d", "rinex_obs"),
        ("rinex_samples/ESA0OPSRAP_20232390000_01D_15M_ORB.SP3.gz", "sp3"),
    ],
)
def test_real_files(data_dir, name, expected):
    assert sniff(data_dir / name) == expected


@pytest.mark.jit
def test_navigation_of_several_files(data_dir):
    folder = data_dir / "moving_simulator_rose"
    gps, galileo = folder / "RINEX_GN_Spirent.23N.gz", folder / "RINEX_EN_Spirent.23L.gz"
    merged = tn.read_navigation(gps, galileo)
    parts = tn.read_navigation(gps), tn.read_navigation(galileo)
    sats = {int(s) for part in parts for s in part.kepler.sat}
    assert {int(s) for s in merged.kepler.sat} == sats
    assert {s // 100 for s in sats} == {0, 2}


@pytest.mark.jit
def test_ubx_gives_observations_and_navigation(data_dir):
    path = data_dir / "pair_0.33m_ublox" / "rover.ubx.gz"
    observations, navigation = tn.read(path)
    np.testing.assert_array_equal(tn.read_observations(path).time_ns, observations.time_ns)
    assert len(tn.read_navigation(path).kepler) == len(navigation.kepler) > 0


def test_import_is_light():
    code = (
        "import json, sys, truenorth.formats as f; f.read; print(json.dumps([m for m in "
        "('numba', 'scipy', 'hatanaka', 'ncompress', 'pyubx2', 'polars') if m in sys.modules]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == []


@pytest.mark.parametrize("read", [tn.read_observations, tn.read_navigation])
def test_a_sensor_log_in_the_wrong_place(tmp_path, read):
    path = tmp_path / "gyro.fog"
    path.write_bytes(b"# fog-packet 1\n929 1.0 a0107e\n")
    with pytest.raises(FormatError, match="this is a log of fibre-optic gyro packets and"):
        read(path)


def test_inventory_of_a_sensor_table(tmp_path):
    from truenorth.formats import write_sensor_table
    from truenorth.sensor_log import SensorLog

    columns = {"rate_radps": np.array([0.1, np.nan, 0.3])}
    write_sensor_table(tmp_path / "gyro.csv", SensorLog("gyro", 10**18 + 10**8 * np.arange(3), columns))
    sensor = tn.summarize(tmp_path / "gyro.csv").sensor
    assert (sensor.kind, sensor.n_samples, sensor.rate_hz) == ("gyro", 3, 10.0)
    (rate,) = sensor.columns
    assert (rate.smallest, rate.largest, round(rate.share, 3)) == (0.1, 0.3, 0.667)
