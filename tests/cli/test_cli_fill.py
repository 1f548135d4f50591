"""``priorfill fill``: what it writes, prints and refuses."""

from __future__ import annotations

import csv
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from c3d_bytes import LABELS, C3DFile, standing
from click.testing import CliRunner, Result
from gappy import ARM, person, with_gaps
from platforms import WINDOWS, on_wine

import priorfill as pf
from priorfill.cli import main
from priorfill.cli.fill_report import worth_of_database
from priorfill.clip import Clip
from priorfill.database import ClipOrigin, PriorDatabase
from priorfill.errors import OptionError, OutputError
from priorfill.formats import read, write
from priorfill.methods.gpr.dropout.options import DropoutOptions

GAPS = ((60, 90, ARM), (200, 240, ("LKNE",)))


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A database of one walk of another subject."""
    place = tmp_path_factory.mktemp("cli") / "db"
    with PriorDatabase.create(place) as made:
        made.add(person(seconds=6.0, seed=11, body=11))
    return place


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `walk.c3d` (limb gaps) and `drop.c3d` (C7 never visible too).

    `spot.c3d` lacks single markers only, `knee.c3d` one for a while, and `back.c3d` is a second
    without C7; they are filled in a fraction of the time.
    """
    place = tmp_path_factory.mktemp("files")
    write(place / "walk.c3d", with_gaps(person(), *GAPS))
    write(place / "drop.c3d", with_gaps(person(), *GAPS, (0, 240, ("C7",))))
    write(place / "spot.c3d", with_gaps(person(), GAPS[1], (0, 240, ("C7",))))
    write(place / "knee.c3d", with_gaps(person(seconds=2.0), (60, 80, ("LKNE",))))
    write(place / "back.c3d", with_gaps(person(seconds=1.0), (0, 60, ("C7",))))
    return place


@pytest.fixture
def folder(files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with the clips of `files`."""
    monkeypatch.chdir(tmp_path)
    for file in files.iterdir():
        shutil.copyfile(file, file.name)
    return tmp_path


def listing() -> list[str]:
    """Names in the working folder."""
    return sorted(path.name for path in Path().iterdir())


def differing_records(one: Path, two: Path) -> set[tuple[int, int]]:
    """(frame, point) of all samples whose bytes differ; fails where any other byte does.

    Both files are read byte by byte: data block from the header, points and frames from it too.
    """
    a, b = one.read_bytes(), two.read_bytes()
    assert len(a) == len(b)
    words = np.frombuffer(a[:512], dtype="<u2")
    points, analog, first, last = (int(words[i]) for i in (1, 2, 3, 4))
    size = 4 if np.frombuffer(a[12:16], "<f4")[0] < 0 else 2
    start, frame_bytes = 512 * (int(words[8]) - 1), size * (4 * points + analog)
    where = np.flatnonzero(np.frombuffer(a, np.uint8) != np.frombuffer(b, np.uint8)) - start
    assert (where >= 0).all()
    frame, inside = np.divmod(where, frame_bytes)
    point = inside // (4 * size)
    assert (frame <= last - first).all()
    assert (point < points).all()
    return set(zip(frame.tolist(), point.tolist(), strict=True))


def filled_records(source: Path, output: Path) -> set[tuple[int, int]]:
    """(frame, point) of all samples that are missing in the source and measured in the output."""
    before, after = read(source), read(output)
    assert before.source is not None
    assert before.labels == after.labels
    frames, markers = np.nonzero(before.missing & ~after.missing)
    points = np.array(before.source.points)[markers]
    return set(zip(frames.tolist(), points.tolist(), strict=True))


# what it does


def test_text(folder: Path) -> None:
    before = Path("walk.c3d").read_bytes()
    result = run("fill", "walk.c3d", "-o", "out.c3d")
    assert result.exit_code == 0
    assert result.stderr == ""
    lines = result.stdout.splitlines()
    assert max(map(len, lines)) <= 80
    assert lines[0].split() == ["expected", "mean", "error", "bound"]
    assert lines[1].split() == [
        *("marker", "frames", "s", "filled", "error", "mm", "90", "mm", "from")
    ]
    first = read("walk.c3d").first_frame
    assert {tuple(line.split()[:4]) for line in lines[2:9]} == {
        *((label, f"{first + 60}-{first + 89}", "0.50", "100") for label in ARM),
        ("LKNE", f"{first + 200}-{first + 239}", "0.67", "100"),
    }
    errors = [float(line.split()[5]) for line in lines[2:9]]
    assert errors == sorted(errors, reverse=True)
    assert all(line.endswith("  a") for line in lines[2:9])
    assert lines[9:] == [
        "from a: the clip's own frames",
        "",
        "filled 220 samples with gpr; 7 of 7 gaps complete; written to out.c3d",
    ]
    assert Path("walk.c3d").read_bytes() == before
    assert not read("out.c3d").missing.any()
    changed = differing_records(Path("walk.c3d"), Path("out.c3d"))
    assert changed == filled_records(Path("walk.c3d"), Path("out.c3d"))
    assert len(changed) == 220


def test_json_and_database(folder: Path, database: Path) -> None:
    result = run("fill", "drop.c3d", "-o", "out.c3d", "--json", "-d", database)
    assert result.exit_code == 0
    facts = json.loads(result.stdout)
    first = read("drop.c3d").first_frame
    assert facts["file"] == "drop.c3d"
    assert facts["output"] == "out.c3d"
    assert facts["method"] == "gpr"
    assert facts["database"] == str(database)
    assert facts["marker_set"] == "baumann41"
    assert facts["rate"] == 60
    assert (facts["filled_samples"], facts["missing_samples"]) == (460, 0)
    assert facts["complete"] is True
    assert facts["rounding_mm"] < 0.001
    assert len(facts["gaps"]) == 8
    (gap,) = [gap for gap in facts["gaps"] if gap["marker"] == "C7"]
    assert 0 < gap["expected_mean_error_mm"] < gap["expected_rms_mm"] < gap["error_bound_90_mm"]
    assert gap["method"] == "gpr"
    assert (
        gap["training_poses"] == DropoutOptions().poses_per_subject
    )  # of the one person in the database
    assert gap["source_clips"] == ["synthetic_walking_011"]
    assert facts["uncertainty"] is None
    assert (gap["first_frame"], gap["last_frame"]) == (first, first + 239)
    assert (gap["frames"], gap["seconds"], gap["filled"]) == (240, 4.0, 240)
    assert gap["sources"] == ["other subjects of the database"]
    assert gap["unfilled"] == []
    assert gap["expected_mean_error_without_database_mm"] is None  # the clip never shows it
    (hand,) = [gap for gap in facts["gaps"] if gap["marker"] == "LFIN"]
    assert hand["expected_mean_error_without_database_mm"] > 0.0


def test_a_line_tells_what_the_database_was_worth() -> None:
    """Weighted by frames, of the gaps that it was used for."""
    unknown = SimpleNamespace(
        filled=10, expected_mean_error_mm=9.0, expected_mean_error_without_database_mm=float("nan")
    )
    gaps = [
        SimpleNamespace(
            filled=filled, expected_mean_error_mm=2.0, expected_mean_error_without_database_mm=worse
        )
        for filled, worse in ((30, 4.0), (10, 8.0))
    ]
    line = worth_of_database(SimpleNamespace(gaps=[*gaps, unknown]))
    assert line.startswith("the database was used for 2 gaps")
    assert line.endswith("2.0 mm, 5.0 mm without it")
    assert worth_of_database(SimpleNamespace(gaps=[unknown])) == ""


def test_published_method(folder: Path, database: Path) -> None:
    result = run("fill", "drop.c3d", "-o", "out.c3d", "-d", database, "-m", "baumann2011")
    assert result.exit_code in (0, 3)  # positions that are not believed stay missing
    assert " samples with baumann2011; " in result.stdout
    assert re.search(r": \d+ nearest poses by \d+ markers$", result.stdout, re.MULTILINE)


def test_with_another_clip_of_the_person(folder: Path) -> None:
    other = person(seed=9)
    write("static.c3d", replace(other, positions=other.positions[50:52]))
    write("other.c3d", other)
    result = run("fill", "spot.c3d", "-o", "a.c3d", "--same-subject", "static.c3d")
    assert result.exit_code == 0
    assert "other recordings of the same subject" in result.stdout
    off = np.linalg.norm(read("a.c3d").positions - person().positions, axis=2)
    assert off[:, person().labels.index("C7")].mean() < 8
    result = run(
        "fill",
        "spot.c3d",
        "-o",
        "b.c3d",
        "--same-subject",
        "static.c3d",
        "--same-subject",
        "other.c3d",
        "--json",
    )
    assert result.exit_code == 0
    (gap,) = [gap for gap in json.loads(result.stdout)["gaps"] if gap["marker"] == "C7"]
    assert "other" in gap["source_clips"]


def test_bad_other_clips(folder: Path) -> None:
    Path("damaged.c3d").write_bytes(b"nothing")
    thing = person()
    write("thing.c3d", replace(thing, labels=[f"P{i}" for i in range(len(thing.labels))]))
    for other, words in (
        ("drop.c3d", "drop.c3d: is the file to be filled"),
        ("absent.c3d", "absent.c3d"),
        ("damaged.c3d", "damaged.c3d"),
        ("thing.c3d", "thing: no marker in common with the clip"),
    ):
        result = run("fill", "drop.c3d", "-o", "out.c3d", "--same-subject", other)
        assert result.exit_code == (2 if other in ("drop.c3d", "absent.c3d") else 1)
        assert words in result.stderr
        assert result.stderr.count("\n") == 1
        assert not Path("out.c3d").exists()


def test_unfilled(folder: Path) -> None:
    result = run("fill", "drop.c3d", "-o", "out.c3d")
    assert result.exit_code == 3
    first = read("drop.c3d").first_frame
    assert result.stderr == (
        f"unfilled: 240 samples of 1 marker (C7) within frames {first}-{first + 239}: "
        "too few frames of the clip show it together with the visible markers, "
        "and no other recording does, and there is no database; "
        "give one (--database), or another clip of the same subject (--same-subject)\n"
    )
    assert "filled 220 samples with gpr; 7 of 8 gaps complete" in result.stdout
    after = read("out.c3d")
    assert after.missing.sum() == 240
    assert after.missing[:, after.labels.index("C7")].all()
    assert differing_records(Path("drop.c3d"), Path("out.c3d")) == filled_records(
        Path("drop.c3d"), Path("out.c3d")
    )
    result = run("fill", "drop.c3d", "-o", "out.json.c3d", "--json")
    assert result.exit_code == 3
    facts = json.loads(result.stdout)
    assert facts["complete"] is False
    (gap,) = [gap for gap in facts["gaps"] if gap["marker"] == "C7"]
    assert gap["expected_rms_mm"] is None
    assert gap["expected_mean_error_mm"] is None
    assert gap["error_bound_90_mm"] is None
    assert gap["training_poses"] == 0
    assert gap["filled"] == 0
    (left,) = gap["unfilled"]
    assert (left["first_frame"], left["last_frame"]) == (first, first + 239)
    assert "no database" in left["reason"]


@pytest.mark.parametrize("arguments", [[], ["--json"]])
def test_no_gaps(folder: Path, arguments: list[str]) -> None:
    write("whole.c3d", person())
    result = run("fill", "whole.c3d", "-o", "out.c3d", *arguments)
    assert result.exit_code == 0
    assert Path("out.c3d").read_bytes() == Path("whole.c3d").read_bytes()
    if arguments:
        facts = json.loads(result.stdout)
        assert (facts["gaps"], facts["filled_samples"], facts["complete"]) == ([], 0, True)
    else:
        assert result.stdout == "whole has no gaps; out.c3d is a copy\n"


def test_overwrite(folder: Path) -> None:
    Path("out.c3d").write_text("precious")
    result = run("fill", "knee.c3d", "-o", "out.c3d")
    assert_refused(result, "out.c3d", "overwrite")
    assert Path("out.c3d").read_text() == "precious"
    result = run("fill", "knee.c3d", "-o", "out.c3d", "--overwrite")
    assert result.exit_code == 0
    assert not read("out.c3d").missing.any()


def test_integers_are_rounded_and_it_says_so(folder: Path) -> None:
    records = standing(40, step=0.5)
    records[10:20, 5] = [0, 0, 0, -1]
    Path("whole.c3d").write_bytes(C3DFile(records, LABELS, is_float=False, scale=0.5).bytes())
    result = run("fill", "whole.c3d", "-o", "out.c3d", "-m", "gpr")
    assert result.exit_code == 0
    assert "filled samples are rounded to the file's number format, by up to 0." in result.stdout
    assert differing_records(Path("whole.c3d"), Path("out.c3d")) == {(f, 5) for f in range(10, 20)}


def test_metres(folder: Path) -> None:
    """A file in m is written in m."""
    records = standing(60)
    records[:, :, :3] /= 1000
    records = records.astype(np.float32).astype(np.float64)
    records[20:30, 5] = [0, 0, 0, -1]
    Path("m.c3d").write_bytes(C3DFile(records, LABELS, units="m").bytes())
    assert run("fill", "m.c3d", "-o", "out.c3d").exit_code == 0
    found = read("out.c3d")
    assert 400 < found.positions[20:30, found.labels.index("LKNE"), 2].min() < 560
    assert differing_records(Path("m.c3d"), Path("out.c3d")) == {(f, 5) for f in range(20, 30)}


def test_nan_coordinates_are_missing(folder: Path) -> None:
    records = standing(60)
    records[20:30, 5, :3] = np.nan
    Path("nan.c3d").write_bytes(C3DFile(records, LABELS).bytes())
    assert run("fill", "nan.c3d", "-o", "out.c3d").exit_code == 0
    assert not read("out.c3d").missing.any()


def test_reading_options(folder: Path) -> None:
    result = run("fill", "knee.c3d", "-o", "out.c3d", "--rate", "30", "--up", "+Z", "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["rate"] == 30


def test_a_progress_bar_only_on_a_terminal(folder: Path) -> None:
    assert "filling" not in run("fill", "knee.c3d", "-o", "out.c3d").stderr


# the expected error of each sample, as a file


def test_uncertainty_as_a_table(folder: Path) -> None:
    line = ["fill", "drop.c3d", "-o", "out.c3d", "--uncertainty", "out.csv"]
    result = run(*line)
    assert result.exit_code == 3  # C7 stays missing
    assert result.stdout.endswith("expected error of each filled sample: out.csv\n")
    with Path("out.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == [
        *("marker", "frame", "time_s"),
        *("expected_rms_mm", "error_bound_90_mm", "sources"),
    ]
    clip = read("drop.c3d")
    expected = [
        (label, clip.first_frame + frame, frame / 60)
        for start, stop, labels in GAPS
        for label in labels
        for frame in range(start, stop)
    ]
    found = [(row["marker"], int(row["frame"]), float(row["time_s"])) for row in rows]
    assert [row[:2] for row in found] == [row[:2] for row in expected]
    np.testing.assert_allclose([r[2] for r in found], [r[2] for r in expected], atol=1e-6)
    assert {row["sources"] for row in rows} == {"the clip's own frames"}
    assert all(0 < float(row["expected_rms_mm"]) < float(row["error_bound_90_mm"]) for row in rows)
    facts = json.loads(run(*line, "--json", "--overwrite").stdout)
    assert facts["uncertainty"] == "out.csv"
    (gap,) = [gap for gap in facts["gaps"] if gap["marker"] == "LKNE"]
    knee = [float(row["expected_rms_mm"]) for row in rows if row["marker"] == "LKNE"]
    assert gap["expected_rms_mm"] == pytest.approx(np.sqrt(np.square(knee).mean()), abs=2e-3)
    assert min(knee) < gap["expected_mean_error_mm"] < max(knee)


def test_uncertainty_as_an_archive(folder: Path) -> None:
    result = run("fill", "drop.c3d", "-o", "out.c3d", "--uncertainty", "out.NPZ")
    assert result.exit_code == 3
    before, after = read("drop.c3d"), read("out.c3d")
    with np.load("out.NPZ") as archive:
        assert tuple(archive["labels"]) == before.labels
        assert archive["frames"].tolist() == [before.first_frame + i for i in range(240)]
        assert float(archive["rate"]) == 60
        assert str(archive["unit"]) == "mm"
        filled = archive["filled"]
        np.testing.assert_array_equal(filled, before.missing & ~after.missing)
        for name in ("expected_rms_mm", "error_bound_90_mm"):
            np.testing.assert_array_equal(np.isfinite(archive[name]), filled)
        assert (archive["error_bound_90_mm"][filled] > archive["expected_rms_mm"][filled]).all()


@pytest.mark.parametrize("name", ["out.csv", "out.npz"])
def test_uncertainty_where_nothing_is_missing(folder: Path, name: str) -> None:
    write("whole.c3d", person())
    assert run("fill", "whole.c3d", "-o", "out.c3d", "--uncertainty", name).exit_code == 0
    if name == "out.csv":
        assert len(Path(name).read_text().splitlines()) == 1
    else:
        with np.load(name) as archive:
            assert not archive["filled"].any()


def test_uncertainty_that_cannot_be_written(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Refused before anything is filled; nothing is written or replaced."""
    monkeypatch.setattr("priorfill.filling.fill_file.fill", None)
    Path("old.csv").write_text("precious")
    Path("dir.csv").mkdir()
    Path("old.c3d").write_text("old")
    os.link("old.c3d", "hard.npz")
    names = listing()
    before = Path("walk.c3d").read_bytes()
    for output, name, status, word, *options in (
        ("out.c3d", "old.csv", 1, "exists already; choose another name or use --overwrite"),
        ("out.c3d", "dir.csv", 1, "is a folder", "--overwrite"),
        ("old.c3d", "hard.npz", 2, "is the file for the filled clip", "--overwrite"),
    ):
        line = ["fill", "walk.c3d", "-o", output, "--uncertainty", name, *options]
        assert_refused(run(*line), name, word, status=status)
        assert listing() == names
    assert Path("walk.c3d").read_bytes() == before
    assert Path("old.csv").read_text() == "precious"
    assert run("fill", "walk.c3d", "-o", "out.c3d", "--uncertainty").exit_code == 2


@pytest.mark.skipif(on_wine(), reason="wine replaces a symbolic link by the file that is written")
def test_uncertainty_that_links_to_another_file(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("priorfill.filling.fill_file.fill", None)
    Path("input.csv").symlink_to("walk.c3d")
    Path("output.csv").symlink_to("out.c3d")
    for name, word in (
        ("input.csv", "is the file that the clip was read from"),
        ("output.csv", "is the file for the filled clip"),
    ):
        line = ["fill", "walk.c3d", "-o", "out.c3d", "--uncertainty", name, "--overwrite"]
        assert_refused(run(*line), name, word, status=2)


@pytest.mark.windows
def test_dry_run(folder: Path, database: Path) -> None:
    before = listing()
    result = run("fill", "spot.c3d", "-m", "linear")
    assert result.exit_code == 3, result.output  # C7 is never visible
    assert "no filled file was written; write it with: -o OUT.c3d" in result.stdout
    assert listing() == before
    result = run("fill", "spot.c3d", "-m", "linear", "--json", "--uncertainty", "u.npz")
    facts = json.loads(result.stdout)
    assert result.exit_code == 3
    assert facts["output"] is None
    assert facts["gaps"]
    assert listing() == sorted([*before, "u.npz"])  # what was asked for by name
    result = run("fill", "spot.c3d", "-d", database, "--add-to-database")
    assert result.exit_code == 2
    assert "--add-to-database needs a file to write" in result.stderr
    with pytest.raises(OptionError, match="`output`"):
        pf.fill_file("spot.c3d", database=database, files=pf.FileOptions(add_to_database=True))


def test_outputs_that_differ_in_case_only(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Refused where the folder takes them for one file, whatever the system."""
    monkeypatch.setattr("priorfill.runtime.atomic_file._ignores_case", lambda folder: True)
    line = ["fill", "walk.c3d", "-m", "linear", "--uncertainty", "out.NPZ", "-o"]
    assert_refused(run(*line, "Out.npz"), "out.NPZ", "is the file for the filled clip", status=2)
    monkeypatch.undo()
    monkeypatch.chdir(folder)
    expected = (2,) if Path("WALK.C3D").exists() else (0, 3)
    assert run(*line, "Out.npz").exit_code in expected
    assert run(*line, Path("another", "out.npz"), "--overwrite").exit_code in (0, 3)


@pytest.mark.parametrize("failing", ["write", "_save_table"])
def test_uncertainty_and_clip_appear_together(
    folder: Path, monkeypatch: pytest.MonkeyPatch, failing: str
) -> None:
    """If the disk is full when one is written, neither appears and existing files stay."""
    from priorfill import formats
    from priorfill.filling import uncertainty_file

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    Path("out.csv").write_text("precious")
    names = listing()
    monkeypatch.setattr(formats if failing == "write" else uncertainty_file, failing, full)
    line = ["fill", "knee.c3d", "-o", "out.c3d", "--uncertainty", "out.csv", "--overwrite"]
    assert_refused(run(*line), "No space left on device")
    assert listing() == names
    assert Path("out.csv").read_text() == "precious"


def test_uncertainty_from_python(folder: Path) -> None:
    clip = read("knee.c3d")
    result = pf.fill(clip)
    pf.write_uncertainty("out.npz", result)
    with np.load("out.npz") as archive:
        np.testing.assert_array_equal(archive["error_bound_90_mm"], result.error_bound_90_mm)
    with pytest.raises(OutputError, match="exists already"):
        pf.write_uncertainty("out.npz", result)
    pf.write_uncertainty("out.npz", result, overwrite=True)
    with pytest.raises(OptionError, match=r"cannot be written with suffix '\.xlsx'"):
        pf.write_uncertainty("out.xlsx", result)
    assert "out.xlsx" not in listing()


# clips of a database to learn from


@pytest.fixture(scope="module")
def people(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A database of walk1 (anna), walk2 (ben), run (ben); ben's samples of C7 are all filled."""
    place = tmp_path_factory.mktemp("cli") / "people"
    with PriorDatabase.create(place) as made:
        for seed, (name, subject) in enumerate(
            [("walk1", "anna"), ("walk2", "ben"), ("run", "ben")]
        ):
            clip = replace(person(seconds=2.0, seed=20 + seed, body=20 + seed), name=name)
            if subject == "anna":
                made.add(clip, ClipOrigin(subject=subject))
                continue
            mask = np.zeros(clip.missing.shape, dtype=bool)
            mask[:, clip.labels.index("C7")] = True
            made.accept(clip, mask, filled_by="gpr", origin=ClipOrigin(subject=subject))
    return place


@pytest.mark.parametrize(
    ("options", "known"),
    [
        ([], {"walk1"}),
        (["--exclude-motion", "walk1"], set()),
        (["--exclude-motion", "run", "--exclude-motion", "*2"], {"walk1"}),
        (["--exclude-subject", "a*"], set()),
        (["--only-subject", "anna"], {"walk1"}),
        (["--only-subject", "ben"], set()),
        (["--trust-filled"], {"walk1", "walk2", "run"}),
        (["--trust-filled", "--exclude-motion", "walk*"], {"run"}),
        (["--trust-filled", "--exclude-subject", "anna", "--exclude-motion", "run"], {"walk2"}),
        (["--trust-filled", "--only-subject", "ben", "--only-subject", "c"], {"walk2", "run"}),
    ],
)
def test_which_clips_it_learns_from(
    options: list[str], known: set[str], folder: Path, people: Path
) -> None:
    result = run("fill", "back.c3d", "-o", "out.c3d", "--json", "-d", people, *options)
    (gap,) = [gap for gap in json.loads(result.stdout)["gaps"] if gap["marker"] == "C7"]
    assert result.exit_code == (0 if known else 3)
    assert set(gap["source_clips"]) == known


def test_the_recording_itself_is_not_learnt_from(folder: Path) -> None:
    run("db", "add", "-d", "db", "drop.c3d")
    write("truth.c3d", person())
    run("db", "accept", "-d", "db", "truth.c3d", "--original", "drop.c3d")
    result = run("fill", "drop.c3d", "-o", "out.c3d", "-d", "db", "--trust-filled")
    assert result.exit_code == 3
    assert "note: not learnt from truth: of the same recording as the clip" in result.stderr


@pytest.mark.parametrize(
    "option",
    [
        ["--exclude-motion", "walk"],
        ["--exclude-subject", "anna"],
        ["--only-subject", "anna"],
        ["--trust-filled"],
        ["--add-to-database"],
    ],
)
def test_options_that_need_a_database(option: list[str], folder: Path) -> None:
    result = run("fill", "walk.c3d", "-o", "out.c3d", *option)
    assert result.exit_code == 2
    assert f"{option[0]} needs a database; give one (--database)" in result.stderr
    assert not Path("out.c3d").exists()


# adding the filled clip to the database


def kept(place: str | Path = "db") -> list[tuple[str, str, int]]:
    """Name, method and filled samples (at level 0) of the clips of a database."""
    with PriorDatabase.open(place) as database:
        return sorted(
            (record.name, record.filled_by, sum(record.present) - sum(record.measured))
            for record in database.clips()
        )


def test_add_to_a_new_database(folder: Path) -> None:
    result = run("fill", "walk.c3d", "-o", "out.c3d", "-d", "db", "--add-to-database")
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout.endswith("; written to out.c3d\nadded to db\n")
    assert "the clip's own frames" in result.stdout
    # 6 markers for 30 frames of 60 Hz, one for 40
    assert kept() == [("out", "gpr", 6 * 15 + 20)]
    # added as the file holds it, so that it is recognised when added again
    assert run("db", "add", "-v", "-d", "db", "out.c3d").stdout.startswith("skipped out.c3d: ")
    again = ["db", "accept", "-d", "db", "out.c3d", "--original", "walk.c3d", "--method", "gpr"]
    assert run(*again).stdout.startswith("skipped out.c3d: ")
    assert run("db", "verify", "-d", "db").exit_code == 0


def test_add_in_place_of_the_clip_with_gaps(folder: Path, database: Path) -> None:
    shutil.copytree(database, "db")
    run("db", "add", "-d", "db", "--subject", "anna", "--licence", "CC0", "drop.c3d")
    result = run("fill", "drop.c3d", "-o", "out.c3d", "-d", "db", "--add-to-database", "--json")
    assert result.exit_code == 0
    facts = json.loads(result.stdout)
    with PriorDatabase.open("db") as made:
        (record,) = (record for record in made.clips() if record.name == "out")
    assert facts["added"] == record.content
    assert len(facts["replaced"]) == 1
    assert (record.subject, record.licence) == ("anna", "CC0")
    assert len(kept()) == 2
    line = ["fill", "drop.c3d", "-o", "again.c3d", "-d", "db", "--add-to-database"]
    result = run(*line, "-m", "baumann2011")
    assert result.stdout.endswith("added to db in place of out\n")
    names = [name for name, *_ in kept()]
    assert "again" in names and "out" not in names and len(names) == 2


def test_add_twice(folder: Path) -> None:
    line = ["fill", "knee.c3d", "-o", "out.c3d", "-d", "db", "--add-to-database", "--overwrite"]
    assert run(*line).exit_code == 0
    result = run(*line)
    assert result.exit_code == 0
    assert result.stdout.endswith(
        "not added to db: out: is in the database already (as out); nothing to do\n"
    )
    facts = json.loads(run(*line, "--json").stdout)
    assert (facts["added"], facts["replaced"]) == (None, [])
    assert len(kept()) == 1


def test_add_what_stays_incomplete_or_has_no_gaps(folder: Path) -> None:
    Path("db").mkdir()
    line = ["-d", "db", "--add-to-database"]
    assert run("fill", "drop.c3d", "-o", "out.c3d", *line).exit_code == 3
    assert kept() == [("out", "gpr", 110)]
    write("whole.c3d", person(seed=8))
    result = run("fill", "whole.c3d", "-o", "copy.c3d", *line)
    assert (result.exit_code, result.stdout) == (
        0,
        "whole has no gaps; copy.c3d is a copy\nadded to db\n",
    )
    assert kept() == [("copy", "", 0), ("out", "gpr", 110)]


def test_interpolated_samples_count_as_filled(folder: Path) -> None:
    records = standing(120)
    records[:, :, 3] = 0x0303
    records[20:30, 5] = [0, 0, 0, -1]
    records[60:80, 2, 3] = 0
    Path("walk.c3d").write_bytes(C3DFile(records, LABELS).bytes())
    line = ["fill", "walk.c3d", "-o", "out.c3d", "-d", "db", "--add-to-database", "--rate", "30"]
    assert run(*line).exit_code == 0
    assert kept() == [("out", "gpr", 30)]


def test_what_was_written_but_not_added(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    line = ["fill", "knee.c3d", "-o", "my out.c3d", "-d", "db", "--add-to-database"]
    name = '"my out.c3d"' if WINDOWS else "'my out.c3d'"
    later = (
        "my out.c3d is written but not added; add it later with: priorfill db accept "
        f"--database db {name} --original knee.c3d --method gpr"
    )
    with PriorDatabase.create("db"):
        result = run(*line)
    assert result.exit_code == 1
    assert "filled 20 samples" in result.stdout
    note, error = result.stderr.splitlines()
    assert note == "note: db: the database is empty"
    assert error.startswith("priorfill: db: process ")
    assert error.endswith(f"wait until it has ended; {later}")
    assert not read("my out.c3d").missing.any()

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    options = ["--overwrite", "--rate", "50", "--up", "+Z", "--unit", "mm", "--keep-zeros"]
    with monkeypatch.context() as patch:
        patch.setattr(PriorDatabase, "accept", full)
        result = run(*line, "--json", *options)
    assert result.exit_code == 1
    assert json.loads(result.stdout)["added"] is None
    assert result.stderr.splitlines()[-1] == (
        f"priorfill: db: cannot be written (No space left on device); {later} "
        "--up +Z --rate 50.0 --unit mm --keep-zeros"
    )
    # the suggested command works
    command = shlex.split(result.stderr.split("add it later with: priorfill ")[1])
    assert run(*command).exit_code == 0
    assert kept()[0][:2] == ("my out", "gpr")


def test_a_clip_that_no_database_takes(folder: Path) -> None:
    records = standing(12)
    records[5:7, 5] = [0, 0, 0, -1]
    Path("short.c3d").write_bytes(C3DFile(records, LABELS).bytes())
    result = run("fill", "short.c3d", "-o", "out.c3d", "-d", "db", "--add-to-database")
    assert result.exit_code == 1
    assert "is too short" in result.stderr
    assert result.stderr.endswith("; out.c3d is written but not added\n")


def test_databases_that_cannot_be_made(folder: Path) -> None:
    Path("things").mkdir()
    Path("things/notes.txt").write_text("not a database")
    names = listing()
    for place, word, status in (
        ("no/db", f"{Path('no/db')}: the folder no does not exist; create it first", 1),
        ("walk.c3d", "walk.c3d: is a file", 2),
        ("things", "things: is not a priorfill database", 1),
    ):
        result = run("fill", "walk.c3d", "-o", "out.c3d", "-d", place, "--add-to-database")
        assert_refused(result, word, status=status)
        assert listing() == names


def test_a_folder_that_may_not_be_written_to(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.W_OK)
    result = run("fill", "walk.c3d", "-o", "out.c3d", "-d", "db", "--add-to-database")
    assert_refused(result, "db: cannot be created; check the permissions of .")


# what it refuses


def assert_refused(result: Result, *words: str, status: int = 1) -> None:
    assert result.exit_code == status, result.output
    assert result.stdout == ""
    assert result.stderr.startswith("priorfill: ")
    assert result.stderr.count("\n") == 1
    assert "Traceback" not in result.stderr
    assert "bug in priorfill" not in result.stderr
    for word in words:
        assert word in result.stderr, (word, result.stderr)


def bad_files() -> dict[str, tuple[bytes, str]]:
    """Contents that cannot be filled, each with a word that the message must contain."""
    whole = C3DFile(standing(40), LABELS)
    infinite = standing(40)
    infinite[12, 3, 1] = np.inf
    metres = standing(40)
    metres[:, :, :3] /= 1000
    return {
        "not C3D": (b"text in a file with the wrong suffix\n" * 40, "C3D"),
        "a picture": (b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 8, ""),
        "cut in the data": (whole.bytes()[:-1500], "cut short"),
        "cut in the parameters": (whole.bytes()[:700], "cut short"),
        "cut in the header": (whole.bytes()[:100], ""),
        "empty": (b"", "empty"),
        "no frames": (C3DFile(standing(0), LABELS).bytes(), "no frames"),
        "no points": (C3DFile(np.zeros((5, 0, 4)), []).bytes(), ""),
        "no rate": (C3DFile(standing(40), LABELS, rate=0.0).bytes(), "--rate"),
        "infinite": (C3DFile(infinite, LABELS, first_frame=101).bytes(), "LASI"),
        "metres": (C3DFile(metres, LABELS).bytes(), "--unit m"),
    }


@pytest.mark.parametrize("what", bad_files())
def test_bad_input(folder: Path, what: str) -> None:
    content, word = bad_files()[what]
    Path("bad.c3d").write_bytes(content)
    before = listing()
    result = run("fill", "bad.c3d", "-o", "out.c3d")
    assert_refused(result, "bad", word)
    if what == "infinite":
        assert "frame 113" in result.stderr
    assert listing() == before
    assert Path("bad.c3d").read_bytes() == content


PROGRAM = "from priorfill.cli import main; main()"


def test_bad_input_as_a_program(folder: Path) -> None:
    """One line on stderr, whatever libraries print themselves."""
    Path("bad.c3d").write_bytes(b"nothing that makes sense")
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, "fill", "bad.c3d", "-o", "out.c3d"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1


def test_other_files(folder: Path) -> None:
    Path("text.txt").write_text("x")
    Path("folder.c3d").mkdir()
    for arguments, word in (
        (["folder.c3d", "-o", "out.c3d"], "folder"),
        (["text.txt", "-o", "out.c3d"], "is none of the known .txt files"),
        (["walk.c3d", "-o", "folder.c3d"], "folder.c3d"),
        (["walk.c3d", "-o", "folder.c3d", "--overwrite"], "folder.c3d"),
        (["walk.c3d", "-o", "text.txt/out.c3d"], "text.txt"),
    ):
        before = Path("walk.c3d").read_bytes()
        names = listing()
        assert_refused(run("fill", *arguments), word)
        assert listing() == names
        assert Path("walk.c3d").read_bytes() == before


def test_wrong_usage(folder: Path) -> None:
    for arguments in (["-o", "out.c3d"], ["walk.c3d", "-o", "out.c3d", "--what"]):
        assert run("fill", *arguments).exit_code == 2


@pytest.mark.windows
@pytest.mark.parametrize("arguments", [[], ["--overwrite"]])
def test_output_is_the_input(folder: Path, arguments: list[str]) -> None:
    before = Path("walk.c3d").read_bytes()
    os.link("walk.c3d", "hard.c3d")
    Path("sub").mkdir()
    names = ["walk.c3d", "hard.c3d", "sub/../walk.c3d", str(folder / "walk.c3d")]
    if Path("WALK.c3d").exists():
        names.append("Walk.C3D")
    for name in names:
        assert_refused(run("fill", "walk.c3d", "-o", name, *arguments), "read from", status=2)
    assert Path("walk.c3d").read_bytes() == before


@pytest.mark.skipif(on_wine(), reason="wine replaces a symbolic link by the file that is written")
@pytest.mark.parametrize("arguments", [[], ["--overwrite"]])
def test_output_is_a_link_to_the_input(folder: Path, arguments: list[str]) -> None:
    before = Path("walk.c3d").read_bytes()
    Path("link.c3d").symlink_to("walk.c3d")
    assert_refused(run("fill", "walk.c3d", "-o", "link.c3d", *arguments), "read from", status=2)
    assert_refused(run("fill", "link.c3d", "-o", "walk.c3d", *arguments), "read from", status=2)
    assert Path("walk.c3d").read_bytes() == before
    assert Path("link.c3d").is_symlink()


def test_folders_that_are_not_databases(folder: Path, database: Path) -> None:
    def refused(place: str | Path, *words: str, status: int = 1) -> None:
        names = listing()
        result = run("fill", "walk.c3d", "-o", "out.c3d", "-d", place)
        assert_refused(result, *words, status=status)
        assert listing() == names

    refused("nowhere", "nowhere", status=2)
    Path("things").mkdir()
    Path("things/notes.txt").write_text("not a database")
    refused("things", "things")
    refused("walk.c3d", "walk.c3d", status=2)
    Path("void").mkdir()
    refused("void", "void")

    shutil.copytree(database, "newer")
    note = Path("newer/priorfill-database.json")
    note.write_text(json.dumps(json.loads(note.read_text()) | {"version": 99}))
    refused("newer", "99", "version")
    note.write_text("{ this is no JSON")
    refused("newer", "newer")
    shutil.copytree(database, "torn")
    Path("torn/catalogue.sqlite").write_bytes(b"no sqlite" * 100)
    refused("torn", "torn")


def test_a_database_without_a_usable_clip(folder: Path, database: Path) -> None:
    """Only the clip itself is then learnt from; a note has the reason."""

    def filled(place: str, note: str, *options: str) -> None:
        line = ["fill", "back.c3d", "-o", "out.c3d", "--overwrite", "-d", place, *options]
        result = run(*line)
        assert result.exit_code == 3
        lines = result.stderr.splitlines()
        assert len(lines) == 2
        assert lines[0].startswith("note: ")
        assert note in lines[0]
        assert lines[1].startswith("unfilled: 60 samples of 1 marker (C7)")
        facts = json.loads(run(*line, "--json").stdout)
        assert facts["notes"] == [lines[0].removeprefix("note: ")]

    PriorDatabase.create("empty").close()
    filled("empty", "the database is empty")
    with PriorDatabase.create("strange") as made:
        names = tuple(f"X{i}" for i in range(41))
        made.add(Clip(person(seed=8).positions, names, 60.0, name="other"))
    filled("strange", "no marker in common")
    shutil.copytree(database, "gutted")
    shutil.rmtree("gutted/segments")
    filled("gutted", "not learnt from")
    shutil.copytree(database, "rotten")
    segment = Path("rotten/segments/000001.f32")
    data = bytearray(segment.read_bytes())
    for at in range(0, len(data), 500):
        data[at] ^= 4
    segment.write_bytes(bytes(data))
    filled("rotten", "are damaged")
    for option in (("--exclude-motion", "*"), ("--only-subject", "nobody")):
        filled(str(database), "no clip is left to learn from", *option)


def test_interrupted(folder: Path) -> None:
    """Ctrl-C during a fill: one line, status 130, no file left behind."""
    program = (
        "import signal, priorfill.filling.run_settings as f\n"
        # shells start background jobs with SIGINT ignored
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "def slow(*a): signal.raise_signal(signal.SIGINT); import time; time.sleep(600)\n"
        "f.get_method = lambda name: slow\n"
        "from priorfill.cli import main; main()"
    )
    names = listing()
    done = subprocess.run(
        [sys.executable, "-c", program, "fill", "walk.c3d", "-o", "out.c3d"],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "priorfill: interrupted\n")
    assert listing() == names


@pytest.mark.realdata
def test_gaps_as_the_cameras_left_them(data: Path, tmp_path: Path) -> None:
    import ezc3d

    source, output = data / "real_gaps" / "sample26_Capture0002.c3d", tmp_path / "out.c3d"
    result = run("fill", source, "-o", output)
    assert result.exit_code == 0, result.output
    changed = differing_records(source, output)
    assert changed == filled_records(source, output)
    assert len(changed) == read(source).missing.sum()
    content = ezc3d.c3d(str(output))
    points = content["data"]["points"]
    residual = content["data"]["meta_points"]["residuals"][0]
    for frame, point in changed:
        assert residual[point, frame] == 0
        assert np.isfinite(points[:3, point, frame]).all()
    # filled samples stay within the range of the measured ones
    before, after = read(source), read(output)
    assert (after.positions > np.nanmin(before.positions, axis=(0, 1)) - 300).all()
    assert (after.positions < np.nanmax(before.positions, axis=(0, 1)) + 300).all()
