"""The server of a review: its page, fills with streamed progress, and saving.

The only module that imports starlette and uvicorn, which the extra ``review`` installs.
"""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from priorfill.errors import OptionError, OutputError, PriorfillError
from priorfill.report.page import content_policy, page_json, page_text
from priorfill.reviewing.error_lines import error_line
from priorfill.reviewing.guard import Guard
from priorfill.reviewing.review_job import ReviewJob
from priorfill.reviewing.security import ADDRESS, Visitor, new_token, parse_body
from priorfill.reviewing.session import ReviewSession

try:
    import uvicorn
    from starlette.applications import Starlette
    from starlette.exceptions import HTTPException
    from starlette.requests import Request
    from starlette.responses import JSONResponse, Response, StreamingResponse
    from starlette.routing import Route
except ImportError as missing:
    raise PriorfillError(
        f'a review needs {missing.name}, which is not installed: pip install "priorfill[review]"'
    ) from missing

if TYPE_CHECKING:
    from starlette.types import Receive, Scope, Send

__all__ = ["ReviewServer"]

MIN_INTERVAL_S = 0.05
"""Time between two lines of progress; a page shows no more."""

FINISH_SECONDS = 30.0
"""How long files that are being written may take when the server ends."""

SHUTDOWN_SECONDS = 2
"""How long connections may stay open when the server ends."""

Job = ReviewJob[dict[str, Any]]

Post = Callable[[dict[str, Any]], Awaitable[Response]]
"""Answers the content of a request."""


class ReviewServer:
    """Serves a review on this computer, in a thread of its own.

    Parameters
    ----------
    session : ReviewSession
        Filled once.
    port : int
        Where to listen; 0: any free port.
    words : callable
        Replaces arguments in backquotes in messages by what the user knows.

    Raises
    ------
    OutputError
        Where another program uses the port.
    """

    def __init__(
        self, session: ReviewSession, port: int = 0, words: Callable[[str], str] = str
    ) -> None:
        self.session = session
        self.ended = threading.Event()
        self._socket = _listen(port)
        self.port = int(self._socket.getsockname()[1])
        self._visitor = Visitor(new_token(), self.port)
        self._work = _Work(session, words)
        self._guard = Guard(self._visitor, _app(self._posts(), self._page, words))
        self._server = uvicorn.Server(
            uvicorn.Config(
                self._guard,
                access_log=False,
                log_config=None,
                log_level="critical",
                server_header=False,
                lifespan="off",
                proxy_headers=False,
                http="h11",
                ws="none",
                loop="asyncio",
                timeout_graceful_shutdown=SHUTDOWN_SECONDS,
            )
        )
        self._thread = threading.Thread(target=self._run, name="priorfill-server", daemon=True)

    @property
    def address(self) -> str:
        """Address of the page, which gives access to the review."""
        return f"http://{ADDRESS}:{self.port}/{self._visitor.token}/"

    @property
    def link(self) -> str:
        """A new address that leads to the page once: others see the command line of a browser."""
        return f"http://{ADDRESS}:{self.port}{self._guard.link()}"

    def start(self) -> None:
        """Start to serve."""
        self._thread.start()

    def wait(self) -> None:
        """Wait until the page ends the review; an interrupt is raised here."""
        # without a limit of time, Windows would not deliver Ctrl-C
        while not self.ended.wait(0.5):
            pass

    def stop(self) -> None:
        """Stop fills, finish files that are being written, and end."""
        self._work.stop()
        self._server.should_exit = True
        if self._thread.ident is not None:
            self._thread.join(FINISH_SECONDS)
        self._socket.close()
        self.session.finish(FINISH_SECONDS)

    def _run(self) -> None:
        try:
            self._server.run(sockets=[self._socket])
        finally:
            self.ended.set()

    def _posts(self) -> dict[str, Post]:
        """Return what answers the requests that do something, by the last part of their path."""
        work = self._work
        return {
            "check": work.check,
            "fill": work.fill,
            "save": work.save,
            "cancel": work.cancel,
            "close": self._close,
        }

    def _page(self, request: Request) -> Response:
        policy = f"{content_policy(connect=True)}; frame-ancestors 'none'"
        return Response(
            page_text(self.session.data, connect=True),
            media_type="text/html; charset=utf-8",
            headers={"Content-Security-Policy": policy},
        )

    async def _close(self, content: dict[str, Any]) -> Response:
        self._work.stop()
        self._server.should_exit = True
        return JSONResponse({"ok": True})


class _Work:
    """What the page asks for; one fill or save at a time.

    Parameters
    ----------
    session : ReviewSession
        Of the file.
    words : callable
        For messages.
    """

    def __init__(self, session: ReviewSession, words: Callable[[str], str]) -> None:
        self._session = session
        self._words = words
        self._job: Job | None = None

    async def check(self, content: dict[str, Any]) -> Response:
        """Check decisions."""
        await self._checked(content)
        return JSONResponse({"ok": True})

    async def fill(self, content: dict[str, Any]) -> Response:
        """Fill as decided, and send the data of the page."""
        decisions = await self._checked(content)
        return await self._start(
            lambda job: {"data": self._session.fill(decisions, job.report, job.check)}
        )

    async def save(self, content: dict[str, Any]) -> Response:
        """Save, after a fill if the decisions are others than those of the last one."""
        decisions = await self._checked(content)

        def work(job: Job) -> dict[str, Any]:
            saved = self._session.save(decisions, job.report, job.check)
            paths = {"output": str(saved.output), "overrides": str(saved.overrides)}
            return {"saved": paths, "data": self._session.data}

        return await self._start(work)

    async def cancel(self, content: dict[str, Any]) -> Response:
        """Stop the fill at hand."""
        self.stop()
        return JSONResponse({"ok": True})

    def stop(self) -> None:
        """Stop the fill at hand, if there is one."""
        if self._job is not None:
            self._job.stop()

    async def _checked(self, content: dict[str, Any]) -> list[dict[str, Any]]:
        """Return the decisions of a request if they fit the file."""
        decisions = content.get("decisions")
        if not isinstance(decisions, list):
            raise OptionError("the request has no list of decisions")
        await asyncio.to_thread(self._session.check, decisions)
        return decisions

    async def _start(self, work: Callable[[Job], dict[str, Any]]) -> Response:
        """Start a fill or save, whose progress is streamed."""
        before = self._job
        while before is not None and not before.done and before.stopped:
            await asyncio.sleep(MIN_INTERVAL_S)
        if before is not self._job or (before is not None and not before.done):
            raise HTTPException(409, "a fill is running; wait for it, or stop it")
        loop, changed = asyncio.get_running_loop(), asyncio.Event()

        def wake() -> None:
            with suppress(RuntimeError):  # the server has ended
                loop.call_soon_threadsafe(changed.set)

        self._job = ReviewJob(work, wake)
        self._job.start()
        return _JobStream(self._job, changed, self._words)


class _JobStream(StreamingResponse):
    """Lines of progress and of the outcome of a fill; a page that leaves stops it.

    Parameters
    ----------
    job : ReviewJob
        The fill.
    changed : asyncio.Event
        Is set after each of its steps.
    words : callable
        For messages.
    """

    def __init__(
        self,
        job: Job,
        changed: asyncio.Event,
        words: Callable[[str], str],
    ) -> None:
        self._job = job
        super().__init__(_lines(job, changed, words), media_type="application/x-ndjson")

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the lines."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._job.stop()


async def _lines(
    job: Job, changed: asyncio.Event, words: Callable[[str], str]
) -> AsyncIterator[bytes]:
    """Yield lines of progress, and the outcome."""
    told = None
    while not job.done:
        await changed.wait()
        changed.clear()
        if job.progress is not None and job.progress != told:
            told = job.progress
            yield _line({"done": told[0], "total": told[1]})
            await asyncio.sleep(MIN_INTERVAL_S)
    if job.error is not None:
        yield _line({"error": error_line(job.error, words)})
    else:
        yield _line(job.outcome or {})


def _line(content: dict[str, Any]) -> bytes:
    return f"{page_json(content)}\n".encode("ascii")


def _app(
    posts: dict[str, Post], page: Callable[[Request], Response], words: Callable[[str], str]
) -> Starlette:
    """Return the application, which answers requests that were not refused."""
    routes = [Route("/{token}/", page, methods=["GET"])]
    routes += [
        Route(f"/{{token}}/{name}", _endpoint(post, words), methods=["POST"])
        for name, post in posts.items()
    ]
    app = Starlette(routes=routes, exception_handlers={HTTPException: _refused, Exception: _failed})
    app.router.redirect_slashes = False  # a redirection would repeat the header Host
    return app


def _endpoint(post: Post, words: Callable[[str], str]) -> Callable[[Request], Awaitable[Response]]:
    """Return what answers a request with JSON; what is wrong with it is status 400."""

    async def answer(request: Request) -> Response:
        try:
            return await post(parse_body(await request.body()))
        except PriorfillError as error:
            return JSONResponse({"error": error_line(error, words)}, 400)

    return answer


async def _refused(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return JSONResponse({"error": error.detail}, error.status_code, error.headers)


async def _failed(request: Request, error: Exception) -> Response:
    return JSONResponse({"error": error_line(error)}, 500)


def _listen(port: int) -> socket.socket:
    """Return a socket that listens on this computer only."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        if hasattr(socket, "SO_EXCLUSIVEADDRUSE"):  # Windows lets others take over a port otherwise
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        else:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((ADDRESS, port))
        listener.listen()
    except OSError as error:
        listener.close()
        raise OutputError(
            f"port {port} of this computer cannot be used ({error.strerror}); choose another one "
            "(`port`), or 0 for any"
        ) from error
    return listener
