"""Gaps of every kind, cut into recordings at random: what studies of accuracy fill.

A gap is cut only where all its samples are measured, and no longer than half of the clip.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from recordings import LIMBS

import priorfill as pf
from priorfill.distances import pair_distances
from priorfill.markerset import describe

EDGE = 0.25
"""s. Gaps inside a clip stay so far from its ends."""

MOST = 0.5
"""Part of a clip that a gap takes at most: the rest is there to learn from."""

LIMB_MARKERS = 4
"""A limb has so many markers at least, and where segments are found from data it is made of
neighbouring segments until it has."""

SHORT_REST = 2.0
"""s of complete frames that are left in a clip of the kind ``short``."""

SCATTER_SHARE = (0.03, 0.09)
"""Share of samples missing, of the kind ``scatter``: that of the 50 patterns that Gløersen and
Federolf 2016 published."""

SCATTER_SECONDS = (0.1, 2.0)
"""s; likewise."""

SCATTER_AT_ONCE = 7
"""Markers missing at once at most; likewise."""

TRIES = 200
"""Placements tried before a clip is given up."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Parts:
    """Which markers of a clip belong together.

    Attributes
    ----------
    segments, limbs : list of list of int
        Markers of each segment and of each limb.
    segment_of : dict of str to str
        Each marker's segment.
    """

    segments: list[list[int]]
    limbs: list[list[int]]
    segment_of: dict[str, str]


def parts_of(clip: pf.Clip) -> Parts:
    """Return the parts of a body: by its marker set, or found from the data."""
    marker_set = describe(clip)
    segment_of = {label: marker_set.segment.get(label, "") for label in clip.labels}
    by_name: dict[str, list[int]] = {}
    for i, label in enumerate(clip.labels):
        if segment_of[label]:
            by_name.setdefault(segment_of[label], []).append(i)
    limbs = [
        [i for name in names for i in by_name.get(f"{side}_{name}", [])]
        for names in LIMBS.values()
        for side in ("left", "right")
    ]
    limbs = [limb for limb in limbs if len(limb) >= LIMB_MARKERS]
    segments = [some for some in by_name.values() if len(some) > 1]
    return Parts(segments, limbs or _grown(clip, list(by_name.values())), segment_of)


def _grown(clip: pf.Clip, segments: list[list[int]]) -> list[list[int]]:
    """Return each segment with its nearest ones, until they have the markers of a limb."""
    distance, _ = pair_distances(clip.positions)
    limbs = []
    for segment in segments:
        order = sorted(segments, key=lambda s, here=segment: distance[np.ix_(here, s)].mean())
        limb = list(segment)
        for other in order:
            if len(limb) >= LIMB_MARKERS:
                break
            limb += [i for i in other if i not in limb]
        limbs.append(limb)
    return limbs


class _Cutter:
    """Cuts gaps into one clip."""

    def __init__(self, clip: pf.Clip, parts: Parts, rng: np.random.Generator) -> None:
        self.clip = clip
        self.parts = parts
        self.rng = rng
        self.known = ~clip.missing
        self.gone = np.zeros_like(clip.missing)

    def length(self, low: float, high: float) -> int | None:
        """Draw a length in frames; None where the clip is too short for any (s)."""
        high = min(high, MOST * self.clip.duration)
        return round(self.rng.uniform(low, high) * self.clip.rate) if high >= low else None

    def pick(self, some: list[list[int]]) -> list[int] | None:
        """Draw one of several lists of markers."""
        return some[self.rng.integers(len(some))] if some else None

    def marker(self) -> list[int]:
        """Draw a marker."""
        return [int(self.rng.integers(len(self.clip.labels)))]

    def start(self, frames: int) -> int:
        """Draw where a gap inside the clip begins."""
        edge = min(round(EDGE * self.clip.rate), (self.clip.frames - frames) // 2)
        return int(self.rng.integers(edge, self.clip.frames - frames - edge + 1))

    def free(self, markers: list[int], start: int, stop: int) -> bool:
        """Return whether samples, and those beside them, are measured and not cut out yet."""
        around = slice(max(start - 1, 0), stop + 1)
        return bool((self.known & ~self.gone)[around, markers].all())

    def cut(self, markers: list[int] | None, frames: int | None) -> bool:
        """Cut some markers out, somewhere; return whether there was a place."""
        if not markers or frames is None:
            return False
        for _ in range(TRIES):
            start = self.start(frames)
            if self.free(markers, start, start + frames):
                self.gone[start : start + frames, markers] = True
                return True
        return False


def _single(cutter: _Cutter) -> bool:
    return cutter.cut(cutter.marker(), cutter.length(0.5, 2.0))


def _segment(cutter: _Cutter) -> bool:
    return cutter.cut(cutter.pick(cutter.parts.segments), cutter.length(1.0, 2.0))


def _limb(cutter: _Cutter) -> bool:
    return cutter.cut(cutter.pick(cutter.parts.limbs), cutter.length(1.0, 3.0))


def _limbs(cutter: _Cutter) -> bool:
    limbs = cutter.parts.limbs
    first, second = cutter.rng.permutation(len(limbs))[:2] if len(limbs) > 1 else (0, 0)
    both = sorted({*limbs[first], *limbs[second]}) if limbs else []
    return first != second and cutter.cut(both, cutter.length(1.0, 2.0))


def _long(cutter: _Cutter) -> bool:
    """Cut three or four parts, each with frames of its own inside a common stretch."""
    rng, frames = cutter.rng, cutter.length(2.0, 6.0)
    several = [*cutter.parts.segments, *cutter.parts.limbs]
    if frames is None or len(several) < 3:
        return False
    for _ in range(TRIES):
        start = cutter.start(frames)
        chosen = rng.permutation(len(several))[: rng.integers(3, 5)]
        pieces = []
        for n, i in enumerate(chosen):
            length = frames if n == 0 else round(rng.uniform(0.4, 1.0) * frames)
            first = start + int(rng.integers(frames - length + 1))
            pieces.append((several[i], first, first + length))
        if all(cutter.free(*piece) for piece in pieces):
            for markers, first, last in pieces:
                cutter.gone[first:last, markers] = True
            return True
    return False


def _ends(cutter: _Cutter) -> bool:
    """Cut a marker, a segment or a limb out at the clip's start or end."""
    choice = cutter.rng.integers(3)
    markers = cutter.marker()
    if choice:
        markers = cutter.pick([cutter.parts.segments, cutter.parts.limbs][choice - 1]) or markers
    frames, last = cutter.length(0.5, 1.0), cutter.clip.frames
    if frames is None:
        return False
    start, stop = (0, frames) if cutter.rng.integers(2) else (last - frames, last)
    if not cutter.free(markers, start, stop):
        return False
    cutter.gone[start:stop, markers] = True
    return True


def _scatter(cutter: _Cutter) -> bool:
    share = cutter.rng.uniform(*SCATTER_SHARE)
    for _ in range(TRIES):
        frames, marker = cutter.length(*SCATTER_SECONDS), cutter.marker()
        if frames is None:
            return False
        start = cutter.start(frames)
        crowded = cutter.gone[start : start + frames].sum(axis=1).max() >= SCATTER_AT_ONCE
        if not crowded and cutter.free(marker, start, start + frames):
            cutter.gone[start : start + frames, marker] = True
        if cutter.gone.mean() >= share:
            break
    return bool(cutter.gone.any())


def _blackout(cutter: _Cutter) -> bool:
    return cutter.cut(list(range(len(cutter.clip.labels))), cutter.length(0.1, 0.5))


def _dropout(cutter: _Cutter) -> bool:
    shown = np.flatnonzero(cutter.known.all(axis=0))
    chosen = cutter.rng.permutation(shown)[: cutter.rng.integers(1, 3)]
    cutter.gone[:, chosen] = True
    return len(chosen) > 0


KINDS: dict[str, Callable[[_Cutter], bool]] = {
    "single": _single,
    "segment": _segment,
    "limb": _limb,
    "limbs": _limbs,
    "long": _long,
    "ends": _ends,
    "scatter": _scatter,
    "blackout": _blackout,
    "dropout": _dropout,
    "short": _limb,
}
"""Kinds of gaps, by name; ``short`` is a limb of 1 to 2 s with little else in the clip."""


def cut_gaps(
    kind: str, clip: pf.Clip, parts: Parts, rng: np.random.Generator
) -> tuple[pf.Clip, Mask] | None:
    """Cut gaps of a kind into a clip.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    clip : Clip
        The truth.
    parts : Parts
        Of its body.
    rng : Generator
        What draws.

    Returns
    -------
    clip : Clip
        The truth, cut shorter if the kind asks for it.
    gone : ndarray of bool [shape=(frames, markers)]
        What is to be removed. None instead of both where the clip has no place for the kind.
    """
    if kind == "short":
        return _cut_short(clip, parts, rng)
    cutter = _Cutter(clip, parts, rng)
    return (clip, cutter.gone) if KINDS[kind](cutter) else None


def _cut_short(
    clip: pf.Clip, parts: Parts, rng: np.random.Generator
) -> tuple[pf.Clip, Mask] | None:
    """Cut a limb out, and so much of the clip away that little else is left."""
    frames, rest = round(rng.uniform(1.0, 2.0) * clip.rate), round(SHORT_REST * clip.rate)
    edge = round(EDGE * clip.rate)
    if clip.frames < frames + rest:
        return None
    first = int(rng.integers(clip.frames - frames - rest + 1))
    short = replace(
        clip,
        positions=clip.positions[first : first + frames + rest],
        first_frame=clip.first_frame + first,
        source=None,
    )
    cutter = _Cutter(short, parts, rng)
    limb, start = cutter.pick(parts.limbs), int(rng.integers(edge, rest - edge + 1))
    if limb is None or not cutter.free(limb, start, start + frames):
        return None
    cutter.gone[start : start + frames, limb] = True
    return short, cutter.gone
