"""Fill the file of a job, inside the child process of that job.

Outputs are written under temporary names, then the record, and then the outputs get their names. A
record whose files have other contents than it says is that of a job that was killed in between;
the next run fills the file again.
"""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from priorfill.errors import OutputError, PriorfillError, escaped
from priorfill.filling.companion_files import companion_files
from priorfill.filling.fill_facts import fill_facts
from priorfill.filling.fill_file import FileOptions, FileResult, FileToFill, write_filled
from priorfill.report.gap_warnings import gap_warnings
from priorfill.report.shown_text import MAX_LABEL, shown
from priorfill.runtime.atomic_file import (
    check_target,
    finish_file,
    finish_new_file,
    hand_on_permissions,
    remove_abandoned,
    remove_folder,
    temporary_name,
)
from priorfill.runtime.error_line import error_line
from priorfill.study.child.own_memory import peak_memory
from priorfill.study.job import (
    FILLED,
    INCOMPLETE,
    NO_GAPS,
    JobLimits,
    JobOutcome,
    StudyJob,
    memory_reason,
)
from priorfill.study.records import file_hash, files_of_job, write_record
from priorfill.study.settings import FillSettings

if TYPE_CHECKING:
    from priorfill.filling.result import Result
    from priorfill.study.job import Status

__all__ = ["fill_job"]

FILL = "priorfill fill for this file"
"""The command that shows a bug; a child process shows no traceback."""


def fill_job(job: StudyJob, limits: JobLimits | None = None) -> JobOutcome:
    """Fill the file of a job, write its outputs and its record, and return the outcome.

    Parameters
    ----------
    job : StudyJob
        The job.
    limits : JobLimits, optional
        What it may use: where memory is refused, the reason is the limit.

    Returns
    -------
    JobOutcome
        The outcome, of a failure as well.
    """
    begin = time.monotonic()
    try:
        return _fill(job, begin)
    except Exception as error:
        outcome = replace(
            _failure(job, limits, error),
            seconds=time.monotonic() - begin,
            replaced=files_of_job(job),
        )
        with suppress(OutputError):  # then the job is simply done again
            write_record(job.record, outcome)
        return outcome


def _fill(job: StudyJob, begin: float) -> JobOutcome:
    """Fill the file of a job; what fails is raised."""
    ours = files_of_job(job)
    settings = FillSettings.from_json(job.settings)
    program = settings.files.program
    companions = [
        str(path) for path in companion_files(Path(job.output), Path(job.source), program)
    ]
    new = [_NewFile.check(path, job, ours) for path in (*companions, *_paths(job))]
    files = replace(
        settings.files,
        report=job.report,
        uncertainty=job.uncertainty,
        overwrite=True,
    )
    work = FileToFill.read(
        Path(job.source),
        Path(job.output),
        database=job.database,
        same_subject=job.same_subject,
        files=files,
        read_alike=True,
        **settings.fill_arguments(job.database_state),
    )
    result = work.fill()
    with ExitStack() as stack:
        waiting = {
            file.path: stack.enter_context(file.waiting())
            for file in new
            if file.path not in companions
        }
        waiting |= {path: waiting[job.output].with_name(Path(path).name) for path in companions}
        done = _write_waiting(job, work, result, files, waiting)
        outcome = JobOutcome(
            job.name,
            job.source,
            job.output,
            _status(done),
            seconds=time.monotonic() - begin,
            peak_memory=peak_memory(),
            facts=fill_facts(done),
            warnings=_warnings(done),
            report=job.report,
            uncertainty=job.uncertainty,
            written={path: file_hash(place) for path, place in waiting.items()},
            # files that are not written this time, such as a page, stay known
            replaced=ours | {file.path: file.digest for file in new if file.digest},
            key=job.key,
        )
        write_record(job.record, outcome)
        for file in new:
            file.finish(waiting[file.path])
    return outcome


def _paths(job: StudyJob) -> list[str]:
    """Return the paths of the files to write, the filled file last."""
    return [path for path in (job.report, job.uncertainty, job.output) if path is not None]


@dataclass(frozen=True)
class _NewFile:
    """A file to write.

    Attributes
    ----------
    path : str
        As in the job.
    target : Path
        The same with links resolved.
    digest : str
        SHA-256 of the file that is there; empty where there is none.
    """

    path: str
    target: Path
    digest: str

    @classmethod
    def check(cls, path: str, job: StudyJob, ours: Mapping[str, str]) -> _NewFile:
        """Check that a file can be written, and that none is lost but those of this job."""
        target = check_target(path, overwrite=True, source=Path(job.source))
        digest = file_hash(target) if target.exists() else ""
        if digest and not job.overwrite and digest not in ours.values():
            raise OutputError(
                f"{path}: exists already, and is not what this study wrote; move it away, or use "
                "`overwrite`"
            )
        return cls(path, target, digest)

    @contextmanager
    def waiting(self) -> Iterator[Path]:
        """Provide a path for the file with the same name, in a temporary folder next to it."""
        folder = self.target.parent / temporary_name("")
        try:
            remove_abandoned(self.target.parent)
            folder.mkdir(parents=True)
            yield folder / Path(self.path).name
        except OSError as error:
            message = (
                str(error) if isinstance(error, PriorfillError) else escaped(error_line(error))
            )
            place = f"{Path(self.path).parent}{os.sep}"
            raise OutputError(message.replace(escaped(f"{folder}{os.sep}"), place)) from error
        finally:
            remove_folder(folder)

    def finish(self, waiting: Path) -> None:
        """Give the file its name; one that somebody wrote meanwhile is not replaced."""
        there = file_hash(self.target) if self.target.exists() else ""
        if there not in (self.digest, ""):
            raise OutputError(f"{self.path}: was changed while writing; move it away")
        if there:
            hand_on_permissions(self.target, waiting)
            finish_file(waiting, self.target)
        elif not finish_new_file(waiting, self.target):
            raise OutputError(f"{self.path}: appeared while writing; move it away")


def _write_waiting(
    job: StudyJob,
    work: FileToFill,
    result: Result,
    files: FileOptions,
    waiting: Mapping[str, Path],
) -> FileResult:
    """Write a result into files that wait for their names."""
    temporary = replace(
        files,
        report=job.report and waiting[job.report],
        uncertainty=job.uncertainty and waiting[job.uncertainty],
    )
    done = write_filled(work, result, waiting[job.output], temporary)
    return replace(
        done,
        output=Path(job.output),
        uncertainty=None if job.uncertainty is None else Path(job.uncertainty),
        further={} if job.report is None else {"report": (Path(job.report),)},
        companions=companion_files(Path(job.output), Path(job.source), files.program),
    )


def _status(done: FileResult) -> Status:
    if not done.result.complete:
        return INCOMPLETE
    return FILLED if done.result.gaps else NO_GAPS


def _warnings(done: FileResult) -> tuple[str, ...]:
    """Return what a person should look at, gap by gap."""
    result = done.result
    first = result.clip.first_frame
    return tuple(
        f"{shown(gap.label, MAX_LABEL)}, "
        f"frames {first + gap.start}-{first + gap.stop - 1}: {warning.text}"
        for gap, warnings in zip(result.gaps, gap_warnings(result), strict=True)
        for warning in warnings
    )


def _failure(job: StudyJob, limits: JobLimits | None, error: Exception) -> JobOutcome:
    """Return the outcome of a job that raised an error."""
    causes: list[BaseException] = [error]
    while (cause := causes[-1].__cause__) is not None:
        causes.append(cause)
    if limits is not None and any(map(_is_of_memory, causes)):
        outcome = JobOutcome.of_failure(
            job, memory_reason(limits), try_again=True, exceeded="memory"
        )
        # what was refused does not count as used
        return replace(outcome, peak_memory=max(peak_memory(), limits.memory))
    # those of the environment: the same job may succeed later
    try_again = any(isinstance(one, (OSError, ImportError, MemoryError)) for one in causes)
    try_again |= not Path(job.source).exists()  # a drive or a share that is gone
    outcome = JobOutcome.of_failure(job, error_line(error, FILL), try_again=try_again)
    return replace(outcome, peak_memory=peak_memory())


def _is_of_memory(error: BaseException) -> bool:
    return isinstance(error, MemoryError) or (
        isinstance(error, OSError) and error.errno == errno.ENOMEM
    )
