"""Result files: the contract of the CSV columns, RTKLIB and NMEA forms, tables, the summary."""

import csv
import io
import json
import math
import subprocess
import sys
import tomllib

import numpy as np
import pytest

from synthetic_solution import make_solution
from truenorth.config import GnssSettings, Session
from truenorth.errors import ConfigError, Reason, Status
from truenorth.export import (
    solution_columns,
    summarize_solution,
    to_polars,
    to_xarray,
    write_settings,
    write_solution,
)
from truenorth.export.columns import COLUMNS, CONTRACT, format_times
from truenorth.export.nmea import checksum, utc_clock
from truenorth.timescales import NS_PER_S, gpst_from_calendar, gpst_from_utc_ns


@pytest.fixture(scope="module")
def solution():
    return make_solution()


def read_csv(path):
    return list(csv.DictReader(io.StringIO(path.read_text())))


def test_csv_begins_with_the_columns_that_scripts_rely_on(solution, tmp_path):
    text = write_solution(solution, tmp_path / "result.csv").read_text()
    header = text.splitlines()[0]
    assert header.startswith(
        "time_gpst,azimuth_deg,elevation_deg,length_m,east_m,north_m,up_m,azimuth_sd_deg,elevation_sd_deg,"
        "length_sd_m,n_sats,n_signals,ratio,success_probability,status,quality,reason,"
    )
    assert header.startswith(CONTRACT)
    assert len(text.splitlines()) == solution.n_epochs + 1


def test_csv_holds_the_numbers_of_the_solution(solution, tmp_path):
    rows = read_csv(write_solution(solution, tmp_path / "result.csv"))
    table = solution_columns(solution)
    for column in COLUMNS[1:]:
        wanted = table[column.name]
        if wanted.dtype.kind == "U":
            assert [row[column.name] for row in rows] == wanted.tolist()
            continue
        found = np.array([float(row[column.name]) for row in rows])
        # Half of the last digit written: at most 5e-6 for lengths, or 1e-6 of a covariance.
        np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=5.1e-4 if column.spec == "%.3f" else 5.1e-6)


def test_csv_gives_status_words_reasons_and_nan_without_a_solution(solution, tmp_path):
    rows = read_csv(write_solution(solution, tmp_path / "result.csv"))
    assert {row["status"] for row in rows} == {"fixed", "held", "float", "none"}
    last = rows[-1]
    assert last["status"] == "none"
    assert last["reason"] == "too_few_satellites"
    assert last["azimuth_deg"] == "NaN"
    assert math.isnan(float(last["elevation_deg"]))
    assert rows[0]["time_gpst"] == "2024-06-24T08:20:00.000"


def test_no_word_of_the_table_could_be_taken_for_a_missing_number():
    words = [reason.name.lower() for reason in Reason] + [status.label for status in Status]
    assert not [word for word in words if "nan" in word]


def test_csv_does_not_load_a_table_library(tmp_path):
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); from synthetic_solution import make_solution\n"
        "from truenorth.export import write_solution, summarize_solution\n"
        "s = make_solution(); write_solution(s, sys.argv[2]); summarize_solution(s)\n"
        "assert not {'polars', 'xarray', 'pandas', 'scipy', 'numba', 'matplotlib'} & set(sys.modules)"
    )
    tests = str(__import__("pathlib").Path(__file__).parent.parent)
    subprocess.run([sys.executable, "-c", code, tests, str(tmp_path / "result.csv")], check=True)


def test_epochs_off_the_millisecond_keep_their_decimals():
    start = gpst_from_calendar(2018, 10, 4, 12, 0, 0.991)
    assert format_times([start]) == ["2018-10-04T12:00:00.991"]
    assert format_times([start + 7_000]) == ["2018-10-04T12:00:00.991007"]
    assert format_times([start, start + 1]) == [
        "2018-10-04T12:00:00.991000000",
        "2018-10-04T12:00:00.991000001",
    ]


def test_pos_has_the_columns_of_rtklib(solution, tmp_path):
    lines = write_solution(solution, tmp_path / "result.pos").read_text().splitlines()
    heading = [line for line in lines if line.startswith("%")]
    assert (
        heading[-1].split()[1:]
        == (
            "GPST e-baseline(m) n-baseline(m) u-baseline(m) Q ns sde(m) sdn(m) sdu(m) sden(m) sdnu(m) sdue(m)"
            " age(s) ratio"
        ).split()
    )
    rows = [line.split() for line in lines if not line.startswith("%")]
    # RTKLIB writes nothing for an epoch without solution.
    assert len(rows) == np.count_nonzero(solution.status != Status.NONE)
    assert [row[5] for row in rows[8:12]] == ["2", "2", "1", "1"]
    date, clock, *numbers = rows[60]
    assert (date, clock) == ("2024/06/24", "08:21:00.000")
    np.testing.assert_allclose([float(x) for x in numbers[:3]], solution.baseline_enu_m[60], atol=5.1e-5)
    # The off-diagonal columns are roots that keep the sign: cov(e,n) > 0 and cov(u,e) < 0 here.
    sden, sdue = float(numbers[8]), float(numbers[10])
    assert sden == pytest.approx(math.sqrt(0.2) * 0.002, abs=5.1e-5)
    assert sdue == pytest.approx(-math.sqrt(0.3) * 0.002, abs=5.1e-5)


def test_nmea_checksum_of_a_published_sentence():
    # The example of the GGA sentence that manuals repeat.
    body = "GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,"
    assert checksum(body) == "47"


def test_nmea_sentences(solution, tmp_path):
    text = write_solution(solution, tmp_path / "result.nmea").read_bytes().decode("ascii")
    sentences = text.split("\r\n")
    assert sentences.pop() == ""
    for sentence in sentences:
        body, _, digits = sentence.removeprefix("$").partition("*")
        assert checksum(body) == digits
    assert len(sentences) == 3 * solution.n_epochs
    pashr, hdt, ths = (sentence.partition("*")[0].split(",") for sentence in sentences[180:183])
    assert pashr[0] == "$PASHR"
    # 08:21:00 GPS time was 08:20:42 UTC in 2024.
    assert pashr[1] == "082042.000"
    assert float(pashr[2]) == pytest.approx(np.degrees(solution.azimuth_rad[60]), abs=5.1e-4)
    assert pashr[3] == "T"
    assert pashr[4] == ""  # two antennas do not see roll
    assert float(pashr[5]) == pytest.approx(np.degrees(solution.elevation_rad[60]), abs=5.1e-4)
    assert len(pashr) == 12
    assert pashr[10] == "2"
    assert hdt[0] == "$GNHDT"
    assert hdt[1:] == [pashr[2], "T"]
    assert ths[1:] == [pashr[2], "A"]


def test_nmea_withholds_a_heading_that_was_not_validated(solution, tmp_path):
    sentences = write_solution(solution, tmp_path / "result.nmea").read_text().splitlines()
    pashr, hdt, ths = (sentence.partition("*")[0].split(",") for sentence in sentences[:3])
    assert solution.status[0] == Status.FLOAT
    assert (pashr[2], pashr[10], hdt[1], ths[1:]) == ("", "1", "", ["", "V"])
    pashr = sentences[-3].partition("*")[0].split(",")
    assert len(pashr) == 12
    assert pashr[10] == "0"


def test_nmea_clock_around_the_leap_second_of_2016():
    midnight = gpst_from_calendar(2017, 1, 1)  # as a label of UTC
    after_ns = int(gpst_from_utc_ns(midnight))
    times = after_ns + np.array([-2, -1, 0, 1]) * NS_PER_S + 500_000_000
    assert utc_clock(times) == ["235959.500", "235960.500", "000000.500", "000001.500"]


def test_nmea_heading_never_reads_360(tmp_path):
    solution = make_solution(1)
    solution.azimuth_rad[0] = np.radians(359.9999)
    assert ",0.000,T" in write_solution(solution, tmp_path / "x.nmea").read_text()


def test_json_holds_summary_and_columns(solution, tmp_path):
    document = json.loads(write_solution(solution, tmp_path / "result.json").read_text())
    assert document["summary"]["epochs"] == 120
    assert document["columns"]["azimuth_deg"][-1] is None
    assert document["columns"]["azimuth_deg"][60] == pytest.approx(np.degrees(solution.azimuth_rad[60]))


def test_parquet_and_polars_hold_the_columns_of_the_csv(solution, tmp_path):
    import polars as pl

    frame = pl.read_parquet(write_solution(solution, tmp_path / "result.parquet"))
    assert frame.columns == [column.name for column in COLUMNS]
    assert frame.equals(to_polars(solution))
    assert frame["status"][0] == "float"
    assert frame["time_gpst"].dtype == pl.Datetime("ns")


def test_xarray_carries_units_and_meanings(solution):
    dataset = to_xarray(solution)
    assert dataset.sizes["time"] == solution.n_epochs
    assert dataset["azimuth_deg"].attrs == {
        "units": "degree",
        "long_name": "azimuth from base to rover, clockwise from true north",
    }
    assert all(
        "units" in dataset[name].attrs and dataset[name].attrs["long_name"] for name in dataset.data_vars
    )
    np.testing.assert_array_equal(dataset["baseline_enu_m"].sel(enu="north"), solution.baseline_enu_m[:, 1])


def test_a_solution_without_epochs_can_be_written(tmp_path):
    empty = make_solution(0)
    for suffix in ("csv", "pos", "nmea", "json", "parquet"):
        assert write_solution(empty, tmp_path / f"empty.{suffix}").exists()
    summary = summarize_solution(empty)
    assert summary["accepted_fraction"] == 0.0
    assert summary["azimuth_deg"]["mean"] is None


@pytest.mark.parametrize(
    ("name", "words"),
    [("result.xyz", "is not one of"), ("result", "no suffix"), ("absent/result.csv", "does not exist")],
)
def test_a_place_that_cannot_be_written_is_refused_in_a_sentence(solution, tmp_path, name, words):
    with pytest.raises(ConfigError, match=words):
        write_solution(solution, tmp_path / name)


def test_summary_has_the_keys_that_scripts_rely_on(solution):
    summary = summarize_solution(solution)
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert summary["epochs"] == 120
    assert summary["epochs_by_status"] == {"fixed": 95, "held": 10, "float": 10, "none": 5}
    assert summary["accepted_fraction"] == pytest.approx(105 / 120)
    for name in ("azimuth_deg", "elevation_deg", "length_m"):
        assert {"mean", "sd"} <= set(summary[name])
    assert set(summary["seconds"]) == {"read", "compile", "solve", "write"}
    assert summary["warnings"] == list(solution.warnings)
    assert summary["reasons"]["ratio_test"]["epochs"] == 10


def test_mean_azimuth_is_circular():
    solution = make_solution(21, azimuth_deg=355.0, rate_deg=0.5)
    entry = summarize_solution(solution)["azimuth_deg"]
    # From 355 to 5 degrees through north; 2 mm of noise on 0.99 m is 0.12 degrees, 0.03 in the mean.
    assert min(entry["mean"], 360.0 - entry["mean"]) < 0.15
    uniform_sd_deg = 0.5 * math.sqrt(21 * 22 / 12)
    assert entry["sd"] == pytest.approx(uniform_sd_deg, rel=0.1)


def test_length_check_names_a_wrong_declared_length():
    good = make_solution()
    check = summarize_solution(good)["length_check"]
    assert check["verdict"] == "agrees"
    assert check["measured_m"] == pytest.approx(0.99, abs=1e-3)  # 2 mm an epoch, 105 epochs
    wrong = make_solution(settings={"length_m": 1.19, "length_sd_m": 0.003, "length_tolerance_sd": 4.0})
    check = summarize_solution(wrong)["length_check"]
    assert check["verdict"] == "disagrees"
    assert check["difference_m"] == pytest.approx(-0.2, abs=1e-3)
    unknown = make_solution(settings={})
    assert summarize_solution(unknown)["length_check"]["verdict"] == "not declared"


def test_length_check_of_the_solver_comes_first():
    solution = make_solution(30, settings={"length_m": 1.19, "length_sd_m": 0.003})
    solution.status[:] = Status.FLOAT
    assert summarize_solution(solution)["length_check"]["verdict"] == "not measured"
    known = make_solution(30, length_check={"verdict": "disagrees"})
    assert summarize_solution(known)["length_check"]["verdict"] == "disagrees"


def test_settings_file_repeats_the_run(solution, tmp_path):
    (tmp_path / "data").mkdir()
    names = [tmp_path / "data" / name for name in ("base.obs", "rover.obs", "brdc.nav")]
    for name in names:
        name.write_text("")
    settings = GnssSettings(length_m=0.99, method="filter", bands=("L1",))
    session = Session.for_pair(str(names[0]), str(names[1]), (str(names[2]),), settings)
    path = write_settings(session, tmp_path / "result.csv", solution=solution)
    assert path == tmp_path / "result.settings.toml"
    table = tomllib.loads(path.read_text())
    # Files beside the result are named relative to it, so that the folder can be moved.
    assert table["platform"]["antennas"][0]["observations"] == "data/base.obs"
    again = Session.read(path)
    assert again == session
    assert again.settings == settings


def test_a_solution_offers_its_tables_files_and_figures(solution, tmp_path):
    assert solution.to_polars().equals(to_polars(solution))
    assert solution.to_xarray().equals(to_xarray(solution))
    assert solution.summary() == summarize_solution(solution)
    assert solution.write(tmp_path / "result.csv") == tmp_path / "result.csv"
    assert solution.write(tmp_path / "result.txt", format="nmea").read_text().startswith("$PASHR")
    assert len(solution.plot().axes) == 7  # six panels, and the right axis of the last
