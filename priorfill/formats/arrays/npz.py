"""Recordings as NumPy archives (.npz); `array_files` lists the arrays."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import FormatError
from priorfill.formats.arrays.array_files import (
    LABELS,
    POSITIONS,
    as_recording,
    write_arrays,
)
from priorfill.formats.file_bytes import check_size
from priorfill.formats.recording import Recording
from priorfill.formats.write_report import WriteReport
from priorfill.runtime.npz_file import save_arrays

__all__ = ["create_npz_clip", "parse_npz", "recognise_npz"]

_ZIP = b"PK\x03\x04"


def recognise_npz(path: Path) -> bool:
    """Check whether a file holds a recording by its list of arrays."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = {name.removesuffix(".npy").lower() for name in archive.namelist()}
    except (OSError, zipfile.BadZipFile):
        return False
    return bool(names & set(POSITIONS)) and bool(names & set(LABELS))


def parse_npz(data: bytes, name: str) -> Recording:
    """Parse the contents of a file.

    Raises
    ------
    FormatError
        If it is not an archive, damaged, too large, or without positions or labels.
    """
    return as_recording(load_arrays(data, name), name)


def load_arrays(data: bytes, name: str) -> dict[str, Any]:
    """Return the arrays of an archive, except those that only pickle could read.

    Raises
    ------
    FormatError
        If it is not an archive, damaged, or too large.
    """
    if not data.startswith(_ZIP):
        raise FormatError(f"{name}: is not a NumPy archive (.npz); save it with numpy.savez")
    arrays = {}
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            check_size(sum(member.file_size for member in archive.infolist()), name)
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            for key in archive.files:
                try:
                    arrays[key] = archive[key]
                except ValueError as error:
                    if "allow_pickle" not in str(error):
                        raise
    except FormatError:
        raise
    except Exception as error:
        # zipfile, zlib and numpy raise errors of any type, and all have the same remedy
        raise FormatError(f"{name}: is damaged ({error}); save or copy it again") from error
    return {key: value for key, value in arrays.items() if isinstance(value, np.ndarray)}


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
