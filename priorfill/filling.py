"""Fill the gaps of a clip: choose a method, call it, assemble what it says."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from priorfill.axes import from_upright, to_upright
from priorfill.clip import Clip
from priorfill.database import PriorDatabase, Selection
from priorfill.errors import DatabaseCorruptError, OptionError
from priorfill.gaps import Gap, find_gaps, gap_groups, runs
from priorfill.markerset import MarkerSet, describe, recognise
from priorfill.memory import give_back
from priorfill.methods import get_method, resolve
from priorfill.methods.task import Estimate, Note, Task
from priorfill.scope import Scope
from priorfill.takes import Take, companion_take, takes_from
from priorfill.trouble import Trouble, troubled_samples, without_trouble
from priorfill.uncertainty import BOUND_FACTOR, MEAN_FACTOR, common_bound

__all__ = [
    "FilledGap",
    "LeftMissing",
    "Result",
    "after_rejecting",
    "expected_errors",
    "fill",
]


@dataclass(frozen=True)
class LeftMissing:
    """Frames ``start <= frame < stop`` of a gap that were not filled, and why.

    Attributes
    ----------
    start, stop : int
        Frames.
    reason : str
        Why they were not filled.
    asked : bool
        Whether they were to be filled; False where the scope leaves them alone.
    """

    start: int
    stop: int
    reason: str
    asked: bool = True


@dataclass(frozen=True)
class FilledGap:
    """What became of one gap.

    Attributes
    ----------
    label : str
        The marker.
    start, stop : int
        Frames ``start <= frame < stop``, counted from the clip's first as 0.
    filled : int
        How many of the frames were filled.
    expected_error : float
        Expected rms Euclidean error (mm) over the filled frames; NaN where unknown.
    expected_mean : float
        Expected mean Euclidean error (mm) over the filled frames; NaN where unknown.
    bound : float
        Distance (mm) below which 90 % of the errors of the filled frames are expected to lie; NaN
        where unknown.
    method : str
        The method used.
    how : tuple of str
        What it was filled from.
    poses : int
        How many poses were learnt from; where parts of the gap were filled from different numbers
        of them, the most. 0: from none, as by a bridge over time.
    left : tuple of LeftMissing
        Frames that were left missing; empty where all were filled.
    takes : tuple of str
        Recordings that were learnt from, the most used first.
    """

    label: str
    start: int
    stop: int
    filled: int
    expected_error: float
    expected_mean: float
    bound: float
    method: str
    how: tuple[str, ...]
    poses: int
    left: tuple[LeftMissing, ...]
    takes: tuple[str, ...]

    @property
    def frames(self) -> int:
        """Length of the gap in frames."""
        return self.stop - self.start

    @property
    def complete(self) -> bool:
        """Whether every frame of the gap was filled that was to be."""
        return not any(part.asked for part in self.left)


@dataclass(frozen=True, eq=False)
class Result:
    """A filled clip, and what is known of each gap.

    Attributes
    ----------
    clip : Clip
        The clip with its gaps filled; measured samples are those of the clip given, bit for bit.
    filled : ndarray of bool [shape=(frames, markers)]
        Which samples were filled.
    deviation : ndarray [shape=(frames, markers), mm]
        Expected rms Euclidean error of each filled sample; NaN elsewhere and where unknown.
    bound : ndarray [shape=(frames, markers), mm]
        Distance below which 90 % of the errors are expected to lie, of each filled sample; NaN
        elsewhere and where unknown.
    gaps : tuple of FilledGap
        Every gap of the clip given, in order of time.
    method : str
        The method used.
    marker_set : MarkerSet
        How the markers were understood.
    database : Path or None
        The prior database, if there was one.
    rejected : ndarray of bool [shape=(frames, markers)]
        Which measured samples were treated as missing. Those of them that are not filled are in the
        clip as they were measured.
    trouble : tuple of Trouble
        Why they were.
    notes : tuple of str
        What of the database was not learnt from, and why, a sentence each.
    """

    clip: Clip
    filled: NDArray[np.bool_]
    deviation: NDArray[np.float64]
    bound: NDArray[np.float64]
    gaps: tuple[FilledGap, ...]
    method: str
    marker_set: MarkerSet
    rejected: NDArray[np.bool_]
    trouble: tuple[Trouble, ...] = ()
    database: Path | None = None
    notes: tuple[str, ...] = ()

    @property
    def complete(self) -> bool:
        """Whether everything was filled that was to be."""
        return all(gap.complete for gap in self.gaps)


def fill(
    clip: Clip,
    *,
    database: PriorDatabase | str | Path | None = None,
    method: str = "auto",
    marker_set: MarkerSet | None = None,
    progress: Callable[[int, int], None] | None = None,
    selection: Selection | None = None,
    trust_filled: bool = False,
    companions: Sequence[Clip] = (),
    scope: Scope | None = None,
    reject_outliers: bool = False,
) -> Result:
    """Fill the gaps of a clip.

    Parameters
    ----------
    clip : Clip
        With gaps.
    database : PriorDatabase or path, optional
        Recordings to learn from beside the clip itself.
    method : str
        ``auto``, or one of `priorfill.methods.METHODS`.
    marker_set : MarkerSet, optional
        Segments and reliable bits; recognised or found from the data if not given.
    progress : callable, optional
        Called with the gap groups done and all of them.
    selection : Selection, optional
        Which clips of the database to learn from; all by default. Other versions of the clip
        itself, and parts of it, are always left out.
    trust_filled : bool
        Learn from samples of the database that were themselves synthesised, too.
    companions : sequence of Clip, optional
        Other clips of the same person with the same markers on: a static trial, other takes of the
        session. What is best known of a marker that the clip never shows.
    scope : Scope, optional
        Which gaps to fill; all by default.
    reject_outliers : bool
        Treat measured samples as missing where `priorfill.trouble.find_trouble` finds trouble.

    Returns
    -------
    Result
        What could not be filled stays missing and is named with the reason.

    Raises
    ------
    MethodError
        Where the method cannot work on the clip.
    OptionError
        Where there is no such method, a companion is the clip itself, or the scope names what
        the clip does not have.
    ClipError
        Where a companion has no marker in common with the clip.
    DatabaseError
        Where the database cannot be read.
    """
    run = get_method(method)
    measured = clip
    trouble: tuple[Trouble, ...] = ()
    if reject_outliers:
        clip, trouble = without_trouble(measured)
    alone = (scope or Scope()).left_alone(clip)
    definition = marker_set or recognise(clip.labels)
    marker_set = describe(clip, marker_set)
    kin = tuple(_companion(measured, other, definition) for other in companions)
    with ExitStack() as stack:
        if isinstance(database, (str, Path)):
            database = stack.enter_context(PriorDatabase.open(database))
        # a method sees gap groups whole: what is left alone in them is left out afterwards
        idle = {(gap.start, gap.stop, gap.marker) for gap, _ in alone}
        groups = tuple(
            group
            for group in gap_groups(clip.missing)
            if not all((gap.start, gap.stop, gap.marker) in idle for gap in group.gaps)
        )
        done = 0

        def one_more() -> None:
            nonlocal done
            done += 1
            if progress is not None:
                progress(done, len(groups))

        # sums of several BLAS threads depend on how many there are; one thread's do not
        stack.enter_context(threadpool_limits(1, user_api="blas"))
        withdrawn: dict[str, DatabaseCorruptError] = {}
        while True:
            prior = _Prior(
                clip, database, definition, selection or Selection(), trust_filled, withdrawn
            )
            task = Task(
                to_upright(clip.positions, clip.up),
                clip.labels,
                clip.rate,
                marker_set,
                groups,
                kin + prior.takes,
                clip.name,
                clip.subject,
            )
            estimate = run(task, one_more)
            if not prior.withdrawn:
                break
            withdrawn |= prior.withdrawn  # once more, as if these clips were not there
            done = 0
    give_back()
    place = database.path if database is not None else None
    result = _assemble(clip, estimate, resolve(method), marker_set, place, prior.notes, alone)
    return after_rejecting(result, measured, trouble)


def after_rejecting(result: Result, measured: Clip, trouble: tuple[Trouble, ...]) -> Result:
    """Return a result of a clip without samples in trouble that knows of them.

    Parameters
    ----------
    result : Result
        Of what `priorfill.trouble.without_trouble` left of a clip.
    measured : Clip
        The clip. What was rejected and is not filled is in the new result as it was measured.
    trouble : tuple of Trouble
        Why it was rejected.
    """
    if not trouble:
        return result
    rejected = troubled_samples(trouble, measured.labels, measured.frames) & ~measured.missing
    positions = np.where(result.clip.missing[..., None], measured.positions, result.clip.positions)
    clip = result.clip.with_positions(positions)
    return replace(result, clip=clip, rejected=rejected, trouble=trouble)


def _companion(clip: Clip, other: Clip, definition: MarkerSet | None) -> Take:
    """Make a take of a companion, which must not be the clip itself."""
    if other is clip or (
        other.labels == clip.labels
        and np.array_equal(other.positions, clip.positions, equal_nan=True)
    ):
        raise OptionError(
            f"{other.name}: is the clip that is to be filled; "
            "as companion give another recording of the same person"
        )
    return companion_take(other, clip.labels, definition, clip.subject)


class _Prior:
    """The takes of a database that a clip may learn from, and what was left out.

    ``withdrawn`` holds, by content, why clips turned out to be damaged when something of them had
    been learnt from already; ``damaged`` is the same of those that are known to be.
    """

    def __init__(
        self,
        clip: Clip,
        database: PriorDatabase | None,
        definition: MarkerSet | None,
        selection: Selection,
        trust_filled: bool,
        damaged: Mapping[str, DatabaseCorruptError],
    ) -> None:
        self.takes: tuple[Take, ...] = ()
        self.withdrawn: dict[str, DatabaseCorruptError] = {}
        self._notes: list[str] = []
        if database is None:
            return
        self._notes += [
            f"{database.path}: the row of clip {name} is damaged; not learnt from"
            for name in database.damaged
        ]
        records = database.clips()
        if not records:
            self._notes.append(f"{database.path}: the database is empty")
            return
        own = database.versions(clip)
        if own:
            self._notes.append(
                f"not learnt from {', '.join(record.name for record in own)}: "
                "of the same recording as the clip"
            )
        self._notes += [f"{error}; not learnt from" for error in damaged.values()]
        records = tuple(
            record
            for record in selection.choose(records)
            if record not in own and record.content not in damaged
        )
        if not records:
            self._notes.append(f"{database.path}: no clip is left to learn from")
            return
        self.takes = takes_from(
            database,
            records,
            clip.labels,
            definition,
            trust_filled=trust_filled,
            refused=lambda error: self._notes.append(f"{error}; not learnt from"),
            withdrawn=self.withdrawn.__setitem__,
        )
        if not self.takes:
            held = sorted({label for record in records for label in record.labels})
            self._notes.append(
                f"{database.path}: no marker in common with {clip.name} "
                f"({', '.join(clip.labels[:6])}, ...); its markers are {', '.join(held[:6])}, ..."
            )

    @property
    def notes(self) -> tuple[str, ...]:
        """What was left out, and why; complete when the takes were used."""
        return tuple(dict.fromkeys(self._notes))


def _assemble(
    clip: Clip,
    estimate: Estimate,
    method: str,
    marker_set: MarkerSet,
    database: Path | None,
    notes: tuple[str, ...],
    alone: Sequence[tuple[Gap, str]],
) -> Result:
    """Put an estimate's filled samples into the clip, but for those that are left alone."""
    missing = clip.missing
    asked = missing.copy()
    left: dict[int, list[LeftMissing]] = {}
    for gap, reason in alone:
        asked[gap.start : gap.stop, gap.marker] = False
        left.setdefault(gap.marker, []).append(
            LeftMissing(gap.start, gap.stop, reason, asked=False)
        )
    filled = asked.copy()
    filled[asked] = np.isfinite(estimate.positions[asked]).all(axis=1)
    # the estimate's arrays become the result's: those of a long clip are large
    positions = from_upright(estimate.positions, clip.up)
    if np.may_share_memory(positions, clip.positions):  # a method that filled nothing
        positions = positions.copy()
    np.copyto(positions, clip.positions, where=~filled[..., None])
    positions.setflags(write=False)
    deviation = estimate.deviation
    np.copyto(deviation, np.nan, where=~filled)
    told = BOUND_FACTOR * deviation if estimate.bound is None else estimate.bound
    bound = told
    np.copyto(bound, np.nan, where=~filled)
    by_marker: dict[int, list[Note]] = {}
    for note in estimate.notes:
        by_marker.setdefault(note.marker, []).append(note)
    gaps = tuple(
        _filled_gap(
            clip,
            gap,
            filled,
            deviation,
            bound,
            method,
            by_marker.get(gap.marker, []),
            [part for part in left.get(gap.marker, []) if gap.start <= part.start < gap.stop],
        )
        for gap in find_gaps(missing)
    )
    return Result(
        clip.with_positions(positions),
        filled,
        deviation,
        bound,
        gaps,
        method,
        marker_set,
        np.zeros_like(filled),
        database=database,
        notes=notes,
    )


def _filled_gap(
    clip: Clip,
    gap: Gap,
    filled: NDArray[np.bool_],
    deviation: NDArray[np.float64],
    bound: NDArray[np.float64],
    method: str,
    notes: list[Note],
    alone: list[LeftMissing],
) -> FilledGap:
    """Sum up one gap."""
    inside = [n for n in notes if n.start < gap.stop and n.stop > gap.start]
    error, mean, common = expected_errors(
        deviation[gap.start : gap.stop, gap.marker], bound[gap.start : gap.stop, gap.marker]
    )
    here = filled[gap.start : gap.stop, gap.marker]
    failed = ~here
    for part in alone:
        failed[part.start - gap.start : part.stop - gap.start] = False
    left = alone + [
        LeftMissing(gap.start + start, gap.start + stop, _reason(inside, gap.start + start))
        for start, stop in runs(failed)
    ]
    return FilledGap(
        label=clip.labels[gap.marker],
        start=gap.start,
        stop=gap.stop,
        filled=int(here.sum()),
        expected_error=error,
        expected_mean=mean,
        bound=common,
        method=method,
        how=tuple(dict.fromkeys(n.how for n in inside if n.filled)) if here.any() else (),
        poses=max((n.poses for n in inside if n.filled), default=0) if here.any() else 0,
        left=tuple(sorted(left, key=lambda part: part.start)),
        takes=tuple(dict.fromkeys(name for n in inside for name in n.takes)),
    )


def expected_errors(
    deviation: NDArray[np.float64], bound: NDArray[np.float64]
) -> tuple[float, float, float]:
    """Sum up how far off the samples of a gap may be.

    Parameters
    ----------
    deviation, bound : ndarray [shape=(frames,), mm]
        Of each sample; NaN where it was not filled, or nothing is known.

    Returns
    -------
    tuple of float
        Expected rms and mean error, and the bound that they have in common (mm); NaN where nothing
        is known.
    """
    known, bounds = _finite(deviation), _finite(bound)
    return (
        float(np.sqrt((known**2).mean())) if len(known) else float("nan"),
        MEAN_FACTOR * float(known.mean()) if len(known) else float("nan"),
        common_bound(bounds) if len(bounds) else float("nan"),
    )


def _finite(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return those of some values that are known."""
    return values[np.isfinite(values)]


def _reason(notes: list[Note], frame: int) -> str:
    """Return why a frame was not filled."""
    for note in notes:
        if not note.filled and note.start <= frame < note.stop:
            return note.how
    return "the method gave no finite position"
