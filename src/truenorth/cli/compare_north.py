"""``truenorth compare-north``: ways to find north side by side, table 9 of Oguz (2006) made from runs."""

from __future__ import annotations

from pathlib import Path

__all__ = ["run_compare_north"]


def run_compare_north(
    *,
    runs: int | None,
    seed: int | None,
    latitude_deg: float | None,
    heading_deg: float | None,
    methods: str | None,
    out: Path | None,
    figure: Path | None,
    as_json: bool,
) -> None:
    """Let every technique find north under one common truth, and tell, write and draw what comes out.

    Parameters
    ----------
    runs, seed : int or None
        Draws of all errors, and the seed of the first.
    latitude_deg, heading_deg : float or None
        The common truth; of the thesis by default.
    methods : str or None
        Names of techniques with commas between; all by default.
    out, figure : Path or None
        Files to write.
    as_json : bool
        Tell it as JSON.
    """
    import json

    from ..evaluation import compare_north
    from ..evaluation.north_comparison import TECHNIQUES
    from .plan import check_files
    from .progress import working

    given = {"runs": runs, "seed": seed, "latitude_deg": latitude_deg, "heading_deg": heading_deg}
    changes = {name: value for name, value in given.items() if value is not None}
    names = None if methods is None else [name.strip() for name in methods.split(",")]
    check_files(out, figure)
    wanted = TECHNIQUES if names is None else names
    with working("finding north in every way") as progress:
        if any(name in TECHNIQUES and TECHNIQUES[name].is_external for name in wanted):
            _compile_engines()
        comparison = compare_north(methods=names, progress=progress, **changes)
    written = []
    if out is not None:
        from ..export.planning import write_table

        written.append(write_table(comparison.columns(), out))
    if figure is not None:
        from ..report.files import save_figure
        from ..report.north_comparison_figures import north_comparison_figure

        written.append(save_figure(north_comparison_figure(comparison), figure))
    if as_json:
        print(json.dumps({**comparison.to_dict(), "files": [str(path) for path in written]}, indent=2))
        return
    print(comparison)
    for path in written:
        print(f"written     {path}")


def _compile_engines() -> None:
    """Compile what satellites need, if nothing is compiled yet: arrays by a second process, pairs by this."""
    from ..ambiguity.rehearsal import rehearse_engine
    from .first_run import engine_compiled_meanwhile
    from .progress import kernels_are_compiled, mark_kernels_compiled

    with engine_compiled_meanwhile("array"):
        if not kernels_are_compiled("pair"):
            rehearse_engine()
            mark_kernels_compiled("pair")
