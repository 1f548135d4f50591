"""Functions and classes of the page's scripts by themselves: requests, decisions, drawing."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser import PageOpener
from page_examples import example_data

import priorfill.report
from priorfill.filling.overrides_file import MAX_BYTES

FOLDER = Path(priorfill.report.__file__).parent / "page"

START = ("loader.js", "main.js")
"""Scripts that do something when they are loaded."""

SERVER = """
async ({ run, status, lines, size }) => {
  const sent = [];
  window.fetch = async (url, { method, body, signal }) => {
    sent.push([url, method, JSON.parse(body)]);
    if (url.endsWith("/cancel")) return new Response("{}");
    if (status === 0) throw new TypeError("no network");
    const bytes = new TextEncoder().encode(lines);
    const stream = new ReadableStream({
      start(controller) {
        signal?.addEventListener("abort", () => controller.error(signal.reason));
        for (let at = 0; at < bytes.length; at += size) {
          controller.enqueue(bytes.slice(at, at + size));
        }
        if (status !== -1) controller.close();
      },
    });
    return new Response(stream, { status: status < 0 ? 200 : status });
  };
  const link = new ServerLink("http://127.0.0.1:1/token?a#b");
  const progress = [];
  const answers = [];
  const soon = (one) => Promise.race([one, new Promise((done) => setTimeout(done, 5000))]);
  const note = (promise) => promise.then((value) => answers.push(value),
    (error) => answers.push(`${error.constructor.name}: ${error.message}`));
  await link.cancel();
  const filling = note(link.run(run, [{ do: "leave" }], (...done) => progress.push(done)));
  if (status === -1) {
    await soon(note(link.run("fill", [], () => {})));
    answers.push(link.busy);
    while (progress.length === 0) await new Promise((done) => setTimeout(done, 1));
    await link.cancel();
  }
  await soon(filling);
  return { sent, progress, answers, busy: link.busy };
}
"""
"""A request to a server whose answer comes in pieces of some bytes; status 0 is no network, and -1
an answer without an end, which is stopped."""


@pytest.fixture(scope="module")
def blank(browser: Any) -> Iterator[Any]:
    """An empty page with the scripts."""
    opener = PageOpener(browser)
    page = opener("about:blank")
    names = sorted(path.name for path in FOLDER.glob("*.js") if path.name not in START)
    first = ["dom.js", "decode.js", "store.js"]
    scripts = [(FOLDER / name).read_text("utf-8") for name in dict.fromkeys([*first, *names])]
    page.add_script_tag(content="\n".join(scripts))
    yield page
    opener.close()
    opener.expect_no_faults()


LOST = "ServerError: The review server does not answer. Export the decisions, and start "
LOST += "priorfill review again with --overrides"


def test_answers_of_the_server_are_read_as_they_come(blank: Any) -> None:
    def ask(lines: str, status: int = 200, run: str = "fill", size: int = 1) -> dict[str, Any]:
        asked = {"run": run, "status": status, "lines": lines, "size": size}
        found: dict[str, Any] = blank.evaluate(SERVER, asked)
        return found

    # pieces of one byte part letters of several
    text = '{"done":1,"total":2}\n\n{"done":2,"total":2}\n{"data":"Übung 漢 𝄞"}'
    for size in (1, 3, 1000):
        found = ask(text, size=size)
        assert found["sent"] == [["http://127.0.0.1:1/token/fill", "POST",
                                  {"decisions": [{"do": "leave"}]}]]  # fmt: skip
        assert found["progress"] == [[1, 2], [2, 2]]
        assert found["answers"] == [{"data": "Übung 漢 𝄞"}]
        assert not found["busy"]
    assert ask('{"saved":1}\n', run="save")["answers"] == [{"saved": 1}]
    for run, lines in (("save", '{"data":1}'), ("fill", '{"saved":1}'), ("fill", "")):
        (answer,) = ask(lines, run=run)["answers"]
        assert answer.startswith(f"ServerError: The review server stopped during the {run}.")
    assert ask('{"error":"a\\nb"}\n{"data":1}')["answers"] == ["ServerError: a\\nb"]
    for status, lines, answer in (
        (400, '{"error":"gap 1: wrong"}', "ServerError: gap 1: wrong"),
        (403, "", LOST),
        (404, "<html>", LOST),
        (409, "", "ServerError: Another fill is running; wait for it, or stop it"),
        (413, "{}", "ServerError: The decisions are too long for the review server"),
        (500, "", "ServerError: The review server refused the request (status 500)"),
        (0, "", LOST),
        (200, "no JSON", LOST),
    ):
        found = ask(lines, status)
        assert (found["answers"], found["busy"]) == ([answer], False)


def test_a_fill_is_stopped(blank: Any) -> None:
    asked = {"run": "fill", "status": -1, "lines": '{"done":0,"total":2}\n', "size": 100}
    found = blank.evaluate(SERVER, asked)
    assert found["answers"] == [
        "ServerError: A fill is running; wait for it, or stop it", True, None
    ]  # fmt: skip
    assert [url.rpartition("/")[2] for url, *_ in found["sent"]] == ["fill", "cancel"]
    assert not found["busy"]


ADD = """
({ data, entries, added }) => {
  const list = new DecisionList(data, entries);
  for (const entry of added) list.add([entry], "test");
  return list.entries;
}
"""


def test_what_is_left_of_a_decision_that_another_cuts(blank: Any) -> None:
    data = example_data()
    base = data["clip"]["first_frame"]
    whole = {"marker": ["LKNE", "RANK"], "subject": "Anna", "do": "linear", "note": "n"}
    part = {"marker": "LKNE", "frames": f"{base + 110}-{base + 119}", "do": "leave"}

    def left(*added: dict[str, Any], old: dict[str, Any] = whole) -> list[dict[str, Any]]:
        found = blank.evaluate(ADD, {"data": data, "entries": [old], "added": list(added)})
        return [one for one in found if one not in added]

    # LKNE has a gap before frame 110, and one after 119; RANK is not cut
    cut = {**whole, "marker": "LKNE"}
    assert left(part | {"subject": "Anna"}) == [
        {**whole, "marker": "RANK"},
        {**cut, "frames": f"{base}-{base + 109}"},
        {**cut, "frames": f"{base + 120}-{base + 599}"},
    ]
    # nothing to decide before the gap, or after it
    frames = {"frames": f"{base + 100}-{base + 119}", "subject": "Anna"}
    rest = {**cut, "frames": f"{base + 120}-{base + 599}"}
    assert left(part | frames) == [{**whole, "marker": "RANK"}, rest]
    frames["frames"] = f"{base + 110}-{base + 149}"
    rest = {**cut, "frames": f"{base}-{base + 109}"}
    assert left(part | frames) == [{**whole, "marker": "RANK"}, rest]
    # next to each other
    first = {**cut, "frames": f"{base + 100}-{base + 109}"}
    assert left(part | {"subject": "Anna"}, old=first) == [first]
    # a mark of measured samples leaves the fill of others as it is
    assert left(part | {"subject": "Anna", "do": "missing"}) == [whole]
    # marks of measured samples stay wherever they are
    wrong = {"marker": "LKNE", "frames": f"{base}-{base + 9}", "subject": "Anna", "do": "missing"}
    leave = wrong | {"frames": base + 3, "do": "leave"}
    assert left(leave, old=wrong) == [
        wrong | {"frames": f"{base}-{base + 2}"},
        wrong | {"frames": f"{base + 4}-{base + 9}"},
    ]


SHOWN = """
(data) => {
  const store = new Store(data);
  const at = (...place) => store.shown(...place);
  const before = at(0, 0, 0);
  store.decoded = [1, 1, 1];
  store.decodedFrames = 240;
  store.present = [null, null, new Uint8Array(store.frames * store.markerCount)];
  store.present[2][3 * store.frames + 7] = 1;
  return [before, at(0, 239, 1), at(0, 229, 1), at(0, 240, 0), at(1, 599, 1), at(2, 7, 3),
    at(2, 3, 7), at(3, 0, 0)];
}
"""


def test_which_samples_of_a_version_are_shown(blank: Any) -> None:
    found = blank.evaluate(SHOWN, example_data())
    # not decoded; missing; filled; not decoded yet; all of a version; only where it has a sample
    assert found == [False, False, True, False, True, True, False, False]


DRAWN = """
(data) => {
  const calls = [];
  const context = new Proxy({ calls }, {
    get: (target, name) => (name in target ? target[name] :
      (...values) => (name === "measureText" ? { width: 10 } : calls.push([name, ...values]))),
  });
  const store = new Store(data);
  colours = () => ({});
  const lines = () => calls.filter(([name]) => name === "setLineDash" || name === "lineTo");
  const drawing = Object.create(BodyDrawing.prototype);
  Object.assign(drawing, {
    store, count: 3, sticks: [0, 1, 1, 2], stickLevel: [0, 0], subject: [0, 0, 0],
    state: [STATE.filled, STATE.measured, STATE.measured],
    at: [0, 0, 1, 10, 0, 1, 20, 0, 1],
    camera: { width: 400, height: 200, pixels: (mm) => mm },
  });
  drawing.drawSticks(context);
  const sticks = lines().map(([, value]) => value);
  const bounds = [10, 24, 25].map((bound) => {
    calls.length = 0;
    store.bound = () => bound;
    paintHalo = () => calls.push(["halo"]);
    drawing.drawBounds(context, 0, {});
    return calls.map(([name]) => name).filter((name) => name === "halo" || name === "stroke");
  });
  calls.length = 0;
  const box = { left: 100, top: 0, width: 600, height: 30, from: 0, to: 600 };
  paintAxis(context, store, box);
  const texts = calls.filter(([name]) => name === "fillText").map(([, text]) => text);
  return { sticks, bounds, texts };
}
"""


def test_what_is_drawn_of_fills_and_times(blank: Any) -> None:
    found = blank.evaluate(DRAWN, example_data())
    # the first stick ends at a filled marker
    assert found["sticks"] == [[5, 3], 10, [], 20]
    # bounds of more than 12 % of the picture's height are lines
    assert found["bounds"] == [["halo"], ["halo"], ["stroke"]]
    assert found["texts"][:6] == ["time (s)", "frame", "0", "101", "1", "201"]


IMPORTED = """
async ({ data, size }) => {
  const store = new Store(data);
  const taken = [];
  const files = new DecisionFiles(store, { take: (entries) => taken.push(entries) });
  const text = '[[gap]]\\nmarker = "LKNE"\\nsubject = "Anna"\\ndo = "leave"\\n#';
  const transfer = new DataTransfer();
  transfer.items.add(new File([text.padEnd(size, "x")], "d.toml"));
  files.input.files = transfer.files;
  await files.read();
  return [taken.length, files.status.textContent, files.input.value];
}
"""


def test_how_long_an_imported_file_may_be(blank: Any) -> None:
    def imported(size: int) -> list[Any]:
        found: list[Any] = blank.evaluate(IMPORTED, {"data": example_data(), "size": size})
        return found

    assert imported(MAX_BYTES) == [1, "1 decision read from d.toml in place of the list.", ""]
    reason = "d.toml was not imported: has more than 4096 KiB."
    assert imported(MAX_BYTES + 1) == [0, reason, ""]


REVIEWED = """
async ({ data, unsaved }) => {
  const sent = [];
  let done;
  window.fetch = async (url) => {
    const action = url.split("/").pop();
    sent.push(action);
    if (action !== "fill") return new Response("{}");
    return new Promise((resolve) => {
      done = () => resolve(new Response('{"error":"no"}'));
    });
  };
  const review = new DecisionReview(new Store({ ...data, can: { refill: true, save: true } }),
    { entries: () => [], unsaved: () => unsaved });
  const states = [];
  const note = () => states.push([
    ...[review.fillButton, review.saveButton, review.closeButton].map((one) => one.disabled),
    ...[review.stopButton, review.bar, review.closeButton].map((one) => one.hidden),
    review.status.textContent,
  ]);
  review.show(true);
  note();
  const running = review.run("fill");
  note();
  review.show(true);  // a decision is made
  review.closeButton.click();
  await review.run("save");
  note();
  done();
  await running;
  note();
  await review.end();
  note();
  review.show(true);
  await review.end();
  note();
  await review.end();
  note();
  return { sent, states };
}
"""
"""A review that fills, during which everything but stopping waits, and that ends."""


def test_a_review_ends_after_the_fill_and_what_is_not_saved_holds_it(blank: Any) -> None:
    fills, waits = [False] * 3 + [True, True, False], [True] * 3 + [False] * 3
    pending = "Some decisions need a fill."
    unsaved = "Some decisions are not saved. End review once more ends without them."
    ended = [*fills[:5], True, "The review has ended; this page can be closed."]
    found = blank.evaluate(REVIEWED, {"data": example_data(), "unsaved": True})
    assert found["states"] == [
        [*fills, pending],
        [*waits, "Filling …"],
        [*waits, "Filling …"],
        [*fills, "No."],
        [*fills, unsaved],
        [*fills, unsaved],  # the decisions are others than those of the first click
        ended,
    ]
    assert found["sent"] == ["fill", "close"]
    found = blank.evaluate(REVIEWED, {"data": example_data(), "unsaved": False})
    assert found["states"][4] == ended
