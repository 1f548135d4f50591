"""What only POSIX systems have: copies of a process, limits on the size of files, small disks."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

from torture.children import execute
from torture.processes import TIMEOUT


def limit_file_size(size: int) -> None:
    """Let writes beyond a size fail with EFBIG (Python ignores SIGXFSZ), in this process."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


class Fork:
    """A copy of this process that runs something else; it starts fast, with everything imported.

    Parameters
    ----------
    arguments : sequence of str
        Python's arguments, as `execute` takes them.
    prepare : callable
        Called in the new process.
    """

    def __init__(self, arguments: Sequence[str], prepare: Callable[[], None]) -> None:
        pipes = [os.pipe(), os.pipe()]
        with warnings.catch_warnings():
            # forking a threaded process can hang a child that takes their locks; none does here
            warnings.simplefilter("ignore", DeprecationWarning)
            self._pid = os.fork()
        if self._pid == 0:
            self._run_child(arguments, prepare, [write for _, write in pipes])
        for _, write in pipes:
            os.close(write)
        self.stdout, self.stderr = (os.fdopen(read, "rb", 0) for read, _ in pipes)
        self._status: int | None = None

    def _run_child(
        self, arguments: Sequence[str], prepare: Callable[[], None], outputs: list[int]
    ) -> None:
        status = 1
        try:
            for number, name in enumerate(("stdout", "stderr"), start=1):
                os.dup2(outputs[number - 1], number)
                setattr(sys, name, open(number, "w", closefd=False))  # noqa: SIM115
            prepare()
            status = execute(arguments)
        finally:
            os._exit(status)

    def poll(self) -> int | None:
        """Return its exit status if it has ended."""
        if self._status is None:
            pid, status = os.waitpid(self._pid, os.WNOHANG)
            if pid:
                self._status = os.waitstatus_to_exitcode(status)
        return self._status

    def kill(self) -> None:
        """Send SIGKILL."""
        self.send_signal(signal.SIGKILL)

    def send_signal(self, number: int) -> None:
        """Send a signal."""
        if self.poll() is None:
            os.kill(self._pid, number)

    def wait(self, timeout: float | None = None) -> int:
        """Wait until it has ended."""
        end = time.monotonic() + (TIMEOUT if timeout is None else timeout)
        while (status := self.poll()) is None:
            if time.monotonic() > end:
                raise subprocess.TimeoutExpired("fork", TIMEOUT)
            time.sleep(0.001)
        return status


class Mount:
    """A small tmpfs, if mounting is allowed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.bytes = 1 << 30
        self._mounted = False

    def why_not(self) -> str:
        """Return why it cannot be mounted; empty if it can."""
        self.folder.mkdir(exist_ok=True)
        try:
            with self:
                return ""
        except (OSError, subprocess.CalledProcessError) as error:
            text = getattr(error, "stderr", None) or str(error)
            return f"cannot mount a tmpfs here: {text.strip()}"

    def __enter__(self) -> Mount:
        self._mount(f"size={self.bytes}")
        self._mounted = True
        return self

    def __exit__(self, *_: object) -> None:
        subprocess.run(["umount", self.folder], check=True)
        self._mounted = False

    def grow(self) -> None:
        """Enlarge it."""
        if self._mounted:
            self._mount("remount,size=1g")

    def _mount(self, options: str) -> None:
        subprocess.run(
            ["mount", "-t", "tmpfs", "-o", options, "priorfill-torture", self.folder],
            check=True,
            capture_output=True,
            text=True,
        )
