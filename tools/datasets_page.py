"""Write docs/datasets.md from the table of data sets: python tools/datasets_page.py."""

from pathlib import Path

from truenorth import datasets

PAGE = Path(__file__).resolve().parents[1] / "docs" / "datasets.md"

HEAD = """\
# Data sets

Made by `python tools/datasets_page.py` from `src/truenorth/datasets.toml`; a test keeps the two together.

Every set is somebody else's measurement, in a public repository. `truenorth.datasets.fetch(name)` takes it
from the folder that the environment variable `TRUENORTH_DATA` names (one folder for each set), or downloads
it once into the user's cache; the content is checked against its SHA-256 either way. On the command line:
`truenorth datasets`, and `truenorth example NAME` for the pairs. Files marked *derived* were made from
upstream ones and cannot be downloaded.
"""


def page():
    """Text of the page."""
    parts = [HEAD]
    for name in datasets.names():
        info = datasets.info(name)
        truth = ", ".join(f"`{key}` {value:g}" for key, value in info.truth.items())
        parts.append(f"\n## {name}\n\n{info.summary[0].upper()}{info.summary[1:]}.\n")
        parts.append(f"\n- Licence: {info.licence}\n- Truth: {truth or 'none as a number'}. {info.note}\n")
        parts.append("\n| role | file | source | SHA-256 |\n| --- | --- | --- | --- |\n")
        for file in info.files:
            source = (
                f"[{file.repository}@{file.commit[:8]}]({file.url})"
                if file.path
                else f"*derived*: {file.derived}"
            )
            parts.append(f"| `{file.role}` | `{file.local}` | {source} | `{file.sha256[:16]}...` |\n")
    return "".join(parts)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
