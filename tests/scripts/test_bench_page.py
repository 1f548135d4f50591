"""The benchmark of report pages runs, and says so where there is no browser."""

import subprocess
import sys

import pytest
from browser import find_chromium
from scripted import SCRIPTS, load_script

ARGUMENTS = ["page", "--pages", "12x60", "--markers", "12", "--repeat", "1", "--play", "0.1",
             "--trials", "20"]  # fmt: skip


def test_pages_are_measured() -> None:
    pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    if find_chromium() is None:
        pytest.skip("no Chromium: install it, or let PRIORFILL_CHROMIUM name it")
    (script,) = SCRIPTS.rglob("page.py")
    # in a process of its own: Playwright runs once a thread, and other tests may have it open
    command = [sys.executable, script, *ARGUMENTS[1:]]
    done = subprocess.run(command, capture_output=True, encoding="utf-8", check=False)
    assert done.returncode in (0, 1), done.stderr  # a busy computer exceeds the bounds
    lines = done.stdout.splitlines()
    assert lines[2].split()[:2] == ["12", "60"]
    assert len(lines[2].split()) == 9
    assert lines[4].split()[0] == "12"
    assert lines[6].split()[0] == "20"
    assert lines[7].startswith("bounds 0.5 MB for 41 x 3000")


def test_without_a_browser_nothing_is_measured(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    script = load_script("page")
    monkeypatch.setattr("sys.argv", ARGUMENTS)
    monkeypatch.setattr(script, "find_browser", lambda: None)
    assert script.main() == 0
    assert "nothing was measured" in capsys.readouterr().out
