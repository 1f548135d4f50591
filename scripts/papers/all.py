#!/usr/bin/env python
"""All tables and figures of the papers: run every script, and rewrite its output in the page.

    python scripts/papers/all.py [--data DIR] [--database DIR] [--only NAME ...] [--page FILE]

``docs/papers.md`` has a heading for each command, ``### Table 1: `python scripts/papers/NAME.py```,
followed by a block with its output; the text around the blocks is written by hand. A block is
replaced as soon as its script has ended, so that an interrupted run keeps what is done. The block
below ``all.py`` itself counts, for each script, the cells that agree with the paper. Where a script
fails, its block stays as it is, and the exit status is 1.

A command with ``--database DIR`` in its heading needs a large database, which ``--database`` names;
without this option, its block stays as it is. ``--only NAME`` runs some scripts, ``--only`` without
a name none: only the counts are made.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from paper import table_lines
from recordings import add_data_option

from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.runtime.atomic_file import replace_file

SCRIPTS = Path(__file__).resolve().parent

PAGE = SCRIPTS.parents[1] / "docs" / "papers.md"

COUNTS = "all"
"""Script whose block has the counts of the others."""

HEADING = re.compile(r"^### [^\n`]*`python scripts/papers/(\w+)\.py ?([^`\n]*)`$", re.MULTILINE)
"""A heading with a command."""

BLOCK = re.compile(HEADING.pattern + r"\n```\n(.*?)^```$", re.MULTILINE | re.DOTALL)
"""The same, and the block of its output."""

COMPARED = re.compile(r"^(\d+) of (\d+) cells are within", re.MULTILINE)
"""What `paper.Comparison` prints."""

PLACEHOLDER = "DIR"
"""In a heading, the value of ``--database``."""


@dataclass(frozen=True)
class Block:
    """Command and output in the page.

    Attributes
    ----------
    name : str
        Of the script.
    options : str
        In the heading.
    output : str
        In the page.
    """

    name: str
    options: str
    output: str

    @property
    def command(self) -> str:
        """Name and options."""
        return f"{self.name} {self.options}".strip()


def blocks(page: str) -> list[Block]:
    """Return the blocks of a page.

    Raises
    ------
    SystemExit
        If a script has no block, a block no script, or two blocks the same command.
    """
    found = [Block(*groups) for groups in BLOCK.findall(page)]
    scripts = {file.stem for file in SCRIPTS.glob("*.py") if "__main__" in file.read_text("utf-8")}
    headings = Counter(" ".join(words).strip() for words in HEADING.findall(page))
    shown = Counter(block.command for block in found)
    faults = [
        *(f"{name}.py has no heading" for name in scripts - {one.name for one in found}),
        *(f"{one.name}.py does not exist" for one in found if one.name not in scripts),
        *(f"{command} has no block" for command in headings - shown),
        *(f"{command} has two blocks" for command, number in shown.items() if number > 1),
    ]
    if faults:
        raise SystemExit(f"{PAGE.name}: {'; '.join(sorted(faults))}; correct its headings")
    return found


def rewrite(file: Path, command: str, output: str) -> None:
    """Replace the output of a command in a page."""

    def replaced(match: re.Match[str]) -> str:
        block = Block(*match.groups())
        head = match[0].removesuffix(f"{block.output}```")
        return f"{head}{output}```" if block.command == command else match[0]

    page = BLOCK.sub(replaced, file.read_text("utf-8"))
    with replace_file(file, overwrite=True) as temporary:
        temporary.write_text(page, encoding="utf-8", newline="\n")


def run(block: Block, data: Path, database: Path | None) -> str | None:
    """Run a script, and return its output; None if it fails."""
    named = [str(database) if word == PLACEHOLDER else word for word in block.options.split()]
    done = subprocess.run(
        [sys.executable, str(SCRIPTS / f"{block.name}.py"), "--data", str(data), *named],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONIOENCODING": "utf-8"},
        encoding="utf-8",
        check=False,
    )
    text = "\n".join(line.rstrip() for line in done.stdout.strip().splitlines()) + "\n"
    return None if done.returncode or "```" in text else text


def counts(found: Sequence[Block]) -> str:
    """Return a table of the cells that are compared with the papers, by script."""
    rows: list[tuple[str, int, int]] = []
    for block in found:
        pairs = COMPARED.findall(block.output)
        if pairs:
            close, cells = (sum(map(int, numbers)) for numbers in zip(*pairs, strict=True))
            rows.append((block.command, cells, close))
    rows.append(("together", sum(row[1] for row in rows), sum(row[2] for row in rows)))
    columns = ["script", "cells of the paper", "within 10 %", "others"]
    lines = table_lines(columns, [(name, cells, n, cells - n) for name, cells, n in rows])
    return "\n".join(lines) + "\n"


def selected(found: Sequence[Block], only: Sequence[str] | None) -> list[Block]:
    """Return the blocks whose scripts are to be run."""
    names = {name.removesuffix(".py") for name in only or ()}
    if unknown := names - {block.name for block in found}:
        raise SystemExit(f"--only: no script is called {', '.join(sorted(unknown))}")
    return [
        block for block in found if block.name != COUNTS and (only is None or block.name in names)
    ]


def main() -> int:
    """Run the scripts."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    add_data_option(parser)
    parser.add_argument("--database", type=Path, help="large database, for the scripts that use it")
    parser.add_argument("--only", nargs="*", metavar="NAME", help="scripts to run; all by default")
    parser.add_argument("--page", type=Path, default=PAGE, help="page that is rewritten")
    arguments = parser.parse_args()
    if not arguments.page.is_file():
        raise SystemExit(f"{arguments.page}: file not found")
    found = blocks(arguments.page.read_text("utf-8"))
    chosen = selected(found, arguments.only)
    failed = []
    for number, block in enumerate(chosen, 1):
        print(f"[{number}/{len(chosen)}] {block.command}", end=" ", file=sys.stderr, flush=True)
        if PLACEHOLDER in block.options.split() and arguments.database is None:
            print("needs --database; its block stays", file=sys.stderr)
            continue
        begin = time.monotonic()
        output = run(block, arguments.data, arguments.database)
        if output is None:
            failed.append(block.command)
            print("failed; its block stays", file=sys.stderr)
            continue
        rewrite(arguments.page, block.command, output)
        print(f"{time.monotonic() - begin:.0f} s", file=sys.stderr)
    table = counts(blocks(arguments.page.read_text("utf-8")))
    rewrite(arguments.page, COUNTS, table)
    print(table, end="")
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
