"""Tables of named columns as CSV or Parquet, and sensor logs as such tables.

CSV begins with what holds for the whole table, one ``# key = value`` a line, the values as JSON; then the
names of the columns, then a line a row::

    # kind = "gyro"
    # scale_degps_per_count = 0.02
    time_ns,rate_count,temperature_count
    1403252400000000000,-3,512

Numbers are written in the shortest form that reads back as the same double; integers stay integers; a
missing number is ``NaN``, and an empty cell is read as one. A column is read as integers, else numbers,
else truth values, else text, whichever fits all its cells, so integers come back with 64 bits, and a text
column must not look like numbers. Parquet keeps the types, and the values of the whole table in its own
key-value metadata under ``truenorth``.

The name decides: ``.parquet`` is Parquet, anything else CSV, packed by gzip when it ends in ``.gz``. A
table is read by its content.

References: RFC 4180; RFC 8259; Apache Parquet format 2.
"""

import csv
import io
import json
import re

import numpy as np

from ..errors import FormatError
from ..sensor_log import SensorLog
from .compression import open_for_writing, read_bytes

__all__ = [
    "TableWriter",
    "is_sensor_table",
    "parse_sensor_table",
    "parse_table",
    "read_sensor_table",
    "read_table",
    "write_sensor_table",
    "write_table",
]

_PARQUET = b"PAR1"
_KEY = "truenorth"
_TRUTH = "truth."


def write_table(path, columns, *, meta=None):
    """Write columns to a table.

    Parameters
    ----------
    path : str or os.PathLike
        The file: ``.parquet``, or CSV, packed when it ends in ``.gz``.
    columns : dict of str to ndarray, shape (n,)
        Numbers, truth values or text.
    meta : dict, optional
        What holds for the whole table: text, numbers, truth values or lists of them.

    Raises
    ------
    FormatError
        If the file cannot be written.
    ValueError
        If the columns differ in length.
    """
    with TableWriter(path, meta=meta) as writer:
        writer.write_block(columns)


class TableWriter:
    """A table that grows by blocks of rows.

    CSV is written block by block; the blocks of a Parquet table wait in memory for `close`, as columns.

    Parameters
    ----------
    path, meta
        As in `write_table`.

    Raises
    ------
    FormatError
        If the file cannot be opened.
    """

    def __init__(self, path, *, meta=None):
        self._path = path
        self._meta = {key: _plain(value) for key, value in (meta or {}).items()}
        for key in self._meta:
            if "=" in key or key != key.strip() or not key.isprintable() or not key:
                raise ValueError(f"{key!r} cannot name a value of a table; give a plain word")
        self._parquet = str(path).endswith(".parquet")
        self._names = None
        self._frames = []
        self._file = open_for_writing(path)

    def __enter__(self):
        """Return the writer; leaving closes the file."""
        return self

    def __exit__(self, *_):
        """Close the file."""
        self.close()

    def write_block(self, columns):
        """Append rows.

        Parameters
        ----------
        columns : dict of str to ndarray, shape (n,)
            The same names and kinds of values in every block.

        Raises
        ------
        ValueError
            If the columns differ in length, or in name from those of the first block.
        """
        arrays = {name: np.ascontiguousarray(column) for name, column in columns.items()}
        lengths = {name: array.shape for name, array in arrays.items()}
        if any(len(shape) != 1 for shape in lengths.values()) or len(set(lengths.values())) > 1:
            raise ValueError(f"the columns of a table have one length; got {lengths}")
        if self._names is not None and list(arrays) != self._names:
            raise ValueError(f"the table has the columns {self._names}; got {list(arrays)}")
        first, self._names = self._names is None, list(arrays)
        frame = _frame(arrays)
        if self._parquet:
            self._frames.append(frame)
            return
        if first:
            head = "".join(f"# {key} = {json.dumps(value)}\n" for key, value in self._meta.items())
            self._file.write(head.encode())
        self._file.write(frame.write_csv(include_header=first).encode())

    def close(self):
        """Finish the file."""
        if self._file.closed:
            return
        try:
            if self._parquet and self._frames:
                import polars as pl

                buffer = io.BytesIO()
                whole = pl.concat(self._frames, rechunk=True)
                whole.write_parquet(buffer, metadata={_KEY: json.dumps(self._meta)})
                self._file.write(buffer.getbuffer())
        finally:
            self._file.close()


def _plain(value):
    """A value that JSON knows."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _frame(arrays):
    import polars as pl

    return pl.DataFrame(
        {
            name: pl.Series(name, array.tolist() if array.dtype.kind in "UO" else array)
            for name, array in arrays.items()
        }
    )


def read_table(path):
    """Read a table that `write_table`, or another program, has written.

    Parameters
    ----------
    path : str or os.PathLike
        A CSV file, packed or not, or a Parquet file.

    Returns
    -------
    columns : dict of str to ndarray, shape (n,)
        In the order of the file.
    meta : dict
        What holds for the whole table.

    Raises
    ------
    FormatError
        If the file is no such table, or its rows differ in length.
    """
    return parse_table(read_bytes(path), path=path)


def parse_table(data, *, path=None):
    """Read a table that is already in memory.

    Parameters
    ----------
    data : bytes
        Content after unpacking.
    path : str or os.PathLike, optional
        Name of the file for messages.

    Returns
    -------
    columns : dict of str to ndarray, shape (n,)
    meta : dict

    Raises
    ------
    FormatError
        As `read_table`.
    """
    import polars as pl

    try:
        if data.startswith(_PARQUET):
            frame = pl.read_parquet(io.BytesIO(data))
            meta = json.loads(pl.read_parquet_metadata(io.BytesIO(data)).get(_KEY, "{}"))
        else:
            frame, meta = _read_csv(data, path)
    except FormatError:
        raise
    # Damaged bytes also raise a panic of the library, which is no Exception, and errors of JSON and CSV.
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, ValueError, csv.Error) as problem:
        reason = str(problem).split("\n", 1)[0]
        raise FormatError(
            f"the table cannot be read ({reason}); it is damaged or of another kind, write it again",
            path=path,
        ) from None
    return {name: _array(frame[name]) for name in frame.columns}, meta


def _read_csv(data, path):
    import polars as pl

    data = data.replace(b"\r\n", b"\n")
    meta, at, line_number = {}, 0, 1
    while data[at : at + 1] == b"#":
        end = data.find(b"\n", at)
        end = len(data) if end < 0 else end
        key, equals, text = data[at + 1 : end].decode("utf-8", "replace").partition("=")
        if equals:
            meta[key.strip()] = _value(text.strip())
        at, line_number = end + 1, line_number + 1
    end = data.find(b"\n", at)
    end = len(data) if end < 0 else end
    names = next(csv.reader([data[at:end].decode("utf-8", "replace")]), [])
    if not names or not all(name.strip() for name in names) or len(set(names)) < len(names):
        raise FormatError(
            "this line should name the columns of a table, each differently; give a table that TrueNorth has "
            "written",
            path=path,
            line_number=line_number,
        )
    body = data[at:]
    _check_lengths(body, len(names), path, line_number)
    if b"\n\n" in body and len(names) > 1 and b'"' not in data[end:]:
        body = re.sub(rb"\n\n+", b"\n", body)  # empty lines are no rows
    # Text first: what a column is, all its cells decide, not the first hundred.
    frame = pl.read_csv(io.BytesIO(body), infer_schema=False)
    return pl.DataFrame([_typed(frame[name]) for name in frame.columns]), meta


def _value(text):
    """JSON, or the text itself where a human wrote it without quotes."""
    try:
        return json.loads(text)
    except ValueError:
        return text


def _check_lengths(body, n_names, path, line_number):
    """Refuse a row that is longer or shorter than the line of names."""
    if b'"' in body:
        rows = csv.reader(io.StringIO(body.decode("utf-8", "replace"), newline=""))
        counts = [(rows.line_num, len(row)) for row in rows]
        bad = next(((line, count) for line, count in counts if count != n_names and count), None)
    else:
        text = np.frombuffer(body if body.endswith(b"\n") else body + b"\n", dtype=np.uint8)
        ends = np.flatnonzero(text == ord("\n"))
        commas = np.cumsum(text == ord(","))[ends]
        count = np.diff(commas, prepend=0) + 1
        wrong = np.flatnonzero((count != n_names) & (np.diff(ends, prepend=-1) > 1))
        bad = (int(wrong[0]) + 1, int(count[wrong[0]])) if len(wrong) else None
    if bad is not None:
        raise FormatError(
            f"this row has {bad[1]} cells and the table {n_names} columns; write the table again",
            path=path,
            line_number=line_number + bad[0] - 1,
        )


def _typed(series):
    """A text column as what all its cells can be read as; empty cells are missing numbers."""
    import polars as pl

    n_missing = series.null_count()
    if n_missing == 0 and len(series):
        whole = series.cast(pl.Int64, strict=False)
        if whole.null_count() == 0:
            return whole
        if series.is_in(["true", "false"]).all():
            return series == "true"
    number = series.cast(pl.Float64, strict=False)
    if number.null_count() == n_missing:
        return number.fill_null(float("nan"))
    return series.fill_null("")


def _array(series):
    """A writable array of the kind of the column."""
    import polars as pl

    if series.dtype == pl.String:
        return np.array(series.to_list(), dtype=np.str_)
    if series.dtype.is_numeric() and series.null_count():
        series = series.cast(pl.Float64).fill_null(float("nan"))
    return np.array(series.to_numpy())


# ---------------------------------------------------------------------------------- sensor logs


def write_sensor_table(path, log, *, truth=False):
    """Write a sensor log to a table.

    Parameters
    ----------
    path : str or os.PathLike
        The file, as in `write_table`.
    log : SensorLog
        Samples.
    truth : bool
        Whether to write the truth of simulated samples too, as columns ``truth.<name>``.

    Raises
    ------
    FormatError
        If the file cannot be written.
    """
    columns = {"time_ns": log.time_ns, **log.columns}
    if truth:
        columns |= {_TRUTH + name: column for name, column in log.truth.items()}
    write_table(path, columns, meta={"kind": log.kind, **log.meta})


def read_sensor_table(path):
    """Read a sensor log from a table.

    Parameters
    ----------
    path : str or os.PathLike
        A table of `write_sensor_table`, or one with a value ``kind`` and a column ``time_ns``.

    Returns
    -------
    SensorLog

    Raises
    ------
    FormatError
        If the file is no table, has no ``kind`` or ``time_ns``, or cells that are no numbers.
    """
    return parse_sensor_table(read_bytes(path), path=path)


def parse_sensor_table(data, *, path=None):
    """Read a sensor log from a table that is already in memory.

    Parameters
    ----------
    data : bytes
        Content after unpacking.
    path : str or os.PathLike, optional
        Name of the file for messages.

    Returns
    -------
    SensorLog

    Raises
    ------
    FormatError
        As `read_sensor_table`.
    """
    columns, meta = parse_table(data, path=path)
    kind = meta.pop("kind", None)
    if not isinstance(kind, str) or not kind:
        raise FormatError(
            'the table does not say of what sensor it is; begin the file with a line like # kind = "gyro"',
            path=path,
        )
    if "time_ns" not in columns or (len(columns["time_ns"]) and columns["time_ns"].dtype.kind not in "iu"):
        raise FormatError(
            f"a log of kind {kind!r} needs a column `time_ns` of whole nanoseconds of GPS time; the table "
            f"has {', '.join(columns)}",
            path=path,
        )
    words = [name for name, column in columns.items() if column.dtype.kind not in "iufb"]
    if words:
        raise FormatError(
            f"the column {words[0]!r} of a sensor log holds something that is no number; mend the table",
            path=path,
        )
    time_ns = columns.pop("time_ns").astype(np.int64)
    return SensorLog(
        kind=kind,
        time_ns=time_ns,
        columns={name: column for name, column in columns.items() if not name.startswith(_TRUTH)},
        meta=meta,
        truth={
            name.removeprefix(_TRUTH): column for name, column in columns.items() if name.startswith(_TRUTH)
        },
    )


def is_sensor_table(head):
    """Whether content begins like a sensor log in a table.

    Parameters
    ----------
    head : bytes
        First bytes of the content.

    Returns
    -------
    bool
    """
    if head.startswith(_PARQUET):
        return True
    lines = []
    for line in head.split(b"\n"):
        if not line.startswith(b"#"):
            break
        lines.append(line[1:].partition(b"=")[0].strip())
    return b"kind" in lines
