"""Recordings as named arrays, the common content of NumPy and MATLAB files.

priorfill writes `positions` (frames, markers, 3), `labels`, `rate` (Hz), `unit`, `up`,
`first_frame`, `name`, `subject` and `filled` (frames, markers). Files of other programs are read if
they use one of the names below, or if one variable alone fits the labels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import FormatError
from priorfill.formats.arrays.column_order import check_column_order
from priorfill.formats.arrays.unpacked_size import check_unpacked
from priorfill.formats.recording import Recording
from priorfill.formats.tables.frames import find_rate
from priorfill.formats.write_report import WriteReport, check_filled, check_read_back
from priorfill.geometry.axes import UP_AXES
from priorfill.runtime.atomic_file import replace_file

__all__ = ["LABELS", "POSITIONS", "RATES", "Unread", "as_recording", "clip_arrays", "write_arrays"]

POSITIONS = ("positions", "markers", "trajectories", "points", "marker_data", "data", "xyz")
LABELS = (
    *("labels", "marker_labels", "marker_names", "markernames", "markerlabels", "names"),
    "markername",
)
RATES = ("rate", "fs", "frame_rate", "framerate", "frequency", "freq", "sampling_rate")
_TIMES = ("time", "times")
_UNITS = ("unit", "units")
"""Names of each variable, in any case; the first one present is used."""

_NAMES = frozenset((*POSITIONS, *LABELS, *RATES, *_UNITS, "up", "subject", "first_frame", "filled"))

_MAX_LISTED = 12
"""Variables named in a message."""

_NUMBER_BYTES = 8
"""Size of a coordinate in a clip, bytes."""

MIN_RATE, MAX_RATE = 0.001, 1e6
"""Frame rates that a file may state (Hz), far beyond those of cameras on both sides."""

SAME_SHARE = 1e-6
"""Share by which two numbers may differ that are the same but for rounding to float32."""

MAX_FRAME = 2**31 - 1
"""Maximum number of a first frame, that of a 32-bit integer."""


@dataclass(frozen=True)
class Unread:
    """A variable that holds neither numbers nor text.

    Attributes
    ----------
    what : str
        What it holds.
    """

    what: str


def clip_arrays(clip: Clip, filled: NDArray[np.bool_]) -> dict[str, Any]:
    """Return the arrays that priorfill writes for a clip, positions in mm."""
    return {
        "positions": clip.positions,
        "labels": np.array([_storable(label) for label in clip.labels]),
        "rate": clip.rate,
        "unit": "mm",
        "up": clip.up,
        "first_frame": clip.first_frame,
        "name": _storable(clip.name),
        "subject": _storable(clip.subject),
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
    """Write a clip as a new file of named arrays.

    The file is written under a temporary name, read back, compared, and then renamed.

    Parameters
    ----------
    path : Path or str
        The file to write.
    clip : Clip
        The clip.
    filled : ndarray [shape=(frames, markers), bool] or None
        Which samples were filled; samples that the source marks as filled are added.
    save : callable
        Writes the arrays of `clip_arrays` to a path.
    parse : callable
        Makes a recording from the contents and name of such a file.
    overwrite : bool
        Replace an existing file.

    Returns
    -------
    WriteReport
        The number of filled samples; positions are not rounded.

    Raises
    ------
    OutputError
        If the file exists already or cannot be written, or a filled sample has no position.
    """
    mask = check_filled(clip, filled)
    declared = clip.source.interpolated if clip.source is not None else None
    arrays = clip_arrays(clip, mask if declared is None else mask | declared)
    with replace_file(path, overwrite=overwrite) as temporary:
        save(temporary, arrays)
        again = parse(temporary.read_bytes(), temporary.name)
        check_read_back(
            path,
            again.labels == _strings(np.array(clip.labels), temporary.name)
            and np.array_equal(again.positions, clip.positions, equal_nan=True),
        )
    return WriteReport(samples=int(mask.sum()), rounding_mm=0.0)


def as_recording(arrays: Mapping[str, Any], name: str, packed: int) -> Recording:
    """Interpret named arrays.

    Parameters
    ----------
    arrays : mapping of str to array_like
        Positions may be (frames, markers, 3), or (frames, 3 * markers) with X, Y, Z of a marker in
        adjacent columns.
    name : str
        The file's name in messages.
    packed : int
        Bytes of the file.

    Raises
    ------
    FormatError
        If positions or labels are not found, or do not fit each other.
    """
    known: dict[str, str] = {}
    for one in arrays:
        other = known.setdefault(one.lower(), one)
        if other != one and one.lower() in _NAMES:
            raise FormatError(f"{name}: has variables {other} and {one}; delete or rename one")
    labels = _labels(arrays, known, name)
    key = _first(known, POSITIONS)
    candidates = [key] if key else [k for k in arrays if _shaped(arrays[k], len(labels))]
    if len(candidates) != 1 or not _shaped(arrays[candidates[0]], len(labels)):
        raise FormatError(
            f"{name}: no variable clearly holds the positions of {len(labels)} markers; "
            f"name one {POSITIONS[0]!r}, of shape (frames, {len(labels)}, 3) or "
            f"(frames, {3 * len(labels)}); there are {_listing(arrays)}"
        )
    raw = np.asarray(arrays[candidates[0]])
    check_unpacked(_NUMBER_BYTES * raw.size, packed, name)
    positions = np.array(raw, dtype=np.float64, order="C")
    if positions.ndim == 2:
        check_column_order(positions, name)
        positions = positions.reshape(len(positions), len(labels), 3)
    up = _text(arrays, known, ("up",), name)
    if up and up not in UP_AXES:
        raise FormatError(
            f"{name}: variable up is {up[:20]!r}; one of {' '.join(UP_AXES)} is needed"
        )
    subject = _text(arrays, known, ("subject",), name)
    mask = None
    if "filled" in known:
        mask = _mask(np.asarray(arrays[known["filled"]]), positions.shape[:2], name)
    rate, notes = _rate_and_notes(arrays, known, len(positions), name)
    notes += tuple(_contradictions(arrays, known))
    return Recording(
        positions,
        labels,
        rate,
        _text(arrays, known, _UNITS, name),
        first_frame=_first_frame(arrays, known, name),
        up=up,
        subjects=(subject,) if subject else (),
        interpolated=mask,
        notes=notes,
    )


def _mask(filled: NDArray[Any], shape: tuple[int, ...], name: str) -> NDArray[np.bool_] | None:
    """Return which samples are filled [shape=(frames, markers)]; None if it does not state it."""
    if filled.dtype.kind not in "bfiu":
        return None
    if filled.size != math.prod(shape) or (filled.ndim == 2 and filled.shape != shape):
        raise FormatError(
            f"{name}: variable filled has the shape {filled.shape}; (frames, markers), here "
            f"{shape}, is needed: correct or delete it"
        )
    return filled.reshape(shape).astype(bool)


def _labels(arrays: Mapping[str, Any], known: Mapping[str, str], name: str) -> tuple[str, ...]:
    """Return the labels."""
    key = _first(known, LABELS)
    texts = _strings(arrays[key], name) if key else ()
    if not texts:
        raise FormatError(
            f"{name}: has no variable with the markers' names; name one {LABELS[0]!r}, a list of "
            f"strings; there are {_listing(arrays)}"
        )
    return texts


def _strings(value: Any, name: str) -> tuple[str, ...]:
    """Return the texts of an array without blanks around them; empty if it holds none."""
    array = np.asarray(value)
    if array.dtype.kind not in "US":
        return ()
    try:
        texts = [
            one.decode("utf-8") if isinstance(one, bytes) else str(one)
            for one in array.ravel().tolist()
        ]
        texts = [_storable(one).strip() for one in texts]
    except ValueError as error:  # bytes of another encoding, numbers that are no characters
        raise FormatError(
            f"{name}: has text that is not Unicode; save the labels as strings"
        ) from error
    return tuple(texts)


def _storable(text: str) -> str:
    """Return a text without lone surrogates, as of a file name that is not UTF-8, and zeros.

    NumPy drops zeros at the end.
    """
    return text.encode("utf-8", "replace").decode("utf-8").rstrip("\0").replace("\0", "?")


def _rate(arrays: Mapping[str, Any], known: Mapping[str, str], name: str) -> float | None:
    """Return the frame rate (Hz); None if there is none."""
    rate = _number(arrays, known, RATES, name)
    if rate is not None and not MIN_RATE <= rate <= MAX_RATE:
        raise FormatError(
            f"{name}: variable {_first(known, RATES)} is {rate:g}; give the frames per second, or "
            "delete it"
        )
    return rate


def _rate_and_notes(
    arrays: Mapping[str, Any], known: Mapping[str, str], frames: int, name: str
) -> tuple[float | None, tuple[str, ...]]:
    """Return the frame rate (Hz) by the rate and the times of a file, and notes."""
    rate = _rate(arrays, known, name)
    key = _first(known, _TIMES)
    if key is None:
        return rate, ()
    times = np.asarray(arrays[key])
    if times.dtype.kind not in "fiu" or times.size != frames:
        return rate, ()
    found, notes = find_rate(rate, [repr(time).encode() for time in times.ravel().tolist()])
    return found, tuple(notes)


def _contradictions(arrays: Mapping[str, Any], known: Mapping[str, str]) -> Iterator[str]:
    """Yield a note for each variable with the meaning of another one, but not its contents."""
    for names in (POSITIONS, LABELS, RATES, _UNITS):
        used, *others = [known[name] for name in names if name in known] or [""]
        for other in others:
            if _contradicts(np.asarray(arrays[used]), np.asarray(arrays[other]), names):
                yield (
                    f"has the variables {used} and {other} with different contents; {used} is "
                    "used (delete or rename the wrong one)"
                )


def _contradicts(one: NDArray[Any], other: NDArray[Any], names: tuple[str, ...]) -> bool:
    """Return whether the second of two variables states what the first one does, and otherwise."""
    kinds = "US" if names in (LABELS, _UNITS) else "fiu"
    if other.dtype.kind not in kinds or other.size == 0:
        return False  # of another meaning
    if one.size != other.size:
        return names is not POSITIONS  # angles, or the coordinates of something else
    if kinds == "US":
        return [str(text).strip() for text in one.ravel()] != [
            str(text).strip() for text in other.ravel()
        ]
    return not np.allclose(one.ravel(), other.ravel(), rtol=SAME_SHARE, atol=0.0, equal_nan=True)


def _first_frame(arrays: Mapping[str, Any], known: Mapping[str, str], name: str) -> int:
    """Return the number of the first frame; 1 if there is none."""
    number = _number(arrays, known, ("first_frame",), name)
    if number is None:
        return 1
    if abs(number) > MAX_FRAME or number != round(number):
        raise FormatError(
            f"{name}: variable {known['first_frame']} is {number:g}; give the whole number of the "
            "first frame, or delete it"
        )
    return round(number)


def _shaped(value: Any, markers: int) -> bool:
    """Check whether an array can hold the positions of this number of markers."""
    array = np.asarray(value)
    return array.dtype.kind in "fiu" and (
        (array.ndim == 3 and array.shape[1:] == (markers, 3))
        or (array.ndim == 2 and array.shape[1] == 3 * markers)
    )


def _first(known: Mapping[str, str], names: tuple[str, ...]) -> str | None:
    """Return the first of the names that is present, as spelled in the file."""
    return next((known[name] for name in names if name in known), None)


def _text(
    arrays: Mapping[str, Any], known: Mapping[str, str], names: tuple[str, ...], name: str
) -> str:
    """Return a string; empty if there is none."""
    key = _first(known, names)
    texts = _strings(arrays[key], name) if key else ()
    return texts[0] if texts else ""


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
    """Return the variables and their shapes for a message."""
    found = []
    for key, value in arrays.items():
        if isinstance(value, Unread):
            found.append(f"{key} ({value.what})")
        else:
            array = np.asarray(value)
            kind = array.dtype.kind
            what = " text" if kind in "US" else "" if kind in "fiuO" else f" {array.dtype.name}"
            found.append(f"{key} {array.shape}{what}")
        if len(found) > _MAX_LISTED:
            return ", ".join([*found[:_MAX_LISTED], "..."])
    return ", ".join(found) or "none"
