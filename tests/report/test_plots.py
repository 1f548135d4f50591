"""Plots of a result: what is drawn, and the files."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure

import priorfill as pf
from priorfill.cli import main
from priorfill.errors import MarkerNotFoundError, OptionError, OutputError
from priorfill.report import figures
from priorfill.report.bands import BAND_50, BAND_90
from priorfill.report.file_names import file_names
from priorfill.report.plots import check_plot, plot_files

FIRST_FRAME = 501
HOSTILE = ("$\\frac{1}{$\u6e2f", "\x1b[31m\u202eabc", "../" + "x" * 10_000)
"""A formula that is none, letters of other scripts, control and bidirectional characters, a long
label."""


def made(labels: tuple[str, ...] = ("LKNE", "RKNE", "C7")) -> pf.Clip:
    """Markers on curves, with a gap, two gaps with one at the end, and none."""
    time = np.linspace(0.0, 2.0, 120)
    positions = np.stack(
        [
            np.stack([500 * np.sin(time + k), 400 * np.cos(time + k), 900 + 10 * k + time], axis=1)
            for k in range(len(labels))
        ],
        axis=1,
    )
    positions[30:50, 0] = np.nan
    positions[20:25, 1] = np.nan
    positions[100:, 1] = np.nan
    return pf.Clip(positions, labels, 60.0, name="walk", first_frame=FIRST_FRAME)


@pytest.fixture(scope="module")
def result() -> pf.Result:
    """A fill in which the gap at the end is left alone."""
    return pf.fill(made(), method="linear", gap_filter=pf.GapFilter(skip_edges=True))


def panels(figure: Figure) -> list[list]:
    """The axes of each panel."""
    return [part.axes for part in figure.subfigs if part.axes]


def curve(axes, colour: str) -> np.ndarray:
    """Frames and values of the line of a colour."""
    (line,) = [line for line in axes.lines if line.get_color() == colour]
    return np.column_stack(line.get_data())


def test_marker_with_a_gap(result: pf.Result) -> None:
    figure = result.plot("LKNE")
    ((x, y, z),) = panels(figure)
    assert [one.get_ylabel() for one in (x, y, z)] == ["x (mm)", "y (mm)", "z (mm), up"]
    assert z.get_xlabel() == "frame"
    assert x.child_axes[0].get_xlabel() == "time (s)"
    title = x.get_title(loc="left")
    assert "LKNE, frames 531\u2013550 (0.33 s)" in title
    assert "filled with linear" in title
    filled = curve(y, "#D55E00")
    inside = np.isfinite(filled[:, 1])
    assert filled[inside, 0].tolist() == list(range(530, 552))  # from one edge to the other
    assert np.array_equal(filled[inside, 1], result.clip["LKNE"][29:51, 1])
    measured = curve(y, "black")
    assert np.isnan(measured[measured[:, 0] == 540, 1]).all()
    bound = result.error_bound_90_mm[40, 0]
    shading, *bands = y.collections
    assert np.ptp(shading.get_paths()[0].vertices[:, 0]) == 20
    for band, share in zip(bands, (BAND_90, BAND_50), strict=True):
        at = band.get_paths()[0].vertices
        at = at[np.isclose(at[:, 0], 541)]
        assert np.ptp(at[:, 1]) == pytest.approx(2 * share * bound)
    assert "50 % band" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_what_was_not_filled_is_marked(result: pf.Result) -> None:
    parts = panels(result.plot("RKNE"))
    titles = [axes[0].get_title(loc="left").replace("\n", " ") for axes in parts]
    assert len(titles) == 2
    assert "left alone, frames 601\u2013620: " in titles[1]
    assert any(area.get_hatch() for area in parts[1][0].collections)
    assert not any(area.get_hatch() for area in parts[0][0].collections)
    assert result.plot("C7").subfigs[0].axes[0].get_title(loc="left").endswith("no gaps")


def test_frames_and_worst_gaps(result: pf.Result) -> None:
    ((x, *_),) = panels(result.plot("RKNE", frames="511-"))
    assert "frames 511\u2013620: 2 gaps" in x.get_title(loc="left")
    assert len(panels(result.plot())) == 3
    (one,) = panels(result.plot(gaps=1))
    assert len(one) == 3
    ((*_, away),) = panels(result.plot("LKNE", truth=result.clip))
    assert away.get_ylabel() == "distance from\nrecorded (mm)"
    for wrong, message in (
        ({"marker": "LKN"}, "did you mean LKNE"),
        ({"frames": "700-800"}, "its frames are 501-620"),
        ({"gaps": 0}, "`gaps`"),
        ({"gaps": 61}, "write a .pdf"),
        ({"truth": made(("A", "B", "C"))}, "`truth`"),
    ):
        with pytest.raises((OptionError, MarkerNotFoundError), match=re.escape(message)):
            result.plot(**wrong)


def test_hostile_labels_in_a_folder(tmp_path: Path) -> None:
    clip = replace(made(HOSTILE), name="$a_$\x1b")
    positions = clip.positions.copy()
    positions[90:95, 2:] = np.nan
    filled = pf.fill(clip.with_positions(positions), method="linear")
    with plot_files(tmp_path / "each", filled, gaps=1) as files:
        assert all(file.name.startswith(".") for file in (tmp_path / "each").iterdir())
    assert sorted(path.name for path in (tmp_path / "each").iterdir()) == sorted(
        file.name for file in files
    )
    assert len(files) == len(HOSTILE)
    assert all(file.read_bytes().startswith(b"\x89PNG") for file in files)
    with pytest.raises(OutputError, match="not empty"):
        check_plot(tmp_path / "each", overwrite=False)


def test_names_of_files() -> None:
    names = file_names(["LKNE", "lkne", "Anna:L*", "Anna/L?", "nul", "..", "a.", "x" * 300])
    assert names == ["LKNE", "lkne_2", "Anna_L_", "Anna_L__2", "_nul", "marker", "a", "x" * 60]


def test_documents_are_the_same_each_time(result: pf.Result, tmp_path: Path) -> None:
    for name in ("a.svg", "b.svg", "a.pdf", "b.pdf"):
        with plot_files(tmp_path / name, result, gaps=1) as files:
            pass
        assert files == (tmp_path / name,)
    for form in ("svg", "pdf"):
        content = (tmp_path / f"a.{form}").read_bytes()
        assert content == (tmp_path / f"b.{form}").read_bytes()
        assert form == "pdf" or b"<script" not in content


def test_pages_of_a_document(
    result: pf.Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("priorfill.report.plots.DEFAULT_GAPS", 1)
    with plot_files(tmp_path / "a.PDF", result, gaps=2):
        pass
    assert (tmp_path / "a.PDF").read_bytes().count(b"/Type /Page ") == 2


def test_without_gaps(result: pf.Result, tmp_path: Path) -> None:
    none = replace(result, gaps=())
    with plot_files(tmp_path / "none.png", none):
        pass
    assert (tmp_path / "none.png").stat().st_size > 1000


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with `walk.c3d`."""
    monkeypatch.chdir(tmp_path)
    pf.write("walk.c3d", made())
    return tmp_path


def run(*arguments: str) -> tuple[int, str]:
    """Status and output of ``priorfill fill walk.c3d``, by straight lines."""
    done = CliRunner().invoke(main, ["fill", "walk.c3d", "-m", "linear", *arguments])
    return done.exit_code, done.output


def test_command(folder: Path) -> None:
    status, output = run("--plot", "gaps.png", "--plot-gaps", "1", "-o", "out.c3d")
    assert status == 3, output  # the gap at the end stays missing
    assert "\nplot: gaps.png\n" in output
    assert Path("gaps.png").read_bytes().startswith(b"\x89PNG")
    status, output = run("--plot", "each", "--plot-gaps", "1", "--json")
    assert status == 3, output
    assert '"each/LKNE.png"' in output.replace("\\\\", "/")
    assert sorted(path.name for path in Path("each").iterdir()) == ["LKNE.png", "RKNE.png"]


def test_refused_before_the_fill(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Path("there.png").touch()
    Path("file").touch()
    monkeypatch.setattr("priorfill.filling.fill_file.fill", None)
    for arguments, status, message in (
        (("--plot", "there.png"), 1, "exists already"),
        (("--plot", "plot.jpg"), 2, "use .png or .svg or .pdf, or the name of a folder"),
        (("--plot", "file"), 1, "is a file"),
        (("--plot", "a.png", "--plot-gaps", "99"), 2, "write a .pdf"),
        (("--plot-gaps", "3"), 2, "--plot-gaps needs a file"),
    ):
        assert run(*arguments)[0] == status
        assert message in " ".join(run(*arguments)[1].split()), run(*arguments)
    monkeypatch.setattr(figures, "find_spec", lambda name: None)
    status, output = run("--plot", "a.png")
    assert status == 2
    assert "pip install matplotlib" in " ".join(output.split())
    monkeypatch.undo()
    monkeypatch.chdir(folder)

    def broken(name: str) -> None:
        raise ValueError("Key backend: 'x' is not a valid value")

    monkeypatch.setattr(figures, "import_module", broken)
    status, output = run("--plot", "a.png")
    assert status == 2
    assert "cannot be imported (Key backend" in " ".join(output.split())
    assert not Path("a.png").exists()


def test_plot_and_clip_appear_together(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("priorfill.formats.write", full)
    assert run("--plot", "a.png", "-o", "out.c3d")[0] == 1
    assert sorted(path.name for path in folder.iterdir()) == ["walk.c3d"]


def test_figures_belong_to_no_window(result: pf.Result) -> None:
    import sys

    figure = result.plot("LKNE")
    assert figure._repr_png_().startswith(b"\x89PNG")
    pyplot = sys.modules.get("matplotlib.pyplot")
    assert pyplot is None or not pyplot.get_fignums()
