"""``priorfill review``: look at a fill in the browser, decide on its gaps, and save."""

from __future__ import annotations

import copy
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.exit_status import EXIT_INCOMPLETE
from priorfill.cli.fill import check_database_options, fill, fill_arguments
from priorfill.cli.option_names import with_options
from priorfill.cli.output import print_line
from priorfill.cli.path_types import FILE
from priorfill.cli.progress import fill_progress

if TYPE_CHECKING:
    from collections.abc import Callable

    from priorfill.reviewing.session import SavedReview

__all__ = ["review"]

_OF_FILL = (
    *("file", "database", "same_subject", "method", "values", "markers", "frames", "max_gap"),
    *("extrapolate", "max_error", "skip_edges", "reject_artefacts", "not_names", "not_subjects"),
    *("subjects", "trust_filled", "rewrite", "overwrite", "threads"),
    *("up", "rate", "unit", "subject", "marker_set", "keep_zeros", "ignore_residuals"),
)
"""Parameters of ``fill`` that decide what a fill is, and how files are read and written."""

_NOT_REPEATED = ("overwrite", "threads")
"""Those without an effect on the result."""


def _parameters_of_fill() -> list[click.Parameter]:
    """Return the parameters that ``fill`` and this command share."""
    return [copy.copy(one) for one in fill.params if one.name in _OF_FILL]


@click.command(params=_parameters_of_fill())
@click.option(
    "--output",
    "-o",
    metavar="OUT",
    type=FILE,
    help="File to save; FILE with _filled at the end of its name by default.",
)
@click.option(
    "--overrides",
    metavar="FILE.toml",
    type=FILE,
    help="File to save the decisions in, next to OUT by default. If it exists, the review begins "
    "with its decisions.",
)
@click.option("--no-browser", is_flag=True, help="Print the address, but open no browser.")
@click.option(
    "--port",
    metavar="N",
    type=click.IntRange(0, 65535),
    default=0,
    help="Port on this computer; any free one by default.",
)
def review(
    file: Path,
    output: Path | None,
    overrides: Path | None,
    no_browser: bool,
    port: int,
    **given: Any,
) -> None:
    """Look at the fill of FILE in the browser, and accept, refuse or repeat the fill of each gap.

    Save on the page writes OUT as `priorfill fill` does, and the decisions next to it; both or
    neither. FILE is not changed. `priorfill fill FILE -o OUT --overrides FILE.toml`, with the same
    options, repeats the result exactly. The page is served on this computer only, at an address
    that nobody can guess. Ctrl-C here, or End review on the page, ends the review.

    Needs starlette and uvicorn: pip install "priorfill[review]".

    Exit status 0: ended; 3: saved, but not all gaps could be filled; 1: failed; 2: wrong usage.
    """
    from priorfill.runtime.threads import limit_threads

    if given["threads"] is not None:
        limit_threads(given["threads"])
    check_database_options(given["database"], given)
    context = click.get_current_context()
    with ExitStack() as stack:
        show = stack.enter_context(fill_progress(file.name))
        from priorfill.reviewing.start import ReviewOptions  # slow, so the bar is shown before
        from priorfill.reviewing.start import review as review_file

        def started(address: str, opens: bool) -> None:
            stack.close()
            _print_start(address, opens=opens)

        saved = review_file(
            file,
            output,
            page=ReviewOptions(
                port, not no_browser, started, _words(context), _command(context, file)
            ),
            database=given["database"],
            overrides=overrides,
            **fill_arguments(given, show),
        )
    _print_end(saved)
    if saved is not None and not saved.complete:
        context.exit(EXIT_INCOMPLETE)


def _words(context: click.Context) -> Callable[[str], str]:
    """Return what puts options in place of arguments, in the threads of the server too."""

    def words(text: str) -> str:
        with context.scope(cleanup=False):
            return with_options(text)

    return words


def _command(context: click.Context, file: Path) -> tuple[str, ...]:
    """Return the words of ``fill`` with the options that were given to this command."""
    words = ["priorfill", "fill", str(file)]
    for one in context.command.params:
        given = context.get_parameter_source(one.name or "")
        if (
            not isinstance(one, click.Option)
            or one.name not in _OF_FILL
            or one.name in _NOT_REPEATED
            or given is not click.core.ParameterSource.COMMANDLINE
        ):
            continue
        name, value = max(one.opts, key=len), context.params[one.name]
        if one.is_flag:
            words.append(name)
        elif isinstance(value, dict):
            for key, item in value.items():
                words += [name, f"{key}={item}"]
        else:
            for item in _texts(one.name, value):
                words += [name, item]
    return tuple(words)


def _texts(name: str, value: Any) -> list[str]:
    """Return the value of an option as it is typed, one text for each time."""
    if name == "markers":
        return [",".join(value)]
    if name == "frames":
        return [":".join("" if end is None else str(end) for end in value)]
    return [str(item) for item in (value if isinstance(value, tuple) else (value,))]


def _print_start(address: str, *, opens: bool) -> None:
    """Print the address."""
    print_line(f"review: {address}")
    if not opens:
        print_line("open this address in the browser of this computer", err=True)
    print_line("Ctrl-C ends the review", err=True)


def _print_end(saved: SavedReview | None) -> None:
    """Print what was saved."""
    if saved is None:
        print_line("nothing was saved")
    else:
        print_line(f"saved {saved.output} and {saved.overrides}")
