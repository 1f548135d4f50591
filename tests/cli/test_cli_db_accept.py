"""``priorfill db accept``: how filled samples are found, and what is replaced."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from c3d_bytes import LABELS, C3DFile, standing
from db_cli import gappy_and_filled, run, small_clip, with_residuals, write_clip

from priorfill.clip import Clip
from priorfill.database import ClipRecord, PriorDatabase
from priorfill.formats import read, write


def clips(place: str = "db") -> tuple[ClipRecord, ...]:
    with PriorDatabase.open(place) as database:
        return database.clips()


def stored_mask(place: str = "db") -> np.ndarray:
    """Samples of level 0 that count as filled, of the only clip in the database."""
    with PriorDatabase.open(place) as database:
        (record,) = database.clips()
        filled = database.filled(record)
        assert filled is not None
        return filled


@pytest.fixture
def pair(here: Path) -> tuple[Clip, Clip, np.ndarray]:
    """`gappy.c3d`, `filled.c3d`, and their clips; four frames give one of level 0."""
    gappy, filled, mask = gappy_and_filled(small_clip(), 40, 80)
    write("gappy.c3d", gappy)
    write("filled.c3d", filled)
    return gappy, filled, mask


def assert_mask(place: str = "db", start: int = 10, stop: int = 20) -> None:
    expected = np.zeros((30, 4), dtype=bool)
    expected[start:stop, 3] = True
    np.testing.assert_array_equal(stored_mask(place), expected)


def test_by_the_original(here: Path, pair: object) -> None:
    result = run(
        "db", "accept", "-d", "db", "filled.c3d", "--original", "gappy.c3d", "--method", "splines"
    )
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout == (
        "accepted filled.c3d: 40 samples filled (8.3 %)\naccepted 1 clip, 1.00 s of motion\n"
    )
    assert_mask()
    (record,) = clips()
    assert (record.name, record.filled_by) == ("filled", "splines")
    assert run("db", "verify", "-d", "db").exit_code == 0


def test_by_residuals(here: Path) -> None:
    _, filled, mask = gappy_and_filled(small_clip())
    with_residuals(here / "filled.c3d", filled, mask)
    result = run("db", "accept", "-d", "db", "filled.c3d")
    assert result.exit_code == 0
    assert "40 samples filled" in result.stdout
    assert_mask()
    assert clips()[0].filled_by == "unknown"


def test_by_the_version_with_gaps(here: Path, pair: object) -> None:
    added = ["--subject", "anna", "--session", "2", "--licence", "CC0", "--credit", "lab"]
    run("db", "add", "-d", "db", *added, "gappy.c3d")
    result = run("db", "accept", "-d", "db", "filled.c3d", "--licence", "CC-BY")
    assert result.exit_code == 0
    # of a gap only the frames of level 0 are known, and what is between them
    assert result.stdout == (
        "accepted filled.c3d: 37 samples filled (7.7 %), in place of gappy\n"
        "accepted 1 clip, 1.00 s of motion\n"
    )
    assert_mask()
    (record,) = clips()
    assert (record.subject, record.session) == ("anna", "2")
    assert (record.licence, record.credit) == ("CC-BY", "lab")


@pytest.mark.parametrize("rate", [30.0, 50.0, 60.0, 100.0, 240.0])
def test_by_the_version_with_gaps_at_any_rate(rate: float, here: Path) -> None:
    clip = small_clip(frames=int(2 * rate), rate=rate)
    gappy, filled, _ = gappy_and_filled(clip, int(0.5 * rate), int(0.9 * rate))
    write("gappy.c3d", gappy)
    write("filled.c3d", filled)
    for place in ("one", "two"):
        run("db", "add", "-d", place, "gappy.c3d")
    with PriorDatabase.open("one") as database:
        (record,) = database.clips()
        gone = np.isnan(database.positions(record)[..., 0])
    assert run("db", "accept", "-d", "one", "filled.c3d").exit_code == 0
    np.testing.assert_array_equal(stored_mask("one"), gone)
    run("db", "accept", "-d", "two", "filled.c3d", "--original", "gappy.c3d")
    np.testing.assert_array_equal(stored_mask("two"), gone)


def test_by_an_earlier_fill(here: Path, pair: tuple[Clip, Clip, np.ndarray]) -> None:
    run("db", "accept", "-d", "db", "filled.c3d", "--original", "gappy.c3d")
    _, filled, mask = pair
    write("better.c3d", filled.with_positions(filled.positions + 5 * mask[..., None]))
    result = run("db", "accept", "-d", "db", "better.c3d", "--method", "gpr")
    assert result.exit_code == 0
    assert "in place of filled" in result.stdout
    assert_mask()
    assert [record.name for record in clips()] == ["better"]


def test_unknown_filled_samples(here: Path, pair: object) -> None:
    text = (
        "priorfill: filled.c3d: neither its residuals nor the database show which samples were "
        "filled; give the file it was filled from (--original IN.c3d)\n"
    )
    result = run("db", "accept", "-d", "db", "filled.c3d")
    assert (result.exit_code, result.stderr) == (1, text)
    assert result.stdout == "accepted 0 clips, could not accept 1\n"
    assert not (here / "db").exists()
    # nor if the database has another recording, or only a part of this one
    run("db", "add", "-d", "db", write_clip(here / "other.c3d", 5))
    clip = small_clip()
    write("part.c3d", Clip(clip.positions[:60], clip.labels, clip.rate))
    run("db", "add", "-d", "db", "part.c3d")
    result = run("db", "accept", "-d", "db", "filled.c3d")
    assert (result.exit_code, result.stderr) == (1, text)
    assert sorted(record.name for record in clips()) == ["other", "part"]


def test_the_original_takes_precedence_over_residuals(here: Path) -> None:
    """Previously interpolated samples count too; filled samples need not have residual 0."""
    clip = small_clip()
    gappy, filled, mask = gappy_and_filled(clip, 40, 60)
    before = np.zeros_like(mask)
    before[100:112, 0] = True
    with_residuals(here / "gappy.c3d", gappy, before)
    with_residuals(here / "filled.c3d", filled, before)
    result = run("db", "accept", "-d", "db", "filled.c3d", "--original", "gappy.c3d")
    assert "32 samples filled" in result.stdout
    expected = np.zeros((30, 4), dtype=bool)
    expected[10:15, 3] = expected[25:28, 0] = True
    np.testing.assert_array_equal(stored_mask(), expected)


def test_many_with_a_folder_of_originals(here: Path) -> None:
    for folder in ("takes", "filled"):
        (here / folder).mkdir()
    for seed, name in enumerate(("a", "b", "c")):
        gappy, filled, _ = gappy_and_filled(small_clip(name, seed))
        write(f"takes/{name}.c3d", gappy)
        write(f"filled/{name}.c3d", filled)
    (here / "takes" / "c.c3d").unlink()
    result = run("db", "accept", "-d", "db", "filled", "--original", "takes")
    assert result.exit_code == 1
    assert result.stderr == (
        f"priorfill: {Path('filled/c.c3d')}: there is no {Path('takes/c.c3d')}, the original "
        "it was filled from; give that file with --original\n"
    )
    assert (
        result.stdout.splitlines()[-1] == "accepted 2 clips, 2.00 s of motion, could not accept 1"
    )
    assert sorted(record.name for record in clips()) == ["a", "b"]


def test_one_original_for_many(here: Path, pair: object) -> None:
    for paths in (["filled.c3d", "gappy.c3d"], ["."]):
        result = run("db", "accept", "-d", "db", *paths, "--original", "gappy.c3d")
        assert result.exit_code == 2
        assert "--original IN.c3d goes with one filled file" in result.stderr


def test_twice(here: Path, pair: object) -> None:
    line = ["db", "accept", "-d", "db", "filled.c3d", "--original", "gappy.c3d"]
    assert run(*line).exit_code == 0
    result = run(*line)
    assert result.exit_code == 0
    assert result.stdout == (
        "skipped filled.c3d: is in the database already (as filled); nothing to do\n"
        "accepted 0 clips, skipped 1 that is there already\n"
    )


def other_originals() -> dict[str, tuple[Clip, str]]:
    gappy, _, _ = gappy_and_filled(small_clip())
    moved, lost = gappy.positions.copy(), gappy.positions.copy()
    moved[20, 1, 2] += 0.2
    lost[:, 3] = np.nan
    rest = (gappy.labels, gappy.rate)
    return {
        "moved": (gappy.with_positions(moved), "it has another position of RASI in frame 21"),
        "longer": (Clip(np.vstack([moved, moved]), *rest), "it has 120 frames, not 240"),
        "slower": (Clip(gappy.positions, gappy.labels, 60.0), "it has 120 Hz, not 60 Hz"),
        "renamed": (
            Clip(gappy.positions, ("LASI", "RASI", "SACR", "T10"), 120.0),
            "it has marker C7, which is not in renamed",
        ),
        "fewer": (
            Clip(gappy.positions[:, :3], gappy.labels[:3], 120.0),
            "it has marker C7, which is not in fewer",
        ),
        "more": (
            Clip(np.hstack([moved, moved[:, :1]]), (*gappy.labels, "T10"), 120.0),
            "it has not marker T10, which is in more",
        ),
    }


@pytest.mark.parametrize("what", other_originals())
def test_another_recording_as_original(what: str, here: Path, pair: object) -> None:
    clip, reason = other_originals()[what]
    write(f"{what}.c3d", clip)
    result = run("db", "accept", "-d", "db", "filled.c3d", "--original", f"{what}.c3d")
    assert result.exit_code == 1
    assert result.stderr == (
        f"priorfill: filled.c3d: was not filled from {what} (--original): {reason}; "
        "give the file that it was filled from\n"
    )
    assert not (here / "db").exists()


def test_a_filled_clip_that_lacks_measured_samples(
    here: Path, pair: tuple[Clip, Clip, np.ndarray]
) -> None:
    _, filled, _ = pair
    positions = filled.positions.copy()
    positions[5:9, 0] = np.nan
    write("less.c3d", filled.with_positions(positions))
    result = run("db", "accept", "-d", "db", "less.c3d", "--original", "gappy.c3d")
    assert result.exit_code == 1
    assert "it lacks LASI in frame 6; give the file" in result.stderr


def test_nothing_filled(here: Path, pair: object) -> None:
    result = run("db", "accept", "-d", "db", "gappy.c3d", "--original", "gappy.c3d")
    assert result.exit_code == 1
    assert result.stderr == (
        "priorfill: gappy.c3d: has no filled samples, --original has the same ones; "
        "use: priorfill db add\n"
    )


def test_an_original_in_another_order_and_rounded(
    here: Path, pair: tuple[Clip, Clip, np.ndarray]
) -> None:
    gappy, _, _ = pair
    order = [2, 0, 3, 1]
    labels = tuple(gappy.labels[i] for i in order)
    write("other.c3d", Clip(np.rint(gappy.positions[:, order] * 10) / 10, labels, 120.0))
    assert run("db", "accept", "-d", "db", "filled.c3d", "--original", "other.c3d").exit_code == 0
    assert_mask()


def test_wrong_originals_and_methods(here: Path, pair: object) -> None:
    result = run("db", "accept", "-d", "db", "filled.c3d", "--original", "no.c3d")
    assert result.exit_code == 2
    assert "no.c3d: there is no such file; check the name" in result.stderr
    assert result.stderr.count("\n") == 1
    result = run("db", "accept", "-d", "db", "filled.c3d", "--method", " ")
    assert result.exit_code == 2
    assert result.stderr == (
        "priorfill: --method is empty; name the method that filled the gaps, or omit it\n"
    )


def test_options_for_reading(here: Path) -> None:
    records = standing(120)
    records[:, :, :3] /= 1000
    (here / "filled.c3d").write_bytes(C3DFile(records, LABELS).bytes())
    records[40:60, 2, 3] = -1
    (here / "gappy.c3d").write_bytes(C3DFile(records, LABELS).bytes())
    line = ["db", "accept", "-d", "db", "filled.c3d", "--original", "gappy.c3d"]
    assert "(--unit m)" in run(*line).stderr
    assert run(*line, "--unit", "m").exit_code == 0
    assert stored_mask()[:, 2].any()


def test_a_file_that_fill_wrote(here: Path) -> None:
    """A file with residuals, which alone show the filled samples."""
    gappy, filled, mask = gappy_and_filled(small_clip())
    with_residuals(here / "gappy.c3d", gappy)
    source = read("gappy.c3d")
    write("filled.c3d", source.with_positions(filled.positions), mask)
    assert run("db", "accept", "-d", "db", "filled.c3d").exit_code == 0
    assert_mask()


def test_measured_samples_are_not_replaced(here: Path, pair: object) -> None:
    write("whole.c3d", small_clip())
    run("db", "add", "-d", "db", "whole.c3d")
    result = run("db", "accept", "-d", "db", "filled.c3d", "--original", "gappy.c3d")
    assert result.exit_code == 0
    assert result.stdout.startswith("skipped filled.c3d: is in the database already (as whole)")
    assert [record.name for record in clips()] == ["whole"]
