"""The modules of the package as text and as syntax trees, for tests of how it is written."""

from __future__ import annotations

import ast
import gc
from functools import cache
from pathlib import Path

import priorfill

__all__ = ["PACKAGE", "modules", "relative", "text_of", "tree_of"]

PACKAGE = Path(priorfill.__file__).parent


@cache
def modules() -> tuple[Path, ...]:
    """All modules of the package."""
    return tuple(sorted(PACKAGE.rglob("*.py")))


def relative(file: Path) -> str:
    """The path of a module below the package."""
    return file.relative_to(PACKAGE).as_posix()


@cache
def text_of(file: Path) -> str:
    """The source of a module."""
    return file.read_text(encoding="utf-8")


def tree_of(file: Path) -> ast.Module:
    """The syntax tree of a module, which no test changes."""
    return _trees()[file]


@cache
def _trees() -> dict[Path, ast.Module]:
    """The trees of all modules: to parse them takes a second."""
    trees = {file: ast.parse(text_of(file)) for file in modules()}
    gc.collect()
    gc.freeze()  # half a million objects, which no gc.collect() need visit
    return trees
