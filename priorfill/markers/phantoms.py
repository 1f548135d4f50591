"""Trajectories that are no markers of their own: fragments of a marker, and phantoms.

Where a program loses a marker, it may continue its path under another label: RBAC, then RBAC-1.
Reflections become trajectories of a few frames. To fill such a trajectory for the rest of the clip
would invent a marker. A marker of the marker set, or one that another recording shows, is neither:
it is a dropout, and filled.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip

__all__ = ["Phantom", "find_phantoms", "phantom_notes"]

MAX_VISIBLE_SHARE = 0.01
"""Share of the frames in which a phantom is visible at most."""

MIN_FRAMES = 100
"""Frames of a clip in which phantoms are looked for: 1 % of fewer are no frame."""

MAX_FRAGMENT_SHARE = 0.5
"""Share of the frames in which a fragment is visible at most."""

MAX_COMMON_SHARE = 0.1
"""Share of a fragment's frames that may show the marker itself as well."""

MAX_NOTES = 6
"""Trajectories that get a note of their own, and those named in the one on the others."""

MAX_LABEL = 64
"""Characters of a label that is searched for the name of another marker."""

_FRAGMENT = re.compile(r"(?P<base>.*[^-_. #~(])[-_. #~(]+(?P<again>\w*?)\d{1,3}\)?")
"""RBAC-1, RBAC_2, RBAC.3, RBAC (2), RBAC-RBAC1."""


@dataclass(frozen=True)
class Phantom:
    """A trajectory that is no marker of its own.

    Attributes
    ----------
    marker : int
        Its index.
    reason : str
        Why it is taken as such, for messages.
    """

    marker: int
    reason: str


def find_phantoms(clip: Clip, known: Collection[str] = ()) -> tuple[Phantom, ...]:
    """Find fragments and phantoms among the trajectories of a clip.

    Parameters
    ----------
    clip : Clip
        The clip.
    known : collection of str
        Labels that are markers for certain: those of the marker set, and of other recordings.

    Returns
    -------
    tuple of Phantom
        In the order of the markers.
    """
    visible = ~clip.missing
    counts = visible.sum(axis=0).tolist()
    place = {label: marker for marker, label in enumerate(clip.labels)}
    found = []
    for marker, (label, count) in enumerate(zip(clip.labels, counts, strict=True)):
        if label in known or count == clip.frames:
            continue
        base = _base_of(label, visible, place, known)
        if base:
            where = _frames(clip, visible[:, marker])
            found.append(Phantom(marker, f"a fragment of {base} by its label, visible in {where}"))
        elif clip.frames >= MIN_FRAMES and 0 < count <= MAX_VISIBLE_SHARE * clip.frames:
            where = _frames(clip, visible[:, marker])
            found.append(Phantom(marker, f"visible in {where} only; taken as a phantom"))
    return tuple(found)


def phantom_notes(clip: Clip, phantoms: Sequence[Phantom]) -> tuple[str, ...]:
    """Return notes on trajectories that are not filled.

    Parameters
    ----------
    clip : Clip
        The clip.
    phantoms : sequence of Phantom
        As found in it.
    """
    notes = [
        f"{clip.labels[phantom.marker]}: {phantom.reason}; not filled unless named in `markers`"
        for phantom in phantoms[:MAX_NOTES]
    ]
    if len(phantoms) > MAX_NOTES:
        rest = [clip.labels[phantom.marker] for phantom in phantoms[MAX_NOTES:]]
        named = ", ".join(rest[:MAX_NOTES]) + (", ..." if len(rest) > MAX_NOTES else "")
        notes.append(f"{len(rest)} more fragments and phantoms are not filled: {named}")
    return tuple(notes)


def _base_of(
    label: str, visible: NDArray[np.bool_], place: Mapping[str, int], known: Collection[str]
) -> str:
    """Return the marker that a label is a fragment of; empty if it is none.

    Unless it is as rare as a phantom, the two may not be visible together: markers of a cluster are
    numbered in the same way.
    """
    match = _FRAGMENT.fullmatch(label) if len(label) <= MAX_LABEL else None
    if match is None or match["again"] not in ("", match["base"]):
        return ""
    seen = visible[:, place[label]]
    if seen.mean() > MAX_FRAGMENT_SHARE:
        return ""
    base = match["base"]
    if base not in place:
        return base if base in known else ""
    if seen.mean() <= MAX_VISIBLE_SHARE:
        return base
    common = seen & visible[:, place[base]]
    return base if common.sum() <= MAX_COMMON_SHARE * seen.sum() else ""


def _frames(clip: Clip, visible: NDArray[np.bool_]) -> str:
    """Return in which frames a trajectory is visible, as a phrase."""
    seen = np.flatnonzero(visible)
    if not len(seen):
        return f"none of {clip.frames} frames"
    first, last = clip.first_frame + int(seen[0]), clip.first_frame + int(seen[-1])
    where = f"frame {first}" if first == last else f"frames {first}-{last}"
    return f"{len(seen)} of {clip.frames} frames ({where})"
