# ruff: noqa: N802  (the names are those of the API)
"""A stub of the Nexus API 1.0.3 that behaves as its documentation says, faults included.

Lists in, lists out; all frames of a trial in each call; errors on stderr instead of
exceptions; `SetTrajectory` that changes the lists it gets; nothing of the application from within.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from priorfill.clip import Clip

Samples = tuple[list[float], list[float], list[float], list[bool]]


class ViconNexus:
    """A connection to Nexus with a trial open.

    Attributes
    ----------
    data : dict
        Lists x, y, z, exists by subject and marker; None for a marker without a trajectory.
    calls : list of tuple
        Every call that changes something: name of the function, subject, marker.
    before_get, before_set : callable
        Called with subject and marker; what the user does meanwhile, or an exception.
    blanks : int
        Number of samples with NaN that were to be set.
    """

    def __init__(
        self, clips: Sequence[Clip], first: int = 1, region: tuple[int, int] | None = None
    ):
        self.GenerateErrors = True
        self.path, self.name = "C:\\Data\\Anna\\Gait\\", "Walk 01"
        self.rate = clips[0].rate
        self.frames = clips[0].frames
        self.range = (first, first + self.frames - 1)
        self.region = region or self.range
        self.active = {clip.subject: True for clip in clips}
        self.data: dict[str, dict[str, Samples | None]] = {
            clip.subject: {
                label: _lists(clip.positions[:, k]) for k, label in enumerate(clip.labels)
            }
            for clip in clips
        }
        self.calls: list[tuple[str, str, str]] = []
        self.before_get: Callable[[str, str], None] = lambda subject, marker: None
        self.before_set: Callable[[str, str], None] = lambda subject, marker: None
        self.blanks = 0
        self.stored: Callable[[float], float] = float

    def GetTrialName(self) -> tuple[str, str]:
        return self.path, self.name

    def GetFrameCount(self) -> int:
        return self.frames

    def GetFrameRate(self) -> float:
        return self.rate

    def GetTrialRange(self) -> tuple[int, int]:
        return self.range

    def GetTrialRegionOfInterest(self) -> tuple[int, int]:
        return self.region

    def GetSubjectNames(self) -> list[str]:
        return list(self.data)

    def GetSubjectInfo(self) -> tuple[list[str], list[str], list[bool]]:
        return list(self.data), ["PlugInGait"] * len(self.data), list(self.active.values())

    def GetMarkerNames(self, subject: str) -> list[str]:
        return list(self.data[subject])

    def GetUnlabeledCount(self) -> int:
        raise AssertionError("unlabelled trajectories are nobody's business")

    def GetUnlabeled(self, index: int) -> Samples:
        raise AssertionError("unlabelled trajectories are nobody's business")

    def GetTrajectory(self, subject: str, marker: str) -> Samples:
        self.before_get(subject, marker)
        samples = self.data.get(subject, {}).get(marker)
        if samples is None:
            sys.stderr.write(f"GetTrajectory: {marker} has no trajectory\n")
            return [], [], [], []
        x, y, z, exists = samples
        return list(x), list(y), list(z), list(exists)

    def SetTrajectory(
        self, subject: str, marker: str, x: list[Any], y: list[Any], z: list[Any], e: list[Any]
    ) -> None:
        self.before_set(subject, marker)
        for i in range(len(x)):
            if any(map(math.isnan, [x[i], y[i], z[i]])):
                self.blanks += 1
                e[i] = False
                x[i] = y[i] = z[i] = 0
        for values, kinds in (
            (x, (float, int)),
            (y, (float, int)),
            (z, (float, int)),
            (e, (bool,)),
        ):
            if type(values) is not list or any(type(value) not in kinds for value in values):
                raise TypeError("in method 'ViconNexusClient_SetTrajectory': wrong type")
        if {len(x), len(y), len(z), len(e)} != {self.frames} or marker not in self.data[subject]:
            sys.stderr.write("SetTrajectory: invalid argument\n")
            return
        self.calls.append(("SetTrajectory", subject, marker))
        stored = [[self.stored(float(value)) for value in values] for values in (x, y, z)]
        self.data[subject][marker] = (stored[0], stored[1], stored[2], list(e))

    def _from_within(self, *arguments: Any) -> None:
        raise AssertionError("cannot be used in a script that is executing from the application")

    SaveTrial = OpenTrial = CloseTrial = RunPipeline = _from_within

    def clip(self, subject: str, like: Clip) -> np.ndarray:
        """The positions of a subject's markers, in the order of a clip; NaN where none exist."""
        columns = []
        for label in like.labels:
            samples = self.data[subject][label]
            assert samples is not None
            column = np.column_stack(samples[:3])
            column[~np.array(samples[3])] = np.nan
            columns.append(column)
        return np.stack(columns, axis=1)


def _lists(positions: np.ndarray) -> Samples:
    """Samples of a marker as Nexus returns them: zeros where there are none."""
    there = ~np.isnan(positions[:, 0])
    x, y, z = np.where(there[:, None], positions, 0.0).T.tolist()
    return x, y, z, there.tolist()


def install(monkeypatch: pytest.MonkeyPatch, connect: Callable[..., Any]) -> None:
    """Make ``viconnexusapi`` importable, whose class is `connect`."""
    package, module = ModuleType("viconnexusapi"), ModuleType("viconnexusapi.ViconNexus")
    module.ViconNexus = connect  # type: ignore[attr-defined]
    package.ViconNexus = module  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "viconnexusapi", package)
    monkeypatch.setitem(sys.modules, "viconnexusapi.ViconNexus", module)
