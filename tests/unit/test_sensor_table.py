"""Tables of columns and sensor logs: what is written comes back; what is damaged is refused."""

import gzip

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from truenorth.errors import FormatError
from truenorth.formats import (
    TableWriter,
    read,
    read_sensor_table,
    read_table,
    sniff,
    write_sensor_table,
    write_table,
)
from truenorth.sensor_log import SensorLog

COLUMNS = {
    "time_ns": np.array([1_403_252_400_000_000_001, 1_403_252_400_100_000_001, 1_403_252_400_200_000_001]),
    "rate": np.array([0.1 + 0.2, np.nan, -1e-300]),
    "whole": np.array([1.0, 2.0, 3.0]),
    "count": np.array([-3, 4, 5]),
    "valid": np.array([True, False, True]),
    "note": np.array(["a", 'he said "b, c"', ""]),
}
META = {"kind": "gyro", "serial": "no. 7 = #", "scale": 0.1 + 0.2, "axes": [1, 2.5], "checked": True}


def assert_columns(found, wanted):
    assert list(found) == list(wanted)
    for name, column in wanted.items():
        assert found[name].dtype.kind == column.dtype.kind, name
        np.testing.assert_array_equal(found[name], column, err_msg=name)


@pytest.mark.parametrize("name", ["a.csv", "a.csv.gz", "a.parquet"])
def test_a_table_comes_back(tmp_path, name):
    write_table(tmp_path / name, COLUMNS, meta=META)
    columns, meta = read_table(tmp_path / name)
    assert_columns(columns, COLUMNS)
    assert meta == META
    assert all(column.flags.writeable for column in columns.values())


def test_the_text_is_plain(tmp_path):
    write_table(
        tmp_path / "a.csv", {k: COLUMNS[k] for k in ("time_ns", "rate")}, meta={"kind": "gyro", "x": 0.5}
    )
    assert (tmp_path / "a.csv").read_text() == (
        '# kind = "gyro"\n# x = 0.5\ntime_ns,rate\n1403252400000000001,0.30000000000000004\n'
        "1403252400100000001,NaN\n1403252400200000001,-1e-300\n"
    )


@pytest.mark.parametrize("name", ["a.csv", "a.csv.gz", "a.parquet"])
def test_blocks_give_the_table_of_the_whole_and_equal_bytes(tmp_path, name):
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        with TableWriter(tmp_path / folder / name, meta=META) as writer:
            for k in range(3):
                writer.write_block({key: column[k : k + 1] for key, column in COLUMNS.items()})
    assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    assert_columns(read_table(tmp_path / "one" / name)[0], COLUMNS)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@given(
    st.lists(st.tuples(st.floats(), st.integers(-(2**63), 2**63 - 1)), min_size=1, max_size=20).map(
        lambda rows: (np.array([r[0] for r in rows]), np.array([r[1] for r in rows], dtype=np.int64))
    )
)
def test_numbers_are_exact(tmp_path_factory, suffix, values):
    path = tmp_path_factory.mktemp("table") / f"a{suffix}"
    columns = {"number": values[0], "count": values[1]}
    write_table(path, columns)
    assert_columns(read_table(path)[0], columns)


def test_a_table_of_another_program_is_read(tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes(b'# a remark\r\n# place = on the roof\r\nt,x,"who, where"\r\n1,,b\r\n\r\n2,3,\r\n')
    columns, meta = read_table(path)
    assert meta == {"place": "on the roof"}
    assert_columns(
        columns,
        {"t": np.array([1, 2]), "x": np.array([np.nan, 3.0]), "who, where": np.array(["b", ""])},
    )
    pl.DataFrame({"t": [1, None]}).write_parquet(tmp_path / "b.parquet")
    columns, meta = read_table(tmp_path / "b.parquet")
    assert meta == {}
    assert_columns(columns, {"t": np.array([1.0, np.nan])})


def test_a_table_without_rows(tmp_path):
    for name in ("a.csv", "a.parquet"):
        write_table(tmp_path / name, {"t": np.zeros(0), "x": np.zeros(0)})
        assert_columns(read_table(tmp_path / name)[0], {"t": np.zeros(0), "x": np.zeros(0)})


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"a,b\n1,2\n3\n", "line 3: this row has 1 cells and the table 2 columns"),
        (b"# k = 1\na,b\n1,2\n3,4,5\n", "line 4: this row has 3 cells"),
        (b'a,b\n1,"x"\n3,"y",5\n', "line 3: this row has 3 cells"),
        (b"a,a\n1,2\n", "line 1: this line should name the columns"),
        (b"# k = 1\n", "line 2: this line should name the columns"),
        (b"PAR1 and then nothing of it", "the table cannot be read"),
        (b"a,b\n1,\xff\xfe\n", "the table cannot be read"),
    ],
)
def test_damaged_tables_are_refused(tmp_path, content, message):
    path = tmp_path / "a.csv"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=message):
        read_table(path)


def test_columns_that_do_not_fit_are_refused(tmp_path):
    with pytest.raises(ValueError, match="one length"):
        write_table(tmp_path / "a.csv", {"a": np.zeros(2), "b": np.zeros(3)})
    with TableWriter(tmp_path / "a.csv") as writer:
        writer.write_block({"a": np.zeros(2)})
        with pytest.raises(ValueError, match="has the columns"):
            writer.write_block({"b": np.zeros(2)})
    with pytest.raises(ValueError, match="cannot name"):
        TableWriter(tmp_path / "a.csv", meta={"a = b": 1})


LOG = SensorLog(
    kind="gyro",
    time_ns=COLUMNS["time_ns"],
    columns={"rate_count": COLUMNS["count"], "temperature_degc": COLUMNS["rate"]},
    meta={"scale_degps_per_count": 0.02, "serial": "A7"},
    truth={"time_ns": COLUMNS["time_ns"] - 7, "bias_radps": COLUMNS["whole"]},
)


@pytest.mark.parametrize("name", ["gyro.csv", "gyro.csv.gz", "gyro.parquet"])
@pytest.mark.parametrize("truth", [False, True])
def test_a_sensor_log_comes_back(tmp_path, name, truth):
    path = tmp_path / name
    write_sensor_table(path, LOG, truth=truth)
    for log in (read_sensor_table(path), read(path)):
        assert (log.kind, log.meta) == (LOG.kind, LOG.meta)
        np.testing.assert_array_equal(log.time_ns, LOG.time_ns)
        assert_columns(log.columns, LOG.columns)
        assert_columns(log.truth, LOG.truth if truth else {})
    assert sniff(path) == "sensor_table"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("time_ns,a\n1,2\n", "does not say of what sensor"),
        ('# kind = "gyro"\na\n2\n', "needs a column `time_ns`"),
        ('# kind = "gyro"\ntime_ns,a\n1.5,2\n', "needs a column `time_ns`"),
        (
            '# kind = "gyro"\ntime_ns,a\n1,x2\n',
            "the column 'a' of a sensor log holds something that is no number",
        ),
    ],
)
def test_what_is_no_sensor_log_is_refused(tmp_path, content, message):
    path = tmp_path / "a.csv.gz"
    path.write_bytes(gzip.compress(content.encode()))
    with pytest.raises(FormatError, match=message):
        read_sensor_table(path)
