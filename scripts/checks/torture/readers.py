"""A process that keeps databases open, with their segments mapped, while others change them."""

from __future__ import annotations

import gc
import json
import mmap
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from priorfill.database import PriorDatabase
from priorfill.errors import PriorfillError
from torture.children import SCRIPT
from torture.clips import Stored, WrongError, stored_of


def serve() -> None:
    """Answer the requests in the lines of stdin, until it is closed."""
    held: list[_Held] = []
    for line in sys.stdin:
        request = json.loads(line)
        try:
            answer: Any = _answer(request, held)
        except (PriorfillError, OSError) as error:
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), flush=True)


class _Held:
    """An open database, with its segments mapped, as other programs might map them."""

    def __init__(self, folder: Path) -> None:
        self._database = PriorDatabase.open(folder)
        self._maps = {}
        for number in {record.segment for record in self._database.clips()}:
            with (folder / "segments" / f"{number:06d}.f32").open("rb") as file:
                self._maps[number] = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        self.expected = self.digests()

    def digests(self) -> dict[str, str]:
        """Return a hash of each clip, read from its files, its catalogue, and the maps."""
        found = {}
        for record in self._database.clips():
            self._database.check(record)
            stored = stored_of(self._database, record)
            mapped = self._maps[record.segment][record.offset : record.offset + record.nbytes]
            is_same = mapped == stored.positions
            found[record.name] = stored.digest if is_same else "the mapped bytes differ"
        return found

    def close(self) -> None:
        """Close everything."""
        self._database.close()
        for one in self._maps.values():
            one.close()


def _answer(request: dict[str, str], held: list[_Held]) -> Any:
    if request["do"] == "open":
        held.append(_Held(Path(request["folder"])))
        return held[-1].expected
    if request["do"] == "close":
        for one in held:
            one.close()
        held.clear()
        gc.collect()  # arrays keep files mapped
        return {}
    for number, one in enumerate(held, start=1):
        if (found := one.digests()) != one.expected:
            names = {*found, *one.expected}
            wrong = sorted(name for name in names if found.get(name) != one.expected.get(name))
            return {"error": f"reader {number} of {len(held)} finds other bytes in {wrong}"}
    return {"checked": len(held)}


class Reader:
    """The process, as others see it; a context manager that ends it.

    Parameters
    ----------
    known : dict
        Expected contents of each version, by clip name.
    """

    def __init__(self, known: dict[str, dict[str, Stored]]) -> None:
        self._known = known
        self._is_open = False
        self._process = subprocess.Popen(
            [sys.executable, str(SCRIPT), "--serve-reader"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=dict(os.environ, PYTHONIOENCODING="utf-8"),
            encoding="utf-8",
        )

    def __enter__(self) -> Reader:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()

    def open(self, folder: Path, found: dict[str, str]) -> None:
        """Open a database once more, and keep it open.

        Parameters
        ----------
        folder : Path
            The database.
        found : dict
            The version of each clip in it.

        Raises
        ------
        WrongError
            If the reader finds something else.
        """
        if not (folder / "priorfill-database.json").exists():
            return
        digests = self._ask(do="open", folder=str(folder))
        self._is_open = True
        expected = {name: self._known[name][version].digest for name, version in found.items()}
        if digests != expected:
            raise WrongError(f"a reader finds {sorted(digests)} instead of {sorted(expected)}")

    def check(self) -> int:
        """Return how many states the process reads exactly as when it opened them.

        Raises
        ------
        WrongError
            If one has changed.
        """
        return int(self._ask(do="check")["checked"])

    def close(self) -> bool:
        """Close all databases; return whether there were any."""
        if self._is_open:
            self._ask(do="close")
        self._is_open, was_open = False, self._is_open
        return was_open

    def _ask(self, **request: str) -> Any:
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        if not line:
            raise WrongError(f"the reader has ended with {self._process.wait()}")
        answer = json.loads(line)
        if "error" in answer:
            raise WrongError(f"a reader that was open: {answer['error']}")
        return answer
