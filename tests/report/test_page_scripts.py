"""Rules of the scripts of the page: text only as text, no network, small functions."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from priorfill.report.page import REPORT_FOLDER
from priorfill.study.summary.as_page import SHARED_SCRIPTS, STUDY_FOLDER, STUDY_SCRIPTS

REPORT = sorted(REPORT_FOLDER.glob("*.js"))
STUDY = [*(REPORT_FOLDER / name for name in SHARED_SCRIPTS), *sorted(STUDY_FOLDER.glob("*.js"))]
SCRIPTS = list(dict.fromkeys(REPORT + STUDY))

MARKUP = re.compile(
    r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|createContextualFragment"
    r"|DOMParser|setHTML|srcdoc|\beval\(|new Function|setTimeout\(\s*[\"'`]"
)
"""Ways in which text would become markup or a script."""

STYLE_ATTRIBUTE = re.compile(r"setAttribute\(\s*[\"']style|\bstyle: [\"'`]|\bon[a-z]+: [\"'`]")
"""Attributes that the content security policy refuses."""

CONSOLE = re.compile(r"\bconsole\.|\balert\(|\bprompt\(|\bdebugger\b")

NETWORK = re.compile(r"\bfetch\(|XMLHttpRequest|WebSocket|EventSource|sendBeacon|importScripts")

SERVER_LINK = "server_link.js"
"""The only script that sends requests, in a review."""

DECLARED = re.compile(r"^(?:async )?(?:const|let|class|function)\s+(\w+)", re.MULTILINE)


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_scripts_keep_the_rules(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    for rule in (MARKUP, STYLE_ATTRIBUTE, CONSOLE):
        assert rule.findall(text) == []
    if path.name != SERVER_LINK:
        assert NETWORK.findall(text) == []
    assert "</script" not in text.lower() and "<!--" not in text
    lines = text.splitlines()
    assert len(lines) <= 350
    assert [line for line in lines if len(line) > 100] == []
    # functions begin with a line that ends with {, and end with } at the same indentation
    for number, line in enumerate(lines):
        begins = re.match(r"( {0,2})(?:async )?[\w#]*(?: ?\w+)?\(.*\{$", line)
        if begins is None:
            continue
        end = next(
            n for n, later in enumerate(lines[number:]) if later.startswith(f"{begins[1]}}}")
        )
        assert end <= 61, f"line {number + 1}: {end - 1} lines"


@pytest.mark.parametrize("scripts", [REPORT, STUDY], ids=["report", "study"])
def test_names_are_declared_once(scripts: list[Path]) -> None:
    # all scripts of a page share one scope
    names = [name for path in scripts for name in DECLARED.findall(path.read_text("utf-8"))]
    assert sorted(name for name in set(names) if names.count(name) > 1) == []


def test_a_summary_has_all_its_scripts() -> None:
    assert sorted(STUDY_SCRIPTS) == sorted(path.name for path in STUDY_FOLDER.glob("*.js"))


@pytest.mark.parametrize("page", [REPORT_FOLDER / "page.html", STUDY_FOLDER / "study.html"])
def test_markup_has_no_handlers_and_no_addresses(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert re.findall(r"\son\w+=|\sstyle=|https?://|\ssrc=", text) == []
    sheets = "".join(path.read_text(encoding="utf-8") for path in page.parent.glob("*.css"))
    assert re.findall(r"url\(|@import", sheets) == []
