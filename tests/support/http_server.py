"""A local HTTP server with programmable faults."""

from __future__ import annotations

import re
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any


@dataclass
class Site:
    """The files of a server, and its behaviour.

    Each item of `behave` applies to one request, in their order: ``("status", code, headers)``
    answers with a status, ``("cut", bytes)`` closes the connection after a number of bytes,
    ``("stall", bytes)`` sends nothing after them, ``("call", function)`` calls a function first.
    """

    files: dict[str, bytes]
    ranges: bool = True
    tags: bool = True
    length: bool = True
    behave: deque[tuple[Any, ...]] = field(default_factory=deque)
    requests: list[dict[str, str]] = field(default_factory=list)
    url: str = ""
    closing: threading.Event = field(default_factory=threading.Event)

    def tag(self, path: str) -> str:
        return f'"{hash(self.files[path]) & 0xFFFF:x}"'


class _Handler(BaseHTTPRequestHandler):
    site: Site
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        site = self.site
        path = self.path.lstrip("/")
        site.requests.append({"path": path, "time": str(time.monotonic()), **dict(self.headers)})
        self.close_connection = True
        what = site.behave.popleft() if site.behave else ("",)
        if what[0] == "call":
            what[1]()
        if what[0] == "status":
            self.send_response(what[1])
            for name, value in what[2].items():
                self.send_header(name, value)
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        if path not in site.files:
            self.send_error(404)
            return
        content, start, status = site.files[path], 0, 200
        wanted = re.fullmatch(r"bytes=(\d+)-", self.headers.get("Range", ""))
        same = self.headers.get("If-Range") in (None, site.tag(path))
        if wanted and site.ranges and same:
            start, status = int(wanted[1]), 206
            if start >= len(content):
                self.send_response(416)
                self.send_header("Content-Range", f"bytes */{len(content)}")
                self.send_header("Content-Length", "0")
                self.end_headers()
                return
        self.send_response(status)
        if status == 206:
            self.send_header("Content-Range", f"bytes {start}-{len(content) - 1}/{len(content)}")
        if site.tags:
            self.send_header("ETag", site.tag(path))
        if site.length:
            self.send_header("Content-Length", str(len(content) - start))
        self.end_headers()
        end = start + what[1] if what[0] in ("cut", "stall") else len(content)
        with suppress(OSError):  # the client has closed the connection
            self.wfile.write(content[start:end])
            self.wfile.flush()
        if what[0] == "stall":
            site.closing.wait(10)

    def log_message(self, *what: Any) -> None:
        pass


@contextmanager
def serve(files: dict[str, bytes], **how: Any) -> Iterator[Site]:
    """Serve files while the block runs."""
    site = Site(dict(files), **how)
    server = ThreadingHTTPServer(("127.0.0.1", 0), type("Handler", (_Handler,), {"site": site}))
    server.daemon_threads = False  # closing waits for open requests
    site.url = f"http://127.0.0.1:{server.server_address[1]}"
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    try:
        yield site
    finally:
        site.closing.set()
        server.shutdown()
        thread.join()
        server.server_close()
