"""``priorfill fill``: fill the gaps of a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.completion import complete_methods, complete_subjects
from priorfill.cli.exit_status import EXIT_INCOMPLETE
from priorfill.cli.fill_report import print_fill, print_fill_notes
from priorfill.cli.option_names import with_options
from priorfill.cli.option_types import DURATION, FRAMES, as_names, every_row_option
from priorfill.cli.output import print_json
from priorfill.cli.path_types import FILE, FOLDER, PathArgument
from priorfill.cli.progress import fill_progress
from priorfill.cli.reading import excluding_options, reading_options
from priorfill.runtime.display import shell_command

if TYPE_CHECKING:
    from priorfill.filling.fill_file import FileOptions, FileResult
    from priorfill.filling.fill_options import FillOptions

__all__ = ["check_database_options", "fill", "fill_arguments", "fill_options"]

MAX_FILES = 6
"""Number of files in a message."""


def _values(
    context: click.Context, parameter: click.Parameter, values: tuple[str, ...]
) -> dict[str, str]:
    """Parse ``NAME=VALUE``."""
    pairs = [value.partition("=") for value in values]
    for value, (name, sign, _) in zip(values, pairs, strict=True):
        if not (sign and name.strip()):
            raise click.BadParameter(f"{value!r} is not of the form NAME=VALUE")
    return {name.strip(): value.strip() for name, _, value in pairs}


def _one_file(context: click.Context, parameter: click.Parameter, files: tuple[Path, ...]) -> Path:
    """Return the file; for several, name the command that fills them."""
    if len(files) == 1:
        return files[0]
    some = [*files[:MAX_FILES], *(["..."] if len(files) > MAX_FILES else [])]
    command = shell_command(["priorfill", "batch", *some, "-o", "FOLDER"])
    raise click.UsageError(f"fill takes one file, not {len(files)}; fill several with: {command}")


@click.command()
@click.argument(
    "file", metavar="FILE", nargs=-1, required=True, cls=PathArgument, type=FILE, callback=_one_file
)
@click.option(
    "--output",
    "-o",
    metavar="OUT",
    type=FILE,
    help="File to write: a copy of FILE with its gaps filled, or a new file if the suffix is of "
    "another format (.c3d .trc .npz .mat). For a Motion-BIDS recording, also the folder of a "
    "derivative dataset. Without it, the gaps are filled and listed, but not written.",
)
@click.option(
    "--database",
    "-d",
    metavar="DIR",
    type=FOLDER,
    help="Prior database to learn from, in addition to FILE itself.",
)
@click.option(
    "--same-subject",
    metavar="OTHER",
    type=FILE,
    multiple=True,
    help="Another recording of the same subject with the same markers attached, such as the "
    "static trial, to learn from. Can be repeated.",
)
@click.option(
    "--method",
    "-m",
    default="auto",
    show_default=True,
    shell_complete=complete_methods,
    help="auto, which is gpr, or one that `priorfill methods` lists.",
)
@click.option(
    "--set",
    "values",
    metavar="NAME=VALUE",
    multiple=True,
    callback=_values,
    help="Set an option of the method; `priorfill methods METHOD` lists them. Can be repeated.",
)
@click.option(
    "--markers",
    metavar="A,B,...",
    multiple=True,
    callback=as_names,
    help='Fill only these markers: labels, or patterns ("L*"), in any case. Can be repeated.',
)
@click.option(
    "--frames",
    metavar="A-B",
    type=FRAMES,
    help="Fill only frames A to B (92-116 or 92:116), as the file numbers them; either may be "
    "omitted.",
)
@click.option(
    "--max-gap",
    metavar="SECONDS",
    type=DURATION,
    help="Leave longer gaps alone, each as a whole; 10f is 10 frames.",
)
@click.option(
    "--extrapolate",
    metavar="SECONDS",
    type=DURATION,
    default=0.0,
    help="Fill this far beyond the first and the last frame in which at least three markers are "
    "visible; 0 by default.",
)
@click.option(
    "--max-error",
    metavar="MM",
    type=float,
    help="Leave samples missing whose expected mean error exceeds this, or is unknown.",
)
@click.option("--skip-edges", is_flag=True, help="Leave gaps at the clip's start and end alone.")
@click.option(
    "--overrides",
    metavar="FILE.toml",
    type=FILE,
    help="Treat single gaps as this file specifies.",
)
@click.option(
    "--write-overrides",
    metavar="OUT.toml",
    type=FILE,
    help="Also write a file for --overrides with an entry for each gap, to be edited.",
)
@click.option(
    "--reject-artefacts",
    is_flag=True,
    help="Treat detected artefacts (label swaps, spikes, ghost or stuck markers) as missing and "
    "list them.",
)
@excluding_options
@click.option(
    "--only-subject",
    "subjects",
    metavar="PATTERN",
    multiple=True,
    shell_complete=complete_subjects,
    help="Learn only from clips of these subjects. Can be repeated.",
)
@click.option(
    "--trust-filled",
    is_flag=True,
    help="Learn also from filled samples of the database, not only from measured ones.",
)
@click.option(
    "--add-to-database",
    is_flag=True,
    help="Add the filled clip to the database, which is created if there is none.",
)
@click.option(
    "--uncertainty",
    metavar="OUT.npz|OUT.csv",
    type=FILE,
    help="Also write the expected error of each filled sample.",
)
@click.option(
    "--report",
    metavar="OUT.html",
    type=FILE,
    help="Also write a page that shows the fill in any browser: gaps, body, curves, sources.",
)
@click.option(
    "--plot",
    metavar="OUT.png|svg|pdf",
    type=FILE,
    help="Also draw the worst gaps. A name without a suffix is a folder for a picture of each "
    "marker with gaps. Needs matplotlib.",
)
@click.option(
    "--plot-gaps",
    metavar="N",
    type=click.IntRange(min=1),
    help="Number of gaps that --plot draws, the worst first; 6 by default. In a folder, of each "
    "marker.",
)
@click.option(
    "--rewrite",
    is_flag=True,
    help="Write a C3D file anew, with float coordinates, instead of a copy; list what changes.",
)
@click.option(
    "--for",
    "program",
    type=click.Choice(["opensim"], case_sensitive=False),
    help="Write a .trc file as this program takes it: +Y up, no blank cells, names without blanks; "
    "and a table of what was estimated.",
)
@click.option("--overwrite", is_flag=True, help="Replace existing files.")
@click.option(
    "--threads",
    metavar="N",
    type=click.IntRange(min=1),
    help="Maximum number of threads; all cores by default. The result does not depend on it.",
)
@every_row_option
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@reading_options
def fill(
    file: Path,
    output: Path | None,
    database: Path | None,
    threads: int | None,
    as_json: bool,
    **given: Any,
) -> None:
    """Fill the gaps of FILE.

    Measured samples and everything else in the file are copied unchanged (except samples that
    --reject-artefacts or --overrides treat as missing). The recording itself, if the database
    holds it, is not learnt from. Each subject of a file is filled by itself.

    Without --output this is a dry run: the table shows what would be filled and how far off it may
    be, and no filled file is written.

    Exit status 0: done; 3: done, but not all gaps could be filled; 1: failed; 2: wrong usage.
    """
    from priorfill.runtime.threads import limit_threads

    if threads is not None:
        limit_threads(threads)
    check_database_options(database, given)
    if output is None and given["add_to_database"]:
        raise click.UsageError("--add-to-database needs a file to write; name it (--output)")
    if given["plot_gaps"] is not None and given["plot"] is None:
        raise click.UsageError("--plot-gaps needs a file for the plot; name it (--plot)")
    with fill_progress(file.name) as show:
        from priorfill.filling.fill_file import fill_file  # slow, so the bar is shown before

        done = fill_file(
            file,
            output,
            database=database,
            overrides=given["overrides"],
            **fill_arguments(given, show),
        )
    if as_json:
        from priorfill.filling.fill_facts import fill_facts

        print_json(fill_facts(done, with_options))
    else:
        print_fill(done, every_row=given["every_row"])
    print_fill_notes(done)
    _end(done)


def check_database_options(database: Path | None, given: dict[str, Any]) -> None:
    """Raise a usage error for options that need a database where there is none.

    Parameters
    ----------
    database : Path or None
        The database.
    given : dict
        Values of the options of a command that fills.
    """
    for option, value in (
        ("--exclude-motion", given["not_names"]),
        ("--exclude-subject", given["not_subjects"]),
        ("--only-subject", given["subjects"]),
        ("--trust-filled", given["trust_filled"]),
        ("--add-to-database", given.get("add_to_database")),
    ):
        if value and database is None:
            raise click.UsageError(f"{option} needs a database; give one (--database)")


def fill_arguments(given: dict[str, Any], show: Any) -> dict[str, Any]:
    """Return arguments of `priorfill.fill_file` and `priorfill.review` that options decide.

    Parameters
    ----------
    given : dict
        Values of the options of a command that fills.
    show : callable
        Of the progress bar.
    """
    from priorfill.filling.gap_filter import GapFilter

    return {
        "same_subject": given["same_subject"],
        "files": _file_options(given),
        "method": given["method"],
        "gap_filter": GapFilter(
            given["markers"], given["frames"], given["max_gap"], given["skip_edges"]
        ),
        "reject_artefacts": given["reject_artefacts"],
        "options": fill_options(given, show),
    }


def _file_options(given: dict[str, Any]) -> FileOptions:
    """Return how files are to be read and written; what the command lacks is at its default."""
    from dataclasses import fields

    from priorfill.filling.fill_file import FileOptions

    known = {field.name for field in fields(FileOptions)}
    return FileOptions(
        zeros_missing=not given["keep_zeros"],
        **{name: value for name, value in given.items() if name in known and value is not None},
    )


def fill_options(given: dict[str, Any], show: Any) -> FillOptions:
    """Return the method's options, the clips to learn from, the marker set and the progress bar.

    Parameters
    ----------
    given : dict
        Values of the options of a command that fills.
    show : callable
        Of the progress bar.
    """
    from priorfill.database import Selection
    from priorfill.filling.fill_options import FillOptions
    from priorfill.markers import definitions

    return FillOptions(
        given["values"],
        Selection(
            subjects=given["subjects"],
            not_names=given["not_names"],
            not_subjects=given["not_subjects"],
        ),
        given["trust_filled"],
        definitions.load(given["marker_set"]) if given["marker_set"] else None,
        extrapolate=given["extrapolate"],
        max_error=given["max_error"],
        progress=show,
    )


def _end(done: FileResult) -> None:
    """Raise the error, or set the exit status, of a fill that did not do everything."""
    if done.not_added is not None:
        raise done.not_added
    if not done.result.complete:
        click.get_current_context().exit(EXIT_INCOMPLETE)
