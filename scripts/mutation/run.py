"""Copies of the checkout in which ``scripts/mutation_sample.py`` plants faults and runs tests."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import psutil

from mutation.reach import Readers, Record, expected, recordings
from mutation.sites import Site

SCRIPTS = Path(__file__).resolve().parents[1]
LEFT_OUT = (".git", ".venv", "*.whl", "*.nbi", "*.nbc", "build", "dist", ".*_cache", ".hypothesis")
MEMORY = 16 * 2**30
"""Address space that tests may use, bytes: a fault can allocate any amount. Linux only: no other
system limits it for all processes of the tests."""

MAX_EXIT_STATUS = 255
"""Larger ones are exceptions of Windows, such as 0xc0000005."""

SLOWER = 3.0
"""Allowed ratio of a duration to the recorded one."""

FIRST_BATCH, BATCH_GROWTH = 15.0, 6.0
"""Recorded duration of the first batch of tests, s, and the ratio of a batch to the one before it.
Collecting all test files takes longer than running the tests that catch most faults."""

RECOMPILE = b"\n# compiled again\n"
"""Appended comment; changes the file, but not its code."""

CAUGHT, HUNG, SURVIVED = "caught", "timeout", "survived"


@dataclass(frozen=True)
class Outcome:
    """The outcome of a fault.

    Attributes
    ----------
    site : Site
        The fault.
    result : str
        `CAUGHT`, `HUNG` or `SURVIVED`.
    test : str
        Node id of the first test that failed; empty for a survivor.
    reached, selected : int
        Number of tests that reach the fault, and of those among them that were to be run.
    seconds : float
        Duration.
    """

    site: Site
    result: str
    test: str
    reached: int
    selected: int
    seconds: float


class Workspace:
    """A private copy of the checkout, with its own temporary files and compiled code."""

    def __init__(self, root: Path, folder: Path) -> None:
        self.root = root
        self.copy, self.scratch = folder / "copy", folder / "scratch"
        self.compiled = folder / "compiled"
        shutil.copytree(
            root, self.copy, ignore=shutil.ignore_patterns(*LEFT_OUT), symlinks=True
        )  # keeps modification times, so cached bytecode stays valid
        self.scratch.mkdir()
        self.process: subprocess.Popen[bytes] | None = None

    def run(
        self, arguments: list[str], environment: dict[str, str], seconds: float
    ) -> subprocess.CompletedProcess[str]:
        """Run pytest in the copy; its process group is killed at the timeout."""
        temporary = self.scratch / "tmp"
        shutil.rmtree(temporary, ignore_errors=True)
        temporary.mkdir()
        # fmt: off
        line = [
            sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "mutation.plugin",
            "--rootdir", str(self.copy), "--basetemp", str(temporary / "pytest"),
            "--hypothesis-profile=ci",  # the same examples each time, and no deadlines
            *arguments,
        ]
        # fmt: on
        output = self.scratch / "output"
        with output.open("wb") as stream:
            self.process = subprocess.Popen(
                line,
                cwd=self.copy,
                env=self._environment() | environment,
                stdout=stream,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # on Windows without effect, see _left_by
            )
        try:
            _limit_memory(self.process.pid)
            code = self.process.wait(timeout=seconds)
        finally:
            self.kill()
        text = output.read_text(encoding="utf-8", errors="replace")
        return subprocess.CompletedProcess(line, code, text)

    def kill(self) -> None:
        """Kill the tests, if they still run, and all processes that they have left."""
        if self.process is None:
            return
        if sys.platform == "win32":
            for process in (*_left_by(self.process.pid), self.process):
                with suppress(psutil.Error, OSError):
                    process.kill()
        else:
            with suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()

    def _environment(self) -> dict[str, str]:
        single = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "PRIORFILL_THREADS")
        # this may itself run in a test that is recorded
        outer = {name: v for name, v in os.environ.items() if not name.startswith("MUTATION_")}
        return {
            **outer,
            "PRIORFILL_DATA": str(recordings(self.root)),
            **dict.fromkeys(single, "1"),
            "PYTHONPATH": os.pathsep.join((str(self.copy), str(SCRIPTS))),
            "NUMBA_CACHE_DIR": str(self.compiled),
            **dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(self.scratch / "tmp")),
        }

    @contextmanager
    def fault(self, site: Site, recompiled: list[str]) -> Iterator[dict[str, str]]:
        """Plant a fault, and provide the environment variables to run it with.

        Neither Python nor numba may load cached code of another fault. Python writes no bytecode.
        numba gets a separate cache. It checks only the file of the compiled function itself, so
        a comment is appended to all other files that compile code of the mutated module.
        """
        environment = {"PYTHONDONTWRITEBYTECODE": "1"}
        if recompiled:
            once = self.scratch / "compiled"
            shutil.rmtree(once, ignore_errors=True)
            if self.compiled.exists():
                shutil.copytree(self.compiled, once)
            environment["NUMBA_CACHE_DIR"] = str(once)
        files = [self.copy / path for path in {site.path, *recompiled}]
        before = [(file.read_bytes(), file.stat()) for file in files]
        try:
            for file, (content, _) in zip(files, before, strict=True):
                planted = file == self.copy / site.path
                file.write_bytes(site.plant(content) if planted else content + RECOMPILE)
            yield environment
        finally:
            for file, (content, old) in zip(files, before, strict=True):
                file.write_bytes(content)
                os.utime(file, ns=(old.st_atime_ns, old.st_mtime_ns))


def _limit_memory(process: int) -> None:
    """Limit the address space of a process, and of those that it will start."""
    if hasattr(psutil.Process, "rlimit"):
        with suppress(psutil.NoSuchProcess):  # it has ended
            psutil.Process(process).rlimit(psutil.RLIMIT_AS, (MEMORY, MEMORY))


def _left_by(process: int) -> list[psutil.Process]:
    """Return the processes that one has started, and those that they have, on Windows.

    Windows has no groups of processes that outlive the first. The number of a process is not used
    again while somebody holds it, as `subprocess` does.
    """
    found, parents = [], {process}
    everything = list(psutil.process_iter(["ppid", "create_time"]))
    for one in sorted(everything, key=lambda one: float(one.info["create_time"] or 0)):
        if one.info["ppid"] in parents and one.pid not in parents:
            parents.add(one.pid)
            found.append(one)
    return found


def within(
    limit: float, reaching: list[tuple[Record, list[int]]]
) -> list[tuple[Record, list[int]]]:
    """Return the first test files that take a limited time (s), at least one."""
    selected: list[tuple[Record, list[int]]] = []
    total = 0.0
    for item in reaching:
        total += expected(*item)
        if selected and total > limit:
            break
        selected.append(item)
    return selected


def batches(selected: list[tuple[Record, list[int]]]) -> Iterator[list[tuple[Record, list[int]]]]:
    """Split test files into batches of growing duration."""
    limit, part = FIRST_BATCH, []
    for item in selected:
        part.append(item)
        if sum(expected(*one) for one in part) > limit:
            yield part
            limit, part = limit * BATCH_GROWTH, []
    if part:
        yield part


def run_batch(
    workspace: Workspace,
    part: list[tuple[Record, list[int]]],
    environment: dict[str, str],
    timeout: float,
) -> str | None:
    """Run some tests until one fails and return its node id; None if all pass."""
    order, failure = workspace.scratch / "order.json", workspace.scratch / "failure"
    failure.unlink(missing_ok=True)
    nodes = [record.tests[test] for record, tests in part for test in tests]
    order.write_text(json.dumps({"tests": nodes, "failure": str(failure)}), encoding="utf-8")
    seconds = timeout + SLOWER * sum(expected(*item) for item in part)
    files = [record.file for record, _ in part]
    done = workspace.run(["-x", *files], environment | {"MUTATION_ORDER": str(order)}, seconds)
    if done.returncode == 0:
        return None
    if failure.exists():
        return failure.read_text(encoding="utf-8")
    if done.returncode < 0:
        return f"killed by signal {-done.returncode}"
    if done.returncode > MAX_EXIT_STATUS:
        return f"crashed with {done.returncode:#x}"
    if done.returncode in (2, 4):
        return "an import that all tests share"
    raise RuntimeError(f"pytest ended with {done.returncode}:\n{done.stdout[-2000:]}")


def run_fault(
    workspace: Workspace,
    site: Site,
    reaching: list[tuple[Record, list[int]]],
    readers: Readers,
    timeout: float,
    limit: float,
) -> Outcome:
    """Plant a fault and run the tests that reach it until one fails."""
    begin = time.monotonic()
    selected = within(limit, reaching)
    result, test = SURVIVED, ""
    with workspace.fault(site, readers.recompiled(site.path)) as environment:
        for part in batches(selected):
            try:
                failed = run_batch(workspace, part, environment, timeout)
            except subprocess.TimeoutExpired:
                result, test = HUNG, ", ".join(record.file for record, _ in part)
                break
            if failed is not None:
                result, test = CAUGHT, failed
                break
    counts = [sum(len(tests) for _, tests in part) for part in (reaching, selected)]
    return Outcome(site, result, test, counts[0], counts[1], time.monotonic() - begin)
