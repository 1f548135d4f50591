"""What users import, and what importing costs."""

import subprocess
import sys
from importlib import import_module

import pytest

import priorfill

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
