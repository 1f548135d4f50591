"""Exchange files of a database while no process is at work."""

from __future__ import annotations

import random
import shutil
from pathlib import Path

from priorfill.database import PriorDatabase

FOREIGN = ("catalogue.sqlite.bak", "notes.txt", "segments/notes.txt", "segments/000777.f32")
"""Files that are not of the database."""


def fingerprint(folder: Path) -> dict[str, bytes]:
    """Return the bytes of all files of a database, except the lock."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "lock"
    }


def _catalogue(folder: Path) -> Path:
    """Return the catalogue in use."""
    return max(folder.glob("catalogue*.sqlite"), key=lambda path: (len(path.name), path.name))


def empty_catalogue(folder: Path, older: Path, other: Path, rng: random.Random) -> bool:
    """Empty the catalogue, with or without its checksum file."""
    if rng.random() < 0.5:
        _catalogue(folder).with_suffix(".checksum").unlink()
    _catalogue(folder).write_bytes(b"")
    return True


def remove_catalogue(folder: Path, older: Path, other: Path, rng: random.Random) -> bool:
    """Remove the catalogue."""
    _catalogue(folder).unlink()
    return True


def foreign_catalogue(folder: Path, older: Path, other: Path, rng: random.Random) -> bool:
    """Replace the catalogue by that of another database, with or without its checksum file."""
    there = _catalogue(folder)
    shutil.copyfile(_catalogue(other), there)
    if rng.random() < 0.5:
        checksum = _catalogue(other).with_suffix(".checksum")
        shutil.copyfile(checksum, there.with_suffix(".checksum"))
    return True


def new_catalogue(folder: Path, older: Path, other: Path, rng: random.Random) -> bool:
    """Replace the catalogue by that of a new database without clips."""
    made = folder.parent / "made"
    shutil.rmtree(made, ignore_errors=True)
    PriorDatabase.create(made).close()
    return foreign_catalogue(folder, older, made, rng)


def older_catalogue(folder: Path, older: Path, other: Path, rng: random.Random) -> bool:
    """Replace the catalogue by its older copy, with its checksum file or without any."""
    there, copy = _catalogue(folder), _catalogue(older)
    if there.name != copy.name or fingerprint(older) == fingerprint(folder):
        return remove_catalogue(folder, older, other, rng)
    sizes = [
        {path.name: path.stat().st_size for path in one.glob("segments/*")}
        for one in (folder, older)
    ]
    shutil.copyfile(copy, there)
    if sizes[0] != sizes[1]:
        if rng.random() < 0.5:
            shutil.copyfile(copy.with_suffix(".checksum"), there.with_suffix(".checksum"))
        else:
            there.with_suffix(".checksum").unlink()
    return True


def spoilt_segment(folder: Path, older: Path, other: Path, rng: random.Random) -> bool:
    """Remove, empty, shorten, lengthen or exchange a segment."""
    segment = rng.choice(sorted(folder.glob("segments/*.f32")))
    data = segment.read_bytes()
    foreign = next(iter(sorted(other.glob("segments/*.f32")))).read_bytes()
    copies = [path.read_bytes() for path in older.glob(f"segments/{segment.name}")]
    choices = [None, b"", data[:-4], data[: len(data) // 2], data + bytes(400), foreign]
    choices += [copy for copy in copies if copy != data]
    chosen = rng.choice(choices)
    if chosen is None:
        segment.unlink()
    else:
        segment.write_bytes(chosen)
    return True


def foreign_files(folder: Path, older: Path, other: Path, rng: random.Random) -> bool:
    """Put files that are not of the database into its folder; this is no damage."""
    for name in FOREIGN:
        source = rng.choice([*other.glob("segments/*.f32"), _catalogue(older)])
        shutil.copyfile(source, folder / name)
    return False


SWAPS = (
    empty_catalogue,
    remove_catalogue,
    foreign_catalogue,
    new_catalogue,
    older_catalogue,
    spoilt_segment,
    spoilt_segment,
    foreign_files,
)
