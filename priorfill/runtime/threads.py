"""The number of threads priorfill may use, and work divided among them.

By default all cores; the environment variable `VARIABLE` sets a lower limit. When several processes
fill clips at the same time, more threads than cores only slow each other down.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import islice, pairwise
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # `priorfill --help` imports no NumPy
    from numpy.typing import NDArray

__all__ = [
    "VARIABLE",
    "Map",
    "by_frames",
    "limit_threads",
    "map_in_threads",
    "run_in_threads",
    "split_range",
    "thread_count",
]

Map = Callable[..., Iterable[Any]]
"""`map`, or a function like it that works on several items at a time."""

AHEAD = 2
"""Items per thread that are begun before the results of earlier ones are used."""

MIN_SHARED = 1_000_000
"""Numbers in an array for each thread that takes part in a pass over it: threads take a fraction of
a millisecond to start, and such a pass takes several."""

BLOCK_NUMBERS = 500_000
"""Numbers of a block of frames: temporary arrays of a block stay in the processor's cache."""

VARIABLE = "PRIORFILL_THREADS"
"""Environment variable with the maximum number of threads of a fill."""


def thread_count() -> int:
    """Return the number of threads a fill may use; results do not depend on it."""
    cores = os.cpu_count() or 1
    try:
        requested = int(os.environ.get(VARIABLE, ""))
    except ValueError:
        return cores
    return min(max(requested, 1), cores)


def limit_threads(count: int) -> None:
    """Limit fills in this process to `count` threads (1 or more)."""
    os.environ[VARIABLE] = str(count)


def split_range(count: int, max_parts: int) -> list[tuple[int, int]]:
    """Split ``range(count)`` into contiguous parts, one per thread.

    Parameters
    ----------
    count : int
        Length of the range.
    max_parts : int
        Number of threads the work is worth; `thread_count` is a further limit.

    Returns
    -------
    list of (int, int)
        Start and stop of each part.

    Examples
    --------
    >>> split_range(10, 1)
    [(0, 10)]
    """
    threads = max(1, min(max_parts, thread_count(), count))
    return list(pairwise(count * part // threads for part in range(threads + 1)))


def run_in_threads(work: Callable[[int, int], Any], parts: list[tuple[int, int]]) -> list[Any]:
    """Call ``work(start, stop)`` for all parts at the same time; return the results in order.

    No part may write to memory that another one writes to.
    """
    if len(parts) == 1:
        return [work(*parts[0])]
    with map_in_threads() as mapped:
        return list(mapped(work, *zip(*parts, strict=True)))


def by_frames(work: Callable[..., Any], *arrays: NDArray[Any]) -> list[Any]:
    """Call a function with blocks of frames of arrays, in threads where the arrays are large.

    Parameters
    ----------
    work : callable
        Takes the same frames of each array. It may write to them.
    *arrays : ndarray [shape=(frames, ...)]
        Of the same frames; the first one tells how many there are in a block.

    Returns
    -------
    list
        The results, in order of the blocks; their number does not depend on that of threads.

    Examples
    --------
    >>> import numpy as np
    >>> by_frames(np.sum, np.ones((4, 3)))
    [np.float64(12.0)]
    """
    frames, numbers = len(arrays[0]), arrays[0].size
    step = max(frames * BLOCK_NUMBERS // max(numbers, 1), 1)
    blocks = [tuple(a[i : i + step] for a in arrays) for i in range(0, max(frames, 1), step)]
    with map_in_threads(numbers) as mapped:
        return list(mapped(work, *zip(*blocks, strict=True)))


@contextmanager
def map_in_threads(numbers: int | None = None) -> Iterator[Map]:
    """Yield a function like `map`, whose items the threads of a fill share; it may be nested.

    A thread that waits for a result works on other items meanwhile. An item may map over others, so
    that all threads take part even where there are fewer long items than threads.

    Parameters
    ----------
    numbers : int, optional
        Numbers of the array that all items together pass over: one thread for each `MIN_SHARED`.

    Examples
    --------
    >>> with map_in_threads() as mapped:
    ...     list(mapped(lambda row: sum(mapped(abs, row)), [[1, -2], [-3]]))
    [3, 3]
    """
    threads = thread_count()
    if numbers is not None:
        threads = min(threads, numbers // MIN_SHARED)
    if threads <= 1:
        yield map
        return
    pool = _Pool(AHEAD * threads)
    helpers = [threading.Thread(target=pool.help, daemon=True) for _ in range(threads - 1)]
    try:
        for helper in helpers:
            helper.start()
        yield pool.map
    finally:
        pool.close()
        for helper in helpers:
            if helper.ident is not None:
                helper.join()


class _Item:
    """A call; what it returned or raised is there when it is done."""

    def __init__(self, work: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        self.done = False
        self._work, self._arguments = work, arguments
        self._result: Any = None
        self.error: BaseException | None = None

    def call(self) -> None:
        try:
            self._result = self._work(*self._arguments)
        except BaseException as error:
            self.error = error

    def result(self) -> Any:
        if self.error is not None:
            raise self.error
        return self._result


class _Pool:
    """The items that several threads work on.

    There is no deadlock: a thread only waits for an item that another one has begun, after all
    items below it in the stack of either thread.

    Parameters
    ----------
    ahead : int
        Items of each map that may be begun before the results of earlier ones are used.
    """

    def __init__(self, ahead: int) -> None:
        self._ahead = ahead
        self._changed = threading.Condition()
        self._not_begun: dict[object, deque[_Item]] = {}  # of each map, the oldest first
        self._closed = False

    def map(self, work: Callable[..., Any], *items: Iterable[Any]) -> Iterator[Any]:
        """Yield the results of calls with all items, in order."""
        arguments = zip(*items, strict=True)
        key, begun, not_begun = object(), deque[_Item](), deque[_Item]()
        with self._changed:
            self._not_begun[key] = not_begun
        try:
            while True:
                more = [_Item(work, each) for each in islice(arguments, self._ahead - len(begun))]
                begun.extend(more)
                with self._changed:
                    not_begun.extend(more)
                    self._changed.notify_all()
                if not begun:
                    return
                self._work_until(lambda first=begun[0]: first.done, not_begun)  # type: ignore[misc]
                yield begun.popleft().result()
        finally:
            with self._changed:
                del self._not_begun[key]

    def help(self) -> None:
        """Work on items until the pool is closed."""
        self._work_until(lambda: self._closed, deque())

    def close(self) -> None:
        """Let helping threads end."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _work_until(self, done: Callable[[], bool], own: deque[_Item]) -> None:
        """Work on items until there is nothing to wait for, on those of a map first."""
        while True:
            with self._changed:
                while not done() and not any(self._not_begun.values()):
                    self._changed.wait()
                if done():
                    return
                # those of the newest map are the shortest
                item = (own or next(q for q in reversed(self._not_begun.values()) if q)).popleft()
            item.call()
            with self._changed:
                item.done = True
                self._changed.notify_all()
            if isinstance(item.error, KeyboardInterrupt):  # at once, not when its turn comes
                raise item.error
