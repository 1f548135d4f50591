"""Write the summary of a study: a page, a JSON file and two tables."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from priorfill.errors import OutputError
from priorfill.report.report_file import REPORT_SUFFIXES
from priorfill.runtime.atomic_file import check_target, check_writable, replace_file
from priorfill.runtime.option_checks import check_suffix
from priorfill.study.job import JobOutcome
from priorfill.study.summary.as_json import FORMAT, summary_json
from priorfill.study.summary.as_page import PAGE_MARK, summary_page
from priorfill.study.summary.as_tables import (
    MARKER_COLUMNS,
    TRIAL_COLUMNS,
    write_marker_table,
    write_trial_table,
)
from priorfill.study.summary.limits import SummaryLimits
from priorfill.study.summary.summarise import StudyContents, StudySummary, summarise_study

__all__ = ["SummaryFiles", "check_summary", "write_summary"]

HEAD_BYTES = 4096
"""Bytes of a file that show whether it is a summary."""


@dataclass(frozen=True)
class SummaryFiles:
    """The files of a summary.

    Attributes
    ----------
    page, json, trials, markers : Path
        The page (HTML), all figures (JSON), the tables of trials and of their markers (CSV).
    problems : tuple of str
        Why some of them could not be written.
    """

    page: Path
    json: Path
    trials: Path
    markers: Path
    problems: tuple[str, ...] = ()

    @classmethod
    def at(cls, path: Path | str) -> SummaryFiles:
        """Return the files of a summary whose page is at a path."""
        page = Path(str(path))
        return cls(
            page=page,
            json=page.with_suffix(".json"),
            trials=page.with_suffix(".csv"),
            markers=page.with_name(f"{page.stem}_markers.csv"),
        )

    @property
    def all(self) -> tuple[Path, ...]:
        """All files, the page last."""
        return self.json, self.trials, self.markers, self.page


def check_summary(path: Path | str, *, overwrite: bool = False) -> SummaryFiles:
    """Check before a study whether its summary can be written.

    Files of a summary may be replaced, others not: a table next to the page may be a recording.

    Parameters
    ----------
    path : Path or str
        The page, ``.html``.
    overwrite : bool
        Whether another file of the name of the page may be replaced.

    Raises
    ------
    OptionError
        If the suffix is another one.
    OutputError
        If the folder takes no files, or a file exists that is not of a summary.
    """
    check_suffix(Path(str(path)), "a summary", REPORT_SUFFIXES)
    files = SummaryFiles.at(path)
    for file in files.all:
        if file != files.page and file.exists() and not _is_ours(file, files):
            raise OutputError(
                f"{file}: exists already, and is not of a summary; give the summary another name"
            )
        check_target(file, overwrite=overwrite or _is_ours(file, files))
    check_writable(files.page, 0)
    return files


def write_summary(
    outcomes: Iterable[JobOutcome],
    path: Path | str,
    *,
    limits: SummaryLimits | None = None,
    contents: StudyContents | None = None,
    overwrite: bool = False,
) -> tuple[StudySummary, SummaryFiles]:
    """Write the summary of a study: a page, a JSON file and two tables with the same stem.

    Each file appears completely or not at all. A table that cannot be written, for instance because
    it is open in a spreadsheet program on Windows, does not keep the page from being written.

    Parameters
    ----------
    outcomes : iterable of JobOutcome
        Of the study, in any order.
    path : Path or str
        The page, ``.html``.
    limits : SummaryLimits, optional
        From which values on a trial needs a hand.
    contents : StudyContents, optional
        What else is known of the study.
    overwrite : bool
        Replace another file of the name of the page, too.

    Returns
    -------
    StudySummary
        The summary.
    SummaryFiles
        The files, and why some of them could not be written.

    Raises
    ------
    OptionError
        If the suffix is another one.
    OutputError
        If the page cannot be written, or a file exists that is not of a summary.

    Examples
    --------
    >>> import tempfile
    >>> lost = JobOutcome("b.c3d", "/in/b.c3d", "/out/b.c3d", "failed", reason="no markers")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     summary, files = write_summary([lost], f"{folder}/summary.html")
    ...     [file.name for file in files.all if file.stat().st_size]
    ['summary.json', 'summary.csv', 'summary_markers.csv', 'summary.html']
    """
    files = check_summary(path, overwrite=overwrite)
    summary = summarise_study(outcomes, limits, contents)
    values = summary_json(summary, files.page.absolute().parent)
    problems = []
    for file, write in _writers(files, values).items():
        try:
            with replace_file(file, overwrite=True) as temporary:
                write(temporary)
        except OutputError as error:
            if file == files.page:
                raise
            problems.append(str(error))
    return summary, replace(files, problems=tuple(problems))


def _writers(
    files: SummaryFiles, values: Mapping[str, Any]
) -> dict[Path, Callable[[Path], object]]:
    """Return what writes each file."""
    return {
        files.json: lambda file: file.write_bytes(_json_text(values).encode("ascii")),
        files.trials: lambda file: write_trial_table(file, values),
        files.markers: lambda file: write_marker_table(file, values),
        files.page: lambda file: file.write_bytes(summary_page(values).encode("utf-8")),
    }


def _json_text(values: Mapping[str, Any]) -> str:
    """Return JSON with a line for each value, and for each entry of a list."""
    lines = []
    for name, value in values.items():
        if isinstance(value, list) and value:
            entries = ",\n".join(json.dumps(entry, allow_nan=False) for entry in value)
            text = f"[\n{entries}\n]"
        else:
            text = json.dumps(value, allow_nan=False)
        lines.append(f"{json.dumps(name)}: {text}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _is_ours(file: Path, files: SummaryFiles) -> bool:
    """Return whether an existing file is that of a summary."""
    marks = {
        files.page: PAGE_MARK,
        files.json: json.dumps(FORMAT),
        files.trials: ",".join(TRIAL_COLUMNS[:4]),
        files.markers: ",".join(MARKER_COLUMNS[:4]),
    }
    if not file.is_file():  # nor a device, which might not answer
        return False
    try:
        with file.open("rb") as opened:
            return marks[file].encode() in opened.read(HEAD_BYTES)
    except OSError:
        return False
