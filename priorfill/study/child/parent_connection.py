"""A child process's connection to its parent: requests, answers, and the end of both.

The parent writes a request on the child's stdin and keeps it open; another request may follow once
the first is answered. When stdin ends, the parent has ended or wants the child to end.
"""

from __future__ import annotations

import faulthandler
import json
import os
import queue
import select
import signal
import sys
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, BinaryIO

import psutil

from priorfill.errors import OptionError

__all__ = ["ANSWER", "ParentConnection"]

ANSWER = b"priorfill-answer "
"""Precedes an answer, so that what libraries print is not taken for one."""

CLEANUP_SECONDS = 1.0
"""Time for removing what is unfinished (s), after which the child ends in any case."""

POLL_SECONDS = 0.5
"""Time between two looks at the parent (s)."""

GRACE_SECONDS = 10.0
"""Time after its limit at which a child ends that nobody has ended (s)."""

PIECE_BYTES = 1 << 16
"""Bytes read at a time."""

_STDIN, _STDOUT, _STDERR = 0, 1, 2


class ParentConnection:
    """The child's side of a connection.

    Attributes
    ----------
    request : mapping of str to object
        What the parent asks for first, as JSON values.
    """

    request: Mapping[str, Any]

    def __init__(self) -> None:
        """Read the first request, and keep stdin and stdout from everybody else.

        Raises
        ------
        OptionError
            Where stdin holds no request: a user runs the command.
        """
        self._parent = os.getppid()
        self._requests: queue.SimpleQueue[Mapping[str, Any] | None] = queue.SimpleQueue()
        self._waits = False
        # on Windows, a pending read of stdin would block whatever else asks for its kind
        requests = os.dup(_STDIN)
        nothing = os.open(os.devnull, os.O_RDONLY)
        os.dup2(nothing, _STDIN)
        os.close(nothing)
        self._answers = os.fdopen(os.dup(_STDOUT), "wb")
        os.dup2(_STDERR, _STDOUT)
        pipe = os.fdopen(requests, "rb", buffering=0)
        try:
            self.request = json.loads(_read_line(pipe))
        except ValueError:
            raise OptionError(
                "there is no job on stdin; `priorfill batch` runs this command by itself"
            ) from None
        signal.signal(signal.SIGINT, signal.default_int_handler)
        threading.Thread(target=self._watch, args=(pipe,), daemon=True).start()

    def answer(self, values: Mapping[str, Any]) -> None:
        """Send values to the parent.

        Parameters
        ----------
        values : mapping of str to object
            JSON values.
        """
        text = json.dumps(values)
        self._answers.write(b"\n" + ANSWER + text.encode("ascii") + b"\n")
        self._answers.flush()

    def next_request(self) -> Mapping[str, Any] | None:
        """Wait for another request.

        Returns
        -------
        mapping of str to object or None
            JSON values; None when the parent asks for nothing more.
        """
        faulthandler.cancel_dump_traceback_later()
        self._waits = True
        request = self._requests.get()
        self._waits = False
        return request

    def end_at(self, seconds: float) -> None:
        """Let this process end itself after some time, even if it is caught in a compiled loop.

        Parameters
        ----------
        seconds : float
            The time limit (s), at which the parent is expected to end this process.
        """
        faulthandler.dump_traceback_later(seconds + GRACE_SECONDS, exit=True, file=_STDERR)

    def _watch(self, pipe: BinaryIO) -> None:
        """Read further requests; end this process when stdin ends or the parent is another one."""
        begun = b""
        while piece := self._read(pipe):
            *lines, begun = (begun + piece).split(b"\n")
            for line in lines:
                self._requests.put(json.loads(line))
        if self._waits:
            self._requests.put(None)
            return
        with suppress(psutil.Error):
            for process in psutil.Process().children(recursive=True):
                process.kill()
        _interrupt()  # writers remove their temporary files
        time.sleep(CLEANUP_SECONDS)
        os._exit(1)

    def _read(self, pipe: BinaryIO) -> bytes:
        """Wait for bytes from the parent; none when stdin has ended or the parent is another."""
        if sys.platform == "win32":  # where only sockets can be waited for
            return pipe.read(PIECE_BYTES)
        while os.getppid() == self._parent:  # its stdin may be open in processes that it forked
            ready, _, _ = select.select([pipe], [], [], POLL_SECONDS)
            if ready:
                return pipe.read(PIECE_BYTES)
        return b""


def _interrupt() -> None:
    """Interrupt the main thread as Ctrl-C would, also while it waits."""
    if sys.platform == "win32":
        signal.raise_signal(signal.SIGINT)  # wakes the main thread there
    else:
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)


def _read_line(pipe: BinaryIO) -> bytes:
    """Read the first request: a line, after which the parent writes nothing until the answer."""
    line = b""
    while not line.endswith(b"\n") and (piece := pipe.read(PIECE_BYTES)):
        line += piece
    return line
