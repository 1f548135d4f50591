"""The mutation operators of ``scripts/mutation_sample.py``.

Each yields the changes that it makes of a node, as bytes to replace and their replacement.
"""

from __future__ import annotations

import ast
import re
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

MODULE = "<module>"

BINARY = {
    ast.Add: ("add-sub", "+", "-"),
    ast.Sub: ("add-sub", "-", "+"),
    ast.Mult: ("mul-div", "*", "/"),
    ast.Div: ("mul-div", "/", "*"),
    ast.BitAnd: ("bit-and-or", "&", "|"),
    ast.BitOr: ("bit-and-or", "|", "&"),
}
COMPARED = {
    ast.Lt: ("<", ("boundary", "<="), ("opposite", ">=")),
    ast.LtE: ("<=", ("boundary", "<"), ("opposite", ">")),
    ast.Gt: (">", ("boundary", ">="), ("opposite", "<=")),
    ast.GtE: (">=", ("boundary", ">"), ("opposite", "<")),
    ast.Eq: ("==", ("opposite", "!=")),
    ast.NotEq: ("!=", ("opposite", "==")),
}
UNARY = {
    ast.USub: ("unary-minus", rb"-\s*"),
    ast.Not: ("not", rb"not\s*"),
    ast.Invert: ("~", rb"~\s*"),
}
_EXCHANGED = {"min": "max", "minimum": "maximum", "argmin": "argmax", "nanmin": "nanmax"}
PAIRS = _EXCHANGED | {other: name for name, other in _EXCHANGED.items()}
DROPPED = ("sqrt", "exp", "log", "abs")
"""Functions of NumPy and `math` that are replaced by their argument."""

NO_STATEMENT = ("progress", "report", "warn", "emit")
"""Calls whose removal changes no number."""


@dataclass(frozen=True)
class Place:
    """The surroundings of a node: function, statement, names (see `Site`)."""

    function: str = MODULE
    span: tuple[int, int] = (1, 1)
    names: tuple[str, ...] = ()
    named: bool = False  # in the value of a constant of the module or of a field
    compiled: str = ""  # name of the compiled function around


class Source:
    """A file's bytes, by line and column."""

    def __init__(self, content: bytes) -> None:
        self.content = content
        self.starts = [0]
        for line in content.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))

    def start(self, node: Any) -> int:
        """Return the first byte of a node."""
        return int(self.starts[node.lineno - 1] + node.col_offset)

    def end(self, node: Any) -> int:
        """Return the byte after a node."""
        return int(self.starts[node.end_lineno - 1] + node.end_col_offset)

    def of(self, node: Any) -> str:
        """Return the source of a node."""
        return self.content[self.start(node) : self.end(node)].decode()

    def token(self, left: Any, right: Any, token: str) -> int:
        """Return where an operator is between two operands; comments do not count."""
        start, end = self.end(left), self.start(right)
        between = re.sub(rb"#[^\n]*", lambda m: b" " * len(m[0]), self.content[start:end])
        return start + between.index(token.encode())


Edit = tuple[str, int, int, str]
"""Operator, first byte, byte after the last, replacement."""


def called(node: ast.AST) -> str:
    """Return the last part of the name of a called function or a decorator."""
    if isinstance(node, ast.Call):
        node = node.func
    return str(getattr(node, "attr", getattr(node, "id", "")))


def is_text(node: ast.AST) -> bool:
    """Return whether an operand is a string, a list, tuple, set or dict display, or None."""
    if isinstance(node, ast.Constant):
        return not isinstance(node.value, (int, float))
    return isinstance(node, (ast.JoinedStr, ast.List, ast.Tuple, ast.Set, ast.Dict))


def binary(node: ast.BinOp, source: Source, place: Place) -> Iterator[Edit]:
    """Exchange + and -, * and /, & and |; remove an exponent."""
    if is_text(node.left) or is_text(node.right):
        return
    if isinstance(node.op, ast.Pow):
        yield "power", source.token(node.left, node.right, "**"), source.end(node), ""
    elif type(node.op) in BINARY:
        operator, old, new = BINARY[type(node.op)]
        at = source.token(node.left, node.right, old)
        yield operator, at, at + len(old), new


def augmented(node: ast.AugAssign, source: Source, place: Place) -> Iterator[Edit]:
    """Exchange the operator of an augmented assignment; remove the statement."""
    if type(node.op) in BINARY and not is_text(node.value):
        operator, old, new = BINARY[type(node.op)]
        at = source.token(node.target, node.value, f"{old}=")
        yield operator, at, at + len(old), new
    yield "drop-statement", source.start(node), source.end(node), "pass"


def unary(node: ast.UnaryOp, source: Source, place: Place) -> Iterator[Edit]:
    """Remove a minus sign, `not` or ~."""
    if type(node.op) in UNARY:
        operator, token = UNARY[type(node.op)]
        start = source.start(node)
        found = re.compile(token).match(source.content, start)
        assert found is not None
        yield operator, start, found.end(), ""


def compare(node: ast.Compare, source: Source, place: Place) -> Iterator[Edit]:
    """Include or exclude the bound of a comparison; negate the comparison."""
    left = node.left
    for op, right in zip(node.ops, node.comparators, strict=True):
        if type(op) in COMPARED:
            old, *others = COMPARED[type(op)]
            at = source.token(left, right, old)
            for operator, new in others:
                yield operator, at, at + len(old), new
        left = right


def boolean(node: ast.BoolOp, source: Source, place: Place) -> Iterator[Edit]:
    """Exchange `and` and `or`."""
    old, new = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
    for left, right in zip(node.values, node.values[1:], strict=False):
        at = source.token(left, right, old)
        yield "and-or", at, at + len(old), new


def call(node: ast.Call, source: Source, place: Place) -> Iterator[Edit]:
    """Replace a call by its argument; exchange the choices of `np.where`, min and max, axes."""
    name = called(node)
    whole = isinstance(node.func, ast.Attribute)  # np.sqrt, not a sqrt of the module's own
    if whole and name in DROPPED and len(node.args) == 1 and not node.keywords:
        yield "drop-call", source.start(node), source.end(node.func), ""
    if name == "where" and len(node.args) == 3:
        _, first, second = node.args
        if source.of(first) != source.of(second):
            between = source.content[source.end(first) : source.start(second)].decode()
            swapped = source.of(second) + between + source.of(first)
            yield "where-swap", source.start(first), source.end(second), swapped
    if isinstance(node.func, ast.Name) and name in PAIRS:
        yield "min-max", source.start(node.func), source.end(node.func), PAIRS[name]
    for keyword in node.keywords:
        if keyword.arg == "axis" and isinstance(keyword.value, ast.Constant):
            value = keyword.value
            if value.value in (0, 1):
                yield "axis", source.start(value), source.end(value), str(1 - int(value.value))


def attribute(node: ast.Attribute, source: Source, place: Place) -> Iterator[Edit]:
    """Exchange minimum and maximum."""
    if node.attr in PAIRS:
        end = source.end(node)
        yield "min-max", end - len(node.attr), end, PAIRS[node.attr]


def constant(node: ast.Constant, source: Source, place: Place) -> Iterator[Edit]:
    """Change a number: a named constant to its double or half, others to 2c or c + 1."""
    value = node.value
    start, end = source.start(node), source.end(node)
    if isinstance(value, bool):
        yield "true-false", start, end, str(not value)
    elif isinstance(value, (int, float)):
        if place.named:
            yield "constant", start, end, repr(doubled_or_halved(value, place.names[0]))
        else:
            new = value * 2 if isinstance(value, float) and value else value + 1
            yield "number", start, end, repr(new)


def doubled_or_halved(value: float, name: str) -> float:
    """Change the number of a named constant; its name decides the direction."""
    if value == 0:
        return value + 1
    if zlib.crc32(name.encode()) % 2 == 0:
        return value * 2
    if isinstance(value, float):
        return value / 2
    return value // 2 if value > 1 else value * 2


def sliced(node: ast.Slice, source: Source, place: Place) -> Iterator[Edit]:
    """Exchange [1:] and [:-1]."""
    text = source.of(node).replace(" ", "")
    if text in ("1:", ":-1"):
        yield "slice", source.start(node), source.end(node), ":-1" if text == "1:" else "1:"


def statement(node: ast.Expr, source: Source, place: Place) -> Iterator[Edit]:
    """Remove a call that is a statement."""
    if isinstance(node.value, ast.Call) and called(node.value) not in NO_STATEMENT:
        yield "drop-statement", source.start(node), source.end(node), "pass"


def stored(node: ast.Assign, source: Source, place: Place) -> Iterator[Edit]:
    """Remove an assignment to elements of an array."""
    if all(isinstance(target, ast.Subscript) for target in node.targets):
        yield "drop-statement", source.start(node), source.end(node), "pass"


OPERATORS: dict[type, Callable[[Any, Source, Place], Iterator[Edit]]] = {
    ast.BinOp: binary,
    ast.AugAssign: augmented,
    ast.UnaryOp: unary,
    ast.Compare: compare,
    ast.BoolOp: boolean,
    ast.Call: call,
    ast.Attribute: attribute,
    ast.Constant: constant,
    ast.Slice: sliced,
    ast.Expr: statement,
    ast.Assign: stored,
}
