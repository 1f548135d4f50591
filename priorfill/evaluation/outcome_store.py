"""The folder of an evaluation, which keeps finished outcomes so that an evaluation can be resumed.

::

    DIR/evaluation.json    the settings; an evaluation with other settings is refused
    DIR/cases/*.npz        one outcome each, written atomically
    DIR/gaps.csv ...       the results, written at the end
"""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from priorfill.errors import OptionError, OutputError
from priorfill.evaluation.evaluation_plan import EvaluationPlan, FillJob
from priorfill.evaluation.evaluation_results import FILES
from priorfill.evaluation.gap_case import FillOutcome, GapSource
from priorfill.evaluation.metrics import MEASURES
from priorfill.runtime.atomic_file import check_target, replace_file
from priorfill.runtime.held_files import is_held, retry_while_held

__all__ = ["OutcomeStore"]

SETTINGS = "evaluation.json"
CASES = "cases"
PLOTS = "error*_by_*.png"

JOINT = "joint "
"""Prefix of the names of arrays of joint angles."""

_UNREADABLE = (
    *(OSError, ValueError, LookupError, TypeError, AttributeError),
    *(EOFError, RecursionError, zipfile.BadZipFile, zlib.error),
)
"""Errors of reading an outcome that was damaged, such as by a power failure."""

MAX_SHOWN = 60
"""Maximum number of characters of a setting in a message."""


class OutcomeStore:
    """A folder that keeps the outcomes of one plan.

    Parameters
    ----------
    folder : Path
        Created if it does not exist.
    plan : EvaluationPlan
        The plan.
    overwrite : bool
        Start anew, and remove what an earlier evaluation left.

    Raises
    ------
    OptionError
        Where the folder has an evaluation with other settings; the message names one.
    OutputError
        Where it has other contents, or cannot be written.
    """

    def __init__(self, folder: Path, plan: EvaluationPlan, *, overwrite: bool = False) -> None:
        self.folder = folder
        self.plan = plan
        settings = json.loads(json.dumps(plan.settings))
        begun = check_folder(folder)
        if begun is not None and not overwrite:
            differs = _difference(begun, settings)
            if differs:
                raise OptionError(
                    f"{folder}: holds an evaluation with {differs}; take the same options, "
                    "another folder, or `overwrite`"
                )
            for name in FILES:  # before the work, as they are replaced at its end
                for file in folder.glob(name):
                    check_target(file, overwrite=True)
        try:
            (folder / CASES).mkdir(parents=True, exist_ok=True)
            if overwrite:  # results of the evaluation that is replaced: first, as users open them
                for name in (*FILES, PLOTS):
                    for file in folder.glob(name):
                        retry_while_held(file.unlink)
            # partial files of a killed process; to start anew, everything
            for file in (folder / CASES).glob("*" if overwrite else ".*.part.npz"):
                retry_while_held(file.unlink)
        except OSError as error:
            remedy = "close the program that has it open" if is_held(error) else "check permissions"
            raise OutputError(
                f"{error.filename or folder}: cannot be written ({error.strerror}); {remedy}"
            ) from error
        if begun is None or overwrite:
            with replace_file(folder / SETTINGS, overwrite=True) as temporary:
                temporary.write_text(
                    json.dumps(settings, indent=2) + "\n", encoding="utf-8", newline="\n"
                )

    def _file(self, job: FillJob) -> Path:
        return self.folder / CASES / f"{job.case:05d}-{job.method}.npz"

    def keep(self, job: FillJob, outcome: FillOutcome) -> None:
        """Write an outcome atomically."""
        facts = {
            "seconds": outcome.seconds,
            "gap_sources": [asdict(source) for source in outcome.gap_sources],
            "refused": outcome.refused,
            "notes": outcome.notes,
        }
        arrays: dict[str, Any] = {JOINT + name: off for name, off in outcome.joints.items()}
        with replace_file(self._file(job), overwrite=True) as temporary:
            np.savez_compressed(
                temporary, facts=np.array(json.dumps(facts)), samples=outcome.samples, **arrays
            )

    def kept(self) -> Iterator[tuple[FillJob, FillOutcome]]:
        """Yield the outcomes that are kept; unreadable ones are left out, and so made again."""
        for job in self.plan.jobs:
            with suppress(*_UNREADABLE):
                outcome = self._read(job)
                if outcome.samples.shape == (len(MEASURES), self.plan.cases[job.case].samples):
                    yield job, outcome

    def _read(self, job: FillJob) -> FillOutcome:
        with self._file(job).open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            facts = json.loads(str(arrays["facts"]))
            return FillOutcome(
                seconds=facts["seconds"],
                samples=arrays["samples"],
                joints={
                    name.removeprefix(JOINT): arrays[name]
                    for name in arrays.files
                    if name.startswith(JOINT)
                },
                gap_sources=tuple(_gap_source(source) for source in facts["gap_sources"]),
                refused=facts["refused"],
                notes=tuple(facts["notes"]),
            )


def _gap_source(facts: dict[str, Any]) -> GapSource:
    """Return a gap's source from its JSON form, whose tuples are lists."""
    return GapSource(
        sources=tuple(facts["sources"]),
        source_clips=tuple(facts["source_clips"]),
        training_poses=facts["training_poses"],
        unfilled=tuple(facts["unfilled"]),
    )


def check_folder(folder: Path) -> dict[str, Any] | None:
    """Return the settings of the evaluation in a folder; None where it is empty.

    Raises
    ------
    OutputError
        Where it is not a folder, or has other contents.
    """
    if not folder.exists():
        return None
    if not folder.is_dir():
        raise OutputError(f"{folder}: is a file; give a folder for the results")
    file = folder / SETTINGS
    if not file.exists():
        if any(folder.iterdir()):
            raise OutputError(f"{folder}: holds something else; give an empty or a new folder")
        return None
    try:
        settings = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise OutputError(f"{file}: cannot be read; give another folder") from error
    if not isinstance(settings, dict):
        raise OutputError(f"{file}: is not of an evaluation; give another folder")
    return settings


def _difference(old: Any, new: Any, name: str = "") -> str:
    """Return a text about the first setting that differs; empty where none does."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in [*new, *(key for key in old if key not in new)]:
            difference = _difference(old.get(key), new.get(key), f"{name} {key}".strip())
            if difference:
                return difference
        return ""
    if old == new:
        return ""
    return f"{name} {_shown(old)}, not {_shown(new)}"


def _shown(value: Any) -> str:
    if isinstance(value, list):
        value = ",".join(str(v["name"]) if isinstance(v, dict) else str(v) for v in value)
    text = str(value)
    return text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}..."
