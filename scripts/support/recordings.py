"""Folder, marker sets and subjects of the recordings that studies and benchmarks use."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

DEFAULT_FOLDER = Path(__file__).resolve().parents[3] / "shared" / "data"
"""Folder of recordings, which are not part of the project, unless PRIORFILL_DATA names another."""

SETS = {
    "gait59": ("gait",),
    "baumann41": ("cmu", "hdm05", "hdm05_cut_markers"),
}
"""Folders of recordings by marker set; other folders have unknown marker sets."""

SUBJECT = {
    "gait": slice(0, 5),
    "cmu": slice(0, -3),
    "hdm05": slice(4, 6),
    "hdm05_cut_markers": slice(4, 6),
    "walkl": slice(None),
}
"""Part of a file name that identifies the subject, by folder."""


def add_data_option(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--data``, the folder of recordings."""
    named = Path(os.environ.get("PRIORFILL_DATA", DEFAULT_FOLDER))
    parser.add_argument("--data", type=Path, default=named, help="folder of recordings")


def subject_of(file: Path) -> str:
    """Return the subject of a recording, from its name and folder."""
    return file.stem[SUBJECT.get(file.parent.name, slice(None))]
