"""Public data sets by name: real receivers' files with known truth, fetched and checked.

Each set is somebody else's measurement in a public repository, named with its commit, licence and
SHA-256 in ``datasets.toml``. `fetch` takes the files from the folder named by the environment variable
``TRUENORTH_DATA``, or from ``../shared/data`` where a checkout has it beside itself, and otherwise
downloads them once into a cache. Either way the content is checked against its hash before it is
handed out.

    pair = truenorth.datasets.fetch("pair_1m_geodetic")
    solution = truenorth.solve_baseline(pair.files["base"], pair.files["rover"], pair.navigation)
"""

from __future__ import annotations

import functools
import gzip
import hashlib
import os
import tomllib
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from .errors import ConfigError, TrueNorthError

__all__ = [
    "DATA_VARIABLE",
    "NEARBY",
    "Dataset",
    "DatasetError",
    "DatasetFile",
    "DatasetInfo",
    "describe",
    "fetch",
    "info",
    "names",
]

DATA_VARIABLE = "TRUENORTH_DATA"
"""Environment variable that names the folder of the data sets."""

NEARBY = Path("..") / "shared" / "data"
"""Folder of the data sets beside a checkout, seen from the checkout; used where it has the set."""

_GITHUB = "https://github.com"
_CHUNK = 1 << 20


class DatasetError(TrueNorthError, OSError):
    """A public data set cannot be had: no network, a missing file, or content that is not as published."""


@dataclass(frozen=True, slots=True)
class DatasetFile:
    """One file of a public set.

    Parameters
    ----------
    role : str
        What it is for: ``base``, ``rover``, ``navigation`` ...
    local : str
        Its name in the folder of the set.
    repository, commit, path : str
        Where it is upstream; the path is empty where the file was made from an upstream one.
    derived : str
        How it was made; empty where it is as upstream.
    sha256 : str
        Hash of the file as upstream serves it (of the local bytes when derived).
    size : int
        Its size in bytes.
    """

    role: str
    local: str
    repository: str
    commit: str
    path: str
    derived: str
    sha256: str
    size: int

    @property
    def url(self) -> str:
        """str: Address of the file at its commit; empty where there is nothing to download."""
        return self.url_at(_GITHUB)

    def url_at(self, site: str) -> str:
        """Address of the file on a mirror that keeps GitHub's paths."""
        # The "raw" address of the site, unlike that of its file server, resolves abbreviated commits
        # and files under Git LFS.
        path = self.path.replace(" ", "%20").replace("+", "%2B")
        return f"{site}/{self.repository}/raw/{self.commit}/{path}" if path else ""


@dataclass(frozen=True, slots=True)
class DatasetInfo:
    """What is known of a public set without having its files.

    Parameters
    ----------
    name, summary, licence, note : str
        Its name, what it holds, under which terms, and how good the truth is.
    truth : dict of str to float
        True values with the unit in the name (``azimuth_deg``, ``length_m``); may be empty.
    files : tuple of DatasetFile
        Its files.
    """

    name: str
    summary: str
    licence: str
    note: str
    truth: Mapping[str, float]
    files: tuple[DatasetFile, ...]


@dataclass(frozen=True, slots=True)
class Dataset:
    """A public set whose files are at hand.

    Parameters
    ----------
    info : DatasetInfo
        What is known of it.
    files : dict of str to Path
        Path by role. Files that were made from upstream ones are here only when a data folder has them.
    """

    info: DatasetInfo
    files: Mapping[str, Path]

    @property
    def name(self) -> str:
        """str: Name of the set."""
        return self.info.name

    @property
    def truth(self) -> Mapping[str, float]:
        """Dict of str to float: True values, the unit in the name."""
        return self.info.truth

    @property
    def navigation(self) -> tuple[Path, ...]:
        """Tuple of Path: Every file with broadcast ephemerides for the pair, in the order of the table."""
        return tuple(path for role, path in self.files.items() if role.startswith("navigation"))

    def describe(self) -> str:
        """Several lines: what the set holds, its source, licence, truth and paths."""
        return describe(self.name) + "".join(f"\n  {role}: {path}" for role, path in self.files.items())

    def __str__(self) -> str:
        """One line: name, summary, licence."""
        return f"{self.name}: {self.info.summary} ({self.info.licence})"


@functools.cache
def _table() -> dict[str, DatasetInfo]:
    raw = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
    table = {}
    for entry in raw["sets"]:
        files = tuple(
            DatasetFile(
                role=file["role"],
                local=file["local"],
                repository=file.get("repository", entry["repository"]),
                commit=file.get("commit", entry.get("commit", "")),
                path=file.get("path", ""),
                derived=file.get("derived", ""),
                sha256=file["sha256"],
                size=file["size"],
            )
            for file in entry["files"]
        )
        table[entry["name"]] = DatasetInfo(
            name=entry["name"],
            summary=entry["summary"],
            licence=entry["licence"],
            note=entry["note"],
            truth=entry.get("truth", {}),
            files=files,
        )
    return table


def names() -> tuple[str, ...]:
    """Names of the public sets, those of two antennas first."""
    return tuple(_table())


def info(name: str) -> DatasetInfo:
    """What is known of a set without having its files.

    Parameters
    ----------
    name : str
        One of `names`.

    Returns
    -------
    DatasetInfo
        Source, licence, truth and files.

    Raises
    ------
    ConfigError
        If there is no set of that name.
    """
    try:
        return _table()[name]
    except KeyError:
        known = ", ".join(names())
        raise ConfigError(
            f"could not find the data set {name!r}; give one of {known}", key="dataset", value=name
        ) from None


def describe(name: str) -> str:
    """Say what a set holds, where it comes from, its licence and its truth.

    Parameters
    ----------
    name : str
        One of `names`.

    Returns
    -------
    str
        Several lines.

    Raises
    ------
    ConfigError
        If there is no set of that name.
    """
    known = info(name)
    sources = dict.fromkeys(f"https://github.com/{f.repository} at {f.commit}" for f in known.files)
    lines = [
        f"{known.name}: {known.summary}",
        f"  source: {'; '.join(sources)}",
        f"  licence: {known.licence}",
        f"  truth: {', '.join(f'{key} {value}' for key, value in known.truth.items()) or 'see the note'}",
        f"  note: {known.note}",
    ]
    return "\n".join(lines)


def fetch(
    name: str,
    *,
    folder: str | os.PathLike[str] | None = None,
    cache: str | os.PathLike[str] | None = None,
    site: str = _GITHUB,
) -> Dataset:
    """Get a public data set, from a folder of data sets or from the network.

    Parameters
    ----------
    name : str
        One of `names`.
    folder : path, optional
        Folder that holds the data sets, one folder each. The default is the one that the environment
        variable ``TRUENORTH_DATA`` names, then `NEARBY` where it has the set; without either the files
        are downloaded.
    cache : path, optional
        Where downloads are kept; by default the user's cache folder of the system.
    site : str, optional
        Mirror to download from, which keeps GitHub's paths.

    Returns
    -------
    Dataset
        Paths by role, and the truth.

    Raises
    ------
    ConfigError
        If there is no set of that name.
    DatasetError
        If a file is missing, cannot be downloaded, or is not the published one.

    Examples
    --------
    >>> import truenorth as tn
    >>> tn.datasets.names()[0]
    'pair_1m_geodetic'
    """
    wanted = info(name)
    source = folder if folder is not None else os.environ.get(DATA_VARIABLE) or None
    if source is None and (NEARBY / name).is_dir():
        source = NEARBY.resolve()
    if source is not None:
        return Dataset(wanted, {file.role: _local(wanted, file, Path(source)) for file in wanted.files})
    target = _cache_folder(cache) / name
    return Dataset(
        wanted, {file.role: _download(wanted, file, target, site) for file in wanted.files if file.path}
    )


def _local(wanted: DatasetInfo, file: DatasetFile, folder: Path) -> Path:
    path = folder / wanted.name / file.local
    what = f"could not take {file.local} of the data set {wanted.name} from the folder {folder}"
    if not path.is_file():
        raise DatasetError(
            f"{what}: it is not there; correct {DATA_VARIABLE}, or unset it to download the files"
        )
    compressed_here = path.suffix == ".gz" and not file.derived and not file.path.endswith(".gz")
    try:
        found = _hash_of(path, unpack=compressed_here)
    except (OSError, EOFError, zlib.error) as error:
        raise DatasetError(f"{what}: it cannot be read ({error}); get it anew") from error
    if found != file.sha256:
        raise DatasetError(
            f"{what}: its SHA-256 is {found[:12]}..., {file.sha256[:12]}... is published; get it anew"
        )
    return path


def _hash_of(path: Path, *, unpack: bool) -> str:
    digest = hashlib.sha256()
    with gzip.open(path) if unpack else path.open("rb") as stream:
        while block := stream.read(_CHUNK):
            digest.update(block)
    return digest.hexdigest()


def _cache_folder(cache: str | os.PathLike[str] | None) -> Path:
    if cache is not None:
        return Path(cache)
    import pooch

    return Path(pooch.os_cache("truenorth"))


def _download(wanted: DatasetInfo, file: DatasetFile, target: Path, site: str) -> Path:
    import pooch
    import requests

    # The cache keeps files as upstream serves them, so a copy that we gzip loses its suffix there.
    name = file.local if file.path.endswith(".gz") else file.local.removesuffix(".gz")
    url = file.url_at(site)
    what = f"could not download {file.local} of the data set {wanted.name}"
    logger = pooch.get_logger()
    level = logger.level
    logger.setLevel("WARNING")
    try:
        return Path(pooch.retrieve(url, known_hash=f"sha256:{file.sha256}", fname=name, path=target))
    except ValueError as error:
        raise DatasetError(
            f"{what}: what {url} sends is not the published file (its SHA-256 is not {file.sha256[:12]}...); "
            f"get it by other means and set {DATA_VARIABLE} to its folder"
        ) from error
    except (requests.RequestException, OSError) as error:
        response = getattr(error, "response", None)
        if response is None:
            cause = f"no answer ({type(error).__name__})"
        else:
            response.close()
            cause = f"the server answers {response.status_code}"
        raise DatasetError(
            f"{what} from {url}: {cause}; connect to the network, or set {DATA_VARIABLE} to a folder "
            "that holds the data sets"
        ) from error
    finally:
        logger.setLevel(level)
