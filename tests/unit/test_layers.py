"""Imports are law: each layer knows only those below it, and heavy libraries stay in their place.

`lint-imports` checks the order of the layers over the whole graph; this test needs nothing but the
source, names file and line, and adds what a graph cannot see: where in a file an import stands.
"""

import ast
from pathlib import Path

import pytest

import truenorth

PACKAGE = Path(truenorth.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))

# From the base upwards; names in one row may know each other.
LAYERS = (
    ("_kernels",),
    ("constants", "errors", "timescales", "rotations", "frames"),
    ("gravity",),
    ("strapdown",),
    ("observations", "navigation", "sensor_log"),
    ("formats",),
    ("datasets", "config", "platform"),
    ("orbits",),
    ("positioning",),
    ("ambiguity",),
    ("attitude",),
    ("calibration",),
    ("sensors",),
    ("northfinding",),
    ("simulation",),
    ("planning",),
    ("evaluation",),
    ("export",),
    ("report",),
    ("cli",),
)
HEIGHT = {name: height for height, row in enumerate(LAYERS) for name in row}

# The solution offers its own table and figure page; the layers above it make them.
DELEGATES = {("attitude/solution.py", "export"), ("attitude/solution.py", "report")}

# Where a library may be imported at all. Everything else stays free of it.
HOMES = {
    "numba": {"_kernels"},
    "matplotlib": {"report"},
    "plotly": {"report"},
    "polars": {"formats", "export", "report"},
    "xarray": {"export", "report"},
    "pooch": {"datasets"},
    "requests": {"datasets"},
    "typer": {"cli"},
    "ppigrf": {"sensors"},
    "allantools": {"sensors"},
}

# What costs too much to load with the package; imported inside the function that needs it.
HEAVY = {
    "scipy", "polars", "xarray", "matplotlib", "plotly",
    "hatanaka", "ncompress", "pyubx2", "pooch", "requests",
    "ppigrf", "allantools", "pandas",
}  # fmt: skip


def _imports(path):
    """Every import of a module: (dotted name, line, whether it runs when the module is imported)."""
    package = ("truenorth", *path.relative_to(PACKAGE).parent.parts)

    def walk(node, at_top):
        for child in ast.iter_child_nodes(node):
            inside = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
            typing_only = isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test)
            if isinstance(child, ast.Import):
                for alias in child.names:
                    yield alias.name, child.lineno, at_top
            elif isinstance(child, ast.ImportFrom):
                base = package[: len(package) - child.level + 1] if child.level else ()
                parts = (*base, *(child.module.split(".") if child.module else ()))
                if parts == ("truenorth",):
                    for alias in child.names:
                        yield f"truenorth.{alias.name}", child.lineno, at_top
                else:
                    yield ".".join(parts), child.lineno, at_top
            else:
                yield from walk(child, at_top and not inside and not typing_only)

    yield from walk(ast.parse(path.read_text(encoding="utf-8")), True)


def _layer(path):
    first = path.relative_to(PACKAGE).parts[0]
    return first.removesuffix(".py")


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_a_module_imports_only_what_its_layer_may(path):
    layer = _layer(path)
    if layer == "__init__":
        top = [name for name, _, at_top in _imports(path) if at_top]
        assert not [name for name in top if name.startswith("truenorth")], "the door loads nothing"
        return
    assert layer in HEIGHT, f"{path.name} stands in no layer; name it in LAYERS and in pyproject.toml"
    wrong = []
    for name, line, at_top in _imports(path):
        library, _, rest = name.partition(".")
        if library == "truenorth":
            target = rest.partition(".")[0]
            delegated = (path.relative_to(PACKAGE).as_posix(), target) in DELEGATES and not at_top
            if HEIGHT.get(target, -1) > HEIGHT[layer] and not delegated:
                wrong.append(f"line {line}: {layer} imports {target}, which is above it")
            if layer == "_kernels" and target != "_kernels":
                wrong.append(f"line {line}: kernels know arrays only, not {target}")
        if layer not in HOMES.get(library, {layer}):
            wrong.append(f"line {line}: {library} belongs in {', '.join(sorted(HOMES[library]))}")
        if at_top and library in HEAVY:
            wrong.append(f"line {line}: {library} is imported with the module; import it where it is used")
    assert not wrong, "\n".join(wrong)


def test_the_layers_here_are_those_of_the_import_contract():
    import tomllib

    file = PACKAGE.parent.parent / "pyproject.toml"
    if not file.is_file():
        # An installed package is tested beside its checkout, so find the file from this test.
        file = Path(__file__).parents[2] / "pyproject.toml"
    contract = tomllib.loads(file.read_text(encoding="utf-8"))["tool"]["importlinter"]["contracts"][0]
    rows = [{name.strip(" ()") for name in row.split(":")} for row in reversed(contract["layers"])]
    assert rows == [set(row) for row in LAYERS]
