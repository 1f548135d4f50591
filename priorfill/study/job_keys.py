"""Keys of jobs: hashes of all that decides an outcome, by which done jobs are known."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from priorfill.database import PriorDatabase
from priorfill.filling.provenance import DatabaseState, database_state, package_versions
from priorfill.formats.file_bytes import no_such_file
from priorfill.study.job import JobOutcome, StudyJob
from priorfill.study.records import contents_hash

__all__ = ["JobKeys", "KeyedJobs"]

_READERS = 4
"""Files that are read at the same time to be hashed."""


@dataclass(frozen=True)
class KeyedJobs:
    """Jobs with their keys.

    Attributes
    ----------
    jobs : tuple of StudyJob
        The jobs.
    failed : tuple of JobOutcome
        Outcomes of those whose files cannot be read.
    """

    jobs: tuple[StudyJob, ...]
    failed: tuple[JobOutcome, ...]


class JobKeys:
    """Keys of the jobs of a study; each file is read once.

    A key depends on the contents of the files, the settings, the versions of priorfill and of the
    packages that results depend on, the state of the database, and on what is to be written; not
    on folders, names of files, and the time.
    """

    def __init__(self) -> None:
        self._hashes: dict[str, str | OSError] = {}

    def with_keys(
        self, jobs: Sequence[StudyJob], database: Path | None, state: str = ""
    ) -> KeyedJobs:
        """Return jobs with their keys.

        Parameters
        ----------
        jobs : sequence of StudyJob
            The jobs of a round, which learn from one state of the database.
        database : Path or None
            The database.
        state : str
            The state of it that the jobs learn from; by default the latest.
        """
        files = {job.name: (job.source, *job.same_subject) for job in jobs}
        self._read({path for paths in files.values() for path in paths})
        contents = None
        if database is not None:
            with PriorDatabase.open(database, state=state) as opened:
                contents, state = database_state(opened), opened.state
        keyed, failed = [], []
        for job in jobs:
            unreadable = [
                (str(found.filename or path), found)
                for path in files[job.name]
                if isinstance(found := self._hashes[path], OSError)
            ]
            if unreadable:
                path, error = unreadable[0]
                reason = f"{path}: cannot be read ({error.strerror}); check its permissions"
                if isinstance(error, FileNotFoundError):
                    reason = str(no_such_file(Path(path)))
                failed.append(JobOutcome.of_failure(job, reason, try_again=True))
            else:
                key = self._key(job, contents)
                keyed.append(replace(job, key=key, database_state=state))
        return KeyedJobs(tuple(keyed), tuple(failed))

    def _read(self, paths: set[str]) -> None:
        unknown = sorted(paths - self._hashes.keys())
        with ThreadPoolExecutor(_READERS) as pool:
            self._hashes |= zip(unknown, pool.map(_hash_or_error, unknown), strict=True)

    def _key(self, job: StudyJob, contents: DatabaseState | None) -> str:
        content = {
            "source": self._hashes[job.source],
            "same_subject": [self._hashes[path] for path in job.same_subject],
            "settings": job.settings,
            "versions": dict(package_versions()),
            "database": None if contents is None else asdict(replace(contents, path="")),
            "suffix": Path(job.output).suffix,
            "report": job.report is not None,
            "uncertainty": job.uncertainty is not None,
        }
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _hash_or_error(path: str) -> str | OSError:
    try:
        return contents_hash(Path(path))
    except OSError as error:
        return error
