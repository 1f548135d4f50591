"""Files that are written in addition to a filled clip: all of them with it, or none.

Each is checked before the fill, written under a temporary name after it, and renamed when all
others are complete. What writes plots and pages is imported where they are wanted: its 18 modules
take 0.01 s.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from priorfill.errors import SameFileError
from priorfill.filling.overrides_file import check_overrides_file, overrides_file
from priorfill.filling.overrides_template import overrides_template
from priorfill.filling.uncertainty_file import check_uncertainty, uncertainty_file
from priorfill.runtime.atomic_file import is_same_file

if TYPE_CHECKING:
    from collections.abc import Iterator

    from priorfill.clip import Clip
    from priorfill.filling.fill_file import FileOptions
    from priorfill.filling.result import Result

__all__ = [
    "FURTHER_OUTPUTS",
    "FurtherOutput",
    "WhatWasFilled",
    "check_further_outputs",
    "further_outputs",
]


@dataclass(frozen=True, eq=False)
class WhatWasFilled:
    """What further outputs are written from.

    Attributes
    ----------
    result : Result
        The fill; of several subjects merged.
    clips : tuple of Clip
        The clip of each subject as it was read.
    files : FileOptions
        How files are written.
    """

    result: Result
    clips: tuple[Clip, ...]
    files: FileOptions


@dataclass(frozen=True)
class FurtherOutput:
    """A kind of file that is written in addition to a filled clip.

    Attributes
    ----------
    name : str
        The field of `FileOptions` that names the file; None there: it is not written.
    what : str
        What it is, after "is".
    check : callable
        Is called with the path, the source and the options, and raises an error where the file
        cannot be written.
    write : callable
        Is called with the path and what was filled; a context manager that provides the paths of
        the files, which appear when its block ends without an error.
    """

    name: str
    what: str
    check: Callable[[Path, Path, FileOptions], None]
    write: Callable[[Path, WhatWasFilled], AbstractContextManager[tuple[Path, ...]]]


def _check_uncertainty(path: Path, source: Path, files: FileOptions) -> None:
    check_uncertainty(path, source=source, overwrite=files.overwrite)


@contextmanager
def _write_uncertainty(path: Path, filled: WhatWasFilled) -> Iterator[tuple[Path, ...]]:
    with uncertainty_file(path, filled.result, overwrite=filled.files.overwrite):
        yield (path,)


def _check_report(path: Path, source: Path, files: FileOptions) -> None:
    from priorfill.report.report_file import check_report  # few fills need it

    check_report(path, sources=(source,), overwrite=files.overwrite)


@contextmanager
def _write_report(path: Path, filled: WhatWasFilled) -> Iterator[tuple[Path, ...]]:
    from priorfill.report.report_data import PageContents  # few fills need it
    from priorfill.report.report_file import report_file

    contents = PageContents(before=filled.clips)
    with report_file(path, filled.result, contents, overwrite=filled.files.overwrite):
        yield (path,)


def _check_plot(path: Path, source: Path, files: FileOptions) -> None:
    from priorfill.report.plots import check_plot  # few fills need it

    check_plot(path, gaps=files.plot_gaps, source=source, overwrite=files.overwrite)


def _write_plot(path: Path, filled: WhatWasFilled) -> AbstractContextManager[tuple[Path, ...]]:
    from priorfill.report.plots import plot_files  # few fills need it

    files = filled.files
    return plot_files(path, filled.result, gaps=files.plot_gaps, overwrite=files.overwrite)


def _check_overrides(path: Path, source: Path, files: FileOptions) -> None:
    check_overrides_file(path, source=source, overwrite=files.overwrite)


@contextmanager
def _write_overrides(path: Path, filled: WhatWasFilled) -> Iterator[tuple[Path, ...]]:
    template = overrides_template(filled.result)
    with overrides_file(path, template, overwrite=filled.files.overwrite):
        yield (path,)


FURTHER_OUTPUTS = (
    FurtherOutput(
        "uncertainty", "the file for the uncertainty", _check_uncertainty, _write_uncertainty
    ),
    FurtherOutput("plot", "the file for the plot", _check_plot, _write_plot),
    FurtherOutput("report", "the report", _check_report, _write_report),
    FurtherOutput(
        "write_overrides", "the file for the overrides", _check_overrides, _write_overrides
    ),
)
"""The files that can be written in addition, in the order in which they appear."""


def check_further_outputs(source: Path, output: Path | None, files: FileOptions) -> None:
    """Check before a fill whether its further outputs can be written.

    Parameters
    ----------
    source : Path
        The file that is read.
    output : Path or None
        The file for the filled clip, if there is one.
    files : FileOptions
        Which are to be written.

    Raises
    ------
    OptionError
        If a format is unknown, or a package is missing.
    SameFileError
        If a file is the source, or another output.
    OutputError
        If a folder takes no files, or a file exists already.
    """
    taken = [] if output is None else [(_resolved(output), "the file for the filled clip")]
    for kind, path in _wanted(files):
        kind.check(path, source, files)
        target = _resolved(path)
        for other, what in taken:
            if is_same_file(target, other):
                raise SameFileError(f"{path}: is {what}; choose another name")
        taken.append((target, kind.what))


@contextmanager
def further_outputs(
    result: Result, clips: Sequence[Clip], files: FileOptions
) -> Iterator[Mapping[str, tuple[Path, ...]]]:
    """Write the further outputs of a fill; they appear when the block ends without an error.

    Parameters
    ----------
    result : Result
        Of the fill.
    clips : sequence of Clip
        The clip of each subject as it was read.
    files : FileOptions
        Which are to be written.

    Yields
    ------
    mapping of str to tuple of Path
        The files, by the name of the option.
    """
    filled = WhatWasFilled(result, tuple(clips), files)
    with ExitStack() as stack:
        yield {
            kind.name: stack.enter_context(kind.write(path, filled))
            for kind, path in _wanted(files)
        }


def _wanted(files: FileOptions) -> list[tuple[FurtherOutput, Path]]:
    """Return the kinds of files that are to be written, with their paths."""
    given = ((kind, getattr(files, kind.name)) for kind in FURTHER_OUTPUTS)
    # Path(Path("out/C:x")) is C:x in Python 3.11
    return [(kind, Path(str(path))) for kind, path in given if path is not None]


def _resolved(path: Path) -> Path:
    return Path(os.path.realpath(path))
