"""Whole files as bytes, whatever they are packed in.

Gzip, Unix compress, bzip2 and zip are recognised by their first bytes, Hatanaka (Compact RINEX) by
its first line, also inside the others. The size after unpacking is bounded, so that a small hostile
file cannot fill the memory.

References: RFC 1952; Y. Hatanaka, "A compression format and tools for GNSS observation data",
Bulletin of the Geographical Survey Institute 55, 2008.
"""

from contextlib import contextmanager
from itertools import chain
from pathlib import Path

from ..errors import FormatError

__all__ = ["MAX_EXPANSION", "MAX_PLAIN_BYTES", "open_for_writing", "read_bytes", "read_pieces", "unpack"]

MAX_PLAIN_BYTES = 16 * 2**30
"""No file may unpack to more than this."""

MAX_EXPANSION = 200
"""Nor to more than this many times its own size; real observation files stay under 40."""

_ALWAYS_ALLOWED = 64 * 2**20

PIECE_BYTES = 2**22
"""Text that is in memory at a time when a file is read in pieces."""

_GZIP, _COMPRESS, _BZIP2, _ZIP = b"\x1f\x8b", b"\x1f\x9d", b"BZh", b"PK\x03\x04"
_CRINEX_LABEL = b"CRINEX VERS   / TYPE"


def read_bytes(path):
    """Read a file and undo every packing around its content.

    Parameters
    ----------
    path : str or os.PathLike
        The file: plain, gzip, Unix compress, bzip2, zip with a single member, Hatanaka, or a
        combination of these, under any name.

    Returns
    -------
    bytes
        The plain content; never empty.

    Raises
    ------
    FormatError
        If the file cannot be opened, is empty, or its packing is damaged.
    """
    with _open(path) as file:
        data = file.read()
    return unpack(data, path=path)


@contextmanager
def _open(path):
    """Open a file, and say it in a sentence when it cannot be read."""
    try:
        with Path(path).open("rb") as file:
            yield file
    except FileNotFoundError:
        raise FormatError("there is no such file; check the name", path=path) from None
    except IsADirectoryError:
        raise FormatError("this is a folder; give a file", path=path) from None
    except OSError as problem:
        reason = problem.strerror or type(problem).__name__
        raise FormatError(f"the file cannot be opened ({reason}); check the path", path=path) from None


def read_pieces(path, size=PIECE_BYTES):
    """Read a file piece after piece, unpacked.

    Plain and gzipped text is unpacked as it is read; what is packed otherwise, and Hatanaka, is unpacked
    whole, as one piece.

    Parameters
    ----------
    path : str or os.PathLike
        The file.
    size : int
        Most bytes of a piece.

    Yields
    ------
    bytes
        Never empty.

    Raises
    ------
    FormatError
        As `read_bytes`; damage within a gzipped file only when it is reached.
    """
    with _open(path) as file:
        pieces = iter(lambda: file.read(size), b"")
        first = next(pieces, b"")
        if first.startswith(_GZIP):
            pieces = _gunzip_pieces(chain((first,), pieces), size, path)
            first = next(pieces, b"")
        is_packed = first.startswith((_GZIP, _BZIP2, _COMPRESS, _ZIP)) or first[60:80] == _CRINEX_LABEL
        if first and not is_packed:
            yield first
            yield from pieces
            return
    yield read_bytes(path)


def _gunzip_pieces(packed, size, path):
    """Plain pieces of gzipped ones; as in `_inflate_members`, members follow each other."""
    import zlib

    machine, total = zlib.decompressobj(31), 0
    for piece in packed:
        plain = b""
        while piece or len(plain) == size:  # a full piece may leave more inside
            if machine.eof:
                if not piece.startswith(_GZIP[: len(piece)]):
                    return  # padding after the last member
                machine = zlib.decompressobj(31)
            try:
                plain = machine.decompress(piece, size)
            except zlib.error as problem:
                raise _damaged("gzip", path, str(problem)) from None
            piece = machine.unused_data if machine.eof else machine.unconsumed_tail
            total += len(plain)
            if plain:
                yield plain
            if machine.eof and not piece:
                break
    if not machine.eof:
        raise _damaged("gzip", path, f"it is cut off after {total} plain bytes")


def open_for_writing(path):
    """Open a file that takes bytes, packed by gzip when its name ends in ``.gz``.

    Parameters
    ----------
    path : str or os.PathLike
        The file; one that exists is replaced.

    Returns
    -------
    binary file
        The packed one holds no time and no name, so equal content gives equal bytes.

    Raises
    ------
    FormatError
        If the file cannot be opened.
    """
    try:
        file = open(path, "wb")  # noqa: SIM115 (closed by the caller)
    except OSError as problem:
        reason = problem.strerror or type(problem).__name__
        raise FormatError(f"the file cannot be written ({reason}); check the path", path=path) from None
    if not str(path).endswith(".gz"):
        return file
    import gzip

    class Packed(gzip.GzipFile):
        def close(self):
            super().close()
            file.close()

    return Packed(filename="", mode="wb", compresslevel=6, fileobj=file, mtime=0)


def unpack(data, *, path=None):
    """Undo every packing around some bytes.

    Parameters
    ----------
    data : bytes
        Content of a file.
    path : str or os.PathLike, optional
        Its name, for messages.

    Returns
    -------
    bytes
        The plain content; never empty.

    Raises
    ------
    FormatError
        If there is nothing, or the packing is damaged or expands beyond reason.
    """
    limit = min(MAX_PLAIN_BYTES, max(_ALWAYS_ALLOWED, MAX_EXPANSION * len(data)))
    for _ in range(3):  # at most an archive in an archive, and Hatanaka inside
        if not data:
            raise FormatError("the file is empty; record or download it again", path=path)
        if data.startswith(_GZIP):
            data = _gunzip(data, limit, path)
        elif data.startswith(_BZIP2) and data[4:10] in (b"1AY&SY", b"\x17rE8P\x90"):
            data = _bunzip2(data, limit, path)
        elif data.startswith(_COMPRESS):
            data = _uncompress(data, limit, path)
        elif data.startswith(_ZIP):
            data = _unzip(data, limit, path)
        elif data[60:80] == _CRINEX_LABEL:
            return _unhatanaka(data, limit, path)
        else:
            return data
    return data


def _damaged(kind, path, detail="it ends early or bytes are wrong"):
    return FormatError(f"the {kind} data cannot be unpacked ({detail}); fetch the file again", path=path)


def _check_limit(size, limit, kind, path):
    if size > limit:
        raise FormatError(
            f"the {kind} data unpack to more than {limit} bytes, which no observation file does; "
            "unpack it by hand if it is genuine",
            path=path,
        )


def _inflate_members(new_decompressor, magic, data, limit, kind, path):
    """Concatenated members of a stream format; padding after the last one is ignored."""
    parts, total = [], 0
    while True:
        machine = new_decompressor()
        try:
            part = machine.decompress(data, limit - total + 1)
        except (OSError, ValueError, EOFError) as problem:
            raise _damaged(kind, path, str(problem) or "bytes are wrong") from None
        total += len(part)
        _check_limit(total, limit, kind, path)
        if not machine.eof:
            raise _damaged(kind, path, f"it is cut off after {total} plain bytes")
        parts.append(part)
        data = machine.unused_data
        if not data.startswith(magic):
            return parts[0] if len(parts) == 1 else b"".join(parts)


def _gunzip(data, limit, path):
    import zlib

    # Fast way: the trailer tells the size, so one allocation does; it is only a hint.
    hint = int.from_bytes(data[-4:], "little")
    if 0 < hint <= limit and hint < 1100 * len(data):
        try:
            plain = zlib.decompress(data, 31, hint)
            if len(plain) == hint:
                return plain
        except (zlib.error, MemoryError):
            pass

    class Machine:
        def __init__(self):
            self._inner = zlib.decompressobj(31)

        def decompress(self, chunk, max_length):
            try:
                return self._inner.decompress(chunk, max_length)
            except zlib.error as problem:
                raise ValueError(str(problem)) from None

        @property
        def eof(self):
            return self._inner.eof

        @property
        def unused_data(self):
            return self._inner.unused_data

    return _inflate_members(Machine, _GZIP, data, limit, "gzip", path)


def _bunzip2(data, limit, path):
    import bz2

    return _inflate_members(bz2.BZ2Decompressor, _BZIP2, data, limit, "bzip2", path)


class _BoundedSink:
    """A writable stream that refuses to grow beyond a limit."""

    def __init__(self, limit):
        self.parts, self.size, self._limit = [], 0, limit

    def write(self, chunk):
        self.size += len(chunk)
        if self.size > self._limit:
            raise OverflowError("too much")
        self.parts.append(bytes(chunk))
        return len(chunk)

    def flush(self):
        pass


def _uncompress(data, limit, path):
    import ncompress

    sink = _BoundedSink(limit)
    try:
        ncompress.decompress(data, sink)
    except Exception as problem:
        _check_limit(sink.size, limit, "compress", path)
        raise _damaged("compress", path, str(problem) or "bytes are wrong") from None
    return b"".join(sink.parts)


def _unzip(data, limit, path):
    import io
    import zipfile
    import zlib

    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = [m for m in archive.infolist() if not m.is_dir()]
            if len(members) != 1:
                raise FormatError(
                    f"the zip archive holds {len(members)} files and one is expected; unpack it and give "
                    "the files",
                    path=path,
                )
            with archive.open(members[0]) as stream:
                plain = stream.read(limit + 1)
    except FormatError:
        raise
    except (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, RuntimeError,
            NotImplementedError) as problem:  # fmt: skip
        raise _damaged("zip", path, str(problem) or "bytes are wrong") from None
    _check_limit(len(plain), limit, "zip", path)
    return plain


def _unhatanaka(data, limit, path):
    import warnings

    import hatanaka

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            plain = hatanaka.crx2rnx(data)
        except Exception as problem:
            detail = " ".join(str(problem).split())[:160] or "bytes are wrong"
            raise _damaged("Hatanaka (Compact RINEX)", path, detail) from None
    _check_limit(len(plain), limit, "Hatanaka", path)
    if not plain:
        raise _damaged("Hatanaka (Compact RINEX)", path, "nothing comes out")
    return plain
