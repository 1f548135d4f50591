"""Locks that name their holder and end with its process."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from priorfill.runtime import file_lock
from priorfill.runtime.file_lock import LockHeldError, acquire_lock

pytestmark = pytest.mark.windows

HOLD = (
    "import signal, sys, time\n"
    "from pathlib import Path\n"
    "from priorfill.runtime.file_lock import acquire_lock\n"
    # shells make background jobs, and so their children, ignore SIGINT
    "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    "lock = acquire_lock(Path(sys.argv[1]))\n"
    "print('held', flush=True)\n"
    "time.sleep(600)\n"
)


def test_a_held_lock_names_its_holder(tmp_path: Path) -> None:
    path = tmp_path / "lock"
    lock = acquire_lock(path)
    with pytest.raises(LockHeldError, match=f"^process {os.getpid()} on {socket.gethostname()}$"):
        acquire_lock(path)
    with path.open("rb", buffering=0) as file:
        file.seek(1)  # Windows lets nobody else read the first byte, which is locked
        assert file.read().decode().startswith(f"process {os.getpid()} on ")
    path.write_text("")  # the holder could not write its name
    with pytest.raises(LockHeldError, match=r"^another process$"):
        acquire_lock(path)
    lock.release()
    acquire_lock(path).release()
    assert path.exists()


@pytest.mark.parametrize("how", ["kill", "interrupt"])
def test_a_lock_ends_with_its_process(tmp_path: Path, how: str) -> None:
    if how == "interrupt" and sys.platform == "win32":
        pytest.skip("Windows sends Ctrl-C to consoles, not to processes")
    path = tmp_path / "lock"
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    with holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(LockHeldError) as caught:
            acquire_lock(path)
        assert caught.value.holder.startswith(f"process {holder.pid} on ")
        try:
            if how == "kill":
                holder.kill()
            else:
                holder.send_signal(signal.SIGINT)
            holder.wait(60)
        finally:
            holder.kill()
        acquire_lock(path).release()


def test_the_first_byte_is_not_read(tmp_path: Path) -> None:
    """On Windows it is locked."""
    (tmp_path / "lock").write_bytes(b"?process 7 on lab-pc\n")
    assert file_lock._read_holder(tmp_path / "lock") == "process 7 on lab-pc"
