"""The scripts of Baumann et al.'s figures and tables, on small libraries of synthetic takes."""

from __future__ import annotations

import argparse
import importlib
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from gappy import person
from scripted import SCRIPTS

import priorfill as pf
from priorfill.markers import definitions

PAPERS = SCRIPTS / "papers"
if str(PAPERS) not in sys.path:
    sys.path.insert(0, str(PAPERS))

baumann = importlib.import_module("baumann")
NAMES = ("fig2", "fig3", "fig4", "fig5", "table2")
scripts = {name: importlib.import_module(f"baumann_{name}") for name in NAMES}

FEW_MARKERS = ("C7", "LFRM")
"""A reliable and an unreliable marker of `baumann41`."""

WALK = "HDM_bd_01-01_01_120"


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Takes of three actors, one of them a take of the paper that is long enough for its frames."""
    path = tmp_path_factory.mktemp("library") / "db"
    takes = {
        WALK: ("bd", 9.3),
        "HDM_bd_hopBothLegs1hops_001_120": ("bd", 1.5),
        "HDM_tr_jogLeftCircle4StepsRstart_001_120": ("tr", 2.0),
        "HDM_tr_kickLFront1Reps_001_120": ("tr", 2.0),
        "HDM_mm_grabHighR_001_120": ("mm", 1.5),
    }
    with pf.PriorDatabase.create(path, rate=30.0) as database:
        for number, (name, (who, seconds)) in enumerate(takes.items()):
            clip = person(seconds=seconds, rate=30.0, seed=number, body=ord(who[0]))
            origin = pf.ClipOrigin(subject=f"hdm05-{who}")
            database.add(replace(clip, name=name), origin)
    return path


def opened(library: Path) -> baumann.Library:
    with baumann.opened(argparse.Namespace(database=library)) as found:
        return found


# takes


def test_the_papers_take_is_filled_in_its_frames(library: Path) -> None:
    found = opened(library)
    walk, *others = baumann.choose(found, scripts["fig3"].TAKES)
    assert walk.named
    assert walk.record.name == WALK
    truth = found.truth(walk.record)
    gappy = baumann.gappy_of(walk, truth, ["LWRA"])
    missing = np.flatnonzero(gappy.missing[:, truth.labels.index("LWRA")])
    # frames 650 to 1100 at 120 Hz
    assert (missing[0], missing[-1]) == (162, 274)
    assert not any(example.named for example in others)


def test_stand_ins_are_alike_and_of_the_actor_if_possible(library: Path) -> None:
    found = opened(library)
    examples = baumann.choose(found, scripts["fig3"].TAKES)
    names = [example.record.name.split("_")[2] for example in examples]
    assert names == ["01-01", "hopBothLegs1hops", "kickLFront1Reps"]
    assert examples[1].name == "bd_hopBothLegs1hops_001 for jump"
    assert "stand-in" in baumann.reason(examples[1], found)
    assert "of library" in baumann.reason(examples[0], found)  # minutes, not hours
    actors = [baumann.actor(e.record) for e in baumann.choose(found, scripts["fig5"].TAKES)]
    assert actors == ["bd", "tr"]  # nobody else walks
    first, last = baumann.gap_of(examples[1], 45, 30.0)
    assert (first, last) == (11, 33)


def test_a_library_without_anything_alike_is_refused(library: Path) -> None:
    odd = baumann.PaperTake("swim", "HDM_xx_09-09_01_120", 0, 0, ("swim",))
    with pytest.raises(SystemExit, match="neither the paper's takes nor similar ones"):
        baumann.choose(opened(library), [odd])


def test_a_folder_without_a_database_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=r"^[^\n]*nowhere[^\n]*$"):
        opened(tmp_path / "nowhere")


def test_databases_differ_by_the_actor(library: Path) -> None:
    found = opened(library)
    walk = baumann.choose(found, scripts["fig4"].TAKES)[0]
    chosen = {
        name: sorted(record.name.split("_")[1] for record in selection.choose(found.records))
        for name, selection in scripts["fig4"].selections(walk).items()
    }
    assert chosen == {
        "all but the take": ["bd", "mm", "tr", "tr"],
        "without the actor": ["mm", "tr", "tr"],
        "only the actor": ["bd"],
    }


def test_files_of_hdm05_are_a_library(tmp_path: Path) -> None:
    folder = tmp_path / baumann.VIRTUAL
    folder.mkdir()
    pf.write(folder / "name.c3d", person(seconds=1.2, rate=120.0))
    (folder / "name.c3d").rename(folder / "HDM_mm_grabHighR_001_120.C3D")  # as published
    with baumann.opened(argparse.Namespace(database=None, data=tmp_path)) as found:
        (record,) = found.records
        truth = found.truth(record)
    assert (record.subject, record.rate, record.virtual_markers) == ("hdm05-mm", 30.0, True)
    assert truth.frames == 36
    with (
        pytest.raises(SystemExit, match="use --data or --database"),
        baumann.opened(argparse.Namespace(database=None, data=tmp_path / "nothing")),
    ):
        pass


# metric


def test_joints_without_gaps_count(library: Path) -> None:
    table2 = scripts["table2"]
    truth = person(seconds=1.0, rate=30.0)
    gone = [truth.labels.index(label) for label in table2.GAPS["left arm"]]
    positions = truth.positions.copy()
    positions[5:20, gone] = np.nan
    gappy = truth.with_positions(positions)
    positions = truth.positions.copy()
    positions[5:20, gone] += (3.0, 0.0, 4.0)
    found = truth.with_positions(positions)
    # of the 14 joints, the left elbow and wrist are off by 5 mm
    assert table2.joints(truth).shape[1] == 14
    assert table2.joint_error(found, truth, gappy) == pytest.approx(5.0 * 2 / 14)
    assert np.isnan(table2.joint_error(gappy, truth, gappy))
    legs = [label for label in table2.GAPS["both legs"] if label not in table2.GAPS["left leg"]]
    assert tuple(legs) == table2.GAPS["right leg"]


def test_the_papers_cells_are_complete() -> None:
    table2 = scripts["table2"]
    for method in ("baumann2011", "krueger2010"):
        cells = np.array([table2.PAPER[take.motion, method].split() for take in table2.TAKES])
        means = np.array(table2.PAPER["mean", method].split(), float)
        np.testing.assert_allclose(cells.astype(float).mean(axis=0), means, atol=0.06)


# the scripts


@pytest.mark.parametrize(
    ("name", "options", "prints"),
    [
        ("fig2", "", "time per second of gap"),
        ("fig3", "", "cartwheel: "),
        ("fig4", "", "cartwheel, without the actor: "),
        ("fig5", "", "size in mm"),
        ("table2", " --methods baumann2011,linear", "mean baumann2011 both legs: "),
    ],
)
def test_script_runs(
    name: str,
    options: str,
    prints: str,
    library: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    script = scripts[name]
    monkeypatch.setattr(script, "METHODS", ("baumann2011",), raising=False)
    # processes that are spawned do not see what is changed here
    if name != "fig2":
        monkeypatch.setattr(script, "in_processes", lambda function, cases: [*map(function, cases)])
    if name == "table2":
        monkeypatch.setattr(script, "TAKES", script.TAKES[:2])
    few = SimpleNamespace(labels=FEW_MARKERS, reliable=definitions.load("baumann41").reliable)
    if name == "fig3":
        monkeypatch.setattr(script, "load", lambda name: few)
    command = f"baumann_{name}.py --data nowhere --database {library}{options}"
    monkeypatch.setattr(sys, "argv", command.split())
    assert script.main() == 0
    printed = capsys.readouterr().out
    assert "Library: 5 takes" in printed
    assert prints in printed
    if name != "fig5":
        assert "cells are within 10% of the paper's" in printed
