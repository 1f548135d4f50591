"""What the page needs to write decisions, and the command that repeats a fill with them."""

from __future__ import annotations

from pathlib import Path

from click.testing import CliRunner
from reviews import write_walk

import priorfill as pf
from priorfill.cli import main
from priorfill.filling.fill_options import FillOptions
from priorfill.methods import get_options
from priorfill.methods.options import with_values
from priorfill.report.decision_data import decision_data, method_options
from priorfill.synthetic import synthesise


def test_settings_are_those_of_the_command_that_repeats_a_fill(here: Path) -> None:
    source = write_walk(Path("walk.c3d"))
    pf.write("other.c3d", synthesise("walking", seconds=1.0, rate=30.0))
    pf.PriorDatabase.create("lab").close()
    done = pf.fill_file(
        source,
        "one.c3d",
        database="lab",
        same_subject=["other.c3d"],
        files=pf.FileOptions(zeros_missing=False, ignore_residuals=True, unit="mm", rate=30.0),
        method="r2",
        options=FillOptions(
            method_options=with_values(get_options("r2"), {"sigma": 150.0}),
            selection=pf.Selection(not_names=("a*",), not_subjects=("c",), subjects=("b",)),
            extrapolate="10f",
            max_error=500.0,
        ),
        gap_filter=pf.GapFilter(markers=("LKNE", "R*"), frames=(5, None), max_gap="9f"),
        reject_artefacts=True,
    )
    settings = decision_data(done.result)["settings"]
    assert ["set", "sigma=150.0"] in settings
    assert ["markers", "LKNE,R*"] in settings
    words = ["fill", str(source), "-o", "again.c3d"]
    for name, value in settings:
        words += [f"--{name}"] if value is True else [f"--{name}={value}"]
    ran = CliRunner().invoke(main, words)
    assert ran.exit_code in (0, 3), ran.output
    assert Path("again.c3d").read_bytes() == Path("one.c3d").read_bytes()
    plain = pf.fill(pf.read(source), method="linear")
    assert decision_data(plain)["settings"] == [["method", "linear"]]


def test_options_of_methods_can_be_typed() -> None:
    options = method_options()
    assert ["sigma", 200.0] in options["r1"]
    assert options["linear"] == []
    assert all(isinstance(value, (bool, int, float, str)) for _, value in options["gpr"])
