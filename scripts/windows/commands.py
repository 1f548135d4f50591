"""Programs that a Windows Python is made with."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

__all__ = ["NotMadeError", "run"]

LIMIT = 300.0
"""Seconds that one program may take; each takes half a minute at most."""


class NotMadeError(Exception):
    """The environment could not be made."""


def run(
    command: Sequence[str | Path],
    failure: str,
    *,
    folder: Path | None = None,
    environment: Mapping[str, str] | None = None,
) -> None:
    """Run a program, and raise `NotMadeError` with its last line if it fails."""
    # not a pipe: wine's services inherit it and would keep it open
    with tempfile.TemporaryFile() as output:
        try:
            done = subprocess.run(
                command,
                cwd=folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                timeout=LIMIT,
                check=False,
            )
        except OSError as error:
            raise NotMadeError(f"{failure}: {error}") from error
        except subprocess.TimeoutExpired as error:
            raise NotMadeError(f"{failure}: not done within {LIMIT:.0f} s") from error
        if done.returncode:
            output.seek(0)
            lines = output.read().decode(errors="replace").strip().splitlines()
            raise NotMadeError(f"{failure}: {lines[-1] if lines else 'no message'}")
