"""Download a file over HTTP, go on where it stopped, and say in a line why that cannot be done.

What is there of a file is kept in ``NAME.part``, and beside it in ``NAME.part.json`` which version
of the file that is: the server is asked for the rest of this version only (RFC 9110, sections
13.1.5 and 14.2), and sends the whole of another.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from email.message import Message
from email.utils import parsedate_to_datetime
from http.client import HTTPException, HTTPMessage, HTTPResponse
from importlib.metadata import version
from pathlib import Path
from typing import IO, Any
from urllib.parse import urlsplit

from priorfill.errors import FetchError
from priorfill.runtime.atomic_file import finish_file

__all__ = ["Downloader", "FileFetchError", "RetryPolicy", "hash_of"]

_PART, _MARK = ".part", ".part.json"
"""Suffixes of what is there of a file, and of which version it is."""

_CHUNK = 1 << 18
"""Bytes read at a time."""

_PROGRESS = 1 << 16
"""Bytes that an attempt must bring for the attempts to be counted anew: a line that breaks every
few megabytes gets a large file in the end, a server that sends next to nothing does not."""

_SLOWEST = 200.0
"""Bytes a second below which a transfer is taken as stalled: 100 MB would take six days."""

_SLOW_WINDOW = 60.0
"""Seconds over which that is judged."""

_LARGEST = 50_000_000_000
"""Bytes of the largest file that is downloaded: ten times the largest that is known."""

_SPARE = 100_000_000
"""Bytes that are left free on the disk."""

_TRY_LATER = frozenset({408, 425, 429, 500, 502, 503, 504})
"""Statuses of servers that may answer another time."""

_GONE = frozenset({404, 410})
_REFUSED = frozenset({401, 403, 407, 451})

_PARTIAL, _NOT_IN_RANGE = 206, 416

_CONTENT_RANGE = re.compile(r"bytes (\d+)-(\d+)/(\d+|\*)")


class FileFetchError(FetchError):
    """A file cannot be had; others of the same server may."""


@dataclass(frozen=True)
class RetryPolicy:
    """How a server is treated, and for how long it is believed in.

    Attributes
    ----------
    pause : float
        s, between two files.
    timeout : float
        s, in which the server must say something.
    tries : int
        Attempts without progress before a file is given up.
    wait : float
        s, before the second attempt; doubled for each further one.
    longest_wait : float
        s, that a server may ask to wait.
    """

    pause: float = 1.0
    timeout: float = 30.0
    tries: int = 5
    wait: float = 2.0
    longest_wait: float = 600.0


@dataclass(frozen=True)
class _Mark:
    """Which version of a file a part is of: where from, the server's word for it, and its size."""

    url: str
    validator: str
    size: int | None


class _AgainError(Exception):
    """An attempt failed in a way that another may not.

    Parameters
    ----------
    reason : str
        What happened.
    wait : float or None
        s, to wait before the next; None: as long as manners say.
    """

    def __init__(self, reason: str, wait: float | None = None) -> None:
        super().__init__(reason)
        self.reason, self.wait = reason, wait


class _Redirects(urllib.request.HTTPRedirectHandler):
    """Follow redirects within the web, and none from an encrypted connection to an open one."""

    def redirect_request(
        self,
        req: urllib.request.Request,
        fp: IO[bytes],
        code: int,
        msg: str,
        headers: HTTPMessage,
        newurl: str,
    ) -> urllib.request.Request | None:
        old, new = urlsplit(req.full_url).scheme, urlsplit(newurl).scheme
        if new not in ("http", "https") or (old == "https" and new == "http"):
            fp.close()
            raise FetchError(f"{req.full_url}: leads to {newurl}, which is not followed")
        return super().redirect_request(req, fp, code, msg, headers, newurl)


class Downloader:
    """Downloads files one after another, politely.

    Parameters
    ----------
    manners : Manners
        How the server is treated.
    tell : callable
        Called with a sentence when there is something to wait for.
    sleep : callable
        Waits for so many seconds.
    """

    def __init__(
        self,
        manners: RetryPolicy,
        tell: Callable[[str], None] = lambda text: None,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._manners, self._tell, self._sleep = manners, tell, sleep
        self._opener = urllib.request.OpenerDirector()
        for handler in (  # not build_opener, which also reads files and asks FTP servers
            urllib.request.ProxyHandler(),
            urllib.request.HTTPHandler(),
            urllib.request.HTTPSHandler(),
            urllib.request.HTTPDefaultErrorHandler(),
            urllib.request.HTTPErrorProcessor(),
            urllib.request.UnknownHandler(),
            _Redirects(),
        ):
            self._opener.add_handler(handler)
        self._asked = False

    def get(
        self,
        url: str,
        target: Path,
        *,
        size: int | None = None,
        sha256: str = "",
        progress: Callable[[int, int | None], None] = lambda done, total: None,
    ) -> str:
        """Download a file, or the rest of it.

        Parameters
        ----------
        url : str
            Its address.
        target : Path
            Where to; replaced if it is there.
        size : int or None
            Bytes that it must have.
        sha256 : str
            Hash that it must have; empty if that is not known.
        progress : callable
            Called with the bytes that are there and those of the whole file, if known.

        Returns
        -------
        str
            SHA-256 of its contents.

        Raises
        ------
        FileFetchError
            Where this file cannot be had, or is another than it should be.
        FetchError
            Where the server does not answer, refuses, or the disk is full. What is there of the
            file is kept, and the next call goes on from it.
        """
        part, mark = _beside(target)
        if self._asked:
            self._sleep(self._manners.pause)
        self._asked = True
        failures = 0
        while True:
            before = _size(part)
            try:
                self._attempt(url, part, mark, size, bool(sha256), progress)
                found = self._checked(url, part, mark, sha256, resumed=before > 0)
            except _AgainError as again:
                gained = _size(part) - before > _PROGRESS
                failures = 1 if gained else failures + 1
                self._wait(url, again, failures)
                continue
            finish_file(part, target)
            mark.unlink(missing_ok=True)
            return found

    def _wait(self, url: str, again: _AgainError, failures: int) -> None:
        """Wait before the next attempt, or give up."""
        manners = self._manners
        later = "what is there is kept; try again later, which goes on from it"
        if failures >= manners.tries:
            raise FetchError(f"{url}: {again.reason} ({failures} times); {later}") from again
        seconds = manners.wait * 2 ** (failures - 1) if again.wait is None else again.wait
        if seconds > manners.longest_wait:
            raise FetchError(
                f"{url}: {again.reason}, and asks to wait {seconds:.0f} s; {later}"
            ) from again
        if seconds >= 1:
            self._tell(f"{url}: {again.reason}; trying again in {seconds:.0f} s")
        self._sleep(seconds)

    def _attempt(
        self,
        url: str,
        part: Path,
        mark: Path,
        size: int | None,
        verified: bool,
        progress: Callable[[int, int | None], None],
    ) -> None:
        """Ask for a file, or the rest of it, once."""
        known = _read_mark(mark)
        start = _size(part)
        if known is None or known.url != url or not (known.validator or verified):
            start = 0  # nothing tells that the rest would be of the same file
        elif start and start == known.size:
            return
        headers = {"User-Agent": f"priorfill/{version('priorfill')}", "Accept-Encoding": "identity"}
        if start and known is not None:
            headers["Range"] = f"bytes={start}-"
            if known.validator:
                headers["If-Range"] = known.validator
        try:
            response = self._opener.open(
                urllib.request.Request(url, headers=headers), timeout=self._manners.timeout
            )
        except urllib.error.HTTPError as error:
            with error:
                raise self._refusal(url, error, part) from error
        except FetchError:
            raise
        except urllib.error.URLError as error:
            raise _AgainError(f"cannot be reached ({_reason(error.reason)})") from error
        except (OSError, HTTPException) as error:
            raise _AgainError(f"the connection failed ({_reason(error)})") from error
        with response:
            start, total = self._where(url, response, start, known, part)
            if size is not None and total is not None and total != size:
                raise FileFetchError(
                    f"{url}: has {total} bytes, not {size} as the catalogue says; it has changed, "
                    "or the address leads to something else"
                )
            self._check_room(url, part, start, total)
            fresh = _Mark(url, _validator(response.headers), total)
            mark.write_text(json.dumps(asdict(fresh)), encoding="utf-8")
            self._receive(response, part, start, total, progress)

    def _refusal(self, url: str, error: urllib.error.HTTPError, part: Path) -> Exception:
        """Return what a status means."""
        status, phrase = error.code, " ".join(str(error.reason).split())
        answer = f"the server answers {status} {phrase}".rstrip()
        if status == _NOT_IN_RANGE:
            part.unlink(missing_ok=True)
            return _AgainError("the server has another version", 0.0)
        if status in _TRY_LATER:
            return _AgainError(answer, _retry_after(error.headers))
        if status in _GONE:
            return FileFetchError(f"{url}: {answer}; it is not there (any more)")
        if status in _REFUSED:
            return FetchError(
                f"{url}: {answer}; download it with a browser, put it at "
                f"{part.with_name(part.name.removesuffix(_PART))}, and try again"
            )
        return FileFetchError(f"{url}: {answer}; look at the address with a browser")

    def _where(
        self, url: str, response: HTTPResponse, start: int, known: _Mark | None, part: Path
    ) -> tuple[int, int | None]:
        """Return where in the file an answer begins, and how long the file is."""
        length = response.headers.get("Content-Length", "")
        if response.status != _PARTIAL:
            return 0, int(length) if length.isdecimal() else None
        found = _CONTENT_RANGE.fullmatch(response.headers.get("Content-Range", "").strip())
        total = int(found[3]) if found and found[3] != "*" else None
        known_size = None if known is None else known.size
        if not found or int(found[1]) != start or (known_size and total and known_size != total):
            part.unlink(missing_ok=True)
            raise _AgainError("the server has another version", 0.0)
        return start, total if total is not None else known_size

    def _check_room(self, url: str, part: Path, start: int, total: int | None) -> None:
        """Raise FetchError where a file is too large for the disk, or for any library."""
        if total is None:
            return
        if total > _LARGEST:
            raise FileFetchError(
                f"{url}: has {total / 1e9:.0f} GB, more than the {_LARGEST / 1e9:.0f} GB that are "
                "downloaded; look at the address with a browser"
            )
        free = shutil.disk_usage(part.parent).free
        if total - start > free - _SPARE:
            raise FetchError(
                f"{part.parent}: has {max(free - _SPARE, 0) / 1e9:.2f} GB to spare, and "
                f"{(total - start) / 1e9:.2f} GB are to come; make room, or choose another folder"
            )

    def _receive(
        self,
        response: HTTPResponse,
        part: Path,
        start: int,
        total: int | None,
        progress: Callable[[int, int | None], None],
    ) -> None:
        """Write what comes to the end of a part."""
        done = since_done = start
        since = time.monotonic()
        progress(done, total)
        with part.open("r+b" if start else "wb") as file:
            file.truncate(start)
            file.seek(start)
            while True:
                try:
                    piece = response.read1(_CHUNK)
                except (OSError, HTTPException) as error:
                    raise _AgainError(f"the connection broke ({_reason(error)})") from error
                if not piece:
                    break
                file.write(piece)
                done += len(piece)
                if done > _LARGEST:
                    raise FileFetchError(f"{response.url}: does not end; look at the address")
                progress(done, total)
                now = time.monotonic()
                if now - since > _SLOW_WINDOW:
                    if done - since_done < _SLOWEST * (now - since):
                        raise _AgainError("the server hardly sends anything")
                    since, since_done = now, done
        if total is not None and done < total:
            raise _AgainError(f"the connection broke after {done} of {total} bytes")

    def _checked(self, url: str, part: Path, mark: Path, sha256: str, *, resumed: bool) -> str:
        """Return the hash of a whole part, which must be right."""
        found = hash_of(part)
        if not sha256 or found == sha256:
            return found
        part.unlink()
        mark.unlink(missing_ok=True)
        if resumed:
            raise _AgainError("the parts do not make the right file", 0.0)
        raise FileFetchError(
            f"{url}: its checksum is {found}, not {sha256}; the file is another than it was, or "
            "was damaged on the way"
        )


def hash_of(path: Path) -> str:
    """Return the SHA-256 of a file's contents."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _beside(target: Path) -> tuple[Path, Path]:
    """Return where the part of a file is, and what it is of."""
    return target.with_name(target.name + _PART), target.with_name(target.name + _MARK)


def _size(path: Path) -> int:
    """Return the bytes of a file; 0 if there is none."""
    return os.stat(path).st_size if path.exists() else 0  # noqa: PTH116 (follows no name twice)


def _read_mark(path: Path) -> _Mark | None:
    """Read which version a part is of; None where that cannot be told."""
    with suppress(OSError, ValueError, TypeError, KeyError):
        content: Any = json.loads(path.read_text(encoding="utf-8"))
        return _Mark(str(content["url"]), str(content["validator"]), content["size"])
    return None


def _validator(headers: Message) -> str:
    """Return what tells a version of a file from others; a weak tag does not."""
    tag = str(headers.get("ETag", "")).strip()
    if tag.startswith('"'):
        return tag
    return str(headers.get("Last-Modified", "")).strip()


def _retry_after(headers: Message) -> float | None:
    """Return the seconds that a server asks to wait."""
    text = str(headers.get("Retry-After", "")).strip()
    if text.isdecimal():
        return float(text)
    with suppress(ValueError):
        return max(0.0, parsedate_to_datetime(text).timestamp() - time.time())
    return None


def _reason(error: object) -> str:
    """Return an error in a few words."""
    words = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return " ".join(str(words).split())
