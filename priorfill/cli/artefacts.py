"""What commands print about artefacts: label swaps, spikes, mislabelled and stuck markers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from priorfill.cli.output import print_line, print_table, some_names
from priorfill.runtime.display import shell_command

if TYPE_CHECKING:
    from pathlib import Path

    from priorfill.filling.result import Result

__all__ = [
    "artefact_text",
    "print_artefacts",
    "print_left_as_measured",
    "warn_of_artefacts",
]

MAX_WARNINGS = 5
"""Number of warnings; `inspect` shows more."""


def print_artefacts(facts: Sequence[dict[str, Any]], title: str, most: int | None) -> None:
    """Print a table of artefacts.

    Parameters
    ----------
    facts : sequence of dict
        As from `artefact_facts`.
    title : str
        Printed above the table.
    most : int or None
        Number of rows; None: all.
    """
    rows = (
        [one["kind"], " ".join(one["markers"]), _frames(one), one["evidence"]]
        for one in facts[:most]
    )
    print_table(("kind", "marker", "frames", "evidence"), rows, title=title)
    if most is not None and len(facts) > most:
        print_line(f"... and {len(facts) - most} more (--all prints them)")


def warn_of_artefacts(facts: Sequence[dict[str, Any]], file: str) -> None:
    """Print the largest artefacts on stderr.

    Parameters
    ----------
    facts : sequence of dict
        As from `artefact_facts`.
    file : str
        The clip's file, for the command that shows all.
    """
    worst = sorted(facts, key=lambda one: -_weight(one))[:MAX_WARNINGS]
    for one in worst:
        print_line(f"warning: {artefact_text(one)}", err=True)
    rest = len(facts) - len(worst)
    if rest:
        command = shell_command(("priorfill", "inspect", file))
        print_line(f"warning: {rest} more; list them with: {command}", err=True)
    if facts:
        print_line(
            "warning: these samples are kept as measured; --reject-artefacts fills them", err=True
        )


def print_left_as_measured(result: Result, file: Path, output: Path | None) -> None:
    """Print on stderr which samples were rejected but not filled.

    Parameters
    ----------
    result : Result
        Of a fill.
    file, output : Path or None
        The file with gaps and the filled file; None after a dry run.
    """
    left = result.rejected & ~result.filled
    if not left.any():
        return
    labels = [
        label for label, column in zip(result.clip.labels, left.T, strict=True) if column.any()
    ]
    same = "stay as measured" if output is None else f"are the same in {output} as in {file}"
    print_line(
        f"left as measured: {int(left.sum())} rejected samples of {some_names(labels)} were not "
        f"filled; they {same}",
        err=True,
    )


def artefact_text(one: dict[str, Any]) -> str:
    """Return an artefact in a line.

    Parameters
    ----------
    one : dict
        One of `artefact_facts`.
    """
    from priorfill.artefacts import KINDS

    names = " and ".join(one["markers"])
    plural = "s" if one["first_frame"] < one["last_frame"] else ""
    return f"{names} {KINDS[one['kind']]} in frame{plural} {_frames(one)} ({one['evidence']})"


def _weight(one: dict[str, Any]) -> float:
    """Return the size of an artefact: displacement (mm) times number of samples."""
    displacement = abs((one["distance_mm"] or 0.0) - (one["typical_distance_mm"] or 0.0))
    frames = one["last_frame"] - one["first_frame"] + 1
    return float(max(displacement, one["size_mm"]) * frames * len(one["markers"]))


def _frames(one: dict[str, Any]) -> str:
    """Return the frames of an artefact as text."""
    first, last = one["first_frame"], one["last_frame"]
    return f"{first}-{last}" if first < last else f"{first}"
