"""Take the recordings out of an archive that nobody here has made.

What it says of itself is not believed: names must stay in the folder, sizes are bounded and
counted, checksums are compared.
"""

from __future__ import annotations

import os
import zipfile
import zlib
from pathlib import Path, PurePosixPath

from priorfill.datasets.download import FileFetchError
from priorfill.errors import OutputError
from priorfill.runtime.atomic_file import replace_file

__all__ = ["unpack"]

RECORDINGS = (".c3d",)
"""Suffixes of what is taken out, lower case."""

LARGEST = 2_000_000_000
"""Bytes of a recording: 5 hours of 50 markers at 120 Hz."""

LARGEST_TOTAL = 100_000_000_000
"""Bytes of an archive's recordings together."""

MOST = 100_000
"""Recordings in an archive."""

_CHUNK = 1 << 20
"""Bytes read at a time."""

_FOREIGN = ("__MACOSX",)
"""Folders in which programs keep what is no recording."""

_DEFLATE_MOST = 1032
"""Bytes that a byte of a deflated member can become at most (zlib's technical details)."""


def unpack(archive: Path, folder: Path) -> list[Path]:
    """Write the recordings of an archive to a folder.

    A recording that is there already, and the same, is not written again.

    Parameters
    ----------
    archive : Path
        A zip file.
    folder : Path
        Where to; the archive's folders are made in it.

    Returns
    -------
    list of Path
        The recordings, in the archive's order.

    Raises
    ------
    FileFetchError
        Where it is no zip file, damaged, has no recordings, or is not what a library would be: then
        nothing of it has been written.
    OutputError
        Where something cannot be written.
    """
    try:
        with zipfile.ZipFile(archive) as opened:
            members = _members(opened, archive)
            where = {member: _place(member, folder, archive) for member in members}
            _check_sizes(members, archive)
            if len({str(path).casefold() for path in where.values()}) < len(where):
                raise _unfit(archive, "has two recordings of one name")
            for member, path in where.items():
                if not _is_there(member, path):
                    _write(opened, member, path)
    except zipfile.BadZipFile as error:
        raise FileFetchError(
            f"{archive}: is no zip file or damaged ({error}); remove it and try again"
        ) from error
    except (NotImplementedError, RuntimeError, EOFError, zlib.error) as error:
        raise FileFetchError(
            f"{archive}: cannot be unpacked ({error}); remove it and try again"
        ) from error
    return list(where.values())


def _members(opened: zipfile.ZipFile, archive: Path) -> list[zipfile.ZipInfo]:
    """Return the recordings of an archive."""
    members = [
        member
        for member in opened.infolist()
        if member.filename.lower().endswith(RECORDINGS)
        and not PurePosixPath(member.filename).name.startswith(".")
        and not set(_FOREIGN) & set(PurePosixPath(member.filename).parts)
    ]
    if not members:
        raise _unfit(archive, f"has no recordings ({', '.join(RECORDINGS)})")
    if len(members) > MOST:
        raise _unfit(archive, f"has {len(members)} recordings, more than {MOST}")
    return members


def _place(member: zipfile.ZipInfo, folder: Path, archive: Path) -> Path:
    """Return where a member goes, which must be inside the folder."""
    name = member.filename
    parts = PurePosixPath(name).parts
    odd = any(ord(sign) < ord(" ") for sign in name) or "\\" in name or ":" in name
    if odd or name.startswith("/") or ".." in parts:
        raise _unfit(archive, f"has a recording of the name {name!r}, which leads out of it")
    path = folder.joinpath(*parts)
    inside = Path(os.path.realpath(folder))
    # a link in the folder may lead out of it, too
    if not Path(os.path.realpath(path)).is_relative_to(inside):
        raise _unfit(archive, f"has a recording of the name {name!r}, which leads out of it")
    return path


def _check_sizes(members: list[zipfile.ZipInfo], archive: Path) -> None:
    """Raise FileFetchError where members are too large, or too large for what they are made of."""
    for member in members:
        if member.file_size > LARGEST:
            raise _unfit(
                archive, f"has a recording of {member.file_size / 1e9:.1f} GB ({member.filename})"
            )
        plain = member.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
        if plain and member.file_size > _DEFLATE_MOST * max(member.compress_size, 1):
            raise _unfit(archive, f"says of {member.filename!r} what cannot be")
    total = sum(member.file_size for member in members)
    if total > LARGEST_TOTAL:
        raise _unfit(archive, f"has recordings of {total / 1e9:.0f} GB")


def _is_there(member: zipfile.ZipInfo, path: Path) -> bool:
    """Tell if a recording has been written before."""
    if not path.is_file() or path.stat().st_size != member.file_size:
        return False
    found = 0
    with path.open("rb") as file:
        while piece := file.read(_CHUNK):
            found = zlib.crc32(piece, found)
    return found == member.CRC


def _write(opened: zipfile.ZipFile, member: zipfile.ZipInfo, path: Path) -> None:
    """Write a recording; zipfile ends at the size that was checked, and compares the checksum."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{path.parent}: cannot be made ({error.strerror}); check what is there"
        ) from error
    with (
        replace_file(path, overwrite=True) as temporary,
        opened.open(member) as source,
        temporary.open("wb") as file,
    ):
        while piece := source.read(_CHUNK):
            file.write(piece)


def _unfit(archive: Path, what: str) -> FileFetchError:
    return FileFetchError(f"{archive}: {what}; it is not unpacked, look at where it comes from")
