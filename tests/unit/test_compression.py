"""Packed files: recognised by their first bytes, unpacked within bounds, damage said in one sentence."""

import bz2
import gzip
import io
import zipfile

import pytest

from truenorth.errors import FormatError
from truenorth.formats import compression
from truenorth.formats.compression import read_bytes, read_pieces, unpack

PLAIN = b"".join(b"line %06d of something that packs\n" % k for k in range(4000))


def zipped(members):
    sink = io.BytesIO()
    with zipfile.ZipFile(sink, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return sink.getvalue()


def lzw(content):
    import ncompress

    return ncompress.compress(content)


PACKED = {
    "plain": PLAIN,
    "gzip": gzip.compress(PLAIN),
    "gzip of two members": gzip.compress(PLAIN[:50_000]) + gzip.compress(PLAIN[50_000:]),
    "gzip with padding": gzip.compress(PLAIN) + bytes(512),
    "bzip2": bz2.compress(PLAIN),
    "bzip2 of two streams": bz2.compress(PLAIN[:50_000]) + bz2.compress(PLAIN[50_000:]),
    "compress": lzw(PLAIN),
    "zip": zipped({"a.obs": PLAIN}),
    "gzip in zip": zipped({"a.obs.gz": gzip.compress(PLAIN)}),
}


@pytest.mark.parametrize("kind", PACKED)
def test_packings(kind, tmp_path):
    path = tmp_path / "name without a suffix"
    path.write_bytes(PACKED[kind])
    assert read_bytes(path) == PLAIN
    assert read_bytes(str(path)) == PLAIN


@pytest.mark.parametrize("kind", PACKED)
@pytest.mark.parametrize("size", [50, 4096, 10**7])
def test_packings_in_pieces(kind, size, tmp_path):
    path = tmp_path / "a.obs"
    path.write_bytes(PACKED[kind])
    pieces = list(read_pieces(path, size))
    assert b"".join(pieces) == PLAIN
    assert all(pieces)
    if (kind.startswith("gzip") and kind != "gzip in zip") or kind == "plain":
        assert max(map(len, pieces)) <= size


def test_the_end_of_a_well_packed_piece_is_not_lost(tmp_path):
    # A few packed bytes hold many plain ones: the last pieces come when all packed bytes are taken.
    path = tmp_path / "a.gz"
    path.write_bytes(gzip.compress(bytes(10**6)))
    assert b"".join(read_pieces(path, 1000)) == bytes(10**6)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_cut_off_gzip_in_pieces(share, tmp_path):
    path = tmp_path / "a.gz"
    path.write_bytes(PACKED["gzip"][: int(share * len(PACKED["gzip"]))])
    with pytest.raises(FormatError, match=r"cannot be unpacked .*; fetch the file again"):
        list(read_pieces(path, 100))


def test_pieces_of_a_file_that_cannot_be_read(tmp_path):
    (tmp_path / "empty").write_bytes(b"")
    for path, sentence in ((tmp_path / "none", "no such file"), (tmp_path / "empty", "the file is empty")):
        with pytest.raises(FormatError, match=sentence):
            next(read_pieces(path))


@pytest.mark.parametrize("kind", ["gzip", "bzip2", "zip"])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_cut_off_archives(kind, share):
    packed = PACKED[kind]
    with pytest.raises(FormatError, match=r"cannot be unpacked .*; fetch the file again"):
        unpack(packed[: int(share * len(packed))], path="a.obs")


def test_damaged_gzip_is_not_taken_for_a_short_one():
    packed = bytearray(PACKED["gzip"])
    packed[-8] ^= 1  # checksum
    with pytest.raises(FormatError, match="the gzip data cannot be unpacked"):
        unpack(bytes(packed))


@pytest.mark.parametrize("kind", ["gzip", "bzip2", "compress", "zip"])
def test_bombs_are_refused(kind, monkeypatch):
    monkeypatch.setattr(compression, "_ALWAYS_ALLOWED", 1000)
    monkeypatch.setattr(compression, "MAX_EXPANSION", 10)
    bomb = {"gzip": gzip.compress, "bzip2": bz2.compress, "compress": lzw, "zip": lambda x: zipped({"a": x})}
    packed = bomb[kind](bytes(3_000_000))
    with pytest.raises(FormatError, match="unpack to more than"):
        unpack(packed, path="a.obs")


@pytest.mark.parametrize(("members", "count"), [({"a.obs": b"x", "b.obs": b"y"}, "2 files"), ({}, "0 files")])
def test_zip_must_hold_one_file(members, count):
    packed = zipped(members)
    if not members:
        packed = b"PK\x03\x04" + packed
    with pytest.raises(FormatError, match=f"{count}|cannot be unpacked"):
        unpack(packed)


def test_folders_in_a_zip_do_not_count():
    assert unpack(zipped({"folder/": b"", "folder/a.obs": PLAIN})) == PLAIN


def test_damaged_hatanaka():
    head = f"{'1.0':<20}{'COMPACT RINEX FORMAT':<40}CRINEX VERS   / TYPE\n".encode()
    with pytest.raises(FormatError, match="Hatanaka"):
        unpack(head + b"nothing more\n", path="a.crx")


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda p: None, "there is no such file"),
        (lambda p: p.mkdir(), "this is a folder"),
        (lambda p: p.write_bytes(b""), "the file is empty"),
        (lambda p: p.write_bytes(gzip.compress(b"")), "the file is empty"),
    ],
)
def test_files_that_cannot_be_read(tmp_path, make, sentence):
    path = tmp_path / "a.obs"
    make(path)
    with pytest.raises(FormatError, match=sentence) as caught:
        read_bytes(path)
    assert caught.value.path == str(path)
