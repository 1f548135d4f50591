"""The plan of an evaluation: clips, cases, methods and settings."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from priorfill.clip import Clip
from priorfill.database import PriorDatabase, Selection
from priorfill.database.content_hash import content_hash
from priorfill.errors import ClipError, OptionError
from priorfill.evaluation.body_parts import parts_of
from priorfill.evaluation.gap_case import EvaluatedClip, GapCase
from priorfill.evaluation.protocols import (
    GapMask,
    GapProtocol,
    GroupGaps,
    MarkerGaps,
    at_rate,
    draw_for,
    groups_of,
    make_protocol,
    name_of,
    settings_of,
)
from priorfill.filling.gap_filter import GapFilter
from priorfill.filling.provenance import package_versions
from priorfill.gaps import find_gaps
from priorfill.markers.describe import describe
from priorfill.markers.marker_set import MarkerSet
from priorfill.methods import METHODS, resolve
from priorfill.runtime.argument_types import check_type
from priorfill.runtime.field_types import check_field_types
from priorfill.runtime.option_texts import close_or_all

__all__ = [
    "ALL_METHODS",
    "EvaluationOptions",
    "EvaluationPlan",
    "FillJob",
    "choose_methods",
    "make_plan",
]

ALL_METHODS = "all"
"""Name that selects every method."""

HASH_DIGITS = 16
"""Digits of a database's checksum: enough to distinguish databases."""


@dataclass(frozen=True)
class EvaluationOptions:
    """Options of `priorfill.evaluate` that few evaluations need.

    Attributes
    ----------
    marker_set : MarkerSet, optional
        Marker set of all clips; recognised by the labels or found from the data if not given.
    selection : Selection
        Clips of the database to learn from. No version of an evaluated clip is ever learnt from.
    trust_filled : bool
        Learn from samples of the database that were filled, too.
    overwrite : bool
        Start anew in a folder that has another evaluation.
    progress : callable, optional
        Called with the number of fills done and the number of all fills.

    See Also
    --------
    priorfill.evaluate : Evaluate methods by artificial gaps.

    Examples
    --------
    >>> import priorfill as pf
    >>> pf.EvaluationOptions(trust_filled=True).overwrite
    False
    """

    marker_set: MarkerSet | None = None
    selection: Selection = field(default_factory=Selection)
    trust_filled: bool = False
    overwrite: bool = False
    progress: Callable[[int, int], None] | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the types."""
        check_field_types(self)


@dataclass(frozen=True)
class FillJob:
    """A case to be filled by a method.

    Attributes
    ----------
    case : int
        Index of the case in the plan.
    method : str
        Name of the method.
    """

    case: int
    method: str


@dataclass(frozen=True, eq=False)
class EvaluationPlan:
    """The plan of an evaluation.

    Attributes
    ----------
    sources : tuple of EvaluatedClip
        The clips, with what their fills may learn from.
    marker_sets : tuple of MarkerSet
        The marker set of each clip, for the names of segments.
    cases : tuple of GapCase
        The gaps to make.
    methods : tuple of str
        The methods, in the order of all tables.
    settings : dict
        Everything that the errors depend on, as written to JSON.
    notes : tuple of str
        Cases that were skipped, with reasons.
    """

    sources: tuple[EvaluatedClip, ...]
    marker_sets: tuple[MarkerSet, ...]
    cases: tuple[GapCase, ...]
    methods: tuple[str, ...]
    settings: dict[str, Any]
    notes: tuple[str, ...]

    @property
    def jobs(self) -> list[FillJob]:
        """All pairs of a case and a method."""
        return [FillJob(case, method) for case in range(len(self.cases)) for method in self.methods]


def choose_methods(names: Sequence[str] | str) -> tuple[str, ...]:
    """Return the names of methods, each once; ``all`` selects every method.

    Raises
    ------
    OptionError
        Where there is no such method, or none is named.

    Examples
    --------
    >>> choose_methods("auto,linear")
    ('gpr', 'linear')
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
    protocol: GapProtocol | str,
    seed: int,
    database: Path | None = None,
    options: EvaluationOptions | None = None,
) -> EvaluationPlan:
    """Make the cases of some clips.

    Parameters
    ----------
    clips : sequence of Clip
        The recordings.
    methods : sequence of str, or str
        See `choose_methods`.
    protocol : GapProtocol or str
        A protocol, or its name.
    seed : int
        Seed of the random choices.
    database : Path, optional
        The prior database.
    options : EvaluationOptions, optional
        The defaults if not given.

    Returns
    -------
    EvaluationPlan
        All cases that can be made; notes name the others.

    Raises
    ------
    OptionError
        Where a method or the protocol is unknown.
    ClipError
        Where there is no clip, one is given twice, or no case can be made in any.
    DatabaseError
        Where the database cannot be read.
    """
    options = options or EvaluationOptions()
    protocol_name = protocol if isinstance(protocol, str) else name_of(protocol)
    made = make_protocol(protocol) if isinstance(protocol, str) else protocol
    chosen = choose_methods(methods)
    named = _with_names(clips)
    sources, prior = _sources(named, database, options)
    cases, notes = _cases(named, made, protocol_name, seed, options.marker_set)
    if not cases:
        raise ClipError(f"no gap can be made: {notes[0] if notes else 'there is nothing measured'}")
    marker_set = options.marker_set
    settings = {
        "versions": dict(package_versions()),
        "methods": list(chosen),
        "protocol": {"name": protocol_name} | settings_of(made),
        "seed": seed,
        "clips": [
            {"name": clip.name, "content": content_hash(clip), "up": clip.up} for clip in named
        ],
        "database": prior,
        "selection": asdict(options.selection),
        "trust_filled": options.trust_filled,
        "marker_set": marker_set.name if marker_set is not None else None,
    }
    described = tuple(describe(clip, marker_set) for clip in named)
    return EvaluationPlan(sources, described, cases, chosen, settings, notes)


def _cases(
    clips: Sequence[Clip],
    protocol: GapProtocol,
    protocol_name: str,
    seed: int,
    marker_set: MarkerSet | None,
) -> tuple[tuple[GapCase, ...], tuple[str, ...]]:
    """Return the cases of all clips, and a note for those that cannot be made."""
    if isinstance(protocol, MarkerGaps):
        GapFilter(protocol.markers).for_subjects(clips)  # refuses what no clip has
    cases: list[GapCase] = []
    notes: list[str] = []
    groups: dict[str, None] = {}
    for number, clip in enumerate(clips):
        parts = parts_of(clip, marker_set)
        groups |= dict.fromkeys(groups_of(parts))
        skipped: dict[str, list[str]] = {}
        draw = draw_for(seed, protocol_name, clip.name)
        for made in at_rate(protocol, clip.rate).cases(clip, parts, draw):
            if isinstance(made, GapMask):
                gaps = tuple(find_gaps(made.mask))
                cases.append(GapCase(number, made.name, made.copy, gaps))
            else:
                skipped.setdefault(made.reason, []).append(made.name)
        for reason, names in skipped.items():
            notes.append(f"{clip.name}: no gap for {' '.join(dict.fromkeys(names))}: {reason}")
    for name in protocol.groups if isinstance(protocol, GroupGaps) else ():
        if name not in groups:
            raise OptionError(f"no clip has the group {name!r}; {close_or_all(name, [*groups])}")
    return tuple(cases), tuple(notes)


def _with_names(clips: Sequence[Clip]) -> list[Clip]:
    """Return clips with unique names, such as ``walk`` and ``walk (2)``."""
    remedy = "a list of Clips; read files with priorfill.read"
    check_type("clips", clips, (list, tuple), remedy)
    for clip in clips:
        check_type("clips", clip, Clip, remedy)
    if not clips:
        raise ClipError("no clip is given; give one or more")
    seen: dict[str, str] = {}
    count: dict[str, int] = {}
    named = []
    for clip in clips:
        content = content_hash(clip)
        if content in seen:
            raise ClipError(
                f"{clip.name}: has the same content as {seen[content]}; give each clip once"
            )
        seen[content] = clip.name
        count[clip.name] = count.get(clip.name, 0) + 1
        again = count[clip.name]
        named.append(clip if again == 1 else replace(clip, name=f"{clip.name} ({again})"))
    return named


def _sources(
    clips: Sequence[Clip], database: Path | None, options: EvaluationOptions
) -> tuple[tuple[EvaluatedClip, ...], dict[str, Any] | None]:
    """Return the clips with what they may learn from, and a description of the database."""
    marker_set = options.marker_set
    if database is None:
        return tuple(EvaluatedClip(clip, marker_set) for clip in clips), None
    sources = []
    with PriorDatabase.open(database) as prior:
        records = prior.clips()
        for clip in clips:
            # compare the complete clip: too little may be left of it once samples are removed
            own = tuple(record.content for record in prior.versions(clip))
            selection = options.selection
            without = replace(selection, not_names=selection.not_names + own)
            sources.append(
                EvaluatedClip(clip, marker_set, database.resolve(), without, options.trust_filled)
            )
    contents = "".join(sorted(record.content for record in records))
    digest = hashlib.sha256(contents.encode()).hexdigest()[:HASH_DIGITS]
    return tuple(sources), {"path": str(database), "clips": len(records), "content": digest}
