"""Signals that end the program, and output streams that are closed or full."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

__all__ = ["TerminatedError", "end_on_signals", "finish_stdout", "open_closed_streams"]

_SIGNALS = ("SIGTERM", "SIGHUP", "SIGBREAK")
"""Requests to end: by the system or a scheduler, by a terminal that closes, by Windows."""

_EXIT_SIGNAL = 128
"""Exit status of a program ended by signal 0, as shells count."""


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
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115, PTH123


def finish_stdout() -> None:
    """Flush stdout; if it has been closed or is full, send what is left nowhere.

    Otherwise Python would try, and fail, once more at its end.
    """
    try:
        sys.stdout.flush()
    except OSError:
        with suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
