"""Variables of MATLAB files (versions 4 to 7), read strictly within bounds.

The readers of other packages crash on damaged files, or take memory for what a header promises.
Here each count is compared with the bytes that are present before memory is taken, so that the
memory needed is a small multiple of the file's unpacked size. Format: MAT-File Format, MathWorks,
R2024a, chapter 1 (versions 5 to 7) and version 4 of it.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import FormatError
from priorfill.formats.arrays.array_files import Unread
from priorfill.formats.arrays.unpacked_size import check_unpacked

__all__ = ["variable_names", "variables"]

_HEADER_BYTES = 128
_ORDER_AT = 126
_ORDERS = {b"IM": "<", b"MI": ">"}
"""Version 5: size of the header; offset of the byte order mark in it, and its values."""

_MATRIX, _COMPRESSED = 14, 15
_INT8, _INT32, _UINT32, _UTF8 = 1, 5, 6, 16
"""Types of data elements. Some programs write shapes as `_UINT32` and names as `_UTF8`."""

_NUMBERS = dict(
    [
        *((1, "i1"), (2, "u1"), (3, "i2"), (4, "u2"), (5, "i4")),
        *((6, "u4"), (7, "f4"), (9, "f8"), (12, "i8"), (13, "u8")),
    ]
)
"""NumPy type of each numeric data element."""

_TEXTS = {1: "latin-1", 2: "latin-1", 4: "utf-16", _UTF8: "utf-8", 17: "utf-16", 18: "utf-32"}
"""Encoding of each data element that holds characters."""

_CELL, _STRUCT, _CHAR = 1, 2, 4
_NUMERIC = range(6, 16)
_OPAQUE = 17
_OTHERS = {
    3: "object",
    5: "sparse matrix",
    16: "function",
    _OPAQUE: "object; make strings char with cellstr",
}
"""Classes of matrices."""

_COMPLEX = 0x0800
"""Flag of a matrix with imaginary parts."""

MAX_DIMENSIONS = 8
"""Maximum number of dimensions; recordings have at most three."""

MAX_DEPTH = 16
"""Maximum nesting of cells and structures; the export of Qualisys has a depth of 5."""

MAX_MATRICES = 200_000
"""Maximum number of cells and fields of a file. Each takes a few hundred bytes of memory, and few
bytes of a file; a recording has one per label and some more."""

MAX_VARIABLES = 10_000
"""Maximum number of variables of a file."""

_TAG = 8
"""Bytes of the tag of a data element; elements are padded to a multiple."""

_CHUNK_BYTES = 1 << 12
"""Packed bytes that are unpacked at once, to at most 4 MB."""

_NAME_BYTES = 4096
"""Bytes at the start of a variable in which its name is."""

_V4_HEADER = 20
_V4_TYPES = ("f8", "f4", "i4", "i2", "u2", "u1")
_V4_BIG_ENDIAN = 1000
_V4_CHARACTERS = 256
"""Version 4: bytes of a variable's header; NumPy types by the digit P of its type; the least type
of a big-endian variable; number of character codes."""


class _DamagedError(Exception):
    """The file is not as the format demands; the message is the reason."""


class _Element(NamedTuple):
    """A data element: its type, its contents, and the offset of the next one."""

    kind: int
    content: memoryview
    end: int


def variables(data: bytes, name: str) -> dict[str, Any]:
    """Return the variables of a file.

    Parameters
    ----------
    data : bytes
        Contents of the file.
    name : str
        The file's name in messages.

    Returns
    -------
    dict
        For each variable an array of numbers; an array of texts (rows of a character matrix); an
        object array of such values (a cell array); a dict (a structure), or an object array of
        dicts; or an `Unread`.

    Raises
    ------
    FormatError
        If the file is damaged, too large, or of another version.
    """
    try:
        return dict(_version4(data) if _is_version4(data) else _version5(data, name))
    except (_DamagedError, ValueError, zlib.error) as error:
        raise _damaged(name, error) from error


def variable_names(data: bytes, name: str) -> tuple[str, ...]:
    """Return the names of the variables of a file; little of it is unpacked.

    Parameters
    ----------
    data : bytes
        Contents of the file.
    name : str
        The file's name in messages.

    Raises
    ------
    FormatError
        If the file is damaged or of another version.
    """
    try:
        if _is_version4(data):
            return tuple(variable for variable, _ in _version4(data))
        reader = _Reader(_order(data))
        names = (reader.name(_head(element)) for element in _top_level(data, reader))
        return tuple(variable for variable in names if variable)
    except (_DamagedError, ValueError, zlib.error) as error:
        raise _damaged(name, error) from error


def _damaged(name: str, error: Exception) -> FormatError:
    reason = "a text is not Unicode" if isinstance(error, UnicodeDecodeError) else error
    return FormatError(f"{name}: cannot be read as a MATLAB file ({reason}); save it again")


def _is_version4(data: bytes) -> bool:
    """Check whether a file is of version 4; the text that opens later ones has no zero byte."""
    return len(data) >= _V4_HEADER and 0 in data[:4]


def _order(data: bytes) -> str:
    """Return the byte order of a file of version 5 to 7."""
    order = _ORDERS.get(data[_ORDER_AT:_HEADER_BYTES])
    if order is None:
        raise _DamagedError("it has no header of version 4 to 7")
    return order


def _version5(data: bytes, name: str) -> Iterator[tuple[str, Any]]:
    """Yield names and values of the variables of a file of version 5 to 7."""
    reader, total = _Reader(_order(data)), 0
    for element in _top_level(data, reader):
        content = _whole(element, total, len(data), name)
        total += len(content)
        if element.kind == _COMPRESSED:
            element = reader.element(content, 0)
            if element.kind != _MATRIX:
                raise _DamagedError("a compressed element holds no variable")
        variable = reader.name(element.content)
        if variable:  # the data of objects and functions has no name
            yield variable, reader.matrix(element.content)


def _top_level(data: bytes, reader: _Reader) -> Iterator[_Element]:
    """Yield the data elements that hold variables, still compressed."""
    view, place, number = memoryview(data), _HEADER_BYTES, 0
    while place < len(view):
        element = reader.element(view, place, padded=False)
        if element.kind not in (_MATRIX, _COMPRESSED):
            raise _DamagedError(f"no variable starts at byte {place}")
        number += 1
        if number > MAX_VARIABLES:
            raise _DamagedError(f"it has more than {MAX_VARIABLES} variables")
        yield element
        place = element.end


def _head(element: _Element) -> memoryview:
    """Return the first bytes of a variable, without its tag."""
    if element.kind == _MATRIX:
        return element.content
    return memoryview(zlib.decompressobj().decompress(element.content, _NAME_BYTES))[_TAG:]


def _whole(element: _Element, total: int, packed: int, name: str) -> memoryview:
    """Return the contents of a top-level element, unpacked.

    Parameters
    ----------
    element : _Element
        The element.
    total, packed : int
        Bytes of the file's variables unpacked before, and of the file.
    name : str
        The file's name in messages.

    Raises
    ------
    FormatError
        If the file unpacks to too much.
    """
    if element.kind == _MATRIX:
        check_unpacked(total + len(element.content), packed, name)
        return element.content
    inflater, parts = zlib.decompressobj(), []
    for start in range(0, len(element.content), _CHUNK_BYTES):
        parts.append(inflater.decompress(element.content[start : start + _CHUNK_BYTES]))
        total += len(parts[-1])
        check_unpacked(total, packed, name)
    if not inflater.eof:
        raise _DamagedError("compressed data end early")
    return memoryview(b"".join(parts))


class _Reader:
    """Reads the matrices of a file of version 5 to 7.

    Parameters
    ----------
    order : str
        Byte order, ``<`` or ``>``.
    """

    def __init__(self, order: str) -> None:
        self._order = order
        self._matrices = 0

    def element(self, view: memoryview, place: int, *, padded: bool = True) -> _Element:
        """Return the data element at an offset; those in a matrix are padded to 8 bytes."""
        if place + _TAG > len(view):
            raise _DamagedError("it ends within a data element")
        kind, size = struct.unpack_from(f"{self._order}II", view, place)
        start = place + _TAG
        if kind >> 16:  # a small element: the size is in the upper half, the contents follow it
            kind, size, start = kind & 0xFFFF, kind >> 16, place + _TAG // 2
            if size > _TAG // 2:
                raise _DamagedError(f"a small data element has {size} bytes")
            return _Element(kind, view[start : start + size], place + _TAG)
        if size > len(view) - start:
            raise _DamagedError(f"a data element of {size} bytes exceeds the file")
        end = start + size
        return _Element(kind, view[start:end], end + -size % _TAG if padded else end)

    def name(self, content: memoryview) -> str:
        """Return the name of a matrix."""
        _, _, name, _ = self._header(content)
        return name

    def _header(self, content: memoryview) -> tuple[int, tuple[int, ...], str, int]:
        """Return class and flags, shape and name of a matrix, and where its contents start."""
        flags = self.element(content, 0)
        if flags.kind != _UINT32 or len(flags.content) != _TAG:
            raise _DamagedError("a variable has no flags")
        (word,) = struct.unpack_from(f"{self._order}I", flags.content)
        if word & 0xFF == _OPAQUE:
            name = self.element(content, flags.end)
            return word, (), _name(name), name.end
        shape = self.element(content, flags.end)
        number, odd = divmod(len(shape.content), 4)
        if shape.kind not in (_INT32, _UINT32) or odd or not 2 <= number <= MAX_DIMENSIONS:
            raise _DamagedError("a variable has no shape")
        sizes = struct.unpack(f"{self._order}{number}i", shape.content)
        if min(sizes) < 0:
            raise _DamagedError(f"a variable has the shape {sizes}")
        name = self.element(content, shape.end)
        return word, sizes, _name(name), name.end

    def matrix(self, content: memoryview, depth: int = 0) -> Any:
        """Return the value of a matrix, as `variables` describes it."""
        self._matrices += 1
        if self._matrices > MAX_MATRICES:
            raise _DamagedError(f"it has more than {MAX_MATRICES} cells and fields")
        if depth > MAX_DEPTH:
            raise _DamagedError(f"cells and structures are nested more than {MAX_DEPTH} deep")
        if not content:
            return np.empty((0, 0))  # an empty cell or field
        flags, shape, _, place = self._header(content)
        kind = flags & 0xFF
        if kind == _CELL:
            return self._cells(content, place, shape, depth)
        if kind == _STRUCT:
            return self._structures(content, place, shape, depth)
        if kind == _CHAR:
            return self._texts(self.element(content, place), shape)
        if kind not in _NUMERIC:
            return Unread(_OTHERS.get(kind, f"class {kind}"))
        return Unread("complex") if flags & _COMPLEX else self._numbers(content, place, shape)

    def _numbers(self, content: memoryview, place: int, shape: tuple[int, ...]) -> NDArray[Any]:
        """Return an array of numbers."""
        element = self.element(content, place)
        if element.kind not in _NUMBERS:
            raise _DamagedError(f"numbers are of the unknown type {element.kind}")
        return _array(element.content, np.dtype(self._order + _NUMBERS[element.kind]), shape)

    def _texts(self, element: _Element, shape: tuple[int, ...]) -> NDArray[Any]:
        """Return the rows of a character matrix."""
        if element.kind not in _TEXTS:
            raise _DamagedError(f"characters are of the unknown type {element.kind}")
        encoding = _TEXTS[element.kind]
        if encoding in ("utf-16", "utf-32"):
            encoding += "-le" if self._order == "<" else "-be"
        return _rows(bytes(element.content).decode(encoding), shape)

    def _cells(
        self, content: memoryview, place: int, shape: tuple[int, ...], depth: int
    ) -> NDArray[np.object_]:
        """Return a cell array."""
        values, _ = self._matrices_at(content, place, math.prod(shape), depth)
        return _objects(values, shape)

    def _structures(
        self, content: memoryview, place: int, shape: tuple[int, ...], depth: int
    ) -> dict[str, Any] | NDArray[np.object_]:
        """Return a structure, or an array of them."""
        length = self.element(content, place)
        names = self.element(content, length.end)
        width = 0
        if length.kind == _INT32 and len(length.content) == 4:
            (width,) = struct.unpack(f"{self._order}i", length.content)
        if width < 1 or names.kind != _INT8 or len(names.content) % width:
            raise _DamagedError("a structure has no field names")
        if len(names.content) > MAX_MATRICES * width:
            raise _DamagedError(f"a structure has more than {MAX_MATRICES} fields")
        raw = bytes(names.content)
        fields = [
            raw[at : at + width].partition(b"\0")[0].decode("latin-1")
            for at in range(0, len(raw), width)
        ]
        number = math.prod(shape)
        if not fields and number > 1:
            raise _DamagedError("an array of structures has no fields")
        values, _ = self._matrices_at(content, names.end, number * len(fields), depth)
        step = len(fields)
        structures = [
            dict(zip(fields, values[at * step : (at + 1) * step], strict=True))
            for at in range(number)
        ]
        return structures[0] if number == 1 else _objects(structures, shape)

    def _matrices_at(
        self, content: memoryview, place: int, number: int, depth: int
    ) -> tuple[list[Any], int]:
        """Return a number of matrices from an offset on, and where they end."""
        if number * _TAG > len(content) - place:
            raise _DamagedError(f"{number} cells or fields exceed the file")
        values = []
        for _ in range(number):
            element = self.element(content, place)
            if element.kind != _MATRIX:
                raise _DamagedError("a cell or field holds no variable")
            values.append(self.matrix(element.content, depth + 1))
            place = element.end
        return values, place


def _name(element: _Element) -> str:
    """Return the name of a matrix."""
    if element.kind not in (_INT8, _UTF8):
        raise _DamagedError("a variable has no name")
    raw = bytes(element.content).partition(b"\0")[0]
    return raw.decode("utf-8" if element.kind == _UTF8 else "latin-1")


def _array(
    content: memoryview | bytes, dtype: np.dtype[Any], shape: tuple[int, ...]
) -> NDArray[Any]:
    """Return an array of numbers that are stored column by column."""
    if len(content) != math.prod(shape) * dtype.itemsize:
        raise _DamagedError(f"{len(content)} bytes hold no {dtype.name} array of shape {shape}")
    return np.frombuffer(content, dtype).reshape(shape, order="F")


def _rows(text: str, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return the rows of a character matrix whose characters are stored column by column."""
    rows, columns = shape if len(shape) == 2 else (-1, 0)
    if rows == 1 and columns:  # the columns may be counted in bytes
        return np.array([text.rstrip()])
    if len(text) != math.prod(shape) or rows < 0:
        raise _DamagedError(f"{len(text)} characters are no text of shape {shape}")
    if not columns:
        return np.array([""])
    return np.array([text[row::rows].rstrip() for row in range(rows)], dtype=str)


def _objects(values: list[Any], shape: tuple[int, ...]) -> NDArray[np.object_]:
    """Return values as an object array of a shape, column by column."""
    array = np.empty(len(values), dtype=object)
    for place, value in enumerate(values):
        array[place] = value
    return array.reshape(shape, order="F")


def _version4(data: bytes) -> Iterator[tuple[str, Any]]:
    """Yield names and values of the variables of a file of version 4."""
    place, number = 0, 0
    while place < len(data):
        number += 1
        if number > MAX_VARIABLES:
            raise _DamagedError(f"it has more than {MAX_VARIABLES} variables")
        if place + _V4_HEADER > len(data):
            raise _DamagedError("it ends within the header of a variable")
        order = "<" if struct.unpack_from("<i", data, place)[0] in range(_V4_BIG_ENDIAN) else ">"
        kind, rows, columns, complex_, length = struct.unpack_from(f"{order}5i", data, place)
        machine, form, text = kind // 1000, kind // 10 % 10, kind % 10
        if machine != (order == ">") or kind // 100 % 10 or form >= len(_V4_TYPES) or text > 2:
            raise _DamagedError(f"the type of a variable is {kind}")
        if min(rows, columns) < 0 or length < 1 or complex_ not in (0, 1):
            raise _DamagedError("the header of a variable is damaged")
        dtype = np.dtype(order + _V4_TYPES[form])
        start = place + _V4_HEADER + length
        size = rows * columns * dtype.itemsize
        place = start + size * (1 + complex_)
        if place > len(data):
            raise _DamagedError("a variable exceeds the file")
        name = data[start - length : start].partition(b"\0")[0].decode("latin-1")
        if complex_ or text == 2:
            yield name, Unread("complex" if complex_ else "sparse matrix")
            continue
        array = _array(data[start : start + size], dtype, (rows, columns))
        yield name, _characters(array) if text else array


def _characters(array: NDArray[Any]) -> NDArray[Any]:
    """Return the rows of a character matrix whose characters are stored as numbers."""
    codes = array.ravel(order="F")
    if not ((codes >= 0) & (codes < _V4_CHARACTERS)).all():
        raise _DamagedError("a text has characters that are no ASCII")
    return _rows(bytes(codes.astype(np.uint8)).decode("latin-1"), array.shape)
