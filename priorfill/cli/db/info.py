"""``priorfill db info``: figures of a database."""

from __future__ import annotations

from pathlib import Path

import click

from priorfill.cli.db.common import database_option, json_option, size, warn
from priorfill.cli.output import duration, print_json, print_line

__all__ = ["info"]


@click.command()
@database_option
@json_option
def info(folder: Path, as_json: bool) -> None:
    """Show figures of a database."""
    from dataclasses import asdict

    from priorfill.database import PriorDatabase

    with PriorDatabase.open(folder) as database:
        warn(database)
        facts = database.info()
    if as_json:
        print_json(asdict(facts) | {"path": str(facts.path)})
        return
    rates = ", ".join(f"{facts.rate / 2**level:g}" for level in range(facts.levels))
    sets = ", ".join(
        f"{name or 'unknown'} ({number})" for name, number in facts.marker_sets.items()
    )
    kinds = f", {facts.synthetic} of them synthetic" if facts.synthetic else ""
    if facts.virtual_markers:
        kinds += f", {facts.virtual_markers} with virtual markers"
    for name, value in (
        ("database", str(facts.path)),
        ("format", f"version {facts.version}"),
        ("clips", f"{facts.clips}{kinds}"),
        ("subjects", str(facts.subjects)),
        ("length", f"{duration(facts.seconds)}, {facts.frames} frames at {facts.rate:g} Hz"),
        ("levels", f"{rates} Hz"),
        ("marker sets", sets or "-"),
        *(
            (what, f"{text or 'none'} ({number})")
            for what, texts in (("licence", facts.licences), ("credit", facts.credits))
            if any(texts)
            for text, number in texts.items()
        ),
        ("size", size(facts.bytes) + _left(facts.leftover_bytes)),
    ):
        print_line(f"{name:<12} {value}")


def _left(number: int) -> str:
    return f", {size(number)} of it waiting to be removed" if number else ""
