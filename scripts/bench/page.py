#!/usr/bin/env python
"""Size, loading time and drawing speed of report pages in the system's Chromium.

    python scripts/bench/page.py [--pages 41x3000,300x10000] [--markers 41,300,1200]
        [--trials 1000,10000]

Makes pages of synthetic people on treadmills next to each other, with gaps filled linearly, and
opens them offline in Chromium, which draws in software. Prints for each page

* its size (MB), and how many times larger the positions are as JSON;
* seconds from the start of loading to the first picture of the body, and until all frames are
  decoded; decoding alone, and how many times longer the browser parses the positions as JSON;
* frames a second while the page plays;

and for numbers of markers the milliseconds of one picture of the body, and how many times longer
plain code takes for a plainer picture: an object for each point, all sticks and all markers in one
path each; and for summaries of studies with numbers of trials the seconds of CPU to write them, the
size of the page (MB), and the seconds until it is shown and until its filter has answered.
Needs Playwright and Chromium; PRIORFILL_CHROMIUM may name its program.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from large_study import large_study

import priorfill as pf
from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.report.encode import encode_sparse
from priorfill.report.page import page_text
from priorfill.report.report_data import page_data
from priorfill.study.summary.summary_files import write_summary
from priorfill.synthetic import Noise, synthesise

RATE = 100.0
"""Hz"""

APART = 1500.0
"""mm from one person to the next."""

NOISE = 0.02
"""mm, of cameras. It takes most of the size of a page. Second differences are those of an HDM05
recording; those of a CMU recording are as with 0.15 mm."""

BOUND = 20.0
"""mm, 90 % bound of filled samples."""

GAPS_EVERY = 7
"""One of this number of markers has a gap in the middle of the clip."""

MEGABYTES = {(41, 3000): 0.5, (300, 10000): 6.0}
"""Largest size of a page, by markers and frames."""

FIRST_PICTURE = 1.0
"""s, longest time to the first picture."""

PICTURE = 1000 / 60
"""ms, longest time of a picture of at most `SMOOTH` markers: 60 a second."""

SUMMARY_SHOWN = 3.0
"""s, longest time until a summary is shown."""

SMOOTH = 300
"""Markers up to which playing must be smooth."""

DRAWN_FRAMES = 100
"""Frames of the clips whose pictures are timed."""

PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "chrome")
"""Names of Chromium."""

LOADED = """() => {
  const { store, views } = window.priorfill || {};
  if (!store || !views.body.scene) return false;
  window.first = window.first || performance.now();
  return store.decodedFrames === store.frames && [window.first / 1000, performance.now() / 1000];
}"""
"""Seconds to the first picture, and to the end of decoding."""

DECODE = """async () => {
  const { store } = window.priorfill;
  const wait = (start) => new Promise((done) => store.on("decoded", ({ version }) =>
    version === 0 && store.decodedFrames === store.frames && done(performance.now() - start)));
  const start = performance.now();
  const ended = wait(start);
  store.decodedFrames = 0;
  store.decode();
  const coded = await ended;
  const text = JSON.stringify(Array.from(store.positions(0)));
  const again = performance.now();
  JSON.parse(text);
  return [coded / 1000, (performance.now() - again) / 1000, text.length];
}"""
"""Seconds of decoding and of parsing the same positions as JSON, and the characters of that."""

PLAY = """async (seconds) => {
  const { store } = window.priorfill;
  let frames = 0;
  let running = true;
  const count = () => { frames += 1; if (running) requestAnimationFrame(count); };
  const start = performance.now();
  requestAnimationFrame(count);
  store.setPlaying(true);
  await new Promise((done) => setTimeout(done, 1000 * seconds));
  store.setPlaying(false);
  running = false;
  return frames / ((performance.now() - start) / 1000);
}"""
"""Frames a second while the page plays."""

DRAW = """([repeat, pictures]) => {
  const { store, views: { body } } = window.priorfill;
  const context = body.canvas.getContext("2d");
  const copy = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true });
  const finish = () => { copy.drawImage(body.canvas, 0, 0); copy.getImageData(0, 0, 1, 1); };
  const dot = (one, other) => one.reduce((sum, value, i) => sum + value * other[i], 0);
  const plain = (frame) => {
    const { camera } = body;
    const project = (x, y, z) => {
      const at = [x - camera.target[0], y - camera.target[1], z - camera.target[2]];
      const scale = camera.focal / (camera.distance - dot(at, [...camera.back]));
      return { x: camera.width / 2 + dot(at, [...camera.right]) * scale,
        y: camera.height / 2 - dot(at, [...camera.up]) * scale };
    };
    context.fillStyle = "white";
    context.fillRect(0, 0, camera.width, camera.height);
    const points = store.data.markers.map((_, marker) => {
      const from = (frame * store.markerCount + marker) * 3;
      const [x, y, z] = [...store.positions(0).slice(from, from + 3)].map((value) => value / 10);
      return { marker: project(x, y, z), floor: project(x, y, body.scene.floor) };
    });
    for (const layer of ["floor", "marker"]) {
      context.beginPath();
      for (const [a, b] of store.data.sticks) {
        context.moveTo(points[a][layer].x, points[a][layer].y);
        context.lineTo(points[b][layer].x, points[b][layer].y);
      }
      context.strokeStyle = layer === "floor" ? "#ddd" : "#789";
      context.lineCap = "round";
      context.lineWidth = 2.5;
      context.stroke();
    }
    context.beginPath();
    points.forEach(({ marker: { x, y } }, marker) => {
      context.moveTo(x + 4, y);
      context.arc(x, y, store.bound(frame, marker) > 0 ? 10 : 4, 0, 7);
    });
    context.fillStyle = "#357";
    context.fill();
    context.lineCap = "butt";
  };
  const best = (draw) => {
    let least = Infinity;
    for (let round = 0; round < repeat; round++) {
      finish();
      const start = performance.now();
      for (let frame = 0; frame < pictures; frame++) {
        store.frame = frame;
        draw(frame);
      }
      finish();
      least = Math.min(least, (performance.now() - start) / pictures);
    }
    return least;
  };
  return [best(() => body.draw()), best(plain)];
}"""
"""Milliseconds of one picture by the page, and by plain code."""


def people(markers: int, frames: int, noise: float) -> pf.Clip:
    """Return people on treadmills next to each other, with gaps in the middle.

    Each walks as the first one does, at another time, so that nothing is stored twice.

    Parameters
    ----------
    markers : int
        Of all together; the last one may have fewer than the others.
    frames : int
        At `RATE`.
    noise : float
        Of the cameras (mm).
    """
    one = synthesise("walking", seconds=frames / RATE, rate=RATE, noise=Noise(measurement=noise))
    place = one.positions[:frames]
    middle = place.mean(axis=1, keepdims=True)
    middle[..., 2] = 0.0
    on_the_spot = place - np.linspace(middle[0], middle[-1], frames)
    count = -(-markers // len(one.labels))
    columns = max(1, round(count**0.5))
    copies = []
    for number in range(count):
        shift = [APART * (number % columns), APART * (number // columns), 0.0]
        copies.append(np.roll(on_the_spot, number * frames // count, axis=0) + np.array(shift))
    positions = np.concatenate(copies, axis=1)[:, :markers]
    positions[frames // 3 : frames // 3 + frames // 10, ::GAPS_EVERY] = np.nan
    labels = [f"P{number}_{label}" for number in range(count) for label in one.labels]
    return pf.Clip(positions, tuple(labels[:markers]), RATE)


def write_people(folder: Path, markers: int, frames: int, noise: float) -> Path:
    """Write the page of a linear fill, with 90 % bounds of `BOUND`, and return its path."""
    path = folder / f"{markers}x{frames}.html"
    if not path.exists():
        result = pf.fill(people(markers, frames, noise), method="linear")
        bounds = encode_sparse(np.full(result.filled.shape, BOUND), result.filled)
        path.write_text(page_text({**page_data(result), "bound_90": bounds}), encoding="utf-8")
    return path


def find_browser() -> str | None:
    """Return the path of Chromium."""
    return os.environ.get("PRIORFILL_CHROMIUM") or next(
        filter(None, map(shutil.which, PROGRAMS)), None
    )


def open_page(browser: Any, path: Path) -> tuple[Any, float, float]:
    """Open a page; also return the seconds to its first picture and until it is decoded."""
    page = browser.new_context(viewport={"width": 1366, "height": 768}, offline=True).new_page()
    page.goto(path.as_uri(), wait_until="commit")
    first, decoded = page.wait_for_function(LOADED, polling="raf", timeout=300_000).json_value()
    return page, first, decoded


def measure_page(browser: Any, path: Path, size: tuple[int, int], play: float) -> bool:
    """Print a line about a page, and return whether it keeps the bounds."""
    page, first, decoded = open_page(browser, path)
    coded, parsed, characters = page.evaluate(DECODE)
    speed = page.evaluate(PLAY, play)
    page.context.close()
    megabytes = path.stat().st_size / 1e6
    print(
        f"{size[0]:7d} {size[1]:6d} {megabytes:6.2f} {characters / 1e6 / megabytes:6.1f} "
        f"{first:7.2f} {decoded:7.2f} {coded:7.2f} {parsed / coded:6.1f} {speed:8.1f}",
        flush=True,
    )
    return megabytes <= MEGABYTES.get(size, megabytes) and first <= FIRST_PICTURE


def measure_drawing(browser: Any, path: Path, markers: int, repeat: int) -> bool:
    """Print a line about pictures of a number of markers, and return whether they are smooth."""
    page, _, _ = open_page(browser, path)
    drawn, plain = page.evaluate(DRAW, [repeat, min(10, DRAWN_FRAMES)])
    page.context.close()
    print(f"{markers:7d} {drawn:9.2f} {plain / drawn:6.1f} {1000 / drawn:9.0f}", flush=True)
    return drawn <= PICTURE or markers > SMOOTH


SHOWN = "() => window.priorfill && performance.now() / 1000"
"""Seconds until a summary is shown."""

FILTER = """() => {
  const start = performance.now();
  window.priorfill.store.setWords("m05 p1");
  document.body.getBoundingClientRect();
  return (performance.now() - start) / 1000;
}"""
"""Seconds until the table of trials shows those that fit the filter."""


def measure_summary(browser: Any, folder: Path, trials: int) -> bool:
    """Print a line about a summary, and return whether it is shown quickly."""
    outcomes = large_study(trials)
    begin = time.process_time()
    _, files = write_summary(outcomes, folder / f"{trials}.html")
    written = time.process_time() - begin
    page = browser.new_context(viewport={"width": 1366, "height": 768}, offline=True).new_page()
    page.goto(files.page.as_uri(), wait_until="commit")
    shown = page.wait_for_function(SHOWN, polling="raf", timeout=300_000).json_value()
    filtered = page.evaluate(FILTER)
    page.context.close()
    megabytes = files.page.stat().st_size / 1e6
    print(f"{trials:7d} {written:7.2f} {megabytes:6.2f} {shown:7.2f} {filtered:8.2f}", flush=True)
    return bool(shown <= SUMMARY_SHOWN)


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pages", default="41x3000,300x10000", help="markers x frames")
    parser.add_argument("--markers", default="41,300,1200", help="markers of the drawings")
    parser.add_argument("--trials", default="1000,10000", help="trials of the summaries")
    parser.add_argument("--noise", type=float, default=NOISE, help="of the cameras (mm)")
    parser.add_argument("--repeat", type=int, default=10, help="drawings count at their best")
    parser.add_argument("--play", type=float, default=3.0, help="seconds that each page plays")
    arguments = parser.parse_args()
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        print("Playwright is not installed: nothing was measured")
        return 0
    program = find_browser()
    if program is None:
        print("there is no Chromium (PRIORFILL_CHROMIUM may name it): nothing was measured")
        return 0
    kept = True
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=program, args=["--no-sandbox", "--disable-gpu"]
        )
        print("Chromium", browser.version)
        print("markers frames     MB   JSON first s   all s  decode   JSON frames/s")
        for text in arguments.pages.split(","):
            markers, frames = map(int, text.split("x"))
            path = write_people(Path(folder), markers, frames, arguments.noise)
            kept &= measure_page(browser, path, (markers, frames), arguments.play)
        print("markers ms/picture  plain possible/s")
        for markers in map(int, arguments.markers.split(",")):
            path = write_people(Path(folder), markers, DRAWN_FRAMES, arguments.noise)
            kept &= measure_drawing(browser, path, markers, arguments.repeat)
        print("trials write s     MB shown s filter s")
        for trials in map(int, arguments.trials.split(",")):
            kept &= measure_summary(browser, Path(folder), trials)
        browser.close()
    sizes = ", ".join(f"{mb} MB for {m} x {f}" for (m, f), mb in MEGABYTES.items())
    print(
        f"bounds {sizes}, first picture {FIRST_PICTURE} s, {PICTURE:.1f} ms a picture of "
        f"{SMOOTH} markers, a summary {SUMMARY_SHOWN} s: {'kept' if kept else 'EXCEEDED'}"
    )
    return 0 if kept else 1


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
