"""Worker processes of the check scripts: time, memory and crashes are contained."""

from __future__ import annotations

import os
import time

import pytest
from scripted import load_script

worker = load_script("worker")


@pytest.fixture(params=["as here", "as on Windows"])
def system(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """This system, and one without forks and without a limit on the address space."""
    if request.param == "as on Windows":
        if not worker.FORKED:
            pytest.skip("is as here")
        monkeypatch.setattr(worker, "FORKED", False)
        monkeypatch.setattr(worker, "HAS_ADDRESS_LIMIT", False)


def test_limits(system: None) -> None:
    """After a timeout, an error, a memory error or a crash, the next item still runs."""
    with worker.Worker(time.sleep, seconds=0.3, memory=2**28) as process:
        assert process.do(0).kind == worker.DONE
        assert process.do(60) == (worker.TIMEOUT, "took more than 0.3 s")
        assert process.do(0).kind == worker.DONE
        kind, value = process.do("x")
        assert kind == worker.RAISED
        assert value.startswith("TypeError at worker.py")
    with worker.Worker(eval, seconds=60, memory=2**28) as process:
        assert process.do("[b'x' * 2**29, __import__('time').sleep(60)]") == (
            worker.MEMORY,
            "needed more than 0.25 GB",
        )
        assert process.do("b'x' * 2**10") == (worker.DONE, b"x" * 2**10)
    with worker.Worker(os._exit, seconds=60, memory=2**28) as process:
        assert process.do(3) == (worker.CRASH, "exit status 3")
        assert process.do(4) == (worker.CRASH, "exit status 4")


def test_modules_are_imported_before_the_first_item(system: None) -> None:
    code = "'colorsys' in __import__('sys').modules"
    with worker.Worker(eval, seconds=60, memory=2**28) as process:
        assert process.do(code) == (worker.DONE, False)
    with worker.Worker(eval, seconds=60, memory=2**28, preload=["colorsys"]) as process:
        assert process.do(code) == (worker.DONE, True)
