"""Write arrays as NumPy archives (.npz)."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from priorfill.runtime.atomic_file import replace_file

__all__ = ["create_npz", "save_arrays"]

_UNIX = 3
"""Number of the system on which a zip file says it was made: the same on all, for equal bytes."""


def create_npz(path: Path | str, arrays: Mapping[str, Any], *, overwrite: bool = False) -> None:
    """Write named arrays to a compressed archive; equal arrays give equal bytes.

    Parameters
    ----------
    path : Path or str
        The file to write.
    arrays : mapping of str to array_like
        Numbers and strings, which can be loaded without unpickling.
    overwrite : bool
        Replace an existing file.

    Raises
    ------
    OutputError
        If the file exists already or cannot be written.
    ValueError
        If an array holds neither numbers nor strings.
    """
    with replace_file(path, overwrite=overwrite) as temporary:
        save_arrays(temporary, arrays)


def save_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write named arrays as `create_npz` does, but not atomically.

    Raises
    ------
    ValueError
        If an array holds neither numbers nor strings.
    """
    ready = {name: np.asarray(value) for name, value in arrays.items()}
    for name, array in ready.items():
        if array.dtype.kind not in "biufU":
            raise ValueError(f"{name} is of type {array.dtype}; give numbers or strings")
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in ready.items():
            entry = zipfile.ZipInfo(f"{name}.npy")  # without the time
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = _UNIX
            with archive.open(entry, "w", force_zip64=True) as file:
                np.lib.format.write_array(file, array, allow_pickle=False)
