"""Worker processes of the check scripts: time, memory and crashes are contained."""

from __future__ import annotations

import os
import time

from scripted import load_script

worker = load_script("worker")


def test_limits():
    """After a timeout, an error, a memory error or a crash, the next item still runs."""
    with worker.Worker(time.sleep, seconds=0.3, memory=2**28) as process:
        assert process.do(0).kind == worker.DONE
        assert process.do(60) == (worker.TIMEOUT, "took more than 0.3 s")
        assert process.do(0).kind == worker.DONE
        kind, value = process.do("x")
        assert kind == worker.RAISED
        assert value.startswith("TypeError at worker.py")
    with worker.Worker(bytes, seconds=60, memory=2**28) as process:
        assert process.do(2**29).kind == worker.MEMORY
        assert process.do(2**10) == (worker.DONE, bytes(2**10))
    with worker.Worker(os._exit, seconds=60, memory=2**28) as process:
        assert process.do(3) == (worker.CRASH, "exit status 3")
        assert process.do(4) == (worker.CRASH, "exit status 4")
