"""Recordings that the studies are made with: where they are, and whose."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

BESIDE = Path(__file__).resolve().parents[3] / "shared" / "data"
"""Where recordings are looked for if nothing says otherwise: they are no part of the project."""

SETS = {
    "gait59": ("gait",),
    "baumann41": ("cmu", "hdm05", "hdm05_cut_markers"),
}
"""Folders whose recordings have the same marker set; others have none that is known."""

SUBJECT = {
    "gait": slice(0, 5),
    "cmu": slice(0, -3),
    "hdm05": slice(4, 6),
    "hdm05_cut_markers": slice(4, 6),
    "walkl": slice(None),
}
"""Where a file's name has the person, by folder."""


def add_data_option(parser: argparse.ArgumentParser) -> None:
    """Give a script the option that names the folder of recordings."""
    named = Path(os.environ.get("PRIORFILL_DATA", BESIDE))
    parser.add_argument("--data", type=Path, default=named, help="folder of recordings")


def subject_of(file: Path) -> str:
    """Return whose motion a recording is, by its name and folder."""
    return file.stem[SUBJECT.get(file.parent.name, slice(None))]
