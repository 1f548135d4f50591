"""``priorfill db edit``: correct the subject or session of clips."""

from __future__ import annotations

from pathlib import Path

import click

from priorfill.cli.completion import complete_clips, complete_sessions, complete_subjects
from priorfill.cli.db.common import choose, count, database_option, title
from priorfill.cli.output import print_line

__all__ = ["edit"]


@click.command(short_help="Correct the subject or session of clips.")
@database_option
@click.option("--subject", metavar="NEW", help="The right subject; --subject= for none.")
@click.option("--session", metavar="NEW", help="The right session; --session= for none.")
@click.option(
    "--of-subject",
    "subjects",
    metavar="PATTERN",
    multiple=True,
    shell_complete=complete_subjects,
    help="Only clips that have this subject; can be repeated.",
)
@click.option(
    "--of-session",
    "sessions",
    metavar="PATTERN",
    multiple=True,
    shell_complete=complete_sessions,
    help="Only clips that have this session; can be repeated.",
)
@click.option("--dry-run", is_flag=True, help="Only show what would be changed.")
@click.argument("names", metavar="[NAME]...", nargs=-1, shell_complete=complete_clips)
def edit(
    folder: Path,
    subject: str | None,
    session: str | None,
    subjects: tuple[str, ...],
    sessions: tuple[str, ...],
    dry_run: bool,
    names: tuple[str, ...],
) -> None:
    """Correct the subject or session of clips in a database, of all of them or none.

    NAME is a clip's name, a pattern of names (in quotes: "walk*"), or its id as db list shows it.
    """
    from priorfill.database import PriorDatabase

    if subject is None and session is None:
        raise click.UsageError("give what to correct: --subject NEW or --session NEW")
    if not (names or subjects or sessions):
        raise click.UsageError(
            "name the clips: NAME... or --of-subject PATTERN or --of-session PATTERN"
        )
    with PriorDatabase.open(folder, write=not dry_run) as database:
        records = choose(folder, database.clips(), names, subjects, sessions=sessions)
        if not dry_run:
            records = database.edit(records, subject=subject, session=session)
    for record in records:
        print_line(f"{'would change' if dry_run else 'changed'} {title(record)}")
    print_line(f"{'would change' if dry_run else 'changed'} {count(len(records), 'clip')}")
