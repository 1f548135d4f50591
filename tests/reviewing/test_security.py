"""Who may use the server of a review."""

from __future__ import annotations

import json

import pytest

from priorfill.errors import OptionError
from priorfill.reviewing.security import MAX_BODY, MAX_DEPTH, Visitor, new_token, parse_body

TOKEN = "t0ken_" + "x" * 37
VISITOR = Visitor(TOKEN, 4711)
HOST = (b"host", b"127.0.0.1:4711")
JSON = (b"content-type", b"application/json")


def status(method: str, path: str, *headers: tuple[bytes, bytes]) -> int:
    refusal = VISITOR.refusal(method, path, headers)
    return 200 if refusal is None else refusal.status


def test_tokens_cannot_be_guessed() -> None:
    tokens = {new_token() for _ in range(100)}
    assert len(tokens) == 100
    assert min(map(len, tokens)) >= 43  # 32 bytes


@pytest.mark.parametrize(
    "path",
    [
        "",
        "/",
        "//",
        f"/{TOKEN}",
        f"/{TOKEN}x/",
        f"/{TOKEN[:-1]}/",
        f"/{TOKEN.swapcase()}/",
        f"//{TOKEN}/",
        f"/./{TOKEN}/",
        f"/../{TOKEN}/",
        "/\u00e9\udcff/",
        f"/{TOKEN}\0/",
        "/x/fill",
    ],
)
def test_other_paths_are_not_found(path: str) -> None:
    assert status("GET", path, HOST) == 404
    assert status("POST", path, HOST, JSON) == 404


@pytest.mark.parametrize(
    "host",
    [
        b"",
        b"127.0.0.1",
        b"127.0.0.1:4712",
        b"localhost",
        b"evil.example:4711",
        b"[::1]:4711",
        b"127.0.0.1:4711.evil.example",
        b"evil.example#127.0.0.1:4711",
        b"127.0.0.1:4711 ",
        b"127.0.0.1.nip.io:4711",
        b"0.0.0.0:4711",
        b"user@127.0.0.1:4711",
        b"127.1:4711",
    ],
)
def test_other_hosts_are_refused(host: bytes) -> None:
    assert status("GET", f"/{TOKEN}/", (b"host", host)) == 403
    assert not VISITOR.comes_from_here([(b"host", host)])


def test_a_request_has_one_host() -> None:
    assert status("GET", f"/{TOKEN}/") == 403
    assert status("GET", f"/{TOKEN}/", HOST, HOST) == 403
    for own in (b"127.0.0.1:4711", b"localhost:4711", b"LocalHost:4711"):
        assert status("GET", f"/{TOKEN}/", (b"host", own)) == 200
    for own in (b"localhost", b"localhost:80"):  # browsers leave the usual port out
        assert Visitor(TOKEN, 80).refusal("GET", f"/{TOKEN}/", [(b"host", own)]) is None


@pytest.mark.parametrize(
    "origin",
    [
        b"null",
        b"",
        b"http://127.0.0.1",
        b"https://127.0.0.1:4711",
        b"http://127.0.0.1:4712",
        b"http://evil.example",
        b"http://localhost:4711.evil.example",
        b"file://",
        b"http://127.0.0.1:4711/",
        b"http://127.0.0.1:4711 http://evil.example",
    ],
)
def test_requests_of_other_pages_are_refused(origin: bytes) -> None:
    for method in ("GET", "POST", "OPTIONS"):
        assert status(method, f"/{TOKEN}/fill", HOST, JSON, (b"origin", origin)) == 403
    assert not VISITOR.comes_from_here([HOST, (b"origin", origin)])
    own = (b"origin", b"http://127.0.0.1:4711")
    assert status("POST", f"/{TOKEN}/fill", HOST, JSON, own) == 200
    assert status("POST", f"/{TOKEN}/fill", HOST, JSON, own, own) == 403
    assert VISITOR.comes_from_here([HOST, own])


def test_requests_that_do_something_are_json_of_the_page_itself() -> None:
    assert status("POST", f"/{TOKEN}/fill", HOST, JSON) == 200
    assert status("POST", f"/{TOKEN}/fill", HOST) == 415
    for kind in (b"text/plain", b"application/x-www-form-urlencoded", b"multipart/form-data"):
        assert status("POST", f"/{TOKEN}/fill", HOST, (b"content-type", kind)) == 415
    for kind in (b"application/json, text/plain", b"application/jsonp", b"text/json", b""):
        assert status("POST", f"/{TOKEN}/fill", HOST, (b"content-type", kind)) == 415
    for kind in (b"application/json; charset=utf-8", b"Application/JSON;charset=UTF-8"):
        assert status("POST", f"/{TOKEN}/fill", HOST, (b"content-type", kind)) == 200
    for site in (b"cross-site", b"same-site", b"none"):
        given = (b"sec-fetch-site", site)
        assert status("POST", f"/{TOKEN}/fill", HOST, JSON, given) == 403
    for method in ("OPTIONS", "PUT", "DELETE", "PATCH", "TRACE", "CONNECT", "post"):
        assert status(method, f"/{TOKEN}/fill", HOST, JSON) == 405


@pytest.mark.parametrize(
    ("length", "expected"),
    [
        (b"0", 200),
        (b"%d" % MAX_BODY, 200),
        (b"%d" % (MAX_BODY + 1), 413),
        (b"9" * 5000, 413),
        (b"-1", 400),
        (b"1e3", 400),
        (b"", 400),
    ],
)
def test_the_length_of_a_request_is_limited(length: bytes, expected: int) -> None:
    given = (b"content-length", length)
    assert status("POST", f"/{TOKEN}/fill", HOST, JSON, given) == expected
    assert status("POST", f"/{TOKEN}/fill", HOST, JSON, given, given) == 400


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"{",
        b"[]",
        b"1",
        b"null",
        b'"x"',
        b"\xff{}",
        b'{"a": NaN}',
        b'{"a": Infinity}',
        b"{}x",
        b"[" * 100_000,
        b'{"a":' * 100_000,
        b'{"a": ' + b"9" * 10_000 + b"}",
    ],
)
def test_what_is_no_object_is_refused(body: bytes) -> None:
    with pytest.raises(OptionError, match="the request is no"):
        parse_body(body)


def test_depth_is_limited() -> None:
    def nested(depth: int) -> bytes:
        value: object = 1
        for _ in range(depth):
            value = [value]
        return json.dumps({"decisions": value}).encode()

    assert parse_body(nested(5))
    with pytest.raises(OptionError, match="within each other"):
        parse_body(nested(MAX_DEPTH + 1))
