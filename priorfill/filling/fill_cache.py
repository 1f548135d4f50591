"""A memory of what fills computed, so that a repeated fill computes only what has changed."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.methods.task import Estimate

__all__ = ["FillCache", "RunEstimate", "digest_of", "recalled"]

T = TypeVar("T")

MAX_BYTES = 1 << 30
"""Bytes that a cache holds at most (1 GiB): eight estimates of 10,000 frames of 300 markers."""

_OVERHEAD = 1 << 10
"""Bytes counted for an entry besides its arrays."""


@dataclass(frozen=True, eq=False)
class RunEstimate:
    """What one method estimated for a clip.

    Attributes
    ----------
    estimate : Estimate
        What is believed of its estimate.
    hidden : ndarray of bool [shape=(frames, markers)]
        Measured samples that it did not see.
    notes : tuple of str
        What of the database was not learnt from.
    records : tuple of ClipRecord
        Clips of the database that it could learn from.
    """

    estimate: Estimate
    hidden: NDArray[np.bool_]
    notes: tuple[str, ...]
    records: tuple[Any, ...]

    def copy(self) -> RunEstimate:
        """Return the same with an estimate of its own, which may be changed."""
        one = self.estimate
        bound = None if one.error_bound_90 is None else one.error_bound_90.copy()
        estimate = Estimate(one.positions.copy(), one.expected_rms.copy(), list(one.notes), bound)
        return RunEstimate(estimate, self.hidden, self.notes, self.records)

    @property
    def nbytes(self) -> int:
        """Size of the arrays."""
        one = self.estimate
        bound = 0 if one.error_bound_90 is None else one.error_bound_90.nbytes
        return one.positions.nbytes + one.expected_rms.nbytes + bound + self.hidden.nbytes


class FillCache:
    """Remembers what fills computed, for fills that are repeated with other overrides.

    Give the same cache to each fill (`FillOptions.cache`). What depends on nothing that has changed
    is not computed again, and the result is the same, bit for bit, as without a cache. One fill at
    a time may use it.

    Parameters
    ----------
    max_bytes : int
        Bytes that it holds at most. What was used longest ago is forgotten first.

    See Also
    --------
    priorfill.fill : Fill the gaps of a clip.

    Examples
    --------
    >>> import priorfill as pf
    >>> from priorfill.synthetic.demo import make_demo_clip
    >>> cache, clip = FillCache(), make_demo_clip()[1]
    >>> options = pf.FillOptions(cache=cache)
    >>> first = pf.fill(clip, method="linear", options=options)
    >>> again = pf.fill(clip, method="linear", options=options)
    >>> cache.hits > 0, bool((first.filled == again.filled).all())
    (True, True)
    """

    def __init__(self, max_bytes: int = MAX_BYTES) -> None:
        self.hits = 0
        self._max_bytes = max_bytes
        self._held: OrderedDict[str, tuple[Any, int]] = OrderedDict()

    def recall(
        self, key: str, compute: Callable[[], T], size: Callable[[T], int] = lambda _: 0
    ) -> T:
        """Return what was computed for a key, or compute it.

        Parameters
        ----------
        key : str
            A digest of all that the value depends on.
        compute : callable
            Returns the value.
        size : callable
            Returns the bytes of a value. It must not be changed afterwards.
        """
        if key in self._held:
            self.hits += 1
            self._held.move_to_end(key)
            value: T = self._held[key][0]
            return value
        value = compute()
        self._held[key] = (value, size(value) + _OVERHEAD)
        while len(self._held) > 1 and sum(n for _, n in self._held.values()) > self._max_bytes:
            self._held.popitem(last=False)
        return value

    def holds(self, key: str) -> bool:
        """Whether something was computed for a key."""
        return key in self._held


def recalled(cache: FillCache | None, parts: Sequence[Any], compute: Callable[[], T]) -> T:
    """Return what a cache holds for something, or compute it; without a cache compute it.

    Parameters
    ----------
    cache : FillCache or None
        The cache.
    parts : sequence of object
        All that the value depends on; see `digest_of`.
    compute : callable
        Returns the value, which is small.
    """
    return compute() if cache is None else cache.recall(digest_of(*parts), compute)


def digest_of(*parts: Any) -> str:
    """Return a digest of clips, arrays, and of what has an exact text.

    Parameters
    ----------
    *parts : object
        Clips count by all that fills depend on, arrays by type, shape and bits, other values by
        their `repr`.
    """
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, Clip):
            text = repr((part.labels, part.rate, part.up, part.name, part.subject))
            text += repr(part.first_frame)
            digest.update(f"clip {len(text)} {text}".encode("utf-8", "surrogatepass"))
            part = part.positions
        if isinstance(part, np.ndarray):
            digest.update(f"array {part.dtype.str} {part.shape}".encode())
            digest.update(np.ascontiguousarray(part).data)
        else:
            text = f"{type(part).__name__} {part!r}"
            digest.update(f"{len(text)} {text}".encode("utf-8", "surrogatepass"))
    return digest.hexdigest()
