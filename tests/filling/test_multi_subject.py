"""Several subjects in one file: each filled by itself, all in one output."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from gappy import ARM, person, with_gaps

from priorfill.cli import main
from priorfill.clip import Clip
from priorfill.database import PriorDatabase
from priorfill.errors import ClipError
from priorfill.filling.fill_clip import fill
from priorfill.filling.multi_subject import merge_results, read_subjects
from priorfill.formats import read, write

GAPS = {"Anna": ((60, 90, ARM), (200, 230, ("LKNE",))), "Ben": ((70, 100, ("LKNE", "C7")),)}


def people() -> dict[str, Clip]:
    """Two subjects with gaps, as a file of each alone holds them."""
    return {
        name: replace(with_gaps(person(seed=seed, body=seed), *GAPS[name]), subject=name)
        for name, seed in (("Anna", 3), ("Ben", 4))
    }


def write_two(path: str) -> None:
    clips = people().values()
    both = Clip(
        np.concatenate([clip.positions for clip in clips], axis=1),
        tuple(f"{clip.subject}:{label}" for clip in clips for label in clip.labels),
        60.0,
    )
    write(path, both)


def run(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["fill", "two.c3d", *arguments])


@pytest.fixture
def two(here: Path) -> Path:
    write_two("two.c3d")
    return here / "two.c3d"


def test_each_is_filled_as_if_alone(two):
    result = run("-o", "out.c3d", "-m", "r2")
    assert result.exit_code == 0, result.output
    assert "filled 270 samples with r2; 9 of 9 gaps complete; written to out.c3d" in result.stdout
    lines = [line.split()[:2] for line in result.stdout.splitlines()]
    assert ["Anna:LKNE", "201-230"] in lines
    assert ["Ben:LKNE", "71-100"] in lines
    merged = fill(read_subjects("two.c3d"), method="r2")
    for name, one in zip(GAPS, merged.subjects, strict=True):
        alone = fill(read("two.c3d", subject=name), method="r2")
        filled = read("out.c3d", subject=name)
        assert not filled.missing.any()
        np.testing.assert_allclose(filled.positions, alone.clip.positions, rtol=0, atol=1e-3)
        np.testing.assert_array_equal(one.clip.positions, alone.clip.positions)
    assert [clip.subject for clip in merged.provenance.clips] == ["Anna", "Ben"]


def test_json_uncertainty_and_database(two):
    result = run(
        *("-o", "out.trc", "-m", "linear", "--json", "--uncertainty", "u.csv"),
        *("-d", "db", "--add-to-database"),
    )
    assert result.exit_code == 0, result.output
    facts = json.loads(result.stdout)
    assert facts["filled_samples"] == 270
    assert [(who["subject"], who["filled_samples"]) for who in facts["subjects"]] == [
        ("Anna", 210),
        ("Ben", 60),
    ]
    assert {(gap["subject"], gap["marker"]) for gap in facts["gaps"]} == {
        *(("Anna", label) for label in (*ARM, "LKNE")),
        *(("Ben", label) for label in ("LKNE", "C7")),
    }
    assert "Ben:C7,71," in Path("u.csv").read_text()
    with PriorDatabase.open("db") as database:
        clips = {record.content: record.subject for record in database.clips()}
    assert {who["added"]: who["subject"] for who in facts["subjects"]} == clips
    assert sorted(clips.values()) == ["Anna", "Ben"]


def test_one_of_them_alone(two):
    result = run("-o", "out.c3d", "-m", "linear", "--subject", "Ben", "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["filled_samples"] == 60
    before, after = (read(name, subject="Anna") for name in ("two.c3d", "out.c3d"))
    np.testing.assert_array_equal(before.positions, after.positions)


def test_markers_and_overrides_of_one_or_all(two):
    def filled(*arguments: str) -> dict[str, int]:
        result = run("-o", "out.c3d", "-m", "linear", "--json", "--overwrite", *arguments)
        assert result.exit_code == 0, result.output
        who = json.loads(result.stdout)["subjects"]
        return {one["subject"]: one["filled_samples"] for one in who}

    assert filled("--markers", "LKNE") == {"Anna": 30, "Ben": 30}
    assert filled("--markers", "Ben:*") == {"Anna": 0, "Ben": 60}
    Path("d.toml").write_text(
        '[[gap]]\nmarker = "LKNE"\nsubject = "Anna"\ndo = "leave"\n'
        '[[gap]]\nmarker = "Ben:C7"\ndo = "leave"\n'
    )
    assert filled("--overrides", "d.toml") == {"Anna": 180, "Ben": 30}
    Path("d.toml").write_text('[[gap]]\nmarker = "LKNE"\nsubject = "Carl"\ndo = "leave"\n')
    result = run("-o", "new.c3d", "--overrides", "d.toml")
    assert result.exit_code == 2
    assert "there is no subject 'Carl'; use one of Anna, Ben" in result.stderr
    assert "'HIP'" in run("-o", "new.c3d", "--markers", "HIP").stderr


def test_other_recordings_go_to_their_subject(two):
    write("anna.c3d", replace(person(seed=3, body=3, seconds=2.0), subject="Anna"))
    result = run("-o", "out.c3d", "-m", "linear", "--same-subject", "anna.c3d")
    assert result.exit_code == 0, result.output
    write("who.c3d", replace(person(seed=3, body=3, seconds=2.0), subject=""))
    result = run("-o", "new.c3d", "-m", "linear", "--same-subject", "who.c3d")
    assert result.exit_code == 2
    assert "who.c3d: does not state whether it is of Anna, Ben" in result.stderr


def test_subjects_with_different_axes():
    anna, ben = (fill(clip, method="linear") for clip in people().values())
    turned = replace(ben, clip=replace(ben.clip, up="+Y"))
    with pytest.raises(ClipError, match=r"for Anna and \+Y for Ben; give the right one \(`up`\)"):
        merge_results([anna, turned])
    assert merge_results([anna]) is anna
