"""The command ``review``: a process with a server, how it ends, and what it says."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from reviews import ReviewClient, write_walk

import priorfill as pf
from priorfill.cli import main
from priorfill.cli.review import review

SCRIPT = """
import _thread, signal, threading, time
from pathlib import Path
from priorfill.cli import main

# shells start background jobs with SIGINT ignored
signal.signal(signal.SIGINT, signal.default_int_handler)

def interrupt():
    while not Path("interrupt").exists():
        time.sleep(0.05)
    _thread.interrupt_main()  # as Ctrl-C, also on Windows

threading.Thread(target=interrupt, daemon=True).start()
main()
"""
"""The command line; a file called ``interrupt`` is Ctrl-C."""

REFUSED = {"marker": "RANK", "do": "leave"}


@contextmanager
def started(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, "review", *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def test_a_review_from_the_first_look_to_ctrl_c(here: Path) -> None:
    write_walk(Path("walk.c3d"))
    options = ["walk.c3d", "-m", "linear", "--frames", "1-38"]
    with started(*options, "--no-browser", "-o", "out/filled.c3d") as process:
        assert process.stdout is not None
        line = process.stdout.readline().strip()
        address = line.removeprefix("review: ")
        client = ReviewClient.of(address)
        assert address == f"http://127.0.0.1:{client.port}/{client.token}/"
        assert b'"command":["priorfill","fill","walk.c3d"' in client.get().body
        assert b'"overrides":"out/filled.overrides.toml"' in client.get().body.replace(
            b"\\\\", b"/"
        )
        answer = client.post("check", {"decisions": [REFUSED | {"options": {"x": 1}}]})
        assert answer.error.startswith("decision 1: ")
        assert "saved" in client.post("save", {"decisions": [REFUSED]}).lines[-1]
        Path("interrupt").touch()
        output, errors = process.communicate(timeout=60)
    assert process.returncode == 0  # a refused gap is not incomplete
    saved = Path("out/filled.c3d"), Path("out/filled.overrides.toml")
    assert output == f"saved {saved[0]} and {saved[1]}\n"
    assert client.token not in errors
    assert "Ctrl-C ends the review" in errors
    again = [*options, "-o", "again.c3d", "--overrides", str(saved[1])]
    assert CliRunner().invoke(main, ["fill", *again]).exit_code == 0
    assert Path("again.c3d").read_bytes() == saved[0].read_bytes()


def invoke(monkeypatch: pytest.MonkeyPatch, *arguments: str, **patches: Any) -> Any:
    """Run the command with a server whose page is never opened."""
    from priorfill.reviewing.server import ReviewServer

    monkeypatch.setattr(ReviewServer, "wait", patches.get("wait", lambda server: None))
    return CliRunner().invoke(main, ["review", *arguments])


def test_the_command_that_repeats_a_fill(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_walk(Path("walk.c3d"))
    commands: list[tuple[str, ...]] = []
    given = ["--set", "neighbours=5", "--markers", "L*,STRN", "--markers", "C7", "--frames", "2:"]
    given += ["--max-gap", "0.5", "--up", "+Z", "--reject-artefacts", "--method", "neighbours"]
    given += ["--keep-zeros", "--skip-edges"]

    def wait(server: Any) -> None:
        commands.append(server.session.command)

    done = invoke(monkeypatch, "walk.c3d", "--overwrite", "--no-browser", *given, wait=wait)
    assert done.exit_code == 0, done.output
    (words,) = commands
    assert words[:3] == ("priorfill", "fill", "walk.c3d")
    context = review.make_context("review", ["walk.c3d", *given])
    again = review.make_context("review", list(words[2:]))
    assert again.params == context.params


def test_a_saved_result_with_gaps_has_a_status(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_walk(Path("walk.c3d"))
    options = ["walk.c3d", "-m", "linear", "--max-error", "0.001", "--no-browser"]
    done = invoke(monkeypatch, *options, wait=lambda server: server.session.save([]))
    assert done.exit_code == 3
    assert "saved walk_filled.c3d and walk_filled.overrides.toml" in done.output
    done = invoke(monkeypatch, *options, "--overwrite")
    assert done.exit_code == 0
    assert "nothing was saved" in done.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nope.c3d"], "there is no such file"),
        (["walk.c3d", "-o", "walk.c3d", "--overwrite"], "is the file that the clip was read from"),
        (["walk.c3d", "-o", "old.c3d"], "old.c3d: exists already; choose another name or use --ov"),
        (["walk.c3d", "--markers", "NOPE"], "no marker is called 'NOPE'"),
        (["walk.c3d", "--trust-filled"], "--trust-filled needs a database"),
        (["walk.c3d", "--overrides", "old.c3d", "--overwrite"], "old.c3d: "),
        (["walk.c3d", "--port", "70000"], "--port"),
    ],
)
def test_what_cannot_work_is_said_before_the_page(
    here: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], message: str
) -> None:
    write_walk(Path("walk.c3d"))
    Path("old.c3d").write_bytes(b"old")
    done = invoke(monkeypatch, *arguments, "-m", "linear", "--no-browser")
    assert done.exit_code in (1, 2)
    assert message in " ".join(done.output.split())
    assert "http" not in done.output


def test_without_the_extra_one_line_names_it(here: Path) -> None:
    script = (
        "import sys; sys.modules['uvicorn'] = None\n"
        "import priorfill as pf\n"
        "try: pf.review('nope.c3d')\n"
        "except pf.PriorfillError as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, encoding="utf-8")
    assert done.stdout == (
        'a review needs uvicorn, which is not installed: pip install "priorfill[review]"\n'
    )


def test_the_browser_gets_a_link_that_works_once(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from priorfill.reviewing import start
    from priorfill.reviewing.server import ReviewServer

    write_walk(Path("walk.c3d"))
    opened: list[str] = []
    monkeypatch.setattr(start.webbrowser, "open", opened.append)
    monkeypatch.setenv("BROWSER", "a browser")
    addresses: list[tuple[str, bool]] = []

    def wait(server: ReviewServer) -> None:
        while not opened:
            pass
        client = ReviewClient.of(server.address)
        assert client.token not in opened[0]
        path = opened[0].partition(f":{server.port}")[2]
        assert client.send("GET", path).status == 303
        assert client.send("GET", path).status == 404
        raise KeyboardInterrupt

    monkeypatch.setattr(ReviewServer, "wait", wait)
    page = pf.ReviewOptions(started=lambda *one: addresses.append(one))
    assert pf.review("walk.c3d", method="linear", page=page) is None
    ((address, opens),) = addresses
    assert address.startswith("http://127.0.0.1:")
    assert opens
    monkeypatch.delenv("BROWSER")
    if sys.platform.startswith("linux"):  # a browser of the terminal cannot show the page
        for name in ("DISPLAY", "WAYLAND_DISPLAY"):
            monkeypatch.delenv(name, raising=False)
        assert not start._has_browser()
