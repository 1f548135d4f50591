"""``priorfill fill``: what it writes, what it says, and what it refuses."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from c3d_bytes import LABELS, C3DFile, standing
from click.testing import CliRunner, Result
from gappy import ARM, person, with_gaps

from priorfill.cli import main
from priorfill.clip import Clip
from priorfill.database import PriorDatabase
from priorfill.formats import read, write

GAPS = ((60, 90, ARM), (200, 240, ("LKNE",)))


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A database of one other person's walk."""
    place = tmp_path_factory.mktemp("cli") / "db"
    with PriorDatabase.create(place) as made:
        made.add(person(seconds=6.0, seed=11, body=11))
    return place


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with `walk.c3d` (limb gaps) and `drop.c3d` (C7 never seen too)."""
    monkeypatch.chdir(tmp_path)
    write("walk.c3d", with_gaps(person(), *GAPS))
    write("drop.c3d", with_gaps(person(), *GAPS, (0, 240, ("C7",))))
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
    assert lines[0].split() == [
        "marker",
        "frames",
        "s",
        "filled",
        "expected",
        "error",
        "mm",
        "from",
    ]
    first = read("walk.c3d").first_frame
    assert [line.split()[:4] for line in lines[1:8]] == [
        *([label, f"{first + 60}-{first + 89}", "0.50", "100"] for label in ARM),
        ["LKNE", f"{first + 200}-{first + 239}", "0.67", "100"],
    ]
    assert all(line.endswith("the clip's own frames") for line in lines[1:8])
    assert lines[8:] == ["", "220 samples filled by prior, 7 of 7 gaps wholly; written to out.c3d"]
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
    assert facts["method"] == "prior"
    assert facts["database"] == str(database)
    assert facts["marker_set"] == "baumann41"
    assert facts["rate"] == 60
    assert (facts["filled_samples"], facts["missing_samples"]) == (460, 0)
    assert facts["complete"] is True
    assert facts["rounding_mm"] < 0.001
    assert len(facts["gaps"]) == 8
    (gap,) = [gap for gap in facts["gaps"] if gap["marker"] == "C7"]
    assert gap["expected_error_mm"] > 0
    assert (gap["first_frame"], gap["last_frame"]) == (first, first + 239)
    assert (gap["frames"], gap["seconds"], gap["filled"]) == (240, 4.0, 240)
    assert gap["from"] == ["the database's nearest poses"]
    assert gap["left_missing"] == []


def test_published_method(folder: Path, database: Path) -> None:
    result = run("fill", "drop.c3d", "-o", "out.c3d", "-d", database, "-m", "baumann2011")
    assert result.exit_code == 0
    assert (
        "460 samples filled by baumann2011, 8 of 8 gaps wholly; written to out.c3d" in result.stdout
    )
    assert "256 nearest poses by" in result.stdout


def test_left_missing(folder: Path) -> None:
    result = run("fill", "drop.c3d", "-o", "out.c3d")
    assert result.exit_code == 3
    first = read("drop.c3d").first_frame
    assert result.stderr == (
        f"left missing: 240 samples of 1 marker (C7) within frames {first}-{first + 239}: "
        "hardly a frame of the clip shows it together with the visible markers, "
        "and there is no database\n"
    )
    assert "220 samples filled by prior, 7 of 8 gaps wholly" in result.stdout
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
    assert gap["expected_error_mm"] is None
    assert gap["filled"] == 0
    (left,) = gap["left_missing"]
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
    result = run("fill", "walk.c3d", "-o", "out.c3d")
    assert_refused(result, "out.c3d", "overwrite")
    assert Path("out.c3d").read_text() == "precious"
    result = run("fill", "walk.c3d", "-o", "out.c3d", "--overwrite")
    assert result.exit_code == 0
    assert not read("out.c3d").missing.any()


def test_integers_are_rounded_and_it_says_so(folder: Path) -> None:
    records = standing(40, step=0.5)
    records[10:20, 5] = [0, 0, 0, -1]
    Path("whole.c3d").write_bytes(C3DFile(records, LABELS, is_float=False, scale=0.5).bytes())
    result = run("fill", "whole.c3d", "-o", "out.c3d", "-m", "prior")
    assert result.exit_code == 0
    assert "the file stores whole numbers: filled samples are rounded by up to 0." in result.stdout
    assert differing_records(Path("whole.c3d"), Path("out.c3d")) == {(f, 5) for f in range(10, 20)}


def test_metres(folder: Path) -> None:
    """A file that says m and is in m comes out in m."""
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
    result = run("fill", "walk.c3d", "-o", "out.c3d", "--rate", "30", "--up", "+Z", "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["rate"] == 30


def test_a_progress_bar_only_on_a_terminal(folder: Path) -> None:
    assert "filling" not in run("fill", "walk.c3d", "-o", "out.c3d").stderr


# what it refuses


def assert_refused(result: Result, *words: str) -> None:
    assert result.exit_code == 1, result.output
    assert result.stdout == ""
    assert result.stderr.startswith("priorfill: ")
    assert result.stderr.count("\n") == 1
    assert "Traceback" not in result.stderr
    assert "fault of priorfill itself" not in result.stderr
    for word in words:
        assert word in result.stderr, (word, result.stderr)


def bad_files() -> dict[str, tuple[bytes, str]]:
    """Contents that cannot be filled, each with a word that the message must have."""
    whole = C3DFile(standing(40), LABELS)
    infinite = standing(40)
    infinite[12, 3, 1] = np.inf
    metres = standing(40)
    metres[:, :, :3] /= 1000
    return {
        "not C3D": (b"this is no C3D file, whatever its name says\n" * 40, "C3D"),
        "a picture": (b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 8, ""),
        "cut in the data": (whole.bytes()[:-1500], "cut short"),
        "cut in the parameters": (whole.bytes()[:700], "cut short"),
        "cut in the header": (whole.bytes()[:100], ""),
        "empty": (b"", "empty"),
        "no frames": (C3DFile(standing(0), LABELS).bytes(), "no frames"),
        "no points": (C3DFile(np.zeros((5, 0, 4)), []).bytes(), ""),
        "no rate": (C3DFile(standing(40), LABELS, rate=0.0).bytes(), "--rate"),
        "duplicate labels": (
            C3DFile(standing(40), ["C7", *LABELS[1:]]).bytes(),
            "C7",
        ),
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
    """Really one line, whatever libraries print by themselves."""
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
        (["no.c3d", "-o", "out.c3d"], "no such file"),
        (["folder.c3d", "-o", "out.c3d"], "folder"),
        (["text.txt", "-o", "out.c3d"], "suffix"),
        (["walk.c3d", "-o", "out.txt"], "suffix"),
        (["walk.c3d", "-o", "folder.c3d"], "folder.c3d"),
        (["walk.c3d", "-o", "folder.c3d", "--overwrite"], "folder.c3d"),
        (["walk.c3d", "-o", "nowhere/out.c3d"], "nowhere"),
        (["walk.c3d", "-o", "text.txt/out.c3d"], "text.txt"),
        (["walk.c3d", "-o", "out.c3d", "-m", "spline"], "spline"),
        (["walk.c3d", "-o", "out.c3d", "--up", "sideways"], "sideways"),
        (["walk.c3d", "-o", "out.c3d", "--rate", "-5"], "-5"),
        (["walk.c3d", "-o", "out.c3d", "--rate", "nan"], "nan"),
        (["walk.c3d", "-o", "out.c3d", "--unit", "parsec"], "parsec"),
        (["walk.c3d", "-o", "out.c3d", "--marker-set", "nonsense"], "nonsense"),
        (["walk.c3d", "-o", "out.c3d", "--subject", "nobody"], "nobody"),
    ):
        before = Path("walk.c3d").read_bytes()
        names = listing()
        assert_refused(run("fill", *arguments), word)
        assert listing() == names
        assert Path("walk.c3d").read_bytes() == before


def test_wrong_usage(folder: Path) -> None:
    for arguments in (["walk.c3d"], ["-o", "out.c3d"], ["walk.c3d", "-o", "out.c3d", "--what"]):
        assert run("fill", *arguments).exit_code == 2


@pytest.mark.parametrize("arguments", [[], ["--overwrite"]])
def test_output_is_the_input(folder: Path, arguments: list[str]) -> None:
    before = Path("walk.c3d").read_bytes()
    Path("link.c3d").symlink_to("walk.c3d")
    os.link("walk.c3d", "hard.c3d")
    Path("sub").mkdir()
    for name in ("walk.c3d", "link.c3d", "hard.c3d", "sub/../walk.c3d", str(folder / "walk.c3d")):
        assert_refused(run("fill", "walk.c3d", "-o", name, *arguments), "read from")
    assert_refused(run("fill", "link.c3d", "-o", "walk.c3d", *arguments), "read from")
    assert Path("walk.c3d").read_bytes() == before
    assert Path("link.c3d").is_symlink()


def test_databases_that_are_none(folder: Path, database: Path) -> None:
    def refused(place: str | Path, *words: str) -> None:
        names = listing()
        result = run("fill", "walk.c3d", "-o", "out.c3d", "-d", place)
        assert_refused(result, *words)
        assert listing() == names

    refused("nowhere", "nowhere")
    Path("things").mkdir()
    Path("things/notes.txt").write_text("not a database")
    refused("things", "things")
    refused("walk.c3d", "walk.c3d")
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
    shutil.copytree(database, "gutted")
    shutil.rmtree("gutted/segments")
    refused("gutted", "gutted")

    with PriorDatabase.create("strange") as made:
        names = tuple(f"X{i}" for i in range(41))
        made.add(Clip(person().positions, names, 60.0, name="other"))
    refused("strange", "no marker in common", "strange")
    PriorDatabase.create("empty").close()
    refused("empty", "it is empty")


def test_interrupted(folder: Path) -> None:
    """Ctrl-C in the middle: one line, status 130, nothing left behind."""
    program = (
        "import os, signal, threading, priorfill.filling as f\n"
        "def slow(*a): os.kill(os.getpid(), signal.SIGINT); import time; time.sleep(20)\n"
        "f.get_method = lambda name: slow\n"
        "from priorfill.cli import main; main()"
    )
    names = listing()
    started = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-c", program, "fill", "walk.c3d", "-o", "out.c3d"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert time.monotonic() - started < 15
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
    # nothing flies away: filled samples are where markers are seen at some time
    before, after = read(source), read(output)
    assert (after.positions > np.nanmin(before.positions, axis=(0, 1)) - 300).all()
    assert (after.positions < np.nanmax(before.positions, axis=(0, 1)) + 300).all()
