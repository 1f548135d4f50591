"""Expand the arguments of a command to files."""

from __future__ import annotations

import glob
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from priorfill.formats.file_bytes import is_folder, is_there

__all__ = ["FoundFiles", "find_files"]


@dataclass(frozen=True)
class FoundFiles:
    """Files that the arguments of a command lead to.

    Attributes
    ----------
    files : list of Path
        Each once.
    missing : list of str
        A message for each argument that is no file, folder or pattern of some.
    failed : list of str
        A message for each folder without files that can be read, or that cannot be searched, and
        for each file that may be a recording and is not read.
    """

    files: list[Path]
    missing: list[str]
    failed: list[str]


def find_files(
    paths: Sequence[Path], suffixes: Sequence[str], recognised: Callable[[Path], bool]
) -> FoundFiles:
    """Return the files that arguments name, and a message for each path that leads to none.

    Parameters
    ----------
    paths : sequence of Path
        Files, folders (all files in them and in their subfolders, except hidden files and folders),
        and shell patterns, for shells that do not expand them; ``**`` matches folders of any depth.
    suffixes : sequence of str
        Lower-case suffixes of the files taken from folders.
    recognised : callable
        Returns whether a file in a folder is a recording; not called for files named explicitly.

    Returns
    -------
    FoundFiles
    """
    files: dict[Path, None] = {}
    missing, failed = [], []
    for path in paths:
        found = [path] if is_there(path) else _matches(path)
        if not found:
            missing.append(
                f"{path}: no file or folder matches this pattern; check it"
                if glob.has_magic(str(path))
                else f"{path}: there is no such file or folder; check the name"
            )
        for one in found:
            if not is_folder(one):
                files[one] = None
                continue
            closed: list[str] = []
            inside = sorted(_inside(one, suffixes, recognised, closed))
            failed += closed
            if not inside and not closed:
                failed.append(f"{one}: has no files that can be read ({', '.join(suffixes)})")
            files |= dict.fromkeys(inside)
    return FoundFiles(list(files), missing, failed)


def _matches(pattern: Path) -> list[Path]:
    # Path.glob takes no absolute patterns
    names = glob.glob(str(pattern), recursive=True)  # noqa: PTH207
    return [Path(name) for name in sorted(names)]


def _inside(
    folder: Path,
    suffixes: Sequence[str],
    recognised: Callable[[Path], bool],
    closed: list[str],
) -> Iterator[Path]:
    """Yield the files in a folder; add a message for what cannot be searched, or is not read."""

    def note(error: OSError) -> None:
        closed.append(
            f"{error.filename}: cannot be searched ({error.strerror}); check its permissions"
        )

    for here, folders, names in os.walk(folder, onerror=note):
        # hidden files are metadata (macOS writes ._walk.c3d next to walk.c3d) or unfinished
        folders[:] = [name for name in folders if not name.startswith(".")]
        for name in names:
            path = Path(here, name)
            if path.suffix.lower() not in suffixes or name.startswith("."):
                continue
            if _is_recording(path, recognised):
                yield path
            elif _is_unread(path):
                closed.append(
                    f"{path}: is a MATLAB file of version 7.3, which is not read; if it is a "
                    "recording, save it as version 7 (save ... -v7)"
                )


def _is_recording(path: Path, recognised: Callable[[Path], bool]) -> bool:
    try:
        return path.is_file() and recognised(path)
    except OSError:  # reading it reports the reason
        return True


def _is_unread(path: Path) -> bool:
    """Return whether a file may be a recording, but has a format whose contents are not read."""
    from priorfill.formats.arrays.mat import is_version_7_3  # loads NumPy

    return path.suffix.lower() == ".mat" and is_version_7_3(path)
