"""TRC (track row column) files of OpenSim and Motion Analysis (EVaRT, Cortex).

::

    PathFileType  4  (X/Y/Z)  walk.trc
    DataRate  CameraRate  NumFrames  NumMarkers  Units  OrigDataRate  OrigDataStartFrame  ...
    120.00    120.00      900        41          mm     120.00        1                   ...
    Frame#  Time  LTOE            RTOE ...
                  X1   Y1   Z1    X2 ...
                                                            (blank line, optional)
    1       0.000 12.3 45.6 78.9  ...

Cells are separated by tabs; in some files by blanks.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import ClipError, FormatError, OutputError
from priorfill.formats.recording import Recording
from priorfill.formats.tables.text_table import (
    BLANKS,
    TableRecording,
    cells_of,
    count_notes,
    find_rate,
    frame_numbers,
    header_number,
    read_table,
    split_lines,
    texts_of,
)
from priorfill.formats.write_report import WriteReport, check_filled
from priorfill.runtime.atomic_file import replace_file

__all__ = ["create_trc", "parse_trc", "recognise_trc"]

_MAX_HEADER_LINES = 30
"""Lines in which the header is searched."""

_FIRST_COORDINATE = 2
"""Cell of the first coordinate, after frame and time."""

_DECIMALS = 6
"""Decimals in a new file (nm), finer than the 32 bit floats of C3D."""

_STEP = 10.0**-_DECIMALS
"""mm."""


def recognise_trc(head: bytes) -> bool:
    """Check whether a file is TRC by its first bytes."""
    return re.search(rb"^(PathFileType|DataRate)[ \t]", head, re.MULTILINE) is not None


def parse_trc(data: bytes, name: str) -> TableRecording:
    """Parse the contents of a TRC file.

    Raises
    ------
    FormatError
        If it is not TRC, or damaged.
    ClipError
        If it has no frames.
    """
    lines = split_lines(data, name)
    names_row = _names_row(lines, name)
    rows = [
        row
        for row in range(names_row + 1, len(lines))
        if lines[row].strip() and lines[row].strip()[:1] not in b"Xx"
    ]
    if not rows:
        raise ClipError(f"{name}: has no frames after line {names_row + 1}; export it again")
    delimiter = b"\t" if b"\t" in lines[rows[0]] else BLANKS
    labels, columns = _markers(lines, names_row, rows[0], delimiter, name)
    positions, table = read_table(lines, rows, columns, labels, delimiter, name)
    header = _header(lines, names_row)
    cells = [cells_of(lines[row], delimiter) for row in rows]
    first, notes = frame_numbers([row_cells[0] for row_cells in cells], rows, name)
    notes += count_notes(
        (header.get("numframes"), len(rows)), (header.get("nummarkers"), len(labels))
    )
    times = [row_cells[1] for row_cells in cells if len(row_cells) > 1]
    rate, rate_notes = find_rate(header_number(header.get("datarate")), times, name)
    return TableRecording(
        Recording(
            positions,
            tuple(labels),
            rate,
            header.get("units", ""),
            first_frame=first,
            default_up="+Y",
            notes=(*notes, *rate_notes),
        ),
        table,
    )


def create_trc(
    path: Path | str,
    clip: Clip,
    filled: NDArray[np.bool_] | None = None,
    *,
    overwrite: bool = False,
) -> WriteReport:
    """Write a clip as a new TRC file in mm and in the clip's axes; missing cells are blank.

    Parameters
    ----------
    path : Path or str
        The file to write.
    clip : Clip
        The clip.
    filled : ndarray [shape=(frames, markers), bool] or None
        Which samples were filled; the file does not mark them.
    overwrite : bool
        Replace an existing file.

    Returns
    -------
    WriteReport
        The number of filled samples, and the rounding error.

    Raises
    ------
    OutputError
        If the file exists already or cannot be written, or a filled sample has no position.
    """
    written = check_filled(clip, filled)
    for label in clip.labels:
        if not label or set(label) & set("\t\r\n"):
            raise OutputError(
                f"{clip.name}: a TRC file cannot hold the label {label!r}; rename the marker"
            )
    rate = f"{clip.rate:.12g}"
    count, frames = len(clip.labels), clip.frames
    head = [
        f"PathFileType\t4\t(X/Y/Z)\t{Path(path).name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits"
        "\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate}\t{rate}\t{frames}\t{count}\tmm\t{rate}\t{clip.first_frame}\t{frames}",
        "Frame#\tTime\t" + "\t\t\t".join(clip.labels) + "\t\t",
        "\t\t" + "\t".join(f"X{n}\tY{n}\tZ{n}" for n in range(1, count + 1)),
        "",
    ]
    positions = clip.positions.copy()
    at_origin = written & (np.abs(positions).max(axis=2) < _STEP)
    positions[at_origin] = (0, 0, _STEP)  # (0, 0, 0) would read as missing
    body = [
        f"{clip.first_frame + frame}\t{frame / clip.rate:.{_DECIMALS}f}\t"
        + "\t".join("" if value != value else f"{value:.{_DECIMALS}f}" for value in row)
        for frame, row in enumerate(positions.reshape(frames, -1).tolist())
    ]
    with replace_file(path, overwrite=overwrite) as temporary:
        temporary.write_bytes("".join(f"{line}\r\n" for line in head + body).encode())
        again = parse_trc(temporary.read_bytes(), temporary.name).recording
        if again.labels != clip.labels or not np.allclose(
            again.positions, clip.positions, rtol=0, atol=2 * _STEP, equal_nan=True
        ):
            raise OutputError(
                f"{path}: the file does not read back as intended and was removed; "
                "check the folder's permissions and space"
            )
    worst = np.abs(again.positions - clip.positions)[written]
    return WriteReport(samples=int(written.sum()), rounding_mm=float(worst.max(initial=0.0)))


def _names_row(lines: list[bytes], name: str) -> int:
    """Return the line with the markers' names."""
    for row, line in enumerate(lines[:_MAX_HEADER_LINES]):
        if re.match(rb"(\xef\xbb\xbf)?\s*Frame#?\s", line, re.IGNORECASE):
            return row
    raise FormatError(
        f"{name}: is not a TRC file (no line 'Frame# Time ...' among its first "
        f"{_MAX_HEADER_LINES}); check the file"
    )


def _header(lines: list[bytes], names_row: int) -> dict[str, str]:
    """Return the header's values by name in lower case."""
    for row in range(names_row - 1):
        delimiter = b"\t" if b"\t" in lines[row] else BLANKS
        keys = [key.lower() for key in texts_of(lines[row], delimiter)]
        if "datarate" in keys:
            values = texts_of(lines[row + 1], delimiter)
            if len(values) < len(keys):  # some programs separate some of the values by blanks
                values = texts_of(lines[row + 1], BLANKS)
            return dict(zip(keys, values, strict=False))
    return {}


def _markers(
    lines: list[bytes], names_row: int, first_row: int, delimiter: bytes, name: str
) -> tuple[list[str], list[list[int]]]:
    """Return labels, and the cells of their coordinates."""
    line = lines[names_row]
    cells = texts_of(line, b"\t" if b"\t" in line else BLANKS)
    places = [cell for cell in range(_FIRST_COORDINATE, len(cells)) if cells[cell]]
    labels = [cells[place] for place in places]
    if not labels:
        raise FormatError(f"{name}: line {names_row + 1} names no markers; export it again")
    # a name stands above its X; names without empty cells between them are in order
    spread = len(places) > 1 and min(np.diff(places)) >= 3
    starts = (
        places if spread and delimiter else [_FIRST_COORDINATE + 3 * k for k in range(len(labels))]
    )
    width = len(cells_of(lines[first_row].rstrip(), delimiter))
    if width > starts[-1] + 3:
        raise FormatError(
            f"{name}: line {first_row + 1} has {width} cells, but line {names_row + 1} names "
            f"{len(labels)} markers, which take {starts[-1] + 3}; name all markers"
        )
    return labels, [[start, start + 1, start + 2] for start in starts]
