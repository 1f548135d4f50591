"""Progress of a fill, counted in missing samples.

The total is known before the first method is called. A fill may need further ones: of artificial
gaps, for expected errors, and of what was not believed. Each call of a method has a share of the
samples, so that the count grows with the work, and never falls.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain

__all__ = ["CallShares", "SampleProgress"]

ONE_FILL = (0.9,)
"""Shares of the calls for a method that predicts its errors: one fill, most often."""

WITH_COPIES = (0.33, 0.33, 0.33)
"""The same where expected errors are found from artificial gaps, by two more fills."""


class SampleProgress:
    """Counts the samples that are done.

    Parameters
    ----------
    total : int
        Number of missing samples of all gap groups of a fill.
    report : callable or None
        Called with the samples done and all samples: at once with 0, then whenever more are done.

    Examples
    --------
    >>> progress = SampleProgress(20, lambda done, total: print(f"{done} of {total}"))
    0 of 20
    >>> progress.reach(4.5)
    4 of 20
    >>> progress.reach(3.0)
    >>> progress.reach(40.0)
    20 of 20
    """

    def __init__(self, total: int, report: Callable[[int, int], None] | None = None) -> None:
        self._total = total
        self._report = report
        self._shown = -1
        self.reach(0.0)

    def reach(self, done: float) -> None:
        """Report that at least this number of samples is done."""
        whole = min(int(done), self._total)
        if whole > self._shown:
            self._shown = whole
            if self._report is not None:
                self._report(whole, self._total)


@dataclass
class CallShares:
    """Divides samples of a fill among the calls of a method that fill them.

    Attributes
    ----------
    whole : SampleProgress
        Of the fill.
    first, samples : int
        Samples done before, and samples to divide.
    has_copies : bool
        Whether the method fills artificial gaps as well.
    """

    whole: SampleProgress
    first: int
    samples: int
    has_copies: bool = False
    _begun: float = field(default=0.0, init=False)
    _shares: Iterator[float] = field(init=False)

    def __post_init__(self) -> None:
        """Begin with the first call."""
        expected: Iterable[float] = WITH_COPIES if self.has_copies else ONE_FILL
        self._shares = chain(expected, iter(lambda: 0.5 * (1.0 - self._begun), None))

    def next(self, samples: int) -> Callable[[float], None]:
        """Return the progress callback of the next call.

        Parameters
        ----------
        samples : int
            How many samples the method will report.
        """
        begun, share = self._begun, next(self._shares)
        self._begun += share
        done = 0.0

        def progress(more: float) -> None:
            nonlocal done
            done = min(done + more, samples)
            self.whole.reach(self.first + self.samples * (begun + share * done / max(samples, 1)))

        return progress
