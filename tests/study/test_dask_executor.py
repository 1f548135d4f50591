"""Jobs on workers of Dask: killed workers, lost outcomes, interruptions, wrong clusters."""

from __future__ import annotations

import hashlib
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest
from gappy import person, with_gaps

import priorfill as pf
from priorfill.errors import OptionError, PriorfillError
from priorfill.study.job import JobLimits, JobOutcome, StudyJob
from priorfill.study.records import write_record
from priorfill.study.settings import FillSettings

pytest.importorskip("distributed", reason="the extra cluster is not installed")

from distributed import KilledWorker

from priorfill.study import dask_executor
from priorfill.study.child.run_child import run_child
from priorfill.study.dask_executor import DaskExecutor, _SentJobs, check_address
from priorfill.study.dask_task import check_worker

pytestmark = pytest.mark.cluster

LIMITS = JobLimits(seconds=60.0, memory=1 << 30, threads=1)

SECONDS = 60.0
"""Longest wait of a test."""


def a_job(folder: Path, name: str, **settings: Any) -> StudyJob:
    """A job whose source exists."""
    source = folder / f"{name}.c3d"
    source.touch()
    output = folder / "out" / f"{name}.c3d"
    record = folder / "out" / f"{name}.json"
    output.parent.mkdir(exist_ok=True)
    return StudyJob(name, str(source), str(output), str(record), settings, key=name)


def wait_for(ready: Callable[[], Any]) -> Any:
    """Wait until something is there, and return it."""
    end = time.monotonic() + SECONDS
    while not (found := ready()):
        assert time.monotonic() < end
        time.sleep(0.02)
    return found


def runner() -> Callable[..., JobOutcome]:
    """What a worker does for a job in these tests; pickled by value, as it is a local function."""

    def run(job: StudyJob, limits: JobLimits, stop: threading.Event) -> JobOutcome:
        import os
        from pathlib import Path

        from priorfill.study.child.run_child import run_child
        from priorfill.study.job import JobOutcome

        task = job.settings["task"]
        begun = Path(f"{job.record}.begun")
        first = not begun.exists()
        Path(f"{begun}.tmp").write_text(str(os.getpid()))
        Path(f"{begun}.tmp").replace(begun)
        if task == "fill":
            return run_child(replace_settings(job), limits, stop)
        if task == "fail":
            raise ValueError("a fault\nof the task")
        if task == "wait" or (task == "wait once" and first):
            assert stop.wait(60)
            Path(f"{job.record}.stopped").touch()
        return JobOutcome(job.name, job.source, job.output, "filled", key=job.key)

    def replace_settings(job: StudyJob) -> StudyJob:
        from dataclasses import replace

        return replace(job, settings=job.settings["fill"])

    return run


@pytest.fixture(scope="module")
def workers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaskExecutor]:
    """Two workers on this computer."""
    folder = tmp_path_factory.mktemp("study")
    with DaskExecutor(LIMITS, folder, workers=2, run=runner()) as executor:
        yield executor


def worker_of(job: StudyJob) -> psutil.Process:
    """The process that runs a job."""
    begun = Path(f"{job.record}.begun")
    return psutil.Process(int(wait_for(lambda: begun.exists() and begun.read_text())))


def test_a_worker_that_is_killed_half_way_loses_nothing(
    workers: DaskExecutor, tmp_path: Path
) -> None:
    fill = FillSettings("linear").to_json()
    job = a_job(tmp_path, "walk", task="fill", fill=fill)
    gappy = with_gaps(person(seconds=1.0, rate=30.0), (10, 15, ("LKNE",)))
    pf.write(job.source, gappy, overwrite=True)
    others = [a_job(tmp_path, f"other{number}", task="quick") for number in range(4)]
    outcomes = workers.run([job, *others])
    found: list[JobOutcome] = []
    waiting = threading.Thread(target=lambda: found.extend(outcomes))
    waiting.start()
    worker = worker_of(job)
    (child,) = wait_for(worker.children)
    worker.kill()
    waiting.join(SECONDS)
    assert sorted((one.name, one.status) for one in found) == [
        *((other.name, "filled") for other in others),
        ("walk", "filled"),
    ]
    assert worker_of(job) != worker
    wait_for(lambda: not child.is_running() or child.status() == psutil.STATUS_ZOMBIE)
    pf.fill_file(job.source, tmp_path / "alone.c3d", method="linear")
    assert Path(job.output).read_bytes() == (tmp_path / "alone.c3d").read_bytes()
    assert not list(tmp_path.rglob(".priorfill-*"))


def test_a_job_that_is_done_is_not_run_again(workers: DaskExecutor, tmp_path: Path) -> None:
    job = a_job(tmp_path, "a", task="quick")
    Path(job.output).write_bytes(b"filled")
    digest = {job.output: hashlib.sha256(b"filled").hexdigest()}
    done = JobOutcome("a", job.source, job.output, "incomplete", written=digest, key="a")
    write_record(job.record, done)
    (outcome,) = workers.run([job])
    assert outcome == done
    Path(job.output).write_bytes(b"edited")
    (outcome,) = workers.run([job])
    assert outcome.status == "filled"


def test_closing_the_outcomes_stops_jobs(workers: DaskExecutor, tmp_path: Path) -> None:
    jobs = [a_job(tmp_path, f"{number}", task="wait") for number in range(2)]
    quick = a_job(tmp_path, "quick", task="quick")
    outcomes = workers.run([quick, *jobs])
    assert next(outcomes).name == "quick"
    for job in jobs:
        worker_of(job)
    outcomes.close()  # type: ignore[attr-defined]
    for job in jobs:
        wait_for(Path(f"{job.record}.stopped").exists)
    (again,) = workers.run([replace(quick, name="again")])
    assert again.name == "again"


def test_a_fault_of_a_task_is_the_reason_of_its_job(workers: DaskExecutor, tmp_path: Path) -> None:
    (outcome,) = workers.run([a_job(tmp_path, "a", task="fail")])
    assert outcome.reason == "a worker failed: ValueError: a fault of the task"
    assert outcome.try_again


def test_a_worker_that_does_not_see_the_source_says_so(
    workers: DaskExecutor, tmp_path: Path
) -> None:
    job = a_job(tmp_path, "a", task="quick")
    Path(job.source).unlink()
    (outcome,) = workers.run([job])
    assert outcome.reason.startswith(f"the worker does not see {job.source}:")
    assert outcome.try_again


def test_no_worker_starts_without_jobs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask_executor, "LocalCluster", None)
    with DaskExecutor(LIMITS, tmp_path, workers=2) as executor:
        assert list(executor.run([])) == []


def test_workers_that_do_not_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(**_: Any) -> None:
        raise RuntimeError("Nanny failed to start.")

    monkeypatch.setattr(dask_executor, "LocalCluster", fails)
    with (
        DaskExecutor(LIMITS, tmp_path) as executor,
        pytest.raises(PriorfillError, match=r"this computer \(RuntimeError: Nanny failed"),
    ):
        list(executor.run([a_job(tmp_path, "a")]))


def test_workers_need_the_same_version(tmp_path: Path) -> None:
    assert check_worker(pf.__version__, str(tmp_path)) == ""
    assert "the study was planned by 0.0" in check_worker("0.0", str(tmp_path))


class GivenAnswers:
    """A client of a scheduler that answers each task with a status and a value."""

    def __init__(self, *answers: tuple[str, Any]) -> None:
        self.answers = list(answers)
        self.status = "running"
        self.keys: list[str] = []

    def submit(self, *_: Any, key: str) -> Any:
        if self.status == "closed":
            raise RuntimeError("closed")
        self.keys.append(key)
        status, value = self.answers.pop(0)
        if status == "gone":
            self.status, status = "closed", "cancelled"

        def give(timeout: float) -> Any:
            if status == "finished" and isinstance(value, Exception):
                raise value
            return value

        future = SimpleNamespace(key=key, status=status, result=give, exception=give)
        future.add_done_callback = lambda call: call(future)
        return future


def settled(job: StudyJob, *answers: tuple[str, Any]) -> tuple[JobOutcome, int]:
    """The outcome of a job after some answers, and how often it was sent."""
    client: Any = GivenAnswers(*answers)
    sent = _SentJobs(client, LIMITS, run_child, limits_of_workers=False)
    sent.send(job)
    assert len(set(client.keys)) == len(client.keys)  # no attempt is taken for another
    return sent.finished.get_nowait(), len(client.keys)


KILLED = ("error", KilledWorker("priorfill-1", None, 3))
LOST = ("lost", None)


@pytest.mark.parametrize(
    "answers",
    [
        [],
        [LOST],
        [("cancelled", None), KILLED],
        [("finished", TimeoutError("its worker ended just then")), LOST, LOST],
    ],
)
def test_a_job_whose_outcome_is_lost_is_sent_again(
    tmp_path: Path, answers: list[tuple[str, Any]]
) -> None:
    job = a_job(tmp_path, "a")
    done = JobOutcome("a", job.source, job.output, "filled", key="a")
    assert settled(job, *answers, ("finished", done.to_json())) == (done, len(answers) + 1)


def test_a_job_is_not_sent_for_ever(tmp_path: Path) -> None:
    outcome, sent = settled(a_job(tmp_path, "a"), *[KILLED] * 9)
    assert (outcome.status, outcome.try_again, sent) == ("failed", True, 4)
    assert outcome.reason == "its workers ended 4 times before it was done; see their logs"


def test_a_scheduler_that_ends_fails_its_jobs(tmp_path: Path) -> None:
    job = a_job(tmp_path, "a")
    outcome, _ = settled(job, LOST, ("gone", None))
    assert outcome.reason.startswith("the connection to the scheduler broke;")
    assert outcome.try_again
    client: Any = GivenAnswers()
    client.status = "closed"
    later = _SentJobs(client, LIMITS, run_child, limits_of_workers=False)
    later.send(job)
    assert later.finished.get_nowait() == outcome


@pytest.mark.parametrize(
    ("address", "warns"),
    [
        ("tls://node7:8786", False),
        ("tcp://127.0.0.1:8786", False),
        ("tcp://[::1]:8786", False),
        ("tcp://localhost:8786", False),
        ("tcp://node7:8786", True),
        ("tcp://10.0.0.7:8786", True),
    ],
)
def test_schedulers_that_anybody_reaches_are_warned_of(address: str, warns: bool) -> None:
    assert bool(check_address(address)) == warns


@pytest.mark.parametrize(
    "address",
    [
        "node7",
        "node7:8786",
        "http://node7:8786",
        "tcp://node7",
        "tcp://:8786",
        "tcp://a:b",
        "",
        "tls://a:1/x",
    ],
)
def test_other_addresses_are_refused(address: str) -> None:
    with pytest.raises(OptionError, match=r"is no address of a scheduler: give tls://HOST:PORT"):
        check_address(address)


def test_a_scheduler_that_does_not_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask_executor, "CONNECT_SECONDS", 0.2)
    job = a_job(tmp_path, "a")
    with (
        DaskExecutor(LIMITS, tmp_path, scheduler="tcp://127.0.0.1:1") as executor,
        pytest.raises(PriorfillError, match=r"tcp://127.0.0.1:1 cannot be reached \(.*\); check"),
    ):
        list(executor.run([job]))
