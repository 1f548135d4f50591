"""A C runtime for wine with the complex functions that numpy needs.

Debian 12's wine lists the C99 complex functions of ucrtbase.dll but implements none of them. The
library built here has them from mingw and forwards everything else to wine's own.
"""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

from commands import run

__all__ = ["build_ucrtbase", "exported_names"]

WINE_LIBRARY = Path("/usr/lib/x86_64-linux-gnu/wine/x86_64-windows/ucrtbase.dll")

MINGW = "x86_64-w64-mingw32-"

BUILTIN_MARK = slice(0x40, 0x50)
"""Bytes by which wine recognises a library as its own, and loads that instead of a file."""

COMPLEX = ("acos", "acosh", "asin", "asinh", "atan", "atanh", "cos", "cosh", "exp", "log", "sin",
           "sinh", "sqrt", "tan", "tanh", "conj", "proj")  # fmt: skip
"""Functions of a complex number that return one; the C name has a c in front, where it has none."""

REAL = ("cabs", "carg", "cimag", "creal")
"""Functions of a complex number that return a real one."""

# Windows passes complex numbers as structures, mingw as C99 does
PREAMBLE = """
#include <complex.h>
#include <math.h>
typedef struct { double v[2]; } Double;
typedef struct { float v[2]; } Float;
static double _Complex in(Double x) { double _Complex z; __real__ z = x.v[0]; __imag__ z = x.v[1]; return z; }
static Double out(double _Complex z) { Double x = {{ __real__ z, __imag__ z }}; return x; }
static float _Complex inf(Float x) { float _Complex z; __real__ z = x.v[0]; __imag__ z = x.v[1]; return z; }
static Float outf(float _Complex z) { Float x = {{ __real__ z, __imag__ z }}; return x; }
"""  # noqa: E501


def build_ucrtbase(folder: Path) -> None:
    """Write ``ucrtbase.dll`` and ``ucrtwine.dll``, which it forwards to, into a folder."""
    source, own = _functions()
    exports = [
        f" {name} = own_{name}" if name in own else f' "{name}" = "ucrtwine.{name}"'
        for name in exported_names(WINE_LIBRARY)
    ]
    definitions = "\n".join(["LIBRARY ucrtbase.dll", "EXPORTS", *exports, ""])
    (folder / "ucrtbase.def").write_text(definitions)
    (folder / "ucrtbase.c").write_text(source)
    run(
        [
            MINGW + "gcc", "-shared", "-O2", "-static-libgcc", "-o", "ucrtbase.dll",
            "ucrtbase.c", "ucrtbase.def",
        ],
        "the C runtime for wine could not be built",
        folder=folder,
    )  # fmt: skip
    library = bytearray(WINE_LIBRARY.read_bytes())
    library[BUILTIN_MARK] = bytes(16)
    (folder / "ucrtwine.dll").write_bytes(library)


def exported_names(library: Path) -> list[str]:
    """Return the names that a DLL exports."""
    dump = subprocess.run(
        [MINGW + "objdump", "-p", library], check=True, capture_output=True, text=True
    ).stdout
    table = dump.partition("[Ordinal/Name Pointer] Table")[2].partition("\n\n")[0]
    return re.findall(r"\]\s+(\S+)$", table, re.MULTILINE)


def _functions() -> tuple[str, set[str]]:
    """Return C code of the complex functions, and their names."""
    lines, names = [PREAMBLE], set()

    def define(name: str, result: str, parameters: str, value: str) -> None:
        names.add(name)
        lines.append(f"{result} own_{name}({parameters}) {{ return {value}; }}")

    for base in COMPLEX:
        name = base if base == "conj" else f"c{base}"
        for kind in ("", "l"):  # on Windows, long double is double
            define(name + kind, "Double", "Double x", f"out({name}(in(x)))")
        define(name + "f", "Float", "Float x", f"outf({name}f(inf(x)))")
    for name in REAL:
        for kind in ("", "l"):
            define(name + kind, "double", "Double x", f"{name}(in(x))")
        define(name + "f", "float", "Float x", f"{name}f(inf(x))")
    for kind in ("", "l"):
        define("clog10" + kind, "Double", "Double x", "out(clog(in(x)) / log(10.0))")
        define("cpow" + kind, "Double", "Double x, Double y", "out(cpow(in(x), in(y)))")
    define("clog10f", "Float", "Float x", "outf(clogf(inf(x)) / logf(10.0f))")
    define("cpowf", "Float", "Float x, Float y", "outf(cpowf(inf(x), inf(y)))")
    return "\n".join([*lines, ""]), names
