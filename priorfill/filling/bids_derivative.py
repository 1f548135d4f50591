"""What belongs to a filled recording in a derivative dataset of BIDS.

::

    derivatives/priorfill/dataset_description.json  README  descriptions.tsv  .bidsignore
    derivatives/priorfill/desc-filled_mask.json  desc-filled_error.json
    derivatives/priorfill/sub-01/motion/sub-01_task-walk_tracksys-omc_desc-filled_motion.tsv  .json
                                        ..._channels.tsv  .json  ..._mask.tsv  ..._error.tsv

The name of the output decides: a recording with ``desc-`` is a derivative.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill import formats
from priorfill.filling.derivative_dataset import (
    check_dataset,
    describe_dataset,
    source_address,
)
from priorfill.filling.provenance import package_versions
from priorfill.filling.result import Result
from priorfill.formats.bids.create_motion import json_bytes
from priorfill.formats.bids.names import (
    derivative_path,
    is_derivative,
    is_motion,
    sibling,
    side_files,
)
from priorfill.formats.bids.side_files import SideFiles, read_side_files
from priorfill.formats.bids.tracked_points import find_tracked_points
from priorfill.gp.calibration import MEAN_FACTOR
from priorfill.runtime.atomic_file import check_target, replace_file

__all__ = ["check_derivative", "derivative_companions", "derivative_output", "write_derivative"]

_DECIMALS = 3
"""Of errors, in mm."""

_ERRORS = ("expected_mean_error_mm", "error_bound_90_mm")
"""Columns of a tracked point in the table of errors."""

_COMPANIONS = (
    ("motion", ".json"),
    ("channels", ".tsv"),
    ("channels", ".json"),
    ("mask", ".tsv"),
    ("error", ".tsv"),
)
"""Suffixes and extensions of the files next to a filled recording."""


def derivative_output(source: Path, output: Path) -> Path:
    """Return the file to write; in a folder the place that BIDS has for a filled recording.

    Parameters
    ----------
    source : Path
        The file that is filled.
    output : Path
        The file to write; for a recording of Motion-BIDS also the root of a derivative dataset: a
        folder, or a name without a suffix.
    """
    if output.suffix and not output.is_dir():
        return output
    if is_motion(source) and source.is_file() and formats.format_of(source) == "bids":
        return derivative_path(source, output)
    return output


def _is_bids_derivative(output: Path, source: Path) -> bool:
    """Check whether an output is a filled recording of a derivative dataset."""
    known = formats.format_of(source) if source.is_file() else None
    return is_derivative(output) and formats.output_format(output, known) == "bids"


def check_derivative(output: Path, source: Path, *, overwrite: bool) -> None:
    """Check before a fill whether the files of a derivative can be written; else do nothing.

    Parameters
    ----------
    output : Path
        The file to write.
    source : Path
        The file that is filled.
    overwrite : bool
        Whether existing files may be replaced.

    Raises
    ------
    OptionError
        If the output would be in the dataset of raw recordings.
    OutputError
        If a file exists already, or cannot be written.
    """
    if not _is_bids_derivative(output, source):
        return
    check_dataset(output)
    for path in derivative_companions(output, source):
        check_target(path, overwrite=overwrite, source=source)


def derivative_companions(output: Path, source: Path) -> tuple[Path, ...]:
    """Return the files that are written next to an output; none but for a derivative.

    Parameters
    ----------
    output : Path
        The file to write.
    source : Path
        The file that is filled.
    """
    if not _is_bids_derivative(output, source):
        return ()
    ends = list(_COMPANIONS)
    if formats.format_of(source) == "bids" and not side_files(source, "channels", ".json"):
        ends.remove(("channels", ".json"))
    return tuple(sibling(output, suffix, extension) for suffix, extension in ends)


@contextmanager
def write_derivative(
    output: Path | None, result: Result, *, place: Path | None = None, overwrite: bool
) -> Iterator[tuple[Path, ...]]:
    """Write what belongs to a filled recording; the files appear when the block ends without error.

    Parameters
    ----------
    output : Path or None
        The filled recording, which the block writes; nothing is done for one of another kind.
    result : Result
        The fill.
    place : Path or None
        Where the recording will be, if `output` is a temporary place.
    overwrite : bool
        Replace existing files.

    Yields
    ------
    tuple of Path
        The files next to the recording.

    Raises
    ------
    OutputError
        If a file exists already or cannot be written.
    """
    source = result.clip.source
    if output is None or source is None or not _is_bids_derivative(output, source.path):
        yield ()
        return
    side = read_side_files(source.path) if source.format == "bids" else None
    place = output if place is None else place
    contents = _contents(output, place, result, side)
    with ExitStack() as stack:
        for path, content in contents.items():
            stack.enter_context(replace_file(path, overwrite=overwrite)).write_bytes(content)
        yield derivative_companions(output, source.path)
    describe_dataset(place, source.path if side is not None else None)


def _contents(
    output: Path, place: Path, result: Result, side: SideFiles | None
) -> dict[Path, bytes]:
    """Return the files next to a filled recording with their contents.

    The side files of a new recording are written with it.
    """
    clip = result.clip
    count = 3 * len(clip.labels)
    columns = np.arange(count).reshape(-1, 3)
    contents: dict[Path, bytes] = {}
    if side is not None and clip.source is not None:
        points = find_tracked_points(side.channels, side.channels_file.name)
        columns = np.array(points.columns)[list(clip.source.points)]
        count = len(side.channels)
        version = package_versions()["priorfill"]
        added: dict[str, Any] = {
            "Description": f"Gaps filled by priorfill {version} (method {result.method})."
        }
        if address := source_address(place, clip.source.path):
            added["Sources"] = [address]
        contents = _copied_side_files(output, clip.source.path, side, added)
    contents[sibling(output, "mask", ".tsv")] = _mask_table(result, columns, count)
    contents[sibling(output, "error", ".tsv")] = _error_table(result)
    return contents


def _copied_side_files(
    output: Path, source: Path, side: SideFiles, added: Mapping[str, Any]
) -> dict[Path, bytes]:
    """Return the side files of a recording for its filled copy, with all that they inherit."""
    contents = {
        sibling(output, "channels", ".tsv"): side.channels_file.read_bytes(),
        sibling(output, "motion", ".json"): json_bytes({**side.motion, **added}),
    }
    if side_files(source, "channels", ".json"):
        contents[sibling(output, "channels", ".json")] = json_bytes(dict(side.channel_fields))
    return contents


def _mask_table(result: Result, columns: NDArray[np.intp], count: int) -> bytes:
    """Return a table of 0 and 1 with the columns of the recording."""
    filled = np.zeros((result.clip.frames, count), dtype=np.uint8)
    for marker, where in enumerate(columns):
        filled[:, where] = result.filled[:, marker, None]
    table = np.full((result.clip.frames, 2 * count), ord("\t"), dtype=np.uint8)
    table[:, ::2] = ord("0") + filled
    table[:, -1] = ord("\n")
    return table.tobytes()


def _error_table(result: Result) -> bytes:
    """Return a table of the expected errors (mm) with a header."""
    labels = result.clip.labels
    titles = [f"{label}_{what}" for label in labels for what in _ERRORS]
    errors = np.stack([MEAN_FACTOR * result.expected_rms_mm, result.error_bound_90_mm], axis=2)
    errors[~result.filled] = np.nan
    lines = ["\t".join(titles)]
    nothing = "\t".join(["n/a"] * len(titles))
    for row in errors.reshape(result.clip.frames, len(titles)):
        if np.isnan(row).all():
            lines.append(nothing)
        else:
            cells = (f"{value:.{_DECIMALS}f}" if np.isfinite(value) else "n/a" for value in row)
            lines.append("\t".join(cells))
    return "".join(f"{line}\n" for line in lines).encode()
