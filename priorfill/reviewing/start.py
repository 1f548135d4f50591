"""``pf.review``: fill a file, serve its page on this computer, open the browser, wait."""

from __future__ import annotations

import os
import sys
import threading
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from priorfill.errors import OptionError
from priorfill.filling.fill_options import FillOptions
from priorfill.reviewing.session import ReviewSession, SavedReview
from priorfill.runtime.field_types import check_field_types

__all__ = ["ReviewOptions", "review"]

MAX_PORT = 65535


@dataclass(frozen=True)
class ReviewOptions:
    """How a review is shown.

    Attributes
    ----------
    port : int
        Port on this computer (127.0.0.1); 0: any free one.
    browser : bool
        Open the page in the browser.
    started : callable, optional
        Called with the address of the page when it can be opened, and whether the browser is being
        opened.
    words : callable
        Replaces arguments in backquotes in messages on the page.
    command : tuple of str
        Words of the command that repeats the fill, without decisions and output; the page shows
        them.

    Raises
    ------
    OptionError
        Where there is no such port.

    See Also
    --------
    priorfill.review : Review the fill of a file.

    Examples
    --------
    >>> ReviewOptions(browser=False).port
    0
    """

    port: int = 0
    browser: bool = True
    started: Callable[[str, bool], None] | None = None
    words: Callable[[str], str] = str
    command: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the types and the port."""
        check_field_types(self)
        if not 0 <= self.port <= MAX_PORT:
            raise OptionError(f"`port` is {self.port}; it must be 0 to {MAX_PORT}")


def review(
    source: Path | str,
    output: Path | str | None = None,
    *,
    page: ReviewOptions | None = None,
    **arguments: Any,
) -> SavedReview | None:
    """Fill a file, and show it in the browser, where fills are accepted, refused or repeated.

    The page is served on this computer only, at an address that nobody can guess. The function
    returns when the review is ended on the page, or by an interrupt (Ctrl-C).

    Parameters
    ----------
    source : Path or str
        The file with gaps; it is not changed.
    output : Path or str, optional
        The file to save; by default ``walk_filled.c3d`` next to ``walk.c3d``. The decisions are
        saved next to it, as ``walk_filled.overrides.toml``; ``fill`` with them repeats the result
        exactly.
    page : ReviewOptions, optional
        How the page is shown.
    **arguments
        The arguments of `priorfill.fill_file`. ``overrides`` is the path of the file for the
        decisions; the review begins with those that it has.

    Returns
    -------
    SavedReview or None
        What was saved last; None if nothing was.

    Raises
    ------
    PriorfillError
        As `priorfill.fill_file` does; and where the extra ``review`` is not installed, or the port
        is in use.

    See Also
    --------
    priorfill.fill_file : Fill without a review.
    priorfill.write_report : Write a page that needs no server.

    Examples
    --------
    >>> import priorfill as pf
    >>> pf.review("walk.c3d", database="lab-priors")  # doctest: +SKIP
    """
    from priorfill.reviewing.server import ReviewServer

    page = page or ReviewOptions()
    session = ReviewSession(source, output, **arguments)
    session.command = page.command
    options = arguments.get("options") or FillOptions()
    server = ReviewServer(session, page.port, page.words)
    try:
        session.fill(session.decisions, options.progress)
        server.start()
        opens = page.browser and _has_browser()
        if opens:
            _open(server.link)
        if page.started is not None:
            page.started(server.address, opens)
        server.wait()
    except KeyboardInterrupt as interrupt:
        if type(interrupt) is not KeyboardInterrupt or not session.data:
            raise  # a request of the system to end, or a fill that nobody has seen
    finally:
        server.stop()
    return session.saved


def _has_browser() -> bool:
    """Return whether a browser with windows can be opened; those of terminals run no scripts."""
    if sys.platform in ("win32", "darwin") or os.environ.get("BROWSER"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _open(link: str) -> None:
    """Open the browser, which may take its time."""
    thread = threading.Thread(target=webbrowser.open, args=(link,), daemon=True)
    thread.start()
