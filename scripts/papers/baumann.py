"""Recordings and databases for the tables of Baumann, Krüger, Zinke and Weber 2011.

The paper fills takes of the motion library HDM05 from databases made of the rest of it. Which
takes, and most of its figures, stand in its plots and are not stated in the text that these
scripts were written from: such figures are dashes here, and the scripts take any file of HDM05 by
``--recording``. Files of HDM05 tell by their names who does what: ``HDM_actor_motion_number``.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from paper import cut, error

import priorfill as pf
from priorfill.evaluation.body_parts import LIMBS
from priorfill.gaps import gap_groups
from priorfill.geometry.axes import from_upright, to_upright
from priorfill.markers.definitions import load
from priorfill.markers.describe import describe
from priorfill.methods.task import Task
from priorfill.search.takes import Take as Prior

__all__ = [
    "METHODS",
    "RECORDING",
    "Take",
    "database_of",
    "error_by",
    "examples",
    "library",
    "limb",
    "middle",
    "tell_data",
]

METHODS = ("baumann2011", "krueger2010", "gpr")
"""The paper's own method, the one that it compares with, and ours."""

RECORDING = "a C3D file of HDM05 (HDM_actor_motion_...) or another one with its 41 markers"

LONGEST_GAP = 2.0
"""s."""

GAP_SHARE = 0.5
"""Part of a clip that a gap takes, in its middle: the cut motions are short."""

RATE = 120.0
"""Hz. The paper's levels start at the recordings' own rate. Of poses four times as dense, the k
nearest are of a quarter of the time."""

LEAST_SECONDS = 1.0
"""s. Shorter clips are not filled, only learnt from."""


@dataclass(frozen=True)
class Take:
    """A recording by its file; actor and motion as its name tells them, else empty."""

    file: Path
    actor: str
    motion: str

    @classmethod
    def of(cls, file: Path) -> Take:
        """Return what a file's name tells."""
        parts = file.stem.split("_")
        known = parts[0] == "HDM" and len(parts) > 3
        return cls(file, *(parts[1:3] if known else ("", "")))


def library(data: Path) -> list[Take]:
    """Return all files of HDM05 below a folder that tell actor and motion, each name once."""
    found = {file.stem: file for file in sorted(data.rglob("HDM_*.c3d"), reverse=True)}
    takes = [Take.of(found[name]) for name in sorted(found)]
    takes = [take for take in takes if take.actor]
    if not takes:
        raise SystemExit(f"{data}: no file HDM_*.c3d below it; use --data")
    return takes


@contextmanager
def database_of(takes: Sequence[Take]) -> Iterator[Path]:
    """Make a database of recordings for as long as it is used."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "priors"
        with pf.PriorDatabase.create(path, rate=RATE) as writer:
            for take in takes:
                writer.add(pf.read(take.file))
        yield path


def examples(takes: Sequence[Take], recording: Path | None, *, full: bool) -> list[Take]:
    """Return the recordings to be filled.

    The user's own; else the first of each motion by one actor, actors taken in turn; or by each
    actor, if ``full``. Only motions of which the actor has another recording: they are what the
    paper's databases hold of each.
    """
    if recording is not None:
        return [Take.of(recording)]
    several: dict[tuple[str, str], list[Take]] = {}
    for take in takes:
        several.setdefault((take.motion, take.actor), []).append(take)
    chosen = []
    for number, motion in enumerate(sorted({take.motion for take in takes})):
        ours = [some for key, some in sorted(several.items()) if key[0] == motion]
        ours = [some for some in ours if len(some) > 1]
        ours = ours if full else ours[number % len(ours) :][:1] if ours else []
        for some in ours:
            long = (take for take in some if pf.read(take.file).duration >= LEAST_SECONDS)
            chosen += [take for take in [next(long, None)] if take is not None]
    if not chosen:
        raise SystemExit("no motion has two recordings by one actor; use --recording")
    return chosen


def limb(kind: str, *sides: str) -> list[str]:
    """Return the markers of an ``arm`` or a ``leg`` on some sides, of the paper's 41."""
    marker_set = load("baumann41")
    wanted = {f"{side}_{part}" for side in sides for part in LIMBS[kind]}
    return [label for label in marker_set.labels if marker_set.segment[label] in wanted]


def middle(clip: pf.Clip, labels: Sequence[str]) -> pf.Clip:
    """Return a clip without some markers in its middle."""
    frames = min(round(GAP_SHARE * clip.frames), round(LONGEST_GAP * clip.rate))
    start = (clip.frames - frames) // 2
    return cut(clip, start, start + frames, labels)


def error_by(
    method: ModuleType, k: int, truth: pf.Clip, gappy: pf.Clip, priors: tuple[Prior, ...]
) -> float:
    """Return the error (mm) of a method of the field with k neighbours; NaN if it left any."""
    task = Task(
        to_upright(gappy.positions, gappy.up),
        gappy.labels,
        gappy.rate,
        describe(gappy),
        tuple(gap_groups(gappy.missing)),
        priors,
    )
    found = method.fill(task, options=method.Options(neighbours=k)).positions
    return error(gappy.with_positions(from_upright(found, gappy.up)), truth, gappy)


def tell_data(takes: Sequence[Take], filled: Sequence[Take], recording: Path | None) -> None:
    """Say what was filled from what, and how that differs from the paper."""
    print("Paper: takes of HDM05 as recorded (120 Hz, 41 markers), filled from databases of HDM05.")
    print(f"Here:  {len(filled)} filled, from a library of {len(takes)} files of HDM05:")
    print("       " + ", ".join(take.file.stem.removeprefix("HDM_") for take in filled))
    virtual_markers = [take for take in takes if take.file.parent.name == "hdm05_cut_markers"]
    if virtual_markers:
        print(
            f"       {len(virtual_markers)} of the library are short cuts whose markers were put "
            "on the recorded skeleton:\n       motion and bodies are real, soft tissue is missing."
        )
    if recording is None:
        print(
            "       The paper's takes are not named in the text at hand; --recording takes yours."
        )
