"""Scripts as modules, for tests of them and with them."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"


def load_script(name: str) -> ModuleType:
    """The module of the script ``NAME.py``, in whichever folder of ``scripts`` it is."""
    (place,) = SCRIPTS.rglob(f"{name}.py")
    for folder in (SCRIPTS / "support", place.parent):
        if str(folder) not in sys.path:
            sys.path.insert(0, str(folder))
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, place)
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module  # dataclasses look for it there
        spec.loader.exec_module(module)
    return sys.modules[name]
