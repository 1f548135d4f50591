"""Other clips next to a result: as it was measured, the truth, or other fills of the same gaps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import ClipError
from priorfill.geometry.axes import to_upright

if TYPE_CHECKING:
    from priorfill.filling.result import Result

__all__ = ["SAME_MM", "file_or_name", "gap_errors", "notes_on_fit", "positions_like"]

SAME_MM = 0.1
"""mm. Measured samples that differ by less are the same: formats round them, C3D files of integers
by half of their step, and so does the page."""

MAX_RATE_ERROR = 1e-3
"""Share by which rates may differ: some formats round them."""

SAME_RATE = 1e-5
"""Share up to which a difference of rates is no more than a format's rounding, and not noted."""

MAX_NAMES = 6
"""Number of markers in a note."""


def positions_like(
    given: Clip | Sequence[Clip], clip: Clip, *, all_markers: bool = False
) -> NDArray[np.float64]:
    """Return the positions of a recording in the order of markers of a clip.

    Parameters
    ----------
    given : Clip or sequence of Clip
        The recording; of a file of several subjects one clip for each.
    clip : Clip
        The clip to be compared with it; of several subjects their merged clip.
    all_markers : bool
        Whether the recording must have all markers; otherwise one is enough.

    Returns
    -------
    ndarray [shape=(frames, markers, 3), mm]
        Upright; NaN where missing.

    Raises
    ------
    ClipError
        Where frames, rate or markers do not fit.
    """
    parts = (given,) if isinstance(given, Clip) else tuple(given)
    if not parts:
        raise ClipError(f"{clip.name}: there is no clip to compare it with; give one")
    place = {
        label if len(parts) == 1 else f"{part.subject}:{label}": (part, marker)
        for part in parts
        for marker, label in enumerate(part.labels)
    }
    for part in parts:
        _check_fit(part, clip)
    lacking = [label for label in clip.labels if label not in place]
    if len(lacking) == len(clip.labels) or (lacking and all_markers):
        raise ClipError(
            f"{file_or_name(parts[0])}: has no marker {lacking[0]}, which "
            f"{file_or_name(clip)} has; give another version of the same recording"
        )
    upright = {id(part): to_upright(part.positions, part.up) for part in parts}
    positions = np.full((clip.frames, len(clip.labels), 3), np.nan)
    for marker, label in enumerate(clip.labels):
        if label in place:
            part, column = place[label]
            positions[:, marker] = upright[id(part)][:, column]
    return positions


def notes_on_fit(given: Clip | Sequence[Clip], clips: Sequence[Clip]) -> list[str]:
    """Return what a recording has otherwise than the clips that it is compared with.

    Parameters
    ----------
    given : Clip or sequence of Clip
        The recording; of a file of several subjects one clip for each.
    clips : sequence of Clip
        The clip of each subject.

    Returns
    -------
    list of str
        One line for each difference: rate, number of the first frame, markers.
    """
    parts = (given,) if isinstance(given, Clip) else tuple(given)
    there, here = parts[0], clips[0]
    file, other = file_or_name(there), file_or_name(here)
    notes = []
    if abs(there.rate - here.rate) > SAME_RATE * here.rate:
        notes.append(
            f"{file}: the frame rate is {there.rate:g} Hz, and that of {other} is {here.rate:g} "
            "Hz, which is used"
        )
    if abs(there.first_frame - here.first_frame) > 1:  # formats begin with 0 or with 1
        notes.append(
            f"{file}: its frames are numbered from {there.first_frame}, and those of {other} from "
            f"{here.first_frame}; the first ones are compared with each other"
        )
    known = {label for clip in clips for label in clip.labels}
    found = {label for part in parts for label in part.labels}
    if more := sorted(found - known):
        notes.append(f"{file}: {_listed(more)} not in {other}, and not shown")
    if fewer := sorted(known - found):
        notes.append(f"{file}: {_listed(fewer)} in {other} only")
    return notes


def _listed(labels: Sequence[str]) -> str:
    """Return labels as the subject of a sentence, its verb included."""
    names = ", ".join([*labels[:MAX_NAMES], *(["..."] if len(labels) > MAX_NAMES else [])])
    if len(labels) == 1:
        return f"marker {names} is"
    return f"{len(labels)} markers ({names}) are"


def gap_errors(result: Result, truth: NDArray[np.float64] | None) -> dict[int, NDArray[np.float64]]:
    """Return the true errors of the filled frames of each gap.

    Parameters
    ----------
    result : Result
        Of a fill.
    truth : ndarray [shape=(frames, markers, 3), mm] or None
        Upright true positions; NaN where unknown.

    Returns
    -------
    dict of int to ndarray [shape=(filled frames,), mm]
        By the number of the gap; NaN where the truth is unknown. Gaps without any are left out.
    """
    if truth is None:
        return {}
    index = {label: number for number, label in enumerate(result.clip.labels)}
    found = {}
    for number, gap in enumerate(result.gaps):
        inside = slice(gap.start, gap.stop), index[gap.label]
        filled = result.filled[inside]
        off = to_upright(result.clip.positions[inside][filled], result.clip.up)
        errors = np.sqrt(((off - truth[inside][filled]) ** 2).sum(axis=1))
        if np.isfinite(errors).any():
            found[number] = errors
    return found


def _check_fit(part: Clip, clip: Clip) -> None:
    """Raise ClipError where a recording has other frames than a clip."""
    if part.frames != clip.frames:
        raise ClipError(
            f"{file_or_name(part)}: has {part.frames} frames, and {file_or_name(clip)} has "
            f"{clip.frames}; "
            "give another version of the same recording"
        )
    if abs(part.rate - clip.rate) > MAX_RATE_ERROR * clip.rate:
        raise ClipError(
            f"{file_or_name(part)}: the frame rate is {part.rate:g} Hz, and that of "
            f"{file_or_name(clip)} is {clip.rate:g} Hz; give another version of the same recording"
        )


def file_or_name(clip: Clip) -> str:
    """Return the file of a clip, or the name of one made in memory.

    Parameters
    ----------
    clip : Clip
        The clip.
    """
    return clip.name if clip.source is None else str(clip.source.path)
