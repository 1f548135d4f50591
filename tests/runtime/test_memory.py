"""What is done so that little memory is held."""

from __future__ import annotations

import ctypes
import sys
from types import SimpleNamespace

import pytest

from priorfill.runtime.memory import give_back


def test_memory_is_given_back_where_the_system_can_be_told(monkeypatch):
    asked = []
    library = SimpleNamespace(malloc_trim=asked.append)
    monkeypatch.setattr(ctypes, "CDLL", lambda name: library)
    monkeypatch.setattr(sys, "platform", "linux")
    give_back()
    assert asked == [0]  # nothing is kept on top
    monkeypatch.setattr(sys, "platform", "win32")
    give_back()
    del library.malloc_trim  # another C library
    monkeypatch.setattr(sys, "platform", "linux")
    give_back()
    assert asked == [0]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems are not asked")
def test_the_systems_own_library_can_be_asked():
    give_back()
