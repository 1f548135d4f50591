"""Jobs of a study on the workers of Dask.

With `priorfill.study.dask_task` the only module that imports distributed, which the extra
``cluster`` installs.
"""

from __future__ import annotations

import gc
import ipaddress
import logging
import signal
import threading
import uuid
from collections.abc import Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, TypeAlias
from urllib.parse import urlsplit

import priorfill
from priorfill.errors import OptionError, PriorfillError, escaped
from priorfill.study.job import JobLimits, JobOutcome, StudyJob

try:
    from distributed import Client, KilledWorker, LocalCluster, Security, WorkerPlugin
    from distributed.utils import silence_logging_cmgr

    from priorfill.study.dask_task import RunJob, check_worker, run_task, run_with_kept_child
except ImportError as missing:
    raise PriorfillError(
        f'a cluster needs {missing.name}, which is not installed: pip install "priorfill[cluster]"'
    ) from missing

if TYPE_CHECKING:
    from distributed import Future

    _Task: TypeAlias = Future[dict[str, Any]]

__all__ = ["DaskExecutor", "check_address"]


PROTOCOLS = ("tcp", "tls")
"""Protocols of addresses of schedulers."""

CONNECT_SECONDS = 30.0
"""Time to reach a scheduler, also after a connection broke."""

RESULT_SECONDS = 60.0
"""Time to fetch the outcome of a finished job, a few kilobytes."""

ATTEMPTS = 4
"""How often a job is given to the scheduler. It does so by itself when a worker ends; this counts
results that were lost, and jobs whose workers were killed four times."""

LOST = f"its workers ended {ATTEMPTS} times before it was done; see their logs"
"""Reason where workers are killed again and again."""

BROKEN = "the connection to the scheduler broke; see to it, and run the same command again"
"""Reason where the scheduler ended."""

CONNECTED = ("running", "connecting")
"""States of a client that reaches its scheduler, or may reach it again."""

MAX_SENT = 1000
"""Jobs that a scheduler has at the same time: enough for any cluster, and sent in a second."""

INTERRUPTIBLE_SECONDS = 0.5
"""Longest wait without a look at signals: on Windows, Ctrl-C does not end a wait."""

MAX_REASON = 500
"""Characters of a reason."""

LOOPBACK_NAMES = ("localhost", "ip6-localhost")


def check_address(address: str) -> str:
    """Check the address of a scheduler.

    Parameters
    ----------
    address : str
        ``tcp://HOST:PORT`` or ``tls://HOST:PORT``.

    Returns
    -------
    str
        A warning where anybody in the network could run programs on the cluster; else empty.

    Raises
    ------
    OptionError
        Where it is no such address.

    Examples
    --------
    >>> check_address("tls://node7:8786")
    ''
    >>> check_address("tcp://node7:8786")[:44]
    'tcp://node7:8786 is neither encrypted nor pr'
    """
    parts = urlsplit(address)
    try:
        complete = parts.scheme in PROTOCOLS and bool(parts.hostname) and parts.port is not None
    except ValueError:  # the port is no number
        complete = False
    if not complete or parts.path or parts.query:
        raise OptionError(
            f"`scheduler` {address} is no address of a scheduler: give tls://HOST:PORT or "
            "tcp://HOST:PORT, as `dask scheduler` prints it"
        )
    if parts.scheme == "tls" or _is_loopback(parts.hostname or ""):
        return ""
    return (
        f"{address} is neither encrypted nor protected: whoever reaches it can run programs as the "
        "user of its workers; use tls:// or a scheduler on 127.0.0.1"
    )


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() in LOOPBACK_NAMES


class DaskExecutor:
    """Runs jobs on workers of Dask (`priorfill.study.local_executor.StudyExecutor`).

    A context manager, which connects once there are jobs. Each is a child process of a worker
    (`priorfill.study.dask_task`). A worker that is killed costs nothing but time: the scheduler
    gives its jobs to others, and jobs whose outcome was lost are sent again.

    Parameters
    ----------
    limits : JobLimits
        What a job may use. With a `scheduler`, workers have limits of their own: the number of
        threads, and the memory where that of `limits` is 0.
    folder : Path or str
        Folder of the filled files, which all workers must see.
    scheduler : str, optional
        Address of a scheduler (`check_address`); without it, workers are started on this computer,
        which nobody else can reach.
    workers : int
        Number of workers to start on this computer.
    run : callable
        Fills the file of a job in a child process.

    See Also
    --------
    priorfill.study.dask_task.run_with_kept_child : What a worker does with a job.
    """

    def __init__(
        self,
        limits: JobLimits,
        folder: Path | str,
        *,
        scheduler: str | None = None,
        workers: int = 1,
        run: RunJob = run_with_kept_child,
    ) -> None:
        self._limits, self._run = limits, run
        self._folder, self._scheduler, self._workers = str(folder), scheduler, workers
        self._client: Client | None = None
        self._open = ExitStack()

    def __enter__(self) -> DaskExecutor:
        return self

    def __exit__(self, *error: object) -> None:
        self._open.close()

    def run(self, jobs: Sequence[StudyJob]) -> Generator[JobOutcome, None, None]:
        """Yield outcomes as jobs are finished; closing the iterator stops those that run.

        Raises
        ------
        PriorfillError
            Where the scheduler does not answer, or a worker has another version of priorfill or
            does not see the folder.
        """
        if not jobs:
            return
        if self._client is None:
            self._client = self._connect()
        sent = _SentJobs(self._client, self._limits, self._run, self._scheduler is not None)
        waiting = iter(jobs)
        running = 0
        try:
            while True:
                for job in islice(waiting, MAX_SENT - running):
                    sent.send(job)
                    running += 1
                if not running:
                    return
                with suppress(Empty):
                    outcome = sent.finished.get(timeout=INTERRUPTIBLE_SECONDS)
                    running -= 1
                    yield outcome
        finally:
            sent.stop()

    def _connect(self) -> Client:
        with ExitStack() as opened:
            opened.enter_context(silence_logging_cmgr(logging.CRITICAL))
            if self._scheduler is None:
                client = opened.enter_context(_workers_here(self._workers))
            else:
                client = opened.enter_context(_connected(self._scheduler))
            question = (check_worker, priorfill.__version__, self._folder)
            for address, answer in client.run(*question, on_error="return").items():
                if answer:
                    raise PriorfillError(f"{address}: {_why(answer)}")
            self._open = opened.pop_all()
        return client


class _SentJobs:
    """Jobs that a scheduler has, and outcomes of those that are finished."""

    def __init__(
        self, client: Client, limits: JobLimits, run: RunJob, limits_of_workers: bool
    ) -> None:
        self._client = client
        self._task = (asdict(limits), priorfill.__version__, run, limits_of_workers)
        self._lock = threading.Lock()
        self._sent: dict[str, _Task] = {}
        self._stopped = False
        self.finished: SimpleQueue[JobOutcome] = SimpleQueue()

    def send(self, job: StudyJob, attempt: int = 1) -> None:
        """Give a job to the scheduler."""
        # a key of its own: what the scheduler knows of another attempt does not count
        key = f"priorfill-{uuid.uuid4().hex}"
        with self._lock:
            if self._stopped:
                return
            try:
                task = self._client.submit(run_task, job.to_json(), *self._task, key=key)
            except Exception:  # of several kinds: the client gave up the scheduler
                self.finished.put(_failure(job, BROKEN))
                return
            self._sent[key] = task
        task.add_done_callback(lambda done: self._settle(job, attempt, done))

    def stop(self) -> None:
        """Stop the jobs that run, and start no others."""
        with self._lock:
            self._stopped = True
            tasks = list(self._sent.values())
            self._sent.clear()
        if tasks and self._client.status == "running":
            self._client.cancel(tasks, force=True)

    def _settle(self, job: StudyJob, attempt: int, done: _Task) -> None:
        """Pass on the outcome of a task, or send its job again."""
        with self._lock:
            if self._sent.pop(str(done.key), None) is None:  # stopped
                return
        outcome = _outcome(job, done)
        if outcome is None and attempt < ATTEMPTS and self._client.status in CONNECTED:
            self.send(job, attempt + 1)
        else:
            connected = self._client.status in CONNECTED
            self.finished.put(outcome or _failure(job, LOST if connected else BROKEN))


def _outcome(job: StudyJob, done: _Task) -> JobOutcome | None:
    """Return the outcome of a task that ended; None where it was lost with its workers."""
    try:
        if done.status == "finished":
            return JobOutcome.from_json(done.result(timeout=RESULT_SECONDS))
        if done.status == "error":
            error = done.exception(timeout=RESULT_SECONDS)
            return (
                None
                if isinstance(error, KilledWorker)
                else _failure(job, f"a worker failed: {_why(error)}")
            )
    except Exception:  # the worker that kept the result ended, or the scheduler
        return None
    return None  # cancelled by a scheduler that ended, or lost


def _failure(job: StudyJob, reason: str) -> JobOutcome:
    """Return the outcome of a job that may succeed once the cluster works."""
    return JobOutcome.of_failure(job, reason, try_again=True)


def _why(error: object) -> str:
    text = str(error)
    if isinstance(error, BaseException) and not isinstance(error, PriorfillError):
        text = f"{type(error).__name__}: {text}"
    return escaped(" ".join(text.split()))[:MAX_REASON]


@contextmanager
def _workers_here(count: int) -> Iterator[Client]:
    """Start workers on this computer, and connect to them.

    They listen on 127.0.0.1, with certificates of their own, because other users of the same
    computer reach that address as well. They have no limit on memory: their children have.
    """
    with ExitStack() as opened:
        try:
            cluster = LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                dashboard_address=None,
                # it answers requests for its state anyway: at a free port, since another study
                # may run here, and a port that is taken is warned of
                scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
                memory_limit=0,
                security=Security.temporary(),
                silence_logs=logging.CRITICAL,
            )
            opened.enter_context(cluster)
            client = opened.enter_context(Client(cluster, set_as_default=False))
            client.register_plugin(_IgnoreInterrupts())
        except (OSError, RuntimeError) as error:  # RuntimeError: one was killed as it started
            raise PriorfillError(
                f"workers of Dask cannot be started on this computer ({_why(error)}); run the "
                "same command again, or without `cluster`; a script starts them below "
                "if __name__ == '__main__'"
            ) from error
        yield client


class _IgnoreInterrupts(WorkerPlugin):
    """Leaves Ctrl-C, which reaches all processes of a terminal, to the process that waits."""

    def setup(self, worker: object) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def _connected(address: str) -> Iterator[Client]:
    check_address(address)
    failure = None
    try:
        client = Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except Exception as error:  # of any kind, depending on what answers at the address
        failure = _why(error)
    if failure is not None:
        gc.collect()  # a client without connection would delay the end of the program by a minute
        raise PriorfillError(
            f"the scheduler at {address} cannot be reached ({failure}); check the address, the "
            "certificates (docs/cluster.md), and that it runs"
        )
    with client:
        yield client
