"""Commands in help texts, messages and documents: what bash, zsh, cmd and PowerShell all take."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from priorfill.cli import main
from priorfill.runtime.display import shell_command

ROOT = Path(__file__).parents[2]

PAGES = sorted(
    path
    for path in (
        ROOT / "README.md",
        *(ROOT / "docs").glob("*.md"),
        *(ROOT / "database").rglob("*.md"),
    )
)

SINGLE_QUOTED = re.compile(r"(?<![\w`])'[^' ]*[*?][^' ]*'|(?<!\w)''(?!\w)")
"""A pattern in single quotes, which cmd passes on with the quotes, and an empty text in them."""

CONTINUED = "\\"
"""Ends a line that bash continues, but neither cmd nor PowerShell."""

FOR_ANY_SHELL = ("", "console", "text")
"""Languages of blocks that are not for one shell, as ``bash`` and ``powershell`` are."""


def commands(
    command: click.Command, name: str = "priorfill"
) -> Iterator[tuple[str, click.Command]]:
    yield name, command
    if isinstance(command, click.Group):
        context = click.Context(command)
        for one in command.list_commands(context):
            inner = command.get_command(context, one)
            assert inner is not None
            yield from commands(inner, f"{name} {one}")


@pytest.mark.parametrize("name_and_command", [*commands(main)], ids=lambda pair: pair[0])
def test_help(name_and_command: tuple[str, click.Command]) -> None:
    """ASCII, because every code page has it; double quotes, because every shell has them."""
    name, command = name_and_command
    text = command.get_help(click.Context(command, info_name=name))
    assert text.isascii()
    assert not SINGLE_QUOTED.findall(text)
    assert not [line for line in text.splitlines() if line.rstrip().endswith(CONTINUED)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_pages(page: Path) -> None:
    language: str | None = None
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        if line.startswith("```"):
            language = line[3:].strip() if language is None else None
            continue
        place = f"{page}:{number}: {line}"
        if language is None:  # outside of blocks, commands are in backquotes
            assert not any(map(SINGLE_QUOTED.search, re.findall(r"`([^`]+)`", line))), place
        elif language in FOR_ANY_SHELL and line.lstrip().startswith("priorfill "):
            assert "'" not in line.partition("  ")[0], place  # an explanation may follow
            assert not line.rstrip().endswith(CONTINUED), place


@pytest.mark.parametrize(
    "words",
    [
        ["priorfill", "inspect", r"C:\my data\walk.c3d"],
        ["a&b", "x y", "", r"C:\new folder" + "\\", r"C:\plain" + "\\", "50%", "Käthe", "a,b"],
    ],
)
def test_commands_of_messages_on_windows(words: list[str]) -> None:
    """Backslashes are as the C library of Windows reads them."""
    line = shell_command(words, windows=True)
    assert "'" not in line
    assert line.replace('"', "") == subprocess.list2cmdline(words).replace('"', "")
    assert line.count('"') == 2 * sum(not word or bool(set(word) & set(" &%,")) for word in words)


def test_commands_of_messages_elsewhere() -> None:
    assert shell_command(["priorfill", Path("my walk")], windows=False) == "priorfill 'my walk'"
