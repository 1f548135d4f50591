"""The gap table of the page: order, filter, choice, keys, thousands of rows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from browser import PageOpener, wait_until
from page_examples import crowded_data, example_data, write_page

READY = "window.priorfill && window.priorfill.store.decodedFrames === 600"


@pytest.fixture
def page(open_page: PageOpener, tmp_path: Path) -> Any:
    return open_page(write_page(example_data(), tmp_path / "page.html"), ready=READY)


def store(page: Any, expression: str) -> Any:
    return page.evaluate(f"(() => {{ const s = window.priorfill.store; return {expression}; }})()")


def rows(page: Any) -> list[int]:
    return page.evaluate(
        "Array.from(document.querySelectorAll('#gap-table tbody tr[data-gap]'),"
        " (row) => Number(row.dataset.gap))"
    )


def chosen(page: Any) -> list[int]:
    return sorted(store(page, "Array.from(s.chosenGaps)"))


def test_columns_order_and_filter(page: Any) -> None:
    assert rows(page) == [1, 4, 3, 0, 2]  # the worst one first
    first = page.locator("#gap-table tbody tr[data-gap]").first.inner_text().split()
    assert first == [
        "Anna:", "RKNE", "301–360", "0.60", "50", "%", "27", "48", "jump",
        "gpr", "the", "clip", "itself,", "clips", "of", "other", "subjects",
    ]  # fmt: skip
    head = page.locator("#gap-table th[data-key=marker]")
    head.get_by_role("button").click()
    assert rows(page) == [3, 0, 2, 1, 4]
    assert head.get_attribute("aria-sort") == "ascending"
    head.get_by_role("button").click()
    assert head.get_attribute("aria-sort") == "descending"
    assert rows(page) == [4, 1, 2, 0, 3]
    page.locator("#gap-table th[data-key=seconds]").get_by_role("button").click()
    assert rows(page)[0] == 1
    assert head.get_attribute("aria-sort") == "none"
    # equal values: the worst one first
    page.locator("#gap-table th[data-key=method]").get_by_role("button").click()
    assert rows(page) == [1, 4, 3, 0, 2]
    # unknown values come last, whatever the direction
    page.evaluate("window.priorfill.store.data.gaps[0].expected_mean = null")
    for expected in ([1, 4, 3, 2, 0], [2, 3, 4, 1, 0]):
        page.locator("#gap-table th[data-key=mean]").get_by_role("button").click()
        assert rows(page) == expected
    page.evaluate("window.priorfill.store.data.gaps[0].expected_mean = 1.8")
    page.get_by_role("button", name="Worst first").click()
    assert rows(page) == [1, 4, 3, 0, 2]
    assert page.locator("#gap-table td.incomplete").all_inner_texts() == ["50 %"]
    page.get_by_label("Filter").fill("kne ANNA")
    assert rows(page) == [1, 0]
    assert "2 of 5 gaps" in page.locator("#gap-table").inner_text()
    page.keyboard.press("Escape")
    page.get_by_label("Filter").fill("nobody")
    assert "No gap fits the filter." in page.locator("#gap-table").inner_text()
    page.get_by_label("Filter").fill("")
    page.get_by_label("Warnings only").check()
    assert rows(page) == [1, 4]
    page.keyboard.press("n")  # goes through what is listed
    assert store(page, "s.activeGap") == 4
    page.keyboard.press("n")
    assert store(page, "s.activeGap") == 4


def test_clicks_choose(page: Any) -> None:
    row = "#gap-table tbody tr[data-gap='{}']"
    page.locator(row.format(3)).click()
    assert store(page, "[s.activeGap, s.frame, ...s.markers]") == [3, 520, 6]
    assert page.locator(row.format(3)).get_attribute("aria-current") == "true"
    page.get_by_role("checkbox", name="Choose STRN, frames 221–260").check()
    assert chosen(page) == [4] and store(page, "s.activeGap") == 3
    page.locator(row.format(0)).click(modifiers=["Shift"])
    assert chosen(page) == [0, 3, 4]
    selected = page.locator("#gap-table tr[aria-selected=true]")
    assert selected.count() == 3
    assert "3 chosen" in page.locator("#gap-table").inner_text()
    page.get_by_role("button", name="Choose none").click()
    assert chosen(page) == []
    page.get_by_role("button", name="Choose", exact=True).click()
    assert chosen(page) == [0, 2, 3]  # below 10 mm
    page.get_by_label("Filter").fill("Anna")
    page.get_by_role("button", name="Choose", exact=True).click()
    assert chosen(page) == [0, 2]  # of the gaps that are listed
    page.get_by_label("Filter").fill("")
    # neither an unknown error is below the limit, nor that of a gap left missing
    page.evaluate(
        "(() => { const { gaps } = window.priorfill.store.data;"
        " gaps[0].expected_mean = null; gaps[2].filled = 0; })()"
    )
    page.get_by_role("button", name="Choose", exact=True).click()
    assert chosen(page) == [3]
    page.evaluate(
        "(() => { const { gaps } = window.priorfill.store.data;"
        " gaps[0].expected_mean = 1.8; gaps[2].filled = 10; })()"
    )
    page.get_by_label("Expected error in mm").fill("1.9")
    page.keyboard.press("Enter")
    assert chosen(page) == [0, 2]
    page.get_by_label("Choose all gaps shown").check()
    assert chosen(page) == [0, 1, 2, 3, 4]
    page.get_by_label("Choose all gaps shown").uncheck()
    assert chosen(page) == []
    # the table follows the other views
    page.evaluate("window.priorfill.store.setActiveGap(0)")
    assert page.locator("#gap-table tr.active").get_attribute("data-gap") == "0"


def test_keys_move_and_choose(page: Any) -> None:
    assert page.locator("#gap-table tbody tr[tabindex='0']").count() == 1
    page.locator("#gap-table tbody tr[tabindex='0']").focus()
    page.keyboard.press("ArrowDown")
    assert store(page, "s.activeGap") == 4
    assert page.evaluate("document.activeElement.dataset.gap") == "4"
    page.keyboard.press("Space")
    assert chosen(page) == [4] and store(page, "s.playing") is False
    page.keyboard.press("Shift+ArrowDown")
    assert chosen(page) == [3, 4]
    page.keyboard.press("End")
    assert store(page, "s.activeGap") == 2
    page.keyboard.press("Home")
    assert store(page, "s.activeGap") == 1
    assert page.locator("#gap-table tbody tr[tabindex='0']").get_attribute("data-gap") == "1"


def test_many_gaps_have_few_rows(open_page: PageOpener, tmp_path: Path) -> None:
    data = crowded_data(10, 1000, 300)
    page = open_page(write_page(data, tmp_path / "page.html"), ready="window.priorfill")
    assert "300 gaps" in page.locator("#gap-table").inner_text()
    assert len(rows(page)) < 60
    assert page.get_by_role("grid").get_attribute("aria-rowcount") == "301"
    first = rows(page)[0]
    page.locator("#gap-table tbody tr[data-gap]").first.focus()
    page.keyboard.press("End")
    assert page.evaluate("document.activeElement.getAttribute('aria-rowindex')") == "301"
    assert page.locator("#gap-table tr.active").is_visible()
    assert first not in rows(page)
    page.evaluate("document.querySelector('.table-scroller').scrollTop = 0")
    wait_until(page, f"document.querySelector('#gap-table tr[data-gap=\"{first}\"]')")
    page.get_by_label("Choose all gaps shown").check()
    assert store(page, "s.chosenGaps.size") == 300
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert len(rows(page)) == 300
