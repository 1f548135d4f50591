"""The page of a result in a notebook: in a frame that can do nothing but show it."""

from __future__ import annotations

from html import escape
from pathlib import Path

from priorfill.errors import OptionError
from priorfill.runtime.atomic_file import replace_file

__all__ = ["NotebookPage"]

LARGE_MB = 5.0
"""MB. A notebook stores what it shows; from this size on it becomes slow to open and save."""

MIN_HEIGHT, MAX_HEIGHT = 200, 5000
"""Pixels."""


class NotebookPage:
    """The page of a result, which a notebook shows where it is the last value of a cell.

    The page runs in a frame without access to the notebook or to a network; it may offer a file of
    decisions for download.

    Parameters
    ----------
    name : str
        Name of the clip.
    page : str
        The page.
    height : int
        Height of the frame (pixels).
    """

    def __init__(self, name: str, page: str, height: int) -> None:
        if not MIN_HEIGHT <= height <= MAX_HEIGHT:
            raise OptionError(
                f"a frame cannot be {height} pixels high; give {MIN_HEIGHT} to {MAX_HEIGHT} "
                "(`height`)"
            )
        self.name, self.page, self.height = name, page, height

    @property
    def megabytes(self) -> float:
        """Size of the page."""
        return len(self.page) / 1e6

    def save(self, path: Path | str, *, overwrite: bool = False) -> None:
        """Write the page to a file that opens in a browser.

        Parameters
        ----------
        path : Path or str
            The file, ``.html``.
        overwrite : bool
            Replace an existing file.

        Raises
        ------
        OutputError
            If the file exists already or cannot be written.
        """
        with replace_file(path, overwrite=overwrite) as temporary:
            temporary.write_bytes(self.page.encode("utf-8"))

    def __repr__(self) -> str:
        return (
            f"<page of {self.name}, {self.megabytes:.1f} MB; notebooks show it, "
            '.save("FILE.html") writes it>'
        )

    def _repr_html_(self) -> str:
        """Return a frame with the page, below a warning where the page is large."""
        warning = (
            f"<p>This page makes the notebook {self.megabytes:.0f} MB larger; "
            "<code>.save(&quot;FILE.html&quot;)</code> writes it to a file instead.</p>"
        )
        return (warning if self.megabytes > LARGE_MB else "") + (
            f'<iframe title="priorfill" sandbox="allow-scripts allow-downloads" width="100%" '
            f'height="{self.height}" srcdoc="{escape(self.page)}"></iframe>'
        )
