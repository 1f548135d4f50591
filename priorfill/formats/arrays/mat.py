"""Recordings as MATLAB files (.mat, versions 4 to 7), including those exported by Qualisys.

`priorfill.formats.arrays.array_files` lists the variables. A file of Qualisys Track Manager holds
one structure with FrameRate, StartFrame and Trajectories.Labeled (Labels, and Data of shape
(markers, 4, frames): X, Y, Z in mm and the residual).
"""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import FormatError
from priorfill.formats import file_bytes
from priorfill.formats.arrays.array_files import (
    LABELS,
    POSITIONS,
    as_recording,
    write_arrays,
)
from priorfill.formats.file_bytes import check_size, read_bounded
from priorfill.formats.recording import Recording
from priorfill.formats.write_report import WriteReport

__all__ = ["create_mat", "parse_mat", "recognise_mat"]

_HDF5 = b"\x89HDF\r\n\x1a\n"
_HDF5_AT = 512
"""Offset of the HDF5 signature in a file of version 7.3, after MATLAB's header text."""

_HEADER_BYTES = 128
_ORDER_AT = 126
_COMPRESSED = 15
"""Version 5: size of the header, offset of the byte order mark in it, and type of a compressed
variable (MAT-File Format, MathWorks, R2024a, chapter 1)."""

_CHUNK_BYTES = 1 << 24
"""Bytes inflated at once when counting."""

_MAX_NUMBER_BYTES = 8
"""Size of the largest numeric type."""


def recognise_mat(path: Path) -> bool:
    """Check whether a file holds a recording by its variables."""
    try:
        data = read_bounded(path)
        names = {name.lower() for name, _, _ in _listed(data, path.name)}
        if len(names) == 1:
            (only,) = _variables(data, path.name).values()
            names = {name.lower() for name in _fields(only)}
    except FormatError:
        return False
    return "trajectories" in names or bool(names & set(POSITIONS) and names & set(LABELS))


def create_mat(
    path: Path | str,
    clip: Clip,
    filled: NDArray[np.bool_] | None = None,
    *,
    overwrite: bool = False,
) -> WriteReport:
    """Write a clip as a new file of version 5.

    See Also
    --------
    priorfill.formats.arrays.array_files.write_arrays : Parameters, and errors raised.
    """
    return write_arrays(path, clip, filled, _save, parse_mat, overwrite=overwrite)


def _save(path: Path, arrays: dict[str, Any]) -> None:
    """Write arrays to a file of version 5."""
    from scipy.io import savemat  # slow; imported late to keep `--help` fast

    labels = np.array(arrays["labels"], dtype=object).reshape(-1, 1)  # a cell array
    buffer = io.BytesIO()
    savemat(buffer, arrays | {"labels": labels}, do_compression=True)
    path.write_bytes(buffer.getvalue())


def _listed(data: bytes, name: str) -> list[tuple[str, tuple[int, ...], str]]:
    """Return name, shape and class of each variable.

    Raises
    ------
    FormatError
        If the file cannot be read.
    """
    from scipy.io import whosmat

    if data[_HDF5_AT:].startswith(_HDF5) or data.startswith(_HDF5):
        raise FormatError(
            f"{name}: is a MATLAB file of version 7.3; save it as version 7 (save ... -v7)"
        )
    try:
        listed: list[tuple[str, tuple[int, ...], str]] = whosmat(io.BytesIO(data))
    except Exception as error:
        # scipy raises errors of any type, and all have the same remedy
        raise _damaged(name, error) from error
    return listed


def _inflated(data: bytes) -> int:
    """Return the approximate uncompressed size of the variables (bytes), up to `MAX_BYTES`.

    The listed shape of a structure does not include its contents, and zlib reaches a compression
    ratio of a thousand.
    """
    order = {b"IM": "<", b"MI": ">"}.get(data[_ORDER_AT:_HEADER_BYTES])
    total, place = 0, _HEADER_BYTES
    while order and place + 8 <= len(data) and total <= file_bytes.MAX_BYTES:
        kind, size = struct.unpack_from(f"{order}II", data, place)
        place += 8
        if kind == _COMPRESSED:
            inflater, rest = zlib.decompressobj(), data[place : place + size]
            while rest and total <= file_bytes.MAX_BYTES:
                try:
                    part = inflater.decompress(rest, _CHUNK_BYTES)
                except zlib.error:
                    break  # reported by the reader
                total += len(part)
                rest = inflater.unconsumed_tail
                if not part:
                    break
        place += size
    return total


def _damaged(name: str, error: Exception) -> FormatError:
    reason = " ".join(str(error).split()) or type(error).__name__
    return FormatError(f"{name}: cannot be read as a MATLAB file ({reason}); save it again")


def parse_mat(data: bytes, name: str) -> Recording:
    """Parse the contents of a file.

    Raises
    ------
    FormatError
        If it is damaged, too large, or of unknown layout.
    """
    variables = _variables(data, name)
    structures = [value for value in variables.values() if _fields(value)]
    if len(structures) == 1 and "Trajectories" in _fields(structures[0]):
        return _qualisys_recording(structures[0], name)
    if len(variables) == 1 and structures:  # all variables in one structure
        only = structures[0]
        variables = {key: _inner(only[key]) for key in _fields(only)}
    return as_recording({key: _plain(value) for key, value in variables.items()}, name)


def _variables(data: bytes, name: str) -> dict[str, Any]:
    """Return the variables by name.

    Raises
    ------
    FormatError
        If the file is damaged or too large.
    """
    from scipy.io import loadmat

    listed = _listed(data, name)
    check_size(
        sum(_MAX_NUMBER_BYTES * int(np.prod(shape, dtype=float)) for _, shape, _ in listed), name
    )
    check_size(_inflated(data), name)
    try:
        loaded = loadmat(io.BytesIO(data), squeeze_me=False, struct_as_record=True)
    except Exception as error:
        raise _damaged(name, error) from error
    return {key: value for key, value in loaded.items() if not key.startswith("__")}


def _qualisys_recording(structure: Any, name: str) -> Recording:
    """Interpret the structure exported by Qualisys Track Manager."""
    try:
        labelled = _inner(_inner(structure["Trajectories"])["Labeled"])
        labels = tuple(str(text).strip() for text in _plain(_inner(labelled["Labels"])).ravel())
        data = np.asarray(_inner(labelled["Data"]), dtype=np.float64)
        rate = float(np.ravel(_inner(structure["FrameRate"]))[0])
        first = 1
        if "StartFrame" in _fields(structure):
            first = int(np.ravel(_inner(structure["StartFrame"]))[0])
    except (KeyError, ValueError, TypeError, IndexError) as error:
        raise FormatError(
            f"{name}: its structure has no labelled trajectories as exported by Qualisys; "
            "label them, and export again"
        ) from error
    if data.ndim == 2:  # MATLAB drops the third dimension of a single frame
        data = data[:, :, None]
    if data.ndim != 3 or data.shape[0] != len(labels) or data.shape[1] not in (3, 4):
        raise FormatError(
            f"{name}: Trajectories.Labeled.Data has shape {data.shape}; "
            f"({len(labels)}, 4, frames) is needed: export again"
        )
    positions = np.array(data[:, :3].transpose(2, 0, 1), order="C")
    return Recording(positions, labels, rate, "mm", first_frame=first)


def _fields(value: Any) -> tuple[str, ...]:
    """Return the field names of a structure; empty if the value is not a single structure."""
    names = getattr(getattr(value, "dtype", None), "names", None)
    return tuple(names) if names and getattr(value, "size", 0) == 1 else ()


def _inner(value: Any) -> Any:
    """Return the contents of a structure's field, which scipy wraps in an array of one object."""
    while isinstance(value, np.ndarray) and value.dtype == object and value.size == 1:
        value = value.ravel()[0]
    return value


def _plain(value: Any) -> NDArray[Any]:
    """Return a cell array of strings as a string array; other values unchanged."""
    array = np.asarray(value)
    if array.dtype != object:
        return array
    texts = [np.asarray(_inner(cell)) for cell in array.ravel()]
    if all(text.dtype.kind == "U" and text.size == 1 for text in texts):
        return np.array([str(text.ravel()[0]) for text in texts])
    return array
