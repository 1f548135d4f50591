"""Who may use the server of a review: whoever has its address, from its own page, and no one else.

The server listens on this computer only. Other users and programs of the computer cannot guess the
token in the address. A page of another site that is open in the browser can send requests here, so
the names of the host and of the requesting page are checked: the first stops a site whose name was
made to lead to this computer (DNS rebinding), the second stops forged requests.
"""

from __future__ import annotations

import hmac
import json
import re
import secrets
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from priorfill.errors import OptionError

__all__ = [
    "ADDRESS",
    "MAX_BODY",
    "RESPONSE_HEADERS",
    "Refusal",
    "Visitor",
    "new_token",
    "parse_body",
    "split_path",
    "too_large",
]

ADDRESS = "127.0.0.1"
"""The server listens here, which other computers cannot reach."""

MAX_BODY = 8 << 20
"""Bytes of a request: some 50,000 decisions."""

MAX_DEPTH = 32
"""Lists and objects within each other in a request; a decision needs five."""

_TOKEN_BYTES = 32
"""Random bytes of the token, which nobody can guess."""

_HTTP_PORT = 80
"""Port that browsers leave out of the name of the host."""

RESPONSE_HEADERS = (
    (b"cache-control", b"no-store"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
)
"""Of every response. None of them lets other sites read what the server sends (CORS)."""


def new_token() -> str:
    """Return a random text for the address of a server."""
    return secrets.token_urlsafe(_TOKEN_BYTES)


@dataclass(frozen=True)
class Refusal:
    """Why a request is refused.

    Attributes
    ----------
    status : int
        Status of HTTP.
    line : str
        The reason.
    """

    status: int
    line: str


@dataclass(frozen=True)
class Visitor:
    """Checks requests.

    Attributes
    ----------
    token : str
        The token of the address.
    port : int
        Where the server listens.
    """

    token: str
    port: int

    def refusal(
        self, method: str, path: str, headers: Iterable[tuple[bytes, bytes]]
    ) -> Refusal | None:
        """Return why a request is refused; None if it is not.

        Parameters
        ----------
        method : str
            Of HTTP.
        path : str
            Without the query.
        headers : iterable of (bytes, bytes)
            Names in lower case, and values.
        """
        given = _by_name(headers)
        foreign = self._refused_place(given)
        if foreign is not None:
            return foreign
        if not self.has_token(path):
            return Refusal(404, "there is no such page")
        if method not in ("GET", "HEAD"):
            return self._refused_post(method, given)
        return None

    def comes_from_here(self, headers: Iterable[tuple[bytes, bytes]]) -> bool:
        """Return whether a request names this server, and no other site sent it.

        Parameters
        ----------
        headers : iterable of (bytes, bytes)
            Names and values.
        """
        return self._refused_place(_by_name(headers)) is None

    def has_token(self, path: str) -> bool:
        """Return whether a path begins with the token, in a time that does not depend on it.

        Parameters
        ----------
        path : str
            Of a request.
        """
        first, _ = split_path(path)
        return hmac.compare_digest(first.encode("utf-8", "replace"), self.token.encode())

    def _refused_place(self, given: dict[bytes, list[bytes]]) -> Refusal | None:
        """Return why a request to another host, or from another site, is refused."""
        if not self._is_own(given.get(b"host", []), b""):
            return Refusal(403, "the address is not that of this review")
        if b"origin" in given and not self._is_own(given[b"origin"], b"http://"):
            return Refusal(403, "another site sent the request")
        return None

    def _is_own(self, values: list[bytes], before: bytes) -> bool:
        """Return whether a header has one value, which names this server."""
        names = (ADDRESS.encode(), b"localhost")
        own = {before + name + b":%d" % self.port for name in names}
        if self.port == _HTTP_PORT:
            own |= {before + name for name in names}
        return len(values) == 1 and values[0].lower() in own

    def _refused_post(self, method: str, given: dict[bytes, list[bytes]]) -> Refusal | None:
        """Return why a request that does something is refused."""
        if method != "POST":
            return Refusal(405, "the request must be GET or POST")
        if given.get(b"sec-fetch-site", [b"same-origin"]) != [b"same-origin"]:
            return Refusal(403, "another site sent the request")
        kinds = given.get(b"content-type", [])
        if len(kinds) != 1 or not re.fullmatch(
            rb"application/json(\s*;\s*charset=\"?utf-8\"?)?", kinds[0].strip().lower()
        ):
            return Refusal(415, "the request must be JSON (application/json)")
        sizes = given.get(b"content-length", [])
        if len(sizes) > 1 or any(not size.isdigit() for size in sizes):
            return Refusal(400, "the length of the request is no number")
        # as text first: numbers of thousands of digits are not converted
        if sizes and (len(sizes[0]) > len(str(MAX_BODY)) or int(sizes[0]) > MAX_BODY):
            return too_large()
        return None


def _by_name(headers: Iterable[tuple[bytes, bytes]]) -> dict[bytes, list[bytes]]:
    """Return the values of headers by their names in lower case."""
    given: dict[bytes, list[bytes]] = {}
    for name, value in headers:
        given.setdefault(name.lower(), []).append(value)
    return given


def too_large() -> Refusal:
    """Return the refusal of a request with more than `MAX_BODY` bytes."""
    return Refusal(413, f"the request has more than {MAX_BODY >> 20} MB")


def split_path(path: str) -> tuple[str, str]:
    """Return the token and the rest of a path.

    Parameters
    ----------
    path : str
        Of a request.

    Examples
    --------
    >>> split_path("/token/fill")
    ('token', 'fill')
    """
    first, slash, rest = path.removeprefix("/").partition("/")
    return (first, rest) if slash and path.startswith("/") else ("", path)


def parse_body(body: bytes) -> dict[str, Any]:
    """Return the object that a request consists of.

    Parameters
    ----------
    body : bytes
        JSON in UTF-8.

    Raises
    ------
    OptionError
        If it is not a JSON object, or too deep.
    """
    try:
        value = json.loads(body.decode("utf-8"), parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise OptionError("the request is not valid JSON") from error
    if not isinstance(value, dict):
        raise OptionError("the request is no JSON object")
    if _depth(value) > MAX_DEPTH:
        raise OptionError("the request has too many lists within each other")
    return value


def _refuse_constant(name: str) -> None:
    raise ValueError(name)


def _depth(value: Any) -> int:
    """Return how many lists and objects are within each other, up to more than `MAX_DEPTH`."""
    depth, level = 0, [value]
    while level and depth <= MAX_DEPTH:
        depth += 1
        level = [
            inner
            for one in level
            if isinstance(one, (dict, list))
            for inner in (one.values() if isinstance(one, dict) else one)
        ]
    return depth
