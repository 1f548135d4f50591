"""Free memory goes back to the system."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from priorfill.runtime.free_memory import MIN_BYTES, release_free_memory

BLOCK = 100_000
"""Bytes, below the least size of arrays that glibc takes from the system one by one."""


def resident_mb() -> float:
    """Return the memory of this process that is in use (MB)."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return int(status.split("VmRSS:")[1].split()[0]) * 1024 / 1e6


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other libraries keep little")
def test_freed_blocks_go_back_to_the_system() -> None:
    blocks = [np.ones(BLOCK, dtype=np.uint8) for _ in range(1000)]
    last = blocks[-1]  # above all others, so that these stay with the library
    before = resident_mb()
    blocks.clear()
    release_free_memory(MIN_BYTES - 1)
    assert resident_mb() > before - 50.0
    release_free_memory(MIN_BYTES)
    assert resident_mb() < before - 50.0
    assert last.all()


def test_it_does_nothing_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "win32")
    release_free_memory(MIN_BYTES)
