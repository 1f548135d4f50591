"""``priorfill nexus`` and ``priorfill qtm``: fill the trial that another program has open."""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.artefacts import (
    artefact_text,
    print_artefacts,
    warn_of_artefacts,
)
from priorfill.cli.exit_status import EXIT_INCOMPLETE
from priorfill.cli.fill import check_database_options, fill, fill_options
from priorfill.cli.fill_report import print_gaps, print_unfilled
from priorfill.cli.output import MAX_ROWS, print_line, some_names
from priorfill.cli.progress import fill_progress
from priorfill.integrations.qtm_rest import DEFAULT_PORT

if TYPE_CHECKING:
    from collections.abc import Callable

    from priorfill.integrations.open_trial import OpenTrial, TrialResult

__all__ = ["nexus", "qtm"]

_FILES_ONLY = frozenset(
    {
        *("file", "output", "add_to_database", "rewrite", "program", "as_json"),
        *("rate", "unit", "subject", "keep_zeros", "ignore_residuals"),
    }
)
"""Parameters of ``fill`` that mean nothing without a file."""

_OTHER_HELP = {
    "database": "Prior database to learn from, in addition to the trial itself.",
    "frames": "Fill only frames A to B (92-116 or 92:116), as the program numbers them; either "
    "may be omitted. Without it, the range selected in the program is filled.",
    "same_subject": "A file of the same subject with the same markers attached, such as the static "
    "trial, to learn from. Can be repeated.",
}
"""Help of options of ``fill`` that speaks of its file."""

MAX_WARNINGS = 5
"""Number of warnings of artefacts in a program in which they cannot be replaced."""


def _shared_options(*but: str) -> list[click.Parameter]:
    """Return the options of ``fill`` that apply to an open trial, except some."""
    shared: list[click.Parameter] = []
    for parameter in fill.params:
        if parameter.name in _FILES_ONLY or parameter.name in but:
            continue
        own = copy.copy(parameter)
        if isinstance(own, click.Option) and own.name in _OTHER_HELP:
            own.help = _OTHER_HELP[own.name]
        shared.append(own)
    return shared


def _trial_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options ``whole_trial`` and ``dry_run``."""
    for option in (
        click.option("--dry-run", is_flag=True, help="Fill and print the table, but set nothing."),
        click.option(
            "--whole-trial",
            is_flag=True,
            help="Fill all frames, not only the range selected in the program.",
        ),
    ):
        command = option(command)
    return command


@click.command(params=_shared_options())
@_trial_options
@click.option(
    "--subject",
    "subject",
    metavar="NAME",
    multiple=True,
    help="Subject to fill, instead of all that are ticked in Nexus. Can be repeated.",
)
@click.option(
    "--host",
    metavar="NAME",
    default="localhost",
    show_default=True,
    help="Computer that runs Nexus.",
)
def nexus(host: str, **given: Any) -> None:
    """Fill the trial that is open in Vicon Nexus.

    Only markers with filled samples are set, after a check that nobody has changed them in the
    meantime; measured samples keep their bits. Nothing is saved: that is the next step of the
    pipeline, or yours in Nexus. Needs the Python package of Nexus (docs/nexus.md).

    Tested with a stub that behaves as Vicon documents its interface, not in Nexus.

    Exit status 0: done; 3: done, but not all gaps could be filled or set; 1: failed; 2: wrong
    usage.
    """
    from priorfill.integrations.nexus import open_nexus

    _fill_open(lambda: open_nexus(host), given)


@click.command(params=_shared_options("reject_artefacts"))
@_trial_options
@click.option(
    "--port",
    type=click.IntRange(1, 65535),
    default=DEFAULT_PORT,
    show_default=True,
    help="Port of the scripting interface of QTM on this computer.",
)
def qtm(port: int, **given: Any) -> None:
    """Fill the measurement that is open in Qualisys Track Manager (QTM).

    Only gaps are set, after a check that nobody has changed them in the meantime. Nothing is
    saved. A script that runs inside QTM can do the same (docs/qtm.md).

    Tested with a stub that behaves as Qualisys documents its interface, not in QTM.

    Exit status 0: done; 3: done, but not all gaps could be filled or set; 1: failed; 2: wrong
    usage.
    """
    from priorfill.integrations.qtm import QtmMeasurement
    from priorfill.integrations.qtm_rest import RestInterface

    _fill_open(lambda: QtmMeasurement(RestInterface(port)), given)


def _fill_open(open_trial: Callable[[], OpenTrial], given: dict[str, Any]) -> None:
    """Open a trial, fill it, and print what was done."""
    from priorfill.filling.gap_filter import GapFilter
    from priorfill.integrations.open_trial import TrialOptions, fill_trial
    from priorfill.methods import get_method
    from priorfill.runtime.threads import limit_threads

    if given["threads"] is not None:
        limit_threads(given["threads"])
    check_database_options(given["database"], given)
    if given["whole_trial"] and given["frames"] is not None:
        raise click.UsageError("give either --frames or --whole-trial")
    get_method(given["method"])  # refuses an unknown method before the trial is read
    trial = open_trial()
    with fill_progress(trial.name) as show:
        done = fill_trial(
            trial,
            trial_options=TrialOptions(
                given.get("subject", ()),
                given["up"],
                given["whole_trial"],
                given["dry_run"],
                given["uncertainty"],
                given["overwrite"],
            ),
            database=given["database"],
            same_subject=given["same_subject"],
            method=given["method"],
            gap_filter=GapFilter(
                given["markers"], given["frames"], given["max_gap"], given["skip_edges"]
            ),
            overrides=given["overrides"],
            reject_artefacts=given.get("reject_artefacts", False),
            options=fill_options(given, show),
        )
    _print(done, None if given["every_row"] else MAX_ROWS, gaps_only=trial.gaps_only)
    if not done.result.complete:
        click.get_current_context().exit(EXIT_INCOMPLETE)


def _print(done: TrialResult, rows: int | None, *, gaps_only: bool) -> None:
    """Print the table of gaps and what was set; notes and what stays missing on stderr."""
    from priorfill.artefacts.artefact_facts import artefact_facts
    from priorfill.integrations.trial_report import outcome

    result = done.result
    facts = artefact_facts(result.artefacts, result.clip)
    if result.gaps:
        print_gaps(result, rows)
        print_line()
    print_line(outcome(done))
    if result.rejected.any():
        print_line()
        print_artefacts(facts, "Artefacts, treated as missing", rows)
    if done.uncertainty is not None:
        print_line(f"expected error of each filled sample: {done.uncertainty}")
    for note in (*done.notes, *result.notes):
        print_line(f"note: {note}", err=True)
    if gaps_only:
        _warn(facts, done.program)
    elif not result.provenance.reject_artefacts:
        warn_of_artefacts(facts, f"{done.trial}.c3d")
    left = result.rejected & ~result.filled
    if left.any():
        pairs = zip(result.clip.labels, left.T, strict=True)
        labels = [label for label, column in pairs if column.any()]
        print_line(
            f"left as measured: {int(left.sum())} rejected samples of {some_names(labels)} were "
            "not filled",
            err=True,
        )
    print_unfilled(result)


def _warn(facts: list[dict[str, Any]], program: str) -> None:
    """Print the first artefacts on stderr, where priorfill does not replace them."""
    for one in facts[:MAX_WARNINGS]:
        print_line(f"warning: {artefact_text(one)}", err=True)
    rest = len(facts) - MAX_WARNINGS
    if facts:
        more = f"; {rest} more are not shown" if rest > 0 else ""
        print_line(
            f"warning: these samples are kept as measured{more}; delete them in {program} and "
            "repeat the fill",
            err=True,
        )
