"""Fill a trial that another program has open, and set only filled samples in it.

The program may change the trial while it is filled. So each marker is read again before it is set
and is left alone unless every sample, missing or not, is equal to the bit to the one read first.
After it was set it is read once more: measured samples must have kept their bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol, Unpack

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.database import PriorDatabase
from priorfill.errors import ClipError, IntegrationError, OptionError
from priorfill.filling.fill_clip import fill
from priorfill.filling.fill_options import FillKeywords
from priorfill.filling.gap_filter import GapFilter, matching_markers
from priorfill.filling.leave_missing import leave_missing
from priorfill.filling.multi_subject import read_subjects
from priorfill.filling.overrides import SWAP
from priorfill.filling.overrides_file import read_overrides
from priorfill.filling.result import Result
from priorfill.filling.uncertainty_file import check_uncertainty, write_uncertainty
from priorfill.formats.recording import MAX_COORDINATE
from priorfill.formats.up_axis import find_up_axis
from priorfill.runtime.argument_types import check_attributes, check_type
from priorfill.runtime.option_checks import check_not_text
from priorfill.runtime.option_texts import first_names

__all__ = ["OpenTrial", "TrialOptions", "TrialResult", "fill_trial"]

_CALLS = ("markers", "check_same", "read", "set_filled", "take_back")
"""What an open trial has."""

_MAX_NAMES = 12
"""Markers that a message lists."""


class OpenTrial(Protocol):
    """A trial that is open in another program: the calls that priorfill needs.

    Attributes
    ----------
    program : str
        Name of the program, for messages.
    name : str
        Name of the trial.
    rate : float
        Frame rate (Hz).
    first_frame : int
        Number of the first frame, as the program shows it.
    frames : int
        Number of frames.
    selected : tuple of int
        First and last frame of the range that the user has selected, numbered likewise.
    gaps_only : bool
        Whether measured samples are never replaced, even if they are rejected as artefacts.
    notes : list of str
        What a user should know about what was read.
    """

    program: str
    name: str
    rate: float
    first_frame: int
    frames: int
    selected: tuple[int, int]
    gaps_only: bool
    notes: list[str]

    def markers(self, subjects: Sequence[str]) -> list[tuple[str, list[str]]]:
        """Return subjects with the labels of their markers; those named, or the active ones."""

    def check_same(self) -> None:
        """Raise IntegrationError unless the program still has the trial open."""

    def read(self, subject: str, marker: str) -> NDArray[np.float64]:
        """Return the positions of a marker [shape=(frames, 3), mm]; NaN where missing."""

    def set_filled(
        self,
        subject: str,
        marker: str,
        positions: NDArray[np.float64],
        filled: NDArray[np.bool_],
    ) -> None:
        """Set the filled samples of a marker, whose other samples are as they were read."""

    def take_back(
        self,
        subject: str,
        marker: str,
        measured: NDArray[np.float64],
        filled: NDArray[np.bool_],
    ) -> None:
        """Undo `set_filled`: the filled samples are as in `measured` again."""


@dataclass(frozen=True)
class TrialOptions:
    """How `fill_trial` reads a trial, and what it writes.

    Attributes
    ----------
    subject : tuple of str
        Names of the subjects to fill; by default those that are active in the program.
    up : str or None
        The axis that points up, one of ``+X -X +Y -Y +Z -Z``; found from the data if None.
    whole_trial : bool
        Fill all frames, not only those of the range that is selected in the program.
    dry_run : bool
        Fill, but set nothing.
    uncertainty : Path or str, optional
        File for the expected error of each filled sample, .npz or .csv.
    overwrite : bool
        Replace an existing file of that name.

    Raises
    ------
    OptionError
        Where `subject` is a text instead of a tuple.

    See Also
    --------
    fill_trial : Fill the trial.

    Examples
    --------
    >>> TrialOptions(subject=("Anna",), dry_run=True).whole_trial
    False
    """

    subject: tuple[str, ...] = ()
    up: str | None = None
    whole_trial: bool = False
    dry_run: bool = False
    uncertainty: Path | str | None = None
    overwrite: bool = False

    def __post_init__(self) -> None:
        """Check the names."""
        check_not_text(self, "subject")


@dataclass(frozen=True, eq=False)
class TrialResult:
    """What `fill_trial` did.

    Attributes
    ----------
    program, trial : str
        Names of the program and of the trial.
    result : Result
        The fill; of several subjects merged. Markers that were not set have no filled samples.
    set_markers : tuple of str
        The markers that were set; for several subjects ``subject:label``.
    refused : tuple of str
        The markers with filled samples that were not set, because the program or its user had
        changed them in the meantime.
    notes : tuple of str
        What was left out, and how the up axis was found, a sentence each.
    dry_run : bool
        Whether nothing was to be set.
    uncertainty : Path or None
        The file with the expected error of each filled sample.

    See Also
    --------
    fill_trial : Fill the trial.

    Examples
    --------
    >>> done = fill_trial(trial)  # doctest: +SKIP
    >>> done.result.complete  # doctest: +SKIP
    True
    """

    program: str
    trial: str
    result: Result
    set_markers: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    dry_run: bool = False
    uncertainty: Path | None = None


def fill_trial(
    trial: OpenTrial,
    *,
    trial_options: TrialOptions | None = None,
    database: PriorDatabase | str | Path | None = None,
    same_subject: Sequence[Clip | Path | str] = (),
    **arguments: Unpack[FillKeywords],
) -> TrialResult:
    """Fill the trial that a program has open.

    Only markers with filled samples are set, each as a whole and after the checks of this module.
    Nothing is saved.

    Parameters
    ----------
    trial : OpenTrial
        The trial.
    trial_options : TrialOptions, optional
        Subjects, range and files.
    database : PriorDatabase or path, optional
        Recordings to learn from, besides the trial itself.
    same_subject : sequence of Clip or path
        Other recordings of the same subject, such as the static trial. Of a file with several
        subjects, those of the trial are used.
    **arguments
        ``method``, ``gap_filter``, ``overrides``, ``reject_artefacts`` and ``options`` of
        `priorfill.fill`.

    Returns
    -------
    TrialResult
        The fill, and which markers were set.

    Raises
    ------
    IntegrationError
        Where the program does not answer as documented, has another trial open than at the
        start, or a marker cannot be set: the message states which markers were set before it.
    ClipError, MethodError, OptionError, DatabaseError
        As in `priorfill.fill`.
    OutputError
        Where the file of the uncertainty cannot be written.

    See Also
    --------
    priorfill.fill : Fill the gaps of a clip.
    priorfill.integrations.nexus.open_nexus : The trial that is open in Nexus.
    priorfill.integrations.qtm.open_qtm : The measurement that is open in QTM.

    Examples
    --------
    >>> from priorfill.integrations.nexus import open_nexus  # doctest: +SKIP
    >>> done = fill_trial(open_nexus(), database="lab-priors")  # doctest: +SKIP
    """
    check_attributes("trial", trial, _CALLS, "what open_nexus or open_qtm returns")
    options = trial_options if trial_options is not None else TrialOptions()
    check_type("trial_options", options, TrialOptions, "TrialOptions")
    _check_overrides(trial, arguments)
    if options.uncertainty is not None:
        check_uncertainty(options.uncertainty, overwrite=options.overwrite)
    gap_filter = arguments.get("gap_filter") or GapFilter()
    clips, notes = _read_clips(trial, options, gap_filter.markers)
    arguments["gap_filter"] = _within_selection(trial, gap_filter, options)
    others = _recordings(same_subject, clips)
    result = fill(clips, database=database, same_subject=others, **arguments)
    if trial.gaps_only:
        measured = ~np.concatenate([clip.missing for clip in clips], axis=1)
        reason = f"it is measured, and only gaps are filled in {trial.program}"
        result = leave_missing(result, clips, measured, reason)
    done = TrialResult(trial.program, trial.name, result, notes=notes, dry_run=options.dry_run)
    if not options.dry_run:
        done = _set_markers(trial, clips, done)
    if options.uncertainty is None:
        return done
    write_uncertainty(options.uncertainty, done.result, overwrite=options.overwrite)
    return replace(done, uncertainty=Path(options.uncertainty))


def _check_overrides(trial: OpenTrial, arguments: FillKeywords) -> None:
    """Read the overrides; raise OptionError where they exchange markers."""
    overrides = arguments.get("overrides")
    if isinstance(overrides, (str, Path)):
        overrides = arguments["overrides"] = read_overrides(overrides)
    if overrides is None:
        return
    for number, entry in enumerate(overrides.entries, start=1):
        if entry.do == SWAP:
            raise OptionError(
                f"{overrides.name}: gap {number}: swap applies to files; exchange the markers in "
                f"{trial.program}"
            )


def _read_clips(
    trial: OpenTrial, options: TrialOptions, named: Sequence[str]
) -> tuple[list[Clip], tuple[str, ...]]:
    """Read a clip for each subject; return what was left out too.

    Markers without any sample are left out unless patterns name them: a subject of these programs
    also lists markers that were not worn.
    """
    clips: list[Clip] = []
    notes: list[str] = []
    up = options.up
    for subject, labels in trial.markers(options.subject):
        if not labels:
            continue
        positions = np.stack([trial.read(subject, label) for label in labels], axis=1)
        _check_coordinates(trial, labels, positions)
        clip = Clip(
            positions,
            tuple(labels),
            trial.rate,
            name=trial.name,
            subject=subject,
            first_frame=trial.first_frame,
        )
        wanted = {marker for pattern in named for marker in matching_markers(clip, pattern)}
        kept = [k for k in range(len(labels)) if k in wanted or not clip.missing[:, k].all()]
        absent = [label for k, label in enumerate(labels) if k not in kept]
        if absent:
            whose = f" of {subject}" if subject else ""
            notes.append(
                f"left out: {first_names(absent, _MAX_NAMES)}{whose}, not visible in any frame; "
                "`markers` names markers to be filled nevertheless"
            )
        if kept:
            own = clip.positions[:, kept]
            own_labels = tuple(labels[k] for k in kept)
            if up is None:
                found, found_from, up_notes = find_up_axis(own, own_labels, "", options.up)
                if found_from == "data":
                    up = found
                notes += up_notes
            clips.append(replace(clip, positions=own, labels=own_labels))
    if not clips:
        raise ClipError(
            f"{trial.name}: {trial.program} has no labelled marker with samples; label the trial "
            "first"
        )
    notes = list(dict.fromkeys([*trial.notes, *notes]))
    # one volume has one up axis
    return [replace(clip, up=up or "+Z") for clip in clips], tuple(notes)


def _recordings(same_subject: Sequence[Clip | Path | str], clips: Sequence[Clip]) -> list[Clip]:
    """Return other recordings of the subjects of some clips, reading those that are files."""
    names = {clip.subject for clip in clips}
    found: list[Clip] = []
    for one in same_subject:
        there = (one,) if isinstance(one, Clip) else read_subjects(one)
        # `fill` reports a recording of none of the subjects
        found += [clip for clip in there if clip.subject in names] or there
    return found


def _check_coordinates(
    trial: OpenTrial, labels: Sequence[str], positions: NDArray[np.float64]
) -> None:
    """Raise ClipError where a marker is farther away than any can be."""
    far = (np.abs(positions) > MAX_COORDINATE).any(axis=2)
    if far.any():
        frame, marker = np.argwhere(far)[0]
        raise ClipError(
            f"{trial.name}: marker {labels[marker]} is implausibly far away in frame "
            f"{trial.first_frame + int(frame)}; delete this sample"
        )


def _within_selection(trial: OpenTrial, gap_filter: GapFilter, options: TrialOptions) -> GapFilter:
    """Return the gap filter with the frames that are selected in the program."""
    whole = (trial.first_frame, trial.first_frame + trial.frames - 1)
    if options.whole_trial and gap_filter.frames is not None:
        raise OptionError("both `frames` and `whole_trial` are given; give one of them")
    if options.whole_trial or gap_filter.frames is not None or trial.selected == whole:
        return gap_filter
    return replace(gap_filter, frames=trial.selected)


def _set_markers(trial: OpenTrial, clips: Sequence[Clip], done: TrialResult) -> TrialResult:
    """Set all markers with filled samples that nobody has changed in the meantime."""
    filled = done.result.filled
    places = [(clip, k) for clip in clips for k in range(len(clip.labels))]
    pending = [place for place in range(len(places)) if filled[:, place].any()]
    names = [
        f"{clip.subject}:{clip.labels[k]}" if len(clips) > 1 else clip.labels[k]
        for clip, k in places
    ]
    if pending:
        trial.check_same()
    finished: list[int] = []
    refused = np.zeros(len(places), dtype=bool)
    for place in pending:
        clip, k = places[place]
        try:
            refused[place] = not _set_marker(
                trial,
                (clip.subject, clip.labels[k]),
                clip.positions[:, k],
                done.result.clip.positions[:, place],
                filled[:, place],
            )
        except (KeyboardInterrupt, Exception) as error:
            rest = [one for one in pending if one not in finished and not refused[one]]
            message = _failure(trial, names[place], error, names, (finished, rest))
            if isinstance(error, KeyboardInterrupt):
                error.args = (message,)
                raise
            raise IntegrationError(message) from error
        if not refused[place]:
            finished.append(place)
    reason = (
        f"it was changed in {trial.program} while the trial was filled, so it was not set; repeat "
        "the fill"
    )
    samples = filled & refused
    return replace(
        done,
        result=leave_missing(done.result, clips, samples, reason),
        set_markers=tuple(names[place] for place in finished),
        refused=tuple(name for name, left in zip(names, refused, strict=True) if left),
    )


def _set_marker(
    trial: OpenTrial,
    marker: tuple[str, str],
    measured: NDArray[np.float64],
    positions: NDArray[np.float64],
    filled: NDArray[np.bool_],
) -> bool:
    """Set a marker; return whether it was as at the start.

    Raises
    ------
    IntegrationError
        Where the program does not have what was set. The marker is as before if that was possible.
    """
    if not _same_bits(trial.read(*marker), measured):
        return False
    positions = np.where(filled[:, None], positions, measured)
    try:
        trial.set_filled(*marker, positions, filled)
        problem = _difference(trial.read(*marker), positions, filled)
    except Exception as error:
        problem = str(error) or type(error).__name__
    except BaseException:
        _take_back(trial, marker, measured, filled)
        raise
    if problem:
        restored = _take_back(trial, marker, measured, filled)
        state = "it is as before" if restored else "its state is unknown"
        raise IntegrationError(f"{problem}; {state}")
    return True


def _take_back(
    trial: OpenTrial,
    marker: tuple[str, str],
    measured: NDArray[np.float64],
    filled: NDArray[np.bool_],
) -> bool:
    """Return whether a marker is as it was, if need be after its filled samples are removed."""
    try:
        if not _same_bits(trial.read(*marker), measured):
            trial.take_back(*marker, measured, filled)
        return _same_bits(trial.read(*marker), measured)
    except Exception:  # the first failure is the one to report
        return False


def _same_bits(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Check whether positions are equal to the bit, and missing in the same frames."""
    if one.shape != other.shape:
        return False
    there = ~np.isnan(one)
    return bool(
        (there == ~np.isnan(other)).all()
        and (one[there].view(np.uint64) == other[there].view(np.uint64)).all()
    )


def _difference(
    back: NDArray[np.float64], sent: NDArray[np.float64], filled: NDArray[np.bool_]
) -> str:
    """Return how a marker that was set differs from what was sent; empty if it does not.

    A program may store single precision, which measured samples have already.
    """
    if back.shape != sent.shape or not _same_bits(back[~filled], sent[~filled]):
        return "other samples than the filled ones differ afterwards"
    step = np.spacing(np.abs(sent[filled]).astype(np.float32))
    if not (np.abs(back[filled] - sent[filled]) <= step).all():  # False for NaN
        return "its filled samples are not what was sent"
    return ""


def _failure(
    trial: OpenTrial,
    name: str,
    error: BaseException,
    names: Sequence[str],
    progress: tuple[Sequence[int], Sequence[int]],
) -> str:
    """Return the message of a marker that could not be set: what is set, and what is not."""
    reason = str(error) or type(error).__name__
    finished, rest = ([names[place] for place in places] for places in progress)
    set_before = "nothing was set before"
    if finished:
        set_before = f"set before: {first_names(finished, _MAX_NAMES)}"
    return (
        f"{trial.name}: {name} could not be set in {trial.program} ({reason}); {set_before}; "
        f"not set: {first_names(rest, _MAX_NAMES)}; reload the trial without saving it to undo all"
    )
