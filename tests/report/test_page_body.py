"""The body player: what is drawn, and what the mouse, fingers and keys do."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import PageOpener
from page_examples import FIRST_FRAME, example_data, write_page

import priorfill as pf
from priorfill.report.encode import encode_positions, encode_runs
from priorfill.synthetic import synthesise

READY = (
    "window.priorfill && priorfill.store.decodedFrames === priorfill.store.frames"
    " && priorfill.views.body.scene"
)
BODY = "#body .body-stage canvas"

NOWHERE = 350
"""A frame of `player_data` without any marker."""

HIDE_BOUNDS = "(on) => { priorfill.views.body.setLook('bounds', on); }"


def player_data() -> dict[str, Any]:
    """Data of eight markers with a truth 40 mm off the fill, and a frame without a marker."""
    data = example_data()
    for runs in data["states"]["values"]:
        runs[:] = _without(runs, NOWHERE)
    frames, count = data["clip"]["frames"], len(data["markers"])
    time, place = np.arange(frames)[:, None] / 100.0, np.arange(count)
    truth = np.stack(
        [
            200 * np.sin(time + place),
            np.broadcast_to(60.0 * (place % 4), (frames, count)),
            1540 - np.broadcast_to(170.0 * (place // 4 % 9), (frames, count)),
        ],
        axis=-1,
    )
    shown = encode_runs(np.ones((frames, count), dtype=np.int8))
    version = {"name": "truth", "kind": "truth", "positions": encode_positions(truth)}
    data["versions"].append({**version, "shown": shown})
    return data


def _without(runs: list[int], frame: int) -> list[int]:
    """Runs of states of a marker that is measured around a frame, and missing in it."""
    states = np.repeat(runs[::2], runs[1::2])
    states[frame] = 0
    coded: list[int] = encode_runs(states[:, None])["values"][0]
    return coded


def state(page: Any, expression: str) -> Any:
    """Evaluate an expression of `store` and `body` after a drawing."""
    return page.evaluate(
        f"() => {{ const {{ store, views: {{ body }} }} = priorfill; body.draw(); "
        f"return {expression}; }}"
    )


def picture(page: Any) -> str:
    """The picture, as text to compare."""
    text: str = state(page, "body.canvas.toDataURL()")
    return text


def place(page: Any, marker: int) -> tuple[float, float]:
    """Where a marker is on the page (pixels)."""
    box = page.locator(BODY).bounding_box()
    x, y = state(page, f"[...body.drawing.at.slice({marker * 3}, {marker * 3 + 2})]")
    return box["x"] + x, box["y"] + y


def drag(page: Any, dx: float, dy: float, *, button: str = "left") -> None:
    """Drag from the middle of the picture."""
    box = page.locator(BODY).bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] * 0.8
    page.mouse.move(x, y)
    page.mouse.down(button=button)
    page.mouse.move(x + dx, y + dy, steps=3)
    page.mouse.up(button=button)


def test_the_camera_turns_moves_zooms_and_fits(open_page: PageOpener, tmp_path: Path) -> None:
    page = open_page(write_page(player_data(), tmp_path / "page.html"), ready=READY)
    camera = "[body.camera.yaw, body.camera.pitch, body.camera.distance, ...body.camera.target]"
    seen, before = picture(page), state(page, camera)
    drag(page, 60, 20)
    page.wait_for_function("(seen) => priorfill.views.body.canvas.toDataURL() !== seen", arg=seen)
    turned = state(page, camera)
    assert turned[0] == pytest.approx(before[0] - 60 * 0.008, abs=0.1)
    assert turned[1] > before[1]
    assert turned[2:] == pytest.approx(before[2:])

    middle = place(page, 0)
    drag(page, 30, 10, button="right")
    assert state(page, camera)[:3] == pytest.approx(turned[:3])
    assert np.subtract(place(page, 0), middle) == pytest.approx([30, 10], rel=0.4)

    x, y = place(page, 0)
    page.mouse.move(x, y)
    page.mouse.wheel(0, -300)
    assert state(page, "body.camera.distance") < 0.8 * before[2]
    assert place(page, 0) == pytest.approx((x, y), abs=25)  # about the pointer

    page.evaluate("priorfill.store.setFrame(130)")
    page.get_by_role("button", name="Top").click()
    assert state(page, "body.camera.pitch") == pytest.approx(math.pi / 2)
    for name in ("Front", "Side"):
        page.get_by_role("button", name=name, exact=True).click()
        inside = state(page, _INSIDE)
        assert inside == len(player_data()["markers"])


_INSIDE = (
    "[...body.drawing.state].filter((s, i) => { const [x, y] = body.drawing.at.slice(3 * i);"
    " return s && x > 0 && y > 0 && x < body.camera.width && y < body.camera.height; }).length"
)


def test_two_fingers_zoom_and_one_turns(open_page: PageOpener, tmp_path: Path) -> None:
    page = open_page(write_page(player_data(), tmp_path / "page.html"), ready=READY, has_touch=True)
    box = page.locator(BODY).bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    send = page.context.new_cdp_session(page).send

    def touch(kind: str, *points: tuple[float, float]) -> None:
        touched = [{"x": at[0], "y": at[1], "id": number} for number, at in enumerate(points)]
        send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touched})

    distance, yaw = state(page, "[body.camera.distance, body.camera.yaw]")
    touch("touchStart", (x - 40, y), (x + 40, y))
    touch("touchMove", (x - 80, y), (x + 80, y))
    touch("touchEnd")
    assert state(page, "body.camera.distance") == pytest.approx(distance / 2, rel=0.05)
    touch("touchStart", (x, y))
    touch("touchMove", (x + 50, y))
    touch("touchMove", (x + 60, y))
    touch("touchEnd")
    assert state(page, "body.camera.yaw") < yaw - 0.05


def test_a_click_chooses_a_marker_and_its_gap(open_page: PageOpener, tmp_path: Path) -> None:
    page = open_page(write_page(player_data(), tmp_path / "page.html"), ready=READY)
    page.evaluate("priorfill.store.setFrame(130)")
    page.mouse.move(*place(page, 2))
    assert page.locator(".body-tip").inner_text().split("\n")[:2] == ["LANK", "measured"]
    page.mouse.click(*place(page, 2))
    assert state(page, "store.markers") == [2]
    page.mouse.click(*place(page, 7))  # filled
    assert state(page, "[store.markers, store.data.gaps[store.activeGap].marker]") == [[7], 7]
    assert state(page, "store.frame") == 130
    page.keyboard.down("Shift")
    page.mouse.click(*place(page, 2))
    page.keyboard.up("Shift")
    assert state(page, "store.markers") == [7, 2]

    page.evaluate("priorfill.store.setFrame(240)")
    assert "1 missing: RKNE" in page.locator("#body-status").inner_text()
    page.locator("#body-status").get_by_role("button", name="RKNE").click()
    assert state(page, "store.data.gaps[store.activeGap].marker") == 1
    page.evaluate(f"priorfill.store.setFrame({NOWHERE})")
    assert page.locator("#body-status").inner_text().startswith("No marker is visible; 8 missing")


def test_bounds_surround_filled_markers_in_true_size(open_page: PageOpener, tmp_path: Path) -> None:
    page = open_page(write_page(player_data(), tmp_path / "page.html"), ready=READY)
    page.evaluate(
        "() => { const { store, views: { body } } = priorfill; store.setMarkers([]);"
        " body.setLook('trail', 0); store.setFrame(130); body.view('front'); }"
    )
    pixels = (
        "(() => { const { width, height } = body.canvas, r = width / body.camera.width;"
        " const copy = new OffscreenCanvas(width, height)"
        ".getContext('2d', { willReadFrequently: true }); copy.drawImage(body.canvas, 0, 0);"
        " const { data } = copy.getImageData(0, 0, width, height);"
        " const of = (m, mm) => { const [x, y, d] = body.drawing.at.slice(3 * m);"
        " const across = Math.round((x + body.camera.pixels(mm, d)) * r);"
        " return data[4 * (Math.round(y * r) * width + across) + 2]; };"
        " return [of(7, 16), of(7, 23), of(3, 16), of(2, 16)]; })()"
    )
    page.evaluate(HIDE_BOUNDS, True)
    shown = state(page, pixels)
    page.evaluate(HIDE_BOUNDS, False)
    hidden = state(page, pixels)
    changed = [one != other for one, other in zip(shown, hidden, strict=True)]
    assert changed == [True, False, False, False]  # the bound is 19.2 mm


def test_the_ghost_of_the_truth_and_the_distance_to_it(
    open_page: PageOpener, tmp_path: Path
) -> None:
    page = open_page(write_page(player_data(), tmp_path / "page.html"), ready=READY)
    page.evaluate("priorfill.store.setFrame(130)")
    page.mouse.move(0, 0)
    alone = picture(page)
    page.locator("#ghost").select_option("Truth")
    assert picture(page) != alone
    assert state(page, "store.ghost") == 1
    page.mouse.move(*place(page, 7))
    assert page.locator(".body-tip").inner_text().split("\n") == [
        "STRN",
        "filled",
        "expected rms error 12 mm",
        "90 % bound 19 mm",
        "40 mm from truth",
    ]
    page.evaluate("priorfill.store.setGhost(-1)")
    page.mouse.move(0, 0)
    assert picture(page) == alone


def test_labels_trails_and_following(open_page: PageOpener, tmp_path: Path) -> None:
    page = open_page(write_page(player_data(), tmp_path / "page.html"), ready=READY)
    pictures = {picture(page)}
    for control, option in (("#labels", "All"), ("#trail", "± 2 s"), ("#labels", "None")):
        page.locator(control).select_option(option)
        pictures.add(picture(page))
    assert len(pictures) == 4

    page.evaluate("priorfill.store.setFrame(0)")
    still = state(page, "[...body.camera.target]")
    page.get_by_role("button", name="Follow").click()
    assert state(page, "[...body.camera.target]") == pytest.approx(still)
    page.evaluate("priorfill.store.setFrame(150)")
    moved = state(page, "[...body.camera.target]")
    centre = np.sin(np.arange(8) + np.array([[0.0], [1.5]]))  # of all markers, in x
    assert moved[0] - still[0] == pytest.approx(200 * np.diff(np.median(centre, axis=1))[0], abs=60)
    page.get_by_role("button", name="Follow").click()
    page.evaluate("priorfill.store.setFrame(0)")
    assert state(page, "[...body.camera.target]") == pytest.approx(moved)


def test_playing_takes_the_time_of_the_clip(open_page: PageOpener, tmp_path: Path) -> None:
    page = open_page(write_page(player_data(), tmp_path / "page.html"), ready=READY)
    played = (
        "async (seconds) => { const { store } = priorfill; const start = performance.now();"
        " const first = store.frame; store.setPlaying(true);"
        " await new Promise((done) => setTimeout(done, 1000 * seconds)); store.setPlaying(false);"
        " return (store.frame - first) / ((performance.now() - start) / 10); }"
    )
    page.evaluate("priorfill.store.setFrame(0)")
    assert page.evaluate(played, 0.35) == pytest.approx(1, abs=0.4)
    page.locator("#speed").select_option("0.25 ×")
    assert page.evaluate(played, 0.35) == pytest.approx(0.25, abs=0.15)

    page.evaluate("priorfill.store.setActiveGap(2)")  # frames 50 to 59
    page.locator("#loop").select_option("Gap")
    page.locator("#speed").select_option("4 ×")
    for _ in range(2):
        page.evaluate(played, 0.15)
        assert 10 <= state(page, "store.frame") < 100

    page.locator("#frame").fill(str(FIRST_FRAME + 42))
    page.keyboard.press("Enter")
    assert state(page, "store.frame") == 42
    assert page.locator("#time").inner_text() == "0.42 / 5.99 s"
    page.locator("#scrub").fill("300")
    assert page.locator("#frame").input_value() == str(FIRST_FRAME + 300)


def test_keys_alone_turn_zoom_and_choose(open_page: PageOpener, tmp_path: Path) -> None:
    page = open_page(write_page(player_data(), tmp_path / "page.html"), ready=READY)
    page.locator(BODY).focus()
    camera = "[body.camera.yaw, body.camera.pitch, body.camera.distance]"
    frame, (yaw, pitch, distance) = state(page, f"[store.frame, {camera}]")
    for key in ("ArrowLeft", "ArrowUp", "+"):
        page.keyboard.press(key)
    now = state(page, camera)
    assert now[0] < yaw and now[1] > pitch and now[2] < distance
    assert state(page, "store.frame") == frame
    page.keyboard.press("0")
    page.keyboard.press("3")
    assert state(page, "body.camera.pitch") == pytest.approx(math.pi / 2)
    first = state(page, "store.markers")[0]
    page.keyboard.press("m")
    assert state(page, "store.markers") == [(first + 1) % 8]
    assert not state(page, "body.look.follow")
    page.keyboard.press("c")
    assert state(page, "body.look.follow")
    page.keyboard.press("Space")
    assert state(page, "store.playing")


@pytest.mark.parametrize("scale", [0.05, 12.0])
def test_a_body_of_any_size_is_fitted_upright(
    open_page: PageOpener, tmp_path: Path, scale: float
) -> None:
    upright = synthesise("walking", seconds=1.0, rate=30.0)
    positions = upright.positions[..., [1, 2, 0]] * scale  # +Y up
    positions[:, 7] += 10_000 * scale  # wrongly labelled throughout
    positions[10:20, 0] = np.nan
    clip = replace(upright, positions=positions, up="+Y")
    pf.write_report(tmp_path / "page.html", pf.fill(clip, method="linear"))
    page = open_page(tmp_path / "page.html", ready=READY)
    head, toe = clip.labels.index("RFHD"), clip.labels.index("RTOE")
    heights = state(page, "[...body.drawing.at].filter((_, i) => i % 3 === 1)")
    height = state(page, "body.camera.height")
    assert heights[head] < heights[toe] - 0.4 * height
    seen = [y for marker, y in enumerate(heights) if marker != 7]
    assert min(seen) > 0 and max(seen) < height
    facing = state(page, "body.scene.facing(store.frame)")
    across = np.subtract(*(clip.positions[15, clip.labels.index(m)] for m in ("LSHO", "RSHO")))
    left = np.array([across[0], -across[2]])  # upright x and y
    assert np.dot([math.cos(facing), math.sin(facing)], left / np.linalg.norm(left)) == (
        pytest.approx(0, abs=0.3)
    )


def test_a_clip_of_one_frame_and_one_marker(open_page: PageOpener, tmp_path: Path) -> None:
    clip = pf.Clip(np.full((1, 1, 3), 7.0), ("M1",), 100.0)
    pf.write_report(tmp_path / "page.html", pf.fill(clip, method="linear"))
    page = open_page(tmp_path / "page.html", ready=READY)
    assert page.locator("#play").is_disabled()
    assert page.locator("#body-status").inner_text() == "1 measured"
    assert state(page, _INSIDE) == 1
