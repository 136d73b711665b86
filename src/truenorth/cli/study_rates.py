"""``truenorth rates``: one data set at several update rates, with the same satellites."""

from __future__ import annotations

from pathlib import Path

from .numbers import parse_numbers

__all__ = ["run_rates"]


def run_rates(
    session: Path,
    *,
    rates: str,
    reference: Path | None,
    out: Path | None,
    figure: Path | None,
    as_json: bool,
) -> None:
    """Thin a session to several rates, solve each, and tell, write and draw what comes out.

    Parameters
    ----------
    session : Path
        The ``session.toml``.
    rates : str
        Hertz, with commas between.
    reference : Path or None
        Table of truth.
    out, figure : Path or None
        Files to write.
    as_json : bool
        Tell it as JSON.
    """
    import json

    from ..evaluation import compare_rates
    from .plan import check_files
    from .progress import working

    wanted = parse_numbers("--rates", rates)
    check_files(out, figure)
    with working("solving at every rate") as progress:
        study = compare_rates(session, wanted, reference, progress=progress)
    written = []
    if out is not None:
        from ..export.planning import write_table

        written.append(write_table(study.columns(), out))
        if study.obstructions:
            beside = out.with_name(f"{out.stem}-refix{out.suffix}")
            written.append(write_table(study.refix_columns(), beside))
    if figure is not None:
        from ..report.files import save_figure
        from ..report.planning_figures import rates_figure

        written.append(save_figure(rates_figure(study), figure))
    if as_json:
        print(json.dumps({**study.to_dict(), "files": [str(path) for path in written]}, indent=2))
        return
    print(study)
    for path in written:
        print(f"written     {path}")
