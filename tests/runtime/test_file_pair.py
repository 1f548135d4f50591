"""A file and a text: both are replaced or neither, whenever the process is killed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from priorfill.errors import OutputError
from priorfill.runtime import atomic_file, file_pair
from priorfill.runtime.file_pair import file_state, finish_pairs, write_pair


class KilledError(BaseException):
    """Ends a writer as a kill does: nothing is cleaned up."""


def save(folder: Path, content: str, *, overwrite: bool = True) -> None:
    write_pair(
        folder / "out.c3d",
        lambda path: path.write_text(content, encoding="utf-8"),
        folder / "out.toml",
        content.encode(),
        overwrite=overwrite,
    )


def contents(folder: Path) -> list[str | None]:
    paths = (folder / "out.c3d", folder / "out.toml")
    return [path.read_text(encoding="utf-8") if path.exists() else None for path in paths]


def test_both_files_are_written_and_replaced(tmp_path: Path) -> None:
    save(tmp_path, "old", overwrite=False)
    assert contents(tmp_path) == ["old", "old"]
    with pytest.raises(OutputError, match="exists already"):
        save(tmp_path, "new", overwrite=False)
    (tmp_path / "out.c3d").chmod(0o640)
    mode = (tmp_path / "out.c3d").stat().st_mode
    save(tmp_path, "new")
    assert contents(tmp_path) == ["new", "new"]
    assert (tmp_path / "out.c3d").stat().st_mode == mode
    assert len(list(tmp_path.iterdir())) == 2
    with pytest.raises(OutputError, match="is the name of both files"):
        write_pair(tmp_path / "a", Path.touch, tmp_path / "a", b"")


@pytest.mark.parametrize("name", ["out.c3d", "out.toml"])
def test_a_file_that_appears_while_writing_stays(tmp_path: Path, name: str) -> None:
    def write(path: Path) -> None:
        path.write_text("new", encoding="utf-8")
        (tmp_path / name).write_text("somebody else's", encoding="utf-8")

    with pytest.raises(OutputError, match=name):
        write_pair(tmp_path / "out.c3d", write, tmp_path / "out.toml", b"new")
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text(encoding="utf-8") == "somebody else's"


def test_an_interrupt_between_the_files_does_not_part_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save(tmp_path, "old")
    calls = []

    def interrupted(temporary: Path, target: Path) -> None:
        calls.append(target.name)
        if target.name == "out.c3d" and calls.count("out.c3d") == 1:
            raise KeyboardInterrupt
        atomic_file.finish_file(temporary, target)

    monkeypatch.setattr(file_pair, "finish_file", interrupted)
    with pytest.raises(KeyboardInterrupt):
        save(tmp_path, "new")
    assert contents(tmp_path) == ["new", "new"]
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("existing", [True, False])
def test_a_failure_leaves_both_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, existing: bool
) -> None:
    if existing:
        save(tmp_path, "old")
    before = contents(tmp_path)

    def held(temporary: Path, target: Path) -> None:
        if target.name == "out.c3d":
            raise PermissionError(13, "held")
        atomic_file.finish_file(temporary, target)

    monkeypatch.setattr(file_pair, "finish_file", held)
    with pytest.raises(OutputError, match=r"out\.c3d: cannot be written"):
        save(tmp_path, "new")
    assert contents(tmp_path) == before
    assert len(list(tmp_path.iterdir())) == sum(one is not None for one in before)


def test_what_the_writer_raises_has_the_name_of_the_file(tmp_path: Path) -> None:
    def write(path: Path) -> None:
        raise OutputError(f"{path}: cannot be written")

    with pytest.raises(OutputError) as error:
        write_pair(tmp_path / "out.c3d", write, tmp_path / "out.toml", b"")
    assert str(error.value) == f"{tmp_path / 'out.c3d'}: cannot be written"
    assert not list(tmp_path.iterdir())


def kill_at(step: int, monkeypatch: pytest.MonkeyPatch, folder: Path, content: str) -> bool:
    """Save, and stop as a kill does before one of the renames; return whether it was reached."""
    steps = [0]
    replace = Path.replace

    def counted(self: Path, target: Path) -> Path:
        steps[0] += 1
        if steps[0] == step:
            raise KilledError
        return replace(self, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", counted)
        patch.setattr(Path, "unlink", lambda self, missing_ok=False: None)
        patch.setattr(file_pair, "remove_folder", lambda path: None)
        patch.setattr(file_pair, "_finish_one", lambda path: None)
        try:
            save(folder, content)
        except KilledError:
            return True
    return False


def test_what_a_killed_process_began_is_finished_or_undone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    outcomes = []
    for step in range(1, 9):
        folder = tmp_path / str(step)
        folder.mkdir()
        save(folder, "old")
        if not kill_at(step, monkeypatch, folder, "new"):
            break
        with monkeypatch.context() as patch:
            patch.setattr(atomic_file, "is_running", lambda process: False)
            finish_pairs(folder)
            assert contents(folder) in (["old", "old"], ["new", "new"])
            if contents(folder) == ["new", "new"]:
                assert len(list(folder.iterdir())) == 2
            outcomes.append(contents(folder)[0])
            save(folder, "newest")
            assert contents(folder) == ["newest", "newest"]
            assert len(list(folder.iterdir())) == 2
    assert outcomes == ["old", "new", "new"]  # before the note; before the text; before the file


def test_the_next_pair_finishes_that_of_a_killed_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save(tmp_path, "old")
    assert kill_at(3, monkeypatch, tmp_path, "new")
    monkeypatch.setattr(atomic_file, "is_running", lambda process: False)
    write_pair(tmp_path / "b.c3d", Path.touch, tmp_path / "b.toml", b"")
    assert contents(tmp_path) == ["new", "new"]


def test_a_text_that_is_written_after_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The process was killed after the file had its name, and the old text was restored."""
    save(tmp_path, "old")
    assert kill_at(2, monkeypatch, tmp_path, "new")
    (note,) = tmp_path.glob("*.pair")
    (waiting,) = note.with_suffix("").glob("out.c3d")
    waiting.replace(tmp_path / "out.c3d")
    monkeypatch.setattr(atomic_file, "is_running", lambda process: False)
    finish_pairs(tmp_path)
    assert contents(tmp_path) == ["new", "new"]


def test_files_that_were_changed_after_a_kill_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save(tmp_path, "old")
    assert kill_at(2, monkeypatch, tmp_path, "new")
    (tmp_path / "out.c3d").write_text("own", encoding="utf-8")  # as long as before
    monkeypatch.setattr(atomic_file, "is_running", lambda process: False)
    finish_pairs(tmp_path)
    assert contents(tmp_path) == ["own", "old"]
    assert not list(tmp_path.glob("*.pair"))


def test_what_a_running_process_writes_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save(tmp_path, "old")
    assert kill_at(3, monkeypatch, tmp_path, "new")
    left = sorted(tmp_path.iterdir())
    finish_pairs(tmp_path)
    assert sorted(tmp_path.iterdir()) == left


@pytest.mark.parametrize(
    "change",
    [
        {"output": "../out.c3d"},
        {"waiting": "../../out.c3d"},
        {"text_path": "out.toml"},
        {"format": 2},
        {"text": "bmV3*"},
    ],
    ids=str,
)
def test_a_note_that_names_other_places_is_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: dict[str, object]
) -> None:
    folder = tmp_path / "clips"
    folder.mkdir()
    monkeypatch.chdir(folder)
    save(folder, "old")
    assert kill_at(2, monkeypatch, folder, "new")
    (note,) = folder.glob("*.pair")
    (tmp_path / "out.c3d").write_text("precious", encoding="utf-8")
    values = json.loads(note.read_text(encoding="utf-8")) | change
    values["before"] = file_state(folder / values["output"])
    note.write_text(json.dumps(values), encoding="utf-8")
    monkeypatch.setattr(atomic_file, "is_running", lambda process: False)
    finish_pairs(folder)
    assert contents(folder) == ["old", "old"]
    assert (tmp_path / "out.c3d").read_text(encoding="utf-8") == "precious"
    assert not [path for path in folder.iterdir() if path.is_dir() or path.suffix == ".pair"]


def test_a_note_that_cannot_be_followed_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save(tmp_path, "old")
    assert kill_at(2, monkeypatch, tmp_path, "new")
    monkeypatch.setattr(atomic_file, "is_running", lambda process: False)

    def held(temporary: Path, target: Path) -> None:
        raise PermissionError(13, "held")

    with monkeypatch.context() as patch:
        patch.setattr(file_pair, "finish_file", held)
        finish_pairs(tmp_path)
    finish_pairs(tmp_path)
    assert contents(tmp_path) == ["new", "new"]


def test_damaged_notes_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(atomic_file, "is_running", lambda process: False)
    name = atomic_file.temporary_name("")
    good = '{"waiting": "a", "output": "b", "text_path": 1, "text": "?", "before": null, '
    for content in (
        good + '"text_before": null}',
        "",
        "[]",
        "{}",
        '{"output": 1}',
        '{"waiting": "../x", "output": "y"',
        "[" * 100_000,
    ):
        (tmp_path / f"{name}.pair").write_text(content, encoding="utf-8")
        finish_pairs(tmp_path)
        assert not list(tmp_path.iterdir())
