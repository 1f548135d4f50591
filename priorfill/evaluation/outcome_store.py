"""The folder of an evaluation: what is finished is kept there, so that it can go on.

::

    DIR/evaluation.json    the settings; another set of them is refused
    DIR/cases/*.npz        an outcome each, whole or not there
    DIR/gaps.csv ...       the results, written at the end
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from priorfill.errors import OptionError, OutputError
from priorfill.evaluation.evaluation_plan import EvaluationPlan, FillJob
from priorfill.evaluation.evaluation_results import FILES
from priorfill.evaluation.gap_case import FillOutcome
from priorfill.evaluation.metrics import MEASURES
from priorfill.runtime.atomic_file import replace_file

__all__ = ["OutcomeStore"]

SETTINGS = "evaluation.json"
CASES = "cases"
PLOTS = "error*_by_*.png"

JOINT = "joint "
"""What the names of arrays of joint angles begin with."""

SHOWN = 60
"""Characters of a setting shown in a message."""


class OutcomeStore:
    """A folder that keeps the outcomes of one plan.

    Parameters
    ----------
    folder : Path
        Made if it is not there.
    plan : EvaluationPlan
        What is to be done.
    overwrite : bool
        Begin anew, whatever an earlier evaluation left there.

    Raises
    ------
    OptionError
        Where the folder holds an evaluation of other settings; the message says which.
    OutputError
        Where it holds something else, or cannot be written.
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
                    "another folder, or --overwrite"
                )
        try:
            (folder / CASES).mkdir(parents=True, exist_ok=True)
            # of a process that was killed; or, to begin anew, all
            for file in (folder / CASES).glob("*" if overwrite else ".*.part.npz"):
                file.unlink()
            if overwrite:  # no results of an evaluation that is no more
                for name in (*FILES, PLOTS):
                    for file in folder.glob(name):
                        file.unlink()
        except OSError as error:
            raise OutputError(
                f"{folder}: cannot be written ({error.strerror}); check its permissions"
            ) from error
        if begun is None or overwrite:
            with replace_file(folder / SETTINGS, overwrite=True) as temporary:
                temporary.write_text(json.dumps(settings, indent=2) + "\n", encoding="utf-8")

    def _file(self, job: FillJob) -> Path:
        return self.folder / CASES / f"{job.case:05d}-{job.method}.npz"

    def keep(self, job: FillJob, outcome: FillOutcome) -> None:
        """Write an outcome, whole or not at all."""
        facts = {
            "seconds": outcome.seconds,
            "how": outcome.how,
            "refused": outcome.refused,
            "notes": outcome.notes,
        }
        arrays: dict[str, Any] = {JOINT + name: off for name, off in outcome.joints.items()}
        with replace_file(self._file(job), overwrite=True) as temporary:
            np.savez_compressed(
                temporary, facts=np.array(json.dumps(facts)), samples=outcome.samples, **arrays
            )

    def kept(self) -> Iterator[tuple[FillJob, FillOutcome]]:
        """Give the outcomes that are there; one that cannot be read is made again."""
        for job in self.plan.jobs:
            with suppress(OSError, ValueError, KeyError, zipfile.BadZipFile):
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
                how=tuple(facts["how"]),
                refused=facts["refused"],
                notes=tuple(facts["notes"]),
            )


def check_folder(folder: Path) -> dict[str, Any] | None:
    """Return the settings of the evaluation that a folder holds; None where it is empty.

    Raises
    ------
    OutputError
        Where it is no folder, or holds something else.
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
    except (OSError, ValueError) as error:
        raise OutputError(f"{file}: cannot be read; give another folder") from error
    if not isinstance(settings, dict):
        raise OutputError(f"{file}: is not of an evaluation; give another folder")
    return settings


def _difference(old: Any, new: Any, name: str = "") -> str:
    """Return the first setting that differs, in words; empty where none does."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in [*new, *(key for key in old if key not in new)]:
            said = _difference(old.get(key), new.get(key), f"{name} {key}".strip())
            if said:
                return said
        return ""
    if old == new:
        return ""
    return f"{name} {_shown(old)}, not {_shown(new)}"


def _shown(value: Any) -> str:
    if isinstance(value, list):
        value = ",".join(str(v["name"]) if isinstance(v, dict) else str(v) for v in value)
    text = str(value)
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."
