"""``priorfill inspect``: its description of a file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from priorfill.cli import main
from priorfill.clip import Clip
from priorfill.database import PriorDatabase
from priorfill.formats import write
from priorfill.markers.definitions import load

RATE = 100.0
FRAMES = 200


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def person() -> tuple[np.ndarray, tuple[str, ...]]:
    """A box of the 41 markers that walks along x, heads above feet, +Z up."""
    labels = load("baumann41").labels
    rng = np.random.default_rng(0)
    height = {"head": 1700, "thorax": 1400, "pelvis": 1000}
    segment = load("baumann41").segment
    t = np.arange(FRAMES) / RATE
    positions = np.empty((FRAMES, len(labels), 3))
    for m, label in enumerate(labels):
        level = height.get(segment[label], 800)
        if any(word in segment[label] for word in ("foot", "shank")):
            level = 80
        swing = 40 * np.sin(2 * np.pi * t + rng.uniform(0, 6))
        positions[:, m] = rng.uniform(-150, 150, 3) * [1, 1, 0.3] + [0, 0, level]
        positions[:, m, 0] += 1200 * t + swing
    return positions, labels


@pytest.fixture
def gappy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file with gaps: LKNE twice, RKNE overlapping the second, LFIN never visible."""
    monkeypatch.chdir(tmp_path)
    positions, labels = person()
    positions[:20, labels.index("LKNE")] = np.nan
    positions[100:150, labels.index("LKNE")] = np.nan
    positions[140:170, labels.index("RKNE")] = np.nan
    positions[:, labels.index("LFIN")] = np.nan
    write(tmp_path / "walk.c3d", Clip(positions, labels, RATE, name="walk", first_frame=1))
    return Path("walk.c3d")


def test_text(gappy: Path) -> None:
    result = run("inspect", gappy)
    assert result.exit_code == 0
    lines = result.output.splitlines()
    assert lines[0] == "walk.c3d"
    facts = {line[2:13].strip(): line[14:] for line in lines[1 : lines.index("")]}
    assert facts["markers"] == "41"
    assert facts["frames"] == "200 at 100 Hz, 2.00 s; numbered from 1"
    assert facts["unit"] == "mm"
    assert facts["up"].startswith("+Z, ")
    assert facts["marker set"] == "baumann41, 41 of its 41 markers"
    assert facts["missing"] == "3.7 % of the samples, in 4 gaps of 3 markers"
    rest = "\n".join(lines[lines.index("") :])
    assert rest == (
        "\n"
        "Gaps by marker\n"
        "marker  segment      gaps  frames      %  longest s  clip frames\n"
        "LFIN    left_hand     all     200  100.0       2.00            0\n"
        "LKNE    left_thigh      2      70   35.0       0.50          130\n"
        "RKNE    right_thigh     1      30   15.0       0.30          170\n"
        "\n"
        "Gap groups\n"
        "frames     s  gaps  markers\n"
        " 1-200  2.00     4  LFIN LKNE RKNE (from the clip's start) (to the clip's end)\n"
        "\n"
        "From the clip itself (visible with 3 others or more): LKNE RKNE.\n"
        "Never visible, so at best from the contralateral marker: LFIN; a database\n"
        "(--database) or another recording of the subject (--same-subject) can help."
    )


def test_json(gappy: Path) -> None:
    result = run("inspect", gappy, "--json")
    assert result.exit_code == 0
    facts = json.loads(result.output)
    assert facts["file"] == "walk.c3d"
    assert facts["markers"] == len(facts["labels"]) == 41
    assert (facts["frames"], facts["rate"], facts["seconds"]) == (200, 100.0, 2.0)
    assert facts["marker_set"] == {
        "name": "baumann41",
        "title": load("baumann41").title,
        "markers": 41,
        "found": 41,
        "absent": [],
        "unknown": [],
    }
    assert facts["missing_samples"] == 300
    assert facts["blackout_frames"] == 0
    assert facts["gaps"][1] == {
        "marker": "LKNE",
        "segment": "left_thigh",
        "gaps": [{"first_frame": 1, "frames": 20}, {"first_frame": 101, "frames": 50}],
        "frames": 70,
        "percent": 35.0,
        "longest_seconds": 0.5,
        "dropout": False,
        "clip_frames": 130,
    }
    assert facts["gap_groups"] == [
        {
            "first_frame": 1,
            "last_frame": 200,
            "seconds": 2.0,
            "gaps": 4,
            "markers": ["LFIN", "LKNE", "RKNE"],
            "at_start": True,
            "at_end": True,
        }
    ]
    assert "C7" in facts["reliable"]
    assert facts["segments"]["head"] == ["LFHD", "RFHD", "LBHD", "RBHD"]


def test_what_a_database_has(gappy: Path, tmp_path: Path) -> None:
    positions, labels = person()
    with PriorDatabase.create(tmp_path / "db") as database:
        database.add(Clip(positions, labels, RATE, name="whole"))
        positions[:, labels.index("LFIN")] = np.nan
        database.add(Clip(positions + 1.5, labels, RATE, name="without"))
        keep = [labels.index(x) for x in ("LFIN", "C7", "T10")]
        database.add(Clip(person()[0][:, keep] + 2.5, ("LFIN", "C7", "T10"), RATE, name="too few"))
    result = run("inspect", gappy, "--database", "db")
    assert result.exit_code == 0
    assert "longest s  clip frames  database clips\n" in result.output
    assert "LFIN    left_hand     all     200  100.0       2.00            0               1\n" in (
        result.output
    )
    assert result.output.endswith(
        "From the clip itself (visible with 3 others or more): LKNE RKNE.\n"
        "From the database only: LFIN.\n"
    )
    facts = json.loads(run("inspect", gappy, "-d", "db", "--json").output)
    assert {gap["marker"]: gap["database_clips"] for gap in facts["gaps"]} == {
        "LFIN": 1,
        "LKNE": 2,
        "RKNE": 2,
    }


def test_blackout_and_barely_visible(tmp_path: Path) -> None:
    positions, labels = person()
    positions[50:60] = np.nan
    positions[20:, labels.index("C7")] = np.nan
    write(tmp_path / "x.c3d", Clip(positions, labels, RATE))
    output = " ".join(run("inspect", tmp_path / "x.c3d").output.split())
    assert "Barely from the clip itself (visible for less than 0.5 s): C7; a database" in output
    assert output.endswith(
        "No marker is visible in 10 frames; the longer a blackout, the less certain its fill."
    )


def test_many_gap_groups_are_cut_short(tmp_path: Path) -> None:
    positions, labels = person()
    for i in range(25):
        positions[8 * i : 8 * i + 1 + (i % 5), 0] = np.nan
    write(tmp_path / "x.c3d", Clip(positions, labels, RATE))
    output = run("inspect", tmp_path / "x.c3d").output
    assert "Gap groups, the 20 longest of 25 (--all: all)\n" in output
    everything = run("inspect", tmp_path / "x.c3d", "--all").output
    assert "longest of" not in everything
    assert len(everything.splitlines()) == len(output.splitlines()) + 5
    assert len(json.loads(run("inspect", tmp_path / "x.c3d", "--json").output)["gap_groups"]) == 25


def test_several_subjects(here: Path) -> None:
    positions, labels = person()
    both = np.concatenate([positions, positions + 500.0], axis=1)
    names = [f"{subject}:{label}" for subject in ("Anna", "Ben") for label in labels]
    both[20:50, names.index("Ben:LKNE")] = np.nan
    write("two.c3d", Clip(both, tuple(names), RATE))
    result = run("inspect", "two.c3d")
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert lines[0] == "two.c3d"
    assert [line.split()[1] for line in lines if line.startswith("  subject")] == ["Anna", "Ben"]
    facts = json.loads(run("inspect", "two.c3d", "--json").stdout)
    assert [one["subject"] for one in facts["subjects"]] == ["Anna", "Ben"]
    assert [len(one["gaps"]) for one in facts["subjects"]] == [0, 1]
    alone = json.loads(run("inspect", "two.c3d", "--subject", "Ben", "--json").stdout)
    assert alone == facts["subjects"][1]


def test_the_worst_markers_come_first_in_80_columns(here: Path) -> None:
    positions, labels = person()
    for number in range(30):
        positions[5 : 10 + number, number] = np.nan
    names = tuple(f"Rather_long_{label}" for label in labels)
    write("x.c3d", Clip(positions, names, RATE))
    lines = run("inspect", "x.c3d").stdout.splitlines()
    assert max(map(len, lines)) <= 80
    assert "... and 10 more markers (--all prints them)" in lines
    table = lines[lines.index("Gaps by marker") + 2 :][:20]
    assert table[0].startswith(names[29])
    assert table[19].startswith(names[10])


def test_no_gaps_and_no_known_set(tmp_path: Path) -> None:
    positions, labels = person()
    names = tuple(f"M{i:02d}" for i in range(len(labels)))
    write(tmp_path / "x.c3d", Clip(positions, names, RATE))
    output = run("inspect", tmp_path / "x.c3d").output
    assert "\n  marker set  not recognised; " in output
    assert output.splitlines()[-1].startswith("  missing     nothing") or "note" in output
    assert "Gaps by marker" not in output


def test_options(gappy: Path, tmp_path: Path) -> None:
    facts = json.loads(run("inspect", gappy, "--json", "--up", "-Y", "--rate", "50").output)
    assert (facts["up"], facts["up_found_from"], facts["rate"]) == ("-Y", "option", 50.0)
    (tmp_path / "mine.toml").write_text(
        'name = "mine"\ntitle = "Mine"\nroot_segments = ["all"]\n[markers]\n'
        'C7 = { segment = "all" }\nT10 = { segment = "all" }\n'
    )
    output = run("inspect", gappy, "--marker-set", "mine.toml").output
    assert "\n  marker set  mine, 2 of its 2 markers; not in the set: LFHD RFHD" in output


def test_bad_input(gappy: Path, tmp_path: Path) -> None:
    (tmp_path / "bad.c3d").write_bytes(b"rubbish")
    for status, arguments in (
        (2, ["no.c3d"]),
        (1, ["bad.c3d"]),
        (1, [tmp_path]),
        (2, [gappy, "--marker-set", "nonsense"]),
        (2, [gappy, "--database", "no"]),
    ):
        result = run("inspect", *arguments)
        assert result.exit_code == status, arguments
        assert result.stdout == ""
        assert result.stderr.startswith("priorfill: ")
        assert result.stderr.count("\n") == 1
    assert run("inspect").exit_code == 2
