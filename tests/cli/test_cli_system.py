"""Signals, and output streams that are closed or full."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner
from platforms import WINDOWS

from priorfill import write
from priorfill.cli import main, system
from priorfill.cli.system import TerminatedError, end_on_signals
from priorfill.runtime import error_line
from priorfill.synthetic.demo import make_demo_clip

pytestmark = pytest.mark.windows

posix = pytest.mark.skipif(WINDOWS, reason="POSIX only")

DONE = (0, 3)
"""Exit status of a fill by straight lines, which may be implausible and thus left missing."""


@pytest.fixture(scope="module")
def walk(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("clips") / "walk.npz"
    demo = make_demo_clip()[1]
    write(path, demo.with_positions(demo.positions[100:180]))  # with one gap
    return path


def program(*arguments: object) -> list[str]:
    return [
        sys.executable,
        "-c",
        "from priorfill.cli import main; main()",
        *map(str, arguments),
    ]


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP", "SIGBREAK"])
def test_a_signal_ends_the_block_like_ctrl_c(name):
    number = getattr(signal, name, None)
    if number is None:
        pytest.skip(f"no {name} here")
    before = signal.signal(number, signal.SIG_DFL)  # under nohup, SIGHUP is ignored
    try:
        with pytest.raises(TerminatedError) as caught, end_on_signals():
            signal.raise_signal(number)
        assert isinstance(caught.value, KeyboardInterrupt)
        assert caught.value.exit_status == 128 + number
        assert signal.getsignal(number) is signal.SIG_DFL
    finally:
        signal.signal(number, before)


@posix
def test_an_ignored_signal_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with end_on_signals():
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


@posix
def test_a_signal_while_writing_leaves_no_file(tmp_path, walk):
    script = (
        "import priorfill.runtime.atomic_file as files, time\n"
        "def wait(path):\n"
        "    open('started', 'w').close()\n"
        "    time.sleep(60)\n"
        "files._flush = wait\n"
        "from priorfill.cli import main; main()"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script, "fill", walk, "-o", "out.npz", "--method", "linear"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 60
    while not (tmp_path / "started").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert [path for path in tmp_path.iterdir() if ".part" in path.name]
    process.send_signal(signal.SIGTERM)
    _, errors = process.communicate()
    assert process.returncode == 128 + signal.SIGTERM
    assert errors.splitlines()[-1] == f"priorfill: ended by signal {int(signal.SIGTERM)}"
    assert [path.name for path in tmp_path.iterdir()] == ["started"]


@posix
@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_a_closed_stream_does_not_matter(tmp_path, walk, stream):
    number = {"stdout": 1, "stderr": 2}[stream]
    done = subprocess.run(
        program("fill", walk, "-o", tmp_path / "out.npz", "--method", "linear"),
        preexec_fn=lambda: os.close(number),
        capture_output=stream != "stdout",
        check=False,
    )
    assert done.returncode in DONE
    assert (tmp_path / "out.npz").exists()


def test_a_program_without_streams():
    """As pythonw and services of Windows start it."""
    script = f"import sys; sys.stdout = sys.stderr = None; {program()[-1]}"
    for arguments, status in ((["methods"], 0), (["inspect", "missing.c3d"], 2)):
        done = subprocess.run([sys.executable, "-c", script, *arguments], check=False)
        assert done.returncode == status


@pytest.mark.skipif(WINDOWS or not Path("/dev/full").exists(), reason="no /dev/full")
def test_a_full_stream(tmp_path, walk):
    fill = program("fill", walk, "-o", tmp_path / "out.npz", "--method", "linear")
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(fill, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
        assert done.returncode == 1
        (line,) = [line for line in done.stderr.splitlines() if "standard output" in line]
        assert "what the command has written to files is complete" in line
        assert (tmp_path / "out.npz").exists()
        done = subprocess.run(
            [*fill, "--overwrite"], stdout=subprocess.PIPE, stderr=full, check=False
        )
        assert done.returncode in DONE
        done = subprocess.run(
            program("--help"), stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
        assert (done.returncode, len(done.stderr.splitlines())) == (1, 1)


@pytest.mark.parametrize("arguments", [("methods",), ("--help",)])
def test_a_reader_that_closes_the_pipe(arguments):
    process = subprocess.Popen(
        # long enough for the pipe to be closed before the first line
        [sys.executable, "-c", f"input(); {program()[-1]}", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    with process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        process.stdin.write("\n")
        process.stdin.close()
        assert process.stderr.read() == ""
    closed_by_click = not WINDOWS and arguments == ("--help",)
    assert process.returncode == (1 if closed_by_click else 141)


def test_a_closed_pipe_of_windows(monkeypatch):
    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.EINVAL, "Invalid argument")

    monkeypatch.setattr(system, "WINDOWS", True)
    monkeypatch.setattr("click.echo", refuse)
    done = CliRunner().invoke(main, ["methods"])
    assert (done.exit_code, done.output) == (141, "")


def test_a_share_of_windows_that_is_gone_is_no_closed_pipe(monkeypatch):
    """Both are an invalid argument without the name of a file."""

    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.EINVAL, "Invalid argument")

    monkeypatch.setattr(system, "WINDOWS", True)
    monkeypatch.setattr("priorfill.cli.inspect.read_clips", refuse)
    done = CliRunner().invoke(main, ["inspect", "walk.c3d"])
    assert done.exit_code == 1
    assert done.stderr.startswith("priorfill: Invalid argument; ")


def test_an_interrupt_during_the_imports():
    script = (
        "import sys\n"
        "class Interrupt:\n"
        "    def find_spec(self, name, *rest):\n"
        "        if name == 'priorfill.cli.output':\n"
        "            raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Interrupt())\n"
        "from priorfill.__main__ import start\n"
        "start()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, "methods"], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr == "priorfill: interrupted\n"


@posix
def test_pipes_are_neither_read_nor_replaced(tmp_path, walk):
    for name in ("in.csv", "in.c3d", "out.npz"):
        os.mkfifo(tmp_path / name)
    for source, target in (("in.csv", "x.c3d"), ("in.c3d", "x.c3d"), (walk, "out.npz")):
        arguments = ["fill", str(tmp_path / source), "-o", str(tmp_path / target), "--overwrite"]
        done = CliRunner().invoke(main, arguments)
        assert done.exit_code == 1
        assert "is not a regular file" in done.stderr
    assert (tmp_path / "out.npz").is_fifo()


@posix
@pytest.mark.parametrize("megabytes", [200, 1200])
def test_a_limit_on_memory(tmp_path, walk, megabytes):
    import resource

    limit = megabytes * 2**20
    done = subprocess.run(
        program("fill", walk, "-o", tmp_path / "out.npz"),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)),
        env={name: value for name, value in os.environ.items() if "NUM_THREADS" not in name},
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    if megabytes > 1000:
        assert (done.returncode, done.stderr) == (0, "")
    else:
        assert done.returncode == 1
        assert done.stderr.startswith("priorfill: the address space is limited to 200 MB")


@posix
def test_messages_on_paths_say_what_to_do(tmp_path, walk, monkeypatch):
    (tmp_path / "file").touch()
    database = CliRunner().invoke(
        main, ["db", "add", "-d", str(tmp_path / "file" / "db"), str(walk)]
    )
    assert database.stderr == f"priorfill: {tmp_path / 'file'}: File exists; check the path\n"
    name = tmp_path / ("y" * 300 + ".npz")
    long = CliRunner().invoke(main, ["fill", str(walk), "-o", str(name)])
    assert long.stderr == f"priorfill: {name}: File name too long; choose a shorter name\n"
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    removed = CliRunner().invoke(main, ["fill", str(walk), "-o", "out.npz"])
    assert removed.exit_code == 1
    assert removed.stderr.startswith("priorfill: the current folder was removed")


@pytest.mark.skipif(not WINDOWS, reason="other systems have one root, which is always there")
@pytest.mark.parametrize("root", ["\\\\no-such-server\\share\\", "Q:\\"])
def test_a_database_on_a_drive_or_share_that_is_gone(tmp_path: Path, root: str) -> None:
    truth, _ = make_demo_clip()
    write(tmp_path / "walk.c3d", truth)
    result = CliRunner().invoke(
        main, ["db", "add", "-d", f"{root}priors", str(tmp_path / "walk.c3d")]
    )
    assert result.exit_code == 1
    assert f"there is no {root}; check the drive, or the connection" in result.stderr


def test_the_root_of_a_path_is_missing_on_windows_only(monkeypatch: pytest.MonkeyPatch) -> None:
    error = FileNotFoundError(errno.ENOENT, "Path not found", "priors")
    assert error_line.system_error(error) == "priors: Path not found; check the path"
    monkeypatch.setattr(error_line, "_missing_root", lambda _: "Q:\\")
    assert error_line.system_error(error) == (
        "priors: there is no Q:\\; check the drive, or the connection to the share"
    )
