"""Every script of ``scripts/`` runs: by a smoke invocation here, or in a test file of its own."""

from __future__ import annotations

import contextlib
import importlib.machinery
import importlib.util
import io
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pytest
from click.testing import CliRunner
from gappy import person, with_gaps
from scripted import SCRIPTS, load_script
from skeleton_files import amc, asf

import priorfill as pf
from priorfill.cli import main as cli
from priorfill.formats.skeletons.asf_amc import read_amc, read_asf
from priorfill.markers import definitions
from priorfill.skeleton.virtual_markers import compute_virtual_markers

CHECKOUT_SCRIPTS = (
    "check",
    "check.py",
    "demo",
    "demo.py",
    "environment",
    "find_python",
    "make_environment.py",
    "profile",
    "test",
    "test.py",
)
"""Scripts that make the environment of a checkout."""

TESTED_ELSEWHERE = {
    **dict.fromkeys(CHECKOUT_SCRIPTS, "scripts/test_checkout.py"),
    "bench/page.py": "scripts/test_bench_page.py",
    "checks/fuzz_c3d.py": "scripts/test_fuzz_c3d.py",
    "checks/fuzz_formats.py": "scripts/test_fuzz_formats.py",
    "checks/fuzz_methods.py": "scripts/test_fuzz_methods.py",
    "checks/survey.py": "scripts/test_survey.py",
    "checks/torture_database.py": "database/test_torture.py",
    "checks/torture_outputs.py": "scripts/test_torture_outputs.py",
    "golden.py": "test_golden.py",
    "golden_motions.py": "synthetic/test_golden_motions.py",
    "mutation_sample.py": "scripts/test_mutation_sample.py",
    "papers/all.py": "scripts/test_papers_all.py",
    "papers/baumann_fig2.py": "scripts/test_papers_baumann.py",
    "papers/baumann_fig3.py": "scripts/test_papers_baumann.py",
    "papers/baumann_fig4.py": "scripts/test_papers_baumann.py",
    "papers/baumann_fig5.py": "scripts/test_papers_baumann.py",
    "papers/baumann_table2.py": "scripts/test_papers_baumann.py",
    "papers/gloersen_fig4.py": "scripts/test_papers_gloersen.py",
    "papers/gloersen_fig6.py": "scripts/test_papers_gloersen.py",
    "papers/gloersen_table1.py": "scripts/test_papers_gloersen.py",
    "papers/gloersen_table2.py": "scripts/test_papers_gloersen.py",
    "papers/gloersen_walkl.py": "scripts/test_papers_gloersen.py",
    "papers/li_fig8.py": "scripts/test_papers_li.py",
    "papers/li_fig9.py": "scripts/test_papers_li.py",
    "papers/li_table1.py": "scripts/test_papers_li.py",
    "papers/li_table2.py": "scripts/test_papers_li.py",
    "papers/li_table4.py": "scripts/test_papers_li.py",
    "studies/accuracy_study.py": "scripts/test_accuracy_study.py",
    "test_windows": "scripts/test_windows_environment.py",
    "windows/environment.py": "scripts/test_windows_environment.py",
    "windows/run_tests.py": "scripts/test_windows_environment.py",
}
"""Scripts whose ``main`` another test file runs, below ``tests/``."""

SHORT_CLIP = """
import sys
import priorfill as pf
from priorfill.synthetic import synthesise
clip = synthesise("walking", seconds=0.5, rate=30.0)
positions = clip.positions.copy()
positions[6:9, 0] = float("nan")
pf.write(sys.argv[1], clip.with_positions(positions))
"""
"""What `bench/start.py` makes the clip with that it fills."""


@dataclass(frozen=True)
class Smoke:
    """How a script is tried.

    Attributes
    ----------
    arguments : str
        Command line; ``{data}`` is the folder of recordings, ``{tmp}`` an empty folder.
    prints : str
        What the output must contain.
    changes : mapping
        Module attributes that are replaced, to keep the input small.
    statuses : sequence of int or None
        Accepted results of ``main``. A benchmark returns 1 where a bound on time is exceeded.
    """

    arguments: str
    prints: str
    changes: Mapping[str, object] = field(default_factory=dict)
    statuses: Sequence[int | None] = (0,)


def run_here(command: Sequence[str], *, accepted: Sequence[int] = (0,), **more: Any) -> NamedTuple:
    """What `bench/child.py` returns for a command line of priorfill, which runs in this process.

    A process of its own takes a second to begin; `bench/memory.py` starts some.
    """
    child = load_script("child")
    program, arguments = tuple(command[: len(child.CLI)]), command[len(child.CLI) :]
    if program != child.CLI:
        cost: NamedTuple = child.run(command, accepted=accepted, **more)
        return cost
    done = CliRunner().invoke(cli, list(arguments))
    assert done.exit_code in accepted, done.output
    here: NamedTuple = child.Cost(1.0, 1.0, 1.0, done.stdout)
    return here


def search_here(method: str, folder: Path, threads: int) -> list[float]:
    """What `bench/search.py` measures, in this process; the kd-tree in one of its own."""
    search = load_script("search")
    if method == "kd-tree":
        measured: list[float] = IN_A_PROCESS(method, folder, threads)
        return measured
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        search.work(method, folder, 1, threads)
    return [float(word) for word in printed.getvalue().split()]


IN_A_PROCESS = load_script("search").in_a_process

SMOKE = {
    "bench/database.py": Smoke(
        "--data {data} --poses 100",
        "cost of adding one clip",
        {"MINUTE": 2.0, "ONE_MORE": 1, "GATHERED": 50, "OPENED": 1, "run": run_here},
    ),
    "bench/fill.py": Smoke(
        "--data {data} --seconds 0.2,0.4 --takes 0,1 --methods linear,baumann2011",
        "s CPU per second of gap",
        {"START": 240, "PARTS": {"marker": ("LFRM",)}},
    ),
    "bench/fill_databases.py": Smoke(
        "--data {data} --poses 100 --seconds 0.1 --repeat 1",
        "marker         100",
        {"TAKE": "gaps.c3d", "START": 40, "GONE": {"marker": ("LFRM",)}, "run": run_here},
    ),
    "bench/lab_files.py": Smoke(
        "--data {data} --cases {data}/cases.json --database {data}/database --repeat 1",
        "limb with a database",
        {
            "METHOD": "linear",
            "REFERENCE": "linear",
            "RAW": "gaps.c3d",
            "SCATTERED": (90, 20, 9),
            "MANY": (1, 5, 40),
            "MINUTES": "0.05",
            "run": run_here,
        },
        statuses=(0, 1),
    ),
    "bench/long_clip.py": Smoke(
        "{tmp}/long.c3d --minutes 0.05 --rate 30 --markers 45",
        "90 frames, 45 markers",
        statuses=(None,),
    ),
    "bench/memory.py": Smoke("--minutes 0.05 --rate 30 --markers 45 --method linear", "MB: kept"),
    "bench/scale.py": Smoke("--quick --method linear", "frayed", {"run": run_here}),
    "bench/profile_fill.py": Smoke("--top 50 {data}/gaps.c3d --method linear", "priorfill/filling"),
    "bench/search.py": Smoke(
        "--data {data} --poses 1000 --takes 02_01 --repeats 1 --check 9",
        "9 of 9 random queries",
        {"in_a_process": search_here},
    ),
    "bench/solver.py": Smoke("--seconds 0.3 --repeat 1", "bounds", statuses=(0, 1)),
    "bench/start.py": Smoke(
        "--repeat 1",
        "second fill",
        {"MAKE": SHORT_CLIP, "run": run_here},
        statuses=(0, 1),
    ),
    "bench/study.py": Smoke(
        "--data {data}/hdm05_cut_markers --files 1 --bar 0 --method linear",
        "1 files are the same in 2 runs",
        {"RUNS": {f"{n} workers": ("--workers", str(n)) for n in (1, 2)}, "run": run_here},
    ),
    "bench/threads.py": Smoke(
        "{data}/gaps.c3d --repeat 1", "files are the same", {"run": run_here}
    ),
    "build_starter_database": Smoke("{tmp}/starter", "MB", {"SECONDS": 0.5}),
    "checks/torture_study.py": Smoke(
        "--data {data}/hdm05_cut_markers --good 1 --garbage 1 --hanging 0 --hungry 0 --kills 0",
        "nothing is left",
    ),
    "studies/artefact_study.py": Smoke(
        "--data {data} --count 1 --fill 1",
        "of a speed limit",
        {
            "CLEAN": ("hdm05/HDM_bd_05-01_01_120.c3d",),
            "MAX_FRAMES": 120,
            "fill": partial(pf.fill, method="linear"),
        },
        statuses=(None,),
    ),
    "studies/growth_study.py": Smoke(
        "--data {data} --set baumann41 --orders 1 --clips 2 --processes 1 --method linear -o {tmp}",
        "measured only",
    ),
    "studies/plausibility_study.py": Smoke(
        "--data {data} --methods linear",
        "below the bound",
        {
            "RECORDINGS": ("hdm05/HDM_bd_05-01_01_120.c3d",),
            "MAX_FRAMES": 240,
            "KINDS": ("single", "limb"),
        },
        statuses=(None,),
    ),
    "studies/warning_study.py": Smoke(
        "--data {data} --methods linear",
        "true positions",
        {
            "RECORDINGS": ("hdm05/HDM_bd_05-01_01_120.c3d",),
            "MAX_FRAMES": 240,
            "KINDS": ("single",),
        },
        statuses=(None,),
    ),
    "studies/summary_rule_study.py": Smoke(
        "--data {data} --method linear",
        "gaps, by expected error and length",
        {"FOLDERS": ("hdm05",), "MAX_FRAMES": 240, "KINDS": ("single",)},
        statuses=(None,),
    ),
    "studies/learn_markers.py": Smoke(
        "{data}/skeleton.c3d {data}/skeleton.amc --skeleton {data}/skeleton.asf"
        " -o {tmp}/markers.toml",
        "mm rms; left out",
        statuses=(None,),
    ),
    "studies/band_coverage.py": Smoke(
        "--data {data} --repeat 1",
        "x y z 90 %",
        {"FILES": ("hdm05/HDM_bd_05-01_01_120.c3d",), "KINDS": ("single",), "MAX_FRAMES": 240},
    ),
    "studies/confidence_study.py": Smoke(
        "--data {data} --repeat 1",
        "HDM_bd_05-01_01_120",
        {"CASES": (("hdm05/HDM_bd_05-01_01_120.c3d", 3.0, 41),), "MAX_FRAMES": 40},
    ),
    "studies/readme_picture.py": Smoke("--data {data} -o {tmp}/fill.png", "LWRA: mean error"),
}
"""Scripts that are tried here."""


def scripts() -> list[str]:
    """The scripts, relative to their folder: what can be run, rather than imported."""
    found = []
    for file in SCRIPTS.rglob("*"):
        if file.is_file() and file.suffix not in (".pyc", ".toml"):
            text = file.read_text(encoding="utf-8")
            if text.startswith("#!") or '__name__ == "__main__"' in text:
                found.append(file.relative_to(SCRIPTS).as_posix())
    return sorted(found)


def test_every_script_is_tried() -> None:
    assert set(scripts()) == set(SMOKE) | set(TESTED_ELSEWHERE)


@pytest.mark.parametrize(("script", "file"), TESTED_ELSEWHERE.items())
def test_the_other_test_file_names_the_script(script: str, file: str) -> None:
    text = (SCRIPTS.parent / "tests" / file).read_text(encoding="utf-8")
    family, _, name = Path(script).stem.partition("_")
    assert Path(script).stem in text or (f'"{name}"' in text and f"{family}_{{name}}" in text)


@pytest.mark.parametrize("script", [*SMOKE, *TESTED_ELSEWHERE])
def test_scripts_print_on_every_code_page(script: str) -> None:
    text = (SCRIPTS / script).read_text(encoding="utf-8")
    main = text.partition('if __name__ == "__main__":\n')[2]
    if "\nfrom priorfill" in text or "\nimport priorfill" in text:
        assert main.startswith("    replace_what_is_lacking()\n")


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of synthetic recordings with the file names of real ones."""
    data = tmp_path_factory.mktemp("data")
    for folder in ("hdm05", "hdm05_cut_markers", "cmu", "gait"):
        (data / folder).mkdir()
    long = person(seconds=4.0, rate=120.0)
    pf.write(data / "hdm05" / "HDM_bd_05-01_01_120.c3d", long)
    pf.write(data / "cmu" / "02_01.c3d", person(seconds=6.0, rate=60.0, seed=4))
    pf.write(data / "gait" / "HC002D06.c3d", person())
    takes = {"bd_walk_001": (5, 0), "bd_walk_002": (6, 0), "mm_walk_001": (7, 1)}
    for name, (seed, body) in takes.items():
        clip = replace(person(seconds=1.2, seed=seed, body=body), subject=name[:2])
        pf.write(data / "hdm05_cut_markers" / f"HDM_{name}_120.c3d", clip)
    gappy = with_gaps(person(seconds=2.0, rate=30.0), (20, 30, ("LKNE",)))
    pf.write(data / "gaps.c3d", gappy)
    write_cases(data, gappy.labels)
    write_skeleton(data)
    return data


def write_cases(data: Path, labels: Sequence[str]) -> None:
    """Write a list of clips with artificial gaps, and a database."""
    case = {
        "source": "gaps.c3d",
        "first": 0,
        "frames": 20,
        "markers": list(labels),
        "gaps": [["LKNE", 5, 3]],
    }
    cases = [{"name": f"{name}a", **case} for name in ("d01_", "d06_", "d17_")]
    (data / "cases.json").write_text(json.dumps(cases), encoding="utf-8")
    with pf.PriorDatabase.create(data / "database") as database:
        database.add(person(seconds=1.0))


def write_skeleton(data: Path) -> None:
    """Write a motion of a skeleton, and the C3D file of markers placed on it."""
    (data / "skeleton.asf").write_text(asf(), encoding="utf-8")
    (data / "skeleton.amc").write_text(amc(60), encoding="utf-8")
    motion = read_amc(data / "skeleton.amc", read_asf(data / "skeleton.asf"))
    clip = compute_virtual_markers(
        motion, definitions.load("baumann41"), name="skeleton", file="skeleton.amc"
    ).clip
    x, y, z = np.moveaxis(clip.positions, 2, 0)
    turned = replace(clip, positions=np.stack([z, x, y], axis=2), up="+Z")
    pf.write(data / "skeleton.c3d", turned)


def load(script: str) -> ModuleType:
    """A fresh module of a script."""
    path = SCRIPTS / script
    if path.suffix:
        sys.modules.pop(path.stem, None)
        return load_script(path.stem)
    loader = importlib.machinery.SourceFileLoader(path.name, str(path))
    spec = importlib.util.spec_from_loader(path.name, loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    return module


@pytest.mark.parametrize("script", SMOKE)
def test_script_runs(
    script: str,
    recordings: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    smoke = SMOKE[script]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(SCRIPTS.parent))
    module = load(script)
    for name, value in smoke.changes.items():
        monkeypatch.setattr(module, name, value)
    arguments = smoke.arguments.format(data=recordings, tmp=tmp_path).split()
    monkeypatch.setattr(sys, "argv", [script, *arguments])
    main: Callable[..., int | None] = module.main
    status = main(arguments) if script == "build_starter_database" else main()
    output = capfd.readouterr()
    assert status in smoke.statuses, output
    assert smoke.prints in output.out
