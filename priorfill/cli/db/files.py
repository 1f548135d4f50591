"""Expand the arguments of a command to files."""

from __future__ import annotations

import glob
from collections.abc import Callable, Sequence
from pathlib import Path

__all__ = ["find_files"]


def find_files(
    paths: Sequence[Path], suffixes: Sequence[str], recognised: Callable[[Path], bool]
) -> tuple[list[Path], list[str]]:
    """Return the files that arguments name, and a message for each that names none.

    Parameters
    ----------
    paths : sequence of Path
        Files, folders (all files in them and in their subfolders, except hidden ones), and shell
        patterns, for shells that do not expand them; ``**`` matches folders of any depth.
    suffixes : sequence of str
        Lower-case suffixes of the files taken from folders.
    recognised : callable
        Returns whether a file in a folder is a recording; not called for files named explicitly.

    Returns
    -------
    files : list of Path
        Each once.
    failed : list of str
        The messages.
    """
    files: dict[Path, None] = {}
    failed = []
    for path in paths:
        found = [path] if path.exists() else _matches(path)
        if not found:
            failed.append(
                f"{path}: no file or folder matches this pattern; check it"
                if glob.has_magic(str(path))
                else f"{path}: no such file or folder; check the name"
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
    # hidden files are metadata (macOS writes ._walk.c3d next to walk.c3d) or unfinished
    return sorted(
        path
        for path in folder.rglob("*")
        if path.suffix.lower() in suffixes
        and not path.name.startswith(".")
        and _is_recording(path, recognised)
    )


def _is_recording(path: Path, recognised: Callable[[Path], bool]) -> bool:
    try:
        return path.is_file() and recognised(path)
    except OSError:  # reading it reports the reason
        return True
