"""What the Tab key completes: methods, protocols, marker sets, data sets, clips, subjects.

click has the protocol between a shell and the program. Each function here receives what click
passes to ``shell_complete=``, loads no numpy, and returns nothing where something is wrong: an
error message would end up on the user's command line.
"""

from __future__ import annotations

import os
import re
import shlex
import sqlite3
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import closing, suppress
from pathlib import Path
from urllib.parse import quote

import click
from click.shell_completion import CompletionItem, PowerShellComplete, add_completion_class

__all__ = [
    "GROUPS",
    "PROTOCOLS",
    "complete_clips",
    "complete_datasets",
    "complete_groups",
    "complete_marker_sets",
    "complete_methods",
    "complete_protocols",
    "complete_sessions",
    "complete_subjects",
    "register_shells",
]

Completion = Callable[[click.Context, click.Parameter, str], list[CompletionItem[str]]]

PROTOCOLS = ("random", "markers", "groups", "periodic", "frames", "like")
"""Those of `priorfill.evaluation.protocols`, which loads numpy."""

GROUPS = ("arms", "legs", "both", "left_arm", "right_arm", "left_leg", "right_leg")
"""Those of the protocol ``groups``."""

_CATALOGUE = re.compile(r"catalogue(?:-([0-9]{1,9}))?\.sqlite")
"""Catalogues of a database; the highest number is the newest."""

_PLAIN = re.compile(r"[\w.+][\w.+-]*")
"""Names that every shell takes without quotes."""

_ID_DIGITS = 8
"""Digits of a clip's id, as `priorfill db list` shows it."""

_BUSY_S = 0.1
"""Longest wait for a database that is being written (s)."""


def _quietly(names: Callable[[click.Context], Iterable[tuple[str, str]]]) -> Completion:
    """Return a completion of names, given with a help text, of a list with commas."""

    def complete(
        ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem[str]]:
        done, comma, begun = incomplete.rpartition(",")
        with suppress(Exception):
            return [
                CompletionItem(f"{done}{comma}{name}", help=text or None)
                for name, text in names(ctx)
                if name.startswith(begun)
            ]
        return []

    return complete


def _methods(ctx: click.Context) -> Iterable[tuple[str, str]]:
    from priorfill.methods import METHODS

    general = {"evaluate": [("all", "all methods")], "methods": []}
    yield from general.get(ctx.info_name or "", [("auto", "the default method")])
    for name, entry in METHODS.items():
        yield name, entry.summary


def _marker_sets(ctx: click.Context) -> Iterable[tuple[str, str]]:
    from priorfill.markers.definitions import available

    return [(name, one.title) for name, one in available().items()]


def _datasets(ctx: click.Context) -> Iterable[tuple[str, str]]:
    from priorfill.datasets.dataset_definitions import known_datasets

    return [(one.name, one.title) for one in known_datasets()]


complete_methods = _quietly(_methods)
complete_datasets = _quietly(_datasets)
complete_protocols = _quietly(lambda ctx: [(name, "") for name in PROTOCOLS])
complete_groups = _quietly(lambda ctx: [(name, "") for name in GROUPS])
_complete_names_of_sets = _quietly(_marker_sets)


def complete_marker_sets(
    ctx: click.Context, param: click.Parameter, incomplete: str
) -> list[CompletionItem[str]]:
    """Complete marker sets, or the file of a definition where none begins like this."""
    names = _complete_names_of_sets(ctx, param, incomplete)
    return names or [CompletionItem(incomplete, type="file")]


def _column(name: str) -> Completion:
    """Return a completion of the subjects or sessions of the command's database."""

    def values(ctx: click.Context) -> Iterable[tuple[str, str]]:
        for (text,) in _query(ctx, f"SELECT DISTINCT {name} FROM clips"):
            if _PLAIN.fullmatch(text):
                yield text, ""

    return _quietly(values)


complete_subjects = _column("subject")
complete_sessions = _column("session")


def complete_clips(
    ctx: click.Context, param: click.Parameter, incomplete: str
) -> list[CompletionItem[str]]:
    """Complete the clips of the command's database.

    A clip is completed to its id if its name needs quotes, or several have it.

    Parameters
    ----------
    ctx : click.Context
        Has the database among its parameters.
    param : click.Parameter
        The argument or option.
    incomplete : str
        The beginning of a name.
    """
    with suppress(Exception):
        found = [
            (name, content[:_ID_DIGITS], subject)
            for name, content, subject in _query(ctx, "SELECT name, content, subject FROM clips")
            if name.startswith(incomplete)
        ]
        uses = Counter(name for name, _, _ in found)
        return [
            CompletionItem(name, help=subject or None)
            if _PLAIN.fullmatch(name) and uses[name] == 1
            else CompletionItem(identity, help=" ".join(f"{name} {subject}".split()))
            for name, identity, subject in found
        ]
    return []


def _query(ctx: click.Context, select: str) -> list[tuple[str, ...]]:
    """Return rows of the catalogue of the database that a command line names."""
    folder = ctx.params.get("folder") or ctx.params.get("database")
    if not isinstance(folder, Path):
        return []
    numbers = {
        int(found[1] or 1): path
        for path in folder.expanduser().iterdir()  # the shell passes on what was typed
        if (found := _CATALOGUE.fullmatch(path.name))
    }
    newest = numbers[max(numbers)].resolve()
    # encoded, as `priorfill.database.sqlite_address` explains; that package loads numpy
    address = f"file:{quote(str(newest), safe='')}?mode=ro"
    with closing(sqlite3.connect(address, uri=True, timeout=_BUSY_S)) as connection:
        return connection.execute(f"{select} WHERE removed_in IS NULL ORDER BY 1").fetchall()


_CALL = "    try {\n        $response ="
_CALL_IN_UTF_8 = """\
    $prev_encoding = [Console]::OutputEncoding
    try { [Console]::OutputEncoding = [System.Text.Encoding]::UTF8 } catch { }
    try {
        $response ="""
_RESTORE = "    } finally {\n"
_RESTORE_ENCODING = (
    f"{_RESTORE}        try {{ [Console]::OutputEncoding = $prev_encoding }} catch {{ }}\n"
)
"""In click's script for PowerShell, which reads the names that click prints in UTF-8 by the code
page of the console; without a console, its encoding cannot be set."""


class _PowerShell(PowerShellComplete):
    r"""Completion in PowerShell, where a backslash is a part of a path, no escape.

    Paths are left to PowerShell, which completes them where a program names nothing, with the
    quotes that they need; click's script would insert them without.
    """

    source_template = PowerShellComplete.source_template.replace(_CALL, _CALL_IN_UTF_8).replace(
        _RESTORE, _RESTORE_ENCODING
    )

    def get_completions(self, args: list[str], incomplete: str) -> list[CompletionItem[str]]:
        """Return the completions that are no paths."""
        found = super().get_completions(args, incomplete)
        return [item for item in found if item.type == "plain"]

    def get_completion_args(self) -> tuple[list[str], str]:
        """Return the arguments before the one to be completed, and what there is of it."""
        lexer = shlex.shlex(os.environ["COMP_WORDS"], posix=True)
        lexer.whitespace_split = True
        lexer.commenters = lexer.escape = ""
        words: list[str] = []
        try:
            words += lexer
        except ValueError:  # a quotation that is not closed yet
            words.append(lexer.token)
        number = int(os.environ["COMP_CWORD"])
        return words[1:number], words[number] if number < len(words) else ""


def register_shells() -> None:
    """Make click use what is specific to priorfill."""
    add_completion_class(_PowerShell)
