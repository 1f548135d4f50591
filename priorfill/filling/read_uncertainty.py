"""Read the expected error of each filled sample, as `priorfill.write_uncertainty` wrote it."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import FormatError, OptionError
from priorfill.filling.provenance import Provenance
from priorfill.filling.uncertainty_file import COLUMNS, UNCERTAINTY_SUFFIXES
from priorfill.formats.arrays.npz import load_arrays
from priorfill.formats.file_bytes import read_bounded
from priorfill.runtime.display import csv_cell

__all__ = ["Uncertainty", "UncertaintyFile", "read_uncertainty"]

_REMEDY = "give a file that `uncertainty` wrote"


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Expected errors of the samples of a clip.

    Attributes
    ----------
    expected_rms_mm, error_bound_90_mm : ndarray [shape=(frames, markers), mm]
        As of `Result`; NaN where unknown.
    sources : mapping of (str, int) to str
        What a sample was filled from, by marker and frame from 0; empty where the file does not
        state it.
    provenance : Provenance or None
        Of the fill; None where the file does not state it.
    """

    expected_rms_mm: NDArray[np.float64]
    error_bound_90_mm: NDArray[np.float64]
    sources: Mapping[tuple[str, int], str] = field(default_factory=dict)
    provenance: Provenance | None = None


@dataclass(frozen=True)
class UncertaintyFile:
    """A file of expected errors.

    Attributes
    ----------
    path : Path
        The file.
    like : callable
        Returns the uncertainty of a clip whose markers have some labels in the file.
    """

    path: Path
    like: Callable[[Clip, Sequence[str]], Uncertainty]


def read_uncertainty(path: Path | str) -> UncertaintyFile:
    """Read a file of expected errors.

    Parameters
    ----------
    path : Path or str
        The file, .npz or .csv.

    Raises
    ------
    OptionError
        If the suffix is another one.
    FormatError
        If it cannot be read, or is not as `priorfill.write_uncertainty` writes it.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in UNCERTAINTY_SUFFIXES:
        raise OptionError(
            f"{path}: the uncertainty is not read from {suffix or 'a file without suffix'}; "
            f"give {' or '.join(UNCERTAINTY_SUFFIXES)}"
        )
    data = read_bounded(path)
    if suffix == ".csv":
        rows = _rows(data, path)
        return UncertaintyFile(path, lambda clip, labels: _of_rows(rows, clip, labels, path))
    arrays = load_arrays(data, str(path))
    return UncertaintyFile(path, lambda clip, labels: _of_arrays(arrays, clip, labels, path))


def _of_arrays(
    arrays: Mapping[str, Any], clip: Clip, labels: Sequence[str], path: Path
) -> Uncertainty:
    """Return the uncertainty of a clip from the arrays of an archive."""
    names = ("labels", "frames", "expected_rms_mm", "error_bound_90_mm")
    for name in names:
        if not isinstance(arrays.get(name), np.ndarray):
            raise FormatError(f"{path}: has no array {name}; {_REMEDY}")
    known, frames, rms, bound = (arrays[name] for name in names)
    shape = (len(frames.ravel()), len(known.ravel()))
    numbers = rms.dtype.kind == bound.dtype.kind == "f" and frames.dtype.kind in "iu"
    if not numbers or rms.shape != shape or bound.shape != shape:
        raise FormatError(f"{path}: its arrays do not fit each other; {_REMEDY}")
    if any((lengths < 0).any() or np.isinf(lengths).any() for lengths in (rms, bound)):
        raise FormatError(f"{path}: has a negative or infinite error; {_REMEDY}")
    if shape[0] != clip.frames:
        raise FormatError(
            f"{path}: is on {shape[0]} frames, and {clip.name} has {clip.frames}; give that of the "
            "same fill"
        )
    place = {str(label): number for number, label in enumerate(known.ravel())}
    columns = [_column(place, label, path) for label in labels]
    return Uncertainty(
        np.asarray(rms[:, columns], dtype=np.float64),
        np.asarray(bound[:, columns], dtype=np.float64),
        provenance=_provenance(arrays.get("provenance")),
    )


def _column(place: Mapping[str, int], label: str, path: Path) -> int:
    if label not in place:
        raise FormatError(f"{path}: has no marker {label}; give that of the same fill")
    return place[label]


def _provenance(value: Any) -> Provenance | None:
    """Return the provenance of an archive; None where this version does not understand it."""
    try:
        return Provenance.from_dict(json.loads(str(value)))
    except (ValueError, RecursionError):  # of another version, or damaged
        return None


def _rows(data: bytes, path: Path) -> list[tuple[str, float, float, float, str]]:
    """Return the rows of a table: marker, seconds, rms error, bound, and sources."""
    try:
        lines = list(csv.reader(io.StringIO(data.decode("utf-8-sig"), newline="")))
    except (UnicodeDecodeError, csv.Error):
        raise FormatError(f"{path}: is not a table of expected errors; {_REMEDY}") from None
    if not lines or tuple(lines[0]) != COLUMNS:
        raise FormatError(f"{path}: has not the columns of expected errors; {_REMEDY}")
    rows = []
    for number, line in enumerate(lines[1:], start=2):
        try:
            label, _, seconds, rms, bound, sources = line
            rows.append((label, float(seconds), _length(rms), _length(bound), sources))
        except ValueError:
            raise FormatError(f"{path}: line {number} is no row of the table; {_REMEDY}") from None
    return rows


def _length(cell: str) -> float:
    """Return the number of a cell, NaN if it is empty; ValueError where it is no length."""
    length = float(cell) if cell else float("nan")
    if length < 0 or math.isinf(length):
        raise ValueError
    return length


def _of_rows(
    rows: Sequence[tuple[str, float, float, float, str]],
    clip: Clip,
    labels: Sequence[str],
    path: Path,
) -> Uncertainty:
    """Return the uncertainty of a clip from the rows of a table."""
    place = {csv_cell(label): number for number, label in enumerate(labels)}
    rms = np.full((clip.frames, len(labels)), np.nan)
    bound = rms.copy()
    sources = {}
    for label, seconds, one, other, text in rows:
        marker = place.get(label)
        if marker is None:  # of another subject
            continue
        if not -0.5 < seconds * clip.rate < clip.frames - 0.5:
            raise FormatError(
                f"{path}: has an error at {seconds:g} s, beyond the end of {clip.name}; give that "
                "of the same fill"
            )
        at = round(seconds * clip.rate)  # files of other formats may number frames otherwise
        rms[at, marker], bound[at, marker] = one, other
        sources[clip.labels[marker], at] = text
    return Uncertainty(rms, bound, sources)
