"""Sketches of recordings: a few hashed samples by which versions of one are told.

A clip with gaps, the same clip filled, and a part cut out of it hold the same measured samples,
bit for bit. So a recording is sketched by hashes of its samples, of which those below a fixed
threshold are kept, about one in two thousand: two sketches then share what the recordings share,
however different their lengths (scaled MinHash: Broder, "On the resemblance and containment of
documents", SEQUENCES 1997; Irber et al., bioRxiv 2022.01.11.475838). Short recordings keep their
smallest few.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["FEWEST_SHARED", "is_version", "sketch"]

ONE_IN = 2048
"""Of so many samples one is kept. A minute of 41 markers at 120 Hz gives 144 hashes, 2 kB in the
catalogue beside 1.5 MB of positions."""

FEWEST = 32
"""Hashes that are kept at least: of a second in which two of three samples were missing, ten are
still those of its filled version."""

FEWEST_SHARED = 3
"""Hashes in common that show two clips to be of one recording. One would be proof enough, were
there no markers that stand still and no coordinates typed in by hand."""

PART = 0.1
"""Share of the smaller sketch that two versions of the same length have in common at least."""

SAME = 0.9
"""Share of the larger sketch above which two clips of different length are one recording."""

_MULTIPLIERS = (np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB))
_ODD = np.uint64(0x9E3779B97F4A7C15)


def sketch(positions: NDArray[np.float64]) -> NDArray[np.uint32]:
    """Sketch a recording.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.

    Returns
    -------
    ndarray of uint32 [shape=(hashes,)]
        Ascending, each once; neither order nor names of frames and markers matter.
    """
    samples = positions.reshape(-1, 3)
    samples = samples[~np.isnan(samples[:, 0])]
    # + 0.0: minus zero is zero
    words = np.ascontiguousarray(samples, dtype="<f4") + np.float32(0.0)
    x, y, z = words.view("<u4").astype(np.uint64).T
    hashes = np.unique(_mixed(_mixed(x << np.uint64(32) | y) ^ (z * _ODD)))
    below = int(np.searchsorted(hashes, np.uint64(2**64 // ONE_IN)))
    # which ones are kept is told by the upper bits, so the lower ones are still at random: half of
    # the room, and three hashes in common by chance are rare among a million clips
    return np.unique(hashes[: max(below, FEWEST)].astype(np.uint32))


def is_version(shared: int, one: int, other: int, *, same_length: bool) -> bool:
    """Return whether two clips are versions of one recording.

    Parameters
    ----------
    shared : int
        Hashes that the sketches have in common.
    one, other : int
        Hashes of each.
    same_length : bool
        Whether they have as many frames: a filled clip has, a part cut out has not.
    """
    if shared < FEWEST_SHARED:
        return False
    return (same_length and shared >= PART * min(one, other)) or shared >= SAME * max(one, other)


def _mixed(words: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Scatter 64-bit words (the finaliser of Steele et al., SplitMix, OOPSLA 2014)."""
    words = (words ^ (words >> np.uint64(30))) * _MULTIPLIERS[0]
    words = (words ^ (words >> np.uint64(27))) * _MULTIPLIERS[1]
    return words ^ (words >> np.uint64(31))
