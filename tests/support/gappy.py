"""Synthetic clips with gaps of known content, and linear interpolation as a reference."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

import numpy as np

from priorfill.clip import Clip
from priorfill.synthetic import Body, synthesise

ARM = ("LUPA", "LELB", "LFRM", "LWRA", "LWRB", "LFIN")
FOOT = ("RANK", "RHEE", "RTOE", "RMT5")


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
