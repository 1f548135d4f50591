"""Survey the files of a study in child processes: one that hangs or kills its reader costs itself.

What was found is kept in the folder of the study, by content, so that no file is read twice.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import psutil

from priorfill.errors import OutputError
from priorfill.filling.provenance import package_versions
from priorfill.runtime.atomic_file import replace_file
from priorfill.study.child.child_process import ChildError, ChildProcess, child_command
from priorfill.study.job import JobLimits
from priorfill.study.survey import Survey, survey_file

__all__ = ["SURVEY_COMMAND", "survey_files", "surveys_of"]

SURVEY_COMMAND = "batch-survey"
"""The hidden command that a child runs."""

MAX_SECONDS = 120.0
"""s. Maximum time for one file. Reading an hour of 50 markers takes a few seconds."""

FILES_PER_CHILD = 40
"""Files from which on another child is worth its start; each file takes some hundredths of a
second."""


def survey_files(
    files: Sequence[tuple[str, str]],
    reading: Mapping[str, Any],
    kept: Path | None,
    limits: JobLimits,
    *,
    workers: int = 1,
    command: Sequence[str] | None = None,
) -> list[Survey]:
    """Return the facts of files, in their order.

    Parameters
    ----------
    files : sequence of (str, str)
        Name of the job, and absolute path of each.
    reading : mapping of str to object
        Keyword arguments of `priorfill.read`.
    kept : Path or None
        File that keeps what was found; it need not exist. None keeps nothing.
    limits : JobLimits
        What a child may use; for each file no more time than `MAX_SECONDS`.
    workers : int
        Maximum number of children at the same time.
    command : sequence of str, optional
        The program that surveys; by default the hidden command of this priorfill.
    """
    if not files:
        return []
    workers = max(1, min(workers, -(-len(files) // FILES_PER_CHILD)))
    limits = replace(
        limits,
        seconds=min(limits.seconds, MAX_SECONDS),
        memory=limits.memory or psutil.virtual_memory().total,
    )
    parts = [files[start::workers] for start in range(workers)]
    stop = threading.Event()
    found: dict[str, Survey] = {}

    def survey(part: Sequence[tuple[str, str]]) -> None:
        for one in _survey_part(part, reading, kept, limits, stop, command):
            found[one.name] = one

    pool = ThreadPoolExecutor(workers)
    try:
        for done in [pool.submit(survey, part) for part in parts]:
            while not done.done():
                with suppress(TimeoutError):
                    done.exception(timeout=0.5)  # on Windows, Ctrl-C does not end a wait
            done.result()
    finally:
        stop.set()
        pool.shutdown()
        if kept is not None:
            _keep(found.values(), reading, kept)
    return [found[name] for name, _ in files]


def surveys_of(request: Mapping[str, Any]) -> Iterator[Survey]:
    """Yield the surveys that a request asks for; in the child.

    Parameters
    ----------
    request : mapping of str to object
        With the files, the reading, and the file that keeps what was found.
    """
    kept = request["kept"]
    known = {} if kept is None else _read_kept(Path(kept), request["reading"])
    for name, source in request["files"]:
        yield survey_file(name, Path(source), request["reading"], known)


def _survey_part(
    files: Sequence[tuple[str, str]],
    reading: Mapping[str, Any],
    kept: Path | None,
    limits: JobLimits,
    stop: threading.Event,
    command: Sequence[str] | None,
) -> Iterator[Survey]:
    """Yield the surveys of files, by as many children as it takes one after the other."""
    left = list(files)
    again = ""  # the file that is tried a second time, after its child was killed
    while left:
        request = {"files": left, "reading": dict(reading), "kept": kept and str(kept)}
        request["limits"] = asdict(limits)
        with closing(
            ChildProcess(command or child_command(SURVEY_COMMAND), request, limits)
        ) as child:
            while left:
                name, source = left[0]
                try:
                    yield Survey.from_json(child.answer(stop))
                except ChildError as error:
                    if error.stopped:
                        return
                    if error.try_again and not error.exceeded and again != name:
                        again = name
                        break
                    yield Survey(name, source, "", reason=f"{source}: {error}")
                    del left[0]
                    break
                del left[0]


def _keep(surveys: Iterable[Survey], reading: Mapping[str, Any], kept: Path) -> None:
    """Keep what was found; where that cannot be written, files are read again next time."""
    known = _read_kept(kept, reading)
    size = len(known)
    for one in surveys:
        if one.subjects:
            known.setdefault(one.content, one.to_json()["subjects"])
    if len(known) > size:
        text = json.dumps({**_header(reading), "files": known})
        with suppress(OutputError), replace_file(kept, overwrite=True) as temporary:
            temporary.write_text(text + "\n", encoding="ascii", newline="\n")


def _header(reading: Mapping[str, Any]) -> dict[str, Any]:
    """Return all but the contents of a file that what was found depends on."""
    return {"versions": dict(package_versions()), "reading": dict(reading)}


def _read_kept(kept: Path, reading: Mapping[str, Any]) -> dict[str, Any]:
    """Return the facts that are kept, by content; nothing if they were read in another way."""
    header = _header(reading)
    try:
        values = json.loads(kept.read_text(encoding="ascii"))
        if {name: values[name] for name in header} == header:
            return dict(values["files"])
    except (OSError, ValueError, TypeError, LookupError, RecursionError):
        pass
    return {}
