"""Processes that are disturbed, and how they start fast."""

from __future__ import annotations

import gc
import io
import json
import os
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from functools import partial
from pathlib import Path
from typing import Any

from torture.children import READY, SCRIPT, execute, rehearse
from torture.clips import WrongError, is_unfinished

TIMEOUT = 120.0
"""Seconds after which a disturbed process counts as hung."""

AHEAD = 1
"""Number of workers that import their modules while another one works."""

HAS_FORK = hasattr(os, "fork")


class Run:
    """A process whose output is collected while it runs.

    Parameters
    ----------
    process : Popen or Fork
        The process, just started.
    """

    def __init__(self, process: Any) -> None:
        self.began = time.monotonic()
        self._process = process
        self._output = b""
        self._errors = b""
        self._changed = threading.Condition()
        self._readers = [
            threading.Thread(target=self._read, args=(self._process.stdout, "_output")),
            threading.Thread(target=self._read, args=(self._process.stderr, "_errors")),
        ]
        for reader in self._readers:
            reader.start()

    def _read(self, pipe: Any, name: str) -> None:
        while data := os.read(pipe.fileno(), 65536):
            with self._changed:
                setattr(self, name, getattr(self, name) + data)
                self._changed.notify()

    @property
    def lines(self) -> list[str]:
        """Complete lines of its output so far."""
        return self._output.decode().replace("\r", "").split("\n")[:-1]

    @property
    def errors(self) -> str:
        """Its output on stderr."""
        return self._errors.decode().replace("\r", "").strip()

    @property
    def runs(self) -> bool:
        """Whether it is still running."""
        return self._process.poll() is None

    def wait_for_lines(self, count: int, word: str = "") -> None:
        """Wait for a number of lines that begin with a word, or for its end."""

        def enough() -> bool:
            there = sum(line.startswith(word) for line in self.lines)
            return there >= count or not self.runs

        with self._changed:
            while not self._changed.wait_for(enough, 1.0) and self.seconds < TIMEOUT:
                pass

    def wait_for_unfinished(self, folder: Path) -> None:
        """Wait until the database has an unfinished file, or for its end."""
        end = self.began + TIMEOUT
        while self.runs and time.monotonic() < end:
            if is_unfinished(folder):
                return

    def end(self, *, kill: int = 0) -> int:
        """Send a signal, unless it is 0; wait for the end, and return the exit status."""
        if kill:
            with suppress(PermissionError):  # on Windows, if it is just ending
                self._process.send_signal(kill)
        try:
            status = self._process.wait(TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            raise WrongError(f"hangs; {self.errors[-300:]}") from None
        finally:
            for reader in self._readers:
                reader.join()
            for pipe in (self._process.stdout, self._process.stderr):
                assert pipe is not None
                pipe.close()
        return int(status)

    def sleep(self, seconds: float) -> None:
        """Wait for a time, or for its end."""
        end = time.monotonic() + seconds
        while self.runs and (left := end - time.monotonic()) > 0:
            time.sleep(min(left, 0.005))

    @property
    def seconds(self) -> float:
        """Time since its start (s)."""
        return time.monotonic() - self.began


class Inline:
    """The same interface for arguments that are executed in this process, to their end.

    Parameters
    ----------
    arguments : sequence of str
        As `execute` takes them.
    """

    def __init__(self, arguments: Sequence[str]) -> None:
        began = time.monotonic()
        texts = [io.TextIOWrapper(io.BytesIO(), encoding="utf-8") for _ in range(2)]
        with redirect_stdout(texts[0]), redirect_stderr(texts[1]):
            self._status = execute(arguments)
        for text in texts:
            text.seek(0)
        self.lines = texts[0].read().splitlines()
        self.errors = texts[1].read().strip()
        gc.collect()  # arrays of a failed command would keep files mapped
        self.seconds = time.monotonic() - began

    def wait_for_lines(self, count: int, word: str = "") -> None:
        """Return: all lines are there."""

    def end(self) -> int:
        """Return the exit status."""
        return self._status


class Processes:
    """Starts processes; a context manager that ends those which wait.

    Where processes can be forked, they are copies of this one; elsewhere they are workers that are
    started ahead, because importing takes longer than what they do.

    Parameters
    ----------
    sample : Path, optional
        A C3D file with which workers try what they will do.
    forks : bool
        Whether to fork.
    """

    def __init__(self, sample: Path | str = "", *, forks: bool = HAS_FORK) -> None:
        self._sample = sample
        self._forks = forks
        self._waiting: deque[Any] = deque()
        self._adds = True
        self._rehearsal = ""

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, *_: object) -> None:
        while self._waiting:
            worker = self._waiting.popleft()
            worker.kill()
            worker.communicate()

    def prepare(self, *, adds: bool) -> None:
        """Choose whether the next processes read and add clips; others start faster."""
        if adds != self._adds:
            self.__exit__()
        self._adds = adds

    def rehearse(self, arguments: Sequence[str]) -> None:
        """Let the next processes execute arguments of priorfill before they are disturbed."""
        self.__exit__()
        self._rehearsal = json.dumps(list(arguments))
        if self._forks:
            rehearse(list(arguments))

    def start(self, arguments: Sequence[str], file_limit: int | None = None) -> Run:
        """Start a process that can be killed.

        Parameters
        ----------
        arguments : sequence of str
            As `execute` takes them.
        file_limit : int, optional
            Maximum bytes of the files it writes; only where processes are forked.
        """
        if self._forks:
            from torture.posix import Fork, limit_file_size

            prepare = (lambda: None) if file_limit is None else partial(limit_file_size, file_limit)
            return Run(Fork(arguments, prepare))
        line = (SCRIPT, "--work", self._sample if self._adds else "", self._rehearsal)
        while len(self._waiting) <= AHEAD:
            self._waiting.append(_popen(*line, stdin=subprocess.PIPE))
        worker = self._waiting.popleft()
        said = b""
        while READY not in said or not said.endswith(b"\n"):
            data = os.read(worker.stdout.fileno(), 100)
            if not data:
                raise SystemExit(f"a worker failed: {worker.stderr.read().decode()}")
            said += data
        worker.stdin.write(json.dumps(list(arguments)).encode() + b"\n")
        worker.stdin.close()
        return Run(worker)

    def start_fresh(self, arguments: Sequence[str]) -> Run:
        """Start a process as a user does, with all its imports, if that takes no longer."""
        if not HAS_FORK:
            return self.start(arguments)
        return Run(_popen(*arguments, stdin=subprocess.DEVNULL))

    def complete(self, arguments: Sequence[str]) -> Run | Inline:
        """Start what nobody kills."""
        return self.start(arguments) if self._forks else Inline(arguments)


def _popen(*arguments: object, stdin: int) -> Any:
    environment = dict(os.environ, PYTHONIOENCODING="utf-8")
    environment.pop("PRIORFILL_DEBUG", None)
    if HAS_FORK:
        environment["PYTHONDONTWRITEBYTECODE"] = "1"
    return subprocess.Popen(
        [sys.executable, *map(str, arguments)],
        stdin=stdin,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        bufsize=0,
        env=environment,
    )
