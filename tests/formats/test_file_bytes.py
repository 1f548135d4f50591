"""Files that cannot be read, as Windows refuses them."""

from __future__ import annotations

import errno
import sys
from pathlib import Path

import pytest
from platforms import WINDOWS

from priorfill import formats
from priorfill.errors import FormatError
from priorfill.formats import file_bytes

pytestmark = pytest.mark.windows


def refusal(number: int) -> PermissionError:
    error = PermissionError(errno.EACCES, "Permission denied")
    error.winerror = number
    return error


def test_a_file_that_a_program_keeps_for_itself(tmp_path, monkeypatch):
    path = tmp_path / "walk.c3d"
    path.write_bytes(b"")

    def refuse(*_: object, **__: object) -> None:
        raise refusal(32)

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(FormatError, match="permissions, and close it in other programs"):
        formats.read(path)


@pytest.mark.skipif(not WINDOWS, reason="other systems let every program read")
def test_a_file_that_is_open_without_sharing(tmp_path):
    if sys.platform == "win32":
        import ctypes

        path = tmp_path / "walk.c3d"
        path.write_bytes(b"")
        kernel = ctypes.windll.kernel32
        kernel.CreateFileW.restype = ctypes.c_void_p
        handle = kernel.CreateFileW(str(path), 0x80000000, 0, None, 3, 0, None)  # read, exist
        try:
            with pytest.raises(FormatError, match="permissions, and close it in other programs"):
                formats.read(path)
        finally:
            kernel.CloseHandle(ctypes.c_void_p(handle))


def test_a_folder_is_called_one(tmp_path, monkeypatch):
    def refuse(*_: object, **__: object) -> None:
        raise refusal(5)

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(FormatError, match="is a folder; give the name of a file"):
        file_bytes.read_bytes(tmp_path, max_bytes=10)


def test_a_path_too_long_for_windows(tmp_path, monkeypatch):
    monkeypatch.setattr(file_bytes, "WINDOWS", True)
    with pytest.raises(FormatError, match=r"no such file; check the name$"):
        formats.read(tmp_path / "walk.c3d")
    with pytest.raises(FormatError, match="or enable long paths"):
        formats.read(tmp_path / ("y" * 120) / ("z" * 120) / "walk.c3d")
