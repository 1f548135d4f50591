"""Text is written alike on every system: UTF-8, whatever the code page, with the line ends given.

`open` and its relatives would else take the encoding and the line ends of the system.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator

import pytest
from package_source import modules, relative, tree_of

CALLS = {"open", "read_text", "write_text", "fdopen", "TextIOWrapper"}

DATABASES = {"target.open", "self.open"}
"""Calls in `priorfill.cli.db` that open a database."""


def text_calls(tree: ast.AST) -> Iterator[tuple[ast.Call, str]]:
    """Yield calls that open, read or write a file of text, with their mode."""
    for call in ast.walk(tree):
        if not isinstance(call, ast.Call):
            continue
        name = ast.unparse(call.func)
        if name.rpartition(".")[2] not in CALLS or name in DATABASES:
            continue
        first = 0 if name.endswith(".open") else 1
        given = call.args[first : first + 1]
        given += [word.value for word in call.keywords if word.arg == "mode"]
        modes = [one.value for one in given if isinstance(one, ast.Constant)]
        mode = str(modes[0]) if modes else "r"
        if "open" in name and ((given and not modes) or "b" in mode):
            continue
        yield call, "w" if name.endswith("write_text") else mode


def faults(tree: ast.AST) -> list[int]:
    """Return the lines of calls without encoding, or that write without line ends."""
    found = []
    for call, mode in text_calls(tree):
        words = {word.arg for word in call.keywords}
        if "encoding" not in words or (set(mode) & set("wax+") and "newline" not in words):
            found.append(call.lineno)
    return found


@pytest.mark.parametrize(
    "source",
    [
        "open(path)",
        "open(path, 'w', encoding='utf-8')",
        "path.open('a', newline='')",
        "path.read_text()",
        "path.write_text(text, encoding='utf-8')",
        "io.TextIOWrapper(file)",
    ],
)
def test_such_calls_are_found(source):
    assert faults(ast.parse(source)) == [1]


@pytest.mark.parametrize(
    "source",
    [
        "open(path, 'rb')",
        "path.open(mode='r+b', buffering=0)",
        "path.read_text(encoding='utf-8')",
        "path.open('w', encoding='utf-8', newline='')",
        "path.open(kind)",
    ],
)
def test_other_calls_are_not(source):
    assert faults(ast.parse(source)) == []


def test_the_package_states_encoding_and_line_ends():
    found = {
        f"{relative(module)}:{line}" for module in modules() for line in faults(tree_of(module))
    }
    assert found == set()
