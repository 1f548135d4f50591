"""``priorfill report``: a page that shows what filled files have in the gaps of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.output import print_line
from priorfill.cli.path_types import FILE, PathArgument
from priorfill.cli.reading import as_reading, file_options

if TYPE_CHECKING:
    from priorfill.filling.result import Result

__all__ = ["report"]


@click.command()
@click.argument("before", cls=PathArgument, type=FILE)
@click.argument("after", cls=PathArgument, type=FILE, nargs=-1, required=True)
@click.option(
    "--output",
    "-o",
    metavar="OUT.html",
    type=FILE,
    required=True,
    help="The page to write.",
)
@click.option(
    "--truth",
    metavar="FILE",
    type=FILE,
    help="The same recording without gaps, to show the true errors.",
)
@click.option(
    "--uncertainty",
    metavar="FILE",
    type=FILE,
    help="The expected errors of the first AFTER, .npz or .csv, as `priorfill fill --uncertainty` "
    "wrote them.",
)
@click.option("--subject", metavar="NAME", help="The subject, in files of several.")
@click.option("--overwrite", is_flag=True, help="Replace an existing page.")
@file_options
def report(before: Path, after: tuple[Path, ...], output: Path, **given: Any) -> None:
    """Show in any browser what filled files have in the gaps of BEFORE.

    AFTER is the same recording, filled by any program; the formats may differ. Several are compared
    with the first one. Measured samples that differ are shown and counted.
    """
    from priorfill.filling.report_from_files import report_from_files

    names = ("truth", "uncertainty", "overwrite", "subject")
    chosen = {name: given.pop(name) for name in names}
    result = report_from_files(output, before, after, **chosen, **as_reading(**given))
    print_line(f"{_summary(result)}; written to {output}")
    for note in result.notes:
        print_line(f"note: {note}", err=True)


def _summary(result: Result) -> str:
    """Return how much was filled as a line."""
    if not result.gaps:
        return "no gaps"
    frames = sum(gap.frames for gap in result.gaps)
    gaps = f"{len(result.gaps)} gap{'s' if len(result.gaps) > 1 else ''}"
    return f"{gaps}, {int(result.filled.sum())} of {frames} samples filled"
