"""Fill the gaps of a clip, or of the clips of several subjects of one file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from priorfill.artefacts import Artefact, find_artefacts, without_artefacts
from priorfill.clip import Clip
from priorfill.errors import DatabaseCorruptError, OptionError
from priorfill.filling.apply_overrides import MethodRun, join_runs, plan_runs
from priorfill.filling.assemble import filled_samples, restore_rejected, sum_up_gaps
from priorfill.filling.assign_overrides import AppliedOverrides, apply_overrides
from priorfill.filling.believable_fill import BelievableFill
from priorfill.filling.database_takes import DatabaseTakes
from priorfill.filling.fill_cache import RunEstimate, digest_of, recalled
from priorfill.filling.fill_options import FillOptions
from priorfill.filling.gap_filter import GapFilter
from priorfill.filling.multi_subject import assign_same_subject, merge_results
from priorfill.filling.override_entries import CLIP, DATABASE, SAME_SUBJECT
from priorfill.filling.overrides import Overrides
from priorfill.filling.overrides_file import read_overrides
from priorfill.filling.overrides_template import notes_on_origin
from priorfill.filling.provenance import (
    DatabaseState,
    Provenance,
    database_state,
    identify,
    marker_set_content,
    package_versions,
    source_clips,
)
from priorfill.filling.result import Result
from priorfill.filling.run_settings import (
    RunSettings,
    changed_options,
    check_sources,
    settings_of_overrides,
)
from priorfill.filling.same_subject_takes import same_subject_takes
from priorfill.filling.sample_progress import CallShares, SampleProgress
from priorfill.filling.seen_clip import SeenClip, doubtful_samples
from priorfill.filling.swaps import SwappedClip, check_swaps, swap_markers
from priorfill.formats.recording import check_coordinates
from priorfill.gaps import runs as runs_of
from priorfill.markers.definitions import recognise
from priorfill.markers.marker_set_check import check_marker_set
from priorfill.markers.phantoms import find_phantoms, phantom_notes
from priorfill.methods import METHODS, get_method, get_options, resolve
from priorfill.methods.options import differing
from priorfill.methods.task import Estimate, Progress, Task
from priorfill.runtime.argument_types import check_type
from priorfill.runtime.option_texts import seconds_of
from priorfill.search.takes import Take

if TYPE_CHECKING:
    from priorfill.database import PriorDatabase

__all__ = ["fill"]

MAX_PLACES = 6
"""Markers that a note lists with their frames."""


def fill(
    clip: Clip | Sequence[Clip],
    *,
    database: PriorDatabase | str | Path | None = None,
    method: str = "auto",
    same_subject: Sequence[Clip] = (),
    gap_filter: GapFilter | None = None,
    overrides: Overrides | str | Path | None = None,
    reject_artefacts: bool = False,
    options: FillOptions | None = None,
) -> Result:
    """Fill the gaps of a clip.

    Parameters
    ----------
    clip : Clip or sequence of Clip
        With gaps. Several clips are those of the subjects of one file, as `priorfill.read_subjects`
        reads them; each is filled by itself.
    database : PriorDatabase or path, optional
        Recordings to learn from, besides the clip itself.
    method : str
        ``auto``, or one of `priorfill.methods.METHODS`.
    same_subject : sequence of Clip
        Other recordings of the same subject with the same markers attached: a static trial, other
        takes of the session. They are the best source for a marker that the clip never shows. One
        whose body measures are those of another subject is not learnt from (`Result.notes`). For
        several clips, each goes to the clip with the same name of the subject.
    gap_filter : GapFilter, optional
        Which gaps to fill; all by default.
    overrides : Overrides or path, optional
        What to do with single gaps: fill them in another way, leave them alone, treat measured
        samples as missing, or exchange those of two markers.
    reject_artefacts : bool
        Treat samples as missing where `priorfill.find_artefacts` finds artefacts.
    options : FillOptions, optional
        Options of the method, clips of the database to learn from, and others.

    Returns
    -------
    Result
        Measured samples keep their bits, unless overrides exchange them. Samples that could not be
        filled stay missing; their gap has the reason. For several clips, the merged result, with
        markers called ``subject:label``.

    Raises
    ------
    MethodError
        Where the method cannot work on the clip.
    OptionError
        Where there is no such method or option, `same_subject` holds the clip itself, or the gap
        filter or overrides name markers or frames that the clip does not have.
    ClipError
        Where a clip of `same_subject` has no marker in common with the clip, or subjects of one
        file differ in their unit or up axis.
    DatabaseError
        Where the database cannot be read.

    See Also
    --------
    priorfill.fill_file : Fill the gaps of a file.
    priorfill.read : Read a clip.
    priorfill.write : Write the filled clip.
    priorfill.find_artefacts : Find label swaps, spikes and other artefacts.

    Examples
    --------
    >>> import priorfill as pf
    >>> from priorfill.synthetic.demo import make_demo_clip
    >>> truth, clip = make_demo_clip()
    >>> result = pf.fill(clip, method="linear", gap_filter=pf.GapFilter(max_gap=0.3))
    >>> [gap.label for gap in result.gaps if gap.filled]
    ['LKNE', 'STRN']
    """
    clips = _as_clips(clip, "clip")
    _check_types(database, method, gap_filter, overrides, options)
    if not clips:
        raise OptionError("there is no clip to fill; give one or several")
    same_subject = _as_clips(same_subject, "same_subject")
    for one in (*clips, *same_subject):
        check_coordinates(one.positions, one.labels, one.first_frame, one.name)
    if isinstance(overrides, (str, Path)):
        overrides = read_overrides(overrides)
    if overrides is not None:
        overrides = overrides.for_subjects(clips)
        check_swaps(overrides, clips)
    settings = _Settings(
        resolve(method),
        (gap_filter or GapFilter()).for_subjects(clips),
        overrides,
        reject_artefacts,
        options or FillOptions(),
    )
    others = assign_same_subject(clips, same_subject)
    with ExitStack() as stack:
        if isinstance(database, (str, Path)):
            from priorfill.database import PriorDatabase  # few fills need it

            database = stack.enter_context(
                PriorDatabase.open(database, state=settings.options.database_state)
            )
        rows = () if database is None else database.clips()
        if overrides is not None:
            names = None if database is None else (row.name for row in rows)
            check_sources(overrides, names, same_subject=bool(same_subject))
        shown = {label for row in rows for label in row.labels}
        plans = [_plan(one, own, settings, shown) for one, own in zip(clips, others, strict=True)]
        # sums by several BLAS threads depend on their number; those by one thread do not
        stack.enter_context(threadpool_limits(1, user_api="blas"))
        samples = sum(run.samples for plan in plans for run in plan.runs)
        progress = SampleProgress(samples, settings.options.progress)
        filling = _Filling(settings, database, progress)
        done = accumulate((plan.samples for plan in plans), initial=0)
        filled = [filling.fill(plan, first) for plan, first in zip(plans, done, strict=False)]
        result = merge_results(filled)
    return replace(result, notes=(*notes_on_origin(result), *result.notes))


def _as_clips(given: Clip | Sequence[Clip], name: str) -> tuple[Clip, ...]:
    """Return an argument that is a clip or several as a tuple."""
    remedy = "a Clip or several; read a file with priorfill.read"
    if isinstance(given, Clip):
        return (given,)
    check_type(name, given, Iterable, remedy)
    for clip in (clips := tuple(given)):
        check_type(name, clip, Clip, remedy)
    return clips


def _check_types(
    database: object, method: object, gap_filter: object, overrides: object, options: object
) -> None:
    """Check arguments of `fill` that may be None but for the method."""
    check_type("method", method, str, "the name of a method")
    path = (str, Path)
    if database is not None:
        from priorfill.database import PriorDatabase  # 0.02 s that fills without one need not pay

        remedy = "the folder of one, or a PriorDatabase"
        check_type("database", database, (*path, PriorDatabase), remedy)
    for name, value, kinds, remedy in (
        ("gap_filter", gap_filter, GapFilter, "a GapFilter"),
        ("overrides", overrides, (*path, Overrides), "the path of a file, or Overrides"),
        ("options", options, FillOptions, "FillOptions"),
    ):
        if value is not None:
            check_type(name, value, kinds, remedy)


@dataclass(frozen=True)
class _Settings:
    """The arguments of `fill` but for clips and database."""

    method: str
    gap_filter: GapFilter
    overrides: Overrides | None
    reject_artefacts: bool
    options: FillOptions
    method_options: Any = field(init=False)

    def __post_init__(self) -> None:
        """Check the method and make its options object; None for the defaults."""
        get_method(self.method)
        given, default = self.options.method_options, get_options(self.method)
        if isinstance(given, Mapping):
            made = changed_options(self.method, given)
        elif default is not None and isinstance(given, type(default)):
            made = None if given == default else given
        else:
            own = "no options"
            if default is not None:
                own = f"{type(default).__name__} or a mapping of names to values"
            raise OptionError(
                f"{type(given).__name__} does not apply to method {self.method}; "
                f"{self.method} takes {own}"
            )
        object.__setattr__(self, "method_options", made)

    @property
    def default(self) -> RunSettings:
        """How gaps without an override are filled."""
        return RunSettings(self.method, self.method_options)


@dataclass(frozen=True, eq=False)
class _Plan:
    """What is to be done with one clip.

    Attributes
    ----------
    given : Clip
        The clip as given.
    swapped : SwappedClip
        The same with the markers exchanged that overrides swap.
    cleaned : Clip
        Without the samples of artefacts.
    artefacts : tuple of Artefact
        Why those were rejected, or samples are in doubt.
    clip : Clip
        `cleaned` without samples that overrides treat as missing.
    applied : AppliedOverrides or None
        What the overrides mean for it.
    same_subject : tuple of Clip
        Other recordings of the subject.
    takes : tuple of Take
        Those that may be learnt from, in the clip's order of markers.
    notes : tuple of str
        Why others of `same_subject` are not learnt from.
    seen : SeenClip
        What methods see of `clip`.
    runs : tuple of MethodRun
        The gaps of each method.
    """

    given: Clip
    swapped: SwappedClip
    cleaned: Clip
    artefacts: tuple[Artefact, ...]
    clip: Clip
    applied: AppliedOverrides | None
    same_subject: tuple[Clip, ...]
    takes: tuple[Take, ...]
    notes: tuple[str, ...]
    seen: SeenClip
    runs: tuple[MethodRun, ...]

    @property
    def samples(self) -> int:
        """Number of missing samples of all gap groups."""
        return sum(run.samples for run in self.runs)

    @property
    def measured(self) -> Clip:
        """The clip as measured, with the markers in their right places."""
        return self.swapped.clip


def _plan(
    given: Clip, same_subject: tuple[Clip, ...], settings: _Settings, shown: set[str]
) -> _Plan:
    """Find what is to be done with a clip; ``shown`` are markers of the database."""
    swapped = swap_markers(settings.overrides, given)
    measured = cleaned = swapped.clip
    options = settings.options
    artefacts: tuple[Artefact, ...] = ()
    if settings.reject_artefacts:
        cleaned, artefacts = without_artefacts(measured)
    elif options.plausibility.hide_doubtful:
        artefacts = recalled(
            options.cache, ("artefacts", measured), lambda: find_artefacts(measured)
        )
    applied = None if settings.overrides is None else apply_overrides(settings.overrides, cleaned)
    clip = cleaned if applied is None else applied.clip
    sources = {CLIP, *([SAME_SUBJECT] if same_subject else []), *([DATABASE] if shown else [])}
    definition = options.marker_set or recognise(clip.labels)
    known = {label for other in same_subject for label in other.labels} | shown
    known |= set() if definition is None else {*definition.labels, *definition.match(clip.labels)}
    phantoms = find_phantoms(measured, known)
    hidden = doubtful_samples(clip, artefacts, options.plausibility)
    beyond = int(min(round(seconds_of(options.extrapolate, clip.rate) * clip.rate, 6), clip.frames))
    seen = SeenClip(clip, hidden, definition, beyond, options.plausibility.interpolate_seconds)
    runs = tuple(
        replace(run, groups=seen.groups(run.skipped))
        for run in plan_runs(
            clip,
            settings_of_overrides(settings.overrides, clip, settings.default, sources),
            settings.gap_filter,
            applied,
            settings.overrides,
            phantoms,
        )
    )
    takes, notes = same_subject_takes(measured, same_subject, definition)
    notes += check_marker_set(
        clip.labels, clip.positions, definition, given=settings.options.marker_set is not None
    )
    return _Plan(
        given,
        swapped,
        cleaned,
        artefacts,
        clip,
        applied,
        same_subject,
        takes,
        (*notes, *(() if settings.gap_filter.markers else phantom_notes(measured, phantoms))),
        seen,
        runs,
    )


@dataclass(frozen=True)
class _Filling:
    """Fills planned clips.

    Attributes
    ----------
    settings : _Settings
        Arguments of `fill`.
    database : PriorDatabase or None
        Opened.
    progress : SampleProgress
        Counter of samples.
    """

    settings: _Settings
    database: PriorDatabase | None
    progress: SampleProgress

    @cached_property
    def state(self) -> DatabaseState | None:
        """State of the database."""
        return None if self.database is None else database_state(self.database)

    @cached_property
    def records_digest(self) -> str:
        """Digest of the rows of the database's clips."""
        if self.database is None:
            return ""
        return digest_of(str(self.database.path), tuple(self.database.clips()))

    def fill(self, plan: _Plan, first: int) -> Result:
        """Fill one clip by the methods of its plan; ``first`` samples are done."""
        provenance = self._provenance(plan)
        results = []
        for run in plan.runs:
            results.append(self._fill_by(plan, run, provenance, first))
            first += run.samples
        result = results[0]
        if plan.applied is not None:
            result = join_runs(plan.cleaned, plan.applied, results)
        if self.settings.reject_artefacts:
            result = restore_rejected(result, plan.measured, plan.artefacts)
        else:
            result = replace(result, artefacts=plan.artefacts)
        swapped = plan.swapped.swapped
        return replace(
            result,
            swapped=None if swapped is None else swapped & ~result.filled,
            notes=(
                *plan.swapped.notes,
                *result.notes,
                *_notes_on_doubt(result, plan.seen.hidden),
            ),
        )

    def _fill_by(self, plan: _Plan, run: MethodRun, provenance: Provenance, first: int) -> Result:
        """Fill the gaps of one method."""
        found = self._estimated(plan, run, first)
        self.progress.reach(first + run.samples)
        estimate, hidden = found.estimate, found.hidden
        samples = filled_samples(plan.clip, estimate, run.left_alone)
        gaps = sum_up_gaps(plan.clip, samples, run.method, estimate.notes, run.left_alone)
        names = [name for gap in gaps for name in gap.source_clips]
        return Result(
            plan.clip.with_positions(samples.positions),
            samples.filled,
            samples.expected_rms,
            samples.error_bound_90,
            gaps,
            run.method,
            plan.seen.geometry.marker_set,
            np.zeros(samples.filled.shape, dtype=bool),
            replace(provenance, source_clips=source_clips(found.records, names)),
            doubtful=hidden if hidden.any() else None,
            database=None if self.database is None else self.database.path,
            notes=(*plan.notes, *found.notes),
        )

    def _estimated(self, plan: _Plan, run: MethodRun, first: int) -> RunEstimate:
        """Return the estimate of a method, from the cache if it has it."""
        cache = self.settings.options.cache
        if cache is None:
            return self._compute(plan, run, first)
        key = self._key(plan, run)
        found = cache.recall(key, lambda: self._compute(plan, run, first), lambda one: one.nbytes)
        return found.copy()

    def _key(self, plan: _Plan, run: MethodRun) -> str:
        """Return a digest of all that the estimate of a method depends on."""
        options = self.settings.options
        return digest_of(
            plan.clip,
            plan.seen.hidden,
            plan.seen.definition,
            plan.seen.extrapolate,
            run.settings,
            run.skipped,
            *plan.same_subject,
            self.records_digest,
            replace(options, method_options={}, progress=None, cache=None, checkpoint=None),
        )

    def _compute(self, plan: _Plan, run: MethodRun, first: int) -> RunEstimate:
        """Call a method on the recordings that it may learn from."""
        damaged: dict[str, DatabaseCorruptError] = {}
        while True:
            prior = DatabaseTakes(
                plan.clip,
                self.database,
                plan.seen.definition,
                self.settings.options,
                plan.same_subject,
                damaged,
            )
            takes = tuple(t for t in plan.takes + prior.takes if run.settings.may_use(t))
            estimate, hidden = self._estimate(plan, run, takes, first)
            if not prior.withdrawn:
                return RunEstimate(estimate, hidden, prior.notes, prior.records)
            damaged |= prior.withdrawn  # again, without these clips

    def _estimate(
        self, plan: _Plan, run: MethodRun, takes: tuple[Take, ...], first: int
    ) -> tuple[Estimate, NDArray[np.bool_]]:
        """Call a method; return what is believed of its estimate, and which samples it missed."""
        options = self.settings.options
        method = run.settings.function()
        if not (takes or run.settings.learn_from_clip):
            method = _without_sources
        filling = BelievableFill(
            plan.seen,
            takes,
            run.skipped,
            options.plausibility,
            options.max_error,
            options.estimate_errors,
            run.settings.learn_from_clip,
            options.checkpoint or (lambda: None),
        )
        has_copies = options.estimate_errors and not METHODS[run.method].predicts_errors
        shares = CallShares(self.progress, first, run.samples, has_copies)
        return filling(lambda task: method(task, shares.next(task.samples)))

    def _provenance(self, plan: _Plan) -> Provenance:
        """Return the provenance of a filled clip but for the clips that were learnt from."""
        settings = self.settings
        marker_set, changed = settings.options.marker_set, settings.method_options
        return Provenance(
            versions=package_versions(),
            method=settings.method,
            options={} if changed is None else differing(changed),
            clips=(identify(plan.given),),
            same_subject=tuple(identify(clip) for clip in plan.same_subject),
            database=self.state,
            selection=settings.options.selection,
            trust_filled=settings.options.trust_filled,
            marker_set=None if marker_set is None else marker_set.name,
            gap_filter=settings.gap_filter,
            overrides=settings.overrides,
            reject_artefacts=settings.reject_artefacts,
            marker_set_content=marker_set_content(marker_set),
            extrapolate=settings.options.extrapolate,
            max_error=settings.options.max_error,
            estimate_errors=settings.options.estimate_errors,
            plausibility=settings.options.plausibility.to_json(),
        )


def _without_sources(task: Task, progress: Progress) -> Estimate:
    """Fill nothing: none of the chosen sources has a recording."""
    reason = "none of the chosen sources has a recording to learn from"
    progress(task.samples)
    return Estimate.without_errors(task, np.full_like(task.positions, np.nan), "", reason)


def _frames(first: int, last: int) -> str:
    return f"{first}-{last}" if last > first else f"{first}"


def _notes_on_doubt(result: Result, found: NDArray[np.bool_]) -> Iterator[str]:
    """Yield notes that name the measured samples that nothing was learnt from.

    Parameters
    ----------
    result : Result
        Of a fill.
    found : ndarray of bool [shape=(frames, markers)]
        Those of artefacts; others were left out when a fill was repeated.
    """
    if result.doubtful is None:
        return
    for samples, text in (
        (
            result.doubtful & found,
            "measured samples in doubt are written as measured; fills neither learn from them nor "
            "join them",
        ),
        (
            result.doubtful & ~found,
            "measured samples next to fills that were not believed were left out when these were "
            "repeated",
        ),
    ):
        if samples.any():
            yield f"{int(samples.sum())} {text} (frames: {_places(result.clip, samples)})"


def _places(clip: Clip, samples: NDArray[np.bool_]) -> str:
    """Return the markers and frames of some samples, as far as a note has room."""
    first = clip.first_frame
    markers = np.flatnonzero(samples.any(axis=0))
    places = [
        f"{clip.labels[marker]} "
        + ", ".join(_frames(first + a, first + b - 1) for a, b in runs_of(samples[:, marker]))
        for marker in markers[:MAX_PLACES]
    ]
    more = len(markers) - MAX_PLACES
    return "; ".join([*places, *([f"and {more} more markers"] if more > 0 else [])])
