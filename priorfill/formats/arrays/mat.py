"""Recordings as MATLAB files (.mat, versions 4 to 7), including those exported by Qualisys.

`priorfill.formats.arrays.array_files` lists the variables. A file of Qualisys Track Manager holds
one structure with FrameRate, StartFrame and Trajectories.Labeled (Labels, and Data of shape
(markers, 4, frames): X, Y, Z in mm and the residual). One of the MoCap Toolbox holds a structure
with markerName, data of shape (frames, 3 * markers) and freq.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Mapping
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
from priorfill.formats.arrays.mat_elements import variable_names, variables
from priorfill.formats.file_bytes import read_bounded
from priorfill.formats.recording import Recording
from priorfill.formats.write_report import WriteReport

__all__ = ["create_mat", "is_version_7_3", "parse_mat", "recognise_mat"]

_HDF5 = b"\x89HDF\r\n\x1a\n"
_HEADER = b"MATLAB 5.0 MAT-file, written by priorfill".ljust(116)
"""Text at the start of a file. SciPy's has system and time, so that no two files are equal."""

_HDF5_AT = 512
"""Offset of the HDF5 signature in a file of version 7.3, after MATLAB's header text."""

_MAX_LISTED = 6
"""Recordings named in a message."""


def recognise_mat(path: Path) -> bool:
    """Check whether a file holds a recording by its variables."""
    try:
        data = read_bounded(path)
        _check_version(data, path.name)
        if _holds_recording(variable_names(data, path.name)):
            return True
        values = variables(data, path.name)
    except FormatError:
        return False
    return any(True for _ in _recordings(values))


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
    path.write_bytes(_HEADER + buffer.getvalue()[len(_HEADER) :])


def is_version_7_3(path: Path) -> bool:
    """Check whether a file is of version 7.3, whose variables are not read."""
    try:
        with path.open("rb") as file:
            return _has_version_7_3(file.read(_HDF5_AT + len(_HDF5)))
    except OSError:
        return False


def _has_version_7_3(data: bytes) -> bool:
    return data[_HDF5_AT:].startswith(_HDF5) or data.startswith(_HDF5)


def _check_version(data: bytes, name: str) -> None:
    """Raise FormatError for a file of version 7.3."""
    if _has_version_7_3(data):
        raise FormatError(
            f"{name}: is a MATLAB file of version 7.3; save it as version 7 (save ... -v7)"
        )


def parse_mat(data: bytes, name: str) -> Recording:
    """Parse the contents of a file.

    Raises
    ------
    FormatError
        If it is damaged, too large, or of unknown layout.
    """
    _check_version(data, name)
    values: Mapping[str, Any] = variables(data, name)
    held = dict(_recordings(values))
    if len(held) > 1:
        some = ", ".join([*list(held)[:_MAX_LISTED], *["..."] * (len(held) > _MAX_LISTED)])
        raise FormatError(
            f"{name}: holds {len(held)} recordings ({some}); save each in a file of its own"
        )
    if held:
        (values,) = held.values()
    elif len(values) == 1 and isinstance(only := _inner(next(iter(values.values()))), dict):
        values = only  # whose fields the message lists
    if isinstance(_field(values, "Trajectories"), dict):
        return _qualisys_recording(values, name, len(data))
    derivatives = np.ravel(np.asarray(_field(values, "timederOrder")))
    if derivatives.dtype.kind in "fiu" and derivatives.any():
        raise FormatError(
            f"{name}: holds time derivatives of positions (timederOrder); save the positions"
        )
    arrays = {key: _plain(_inner(value)) for key, value in values.items()}
    for key, value in arrays.items():
        if _is_by_marker(key, value):
            positions = np.stack([np.asarray(one) for one in value.values()], axis=1)
            return as_recording(
                arrays | {key: positions, "labels": np.array(list(value))}, name, len(data)
            )
    return as_recording(arrays, name, len(data))


def _recordings(
    values: Mapping[str, Any], place: str = ""
) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield the structures that hold a recording, and where they are; the outermost ones."""
    if _holds_recording(values) or any(_is_by_marker(key, one) for key, one in values.items()):
        yield place, values
        return
    for key, value in values.items():
        inner = _inner(value)
        is_list = isinstance(inner, np.ndarray) and inner.dtype == object
        parts = inner.ravel().tolist() if is_list else [inner]
        for number, part in enumerate(parts, start=1):
            if isinstance(part, dict):
                index = f"({number})" if len(parts) > 1 else ""
                yield from _recordings(part, f"{place}.{key}{index}".lstrip("."))


def _is_by_marker(key: str, value: Any) -> bool:
    """Check whether a variable is a structure of positions (frames, 3), a field per marker."""
    if key.lower() not in POSITIONS or not isinstance(value, dict) or not value:
        return False
    fields = list(value.values())
    return all(
        isinstance(one, np.ndarray)
        and one.dtype.kind in "fiu"
        and one.ndim == 2
        and one.shape[1] == 3
        and len(one) == len(fields[0])
        for one in fields
    )


def _holds_recording(names: Iterable[str]) -> bool:
    """Check whether variables or fields with these names hold a recording."""
    lower = {name.lower() for name in names}
    return "trajectories" in lower or bool(lower & set(POSITIONS) and lower & set(LABELS))


def _field(structure: Any, name: str) -> Any:
    """Return a field of a structure; None if there is none."""
    return _inner(structure.get(name)) if isinstance(structure, Mapping) else None


def _qualisys_recording(structure: Mapping[str, Any], name: str, packed: int) -> Recording:
    """Interpret the structure exported by Qualisys Track Manager."""
    labelled = _field(_field(structure, "Trajectories"), "Labeled")
    labels = np.ravel(_plain(_field(labelled, "Labels")))
    data = np.asarray(_field(labelled, "Data"))
    rate, first = (
        np.ravel(np.asarray(_field(structure, key))) for key in ("FrameRate", "StartFrame")
    )
    if labels.dtype.kind != "U" or data.dtype.kind not in "fiu" or rate.dtype.kind not in "fiu":
        raise FormatError(
            f"{name}: its structure has no labelled trajectories as exported by Qualisys; "
            "label them, and export again"
        )
    if data.ndim == 2:  # MATLAB drops the third dimension of a single frame
        data = data[:, :, None]
    if data.ndim != 3 or data.shape[0] != len(labels) or data.shape[1] not in (3, 4):
        raise FormatError(
            f"{name}: Trajectories.Labeled.Data has shape {data.shape}; "
            f"({len(labels)}, 4, frames) is needed: export again"
        )
    arrays = {"positions": data[:, :3].transpose(2, 0, 1), "labels": labels, "rate": rate}
    if first.dtype.kind in "fiu":
        arrays["first_frame"] = first
    return as_recording(arrays | {"unit": "mm"}, name, packed)


def _inner(value: Any) -> Any:
    """Return the contents of a cell array of one cell."""
    while isinstance(value, np.ndarray) and value.dtype == object and value.size == 1:
        value = value.ravel()[0]
    return value


def _plain(value: Any) -> Any:
    """Return a cell array of strings as a string array; other values unchanged."""
    if not isinstance(value, np.ndarray) or value.dtype != object:
        return value
    texts = [np.asarray(_inner(cell)) for cell in value.ravel()]
    if all(text.dtype.kind == "U" and text.size == 1 for text in texts):
        return np.array([str(text.ravel()[0]) for text in texts])
    return value
