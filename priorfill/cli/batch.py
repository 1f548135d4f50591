"""``priorfill batch``: fill the gaps of all files of a study."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.fill import EXIT_INCOMPLETE, check_database_options, fill, fill_arguments
from priorfill.cli.option_types import every_row_option
from priorfill.cli.output import MAX_ROWS, print_json, print_line
from priorfill.cli.path_types import FILE, FOLDER, PathArgument
from priorfill.cli.progress import progress
from priorfill.errors import OptionError, StudyError

if TYPE_CHECKING:
    from priorfill.study.job import JobOutcome
    from priorfill.study.run_study import Study
    from priorfill.study.study_options import StudyOptions

__all__ = ["batch", "shared_fill_options"]

_OF_FILL = (
    *("database", "method", "values", "markers", "frames", "max_gap", "extrapolate", "max_error"),
    *("skip_edges", "reject_artefacts", "not_names", "not_subjects", "subjects", "trust_filled"),
    *("rewrite", "overwrite", "up", "rate", "unit", "subject", "marker_set", "keep_zeros"),
    "ignore_residuals",
)
"""Parameters of ``fill`` that apply to many files."""

_OF_STUDY = ("report", "uncertainty", "overwrite")
"""Parameters that mean something else for a study than for a file."""

_OTHER_HELP = {
    "database": "Prior database to learn from, in addition to the files themselves.",
    "overwrite": "Replace files in the output folder that are not of this study, or were changed "
    "since.",
}
"""Help of options of ``fill`` that speaks of its file."""

_EXIT_FAILED = 1
_EXIT_USAGE = 2


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


@click.command(params=shared_fill_options())
@every_row_option
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option(
    "--retry", is_flag=True, help="Fill files again that failed for reasons of their own."
)
@click.option(
    "--memory-limit",
    metavar="GB",
    type=click.FloatRange(min=0.0, min_open=True),
    help="Memory that the fill of a file may use; by default its share of the computer's.",
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
    "--uncertainty",
    is_flag=True,
    help="Also write the expected error of each filled sample of each file, FILE.uncertainty.npz.",
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
@click.option("--report", is_flag=True, help="Also write a page for each file, FILE.html.")
@click.option(
    "--workers",
    "-w",
    metavar="N",
    type=click.IntRange(min=1),
    help="Number of files that are filled at the same time; by default the number of cores, or "
    "fewer where the memory does not suffice. The filled files do not depend on it.",
)
@click.option(
    "--output",
    "-o",
    metavar="FOLDER",
    type=FOLDER,
    required=True,
    help="Folder for the filled files, which keep their names and folders.",
)
@click.argument("paths", metavar="PATH...", nargs=-1, required=True, cls=PathArgument, type=FILE)
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
    interrupted, and fills nothing twice.

    Exit status 0: all files are complete; 3: some are not, or failed; 1: none was filled; 2: wrong
    usage.
    """
    check_database_options(database, given)
    with progress(None, "filling", before="reading and checking", unit="files") as show:
        from priorfill.study.run_study import batch as run

        shared = {name: given[name] for name in given if name not in _OF_STUDY}
        arguments = fill_arguments(shared | {"same_subject": ()}, None)
        del arguments["same_subject"]
        try:
            study = run(
                paths,
                output,
                database=database,
                study=_study_options(given, show),
                **arguments,
            )
        except StudyError as error:
            _print_problems(error)
            return
    if as_json:
        print_json([outcome.to_json() for outcome in study.outcomes])
    else:
        _print_study(study, None if every_row else MAX_ROWS)
    if study.status != "all":
        exit_status = EXIT_INCOMPLETE if study.status == "some" else _EXIT_FAILED
        click.get_current_context().exit(exit_status)


def _study_options(given: dict[str, Any], show: Any) -> StudyOptions:
    """Return how the study is run."""
    from priorfill.study.study_options import StudyOptions

    memory = given["memory_limit"]
    return StudyOptions(
        workers=given["workers"],
        report=given["report"],
        uncertainty=given["uncertainty"],
        scheduler=given["scheduler"],
        cluster=given["cluster"],
        time_limit=given["time_limit"] * 60.0,
        memory_limit=None if memory is None else int(memory * 1e9),
        retry=given["retry"],
        overwrite=given["overwrite"],
        progress=lambda at: show(at.done, at.total),
    )


def _print_problems(error: StudyError) -> None:
    """Print all reasons why a study cannot begin, and end."""
    for problem in error.problems:
        print_line(f"priorfill: {problem}", err=True)
    usage = all(isinstance(problem, OptionError) for problem in error.problems)
    click.get_current_context().exit(_EXIT_USAGE if usage else _EXIT_FAILED)


def _print_study(study: Study, rows: int | None) -> None:
    """Print a line for each file that failed or is not complete, and the totals."""
    for note in study.notes:
        print_line(f"note: {note}", err=True)
    lines = [_problem_line(one) for one in study.outcomes if one.status == "failed"]
    lines += [_problem_line(one) for one in study.outcomes if one.status == "incomplete"]
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
        return f"failed: {outcome.name}: {outcome.reason}"
    return f"incomplete: {outcome.name}"


def _totals(study: Study) -> str:
    """Return the numbers of files."""
    counts = [
        f"{number} {status}"
        for status in ("filled", "incomplete", "no gaps", "failed")
        if (number := sum(one.status == status for one in study.outcomes))
    ]
    before = f" ({study.done_before} were done before)" if study.done_before else ""
    return f"{len(study.outcomes)} files: {', '.join(counts)}{before}; in {study.folder}"
