"""A review without a server: decisions, fills, and what is saved."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bids_files import NAME, columns_of, gappy, write_dataset
from c3d_bytes import LABELS, C3DFile, standing
from gappy import person
from reviews import write_walk

import priorfill as pf
from priorfill.errors import OptionError, OutputError, PriorfillError
from priorfill.filling.overrides_file import read_overrides
from priorfill.formats.c3d.layout import parse_layout
from priorfill.reviewing.session import FillStoppedError, ReviewSession

REFUSED = {"marker": "RANK", "do": "leave"}
LINEAR = {"marker": "LKNE", "frames": ":", "do": "linear", "note": "by eye"}
WRONG = {"marker": "STRN", "frames": "30-33", "do": "missing"}
SWAPPED = {"marker": "LTOE", "do": "swap", "with": "RTOE", "frames": "50-52"}


@pytest.fixture
def walk(here: Path) -> Path:
    return write_walk(Path("walk.c3d"))


def review(source: Path, output: str | None = None, **arguments: Any) -> ReviewSession:
    return ReviewSession(source, output, **({"method": "pchip"} | arguments))


def test_a_review_begins_with_a_fill_and_writes_nothing(walk: Path) -> None:
    session = review(walk)
    data = session.fill(session.decisions)
    assert data["mode"] == "review"
    assert data["can"] == {"refill": True, "save": True}
    assert sorted(data["markers"][gap["marker"]]["raw"] for gap in data["gaps"]) == [
        "LKNE",
        "RANK",
        "STRN",
    ]
    assert [path.name for path in Path().iterdir()] == ["walk.c3d"]


def test_a_saved_review_is_repeated_by_a_fill_byte_for_byte(walk: Path) -> None:
    before = walk.read_bytes()
    session = review(walk)
    session.fill([])
    decisions = [SWAPPED, WRONG, LINEAR, REFUSED]
    session.fill(decisions)
    saved = session.save(decisions)
    assert (saved.output, saved.overrides) == (
        Path("walk_filled.c3d"),
        Path("walk_filled.overrides.toml"),
    )
    assert saved.complete
    again = pf.fill_file(walk, "again.c3d", method="pchip", overrides=saved.overrides)
    assert Path("again.c3d").read_bytes() == saved.output.read_bytes()
    assert [note for note in again.result.notes if "made for" in note] == []
    assert read_overrides(saved.overrides).made_for == again.result.provenance.made_for
    assert walk.read_bytes() == before


def test_decisions_change_what_is_saved_and_nothing_else(walk: Path) -> None:
    session = review(walk)
    session.save([])
    plain = pf.read(session.output)
    session.save([REFUSED, LINEAR, WRONG])
    decided = pf.read(session.output)
    column = {label: number for number, label in enumerate(plain.labels)}
    assert decided.missing[20:30, column["RANK"]].all()
    assert not np.array_equal(
        plain.positions[10:14, column["LKNE"]], decided.positions[10:14, column["LKNE"]]
    )
    same = np.ones(plain.missing.shape, dtype=bool)
    same[10:14, column["LKNE"]] = same[20:30, column["RANK"]] = False
    same[29:33, column["STRN"]] = False
    assert np.array_equal(plain.positions[same], decided.positions[same])


def test_saving_fills_again_only_for_other_decisions(walk: Path) -> None:
    session = review(walk)
    seen: list[tuple[int, int]] = []
    session.fill([REFUSED])
    assert session.data["unsaved"]
    session.save([REFUSED | {"note": "seen"}], lambda done, total: seen.append((done, total)))
    assert seen == []
    assert not session.data["unsaved"]
    assert session.data["decisions"] == [REFUSED | {"note": "seen"}]
    assert "seen" in session.overrides.read_text(encoding="utf-8")
    assert session.fill([])["unsaved"]
    assert not session.fill([REFUSED | {"note": "seen"}])["unsaved"]
    session.save([], lambda done, total: seen.append((done, total)))
    assert seen[-1][0] == seen[-1][1]
    assert session._cache.hits > 0


def test_wrong_decisions_change_nothing(walk: Path) -> None:
    session = review(walk)
    session.fill([REFUSED])
    for wrong in (
        [{"marker": "NOPE", "do": "leave"}],
        [{"marker": "LKNE", "do": "nope"}],
        [{"marker": "LKNE", "frames": "900-901", "do": "leave"}],
        [WRONG, {"marker": "STRN", "frames": 31, "do": "leave"}],
        [{"do": "leave"}],
        [1],
    ):
        with pytest.raises(OptionError, match=r"overrides: gap"):
            session.fill(wrong)
    assert session.data["decisions"] == [REFUSED]


def test_a_stopped_fill_changes_nothing(walk: Path) -> None:
    session = review(walk)
    session.fill([])

    def stop(*_: int) -> None:
        raise FillStoppedError

    for callbacks in ({"progress": stop}, {"checkpoint": stop}):
        with pytest.raises(FillStoppedError):
            session.fill([{"marker": "RANK", "do": "gpr"}], **callbacks)
    assert session.data["decisions"] == []
    session.fill([LINEAR])


def test_a_review_continues_with_the_decisions_of_its_file(walk: Path) -> None:
    session = review(walk)
    session.save([REFUSED])
    with pytest.raises(OutputError, match="exists already"):
        review(walk)
    files = pf.FileOptions(overwrite=True)
    again = review(walk, files=files)
    assert again.decisions == [REFUSED]
    assert not again.fill(again.decisions)["unsaved"]
    again.save([])  # in place of the earlier one
    again.save([REFUSED])
    given = review(walk, "other.c3d", overrides=session.overrides, files=files)
    assert given.decisions == [REFUSED]
    assert given.overrides == session.overrides
    unsaved = review(walk, "new.c3d", overrides=read_overrides(session.overrides))
    assert unsaved.fill(unsaved.decisions)["unsaved"]


def test_a_review_first_finishes_what_a_killed_one_began(
    walk: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    saved = review(walk).save([REFUSED]).overrides
    content = saved.read_bytes()
    saved.unlink()

    def finish(folder: Path) -> None:
        (folder / saved).write_bytes(content)

    monkeypatch.setattr("priorfill.reviewing.session.finish_pairs", finish)
    assert review(walk, files=pf.FileOptions(overwrite=True)).decisions == [REFUSED]


def test_a_file_that_is_rewritten(here: Path) -> None:
    records = standing(40, step=0.5)
    records[10:20, 5] = [0, 0, 0, -1]
    Path("integers.c3d").write_bytes(C3DFile(records, LABELS, is_float=False, scale=0.5).bytes())
    for rewrite in (False, True):
        files = pf.FileOptions(rewrite=rewrite, overwrite=True)
        saved = review(Path("integers.c3d"), files=files).save([])
        assert parse_layout(saved.output.read_bytes(), "").is_float == rewrite


def test_sources_are_those_of_the_review(walk: Path) -> None:
    with pf.PriorDatabase.create("db") as made:
        made.add(person(seconds=2.0, rate=30.0, seed=9))
        (record,) = made.clips()
        pf.write("other.c3d", person(seconds=2.0, rate=30.0, seed=8))
    from_other = REFUSED | {"do": "gpr", "sources": "same-subject"}
    from_clip = REFUSED | {"do": "gpr", "sources": f"database:{record.name}"}
    for decision in (from_other, from_clip):
        with pytest.raises(OptionError, match="there is no"):
            review(walk).check([decision])
    session = review(walk, database="db", same_subject=["other.c3d"])
    session.check([from_other | {"sources": [from_other["sources"], from_clip["sources"]]}])
    assert session.fill([])["database_clips"] == [record.name]


def test_what_was_changed_in_the_meantime_is_not_replaced(walk: Path) -> None:
    session = review(walk)
    session.fill([])
    session.output.write_text("somebody else's", encoding="utf-8")
    with pytest.raises(OutputError, match="exists already"):
        session.save([])
    assert session.output.read_text(encoding="utf-8") == "somebody else's"
    session.output.unlink()
    session.save([])
    session.save([REFUSED])  # its own files
    session.overrides.write_text("# edited", encoding="utf-8")
    with pytest.raises(OutputError, match=r"walk_filled\.overrides\.toml: was changed after"):
        session.save([])
    session.overrides.unlink()
    session.save([])
    shutil.copy(walk, session.output)
    with pytest.raises(OutputError, match=r"walk_filled\.c3d: was changed after it was saved"):
        session.save([])
    session.output.unlink()
    session.save([])
    Path("walk.c3d").write_bytes(walk.read_bytes() + b"\0" * 512)
    saved = session.output.read_bytes()
    with pytest.raises(PriorfillError, match="changed since it was read"):
        session.save([REFUSED])
    assert session.output.read_bytes() == saved


@pytest.mark.parametrize("name", ["out.c3d", "out.toml"])
def test_a_file_to_save_that_becomes_the_source(walk: Path, name: str) -> None:
    session = review(walk, "out.c3d", overrides="out.toml", files=pf.FileOptions(overwrite=True))
    session.fill([])
    os.link(walk, name)
    with pytest.raises(OutputError, match="is the file that the clip was read from"):
        session.save([])


@pytest.mark.parametrize("suffix", [".npz", ".trc"])
def test_a_changed_source_is_noticed_in_other_formats(walk: Path, suffix: str) -> None:
    clip = pf.read(walk)
    source = Path(f"other{suffix}")
    pf.write(source, replace(clip, source=None))
    session = review(source)
    session.save([])
    pf.fill_file(source, f"again{suffix}", method="pchip")
    if suffix == ".trc":  # archives hold the time of writing
        assert (
            Path(f"again{suffix}").read_bytes().split(b"\n")[1:]
            == (session.output.read_bytes().split(b"\n")[1:])
        )
    pf.write(source, replace(clip, source=None, rate=60.0), overwrite=True)
    with pytest.raises(OutputError, match="changed since it was read"):
        session.save([REFUSED])


def test_outputs_are_checked_before_the_file_is_read(
    walk: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(OutputError, match="is the file that the clip was read from"):
        review(walk, "walk.c3d", files=pf.FileOptions(overwrite=True))
    with pytest.raises(OutputError, match="is the file that the clip was read from"):
        review(walk, overrides="walk.c3d", files=pf.FileOptions(overwrite=True))
    with pytest.raises(OptionError, match="no such output"):
        review(walk, files=pf.FileOptions(uncertainty="walk.csv"))
    with pytest.raises(OptionError, match="known are"):
        review(walk, "walk.nope")
    with pytest.raises(OutputError, match=r"out\.npz: is the file for the decisions, too"):
        review(walk, "out.npz", overrides="out.npz")
    with pytest.raises(OptionError, match="no such output"):
        review(walk, files=pf.FileOptions(write_overrides="gaps.toml"))
    opened = Path.open

    def locked(path: Path, *arguments: Any) -> Any:
        if path.parent.name == "locked":
            raise PermissionError(13, "Permission denied")
        return opened(path, *arguments)

    Path("locked").mkdir()
    monkeypatch.setattr(Path, "open", locked)
    with pytest.raises(OutputError, match=r"gaps\.toml: cannot be written"):
        review(walk, overrides="locked/gaps.toml")
    Path("locked").rmdir()
    assert [path.name for path in Path().iterdir()] == ["walk.c3d"]


@pytest.mark.skipif(os.name == "nt", reason="all names of Windows are Unicode")
def test_a_name_that_is_no_text(walk: Path) -> None:
    source = Path(os.fsdecode(b"walk\xff.c3d"))
    try:
        walk.rename(source)
    except OSError:
        pytest.skip("the file system takes no such name")
    saved = review(source).save([REFUSED])
    again = pf.fill_file(source, "again.c3d", method="pchip", overrides=saved.overrides)
    assert Path("again.c3d").read_bytes() == saved.output.read_bytes()
    assert again.result.notes == ()


def test_subjects_of_one_file(here: Path) -> None:
    clips = {name: pf.read(write_walk(Path(f"{name}.npz"))) for name in ("Anna", "Ben")}
    both = pf.Clip(
        np.concatenate([clip.positions for clip in clips.values()], axis=1),
        tuple(f"{name}:{label}" for name, clip in clips.items() for label in clip.labels),
        30.0,
    )
    pf.write("two.c3d", both)
    session = review(Path("two.c3d"))
    assert session.fill([])["subjects"] == ["Anna", "Ben"]
    saved = session.save([REFUSED | {"subject": "Ben"}])
    filled = {clip.subject: clip for clip in pf.read_subjects(saved.output)}
    assert {name: clip.missing.sum() for name, clip in filled.items()} == {"Anna": 0, "Ben": 10}
    pf.fill_file("two.c3d", "again.c3d", method="pchip", overrides=saved.overrides)
    assert Path("again.c3d").read_bytes() == saved.output.read_bytes()


def test_a_review_in_a_bids_dataset_saves_a_derivative(tmp_path: Path) -> None:
    source = write_dataset(tmp_path, columns_of(gappy()))
    session = ReviewSession(source, method="linear")
    folder = tmp_path / "derivatives" / "priorfill"
    name = f"{NAME}_desc-filled"
    assert session.output == folder / "sub-01" / "motion" / f"{name}_motion.tsv"
    for _ in range(2):  # what this review saved may be replaced
        session.save([])
    assert not pf.read(session.output).missing.any()
    ends = ("channels.tsv", "error.tsv", "mask.tsv", "motion.json", "motion.overrides.toml")
    assert {path.name for path in session.output.parent.iterdir()} == {
        f"{name}_motion.tsv",
        *(f"{name}_{end}" for end in ends),
    }
    with pytest.raises(OutputError, match="exists already"):
        ReviewSession(source, method="linear")


def test_a_review_saves_only_a_bids_file_as_one(walk: Path) -> None:
    with pytest.raises(OptionError, match="a review saves only a Motion-BIDS file as one"):
        review(walk, "sub-1_task-a_tracksys-b_motion.tsv")
