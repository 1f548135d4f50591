"""Libraries, takes and tables for the figures of Baumann, Krüger, Zinke and Weber 2011.

The paper fills takes of the motion library HDM05 from the others, all at 30 Hz. It names its takes;
where the library has one of them, it is filled in the paper's frames, otherwise a stand-in of
similar movement, in the middle half. A library is a prior database (``--database``, such as one
made by ``priorfill db fetch hdm05``), or the files of HDM05 below a folder of recordings.
"""

from __future__ import annotations

import argparse
import re
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from glob import escape
from pathlib import Path

import numpy as np
from paper import cut, method_alone, options

import priorfill as pf
from priorfill.database import ClipRecord
from priorfill.errors import PriorfillError
from priorfill.evaluation.body_parts import LIMBS
from priorfill.markers.definitions import load

__all__ = [
    "ARM",
    "LIKE_A_WALK",
    "METHODS",
    "RATE",
    "Example",
    "Library",
    "PaperTake",
    "actor",
    "choose",
    "fill_by",
    "gappy_of",
    "limb",
    "opened",
    "parser_of",
    "print_data",
    "reason",
    "without",
]

METHODS = ("baumann2011", "krueger2010", "gpr")
"""The method of the paper, the one it compares with, and the default of priorfill."""

RATE = 30.0
"""Hz. Rate of all tests of the paper with artificial gaps."""

PAPER_RATE = 120.0
"""Hz. Rate of the files that the paper's frame numbers count."""

GAP_SHARE = 0.5
"""Part of a stand-in that is a gap, in its middle."""

PAPER_MINUTES = 180.0
"""min. Duration of HDM05, at least."""

MIN_FRAMES = 30
"""Frames of a stand-in at least: a second."""

VIRTUAL = "hdm05_cut_markers"
"""Folder of short takes whose markers were computed on the recorded skeleton."""

NAME = re.compile(r"HDM_([a-z]+)_(.+?)_\d+(?:_120)?$", re.IGNORECASE)
"""Actor and motion in the name of a take of HDM05."""


def limb(kind: str, *sides: str) -> tuple[str, ...]:
    """Return the markers of an ``arm`` or a ``leg`` on some sides, of the paper's 41."""
    marker_set = load("baumann41")
    wanted = {f"{side}_{part}" for side in sides for part in LIMBS[kind]}
    return tuple(label for label in marker_set.labels if marker_set.segment[label] in wanted)


ARM = limb("arm", "left")
"""The six markers of the left arm."""


LIKE_A_WALK = ("01-01", "2_walk_", "sneak2Steps", "jogLeft")
"""Parts of names of stand-ins for a walk, the best first."""


@dataclass(frozen=True)
class PaperTake:
    """A take of the paper.

    Attributes
    ----------
    motion : str
        The movement, in the paper's word, or the take's name where it has none.
    name : str
        Of the file.
    first, last : int
        Its frames ``first <= frame < last``, at 120 Hz; both 0: the middle half.
    like : tuple of str
        Parts of names of stand-ins, the best first.
    """

    motion: str
    name: str
    first: int
    last: int
    like: tuple[str, ...]


@dataclass(frozen=True)
class Example:
    """A take of a library that is filled.

    Attributes
    ----------
    take : PaperTake
        The paper's take that it is, or stands for.
    record : ClipRecord
        In the library.
    named : bool
        Whether it is the paper's own take.
    """

    take: PaperTake
    record: ClipRecord
    named: bool

    @property
    def name(self) -> str:
        """Name in tables."""
        name = self.record.name.removeprefix("HDM_").removesuffix("_120")
        return name if self.named else f"{name} for {self.take.motion}"


class Library:
    """The takes of a prior database with the paper's markers.

    Attributes
    ----------
    path : Path
        The database.
    records : tuple of ClipRecord
        Its takes.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            with pf.PriorDatabase.open(path) as database:
                self.records = tuple(r for r in database.clips() if set(ARM) <= set(r.labels))
        except PriorfillError as fault:
            raise SystemExit(str(fault)) from None
        if not self.records:
            raise SystemExit(f"{path}: no take has the 41 markers of the paper")

    @property
    def minutes(self) -> float:
        """Duration of all takes."""
        return sum(record.frames[0] / record.rate for record in self.records) / 60.0

    def truth(self, record: ClipRecord) -> pf.Clip:
        """Return a take at the rate of the database."""
        with pf.PriorDatabase.open(self.path) as database:
            positions = database.positions(record).astype(np.float64)
        return pf.Clip(
            positions, record.labels, record.rate, name=record.name, subject=record.subject
        )

    def named(self, name: str) -> ClipRecord | None:
        """Return a take by its name, in any case."""
        same = (r for r in self.records if r.name.casefold() == name.casefold())
        return next(same, None)


def actor(record: ClipRecord) -> str:
    """Return the actor of a take: in a name of HDM05, otherwise the subject."""
    found = NAME.match(record.name)
    return found[1].lower() if found else record.subject


def parser_of(doc: str | None) -> argparse.ArgumentParser:
    """Return a parser with ``--data`` and ``--database``."""
    parser = options(doc)
    help_text = "prior database that is filled from, instead of the files of HDM05"
    parser.add_argument("--database", type=Path, metavar="DIR", help=help_text)
    return parser


@contextmanager
def opened(arguments: argparse.Namespace) -> Iterator[Library]:
    """Return the library: the given database, or one made of the files of HDM05."""
    if arguments.database is not None:
        yield Library(arguments.database)
        return
    paths = sorted(arguments.data.rglob("HDM_*"), reverse=True)
    files = {file.stem: file for file in paths if file.suffix.lower() == ".c3d"}
    if not files:
        raise SystemExit(f"{arguments.data}: contains no file HDM_*.c3d; use --data or --database")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "library"
        with pf.PriorDatabase.create(path, rate=RATE) as writer:
            for name in sorted(files):
                clip = pf.read(files[name])
                virtual = files[name].parent.name == VIRTUAL
                found = NAME.match(name)
                subject = f"hdm05-{found[1].lower()}" if found else None
                writer.add(clip, pf.ClipOrigin(subject=subject, virtual_markers=virtual))
        yield Library(path)


def choose(library: Library, takes: Sequence[PaperTake]) -> list[Example]:
    """Return for each take of the paper the library's own, or a stand-in.

    Stand-ins are takes whose names contain the first of the words `PaperTake.like` that some name
    contains: those of the same actor if there are any, otherwise of an actor who is not filled yet
    and has most of them, and of these the one of median length. No take stands for two; a take of
    the paper for which nothing is left has no stand-in.
    """
    chosen: list[Example] = []
    for take in takes:
        record = library.named(take.name)
        named = record is not None
        if record is None:
            record = _stand_in(library, take, [example.record for example in chosen])
        if record is not None:
            chosen.append(Example(take, record, named))
    if not chosen:
        raise SystemExit(f"{library.path}: contains neither the paper's takes nor similar ones")
    return chosen


def _stand_in(library: Library, take: PaperTake, used: Sequence[ClipRecord]) -> ClipRecord | None:
    """Return the take that stands for one of the paper; None if nothing is like it."""
    left = [r for r in library.records if r not in used and r.frames[0] >= MIN_FRAMES]
    some = next((found for w in take.like if (found := [r for r in left if w in r.name])), [])
    actors = {actor(record) for record in used}
    takes = Counter(actor(record) for record in some)
    found = NAME.match(take.name)

    def fitness(record: ClipRecord) -> tuple[bool, bool, int, str]:
        who = actor(record)
        same = found is not None and who == found[1].lower()
        return same, who not in actors, takes[who], who

    best = max(map(fitness, some), default=None)
    group = sorted((r.frames[0], r.name, r) for r in some if fitness(r) == best)
    return group[len(group) // 2][2] if group else None


def gap_of(example: Example, frames: int, rate: float) -> tuple[int, int]:
    """Return the frames of the gap: the paper's, or the middle of a stand-in."""
    if example.named and example.take.last:
        scale = rate / PAPER_RATE
        return round(example.take.first * scale), min(round(example.take.last * scale), frames)
    length = round(GAP_SHARE * frames)
    start = (frames - length) // 2
    return start, start + length


def gappy_of(example: Example, truth: pf.Clip, labels: Sequence[str]) -> pf.Clip:
    """Remove markers of a take in the frames of its gap."""
    return cut(truth, *gap_of(example, truth.frames, truth.rate), labels)


def fill_by(
    library: Path, gappy: pf.Clip, selection: pf.Selection, methods: Sequence[str]
) -> list[pf.Clip]:
    """Fill a clip by some methods from the selected takes of a library."""
    options = method_alone(selection)
    return [
        pf.fill(gappy, database=library, method=method, options=options).clip for method in methods
    ]


def without(example: Example) -> pf.Selection:
    """Return the selection of all takes of a library but one."""
    return pf.Selection(not_names=(escape(example.record.name),))


def reason(example: Example, library: Library) -> str:
    """Return what explains the deviation of a take's errors from the paper's."""
    if not example.named:
        return f"stand-in, {library.minutes:.0f} min of library"
    if library.minutes < PAPER_MINUTES:
        return f"{library.minutes:.0f} min of library, in the paper more than {PAPER_MINUTES:.0f}"
    return "the paper states neither k nor its root frames"


def print_data(library: Library, examples: Sequence[Example]) -> None:
    """Print the library and the takes that are filled, compared with the paper's."""
    actors = len({actor(record) for record in library.records})
    virtual = sum(record.virtual_markers for record in library.records)
    print(f"Paper:   takes of HDM05, from all of it: more than 3 hours, 5 actors, {RATE:.0f} Hz.")
    print(
        f"Library: {len(library.records)} takes, {library.minutes:.0f} min, {actors} actors, "
        f"{library.records[0].rate:g} Hz"
        + (f"; markers of {virtual} computed from a skeleton" if virtual else "")
    )
    for example in examples:
        record, take = example.record, example.take
        kind = "the paper's" if example.named else f"stand-in for {take.motion}, {take.name}"
        first, last = gap_of(example, record.frames[0], record.rate)
        print(f"Filled:  {record.name}, frames {first} to {last} of {record.frames[0]}: {kind}")
