"""What commands print about artefacts, and what they do about them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from gappy import person, with_gaps

from priorfill.cli import main
from priorfill.clip import Clip
from priorfill.formats import read, write

TRUTH = replace(person(rate=120.0, seconds=2.5), first_frame=1000)
SPIKES = (("LWRA", 100), ("LWRB", 140), ("RTOE", 60), ("C7", 90), ("RKNE", 120), ("LFIN", 200))


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def with_artefacts(*spikes: tuple[str, int]) -> Clip:
    """The clip with spikes of 4 frames and 70 mm, and a gap."""
    positions = TRUTH.positions.copy()
    for label, start in spikes:
        positions[start : start + 4, TRUTH.labels.index(label)] += [0, 70, 0]
    return with_gaps(TRUTH.with_positions(positions), (20, 40, ("LKNE",)))


@pytest.fixture(autouse=True)
def folder(here: Path) -> Path:
    write("one.c3d", with_artefacts(SPIKES[0]))
    write("many.c3d", with_artefacts(*SPIKES))
    write("clean.c3d", with_artefacts())
    return here


def test_inspect_has_a_table_and_json() -> None:
    output = run("inspect", "one.c3d").output
    lines = output.splitlines()
    title = lines.index("Artefacts: measured samples that are probably wrong")
    assert lines[title + 1].split() == ["kind", "marker", "frames", "evidence"]
    assert lines[title + 2].startswith("spike  LWRA    1100-1103  LWRA-")
    assert " mm, usually " in lines[title + 2]
    (spike,) = json.loads(run("inspect", "one.c3d", "--json").output)["artefacts"]
    assert (spike["kind"], spike["markers"]) == ("spike", ["LWRA"])
    assert (spike["first_frame"], spike["last_frame"]) == (1100, 1103)
    assert spike["size_mm"] == pytest.approx(70, abs=5)
    assert spike["reference_marker"] in TRUTH.labels
    assert spike["evidence"] in " ".join(output.split())


def test_inspect_lists_no_artefacts_of_a_clean_clip() -> None:
    assert "Artefact" not in run("inspect", "clean.c3d").output
    assert json.loads(run("inspect", "clean.c3d", "--json").output)["artefacts"] == []


def test_fill_warns_and_changes_nothing_that_is_measured() -> None:
    result = run("fill", "one.c3d", "-o", "out.c3d", "-m", "linear")
    assert result.exit_code == 0
    warnings = [line for line in result.stderr.splitlines() if line.startswith("warning: ")]
    assert warnings[0].startswith(
        "warning: LWRA leaves its path for a moment in frames 1100-1103 (LWRA-"
    )
    assert warnings[1:] == [
        "warning: these samples are kept as measured; --reject-artefacts fills them"
    ]
    before, after = read("one.c3d"), read("out.c3d")
    seen = ~before.missing
    np.testing.assert_array_equal(after.positions[seen], before.positions[seen])


def test_fill_shows_a_handful_of_warnings() -> None:
    result = run("fill", "many.c3d", "-o", "out.c3d", "-m", "linear")
    warnings = [line for line in result.stderr.splitlines() if line.startswith("warning: ")]
    assert len(warnings) == 7
    assert warnings[5] == "warning: 1 more; list them with: priorfill inspect many.c3d"
    assert "warning" not in run("fill", "clean.c3d", "-o", "c.c3d", "-m", "linear").stderr


def test_reject_artefacts_fills_and_lists_them() -> None:
    options = ("-m", "linear", "--reject-artefacts", "--uncertainty", "how.npz")
    result = run("fill", "many.c3d", "-o", "out.c3d", *options)
    assert result.exit_code == 0, result.output
    assert "warning" not in result.stderr
    lines = result.stdout.splitlines()
    title = lines.index("Artefacts, treated as missing")
    kinds = [line.split()[:3] for line in lines[title + 2 :] if line.startswith("spike")]
    assert kinds == [
        ["spike", label, f"{1000 + start}-{1003 + start}"]
        for label, start in sorted(SPIKES, key=lambda spike: spike[1])
    ]
    wrong = np.linalg.norm(with_artefacts(*SPIKES).positions - TRUTH.positions, axis=2) > 60
    before, after = read("many.c3d"), read("out.c3d")
    off = np.linalg.norm(after.positions - TRUTH.positions, axis=2)
    assert off[wrong].mean() < 5
    kept = ~before.missing & ~wrong
    np.testing.assert_array_equal(after.positions[kept], before.positions[kept])
    assert (np.load("how.npz")["filled"] == (wrong | before.missing)).all()

    facts = json.loads(
        run(
            "fill", "many.c3d", "-o", "b.c3d", "-m", "linear", "--reject-artefacts", "--json"
        ).stdout
    )
    assert facts["rejected_samples"] == wrong.sum()
    assert len(facts["artefacts"]) == len(SPIKES)
    assert {"LWRA", "LKNE"} <= {gap["marker"] for gap in facts["gaps"]}


def test_what_is_rejected_and_not_filled_is_named() -> None:
    options = ("-m", "linear", "--reject-artefacts", "--markers", "LKNE")
    result = run("fill", "one.c3d", "-o", "out.c3d", *options)
    assert result.exit_code == 0
    assert (
        "left as measured: 4 rejected samples of LWRA were not filled; "
        "they are the same in out.c3d as in one.c3d"
    ) in result.stderr
    before, after = read("one.c3d"), read("out.c3d")
    seen = ~before.missing
    np.testing.assert_array_equal(after.positions[seen], before.positions[seen])


@pytest.mark.parametrize("suffix", [".trc", ".npz"])
def test_rejected_samples_in_other_formats(suffix: str) -> None:
    write("one" + suffix, with_artefacts(SPIKES[0]))
    options = ("-m", "linear", "--reject-artefacts")
    result = run("fill", "one" + suffix, "-o", "out" + suffix, *options)
    assert result.exit_code == 0, result.output
    marker = TRUTH.labels.index("LWRA")
    off = np.linalg.norm((read("out" + suffix).positions - TRUTH.positions)[:, marker], axis=1)
    assert off.max() < 10


def test_a_database_does_not_hold_artefacts() -> None:
    added = run("db", "add", "-v", "-d", "db", "one.c3d", "clean.c3d").output.splitlines()
    assert added[0] == (
        "added one.c3d, without 4 samples of LWRA that are artefacts (see: priorfill inspect)"
    )
    (clip,) = json.loads(run("db", "list", "-d", "db", "--json").output)
    lacks = np.array(clip["frames"][0]) - clip["present"]
    assert {TRUTH.labels[i] for i in np.flatnonzero(lacks)} == {"LWRA", "LKNE"}
    assert "skipped" in run("db", "add", "-d", "db", "one.c3d").output
    run("db", "add", "-d", "all", "--keep-artefacts", "one.c3d")
    (clip,) = json.loads(run("db", "list", "-d", "all", "--json").output)
    assert clip["present"][TRUTH.labels.index("LWRA")] == clip["frames"][0]
