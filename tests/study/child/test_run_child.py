"""Jobs in child processes: outcomes, limits, and children that end without an outcome."""

from __future__ import annotations

import sys
import threading
from dataclasses import replace
from pathlib import Path

import psutil
import pytest

from priorfill import fill, read, write
from priorfill.study.child import child_pool
from priorfill.study.child.child_pool import ChildPool
from priorfill.study.child.run_child import run_child
from priorfill.study.job import JobLimits, StudyJob
from priorfill.study.records import file_hash, read_record
from priorfill.study.settings import FillSettings
from priorfill.synthetic.demo import make_demo_clip

LIMITS = JobLimits(seconds=300.0, memory=1 << 31, threads=1)
READ = "import sys; sys.stdin.readline();"


def job_in(folder: Path) -> StudyJob:
    return StudyJob(
        "walk.c3d",
        str(folder / "walk.c3d"),
        str(folder / "out" / "walk.c3d"),
        str(folder / "out" / ".priorfill" / "walk.c3d.json"),
        FillSettings("linear").to_json(),
        key="k",
    )


@pytest.mark.windows
def test_a_child_fills_a_file_and_writes_the_record(tmp_path: Path) -> None:
    clip = make_demo_clip()[1]
    write(tmp_path / "walk.c3d", clip)
    job = job_in(tmp_path)
    children = ChildPool()
    outcome = run_child(job, LIMITS, children=children)
    assert outcome.status == "incomplete", outcome.reason
    assert outcome.written == {job.output: file_hash(job.output)}
    again = run_child(job, LIMITS, children=children)
    assert (again.status, again.written) == (outcome.status, outcome.written)
    children.close()
    record = read_record(job.record)
    assert record is not None
    assert record.written == outcome.written
    here = fill(read(tmp_path / "walk.c3d"), method="linear")
    assert outcome.facts["filled_samples"] == int(here.filled.sum())
    assert {file.name for file in (tmp_path / "out").iterdir()} == {".priorfill", "walk.c3d"}


@pytest.mark.windows
@pytest.mark.parametrize(
    ("code", "reason", "try_again"),
    [
        ("print('mine', file=sys.stderr); sys.exit(7)", "exit status 7", True),
        ("print('mine', file=sys.stderr); import os; os.kill(os.getpid(), 9)", "process", True),
    ],
)
def test_a_child_without_an_outcome(
    tmp_path: Path, code: str, reason: str, try_again: bool
) -> None:
    job = job_in(tmp_path)
    outcome = run_child(job, LIMITS, command=(sys.executable, "-c", f"{READ}{code}"))
    assert (outcome.status, outcome.try_again) == ("failed", try_again)
    assert reason in outcome.reason
    assert "last output: mine" in outcome.reason
    assert read_record(job.record) == outcome


@pytest.mark.windows
def test_a_child_that_hangs_is_ended(tmp_path: Path) -> None:
    code = f"{READ}import time; time.sleep(60)"
    limits = JobLimits(seconds=0.5, memory=1 << 31, threads=1)
    outcome = run_child(job_in(tmp_path), limits, command=(sys.executable, "-c", code))
    assert outcome.exceeded == "seconds"
    assert outcome.seconds < 30.0


def test_a_child_that_takes_too_much_memory_is_ended(tmp_path: Path) -> None:
    code = f"{READ}x = bytearray(1 << 27); import time; x[::4096] = x[::4096]; time.sleep(60)"
    limits = JobLimits(seconds=60.0, memory=1 << 26, threads=1)
    outcome = run_child(job_in(tmp_path), limits, command=(sys.executable, "-c", code))
    assert outcome.exceeded == "memory"
    assert outcome.peak_memory > 1 << 26


def test_a_child_that_is_stopped_leaves_no_record(tmp_path: Path) -> None:
    stop = threading.Event()
    stop.set()
    job = job_in(tmp_path)
    code = f"{READ}import time; time.sleep(60)"
    outcome = run_child(job, LIMITS, stop, command=(sys.executable, "-c", code))
    assert (outcome.status, outcome.try_again) == ("failed", True)
    assert not Path(job.record).exists()


ECHO = """
import json, os, sys
for number, line in enumerate(sys.stdin):
    name = json.loads(line)["job"]["name"]
    if number and name == "die":
        os._exit(3)
    outcome = {"name": name, "source": "", "output": "", "status": "filled"}
    outcome["reason"] = str(os.getpid())
    if name == "bad":
        outcome["status"] = "failed"
    if number and name == "full":
        outcome |= {"status": "failed", "try_again": True}
    print("priorfill-answer " + json.dumps(outcome), flush=True)
"""


def processes(names: str, folder: Path, limits: JobLimits = LIMITS) -> list[int]:
    """Run jobs of these names with kept children; return the places of their processes."""
    command = (sys.executable, "-c", ECHO)
    children = ChildPool()
    found = []
    for name in names.split():
        job = replace(job_in(folder), name=name)
        outcome = run_child(job, limits, command=command, children=children)
        assert outcome.status == ("failed" if name == "bad" else "filled"), outcome.reason
        found.append(outcome.reason)
    children.close()
    assert children.take() is None
    return [found.index(one) for one in found]


@pytest.mark.windows
def test_a_child_fills_several_files(tmp_path: Path) -> None:
    assert processes("a b bad c", tmp_path) == [0, 0, 0, 0]


def test_what_fails_in_a_used_child_is_tried_in_another(tmp_path: Path) -> None:
    assert processes("a die b", tmp_path) == [0, 1, 1]
    assert processes("a full b", tmp_path) == [0, 1, 1]


def test_a_child_with_much_memory_is_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    limits = replace(LIMITS, memory=1 << 28)
    monkeypatch.setattr(child_pool, "MAX_KEPT_SHARE", 0.01)
    assert processes("a b", tmp_path, limits) == [0, 1]


def test_a_child_that_ended_while_it_waited(tmp_path: Path) -> None:
    children = ChildPool()
    command = (sys.executable, "-c", ECHO)
    first = run_child(job_in(tmp_path), LIMITS, command=command, children=children)
    psutil.Process(int(first.reason)).kill()
    second = run_child(job_in(tmp_path), LIMITS, command=command, children=children)
    assert (second.status, second.reason != first.reason) == ("filled", True)
    children.close()
    assert not psutil.pid_exists(int(second.reason))


def test_a_process_that_cannot_be_started(tmp_path: Path) -> None:
    outcome = run_child(job_in(tmp_path), LIMITS, command=(str(tmp_path / "no-python"),))
    assert (outcome.status, outcome.try_again) == ("failed", True)
    assert "no process could be started" in outcome.reason
