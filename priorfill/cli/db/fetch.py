"""``priorfill db fetch``: download a free library, and add it to a database."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

from priorfill.cli.db.common import count, size
from priorfill.cli.output import print_table
from priorfill.cli.progress import progress

if TYPE_CHECKING:
    from priorfill.cli.db.adding import Target
    from priorfill.database import ClipRecord
    from priorfill.datasets import Dataset, DatasetFile, Fetched

__all__ = ["fetch"]

MEGABYTE = 1_000_000


def _list(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    """Print which libraries there are, and end."""
    del parameter
    if not value or context.resilient_parsing:
        return
    from priorfill.datasets import known_datasets

    rows = [
        (one.name, one.title, str(len(one.files)), one.marker_set or "-", one.licence, one.home)
        for one in known_datasets()
    ]
    print_table(("name", "library", "files>", "marker set", "licence", "see"), rows)
    context.exit()


@click.command(short_help="Download a free library into a database.")
@click.argument("name", metavar="LIBRARY")
@click.option(
    "--list",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_list,
    help="Show which libraries there are, and end.",
)
@click.option(
    "--database",
    "-d",
    "database",
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="The database's folder; needed unless --download-only is given.",
)
@click.option(
    "--to",
    "folder",
    metavar="FOLDER",
    type=click.Path(path_type=Path),
    help="Where the files go; by default a folder of the library's name beside the database.",
)
@click.option(
    "--only",
    metavar="PATTERN",
    multiple=True,
    help="These files of the library only ('*03-0*'); may be given again.",
)
@click.option(
    "--limit",
    metavar="N",
    type=click.IntRange(min=1),
    help="Download no more than N files this time.",
)
@click.option("--mirror", metavar="URL", help="Ask this address instead of the library's own.")
@click.option(
    "--pause",
    metavar="SECONDS",
    type=click.FloatRange(min=0),
    default=1.0,
    show_default=True,
    help="Wait between two files.",
)
@click.option("--yes", "-y", is_flag=True, help="Accept the library's terms without being asked.")
@click.option("--download-only", is_flag=True, help="Add nothing to a database.")
def fetch(
    name: str,
    database: Path | None,
    folder: Path | None,
    only: tuple[str, ...],
    limit: int | None,
    mirror: str | None,
    pause: float,
    yes: bool,
    download_only: bool,
) -> None:
    """Download LIBRARY, hdm05 or cmu, and add its recordings to a database.

    Shows the library's terms first, and asks whether you accept them. What was interrupted goes
    on where it stopped when the same command is given again. A file that cannot be had is reported
    and the others go on; the exit status is then 1.
    """
    from priorfill.datasets import RetryPolicy, find_dataset
    from priorfill.datasets import fetch as get
    from priorfill.datasets.fetch import choose_files

    if database is None and not download_only:
        raise click.UsageError(
            "give the database to add to (--database DIR), or say --download-only"
        )
    if database is None and folder is None:
        raise click.UsageError("say where the files go (--to FOLDER)")
    library = find_dataset(name)
    if folder is None:
        assert database is not None
        folder = database.absolute().parent / library.name
        if folder == database.absolute():
            raise click.UsageError("the database is where the files would go; give --to FOLDER")
    number = len(choose_files(library, only))
    _tell_terms(library, number, folder, mirror)
    if not yes:
        click.confirm("Do you accept these terms?", abort=True, err=True)
    failures = 0
    recordings: list[Path] = []
    downloads = get(
        library,
        folder,
        only=only,
        limit=limit,
        mirror=mirror,
        manners=RetryPolicy(pause=pause),
        progress=(bar := _Bar()).show,
        tell=lambda text: click.echo(f"note: {text}", err=True),
    )
    with bar:
        for fetched in _with_bar_removed(downloads, bar):
            if fetched.failure:
                failures += 1
                click.echo(f"priorfill: {fetched.failure}", err=True)
                continue
            verb = "downloaded" if fetched.new else "there already:"
            held = count(len(fetched.recordings), "recording")
            click.echo(f"{verb} {fetched.path} ({size(fetched.size)}, {held})")
            recordings += fetched.recordings
    click.echo(
        f"{count(len(recordings), 'recording')} in {folder}"
        + (f", could not download {failures}" if failures else "")
    )
    if database is not None and not download_only and recordings:
        _add(library, database, recordings)  # exits with 1 itself if one cannot be added
    if failures:
        click.get_current_context().exit(1)


def _tell_terms(library: Dataset, number: int, folder: Path, mirror: str | None) -> None:
    """Say what is to be downloaded, and on which terms; on stderr, beside the question."""
    for key, value in (
        ("library", f"{library.title} ({library.home})"),
        ("licence", library.licence),
        ("terms", library.terms),
        ("credit", library.credit),
        ("files", f"{number} of {len(library.files)}, from {mirror or library.base}"),
        ("to", str(folder)),
    ):
        click.echo(f"{key:<9} {value}", err=True)


def _add(library: Dataset, database: Path, recordings: list[Path]) -> None:
    """Add recordings with what the library says of them."""
    from priorfill.cli.db.adding import put_files, read_file, sound

    def put(target: Target, path: Path) -> tuple[ClipRecord, str]:
        options = {"up": None, "rate": None, "unit": None, "keep_zeros": False}
        clip, text = sound(read_file(target.reader, path, None, **options))
        record = target.open().add(
            clip,
            subject=library.subject(path.stem) or None,
            licence=library.licence,
            credit=library.credit,
        )
        return record, text

    put_files(database, recordings, put, done="added", doing="Adding", to_do="add")


class _Bar:
    """A progress bar in megabytes for one file after another."""

    def __init__(self) -> None:
        self._file: DatasetFile | None = None
        self._stack = ExitStack()

    def __enter__(self) -> _Bar:
        return self

    def __exit__(self, *error: object) -> None:
        self.remove()

    def show(self, file: DatasetFile, done: int, total: int | None) -> None:
        """Show how much of a file is there."""
        megabytes = None if total is None else -(-total // MEGABYTE)
        if file is not self._file:
            self.remove()
            self._file = file
            name = f"{file.path.rpartition('/')[2]} (MB)"
            self._show = self._stack.enter_context(progress(megabytes, name))
        self._show(done // MEGABYTE, megabytes)

    def remove(self) -> None:
        """Take the bar away, if there is one."""
        self._file = None
        self._stack.close()


def _with_bar_removed(downloads: Iterator[Fetched], bar: _Bar) -> Iterator[Fetched]:
    """Yield downloads, each when its bar is gone."""
    for fetched in downloads:
        bar.remove()
        yield fetched
