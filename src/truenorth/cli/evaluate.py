"""``truenorth evaluate``: a solution against a reference."""

from __future__ import annotations

from pathlib import Path

from ..errors import ConfigError

__all__ = ["evaluate_files", "parse_vector"]


def evaluate_files(
    solution: Path,
    reference: Path,
    *,
    body: str | None = None,
    wrong_sd: float = 5.0,
    wrong_deg: float | None = None,
    figure: Path | None = None,
    as_json: bool = False,
) -> None:
    """Print the errors of a solution's file against a reference's, and draw them.

    Parameters
    ----------
    solution, reference : Path
        Tables, see `truenorth.evaluation.compare`.
    body : str, optional
        Body vector of a baseline as ``forward,right,down``; by default from the settings beside the
        solution, else straight ahead.
    wrong_sd, wrong_deg : float, optional
        What makes an epoch wrong.
    figure : Path, optional
        Figure or page to write.
    as_json : bool
        Tell it as JSON.
    """
    import json

    from ..evaluation import compare
    from ..evaluation.comparison import body_vector_beside

    if figure is not None:
        from ..report import check_figure_path

        check_figure_path(figure)
    vector = parse_vector(body) if body is not None else body_vector_beside(solution)
    comparison = compare(solution, reference, baseline_body_m=vector, wrong_sd=wrong_sd, wrong_deg=wrong_deg)
    if figure is not None:
        from ..report import write_figure

        write_figure(comparison, figure)
    if as_json:
        print(json.dumps(comparison.to_dict(), indent=2, allow_nan=False))
        return
    print(comparison)
    if figure is not None:
        print(f"written     {figure}")


def parse_vector(text: str) -> tuple[float, float, float]:
    """Three numbers with commas between."""
    try:
        forward, right, down = (float(part) for part in text.split(","))
    except ValueError:
        raise ConfigError(
            f"`--body {text}` is not three numbers; give metres forward, right, down, e.g. 2.0,0,0",
            key="body",
        ) from None
    return forward, right, down
