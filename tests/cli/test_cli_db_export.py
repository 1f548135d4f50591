"""``priorfill db export``: content and names of the files, and refusals."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from db_cli import gappy_and_filled, run, small_clip

from priorfill.clip import Clip
from priorfill.database import ClipOrigin, PriorDatabase
from priorfill.errors import OutputError
from priorfill.formats import create_npz, read

_WORDS = re.compile(r"(?<=created )\(.*?\)")


@pytest.fixture
def ids(here: Path) -> dict[tuple[str, str], str]:
    """A database `db`; the first digits of its clips' hashes, by name and subject."""
    with PriorDatabase.create("db") as database:
        gappy, _, _ = gappy_and_filled(small_clip("run", 1, subject="anna"))
        _, filled, mask = gappy_and_filled(small_clip("Walk", 2, subject="anna"))
        database.add(gappy, ClipOrigin(licence="CC0", credit="lab", session="2"))
        database.accept(filled, mask, filled_by="gpr")
        database.add(small_clip("walk", 3, subject="ben"))
        return {(r.name, r.subject): r.content[:8] for r in database.clips()}


def files(folder: str = "out") -> list[str]:
    return sorted(path.name for path in Path(folder).iterdir())


def stored(name: str) -> np.ndarray:
    with PriorDatabase.open("db") as database:
        (record,) = (record for record in database.clips() if record.name == name)
        return database.positions(record).copy()


def test_c3d(ids: dict[tuple[str, str], str]) -> None:
    result = run("db", "export", "-d", "db", "-o", "out")
    assert result.exit_code == 0
    walk, other = f"Walk-{ids['Walk', 'anna']}", f"walk-{ids['walk', 'ben']}"
    assert result.stdout.splitlines() == [
        f"{Path('out', walk)}.c3d: Walk (anna, 1.00 s, {ids['Walk', 'anna']})",
        f"{Path('out/run.c3d')}: run (anna, 1.00 s, {ids['run', 'anna']})",
        f"{Path('out', other)}.c3d: walk (ben, 1.00 s, {ids['walk', 'ben']})",
        "exported 3 clips, 3.00 s of motion",
    ]
    assert result.stderr == (
        "note: 1 clip with filled samples, which these C3D files do not distinguish from "
        "measured ones (--format npz does; --measured-only leaves them out)\n"
    )
    assert files() == sorted([f"{walk}.c3d", f"{other}.c3d", "run.c3d"])
    clip = read("out/run.c3d")
    assert (clip.labels, clip.rate, clip.up) == (("LASI", "RASI", "SACR", "C7"), 30.0, "+Z")
    assert (clip.subject, clip.first_frame) == ("anna", 1)
    np.testing.assert_array_equal(clip.positions, stored("run"))
    assert clip.missing.sum() == 10


def test_exported_files_can_be_added(ids: object) -> None:
    """To another database of the same rate, which filters nothing: bit for bit."""
    run("db", "export", "-d", "db", "-o", "out", "--measured-only")
    assert run("db", "add", "-d", "again", "out").exit_code == 0
    with PriorDatabase.open("again") as database:
        (record,) = (record for record in database.clips() if record.name == "run")
        np.testing.assert_array_equal(database.positions(record), stored("run"))


def test_npz(ids: dict[tuple[str, str], str]) -> None:
    result = run("db", "export", "-d", "db", "-o", "out", "--format", "npz", "run", "W*")
    assert (result.exit_code, result.stderr) == (0, "")
    walk = f"Walk-{ids['Walk', 'anna']}.npz"
    assert files() == [walk, "run.npz"]
    with np.load("out/run.npz") as archive:
        run_ = {name: archive[name] for name in archive.files}
    np.testing.assert_array_equal(run_["positions"], stored("run"))
    assert run_["positions"].dtype == np.float32
    assert run_["labels"].tolist() == ["LASI", "RASI", "SACR", "C7"]
    assert not run_["filled"].any()
    assert run_["filled"].shape == (30, 4)
    facts = {name: run_[name].item() for name in run_ if run_[name].ndim == 0}
    assert facts.pop("content").startswith(ids["run", "anna"])
    assert facts.pop("added")
    assert facts.pop("version")
    assert facts == {
        "name": "run",
        "subject": "anna",
        "session": "2",
        "source": "",
        "licence": "CC0",
        "credit": "lab",
        "original_rate": 120.0,
        "original_frames": 120,
        "rate": 30.0,
        "marker_set": "",
        "filled_by": "",
        "synthetic": False,
        "virtual_markers": False,
        "unit": "mm",
        "up": "+Z",
    }
    assert run_["measured"].tolist() == [30, 30, 30, 20]
    with np.load(f"out/{walk}") as archive:
        assert archive["filled"].sum() == 10
        assert archive["filled"][10:20, 3].all()
        assert archive["filled_by"].item() == "gpr"


@pytest.mark.parametrize("suffix", ["c3d", "npz"])
def test_measured_only(suffix: str, ids: object) -> None:
    line = ["db", "export", "-d", "db", "-o", "out", "--format", suffix, "--measured-only", "Walk"]
    result = run(*line)
    assert (result.exit_code, result.stderr) == (0, "")
    (path,) = Path("out").iterdir()
    if suffix == "c3d":
        missing = read(path).missing
    else:
        with np.load(path) as archive:
            missing = np.isnan(archive["positions"][..., 0])
            assert not archive["filled"].any()
    assert missing[10:20, 3].all()
    assert missing.sum() == 10


def test_some(ids: dict[tuple[str, str], str]) -> None:
    for line, expected in (
        (["--subject", "ben"], [f"walk-{ids['walk', 'ben']}.c3d"]),
        (["--subject", "a*", "run"], ["run.c3d"]),
        ([ids["walk", "ben"]], [f"walk-{ids['walk', 'ben']}.c3d"]),
        (["--marker", "C7", "--marker", "LASI", "r*"], ["run.c3d"]),
    ):
        folder = f"deep/{len(line)}{line[0]}"
        assert run("db", "export", "-d", "db", "-o", folder, *line).exit_code == 0
        assert files(folder) == expected
    for line, text in (
        (["jump"], "db: no clip is called jump"),
        (["--marker", "T10"], "db: has no clip with marker T10"),
        (
            ["--marker", "C7", "--subject", "x", "run"],
            "no clip of subject x with marker C7 is called",
        ),
    ):
        result = run("db", "export", "-d", "db", "-o", "no", *line)
        assert (result.exit_code, result.stdout) == (2, "")
        assert text in result.stderr
        assert "see: priorfill db list --database db\n" in result.stderr
    assert not Path("no").exists()


def test_existing_files(ids: object) -> None:
    run("db", "export", "-d", "db", "-o", "out")
    Path("out/run.c3d").write_text("precious")
    result = run("db", "export", "-d", "db", "-o", "out", "run")
    assert (result.exit_code, result.stdout) == (1, "")
    assert result.stderr == (
        f"priorfill: {Path('out/run.c3d')}: exists already; choose another folder (-o) "
        "or use --overwrite\n"
    )
    result = run("db", "export", "-d", "db", "-o", "out")
    assert "exists already, and 2 more; choose" in result.stderr
    assert Path("out/run.c3d").read_text() == "precious"
    assert run("db", "export", "-d", "db", "-o", "out", "--overwrite").exit_code == 0
    assert read("out/run.c3d").frames == 30


def test_wrong_folders(ids: object) -> None:
    Path("file").write_text("x")
    for folder, text in (
        ("db", "is inside the database"),
        ("db/out", "is inside the database"),
        ("file", "cannot be created (File exists)"),
        ("file/out", "cannot be created (Not a directory)"),
    ):
        result = run("db", "export", "-d", "db", "-o", folder)
        assert (result.exit_code, result.stdout) == (1, "")
        expected = f"priorfill: {Path(folder)}: {text}; choose another folder (-o)\n"
        if sys.platform == "win32":  # which has other words for it
            result_line, expected = (_WORDS.sub("(...)", one) for one in (result.stderr, expected))
            assert result_line == expected
        else:
            assert result.stderr == expected
    assert run("db", "export", "-d", "db").exit_code == 2
    assert run("db", "export", "-d", "db", "-o", "out", "--format", "bvh").exit_code == 2


def test_an_empty_database(here: Path) -> None:
    PriorDatabase.create("db").close()
    result = run("db", "export", "-d", "db", "-o", "out")
    assert (result.exit_code, result.stdout) == (0, "exported 0 clips\n")


def test_odd_names(here: Path) -> None:
    clip = small_clip("x", 2)
    odd = ["a/b", "a:b", "../up", ".hidden", "", "ä" * 200, "tab\there", "same", "same"]
    odd += ["NUL", "com1.x", "trail. .", "kıl", "KIL"]  # Windows takes the last two for one
    with PriorDatabase.create("db") as database:
        for seed, name in enumerate(odd):
            database.add(small_clip(name, seed))
        same = [record for record in database.clips() if record.name == "same"]
        # called as the file of another one is
        database.add(small_clip(f"same-{same[0].content[:8]}", 50))
    assert clip.frames == 120
    result = run("db", "export", "-d", "db", "-o", "out")
    assert (result.exit_code, result.stderr) == (0, "")
    found = files()
    assert len(found) == len(odd) + 1
    assert {"_up.c3d", "hidden.c3d", "clip.c3d", "ä" * 75 + ".c3d", "tab_here.c3d"} <= set(found)
    assert {"_NUL.c3d", "_com1.x.c3d", "trail.c3d"} <= set(found)
    assert sum(name.startswith("a_b-") for name in found) == 2
    assert sum(name.lower().startswith(("kıl-", "kil-")) for name in found) == 2
    assert sum(name.startswith("same-") for name in found) == 3
    assert files(".") == ["db", "out"]


def test_a_damaged_clip_is_not_exported(ids: object) -> None:
    segment = Path("db/segments/000001.f32")
    data = bytearray(segment.read_bytes())
    data[100] ^= 4  # behind the header
    segment.write_bytes(bytes(data))
    result = run("db", "export", "-d", "db", "-o", "out")
    assert result.exit_code == 1
    assert result.stderr.startswith("priorfill: db: positions of clip run are damaged")
    assert result.stdout.endswith("exported 2 clips, 2.00 s of motion, could not export 1\n")
    assert "run.c3d" not in files()


def test_a_clip_too_long_for_c3d(ids: object, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("priorfill.formats.c3d.create.MAX_C3D_FRAMES", 30)
    with PriorDatabase.open("db", write=True) as database:
        database.add(small_clip("long", 8, frames=200))
    result = run("db", "export", "-d", "db", "-o", "out")
    assert result.exit_code == 1
    assert result.stderr.splitlines()[0] == (
        "priorfill: long: has 50 frames, C3D holds 30; export it with --format npz"
    )
    assert len(files()) == 3


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limit on the size of files")
@pytest.mark.parametrize("suffix", ["c3d", "npz"])
def test_a_full_disk_stops_it(suffix: str, ids: object) -> None:
    """With a limit of 2 kB per file, which ezc3d alone would not notice."""
    program = (
        "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (2048, 2048))\n"
        "from priorfill.cli import main; main()"
    )
    line = ["db", "export", "-d", "db", "-o", "out", "--format", suffix]
    done = subprocess.run(
        [sys.executable, "-c", program, *line], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("priorfill: out/Walk-")
    assert done.stderr.endswith("check the folder's permissions and space\n")
    assert done.stderr.count("\n") == 1
    assert files() == []


def test_npz_is_the_same_each_time(here: Path) -> None:
    arrays = {"positions": np.zeros((3, 2, 3)), "name": "walk", "labels": ("A", "B"), "rate": 30.0}
    create_npz("one.npz", arrays)
    create_npz("two.npz", arrays)
    assert Path("one.npz").read_bytes() == Path("two.npz").read_bytes()
    with pytest.raises(OutputError, match="exists already"):
        create_npz("one.npz", arrays)
    create_npz("one.npz", {"rate": 60.0}, overwrite=True)
    with np.load("one.npz") as archive:
        assert archive.files == ["rate"]
    with pytest.raises(ValueError, match="odd is of type object; give numbers or strings"):
        create_npz("three.npz", {"odd": np.array([None])})
    assert files(".") == ["one.npz", "two.npz"]


def test_a_reader_of_the_same_clip(ids: object) -> None:
    """The exported arrays are valid arguments of `Clip`: NaN where missing."""
    run("db", "export", "-d", "db", "-o", "out", "--format", "npz", "run")
    with np.load("out/run.npz") as archive:
        clip = Clip(archive["positions"], tuple(archive["labels"].tolist()), archive["rate"].item())
    assert clip.missing.sum() == 10
