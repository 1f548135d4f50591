"""Paths on the command line: what the shells of Windows leave to programs.

A shell of POSIX systems puts files in place of ``*.c3d`` and the user's folder in place of ``~``.
Those of Windows pass both on. click would expand every argument there, also patterns of labels
and clips, by the files that happen to be in the folder; so `priorfill.cli.main` turns that off, and
the parameters that are paths expand themselves.
"""

from __future__ import annotations

import ntpath
import os
import re
from collections.abc import Sequence
from glob import escape, glob
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.runtime.held_files import WINDOWS

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

__all__ = ["FILE", "FOLDER", "PathArgument", "expand_wildcards"]


_DRIVE_INSIDE = re.compile(r"[\\/][A-Za-z]:")
"""A drive behind a folder. pathlib drops the folder (Python 3.11) and means the drive."""


def expand_wildcards(texts: Sequence[str]) -> list[str]:
    r"""Return paths with ``*`` and ``?`` expanded as a POSIX shell does.

    Parameters
    ----------
    texts : sequence of str
        Arguments that are paths. ``**`` matches folders of any depth. Brackets stand for
        themselves, as names of files have them (``walk[1].c3d``).

    Returns
    -------
    list of str
        The matching files in alphabetical order in place of each pattern; what exists, has no
        wildcards or matches nothing, as it is. Files whose names begin with a dot are left out.
    """
    paths: list[str] = []
    for text in texts:
        text = _with_home(text)
        found = []
        # the drive of \\?\C:\walk.c3d has no wildcard
        if any(sign in os.path.splitdrive(text)[1] for sign in "*?") and not Path(text).exists():
            pattern = escape(text).replace("[*]", "*").replace("[?]", "?")
            found = sorted(glob(pattern, recursive=True))  # noqa: PTH207, Path.glob is relative
        paths += found or [text]
    return paths


def _with_home(text: str) -> str:
    """Return a path with the user's folder in place of ``~`` at its start, but not of ``~name``."""
    if text[:2] not in ("~", "~/", "~\\"):
        return text
    return os.path.expanduser(text)  # noqa: PTH111, which raises where there is no such folder


class _PathText(click.Path):
    """A path of a file or folder; on Windows, ``~`` is expanded.

    Parameters
    ----------
    completed_as : {"file", "dir"}
        What a shell completes.
    """

    def __init__(self, completed_as: str) -> None:
        # a file that cannot be read is reported where it is read, and costs only itself
        super().__init__(path_type=Path, readable=False)
        self._completed_as = completed_as

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return a Path; on Windows, refuse what the shell divided wrongly, or names two drives."""
        if WINDOWS and isinstance(value, str):
            if '"' in value:
                self.fail(
                    f"{value} has a quotation mark, as a backslash before the closing one makes "
                    "it part of the path; leave the last backslash out",
                    param,
                    ctx,
                )
            value = _with_home(value)
            if _DRIVE_INSIDE.search(ntpath.splitdrive(value)[1]):
                self.fail(
                    f"{value} has a drive behind a folder, where Windows allows no colon; "
                    "correct the path",
                    param,
                    ctx,
                )
        return super().convert(value, param, ctx)

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem[str]]:
        """Let the shell complete files or folders."""
        from click.shell_completion import CompletionItem

        return [CompletionItem(incomplete, type=self._completed_as)]


FILE = _PathText("file")
"""Path of a file, or of any kind."""

FOLDER = _PathText("dir")
"""Path of a folder."""


class PathArgument(click.Argument):
    """An argument of one or several paths; on Windows, wildcards are expanded."""

    def type_cast_value(self, ctx: click.Context, value: Any) -> Any:
        """Expand wildcards, then convert as usual."""
        if WINDOWS and value:
            many = self.nargs != 1
            paths = expand_wildcards(value if many else [value])
            if not many and len(paths) > 1:
                raise click.BadParameter(
                    f"{value} matches {len(paths)} files; name one", ctx=ctx, param=self
                )
            value = tuple(paths) if many else paths[0]
        return super().type_cast_value(ctx, value)
