"""Run a study: fill what is not done yet, keep the outcomes, and sum up.

The parts: `plan_study` finds and checks the jobs, `StudyRounds` orders them, `JobKeys` tells which
are done already, a `StudyExecutor` runs the rest, and `write_summary` sums up.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, Unpack

from priorfill.errors import OptionError, OutputError, PriorfillError
from priorfill.filling.fill_file import FileOptions
from priorfill.filling.fill_options import FillKeywords, FillOptions
from priorfill.filling.gap_filter import GapFilter
from priorfill.runtime.argument_types import check_path, check_type
from priorfill.study.child.run_child import remove_leftovers
from priorfill.study.job import FAILED, FILLED, NO_GAPS, JobOutcome, StudyJob
from priorfill.study.job_keys import JobKeys
from priorfill.study.local_executor import LocalExecutor, StudyExecutor
from priorfill.study.records import kept_outcomes, read_record, write_record
from priorfill.study.settings import FillSettings
from priorfill.study.settled_jobs import settled_outcome, with_earlier_file
from priorfill.study.study_folder import StudyFolder
from priorfill.study.study_options import StudyOptions
from priorfill.study.study_plan import StudyPlan, plan_study
from priorfill.study.study_progress import ProgressOfJobs
from priorfill.study.study_rounds import StudyRounds
from priorfill.study.summary.limits import SummaryLimits
from priorfill.study.summary.summarise import StudyContents
from priorfill.study.summary.summary_files import write_summary

__all__ = ["Study", "batch", "sum_up_study"]


@dataclass(frozen=True)
class Study:
    """A study that `priorfill.batch` ran.

    Attributes
    ----------
    folder : Path
        The folder of the filled files.
    outcomes : tuple of JobOutcome
        What became of each file, in the order of their names.
    waiting : tuple of str
        Names of files that are still to be filled (`StudyOptions.check_only`).
    done_before : int
        Number of outcomes that an earlier run had.
    summary : Path or None
        The page that sums up the study; None where none was written.
    notes : tuple of str
        What was left out of the study, and why there is no summary.

    See Also
    --------
    priorfill.batch : Fill all files of a study.

    Examples
    --------
    >>> Study(Path("filled"), ()).status
    'all'
    """

    folder: Path
    outcomes: tuple[JobOutcome, ...]
    waiting: tuple[str, ...] = ()
    done_before: int = 0
    summary: Path | None = None
    notes: tuple[str, ...] = ()

    @property
    def status(self) -> Literal["all", "some", "none"]:
        """Whether all files are complete, some, or none is filled."""
        if not self.waiting and all(one.status in (FILLED, NO_GAPS) for one in self.outcomes):
            return "all"
        return "none" if all(one.status == FAILED for one in self.outcomes) else "some"


def batch(
    paths: Path | str | Sequence[Path | str],
    output: Path | str,
    *,
    database: Path | str | None = None,
    files: FileOptions | None = None,
    study: StudyOptions | None = None,
    **arguments: Unpack[FillKeywords],
) -> Study:
    """Fill the gaps of all files of a study.

    Files are filled in child processes, so that a bad file costs itself only. Outcomes are
    kept: the same call continues a study that was interrupted, and fills nothing twice.

    Parameters
    ----------
    paths : Path or str, or a sequence of them
        Files and folders, which are searched for recordings.
    output : Path or str
        The folder for the filled files. They keep their names, and the folders in which they are
        below the folder that all paths have in common.
    database : Path or str, optional
        Folder of the prior database to learn from.
    files : FileOptions, optional
        How to read and write files; without what is for one file only.
    study : StudyOptions, optional
        Workers, limits, and what is written in addition.
    **arguments
        ``method``, ``gap_filter``, ``reject_artefacts`` and ``options`` of `priorfill.fill`.

    Returns
    -------
    Study
        The outcome of each file.

    Raises
    ------
    StudyError
        Where the study cannot begin, with all reasons.
    OptionError
        Where an option is out of range, or applies to one file only.
    OutputError
        Where another process fills the same study, or the summary cannot be written.

    See Also
    --------
    priorfill.fill_file : Fill the gaps of one file.

    Examples
    --------
    >>> import tempfile
    >>> import priorfill as pf
    >>> from priorfill.synthetic.demo import make_demo_clip
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = pf.write(f"{folder}/in/P01/walk.c3d", make_demo_clip()[1])
    ...     done = pf.batch(f"{folder}/in", f"{folder}/out", method="linear")
    >>> [(one.name, one.status) for one in done.outcomes]
    [('P01/walk.c3d', 'incomplete')]
    """
    options = study or StudyOptions()
    settings = _settings(files, arguments)
    check_type("paths", paths, (str, Path, list, tuple), "a path or a list of paths")
    check_path("output", output)
    given = [paths] if isinstance(paths, (str, Path)) else list(paths)
    for path in given:
        check_path("paths", path)
    plan = plan_study(given, output, settings, database, options)
    if options.check_only:
        return _StudyRun(plan, options).run()
    with plan.folder.locked(options.index):
        plan.folder.mark()
        return _StudyRun(plan, options).run()


def _settings(files: FileOptions | None, arguments: FillKeywords) -> FillSettings:
    """Return the settings that all files share."""
    if arguments.get("overrides") is not None:
        raise OptionError("`overrides` are for the gaps of one file, not for a study")
    return FillSettings(
        arguments.get("method", "auto"),
        arguments.get("gap_filter") or GapFilter(),
        arguments.get("reject_artefacts", False),
        files or FileOptions(),
        arguments.get("options") or FillOptions(),
    )


class _StudyRun:
    """A study that is run."""

    def __init__(self, plan: StudyPlan, options: StudyOptions) -> None:
        self._plan = plan
        self._options = options
        self._outcomes: dict[str, JobOutcome] = {}
        self._done_before = 0
        self._keys = JobKeys()
        self._rounds = StudyRounds(plan, options)

    def run(self) -> Study:
        """Run all jobs that are not settled, and sum up, also after an interruption."""
        progress: ProgressOfJobs | None = None
        ended: BaseException | None = None
        begun = time.monotonic()
        try:
            with _executor(self._plan, self._options) as executor:
                for jobs in self._rounds:
                    if progress is None:  # what is known after the survey
                        progress = ProgressOfJobs(self._rounds.work, self._options.progress)
                    self._run_round(jobs, executor, progress)
                    self._rounds.learn(self._outcomes)
        except (KeyboardInterrupt, PriorfillError, OSError) as error:
            ended = error
        study = self._study(self._rounds.notes, time.monotonic() - begun)
        if isinstance(ended, KeyboardInterrupt):
            summary = "" if study.summary is None else f" (summary: {study.summary})"
            done = f" with {len(study.outcomes)} of {len(self._plan.jobs)} files done"
            known = done if study.outcomes else ""  # else it did not come to look at records
            ended.args = (f"interrupted{known}{summary}; the same command continues",)
        if ended is not None:
            raise ended
        return study

    def _run_round(
        self, jobs: Sequence[StudyJob], executor: StudyExecutor, progress: ProgressOfJobs
    ) -> None:
        """Run the jobs of a round that are not settled."""
        state = next((job.database_state for job in jobs), "") or self._plan.database_state
        keyed = self._keys.with_keys(jobs, self._plan.database, state)
        settled = {job.name: settled_outcome(job, self._options) for job in keyed.jobs}
        done = [outcome for outcome in settled.values() if outcome is not None]
        self._done_before += sum(one.status != FAILED for one in done)
        done += keyed.failed
        self._outcomes |= {one.name: one for one in done}
        progress.settled(done)
        left = [job for job in keyed.jobs if settled[job.name] is None]
        if self._options.check_only:
            return
        remove_leftovers(*keyed.jobs)  # of an earlier run, also where nothing is written
        left.sort(key=lambda job: (-self._rounds.work[job.name], job.name))  # no long job last
        records = {job.name: job.record for job in left}
        with closing(executor.run(left)) as outcomes:  # an interrupt stops what runs
            for outcome in outcomes:
                _keep(outcome, records[outcome.name])
                self._outcomes[outcome.name] = outcome
                progress.filled(outcome)

    def _study(self, notes: tuple[str, ...], seconds: float) -> Study:
        """Return the study, summed up where all of it was to be done."""
        plan, options = self._plan, self._options
        left = sorted({job.name for job in plan.jobs} - self._outcomes.keys())
        study = Study(
            plan.folder.path,
            tuple(with_earlier_file(self._outcomes[name]) for name in sorted(self._outcomes)),
            tuple(left),
            self._done_before,
            notes=(*plan.notes, *notes),
        )
        if options.check_only or options.index is not None:
            return study
        if plan.jobs and not study.outcomes:  # an earlier summary says more
            return study
        if study.done_before:
            seconds = math.nan  # of a part
        return _summed_up(study, plan.folder, options, seconds)


def sum_up_study(output: Path | str, options: StudyOptions) -> Study:
    """Write the summary of a study again, from the records of what is done.

    Parameters
    ----------
    output : Path or str
        The folder of the filled files.
    options : StudyOptions
        Which summary is written.

    Raises
    ------
    OptionError
        If the folder is not that of a study.
    """
    folder = StudyFolder.at(output)
    outcomes = tuple(map(with_earlier_file, kept_outcomes(folder)))
    if not outcomes:
        raise OptionError(
            f"{folder.path}: holds no filled files of a study; check the folder, or give "
            "files and folders to fill"
        )
    return _summed_up(Study(folder.path, outcomes), folder, options, math.nan)


def _summed_up(study: Study, folder: StudyFolder, options: StudyOptions, seconds: float) -> Study:
    """Return a study whose summary is written; a note says why it could not be."""
    page = folder.summary if options.summary is None else options.summary
    try:
        _, files = write_summary(
            study.outcomes,
            page,
            limits=SummaryLimits(options.flag_error, options.flag_gap),
            contents=StudyContents(folder.path.name, study.waiting, seconds),
            overwrite=options.overwrite,
        )
    except OutputError as error:
        return replace(study, notes=(*study.notes, f"there is no summary: {error}"))
    return replace(study, summary=files.page, notes=(*study.notes, *files.problems))


def _executor(plan: StudyPlan, options: StudyOptions) -> StudyExecutor:
    """Return what runs the jobs."""
    if not options.uses_dask:
        return LocalExecutor(options.worker_count, options.limits)
    from priorfill.study.dask_executor import DaskExecutor  # takes half a second to import

    return DaskExecutor(
        options.limits,
        plan.folder.path,
        scheduler=options.scheduler,
        workers=options.worker_count,
    )


def _keep(outcome: JobOutcome, record: str) -> None:
    """Write the record of a job, unless its child did."""
    if read_record(record) != outcome:
        with suppress(OutputError):  # the next run does the job again
            write_record(record, outcome)
