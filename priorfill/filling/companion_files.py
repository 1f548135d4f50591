"""Files that belong to an output and are written with it: both appear, or neither.

A derivative of BIDS has a mask, errors and side files, a file for OpenSim a table of what was
estimated.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from priorfill.filling.bids_derivative import (
    check_derivative,
    derivative_companions,
    write_derivative,
)
from priorfill.filling.opensim_estimates import estimates_path, estimates_table
from priorfill.filling.result import Result
from priorfill.runtime.atomic_file import check_target, replace_file

__all__ = ["check_companions", "companion_files", "write_companions"]


def companion_files(output: Path, source: Path, program: str | None = None) -> tuple[Path, ...]:
    """Return the files that are written next to an output.

    Parameters
    ----------
    output : Path
        The file to write.
    source : Path
        The file that is filled.
    program : str or None
        The program that the output is for.
    """
    if program is not None:
        return (estimates_path(output),)
    return derivative_companions(output, source)


def check_companions(output: Path, source: Path, program: str | None, *, overwrite: bool) -> None:
    """Check before a fill whether the files next to its output can be written.

    Parameters
    ----------
    output, source, program
        As for `companion_files`.
    overwrite : bool
        Whether existing files may be replaced.

    Raises
    ------
    OptionError
        If a derivative would be in a dataset of raw recordings.
    OutputError
        If a file exists already, or cannot be written.
    """
    if program is not None:
        check_target(estimates_path(output), overwrite=overwrite, source=source)
    else:
        check_derivative(output, source, overwrite=overwrite)


@contextmanager
def write_companions(
    output: Path | None,
    result: Result,
    *,
    place: Path | None = None,
    program: str | None = None,
    overwrite: bool,
) -> Iterator[tuple[Path, ...]]:
    """Write the files next to an output; they appear when the block ends without error.

    Parameters
    ----------
    output : Path or None
        The file that the block writes; None after a dry run.
    result : Result
        The fill.
    place : Path or None
        Where the output will be, if `output` is a temporary place.
    program : str or None
        The program that the output is for.
    overwrite : bool
        Replace existing files.

    Yields
    ------
    tuple of Path
        The files.

    Raises
    ------
    OutputError
        If a file exists already or cannot be written.
    """
    if output is None or program is None:
        with write_derivative(output, result, place=place, overwrite=overwrite) as files:
            yield files
        return
    path = estimates_path(output)
    with replace_file(path, overwrite=overwrite) as temporary:
        temporary.write_bytes(estimates_table(result))
        yield (path,)
