"""Sketches of recordings: hashes of a few samples, which identify versions of one recording.

A clip with gaps, the same clip filled, and a part cut out of it hold the same measured samples, bit
for bit. A sketch contains the hashes of samples that are below a fixed threshold, about one in two
thousand: two sketches then have the same share in common as the recordings, however different the
lengths (scaled MinHash: Broder, "On the resemblance and containment of documents", SEQUENCES 1997;
Irber et al., bioRxiv 2022.01.11.475838). Short recordings keep a minimum number of hashes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["MIN_SHARED_HASHES", "is_version", "sketch"]

SAMPLES_PER_HASH = 2048
"""One of this many samples is kept. A minute of 41 markers at 120 Hz gives 144 hashes, which take
2 kB in the catalogue, compared with 1.5 MB of positions."""

MIN_HASHES = 32
"""Minimum number of hashes kept. Of a one-second clip that misses two thirds of its samples, about
ten hashes remain in the sketch of its filled version."""

MIN_SHARED_HASHES = 3
"""Minimum number of common hashes of two versions of one recording. One would be enough if there
were no markers that stand still and no coordinates typed in by hand."""

MIN_SHARE_SAME_LENGTH = 0.1
"""Minimum share of the smaller sketch that versions of the same length have in common."""

MIN_SHARE_OTHER_LENGTH = 0.9
"""Minimum share of the larger sketch that versions of different length have in common."""

_MULTIPLIERS = (np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB))
_ODD = np.uint64(0x9E3779B97F4A7C15)


def sketch(positions: NDArray[np.float64]) -> NDArray[np.uint32]:
    """Return the sketch of a recording.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.

    Returns
    -------
    ndarray of uint32 [shape=(hashes,)]
        Ascending, unique; independent of the order and the names of frames and markers.
    """
    samples = positions.reshape(-1, 3)
    samples = samples[~np.isnan(samples[:, 0])]
    # + 0.0 turns minus zero into zero
    words = np.ascontiguousarray(samples, dtype="<f4") + np.float32(0.0)
    x, y, z = words.view("<u4").astype(np.uint64).T
    hashes = np.unique(_scatter(_scatter(x << np.uint64(32) | y) ^ (z * _ODD)))
    below = int(np.searchsorted(hashes, np.uint64(2**64 // SAMPLES_PER_HASH)))
    # the threshold concerns the upper bits, so the lower 32 are still random: they take half the
    # space, and among a million clips three common hashes by chance are rare
    return np.unique(hashes[: max(below, MIN_HASHES)].astype(np.uint32))


def is_version(shared: int, one: int, other: int, *, same_length: bool) -> bool:
    """Return whether two clips are versions of one recording.

    Parameters
    ----------
    shared : int
        Number of hashes the sketches have in common.
    one, other : int
        Number of hashes of each.
    same_length : bool
        Whether the clips have equally many frames, as a clip and its filled version do.
    """
    if shared < MIN_SHARED_HASHES:
        return False
    return (same_length and shared >= MIN_SHARE_SAME_LENGTH * min(one, other)) or (
        shared >= MIN_SHARE_OTHER_LENGTH * max(one, other)
    )


def _scatter(words: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Mix the bits of 64-bit words (finaliser of SplitMix: Steele et al., OOPSLA 2014)."""
    words = (words ^ (words >> np.uint64(30))) * _MULTIPLIERS[0]
    words = (words ^ (words >> np.uint64(27))) * _MULTIPLIERS[1]
    return words ^ (words >> np.uint64(31))
