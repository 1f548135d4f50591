"""The fixture of page tests notes what a page must not do."""

from pathlib import Path

from browser import PageOpener

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
