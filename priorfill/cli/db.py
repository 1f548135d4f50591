"""``priorfill db``: build and look at prior databases."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.output import duration, print_json, print_table
from priorfill.cli.progress import progress
from priorfill.errors import ClipError, OptionError, PriorfillError

if TYPE_CHECKING:
    from priorfill.database import ClipRecord

__all__ = ["db"]

_INTERNAL = {"segment", "offset", "checksums"}  # of a record, no one's business outside

database_option = click.option(
    "--database",
    "-d",
    "folder",
    metavar="DIR",
    required=True,
    type=click.Path(path_type=Path),
    help="The database's folder.",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON.")


@click.group()
def db() -> None:
    """Build and look at prior databases."""


@db.command()
@database_option
@click.option("--subject", metavar="NAME", help="Whose motion it is; by default as the file says.")
@click.option("--session", metavar="NAME", default="", help="Recording session.")
@click.option("--licence", metavar="TEXT", default="", help="Terms under which it may be used.")
@click.option("--credit", metavar="TEXT", default="", help="Whom to name.")
@click.argument(
    "paths", metavar="PATH...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
@click.pass_context
def add(
    ctx: click.Context,
    folder: Path,
    subject: str | None,
    session: str,
    licence: str,
    credit: str,
    paths: tuple[Path, ...],
) -> None:
    """Add files, and the files in folders, to a database; make it if there is none.

    Files that are in it already are skipped. A file that cannot be added is reported and the
    others go on; the exit status is then 1.
    """
    from priorfill import formats
    from priorfill.database import PriorDatabase
    from priorfill.errors import DuplicateClipError

    files, failed = _find_files(paths, formats.SUFFIXES)
    for reason in failed:
        click.echo(f"priorfill: {reason}", err=True)
    database: PriorDatabase | None = None
    failures = len(failed)
    added: list[ClipRecord] = []
    skipped = 0
    try:
        with progress(len(files), "Adding clips") as show:
            for done, path in enumerate(files):
                show(done, None)
                try:
                    clip = formats.read(path)
                except (PriorfillError, OSError) as error:
                    click.echo(f"priorfill: {_with_path(path, error)}", err=True)
                    failures += 1
                    continue
                # only now, so that nothing is made where there is nothing to add
                database = database or PriorDatabase.open_or_create(folder)
                try:
                    record = database.add(
                        clip, subject=subject, session=session, licence=licence, credit=credit
                    )
                except DuplicateClipError as error:
                    click.echo(f"skipped {_with_path(path, error)}")
                    skipped += 1
                except (ClipError, OptionError) as error:
                    click.echo(f"priorfill: {_with_path(path, error)}", err=True)
                    failures += 1
                else:
                    added.append(record)
    finally:
        if database is not None:
            database.close()
    seconds = sum(record.duration for record in added)
    click.echo(
        f"added {_count(len(added), 'clip')} ({duration(seconds)})"
        + (f", skipped {skipped} that {_is(skipped)} there already" if skipped else "")
        + (f", could not add {failures}" if failures else "")
    )
    if failures:
        ctx.exit(1)


@db.command("list")
@database_option
@json_option
def list_clips(folder: Path, as_json: bool) -> None:
    """List the clips of a database."""
    from priorfill.database import PriorDatabase

    with PriorDatabase.open(folder) as database:
        records = sorted(
            database.clips(), key=lambda record: (record.subject, record.name, record.content)
        )
    if as_json:
        print_json([_record_as_json(record) for record in records])
        return
    if not records:
        click.echo(f"{folder}: the database has no clips")
        return
    print_table(
        ("name", "subject", "session", "marker set", "markers>", "s>", "Hz>", "licence", ""),
        (
            (
                record.name,
                record.subject or "-",
                record.session or "-",
                record.marker_set or "-",
                str(len(record.labels)),
                f"{record.duration:.2f}",
                f"{record.original_rate:g}",
                record.licence or "-",
                " ".join(
                    word
                    for word, given in (
                        ("synthetic", record.synthetic),
                        ("filled", record.has_filled),
                    )
                    if given
                ),
            )
            for record in records
        ),
    )


@db.command()
@database_option
@json_option
def info(folder: Path, as_json: bool) -> None:
    """Show a database in figures."""
    from priorfill.database import PriorDatabase

    with PriorDatabase.open(folder) as database:
        facts = database.info()
    if as_json:
        print_json(asdict(facts) | {"path": str(facts.path)})
        return
    rates = ", ".join(f"{facts.rate / 2**level:g}" for level in range(facts.levels))
    sets = ", ".join(
        f"{name or 'not known'} ({count})" for name, count in facts.marker_sets.items()
    )
    synthetic = f", {facts.synthetic} of them synthetic" if facts.synthetic else ""
    for name, value in (
        ("database", str(facts.path)),
        ("format", f"version {facts.version}"),
        ("clips", f"{facts.clips}{synthetic}"),
        ("subjects", str(facts.subjects)),
        ("length", f"{duration(facts.seconds)}, {facts.frames} frames at {facts.rate:g} Hz"),
        ("levels", f"{rates} Hz"),
        ("marker sets", sets or "-"),
        ("size", _size(facts.bytes)),
    ):
        click.echo(f"{name:<12} {value}")


@db.command()
@database_option
@click.pass_context
def verify(ctx: click.Context, folder: Path) -> None:
    """Check every clip of a database against its checksums."""
    from priorfill.database import PriorDatabase

    with PriorDatabase.open(folder) as database, progress(None, "Checking clips") as show:
        problems = database.verify(show)
        count = len(database.clips())
    for problem in problems:
        click.echo(f"priorfill: {problem}", err=True)
    if problems:
        ctx.exit(1)
    click.echo(f"{_count(count, 'clip')} checked, all are as they were added")


def _find_files(paths: tuple[Path, ...], suffixes: tuple[str, ...]) -> tuple[list[Path], list[str]]:
    """Return the files that `paths` stand for, each once, and what is wrong with the others."""
    files: dict[Path, None] = {}
    failed = []
    for path in paths:
        if path.is_dir():
            inside = sorted(p for p in path.rglob("*") if p.suffix.lower() in suffixes)
            if not inside:
                failed.append(f"{path}: has no files that can be read ({', '.join(suffixes)})")
            files |= dict.fromkeys(inside)
        elif path.exists():
            files[path] = None
        else:
            failed.append(f"{path}: there is no such file or folder; check the name")
    return list(files), failed


def _with_path(path: Path, error: Exception) -> str:
    """Return an error's message, with the file's path if it does not begin with it."""
    text = " ".join(str(error).split())
    for start in (str(path), path.name, path.stem):
        text = text.removeprefix(f"{start}: ")
    return f"{path}: {text}"


def _record_as_json(record: ClipRecord) -> dict[str, Any]:
    content = {key: value for key, value in asdict(record).items() if key not in _INTERNAL}
    return content | {"seconds": round(record.duration, 6), "bytes": record.nbytes}


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _is(number: int) -> str:
    return "is" if number == 1 else "are"


def _size(number: int) -> str:
    size = float(number)
    for unit in ("bytes", "kB", "MB"):
        if size < 1000:
            return f"{size:.0f} {unit}" if unit == "bytes" else f"{size:.1f} {unit}"
        size /= 1000
    return f"{size:.1f} GB"
