"""Small clips, and what a database must hold of them."""

from __future__ import annotations

import gc
import hashlib
import json
import re
import sqlite3
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from priorfill.database import ClipRecord, PriorDatabase
from priorfill.errors import PriorfillError

RATE = 60.0
LABELS = ("LASI", "RASI", "SACR", "C7", "LKNE", "RKNE")
DATABASE_RATE = 30.0
LEVELS = 3

RESTING = re.compile(r"priorfill-database\.json|catalogue(-\d+)?\.(sqlite|checksum)|segments|lock")
"""Files of a database without a writer; anything else is unfinished."""

NEW = {
    "lock",
    "segments",
    "priorfill-database.json.new",
    "catalogue.sqlite",
    "catalogue.sqlite.new",
    "catalogue.sqlite.new-journal",
    "catalogue.checksum",
    "catalogue.checksum.new",
}
"""Files of a database that was being made."""


@dataclass(frozen=True)
class Stored:
    """Expected contents of a database for a clip: bytes of all levels and of the mask."""

    positions: bytes
    filled: bytes

    @property
    def digest(self) -> str:
        """Their hash."""
        return hashlib.sha256(self.positions + self.filled).hexdigest()


def stored_of(database: PriorDatabase, record: ClipRecord) -> Stored:
    """Return what a database holds of a clip."""
    mask = database.filled(record)
    if mask is None:
        mask = np.zeros((record.frames[0], len(record.labels)), dtype=bool)
    data = b"".join(database.positions(record, level).tobytes() for level in range(LEVELS))
    return Stored(data, mask.tobytes())


def make_clip(seed: int, *, gappy: bool = False) -> Any:
    """Return a small clip of six oscillating markers, optionally with a gap."""
    from priorfill.clip import Clip

    rng = np.random.default_rng([4711, seed])
    frames = int(rng.integers(50, 90))
    t = np.arange(frames)[:, None, None] / RATE
    place = rng.uniform(-500, 500, (1, len(LABELS), 3))
    speed = 2 * np.pi * rng.uniform(0.5, 2, (1, len(LABELS), 3))
    positions = place + [0, 0, 1000] + 200 * np.sin(speed * t + rng.uniform(0, 6, place.shape))
    if gappy:
        positions[20:30, rng.integers(len(LABELS))] = np.nan
    # float32 as in files: accepting a filled version must find equal samples
    return Clip(positions.astype(np.float32), LABELS, RATE, name=f"clip{seed:03d}")


def fill_of(clip: Any) -> tuple[Any, np.ndarray]:
    """Fill gaps linearly, and return the mask."""
    filled = clip.missing
    positions = clip.positions.copy()
    frames = np.arange(clip.frames)
    for marker in np.flatnonzero(filled.any(axis=0)):
        known = ~filled[:, marker]
        for i in range(3):
            positions[:, marker, i] = np.interp(frames, frames[known], positions[known, marker, i])
    return clip.with_positions(positions), filled


def must_be(clip: Any, filled: np.ndarray | None = None) -> Stored:
    """Return the expected contents for a clip, computed independently of the database."""
    from priorfill.geometry.axes import to_upright
    from priorfill.signal.resample import pyramid, resample

    fine = resample(to_upright(clip.positions, clip.up), clip.rate, DATABASE_RATE)
    levels = pyramid(fine, DATABASE_RATE, LEVELS)
    mask = np.zeros(fine.shape[:2], dtype=bool)
    if filled is not None:
        step = int(RATE / DATABASE_RATE)  # every sample of level 0 is one of the clip's
        mask = filled[::step][: len(mask)] & ~np.isnan(fine[..., 0])
    data = b"".join(level.positions.astype("<f4").tobytes() for level in levels)
    return Stored(data, mask.tobytes())


class WrongError(Exception):
    """Data was lost, or is unexpected."""


def contents(folder: Path, known: dict[str, dict[str, Stored]]) -> dict[str, str]:
    """Open and verify a database; return the version of each clip in it.

    Parameters
    ----------
    folder : Path
        The database; a missing folder counts as empty.
    known : dict
        Expected contents of each version, by clip name.

    Raises
    ------
    WrongError
        If it cannot be opened, fails to verify, or has unexpected contents.
    """
    if not (folder / "priorfill-database.json").exists():
        left = [path.name for path in folder.iterdir()] if folder.exists() else []
        if set(left) <= NEW and not any(folder.glob("segments/*")):
            return {}
        raise WrongError(f"there is no database, but {left}")
    found: dict[str, str] = {}
    try:
        with PriorDatabase.open(folder) as database:
            problems = database.verify()
            if problems:
                raise WrongError("; ".join(problems))
            for record in database.clips():
                stored = stored_of(database, record)
                if record.name in found:
                    raise WrongError(f"{record.name} exists twice")
                for version, expected in known.get(record.name, {}).items():
                    if stored == expected:
                        found[record.name] = version
                if record.name not in found:
                    raise WrongError(f"{record.name} is not what was added, bit for bit")
    except (PriorfillError, OSError, ValueError, KeyError) as error:
        raise WrongError(f"{type(error).__name__}: {error}") from error
    return found


def is_unfinished(folder: Path) -> bool:
    """Return whether a database has unfinished files or two catalogues."""
    try:
        names = [path.name for path in folder.iterdir()]
    except FileNotFoundError:
        return False
    catalogues = sum(name.endswith(".sqlite") for name in names)
    return catalogues > 1 or not all(RESTING.fullmatch(name) for name in names)


def check_nothing_left(folder: Path) -> None:
    """Open a database for writing, which nobody else has open; nothing unfinished may be left.

    Raises
    ------
    WrongError
        If there are unfinished files, or segments that the catalogue does not list.
    """
    gc.collect()  # Windows removes no file that a forgotten array still maps
    try:
        PriorDatabase.open(folder, write=True).close()
    except PriorfillError as error:
        raise WrongError(f"cannot be opened for writing: {error}") from error
    names = sorted(path.name for path in folder.iterdir())
    if is_unfinished(folder):
        raise WrongError(f"the next opening left unfinished files among {names}")
    (catalogue,) = folder.glob("*.sqlite")
    with closing(sqlite3.connect(catalogue)) as connection:
        ((text,),) = connection.execute("SELECT value FROM meta WHERE name = 'segments'").fetchall()
    listed = sorted(f"{int(number):06d}.f32" for number in json.loads(text)["segments"])
    there = sorted(path.name for path in folder.glob("segments/*"))
    if there != listed:
        raise WrongError(f"the next opening left segments {there}, listed are {listed}")


def difference(found: dict[str, str], wanted: dict[str, str]) -> str:
    """Describe the difference between two contents."""
    parts = [
        f"{name} {found.get(name, 'missing')} instead of {wanted.get(name, 'nothing')}"
        for name in sorted(set(found) | set(wanted))
        if found.get(name) != wanted.get(name)
    ]
    return ", ".join(parts) or "no difference"
