"""Download files over HTTP, and resume interrupted downloads.

pooch stores a file under its name once its checksum matches. The downloader it calls is ours,
because pooch's own start again after an interruption: the received part of a file is kept in
``NAME.part``, and ``NAME.part.json`` identifies the version of the file it belongs to. The server
is asked for the rest of this version only (RFC 9110, sections 13.1.5 and 14.2); if the file has
changed, it sends the complete new version.
"""

from __future__ import annotations

import json
import re
import shutil
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from email.utils import parsedate_to_datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self
from urllib.parse import urljoin, urlsplit

import pooch
import requests
import urllib3.exceptions

from priorfill.datasets.retry_policy import FileFetchError, RetryPolicy
from priorfill.errors import FetchError
from priorfill.runtime.atomic_file import finish_file
from priorfill.runtime.disk_flush import flush_folder
from priorfill.runtime.held_files import is_held, retry_while_held

__all__ = ["Downloader"]

CHUNK_BYTES = 1 << 18
"""Maximum bytes read at a time."""

MIN_PROGRESS_BYTES = 1 << 16
"""Bytes that an attempt must bring to reset the count of failures: a connection that breaks every
few megabytes delivers a large file in the end, a server that sends next to nothing does not."""

MIN_BYTES_PER_SECOND = 200.0
"""Rate below which a transfer counts as stalled; 100 MB would take six days."""

RATE_SECONDS = 60.0
"""Time over which the rate is measured."""

MAX_FILE_BYTES = 50_000_000_000
"""Largest file that is downloaded: ten times the largest known one."""

SPARE_DISK_BYTES = 100_000_000
"""Disk space to leave free."""

RETRIED_STATUSES = frozenset({408, 425, 429, 500, 502, 503, 504})
GONE_STATUSES = frozenset({404, 410})
REFUSED_STATUSES = frozenset({401, 403, 407, 451})
PARTIAL_CONTENT, RANGE_NOT_SATISFIABLE = 206, 416

_CONTENT_RANGE = re.compile(r"bytes (\d+)-(\d+)/(\d+|\*)")

Progress = Callable[[int, int | None], None]
"""Called with the received bytes and those of the complete file, if known."""


@dataclass(frozen=True)
class _FileVersion:
    """The version of a file that a part belongs to: address, validator (ETag or date), bytes."""

    url: str
    validator: str
    size: int | None


class _RetryError(Exception):
    """An attempt failed, and another one may succeed.

    Parameters
    ----------
    reason : str
        What happened.
    wait : float or None
        Wait before the next attempt (s); None: given by the policy.
    """

    def __init__(self, reason: str, wait: float | None = None) -> None:
        super().__init__(reason)
        self.reason, self.wait = reason, wait


class _Session(requests.Session):
    """Follows redirects to http and https, but not from https to http."""

    def get_redirect_target(self, resp: requests.Response) -> str | None:
        target = super().get_redirect_target(resp)
        if target is not None:
            new = urljoin(resp.url, target)
            schemes = urlsplit(resp.url).scheme, urlsplit(new).scheme
            if schemes[1] not in ("http", "https") or schemes == ("https", "http"):
                resp.close()
                raise FetchError(f"{resp.url}: redirects to {new}, which is not followed")
        return target


class Downloader:
    """Downloads files one after another; a context manager that closes the connections.

    Parameters
    ----------
    policy : RetryPolicy
        Waiting times and number of attempts.
    notify : callable
        Called with a sentence before a wait.
    sleep : callable
        Waits for a number of seconds.
    """

    def __init__(
        self,
        policy: RetryPolicy,
        notify: Callable[[str], None] = lambda text: None,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.policy, self.notify, self.sleep = policy, notify, sleep
        self.session = _Session()
        self.session.headers["User-Agent"] = f"priorfill/{version('priorfill')}"
        self.session.headers["Accept-Encoding"] = "identity"
        self._is_first = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.session.close()

    def get(
        self,
        url: str,
        target: Path,
        *,
        size: int | None = None,
        sha256: str = "",
        progress: Progress = lambda done, total: None,
    ) -> str:
        """Download a file, or the rest of it.

        Parameters
        ----------
        url : str
            Its address.
        target : Path
            The file to write, which does not exist.
        size : int or None
            Bytes that it must have.
        sha256 : str
            Hash that it must have; empty if unknown.
        progress : callable
            Called with the received bytes and those of the complete file, if known.

        Returns
        -------
        str
            SHA-256 of its contents.

        Raises
        ------
        FileFetchError
            If this file cannot be downloaded, or its size or checksum is wrong.
        FetchError
            If the server does not answer or refuses, or the disk is full. The received part of the
            file is kept, and the next call continues from it.
        """
        if not self._is_first:
            self.sleep(self.policy.pause)
        self._is_first = False
        pooch.get_logger().setLevel("WARNING")
        transfer = _Transfer(self, target, size, progress, has_hash=bool(sha256))
        while True:
            try:
                pooch.retrieve(
                    url,
                    known_hash=f"sha256:{sha256}" if sha256 else None,
                    fname=target.name,
                    path=target.parent,
                    downloader=transfer,
                )
            except FetchError:
                raise
            except ValueError as error:  # of pooch: the checksum is wrong
                if transfer.was_resumed:  # the parts may be of two versions of the file
                    continue
                raise FileFetchError(
                    f"{url}: its checksum is not {sha256}; the file has changed, or was damaged on "
                    "the way"
                ) from error
            flush_folder(target.parent)
            return str(pooch.file_hash(target))


class _Transfer:
    """A downloader for pooch that continues from the received part of one file."""

    def __init__(
        self,
        downloader: Downloader,
        target: Path,
        size: int | None,
        progress: Progress,
        *,
        has_hash: bool,
    ) -> None:
        self._downloader, self._target = downloader, target
        self._size, self._progress, self._has_hash = size, progress, has_hash
        self._part = target.with_name(f"{target.name}.part")
        self._version_file = target.with_name(f"{target.name}.part.json")
        self.was_resumed = False

    def __call__(
        self, url: str, output_file: str, pooch: object, check_only: bool = False
    ) -> bool | None:
        """Download the file, in several attempts if need be."""
        self.was_resumed = False
        failures = 0
        while True:
            before = _size_of(self._part)
            self.was_resumed |= before > 0
            try:
                self._attempt(url)
            except _RetryError as error:
                progressed = _size_of(self._part) - before > MIN_PROGRESS_BYTES
                failures = 1 if progressed else failures + 1
                self._wait(url, error, failures)
                continue
            self._finish(Path(output_file))
            return None

    def _finish(self, output: Path) -> None:
        """Rename the complete part."""
        try:
            finish_file(self._part, output)
        except OSError as error:
            if not is_held(error):
                raise
            raise FetchError(
                f"{self._part}: is complete, but open in another program; close it there, and try "
                "again"
            ) from error
        with suppress(OSError):  # a program has it open; without a part it means nothing
            self._version_file.unlink(missing_ok=True)

    def _wait(self, url: str, error: _RetryError, failures: int) -> None:
        """Wait before the next attempt, or give up."""
        policy = self._downloader.policy
        later = "the received part is kept; try again later to continue from it"
        if failures >= policy.max_attempts:
            raise FetchError(f"{url}: {error.reason} ({failures} times); {later}") from error
        seconds = policy.wait * 2 ** (failures - 1) if error.wait is None else error.wait
        if seconds > policy.max_wait:
            raise FetchError(
                f"{url}: {error.reason}, and asks to wait {seconds:.0f} s; {later}"
            ) from error
        if seconds >= 1:
            self._downloader.notify(f"{url}: {error.reason}; trying again in {seconds:.0f} s")
        self._downloader.sleep(seconds)

    def _attempt(self, url: str) -> None:
        """Request the file, or the rest of it, once."""
        known = _read_version(self._version_file)
        start = _size_of(self._part)
        if known is None or known.url != url or not (known.validator or self._has_hash):
            start = 0  # the rest might be of another version
        elif start and start == known.size:
            return
        headers = {}
        if start and known is not None:
            headers["Range"] = f"bytes={start}-"
            if known.validator:
                headers["If-Range"] = known.validator
        with self._request(url, headers) as response:
            if response.status_code >= 300:
                raise self._refusal(url, response)
            start, total = self._extent(response, start, known)
            self._check_size(url, start, total)
            fresh = _FileVersion(url, _validator(response.headers), total)
            self._version_file.write_text(json.dumps(asdict(fresh)), encoding="utf-8", newline="\n")
            self._receive(response, start, total)

    def _request(self, url: str, headers: dict[str, str]) -> requests.Response:
        timeout = self._downloader.policy.timeout
        try:
            return self._downloader.session.get(url, headers=headers, stream=True, timeout=timeout)
        except (requests.ConnectionError, requests.Timeout) as error:
            raise _RetryError(f"the connection failed ({_reason(error)})") from error
        except requests.RequestException as error:
            raise FileFetchError(f"{url}: {_reason(error)}; check the address") from error

    def _refusal(self, url: str, response: requests.Response) -> Exception:
        """Return the error for a status."""
        status = response.status_code
        answer = f"the server answers {status} {response.reason}".rstrip()
        if status == RANGE_NOT_SATISFIABLE:
            self._remove_part()
            return _RetryError("the server has another version", 0.0)
        if status in RETRIED_STATUSES:
            return _RetryError(answer, _retry_after(response.headers))
        if status in GONE_STATUSES:
            return FileFetchError(f"{url}: {answer}; the file does not exist; check the address")
        if status in REFUSED_STATUSES:
            return FetchError(
                f"{url}: {answer}; download it with a browser, save it as {self._target}, and try "
                "again"
            )
        return FileFetchError(f"{url}: {answer}; check the address with a browser")

    def _remove_part(self) -> None:
        retry_while_held(lambda: self._part.unlink(missing_ok=True))

    def _extent(
        self, response: requests.Response, start: int, known: _FileVersion | None
    ) -> tuple[int, int | None]:
        """Return where in the file a response begins, and the file's size if known."""
        if response.status_code != PARTIAL_CONTENT:
            length = response.headers.get("Content-Length", "")
            return 0, int(length) if length.isdecimal() else None
        found = _CONTENT_RANGE.fullmatch(response.headers.get("Content-Range", "").strip())
        total = int(found[3]) if found and found[3] != "*" else None
        known_size = None if known is None else known.size
        if not found or int(found[1]) != start or (known_size and total and known_size != total):
            self._remove_part()
            raise _RetryError("the server has another version", 0.0)
        return start, total if total is not None else known_size

    def _check_size(self, url: str, start: int, total: int | None) -> None:
        """Raise an error if the size is wrong, or too large for the disk or for any data set."""
        if total is None:
            return
        if self._size is not None and total != self._size:
            raise FileFetchError(
                f"{url}: has {total} bytes, not {self._size} as in the definition; the file has "
                "changed, or the address leads to something else"
            )
        if total > MAX_FILE_BYTES:
            raise FileFetchError(
                f"{url}: has {total / 1e9:.0f} GB, more than the maximum of "
                f"{MAX_FILE_BYTES / 1e9:.0f} GB; check the address with a browser"
            )
        folder = self._part.parent
        free = max(shutil.disk_usage(folder).free - SPARE_DISK_BYTES, 0)
        if total - start > free:
            raise FetchError(
                f"{folder}: has {free / 1e9:.2f} GB to spare, but {(total - start) / 1e9:.2f} GB "
                "are needed; free some space, or choose another folder"
            )

    def _receive(self, response: requests.Response, start: int, total: int | None) -> None:
        """Append what the server sends to the part."""
        done = measured_from = start
        since = time.monotonic()
        self._progress(done, total)
        with self._part.open("r+b" if start else "wb") as file:
            file.truncate(start)
            file.seek(start)
            while True:
                try:
                    # requests' own iterators lose what they hold when the connection breaks
                    data = response.raw.read1(CHUNK_BYTES, decode_content=False)
                except urllib3.exceptions.ProtocolError:
                    break  # fewer bytes than announced
                except (urllib3.exceptions.HTTPError, OSError) as error:
                    raise _RetryError(f"the connection broke ({_reason(error)})") from error
                if not data:
                    break
                file.write(data)
                done += len(data)
                if done > MAX_FILE_BYTES:
                    raise FileFetchError(f"{response.url}: does not end; check the address")
                self._progress(done, total)
                now = time.monotonic()
                if now - since > RATE_SECONDS:
                    if done - measured_from < MIN_BYTES_PER_SECOND * (now - since):
                        raise _RetryError("the server sends almost nothing")
                    since, measured_from = now, done
        if total is not None and done < total:
            raise _RetryError(f"the connection broke after {done} of {total} bytes")


def _size_of(path: Path) -> int:
    """Return the bytes of a file; 0 if it does not exist."""
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0


def _read_version(path: Path) -> _FileVersion | None:
    """Return the version that a part belongs to; None if unknown."""
    with suppress(OSError, ValueError, TypeError, KeyError, RecursionError):
        content: Any = json.loads(path.read_text(encoding="utf-8"))
        return _FileVersion(str(content["url"]), str(content["validator"]), content["size"])
    return None


def _validator(headers: Mapping[str, str]) -> str:
    """Return the strong ETag of a version, else its date; weak ETags do not identify bytes."""
    tag = headers.get("ETag", "").strip()
    return tag if tag.startswith('"') else headers.get("Last-Modified", "").strip()


def _retry_after(headers: Mapping[str, str]) -> float | None:
    """Return the seconds that a server asks to wait."""
    text = headers.get("Retry-After", "").strip()
    if text.isdecimal():
        return float(text)
    with suppress(ValueError):
        return max(0.0, parsedate_to_datetime(text).timestamp() - time.time())
    return None


def _reason(error: BaseException) -> str:
    """Return the innermost cause of an error in a few words."""
    innermost = error
    while (cause := innermost.__cause__ or innermost.__context__) is not None:
        innermost = cause
    if isinstance(innermost, TimeoutError):
        return "timed out"
    text = innermost.strerror if isinstance(innermost, OSError) else None
    return text or " ".join(str(innermost).split()) or type(innermost).__name__
