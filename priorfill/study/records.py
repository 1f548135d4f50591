"""Records of jobs: JSON files that keep outcomes, by which a study is continued."""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from priorfill.formats.bids.names import all_side_files
from priorfill.runtime.atomic_file import replace_file
from priorfill.study.job import JobOutcome, StudyJob
from priorfill.study.study_folder import StudyFolder

__all__ = [
    "FileState",
    "contents_hash",
    "file_hash",
    "file_states",
    "files_of_job",
    "kept_outcomes",
    "read_record",
    "record_of_job",
    "write_record",
]

MAX_BYTES = 2**28
"""Maximum size of a record; one of a thousand gaps has 1 MB."""

FileState = Literal["written", "earlier", "changed"]
"""Whether a file is as the run of the record wrote it, or the run before, or was changed since."""


def file_hash(path: Path | str) -> str:
    """Return the SHA-256 of a file's contents.

    Raises
    ------
    OSError
        If it cannot be read.
    """
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def contents_hash(path: Path) -> str:
    """Return the SHA-256 of a recording, and of its side files where it has some.

    Raises
    ------
    OSError
        If a file cannot be read.
    """
    hashes = [file_hash(one) for one in (path, *all_side_files(path))]
    if len(hashes) == 1:
        return hashes[0]
    return hashlib.sha256(" ".join(hashes).encode()).hexdigest()


def read_record(path: Path | str) -> JobOutcome | None:
    """Return the outcome that a record keeps; None where there is none, or it is damaged."""
    path = Path(path)
    try:
        if path.stat().st_size > MAX_BYTES:
            return None
        values: Any = json.loads(path.read_text(encoding="ascii"))
        return JobOutcome.from_json(values)
    except (OSError, ValueError, TypeError, AttributeError, RecursionError):
        return None


def record_of_job(job: StudyJob) -> JobOutcome | None:
    """Return what the record of a job keeps, with the paths of the job: a study can be moved.

    Parameters
    ----------
    job : StudyJob
        The job.
    """
    kept = read_record(job.record)
    if kept is None:
        return None
    places = {
        kept.output: job.output,
        kept.report: job.report,
        kept.uncertainty: job.uncertainty,
    }
    for path in {**kept.written, **kept.replaced}:
        if path not in places and Path(path).parent == Path(kept.output).parent:
            places[path] = str(Path(job.output).with_name(Path(path).name))
    return replace(
        kept,
        source=job.source,
        output=job.output,
        report=kept.report and places[kept.report],
        uncertainty=kept.uncertainty and places[kept.uncertainty],
        written={places.get(path) or path: digest for path, digest in kept.written.items()},
        replaced={places.get(path) or path: digest for path, digest in kept.replaced.items()},
    )


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
        temporary.write_text(text + "\n", encoding="ascii", newline="\n")


def file_states(record: JobOutcome | None) -> dict[str, FileState]:
    """Return for each file of a record that exists whose it is.

    A record is written before its files are renamed. So a job that was killed then has left the
    files of the run before, ``earlier``.

    Parameters
    ----------
    record : JobOutcome or None
        What a record keeps.
    """
    if record is None:
        return {}
    found: dict[str, FileState] = {}
    for path in {**record.written, **record.replaced}:
        with suppress(FileNotFoundError, NotADirectoryError):
            found[path] = _file_state(path, record)
    return found


def _file_state(path: str, record: JobOutcome) -> FileState:
    try:
        digest = file_hash(path)
    except FileNotFoundError:
        raise
    except OSError:
        return "changed"
    if digest == record.written.get(path):
        return "written"
    return "earlier" if digest == record.replaced.get(path) else "changed"


def kept_outcomes(folder: StudyFolder) -> tuple[JobOutcome, ...]:
    """Return all outcomes that a study keeps, by name, with the paths that files have there.

    Parameters
    ----------
    folder : StudyFolder
        The folder of the study.
    """
    found = {}
    for path in folder.records.rglob("*.json"):
        outcome = None if path.name.startswith(".") else read_record(path)
        if outcome is not None and folder.record(outcome.name) == path:  # else of somebody else
            name = outcome.name
            found[name] = replace(
                outcome,
                output=str(folder.output(name)),
                report=outcome.report and str(folder.report(name)),
                uncertainty=outcome.uncertainty and str(folder.uncertainty(name)),
            )
    return tuple(found[name] for name in sorted(found))


def files_of_job(job: StudyJob) -> dict[str, str]:
    """Return the SHA-256 of the files that earlier runs of a job wrote, and nobody changed since.

    Parameters
    ----------
    job : StudyJob
        The job.
    """
    record = record_of_job(job)
    if record is None:
        return {}
    known = {"written": record.written, "earlier": record.replaced}
    return {
        path: known[state][path]
        for path, state in file_states(record).items()
        if state != "changed"
    }
