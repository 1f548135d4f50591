"""How a server is treated, and the error that concerns one of its files."""

from __future__ import annotations

from dataclasses import dataclass

from priorfill.errors import FetchError

__all__ = ["FileFetchError", "RetryPolicy"]


class FileFetchError(FetchError):
    """A file cannot be downloaded or unpacked; other files of the same server may be."""


@dataclass(frozen=True)
class RetryPolicy:
    """Waiting times and number of attempts.

    Attributes
    ----------
    pause : float
        Wait between two files (s).
    timeout : float
        Maximum time without a byte from the server (s).
    max_attempts : int
        Attempts without progress after which a file is given up.
    wait : float
        Wait before the second attempt (s); doubled before each further one.
    max_wait : float
        Longest wait that a server may ask for (s).

    Examples
    --------
    >>> RetryPolicy(pause=2.0).max_attempts
    5
    """

    pause: float = 1.0
    timeout: float = 30.0
    max_attempts: int = 5
    wait: float = 2.0
    max_wait: float = 600.0
