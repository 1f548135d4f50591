"""Write the expected error of each filled sample: as a NumPy archive or as a table."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from priorfill.runtime.argument_types import check_path, check_result
from priorfill.runtime.atomic_file import check_target, check_writable, replace_file
from priorfill.runtime.display import csv_cell
from priorfill.runtime.npz_file import save_arrays
from priorfill.runtime.option_checks import check_suffix

if TYPE_CHECKING:
    from priorfill.filling.result import Result

__all__ = ["UNCERTAINTY_SUFFIXES", "check_uncertainty", "uncertainty_file", "write_uncertainty"]

UNCERTAINTY_SUFFIXES = (".npz", ".csv")
"""Suffixes of the files that can be written, lower case."""

COLUMNS = ("marker", "frame", "time_s", "expected_rms_mm", "error_bound_90_mm", "sources")
"""Columns of the table."""


def check_uncertainty(
    path: Path | str,
    *,
    source: Path | None = None,
    overwrite: bool = False,
) -> None:
    """Check before a fill whether its uncertainty can be written.

    Parameters
    ----------
    path : Path or str
        The file to write.
    source : Path or None
        The file that is read, if any; `path` must be another.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    OptionError
        If the format is unknown.
    OutputError
        If the folder takes no files, or the file exists already or is the one that is read.
    """
    path = Path(str(path))  # as in `check_target`
    check_suffix(path, "the uncertainty", UNCERTAINTY_SUFFIXES)
    check_target(path, overwrite=overwrite, source=source)
    check_writable(path, 0)


@contextmanager
def uncertainty_file(
    path: Path | str, result: Result, *, overwrite: bool = False
) -> Iterator[None]:
    """Write the uncertainty of a result; the file appears when the block ends without an error.

    So it can be written together with another file: either both appear, or neither.

    Parameters
    ----------
    path : Path or str
        The file to write; its suffix, .npz or .csv, selects the format.
    result : Result
        Of a fill.
    overwrite : bool
        Replace an existing file.

    Raises
    ------
    OptionError
        If the suffix is another one.
    OutputError
        If the file exists already or cannot be written.
    """
    path = Path(str(path))  # as in `check_target`
    check_suffix(path, "the uncertainty", UNCERTAINTY_SUFFIXES)
    with replace_file(path, overwrite=overwrite) as temporary:
        if path.suffix.lower() == ".csv":
            _save_table(temporary, result)
        else:
            _save_npz(temporary, result)
        yield


def write_uncertainty(path: Path | str, result: Result, *, overwrite: bool = False) -> None:
    """Write the expected error of each filled sample of a result.

    An .npz file has arrays ``expected_rms_mm`` and ``error_bound_90_mm`` [shape=(frames, markers)],
    ``filled``, ``labels``, ``frames``, ``rate``, ``unit`` and the provenance as JSON; a .csv file
    has a row for each filled sample. docs/cli.md describes both.

    Parameters
    ----------
    path : Path or str
        The file to write; its suffix, .npz or .csv, selects the format.
    result : Result
        Of a fill.
    overwrite : bool
        Replace an existing file.

    Raises
    ------
    OptionError
        If the suffix is another one.
    OutputError
        If the file exists already or cannot be written.

    See Also
    --------
    priorfill.write : Write the filled clip.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import priorfill as pf
    >>> from priorfill.synthetic.demo import make_demo_clip
    >>> result = pf.fill(make_demo_clip()[1], method="linear")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pf.write_uncertainty(f"{folder}/walk.npz", result)
    ...     with np.load(f"{folder}/walk.npz") as archive:
    ...         bool((archive["filled"] == result.filled).all())
    True
    """
    check_path("path", path)
    check_result(result)
    with uncertainty_file(path, result, overwrite=overwrite):
        pass


def _save_npz(path: Path, result: Result) -> None:
    """Write arrays over all samples."""
    clip = result.clip
    save_arrays(
        path,
        {
            "labels": clip.labels,
            "frames": clip.first_frame + np.arange(clip.frames),
            "rate": clip.rate,
            "filled": result.filled,
            "expected_rms_mm": result.expected_rms_mm,
            "error_bound_90_mm": result.error_bound_90_mm,
            "unit": "mm",
            "provenance": json.dumps(result.provenance.to_dict()),
        },
    )


def _save_table(path: Path, result: Result) -> None:
    """Write a row for each filled sample, gap by gap."""
    clip = result.clip
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for gap in result.gaps:
            marker = clip.labels.index(gap.label)
            sources = csv_cell("; ".join(gap.sources))
            for frame in range(gap.start, gap.stop):
                if result.filled[frame, marker]:
                    writer.writerow(
                        (
                            csv_cell(gap.label),
                            clip.first_frame + frame,
                            f"{frame / clip.rate:.6f}",
                            _number(result.expected_rms_mm[frame, marker]),
                            _number(result.error_bound_90_mm[frame, marker]),
                            sources,
                        )
                    )


def _number(value: float) -> str:
    """Return a length (mm) for the table; empty where it is unknown."""
    return f"{value:.3f}" if np.isfinite(value) else ""
