"""The page: one file of markup, style, scripts and data that needs no network.

A content security policy allows nothing but the scripts and the style of the page itself, by their
hashes. The scripts are deflated, and unpacked by a short one. What comes from files is JSON in an
element that no browser executes.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

__all__ = ["REPORT_FOLDER", "PageFiles", "content_policy", "page_json", "page_text", "report_page"]

FIRST_SCRIPTS = ("dom.js", "decode.js", "store.js")
"""Scripts that others are built on."""

LAST_SCRIPTS = ("keyboard.js", "main.js")
"""Scripts that use all others; only the last one does anything when the page is loaded."""

LOADER = "loader.js"
"""The script that unpacks all others, which take a third of the size when they are deflated."""

REPORT_FOLDER = Path(__file__).parent / "page"
"""Markup, style and scripts of the page of a report."""

_ESCAPED = re.compile("[<>&]")
"""What markup consists of. JSON in ASCII has escape sequences for everything else."""

_PLACES = re.compile(r"\{\{(csp|title|style|packed|script|data)\}\}")
"""Places of the template page.html."""


@dataclass(frozen=True)
class PageFiles:
    """The files that a kind of page is made of.

    Attributes
    ----------
    template : Path
        The markup, with places for the rest.
    sheets, scripts : tuple of Path
        Style and scripts, in their order.
    loader : Path
        The script that unpacks the others.
    """

    template: Path
    sheets: tuple[Path, ...]
    scripts: tuple[Path, ...]
    loader: Path = REPORT_FOLDER / LOADER


def page_text(
    data: Mapping[str, Any], files: PageFiles | None = None, *, connect: bool = False
) -> str:
    """Return the page with its data, as one HTML document.

    Parameters
    ----------
    data : mapping
        What the page shows; docs/report.md describes it.
    files : PageFiles, optional
        What the page is made of; those of a report if not given.
    connect : bool
        Whether the page may send requests to the server that it was loaded from.
    """
    files = files or report_page()
    template, style, loader, script = _parts(files)
    contents = {
        "csp": content_policy(files, connect=connect),
        "title": _as_markup(str(data["title"])),
        "style": style,
        "packed": base64.b64encode(zlib.compress(script.encode("utf-8"), 9)).decode("ascii"),
        "script": loader,
        "data": page_json(data),
    }
    return _PLACES.sub(lambda place: contents[place[1]], template)


def content_policy(files: PageFiles | None = None, *, connect: bool = False) -> str:
    """Return the content security policy of the page.

    Parameters
    ----------
    files : PageFiles, optional
        What the page is made of; those of a report if not given.
    connect : bool
        Whether the page may send requests to the server that it was loaded from.
    """
    _, style, loader, script = _parts(files or report_page())
    return "; ".join(
        (
            "default-src 'none'",
            f"script-src '{_hash(loader)}' '{_hash(script)}'",
            f"style-src '{_hash(style)}'",
            "img-src data: blob:",
            "connect-src 'self'" if connect else "connect-src 'none'",
            "base-uri 'none'",
            "form-action 'none'",
        )
    )


def page_json(data: Mapping[str, Any]) -> str:
    """Return data as JSON in ASCII without the characters of markup.

    Parameters
    ----------
    data : mapping
        Numbers, texts, lists and mappings; no number is infinite or NaN.
    """
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return _ESCAPED.sub(lambda one: f"\\u{ord(one[0]):04x}", text)


@lru_cache(maxsize=1)
def report_page() -> PageFiles:
    """Return what the page of a report is made of."""
    scripts = sorted(REPORT_FOLDER.glob("*.js"), key=lambda path: _place(path.name))
    sheets = sorted(REPORT_FOLDER.glob("*.css"), key=lambda path: (path.name != "page.css", path))
    return PageFiles(
        template=REPORT_FOLDER / "page.html",
        sheets=tuple(sheets),
        scripts=tuple(path for path in scripts if path.name != LOADER),
    )


@lru_cache(maxsize=2)
def _parts(files: PageFiles) -> tuple[str, str, str, str]:
    """Return the template, the style, the loader, and all other scripts in one."""
    scripts = "\n".join(map(_content, files.scripts))
    style = "\n".join(map(_content, files.sheets))
    return (
        _content(files.template),
        f"\n{style}",
        _scoped(_content(files.loader)),
        _scoped(scripts),
    )


def _scoped(script: str) -> str:
    """Return a script whose names are its own."""
    return f'\n"use strict";\n(() => {{\n{script}\n}})();\n'


def _place(name: str) -> tuple[int, str]:
    """Return by what the scripts are sorted."""
    if name in FIRST_SCRIPTS:
        return FIRST_SCRIPTS.index(name) - len(FIRST_SCRIPTS), name
    return (1 + LAST_SCRIPTS.index(name) if name in LAST_SCRIPTS else 0), name


def _content(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def _hash(text: str) -> str:
    digest = hashlib.sha256(text.encode("utf-8")).digest()
    return f"sha256-{base64.b64encode(digest).decode('ascii')}"


def _as_markup(text: str) -> str:
    """Return a text as the content of an element, in ASCII."""
    return "".join(
        one if " " <= one <= "~" and one not in "<>&\"'" else f"&#{ord(one)};" for one in text
    )
