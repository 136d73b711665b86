"""The documentation is run: its code, what it says that the code prints, its links, its docstrings."""

import contextlib
import doctest
import importlib.util
import inspect
import io
import itertools
import re
from pathlib import Path

import pytest

import truenorth

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = Path(truenorth.__file__).parent
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("benchmarks/*.md")])
_SOURCES = {
    ".".join(("truenorth", *path.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(".__init__"): path
    for path in sorted(PACKAGE.rglob("*.py"))
}
MODULES = tuple(_SOURCES)

_FENCE = re.compile(r"^```(?P<kind>[a-z]*)[^\n]*\n(?P<text>.*?)^```[ ]*$", re.MULTILINE | re.DOTALL)
_FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def _blocks(page):
    """Python blocks of a page in order: (line, code, what the page says that it prints or None)."""
    text = page.read_text(encoding="utf-8")
    fences = list(_FENCE.finditer(text))
    for fence, after in itertools.zip_longest(fences, fences[1:]):
        if fence["kind"] != "python":
            continue
        # A block of plain text right below is the output.
        follows = (
            after is not None and after["kind"] == "text" and not text[fence.end() : after.start()].strip()
        )
        yield text.count("\n", 0, fence.start("text")), fence["text"], after["text"] if follows else None


def _names(page):
    return page.relative_to(ROOT).as_posix()


@pytest.mark.jit
@pytest.mark.parametrize("page", [page for page in PAGES if any(_blocks(page))], ids=_names)
def test_the_code_of_a_page_runs_and_prints_what_the_page_says(page, data_dir, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TRUENORTH_DATA", str(data_dir))
    monkeypatch.setenv("MPLBACKEND", "Agg")
    names = {"__name__": "__main__"}
    for line, code, wanted in _blocks(page):
        said = io.StringIO()
        # Empty lines in front give a traceback the line numbers of the page.
        with contextlib.redirect_stdout(said):
            exec(compile("\n" * line + code, str(page), "exec"), names)
        if wanted is not None:
            ok = doctest.OutputChecker().check_output(wanted, said.getvalue(), _FLAGS)
            assert ok, (
                f"{_names(page)}, line {line}: the page says\n{wanted}\nthe code prints\n{said.getvalue()}"
            )


@pytest.mark.parametrize("page", PAGES, ids=_names)
def test_links_of_a_page_lead_somewhere(page):
    text = re.sub(_FENCE, "", page.read_text(encoding="utf-8"))
    missing = []
    for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text):
        if not target.startswith(("http://", "https://", "mailto:")) and not (page.parent / target).exists():
            missing.append(target)
    assert not missing


@pytest.mark.parametrize("name", MODULES)
def test_a_module_opens_with_its_subject(name):
    assert importlib.import_module(name).__doc__


@pytest.mark.parametrize("name", [name for name in MODULES if ">>>" in _SOURCES[name].read_text("utf-8")])
def test_examples_in_docstrings_hold(name, data_dir):
    failed, tried = doctest.testmod(importlib.import_module(name), optionflags=_FLAGS)
    assert tried > 0
    assert failed == 0


# Demanded of every name that a module offers, and more of the functions of the package itself: those
# state every parameter and what comes back. (The fields of settings are documented one by one below
# them. Parameters that belong together may share a line, so their order is free.)
_EVERYWHERE = {"GL03", "GL06", "GL07", "GL08", "GL09", "SS03", "SS04", "PR02", "PR10"}
_AT_THE_DOOR = _EVERYWHERE | {"PR01", "RT01"}


def _offered():
    for name in MODULES:
        if name.startswith(("truenorth._kernels", "truenorth.cli")):
            continue
        module = importlib.import_module(name)
        for offered in getattr(module, "__all__", ()):
            value = getattr(module, offered)
            if inspect.isfunction(value) or (
                inspect.isclass(value) and value.__module__.startswith("truenorth")
            ):
                yield (
                    f"{value.__module__}.{value.__qualname__}",
                    inspect.isfunction(value) and offered in truenorth.__all__,
                )


def test_docstrings_are_complete_numpydoc():
    validate = pytest.importorskip("numpydoc.validate", reason="numpydoc is not installed").validate
    wrong = []
    for name, at_the_door in sorted(set(_offered())):
        demanded = _AT_THE_DOOR if at_the_door else _EVERYWHERE
        wrong += [f"{name}: {code} {text}" for code, text in validate(name)["errors"] if code in demanded]
    assert not wrong, "\n".join(wrong)


def test_the_readme_has_one_command_each_for_the_job_and_the_tests():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for purpose in ("main job", "tests"):
        found = re.findall(rf"<!-- command: {purpose} -->\n```sh\n(.+)\n```", readme)
        assert len(found) == 1, f"one command for the {purpose}, marked as such"
        assert found[0].startswith("python3.11 -m venv .venv && .venv/bin/pip install")


def test_the_page_of_data_sets_is_the_table():
    spec = importlib.util.spec_from_file_location("datasets_page", ROOT / "tools" / "datasets_page.py")
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    assert tool.PAGE.read_text(encoding="utf-8") == tool.page(), "run python tools/datasets_page.py"


def test_every_page_of_validation_is_in_its_table_of_contents():
    folder = ROOT / "docs" / "validation"
    contents = (folder / "README.md").read_text(encoding="utf-8")
    assert not [
        page.name for page in folder.glob("*.md") if page.name != "README.md" and page.name not in contents
    ]
