"""A Windows without the C++ library that numba and ezc3d need."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from priorfill.cli import main

MESSAGE = """Numba could not be imported.
If you are seeing this message ...
The original error was: 'DLL load failed while importing _typeconv: The specified module ...'
"""


@pytest.mark.parametrize(
    "error", [MESSAGE, "DLL load failed while importing _ezc3d: Das angegebene Modul ..."]
)
def test_the_remedy_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: str) -> None:
    def fail(*arguments: object, **options: object) -> None:
        raise ImportError(error)

    monkeypatch.setattr("priorfill.filling.fill_clip.fill", fail)
    result = CliRunner().invoke(main, ["demo", "--output", str(tmp_path)])
    assert result.exit_code == 1
    assert result.stderr == (
        "priorfill: numba and ezc3d need Microsoft's Visual C++ Redistributable (x64), which is "
        "missing; install it: winget install Microsoft.VCRedist.2015+.x64\n"
    )
