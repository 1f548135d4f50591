"""What an evaluation is to do: clips, protocol, methods, and the cases that these make."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from priorfill.clip import Clip
from priorfill.database import PriorDatabase, Selection
from priorfill.database.ingest import content_hash
from priorfill.errors import ClipError, OptionError
from priorfill.evaluation.body_parts import parts_of
from priorfill.evaluation.gap_case import EvaluatedClip, GapCase
from priorfill.evaluation.protocols import (
    GapMask,
    GapProtocol,
    draw_for,
    settings_of,
)
from priorfill.gaps import find_gaps
from priorfill.markers.describe import describe
from priorfill.markers.marker_set import MarkerSet
from priorfill.methods import METHODS, resolve

__all__ = ["ALL_METHODS", "EvaluationPlan", "FillJob", "choose_methods", "make_plan"]

ALL_METHODS = "all"
"""Stands for every method that there is."""

VERSIONS = ("priorfill", "numpy", "scipy")
"""Packages whose versions a result names."""

HASH_DIGITS = 16
"""Digits of a checksum: enough to tell databases apart."""


@dataclass(frozen=True)
class FillJob:
    """A case to be filled by a method."""

    case: int
    method: str


@dataclass(frozen=True, eq=False)
class EvaluationPlan:
    """What an evaluation is to do.

    Attributes
    ----------
    sources : tuple of EvaluatedClip
        The clips, and what fills of them may learn from.
    marker_sets : tuple of MarkerSet
        Of each clip, under its own labels: for names of segments only.
    cases : tuple of GapCase
        What is removed from them.
    methods : tuple of str
        What fills, in the order of all tables.
    settings : dict
        All that the errors depend on, as it goes into a JSON file.
    notes : tuple of str
        Cases that could not be made, and why.
    """

    sources: tuple[EvaluatedClip, ...]
    marker_sets: tuple[MarkerSet, ...]
    cases: tuple[GapCase, ...]
    methods: tuple[str, ...]
    settings: dict[str, Any]
    notes: tuple[str, ...]

    @property
    def jobs(self) -> list[FillJob]:
        """Every case with every method."""
        return [FillJob(case, method) for case in range(len(self.cases)) for method in self.methods]


def choose_methods(names: Sequence[str] | str) -> tuple[str, ...]:
    """Return methods by their names, each once; ``all`` is every one.

    Raises
    ------
    OptionError
        Where there is no such method, or none is named.
    """
    given = names.split(",") if isinstance(names, str) else list(names)
    chosen: list[str] = []
    for name in given:
        chosen += list(METHODS) if name == ALL_METHODS else [resolve(name.strip())]
    if not chosen:
        raise OptionError(f"no method is named; use some of auto {' '.join(METHODS)}")
    return tuple(dict.fromkeys(chosen))


def make_plan(
    clips: Sequence[Clip],
    *,
    methods: Sequence[str] | str,
    protocol: GapProtocol,
    protocol_name: str,
    database: Path | None,
    seed: int,
    marker_set: MarkerSet | None = None,
    selection: Selection | None = None,
    trust_filled: bool = False,
) -> EvaluationPlan:
    """Make the cases of some clips.

    Raises
    ------
    OptionError
        Where a method is unknown.
    ClipError
        Where there is no clip, one is given twice, or no case can be made of any.
    DatabaseError
        Where the database cannot be read.
    """
    chosen = choose_methods(methods)
    named = _with_names(clips)
    selection = selection or Selection()
    sources, prior = _sources(named, database, marker_set, selection, trust_filled)
    cases: list[GapCase] = []
    notes: list[str] = []
    for number, clip in enumerate(named):
        parts = parts_of(clip, marker_set)
        refused: dict[str, list[str]] = {}
        for made in protocol.cases(clip, parts, draw_for(seed, protocol_name, clip.name)):
            if isinstance(made, GapMask):
                gaps = tuple(find_gaps(made.gone))
                cases.append(GapCase(number, made.name, made.copy, gaps))
            else:
                refused.setdefault(made.reason, []).append(made.name)
        for reason, names in refused.items():
            notes.append(f"{clip.name}: no gap for {' '.join(dict.fromkeys(names))}: {reason}")
    if not cases:
        raise ClipError(f"no gap can be made: {notes[0] if notes else 'there is nothing measured'}")
    settings = {
        "versions": {name: version(name) for name in VERSIONS}
        | {"python": platform.python_version()},
        "methods": list(chosen),
        "protocol": {"name": protocol_name} | settings_of(protocol),
        "seed": seed,
        "clips": [
            {"name": clip.name, "content": content_hash(clip), "up": clip.up} for clip in named
        ],
        "database": prior,
        "selection": asdict(selection),
        "trust_filled": trust_filled,
        "marker_set": marker_set.name if marker_set is not None else None,
    }
    described = tuple(describe(clip, marker_set) for clip in named)
    return EvaluationPlan(sources, described, tuple(cases), chosen, settings, tuple(notes))


def _with_names(clips: Sequence[Clip]) -> list[Clip]:
    """Return clips whose names tell them apart: ``walk``, ``walk (2)``."""
    if not clips:
        raise ClipError("no clip is given; give one or more")
    seen: dict[str, str] = {}
    count: dict[str, int] = {}
    named = []
    for clip in clips:
        content = content_hash(clip)
        if content in seen:
            raise ClipError(f"{clip.name}: is the same as {seen[content]}; give each clip once")
        seen[content] = clip.name
        count[clip.name] = count.get(clip.name, 0) + 1
        again = count[clip.name]
        named.append(clip if again == 1 else replace(clip, name=f"{clip.name} ({again})"))
    return named


def _sources(
    clips: Sequence[Clip],
    database: Path | None,
    marker_set: MarkerSet | None,
    selection: Selection,
    trust_filled: bool,
) -> tuple[tuple[EvaluatedClip, ...], dict[str, Any] | None]:
    """Return the clips with what may be learnt from, and what the database is."""
    if database is None:
        return tuple(EvaluatedClip(clip, marker_set) for clip in clips), None
    sources = []
    with PriorDatabase.open(database) as prior:
        records = prior.clips()
        for clip in clips:
            # told by the whole clip: of what is left of it too little may be there to tell
            own = tuple(record.content for record in prior.versions(clip))
            without = replace(selection, not_names=selection.not_names + own)
            sources.append(
                EvaluatedClip(clip, marker_set, database.resolve(), without, trust_filled)
            )
    contents = "".join(sorted(record.content for record in records))
    digest = hashlib.sha256(contents.encode()).hexdigest()[:HASH_DIGITS]
    return tuple(sources), {"path": str(database), "clips": len(records), "contents": digest}
