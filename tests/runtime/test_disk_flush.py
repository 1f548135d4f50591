from __future__ import annotations

import errno
import os
from types import SimpleNamespace

import pytest

from priorfill.runtime import disk_flush
from priorfill.runtime.disk_flush import flush_file, flush_folder

FULL = 51
"""F_FULLFSYNC of macOS."""


@pytest.fixture
def calls(monkeypatch):
    """Record flushes on a system like macOS; `refuse` is the error of the full one."""
    made = SimpleNamespace(list=[], refuse=0)

    def fcntl(descriptor, command):
        assert command == FULL
        if made.refuse:
            raise OSError(made.refuse, os.strerror(made.refuse))
        made.list.append("full")

    monkeypatch.setattr(disk_flush, "_FULL_FLUSH", FULL)
    monkeypatch.setattr(disk_flush, "fcntl", SimpleNamespace(fcntl=fcntl), raising=False)
    monkeypatch.setattr(os, "fsync", lambda descriptor: made.list.append("fsync"))
    return made


def test_macos_flushes_the_drive_too(tmp_path, calls):
    with (tmp_path / "x").open("wb") as file:
        flush_file(file.fileno())
    assert calls.list == ["full"]


@pytest.mark.parametrize("refusal", [errno.ENOTSUP, errno.EINVAL, errno.ENOTTY])
def test_where_the_file_system_has_no_full_flush(tmp_path, calls, refusal):
    calls.refuse = refusal
    with (tmp_path / "x").open("wb") as file:
        flush_file(file.fileno())
    assert calls.list == ["fsync"]


def test_a_failed_full_flush_is_not_hidden_by_a_second_call(tmp_path, calls):
    calls.refuse = errno.EIO
    with (tmp_path / "x").open("wb") as file, pytest.raises(OSError, match="error"):
        flush_file(file.fileno())
    assert calls.list == []


def test_a_real_flush(tmp_path):
    with (tmp_path / "x").open("wb") as file:
        flush_file(file.fileno())
    flush_folder(tmp_path)


@pytest.mark.skipif(os.name == "nt", reason="folders cannot be opened on Windows")
def test_a_folder_is_flushed_the_same_way(tmp_path, calls):
    flush_folder(tmp_path)
    assert calls.list == ["full"]
