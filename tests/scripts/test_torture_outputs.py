"""A few rounds of scripts/checks/torture_outputs.py: no output is lost."""

from __future__ import annotations

from pathlib import Path

import pytest
from scripted import load_script

ROUNDS = 2


@pytest.mark.parametrize("kind", ["fill", "review", "evaluate"])
def test_no_output_is_lost(in_memory: Path, kind: str) -> None:
    script = load_script("torture_outputs")
    work = in_memory / kind
    work.mkdir()
    with script.Outputs(work, seed=1) as outputs:
        outputs.run(kind, ROUNDS)
    (row,) = outputs.rows
    assert (row.faults, row.rounds) == ([], ROUNDS)
    assert row.killed > 0


def test_losses_are_noticed(in_memory: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file that lacks its last byte is neither the old nor the new one."""
    script = load_script("torture_outputs")
    work = in_memory / "cut"
    work.mkdir()
    finished = script.contents

    def cut(folder: Path) -> dict[str, bytes]:
        return {name: data[:-1] for name, data in finished(folder).items()}

    with script.Outputs(work, seed=1) as outputs:
        calls = iter([finished, finished, cut])
        monkeypatch.setattr(script, "contents", lambda folder: next(calls, finished)(folder))
        outputs.run("fill", 1)
    (row,) = outputs.rows
    assert "neither the old nor the new" in row.faults[0]
