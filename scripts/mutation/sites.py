"""Where ``scripts/mutation_sample.py`` can plant faults.

A site is one small change of the source by byte offsets; the rest of the file is unchanged.
Docstrings, type hints, decorators, messages, imports, ``__all__`` and defaults that are functions
have no sites.
"""

from __future__ import annotations

import ast
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

from mutation.operators import MODULE, OPERATORS, Place, Source, called

NO_KEYWORD = ("axis", "strict", "dtype", "stacklevel", "maxsize", "max_workers")
"""Keywords whose values are not mutated; `axis` has an operator of its own."""


@dataclass(frozen=True)
class Site:
    """One fault.

    Attributes
    ----------
    path, function : str
        The file, relative to the checkout, and the qualified name of the function in it.
    operator : str
        The mutation operator.
    line : int
        Where the change begins, counted from 1.
    text, after : str
        That source line, stripped, without and with the fault.
    ordinal : int
        Number among the sites with the same path, function, operator and text.
    start, end : int
        Bytes of the file that are replaced.
    new : str
        Their replacement.
    span : tuple of int
        First and last line of the statement.
    names : tuple of str
        The constant, field or compiled function that is changed: tests that execute its readers
        reach the fault. Empty where tests that execute `span` do.
    """

    path: str
    function: str
    operator: str
    line: int
    text: str
    after: str
    ordinal: int
    start: int
    end: int
    new: str
    span: tuple[int, int]
    names: tuple[str, ...]

    @property
    def key(self) -> str:
        """Identifier that depends on the text of the line, not on its number."""
        return "::".join((self.path, self.function, self.operator, self.text, str(self.ordinal)))

    def plant(self, content: bytes) -> bytes:
        """Return the content of the file with the fault."""
        return content[: self.start] + self.new.encode() + content[self.end :]


def is_excluded(node: ast.AST) -> bool:
    """Return whether a node and its parts have no sites."""
    if isinstance(node, (ast.Raise, ast.Import, ast.ImportFrom, ast.JoinedStr)):
        return True
    if isinstance(node, ast.Call):
        return called(node).endswith(("Error", "Warning", "warn"))
    if isinstance(node, ast.If):
        return called(node.test) == "TYPE_CHECKING"
    if isinstance(node, ast.keyword):
        return node.arg in NO_KEYWORD
    if isinstance(node, ast.ClassDef):
        return any("Enum" in called(base) for base in node.bases)
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Constant)  # a docstring
    return isinstance(node, ast.Assign) and "__all__" in map(called, node.targets)


def children(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the parts of a node that may have sites: all but type hints and decorators."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list"):
            continue
        for part in value if isinstance(value, list) else [value]:
            if isinstance(part, ast.arguments):
                defaults = [*part.defaults, *(d for d in part.kw_defaults if d is not None)]
                yield from (d for d in defaults if not isinstance(d, ast.Lambda))
            elif isinstance(part, ast.AST):
                yield part


def header(node: ast.stmt) -> tuple[int, int]:
    """Return the first and last line of a statement, without the statements inside it."""
    assert node.end_lineno is not None
    inside = getattr(node, "body", None) or getattr(node, "cases", None)
    if not inside:
        return node.lineno, node.end_lineno
    first = getattr(inside[0], "lineno", None) or inside[0].pattern.lineno
    return node.lineno, max(node.lineno, first - 1)


def targets(node: ast.AST) -> tuple[str, ...]:
    """Return the names that a statement of a module or class assigns to."""
    found = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
    inside = (part for target in found if target is not None for part in ast.walk(target))
    return tuple(part.id for part in inside if isinstance(part, ast.Name))


def enter(node: ast.AST, place: Place, in_function: bool) -> Place:
    """Return the place of the parts of a node."""
    if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
        prefix = "" if place.function == MODULE else f"{place.function}."
        place = replace(place, function=prefix + node.name, named=False)
        if isinstance(node, ast.FunctionDef):  # of the defaults
            end = node.end_lineno or node.lineno
            place = replace(place, span=(node.body[0].lineno, end), names=())
            if any("jit" in called(decorator) for decorator in node.decorator_list):
                place = replace(place, compiled=node.name)
            if place.compiled:
                place = replace(place, names=(place.compiled,))
    elif isinstance(node, ast.stmt):
        place = replace(place, span=header(node))
        if not in_function:
            names = targets(node)
            place = replace(place, names=names or ("",), named=bool(names))
    return place


def walk(node: ast.AST, place: Place, in_function: bool = False) -> Iterator[tuple[ast.AST, Place]]:
    """Yield the nodes that may have sites, in source order, with their surroundings."""
    if is_excluded(node):
        return
    place = enter(node, place, in_function)
    yield node, place
    for child in children(node):
        # defaults are evaluated outside the function, but matter where it is called
        yield from walk(child, place, in_function or isinstance(node, ast.FunctionDef))


def sites(path: str, content: bytes) -> list[Site]:
    """Return all sites of a file.

    Parameters
    ----------
    path : str
        Path relative to the checkout.
    content : bytes
        Of the file.

    Returns
    -------
    list of Site
        In source order.
    """
    source = Source(content)
    lines = content.splitlines()
    found, counts = [], Counter[tuple[str, str, str]]()
    for node, place in walk(ast.parse(content), Place()):
        if type(node) not in OPERATORS:
            continue
        for operator, start, end, new in OPERATORS[type(node)](node, source, place):
            line = bisect_right(source.starts, start)
            first = source.starts[line - 1]
            text = lines[line - 1].decode().strip()
            rest = content[end:].partition(b"\n")[0]
            after = (content[first:start] + new.encode() + rest).splitlines()[0].decode().strip()
            same = (place.function, operator, text)
            where = (path, place.function, operator, line, text, after, counts[same])
            found.append(Site(*where, start, end, new, place.span, place.names))
            counts[same] += 1
    return found
