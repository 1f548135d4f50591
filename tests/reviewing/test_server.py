"""The server of a review: what it answers, streams and refuses."""

from __future__ import annotations

import json
import logging
import re
import socket
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from reviews import ReviewClient, write_walk

import priorfill as pf
from priorfill.errors import OutputError
from priorfill.reviewing import guard
from priorfill.reviewing.security import MAX_BODY
from priorfill.reviewing.server import ReviewServer
from priorfill.reviewing.session import ReviewSession

REFUSED = {"marker": "RANK", "do": "leave"}


@pytest.fixture(scope="module")
def served(in_memory: Path) -> Iterator[tuple[ReviewServer, ReviewClient]]:
    """A server with a small recording; tests of the module share it."""
    session = ReviewSession(write_walk(in_memory / "walk.c3d"), method="linear")
    session.fill([])
    server = ReviewServer(session)
    server.start()
    yield server, ReviewClient.of(server.address)
    server.stop()


@pytest.fixture
def client(served: tuple[ReviewServer, ReviewClient]) -> ReviewClient:
    return served[1]


@dataclass
class SlowFill:
    """A fill that takes until it may end; each step reports progress."""

    begun: threading.Event = field(default_factory=threading.Event)
    may_end: threading.Event = field(default_factory=threading.Event)

    def fill(self, decisions: Any, progress: Any, checkpoint: Any) -> dict[str, Any]:
        """Take the place of `ReviewSession.fill`."""
        for step in range(1, 600):
            progress(step, 600)
            self.begun.set()
            if self.may_end.wait(0.05):
                return {"title": "slow"}
        raise AssertionError("nobody stopped the fill")


@pytest.fixture
def slow(served: tuple[ReviewServer, ReviewClient], monkeypatch: pytest.MonkeyPatch) -> SlowFill:
    """The fills of the server."""
    fills = SlowFill()
    monkeypatch.setattr(served[0].session, "fill", fills.fill)
    return fills


def test_the_page_and_its_headers(client: ReviewClient) -> None:
    answer = client.get()
    assert answer.status == 200
    headers = dict(answer.headers)
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "connect-src 'self'" in policy
    assert "frame-ancestors 'none'" in policy
    assert "unsafe" not in policy
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cache-control"] == "no-store"
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["x-frame-options"] == "DENY"
    assert headers["cross-origin-opener-policy"] == "same-origin"
    assert headers["cross-origin-resource-policy"] == "same-origin"
    assert headers["content-type"] == "text/html; charset=utf-8"
    assert "server" not in headers
    found = re.search(rb'id="priorfill-data">(.*?)</script>', answer.body, re.DOTALL)
    assert found is not None
    assert json.loads(found[1])["mode"] == "review"


def test_decisions_are_checked_filled_and_saved(
    served: tuple[ReviewServer, ReviewClient], client: ReviewClient
) -> None:
    session = served[0].session
    assert client.post("check", {"decisions": [REFUSED]}).lines == [{"ok": True}]
    answer = client.post("fill", {"decisions": [REFUSED]})
    assert answer.status == 200
    assert dict(answer.headers)["content-type"].startswith("application/x-ndjson")
    *steps, last = answer.lines
    assert steps
    assert all(set(step) == {"done", "total"} for step in steps)
    assert last["data"]["decisions"] == [REFUSED]
    page = client.get().body
    assert b'"decisions":[{"marker":"RANK","do":"leave"}]' in page
    saved = client.post("save", {"decisions": [REFUSED]}).lines[-1]
    assert saved["saved"] == {
        "output": str(session.output),
        "overrides": str(session.overrides),
    }
    assert saved["data"]["decisions"] == [REFUSED]
    assert pf.read(session.output).missing.sum() == 10


def test_an_error_is_one_line_and_the_review_goes_on(
    served: tuple[ReviewServer, ReviewClient], client: ReviewClient
) -> None:
    for name in ("check", "fill", "save"):
        answer = client.post(name, {"decisions": [{"marker": "NOPE", "do": "leave"}]})
        assert answer.status == 400
        assert answer.error.startswith("decision 1: no marker of walk is called 'NOPE'")
    output = served[0].session.output
    client.post("save", {"decisions": []})
    saved = output.read_bytes()
    output.write_bytes(b"somebody else's")
    answer = client.post("save", {"decisions": [REFUSED]})
    assert answer.lines[-1]["error"].startswith(f"{output}: was changed after it was saved")
    assert output.read_bytes() == b"somebody else's"
    output.write_bytes(saved)
    output.unlink()
    assert "saved" in client.post("save", {"decisions": []}).lines[-1]


def test_bugs_are_lines_too(
    served: tuple[ReviewServer, ReviewClient], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: Any) -> None:
        raise ZeroDivisionError("0 of 0")

    monkeypatch.setattr(served[0].session, "fill", broken)
    answer = served[1].post("fill", {"decisions": []})
    assert answer.lines == [
        {"error": "bug in priorfill (ZeroDivisionError: 0 of 0); please report it"}
    ]
    monkeypatch.setattr(served[0].session, "check", broken)
    answer = served[1].post("check", {"decisions": []})
    assert (answer.status, answer.error[:17]) == (500, "bug in priorfill ")


def test_one_fill_at_a_time_which_can_be_stopped(client: ReviewClient, slow: SlowFill) -> None:
    lines: list[dict[str, Any]] = []
    first = threading.Thread(
        target=lambda: lines.extend(client.post("fill", {"decisions": []}).lines)
    )
    first.start()
    assert slow.begun.wait(30)
    answer = client.post("save", {"decisions": []})
    assert answer.status == 409
    assert answer.error == "a fill is running; wait for it, or stop it"
    assert client.get().status == 200
    assert client.post("cancel", {}).lines == [{"ok": True}]
    first.join(30)
    assert lines[-1] == {"error": "the fill was stopped"}
    slow.may_end.set()
    assert client.post("fill", {"decisions": []}).lines[-1] == {"data": {"title": "slow"}}


def test_a_page_that_leaves_stops_its_fill(client: ReviewClient, slow: SlowFill) -> None:
    body = b'{"decisions": []}'
    with socket.create_connection(("127.0.0.1", client.port), timeout=30) as connection:
        connection.sendall(
            f"POST /{client.token}/fill HTTP/1.1\r\nHost: 127.0.0.1:{client.port}\r\n"
            "Content-Type: application/json\r\n"
            f"Content-Length: {len(body)}\r\n\r\n".encode()
            + body
        )
        received = b""
        while b'"done"' not in received:
            received += connection.recv(1000)
    # the next request waits until the fill that was left has stopped
    waiting = threading.Timer(0.3, slow.may_end.set)
    waiting.start()
    assert client.post("fill", {"decisions": []}).lines[-1] == {"data": {"title": "slow"}}
    waiting.join()


@pytest.mark.parametrize("body", [b"", b"{", b"[]", b"{}", b'{"decisions": 1}', b"[" * 100_000])
@pytest.mark.parametrize("name", ["check", "fill", "save"])
def test_malformed_requests_are_refused(client: ReviewClient, name: str, body: bytes) -> None:
    answer = client.send("POST", f"/{client.token}/{name}", body)
    assert answer.status == 400
    assert answer.error.startswith("the request")


def test_requests_of_others_are_refused(client: ReviewClient) -> None:
    own, port = f"/{client.token}/", client.port
    body = b'{"decisions": []}'
    refused = [
        (client.send("GET", "/"), 404),
        (client.send("GET", "/x/"), 404),
        (client.send("POST", "/x/fill", body), 404),
        (client.send("GET", f"{own}../../etc/passwd"), 404),
        (client.send("GET", f"{own}%2e%2e/%2e%2e/etc/passwd"), 404),
        (client.send("GET", f"{own}nope"), 404),
        (client.send("GET", own, headers={"Host": f"evil.example:{port}"}), 403),
        (client.send("GET", own, headers={"Origin": "http://evil.example"}), 403),
        (client.send("POST", f"{own}fill", body, {"Origin": "null"}), 403),
        (client.send("POST", f"{own}fill", body, {"Host": f"127.0.0.1.nip.io:{port}"}), 403),
        (client.send("POST", f"{own}fill", body, {"Content-Type": None}), 415),
        (client.send("POST", f"{own}fill", body, {"Content-Type": "text/plain"}), 415),
        (client.send("GET", f"{own}fill"), 405),
        (client.send("GET", f"{own}close"), 405),
        (client.send("POST", own, body), 405),
        (client.send("OPTIONS", f"{own}fill", headers={"Origin": "http://evil.example"}), 403),
        (client.send("OPTIONS", f"{own}fill"), 405),
        (client.send("PUT", f"{own}fill", body), 405),
        (client.send("POST", f"{own}fill", b"", {"Content-Length": str(MAX_BODY + 1)}), 413),
    ]
    for answer, status in refused:
        assert answer.status == status
        assert answer.error
        names = [name for name, _ in answer.headers]
        assert not [name for name in names if name.startswith("access-control")]
        assert "server" not in names
        assert client.token.encode() not in answer.body
        assert ("referrer-policy", "no-referrer") in answer.headers


def test_a_body_without_a_length_is_limited_too(client: ReviewClient) -> None:
    chunk = b"10000\r\n" + b" " * 0x10000 + b"\r\n"
    with socket.create_connection(("127.0.0.1", client.port), timeout=30) as connection:
        connection.sendall(
            f"POST /{client.token}/fill HTTP/1.1\r\nHost: 127.0.0.1:{client.port}\r\n"
            "Content-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\n".encode()
        )
        try:
            for _ in range(MAX_BODY // 0x10000 + 2):
                connection.sendall(chunk)
            answer = connection.recv(1000)
        except ConnectionError:  # it was closed while we were sending
            answer = b"HTTP/1.1 413"
    assert answer.startswith(b"HTTP/1.1 413")


def test_the_link_leads_to_the_page_once(
    served: tuple[ReviewServer, ReviewClient], monkeypatch: pytest.MonkeyPatch
) -> None:
    server, client = served
    path = server.link.partition(f":{server.port}")[2]
    assert client.token not in path
    assert client.send("GET", path, headers={"Host": "evil.example"}).status == 403
    answer = client.send("GET", path)
    assert answer.status == 303
    assert ("location", f"/{client.token}/") in answer.headers
    assert client.send("GET", path).status == 404
    path = server.link.partition(f":{server.port}")[2]
    monkeypatch.setattr(guard, "LINK_SECONDS", -1.0)
    late = server.link.partition(f":{server.port}")[2]
    for unused in (path, late, "//open", "/open", "/"):
        assert client.send("GET", unused).status == 404


def test_the_server_listens_on_this_computer_and_keeps_no_log(
    served: tuple[ReviewServer, ReviewClient],
    client: ReviewClient,
    caplog: pytest.LogCaptureFixture,
    capfd: pytest.CaptureFixture[str],
) -> None:
    with caplog.at_level(logging.DEBUG):
        client.get()
        client.send("GET", f"/{client.token}/nope")
    printed = capfd.readouterr()
    for text in (caplog.text, printed.out, printed.err):
        assert client.token not in text
    assert served[0].address == f"http://127.0.0.1:{client.port}/{client.token}/"
    assert served[0]._socket.getsockname() == ("127.0.0.1", client.port)
    with pytest.raises(OutputError, match=f"port {client.port} of this computer cannot be used"):
        ReviewServer(served[0].session, client.port)


def test_the_page_ends_the_review_and_its_fill(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    session, slow = ReviewSession(write_walk(Path("walk.c3d")), method="linear"), SlowFill()
    monkeypatch.setattr(session, "fill", slow.fill)
    session.data = {"title": "walk"}
    server = ReviewServer(session)
    server.start()
    client = ReviewClient.of(server.address)
    lines: list[dict[str, Any]] = []
    filling = threading.Thread(
        target=lambda: lines.extend(client.post("fill", {"decisions": []}).lines)
    )
    filling.start()
    assert slow.begun.wait(30)
    assert client.post("close", {}).lines == [{"ok": True}]
    filling.join(30)
    assert lines[-1] == {"error": "the fill was stopped"}
    server.wait()
    server.stop()
    with pytest.raises(ConnectionError):
        client.get()
