"""Processes that work on a prior database, and die there if a test wants it."""

from __future__ import annotations

import multiprocessing
import os
import sqlite3
import sys
import warnings
from collections.abc import Callable
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import numpy as np

from priorfill.clip import Clip
from priorfill.database import PriorDatabase, catalogue, catalogue_rows, segments
from priorfill.errors import DatabaseLockedError

DIED, LOCKED = 9, 7
"""Exit statuses."""

PLACES: dict[str, tuple[Any, str]] = {
    "at first": (catalogue.Catalogue, "announce"),
    "before the row": (catalogue.Catalogue, "change"),
    "within the transaction": (catalogue_rows, "row_checksum"),
    "before the segment is on disk": (segments, "flush_file"),
}
"""Where a writer may die while it adds a clip."""


def make_clip(
    seed: int = 0, frames: int = 130, rate: float = 120.0, up: str = "+Z", **more: str
) -> Clip:
    """A clip of four swinging markers, with a gap."""
    rng = np.random.default_rng(seed)
    t = np.arange(frames)[:, None, None] / rate
    place = rng.uniform(-500, 500, (1, 4, 3))
    swing = 200 * np.sin(2 * np.pi * rng.uniform(0.5, 2, (1, 4, 3)) * t)
    positions = place + swing
    positions[40:60, 1] = np.nan
    more.setdefault("name", f"clip{seed}")
    return Clip(positions, ("LASI", "RASI", "SACR", "C7"), rate, up, **more)  # type: ignore[arg-type]


def start(act: Callable[..., None], *given: object) -> BaseProcess:
    """Call a function of a module in another process."""
    # a fork begins at once; other systems have none that is safe
    context: Any = multiprocessing.get_context("fork" if sys.platform == "linux" else "spawn")
    process: BaseProcess = context.Process(target=act, args=given)
    with warnings.catch_warnings():
        # forking a threaded process can hang a child that takes their locks; this one does not
        warnings.simplefilter("ignore", DeprecationWarning)
        process.start()
    return process


def run_and_die(act: Callable[..., None], *given: object) -> None:
    """Call a function in another process, which ends in it without cleaning up."""
    process = start(act, *given)
    process.join()
    assert process.exitcode == DIED


def die_in_add(folder: Path, where: str) -> None:
    """Add clip 1, and die while adding clip 2."""
    with PriorDatabase.open(folder, write=True) as database:
        database.add(make_clip(1))
        setattr(*PLACES[where], lambda *_, **__: os._exit(DIED))
        database.add(make_clip(2))


def die_as_writer(folder: Path) -> None:
    """Die with the database open."""
    database = PriorDatabase.open(folder, write=True)
    os._exit(DIED if database.clips() is not None else 1)


def spoil(path: Path) -> None:
    """Change a catalogue without committing, and die."""
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute("PRAGMA cache_size = 1")  # spill changed pages to the file early
    connection.execute("BEGIN IMMEDIATE")
    connection.execute("CREATE TABLE junk (data BLOB)")
    for _ in range(50):
        connection.execute("INSERT INTO junk VALUES (randomblob(4000))")
    connection.execute("UPDATE clips SET name = 'spoilt'")
    os._exit(DIED)


def add_one(folder: Path, seed: int) -> None:
    """Add a clip, and make the database if there is none."""
    try:
        with PriorDatabase.open_or_create(folder) as database:
            database.add(make_clip(seed))
    except DatabaseLockedError:
        os._exit(LOCKED)
    os._exit(0)


def write_on(folder: Path) -> None:
    """Add, remove and compact until the process is killed."""
    number = 1
    while True:
        with PriorDatabase.open(folder, write=True) as database:
            for _ in range(3):
                database.add(make_clip(number))
                number += 1
            database.remove(database.clips()[:2])
            database.compact()
