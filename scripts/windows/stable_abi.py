"""The library that packages for every version of Python are linked to, such as psutil.

No package of PyPI contains it. Each of its functions is that of the same name in the library of
Python itself.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from commands import run
from complex_functions import MINGW, exported_names

__all__ = ["build_stable_abi"]


def build_stable_abi(library: Path) -> None:
    """Write ``python3.dll`` next to the library of a version of Python, and forward to that."""
    lines = [f' "{name}" = "{library.stem}.{name}"' for name in exported_names(library)]
    with tempfile.TemporaryDirectory() as folder:
        definitions = Path(folder) / "python3.def"
        definitions.write_text("\n".join(["LIBRARY python3.dll", "EXPORTS", *lines, ""]), "utf-8")
        code = Path(folder) / "python3.c"
        code.touch()
        output = library.with_name("python3.dll")
        run(
            [MINGW + "gcc", "-shared", "-o", output, code, definitions],
            "python3.dll could not be built",
        )
