"""The fixture of page tests notes what a page must not do."""

from pathlib import Path
from typing import Any

import pytest
from browser import LAPTOP, PageOpener

BAD = """<!doctype html><title>page</title><script>
console.log("text"); fetch("http://127.0.0.1:9/").catch(() => {}); window.done = true; missing();
</script>"""


def test_faults_of_a_page_are_noted(open_page: PageOpener, tmp_path: Path) -> None:
    file = tmp_path / "page.html"
    file.write_text(BAD, encoding="utf-8")
    page = open_page(file, ready="window.done")
    assert page.title() == "page"
    page.wait_for_timeout(100)
    kinds = {fault.partition(":")[0] for fault in open_page.faults}
    assert kinds == {"console", "error", "request"}
    open_page.faults.clear()


def test_a_kept_page_begins_anew(browser: Any, tmp_path: Path) -> None:
    file = tmp_path / "page.html"
    file.write_text("<!doctype html><title>page</title>", encoding="utf-8")
    kept: list[Any] = []
    first, second = PageOpener(browser, kept), PageOpener(browser, kept)
    one = first(file)
    other = first(file)
    one.evaluate("window.left = addEventListener('beforeunload', (e) => e.preventDefault()) || 1")
    one.set_viewport_size({"width": 400, "height": 300})
    one.keyboard.down("Shift")
    first.close()
    again = second(file)
    assert again is one is not other
    assert other.is_closed()
    assert again.evaluate("[typeof left, innerWidth, innerHeight]") == ["undefined", *LAPTOP]
    again.evaluate("() => { onkeydown = (event) => { window.shifted = event.shiftKey; }; }")
    again.keyboard.press("a")
    assert again.evaluate("shifted") is False
    again.evaluate("console.log('text')")
    assert (first.faults, second.faults) == ([], ["console: text"])
    second.close()
    kept[0].context.close()
    third = PageOpener(browser, kept)
    with pytest.raises(Exception, match="closed"):
        third(file)
    third.close()  # which forgets the page
    assert kept == []
