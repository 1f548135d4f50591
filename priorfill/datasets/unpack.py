"""Unpack recordings from an archive of unknown origin.

Nothing the archive states is trusted: names must stay inside the folder, sizes are bounded and
counted, checksums are compared.
"""

from __future__ import annotations

import os
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path, PurePosixPath

from priorfill.datasets.local_names import (
    MAX_NAME,
    leads_out,
    local_path,
    plain_path,
    same_name,
)
from priorfill.datasets.retry_policy import FileFetchError
from priorfill.runtime.atomic_file import replace_file

__all__ = ["unpack"]

RECORDINGS = (".c3d",)
"""Lower-case suffixes of the members that are unpacked."""

MAX_RECORDING_BYTES = 2_000_000_000
"""Size of 5 hours of 50 markers at 120 Hz."""

MAX_TOTAL_BYTES = 100_000_000_000
"""Maximum size of an archive's recordings together."""

MAX_RECORDINGS = 100_000

CHUNK_BYTES = 1 << 20
"""Bytes read at a time."""

IGNORED_FOLDERS = ("__MACOSX",)
"""Folders in which programs store metadata under the names of recordings."""

MAX_DEFLATE_RATIO = 1032
"""Maximum ratio of inflated to deflated bytes (zlib's technical details)."""


def unpack(
    archive: Path,
    folder: Path,
    *,
    taken: Mapping[str, str] | None = None,
    notify: Callable[[str], None] = lambda text: None,
) -> list[Path]:
    """Write the recordings of an archive to a folder.

    A recording that exists already, with the same content, is not written again. On Windows,
    recordings whose names it does not allow are written under similar ones (see `local_path`).

    Parameters
    ----------
    archive : Path
        A zip file.
    folder : Path
        Where to; the archive's folders are created in it.
    taken : mapping, optional
        Recordings in the folder that are not to be replaced: whose they are, by `same_name`.
    notify : callable
        Called with a sentence if recordings get other names.

    Returns
    -------
    list of Path
        The recordings, in the archive's order.

    Raises
    ------
    FileFetchError
        If it is not a zip file, is damaged, has no recordings, breaks one of the limits, or has
        recordings that would replace each other or others. In the last four cases nothing is
        written.
    OutputError
        If a file cannot be written.
    """
    try:
        with zipfile.ZipFile(archive) as opened:
            members = _recordings_of(opened, archive)
            targets = {member: _target(member, folder, archive) for member in members}
            _check_sizes(members, archive)
            _check_names(targets, folder, archive, taken or {})
            _tell_new_names(targets, folder, archive, notify)
            for member, path in targets.items():
                if not _exists(member, path):
                    _write(opened, member, path)
    except zipfile.BadZipFile as error:
        raise FileFetchError(
            f"{archive}: is no zip file or damaged ({error}); remove it and try again"
        ) from error
    except (NotImplementedError, RuntimeError, EOFError, zlib.error, UnicodeDecodeError) as error:
        raise FileFetchError(
            f"{archive}: cannot be unpacked ({error}); remove it and try again"
        ) from error
    return list(targets.values())


def _recordings_of(opened: zipfile.ZipFile, archive: Path) -> list[zipfile.ZipInfo]:
    """Return the members that are recordings."""
    members = [
        member
        for member in opened.infolist()
        if member.filename.lower().endswith(RECORDINGS)
        and not plain_path(member.filename).name.startswith(".")
        and not set(IGNORED_FOLDERS) & set(plain_path(member.filename).parts)
    ]
    if not members:
        raise _unfit(archive, f"has no recordings ({', '.join(RECORDINGS)})")
    if len(members) > MAX_RECORDINGS:
        raise _unfit(archive, f"has {len(members)} recordings, more than {MAX_RECORDINGS}")
    return members


def _target(member: zipfile.ZipInfo, folder: Path, archive: Path) -> Path:
    """Return the path a member is written to, which must be inside the folder."""
    name = member.filename
    if leads_out(name):
        raise _unfit(archive, f"has a recording whose name {name!r} leads out of the folder")
    if any(ord(sign) < ord(" ") for sign in name):
        raise _unfit(archive, f"has a recording whose name {name!r} has control characters")
    path = folder / local_path(name)
    for part in path.parts[len(folder.parts) :]:
        if len(os.fsencode(part)) > MAX_NAME:
            raise _unfit(archive, f"has a name of {len(os.fsencode(part))} bytes ({part[:20]}...)")
    inside = Path(os.path.realpath(folder))
    # a symbolic link in the folder may lead out of it, too
    if not Path(os.path.realpath(path)).is_relative_to(inside):
        raise _unfit(archive, f"has a recording whose name {name!r} leads out of the folder")
    return path


def _check_sizes(members: list[zipfile.ZipInfo], archive: Path) -> None:
    """Raise FileFetchError if members are too large, or larger than their bytes can inflate to."""
    for member in members:
        if member.file_size > MAX_RECORDING_BYTES:
            raise _unfit(
                archive, f"has a recording of {member.file_size / 1e9:.1f} GB ({member.filename})"
            )
        is_bounded = member.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
        if is_bounded and member.file_size > MAX_DEFLATE_RATIO * max(member.compress_size, 1):
            raise _unfit(archive, f"states an impossible size of {member.filename!r}")
    total = sum(member.file_size for member in members)
    if total > MAX_TOTAL_BYTES:
        raise _unfit(archive, f"has recordings of {total / 1e9:.0f} GB")


def _check_names(
    targets: Mapping[zipfile.ZipInfo, Path], folder: Path, archive: Path, taken: Mapping[str, str]
) -> None:
    """Raise FileFetchError if a recording would replace another one, on any system."""
    names: dict[str, str] = {}
    for member, path in targets.items():
        name = same_name(path.relative_to(folder).as_posix())
        if name in names:
            raise _unfit(
                archive,
                f"has two recordings of one name ({names[name]!r} and {member.filename!r})",
            )
        names[name] = member.filename
        if name in taken and not _exists(member, path):
            raise FileFetchError(
                f"{archive}: its recording {member.filename!r} would replace that of {taken[name]};"
                " download it into a folder of its own"
            )
    for name, original in names.items():
        for parent in PurePosixPath(name).parents:
            if str(parent) in names:
                raise _unfit(archive, f"has a recording in another one ({original!r})")


def _tell_new_names(
    targets: Mapping[zipfile.ZipInfo, Path],
    folder: Path,
    archive: Path,
    notify: Callable[[str], None],
) -> None:
    """Say which recordings get other names than in the archive."""
    new = [
        f"{member.filename!r} as {local!r}"
        for member, path in targets.items()
        if (local := path.relative_to(folder).as_posix()) != plain_path(member.filename).as_posix()
    ]
    if new:
        others = f" and {len(new) - 1} others under similar names" if len(new) > 1 else ""
        notify(f"{archive}: Windows does not allow all its names; unpacks {new[0]}{others}")


def _exists(member: zipfile.ZipInfo, path: Path) -> bool:
    """Return whether a recording has been written already."""
    try:
        if not path.is_file() or path.stat().st_size != member.file_size:
            return False
    except OSError:  # such as a path that is too long; writing reports it
        return False
    found = 0
    with path.open("rb") as file:
        while chunk := file.read(CHUNK_BYTES):
            found = zlib.crc32(chunk, found)
    return found == member.CRC


def _write(opened: zipfile.ZipFile, member: zipfile.ZipInfo, path: Path) -> None:
    """Write a recording; zipfile stops at the checked size and compares the checksum."""
    with (
        replace_file(path, overwrite=True) as temporary,
        opened.open(member) as source,
        temporary.open("wb") as file,
    ):
        while chunk := source.read(CHUNK_BYTES):
            file.write(chunk)


def _unfit(archive: Path, what: str) -> FileFetchError:
    return FileFetchError(f"{archive}: {what}; it is not unpacked, check where it comes from")
