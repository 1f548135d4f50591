"""The page as a whole: decoding, text of files, colours, keys, paper."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import PageOpener, wait_until
from page_examples import HOSTILE, example_data, write_page

READY = "window.priorfill && window.priorfill.store.decodedFrames === 600"


@pytest.fixture
def page(open_page: PageOpener, tmp_path: Path) -> Any:
    return open_page(write_page(example_data(), tmp_path / "page.html"), ready=READY)


def store(page: Any, expression: str) -> Any:
    return page.evaluate(f"(() => {{ const s = window.priorfill.store; return {expression}; }})()")


def test_data_are_decoded_exactly(page: Any) -> None:
    # both sides of the boundary of two blocks, a filled sample, and a sample held where missing
    frames = (0, 1, 511, 512, 513, 599)
    seen = store(page, f"{list(frames)}.map((f) => Array.from("
                 "s.positions(0).slice((f * 8 + 5) * 3, (f * 8 + 6) * 3)))")  # fmt: skip
    sway = 200 * np.sin(np.array(frames) / 100 + 5)
    np.testing.assert_allclose(np.array(seen)[:, 0] / 10, sway, atol=0.0501)
    assert [row[1:] for row in seen] == [[600, 13300]] * len(frames)
    states = store(page, "[s.state(99, 0), s.state(100, 0), s.state(240, 1), s.state(310, 2),"
                   " s.state(55, 3), s.state(420, 4)]")  # fmt: skip
    assert states == [1, 2, 0, 3, 4, 5]
    assert store(page, "[s.rms(149, 0), s.bound(200, 1), s.rms(55, 3), s.rms(539, 6)]") == [
        2, 48, 0.7, 8,
    ]  # fmt: skip
    assert store(page, "[s.rms(99, 0), s.bound(240, 1)].every(Number.isNaN)")
    assert store(page, "[s.gapAt(100, 0), s.gapAt(99, 0), s.gapAt(259, 1), s.gapAt(260, 1)]") == [
        0, -1, 1, -1,
    ]  # fmt: skip
    assert store(page, "[s.shown(0, 240, 1), s.shown(0, 229, 1), s.frameNumber(9)]") == [
        False, True, 110,
    ]  # fmt: skip


def test_text_of_files_stays_text(open_page: PageOpener, tmp_path: Path) -> None:
    page = open_page(write_page(example_data(hostile=True), tmp_path / "page.html"), ready=READY)
    for gap in range(5):
        page.evaluate(f"window.priorfill.store.setActiveGap({gap})")
    page.locator("#summary summary").click()
    page.get_by_label("All markers").click()
    page.locator("#timeline canvas").hover(position={"x": 300, "y": 60})
    assert page.title() == "</title><script>alert(3)</script>.c3d"
    assert page.locator("h1").inner_text() == "</title><script>alert(3)</script>.c3d"
    assert page.locator("img").count() == 0
    assert page.locator("script").count() == 2
    rows = page.locator("#gap-table tbody").inner_text()
    assert HOSTILE[0] in rows and HOSTILE[1] in rows
    assert HOSTILE[0] in page.locator("#summary").inner_text()
    # a label of 10,000 characters does not widen the page
    page.evaluate("window.priorfill.store.setMarkers([2])")
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")


def test_colours_follow_the_system_and_the_button(open_page: PageOpener, tmp_path: Path) -> None:
    file = write_page(example_data(), tmp_path / "page.html")
    page = open_page(file, ready=READY, dark=True)
    ground = "getComputedStyle(document.documentElement).backgroundColor"
    picture = "document.querySelector('#timeline canvas').toDataURL()"
    dark, picture_dark = page.evaluate(ground), page.evaluate(picture)
    page.get_by_role("button", name="Light", exact=True).click()
    wait_until(page, f"{picture} !== {json.dumps(picture_dark)}")
    light = page.evaluate(ground)
    assert sum(map(int, light[4:-1].split(","))) > 600 > sum(map(int, dark[4:-1].split(",")))
    page.keyboard.press("t")
    assert page.evaluate(ground) == dark
    page.emulate_media(color_scheme="light")
    assert page.evaluate(ground) == dark  # what the user chose stays


def test_text_is_readable(page: Any) -> None:
    # contrast of text with its ground by WCAG 2.2, 1.4.3: at least 4.5
    measured = page.evaluate("""() => {
      const light = (text) => {
        const canvas = document.createElement("canvas").getContext("2d");
        canvas.fillStyle = text;
        canvas.fillRect(0, 0, 1, 1);
        const parts = [...canvas.getImageData(0, 0, 1, 1).data].slice(0, 3).map((v) => v / 255)
          .map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
        return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2];
      };
      const root = document.documentElement;
      const pairs = [["text", "surface"], ["text", "panel"], ["muted", "surface"],
        ["muted", "panel"], ["accent", "surface"], ["accent", "selection"], ["text", "selection"],
        ["missing", "surface"], ["missing", "selection"], ["problem-text", "problem"],
        ["warning", "warning-back"], ["muted", "selection"]];
      const found = {};
      for (const theme of ["light", "dark"]) {
        root.dataset.theme = theme;
        const style = getComputedStyle(root);
        for (const pair of pairs) {
          const [a, b] = pair.map((name) => light(style.getPropertyValue(`--${name}`).trim()));
          found[`${theme} ${pair}`] = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
        }
      }
      return found;
    }""")
    assert {name: ratio for name, ratio in measured.items() if ratio < 4.5} == {}


def test_keys_work_anywhere(page: Any) -> None:
    press = page.keyboard.press
    assert store(page, "s.activeGap") == 1  # the worst one
    press("n")
    assert store(page, "s.activeGap") == 4
    press("p")
    assert store(page, "[s.activeGap, s.frame]") == [1, 230]
    press("ArrowRight")
    press("Shift+ArrowRight")
    assert store(page, "s.frame") == 241
    press("Shift+ArrowLeft")
    press("ArrowLeft")
    press(",")
    press("Shift+ArrowRight")
    press(".")
    assert store(page, "s.range") == [230, 240]
    press("Shift+ArrowLeft")
    press("Shift+ArrowLeft")
    press(".")  # before its beginning
    assert store(page, "s.range") == [220, 220]
    press("Shift+ArrowRight")
    press("Shift+ArrowRight")
    press("Escape")
    assert store(page, "s.range") is None
    press("]")
    assert store(page, "s.speed") == 2
    press("[")
    press("s")
    assert store(page, "[s.speed, s.chosenGaps.has(1)]") == [1, True]
    press("Space")
    wait_until(page, "window.priorfill.store.frame > 241")
    press("Space")
    assert store(page, "s.playing") is False
    press("Space")
    press("ArrowRight")  # a step ends playing
    assert store(page, "s.playing") is False


def test_keys_stay_with_what_is_typed_into(page: Any) -> None:
    before = store(page, "[s.activeGap, s.frame]")
    page.get_by_label("Filter").focus()
    page.keyboard.type("napxt ?")
    assert page.get_by_label("Filter").input_value() == "napxt ?"
    page.keyboard.press("ArrowLeft")
    assert store(page, "[s.activeGap, s.frame]") == before
    page.get_by_label("Filter").fill("")
    page.locator("h1").click()
    page.keyboard.press("Control+ArrowRight")  # belongs to the browser
    assert store(page, "[s.activeGap, s.frame]") == before
    page.keyboard.press("?")
    dialog = page.get_by_role("dialog")
    assert dialog.get_by_text("Gap below in the table").is_visible()
    page.keyboard.press("n")
    assert store(page, "s.activeGap") == before[0]
    page.keyboard.press("Escape")
    assert not dialog.is_visible()
    page.get_by_role("button", name="Keys").click()
    dialog.get_by_role("button", name="Close").click()
    assert not dialog.is_visible()


def test_summary_unfolds_and_gaps_are_described(page: Any) -> None:
    assert "5 gaps" in page.locator("#headline").inner_text()
    assert "missing 4.2 % before, 0.6 % after" in page.locator("#headline").inner_text()
    assert not page.get_by_role("rowheader", name="Database").is_visible()
    page.locator("#summary summary").click()
    assert page.get_by_role("rowheader", name="Database").is_visible()
    skip = page.get_by_role("link", name="Skip to the gap table")
    skip.focus()
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "gap-table"
    text = page.locator("#gap-detail").inner_text()
    assert "RKNE, frames 301–360" in text
    assert "The fill begins 24 mm from the path." in text
    assert "331–360: nothing alike in the database" in text
    page.locator("#gap-detail").get_by_role("button", name="Next").click()
    assert "STRN, frames 221–260" in page.locator("#gap-detail").inner_text()


def test_paper_has_everything_in_light_colours(open_page: PageOpener, tmp_path: Path) -> None:
    page = open_page(write_page(example_data(), tmp_path / "page.html"), ready=READY, dark=True)
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    page.emulate_media(media="print")
    assert page.evaluate("window.priorfill.views.summary.box.open")
    assert page.locator("#gap-table tbody tr[data-gap]").count() == 5
    assert "The fill is 12 mm below the floor." in page.locator("#gap-table").inner_text()
    assert page.locator(".timeline-paper canvas").count() == 1
    assert not page.get_by_role("button", name="Keys").is_visible()
    assert page.evaluate("getComputedStyle(document.documentElement).color") == "rgb(27, 31, 36)"
    assert page.evaluate("getComputedStyle(document.documentElement).backgroundColor") == (
        "rgb(255, 255, 255)"
    )
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    page.emulate_media(media="screen")
    assert page.locator(".timeline-paper canvas").count() == 0
    assert page.evaluate("document.documentElement.dataset.theme") is None


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda data: data["versions"][0]["positions"]["data"].__setitem__(0, "AAAA"), "positions"),
        (lambda data: data.__setitem__("format", 2), "unknown format"),
        (lambda data: data["states"]["values"][0].pop(), "damaged"),
    ],
)
def test_damaged_data_are_one_line(
    open_page: PageOpener, tmp_path: Path, spoil: Any, message: str
) -> None:
    data = example_data()
    spoil(data)
    page = open_page(write_page(data, tmp_path / "page.html"))
    line = page.get_by_role("alert")
    line.wait_for(state="visible")
    assert message in line.inner_text()
    assert "\n" not in line.inner_text()


def test_old_browsers_are_named(open_page: PageOpener, tmp_path: Path) -> None:
    file = write_page(example_data(), tmp_path / "page.html")
    page = open_page(file, ready=READY, own=True)
    page.add_init_script("delete window.DecompressionStream")
    page.reload()
    page.get_by_role("alert").wait_for(state="visible")
    assert "use Chrome 93" in page.get_by_role("alert").inner_text()
