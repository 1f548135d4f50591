"""What notebooks show: a line, tables, and the page in a frame."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser import PageOpener, wait_until

import priorfill as pf
from priorfill.errors import ClipError, MarkerNotFoundError, OptionError
from priorfill.report.notebook_page import NotebookPage

HOSTILE = ("</script><img src=x onerror=alert(1)>", "<b>", "\u202e$x$", "x" * 10_000)


@pytest.fixture(scope="module")
def result() -> pf.Result:
    """A fill of hostile labels, by straight lines."""
    time = np.linspace(0.0, 1.0, 60)
    paths = [np.stack([900 * np.sin(time + k), 300 * time, 1000 + time], 1) for k in range(4)]
    positions = np.stack(paths, axis=1)
    positions[10:30, :2] = np.nan
    clip = pf.Clip(positions, HOSTILE, 60.0, name="</iframe>\x1b", subject="<i>")
    return pf.fill(clip, method="linear")


def test_lines(result: pf.Result, tmp_path: Path) -> None:
    assert repr(result).startswith("<Result </iframe>\\x1b: filled 40 samples with linear; 2 of 2")
    assert "linear; versions python" in repr(result.provenance)
    assert "frames 0\u201359, duration 1.00 s at 60 Hz, missing 0.0 %>" in repr(result.clip)
    with pf.PriorDatabase.create(tmp_path / "db") as database:
        assert re.fullmatch(
            r"<PriorDatabase .*db: clips 0, subjects 0, length 0 s>", repr(database)
        )
    for one in (result, result.provenance, result.clip):
        assert len(repr(one)) < 500


def test_tables_are_text(result: pf.Result, tmp_path: Path) -> None:
    clip = replace(result.clip, source=None)
    shown = result._repr_html_() + clip._repr_html_()
    with pf.PriorDatabase.create(tmp_path / "<b>") as database:
        shown += database._repr_html_()
    assert set(re.findall(r"</?(\w+)", shown)) <= {*("table", "caption", "tbody", "tr", "th", "td")}
    assert "&lt;/script&gt;&lt;img" in shown
    assert "\u202e" not in shown
    assert len(shown) < 10_000
    many = replace(result, gaps=result.gaps * 20)
    assert "... and 28 more" in many._repr_html_()


def test_page_in_a_frame(result: pf.Result, open_page: PageOpener, tmp_path: Path) -> None:
    shown = result.show(height=700)
    notebook = tmp_path / "notebook.html"
    notebook.write_text(f"<!doctype html><p>text</p>{shown._repr_html_()}", encoding="utf-8")
    page = open_page(notebook)
    (frame,) = page.frames[1:]
    wait_until(frame.page, "document.querySelector('iframe').contentDocument === null")  # sandboxed
    frame.wait_for_selector("#gap-table tbody tr[data-gap]")
    wait_until(frame, "window.priorfill.store.decodedFrames === 60")
    label = frame.evaluate("document.querySelector('#gap-table tbody').textContent")
    assert "</script><img src=x onerror=alert(1)>" in label
    assert open_page.faults == []


def test_page_outside_a_notebook(result: pf.Result, tmp_path: Path) -> None:
    shown = result.show()
    assert repr(shown).startswith("<page of </iframe>")
    shown.save(tmp_path / "walk.html")
    assert (tmp_path / "walk.html").read_text(encoding="utf-8") == shown.page
    with pytest.raises(OptionError, match="`height`"):
        result.show(height=10)
    large = NotebookPage("walk", "x" * 6_000_000, 700)._repr_html_()
    assert large.startswith("<p>This page makes the notebook 6 MB larger")
    assert shown._repr_html_().startswith("<iframe ")


def test_path_of_a_marker(result: pf.Result) -> None:
    clip = replace(result.clip, labels=("LKNE", "RKNE", "C7", "T10"))
    assert np.array_equal(clip["RKNE"], clip.positions[:, 1])
    assert np.shares_memory(clip["RKNE"], clip.positions)
    with pytest.raises(ValueError, match="read-only"):
        clip["RKNE"][0, 0] = 1.0
    assert "C7" in clip
    assert 3 not in clip
    assert list(clip) == ["LKNE", "RKNE", "C7", "T10"]
    for error in (KeyError, ClipError, MarkerNotFoundError, pf.PriorfillError):
        with pytest.raises(error, match="has no marker rkne; did you mean RKNE"):
            clip["rkne"]
    both = replace(clip, labels=("Anna:C7", "Anna:T10", "Ben:C7", "Ben:T10"))
    with pytest.raises(KeyError, match="did you mean Anna:C7 or Ben:C7"):
        both["C7"]
    with pytest.raises(KeyError, match="by their labels, not by 0"):
        clip[0]  # type: ignore[index]


def test_progress_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    from priorfill.report import notebook_progress as module

    shown: list[str] = []

    class Handle:
        def update(self, bundle: dict[str, str], raw: bool) -> None:
            shown.append(bundle["text/html"])

    def display(bundle: dict[str, str], *, raw: bool, display_id: bool) -> Handle:
        shown.append(bundle["text/html"])
        return Handle()

    monkeypatch.setattr(module, "_display", lambda: display)
    monkeypatch.setattr(module, "INTERVAL_S", 0.0)
    bar = pf.notebook_progress("<b>")
    bar(1, 3)
    bar(3, None)
    assert shown == [
        '<progress value="1" max="3"></progress> &lt;b&gt; 1 of 3',
        '<progress value="3" max="3"></progress> &lt;b&gt; 3 of 3',
    ]
    monkeypatch.setattr(module, "INTERVAL_S", 100.0)
    for step in range(20):
        bar(step, 20)
    bar(20, 20)
    assert len(shown) == 3
