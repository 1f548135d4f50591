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

__all__ = ["MOTION", "BidsName", "is_motion", "motion_name_fault", "side_files"]

MOTION = "_motion.tsv"
"""End of the name of a recording."""

_DESCRIPTION = "dataset_description.json"
"""The file that marks the root of a dataset."""

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
    """Return why a recording cannot have a name; empty if it can."""
    if is_motion(path):
        return ""
    return f"a Motion-BIDS file needs a name that ends with {MOTION}; choose such a name"


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


def _folders(path: Path) -> list[Path]:
    """Return the folders from the root of a file's dataset to the file."""
    folder = Path(os.path.abspath(path)).parent  # noqa: PTH100, does not resolve links
    folders = [folder]
    while _INSIDE.fullmatch(folder.name) and not (folder / _DESCRIPTION).exists():
        folder = folder.parent
        folders.append(folder)
    return folders[::-1]
