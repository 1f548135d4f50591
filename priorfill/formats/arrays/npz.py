"""Recordings as NumPy archives (.npz); `array_files` names their arrays."""

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
    """Tell by its list of arrays if a file holds a recording."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = {name.removesuffix(".npy").lower() for name in archive.namelist()}
    except (OSError, zipfile.BadZipFile):
        return False
    return bool(names & set(POSITIONS)) and bool(names & set(LABELS))


def parse_npz(data: bytes, name: str) -> Recording:
    """Read a recording; raises what `load_arrays` and `as_recording` do."""
    return as_recording(load_arrays(data, name), name)


def load_arrays(data: bytes, name: str) -> dict[str, Any]:
    """Return the arrays of an archive, but for those that only pickle could read.

    Raises
    ------
    FormatError
        If it is no archive, damaged, or too large.
    """
    if not data.startswith(_ZIP):
        raise FormatError(f"{name}: is no NumPy archive (.npz); save it with numpy.savez")
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
        # zipfile, zlib and numpy raise whatever they like, and every cause has the same remedy
        raise FormatError(f"{name}: is damaged ({error}); save or copy it again") from error
    return {key: value for key, value in arrays.items() if isinstance(value, np.ndarray)}


def create_npz_clip(
    path: Path | str,
    clip: Clip,
    filled: NDArray[np.bool_] | None = None,
    *,
    overwrite: bool = False,
) -> WriteReport:
    """Write a clip as a new archive; see `priorfill.formats.arrays.array_files.write_arrays`."""
    return write_arrays(path, clip, filled, save_arrays, parse_npz, overwrite=overwrite)
