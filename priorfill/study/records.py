"""Records of jobs: JSON files that keep outcomes, by which a study is continued."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from priorfill.runtime.atomic_file import replace_file
from priorfill.study.job import FAILED, JobLimits, JobOutcome, StudyJob

__all__ = [
    "file_hash",
    "is_settled",
    "read_record",
    "unchanged_files",
    "write_record",
]


def file_hash(path: Path | str) -> str:
    """Return the SHA-256 of a file's contents.

    Raises
    ------
    OSError
        If it cannot be read.
    """
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_record(path: Path | str) -> JobOutcome | None:
    """Return the outcome that a record keeps; None where there is none, or it is damaged."""
    try:
        values: Any = json.loads(Path(path).read_text("ascii"))
        return JobOutcome.from_json(values)
    except (OSError, ValueError, TypeError, AttributeError, RecursionError):
        return None


def write_record(path: Path | str, outcome: JobOutcome) -> None:
    """Write a record, completely or not at all.

    Parameters
    ----------
    path : Path or str
        The record.
    outcome : JobOutcome
        What it keeps.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    # names that are no UTF-8 stay what they are as escape sequences of ASCII
    text = json.dumps(outcome.to_json(), indent=1)
    with replace_file(path, overwrite=True) as temporary:
        temporary.write_text(text + "\n", "ascii", newline="\n")


def unchanged_files(written: Mapping[str, str]) -> dict[str, bool]:
    """Return for each written file that exists whether it is as it was written.

    Parameters
    ----------
    written : mapping of str to str
        SHA-256 by path.
    """
    found = {}
    for path, digest in written.items():
        if Path(path).exists():
            try:
                found[path] = file_hash(path) == digest
            except OSError:
                found[path] = False
    return found


def is_settled(outcome: JobOutcome, job: StudyJob, limits: JobLimits, *, retry: bool) -> bool:
    """Return whether a recorded outcome need not be computed again.

    Written files may have been changed since; those that are gone are written again.

    Parameters
    ----------
    outcome : JobOutcome
        Of the record.
    job : StudyJob
        The job with its key.
    limits : JobLimits
        What the job may use.
    retry : bool
        Whether failures are tried again.
    """
    if outcome.key != job.key or not job.key:
        return False
    if outcome.status != FAILED:
        return all(Path(path).exists() for path in outcome.written)
    if retry:
        return False
    if outcome.exceeded == "seconds":
        return outcome.seconds >= limits.seconds
    if outcome.exceeded == "memory":
        return outcome.peak_memory >= limits.memory
    return not outcome.try_again
