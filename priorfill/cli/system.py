"""Signals that end the program, closed or full output streams, and limits on memory."""

from __future__ import annotations

import errno
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from priorfill.errors import PriorfillError
from priorfill.runtime.held_files import WINDOWS

__all__ = [
    "TerminatedError",
    "check_memory_limit",
    "end_on_signals",
    "finish_stdout",
    "is_closed_pipe",
    "open_closed_streams",
]

_SIGNALS = ("SIGTERM", "SIGHUP", "SIGBREAK")
"""Requests to end: by the system or a scheduler, by a terminal that closes, by Ctrl-Break. When a
console of Windows closes, the process ends at once; what it leaves, later processes remove."""

_EXIT_SIGNAL = 128
"""Exit status of a program ended by signal 0, as shells count."""


_MIN_MEMORY = 1 << 30
"""Address space (bytes) below which a fill of a minute of 50 markers fails."""

_BLAS_THREADS = "OPENBLAS_NUM_THREADS"


class TerminatedError(KeyboardInterrupt):
    """A signal asks the program to end; like Ctrl-C, it lets writers remove what is unfinished.

    Attributes
    ----------
    exit_status : int
        The exit status that shells give a program ended by this signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(f"ended by signal {number}")
        self.exit_status = _EXIT_SIGNAL + number


@contextmanager
def end_on_signals() -> Iterator[None]:
    """Raise `TerminatedError` in the block when the program is asked to end.

    Signals that are ignored, as SIGHUP under ``nohup``, stay ignored.
    """
    kept: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        for name in _SIGNALS:
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is signal.SIG_DFL:
                kept[number] = signal.signal(number, _end)
    try:
        yield
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)


def _end(number: int, frame: Any) -> None:
    raise TerminatedError(number)


def open_closed_streams() -> None:
    """Send what is printed nowhere if the program was started without stdout or stderr."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8", newline="\n"))  # noqa: SIM115, PTH123


def finish_stdout() -> None:
    """Flush stdout; if it has been closed or is full, send what is left nowhere.

    Otherwise Python would try, and fail, once more at its end.
    """
    try:
        sys.stdout.flush()
    except (OSError, ValueError):
        with suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def is_closed_pipe(error: OSError) -> bool:
    """Return whether writing failed because the reader of our output has closed it.

    Parameters
    ----------
    error : OSError
        Raised by writing to stdout; on Windows, which calls this an invalid argument.
    """
    if isinstance(error, BrokenPipeError):
        return True
    return WINDOWS and error.errno == errno.EINVAL and error.filename is None


def check_memory_limit() -> None:
    """Prepare the libraries for a limit on the address space, as ``ulimit -v`` sets it.

    OpenBLAS reserves memory for a thread on each core when it is loaded, and retries for ever if it
    gets none. Fills need one such thread only: they distribute gaps over cores, not matrices.

    Raises
    ------
    PriorfillError
        If the limit is too low.
    """
    try:
        import resource
    except ImportError:  # Windows limits the memory of jobs, but not the address space
        return
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY:
        return
    if limit < _MIN_MEMORY:
        raise PriorfillError(
            f"the address space is limited to {limit / 2**20:.0f} MB; priorfill needs at least "
            f"{_MIN_MEMORY / 2**20:.0f} MB: raise the limit (ulimit -v)"
        )
    os.environ.setdefault(_BLAS_THREADS, "1")
