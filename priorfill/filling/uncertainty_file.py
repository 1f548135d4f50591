"""Write how far off each filled sample may be: as a NumPy archive or as a table."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from priorfill.errors import FormatError, OutputError
from priorfill.runtime.atomic_file import check_target, replace_file
from priorfill.runtime.npz_file import save_arrays

if TYPE_CHECKING:
    from priorfill.filling.result import Result

__all__ = ["UNCERTAINTY_SUFFIXES", "check_uncertainty", "uncertainty_file", "write_uncertainty"]

UNCERTAINTY_SUFFIXES = (".npz", ".csv")
"""Suffixes of the files that can be written, lower case."""

COLUMNS = ("marker", "frame", "time_s", "deviation_mm", "bound_90_mm", "from")
"""Of the table."""


def check_uncertainty(
    path: Path | str, *, source: Path, output: Path, overwrite: bool = False
) -> None:
    """Find out, before the work is done, whether its uncertainty can be written.

    Parameters
    ----------
    path : Path or str
        The file to write.
    source, output : Path
        The file that will be read and the one for the filled clip; it must be neither.
    overwrite : bool
        Whether it may replace an existing file.

    Raises
    ------
    FormatError
        If the format is unknown.
    OutputError
        If the folder is missing, the file exists already, or is one of the others.
    """
    path = Path(path)
    _check_suffix(path)
    target = check_target(path, overwrite=overwrite, source=source)
    same = target == output.resolve()  # one that does not exist yet has no other names
    if same or (target.exists() and output.exists() and target.samefile(output)):
        raise OutputError(f"{path}: is where the filled clip is to go; choose another name")


@contextmanager
def uncertainty_file(
    path: Path | str, result: Result, *, overwrite: bool = False
) -> Iterator[None]:
    """Write the uncertainty of a result, which appears when the block ends well.

    So it can be written together with something else: both, or none of them.

    Parameters
    ----------
    path : Path or str
        The file to write; its suffix, .npz or .csv, tells the form (docs/cli.md).
    result : Result
        What was filled.
    overwrite : bool
        Replace an existing file.

    Raises
    ------
    FormatError
        If the suffix is another one.
    OutputError
        If the file exists already or cannot be written.
    """
    path = Path(path)
    _check_suffix(path)
    with replace_file(path, overwrite=overwrite) as temporary:
        if path.suffix.lower() == ".csv":
            _save_table(temporary, result)
        else:
            _save_npz(temporary, result)
        yield


def write_uncertainty(path: Path | str, result: Result, *, overwrite: bool = False) -> None:
    """Write how far off each filled sample of a result may be.

    Parameters and errors are those of `uncertainty_file`.
    """
    with uncertainty_file(path, result, overwrite=overwrite):
        pass


def _check_suffix(path: Path) -> None:
    """Raise FormatError if the suffix is none that uncertainty can have."""
    if path.suffix.lower() not in UNCERTAINTY_SUFFIXES:
        raise FormatError(
            f"{path}: the suffix {path.suffix or '(none)'!r} is none for uncertainty; "
            f"use {' or '.join(UNCERTAINTY_SUFFIXES)}"
        )


def _save_npz(path: Path, result: Result) -> None:
    clip = result.clip
    save_arrays(
        path,
        {
            "labels": clip.labels,
            "frames": clip.first_frame + np.arange(clip.frames),
            "rate": clip.rate,
            "filled": result.filled,
            "deviation": result.expected_rms,
            "bound": result.error_bound_90,
            "unit": "mm",
        },
    )


def _save_table(path: Path, result: Result) -> None:
    """Write a line for each filled sample, gap by gap."""
    clip = result.clip
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for gap in result.gaps:
            marker = clip.labels.index(gap.label)
            told = "; ".join(gap.sources)
            for frame in range(gap.start, gap.stop):
                if result.filled[frame, marker]:
                    writer.writerow(
                        (
                            gap.label,
                            clip.first_frame + frame,
                            f"{frame / clip.rate:.6f}",
                            _number(result.expected_rms[frame, marker]),
                            _number(result.error_bound_90[frame, marker]),
                            told,
                        )
                    )


def _number(value: float) -> str:
    """Return a length (mm) for the table; nothing where it is unknown."""
    return f"{value:.3f}" if np.isfinite(value) else ""
