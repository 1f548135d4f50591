"""A review in the browser: decisions, fills and saved files."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser import PageOpener, wait_until
from reviews import write_walk

import priorfill as pf
from priorfill.reviewing.server import ReviewServer
from priorfill.reviewing.session import ReviewSession

READY = "window.priorfill && window.priorfill.store.decodedFrames === 60"

REFUSED_CONNECTION = "ERR_CONNECTION_REFUSED"
"""What the console shows when the server has gone."""


@pytest.fixture
def server(here: Path) -> Iterator[ReviewServer]:
    """The server of a review of `walk.c3d`, filled by straight lines."""
    session = ReviewSession(write_walk(Path("walk.c3d")), method="linear")
    session.fill([])
    server = ReviewServer(session)
    server.start()
    yield server
    server.stop()


def status(page: Any, text: str) -> None:
    """Wait for a text of the line on fills and saving."""
    page.locator("#review-status", has_text=text).wait_for()


def choose(page: Any, *labels: str) -> None:
    """Check the boxes of the gaps of some markers in the table, and no others."""
    page.evaluate("window.priorfill.store.setChosenGaps([])")
    for label in labels:
        page.locator("#gap-table tbody tr", has_text=label).get_by_role("checkbox").click()


def methods(page: Any) -> dict[str, tuple[str, int]]:
    """Method and filled frames of the gap of each marker."""
    gaps = page.evaluate(
        "(() => { const { data } = window.priorfill.store; return data.gaps.map((gap) =>"
        " [data.markers[gap.marker].label, [gap.method, gap.filled]]); })()"
    )
    return {label: tuple(rest) for label, rest in gaps}


def differing_samples(one: bytes, other: bytes) -> set[tuple[int, int]]:
    """Frames, from 1, and markers of the coordinates in which two C3D files differ."""
    assert len(one) == len(other)
    points, analog = struct.unpack("<HH", one[2:6])
    start = (struct.unpack("<H", one[16:18])[0] - 1) * 512
    frame = 16 * points + 4 * analog
    places = [place for place in range(len(one)) if one[place] != other[place]]
    assert all(place >= start for place in places)
    return {((place - start) // frame + 1, (place - start) % frame // 16) for place in places}


def test_decisions_are_filled_compared_undone_and_saved(
    open_page: PageOpener, server: ReviewServer
) -> None:
    page = open_page(server.address, ready=READY)
    assert page.locator("#fill").is_disabled()
    page.locator("#save").click()
    status(page, "Saved.")
    plain = Path("walk_filled.c3d").read_bytes()

    choose(page, "RANK", "STRN")
    page.locator("#refuse").click()  # two gaps at once
    choose(page, "LKNE")
    page.keyboard.press("f")
    page.get_by_label("Method").select_option("pchip")
    page.keyboard.press("Enter")
    page.get_by_role("button", name="Add re-fill").click()
    assert page.locator("#decision-list .pending").count() == 3
    page.locator("#gap-table tbody tr", has_text="STRN").locator("td").nth(2).click()
    page.get_by_role("button", name="Delete STRN").click()
    page.locator("#fill").click()
    status(page, "Filled.")
    assert page.locator("#decision-list .pending").count() == 0
    assert methods(page) == {"LKNE": ("pchip", 4), "RANK": ("linear", 0), "STRN": ("linear", 5)}
    row = page.locator("#gap-table tbody tr", has_text="LKNE")
    assert "pchip" in row.inner_text()
    target = page.locator("#decision-target").inner_text()
    assert target.startswith("Gap shown: STRN")  # the gap that was shown stays
    page.locator("#before").click()
    assert page.evaluate("window.priorfill.store.ghost") == 1

    page.locator("#save").click()
    status(page, "Saved.")
    paths = page.locator("#saved-paths dd").all_inner_texts()
    assert [Path(path).name for path in paths] == ["walk_filled.c3d", "walk_filled.overrides.toml"]
    clip = pf.read("walk_filled.c3d")
    knee, ankle = (clip.labels.index(label) for label in ("LKNE", "RANK"))
    assert clip.missing[20:30, ankle].all()
    assert clip.missing.sum() == 10
    saved = Path("walk_filled.c3d").read_bytes()
    expected = {(frame, ankle) for frame in range(21, 31)}
    expected |= {(frame, knee) for frame in range(11, 15)}
    assert differing_samples(plain, saved) == expected
    pf.fill_file("walk.c3d", "again.c3d", method="linear", overrides=paths[1])
    assert Path("again.c3d").read_bytes() == saved

    page.keyboard.press("z")  # the deletion
    page.keyboard.press("z")  # the re-fill
    page.keyboard.press("z")  # both refusals
    page.locator("#fill").click()
    status(page, "Filled.")
    page.locator("#save").click()
    status(page, "Saved.")
    assert Path("walk_filled.c3d").read_bytes() == plain


def test_measured_samples_are_exchanged_and_marked_as_wrong(
    open_page: PageOpener, server: ReviewServer
) -> None:
    page = open_page(server.address, ready=READY)
    page.locator("#swap").click()
    page.get_by_label("Marker", exact=True).select_option(label="LANK")
    other = page.get_by_label("and", exact=True)
    other.select_option(other.locator("option", has_text="LHEE").get_attribute("value"))
    page.get_by_label("First frame").fill("50")
    page.get_by_label("Last frame").fill("52")
    page.get_by_role("button", name="Add exchange").click()
    page.locator("#mark-wrong").click()
    page.get_by_label("Marker", exact=True).select_option(label="LELB")
    page.get_by_label("First frame").fill("5")
    page.get_by_label("Last frame").fill("7")
    page.get_by_role("button", name="Add mark").click()
    page.locator("#save").click()  # fills as well
    status(page, "Saved.")
    before, after = pf.read("walk.c3d"), pf.read("walk_filled.c3d")
    ankle, heel, elbow = (before.labels.index(label) for label in ("LANK", "LHEE", "LELB"))
    expected = before.positions.copy()
    expected[49:52, [ankle, heel]] = expected[49:52, [heel, ankle]]
    measured = ~before.missing
    measured[4:7, elbow] = False
    assert (after.positions[measured] == expected[measured]).all()
    assert (after.positions[4:7, elbow] != before.positions[4:7, elbow]).any(axis=1).all()
    assert methods(page)["LELB"] == ("linear", 3)

    both = '[[gap]]\nmarker = "LKNE"\ndo = "pchip"\n[[gap]]\nmarker = "LKNE"\ndo = "leave"\n'
    Path("wrong.toml").write_text(both, encoding="utf-8")
    page.get_by_label("Import decisions").set_input_files("wrong.toml")
    status(page, "Decisions 1 and 2 contradict each other")
    open_page.faults = [one for one in open_page.faults if "400" not in one]
    page.locator("#end-review").click()
    status(page, "Some decisions are not saved")
    server.stop()
    page.locator("#fill").click()
    status(page, "The review server does not answer. Export the decisions")
    with page.expect_download():
        page.get_by_role("button", name="Export decisions").click()
    wait_until(page, "document.getElementById('fill').disabled === false")
    open_page.faults = [one for one in open_page.faults if REFUSED_CONNECTION not in one]
