"""What users import, and what importing costs."""

import os
import subprocess
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import pytest

import priorfill
import priorfill as pf
from priorfill import interop
from priorfill.integrations.open_trial import fill_trial
from priorfill.synthetic.demo import make_demo_clip

SLOW = ("numba", "scipy", "ezc3d", "rich", "matplotlib", "distributed")


def loaded_after(statement: str) -> set[str]:
    """Slow packages that a statement makes Python import."""
    code = f"import sys\n{statement}\nprint(*(m for m in {SLOW} if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split() if done.stdout.strip() else [])


def test_all_is_sorted_and_complete():
    assert priorfill.__all__ == sorted(priorfill.__all__)
    assert dir(priorfill) == priorfill.__all__
    for name in priorfill.__all__:
        assert getattr(priorfill, name) is not None
    for module in (
        "filling.fill_clip",
        "filling.fill_file",
        "formats",
        "gaps",
        "clip",
        "database",
        "evaluation",
    ):
        names = import_module(f"priorfill.{module}").__all__
        assert len(set(names)) == len(names)


@pytest.mark.parametrize("name", [n for n in priorfill.__all__ if not n.startswith("__")])
def test_public_names_have_an_example_and_see_also(name: str) -> None:
    documentation = getattr(priorfill, name).__doc__
    assert "Examples\n" in documentation
    assert "See Also\n" in documentation


def test_no_such_name():
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        priorfill.nonsense  # noqa: B018


def test_fill_stays_a_function():
    for module in (
        "filling.fill_clip",
        "methods.gpr.gpr_fill",
        "methods.baumann2011",
        "cli.fill",
        "cli.evaluate",
    ):
        import_module(f"priorfill.{module}")
    assert callable(priorfill.fill)
    assert priorfill.fill.__module__ == "priorfill.filling.fill_clip"
    assert callable(priorfill.evaluate)


def test_import_is_cheap():
    assert loaded_after("import priorfill; priorfill.__all__, priorfill.__version__") == set()


def test_help_is_cheap():
    for arguments in (["--help"], ["--version"], ["evaluate", "--help"]):
        statement = (
            "from priorfill.cli import main\n"
            f"try: main({arguments})\n"
            "except SystemExit as e: assert e.code in (0, None)"
        )
        assert loaded_after(statement) == set()


UNNEEDED = (
    "database.prior_database",
    "methods.gpr.blackout.fill_blackouts",
    "methods.gpr.dropout.fill_dropouts",
    "report.page",
    "report.plots",
)
"""Modules with some tens of others, which take 0.01 to 0.02 s each."""


def test_a_fill_imports_what_it_needs(tmp_path: Path) -> None:
    pf.write(tmp_path / "in.npz", make_demo_clip()[1])
    code = (
        "import sys\nfrom priorfill.cli import main\n"
        "try: main(['fill', 'in.npz', '-o', 'out.npz', '--markers', 'LFIN'])\n"
        "except SystemExit as end: assert end.code in (0, 3)\n"
        f"print(*(m for m in {UNNEEDED} if f'priorfill.{{m}}' in sys.modules), sep='\\n')"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path)
    assert "out.npz" in done.stdout
    assert done.stdout.splitlines()[-1] == ""
    for module in UNNEEDED:
        import_module(f"priorfill.{module}")  # there are such modules


def test_slow_packages_are_seen_by_this_test():
    assert "scipy" in loaded_after("import scipy")


def test_nothing_else_is_imported_before_interrupts_are_caught():
    code = (
        "import os, sys; from importlib import import_module; before = set(sys.modules)\n"
        "import priorfill.__main__\n"
        "print(*sorted(set(sys.modules) - before))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["__future__", "priorfill", "priorfill.__main__"]


def test_a_command_seldom_looks_for_unused_objects():
    """Looking through all that imports make takes longer than some fills."""
    code = (
        "import atexit, gc; runs = []\n"
        "gc.callbacks.append(lambda phase, info: runs.append(phase))\n"
        "import sys; sys.argv = ['priorfill', 'methods', '--json']\n"
        "atexit.register(lambda: print(gc.get_freeze_count() > 10_000, file=sys.stderr))\n"
        "from priorfill.__main__ import start; runs.clear()\n"
        "atexit.register(lambda: print(runs, file=sys.stderr)); start()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.split() == ["[]", "True"]


@pytest.mark.parametrize(("given", "used"), [(None, "1"), ("2", "2")])
def test_a_command_starts_no_threads_of_blas(given, used):
    """Its threads would wait actively; a number that the user sets is kept."""
    code = (
        "import atexit, os, sys; sys.argv = ['priorfill', 'methods', '--json']\n"
        "atexit.register(lambda: print(os.environ['OPENBLAS_NUM_THREADS'], file=sys.stderr))\n"
        "from priorfill.__main__ import start; assert 'numpy' not in sys.modules; start()"
    )
    environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    if given:
        environment["OPENBLAS_NUM_THREADS"] = given
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
    )
    assert done.stderr.split() == [used]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows interrupts all processes of a console")
def test_an_interrupted_start_is_quiet():
    """Also where Python would end itself by the signal: inside ``exec``, as of dataclasses."""
    code = (
        "import signal, sys\n"
        "class Loader:\n"
        "    def find_spec(self, name, *more):\n"
        "        if name == 'priorfill.cli': exec('signal.raise_signal(signal.SIGINT)')\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "sys.meta_path.insert(0, Loader())\n"
        "from priorfill.__main__ import start; start()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "priorfill: interrupted\n")


def calls_with(value: object) -> dict[str, Callable[[], object]]:
    """Calls of public functions in which one argument has a value, by the argument's name."""
    clip = make_demo_clip()[1]
    return {
        "read path": lambda: pf.read(value),
        "read_subjects path": lambda: pf.read_subjects(value),
        "write path": lambda: pf.write(value, clip),
        "write clip": lambda: pf.write("out.npz", value),
        "fill clip": lambda: pf.fill(value, method="linear"),
        "fill method": lambda: pf.fill(clip, method=value),
        "fill database": lambda: pf.fill(clip, database=value),
        "fill options": lambda: pf.fill(clip, options=value),
        "fill gap_filter": lambda: pf.fill(clip, gap_filter=value),
        "fill overrides": lambda: pf.fill(clip, overrides=value),
        "fill same_subject": lambda: pf.fill(clip, same_subject=value),
        "fill_file source": lambda: pf.fill_file(value),
        "fill_file output": lambda: pf.fill_file("walk.c3d", value),
        "fill_file files": lambda: pf.fill_file("walk.c3d", files=value),
        "find_artefacts clip": lambda: pf.find_artefacts(value),
        "find_gaps missing": lambda: pf.find_gaps(value),
        "gap_groups missing": lambda: pf.gap_groups(value),
        "add_result database": lambda: pf.add_result(value, value),
        "add_result result": lambda: pf.add_result("db", value),
        "batch paths": lambda: pf.batch(value, "out"),
        "batch output": lambda: pf.batch([], value),
        "evaluate clips": lambda: pf.evaluate([value], methods=["linear"]),
        "overrides_template result": lambda: pf.overrides_template(value),
        "read_overrides path": lambda: pf.read_overrides(value),
        "write_overrides path": lambda: pf.write_overrides(value, pf.Overrides(())),
        "write_overrides overrides": lambda: pf.write_overrides("a.toml", value),
        "report_from_files after": lambda: pf.report_from_files("a.html", "walk.c3d", value),
        "result_from_files path": lambda: pf.result_from_files(value, "walk.c3d"),
        "fill_array labels": lambda: pf.fill_array(clip.positions, value, 120.0),
        "fill_array rate": lambda: pf.fill_array(clip.positions, clip.labels, value),
        "GapFilter max_gap": lambda: pf.GapFilter(max_gap=() if value == 3 else value),
        "FillOptions marker_set": lambda: pf.FillOptions(marker_set=value),
        "FillOptions extrapolate": lambda: pf.FillOptions(extrapolate=[] if value == 3 else value),
        "FillOptions max_error": lambda: pf.FillOptions(max_error="3" if value == 3 else value),
        "FillOptions progress": lambda: pf.FillOptions(progress=value),
        "from_arrays labels": lambda: interop.from_arrays(clip.positions, value, 120.0),
        "from_arrays unit": lambda: interop.from_arrays(
            clip.positions, clip.labels, 120.0, unit=value
        ),
        "Clip labels": lambda: pf.Clip(clip.positions, value, 120.0),
        "Clip name": lambda: pf.Clip(clip.positions, clip.labels, 120.0, name=value),
        "Clip subject": lambda: pf.Clip(clip.positions, clip.labels, 120.0, subject=value),
        "Clip source": lambda: pf.Clip(clip.positions, clip.labels, 120.0, source=value),
        "open path": lambda: pf.PriorDatabase.open(value),
        "create path": lambda: pf.PriorDatabase.create(value),
        "open_or_create path": lambda: pf.PriorDatabase.open_or_create(value),
        "fill_trial trial": lambda: fill_trial(value),
        "from_arrays rate": lambda: interop.from_arrays(clip.positions, clip.labels, value),
        "to_timeseries clip": lambda: interop.to_timeseries(value, dict),
        "to_xarray clip": lambda: interop.to_xarray(value, dict),
        "to_dataframe clip": lambda: interop.to_dataframe(value, dict),
        "result_to_xarray result": lambda: interop.result_to_xarray(value, dict),
        "result_to_dataframe result": lambda: interop.result_to_dataframe(value, dict),
        "fill_array unit": lambda: pf.fill_array(clip.positions, clip.labels, 120.0, unit=value),
        "fill_array up": lambda: pf.fill_array(clip.positions, clip.labels, 120.0, up=value),
        "from_timeseries series": lambda: interop.from_timeseries(value),
        "from_xarray array": lambda: interop.from_xarray(value),
        "from_dataframe frame": lambda: interop.from_dataframe(value),
        "write_report result": lambda: pf.write_report("a.html", value),
        "write_uncertainty result": lambda: pf.write_uncertainty("a.npz", value),
    }


@pytest.mark.parametrize("call", calls_with(None))
def test_arguments_of_a_wrong_type(call: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """One line with the argument, what it is, and what is needed; nothing is written."""
    monkeypatch.chdir(tmp_path)
    for value in (3, object(), b"walk.c3d"):
        if isinstance(value, bytes) and call == "fill_array labels":
            continue  # a sequence of numbers
        if value == 3 and call.endswith(" rate"):
            continue
        with pytest.raises(TypeError) as caught:
            calls_with(value)[call]()
        assert isinstance(caught.value, pf.PriorfillError)
        message = str(caught.value)
        assert message.startswith(f"`{call.split()[1]}` is of type ")
        assert "; give " in message
    assert list(tmp_path.iterdir()) == []


def test_exchanged_arguments():
    clip = make_demo_clip()[1]
    with pytest.raises(TypeError, match=r"^`path` is of type Clip; give a path, as a text or Path"):
        pf.write(clip, "walk.c3d")


@pytest.mark.parametrize("path", ["walk\0.c3d", Path("walk\0.c3d")])
def test_a_path_with_a_zero_byte(path: Path | str):
    for call in (pf.read, pf.PriorDatabase.open, pf.PriorDatabase.create):
        with pytest.raises(pf.PriorfillError, match="`path` has a zero byte"):
            call(path)


def test_coordinates_beyond_all_measurement_are_refused(recwarn: pytest.WarningsRecorder):
    """By `fill` too, which would only warn of overflows."""
    clip = make_demo_clip()[1]
    with pytest.raises(pf.PriorfillError, match=r"has a coordinate of .*e\+303 in frame"):
        pf.fill(clip.with_positions(clip.positions * 1e300))
    assert not recwarn.list


@pytest.mark.parametrize("markers", [3, {3}, [3], ("LKNE", None)])
def test_markers_of_a_filter_are_texts(markers: object):
    with pytest.raises(TypeError, match=r"^`markers(\[[01]\])?` is of type .*; give a"):
        pf.GapFilter(markers=markers)


@pytest.mark.parametrize("frames", [3, object(), "92-116", (1,), (1.5, 3), ("1", "3")])
def test_frames_of_a_filter_are_two_numbers(frames: object):
    with pytest.raises(pf.PriorfillError, match="give the first and the last frame"):
        pf.GapFilter(frames=frames)
