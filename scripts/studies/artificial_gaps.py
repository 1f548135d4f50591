"""Random gaps of several kinds in recordings, for studies of accuracy.

A gap is placed only where all its samples are measured, and spans at most half of the clip.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

import priorfill as pf
from priorfill.evaluation.body_parts import BodyParts
from priorfill.evaluation.gap_generator import (
    MAX_TRIES,
    MIN_EDGE_SECONDS,
    GapGenerator,
    Mask,
)
from priorfill.evaluation.protocols import RANDOM_GAP_SECONDS, RANDOM_GAP_SHARE, RANDOM_MAX_MISSING

SHORT_SECONDS = 2.0
"""s. Length of the complete frames that remain in a clip of kind ``short``."""


class _Cutter(GapGenerator):
    """Generates gaps in one clip with known segments and limbs."""

    def __init__(self, clip: pf.Clip, parts: BodyParts, rng: np.random.Generator) -> None:
        super().__init__(clip, rng)
        self.parts = parts


def _single(cutter: _Cutter) -> bool:
    return cutter.remove(cutter.marker(), cutter.length(0.5, 2.0))


def _segment(cutter: _Cutter) -> bool:
    return cutter.remove(cutter.pick(cutter.parts.segments), cutter.length(1.0, 2.0))


def _limb(cutter: _Cutter) -> bool:
    return cutter.remove(cutter.pick(cutter.parts.limbs), cutter.length(1.0, 3.0))


def _limbs(cutter: _Cutter) -> bool:
    limbs = cutter.parts.limbs
    first, second = cutter.rng.permutation(len(limbs))[:2] if len(limbs) > 1 else (0, 0)
    both = sorted({*limbs[first], *limbs[second]}) if limbs else []
    return first != second and cutter.remove(both, cutter.length(1.0, 2.0))


def _long(cutter: _Cutter) -> bool:
    """Remove three or four segments or limbs, each for its own part of a common interval."""
    rng, frames = cutter.rng, cutter.length(2.0, 6.0)
    several = [*cutter.parts.segments, *cutter.parts.limbs]
    if frames is None or len(several) < 3:
        return False
    for _ in range(MAX_TRIES):
        start = cutter.start(frames)
        chosen = rng.permutation(len(several))[: rng.integers(3, 5)]
        pieces = []
        for n, i in enumerate(chosen):
            length = frames if n == 0 else round(rng.uniform(0.4, 1.0) * frames)
            first = start + int(rng.integers(frames - length + 1))
            pieces.append((several[i], first, first + length))
        if all(cutter.is_free(*piece) for piece in pieces):
            for markers, first, last in pieces:
                cutter.mask[first:last, markers] = True
            return True
    return False


def _ends(cutter: _Cutter) -> bool:
    """Remove a marker, a segment or a limb at the start or end of the clip."""
    choice = cutter.rng.integers(3)
    markers = cutter.marker()
    if choice:
        markers = cutter.pick([cutter.parts.segments, cutter.parts.limbs][choice - 1]) or markers
    frames, last = cutter.length(0.5, 1.0), cutter.clip.frames
    if frames is None:
        return False
    start, stop = (0, frames) if cutter.rng.integers(2) else (last - frames, last)
    if not cutter.is_free(markers, start, stop):
        return False
    cutter.mask[start:stop, markers] = True
    return True


def _scatter(cutter: _Cutter) -> bool:
    share = cutter.rng.uniform(*RANDOM_GAP_SHARE)
    return cutter.scatter(share, RANDOM_GAP_SECONDS, RANDOM_MAX_MISSING)


def _blackout(cutter: _Cutter) -> bool:
    return cutter.remove(list(range(len(cutter.clip.labels))), cutter.length(0.1, 0.5))


def _dropout(cutter: _Cutter) -> bool:
    shown = np.flatnonzero(cutter.measured.all(axis=0))
    chosen = cutter.rng.permutation(shown)[: cutter.rng.integers(1, 3)]
    cutter.mask[:, chosen] = True
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
"""Kinds of gaps; ``short`` is a limb for 1 to 2 s in a clip with few other frames."""


def cut_gaps(
    kind: str, clip: pf.Clip, parts: BodyParts, rng: np.random.Generator
) -> tuple[pf.Clip, Mask] | None:
    """Place gaps of a kind in a clip.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    clip : Clip
        The truth.
    parts : BodyParts
        Its segments and limbs.
    rng : Generator
        Random numbers.

    Returns
    -------
    clip : Clip
        The truth, shortened for kind ``short``.
    gone : ndarray of bool [shape=(frames, markers)]
        Samples to remove. None instead of both if the clip has no room for the kind.
    """
    if kind == "short":
        return _cut_short(clip, parts, rng)
    cutter = _Cutter(clip, parts, rng)
    return (clip, cutter.mask) if KINDS[kind](cutter) else None


def _cut_short(
    clip: pf.Clip, parts: BodyParts, rng: np.random.Generator
) -> tuple[pf.Clip, Mask] | None:
    """Remove a limb, and shorten the clip until few other frames remain."""
    frames, rest = round(rng.uniform(1.0, 2.0) * clip.rate), round(SHORT_SECONDS * clip.rate)
    edge = round(MIN_EDGE_SECONDS * clip.rate)
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
    if limb is None or not cutter.is_free(limb, start, start + frames):
        return None
    cutter.mask[start : start + frames, limb] = True
    return short, cutter.mask
