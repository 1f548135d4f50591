"""A small recording under review, and a client of its server."""

from __future__ import annotations

import http.client
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import priorfill as pf
from priorfill.synthetic import synthesise

__all__ = ["Answer", "ReviewClient", "write_walk"]


def write_walk(path: Path) -> Path:
    """Write a walk of two seconds with gaps of LKNE, RANK and STRN, and return its path."""
    clip = synthesise("walking", seconds=2.0, rate=30.0)
    positions = clip.positions.copy()
    for label, start, stop in (("LKNE", 10, 14), ("RANK", 20, 30), ("STRN", 40, 45)):
        positions[start:stop, clip.labels.index(label)] = np.nan
    pf.write(path, clip.with_positions(positions))
    return path


@dataclass(frozen=True)
class Answer:
    """What a server answers.

    Attributes
    ----------
    status : int
        Of HTTP.
    headers : list of (str, str)
        With names in lower case.
    body : bytes
        The rest.
    """

    status: int
    headers: list[tuple[str, str]]
    body: bytes

    @property
    def lines(self) -> list[dict[str, Any]]:
        """The JSON of each line."""
        return [json.loads(line) for line in self.body.splitlines()]

    @property
    def error(self) -> str:
        """The line of an error."""
        return str(self.lines[-1]["error"])


@dataclass
class ReviewClient:
    """Sends requests as the page does, or otherwise.

    Attributes
    ----------
    port : int
        Of the server.
    token : str
        Of its address.
    """

    port: int
    token: str
    seconds: float = field(default=60.0)

    @classmethod
    def of(cls, address: str) -> ReviewClient:
        """Return a client of the server with an address."""
        _, _, host, token, _ = address.split("/")
        return cls(int(host.partition(":")[2]), token)

    def send(
        self,
        method: str,
        path: str,
        body: bytes | None = None,
        headers: Mapping[str, str | None] | None = None,
    ) -> Answer:
        """Send a request; a header that is None is left out."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=self.seconds)
        given: dict[str, str | None] = {"Host": f"127.0.0.1:{self.port}"}
        if body is not None:
            given |= {"Content-Type": "application/json", "Content-Length": str(len(body))}
        given |= headers or {}
        try:
            connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            for name, value in given.items():
                if value is not None:
                    connection.putheader(name, value)
            connection.endheaders(body)
            answer = connection.getresponse()
            names = [(name.lower(), value) for name, value in answer.getheaders()]
            return Answer(answer.status, names, answer.read())
        finally:
            connection.close()

    def get(self, name: str = "", **more: Any) -> Answer:
        """Get a page of the review."""
        return self.send("GET", f"/{self.token}/{name}", **more)

    def post(self, name: str, content: Any, **more: Any) -> Answer:
        """Send JSON as the page does."""
        return self.send("POST", f"/{self.token}/{name}", json.dumps(content).encode(), **more)
