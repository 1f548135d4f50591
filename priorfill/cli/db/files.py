"""Which files the arguments of a command stand for."""

from __future__ import annotations

import glob
from collections.abc import Callable, Sequence
from pathlib import Path

__all__ = ["find_files"]


def find_files(
    paths: Sequence[Path], suffixes: Sequence[str], recognised: Callable[[Path], bool]
) -> tuple[list[Path], list[str]]:
    """Return the files that arguments stand for, and what is wrong with the others.

    Parameters
    ----------
    paths : sequence of Path
        Files, folders (all that is in them and in their folders, but for hidden files), and shell
        patterns, for shells that do not expand them; ``**`` stands for folders of any depth.
    suffixes : sequence of str
        Lower-case suffixes of the files that are taken from folders.
    recognised : callable
        Tells which of those are recordings; for files that are named it is not asked.

    Returns
    -------
    files : list of Path
        Each once.
    failed : list of str
        A message for each argument that stands for nothing.
    """
    files: dict[Path, None] = {}
    failed = []
    for path in paths:
        found = [path] if path.exists() else _matches(path)
        if not found:
            failed.append(
                f"{path}: no file or folder fits this pattern; check it"
                if glob.has_magic(str(path))
                else f"{path}: there is no such file or folder; check the name"
            )
        for one in found:
            if not one.is_dir():
                files[one] = None
                continue
            inside = _inside(one, suffixes, recognised)
            if not inside:
                failed.append(f"{one}: has no files that can be read ({', '.join(suffixes)})")
            files |= dict.fromkeys(inside)
    return list(files), failed


def _matches(pattern: Path) -> list[Path]:
    # Path.glob takes no absolute patterns
    names = glob.glob(str(pattern), recursive=True)  # noqa: PTH207
    return [Path(name) for name in sorted(names)]


def _inside(
    folder: Path, suffixes: Sequence[str], recognised: Callable[[Path], bool]
) -> list[Path]:
    # hidden ones are other programs' notes (macOS puts ._walk.c3d beside walk.c3d) or unfinished
    return sorted(
        path
        for path in folder.rglob("*")
        if path.suffix.lower() in suffixes
        and not path.name.startswith(".")
        and path.is_file()
        and recognised(path)
    )
