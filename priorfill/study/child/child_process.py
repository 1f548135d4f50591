"""A child process that runs a hidden command of priorfill, within limits of time and memory."""

from __future__ import annotations

import json
import os
import queue
import signal
import site
import subprocess
import sys
import sysconfig
import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import psutil

from priorfill.errors import PriorfillError, escaped
from priorfill.runtime.threads import VARIABLE
from priorfill.study.child.parent_connection import ANSWER, CLEANUP_SECONDS
from priorfill.study.job import JobLimits, memory_reason

__all__ = ["ChildError", "ChildProcess", "child_command", "child_environment"]

POLL_SECONDS = 0.1
"""Time between two looks at a child (s): a program fills some hundred megabytes meanwhile."""

SEARCH_SECONDS = 1.0
"""Time between two searches for processes that a child has started (s); a search reads the list
of all processes."""

PIPE_SECONDS = 2.0
"""Time for what is left in the pipes of a child that has ended (s); a process that it has left
behind may hold them open."""

MAX_ANSWER = 1 << 28
"""Maximum length of an answer (bytes). That of a recording with 10,000 gaps has 5 MB."""

TAIL_LINES, TAIL_LINE = 20, 500
"""Lines of stderr that are kept, and bytes of each."""

ONE_THREAD = (
    *("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"),
)
"""Variables of BLAS libraries: a fill uses one thread of theirs, and each takes memory."""

FAULTS = {"SIGSEGV", "SIGABRT", "SIGFPE", "SIGILL"}
"""Signals by which a program ends itself: the same file would end it again."""

_WINDOWS_FAULT = 0xC0000000
"""Exit statuses of Windows from here on are faults, such as an access violation."""


class ChildError(PriorfillError):
    """A child process ended without an answer.

    Attributes
    ----------
    try_again : bool
        Whether the same request may succeed later.
    exceeded : str
        The limit that it exceeded, ``seconds`` or ``memory``; else empty.
    stopped : bool
        Whether it ended because it was asked to.
    """

    def __init__(
        self,
        message: str,
        *,
        try_again: bool = True,
        exceeded: str = "",
        stopped: bool = False,
    ) -> None:
        super().__init__(message)
        self.try_again = try_again
        self.exceeded = exceeded
        self.stopped = stopped


class ChildProcess:
    """A child process that answers requests, one after the other.

    Parameters
    ----------
    command : sequence of str
        The program and its arguments.
    request : mapping of str to object
        What it is asked for first, as JSON values.
    limits : JobLimits
        What it may use. The time is that of one answer.

    Attributes
    ----------
    peak_memory : int
        Largest memory (bytes) that was seen since the last request.
    """

    peak_memory: int

    def __init__(
        self, command: Sequence[str], request: Mapping[str, Any], limits: JobLimits
    ) -> None:
        self.peak_memory = 0
        self._lines: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._tail: deque[bytes] = deque(maxlen=TAIL_LINES)
        self._seen: dict[int, psutil.Process] = {}
        self._next_search = 0.0
        self._process = subprocess.Popen(
            list(command),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=child_environment(limits.threads),
            **_own_group(),
        )
        streams = self._process.stdout, self._process.stderr
        assert streams[0] is not None and streams[1] is not None
        self._readers = [
            threading.Thread(target=self._read_answers, args=(streams[0],), daemon=True),
            threading.Thread(target=self._read_stderr, args=(streams[1],), daemon=True),
        ]
        for reader in self._readers:
            reader.start()
        self.ask(request, limits)

    def ask(self, request: Mapping[str, Any], limits: JobLimits) -> None:
        """Send a request; the one before must be answered.

        Parameters
        ----------
        request : mapping of str to object
            JSON values.
        limits : JobLimits
            What the child may use from here on.
        """
        self.peak_memory = 0
        self._limits = limits
        self._tail.clear()
        assert self._process.stdin is not None
        with suppress(OSError):  # it has ended; the first answer shows why
            self._process.stdin.write(json.dumps(request).encode("ascii") + b"\n")
            self._process.stdin.flush()

    @property
    def has_ended(self) -> bool:
        """Whether it has ended."""
        return self._process.poll() is not None

    @property
    def memory(self) -> int:
        """Memory (bytes) that it has to itself."""
        return self._memory()

    def answer(self, stop: threading.Event | None = None) -> dict[str, Any]:
        """Wait for the next answer.

        Parameters
        ----------
        stop : threading.Event, optional
            Ends the child when it is set.

        Returns
        -------
        dict
            JSON values.

        Raises
        ------
        ChildError
            Where the child ends without an answer, exceeds a limit, or is stopped. It has ended
            then, and what it started as well.
        """
        begin = time.monotonic()
        while True:
            with suppress(queue.Empty):
                return _decoded(self._lines.get(timeout=POLL_SECONDS))
            if stop is not None and stop.is_set():
                self.close()
                raise ChildError("was stopped before it was done", stopped=True)
            if self._process.poll() is not None:
                return self._last_answer()
            self._check_limits(time.monotonic() - begin)

    def close(self) -> None:
        """End the child, and what it has started; it may remove its temporary files."""
        assert self._process.stdin is not None
        with suppress(OSError):
            self._process.stdin.close()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(2.0 * CLEANUP_SECONDS)
        self._kill()

    def _check_limits(self, seconds: float) -> None:
        """Raise ChildError if the child takes too long, or too much memory."""
        limits = self._limits
        memory = self._memory()
        self.peak_memory = max(self.peak_memory, memory)
        if memory > limits.memory:
            self._kill()
            raise ChildError(memory_reason(limits), exceeded="memory")
        if seconds > limits.seconds:
            self._kill()
            raise ChildError(
                f"was not done after {limits.seconds:.0f} s, and was ended; raise the limit "
                "(`time_limit`) if the recording is that long",
                exceeded="seconds",
            )

    def _memory(self) -> int:
        """Return the memory (bytes) of the child and of what it has started."""
        now = time.monotonic()
        if now >= self._next_search:
            self._next_search = now + SEARCH_SECONDS
            self._find_tree()
        return sum(private_memory(process) for process in self._seen.values())

    def _find_tree(self) -> None:
        """Find the processes that the child has started."""
        with suppress(psutil.Error):
            child = self._seen.get(self._process.pid) or psutil.Process(self._process.pid)
            for process in (child, *child.children(recursive=True)):
                self._seen.setdefault(process.pid, process)

    def _kill(self) -> None:
        """End the child and what it has started at once."""
        if self._process.poll() is None:
            self._find_tree()
        if sys.platform != "win32":
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, signal.SIGKILL)
        for process in self._seen.values():
            with suppress(psutil.Error):  # psutil knows a process by its start, too
                process.kill()
        self._process.wait()
        self._finish_pipes()

    def _finish_pipes(self) -> None:
        """Read what is left in the pipes, and close them."""
        for reader in self._readers:
            reader.join(PIPE_SECONDS)
        for stream in (self._process.stdin, self._process.stdout, self._process.stderr):
            reading = stream is not None and any(reader.is_alive() for reader in self._readers)
            if stream is not None and not reading:
                with suppress(OSError):
                    stream.close()

    def _last_answer(self) -> dict[str, Any]:
        """Return the answer of a child that has ended; raise ChildError if there is none."""
        self._kill()
        with suppress(queue.Empty):
            return _decoded(self._lines.get_nowait())
        raise self._ended()

    def _ended(self) -> ChildError:
        """Return how the child ended without an answer."""
        status = self._process.returncode
        last = self._last_line()
        said = f"; its last output: {last}" if last else ""
        if status < 0:
            name = _signal_name(-status)
            if name in FAULTS:
                return ChildError(
                    f"ended the program ({name}); please report it with the file{said}",
                    try_again=False,
                )
            return ChildError(
                f"its process was killed ({name}), possibly for lack of memory; run the command "
                f"again, with fewer `workers` if it happens often{said}"
            )
        if status >= _WINDOWS_FAULT:
            return ChildError(
                f"ended the program (fault 0x{status:08X}); please report it with the file{said}",
                try_again=False,
            )
        return ChildError(
            f"its process ended with exit status {status} and without an outcome; run the command "
            f"again{said}"
        )

    def _last_line(self) -> str:
        """Return the last line of stderr."""
        lines = [line.strip() for line in self._tail]
        last = next((line for line in reversed(lines) if line), b"")
        return escaped(last.decode("utf-8", "backslashreplace"))

    def _read_answers(self, pipe: IO[bytes]) -> None:
        """Read answers from stdout; other lines are ignored."""
        with suppress(OSError, ValueError):
            while line := pipe.readline(MAX_ANSWER):
                if line.startswith(ANSWER) and line.endswith(b"\n"):
                    self._lines.put(line.removeprefix(ANSWER))

    def _read_stderr(self, pipe: IO[bytes]) -> None:
        """Read stderr and keep its last lines."""
        with suppress(OSError, ValueError):
            while line := pipe.readline(TAIL_LINE):
                self._tail.append(line)


def private_memory(process: psutil.Process) -> int:
    """Return the memory (bytes) that a process has to itself; 0 if it has ended.

    What it has reserved and not used does not count; on Linux, pages of files that it has mapped
    do not either, which the system takes back where needed.

    Parameters
    ----------
    process : psutil.Process
        The process.
    """
    try:
        memory = process.memory_info()
    except psutil.Error:
        return 0
    return int(memory.rss) - int(getattr(memory, "shared", 0))


def child_command(name: str) -> list[str]:
    """Return the command line of a hidden command of this priorfill.

    Parameters
    ----------
    name : str
        The command.
    """
    utf8 = f"utf8={sys.flags.utf8_mode}"  # names of files must be decoded alike
    # -P: a file in the current folder must not take the place of a module
    user_site = ["-s"] if sys.flags.no_user_site else []
    return [sys.executable, "-P", *user_site, "-X", utf8, "-m", "priorfill", name]


def child_environment(threads: int) -> dict[str, str]:
    """Return the environment of a child: modules are found as here, and threads are limited.

    Parameters
    ----------
    threads : int
        Number of threads.
    """
    environment = dict(os.environ)
    if sys.flags.ignore_environment:
        environment = {k: v for k, v in environment.items() if not k.startswith("PYTHON")}
    environment["PYTHONPATH"] = os.pathsep.join(_own_path())
    environment |= dict.fromkeys(ONE_THREAD, "1")
    return environment | dict.fromkeys((VARIABLE, "NUMBA_NUM_THREADS"), str(threads))


def _own_path() -> list[str]:
    """Return the folders that modules are found in here, without those of every Python."""
    places = [*sysconfig.get_paths().values(), *site.getsitepackages(), site.getusersitepackages()]
    every = {os.path.realpath(place) for place in places}
    every |= {os.path.realpath(Path(sysconfig.get_path("stdlib"), "lib-dynload"))}
    given = "" if sys.flags.ignore_environment else os.environ.get("PYTHONPATH", "")
    found = [*sys.path, str(Path(__file__).parents[3]), *filter(None, given.split(os.pathsep))]
    found = [os.path.abspath(place) for place in found]  # noqa: PTH100 - "" is the current one
    own = [place for place in found if os.path.realpath(place) not in every]
    return list(dict.fromkeys(place for place in own if Path(place).exists()))


def _own_group() -> dict[str, Any]:
    """Return how a child is started so that Ctrl-C reaches its parent only."""
    if sys.platform == "win32":
        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.CREATE_NO_WINDOW}
    return {"process_group": 0}


def _decoded(line: bytes) -> dict[str, Any]:
    values = json.loads(line)
    assert isinstance(values, dict)
    return values


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
