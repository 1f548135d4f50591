"""Decisions in the page: made, undone, exported, imported."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from browser import PageOpener
from page_examples import example_data, write_page

import priorfill as pf
from priorfill.filling.overrides_file import read_overrides, write_overrides

READY = "window.priorfill && window.priorfill.store.decodedFrames === 600"

HOSTILE = (
    '"; do = "leave" # \\',
    "line\nend\ttab\r\x00\x1b[31m",
    "</script><img src=x onerror=alert(1)>",
    " outer blanks\u00a0",
    "comma,comma",
    "\u202ebidi\u2028é\U0001f600'''",
    "\ufeff*?[a]",
    "",
)
"""Labels as a file can have them, which the data of the page hold besides what is shown."""


def decisions(page: Any) -> list[dict[str, Any]]:
    """The decisions of the page."""
    found: list[dict[str, Any]] = page.evaluate("window.priorfill.store.decisions")
    return found


def rows(page: Any) -> list[tuple[str, str]]:
    """Text and state of each decision in the list."""
    texts, states = (
        page.locator(f"#decision-list {part}").all_inner_texts()
        for part in (".decision-text", ".decision-state")
    )
    return list(zip(texts, states, strict=True))


def leaving_warns(page: Any) -> bool:
    """Whether the browser would ask before the page is left."""
    return bool(
        page.evaluate(
            "(() => { const event = new Event('beforeunload', { cancelable: true });"
            " window.dispatchEvent(event); return event.defaultPrevented; })()"
        )
    )


def choose_gap(page: Any, index: int) -> None:
    """Make a gap the one that is shown."""
    page.evaluate("(index) => window.priorfill.store.setActiveGap(index)", index)


def test_decisions_are_made_by_keys_cut_joined_and_undone(
    open_page: PageOpener, tmp_path: Path
) -> None:
    page = open_page(write_page(example_data(), tmp_path / "page.html"), ready=READY)
    assert not leaving_warns(page)
    choose_gap(page, 0)
    page.keyboard.press("x")
    refused = {"marker": "LKNE", "frames": "201-250", "subject": "Anna", "do": "leave"}
    assert decisions(page) == [refused]
    shown = "Anna: LKNE, frames 201–250 refused: stays missing"
    assert rows(page) == [(shown, "not in this fill")]
    assert leaving_warns(page)

    page.keyboard.press("f")  # the focus is in the menu of methods
    page.keyboard.type("lin")
    page.get_by_label("First frame").fill("211")
    page.get_by_label("Last frame").fill("999")
    page.keyboard.press("Enter")
    assert "from 101 to 700" in page.get_by_role("alert").inner_text()
    page.get_by_label("Last frame").fill("220")
    page.get_by_text("Donor markers", exact=True).click()
    near = page.get_by_role("group", name="donor markers").locator("label").all_inner_texts()
    assert [text.split()[0] for text in near[:2]] == ["RKNE", "LANK"]
    assert len(near) == 5  # those of the other subject are no donors
    page.get_by_role("group", name="donor markers").get_by_label("LTHI").check()
    page.locator("#decision-form summary", has_text="Sources").click()
    page.get_by_label("other recordings of the subject").uncheck()
    page.get_by_text("Options of the method").click()
    page.get_by_label("NAME = VALUE").fill('window = 0.5\ntraining.name = "a b"')
    page.get_by_label("Note", exact=True).fill("try this")
    page.keyboard.press("Enter")
    refill = {
        "marker": "LKNE",
        "frames": "211-220",
        "subject": "Anna",
        "do": "linear",
        "donors": ["LTHI"],
        "sources": ["clip", "database"],
        "options": {"window": 0.5, "training.name": "a b"},
        "note": "try this",
    }
    parts = [{**refused, "frames": "201-210"}, {**refused, "frames": "221-250"}]
    assert decisions(page) == [*parts, refill]
    page.keyboard.press("a")  # the fill by another method is what is accepted
    accepted = {"marker": "LKNE", "subject": "Anna", "do": "accept"}
    kept = [{**accepted, "frames": "201-210"}, {**accepted, "frames": "221-250"}]
    assert decisions(page) == [refill, *kept]
    page.keyboard.press("z")
    page.keyboard.press("z")
    assert decisions(page) == [refused]
    page.keyboard.press("y")
    assert decisions(page) == [*parts, refill]
    assert "Repeated" in page.locator("#announcer").inner_text()
    page.locator("#decision-list li").nth(1).get_by_text("Delete").click()
    assert decisions(page) == [parts[0], refill]
    assert page.locator("#redo").is_disabled()  # another step was made
    choose_gap(page, 3)
    page.locator("#decision-list li").first.locator("button.link").click()
    assert page.evaluate("window.priorfill.store.activeGap") == 0

    page.evaluate("window.priorfill.store.setChosenGaps([0, 1, 3, 4])")
    page.locator("#accept").click()
    assert {(entry["do"], entry.get("subject")) for entry in decisions(page)} == {
        ("linear", "Anna"),
        ("accept", "Anna"),
        ("accept", "Ben"),
    }

    # a form begins with the frames that were dragged, or those in doubt
    page.evaluate("window.priorfill.store.setChosenGaps([])")
    choose_gap(page, 0)
    page.evaluate("window.priorfill.store.setRange([140, 199])")
    page.locator("#refill").click()
    page.get_by_label("Method").select_option("leave")
    page.get_by_role("button", name="Add re-fill").click()
    assert {**refused, "frames": "241-250"} in decisions(page)
    page.evaluate("window.priorfill.store.setRange(null)")
    page.evaluate("window.priorfill.store.setMarkers([2])")
    page.evaluate("window.priorfill.store.setFrame(305)")
    page.locator("#mark-wrong").click()
    assert page.get_by_label("First frame").input_value() == "401"
    assert page.get_by_label("Last frame").input_value() == "420"
    page.keyboard.press("Escape")
    assert page.locator("#decision-form").inner_text() == ""


def hostile_data() -> dict[str, Any]:
    """Data whose markers and subjects have labels of `HOSTILE`."""
    data = example_data(hostile=True)
    for marker, label in zip(data["markers"], HOSTILE, strict=True):
        marker["own_raw"] = label
    data["subjects_raw"] = [HOSTILE[0], HOSTILE[1]]
    data["aliases"] = {"auto": "gpr", "prior": "gpr"}
    data["database_clips"] = ["walk [1]", HOSTILE[2]]
    data["made_for"] = {"file": HOSTILE[1], "sha256": "0" * 64, "method": "gpr", "database": ""}
    return data


def exported(page: Any, path: Path) -> Path:
    """Export the decisions to a file."""
    with page.expect_download() as download:
        page.get_by_role("button", name="Export decisions").click()
    assert download.value.suggested_filename.endswith("_filled.overrides.toml")
    download.value.save_as(path)
    return path


def imported(page: Any, path: Path) -> str:
    """Import a file, and return what the page says."""
    page.evaluate("document.getElementById('decision-file-status').textContent = ''")
    page.get_by_label("Import decisions").set_input_files(path)
    return str(page.locator("#decision-file-status:not(:empty)").inner_text())


def test_exported_decisions_read_alike_in_python_and_in_the_page(
    open_page: PageOpener, tmp_path: Path
) -> None:
    page = open_page(write_page(hostile_data(), tmp_path / "page.html"), ready=READY)
    page.evaluate("window.priorfill.store.setChosenGaps([0, 1, 2, 3, 4])")
    page.locator("#refuse").click()
    choose_gap(page, 3)
    page.evaluate("window.priorfill.store.setChosenGaps([])")
    page.locator("#refill").click()
    page.locator("#decision-form summary", has_text="Donor markers").click()
    page.get_by_role("group", name="donor markers").locator("label").first.click()
    page.locator("#decision-form summary", has_text="Sources").click()
    page.get_by_role("group", name="clips").locator("label").first.click()
    page.get_by_role("group", name="clips").locator("label").last.click()
    page.get_by_label("NAME = VALUE").evaluate("(field, text) => { field.value = text; }", OPTIONS)
    page.get_by_label("Note", exact=True).fill("." * 200 + HOSTILE[2])
    page.get_by_role("button", name="Add re-fill").click()
    page.evaluate("window.priorfill.store.setRange([10, 12])")
    page.locator("#mark-wrong").click()
    page.get_by_role("button", name="Add mark").click()
    page.evaluate("window.priorfill.store.setRange(null)")
    page.evaluate("window.priorfill.store.setMarkers([1])")
    page.locator("#swap").click()
    page.get_by_label("and", exact=True).select_option("4")
    page.get_by_label("First frame").fill("300")
    page.get_by_label("Last frame").fill("400")
    page.get_by_role("button", name="Add exchange").click()

    entries = decisions(page)
    assert [entry["do"] for entry in entries] == ["swap", "missing", *["leave"] * 4, "gpr"]
    assert entries[0]["with"] == HOSTILE[4]
    assert entries[-1]["sources"][-2:] == ["database:walk [[]1]", f"database:{HOSTILE[2]}"]
    assert entries[-1]["options"] == {"a": 1, "b.c": [0.5, 1e-9], "d": True, "e": "x\ny"}
    file = exported(page, tmp_path / "out.toml")
    assert not leaving_warns(page)
    overrides = read_overrides(file)
    assert overrides.to_entries() == entries
    assert overrides.made_for is not None
    assert overrides.made_for.file == HOSTILE[1]
    assert file.read_text(encoding="utf-8").isprintable() is False  # line ends alone
    assert all(line.isprintable() for line in file.read_text(encoding="utf-8").split("\n"))
    text = page.locator("#decision-list").inner_text()
    assert "</script><img src=x" in text
    assert "\u202e" not in text

    page.keyboard.press("z")
    assert decisions(page) != entries
    assert imported(page, file).startswith("7 decisions read from out.toml")
    assert decisions(page) == entries
    again = write_overrides(tmp_path / "again.toml", overrides)
    page.evaluate("window.priorfill.store.setDecisions([])")
    imported(page, again)
    assert decisions(page) == entries


OPTIONS = 'a = 1\nb.c = [0.5, 1e-9]\nd = true\ne = "x\\ny"'
"""Options of a method, as a user writes them into the form."""

GOOD = '[[gap]]\nmarker = "LKNE"\ndo = "leave"\n'
"""A file of one decision."""


def test_files_written_by_hand_are_read_or_refused_with_the_line(
    open_page: PageOpener, tmp_path: Path
) -> None:
    data = example_data()
    data["aliases"] = {"auto": "gpr", "prior": "gpr"}
    data["settings"] = [["frames", "-5:9"], ["markers", "L KNE,$(x)"], ["skip-edges", True]]
    page = open_page(write_page(data, tmp_path / "page.html"), ready=READY)
    file = tmp_path / "hand.toml"
    file.write_bytes(b"\xef\xbb\xbf" + HAND_WRITTEN.replace("\n", "\r\n").encode())
    assert "made for another recording (jump.c3d)" in imported(page, file)
    assert decisions(page) == read_overrides(file).to_entries()
    assert page.locator("#gap-table [data-gap='4']").inner_text().count("✕")

    assert page.get_by_label("Command that repeats them").input_value() == (
        "priorfill fill walk.c3d --frames=-5:9 --markers 'L KNE,$(x)' --skip-edges "
        "-o walk_filled.c3d --overrides walk_filled.overrides.toml"
    )
    before = decisions(page)
    for text, reason in FAULTS:
        file.write_bytes(text if isinstance(text, bytes) else text.encode())
        assert imported(page, file) == f"hand.toml was not imported: {reason}."
        assert decisions(page) == before
        if "101-700" not in reason and "called X" not in reason:  # the page knows the clip
            with pytest.raises(pf.PriorfillError):
                read_overrides(file)


HAND_WRITTEN = """# by hand
[made_for]
file = 'jump.c3d'   # another
sha256 = "1"

[[gap]]
marker = "LKNE, r*"
frames = "150:"
subject = "Anna"
do = "prior"
donors = "LTHI, LANK"
options = { training.max_poses = 0x1F, "x" = [ 1, 2.5e-3,
  1_000, # comment
] }
note = \"\"\"
two
lines \\
   folded\"\"\"

[[gap]]
do = "leave"
frames = 230
marker = ["C7", 'STRN']
"""

FAULTS = (
    ('[[gap]]\nmarker = "X"\ndo = "leave"', "line 1: gap 1: no marker is called X"),
    (
        GOOD + '[[gap]]\nmarker = "C7"\n',
        "line 4: gap 2: do is missing; use one of accept, "
        "leave, missing, swap, auto, gpr, linear, prior",
    ),
    (
        GOOD + "when = 1\n",
        "line 1: gap 1: unknown key when; use marker, frames, subject, do, "
        "with, donors, sources, options, note",
    ),
    (
        GOOD + 'frames = "92_116"',
        'line 1: gap 1: frames "92_116" are no range; write 92-116 or 92:116',
    ),
    (GOOD + "frames = 900", "line 1: gap 1: frame 900 are not all in the clip, which has 101-700"),
    (
        '[[gap]]\nmarker = "LKNE"\ndo = "linear"\nsources = ["x"]',
        "line 1: gap 1: sources are no list of clip, same-subject, database and database:PATTERN",
    ),
    (
        '[[gap]]\nmarker = "LKNE"\ndo = "linear"\ndonors = ["X"]',
        "line 1: gap 1: no marker is called X (donors)",
    ),
    (GOOD + 'note = "a', "line 4: a text has no closing quotes"),
    (GOOD + "note = 2026-01-01", "line 4: a date or time is no value here; write it in quotes"),
    (GOOD + 'do = "leave"', "line 4: do is given twice; remove one"),
    (GOOD + "note", "line 4: no = follows the key; write key = value"),
    (
        GOOD + 'note = "\\q"',
        "line 4: a text holds an unknown escape sequence; write \\\\ for a backslash",
    ),
    (
        GOOD + "options = {a = 1",
        "line 4: a table in { } goes on without a comma or closing } on the same line",
    ),
    (GOOD + "donors = []", "line 1: gap 1: only fills by a method have donors"),
    (
        GOOD + "[gaps]",
        "line 4: unknown or repeated table; write [made_for] once and [[gap]] tables",
    ),
    (GOOD + 'note = "\x01"', "line 4: holds a control character, which TOML does not have"),
    (b"\xff", "is not UTF-8; save it as UTF-8"),
)
"""Contents that are no decisions on this clip, and why."""
