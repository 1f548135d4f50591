"""A job of a study, which is the fill of one file, and its outcome; both as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Literal, get_args

from priorfill.errors import escaped

__all__ = [
    "FAILED",
    "FILLED",
    "INCOMPLETE",
    "NO_GAPS",
    "JobLimits",
    "JobOutcome",
    "StudyJob",
    "memory_reason",
]

Status = Literal["filled", "incomplete", "no gaps", "failed"]
"""Status of a finished job."""

FILLED: Status = "filled"
"""All gaps are filled."""

INCOMPLETE: Status = "incomplete"
"""The output is written, but samples stay missing; the reasons are in the facts."""

NO_GAPS: Status = "no gaps"
"""Nothing was missing; the output is a copy."""

FAILED: Status = "failed"
"""No output is written; the outcome has the reason."""

MAX_NUMBER = 2**53
"""Seconds and bytes that an outcome has at most; larger ones are damage."""


@dataclass(frozen=True)
class JobLimits:
    """What a job may use.

    Attributes
    ----------
    seconds : float
        Maximum wall time (s).
    memory : int
        Maximum memory (bytes) that the process has to itself.
    threads : int
        Number of threads.

    Examples
    --------
    >>> JobLimits(seconds=600.0, memory=2**32, threads=1).threads
    1
    """

    seconds: float
    memory: int
    threads: int


@dataclass(frozen=True)
class StudyJob:
    """The fill of one file of a study.

    Attributes
    ----------
    name : str
        Path of the file within the study, with ``/``; it names the job.
    source, output : str
        Absolute paths of the file with gaps and of the file to write.
    record : str
        Absolute path of the file that keeps the outcome.
    settings : mapping of str to object
        Options of the fill as JSON values (`priorfill.study.settings`).
    database : str or None
        Absolute path of the prior database.
    same_subject : tuple of str
        Absolute paths of other recordings of the same subject.
    report, uncertainty : str or None
        Absolute paths of files to write in addition.
    overwrite : bool
        Whether files that are there may be replaced: they are those of an earlier outcome, or the
        user wants it.
    key : str
        Hash of all that decides the outcome: contents of the files read, settings, version of
        priorfill, state of the database. An outcome with the same key need not be computed again.
    database_state : str
        State of the database to learn from (`priorfill.PriorDatabase.state`); empty: the latest.

    Examples
    --------
    >>> job = StudyJob("P01/walk.c3d", "/in/P01/walk.c3d", "/out/P01/walk.c3d", "/out/r.json")
    >>> StudyJob.from_json(job.to_json()) == job
    True
    """

    name: str
    source: str
    output: str
    record: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    database: str | None = None
    same_subject: tuple[str, ...] = ()
    report: str | None = None
    uncertainty: str | None = None
    overwrite: bool = False
    key: str = ""
    database_state: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return the job as JSON values."""
        return asdict(self) | {"settings": dict(self.settings)}

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> StudyJob:
        """Return the job of `to_json`; names that are unknown are left out."""
        known = {one.name for one in fields(cls)}
        given = {name: value for name, value in values.items() if name in known}
        return cls(**given | {"same_subject": tuple(given.get("same_subject", ()))})


@dataclass(frozen=True)
class JobOutcome:
    """What became of a job.

    Attributes
    ----------
    name, source, output, report, uncertainty, key
        As in the job; `report` and `uncertainty` are None where none was written.
    status : str
        ``filled``, ``incomplete``, ``no gaps`` or ``failed``.
    reason : str
        One line that states why the job failed, and the remedy; else empty.
    try_again : bool
        Whether the failure may be due to the environment (a full disk, a limit, a killed process)
        rather than to the file, so that the same job may succeed later.
    seconds : float
        Wall time of the fill (s).
    peak_memory : int
        Largest memory of its process (bytes); 0 where unknown.
    exceeded : str
        The limit that ended the job, ``seconds`` or ``memory`` (`JobLimits`); else empty. A study
        with a greater limit tries again.
    facts : mapping of str to object
        The fill as ``priorfill fill --json`` prints it; empty where it failed.
    warnings : tuple of str
        What a person should look at, as the page of a fill words it.
    changed : str
        Which written files somebody changed after the fill, so that they are left as they are; else
        empty. It is one of the warnings, too.
    written : mapping of str to str
        SHA-256 of each written file, by its absolute path. A record is written before its files
        are renamed to these paths: they count as written where their contents have these hashes.
    replaced : mapping of str to str
        SHA-256 of files that were at these paths and might be replaced. Where a job was killed
        before it renamed its files, they may still be there, and may be replaced by the next run.

    See Also
    --------
    priorfill.batch : Fill all files of a study.

    Examples
    --------
    >>> outcome = JobOutcome("a.c3d", "/in/a.c3d", "/out/a.c3d", "failed", reason="no markers")
    >>> JobOutcome.from_json(outcome.to_json()) == outcome
    True
    """

    name: str
    source: str
    output: str
    status: Status
    reason: str = ""
    try_again: bool = False
    seconds: float = 0.0
    peak_memory: int = 0
    exceeded: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    changed: str = ""
    report: str | None = None
    uncertainty: str | None = None
    written: Mapping[str, str] = field(default_factory=dict)
    replaced: Mapping[str, str] = field(default_factory=dict)
    key: str = ""

    @classmethod
    def of_failure(
        cls, job: StudyJob, reason: str, *, try_again: bool = False, exceeded: str = ""
    ) -> JobOutcome:
        """Return the outcome of a job that failed.

        Parameters
        ----------
        job : StudyJob
            The job.
        reason, try_again, exceeded
            As in the attributes.
        """
        return cls(
            job.name,
            job.source,
            job.output,
            FAILED,
            reason=escaped(" ".join(reason.split())),
            try_again=try_again,
            exceeded=exceeded,
            key=job.key,
        )

    def to_json(self) -> dict[str, Any]:
        """Return the outcome as JSON values."""
        mappings = ("facts", "written", "replaced")
        return asdict(self) | {name: dict(getattr(self, name)) for name in mappings}

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> JobOutcome:
        """Return the outcome of `to_json`; names that are unknown are left out.

        Raises
        ------
        ValueError, TypeError, AttributeError
            If the values are not those of an outcome, such as in a damaged record.
        """
        known = {one.name for one in fields(cls)}
        given = {name: value for name, value in values.items() if name in known}
        outcome = cls(**given | {"warnings": tuple(given.get("warnings", ()))})
        if not outcome._is_sound():
            raise ValueError("is not the outcome of a job")
        return outcome

    def _is_sound(self) -> bool:
        """Return whether all values have the types of an outcome; facts are not looked into."""
        texts = [self.name, self.source, self.output, self.reason, self.exceeded, self.key]
        texts += [
            self.changed,
            *(one for one in (self.report, self.uncertainty) if one is not None),
        ]
        for hashes in (self.written, self.replaced):
            texts += [*hashes.keys(), *hashes.values()]
        return (
            all(isinstance(one, str) for one in (*texts, *self.warnings))
            and self.status in get_args(Status)
            and isinstance(self.facts, Mapping)
            and isinstance(self.try_again, bool)
            and 0.0 <= self.seconds <= MAX_NUMBER
            and 0 <= self.peak_memory <= MAX_NUMBER
        )


def memory_reason(limits: JobLimits) -> str:
    """Return why a job failed that needs more memory than it may use.

    Parameters
    ----------
    limits : JobLimits
        What it may use.
    """
    small = limits.memory < 1e9
    most = f"{limits.memory / 1e6:.0f} MB" if small else f"{limits.memory / 1e9:.1f} GB"
    return (
        f"needs more than {most} of memory; raise the limit "
        "(`memory_limit`), with fewer `workers` if the computer has no more"
    )
