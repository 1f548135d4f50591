from __future__ import annotations

import errno
import mmap
import os
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from platforms import WINDOWS, on_wine

from priorfill.errors import OutputError
from priorfill.runtime import atomic_file, held_files, windows_names
from priorfill.runtime.atomic_file import check_target, check_writable, replace_file

pytestmark = pytest.mark.windows

posix = pytest.mark.skipif(WINDOWS, reason="POSIX only")


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


def test_a_missing_folder_is_made(tmp_path):
    target = tmp_path / "new" / "folder" / "out.c3d"
    check_target(target)
    check_writable(target, 100)
    assert not (tmp_path / "new").exists()
    with replace_file(target) as temporary:
        temporary.write_bytes(b"new")
    assert target.read_bytes() == b"new"


def test_a_file_in_place_of_a_folder_is_reported(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(OutputError, match="file is a file, no folder"):
        check_target(tmp_path / "file" / "sub" / "out.c3d")


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


@pytest.mark.skipif(on_wine(), reason="wine shows no symbolic link as one")
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


def leftover(folder, process, computer=None, idle=0.0):
    """Return a temporary file of some process."""
    computer = atomic_file._computer() if computer is None else computer
    path = folder / f".priorfill-{computer}-{process}-0123456789ab.part.c3d"
    path.write_bytes(b"half")
    written = time.time() - idle
    os.utime(path, (written, written))
    return path


def test_files_of_killed_processes_are_removed(tmp_path):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()  # on Windows, the process can still be opened
    killed = leftover(tmp_path, ended.pid)
    too_large = leftover(tmp_path, 10**30)
    running = leftover(tmp_path, os.getpid())
    elsewhere = leftover(tmp_path, ended.pid, "ffffffff", idle=3600)
    long_ago = leftover(tmp_path, ended.pid, "fffffffe", idle=25 * 3600)
    other = tmp_path / ".walk.part.c3d"
    other.write_bytes(b"not ours")
    with replace_file(tmp_path / "out.c3d"):
        assert not killed.exists()
        assert not long_ago.exists()
    assert running.exists()
    assert elsewhere.exists()
    assert too_large.exists()
    assert other.exists()


def test_a_long_name_leaves_room_for_the_temporary_one(tmp_path):
    target = tmp_path / ("x" * 250 + ".c3d")
    with replace_file(target) as temporary:
        temporary.write_bytes(b"new")
    assert target.read_bytes() == b"new"


@pytest.mark.parametrize("links", [True, False] if not WINDOWS else [True])
def test_of_two_writers_of_a_new_file_the_second_is_refused(tmp_path, monkeypatch, links):
    if not links:

        def refuse(*_: object) -> None:
            raise OSError(errno.EPERM, "Operation not permitted")

        monkeypatch.setattr("os.link", refuse)
    target = tmp_path / "out.c3d"
    with (
        pytest.raises(OutputError, match="appeared while writing"),
        replace_file(target) as second,
    ):
        second.write_bytes(b"second")
        with replace_file(target) as first:
            first.write_bytes(b"first")
    assert target.read_bytes() == b"first"
    assert [path.name for path in tmp_path.iterdir()] == ["out.c3d"]


@posix
def test_a_replaced_file_hands_on_permissions_and_owner(tmp_path):
    target = tmp_path / "out.c3d"
    target.write_bytes(b"old")
    target.chmod(0o640)
    if os.geteuid() == 0:
        os.chown(target, 1234, 5678)
    before = target.stat()
    with replace_file(target, overwrite=True) as temporary:
        temporary.write_bytes(b"new")
    after = target.stat()
    assert (after.st_mode, after.st_uid, after.st_gid) == (
        before.st_mode,
        before.st_uid,
        before.st_gid,
    )


def test_a_write_protected_file_is_kept(tmp_path, monkeypatch):
    target = tmp_path / "out.c3d"
    target.write_bytes(b"old")
    target.chmod(0o444)
    if not WINDOWS:
        monkeypatch.setattr("os.access", lambda path, mode: False)  # the superuser writes all
    with pytest.raises(OutputError, match="write-protected"), replace_file(target, overwrite=True):
        pass
    assert target.read_bytes() == b"old"


@posix
def test_a_device_is_no_target(tmp_path):
    os.mkfifo(tmp_path / "pipe.c3d")
    with (
        pytest.raises(OutputError, match="is not a regular file"),
        replace_file(tmp_path / "pipe.c3d", overwrite=True),
    ):
        pass


def test_whether_a_folder_takes_files_is_checked_beforehand(tmp_path, monkeypatch):
    check_writable(tmp_path / "out.c3d", 1000)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(OutputError, match=r"takes about .* MB, but only .* MB are free"):
        check_writable(tmp_path / "out.c3d", 10**18)

    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr("pathlib.Path.open", refuse)
    with pytest.raises(OutputError, match=r"cannot be written \(Read-only file system\)"):
        check_writable(tmp_path / "out.c3d", 0)


@posix
def test_a_name_taken_at_the_last_moment_where_there_are_no_links(tmp_path, monkeypatch):
    target = tmp_path / "out.c3d"

    def refuse(source, name):
        target.write_bytes(b"other")  # after every check
        raise PermissionError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr("os.link", refuse)
    monkeypatch.setattr("pathlib.Path.exists", lambda path: path != target)
    with pytest.raises(OutputError, match="appeared"), replace_file(target) as temporary:
        temporary.write_bytes(b"new")
    assert target.read_bytes() == b"other"


@posix
def test_a_link_that_is_reported_as_existing_although_it_was_made(tmp_path, monkeypatch):
    link = os.link

    def lose_the_answer(source, name):
        link(source, name)
        raise FileExistsError(errno.EEXIST, "File exists")

    monkeypatch.setattr("os.link", lose_the_answer)
    with replace_file(tmp_path / "out.c3d") as temporary:
        temporary.write_bytes(b"new")
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"new"]


@posix
@pytest.mark.parametrize("call", ["open", "fsync"])
def test_a_folder_that_cannot_be_flushed(tmp_path, monkeypatch, call):
    real = getattr(os, call)

    def refuse(what, *rest):
        if call == "open" and what == tmp_path:
            raise PermissionError(errno.EACCES, "Permission denied")
        if call == "fsync" and os.path.isdir(f"/dev/fd/{what}"):  # noqa: PTH112
            raise OSError(errno.EINVAL, "Invalid argument")
        return real(what, *rest)

    monkeypatch.setattr(os, call, refuse)
    with replace_file(tmp_path / "out.c3d") as temporary:
        temporary.write_bytes(b"new")
    assert (tmp_path / "out.c3d").read_bytes() == b"new"


@contextmanager
def held(path):
    """Hold a file as a program of the user does."""
    with path.open("rb") as file:
        yield file


@contextmanager
def mapped(path):
    """Hold a file by its mapped contents alone."""
    with path.open("rb") as file:
        contents = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    with contents:
        yield contents


@pytest.fixture
def refusals(monkeypatch):
    """Refuse what Windows refuses for files in the list that is returned; count the refusals."""

    class Held(list):
        count = 0
        lasts = 1000

    files = Held()

    def refuse_like_windows(name, real, error):
        def call(path, *rest, **options):
            concerned = {os.fspath(path), *map(os.fspath, rest)}
            if files.count < files.lasts and concerned & {os.fspath(file) for file in files}:
                files.count += 1
                failure = PermissionError(errno.EACCES, "Access is denied")
                failure.winerror = error
                raise failure
            return real(path, *rest, **options)

        monkeypatch.setattr(os, name, call)

    refuse_like_windows("replace", os.replace, 5)
    refuse_like_windows("rename", os.rename, 32)
    refuse_like_windows("unlink", os.unlink, 32)
    monkeypatch.setattr(held_files, "_PAUSES_S", (0.0,) * 6)
    monkeypatch.setattr(held_files, "WINDOWS", True)
    monkeypatch.setattr(atomic_file, "WINDOWS", True)
    return files


def test_a_target_that_is_open_is_noticed_before_the_work(tmp_path, refusals):
    target = tmp_path / "out.c3d"
    target.write_bytes(b"old")
    refusals.append(target)
    with pytest.raises(OutputError, match=r"out\.c3d: is open in another program; close it"):
        check_target(target, overwrite=True)


def test_a_target_that_is_opened_during_the_work_is_kept(tmp_path, refusals):
    target = tmp_path / "out.c3d"
    target.write_bytes(b"old")
    with (
        pytest.raises(OutputError, match=r"out\.c3d: is open in another program; close it"),
        replace_file(target, overwrite=True) as temporary,
    ):
        temporary.write_bytes(b"new")
        refusals.append(target)
    assert target.read_bytes() == b"old"
    assert [path.name for path in tmp_path.iterdir()] == ["out.c3d"]


def test_a_target_that_a_virus_scanner_opens_for_a_moment_is_replaced(tmp_path, refusals):
    target = tmp_path / "out.c3d"
    target.write_bytes(b"old")
    refusals.lasts = 3
    with replace_file(target, overwrite=True) as temporary:
        temporary.write_bytes(b"new")
        refusals.append(target)
    assert refusals.count == 3
    assert target.read_bytes() == b"new"


def test_a_new_file_that_a_virus_scanner_opens_for_a_moment_gets_its_name(tmp_path, refusals):
    refusals.lasts = 3
    with replace_file(tmp_path / "out.c3d") as temporary:
        temporary.write_bytes(b"new")
        refusals.append(temporary)
    assert refusals.count == 3
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"new"]


def test_a_name_that_windows_finds_taken_is_kept(tmp_path, monkeypatch):
    def refuse(path, target):
        raise FileExistsError(errno.EEXIST, "File exists")

    monkeypatch.setattr(atomic_file, "WINDOWS", True)
    monkeypatch.setattr(Path, "rename", refuse)
    with pytest.raises(OutputError, match="appeared while writing"), replace_file(tmp_path / "out"):
        pass
    assert not list(tmp_path.iterdir())


def test_a_temporary_file_that_a_virus_scanner_opens_for_a_moment_is_removed(tmp_path, refusals):
    refusals.lasts = 3
    with pytest.raises(ValueError, match="first"), replace_file(tmp_path / "out") as temporary:
        temporary.touch()
        refusals.append(temporary)
        raise ValueError("first")
    assert refusals.count == 3
    assert not list(tmp_path.iterdir())


def test_a_scanner_that_keeps_a_new_file_for_itself_is_waited_for(tmp_path, refusals, monkeypatch):
    refused = []

    def open_late(path, mode="r", **options):
        if mode == "rb+" and len(refused) < 3:
            refused.append(path)
            raise PermissionError(errno.EACCES, "Permission denied")
        return really(path, mode, **options)

    really = Path.open
    monkeypatch.setattr(Path, "open", open_late)
    with replace_file(tmp_path / "out") as temporary:
        temporary.write_bytes(b"new")
    assert len(refused) == 3
    assert (tmp_path / "out").read_bytes() == b"new"


def test_a_temporary_file_that_cannot_go_hides_no_error(tmp_path, refusals):
    with pytest.raises(ValueError, match="first"), replace_file(tmp_path / "out") as temporary:
        refusals.append(temporary)
        raise ValueError("first")
    assert not (tmp_path / "out").exists()


def test_a_folder_takes_files_although_a_virus_scanner_holds_them(tmp_path, refusals, monkeypatch):
    monkeypatch.setattr(atomic_file, "temporary_name", lambda suffix: "trial")
    refusals.append(tmp_path / "trial")
    check_writable(tmp_path / "out.c3d", 0)
    refusals.clear()
    refusals.append(tmp_path / "trial 2")
    monkeypatch.setattr(atomic_file, "temporary_name", lambda suffix: "trial 2")
    refusals.count, refusals.lasts = 0, 3
    check_writable(tmp_path / "out.c3d", 0)
    assert [path.name for path in tmp_path.iterdir()] == ["trial"]


@pytest.mark.parametrize("name", ["nul.c3d", "walk:2.c3d", "what?.c3d", "walk.c3d ", "new./a.c3d"])
def test_names_that_windows_does_not_take_are_refused(tmp_path, monkeypatch, name):
    monkeypatch.setattr(atomic_file, "WINDOWS", True)
    with pytest.raises(OutputError, match="choose another name"), replace_file(tmp_path / name):
        pass
    assert not list(tmp_path.iterdir())


@posix
def test_such_names_are_taken_elsewhere(tmp_path):
    for name in ("nul.c3d", "walk:2.c3d", "what?.c3d", "walk.c3d "):
        with replace_file(tmp_path / name):
            pass
        assert (tmp_path / name).exists()


def test_a_path_that_is_too_long_is_refused_before_the_work(tmp_path, monkeypatch):
    target = tmp_path / ("y" * 100) / ("z" * 100) / "out.c3d"
    check_target(target)
    monkeypatch.setattr(atomic_file, "WINDOWS", True)
    monkeypatch.setattr(windows_names, "long_paths_enabled", lambda: False)
    with pytest.raises(OutputError, match=r"Windows takes 259; .* \(LongPathsEnabled"):
        check_target(target)


def test_files_without_numbers_are_compared_by_their_paths(tmp_path, monkeypatch):
    source, other = tmp_path / "in.c3d", tmp_path / "other.c3d"
    source.write_bytes(b"")
    other.write_bytes(b"")
    real = Path.stat

    def stat(path, **options):
        found = list(real(path, **options))
        found[1] = found[2] = 0  # number of the file, of the drive
        return os.stat_result(found)

    monkeypatch.setattr(Path, "stat", stat)
    check_target(other, overwrite=True, source=source)
    with pytest.raises(OutputError, match="is the file that the clip was read from"):
        check_target(tmp_path / "x" / ".." / "in.c3d", overwrite=True, source=source)


@pytest.mark.skipif(not WINDOWS, reason="other systems replace open files")
class TestOpenFiles:
    @pytest.fixture(autouse=True)
    def short_pauses(self, monkeypatch):
        monkeypatch.setattr(held_files, "_PAUSES_S", (0.01, 0.2))

    @pytest.mark.parametrize("hold", [held, mapped])
    def test_an_open_target_is_kept(self, tmp_path, hold):
        target = tmp_path / "out.c3d"
        target.write_bytes(b"old")
        with (
            hold(target),
            pytest.raises(OutputError, match="is open in another program"),
            replace_file(target, overwrite=True) as temporary,
        ):
            temporary.write_bytes(b"new")
        assert target.read_bytes() == b"old"
        assert [path.name for path in tmp_path.iterdir()] == ["out.c3d"]

    def test_a_target_that_is_closed_in_time_is_replaced(self, tmp_path):
        target = tmp_path / "out.c3d"
        target.write_bytes(b"old")
        file = target.open("rb")
        threading.Timer(0.1, file.close).start()
        with replace_file(target, overwrite=True) as temporary:
            temporary.write_bytes(b"new")
        assert target.read_bytes() == b"new"

    def test_a_source_is_known_whatever_the_case_of_its_name(self, tmp_path):
        (tmp_path / "Walk.c3d").write_bytes(b"")
        with pytest.raises(OutputError, match="is the file that the clip was read from"):
            check_target(tmp_path / "WALK.C3D", overwrite=True, source=tmp_path / "Walk.c3d")

    def test_a_drive_that_does_not_exist(self):
        with pytest.raises(OutputError, match=r"there is no B:\\; check the drive"):
            check_target("B:/walks/out.c3d")


@pytest.mark.skipif(not WINDOWS, reason="elsewhere, a path has no drive")
def test_a_drive_behind_a_folder_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """pathlib of Python 3.11 drops the folder when it makes a path of a path."""
    monkeypatch.chdir(tmp_path)
    for path in ("out/C:x.npz", Path("out/C:x.npz")):
        for use in (check_target, lambda path: replace_file(path).__enter__()):
            with pytest.raises(OutputError, match="Windows allows in no name"):
                use(path)
