"""Names of the files of a BIDS dataset, and where its side files are.

A name is a list of entities, a suffix and an extension:
``sub-01_task-walk_tracksys-omc_motion.tsv``. A side file applies to each file below its folder that
has all of its entities (the inheritance principle).
"""

from __future__ import annotations

import os
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from priorfill.formats.file_bytes import is_folder

__all__ = [
    "DESCRIPTION",
    "MOTION",
    "BidsName",
    "all_side_files",
    "dataset_root",
    "derivative_path",
    "filled_name",
    "is_derivative",
    "is_motion",
    "mask_file",
    "motion_name_fault",
    "new_motion_fault",
    "sibling",
    "side_files",
]

MOTION = "_motion.tsv"
"""End of the name of a recording."""

DESCRIPTION = "dataset_description.json"
"""The file that marks the root of a dataset."""

_FILLED = "filled"
"""Label of filled recordings: ``desc-filled``."""

_NEW = re.compile(
    r"sub-[0-9a-zA-Z+]+(_ses-[0-9a-zA-Z+]+)?_task-[0-9a-zA-Z+]+_tracksys-[0-9a-zA-Z+]+"
    r"(_acq-[0-9a-zA-Z+]+)?(_run-[0-9]+)?(_desc-[0-9a-zA-Z+]+)?_motion\.tsv"
)
"""Name of a recording with the entities that BIDS requires, in its order."""

_INSIDE = re.compile(r"motion|(?:sub|ses)-.+")
"""Folders that are below the root of a dataset."""


@dataclass(frozen=True)
class BidsName:
    """The parts of a file's name.

    Attributes
    ----------
    entities : tuple of str
        ``sub-01``, ``task-walk`` and the like, in order.
    suffix : str
        What the file is, such as ``motion``.
    extension : str
        With its dot.
    """

    entities: tuple[str, ...]
    suffix: str
    extension: str

    @classmethod
    def parse(cls, name: str) -> BidsName:
        """Return the parts of a name.

        Parameters
        ----------
        name : str
            The name, without folders.

        Examples
        --------
        >>> BidsName.parse("sub-01_task-walk_motion.tsv").entities
        ('sub-01', 'task-walk')
        """
        stem, dot, extension = name.partition(".")
        *entities, suffix = stem.split("_")
        return cls(tuple(entities), suffix, dot + extension)

    def label(self, key: str) -> str:
        """Return the label of an entity; empty if the name does not have it.

        Parameters
        ----------
        key : str
            Such as ``sub``.
        """
        for entity in self.entities:
            if entity.startswith(key + "-"):
                return entity[len(key) + 1 :]
        return ""


def is_motion(path: Path) -> bool:
    """Check whether a file is a recording of a BIDS dataset, by its name."""
    return path.name.lower().endswith(MOTION)


def motion_name_fault(path: Path) -> str:
    """Return why a copy of a recording cannot have a name; empty if it can."""
    if is_motion(path):
        return ""
    return f"a Motion-BIDS file needs a name that ends with {MOTION}; choose such a name"


def new_motion_fault(path: Path) -> str:
    """Return why a new recording cannot have a name; empty if it can."""
    if _NEW.fullmatch(path.name):
        return ""
    return (
        "a new .tsv file is of Motion-BIDS, with a name such as "
        "sub-01_task-walk_tracksys-omc_desc-filled_motion.tsv; name it so, or write another "
        "format (.c3d .trc .npz .mat)"
    )


def is_derivative(path: Path) -> bool:
    """Check whether a file is a recording that was computed from another, by its name."""
    return is_motion(path) and bool(BidsName.parse(path.name).label("desc"))


def sibling(path: Path, suffix: str, extension: str) -> Path:
    """Return the file with the same entities and folder, but another suffix and extension.

    Parameters
    ----------
    path : Path
        The file.
    suffix : str
        Such as ``channels``.
    extension : str
        With its dot.
    """
    return path.with_name("_".join((*BidsName.parse(path.name).entities, suffix)) + extension)


def mask_file(path: Path) -> Path | None:
    """Return the table that marks the filled samples of a derivative; None if there is none.

    Parameters
    ----------
    path : Path
        The recording.
    """
    mask = sibling(path, "mask", ".tsv")
    return mask if is_derivative(path) and mask.is_file() else None


def filled_name(name: str) -> str:
    """Return the name of a filled recording.

    Parameters
    ----------
    name : str
        Of the recording; if it is not one of a BIDS dataset, it is returned as it is.

    Examples
    --------
    >>> filled_name("sub-01_task-walk_tracksys-omc_motion.tsv")
    'sub-01_task-walk_tracksys-omc_desc-filled_motion.tsv'
    >>> filled_name("walk_motion.tsv")
    'walk_motion.tsv'
    """
    parts = BidsName.parse(name)
    if not (parts.label("sub") and is_motion(Path(name))):
        return name
    entities = [entity for entity in parts.entities if not entity.startswith("desc-")]
    label = parts.label("desc")  # a file has one label at most
    entities.append(f"desc-{label}{_FILLED.title()}" if label else f"desc-{_FILLED}")
    return "_".join((*entities, parts.suffix)) + parts.extension


def derivative_path(source: Path, folder: Path) -> Path:
    """Return where a derivative dataset has a filled recording.

    Parameters
    ----------
    source : Path
        The recording.
    folder : Path
        The root of the derivative dataset.
    """
    parts = BidsName.parse(source.name)
    for key in ("sub", "ses"):
        if parts.label(key):
            folder /= f"{key}-{parts.label(key)}"
    return folder / "motion" / filled_name(source.name)


def dataset_root(path: Path) -> Path | None:
    """Return the root of the dataset that a file or folder is in; None if it is in none.

    Parameters
    ----------
    path : Path
        The file or folder; the root itself is in the dataset.
    """
    root = _folders(path / "x" if is_folder(path) else path)[0]
    return root if _is_root(root) else None


def side_files(path: Path, suffix: str, extension: str) -> list[Path]:
    """Return the side files that apply to a file, those that decide last.

    Parameters
    ----------
    path : Path
        The file. Links are not followed: in a dataset of DataLad it is one, and its name and folder
        count, not those of the contents.
    suffix : str
        What the side files are, such as ``channels``.
    extension : str
        With its dot.

    Returns
    -------
    list of Path
        From the root of the dataset to the file's folder, and in a folder from the fewest entities
        to the most.
    """
    entities = set(BidsName.parse(path.name).entities)
    found = []
    for folder in _folders(path):
        here = []
        with suppress(OSError), os.scandir(folder) as entries:
            for entry in entries:
                name = BidsName.parse(entry.name)
                if (
                    (name.suffix, name.extension) == (suffix, extension)
                    and entities.issuperset(name.entities)
                    and entry.is_file()
                ):
                    here.append((len(name.entities), entry.name))
        found += [folder / name for _, name in sorted(here)]
    return found


def all_side_files(path: Path) -> list[Path]:
    """Return the side files that decide what a recording means; none for another file.

    Parameters
    ----------
    path : Path
        The file.
    """
    if not is_motion(path):
        return []
    tables = side_files(path, "channels", ".tsv")[-1:]
    if mask := mask_file(path):
        tables.append(mask)
    return tables + side_files(path, "motion", ".json") + side_files(path, "channels", ".json")


def _folders(path: Path) -> list[Path]:
    """Return the folders from the root of a file's dataset to the file."""
    folder = Path(os.path.abspath(path)).parent  # noqa: PTH100, does not resolve links
    folders = [folder]
    while _INSIDE.fullmatch(folder.name) and not _is_root(folder):
        folder = folder.parent
        folders.append(folder)
    return folders[::-1]


def _is_root(folder: Path) -> bool:
    """Return whether a folder is the root of a dataset; a folder without permission is none."""
    return os.path.exists(folder / DESCRIPTION)  # noqa: PTH110, Path.exists raises PermissionError
