"""A browser for tests of pages: Chromium, which Playwright drives without a network."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

__all__ = ["PageOpener", "chromium", "find_chromium", "wait_until"]

NAMES = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "C:/Program Files/Google/Chrome/Application/chrome.exe",
)
"""Programs looked for where ``PRIORFILL_CHROMIUM`` names none."""

ARGUMENTS = (
    "--no-sandbox",  # there is none for root, the user of containers
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
)

LAPTOP = (1366, 768)
"""Size of a window (pixels)."""


def find_chromium() -> str | None:
    """Return the path of the system's Chromium."""
    given = os.environ.get("PRIORFILL_CHROMIUM")
    return given or next(filter(None, map(shutil.which, NAMES)), None)


def wait_until(page: Any, expression: str, seconds: float = 15.0) -> None:
    """Wait until an expression in JavaScript is true.

    ``page.wait_for_function`` needs ``eval``, which pages with a content security policy lack.
    """
    end = time.monotonic() + seconds
    while not page.evaluate(f"!!({expression})"):
        assert time.monotonic() < end, f"not within {seconds} s: {expression}"
        page.wait_for_timeout(20)


@contextmanager
def chromium() -> Iterator[Any]:
    """Start Chromium; the test is skipped where it is not installed."""
    playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    path = find_chromium()
    if path is None:
        pytest.skip("no Chromium: install it, or let PRIORFILL_CHROMIUM name it")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=list(ARGUMENTS))
        try:
            yield browser
        finally:
            browser.close()


class PageOpener:
    """Opens pages, and notes what a page must not do.

    Parameters
    ----------
    browser : Browser
        Playwright's browser.
    kept : list, optional
        The page of a window that several openers use one after the other, empty at first: to load
        a file into it takes a third of the time of a window of its own.

    Attributes
    ----------
    faults : list of str
        Messages on the console, errors of scripts, and requests to other places than the page.
    """

    def __init__(self, browser: Any, kept: list[Any] | None = None) -> None:
        self._browser = browser
        self._kept = kept
        self._contexts: list[Any] = []
        self._borrowed: Any = None
        self._listeners: dict[str, Callable[[Any], None]] = {}
        self.faults: list[str] = []

    def __call__(
        self,
        address: Path | str,
        *,
        size: tuple[int, int] = LAPTOP,
        dark: bool = False,
        ready: str | None = None,
        own: bool = False,
        **context: Any,
    ) -> Any:
        """Open a file, without a network, or an address of this computer.

        Parameters
        ----------
        address : Path or str
            The page.
        size : tuple of int
            Width and height of the window (pixels).
        dark : bool
            Whether the user prefers dark pages.
        ready : str, optional
            Expression in JavaScript to wait for.
        own : bool
            Whether the page has a window that no other opener uses: what a test does to it would
            outlast the page. Windows of other kinds than the usual one are never shared.
        **context
            More arguments of ``new_context``.
        """
        local = isinstance(address, Path)
        url = Path(address).resolve().as_uri() if local else str(address)
        usual = local and size == LAPTOP and not dark and not context
        kept = self._kept if usual and not own and self._borrowed is None else None
        if kept:
            page = kept[0]
        else:
            made = self._browser.new_context(
                viewport={"width": size[0], "height": size[1]},
                color_scheme="dark" if dark else "light",
                offline=local,
                accept_downloads=True,
                **context,
            )
            page = made.new_page()
            page.set_default_timeout(15_000)
            if kept is None:
                self._contexts.append(made)
            else:
                kept.append(page)
        listeners = {
            "console": lambda message: self.faults.append(f"console: {message.text}"),
            "pageerror": lambda error: self.faults.append(f"error: {error}"),
            "request": lambda request: self._note_request(url, request.url),
        }
        for event, listener in listeners.items():
            page.on(event, listener)
        if kept:
            self._borrowed, self._listeners = page, listeners
        page.goto(url)
        if page.locator("#priorfill-data").count():  # packed scripts run after the page is loaded
            wait_until(page, "window.priorfill || !document.getElementById('problem').hidden")
        if ready is not None:
            wait_until(page, ready)
        return page

    def close(self) -> None:
        """Close all pages."""
        for context in self._contexts:
            context.close()
        if self._borrowed is not None:
            self._give_back(self._borrowed)

    def _give_back(self, page: Any) -> None:
        """Leave the kept page as it was made, or close it if it does not answer."""
        for event, listener in self._listeners.items():
            page.remove_listener(event, listener)
        self._borrowed = None
        try:
            page.goto("about:blank")
            page.set_viewport_size({"width": LAPTOP[0], "height": LAPTOP[1]})
            page.mouse.up()
            page.mouse.move(0, 0)
            page.keyboard.up("Shift")  # a failed test may have left it down
        except Exception:  # of any kind: it has crashed, or runs for ever
            if self._kept is not None:
                self._kept.clear()
            page.context.close()

    def expect_no_faults(self, allowed: Sequence[str] = ()) -> None:
        """Fail if a page did what it must not.

        Parameters
        ----------
        allowed : sequence of str
            Texts; faults with one of them are expected.
        """
        faults = [fault for fault in self.faults if not any(text in fault for text in allowed)]
        assert not faults, faults

    def _note_request(self, own: str, requested: str) -> None:
        one, other = urlsplit(own), urlsplit(requested)
        if other.scheme in ("data", "blob"):
            return
        same = (one.scheme, one.netloc) == (other.scheme, other.netloc)
        if not same or (one.scheme == "file" and one.path != other.path):
            self.faults.append(f"request: {requested}")
