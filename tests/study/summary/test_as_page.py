"""The page of a summary, in a browser: what it shows, filters, keys, text of files, paper."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from browser import PageOpener, wait_until
from page_examples import HOSTILE
from study_outcomes import failure, gap, outcome

from priorfill.study.job import JobOutcome
from priorfill.study.summary.as_page import MAX_MARKERS
from priorfill.study.summary.summarise import StudyContents
from priorfill.study.summary.summary_files import write_summary

EXAMPLE = (
    outcome("P1/good.c3d", gap("C7", 0.3)),
    outcome("P1/lost.c3d", gap("LASI", 2.0, 30.0), gap("C7", 0.1)),
    outcome("P2/left.c3d", gap("C7", 0.5, left=10), gap("LASI", 0.2)),
    outcome("P2/none.c3d", facts={"subjects": [{"subject": "Ben"}]}),
    failure("P2/a.c3d", "/study/in/P2/a.c3d: no markers"),
    failure("P2/b.c3d", "/study/in/P2/b.c3d: no markers"),
    failure("P2/c.c3d", "killed", try_again=True),
)

AUDIT = """() => {
  const canvas = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  const rgba = (text) => {
    canvas.clearRect(0, 0, 1, 1);
    canvas.fillStyle = text;
    canvas.fillRect(0, 0, 1, 1);
    return [...canvas.getImageData(0, 0, 1, 1).data];
  };
  const light = (colour) => {
    const parts = colour.slice(0, 3).map((v) => v / 255)
      .map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
    return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2];
  };
  const ground = (node) => {
    for (let one = node; one; one = one.parentElement) {
      const colour = rgba(getComputedStyle(one).backgroundColor);
      if (colour[3] > 250) return colour;
    }
    return [255, 255, 255];
  };
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  const pale = [];
  while (texts.nextNode()) {
    const node = texts.currentNode.parentElement;
    const hidden = !node.checkVisibility() || node.closest("script, .for-readers, .skip");
    if (hidden || node.disabled || !texts.currentNode.data.trim()) continue;
    const pair = [light(rgba(getComputedStyle(node).color)), light(ground(node))];
    if ((Math.max(...pair) + 0.05) / (Math.min(...pair) + 0.05) < 4.5) pale.push(node.outerHTML);
  }
  const named = (node) => node.textContent.trim() || node.getAttribute("aria-label") ||
    (node.labels && node.labels.length);
  const nameless = [...document.querySelectorAll("button, a, input, canvas[tabindex]")]
    .filter((node) => !named(node)).map((node) => node.outerHTML);
  return [pale, nameless, document.documentElement.scrollWidth > innerWidth];
}"""
"""Text with less contrast than WCAG 2.2, 1.4.3 asks for; controls without a name; too wide."""


def write(outcomes: Sequence[JobOutcome], folder: Path, **contents: Any) -> Path:
    _, files = write_summary(
        outcomes, folder / "summary.html", contents=StudyContents("gait", **contents)
    )
    return files.page


@pytest.fixture
def page(open_page: PageOpener, tmp_path: Path) -> Any:
    return open_page(write(EXAMPLE, tmp_path, waiting=("P3/x.c3d",)))


def rows(page: Any, table: str = "trials") -> list[str]:
    """The first cell of each row in view."""
    return page.locator(f"#{table} tr[data-row] th").all_inner_texts()


def test_what_needs_a_hand_comes_first(page: Any) -> None:
    headline = page.locator("#headline").inner_text()
    assert "8 trials: 2 filled completely, 1 filled in part, 1 without gaps, 3 failed" in headline
    assert "5 need a hand: 3 failed, 1 to record again, 1 to look at." in headline
    assert "1 trial not done yet; the same command goes on" in headline
    needs = page.locator("#attention").inner_text()
    assert "2 trials: P2/a.c3d, P2/b.c3d\n\nno markers" in needs
    assert "killed (the same command tries it again)" in needs
    assert "LASI: frames 101-300 (2.00 s): expected error 30 mm" in needs
    assert "10 samples of C7 stay missing: nothing alike" in needs
    assert [row.split()[0] for row in rows(page)] == [
        "a.c3d", "b.c3d", "c.c3d", "lost.c3d", "left.c3d", "good.c3d", "none.c3d",
    ]  # fmt: skip
    link = page.locator("#trials").get_by_role("link", name="lost.c3d")
    assert link.get_attribute("href").endswith("/study/out/P1/lost.c3d.html")
    assert rows(page, "markers") == ["LASI", "C7"]
    assert rows(page, "folders") == ["P1", "P2"]
    assert rows(page, "subjects") == ["Anna", "Ben"]


def test_tables_sort_and_filter(page: Any) -> None:
    head = page.locator("#trials th[data-key=longest]")
    for order, first in (("descending", "lost"), ("ascending", "good"), ("none", "a.c3d")):
        head.get_by_role("button").click()
        assert head.get_attribute("aria-sort") == order
        assert rows(page)[0].startswith(first)
    page.get_by_label("Filter").fill("lasi p2")
    assert rows(page) == ["left.c3d P2"]
    page.locator("#attention").get_by_role("button", name="lost.c3d").click()  # it is filtered out
    assert len(rows(page)) == 7
    assert page.evaluate("document.activeElement.textContent").startswith("lost.c3d")
    assert "LASI, frames 101–300 (2.00 s), expected 30 mm" in page.locator("#trial").inner_text()
    page.locator("#markers").get_by_text("LASI").click()
    page.locator("#folders").get_by_text("P2", exact=True).click()
    assert rows(page) == ["left.c3d P2"]
    page.get_by_role("button", name="gaps of LASI ×").click()
    page.get_by_role("button", name="folder P2 ×").click()
    page.get_by_role("button", name="Good 2").click()
    assert rows(page) == ["good.c3d P1", "none.c3d P2"]
    page.locator("#subjects").get_by_text("Ben", exact=True).click()
    assert rows(page) == ["none.c3d P2"]


def test_keys_move_in_tables_and_in_the_map(page: Any) -> None:
    page.locator("#trials tr[data-row]").first.focus()
    page.keyboard.press("End")
    page.keyboard.press("ArrowUp")
    assert page.locator("#trial h2").inner_text() == "P1/good.c3d"
    assert page.evaluate("document.activeElement.textContent").startswith("good.c3d")
    page.get_by_label("Map of markers").focus()
    page.keyboard.press("ArrowRight")
    assert page.locator("#announcer").inner_text() == "LASI, P1/lost.c3d: 20 % missing"
    page.keyboard.press("ArrowDown")
    page.keyboard.press("End")
    page.keyboard.press("ArrowLeft")
    assert page.locator("#announcer").inner_text() == (
        "C7, P2/left.c3d: 5.0 % missing, some stay missing"
    )
    page.keyboard.press("Enter")
    assert page.locator("#trial h2").inner_text() == "P2/left.c3d"


def test_everything_has_contrast_and_a_name(page: Any) -> None:
    for width, theme in ((1366, "light"), (390, "dark")):
        page.set_viewport_size({"width": width, "height": 800})
        page.evaluate(f"document.documentElement.dataset.theme = '{theme}'")
        assert page.evaluate(AUDIT) == [[], [], False]


def test_text_of_files_stays_text(open_page: PageOpener, tmp_path: Path) -> None:
    bad = [
        outcome(f"{text[:100]}/javascript:alert({n}).c3d", gap(text, 2.0, 30.0, reason=text),
                warnings=(text,), facts={"notes": [text]})
        for n, text in enumerate(HOSTILE)
    ]  # fmt: skip
    page = open_page(write([*bad, failure("x.c3d", HOSTILE[0])], tmp_path))
    for number in range(len(bad)):
        page.evaluate(f"window.priorfill.store.setActive({number})")
    assert page.locator("img").count() == 0
    assert page.locator("script").count() == 2
    assert HOSTILE[0] in page.locator("#attention").inner_text()
    links = page.evaluate("Array.from(document.links, (link) => link.protocol)")
    assert set(links) == {"file:"}
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_thousands_of_trials_are_rows_in_view_only(open_page: PageOpener, tmp_path: Path) -> None:
    trials = [outcome(f"{n}.c3d", gap("C7", (1 + n % 2) / 10)) for n in range(1500)]
    page = open_page(write(trials, tmp_path))
    assert 10 < len(rows(page)) < 60
    page.locator("#trials tr[data-row]").first.focus()
    page.keyboard.press("End")
    wait_until(page, "document.activeElement.getAttribute('aria-rowindex') === '1501'")
    page.get_by_label("Map of markers").focus()  # of which a column shows two trials
    assert page.locator("#announcer").inner_text() == (
        "C7, 1.c3d: 2.0 % missing (the worst of 2 trials)"
    )


def test_markers_beyond_those_shown_are_counted(open_page: PageOpener, tmp_path: Path) -> None:
    gaps = [gap(f"M{n}", 0.3 if n < MAX_MARKERS else 0.2) for n in range(MAX_MARKERS + 50)]
    page = open_page(write([outcome("a.c3d", *gaps)], tmp_path))
    assert (
        "50 markers with fewer missing frames left out" in page.locator(".panel-map").inner_text()
    )
    assert page.evaluate("window.priorfill.store.data.trials[0].cells.size") == MAX_MARKERS


def test_paper_has_everything_in_light_colours(open_page: PageOpener, tmp_path: Path) -> None:
    trials = [outcome(f"{n}.c3d", gap("C7", 0.3, 20.0)) for n in range(40)]
    page = open_page(write(trials, tmp_path), own=True)  # media stay with the window
    shown = page.locator("#attention li").count()
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    page.emulate_media(media="print")
    assert len(rows(page)) == page.locator("#attention li").count() == 40 > shown
    assert not page.locator("#trial").is_visible()
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    page.emulate_media(media="screen")
    assert page.locator("#attention li").count() == shown


def test_a_study_without_outcomes_is_shown(open_page: PageOpener, tmp_path: Path) -> None:
    page = open_page(write([], tmp_path))
    assert "0 trials: nothing was done." in page.locator("#headline").inner_text()
    assert "There are no trials." in page.locator("#trials").inner_text()
