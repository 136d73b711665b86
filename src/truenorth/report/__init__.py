"""What people look at: text, figures and one self-contained page of a result."""

from .figures import figure_page
from .files import check_figure_path, write_figure
from .text import explain_epoch, find_epoch, summary_text

__all__ = [
    "check_figure_path",
    "explain_epoch",
    "figure_page",
    "find_epoch",
    "summary_text",
    "write_figure",
]
