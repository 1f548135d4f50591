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
from functools import lru_cache
from pathlib import Path
from typing import Any

__all__ = ["content_policy", "page_json", "page_text"]

FIRST_SCRIPTS = ("dom.js", "decode.js", "store.js")
"""Scripts that others are built on."""

LAST_SCRIPTS = ("keyboard.js", "main.js")
"""Scripts that use all others; only the last one does anything when the page is loaded."""

LOADER = "loader.js"
"""The script that unpacks all others, which take a third of the size when they are deflated."""

_FOLDER = Path(__file__).parent / "page"

_ESCAPED = re.compile("[<>&]")
"""What markup consists of. JSON in ASCII has escape sequences for everything else."""

_PLACES = re.compile(r"\{\{(csp|title|style|packed|script|data)\}\}")
"""Places of the template page.html."""


def page_text(data: Mapping[str, Any], *, connect: bool = False) -> str:
    """Return the page with its data, as one HTML document.

    Parameters
    ----------
    data : mapping
        What the page shows; docs/report.md describes it.
    connect : bool
        Whether the page may send requests to the server that it was loaded from.
    """
    template, style, loader, script = _parts()
    contents = {
        "csp": content_policy(connect=connect),
        "title": _as_markup(str(data["title"])),
        "style": style,
        "packed": base64.b64encode(zlib.compress(script.encode("utf-8"), 9)).decode("ascii"),
        "script": loader,
        "data": page_json(data),
    }
    return _PLACES.sub(lambda place: contents[place[1]], template)


def content_policy(*, connect: bool = False) -> str:
    """Return the content security policy of the page.

    Parameters
    ----------
    connect : bool
        Whether the page may send requests to the server that it was loaded from.
    """
    _, style, loader, script = _parts()
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
def _parts() -> tuple[str, str, str, str]:
    """Return the template, the style, the loader, and all other scripts in one."""
    names = sorted((path.name for path in _FOLDER.glob("*.js")), key=_place)
    scripts = "\n".join(_content(name) for name in names if name != LOADER)
    sheets = sorted(path.name for path in _FOLDER.glob("*.css"))
    style = "\n".join(
        _content(name) for name in sorted(sheets, key=lambda name: name != "page.css")
    )
    return _content("page.html"), f"\n{style}", _scoped(_content(LOADER)), _scoped(scripts)


def _scoped(script: str) -> str:
    """Return a script whose names are its own."""
    return f'\n"use strict";\n(() => {{\n{script}\n}})();\n'


def _place(name: str) -> tuple[int, str]:
    """Return by what the scripts are sorted."""
    if name in FIRST_SCRIPTS:
        return FIRST_SCRIPTS.index(name) - len(FIRST_SCRIPTS), name
    return (1 + LAST_SCRIPTS.index(name) if name in LAST_SCRIPTS else 0), name


def _content(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    digest = hashlib.sha256(text.encode("utf-8")).digest()
    return f"sha256-{base64.b64encode(digest).decode('ascii')}"


def _as_markup(text: str) -> str:
    """Return a text as the content of an element, in ASCII."""
    return "".join(
        one if " " <= one <= "~" and one not in "<>&\"'" else f"&#{ord(one)};" for one in text
    )
