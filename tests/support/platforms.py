"""What tests ask about the operating system."""

from __future__ import annotations

import ctypes
import sys

WINDOWS = sys.platform == "win32"


def on_wine() -> bool:
    """Return whether this Windows is wine, whose own failures are no failures of priorfill.

    A test that wine fails and Windows passes is skipped with the reason:
    ``@pytest.mark.skipif(on_wine(), reason="wine shows no symbolic link as one")``.
    """
    if sys.platform != "win32":
        return False
    return hasattr(ctypes.WinDLL("ntdll"), "wine_get_version")  # no version of Windows has it
