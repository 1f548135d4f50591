"""Recordings as NumPy archives (.npz); which arrays is said in `priorfill.formats.arrays`."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import FormatError, OutputError
from priorfill.formats.arrays import LABELS, POSITIONS, as_recording, clip_arrays
from priorfill.formats.atomic import replace_file
from priorfill.formats.c3d_patch import WriteReport
from priorfill.formats.npz_new import save_arrays
from priorfill.formats.recording import (
    Reading,
    check_filled,
    check_size,
    make_clip,
    read_bounded,
)

__all__ = ["create_npz_clip", "read_npz", "recognise_npz"]

_ZIP = b"PK\x03\x04"


def recognise_npz(path: Path) -> bool:
    """Tell by its list of arrays if a file holds a recording."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = {name.removesuffix(".npy").lower() for name in archive.namelist()}
    except (OSError, zipfile.BadZipFile):
        return False
    return bool(names & set(POSITIONS)) and bool(names & set(LABELS))


def read_npz(path: Path, reading: Reading) -> Clip:
    """Read a recording; see `priorfill.formats.read`."""
    data = read_bounded(path)
    recording = as_recording(load_arrays(data, path.name), path.name)
    return make_clip(recording, path.name, reading, path=path, data=data, format="npz")


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
    """Write a clip as a new archive; positions are the clip's, in mm.

    Parameters
    ----------
    path : Path or str
        The file to write.
    clip : Clip
        The clip.
    filled : ndarray [shape=(frames, markers), bool] or None
        Which samples were filled; samples that the source says are filled count, too.
    overwrite : bool
        Replace an existing file.

    Raises
    ------
    OutputError
        If the file exists already or cannot be written, or a filled sample has no position.
    """
    mask = check_filled(clip, filled)
    before = clip.source.interpolated if clip.source is not None else None
    with replace_file(path, overwrite=overwrite) as temporary:
        save_arrays(temporary, clip_arrays(clip, mask if before is None else mask | before))
        again = as_recording(load_arrays(temporary.read_bytes(), temporary.name), temporary.name)
        if again.labels != clip.labels or not np.array_equal(
            again.positions, clip.positions, equal_nan=True
        ):
            raise OutputError(
                f"{path}: what was written there is not what should be; "
                "check the folder's permissions and space"
            )
    return WriteReport(samples=int(mask.sum()), worst_error_mm=0.0)
