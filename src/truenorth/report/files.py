"""Writing figures; the suffix names the kind of file."""

from pathlib import Path

from ..errors import writing
from ..export.files import check_suffix

__all__ = ["STATIC_SUFFIXES", "check_figure_path", "check_static_path", "save_figure", "write_figure"]

STATIC_SUFFIXES = (".png", ".pdf", ".svg")
"""Suffixes of static pages; ``.html`` is interactive."""


def check_figure_path(path):
    """Make sure that a figure page can be written.

    Parameters
    ----------
    path : str or path-like
        File to be written later.

    Raises
    ------
    ConfigError
        If the suffix is unknown or the file cannot be written.
    """
    check_suffix(path, (*STATIC_SUFFIXES, ".html"), key="figure")


def write_figure(solution, path):
    """Write the figure page of a result.

    Parameters
    ----------
    solution : BaselineSolution, AttitudeSolution or Comparison
        Result of `truenorth.solve_session`, or its comparison with a reference.
    path : str or path-like
        ``.png``, ``.pdf`` or ``.svg`` for a static page, ``.html`` for an interactive one.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ConfigError
        If the suffix is unknown or the file cannot be written.
    """
    path = Path(path)
    check_figure_path(path)
    with writing(path, key="figure"):
        if path.suffix.lower() == ".html":
            from .page import page_html

            path.write_text(page_html(solution), encoding="utf-8")
        else:
            from .figures import figure_page

            figure_page(solution).savefig(path)
    return path


def check_static_path(path):
    """Make sure that a figure can be written that has no interactive form.

    Parameters
    ----------
    path : str or path-like
        File to be written later.

    Raises
    ------
    ConfigError
        If the suffix is unknown or the file cannot be written.
    """
    check_suffix(path, STATIC_SUFFIXES, key="figure")


def save_figure(figure, path):
    """Write a figure to a file.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        What to write.
    path : str or path-like
        ``.png``, ``.pdf`` or ``.svg``.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ConfigError
        If the suffix is unknown or the file cannot be written.
    """
    path = Path(path)
    check_static_path(path)
    with writing(path, key="figure"):
        figure.savefig(path)
    return path
