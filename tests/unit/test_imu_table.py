"""Inertial logs: what each kind of file says, what a mapping must say, and what is refused."""

import gzip
import re
from functools import partial

import numpy as np
import pytest

from moving_bodies import Wobbling, generators
from truenorth.errors import ConfigError, FormatError
from truenorth.formats import read_table, write_sensor_table, write_table
from truenorth.formats.imu_mapping import ImuMapping, rot_frd_from_axes
from truenorth.formats.imu_table import read_imu_table
from truenorth.rotations import rot_ned_from_body
from truenorth.sensors import ImuDescription, simulate_imu
from truenorth.sensors.imu import imu_increments_from_log
from truenorth.strapdown import compensate_increments

START_NS = 1_403_252_400_000_000_000
DEG = np.pi / 180.0
ARCSEC = DEG / 3600.0

PSINS = """% PSINS-format SIMU log file.
% remarks

0.1 0.2 -90.6 0.0 0.0 0.0
34.5 108.25 380.0 0.0 10.0 9.780327
0.1 0.2 0.3 125.0 125.0 125.0
{rows}"""


def psins(rows):
    return PSINS.format(rows="".join(" ".join(map(str, row)) + " \n" for row in rows))


def counts(n=40, seed=3):
    return np.random.default_rng(seed).integers(-9, 90, (n, 6))


def table(n=200, seed=4):
    """Stamps of 100 Hz, gyro rates in rad/s and forces in m/s^2, in axes forward, right, down."""
    rng = np.random.default_rng(seed)
    return 0.01 * np.arange(1, n + 1), rng.normal(0.0, 0.02, (n, 3)), rng.normal(-1.0, 5.0, (n, 3))


def columns(stamps, gyro, force, names=("t", "gx", "gy", "gz", "ax", "ay", "az")):
    return dict(zip(names, (stamps, *gyro.T, *force.T), strict=True))


MAPPING = {
    "axes": "FRD",
    "compensated": True,
    "time": {"column": "t", "unit": "s"},
    "gyro": {"columns": ("gx", "gy", "gz"), "unit": "rad/s"},
    "accelerometer": {"columns": ("ax", "ay", "az"), "unit": "m/s^2"},
}


def mapping(**changes):
    """The plain mapping with tables merged key by key."""
    merged = {
        key: {**value, **changes.get(key, {})} if isinstance(value, dict) else changes.get(key, value)
        for key, value in MAPPING.items()
    }
    return ImuMapping.from_table({**changes, **merged})


# ------------------------------------------------------------------------------- files that need no mapping


@pytest.mark.parametrize("packed", [False, True])
def test_psins_text_says_everything_itself(tmp_path, packed):
    raw = counts()
    path = tmp_path / "log.imu"
    text = psins(raw).encode()
    path.write_bytes(gzip.compress(text) if packed else text)
    log = read_imu_table(path)
    rows = raw * (np.array([0.1, 0.2, 0.3, 125e-6, 125e-6, 125e-6]) * ([ARCSEC] * 3 + [9.780327] * 3))
    # Right, forward, up become forward, right, down.
    body = [block[:, [1, 0, 2]] * [1.0, 1.0, -1.0] for block in (rows[:, :3], rows[:, 3:])]
    angle, velocity = compensate_increments(*body)
    np.testing.assert_allclose(log.increments.angle_rad, angle, rtol=1e-14)
    np.testing.assert_allclose(log.increments.velocity_mps, velocity, rtol=1e-14)
    np.testing.assert_allclose(log.sensor_angle_rad, rows[:, :3])
    np.testing.assert_allclose(log.increments.time_s, 0.01 * np.arange(41), atol=1e-12)
    assert np.degrees([log.latitude_rad, log.longitude_rad]) == pytest.approx([34.5, 108.25])
    assert (log.height_m, log.interval_s, log.start_ns, log.errors) == (380.0, 0.01, None, None)
    assert str(log) == "40 samples, 100 Hz, 0 s to 0.4 s"
    assert any("arcsec" in note for note in log.notes)


def test_a_mapping_may_say_more_of_a_psins_text(tmp_path):
    path = tmp_path / "log.imu"
    path.write_text(psins(counts()))
    plain = read_imu_table(path)
    more = read_imu_table(
        path,
        ImuMapping.from_table(
            {"mount_deg": [90, 0, 0], "compensated": True, "errors": {"grade": "navigation"}}
        ),
    )
    scaled = plain.sensor_angle_rad[:, [1, 0, 2]] * [1.0, 1.0, -1.0]
    np.testing.assert_allclose(more.increments.angle_rad, scaled[:, [1, 0, 2]] * [-1.0, 1.0, 1.0], atol=1e-18)
    assert more.errors == {"grade": "navigation"}
    assert (more.latitude_rad, more.height_m) == (plain.latitude_rad, 380.0)
    moved = read_imu_table(path, ImuMapping.from_table({"place": {"latitude_deg": 10.0}}))
    assert (np.degrees(moved.latitude_rad), moved.height_m) == (pytest.approx(10.0), 380.0)


def test_windows_line_ends_and_a_missing_last_one_change_nothing(tmp_path):
    plain, other = tmp_path / "plain", tmp_path / "other"
    plain.write_text(psins(counts()))
    other.write_bytes(psins(counts()).rstrip().replace("\n", "\r\n").encode())
    np.testing.assert_array_equal(
        read_imu_table(plain).increments.angle_rad, read_imu_table(other).increments.angle_rad
    )


@pytest.mark.parametrize("output", ["rates", "increments"])
@pytest.mark.parametrize("suffix", ["csv", "csv.gz", "parquet"])
def test_own_logs_need_no_mapping(tmp_path, output, suffix):
    imu = ImuDescription(output=output, rate_hz=50.0)
    log = simulate_imu(imu, Wobbling(), start_ns=START_NS, duration_s=4.0, generator=generators(1))
    path = tmp_path / f"imu.{suffix}"
    write_sensor_table(path, log, truth=True)
    read = read_imu_table(path)
    angle, velocity = imu_increments_from_log(imu, log)
    np.testing.assert_allclose(read.increments.angle_rad, angle, rtol=1e-12)
    np.testing.assert_allclose(read.increments.velocity_mps, velocity, rtol=1e-12)
    assert (read.interval_s, read.start_ns) == (0.02, START_NS)
    assert read.increments.time_s[0] == 0.0


def test_names_with_units_need_no_mapping_and_a_mapping_may_add_the_rest(tmp_path):
    stamps, gyro, force = table()
    names = ("time_s", *(f"rate_{a}_radps" for a in "xyz"), *(f"force_{a}_mps2" for a in "xyz"))
    path = tmp_path / "imu.csv"
    write_table(path, columns(stamps, gyro, force, names))
    plain = read_imu_table(path)
    np.testing.assert_allclose(plain.increments.angle_rad, 0.01 * gyro, rtol=1e-12)
    added = read_imu_table(
        path,
        ImuMapping.from_table(
            {
                "axes": "FLU",
                "mount_deg": [90, 0, 0],
                "place": {"latitude_deg": 40.0},
                "errors": {"grade": "tactical"},
            }
        ),
    )
    # The unit looks to the right: its forward is the body's right, its left the body's forward.
    np.testing.assert_allclose(
        added.increments.angle_rad, 0.01 * gyro[:, [1, 0, 2]] * [1.0, 1.0, -1.0], atol=1e-16
    )
    assert (np.degrees(added.latitude_rad), added.longitude_rad) == (pytest.approx(40.0), None)
    assert added.errors == {"grade": "tactical"}


def test_a_table_without_stamps_takes_its_interval_from_its_head(tmp_path):
    _, gyro, force = table()
    names = (*(f"rate_{a}_radps" for a in "xyz"), *(f"force_{a}_mps2" for a in "xyz"))
    cells = dict(zip(names, (*gyro.T, *force.T), strict=True))
    path = tmp_path / "imu.csv"
    write_table(path, cells, meta={"interval_s": 0.005})
    assert read_imu_table(path).duration_s == pytest.approx(1.0)
    write_table(path, cells)
    with pytest.raises(FormatError, match="says nothing of time"):
        read_imu_table(path)


def test_foreign_columns_are_refused_with_what_to_write(tmp_path):
    path = tmp_path / "imu.csv"
    write_table(path, columns(*table()))
    with pytest.raises(FormatError, match=r"t, gx, gy.*TOML file.*\[gyro\].*--mapping"):
        read_imu_table(path)
    path.write_bytes(b"\x00\x01\x02\xff" * 50)
    with pytest.raises(FormatError, match="neither a text table nor Parquet"):
        read_imu_table(path)


# ------------------------------------------------------------------------------------------------ mappings

RATES = {"rad/s": 1.0, "deg/s": DEG, "deg/h": DEG / 3600.0}
ANGLES = {"rad": 1.0, "deg": DEG, "arcsec": ARCSEC}
FORCES = {"m/s^2": 1.0, "g": 9.80665, "mg": 9.80665e-3, "ug": 9.80665e-6}
VELOCITIES = {"m/s": 1.0, "g*s": 9.80665, "mg*s": 9.80665e-3, "ug*s": 9.80665e-6}


@pytest.mark.parametrize("unit", [*RATES, *ANGLES])
def test_units_of_gyros(tmp_path, unit):
    stamps, gyro, force = table()
    said = gyro / RATES[unit] if unit in RATES else 0.01 * gyro / ANGLES[unit]
    path = tmp_path / "imu.parquet"
    write_table(path, columns(stamps, said, force))
    read = read_imu_table(path, mapping(gyro={"unit": unit}))
    np.testing.assert_allclose(read.increments.angle_rad, 0.01 * gyro, rtol=1e-9)
    np.testing.assert_allclose(read.increments.velocity_mps, 0.01 * force, rtol=1e-9)


@pytest.mark.parametrize("unit", [*FORCES, *VELOCITIES])
def test_units_of_accelerometers(tmp_path, unit):
    stamps, gyro, force = table()
    said = force / FORCES[unit] if unit in FORCES else 0.01 * force / VELOCITIES[unit]
    path = tmp_path / "imu.parquet"
    write_table(path, columns(stamps, gyro, said))
    read = read_imu_table(path, mapping(accelerometer={"unit": unit}))
    np.testing.assert_allclose(read.increments.velocity_mps, 0.01 * force, rtol=1e-9)


def test_counts_ranges_and_the_g_of_the_unit(tmp_path):
    stamps, gyro, force = table()
    path = tmp_path / "imu.parquet"
    write_table(path, columns(stamps, np.rint(gyro * 1e5), np.rint(force * 1e5)))
    read = read_imu_table(
        path,
        mapping(
            gyro={"unit": "deg/s", "scale": 0.25, "range_dps": 250.0},
            accelerometer={"unit": "mg", "scale": -0.5, "g_mps2": 9.8, "range_g": 4.0},
        ),
    )
    np.testing.assert_allclose(read.increments.angle_rad, 0.01 * np.rint(gyro * 1e5) * 0.25 * DEG)
    np.testing.assert_allclose(read.increments.velocity_mps, -0.01 * np.rint(force * 1e5) * 0.5e-3 * 9.8)
    assert read.gyro_range_radps == pytest.approx(250.0 * DEG)
    assert read.accelerometer_range_mps2 == pytest.approx(39.2)
    assert "counts of -0.5 mg with g = 9.8 m/s^2" in read.notes[0]


@pytest.mark.parametrize(
    ("unit", "worth", "epoch"),
    [("s", 1.0, "record"), ("ms", 1e-3, "record"), ("us", 1e-6, "gps"), ("ns", 1e-9, "gps")],
)
def test_units_of_time(tmp_path, unit, worth, epoch):
    _, gyro, force = table()
    # Whole numbers, so that nanoseconds of today do not lose their last digits.
    stamps = np.rint(START_NS * 1e-9 / worth).astype(np.int64) + np.rint(
        np.arange(1, 201) * 0.04 / worth
    ).astype(np.int64)
    if unit == "s":
        stamps = 0.04 * np.arange(200)
    path = tmp_path / "imu.csv"
    write_table(path, columns(stamps, gyro, force))
    read = read_imu_table(path, mapping(time={"unit": unit, "epoch": epoch}))
    assert read.interval_s == pytest.approx(0.04, rel=1e-9)
    assert read.start_ns == (START_NS if epoch == "gps" else None)


@pytest.mark.parametrize(
    ("axes", "x", "y", "z"),
    [
        ("FRD", (1, 0, 0), (0, 1, 0), (0, 0, 1)),
        ("rfu", (0, 1, 0), (1, 0, 0), (0, 0, -1)),
        ("FLU", (1, 0, 0), (0, -1, 0), (0, 0, -1)),
        ("x right, y forward, z up", (0, 1, 0), (1, 0, 0), (0, 0, -1)),
        ("X: Back; Y: Starboard; Z: Up", (-1, 0, 0), (0, 1, 0), (0, 0, -1)),
        ("z forward, x down, y left", (0, 0, 1), (0, -1, 0), (1, 0, 0)),
    ],
)
def test_axes_in_letters_and_words(axes, x, y, z):
    np.testing.assert_array_equal(rot_frd_from_axes(axes), np.array([x, y, z]).T)


@pytest.mark.parametrize(
    ("axes", "said"),
    [
        ("FRU", "left-handed"),
        ("FFD", "one line"),
        ("FBD", "one line"),
        ("north", "three letters"),
        ("FR", "three"),
    ],
)
def test_axes_that_are_none(axes, said):
    with pytest.raises(ConfigError, match=said):
        rot_frd_from_axes(axes)


def test_a_unit_that_sits_askew_is_turned_into_the_body(tmp_path):
    stamps, gyro, force = table()
    mount = (30.0, -10.0, 75.0)
    turned = rot_ned_from_body(*np.radians(mount))
    path = tmp_path / "imu.parquet"
    write_table(path, columns(stamps, gyro @ turned, force @ turned))
    read = read_imu_table(path, mapping(**{"mount_deg": list(mount)}))
    np.testing.assert_allclose(read.increments.angle_rad, 0.01 * gyro, atol=1e-15)


def test_increments_that_are_not_compensated_are(tmp_path):
    stamps, gyro, force = table()
    path = tmp_path / "imu.parquet"
    write_table(path, columns(stamps, gyro, force))
    plain = read_imu_table(path, mapping(compensated=True))
    mended = read_imu_table(path, mapping(compensated=False))
    angle, velocity = compensate_increments(plain.increments.angle_rad, plain.increments.velocity_mps)
    np.testing.assert_allclose(mended.increments.angle_rad, angle)
    np.testing.assert_allclose(mended.increments.velocity_mps, velocity)
    assert not np.allclose(mended.increments.velocity_mps, plain.increments.velocity_mps, rtol=1e-6)


@pytest.mark.parametrize(
    ("separator", "between", "by_number", "head"),
    [
        ("comma", ",", True, 0),
        ("comma", ",", False, 2),
        ("semicolon", ";", False, 0),
        ("tab", "\t", True, 3),
        ("space", "   ", True, 0),
        ("space", " ", False, 1),
    ],
)
def test_text_tables_of_all_kinds(tmp_path, separator, between, by_number, head):
    stamps, gyro, force = table(50)
    rows = np.column_stack([stamps, gyro, force])
    lines = ["some words; of 3 instruments"] * head + ["% a remark", "# another", ""]
    if not by_number:
        lines.append(between.join(("t", "gx", "gy", "gz", "ax", "ay", "az")))
    lines += [between.join(repr(float(value)) for value in row) for row in rows]
    path = tmp_path / "imu.txt"
    path.write_text("\n".join(lines) + "\n")
    names = [1, 2, 3, 4, 5, 6, 7] if by_number else list(columns(stamps, gyro, force))
    read = read_imu_table(
        path,
        mapping(
            separator=separator,
            header_lines=head,
            time={"column": names[0]},
            gyro={"columns": names[1:4]},
            accelerometer={"columns": names[4:]},
        ),
    )
    np.testing.assert_allclose(read.increments.angle_rad, 0.01 * gyro, rtol=1e-9)
    np.testing.assert_allclose(read.increments.velocity_mps, 0.01 * force, rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"axes": None}, "`axes` is missing"),
        ({"time": None}, "`time` is missing"),
        ({"gyro": None}, "both"),
        ({"gyro": {"unit": "deg/m"}}, "`gyro.unit` is 'deg/m'; give one of rad/s, deg/s"),
        ({"gyro": {"unit": None}}, "`gyro.unit`"),
        ({"gyro": {"columns": ("gx", "gy")}}, "`gyro.columns`"),
        ({"gyro": {"scale": 0.0}}, "`gyro.scale`"),
        ({"gyro": {"range": 3}}, "`gyro.range` is not a setting of a mapping; known are columns, unit"),
        ({"accelerometer": {"range_g": -1.0}}, "`accelerometer.range_g` is -1.0; give a positive"),
        ({"time": {"rate_hz": 100.0}}, "`time.rate_hz`.* either"),
        ({"time": {"unit": None}}, "`time.unit` is missing"),
        ({"time": {"column": 1}}, "name all columns, or number all"),
        ({"colour": "red"}, "`colour` is not a setting"),
        ({"mount_deg": [1.0, 2.0, float("nan")]}, "`mount_deg`"),
        ({"place": {"latitude_deg": 91.0}}, "`place.latitude_deg` is 91.0; give -90 to 90"),
        ({"gyro": {"unit": "rad"}, "compensated": None}, "`compensated` is missing"),
    ],
)
def test_impossible_mappings_name_the_setting(change, said):
    merged = {key: dict(value) if isinstance(value, dict) else value for key, value in MAPPING.items()}
    for key, value in change.items():
        merged[key] = {**merged[key], **value} if isinstance(value, dict) and key in merged else value
    plain = {key: value for key, value in merged.items() if value is not None}
    for key, value in plain.items():
        if isinstance(value, dict):
            plain[key] = {inner: cell for inner, cell in value.items() if cell is not None}
    with pytest.raises(ConfigError, match=said) as caught:
        ImuMapping.from_table(plain)
    assert "\n" not in str(caught.value)


def test_a_mapping_from_a_file_and_files_that_are_none(tmp_path):
    log, toml = tmp_path / "imu.csv", tmp_path / "imu.toml"
    write_table(log, columns(*table()))
    toml.write_text(
        'axes = "x right, y forward, z up"\n[time]\ncolumn = "t"\nunit = "s"\n'
        '[gyro]\ncolumns = ["gx", "gy", "gz"]\nunit = "deg/s"\n'
        '[accelerometer]\ncolumns = ["ax", "ay", "a"]\nunit = "g"\n'
    )
    with pytest.raises(ConfigError, match=r"column 'a', which .* has not; there are t, gx"):
        read_imu_table(log, toml)
    toml.write_text(toml.read_text().replace('"a"', '"az"'))
    assert read_imu_table(log, toml).n_samples == 200
    toml.write_text("axes = [")
    with pytest.raises(FormatError, match="not valid TOML"):
        read_imu_table(log, toml)
    with pytest.raises(FormatError, match="cannot be read"):
        read_imu_table(log, tmp_path / "none.toml")
    with pytest.raises(FormatError, match="no such file"):
        read_imu_table(tmp_path / "none.csv")


# ---------------------------------------------------------------------------------------- time and numbers


def read_part(tmp_path, stamps, gyro, force, start_s=None, end_s=None, **changes):
    path = tmp_path / "imu.parquet"
    write_table(path, columns(stamps, gyro, force))
    return read_imu_table(path, mapping(**changes), start_s=start_s, end_s=end_s)


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        ("gap", r"after 1.000 s there is a gap of 0.06 s where samples come every 0.01 s"),
        ("back", r"time goes back by 0.3.* s at 1.000 s"),
        ("twice", r"time is given twice at 1.000 s \(1 such"),
        ("cell", r"`gy` holds no number in sample 101 at 1.010 s"),
        ("stamp", r"sample 101 has no time stamp"),
    ],
)
def test_what_is_missing_is_refused_in_the_part_only(tmp_path, harm, said):
    stamps, gyro, force = table(400)
    if harm == "gap":
        stamps[100:] += 0.05
    elif harm == "back":
        stamps[100:150] -= 0.32
    elif harm == "twice":
        stamps[100:] -= 0.01
    elif harm == "cell":
        gyro[100, 1] = np.nan
    else:
        stamps[100] = np.nan
    refuse = partial(read_part, tmp_path, stamps, gyro, force)
    with pytest.raises(FormatError, match=said) as caught:
        refuse()
    assert re.search("--from and --until", str(caught.value))
    with pytest.raises(FormatError, match=said.replace("sample 101 has", "has")):
        refuse(start_s=0.5, end_s=2.5)
    # Before and after it the same file is good.
    assert refuse(end_s=0.6).n_samples == 60
    after = refuse(start_s=2.5)
    np.testing.assert_allclose(after.sensor_velocity_mps, 0.01 * force[-after.n_samples :])
    assert after.increments.time_s[0] == pytest.approx(2.5, abs=0.011)


def test_an_infinite_value_is_no_number(tmp_path):
    stamps, gyro, force = table()
    force[7, 2] = np.inf
    with pytest.raises(FormatError, match="`az` holds no number in sample 8"):
        read_part(tmp_path, stamps, gyro, force)


def test_jittered_and_late_stamps_are_taken_as_equally_spaced(tmp_path):
    stamps, gyro, force = table(1000)
    rng = np.random.default_rng(2)
    shaken = stamps + rng.uniform(0.0, 0.004, 1000)
    shaken[300:304] = shaken[304] - 0.0001 * np.arange(4, 0, -1)  # four wait for a fifth
    read = read_part(tmp_path, shaken, gyro, force)
    # The mean of 999 steps is better known than one: 4 ms in 10 s.
    assert read.interval_s == pytest.approx(0.01, rel=5e-4)
    assert any("none is missing" in note for note in read.notes)
    exact = read_part(tmp_path, stamps, gyro, force)
    assert len(exact.notes) == 1


def test_stamps_of_a_coarse_clock_keep_the_true_rate(tmp_path):
    # 128 Hz in whole milliseconds: most steps are 8 ms, and the mean is 7.8125.
    stamps = np.floor(np.arange(1, 2001) * 1000.0 / 128.0).astype(np.int64)
    _, gyro, force = table(2000)
    read = read_part(tmp_path, stamps, gyro, force, time={"unit": "ms"})
    assert read.interval_s == pytest.approx(1.0 / 128.0, rel=1e-4)
    assert read.increments.time_s[0] == 0.0


def test_a_rate_in_place_of_useless_stamps(tmp_path):
    _, gyro, force = table()
    path = tmp_path / "imu.parquet"
    write_table(path, columns(np.zeros(200), gyro, force))
    with pytest.raises(FormatError, match=r"do not advance.*rate_hz"):
        read_imu_table(path, mapping())
    changed = {**MAPPING, "time": {"rate_hz": 200.0}}
    assert read_imu_table(path, ImuMapping.from_table(changed)).duration_s == pytest.approx(1.0)


def test_a_log_whose_stamps_contradict_its_interval(tmp_path):
    log = simulate_imu(
        ImuDescription(rate_hz=50.0), Wobbling(), start_ns=START_NS, duration_s=4.0, generator=generators(1)
    )
    path = tmp_path / "imu.csv"
    write_sensor_table(path, log)
    cells, meta = read_table(path)
    write_table(path, cells, meta={**meta, "interval_s": 0.0195})
    with pytest.raises(FormatError, match=r"`interval_s` says 0.0195;"):
        read_imu_table(path)


def test_parts_keep_the_time_of_the_record(tmp_path):
    path = tmp_path / "log.imu"
    path.write_text(psins(counts(500)))
    whole = read_imu_table(path)
    part, again = whole.between(1.0, 3.0), read_imu_table(path, start_s=1.0, end_s=3.0)
    for log in (part, again):
        assert log.n_samples == 200
        np.testing.assert_allclose(log.increments.time_s[[0, -1]], [1.0, 3.0], atol=1e-12)
        np.testing.assert_array_equal(log.sensor_angle_rad, whole.sensor_angle_rad[100:300])
    np.testing.assert_array_equal(part.increments.angle_rad, whole.increments.angle_rad[100:300])
    assert whole.between().n_samples == 500
    for empty in (partial(whole.between, 6.0, 7.0), partial(read_imu_table, path, start_s=6.0, end_s=7.0)):
        with pytest.raises(
            FormatError, match=r"no samples lie from 6 s until 7 s; the record goes from 0 s to 5 s"
        ):
            empty()


@pytest.mark.parametrize(
    ("text", "said", "line"),
    [
        (psins(counts()).replace("34.5 108.25", "108.25 34.5"), "108.25 deg", 6),
        (psins(counts()).replace("0.1 0.2 0.3 125.0", "0.1 0.2 0.3"), "three lines of six numbers", 6),
        (psins(counts(3)) + "1 2 3 4 5\n", "5 numbers where 6 belong", 10),
        (psins(counts(3)) + "1 2 3 4 5 six\n", "'six' is no number", 10),
        (psins([]), "no samples", None),
        (psins(counts())[:90], "three lines of six numbers", 5),
    ],
)
def test_damaged_psins_text_names_the_line(tmp_path, text, said, line):
    path = tmp_path / "log.imu"
    path.write_text(text)
    with pytest.raises(FormatError, match=said) as caught:
        read_imu_table(path)
    assert caught.value.line_number == line


def test_damaged_tables_name_line_and_word(tmp_path):
    stamps, gyro, force = table(5)
    path = tmp_path / "imu.csv"
    write_table(path, columns(stamps, gyro, force))
    lines = path.read_text().splitlines()
    path.write_text("\n".join(["words", *lines[:4], "1,2", *lines[4:]]))
    with pytest.raises(FormatError, match="2 cells") as caught:
        read_imu_table(path, mapping(header_lines=1))
    assert caught.value.line_number == 6
    path.write_text("\n".join([*lines[:4], "0.04,1,2,three,4,5,6", *lines[5:]]))
    with pytest.raises(FormatError, match="'gz' holds 'three'"):
        read_imu_table(path, mapping())
