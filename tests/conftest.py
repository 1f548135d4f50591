"""What the tests share."""

from __future__ import annotations

import gc
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser import PageOpener, chromium
from hypothesis import settings

# the first call of a compiled function takes seconds while it is compiled
settings.register_profile("priorfill", settings(), deadline=None, max_examples=40)
settings.load_profile("priorfill")


def pytest_collection_finish() -> None:
    """Leave what the collection made, a third of a million objects, out of every gc.collect()."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real recordings, which are no part of the project."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("PRIORFILL_DATA", default))
    if not folder.is_dir():
        pytest.skip("no recordings: set PRIORFILL_DATA, or put them in ../shared/data")
    return folder


@pytest.fixture(scope="module")
def in_memory() -> Iterator[Path]:
    """A folder where flushing costs nothing, if there is memory to be had as one."""
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(
        prefix="priorfill-", dir=memory if memory.is_dir() else None
    ) as folder:
        yield Path(folder)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Run in a folder of its own, so that messages have short paths."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PRIORFILL_DEBUG", raising=False)
    return tmp_path


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Chromium, once a process of the tests."""
    with chromium() as started:
        yield started


@pytest.fixture(scope="session")
def kept_page(browser: Any) -> list[Any]:
    """The page of the window that tests use one after the other, once there is one."""
    return []


@pytest.fixture
def open_page(browser: Any, kept_page: list[Any]) -> Iterator[PageOpener]:
    """Open pages; the test fails if one prints to the console, has an error, or uses a network.

    A test that expects such faults clears ``open_page.faults``.
    """
    opener = PageOpener(browser, kept_page)
    yield opener
    opener.close()
    opener.expect_no_faults()
