"""Recordings as NumPy archives (.npz); `array_files` lists the arrays."""

from __future__ import annotations

import io
import math
import warnings
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import FormatError
from priorfill.formats.arrays.array_files import (
    LABELS,
    POSITIONS,
    Unread,
    as_recording,
    write_arrays,
)
from priorfill.formats.arrays.unpacked_size import check_unpacked
from priorfill.formats.file_bytes import os_errors_explained
from priorfill.formats.recording import Recording
from priorfill.formats.write_report import WriteReport
from priorfill.runtime.npz_file import save_arrays

__all__ = ["create_npz_clip", "parse_npz", "recognise_npz"]

_ZIP = b"PK\x03\x04"

_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Compression methods that NumPy writes."""

MAX_ARRAYS = 10_000
"""Maximum number of arrays of a file."""


class _DamagedError(Exception):
    """An array is not as the format demands; the message is the reason."""


def recognise_npz(path: Path) -> bool:
    """Check whether a file holds a recording by its list of arrays."""
    try:
        with os_errors_explained(path), zipfile.ZipFile(path) as archive:
            names = {name.removesuffix(".npy").lower() for name in archive.namelist()}
    except Exception:  # zipfile raises errors of any type for damaged archives
        return False
    return bool(names & set(POSITIONS)) and bool(names & set(LABELS))


def parse_npz(data: bytes, name: str) -> Recording:
    """Parse the contents of a file.

    Raises
    ------
    FormatError
        If it is not an archive, damaged, too large, or without positions or labels.
    """
    return as_recording(load_arrays(data, name), name, len(data))


def load_arrays(data: bytes, name: str) -> dict[str, Any]:
    """Return the arrays of an archive, with `Unread` for those of neither numbers nor text.

    Raises
    ------
    FormatError
        If it is not an archive, damaged, or too large.
    """
    if not data.startswith(_ZIP):
        raise FormatError(f"{name}: is not a NumPy archive (.npz); save it with numpy.savez")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = archive.infolist()
            check_unpacked(sum(member.file_size for member in members), len(data), name)
            if len(members) > MAX_ARRAYS:
                raise _DamagedError(f"it has more than {MAX_ARRAYS} arrays")
            return {
                member.filename.removesuffix(".npy"): _array(archive, member)
                for member in members
                if member.filename.endswith(".npy")
            }
    except FormatError:
        raise
    except Exception as error:
        # zipfile, zlib and numpy raise errors of any type, and all have the same remedy
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FormatError(f"{name}: is damaged ({reason}); save or copy it again") from error


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any] | Unread:
    """Return one array of an archive.

    The size that its header states is compared with the bytes that are there before memory is
    taken.
    """
    if member.compress_type not in _METHODS:
        raise _DamagedError(f"{member.filename} is compressed by a method that NumPy does not use")
    with archive.open(member) as file:
        version = npy.read_magic(file)
        if version == (3, 0):
            return Unread("structured array")  # only their names need this version
        if version not in ((1, 0), (2, 0)):
            raise _DamagedError(f"{member.filename} is of unknown version {version}")
        read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # headers that Python 2 wrote
            shape, by_column, dtype = read(file)
        if dtype.kind not in "biufUS":
            return Unread("Python objects" if dtype.hasobject else dtype.name)
        number = math.prod(shape)
        left = member.file_size - file.tell()
        if min(shape, default=0) < 0 or number * dtype.itemsize != left or number > max(left, 1):
            raise _DamagedError(f"{member.filename} has {left} bytes for an array {shape} {dtype}")
        content = file.read()
    if len(content) != left:
        raise _DamagedError(f"{member.filename} ends early")
    return np.frombuffer(content, dtype).reshape(shape, order="F" if by_column else "C")


def create_npz_clip(
    path: Path | str,
    clip: Clip,
    filled: NDArray[np.bool_] | None = None,
    *,
    overwrite: bool = False,
) -> WriteReport:
    """Write a clip as a new archive.

    See Also
    --------
    priorfill.formats.arrays.array_files.write_arrays : Parameters, and errors raised.
    """
    return write_arrays(path, clip, filled, save_arrays, parse_npz, overwrite=overwrite)
