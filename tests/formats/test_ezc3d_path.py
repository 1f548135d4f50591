from __future__ import annotations

import tempfile

import numpy as np
import pytest
from platforms import WINDOWS

import priorfill as pf
from priorfill.errors import OutputError
from priorfill.formats import create_c3d
from priorfill.formats.c3d import ezc3d_path as module
from priorfill.formats.c3d.ezc3d_path import ezc3d_path
from priorfill.synthetic import synthesise

pytestmark = pytest.mark.windows

NAMES = ["walk 1", "Jürgen Läufe", "歩行", "Łódź σ"]


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """Give the user a name that is not ASCII: it is part of the temporary folder."""
    folder = tmp_path / "Jürgen 歩"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


@pytest.mark.parametrize("name", NAMES)
def test_c3d_files_are_written_whatever_the_users_name(tmp_path, temporary, name):
    clip = synthesise("walking", seconds=0.2)
    folder = tmp_path / name
    folder.mkdir()
    path = folder / f"{name}.c3d"
    create_c3d(path, clip)
    assert [file.name for file in folder.iterdir()] == [path.name]
    np.testing.assert_array_equal(pf.read(path).positions.shape, clip.positions.shape)
    assert list(temporary.iterdir()) == []


def test_a_copy_goes_where_its_path_is_ascii(tmp_path, temporary, monkeypatch):
    monkeypatch.setattr(module, "WINDOWS", True)
    monkeypatch.setattr(module, "_short_path", lambda path: path)  # the disk has no short names
    shared = tmp_path / "Public"
    shared.mkdir()
    monkeypatch.setenv("PUBLIC", str(shared))
    monkeypatch.setenv("PROGRAMDATA", str(tmp_path / "missing"))
    path = tmp_path / "Läufe.c3d"
    with ezc3d_path(path, write=True) as plain:
        assert plain.isascii()
        assert str(shared) in plain
        with open(plain, "wb") as file:  # noqa: PTH123, as ezc3d does
            file.write(b"new")
    assert path.read_bytes() == b"new"
    assert list(shared.iterdir()) == []
    shared.rmdir()
    with pytest.raises(OutputError, match="TEMP"), ezc3d_path(path):
        pass


def test_a_path_too_long_for_windows_is_replaced_by_a_copy(tmp_path, monkeypatch):
    path = tmp_path / ("y" * 120) / ("z" * 120) / "walk.c3d"
    if not WINDOWS:
        with ezc3d_path(path) as plain:
            assert plain == str(path)
    monkeypatch.setattr(module, "WINDOWS", True)
    with ezc3d_path(path, write=True) as plain:
        assert len(plain) < 260
        with open(plain, "wb") as file:  # noqa: PTH123
            file.write(b"new")
        path.parent.mkdir(parents=True)
    assert path.read_bytes() == b"new"
