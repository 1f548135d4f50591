"""A child ends with its parent, and what it has started as well."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from priorfill.study.child.child_process import ChildProcess, child_command, child_environment
from priorfill.study.job import JobLimits

LIMITS = JobLimits(seconds=60.0, memory=1 << 31, threads=1)

CHILD = """
import subprocess, sys, time
from priorfill.study.child.parent_connection import ParentConnection
parent = ParentConnection()
started = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
print("noise", flush=True)
parent.answer({"child": started.pid, "request": parent.request})
try:
    time.sleep(600)
finally:
    open(parent.request["file"], "w").close()
"""

PARENT = f"""
import os, sys, time
from priorfill.study.child.child_process import ChildProcess
from priorfill.study.job import JobLimits
command = [sys.executable, "-c", {CHILD!r}]
child = ChildProcess(command, {{"file": sys.argv[1]}}, JobLimits(60.0, 1 << 31, 1))
print(child.answer()["child"], child._process.pid, flush=True)
time.sleep(600)
"""


@pytest.mark.windows
def test_a_child_ends_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    line = [sys.executable, "-c", PARENT, str(tmp_path / "cleaned")]
    with subprocess.Popen(line, stdout=subprocess.PIPE, env=child_environment(1)) as parent:
        assert parent.stdout is not None
        both = [psutil.Process(int(number)) for number in parent.stdout.readline().split()]
        parent.kill()
    _, alive = psutil.wait_procs(both, timeout=30.0)
    assert not alive
    assert (tmp_path / "cleaned").exists()


@pytest.mark.windows
def test_a_child_that_is_closed_ends_what_it_has_started(tmp_path: Path) -> None:
    request = {"file": str(tmp_path / "cleaned"), "name": "\udcff ü"}
    child = ChildProcess([sys.executable, "-c", CHILD], request, LIMITS)
    answer = child.answer()
    assert answer["request"] == request
    started = psutil.Process(answer["child"])
    child.close()
    _, alive = psutil.wait_procs([started], timeout=30.0)
    assert not alive
    assert child.has_ended


def test_modules_are_found_as_here(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "numpy.py").write_text("raise SystemExit('the wrong one')", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", "relative")
    found = child_environment(3)
    assert str(Path(__file__).parents[2]) in found["PYTHONPATH"]
    assert found["PRIORFILL_THREADS"] == found["NUMBA_NUM_THREADS"] == "3"
    assert found["OPENBLAS_NUM_THREADS"] == "1"
    assert "-P" in child_command("batch-job")


@pytest.mark.parametrize("typed", [b"", b"hello\n"])
def test_a_user_who_runs_the_command_is_told_of_batch(typed: bytes) -> None:
    line = "from priorfill.study.child import parent_connection as c; c.ParentConnection()"
    done = subprocess.run(
        [sys.executable, "-c", line], input=typed, capture_output=True, env=child_environment(1)
    )
    assert b"`priorfill batch` runs this command" in done.stderr
