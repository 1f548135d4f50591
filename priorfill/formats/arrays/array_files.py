"""Recordings as named arrays: what NumPy and MATLAB files of ours, and of others, have in common.

Ours have `positions` (frames, markers, 3), `labels`, `rate` (Hz), `unit`, `up`, `first_frame`,
`name`, `subject` and `filled` (frames, markers).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import FormatError, OutputError
from priorfill.formats.recording import Recording
from priorfill.formats.write_report import WriteReport, check_filled
from priorfill.geometry.axes import UP_AXES
from priorfill.runtime.atomic_file import replace_file

__all__ = ["LABELS", "POSITIONS", "RATES", "as_recording", "clip_arrays", "write_arrays"]

POSITIONS = ("positions", "markers", "trajectories", "points", "marker_data", "data", "xyz")
LABELS = ("labels", "marker_labels", "marker_names", "markernames", "markerlabels", "names")
RATES = ("rate", "fs", "frame_rate", "framerate", "frequency", "freq", "sampling_rate")
_UNITS = ("unit", "units")
"""Names by which each is looked for, upper and lower case alike; the first that is there counts."""


def clip_arrays(clip: Clip, filled: NDArray[np.bool_]) -> dict[str, Any]:
    """Return what a file of ours holds of a clip, positions in mm."""
    return {
        "positions": clip.positions,
        "labels": np.array(clip.labels),
        "rate": clip.rate,
        "unit": "mm",
        "up": clip.up,
        "first_frame": clip.first_frame,
        "name": clip.name,
        "subject": clip.subject,
        "filled": filled,
    }


def write_arrays(
    path: Path | str,
    clip: Clip,
    filled: NDArray[np.bool_] | None,
    save: Callable[[Path, dict[str, Any]], None],
    parse: Callable[[bytes, str], Recording],
    *,
    overwrite: bool = False,
) -> WriteReport:
    """Write a clip as a new file of named arrays, and read it back before it gets its name.

    C3DParameters
    ----------
    path : Path or str
        The file to write.
    clip : Clip
        The clip.
    filled : ndarray [shape=(frames, markers), bool] or None
        Which samples were filled; samples that the source says are filled count, too.
    save : callable
        Writes `clip_arrays` to a file.
    parse : callable
        Reads the contents of such a file, which has a name.
    overwrite : bool
        Replace an existing file.

    Raises
    ------
    OutputError
        If the file exists already or cannot be written, or a filled sample has no position.
    """
    mask = check_filled(clip, filled)
    before = clip.source.interpolated if clip.source is not None else None
    arrays = clip_arrays(clip, mask if before is None else mask | before)
    with replace_file(path, overwrite=overwrite) as temporary:
        save(temporary, arrays)
        again = parse(temporary.read_bytes(), temporary.name)
        if again.labels != clip.labels or not np.array_equal(
            again.positions, clip.positions, equal_nan=True
        ):
            raise OutputError(
                f"{path}: what was written there is not what should be; "
                "check the folder's permissions and space"
            )
    return WriteReport(samples=int(mask.sum()), worst_error_mm=0.0)


def as_recording(arrays: Mapping[str, Any], name: str) -> Recording:
    """Understand named arrays.

    C3DParameters
    ----------
    arrays : mapping of str to array_like
        Positions may be (frames, markers, 3) or (frames, 3 markers) with X, Y, Z of a marker
        beside each other.
    name : str
        What to call the file in messages.

    Raises
    ------
    FormatError
        Where positions or labels are not found, or do not fit each other.
    """
    known = {key.lower(): key for key in arrays}
    labels = _labels(arrays, known, name)
    key = _first(known, POSITIONS)
    candidates = [key] if key else [k for k in arrays if _shaped(arrays[k], len(labels))]
    if len(candidates) != 1 or not _shaped(arrays[candidates[0]], len(labels)):
        raise FormatError(
            f"{name}: no variable is known to hold the positions of {len(labels)} markers; "
            f"name one {POSITIONS[0]!r}, of shape (frames, {len(labels)}, 3) or "
            f"(frames, {3 * len(labels)}); there are {_listing(arrays)}"
        )
    raw = np.asarray(arrays[candidates[0]])
    positions = np.array(raw, dtype=np.float64).reshape(raw.shape[0], len(labels), 3)
    up = _text(arrays, known, ("up",))
    if up and up not in UP_AXES:
        raise FormatError(
            f"{name}: variable up is {up[:20]!r}; one of {' '.join(UP_AXES)} is needed"
        )
    subject = _text(arrays, known, ("subject",))
    first_frame = _number(arrays, known, ("first_frame",), name)
    filled = arrays[known["filled"]] if "filled" in known else None
    mask = None
    if filled is not None:
        mask = np.asarray(filled).astype(bool)
        if mask.shape != positions.shape[:2]:
            mask = (
                mask.reshape(positions.shape[:2]) if mask.size == positions[..., 0].size else None
            )
    return Recording(
        positions,
        labels,
        _number(arrays, known, RATES, name),
        _text(arrays, known, _UNITS),
        first_frame=1 if first_frame is None else round(first_frame),
        up=up,
        subjects=(subject,) if subject else (),
        interpolated=mask,
    )


def _labels(arrays: Mapping[str, Any], known: Mapping[str, str], name: str) -> tuple[str, ...]:
    """Return the labels."""
    key = _first(known, LABELS)
    texts = np.asarray(arrays[key]) if key else np.empty(0, dtype=str)
    if texts.dtype.kind not in "US" or texts.size == 0:
        raise FormatError(
            f"{name}: has no variable with the markers' names; name one {LABELS[0]!r}, a list of "
            f"texts; there are {_listing(arrays)}"
        )
    return tuple(str(text).strip() for text in texts.astype(str).ravel())


def _shaped(value: Any, markers: int) -> bool:
    """Tell if an array can be the positions of so many markers."""
    array = np.asarray(value)
    return array.dtype.kind in "fiu" and (
        (array.ndim == 3 and array.shape[1:] == (markers, 3))
        or (array.ndim == 2 and array.shape[1] == 3 * markers)
    )


def _first(known: Mapping[str, str], names: tuple[str, ...]) -> str | None:
    """Return the first of the names that is there, as it is spelled."""
    return next((known[name] for name in names if name in known), None)


def _text(arrays: Mapping[str, Any], known: Mapping[str, str], names: tuple[str, ...]) -> str:
    """Return a text; empty if there is none."""
    key = _first(known, names)
    value = np.asarray(arrays[key]) if key else np.empty(0)
    return str(value.ravel()[0]).strip() if value.dtype.kind in "US" and value.size else ""


def _number(
    arrays: Mapping[str, Any], known: Mapping[str, str], names: tuple[str, ...], name: str
) -> float | None:
    """Return a number; None if there is none."""
    key = _first(known, names)
    if key is None:
        return None
    value = np.asarray(arrays[key])
    if value.size != 1 or value.dtype.kind not in "fiu" or not np.isfinite(value.ravel()[0]):
        raise FormatError(f"{name}: variable {key} should be one number; correct or delete it")
    return float(value.ravel()[0])


def _listing(arrays: Mapping[str, Any]) -> str:
    """Return words for what is there."""
    found = [f"{key} {np.asarray(value).shape}" for key, value in arrays.items()]
    return (
        ", ".join(found[:_MOST_LISTED]) + (", ..." if len(found) > _MOST_LISTED else "") or "none"
    )


_MOST_LISTED = 12
"""Variables named in a message."""
