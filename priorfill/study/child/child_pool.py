"""Child processes that wait for another job of a study.

A process that has filled a file fills the next one without loading everything again: libraries,
compiled functions and definitions, which take longer than the fill of a short recording.
"""

from __future__ import annotations

from collections import deque

from priorfill.study.child.child_process import ChildProcess
from priorfill.study.job import JobLimits

__all__ = ["ChildPool"]

MAX_KEPT_SHARE = 0.5
"""Largest memory of a process that is kept, as a share of the limit of a job: what libraries do not
give back must not count against the next job."""


class ChildPool:
    """Child processes that have answered, and wait for another request."""

    def __init__(self) -> None:
        self._waiting: deque[ChildProcess] = deque()

    def take(self) -> ChildProcess | None:
        """Return a process that waits; None if there is none."""
        while True:
            try:
                child = self._waiting.pop()
            except IndexError:
                return None
            if not child.has_ended:
                return child
            child.close()

    def give(self, child: ChildProcess, limits: JobLimits) -> None:
        """Keep a process that has answered, or end it if it has too much memory.

        Parameters
        ----------
        child : ChildProcess
            The process.
        limits : JobLimits
            What a job may use.
        """
        if child.memory > MAX_KEPT_SHARE * limits.memory:
            child.close()
        else:
            self._waiting.append(child)

    def close(self) -> None:
        """End all that wait."""
        while (child := self.take()) is not None:
            child.close()
