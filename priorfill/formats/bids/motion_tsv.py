"""Recordings of Motion-BIDS: ``*_motion.tsv``, a row for each sample, a column for each channel.

The file has no header. ``*_channels.tsv`` has a line for each column, ``*_motion.json`` the
sampling frequency. Missing numbers are ``n/a``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip, Source
from priorfill.errors import ClipError, FormatError, OutputError
from priorfill.formats.bids.names import BidsName
from priorfill.formats.bids.side_files import SideFiles, number_of_field, read_side_files
from priorfill.formats.bids.tracked_points import TrackedPoints, find_tracked_points
from priorfill.formats.recording import ReadOptions, Recording, clip_from_file
from priorfill.formats.tables.cells import (
    cells_of,
    is_blank,
    join_quoted,
    line_number,
    split_lines,
    texts_of,
)
from priorfill.formats.tables.frames import find_rate
from priorfill.formats.tables.text_table import TableRecording, read_table, write_table
from priorfill.formats.write_report import WriteReport

__all__ = ["copy_motion", "holds_positions", "parse_motion", "read_motion"]

_DELIMITER = b"\t"


def read_motion(path: Path, options: ReadOptions) -> Clip:
    """Read a recording of a BIDS dataset.

    Raises
    ------
    FormatError
        If it or one of its side files is absent or damaged.
    ClipError, OptionError
        As `priorfill.formats.recording.make_clip` does.
    """
    side = read_side_files(path)

    def parse(data: bytes, name: str) -> Recording:
        return parse_motion(data, name, side).recording

    return clip_from_file(path, options, "bids", parse)


def copy_motion(
    path: Path | str, clip: Clip, filled: NDArray[np.bool_], *, overwrite: bool = False
) -> WriteReport:
    """Write a copy of a clip's recording with the cells of the filled samples replaced.

    Side files are not copied.

    Parameters
    ----------
    path, clip, filled, overwrite
        As for `priorfill.formats.tables.text_table.write_table`.

    Raises
    ------
    FormatError, OutputError
        As in `write_table`; also if the channels have changed since the recording was read.
    """
    source = clip.source
    if source is None:
        raise OutputError(f"{clip.name}: comes from no file to copy; write it as a new file")
    side = read_side_files(source.path)
    _check_channels(find_tracked_points(side.channels, side.channels_file.name), source, side)

    def parse(data: bytes, name: str) -> TableRecording:
        return parse_motion(data, name, side)

    return write_table(path, clip, filled, parse, overwrite=overwrite)


def holds_positions(path: Path) -> bool:
    """Check whether a recording has a channel of positions, which those of inertial sensors lack.

    A recording whose side files cannot be read counts as one; reading it reports the reason.
    """
    try:
        return any(channel.kind == "POS" for channel in read_side_files(path).channels)
    except FormatError:
        return True


def parse_motion(data: bytes, name: str, side: SideFiles) -> TableRecording:
    """Parse the contents of a recording.

    Parameters
    ----------
    data : bytes
        The contents.
    name : str
        The file's name.
    side : SideFiles
        What its side files state.

    Raises
    ------
    FormatError
        If its columns are not those of the side files, or it is damaged.
    ClipError
        If it has no frames.
    """
    points = find_tracked_points(side.channels, side.channels_file.name)
    lines = join_quoted(split_lines(data, name), _DELIMITER, name)
    rows = [row for row in range(len(lines)) if lines[row].strip(b" \r\n")]
    notes = list(points.notes)
    if texts_of(lines[rows[0]], _DELIMITER) == [channel.name for channel in side.channels]:
        rows = rows[1:]
        notes.append("The first line has the names of the channels, which BIDS does not provide.")
    _check_rows(lines, rows, side, name)
    positions, table = read_table(
        lines, rows, points.columns, points.labels, _DELIMITER, name, len(side.channels),
        scale=np.array(points.scale),
    )  # fmt: skip
    missing = number_of_field(side.motion.get("MissingValues"))
    if missing:  # 0 is left to the options
        positions[positions == missing * np.array(points.scale)] = np.nan
    rate, rate_notes = _rate(side, points, lines, rows)
    filled, mask_notes = _filled_samples(side, points, len(rows))
    subject = BidsName.parse(name).label("sub")
    return TableRecording(
        Recording(
            positions,
            points.labels,
            rate,
            points.unit,
            up=side.up_axis(points.frame),
            subjects=(f"sub-{subject}",) if subject else (),
            not_markers=points.left_out,
            notes=(*notes, *rate_notes, *mask_notes),
            interpolated=filled,
        ),
        table,
    )


def _check_rows(lines: list[bytes], rows: list[int], side: SideFiles, name: str) -> None:
    """Raise an error if there are no frames, gaps between them, or other columns than channels."""
    if not rows:
        raise ClipError(f"{name}: has no frames; export it again")
    if rows[-1] - rows[0] >= len(rows):
        raise FormatError(
            f"{name}: has an empty line between its samples; delete it, or fill it with n/a"
        )
    channels = len(side.channels)
    for row in rows:
        cells = cells_of(lines[row], _DELIMITER)
        if len(cells) != channels and (len(cells) < channels or not _are_blank(cells[channels:])):
            raise FormatError(
                f"{name}: line {line_number(lines, row)} has {len(cells)} columns, and "
                f"{side.channels_file.name} names {channels} channels; correct one of them"
            )


def _are_blank(cells: list[bytes]) -> bool:
    """Check whether no cell has content."""
    return all(is_blank(cell) for cell in cells)


def _rate(
    side: SideFiles, points: TrackedPoints, lines: list[bytes], rows: list[int]
) -> tuple[float | None, list[str]]:
    """Return the frame rate (Hz), None if it is unknown, and notes."""
    nominal = number_of_field(side.motion.get("SamplingFrequency"))
    effective = number_of_field(side.motion.get("SamplingFrequencyEffective"))
    notes = []
    if effective is not None and effective > 0:
        if nominal is not None and nominal != effective:
            notes.append(
                f"SamplingFrequencyEffective, {effective:.6g} Hz, is used instead of "
                f"SamplingFrequency, {nominal:.6g} Hz."
            )
        nominal = effective
    own = {side.channels[column].rate for point in points.columns for column in point} - {None}
    if nominal is None and len(own) == 1:
        nominal = own.pop()
    elif own - {nominal, number_of_field(side.motion.get("SamplingFrequency"))}:
        notes.append(
            f"{side.channels_file.name} states other sampling frequencies for some positions; "
            "they are ignored."
        )
    latency = [k for k, channel in enumerate(side.channels) if channel.kind == "LATENCY"]
    times: list[bytes] = []
    if len(latency) == 1:
        cells = [cells_of(lines[row], _DELIMITER) for row in rows]
        times = [row[latency[0]] for row in cells if len(row) > latency[0]]
    rate, more = find_rate(nominal, times)
    return rate, notes + more


def _filled_samples(
    side: SideFiles, points: TrackedPoints, frames: int
) -> tuple[NDArray[np.bool_] | None, list[str]]:
    """Return which samples a mask marks as filled [shape=(frames, points)], and notes."""
    if not side.mask:
        return None, []
    channels = len(side.channels)
    cells = np.frombuffer(side.mask.replace(b"\r\n", b"\n").rstrip() + b"\n", dtype=np.uint8)
    if len(cells) == 2 * frames * channels:
        table = cells.reshape(frames, 2 * channels)
        marks, separators = table[:, ::2], table[:, 1::2]
        ends = np.array([ord("\t")] * (channels - 1) + [ord("\n")])
        if np.isin(marks, (ord("0"), ord("1"))).all() and (separators == ends).all():
            return (marks == ord("1"))[:, points.columns].any(axis=2), []
    return None, ["Its mask does not have 0 or 1 for each sample and is ignored."]


def _check_channels(points: TrackedPoints, source: Source, side: SideFiles) -> None:
    """Raise OutputError if the channels are others than those of the clip."""
    count = len(points.labels)
    labels = tuple(points.labels[point] for point in source.points if point < count)
    if labels != source.point_labels or points.unit != source.unit:
        raise OutputError(
            f"{side.channels_file}: has changed since the recording was read; read and fill it "
            "again"
        )
