"""Tab completion, through the protocol between shells and click."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from db_cli import small_clip

from priorfill.cli import completion, main
from priorfill.database import ClipOrigin, PriorDatabase
from priorfill.evaluation import protocols
from priorfill.methods import METHODS


def complete(line: str, shell: str = "bash") -> list[str]:
    """What a shell offers at the end of a line."""
    words = line.split(" ")
    number = len(words) - 1
    environment = {
        "_PRIORFILL_COMPLETE": f"{shell}_complete",
        "COMP_WORDS": line,
        "COMP_CWORD": words[-1] if shell == "fish" else str(number),
    }
    done = CliRunner().invoke(main, [], env=environment, prog_name="priorfill")
    assert done.exit_code == 0, done.output
    return [answer for answer in done.stdout.splitlines() if answer]


def offered(line: str) -> list[str]:
    return [answer.removeprefix("plain,") for answer in complete(line)]


@pytest.fixture(scope="module")
def priors(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("my priors") / "db"
    with PriorDatabase.create(folder) as database:
        for seed, (name, subject, session) in enumerate(
            (("walk1", "Anna", "mon"), ("walk 2", "Anna", "tue"), ("run", "Jörg B", ""))
        ):
            database.add(small_clip(name, seed=seed), ClipOrigin(subject, session))
    return folder


def test_commands_and_options() -> None:
    assert offered("priorfill in") == ["inspect"]
    assert "compact" in offered("priorfill db ")
    assert offered("priorfill fill --marker-") == ["--marker-set"]


def test_names_of_the_program() -> None:
    assert offered("priorfill fill --method ") == ["auto", *METHODS]
    assert offered("priorfill demo -m li")[0] == "linear"
    assert offered("priorfill evaluate -m spline,lin") == ["spline,linear"]
    assert offered("priorfill evaluate -m al") == ["all"]
    assert offered("priorfill methods gp") == ["gpr"]
    assert offered("priorfill evaluate --protocol ") == [*protocols.PROTOCOLS]
    assert offered("priorfill evaluate --groups arms,left_l") == ["arms,left_leg"]
    assert set(offered("priorfill inspect --marker-set ")) >= {"baumann41", "plug-in-gait"}
    assert offered("priorfill db fetch c") == ["cmu"]


def test_groups_are_those_of_the_protocol() -> None:
    for group in completion.GROUPS:
        protocols.make_protocol("groups", groups=(group,))


def test_files_and_folders_are_left_to_the_shell() -> None:
    assert complete("priorfill fill w") == ["file,w"]
    assert complete("priorfill fill w.c3d -d l") == ["dir,l"]
    assert complete("priorfill inspect --marker-set my") == ["file,my"]


def test_clips_of_the_database(priors: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(priors.parent)
    with PriorDatabase.open(priors) as database:
        blank = next(clip.content[:8] for clip in database.clips() if clip.name == "walk 2")
    assert offered("priorfill db remove -d db wa") == [blank, "walk1"]
    assert offered("priorfill fill w.c3d -d db --exclude-motion r") == ["run"]
    assert offered("priorfill db list -d db --subject ") == ["Anna"]
    assert offered("priorfill db edit -d db --of-session t") == ["tue"]
    assert offered("priorfill db remove wa") == []  # no database
    for name in ("HOME", "USERPROFILE"):
        monkeypatch.setenv(name, str(priors.parent))
    assert offered("priorfill db remove -d ~/db r") == ["run"]


@pytest.mark.windows
def test_a_path_of_windows_in_powershell(priors: Path) -> None:
    line = f"priorfill db remove -d '{priors}' wal"
    environment = {
        "_PRIORFILL_COMPLETE": "powershell_complete",
        "COMP_WORDS": line,
        "COMP_CWORD": "5",
    }
    done = CliRunner().invoke(main, [], env=environment, prog_name="priorfill")
    assert done.stdout.splitlines()[3:6] == ["plain", "walk1", "Anna"]
    environment["COMP_WORDS"] = f"priorfill db list -d '{priors}' --name 'wal"  # it goes on
    environment["COMP_CWORD"] = "6"
    done = CliRunner().invoke(main, [], env=environment, prog_name="priorfill")
    assert done.stdout.splitlines()[3:6] == ["plain", "walk1", "Anna"]


def test_powershell_completes_paths_itself() -> None:
    """It does where the program names nothing, and quotes them, unlike click's script."""
    environment = {
        "_PRIORFILL_COMPLETE": "powershell_complete",
        "COMP_WORDS": r"priorfill inspect C:\data\wa",
        "COMP_CWORD": "2",
    }
    done = CliRunner().invoke(main, [], env=environment, prog_name="priorfill")
    assert (done.exit_code, done.stdout.strip()) == (0, "")


def test_powershell_reads_names_as_utf_8() -> None:
    """By default, it takes the code page of the console, such as cp850."""
    environment = {"_PRIORFILL_COMPLETE": "powershell_source"}
    script = CliRunner().invoke(main, [], env=environment, prog_name="priorfill").stdout
    kept, changed, called, restored = (
        script.index(text)
        for text in (
            "$prev_encoding = [Console]::OutputEncoding",
            "[Console]::OutputEncoding = [System.Text.Encoding]::UTF8",
            "$response = & priorfill",
            "[Console]::OutputEncoding = $prev_encoding",
        )
    )
    assert kept < changed < called < restored
    assert script.count("{") == script.count("}")


@pytest.mark.parametrize("contents", [b"", b"no database", None])
def test_silent_on_damaged_databases(here: Path, contents: bytes | None) -> None:
    (here / "db").mkdir()
    if contents is not None:
        (here / "db" / "catalogue.sqlite").write_bytes(contents)
    assert offered("priorfill db remove -d db w") == []
    assert offered("priorfill db remove -d nowhere w") == []
    assert offered("priorfill db list -d db --subject w") == []
    assert [path.name for path in here.iterdir()] == ["db"]


def test_other_shells() -> None:
    for shell, first in (("zsh", "plain\ngpr\n"), ("fish", "plain,gpr\t")):
        lines = complete("priorfill methods gp", shell)
        assert "\n".join(lines).startswith(first)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish", "powershell"])
def test_scripts(shell: str) -> None:
    environment = {"_PRIORFILL_COMPLETE": f"{shell}_source"}
    done = CliRunner().invoke(main, [], env=environment, prog_name="priorfill")
    assert done.exit_code == 0
    assert "priorfill" in done.stdout


def test_numpy_is_not_loaded(priors: Path) -> None:
    program = (
        "import sys, atexit\n"
        "atexit.register(lambda: print('numpy' in sys.modules))\n"
        "from priorfill.cli import main; main(prog_name='priorfill')"
    )
    for line, number in ((f"priorfill db remove -d '{priors}' r", 5), ("priorfill fill -m g", 3)):
        done = subprocess.run(
            [sys.executable, "-c", program],
            env=os.environ
            | {
                "_PRIORFILL_COMPLETE": "bash_complete",
                "COMP_WORDS": line,
                "COMP_CWORD": str(number),
            },
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert done.stdout.splitlines()[-1] == "False", done.stderr
        assert done.stdout.startswith("plain,")
