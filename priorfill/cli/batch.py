"""``priorfill batch``: fill the gaps of all files of a study."""

from __future__ import annotations

import copy
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.exit_status import EXIT_FAILED, EXIT_INCOMPLETE, EXIT_USAGE, is_usage_error
from priorfill.cli.fill import check_database_options, fill, fill_arguments
from priorfill.cli.option_types import every_row_option
from priorfill.cli.output import MAX_ROWS, print_json, print_line
from priorfill.cli.path_types import FILE, FOLDER, PathArgument
from priorfill.cli.progress import study_progress
from priorfill.cli.reading_many import with_path
from priorfill.errors import StudyError

if TYPE_CHECKING:
    from priorfill.study.job import JobOutcome
    from priorfill.study.run_study import Study

__all__ = ["batch", "shared_fill_options"]

_OF_FILL = (
    "database", "method", "values", "markers", "frames", "max_gap", "extrapolate", "max_error",
    "skip_edges", "reject_artefacts", "not_names", "not_subjects", "subjects", "trust_filled",
    "rewrite", "program", "overwrite", "up", "rate", "unit", "subject", "marker_set", "keep_zeros",
    "ignore_residuals",
)  # fmt: skip
"""Parameters of ``fill`` that apply to many files."""

_OF_STUDY = ("report", "uncertainty", "overwrite")
"""Parameters that mean something else for a study than for a file."""

_OTHER_HELP = {
    "database": "Prior database to learn from, in addition to the files themselves.",
    "overwrite": "Replace files in the output folder that are not of this study, or were changed "
    "since.",
}
"""Help of options of ``fill`` that speaks of its file."""

_MINUTE = 60.0
_GB = 1e9


def shared_fill_options() -> list[click.Parameter]:
    """Return the options of ``fill`` that apply to many files."""
    shared: list[click.Parameter] = []
    for parameter in fill.params:
        if parameter.name in _OF_FILL:
            own = copy.copy(parameter)
            if isinstance(own, click.Option):
                own.help = _OTHER_HELP.get(own.name or "", own.help)
            shared.append(own)
    return shared


@click.command()
@click.option(
    "--output",
    "-o",
    metavar="FOLDER",
    type=FOLDER,
    required=True,
    help="Folder for the filled files, which keep their names and folders.",
)
@click.option(
    "--workers",
    "-w",
    metavar="N",
    type=click.IntRange(min=1),
    help="Number of files that are filled at the same time; by default the number of "
    "cores, or fewer where the memory does not suffice. The filled files do not "
    "depend on it.",
)
@click.option("--report", is_flag=True, help="Also write a page for each file, FILE.html.")
@click.option(
    "--uncertainty",
    is_flag=True,
    help="Also write the expected error of each filled sample of each file, FILE.uncertainty.npz.",
)
@click.option(
    "--summary",
    metavar="OUT.html",
    type=FILE,
    help="Page that sums up the study, with tables next to it; summary.html in FOLDER by default.",
)
@click.option(
    "--flag-error",
    metavar="MM",
    type=click.FloatRange(min=0.0),
    help="The summary lists files with a greater expected mean error in a gap; 10 by default.",
)
@click.option(
    "--flag-gap",
    metavar="SECONDS",
    type=click.FloatRange(min=0.0),
    help="The summary lists files with longer gaps; by default, a length alone is no reason.",
)
@click.option(
    "--time-limit",
    metavar="MINUTES",
    type=click.FloatRange(min=0.0, min_open=True),
    default=60.0,
    show_default=True,
    help="Time after which the fill of a file is ended.",
)
@click.option(
    "--memory-limit",
    metavar="GB",
    type=click.FloatRange(min=0.0, min_open=True),
    help="Memory that the fill of a file may use; by default its share of the computer's.",
)
@click.option(
    "--retry",
    is_flag=True,
    help="Fill files again that failed for reasons of their own.",
)
@click.option(
    "--check",
    "check_only",
    is_flag=True,
    help="Check everything and count what is to be done, but fill nothing.",
)
@click.option(
    "--grow",
    is_flag=True,
    help="Fill files with few gaps first, and add what was filled well enough to the database, "
    "which is created if there is none: files with more gaps learn from it.",
)
@click.option(
    "--no-same-session",
    "same_session",
    is_flag=True,
    flag_value=False,
    default=True,
    help="Do not fill a file from other recordings of the same subject in its folder.",
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Fill on the workers of a Dask scheduler, tls://HOST:PORT or tcp://HOST:PORT.",
)
@click.option(
    "--cluster",
    type=click.Choice(["local"]),
    help="local: start Dask workers on this computer.",
)
@click.option(
    "--index",
    metavar="I",
    type=click.IntRange(min=1),
    help="Fill only part I of the study, as one task of an array of tasks, without a summary.",
)
@click.option("--of", metavar="N", type=click.IntRange(min=1), help="Number of parts of --index.")
@every_row_option
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.argument("paths", metavar="PATH...", nargs=-1, cls=PathArgument, type=FILE)
def batch(
    paths: tuple[Path, ...],
    output: Path,
    database: Path | None,
    every_row: bool,
    as_json: bool,
    **given: Any,
) -> None:
    """Fill the gaps of all files of a study.

    PATH is a file, or a folder that is searched for recordings. Each file is filled in a process
    of its own, so that a bad file costs itself only. The same command continues a study that was
    interrupted, and fills nothing twice. Without PATH, the summary of what is done is written
    again.

    Exit status 0: all files are complete; 3: some are not, or failed; 1: none was filled; 2: wrong
    usage.
    """
    check_database_options(database, given)
    with study_progress() as show:
        from priorfill.study.run_study import batch as run  # slow, so the bar is shown before
        from priorfill.study.run_study import sum_up_study
        from priorfill.study.study_options import StudyOptions

        options = StudyOptions(**_values(given), progress=show)
        try:
            if paths:
                keywords = _fill_keywords(given)
                study = run(paths, output, database=database, study=options, **keywords)
            else:
                study = sum_up_study(output, options)
        except StudyError as error:
            _print_problems(error)
            return
    if as_json:
        print_json([outcome.to_json() for outcome in study.outcomes])
    else:
        _print_study(study, None if every_row else MAX_ROWS)
    for note in study.notes:
        print_line(f"note: {note}", err=True)
    if study.status != "all" and not options.check_only:
        exit_status = EXIT_INCOMPLETE if study.status == "some" else EXIT_FAILED
        click.get_current_context().exit(exit_status)


batch.params += shared_fill_options()  # after those of its own


def _values(given: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of `priorfill.StudyOptions`."""
    from dataclasses import fields

    from priorfill.study.study_options import StudyOptions

    memory = given["memory_limit"]
    known = {one.name for one in fields(StudyOptions)}
    values = {name: value for name, value in given.items() if name in known and value is not None}
    return values | {
        "time_limit": given["time_limit"] * _MINUTE,
        "memory_limit": None if memory is None else int(memory * _GB),
    }


def _fill_keywords(given: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of `priorfill.batch` that it shares with `priorfill.fill_file`."""
    shared = {name: given[name] for name in given if name not in _OF_STUDY}
    arguments = fill_arguments(shared | {"same_subject": ()}, None)
    del arguments["same_subject"]
    return arguments


def _print_problems(error: StudyError) -> None:
    """Print all reasons why a study cannot begin, and end."""
    for problem in error.problems:
        print_line(f"priorfill: {problem}", err=True)
    usage = any(map(is_usage_error, error.problems))
    click.get_current_context().exit(EXIT_USAGE if usage else EXIT_FAILED)


def _print_study(study: Study, rows: int | None) -> None:
    """Print a line for each file that a person should know of, and the totals."""
    failed = [one for one in study.outcomes if one.status == "failed"]
    incomplete = [one for one in study.outcomes if one.status == "incomplete"]
    incomplete.sort(key=lambda one: -one.facts.get("missing_samples", 0))
    lines = [_problem_line(one) for one in (*failed, *incomplete)]
    lines += [f"changed: {one.name}: {one.changed}" for one in study.outcomes if one.changed]
    for line in lines[:rows]:
        print_line(line)
    if rows is not None and len(lines) > rows:
        print_line(f"... and {len(lines) - rows} more (--all prints them)")
    print_line(_totals(study))
    if study.summary is not None:
        print_line(f"summary: {study.summary}")


def _problem_line(outcome: JobOutcome) -> str:
    """Return a line about a file that failed or is not complete."""
    if outcome.status == "failed":
        return f"failed: {with_path(Path(outcome.name), outcome.reason)}"
    spans = [span for gap in outcome.facts.get("gaps", ()) for span in gap["unfilled"]]
    reasons = Counter[str]()
    for span in spans:
        if span["requested"]:
            reasons[span["reason"]] += span["last_frame"] - span["first_frame"] + 1
    why = f": {reasons.most_common(1)[0][0]}" if reasons else ""
    return f"incomplete: {outcome.name}: {reasons.total()} samples stay missing{why}"


def _totals(study: Study) -> str:
    """Return the numbers of files."""
    counts = [
        f"{number} {status}"
        for status in ("filled", "incomplete", "no gaps", "failed")
        if (number := sum(one.status == status for one in study.outcomes))
    ]
    if study.waiting:
        counts.append(f"{len(study.waiting)} to be filled")
    before = f" ({study.done_before} of them before)" if study.done_before else ""
    total = len(study.outcomes) + len(study.waiting)
    files = "1 file" if total == 1 else f"{total} files"
    return f"{files}: {', '.join(counts)}{before}; in {study.folder}"
