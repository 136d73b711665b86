"""``truenorth info``: what files hold."""

from __future__ import annotations

import json
from pathlib import Path

__all__ = ["info"]


def info(files: list[Path], as_json: bool) -> None:
    """Print what each file holds, as aligned text or as JSON.

    Parameters
    ----------
    files : list of Path
        Observation, navigation or orbit files.
    as_json : bool
        Print JSON: one object for a single file, a list for several.

    Raises
    ------
    FormatError
        If a file cannot be read; those before it have been printed as text already.
    """
    from ..formats import summarize

    if as_json:
        found = [summarize(path).to_dict() for path in files]
        print(json.dumps(found[0] if len(found) == 1 else found, indent=2, ensure_ascii=False))
        return
    for k, path in enumerate(files):
        if k:
            print()
        print(summarize(path))
