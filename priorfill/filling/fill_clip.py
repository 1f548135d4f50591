"""Fill the gaps of a clip: choose a method, call it, assemble what it says."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from priorfill.artefacts import Artefact, artefact_samples, without_artefacts
from priorfill.clip import Clip
from priorfill.database import PriorDatabase, Selection
from priorfill.errors import DatabaseCorruptError, OptionError
from priorfill.filling.gap_filter import GapFilter
from priorfill.filling.result import (
    FilledGap,
    Result,
    UnfilledSpan,
)
from priorfill.gaps import (
    Gap,
    find_gaps,
    gap_groups,
    runs,
)
from priorfill.geometry.axes import from_upright, to_upright
from priorfill.gp.calibration import BOUND_FACTOR, MEAN_FACTOR, common_bound
from priorfill.markers.clip_geometry import ClipGeometry
from priorfill.markers.definitions import recognise
from priorfill.markers.marker_set import MarkerSet
from priorfill.methods import get_method, resolve
from priorfill.methods.task import Estimate, Note, Task
from priorfill.runtime.memory import give_back
from priorfill.search.takes import Take, same_subject_take, takes_from

__all__ = ["after_rejecting", "expected_errors", "fill"]


def fill(
    clip: Clip,
    *,
    database: PriorDatabase | str | Path | None = None,
    method: str = "auto",
    marker_set: MarkerSet | None = None,
    progress: Callable[[int, int], None] | None = None,
    selection: Selection | None = None,
    trust_filled: bool = False,
    same_subject: Sequence[Clip] = (),
    gap_filter: GapFilter | None = None,
    reject_artefacts: bool = False,
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
        Treat measured samples as missing where `priorfill.artefacts.find_artefacts` finds trouble.

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
    artefacts: tuple[Artefact, ...] = ()
    if reject_artefacts:
        clip, artefacts = without_artefacts(measured)
    alone = (gap_filter or GapFilter()).left_alone(clip)
    definition = marker_set or recognise(clip.labels)
    geometry = ClipGeometry(to_upright(clip.positions, clip.up), clip.labels, definition)
    kin = tuple(_companion(measured, other, definition) for other in same_subject)
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
                geometry.positions,
                clip.labels,
                clip.rate,
                geometry.marker_set,
                groups,
                kin + prior.takes,
                clip.name,
                clip.subject,
                geometry,
            )
            estimate = run(task, one_more)
            if not prior.withdrawn:
                break
            withdrawn |= prior.withdrawn  # once more, as if these clips were not there
            done = 0
    give_back()
    place = database.path if database is not None else None
    result = _assemble(
        clip, estimate, resolve(method), geometry.marker_set, place, prior.notes, alone
    )
    return after_rejecting(result, measured, artefacts)


def after_rejecting(result: Result, measured: Clip, artefacts: tuple[Artefact, ...]) -> Result:
    """Return a result of a clip without samples in trouble that knows of them.

    Parameters
    ----------
    result : Result
        Of what `priorfill.artefacts.without_artefacts` left of a clip.
    measured : Clip
        The clip. What was rejected and is not filled is in the new result as it was measured.
    trouble : tuple of Trouble
        Why it was rejected.
    """
    if not artefacts:
        return result
    rejected = artefact_samples(artefacts, measured.labels, measured.frames) & ~measured.missing
    positions = np.where(result.clip.missing[..., None], measured.positions, result.clip.positions)
    clip = result.clip.with_positions(positions)
    return replace(result, clip=clip, rejected=rejected, artefacts=artefacts)


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
    return same_subject_take(other, clip.labels, definition, clip.subject)


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
    left: dict[int, list[UnfilledSpan]] = {}
    for gap, reason in alone:
        asked[gap.start : gap.stop, gap.marker] = False
        left.setdefault(gap.marker, []).append(
            UnfilledSpan(gap.start, gap.stop, reason, requested=False)
        )
    filled = asked.copy()
    filled[asked] = np.isfinite(estimate.positions[asked]).all(axis=1)
    # the estimate's arrays become the result's: those of a long clip are large
    positions = from_upright(estimate.positions, clip.up)
    if np.may_share_memory(positions, clip.positions):  # a method that filled nothing
        positions = positions.copy()
    np.copyto(positions, clip.positions, where=~filled[..., None])
    positions.setflags(write=False)
    expected_rms = estimate.expected_rms
    np.copyto(expected_rms, np.nan, where=~filled)
    told = (
        BOUND_FACTOR * expected_rms if estimate.error_bound_90 is None else estimate.error_bound_90
    )
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
            expected_rms,
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
        expected_rms,
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
    expected_rms: NDArray[np.float64],
    bound: NDArray[np.float64],
    method: str,
    notes: list[Note],
    alone: list[UnfilledSpan],
) -> FilledGap:
    """Sum up one gap."""
    inside = [n for n in notes if n.start < gap.stop and n.stop > gap.start]
    error, mean, common = expected_errors(
        expected_rms[gap.start : gap.stop, gap.marker], bound[gap.start : gap.stop, gap.marker]
    )
    here = filled[gap.start : gap.stop, gap.marker]
    failed = ~here
    for part in alone:
        failed[part.start - gap.start : part.stop - gap.start] = False
    left = alone + [
        UnfilledSpan(gap.start + start, gap.start + stop, _reason(inside, gap.start + start))
        for start, stop in runs(failed)
    ]
    return FilledGap(
        label=clip.labels[gap.marker],
        start=gap.start,
        stop=gap.stop,
        filled=int(here.sum()),
        expected_rms=error,
        expected_mean_error=mean,
        error_bound_90=common,
        method=method,
        sources=tuple(dict.fromkeys(n.source for n in inside if n.filled)) if here.any() else (),
        training_poses=max((n.training_poses for n in inside if n.filled), default=0)
        if here.any()
        else 0,
        unfilled=tuple(sorted(left, key=lambda part: part.start)),
        source_clips=tuple(dict.fromkeys(name for n in inside for name in n.source_clips)),
    )


def expected_errors(
    expected_rms: NDArray[np.float64], bound: NDArray[np.float64]
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
    known, bounds = _finite(expected_rms), _finite(bound)
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
            return note.source
    return "the method gave no finite position"
