"""Messages of the library are in the words of Python; the command line has its options itself."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

from package_source import modules, relative, tree_of

OPTION = re.compile(r"(?<![\w-])--[a-z]")

WHOLE_COMMANDS = {"database/manifest.py", "filling/fill_file.py"}
"""Modules whose messages end with a command to paste, which has options."""


def texts(tree: ast.Module) -> Iterator[str]:
    """The texts of a module, docstrings excepted."""
    alone = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in alone:
            yield node.value


def test_no_message_names_an_option_of_the_command_line() -> None:
    found = {}
    for file in modules():
        name = relative(file)
        if not name.startswith(("cli/", "__main__")):
            named = [text for text in texts(tree_of(file)) if OPTION.search(text)]
            if named:
                found[name] = named
    # the texts of commands to paste are single words of a list
    for name in WHOLE_COMMANDS:
        assert all(" " not in text for text in found.pop(name))
    assert found == {}


def test_options_are_found() -> None:
    tree = ast.parse('"""--a"""\nx = f"give {y} (--rate)"')
    assert [text for text in texts(tree) if OPTION.search(text)] == [" (--rate)"]
