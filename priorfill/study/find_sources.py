"""Find the recordings of a study below folders, and name them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from priorfill.database.manifest import MANIFEST
from priorfill.errors import OptionError
from priorfill.formats import SUFFIXES, is_recording
from priorfill.formats.bids.names import DESCRIPTION, dataset_root
from priorfill.formats.file_bytes import is_folder, is_there
from priorfill.study.study_folder import MARK, STATE

__all__ = ["FoundSources", "StudySource", "find_sources"]

_NOT_RAW = ("code", "derivatives", "sourcedata", "stimuli")
"""Folders of a BIDS dataset that hold other data than its recordings."""


@dataclass(frozen=True)
class StudySource:
    """A recording of a study.

    Attributes
    ----------
    name : str
        Path below the folder that all paths have in common, with ``/``.
    path : Path
        The file, absolute.
    """

    name: str
    path: Path


@dataclass(frozen=True)
class FoundSources:
    """The recordings of a study.

    Attributes
    ----------
    sources : tuple of StudySource
        Sorted by name.
    problems : tuple of str
        A line for each path that leads to no recording.
    notes : tuple of str
        A line for each folder that was left out.
    """

    sources: tuple[StudySource, ...]
    problems: tuple[str, ...]
    notes: tuple[str, ...]


def find_sources(paths: Sequence[Path | str], output: Path) -> FoundSources:
    """Find the recordings that paths lead to.

    Folders are searched with all folders in them, also through links. Hidden files and folders,
    prior databases, and the outputs of studies are left out.

    Parameters
    ----------
    paths : sequence of Path or str
        Files and folders.
    output : Path
        The folder of outputs.

    Raises
    ------
    OptionError
        If a path is the folder of outputs, or the paths have no folder in common.
    """
    found: dict[Path, None] = {}
    problems: list[str] = []
    notes: list[str] = []
    given = [Path(os.path.abspath(path)) for path in paths]  # noqa: PTH100, does not resolve links
    for path in given:
        if not is_there(path):
            problems.append(f"{path}: there is no such file or folder; check the name")
        elif not is_folder(path):
            found[path] = None
        elif output.exists() and path.samefile(output):
            raise OptionError(
                f"{path}: is the folder for the filled files, too; give another one (`output`)"
            )
        else:
            known = len(notes)
            inside = list(_below(path, output, notes))
            found |= dict.fromkeys(inside)
            if not inside:
                problems.append(f"{path}: has no recordings ({', '.join(SUFFIXES)})")
                problems += notes[known:]
    top = _common_folder(given)
    sources = (StudySource(path.relative_to(top).as_posix(), path) for path in found)
    ordered = sorted(sources, key=lambda one: one.name)
    return FoundSources(tuple(ordered), tuple(problems), tuple(notes))


def _common_folder(paths: Sequence[Path]) -> Path:
    """Return the folder that all paths have in common; in a BIDS dataset its root."""
    folders = [path if is_folder(path) else path.parent for path in paths]
    try:
        folder = Path(os.path.commonpath(folders))
        return dataset_root(folder) or folder
    except ValueError:
        raise OptionError(
            "the paths are on several drives and have no folder in common; fill each drive by "
            "itself, into a folder of its own"
        ) from None


def _below(folder: Path, output: Path, notes: list[str]) -> Iterator[Path]:
    """Yield the recordings below a folder; each folder is searched once."""
    seen: set[tuple[int, int]] = set()
    note = _note_to(notes)
    for here, folders, files in os.walk(folder, followlinks=True, onerror=note):
        place = Path(here)
        try:
            status = place.stat()
            known = (status.st_dev, status.st_ino) in seen and status.st_ino != 0
            seen.add((status.st_dev, status.st_ino))
            # a folder that is given is meant, such as that of filled files for a second pass
            left_out = "" if known or place == folder else _left_out(place, output)
            is_output = _is_output(place, output)
        except OSError as error:  # such as a folder that may be listed but not entered
            note(OSError(error.errno, error.strerror, here))
            folders.clear()
            continue
        if left_out:
            notes.append(f"{place}: {left_out}; left out")
        if known or left_out or is_output:
            folders.clear()
            continue
        # hidden files are metadata (macOS writes ._walk.c3d next to walk.c3d) or unfinished
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(files):
            path = place / name
            if name.startswith(".") or path.suffix.lower() not in SUFFIXES:
                continue
            if _is_source(path):
                yield path
            elif _is_unread(path):
                notes.append(
                    f"{path}: is a MATLAB file of version 7.3; left out; if it is a recording, "
                    "save it as version 7 (save ... -v7)"
                )


def _note_to(notes: list[str]) -> Callable[[OSError], None]:
    """Return a function that notes which folder cannot be read."""

    def note(error: OSError) -> None:
        notes.append(f"{error.filename}: cannot be searched ({error.strerror}); left out")

    return note


def _is_output(place: Path, output: Path) -> bool:
    return output.exists() and place.samefile(output)


def _left_out(place: Path, output: Path) -> str:
    """Return why a folder holds no sources; empty if it may."""
    if (place / MANIFEST).exists():
        return "is a prior database"
    if (place / STATE / MARK).exists() and not _is_output(place, output):
        return "holds the filled files of a study"
    if _is_not_raw(place):
        return "does not hold the recordings of its BIDS dataset"
    return ""


def _is_not_raw(place: Path) -> bool:
    """Return whether a folder holds other data of a BIDS dataset than its recordings."""
    return place.name in _NOT_RAW and (place.parent / DESCRIPTION).exists()


def _is_source(path: Path) -> bool:
    try:
        # the contents of a link may have to be fetched first, which its job reports
        return (path.is_file() or (path.is_symlink() and not path.exists())) and is_recording(path)
    except OSError:  # reading it reports the reason
        return True


def _is_unread(path: Path) -> bool:
    """Return whether a file may be a recording, but has a format whose contents are not read."""
    from priorfill.formats.arrays.mat import is_version_7_3  # loads NumPy

    return path.suffix.lower() == ".mat" and is_version_7_3(path)
