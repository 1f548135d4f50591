"""Curves in the page: values, bands, versions, zoom, keys."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from browser import PageOpener, wait_until
from page_examples import RATE, crowded_data, example_data, write_page

from priorfill.report.bands import BAND_50, BAND_90, HALO_50
from priorfill.report.encode import encode_positions, encode_runs

FRAMES, MARKERS = 600, 8
RKNE, LANK = 1, 2
ERROR = 30.0
"""mm. Expected rms error of the fills of RKNE in the example; the bound is 1.6 times as large."""

READY = "window.priorfill && window.priorfill.store.positions(0)"
DECODED = (
    f"{READY} && window.priorfill.store.decodedFrames === window.priorfill.store.frames"
    " && !window.priorfill.views.curves.timer"
)

INK = """([frames, kind, name]) => {
  const { base, laid, view } = window.priorfill.views.curves;
  const panel = laid.panels.find((p) => p.kind === kind);
  const shade = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const wanted = [1, 3, 5].map((at) => parseInt(shade.slice(at, at + 2), 16));
  const at = (frame) => panel.x + ((frame - view.first) / view.span) * panel.width;
  const [left, right] = frames.map((frame) => Math.round(at(frame)));
  const copy = document.createElement("canvas");
  [copy.width, copy.height] = [base.width, base.height];
  const context = copy.getContext("2d", { willReadFrequently: true });
  context.drawImage(base, 0, 0);
  const { data } = context.getImageData(
    left, panel.y + 1, Math.max(1, right - left), panel.height - 2);
  let count = 0;
  for (let i = 0; i < data.length; i += 4) {
    if (wanted.every((value, c) => Math.abs(value - data[i + c]) < 24)) count += 1;
  }
  return count;
}"""
"""Number of pixels of a colour between two frames of a panel."""


def path_of(marker: int) -> np.ndarray:
    """Positions of a marker of the example (frames, 3), mm, rounded as in the page."""
    time = np.arange(FRAMES) / RATE
    still = [60.0 * (marker % 4), 1500 - 170.0 * (marker // 4 % 9)]
    path = np.column_stack([200 * np.sin(time + marker), *(np.full(FRAMES, v) for v in still)])
    return np.round(path, 1)


def with_versions(data: dict[str, Any]) -> dict[str, Any]:
    """Add a truth 5 mm above the fill, and another file that lacks the second half."""
    paths = np.stack([path_of(marker) for marker in range(MARKERS)], axis=1)
    everywhere = np.ones((FRAMES, MARKERS), dtype=bool)
    half = everywhere.copy()
    half[FRAMES // 2 :] = False
    for name, kind, shift, shown in (
        ("truth.c3d", "truth", 5.0, everywhere),
        ("<b>spline.c3d", "other", -20.0, half),
    ):
        positions = np.where(shown[..., None], paths + np.array([0.0, 0.0, shift]), np.nan)
        version = {"name": name, "kind": kind, "positions": encode_positions(positions)}
        data["versions"].append({**version, "shown": encode_runs(shown)})
    return data


def curves(page: Any, expression: str) -> Any:
    """Evaluate an expression of the curves after what is asked for is drawn."""
    page.evaluate("() => new Promise((r) => requestAnimationFrame(() => setTimeout(r, 0)))")
    return page.evaluate(f"((curves, store) => ({expression}))"
                         "(window.priorfill.views.curves, window.priorfill.store)")  # fmt: skip


def view(page: Any) -> tuple[float, float]:
    """The first and the last frame in view."""
    first, last = curves(page, "[curves.view.first, curves.view.last]")
    return first, last


def legend_of(page: Any) -> str:
    """The text of the legend."""
    curves(page, "0")
    return str(page.locator(".curves-legend").inner_text())


def place_of(page: Any) -> str:
    """The text above the read-out."""
    curves(page, "0")
    return str(page.locator(".curves-place").inner_text())


def go_to(page: Any, frame: int) -> None:
    """Move the playhead."""
    page.evaluate("(frame) => window.priorfill.store.setFrame(frame)", frame)


def values(page: Any) -> list[list[str]]:
    """The rows of the read-out."""
    curves(page, "0")
    rows = page.locator("#curves tbody tr").all()
    return [row.locator("th, td").all_inner_texts() for row in rows]


def spot(page: Any, frame: float, part: str = "panels") -> tuple[float, float]:
    """A place in the window, at a frame of the first panel or time axis."""
    page.locator("#curves-canvas").scroll_into_view_if_needed()
    x, y = curves(
        page,
        f"""((one, box) => [
        box.x + one.x + ({frame} - curves.view.first) / curves.view.span * one.width,
        box.y + one.y + 12,
      ])(curves.laid.{part}[0], curves.overlay.getBoundingClientRect())""",
    )
    return x, y


def drag(page: Any, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Drag with the pointer."""
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(*end, steps=4)
    page.mouse.up()


def test_a_gap_is_shown_with_its_bands_and_what_stays_missing(
    open_page: PageOpener, tmp_path: Path
) -> None:
    page = open_page(write_page(example_data(), tmp_path / "page.html"), ready=DECODED)
    assert page.locator(".curves-chip").all_inner_texts() == ["RKNE×"]
    first, last = view(page)  # as much on each side as the gap of frames 200 to 259 is long
    assert (first, last) == (140, 319)

    go_to(page, 210)
    half = BAND_90 * 1.6 * ERROR
    x, y, z = path_of(RKNE)[210]
    (row,) = values(page)
    assert row[:2] == ["RKNE", "filled"]
    assert row[2:5] == [f"{v:.1f} ± {half:.1f}".replace("-", "−") for v in (x, y, z)]
    assert row[6] == f"{ERROR:.1f}, 90 % below {1.6 * ERROR:.1f}"
    assert place_of(page) == "Frame 311, 2.10 s, at the playhead:"
    go_to(page, 240)
    assert values(page)[0][1:3] == ["missing", "–"]

    # measured, then filled with a wide and a narrow band, then nothing, then measured
    assert page.evaluate(INK, [[170, 196], "x", "--measured"]) > 30
    assert page.evaluate(INK, [[202, 228], "x", "--filled"]) > 15
    assert page.evaluate(INK, [[202, 228], "y", "--bound-90"]) > 100
    assert page.evaluate(INK, [[202, 228], "y", "--bound-50"]) > 100
    for name in ("--measured", "--filled", "--bound-90"):
        assert page.evaluate(INK, [[233, 257], "x", name]) == 0
    assert page.evaluate(INK, [[262, 300], "x", "--measured"]) > 30
    shares = curves(page, "['x', 'distance'].map((k) => [90, 50].map((p) => "
                          "curves.series.halfWidth(k, p)))")  # fmt: skip
    assert shares == [[BAND_90, BAND_50], [1, HALO_50]]
    legend = legend_of(page)
    assert "90 % band" in legend and "left missing" in legend and "in doubt" not in legend

    page.get_by_label("Add a marker to the curves").fill("lank")
    page.keyboard.press("Enter")
    page.evaluate("window.priorfill.views.curves.showFrames(290, 330)")
    assert "in doubt" in legend_of(page)
    assert [row[:2] for row in values(page)][1] == ["LANK", "measured"]
    page.get_by_label("Remove RKNE from the curves").click()
    curves(page, "0")
    assert page.evaluate(INK, [[299, 321], "x", "--doubt"]) > 20
    assert page.evaluate(INK, [[291, 297], "x", "--doubt"]) == 0

    before = page.evaluate(INK, [[291, 329], "x", "--measured"])
    page.locator("#theme").click()
    curves(page, "0")
    assert before > 20 and page.evaluate(INK, [[291, 329], "x", "--measured"]) > 20
    page.get_by_label("Remove LANK from the curves").click()
    page.get_by_text("Choose a gap, or add a marker.").wait_for()


def test_curves_are_zoomed_panned_and_read_by_pointer_and_keys(
    open_page: PageOpener, tmp_path: Path
) -> None:
    page = open_page(write_page(example_data(), tmp_path / "page.html"), ready=DECODED)
    frame_now = "store.frame"
    page.mouse.move(*spot(page, 180))
    assert place_of(page) == "Frame 281, 1.80 s, at the pointer:"
    page.mouse.wheel(0, -100)  # scrolls: the curves have not the focus
    assert view(page) == (140, 319)
    page.mouse.click(*spot(page, 200))
    assert curves(page, frame_now) == 200
    page.mouse.wheel(0, -100)
    wait_until(page, "window.priorfill.views.curves.view.span < 160")
    first, last = view(page)
    assert first < 200 < last
    drag(page, spot(page, 190), spot(page, 230))
    assert np.allclose(view(page), (190, 230), atol=1)
    drag(page, spot(page, 200, "axes"), spot(page, 210, "axes"))
    assert np.allclose(view(page), (180, 220), atol=1.5)
    page.keyboard.down("Shift")
    drag(page, spot(page, 195), spot(page, 205))
    page.keyboard.up("Shift")
    assert np.allclose(curves(page, "store.range"), (195, 205), atol=1)
    page.mouse.dblclick(*spot(page, 200))
    assert view(page) == (0, FRAMES - 1)

    page.evaluate("document.activeElement.blur()")
    page.locator("#curves-canvas").focus()
    go_to(page, 300)
    page.keyboard.press("+")
    first, last = view(page)
    assert np.isclose(last - first, (FRAMES - 1) / 1.5) and first < 300 < last
    page.keyboard.press("-")
    page.keyboard.press("-")
    assert view(page) == (0, FRAMES - 1)
    page.keyboard.press("Enter")
    assert view(page) == (140, 319)
    page.keyboard.press("PageDown")
    assert view(page)[0] == 140 + 0.5 * 179
    page.keyboard.press("Home")
    assert view(page) == (0, FRAMES - 1)
    page.keyboard.press("ArrowRight")
    assert curves(page, frame_now) == 301
    page.get_by_role("button", name="Curves: zoom to the gap").click()
    go_to(page, 500)  # the view follows the playhead
    assert np.isclose(sum(view(page)) / 2, 500, atol=1)

    field = page.get_by_label("Add a marker to the curves")
    for text, message in (("q", "No marker contains “q”"), ("l", "3 markers contain “l”")):
        field.fill(text)
        field.press("Enter")
        assert page.locator(".curves-message").inner_text() == message
    for label in ("LKNE", "LANK", "RANK", "LTHI", "RTHI"):
        field.fill(label)
    assert page.locator(".curves-chip").count() == 6 and field.is_disabled()
    assert len(values(page)) == 6
    assert curves(page, "curves.laid.panels.length") == 6 * 5
    page.get_by_role("button", name="Arrange", exact=True).click()
    page.get_by_label("in one panel").check()
    assert curves(page, "curves.laid.panels.length") == 5
    page.get_by_role("checkbox", name="speed").uncheck()
    page.get_by_label("same scale").check()
    panels = curves(page, "curves.laid.panels.map((p) => [p.kind, p.high - p.low])")
    assert [kind for kind, _ in panels] == ["x", "y", "z", "error"]
    assert np.ptp([height for kind, height in panels if kind != "error"]) < 1e-6
    label = page.locator("#curves-canvas").get_attribute("aria-label")
    assert label is not None and re.match(r"Curves of RKNE, LKNE, .*: x, y, z, error; ", label)


def test_versions_are_compared_over_the_whole_clip(open_page: PageOpener, tmp_path: Path) -> None:
    data = with_versions(example_data())
    data["clip"]["up"] = "+Y"
    page = open_page(write_page(data, tmp_path / "page.html"), ready=DECODED)
    wait_until(page, "window.priorfill.views.curves.series.known.get(2) === 600")
    page.wait_for_timeout(50)
    go_to(page, 210)
    head = page.locator("#curves thead th").all_inner_texts()
    assert head[2:] == ["x (mm)", "y (mm, file -Z)", "z up (mm, file Y)", "speed (mm/s)",
                        "distance (mm)"]  # fmt: skip
    filled, truth, other = values(page)
    path = path_of(RKNE)
    speed = np.linalg.norm(path[211] - path[209]) / 2 * RATE
    assert filled[5] == f"{speed:.0f}" and filled[6] == "5.0"
    assert (truth[1], truth[4]) == ("truth.c3d", f"{path[210, 2] + 5:.1f}")
    assert (other[1], other[4]) == ("<b>spline.c3d", f"{path[210, 2] - 20:.1f}")
    assert page.evaluate(INK, [[170, 196], "z", "--truth"]) > 20
    assert page.evaluate(INK, [[202, 228], "distance", "--bound-90"]) > 100
    legend = legend_of(page)
    assert "truth.c3d" in legend and "<b>spline.c3d" in legend

    page.get_by_role("button", name="Compare", exact=True).click()
    page.get_by_label("truth.c3d", exact=True).uncheck()
    assert len(values(page)) == 2
    assert page.evaluate(INK, [[170, 196], "z", "--truth"]) == 0
    page.get_by_label("neighbours").check()
    assert "neighbours, shifted" in legend_of(page)
    near = "curves.laid.panels[0].lines.filter((line) => line.role === 'neighbour')"
    assert curves(page, f"{near}.map((line) => store.data.markers[line.other].label)") == ["LKNE"]
    offset = curves(
        page,
        f"""((one, first, last) => {{
        const own = curves.series.values(0, 1, "x");
        let sum = 0;
        for (let t = first; t <= last; t += 1) if (own[t] === own[t]) sum += one[t] - own[t];
        return sum / (last - first + 1);
      }})({near}[0].series, curves.view.first, curves.view.last)""",
    )
    assert abs(offset) < 0.01
    page.get_by_label("First version of the distance").select_option("truth.c3d")
    page.get_by_label("Second version of the distance").select_option("<b>spline.c3d")
    assert values(page)[0][6] == "25.0"
    assert page.evaluate(INK, [[202, 228], "distance", "--bound-90"]) == 0
    go_to(page, 310)
    assert values(page)[0][6] == "–"

    # filled again: other values, the same view
    page.evaluate("window.priorfill.views.curves.showFrames(195, 215)")
    again = example_data()
    higher = np.stack([path_of(marker) + np.array([0, 0, 7]) for marker in range(MARKERS)], axis=1)
    again["versions"][0]["positions"] = encode_positions(higher)
    page.evaluate("(data) => window.priorfill.store.setData(data)", again)
    wait_until(page, DECODED)
    go_to(page, 210)
    wait_until(page, "document.querySelectorAll('#curves tbody tr').length === 1")
    assert values(page)[0][4].startswith(f"{path[210, 2] + 7:.1f} ± ")
    assert view(page) == (195, 215)
    assert page.get_by_role("group", name="Compared versions").count() == 0


def test_long_clips_keep_their_peaks_and_are_drawn_once(
    open_page: PageOpener, tmp_path: Path
) -> None:
    data = crowded_data(6, 12_000, 60)
    time = np.arange(12_000) / RATE
    positions = np.stack([np.column_stack([30 * np.sin(time + m), 0 * time, 0 * time])
                          for m in range(6)], axis=1)  # fmt: skip
    peak = 7777
    positions[peak, 0, 0] = 500.0
    data["versions"][0]["positions"] = encode_positions(positions)
    page = open_page(write_page(data, tmp_path / "page.html"), ready=DECODED)
    page.wait_for_timeout(50)
    page.evaluate("window.priorfill.store.setMarkers([0])")
    page.evaluate("window.priorfill.views.curves.showClip()")
    low, high = curves(page, "[curves.laid.panels[0].low, curves.laid.panels[0].high]")
    assert low < -30 and high > 500
    assert page.evaluate(INK, [[peak - 30, peak + 30], "x", "--measured"]) > 15
    page.evaluate("window.priorfill.store.setMarkers([0, 1, 2, 3, 4, 5])")
    curves(page, "0")
    page.evaluate("""() => {
      const { curves } = window.priorfill.views;
      const { draw } = curves;
      window.drawn = 0;
      curves.draw = function () { window.drawn += 1; draw.call(curves); };
    }""")
    for frame in (100, 6000, 11_000):
        go_to(page, frame)
        assert len(values(page)) == 6
    assert page.evaluate("window.drawn") == 0  # the playhead has a canvas of its own
    page.evaluate("window.priorfill.views.curves.zoom(0.5); "
                  "window.priorfill.views.curves.pan(10)")  # fmt: skip
    curves(page, "0")
    assert page.evaluate("window.drawn") == 1
