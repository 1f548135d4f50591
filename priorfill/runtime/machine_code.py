"""Machine code loaded by llvmlite, and called with words.

The code of a function is an object file of LLVM, with a function `START` that takes the address of
the arguments, 8 bytes each, and that of the result, and returns 0 unless memory ran out.
"""

from __future__ import annotations

import ctypes
import json
import os
import struct
import sys
from collections.abc import Callable, Sequence
from functools import cache, cached_property
from importlib.metadata import version
from typing import Any

import llvmlite.binding as llvm

from priorfill.runtime.lapack import EXTERNAL

__all__ = ["START", "Loaded", "describe_system", "load", "pack", "undefined_symbols"]

START = "priorfill_start"
"""How names of functions called from Python begin; the rest makes them unique."""

PACKING = 2
"""Number of the way in which code is compiled and packed; code of another one is compiled again."""

_STATUS_NONE = -2
"""What a function of numba returns besides 0 if its result is None."""

_ELF = b"\x7fELF\x02\x01"
"""How object files of 64-bit processors with little-endian numbers begin, on Linux and Windows."""

_SYMBOL = struct.Struct("<IBBHQQ")
"""A symbol of such a file: offset of its name, kind, visibility, section, address, size."""

RESULTS: dict[str, Callable[[Any], Any]] = {
    "none": lambda _: None,
    "bool": lambda word: bool(word.value & 1),
    "int64": lambda word: word.value,
    "float64": lambda word: ctypes.c_double.from_buffer(word).value,
}
"""How results are read, by numba's name of their type."""


def pack(name: str, result: str, words: str, code: bytes) -> bytes:
    """Return what `load` takes.

    Parameters
    ----------
    name : str
        Of the function that is called.
    result : str
        A key of `RESULTS`.
    words : str
        ``q`` for each integer or pointer, ``d`` for each float.
    code : bytes
        An object file.
    """
    return json.dumps([name, result, words, undefined_symbols(code)]).encode() + b"\n" + code


class Loaded:
    """A function in memory.

    Parameters
    ----------
    address : int
        Of the function `START`.
    result, words : str
        As in `pack`.
    """

    def __init__(self, address: int, result: str, words: str) -> None:
        prototype = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_char_p, ctypes.c_void_p)
        self._call = prototype(address)  # without the interpreter lock
        self._pack = struct.Struct(f"={words}").pack
        self._read = RESULTS[result]

    def __call__(self, words: Sequence[Any]) -> Any:
        """Call the function with packed arguments."""
        result = ctypes.c_int64(0)
        if self._call(self._pack(*words), ctypes.addressof(result)) not in (0, _STATUS_NONE):
            raise MemoryError("a compiled function ran out of memory")
        return self._read(result)


def load(packed: bytes, add_symbols: Callable[[], None]) -> Loaded:
    """Load a function that `pack` returned.

    Parameters
    ----------
    packed : bytes
        Complete and unchanged: damaged code may do anything.
    add_symbols : callable
        Makes known to LLVM what code may call in numba; called for code that does.
    """
    head, code = packed.split(b"\n", 1)
    name, result, words, undefined = json.loads(head)
    return Loaded(_engine().load(name, code, undefined, add_symbols), result, words)


def undefined_symbols(code: bytes) -> list[str] | None:
    """Return the names that an object file needs from elsewhere; None if that is unknown."""
    if not code.startswith(_ELF):
        return None
    sections = {section.name(): section.data() for section in _sections(code)}
    names = sections[b".strtab"]
    found = []
    for offset, _, _, section, _, _ in _SYMBOL.iter_unpack(sections[b".symtab"]):
        if section == 0 and offset:
            found.append(names[offset : names.index(b"\0", offset)].decode())
    return found


def _sections(code: bytes) -> Any:
    return llvm.ObjectFileRef.from_data(code).sections()


@cache
def describe_system() -> str:
    """Return what machine code depends on besides its source, as text."""
    versions = [sys.version, *map(version, ("numba", "llvmlite"))]
    processor = [llvm.get_process_triple(), llvm.get_host_cpu_name(), _features()]
    settings = sorted(item for item in os.environ.items() if item[0].startswith("NUMBA_"))
    stated = [item for item in settings if item[0] != "NUMBA_CACHE_DIR"]
    return repr([PACKING, versions, processor, stated])


def _features() -> str:
    try:
        return str(llvm.get_host_cpu_features().flatten())
    except RuntimeError:  # unknown on some systems
        return ""


@cache
def _engine() -> _Engine:
    return _Engine()


class _Engine:
    """Where machine code is loaded to. It stays until the process ends."""

    def __init__(self) -> None:
        if tuple(int(part) for part in version("llvmlite").split(".")[:2]) < (0, 45):
            llvm.initialize()
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        for name, address in self._symbols.items():
            llvm.add_symbol(name, address)
        self._jits: list[Any] = []

    @cached_property
    def _symbols(self) -> dict[str, int]:
        """Addresses of functions that the code calls."""
        addresses = {
            "memset": ctypes.memset,
            "memcpy": ctypes.memmove,
            "memmove": ctypes.memmove,
        }
        return {
            name: ctypes.cast(function, ctypes.c_void_p).value or 0
            for name, function in addresses.items()
        }

    def load(
        self,
        name: str,
        code: bytes,
        undefined: list[str] | None,
        add_symbols: Callable[[], None],
    ) -> int:
        """Return the address of a function."""
        for symbol in EXTERNAL if undefined is None else EXTERNAL.keys() & undefined:
            llvm.add_symbol(symbol, EXTERNAL[symbol].address)
        if undefined is None or not set(undefined) <= self._symbols.keys() | EXTERNAL.keys():
            add_symbols()
        machine = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(jit=True)
        # its own, so that no code calls a function of the same name in other code
        jit = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
        self._jits.append(jit)
        jit.add_object_file(llvm.ObjectFileRef.from_data(code))
        jit.finalize_object()
        return int(jit.get_function_address(name))
