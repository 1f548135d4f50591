"""Functions compiled by numba, and their machine code on disk.

numba compiles a function when it is first called with arguments of some types. Its machine code is
kept next to the source or in a folder of the user, and later processes load it by llvmlite, without
numba, whose import takes as long as many a fill. The key of the code holds all it is made from:
the function and those that it calls, constants, types, options, versions and the processor.

Functions return None, a bool, an int or a float. Their arguments are arrays, ints, floats and
tuples of these. They do not allocate arrays, or numba is imported for its memory management. Code
that cannot be kept, or is damaged on disk, is compiled again; `cache_problem` returns why.
"""

from __future__ import annotations

import hashlib
import operator
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, TypeVar, cast

import numpy as np

from priorfill.runtime import code_files
from priorfill.runtime.array_address import array_address
from priorfill.runtime.code_files import CodeKey
from priorfill.runtime.machine_code import Loaded, describe_system, load

__all__ = ["CompiledFunction", "cache_problem", "compiled"]

_Function = TypeVar("_Function", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {
    "nogil": True,
    "error_model": "numpy",
    "no_cfunc_wrapper": True,
    "no_cpython_wrapper": True,
}
"""Options of all functions: no wrappers, as arguments are packed here, and no check of each
division. These lengthen the compilation, for which the user waits."""

_LAYOUT = 0x503
"""Flags of an array: rows or columns are contiguous, it is aligned, and it can be written."""

NUMBERS = "biufc"
"""Kinds of elements of arrays. The code of one structured type could not be told from another's."""

_lock = threading.RLock()


def compiled(**options: Any) -> Callable[[_Function], _Function]:
    """Return a decorator that compiles a function and keeps its code on disk where possible.

    Parameters
    ----------
    **options
        Of `numba.njit`, in addition to those of all functions.
    """

    def decorate(function: _Function) -> _Function:
        made = CompiledFunction(cast(FunctionType, function), {**_OPTIONS, **options})
        return cast(_Function, made)

    return decorate


def cache_problem() -> str:
    """Return why compiled code could not be kept on disk; empty if it could."""
    return code_files.problem()


class CompiledFunction:
    """A function that is compiled, or loaded, when it is first called.

    Parameters
    ----------
    function : function
        Without a closure. Global names are constants, modules, and other compiled functions.
    options : dict
        Of `numba.njit`.

    Attributes
    ----------
    function : function
        As given.
    options : dict
        As given.
    """

    def __init__(self, function: FunctionType, options: dict[str, Any]) -> None:
        self.function, self.options = function, options
        self.__doc__, self.__name__ = function.__doc__, function.__name__
        self.__module__, self.__wrapped__ = function.__module__, function
        self._loaded: dict[Any, Loaded] = {}

    def __call__(self, *arguments: Any) -> Any:
        """Call the function, without the interpreter lock."""
        words: list[Any] = []
        kind = tuple([_unpack(argument, words) for argument in arguments])
        loaded = self._loaded.get(kind)
        if loaded is None:
            loaded = self._prepare(kind, arguments)
        return loaded(words)

    @property
    def digest(self) -> bytes:
        """Hash of the function, of those it calls, and of their constants and options.

        It is computed for each compilation, as constants may have been replaced since the last.
        """
        found = hashlib.sha256()
        for part in _parts(self.function.__code__):
            found.update(part.encode() + b"\n")
        found.update(repr(sorted((name, _stated(v)) for name, v in self.options.items())).encode())
        found.update(_content(self.function.__defaults__))
        for name, value in self.globals_used():
            found.update(name.encode() + b"=" + _content(value))
            if isinstance(value, ModuleType):
                for attribute in _names(self.function.__code__):
                    if attribute in vars(value):
                        found.update(attribute.encode() + b"=" + _content(vars(value)[attribute]))
        return found.digest()

    def globals_used(self) -> Iterator[tuple[str, Any]]:
        """Yield the names and values of the module that the function refers to."""
        known = self.function.__globals__
        for name in _names(self.function.__code__):
            if name in known:
                yield name, known[name]

    def _prepare(self, kind: tuple[Any, ...], arguments: tuple[Any, ...]) -> Loaded:
        """Load the code for arguments of some types, or compile it."""
        with _lock:
            loaded = self._loaded.get(kind)
            if loaded is None:
                loaded = self._loaded[kind] = self._load(arguments)
            return loaded

    def _load(self, arguments: tuple[Any, ...]) -> Loaded:
        types = repr(tuple(_type_name(argument) for argument in arguments))
        code = self.function.__code__
        source = Path(code.co_filename)
        name = f"{source.stem}.{code.co_name}"
        key = CodeKey(source.parent, name, f"{types} {describe_system()}", self.digest)
        kept = code_files.find(key)
        if kept is None:
            from priorfill.runtime.numba_compiler import compile_function  # slow to import

            kept = compile_function(self, _examples(arguments))
            code_files.keep(key, kept)
        return load(kept, _add_symbols)


def _add_symbols() -> None:
    from priorfill.runtime.numba_compiler import add_symbols  # slow to import

    add_symbols()


def _unpack(argument: Any, words: list[Any]) -> Any:
    """Append the words that pass an argument; return what its type depends on.

    An array is passed as two pointers to its owner, which has none here, number and size of its
    elements, address, lengths and strides.
    """
    if isinstance(argument, np.ndarray):
        data = array_address(argument)
        words += (0, 0, argument.size, argument.itemsize, data, *argument.shape, *argument.strides)
        return argument.dtype.str, argument.ndim, argument.flags.num & _LAYOUT
    if isinstance(argument, tuple):
        return tuple([_unpack(item, words) for item in argument])
    words.append(_number(argument))
    return type(words[-1])


def _number(argument: Any) -> int | float:
    if isinstance(argument, float):
        return float(argument)
    return operator.index(argument)  # raises TypeError for what would lose digits


def _examples(argument: Any) -> Any:
    """Return an argument with zeros in place of numbers: numba has other types for large ones."""
    if isinstance(argument, tuple):
        return tuple(_examples(item) for item in argument)
    return argument if isinstance(argument, np.ndarray) else type(_number(argument))()


def _type_name(argument: Any) -> str:
    """Return what numba's type of an argument depends on."""
    if isinstance(argument, tuple):
        return "".join(["(", *map(_type_name, argument), ")"])
    if not isinstance(argument, np.ndarray):
        return "float" if isinstance(argument, float) else "int"
    if argument.dtype.kind not in NUMBERS:
        raise TypeError(f"an array of {argument.dtype} is passed, not of numbers")
    flags = argument.flags
    layout = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
    aligned = "" if flags.aligned else " unaligned"
    writable = "" if flags.writeable else " read-only"
    return f"{argument.dtype.str}{argument.ndim}{layout}{aligned}{writable}"


def _parts(code: CodeType) -> Iterator[str]:
    yield code.co_code.hex()
    yield repr((code.co_name, code.co_argcount, code.co_names, code.co_varnames, code.co_flags))
    for constant in code.co_consts:
        yield from _parts(constant) if isinstance(constant, CodeType) else (repr(constant),)


def _names(code: CodeType) -> Iterator[str]:
    """Yield the names of globals and attributes that a function and those inside it refer to."""
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)


def _content(value: Any) -> bytes:
    """Return the value of a constant, or the name of a module, class or function."""
    if isinstance(value, CompiledFunction):
        return value.digest
    if isinstance(value, tuple):
        return b"".join([b"(", *(_content(item) + b"," for item in value), b")"])
    if isinstance(value, np.ndarray | np.generic):
        return f"{value.dtype.str}{value.shape}".encode() + value.tobytes()
    return (getattr(value, "__name__", None) or repr(value)).encode()


def _stated(option: Any) -> Any:
    return sorted(option) if isinstance(option, set | frozenset) else option
