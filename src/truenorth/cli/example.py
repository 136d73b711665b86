"""``truenorth example`` and ``truenorth datasets``: public data with known truth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..datasets import Dataset

__all__ = ["list_datasets", "locate_dataset", "solve_example"]

INERTIAL_AT_REST = "imu_laser_gyro"
"""The public inertial log in which north can be found."""


def solve_example(
    name: str,
    *,
    out: Path | None = None,
    figure: Path | None = None,
    method: str | None = None,
    single_epoch: bool = False,
    as_json: bool = False,
) -> int:
    """Solve a named data set, a pair with its published length, and print the published truth beside it.

    Parameters
    ----------
    name : str
        Name of the set.
    out, figure : Path, optional
        Files to write.
    method : str, optional
        Integer resolution, or method of the search for north.
    single_epoch : bool
        Resolve every epoch by itself.
    as_json : bool
        Tell it as JSON.

    Returns
    -------
    int
        Exit code.
    """
    from .. import datasets
    from ..errors import ConfigError

    dataset = datasets.fetch(name)
    if name == INERTIAL_AT_REST:
        if single_epoch:
            raise ConfigError(f"`{name}` is an inertial log, which has no epochs; leave --single-epoch out")
        from .northfind import run_northfind

        code = run_northfind(
            dataset.files["imu"],
            latitude_deg=dataset.truth["latitude_deg"],
            height_m=dataset.truth["height_m"],
            errors="navigation",
            method=method,
            out=out,
            figure=figure,
            as_json=as_json,
        )
    elif {"base", "rover"} <= set(dataset.files):
        code = _solve_pair(
            dataset, out=out, figure=figure, method=method, single_epoch=single_epoch, as_json=as_json
        )
    else:
        raise ConfigError(
            f"`{name}` is neither a pair of antennas nor an inertial log at rest; choose another set of"
            f" `truenorth datasets`"
        )
    truth = ", ".join(f"{key} {value:g}" for key, value in dataset.truth.items())
    if truth and not as_json:
        print(f"published   {truth}")
    return code


def _solve_pair(
    dataset: Dataset,
    *,
    out: Path | None,
    figure: Path | None,
    method: str | None,
    single_epoch: bool,
    as_json: bool,
) -> int:
    """Solve two antennas with the length between them that was published."""
    from ..config import GnssSettings
    from .request import make_session
    from .run import run_session

    pair = [dataset.files["base"], dataset.files["rover"]]
    files = [*pair, *(path for path in dataset.navigation if path not in pair)]
    accuracy_m = dataset.truth.get("accuracy_m", 0.0)
    overrides = {
        "length_m": dataset.truth.get("length_m"),
        # The published length is known no better than the published coordinates.
        "length_sd_m": accuracy_m if accuracy_m > GnssSettings().length_sd_m else None,
        "method": method,
        "single_epoch": single_epoch or None,
    }
    session = make_session(files, overrides, [])
    return run_session(session, out=out, figure=figure, as_json=as_json)


def list_datasets(*, as_json: bool = False) -> None:
    """Print the names of the public sets and what they hold."""
    import json

    from .. import datasets

    known = [datasets.info(name) for name in datasets.names()]
    if as_json:
        table = [
            {
                "name": entry.name,
                "summary": entry.summary,
                "licence": entry.licence,
                "truth": dict(entry.truth),
            }
            for entry in known
        ]
        print(json.dumps(table, indent=2))
        return
    for entry in known:
        print(f"{entry.name}\n    {entry.summary} ({entry.licence})")


def locate_dataset(name: str, *, as_json: bool = False) -> None:
    """Fetch a set if need be and print the paths of its files."""
    import json

    from .. import datasets

    dataset = datasets.fetch(name)
    if as_json:
        files = {role: str(path) for role, path in dataset.files.items()}
        print(json.dumps({"name": name, "truth": dict(dataset.truth), "files": files}, indent=2))
    else:
        print(dataset.describe())
