"""Public data sets: the table, the folder, and the download against a server on this machine."""

import dataclasses
import functools
import gzip
import hashlib
import http.server
import threading
from urllib.parse import unquote

import pytest

from truenorth import datasets
from truenorth.errors import ConfigError, TrueNorthError

PLAIN = b"observations as the repository serves them\n" * 50
PACKED = gzip.compress(b"a log that is kept compressed upstream\n" * 50, mtime=0)


def _file(role, local, path, content, **changes):
    file = datasets.DatasetFile(
        role=role,
        local=local,
        repository="someone/data",
        commit="0123abcd",
        path=path,
        derived="",
        sha256=hashlib.sha256(content).hexdigest(),
        size=len(content),
    )
    return dataclasses.replace(file, **changes)


@pytest.fixture
def small_set(monkeypatch, tmp_path):
    """Make a set of three files known: one plain upstream, one compressed upstream, one derived."""
    made = datasets.DatasetInfo(
        name="small",
        summary="a set made for this test",
        licence="MIT",
        note="exact",
        truth={"length_m": 1.0},
        files=(
            _file("base", "base.obs.gz", "some folder/base+1.obs", PLAIN),
            _file("navigation", "log.ubx.gz", "log.ubx.gz", PACKED),
            _file("base_rinex", "made.obs", "", b"made", derived="made from the log with a converter"),
        ),
    )
    monkeypatch.setattr(datasets, "_table", lambda: {"small": made})
    monkeypatch.delenv(datasets.DATA_VARIABLE, raising=False)
    # Away from any checkout, which could have data beside it.
    monkeypatch.chdir(tmp_path)
    return made


@pytest.fixture
def server(tmp_path):
    """Serve a folder on a free port of 127.0.0.1; yields its address, its folder and the requested paths."""
    root = tmp_path / "served"
    root.mkdir()
    requested = []

    class Handler(http.server.SimpleHTTPRequestHandler):
        def do_GET(self):
            requested.append(unquote(self.path))
            super().do_GET()

        def log_message(self, *_):
            pass

    with http.server.ThreadingHTTPServer(
        ("127.0.0.1", 0), functools.partial(Handler, directory=root)
    ) as httpd:
        thread = threading.Thread(target=httpd.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{httpd.server_port}", root, requested
        httpd.shutdown()
        thread.join()


def _publish(root, base=PLAIN, log=PACKED):
    place = root / "someone" / "data" / "raw" / "0123abcd"
    (place / "some folder").mkdir(parents=True)
    (place / "some folder" / "base+1.obs").write_bytes(base)
    (place / "log.ubx.gz").write_bytes(log)


def test_download_keeps_checked_files_and_asks_once(small_set, server, tmp_path):
    site, root, requested = server
    _publish(root)

    got = datasets.fetch("small", cache=tmp_path / "cache", site=site)
    again = datasets.fetch("small", cache=tmp_path / "cache", site=site)

    assert got.files == again.files
    # What was made from an upstream file cannot be downloaded, so it is not promised.
    assert set(got.files) == {"base", "navigation"}
    assert got.files["base"] == tmp_path / "cache" / "small" / "base.obs"
    assert got.files["base"].read_bytes() == PLAIN
    assert got.navigation == (tmp_path / "cache" / "small" / "log.ubx.gz",)
    assert got.navigation[0].read_bytes() == PACKED
    prefix = "/someone/data/raw/0123abcd/"
    assert requested == [prefix + "some folder/base+1.obs", prefix + "log.ubx.gz"]


def test_a_damaged_copy_in_the_cache_is_fetched_again(small_set, server, tmp_path):
    site, root, requested = server
    _publish(root)
    got = datasets.fetch("small", cache=tmp_path / "cache", site=site)
    got.files["base"].write_bytes(PLAIN[:100])

    again = datasets.fetch("small", cache=tmp_path / "cache", site=site)

    assert again.files["base"].read_bytes() == PLAIN
    assert len(requested) == 3


def _assert_one_sentence(text):
    assert "\n" not in text
    assert text.startswith("could not ")
    assert len(text) < 500


def test_changed_content_is_refused(small_set, server, tmp_path):
    site, root, _ = server
    _publish(root, base=PLAIN + b"one line more\n")

    with pytest.raises(datasets.DatasetError, match="not the published file") as raised:
        datasets.fetch("small", cache=tmp_path / "cache", site=site)

    _assert_one_sentence(str(raised.value))
    assert datasets.DATA_VARIABLE in str(raised.value)
    assert not (tmp_path / "cache" / "small" / "base.obs").exists()


def test_a_file_that_is_gone_upstream_says_so(small_set, server, tmp_path):
    site, _, _ = server
    with pytest.raises(datasets.DatasetError, match="the server answers 404") as raised:
        datasets.fetch("small", cache=tmp_path / "cache", site=site)
    _assert_one_sentence(str(raised.value))


def test_without_a_network_the_folder_is_named_as_the_way_out(small_set, tmp_path):
    # Nothing listens on port 9 of this machine, so the connection is refused at once.
    with pytest.raises(datasets.DatasetError, match="no answer") as raised:
        datasets.fetch("small", cache=tmp_path / "cache", site="http://127.0.0.1:9")
    _assert_one_sentence(str(raised.value))
    assert datasets.DATA_VARIABLE in str(raised.value)


@pytest.fixture
def small_folder(small_set, tmp_path):
    """Build a data folder as users keep it: what is plain upstream is gzipped here."""
    place = tmp_path / "data" / "small"
    place.mkdir(parents=True)
    (place / "base.obs.gz").write_bytes(gzip.compress(PLAIN))
    (place / "log.ubx.gz").write_bytes(PACKED)
    (place / "made.obs").write_bytes(b"made")
    return tmp_path / "data"


def test_the_named_folder_is_used_before_any_network(small_folder, monkeypatch):
    monkeypatch.setenv(datasets.DATA_VARIABLE, str(small_folder))
    got = datasets.fetch("small", site="http://127.0.0.1:9")
    assert got.files == {
        "base": small_folder / "small" / "base.obs.gz",
        "navigation": small_folder / "small" / "log.ubx.gz",
        "base_rinex": small_folder / "small" / "made.obs",
    }
    assert got.truth == {"length_m": 1.0}
    assert "MIT" in str(got)
    assert str(got.files["base"]) in got.describe()


def test_a_folder_beside_the_checkout_is_found(small_folder, tmp_path, monkeypatch):
    checkout = tmp_path / "checkout"
    checkout.mkdir()
    (tmp_path / "shared").mkdir()
    small_folder.rename(tmp_path / "shared" / "data")
    monkeypatch.chdir(checkout)
    got = datasets.fetch("small", site="http://127.0.0.1:9")
    assert got.files["base"] == (tmp_path / "shared" / "data" / "small" / "base.obs.gz").resolve()


@pytest.mark.parametrize(
    ("local", "content", "said"),
    [
        ("base.obs.gz", gzip.compress(PLAIN + b"x", mtime=0), "is published; get it anew"),
        ("base.obs.gz", gzip.compress(PLAIN, mtime=0)[:-9], "cannot be read"),
        ("base.obs.gz", b"not gzip at all", "cannot be read"),
        ("log.ubx.gz", PACKED[:-1], "is published; get it anew"),
        ("made.obs", None, "it is not there"),
    ],
    ids=["other content", "cut short", "not gzip", "a byte less", "absent"],
)
def test_a_folder_with_other_content_is_refused(small_folder, local, content, said):
    path = small_folder / "small" / local
    path.unlink() if content is None else path.write_bytes(content)
    with pytest.raises(datasets.DatasetError, match=said) as raised:
        datasets.fetch("small", folder=small_folder)
    _assert_one_sentence(str(raised.value))
    assert local in str(raised.value)
    assert isinstance(raised.value, TrueNorthError)


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(ConfigError, match="pair_1m_geodetic") as raised:
        datasets.fetch("pair_of_shoes")
    assert raised.value.key == "dataset"
    assert raised.value.value == "pair_of_shoes"


def test_every_file_of_the_table_has_a_source_or_a_reason():
    for name in datasets.names():
        known = datasets.info(name)
        assert known.licence
        roles = [file.role for file in known.files]
        assert len(roles) == len(set(roles)), name
        for file in known.files:
            assert bool(file.path) != bool(file.derived), (name, file.role)
            assert len(bytes.fromhex(file.sha256)) == 32
            assert len(file.commit) in (8, 40)
            assert set(file.commit) <= set("0123456789abcdef"), (name, file.role)
            if file.path:
                assert file.url.startswith(f"https://github.com/{file.repository}/raw/{file.commit}/")
            else:
                assert file.url == ""
        assert f"{name}: " in datasets.describe(name)


@pytest.mark.parametrize("name", datasets.names())
def test_the_real_data_are_the_published_ones(data_dir, name):
    got = datasets.fetch(name, folder=data_dir)
    assert set(got.files) == {file.role for file in got.info.files}
    if name.startswith(("pair_", "moving_")):
        assert {"base", "rover"} <= set(got.files)
        assert got.navigation


def test_true_baselines_agree_with_their_own_angles():
    """Length and azimuth of the table follow from its east, north, up (rounded to 0.1 mm)."""
    from math import atan2, degrees, hypot

    for name in ("pair_1m_geodetic", "pair_0.33m_ublox", "pair_38m_gps"):
        truth = datasets.info(name).truth
        east, north, up = truth["east_m"], truth["north_m"], truth["up_m"]
        # Each component is rounded to 0.1 mm (1 mm for the longest), so the length is good to 1 mm.
        assert hypot(east, north, up) == pytest.approx(truth["length_m"], abs=1e-3)
        if "azimuth_deg" in truth:
            azimuth = degrees(atan2(east, north)) % 360.0
            # 0.1 mm over 0.33 m is 0.02 degrees.
            assert azimuth == pytest.approx(truth["azimuth_deg"], abs=0.03)
