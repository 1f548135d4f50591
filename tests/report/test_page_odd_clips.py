"""Pages of unusual clips: one frame, very fast cameras, every second sample missing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from browser import PageOpener, wait_until
from page_examples import example_data, write_page

import priorfill as pf
from priorfill.report.encode import encode_sparse
from priorfill.report.report_data import page_data

READY = "window.priorfill && priorfill.store.decodedFrames === priorfill.store.frames"

PIXELS = """() => {
  const hex = getComputedStyle(document.documentElement).getPropertyValue("--measured").trim();
  const want = [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
  const canvas = document.querySelector("#curves canvas");
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  let found = 0;
  for (let at = 0; at < data.length; at += 4) {
    found += want.every((value, i) => Math.abs(value - data[at + i]) < 3);
  }
  return found;
}"""
"""Number of pixels of the curves in the colour of measured samples."""

TEXTS = """() => {
  const texts = [];
  const pen = CanvasRenderingContext2D.prototype;
  const { fillText } = pen;
  pen.fillText = function (text, ...place) {
    texts.push(text);
    fillText.call(this, text, ...place);
  };
  priorfill.views.timeline.imageKey = "";
  priorfill.views.timeline.draw();
  pen.fillText = fillText;
  return texts;
}"""
"""What the timeline writes."""


def fast_data() -> dict[str, Any]:
    """Return data of two markers at 20,000 Hz; of one, every second sample is missing."""
    positions = np.zeros((61, 2, 3))
    positions[:, 0, 0] = np.linspace(0.0, 300.0, 61)
    positions[1::2, 0] = np.nan
    clip = pf.Clip(positions, ("LKNE", "RKNE"), 20_000.0, first_frame=1_000_000)
    result = pf.fill(clip, method="linear")
    data = page_data(result)
    unknown = np.full(result.filled.shape, np.nan)
    for gap in data["gaps"]:
        gap["expected_mean"] = gap["expected_rms"] = gap["bound_90"] = None
    return data | {
        "expected_rms": encode_sparse(unknown, result.filled),
        "bound_90": encode_sparse(unknown, result.filled),
    }


def test_single_samples_and_short_times_are_shown(open_page: PageOpener, tmp_path: Path) -> None:
    page = open_page(write_page(fast_data(), tmp_path / "page.html"), ready=READY)
    page.wait_for_timeout(100)
    headline = page.locator("#headline").inner_text()
    assert "61 frames at 20000 Hz (0.00305 s) · 2 markers · 30 gaps" in headline
    assert page.locator("#gap-table tr[data-gap] .number").first.inner_text() == "0.00005"
    assert page.locator("#time").inner_text().endswith("/ 0.00300 s")
    assert "filled, error unknown" in page.locator("#timeline .legend").inner_text()
    assert "error not known" in page.locator("#gap-detail").inner_text()
    texts = page.evaluate(TEXTS)
    assert {"0.0005", "0.0010", "1000010", "1000020"} <= set(texts)
    # 31 single measured samples in three panels, each of them a square of several pixels
    assert page.evaluate(PIXELS) > 31 * 3 * 4
    # the number of a frame is not cut
    assert page.locator("#frame").input_value().startswith("10000")
    assert page.evaluate(
        "(() => { const { scrollWidth, clientWidth } = document.getElementById('frame');"
        " return scrollWidth <= clientWidth; })()"
    )


def test_a_clip_of_one_frame(open_page: PageOpener, tmp_path: Path) -> None:
    clip = pf.Clip(np.full((1, 1, 3), np.nan), ("LKNE",), float(np.float32(239.76)), first_frame=5)
    page = open_page(write_page(page_data(pf.fill(clip)), tmp_path / "page.html"), ready=READY)
    assert (
        page.locator("#headline")
        .inner_text()
        .startswith("1 frame at 239.76 Hz (0.004 s) · 1 marker · 1 gap · missing 100 % before")
    )
    assert "1 frame, 0.004 s" in page.locator("#gap-detail").inner_text()
    view = page.evaluate("[priorfill.views.curves.view.first, priorfill.views.curves.view.last]")
    assert view == [-0.5, 0.5]  # the frame is in the middle, and no other one has a number


def test_the_command_has_the_whole_name_of_the_file(open_page: PageOpener, tmp_path: Path) -> None:
    data = example_data()
    data["made_for"] = {"file": f"-{'n' * 200}.c3d", "sha256": "", "method": "gpr", "database": ""}
    page = open_page(write_page(data, tmp_path / "page.html"), ready=READY)
    command = page.locator("#decision-command").input_value()
    assert command.startswith(f"priorfill fill ./-{'n' * 200}.c3d -o ")  # "-n..." were an option
    narrow = page.locator("button:visible").evaluate_all(
        "(all) => all.filter((one) => one.getBoundingClientRect().width < 24)"
        ".map((one) => one.textContent)"
    )
    assert narrow == []  # WCAG 2.5.8: targets have 24 pixels at least
    assert page.locator("canvas:not([aria-hidden], [aria-label])").count() == 0


def test_heads_of_the_table_are_text_on_paper(open_page: PageOpener, tmp_path: Path) -> None:
    page = open_page(write_page(example_data(), tmp_path / "page.html"), ready=READY)
    heads = page.locator("#gap-table thead th")
    heads.get_by_role("button", name="Marker").click()
    on_screen = heads.all_inner_texts()
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    # Chromium repeats heads on each page, but without the text of buttons
    assert page.locator("#gap-table thead button").count() == 0
    assert heads.all_inner_texts() == on_screen
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    wait_until(page, "document.querySelectorAll('#gap-table thead button').length > 5")
    assert heads.nth(1).get_attribute("aria-sort") == "ascending"
