"""The timeline of the page: what it draws, and what pointer, wheel and keys do."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import pytest
from browser import PageOpener, wait_until
from page_examples import crowded_data, example_data, write_page

READY = "window.priorfill && window.priorfill.store.decodedFrames === 600"

POINT = """(t, marker, frame) => {
  const box = t.canvas.getBoundingClientRect();
  const row = 32 + (t.rowOf.get(marker) + 0.5) * t.rowHeight - t.scroller.scrollTop;
  return [box.left + t.xOf(frame + 0.5), box.top + row];
}"""

COLOUR_AT = """(t, marker, frame, part = 0.5) => {
  t.draw();
  const copy = document.createElement("canvas");
  copy.width = t.canvas.width;
  copy.height = t.canvas.height;
  const pen = copy.getContext("2d", { willReadFrequently: true });
  pen.drawImage(t.canvas, 0, 0);
  const y = 32 + (t.rowOf.get(marker) + part) * t.rowHeight - t.scroller.scrollTop;
  return Array.from(pen.getImageData(Math.round(t.xOf(frame)), Math.round(y), 1, 1).data);
}"""


@pytest.fixture
def page(open_page: PageOpener, tmp_path: Path) -> Any:
    return open_page(write_page(example_data(), tmp_path / "page.html"), ready=READY)


def timeline(page: Any, expression: str) -> Any:
    script = "const s = window.priorfill.store, t = window.priorfill.views.timeline;"
    return page.evaluate(f"(() => {{ {script} return {expression}; }})()")


def point(page: Any, marker: int, frame: float) -> tuple[float, float]:
    """Return where a sample is in the window."""
    page.locator("#timeline canvas").scroll_into_view_if_needed()
    x, y = timeline(page, f"({POINT})(t, {marker}, {frame})")
    return x, y


def test_colours_and_rows(page: Any) -> None:
    # markers with gaps or special samples, below the names of their subjects
    assert timeline(page, "t.rows.map((r) => r.subject || r.marker)") == [
        "Anna", 0, 1, 2, 3, 4, "Ben", 6, 7,
    ]  # fmt: skip
    # the colour of a filled sample is that of its expected error, and each state has its own
    seen = [
        timeline(page, f"({COLOUR_AT})(t, {marker}, {frame})")
        for marker, frame in [(0, 125), (1, 215), (2, 310), (4, 425), (0, 50), (6, 520)]
    ]
    assert len({tuple(colour) for colour in seen}) == len(seen)
    # in the light theme a greater error is darker
    assert sum(seen[0]) > sum(seen[-1]) > sum(seen[1])
    # a line above the fills that replace measured samples, and only above these
    for marker, frame, line in ((3, 55, True), (0, 125, False)):
        top, middle = (
            timeline(page, f"({COLOUR_AT})(t, {marker}, {frame}, {part})") for part in (0.15, 0.5)
        )
        assert (top != middle) is line
    page.get_by_label("All markers").check()
    assert timeline(page, "t.rows.length") == 10
    page.get_by_label("Fit rows").check()
    assert timeline(page, "t.spacer.clientHeight <= t.scroller.clientHeight + 1")


def test_clicks_and_drags(page: Any) -> None:
    page.mouse.click(*point(page, 6, 510))
    assert timeline(page, "[s.activeGap, s.frame, ...s.markers]") == [3, 510, 6]
    page.mouse.click(*point(page, 0, 300))  # no gap there: marker and frame
    assert timeline(page, "[s.frame, ...s.markers]") == [300, 0]
    x, y = point(page, 2, 310)
    page.keyboard.down("Shift")
    page.mouse.click(x, y)
    page.keyboard.up("Shift")
    assert timeline(page, "s.markers") == [0, 2]
    left, y = point(page, 0, 200)
    right, _ = point(page, 0, 300)
    page.mouse.move(left, y)
    page.mouse.down()
    page.mouse.move((left + right) / 2, y)
    page.mouse.move(right, y)
    page.mouse.up()
    assert timeline(page, "s.range") == [200, 300]
    assert "301 to 401" in page.locator("#announcer").inner_text()
    x, y = point(page, 0, 450)
    top = timeline(page, "t.canvas.getBoundingClientRect().top")
    page.mouse.click(x, top + 10)  # on the axis
    assert timeline(page, "[s.frame, s.range]") == [450, [200, 300]]
    page.mouse.click(*point(page, 0, 125))
    assert timeline(page, "[s.range, s.activeGap]") == [None, 0]
    page.mouse.click(*point(page, 6, 510), button="right")  # opens the menu of the browser
    assert timeline(page, "s.activeGap") == 0
    page.mouse.dblclick(*point(page, 0, 125))
    assert timeline(page, "[Math.round(t.view.from), Math.round(t.view.to)]") == [50, 200]
    page.get_by_role("button", name="Show all frames (0)").click()
    page.mouse.move(page.locator("#timeline canvas").bounding_box()["x"] + 20, point(page, 1, 0)[1])
    tip = page.locator("#timeline .tip").inner_text()
    assert tip == "RKNE: 1 gap, missing 10 % before, 5.0 % after the fill"
    page.mouse.move(*point(page, 1, 215))
    tip = page.locator("#timeline .tip").inner_text()
    assert "RKNE, frame 316 (2.15 s): filled" in tip
    assert "expected rms error 30 mm, 90 % below 48 mm" in tip


def test_zoom_by_wheel_buttons_and_keys(page: Any) -> None:
    span = "Math.round(t.view.to - t.view.from)"
    assert timeline(page, span) == 600
    page.mouse.move(*point(page, 0, 125))
    page.mouse.wheel(0, -120)
    wait_until(
        page, f"(() => {{ const t = window.priorfill.views.timeline; return {span} < 600 }})()"
    )
    # the frame under the pointer stays there
    assert timeline(page, "t.view.from > 0 && t.view.to > 125")
    page.get_by_role("button", name="Show all frames (0)").click()
    assert timeline(page, span) == 600
    page.get_by_role("button", name="Show fewer frames (+)").click()
    assert timeline(page, span) == 400
    page.get_by_role("button", name="Later frames (Page Down)").click()
    assert timeline(page, "Math.round(t.view.to)") > 500
    page.locator("#timeline").get_by_role("button", name="Zoom to the gap").click()
    assert timeline(page, f"[{span}, Math.round(t.view.from)]") == [180, 140]
    page.locator("#timeline canvas").focus()
    page.keyboard.press("-")
    assert timeline(page, span) == 270
    page.keyboard.press("0")
    page.keyboard.press("+")
    page.keyboard.press("PageUp")
    assert timeline(page, f"[{span}, t.view.from]") == [400, 0]
    page.keyboard.press("ArrowDown")
    assert timeline(page, "s.markers") == [2]
    page.keyboard.press("ArrowDown")
    assert timeline(page, "[s.activeGap, s.frame]") == [2, 55]
    page.keyboard.press("ArrowUp")
    page.keyboard.press("ArrowUp")
    page.keyboard.press("ArrowUp")
    assert timeline(page, "[s.activeGap, ...s.markers]") == [0, 0]
    page.keyboard.press("End")
    assert timeline(page, "s.frame") == 599
    # gaps chosen elsewhere come into view
    page.keyboard.press("Enter")
    page.evaluate("window.priorfill.store.setActiveGap(3)")
    assert timeline(page, "t.view.from < 500 && t.view.to > 540")


def test_many_markers_stay_quick(open_page: PageOpener, tmp_path: Path) -> None:
    data = crowded_data(300, 1000, 1500)
    page = open_page(write_page(data, tmp_path / "page.html"), ready="window.priorfill")
    wait_until(page, "window.priorfill.store.decodedFrames === 1000")
    seconds = timeline(
        page,
        """(() => {
          const begin = performance.now();
          for (let i = 0; i < 50; i++) { s.frame = i * 10; t.draw(); }
          return (performance.now() - begin) / 50 / 1000;
        })()""",
    )
    assert seconds < 0.1  # 1 ms on an idle computer: the rows are drawn once
    # columns of several frames have the colour of the greatest error in them
    page.set_viewport_size({"width": 400, "height": 768})
    pictures = timeline(
        page,
        """[[300, 300], [0, 300], [0, 0]].map(([other, most]) => {
          t.scroller.scrollTop = 0;
          const { start, stop, offset } = s.filledRuns[0].find((r) => r.stop - r.start > 8);
          for (let i = 0; i < stop - start; i++) {
            s.errors.rms[offset + i] = i % 3 && i < stop - start - 1 ? other : most;
          }
          t.imageKey = "";
          t.draw();
          return t.canvas.toDataURL();
        })""",
    )
    assert pictures[0] == pictures[1] != pictures[2]
    page.get_by_label("Fit rows").check()
    began = time.monotonic()
    assert timeline(page, "(() => { t.imageKey = ''; t.draw(); return t.rowHeight })()") < 1.0001
    assert time.monotonic() - began < 5


def test_decisions_have_signs(page: Any) -> None:
    picture = "t.canvas.toDataURL()"
    timeline(page, "t.draw()")
    before = timeline(page, picture)
    entry = {"marker": "LKNE", "subject": "Anna", "frames": "201-250", "do": "accept"}
    page.evaluate(f"window.priorfill.store.setDecisions([{json.dumps(entry)}])")
    sign = page.locator("#gap-table tr[data-gap='0'] .sign")
    assert sign.inner_text().strip() == "✓"
    timeline(page, "t.draw()")
    assert timeline(page, picture) != before
    page.evaluate("window.priorfill.store.setDecisions([])")
    assert sign.count() == 0
    timeline(page, "t.draw()")
    assert timeline(page, picture) == before
