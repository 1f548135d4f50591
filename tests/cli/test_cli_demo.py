"""``priorfill demo``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from priorfill.cli import main
from priorfill.formats import read
from priorfill.synthetic import LABELS
from priorfill.synthetic.demo import make_demo_clip

GAPS = ((1.0, 1.25, ("LKNE",)), (10.0, 10.4, ("LBHD",)), (11.0, 12.0, ("LANK", "LHEE", "LTOE")))
"""Some of the demo's gaps: to fill them all takes ten times as long."""


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def test_demo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("priorfill.synthetic.demo.DEMO_GAPS", GAPS)
    result = run("demo", "-o", tmp_path / "new" / "folder")
    assert result.exit_code == 0, result.output
    folder = tmp_path / "new" / "folder"
    names = ["demo_filled.c3d", "demo_gaps.c3d", "demo_truth.c3d"]
    assert sorted(path.name for path in folder.iterdir()) == names
    lines = result.stdout.splitlines()
    assert "synthetic" in lines[0]
    assert result.stderr == ""
    for name in names:
        assert str(folder / name) in result.stdout
    table = [line.split() for line in lines[3 : lines.index("", 3)]]
    assert [row[0] for row in table] == [
        *(label for _, _, labels in sorted(GAPS) for label in in_order(labels)),
        "all",
    ]
    # rms errors relative to the ground truth, of the fill and of linear interpolation
    assert float(table[-1][1]) < 0.5 * float(table[-1][-1])

    truth, gaps, filled = (read(folder / f"demo_{n}.c3d") for n in ("truth", "gaps", "filled"))
    assert not truth.missing.any()
    assert not filled.missing.any()
    assert gaps.missing.sum() == sum(
        round((end - start) * 120) * len(labels) for start, end, labels in GAPS
    )
    measured = ~gaps.missing
    assert filled.labels == gaps.labels
    np.testing.assert_array_equal(filled.positions[measured], gaps.positions[measured])


def test_gaps_that_stay_missing_have_no_error(tmp_path: Path) -> None:
    result = run("demo", "-o", tmp_path, "--method", "rigid")
    assert result.exit_code == 3, result.output
    rows = [line.split() for line in result.stdout.splitlines() if line.startswith("LFIN")]
    (row,) = rows
    assert row[2:4] == ["-", "-"]
    assert float(row[4]) > 100
    assert "nan" not in result.output


def in_order(labels: tuple[str, ...]) -> list[str]:
    return sorted(labels, key=LABELS.index)


def test_the_demo_clip_is_named_synthetic() -> None:
    truth, gappy = make_demo_clip()
    assert truth.name.startswith("synthetic")
    assert truth.subject.startswith("synthetic")
    assert gappy.missing.any()


def test_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    result = run("demo", "-o", tmp_path / "file")
    assert result.exit_code == 1
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1
    assert "cannot be created" in result.stderr


def test_unknown_method_leaves_nothing(tmp_path: Path) -> None:
    result = run("demo", "-o", tmp_path / "demo", "-m", "nonsense")
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "demo").exists()
