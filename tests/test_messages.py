"""Messages of the library are in the words of Python; the command line has its options itself."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import priorfill

ROOT = Path(priorfill.__file__).parent

OPTION = re.compile(r"(?<![\w-])--[a-z]")

WHOLE_COMMANDS = {"database/manifest.py", "filling/fill_file.py"}
"""Modules whose messages end with a command to paste, which has options."""


def texts(source: str) -> Iterator[str]:
    """The texts of a module, docstrings excepted."""
    tree = ast.parse(source)
    alone = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in alone:
            yield node.value


def test_no_message_names_an_option_of_the_command_line() -> None:
    found = {}
    for file in sorted(ROOT.rglob("*.py")):
        name = file.relative_to(ROOT).as_posix()
        if not name.startswith(("cli/", "__main__")):
            named = [
                text for text in texts(file.read_text(encoding="utf-8")) if OPTION.search(text)
            ]
            if named:
                found[name] = named
    # the texts of commands to paste are single words of a list
    for name in WHOLE_COMMANDS:
        assert all(" " not in text for text in found.pop(name))
    assert found == {}


def test_options_are_found() -> None:
    assert [t for t in texts('"""--a"""\nx = f"give {y} (--rate)"') if OPTION.search(t)] == [
        " (--rate)"
    ]
