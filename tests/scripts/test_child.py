"""The resources that `scripts/bench/child.py` reports."""

from __future__ import annotations

import sys
from types import ModuleType

import numpy as np
import pytest
from scripted import load_script

pytestmark = pytest.mark.windows


@pytest.fixture
def child() -> ModuleType:
    return load_script("child")


def test_memory_of_the_caller_does_not_count(child: ModuleType) -> None:
    large = np.ones(40_000_000)  # 320 MB
    cost = child.run([sys.executable, "-c", "print('text')"])
    assert large.nbytes / 1e6 > 4 * cost.memory > 0
    assert cost.output == "text\n"


def test_memory_and_cpu_of_the_command_count(child: ModuleType) -> None:
    cost = child.run([sys.executable, "-c", "x = b'x' * 100_000_000; sum(range(3_000_000))"])
    assert 100 < cost.memory < 200
    assert cost.cpu > 0.02
    assert cost.wall > 0.02


def test_exit_status_that_is_not_accepted(child: ModuleType) -> None:
    assert child.run([sys.executable, "-c", "raise SystemExit(3)"], accepted=(0, 3)).output == ""
    with pytest.raises(SystemExit, match="exit status 3"):
        child.run([sys.executable, "-c", "raise SystemExit(3)"])
