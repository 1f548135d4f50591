"""``priorfill db fetch``: download a free data set, and add it to a database."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

from priorfill.cli.completion import complete_datasets
from priorfill.cli.db.common import count, size
from priorfill.cli.output import print_line, print_table
from priorfill.cli.path_types import FOLDER
from priorfill.cli.progress import progress

if TYPE_CHECKING:
    from priorfill.cli.db.adding import Target
    from priorfill.database import ClipRecord
    from priorfill.datasets import Dataset, DatasetFile, FetchOptions, FetchResult

__all__ = ["fetch"]

MEGABYTE = 1_000_000


def _list(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    """Print the known data sets, and exit."""
    del parameter
    if not value or context.resilient_parsing:
        return
    from priorfill.datasets import known_datasets

    rows = [
        (one.name, one.title, str(len(one.files)), one.marker_set or "-", one.licence, one.home)
        for one in known_datasets()
    ]
    print_table(("name", "data set", "files>", "marker set", "licence", "see"), rows)
    context.exit()


@click.command(short_help="Download a free data set into a database.")
@click.argument("name", metavar="DATASET", shell_complete=complete_datasets)
@click.option(
    "--list",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_list,
    help="Show the known data sets, and exit.",
)
@click.option(
    "--database",
    "-d",
    "database",
    metavar="DIR",
    type=FOLDER,
    help="The database's folder; required unless --download-only is given.",
)
@click.option(
    "--to",
    "folder",
    metavar="FOLDER",
    type=FOLDER,
    help="Folder for the files; by default one named as the data set, next to the database.",
)
@click.option(
    "--only",
    metavar="PATTERN",
    multiple=True,
    help='Only these files of the data set ("*03-0*"); can be repeated.',
)
@click.option(
    "--limit",
    metavar="N",
    type=click.IntRange(min=1),
    help="Download at most N files now.",
)
@click.option("--mirror", metavar="URL", help="Use this address instead of the data set's own.")
@click.option(
    "--pause",
    metavar="SECONDS",
    type=click.FloatRange(min=0),
    default=1.0,
    show_default=True,
    help="Wait between two files.",
)
@click.option("--yes", "-y", is_flag=True, help="Accept the terms of use without being asked.")
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
    """Download DATASET, hdm05 or cmu, and add its recordings to a database.

    Shows the terms of use first, and asks whether you accept them. To resume an interrupted
    download, give the same command again. A file that cannot be downloaded is reported, the others
    are downloaded, and the exit status is 1.
    """
    from priorfill.datasets import FetchOptions, RetryPolicy, find_dataset
    from priorfill.datasets.dataset_definitions import check_address
    from priorfill.datasets.fetch_dataset import choose_files

    if mirror is not None:
        check_address(mirror)
    if database is None and not download_only:
        raise click.UsageError("give the database to add to (--database DIR), or --download-only")
    if database is None and folder is None:
        raise click.UsageError("give a folder for the files (--to FOLDER)")
    dataset = find_dataset(name)
    if folder is None:
        assert database is not None
        folder = database.absolute().parent / dataset.name
        if folder == database.absolute():
            raise click.UsageError("the files would go into the database; give --to FOLDER")
    options = FetchOptions(only, limit, mirror, RetryPolicy(pause=pause))
    _print_terms(dataset, len(choose_files(dataset, only)), folder, mirror)
    if not yes:
        click.confirm("Do you accept these terms?", abort=True, err=True)
    recordings, failures = _download(dataset, folder, options)
    if database is not None and not download_only and recordings:
        _add(dataset, database, recordings)  # exits with 1 itself if one cannot be added
    if failures:
        click.get_current_context().exit(1)


def _print_terms(dataset: Dataset, number: int, folder: Path, mirror: str | None) -> None:
    """Print what will be downloaded and the terms of use, on stderr like the question."""
    for key, value in (
        ("data set", f"{dataset.title} ({dataset.home})"),
        ("licence", dataset.licence),
        ("terms", dataset.terms),
        ("credit", dataset.credit),
        ("files", f"{number} of {len(dataset.files)}, from {mirror or dataset.base}"),
        ("to", str(folder)),
    ):
        print_line(f"{key:<9} {value}", err=True)


def _download(dataset: Dataset, folder: Path, options: FetchOptions) -> tuple[list[Path], int]:
    """Download the files and print the result of each; return recordings and failures."""
    from priorfill.datasets import fetch as fetch_files

    failures = 0
    recordings: list[Path] = []
    with _DownloadBar() as bar:
        results = fetch_files(
            dataset,
            folder,
            options,
            progress=bar.show,
            notify=lambda text: print_line(f"note: {text}", err=True),
        )
        for result in _hiding(bar, results):
            if result.failure:
                failures += 1
                print_line(f"priorfill: {result.failure}", err=True)
                continue
            verb = "downloaded" if result.new else "there already:"
            number = count(len(result.recordings), "recording")
            print_line(f"{verb} {result.path} ({size(result.size)}, {number})")
            recordings += result.recordings
    print_line(
        f"{count(len(recordings), 'recording')} in {folder}"
        + (f", could not download {failures}" if failures else "")
    )
    return recordings, failures


def _add(dataset: Dataset, database: Path, recordings: list[Path]) -> None:
    """Add recordings with their subjects, and the data set's licence and credit."""
    from priorfill.cli.db.adding import ADD, put_files, read_file, without_artefacts
    from priorfill.database import ClipOrigin

    def put(target: Target, path: Path) -> tuple[ClipRecord, str]:
        reading = {"up": None, "rate": None, "unit": None, "keep_zeros": False}
        clip, text = without_artefacts(read_file(path, None, **reading))
        origin = ClipOrigin(
            subject=dataset.subject(path.stem) or None,
            licence=dataset.licence,
            credit=dataset.credit,
        )
        return target.add(clip, origin), text

    put_files(database, recordings, put, ADD)


class _DownloadBar:
    """A progress bar in megabytes for one file after another."""

    def __init__(self) -> None:
        self._file: DatasetFile | None = None
        self._stack = ExitStack()

    def __enter__(self) -> _DownloadBar:
        return self

    def __exit__(self, *error: object) -> None:
        self.hide()

    def show(self, file: DatasetFile, done: int, total: int | None) -> None:
        """Show how much of a file has been received."""
        megabytes = None if total is None else -(-total // MEGABYTE)
        if file is not self._file:
            self.hide()
            self._file = file
            name = f"{file.path.rpartition('/')[2]} (MB)"
            self._show = self._stack.enter_context(progress(megabytes, name))
        self._show(done // MEGABYTE, megabytes)

    def hide(self) -> None:
        """Remove the bar, if there is one."""
        self._file = None
        self._stack.close()


def _hiding(bar: _DownloadBar, results: Iterator[FetchResult]) -> Iterator[FetchResult]:
    """Yield results, each after the bar was hidden."""
    for result in results:
        bar.hide()
        yield result
