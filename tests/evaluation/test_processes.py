"""Worker processes, which are spawned on every system: scripts, interrupts, and their number."""

from __future__ import annotations

import _thread
import multiprocessing as mp
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import wait as wait_for
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from priorfill.errors import OutputError
from priorfill.evaluation import EvaluationOptions, evaluate, gap_case, runner
from priorfill.synthetic import synthesise

SCRIPT = """\
from priorfill.errors import EvaluationError
from priorfill.evaluation import evaluate
try:
    evaluate([], jobs=2)
except EvaluationError as error:
    print(error)
"""


def test_a_script_without_a_guard_gets_one_line(tmp_path: Path) -> None:
    script = tmp_path / "without guard.py"
    script.write_text(SCRIPT, encoding="utf-8")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout == (
        "worker processes run the script again up to this point; put its statements below "
        '`if __name__ == "__main__":`, or give `jobs` as 0\n'
    )
    assert done.stderr == ""


def test_a_script_from_a_pipe_gets_one_line() -> None:
    done = subprocess.run(
        [sys.executable], input=SCRIPT, capture_output=True, text=True, timeout=120
    )
    assert done.stdout == (
        "worker processes cannot run <stdin> again; run it from a file, or give `jobs` as 0\n"
    )
    assert done.stderr == ""


@pytest.mark.windows
def test_an_interrupt_ends_the_wait_for_a_fill(
    monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    """Windows looks at signals only between waits."""
    # a program in the background of a shell ignores Ctrl-C
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    request.addfinalizer(lambda: signal.signal(signal.SIGINT, before))
    clip = synthesise("walking", seconds=1.0)
    alone = evaluate(clip, methods="linear", protocol="frames")
    plan = replace(alone.plan, cases=(_Slow(0, "slow", 1, ()),))
    interrupt = threading.Timer(0.3, _thread.interrupt_main)
    began: list[float] = []

    def wait(*given: Any) -> Any:
        if not began:
            began.append(time.monotonic())
            interrupt.start()  # not earlier: Python ignores exceptions in finalizers
        return wait_for(*given)

    monkeypatch.setattr(runner, "wait_for", wait)
    with pytest.raises(KeyboardInterrupt):
        runner.run_plan(plan, jobs=1)
    assert time.monotonic() - began[0] < _Slow.SECONDS / 2
    for child in mp.active_children():
        child.join(30.0)
        # a thread of the pool may have waited for it as well, and is about to note its exit status
        end = time.monotonic() + 5.0
        while child.is_alive() and time.monotonic() < end:
            time.sleep(0.01)
        assert not child.is_alive()


class _Slow(gap_case.GapCase):
    """A case that takes a minute."""

    SECONDS = 60.0

    def __reduce__(self) -> tuple[object, ...]:
        return time.sleep, (self.SECONDS,)


def test_workers_leave_interrupts_to_their_parent(monkeypatch: pytest.MonkeyPatch) -> None:
    ignored: list[int] = []
    monkeypatch.setattr(signal, "SIGBREAK", 21, raising=False)
    monkeypatch.setattr(signal, "signal", lambda number, action: ignored.append(number))
    for name in ("limit_threads", "threadpool_limits"):
        monkeypatch.setattr(runner, name, lambda number: None)
    runner._begin(())
    assert ignored == [signal.SIGINT, 21]


def test_windows_has_a_maximum_of_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    def pool(sources: object, processes: int) -> None:
        raise ZeroDivisionError(f"{processes} processes")

    monkeypatch.setattr(runner, "MAX_PROCESSES", 3)
    monkeypatch.setattr(runner, "_pool", pool)
    plan = evaluate(synthesise("walking", seconds=1.0), methods="linear", protocol="frames").plan
    with pytest.raises(ZeroDivisionError, match="3 processes"):
        runner.run_plan(plan, jobs=100)


@pytest.mark.windows
def test_an_evaluation_whose_table_is_open(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a spreadsheet has it open: refused before anything is removed."""
    clip = synthesise("walking", seconds=1.0)
    line = {"methods": "linear", "protocol": "frames", "output": tmp_path}
    evaluate(clip, **line)
    kept = len(list((tmp_path / "cases").iterdir()))
    again = EvaluationOptions(overwrite=True)
    if sys.platform != "win32":
        monkeypatch.setattr("pathlib.Path.unlink", _refused)
        monkeypatch.setattr("priorfill.evaluation.outcome_store.is_held", lambda error: True)
    with (
        (tmp_path / "gaps.csv").open(),
        pytest.raises(OutputError, match=r"gaps\.csv.*close the program that has it open"),
    ):
        evaluate(clip, **line, options=again)
    monkeypatch.undo()
    assert len(list((tmp_path / "cases").iterdir())) == kept > 0
    assert evaluate(clip, **line, options=again).worked


@pytest.mark.windows
def test_an_open_table_is_noticed_before_the_fills(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clip = synthesise("walking", seconds=1.0)
    line = {"methods": "linear", "protocol": "frames", "output": tmp_path}
    evaluate(clip, **line)
    next((tmp_path / "cases").iterdir()).unlink()
    kept = len(list((tmp_path / "cases").iterdir()))
    if sys.platform != "win32":
        module = "priorfill.runtime.atomic_file"
        monkeypatch.setattr(f"{module}.is_open_elsewhere", lambda path: path.name == "gaps.csv")
    with (
        (tmp_path / "gaps.csv").open(),
        pytest.raises(OutputError, match=r"gaps\.csv: is open in another program"),
    ):
        evaluate(clip, **line)
    assert len(list((tmp_path / "cases").iterdir())) == kept


def _refused(path: Path, missing_ok: bool = False) -> None:
    if path.name == "gaps.csv":
        raise PermissionError(13, "Permission denied", str(path))
    os.unlink(path)  # noqa: PTH108, which is replaced here
