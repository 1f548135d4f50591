"""Run a study: fill what is not done yet, keep the outcomes, and sum up.

The parts: `plan_study` finds and checks the jobs, `StudyRounds` orders them, `JobKeys` tells which
are done already, a `StudyExecutor` runs the rest, and `write_summary` sums up.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, Unpack

from priorfill.errors import OptionError, OutputError
from priorfill.filling.fill_file import FileOptions
from priorfill.filling.fill_options import FillKeywords, FillOptions
from priorfill.filling.gap_filter import GapFilter
from priorfill.filling.provenance import DatabaseState
from priorfill.study.job import FAILED, FILLED, NO_GAPS, JobOutcome, StudyJob
from priorfill.study.job_keys import JobKeys
from priorfill.study.local_executor import LocalExecutor, StudyExecutor
from priorfill.study.records import read_record, write_record
from priorfill.study.settings import FillSettings
from priorfill.study.settled_jobs import settled_outcome
from priorfill.study.study_options import StudyOptions
from priorfill.study.study_plan import StudyPlan, plan_study
from priorfill.study.study_progress import ProgressOfJobs
from priorfill.study.study_rounds import StudyRounds

__all__ = ["Study", "batch"]


@dataclass(frozen=True)
class Study:
    """A study that `priorfill.batch` ran.

    Attributes
    ----------
    folder : Path
        The folder of the filled files.
    outcomes : tuple of JobOutcome
        What became of each file, in the order of their names.
    left : tuple of str
        Names of files that are still to be filled, where nothing was (`StudyOptions.check_only`).
    done_before : int
        Number of outcomes that an earlier run had.
    summary : Path or None
        The page that sums up the study.
    notes : tuple of str
        What was left out of the study.

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
    left: tuple[str, ...] = ()
    done_before: int = 0
    summary: Path | None = None
    notes: tuple[str, ...] = ()

    @property
    def status(self) -> Literal["all", "some", "none"]:
        """Whether all files are complete, some, or none is filled."""
        if not self.left and all(one.status in (FILLED, NO_GAPS) for one in self.outcomes):
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

    Each file is filled in a process of its own, so that a bad file costs itself only. Outcomes are
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
    given = [paths] if isinstance(paths, (str, Path)) else list(paths)
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
        self._left: list[str] = []
        self._done_before = 0
        self._keys = JobKeys()
        self._progress = ProgressOfJobs(plan.work, options.progress)

    def run(self) -> Study:
        """Run all jobs that are not settled, and sum up, also after an interruption."""
        rounds = StudyRounds(self._plan.jobs)
        interrupted = None
        try:
            with _executor(self._plan, self._options) as executor:
                for jobs in rounds:
                    self._run_round(jobs, executor)
                    rounds.learn(self._outcomes)
        except KeyboardInterrupt as error:
            interrupted = error
        study = self._sum_up()
        if interrupted is not None:
            interrupted.args = (
                f"interrupted with {len(self._outcomes)} of {len(self._plan.jobs)} files done; the "
                "same command continues",
            )
            raise interrupted
        return study

    def _run_round(self, jobs: Sequence[StudyJob], executor: StudyExecutor) -> None:
        """Run the jobs of a round that are not settled."""
        keyed = self._keys.with_keys(jobs, self._plan.database)
        settled = {job.name: settled_outcome(job, self._options) for job in keyed.jobs}
        done = [outcome for outcome in settled.values() if outcome is not None]
        self._done_before += sum(one.status != FAILED for one in done)
        done += keyed.failed
        self._outcomes |= {one.name: one for one in done}
        self._progress.settled(done)
        left = [job for job in keyed.jobs if settled[job.name] is None]
        if self._options.check_only:
            self._left += [job.name for job in left]
            return
        left.sort(key=lambda job: (-self._plan.work[job.name], job.name))  # no long job last
        records = {job.name: job.record for job in left}
        with closing(executor.run(left)) as outcomes:  # an interrupt stops what runs
            for outcome in outcomes:
                checked = _of_this_database(outcome, keyed.database)
                _keep(checked, records[outcome.name])
                self._outcomes[outcome.name] = checked
                self._progress.filled(checked)

    def _sum_up(self) -> Study:
        """Write the summary."""
        outcomes = tuple(self._outcomes[name] for name in sorted(self._outcomes))
        return Study(
            self._plan.folder.path,
            outcomes,
            tuple(sorted(self._left)),
            self._done_before,
            notes=self._plan.notes,
        )


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


def _of_this_database(outcome: JobOutcome, expected: DatabaseState | None) -> JobOutcome:
    """Return an outcome; without a key where the database was changed during the study.

    The next run then fills the file again, from the database as it is.
    """
    provenance = outcome.facts.get("provenance") or {}
    used = provenance.get("database") or {}
    if expected is None or not used or used.get("content") == expected.content:
        return outcome
    warning = "the database was changed while the study ran; the same command fills the file again"
    return replace(outcome, key="", warnings=(warning, *outcome.warnings))


def _keep(outcome: JobOutcome, record: str) -> None:
    """Write the record of a job, unless its child did."""
    if read_record(record) != outcome:
        with suppress(OutputError):  # the next run does the job again
            write_record(record, outcome)
