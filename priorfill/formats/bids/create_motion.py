"""Write a clip as a new recording of Motion-BIDS with its side files."""

from __future__ import annotations

import json
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import OptionError, OutputError
from priorfill.formats.bids.motion_tsv import parse_motion
from priorfill.formats.bids.names import BidsName, new_motion_fault, sibling
from priorfill.formats.bids.side_files import UP_AXIS, Channel, SideFiles
from priorfill.formats.tables.new_table import position_rows, report_of_new_table
from priorfill.formats.write_report import WriteReport, check_filled
from priorfill.runtime.atomic_file import check_target, replace_file

__all__ = ["create_motion", "json_bytes", "new_side_files"]

_UNIT = "mm"

_FRAME = "lab"
"""Name of the reference frame: the axes of the input."""

_TITLES = ("name", "component", "type", "tracked_point", "units", "reference_frame")


def create_motion(
    path: Path | str,
    clip: Clip,
    filled: NDArray[np.bool_] | None = None,
    *,
    overwrite: bool = False,
) -> WriteReport:
    """Write a clip as a new recording in mm and in the clip's axes, with its side files.

    Missing samples are ``n/a``. The side files have the recording's entities.

    Parameters
    ----------
    path : Path or str
        The recording to write. Its name states subject, task and tracking system.
    clip : Clip
        The clip.
    filled : ndarray [shape=(frames, markers), bool] or None
        Which samples were filled; the file does not mark them.
    overwrite : bool
        Replace existing files.

    Returns
    -------
    WriteReport
        The number of filled samples, and the rounding error.

    Raises
    ------
    OptionError
        If the name lacks an entity that BIDS requires.
    OutputError
        If a file exists already or cannot be written, a filled sample has no position, or a label
        cannot be written.
    """
    path = Path(str(path))  # as in `check_target`
    if fault := new_motion_fault(path):
        raise OptionError(f"{path}: {fault}")
    written = check_filled(clip, filled)
    _check_labels(clip)
    side = new_side_files(path, clip)
    for other in (path, *side):
        check_target(other, overwrite=overwrite)
    text = "".join(f"{row}\n" for row in position_rows(clip, written, "n/a"))
    with ExitStack() as stack:
        # the one that is entered first appears last
        temporary = stack.enter_context(replace_file(path, overwrite=overwrite))
        temporary.write_bytes(text.encode())
        for other, content in side.items():
            stack.enter_context(replace_file(other, overwrite=overwrite)).write_bytes(content)
        again = parse_motion(
            temporary.read_bytes(), path.name, _side_files_of(clip, path)
        ).recording
        return report_of_new_table(path, again, clip, written)


def new_side_files(path: Path, clip: Clip) -> dict[Path, bytes]:
    """Return the side files of a new recording with their contents.

    Parameters
    ----------
    path : Path
        The recording.
    clip : Clip
        What it holds.
    """
    lines = [_TITLES, *(_cells(channel) for channel in _channels(clip))]
    table = "".join("\t".join(cells) + "\n" for cells in lines)
    level = {"Description": f"Axes of the laboratory; {clip.up} points up.", UP_AXIS: clip.up}
    return {
        sibling(path, "channels", ".tsv"): table.encode(),
        sibling(path, "channels", ".json"): json_bytes(
            {"reference_frame": {"Levels": {_FRAME: level}}}
        ),
        sibling(path, "motion", ".json"): json_bytes(_fields(path, clip)),
    }


def json_bytes(fields: dict[str, Any]) -> bytes:
    """Return the contents of a JSON file."""
    return (json.dumps(fields, indent=2, ensure_ascii=False) + "\n").encode()


def _fields(path: Path, clip: Clip) -> dict[str, Any]:
    """Return the fields of ``_motion.json``."""
    name = BidsName.parse(path.name)
    return {
        "TaskName": name.label("task"),
        "SamplingFrequency": clip.rate,
        "TrackingSystemName": name.label("tracksys"),
        "MotionChannelCount": 3 * len(clip.labels),
        "POSChannelCount": 3 * len(clip.labels),
        "TrackedPointsCount": len(clip.labels),
        "RecordingDuration": clip.frames / clip.rate,
        "MissingValues": "n/a",
    }


def _channels(clip: Clip) -> list[Channel]:
    """Return the channels of a clip: X, Y and Z of each marker."""
    return [
        Channel("POS", axis, label, _UNIT, _FRAME, name=f"{label}_{axis}")
        for label in clip.labels
        for axis in "xyz"
    ]


def _cells(channel: Channel) -> tuple[str, ...]:
    """Return a channel's line of ``_channels.tsv``."""
    return (
        channel.name,
        channel.component,
        channel.kind,
        channel.tracked_point,
        channel.units,
        channel.frame,
    )


def _side_files_of(clip: Clip, path: Path) -> SideFiles:
    """Return what the side files of a clip state."""
    channels = sibling(path, "channels", ".tsv")
    return SideFiles(tuple(_channels(clip)), channels, {"SamplingFrequency": clip.rate}, {})


def _check_labels(clip: Clip) -> None:
    """Raise OutputError at a label that a table without quotes cannot hold."""
    for label in clip.labels:
        if not label or label.lower() == "n/a" or set(label) & set('\t\r\n"\0'):
            raise OutputError(
                f"{clip.name}: Motion-BIDS cannot hold the label {label!r}; rename the marker"
            )
