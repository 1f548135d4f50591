"""``priorfill evaluate``: what it prints, writes and refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from gappy import person, with_gaps

from priorfill.cli import main
from priorfill.formats import write


def run(*arguments: str | Path) -> Result:
    given = ["evaluate", *map(str, arguments), "--jobs", "0"]
    return CliRunner().invoke(main, given)


@pytest.fixture
def walk(here: Path) -> Path:
    """A file with a gap of its own."""
    write(here / "walk.c3d", with_gaps(person(), (20, 40, ["LELB"])))
    return here / "walk.c3d"


def test_a_table(walk: Path) -> None:
    done = run(walk, "-m", "linear,spline", "--copies", "2")
    assert done.exit_code == 0, done.output
    lines = done.stdout.splitlines()
    assert " of 1 clip; protocol random, seed 0" in lines[0]
    assert lines[3].split()[:4] == ["method", "filled", "mm", "mm"]
    assert [line.split()[:3] for line in lines[4:6]] == [
        ["linear", "100", "%"], ["spline", "100", "%"]
    ]  # fmt: skip
    assert "over all samples, best first: " in done.stdout
    assert max(map(len, lines)) <= 80
    assert done.stderr.startswith("4 fills: 2 methods on 2 cases")


def test_json(walk: Path) -> None:
    done = run(walk, "-m", "linear", "-p", "markers", "--markers", "LKNE,LTOE", "--length",
               "0.5", "--seed", "3", "--json")  # fmt: skip
    facts = json.loads(done.stdout)
    assert facts["cases"] == 2
    assert facts["settings"]["seed"] == 3
    assert facts["samples"] == 2 * 30
    assert facts["methods"]["linear"]["filled_share"] == 1.0


def test_a_folder_with_plots(walk: Path, here: Path) -> None:
    pytest.importorskip("matplotlib")
    few = ("-p", "markers", "--markers", "LKNE,LTOE")
    given = (walk, "-m", "linear", *few, "-o", here / "out", "--plots")
    done = run(*given)
    assert done.exit_code == 0, done.output
    assert f"results of every gap: {here / 'out'}" in done.stdout
    assert len(list((here / "out").glob("*.png"))) == 3
    refused = run(*given, "--seed", "1")
    assert refused.exit_code == 2
    assert refused.stderr == (
        f"priorfill: {here / 'out'}: holds an evaluation with seed 0, not 1; take the same "
        "options, another folder, or --overwrite\n"
    )
    assert run(*given, "--seed", "1", "--overwrite").exit_code == 0


def test_the_gaps_of_another_file(walk: Path, here: Path) -> None:
    write(here / "other.c3d", with_gaps(person(seed=7), (100, 130, ["LKNE", "RKNE"])))
    facts = json.loads(run(walk, "-m", "linear", "--like", here / "other.c3d", "--json").stdout)
    assert facts["settings"]["protocol"]["name"] == "like"
    assert (facts["gaps"], facts["samples"]) == (2, 60)


def test_a_method_that_cannot_work_makes_status_3(
    walk: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from priorfill.errors import MethodError
    from priorfill.methods import get_method

    def refuse(task: object, progress: object) -> None:
        raise MethodError("no complete frame; record one")

    monkeypatch.setattr(
        "priorfill.filling.run_settings.get_method",
        lambda n: refuse if n == "pchip" else get_method(n),
    )
    done = run(walk, "-m", "pchip,linear", "-p", "frames")
    assert done.exit_code == 3
    assert done.stderr.splitlines()[1:] == ["pchip could not work: no complete frame; record one"]
    line = next(line for line in done.stdout.splitlines() if line.startswith("pchip"))
    assert line.split()[:3] == ["pchip", "0", "%"]
    assert "left out: pchip, which filled less than half" in " ".join(done.stdout.split())


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["-m", "magic"], 2, "there is no method 'magic'; use one of auto, gpr"),
        (["-m", "linaer"], 2, "did you mean linear?"),
        (["-p", "magic"], 2, "there is no protocol 'magic'; use one of random, markers"),
        (["-p", "magic", "--like", "no.c3d"], 2, "there is no protocol 'magic'"),
        (["-p", "frames", "--period", "2"], 2, "protocol frames has no option --period; it has"),
        (["-p", "markers", "--number", "2"], 2, "it has --copies --length --markers"),
        (["-p", "frames", "--length", "2-1"], 2, "--length is 2 to 1; give numbers above 0, the"),
        (["-p", "frames", "--length", "1-10f"], 2, "--length is 1.0 to 10f; give both in"),
        (["-p", "frames", "--copies", "0"], 2, "--copies is 0; give"),
        (["-p", "periodic", "--length", "3"], 2, "give shorter ones (--length)"),
        (["-p", "frames", "--like", "no.c3d"], 2, "--like needs the protocol like"),
        (["-p", "like"], 2, "give the file (--like)"),
        (["--length", "1x"], 2, "'1x' is no duration"),
        (["--number", "many"], 2, "'many' is not like 3 or 1-5"),
        (["--plots"], 2, "--plots needs a folder; give one (--output)"),
        (["--exclude-subject", "me"], 2, "give one (--database)"),
    ],
)
def test_wrong_usage_before_any_work(
    here: Path, arguments: list[str], status: int, message: str
) -> None:
    done = run("there-is-no.c3d", *arguments)
    assert done.exit_code == status
    assert message in done.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-p", "markers", "--markers", "LKNEE"], "called 'LKNEE'; did you mean LKNE"),
        (["-p", "groups", "--groups", "arm"], "no clip has the group 'arm'; did you mean arms"),
    ],
)
def test_names_that_no_clip_has(walk: Path, arguments: list[str], message: str) -> None:
    done = run(walk, "-m", "linear", *arguments)
    assert (done.exit_code, done.stdout) == (2, "")
    assert message in done.stderr


def test_lengths_in_frames_and_seconds(walk: Path) -> None:
    few = ("-m", "linear", "-p", "markers", "--markers", "lkne,ltoe", "--json")
    frames = json.loads(run(walk, *few, "--length", "30f").stdout)
    seconds = json.loads(run(walk, *few, "--length", f"{30 / person().rate}s").stdout)
    assert frames["samples"] == 2 * 30
    assert frames["methods"]["linear"]["mean_mm"] == seconds["methods"]["linear"]["mean_mm"]


def test_without_matplotlib(walk: Path, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("priorfill.report.figures.find_spec", lambda name: None)
    done = run("there-is-no.c3d", "-o", here / "out", "--plots")
    assert done.exit_code == 2
    assert done.stderr.startswith("priorfill: plots need matplotlib, which is not installed")
    assert len(done.stderr.splitlines()) == 1
    assert not (here / "out").exists()


def test_interrupted(walk: Path, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("priorfill.evaluation.runner.run_case", interrupt)
    assert run(walk, "-m", "linear", "-o", here / "out").exit_code == 130
