"""Jobs at the same time: each has one outcome, whatever happens."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from priorfill.study import local_executor
from priorfill.study.job import JobLimits, JobOutcome, StudyJob
from priorfill.study.local_executor import LocalExecutor

LIMITS = JobLimits(60.0, 2**30, 1)


def job(name: str) -> StudyJob:
    return StudyJob(name, f"/in/{name}", f"/out/{name}", f"/out/{name}.json")


def test_each_job_has_one_outcome(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(job: StudyJob, **_: Any) -> JobOutcome:
        if job.name == "3":
            raise RuntimeError("a bug")
        return JobOutcome(job.name, job.source, job.output, "filled")

    monkeypatch.setattr(local_executor, "run_child", run)
    jobs = [job(str(number)) for number in range(7)]
    with LocalExecutor(3, LIMITS) as executor:
        outcomes = sorted(executor.run(jobs), key=lambda one: one.name)
    assert [one.name for one in outcomes] == [one.name for one in jobs]
    assert [one.name for one in outcomes if one.status == "failed"] == ["3"]
    assert "bug in priorfill (RuntimeError: a bug)" in outcomes[3].reason
    assert outcomes[3].try_again


def test_jobs_are_stopped_and_not_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    stopped: list[str] = []

    def run(job: StudyJob, stop: threading.Event, **_: Any) -> JobOutcome:
        if job.name != "0":
            assert stop.wait(10)
            stopped.append(job.name)
        return JobOutcome.of_failure(job, "stopped")

    monkeypatch.setattr(local_executor, "run_child", run)
    outcomes = LocalExecutor(2, LIMITS).run([job(str(number)) for number in range(5)])
    assert next(outcomes).name == "0"
    outcomes.close()
    assert stopped in ([], ["1"])  # the second may not have begun
