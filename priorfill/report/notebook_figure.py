"""A figure of matplotlib that notebooks show although pyplot does not know it."""

from __future__ import annotations

from io import BytesIO

from matplotlib.figure import Figure

__all__ = ["NotebookFigure"]


class NotebookFigure(Figure):
    """A figure that is shown where it is the last value of a notebook's cell."""

    def _repr_png_(self) -> bytes:
        """Return the figure as a picture, as Jupyter asks for it."""
        picture = BytesIO()
        self.savefig(picture, format="png")
        return picture.getvalue()
