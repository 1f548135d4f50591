"""Run a job in a child process, so that a bad file costs itself only."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from dataclasses import replace

from priorfill.runtime.threads import VARIABLE
from priorfill.study.job import JobLimits, JobOutcome, StudyJob

__all__ = ["run_child"]


def run_child(job: StudyJob, limits: JobLimits, stop: threading.Event | None = None) -> JobOutcome:
    """Run a job in a child process, and return its outcome.

    Parameters
    ----------
    job : StudyJob
        The job.
    limits : JobLimits
        What it may use.
    stop : threading.Event, optional
        Ends the child when it is set.
    """
    begun = time.monotonic()
    child = subprocess.Popen(
        [sys.executable, "-m", "priorfill", "batch-job"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, VARIABLE: str(limits.threads)},
        start_new_session=True,
    )
    assert child.stdin is not None
    assert child.stdout is not None
    child.stdin.write(json.dumps(job.to_json()).encode() + b"\n")
    child.stdin.flush()
    while child.poll() is None:
        if stop is not None and stop.is_set():
            child.kill()
        elif time.monotonic() - begun > limits.seconds:
            child.kill()
            child.wait()
            return JobOutcome.of_failure(job, "took too long", try_again=True, exceeded="seconds")
        time.sleep(0.05)
    text = child.stdout.read()
    child.stdin.close()
    child.stdout.close()
    if child.returncode:
        return JobOutcome.of_failure(job, "was ended", try_again=True)
    outcome = JobOutcome.from_json(json.loads(text.splitlines()[-1]))
    return replace(outcome, seconds=time.monotonic() - begun)
