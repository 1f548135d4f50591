from __future__ import annotations

import os

import pytest

from priorfill.errors import OutputError
from priorfill.runtime.atomic_file import replace_file


def test_the_file_appears_complete(tmp_path):
    target = tmp_path / "out.C3D"
    with replace_file(target) as temporary:
        assert temporary.parent == tmp_path
        assert temporary.name.endswith(".c3d")
        temporary.write_bytes(b"new")
        assert not target.exists()
    assert target.read_bytes() == b"new"
    assert [p.name for p in tmp_path.iterdir()] == ["out.C3D"]


@pytest.mark.parametrize("fault", [ValueError, KeyboardInterrupt])
def test_an_exception_changes_nothing(tmp_path, fault):
    target = tmp_path / "out.c3d"
    target.write_bytes(b"old")
    with pytest.raises(fault), replace_file(target, overwrite=True) as temporary:
        temporary.write_bytes(b"half")
        raise fault
    assert target.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["out.c3d"]


def test_a_missing_folder_is_reported(tmp_path):
    with (
        pytest.raises(OutputError, match=r"nowhere does not exist; create it"),
        replace_file(tmp_path / "nowhere" / "out.c3d"),
    ):
        pass


def test_a_folder_is_no_target(tmp_path):
    with pytest.raises(OutputError, match="is a folder"), replace_file(tmp_path):
        pass


def test_an_existing_file_is_kept_unless_overwriting(tmp_path):
    target = tmp_path / "out.c3d"
    target.write_bytes(b"old")
    with pytest.raises(OutputError, match="exists already"), replace_file(target):
        pass
    with replace_file(target, overwrite=True) as temporary:
        temporary.write_bytes(b"new")
    assert target.read_bytes() == b"new"


def test_a_file_that_appears_while_writing_is_kept(tmp_path):
    target = tmp_path / "out.c3d"
    with pytest.raises(OutputError, match="appeared"), replace_file(target):
        target.write_bytes(b"other")
    assert target.read_bytes() == b"other"


def test_permissions_follow_the_umask(tmp_path):
    plain = tmp_path / "plain"
    plain.write_bytes(b"")
    with replace_file(tmp_path / "out"):
        pass
    assert (tmp_path / "out").stat().st_mode == plain.stat().st_mode


def test_a_link_stays_a_link(tmp_path):
    real = tmp_path / "real.c3d"
    real.write_bytes(b"old")
    link = tmp_path / "link.c3d"
    link.symlink_to(real)
    with replace_file(link, overwrite=True) as temporary:
        temporary.write_bytes(b"new")
    assert link.is_symlink()
    assert real.read_bytes() == b"new"


def test_system_errors_become_output_errors(tmp_path):
    with pytest.raises(OutputError, match="No space left"), replace_file(tmp_path / "out"):
        raise OSError(28, os.strerror(28))
    assert not list(tmp_path.iterdir())
