"""What all plots share: matplotlib, texts without formulas, and files.

matplotlib is an optional dependency and imported when a figure is made. Figures belong to no window
and need no display.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from priorfill.errors import OptionError
from priorfill.report.shown_text import MAX_LABEL, shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["COLOURS", "DPI", "check_plots", "default_style", "new_figure", "plain", "save_figures"]

COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#000000", "#999999")
"""Colour-blind safe colours: those of Okabe and Ito, without yellow, which is hard to see on white,
and with grey."""

DPI = 150
"""Pixels per inch of a picture."""

FONTS = (
    *("Noto Sans CJK JP", "Noto Sans CJK SC", "Source Han Sans", "Yu Gothic", "Microsoft YaHei"),
    *("Malgun Gothic", "Hiragino Sans", "PingFang SC", "Arial Unicode MS", "WenQuanYi Micro Hei"),
)
"""Fonts with letters of East Asia, for labels and file names; matplotlib's own font has none."""

LEFT_OUT: dict[str, dict[str, Any]] = {
    ".png": {"Software": None},
    ".svg": {"Date": None, "Creator": None},
    ".pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
"""Entries left out of files, so that equal figures give equal bytes."""


def check_plots() -> None:
    """Check that plots can be drawn.

    Raises
    ------
    OptionError
        Where matplotlib is not installed, or cannot be imported.
    """
    if find_spec("matplotlib") is None:
        raise OptionError(
            "plots need matplotlib, which is not installed; install it with: pip install matplotlib"
        )
    try:
        import_module("matplotlib.figure")
    except (ImportError, ValueError, RuntimeError, OSError) as error:  # also of wrong settings
        raise OptionError(
            f"plots need matplotlib, which cannot be imported ({shown(str(error), 200)}); "
            "check its installation and settings"
        ) from error


@contextmanager
def default_style() -> Iterator[None]:
    """Draw in matplotlib's own style, whatever the user's settings are.

    Colours are chosen for a white background, and a label is no TeX.
    """
    import matplotlib.style
    from matplotlib.font_manager import fontManager

    installed = set(fontManager.get_font_names())
    fonts = ["DejaVu Sans", *(name for name in FONTS if name in installed)]
    with matplotlib.style.context(["default", {"font.family": fonts, "svg.hashsalt": "priorfill"}]):
        yield


def new_figure(width: float, height: float) -> Figure:
    """Return a figure that is independent of a display, and shows itself in notebooks.

    Parameters
    ----------
    width, height : float
        Inches.
    """
    from priorfill.report.notebook_figure import NotebookFigure

    return NotebookFigure(figsize=(width, height), layout="constrained")


def plain(text: str, limit: int = MAX_LABEL) -> str:
    r"""Return a text in which matplotlib finds no formula, and no control characters.

    Parameters
    ----------
    text : str
        Of a file.
    limit : int
        Number of characters above which the middle is left out.

    Examples
    --------
    >>> print(plain("$x$"))
    \$x\$
    """
    return shown(text, limit).replace("$", r"\$")


def save_figures(figures: Iterable[Figure], path: Path) -> None:
    """Write figures to a file, with equal bytes for equal figures.

    Parameters
    ----------
    figures : iterable of Figure
        One; several become pages of a .pdf.
    path : Path
        The file; its suffix is ``.png``, ``.svg`` or ``.pdf``.
    """
    form = path.suffix.lower()
    with warnings.catch_warnings(), default_style():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        if form != ".pdf":
            (figure,) = figures
            figure.savefig(path, format=form[1:], dpi=DPI, metadata=LEFT_OUT[form])
            return
        from matplotlib.backends.backend_pdf import PdfPages

        with PdfPages(path, metadata=LEFT_OUT[form]) as pages:
            for figure in figures:
                figure.savefig(pages, format="pdf")
