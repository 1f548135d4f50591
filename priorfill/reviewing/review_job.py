"""A fill or save that runs in a thread, reports its progress, and can be stopped."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from priorfill.reviewing.session import FillStoppedError

__all__ = ["ReviewJob"]

Outcome = TypeVar("Outcome")


class ReviewJob(Generic[Outcome]):
    """Runs a function in a thread, which ends with the program.

    Parameters
    ----------
    work : callable
        Is called with the job, whose `report` and `check` a fill calls.
    changed : callable
        Is called from the thread after each step and at the end.

    Attributes
    ----------
    progress : tuple of int or None
        Number of gap groups done and of all.
    done : bool
        Whether the thread has ended.
    outcome : object or None
        What the function returned.
    error : BaseException or None
        What it raised.
    """

    def __init__(
        self, work: Callable[[ReviewJob[Outcome]], Outcome], changed: Callable[[], None]
    ) -> None:
        self.progress: tuple[int, int] | None = None
        self.done = False
        self.outcome: Outcome | None = None
        self.error: BaseException | None = None
        self._work = work
        self._changed = changed
        self._stopped = threading.Event()
        # a daemon: a fill that is being stopped does not keep the program from ending
        self._thread = threading.Thread(target=self._run, name="priorfill-review", daemon=True)

    @property
    def stopped(self) -> bool:
        """Whether the fill was asked to stop."""
        return self._stopped.is_set()

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """Ask the fill to stop, which it does at its next checkpoint."""
        self._stopped.set()

    def _run(self) -> None:
        try:
            self.outcome = self._work(self)
        except BaseException as error:
            self.error = error
        self.done = True
        self._changed()

    def check(self) -> None:
        """Raise FillStoppedError if the fill was asked to stop."""
        if self.stopped:
            raise FillStoppedError("stopped")

    def report(self, done: int, total: int) -> None:
        """Note the progress.

        Parameters
        ----------
        done, total : int
            Number of gap groups done and of all.
        """
        self.check()
        self.progress = done, total
        self._changed()
