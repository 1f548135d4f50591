"""``priorfill methods``."""

from __future__ import annotations

import json

from click.testing import CliRunner

from priorfill.cli import main
from priorfill.methods import METHODS


def test_methods() -> None:
    result = CliRunner().invoke(main, ["methods"])
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert lines[0].split() == ["method", "what", "it", "does", "source"]
    assert [line.split()[0] for line in lines[1:-1]] == list(METHODS)
    assert lines[-1] == "auto is gpr."


def test_methods_as_json() -> None:
    listed = json.loads(CliRunner().invoke(main, ["methods", "--json"]).stdout)
    assert listed["linear"] == {"summary": "straight lines over time", "source": "SciPy"}
    assert list(listed) == list(METHODS)
