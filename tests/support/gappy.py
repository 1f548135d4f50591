"""Synthetic clips with gaps of known content, fills without check, and straight lines."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from priorfill.clip import Clip
from priorfill.filling.fill_clip import fill
from priorfill.filling.fill_options import FillOptions
from priorfill.filling.plausibility_options import UNCHECKED
from priorfill.filling.result import Result
from priorfill.synthetic import Body, synthesise

ARM = ("LUPA", "LELB", "LFRM", "LWRA", "LWRB", "LFIN")
FOOT = ("RANK", "RHEE", "RTOE", "RMT5")

WITH_ENDS = FillOptions(extrapolate=math.inf)
"""Options of a fill that is checked, but includes ends with fewer than three visible markers."""

AS_ESTIMATED = replace(
    WITH_ENDS, plausibility=replace(UNCHECKED, hide_doubtful=False), estimate_errors=False
)
"""Options of a fill that is a method's own estimate from all measured samples."""


@lru_cache
def person(
    motion: str = "walking", seconds: float = 4.0, rate: float = 60.0, seed: int = 3, body: int = 0
) -> Clip:
    """A synthetic clip without gaps."""
    return synthesise(motion, seconds=seconds, rate=rate, seed=seed, body=Body(seed=body))


def with_gaps(clip: Clip, *gaps: tuple[int, int, Iterable[str]]) -> Clip:
    """The clip without the frames `start` to `stop` of some markers, for each gap."""
    positions = clip.positions.copy()
    for start, stop, labels in gaps:
        positions[start:stop, [clip.labels.index(label) for label in labels]] = np.nan
    return clip.with_positions(positions)


def fill_unchecked(clip: Clip, **arguments: Any) -> Result:
    """Fill a clip with the method's own estimate, plausible or not."""
    return fill(clip, options=AS_ESTIMATED, **arguments)


def straight(clip: Clip) -> np.ndarray:
    """Positions with gaps interpolated linearly; at the clip's ends the position is repeated."""
    positions = clip.positions.copy()
    frames = np.arange(clip.frames)
    for marker in range(len(clip.labels)):
        known = ~clip.missing[:, marker]
        if known.any():
            for i in range(3):
                positions[:, marker, i] = np.interp(
                    frames, frames[known], positions[known, marker, i]
                )
    return positions


def error(positions: np.ndarray, truth: np.ndarray, where: np.ndarray) -> float:
    """Mean distance (mm) over some samples."""
    return float(np.linalg.norm(positions - truth, axis=2)[where].mean())
