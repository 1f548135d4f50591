"""The plan of a study: its jobs, and whatever would prevent them, found before the first fill."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from priorfill.database import PriorDatabase
from priorfill.errors import OptionError, PriorfillError, StudyError
from priorfill.filling.add_result import can_create_database
from priorfill.formats import PROGRAMS
from priorfill.runtime.atomic_file import is_same_file
from priorfill.study.find_sources import StudySource, find_sources
from priorfill.study.job import StudyJob
from priorfill.study.settings import FillSettings
from priorfill.study.study_folder import StudyFolder
from priorfill.study.study_options import StudyOptions
from priorfill.study.summary.summary_files import check_summary

__all__ = ["StudyPlan", "plan_study"]


@dataclass(frozen=True)
class StudyPlan:
    """What a study will do.

    Attributes
    ----------
    folder : StudyFolder
        Where it writes.
    jobs : tuple of StudyJob
        In the order of their names; without keys.
    work : dict of str to float
        How much work each job is, in any unit, by name: bytes of its source.
    database : Path or None
        The database.
    database_state : str
        The state of it to learn from; empty: the latest.
    notes : tuple of str
        What was left out.
    sources : tuple of StudySource
        All files of the study, also those of other tasks of an array.
    """

    folder: StudyFolder
    jobs: tuple[StudyJob, ...]
    work: dict[str, float]
    database: Path | None
    database_state: str
    notes: tuple[str, ...]
    sources: tuple[StudySource, ...]


def plan_study(
    paths: Sequence[Path | str],
    output: Path | str,
    settings: FillSettings,
    database: Path | str | None,
    options: StudyOptions,
) -> StudyPlan:
    """Find the jobs of a study, and check what can be checked.

    Parameters
    ----------
    paths : sequence of Path or str
        Files and folders.
    output : Path or str
        The folder for the filled files.
    settings : FillSettings
        Options of the fills.
    database : Path or str or None
        The database.
    options : StudyOptions
        How the study is run.

    Raises
    ------
    StudyError
        With all problems.
    """
    program = settings.files.program
    folder = StudyFolder.at(output, "" if program is None else PROGRAMS[program].suffix)
    # links are not resolved
    prior = None if database is None else Path(os.path.abspath(database))  # noqa: PTH100
    state = settings.options.database_state
    problems: list[PriorfillError] = []

    def tried(check: Callable[[], object]) -> None:
        try:
            check()
        except PriorfillError as error:
            problems.append(error)

    found = None
    try:
        found = find_sources(paths, folder.path)
        problems += map(OptionError, found.problems)
    except OptionError as error:
        problems.append(error)
    sources = () if found is None else found.sources
    sizes = {one.name: _size(one.path) for one in sources}
    tried(lambda: _check_folder(sources, sizes, folder, options))
    tried(lambda: _check_names(sources, folder, options))
    tried(lambda: _check_database(prior, state, options))
    if options.grow and program is not None:
        problems.append(
            OptionError(
                "files for a program are turned and rounded, and a database cannot tell of which "
                "recordings they are versions; use `grow` without `program`"
            )
        )
    notes = [] if found is None else list(found.notes)
    if options.uses_dask:
        tried(lambda: notes.extend(_cluster_notes(options)))
    if problems:
        raise StudyError(problems)
    assert found is not None
    stored, path = settings.to_json(), None if prior is None else str(prior)
    jobs = tuple(_job(one, folder, options, stored, path) for one in sources)
    if options.index is not None:
        jobs = jobs[options.index - 1 :: options.of]
    work = {job.name: max(sizes[job.name], 1.0) for job in jobs}
    return StudyPlan(folder, jobs, work, prior, state, tuple(notes), tuple(sources))


def _job(
    source: StudySource,
    folder: StudyFolder,
    options: StudyOptions,
    settings: dict[str, Any],
    database: str | None,
) -> StudyJob:
    """Return the job of a source."""
    name = source.name
    return StudyJob(
        name,
        str(source.path),
        str(folder.output(name)),
        str(folder.record(name)),
        settings,
        database,
        report=str(folder.report(name)) if options.report else None,
        uncertainty=str(folder.uncertainty(name)) if options.uncertainty else None,
        overwrite=options.overwrite,
    )


def _check_database(database: Path | None, state: str, options: StudyOptions) -> None:
    """Raise PriorfillError where the database cannot be read or, if it grows, not be written."""
    if options.grow and database is None:
        raise OptionError("`grow` needs a database; give the folder of one (`database`)")
    if options.grow and state:
        raise OptionError("`grow` adds to the latest state of a database; give no other")
    if database is None or (options.grow and can_create_database(database)):
        return
    PriorDatabase.open(database, state=state).close()
    if options.grow and not options.check_only:
        PriorDatabase.open(database, write=True).close()


def _cluster_notes(options: StudyOptions) -> list[str]:
    """Return what a user should know of the cluster.

    Raises
    ------
    PriorfillError
        Where Dask is not installed, or the address of the scheduler is none.
    """
    from priorfill.study.dask_executor import check_address  # takes half a second to import

    warning = "" if options.scheduler is None else check_address(options.scheduler)
    return [warning] if warning else []


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:  # reading it reports the reason
        return 0


def _check_folder(
    sources: Sequence[StudySource],
    sizes: dict[str, int],
    folder: StudyFolder,
    options: StudyOptions,
) -> None:
    """Raise an error where filled files, or the summary, cannot be written."""
    folder.check(sum(sizes[one.name] for one in sources if not folder.output(one.name).exists()))
    if options.index is None:  # a task of an array writes no summary
        _check_summary(sources, folder, options)


def _check_summary(
    sources: Sequence[StudySource], folder: StudyFolder, options: StudyOptions
) -> None:
    """Raise an error where the summary cannot be written, or has the name of an output."""
    page = folder.summary if options.summary is None else options.summary
    files = check_summary(page, overwrite=options.overwrite).all
    # links are not resolved
    names = [os.path.abspath(file) for file in files]  # noqa: PTH100
    alike = {name.casefold(): Path(name) for name in names}
    for one in sources:
        paths = [folder.output(one.name), *([folder.report(one.name)] if options.report else ())]
        for path in paths:
            name = alike.get(str(path).casefold())
            if name is not None and is_same_file(name, path):
                raise OptionError(
                    f"{path}: is an output of {one.path}, and would be a file of the summary; give "
                    "the summary another name (`summary`)"
                )


def _check_names(
    sources: Sequence[StudySource], folder: StudyFolder, options: StudyOptions
) -> None:
    """Raise OptionError where two sources have one output, or an output is a source."""
    first: dict[str, Path] = {}
    written: dict[Path, StudySource] = {}
    for one in sources:
        paths = [folder.output(one.name)]
        if options.uncertainty:
            paths.append(folder.uncertainty(one.name))
        for path in paths:
            alike = str(path).casefold()
            other = written.get(path)
            if other is None and alike in first and is_same_file(first[alike], path):
                other = written[first[alike]]
            if other is not None:
                raise OptionError(
                    f"{other.path} and {one.path} would have one output, {path}; rename one of them"
                )
            first.setdefault(alike, path)
            written[path] = one
    given = {os.path.realpath(one.path) for one in sources}
    for one in sources:
        if os.path.realpath(folder.output(one.name)) in given:
            raise OptionError(
                f"{folder.output(one.name)}: is a file to be filled; choose another folder for the "
                "filled files (`output`)"
            )
