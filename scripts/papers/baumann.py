"""Recordings and databases for the tables of Baumann, Krüger, Zinke and Weber 2011.

The paper fills takes of the motion library HDM05 from databases of the other takes. It does not
identify its takes and shows most results as plots only; such values are dashes here. File names of
HDM05 contain actor and motion: ``HDM_actor_motion_number``.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from paper import cut, error

import priorfill as pf
from priorfill.evaluation.body_parts import LIMBS
from priorfill.gaps import gap_groups
from priorfill.geometry.axes import from_upright, to_upright
from priorfill.markers.definitions import load
from priorfill.markers.describe import describe
from priorfill.methods.baumann2011 import krueger2010
from priorfill.methods.task import Task
from priorfill.search.takes import Take as SearchTake

__all__ = [
    "METHODS",
    "RECORDING",
    "Take",
    "database_of",
    "examples",
    "krueger_error",
    "library",
    "limb",
    "middle",
    "print_data",
]

METHODS = ("baumann2011", "krueger2010", "gpr")
"""The method of the paper, the one it compares with, and the default of priorfill."""

RECORDING = "a C3D file of HDM05 (HDM_actor_motion_...) or another one with its 41 markers"

MAX_GAP_SECONDS = 2.0
"""s."""

GAP_SHARE = 0.5
"""Share of a clip that a gap takes, in its middle: the takes are short."""

RATE = 120.0
"""Hz. The finest level of the paper is the rate of the recordings. At a quarter of it, the k
nearest poses would span four times the time."""

MIN_SECONDS = 1.0
"""s. Shorter clips are in the database, but are not filled."""


@dataclass(frozen=True)
class Take:
    """A recording: file, and actor and motion from its name, or empty."""

    file: Path
    actor: str
    motion: str

    @classmethod
    def of(cls, file: Path) -> Take:
        """Read actor and motion from a file name."""
        parts = file.stem.split("_")
        known = parts[0] == "HDM" and len(parts) > 3
        return cls(file, *(parts[1:3] if known else ("", "")))


def library(data: Path) -> list[Take]:
    """Return the HDM05 files below a folder with actor and motion in their name, each name once."""
    found = {file.stem: file for file in sorted(data.rglob("HDM_*.c3d"), reverse=True)}
    takes = [Take.of(found[name]) for name in sorted(found)]
    takes = [take for take in takes if take.actor]
    if not takes:
        raise SystemExit(f"{data}: contains no file HDM_*.c3d; use --data")
    return takes


@contextmanager
def database_of(takes: Sequence[Take]) -> Iterator[Path]:
    """Build a temporary database of recordings."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "priors"
        with pf.PriorDatabase.create(path, rate=RATE) as writer:
            for take in takes:
                writer.add(pf.read(take.file))
        yield path


def examples(takes: Sequence[Take], recording: Path | None, *, full: bool) -> list[Take]:
    """Return the recordings to be filled.

    The given one; otherwise one take of each motion that an actor performed twice, with actors in
    turn, or of each actor if ``full``.
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
            long = (take for take in some if pf.read(take.file).duration >= MIN_SECONDS)
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
    """Remove markers in the middle of a clip."""
    frames = min(round(GAP_SHARE * clip.frames), round(MAX_GAP_SECONDS * clip.rate))
    start = (clip.frames - frames) // 2
    return cut(clip, start, start + frames, labels)


def krueger_error(k: int, truth: pf.Clip, gappy: pf.Clip, takes: tuple[SearchTake, ...]) -> float:
    """Return the error (mm) of krueger2010 with k neighbours; NaN if samples stay missing."""
    task = Task(
        to_upright(gappy.positions, gappy.up),
        gappy.labels,
        gappy.rate,
        describe(gappy),
        tuple(gap_groups(gappy.missing)),
        takes,
    )
    found = krueger2010.fill(task, options=krueger2010.Krueger2010Options(neighbours=k)).positions
    return error(gappy.with_positions(from_upright(found, gappy.up)), truth, gappy)


def print_data(takes: Sequence[Take], filled: Sequence[Take], recording: Path | None) -> None:
    """Print the filled recordings and the library, compared with the paper's."""
    print("Paper: takes of HDM05 as recorded (120 Hz, 41 markers), filled from databases of HDM05.")
    print(f"Here:  {len(filled)} filled, from a library of {len(takes)} files of HDM05:")
    print("       " + ", ".join(take.file.stem.removeprefix("HDM_") for take in filled))
    virtual_markers = [take for take in takes if take.file.parent.name == "hdm05_cut_markers"]
    if virtual_markers:
        print(
            f"       {len(virtual_markers)} of the library are short takes whose markers were "
            "computed on the recorded skeleton:\n       real motion and proportions, no soft tissue"
        )
    if recording is None:
        print("       The takes of the paper are not identified; --recording fills one of yours.")
