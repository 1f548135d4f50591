"""A progress bar in a notebook."""

from __future__ import annotations

import time
from collections.abc import Callable
from html import escape
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from priorfill.errors import escaped

__all__ = ["notebook_progress"]

INTERVAL_S = 0.1
"""s. Least time between two updates, each of which is a message to the browser."""


def notebook_progress(description: str = "filling") -> Callable[[int, int | None], None]:
    """Return a callback that shows a progress bar below the cell of a notebook.

    Parameters
    ----------
    description : str
        In front of the bar.

    Returns
    -------
    callable
        For ``FillOptions(progress=...)``; one for each fill. Outside a notebook it does nothing.

    See Also
    --------
    priorfill.FillOptions : Takes the callback.

    Examples
    --------
    >>> import priorfill as pf
    >>> from priorfill.synthetic.demo import make_demo_clip
    >>> options = pf.FillOptions(progress=pf.notebook_progress())
    >>> pf.fill(make_demo_clip()[1], method="linear", options=options).method
    'linear'
    """
    return _Bar(description)


class _Bar:
    """A bar that is drawn at its first call, and updated by later ones."""

    def __init__(self, description: str) -> None:
        self._description = description
        self._handle: Any = None
        self._total: int | None = None
        self._shown = float("-inf")
        self._display = _display()

    def __call__(self, done: int, total: int | None = None) -> None:
        if self._display is None:
            return
        self._total = self._total if total is None else total
        ended = self._total is not None and done >= self._total
        if not ended and time.monotonic() - self._shown < INTERVAL_S:
            return
        self._shown = time.monotonic()
        bundle = {"text/plain": self._line(done), "text/html": self._bar(done)}
        if self._handle is None:
            self._handle = self._display(bundle, raw=True, display_id=True)
        else:
            self._handle.update(bundle, raw=True)

    def _line(self, done: int) -> str:
        of = "" if self._total is None else f" of {self._total}"
        return f"{escaped(self._description)} {done}{of}"

    def _bar(self, done: int) -> str:
        length = "" if self._total is None else f' value="{done}" max="{self._total}"'
        return f"<progress{length}></progress> {escape(self._line(done))}"


def _display() -> Callable[..., Any] | None:
    """Return IPython's function that shows something below a cell; None outside a notebook."""
    if find_spec("IPython") is None:
        return None
    python = import_module("IPython")
    # a terminal's shell has no kernel, and would print a line for each update
    if getattr(python.get_ipython(), "kernel", None) is None:
        return None
    display: Callable[..., Any] = import_module("IPython.display").display
    return display
