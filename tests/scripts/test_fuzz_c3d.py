"""A few of scripts/checks/fuzz_c3d.py: damaged files are filled, or refused in one line."""

from __future__ import annotations

from collections import Counter

import pytest
from scripted import load_script

from priorfill.errors import FormatError

fuzz = load_script("fuzz_c3d")
SECONDS = load_script("fuzzing").SECONDS


class ShoutingError(FormatError):
    """An error whose message has several lines."""

    def __str__(self) -> str:
        return str(self.args[0])


FEW = 40
"""Damaged files in a test; the script alone takes tens of thousands."""


def test_damaged_files(tmp_path):
    ends: Counter[str] = Counter()
    for number in range(FEW):
        end, seconds = fuzz.run_case(fuzz.Case(7, number, str(tmp_path)))
        ends[end.partition(":")[0]] += 1
        assert seconds < SECONDS
    assert ends["filled"] > FEW / 10
    assert ends["refused"] > FEW / 10


def test_whole_files_are_filled(tmp_path, monkeypatch):
    """What is damaged must be right before, or nothing is tested."""
    for number, content in enumerate(fuzz.fixtures()):
        monkeypatch.setattr(fuzz, "mutate", lambda seed, number, content=content: content)
        end, _ = fuzz.run_case(fuzz.Case(0, number, str(tmp_path)))
        assert not end.startswith("refused"), number


def test_a_seed_makes_the_same_files():
    files = [fuzz.mutate(3, number) for number in range(30)]
    assert files == [fuzz.mutate(3, number) for number in range(30)]
    assert len(set(files) - set(fuzz.fixtures())) > 20  # not every mutation changes something


@pytest.mark.parametrize(
    ("fault", "expected"),
    [(ValueError("x"), ValueError), (ShoutingError("in.c3d: two\nlines"), AssertionError)],
)
def test_faults_are_seen(tmp_path, monkeypatch, fault, expected):
    def read(path):
        raise fault

    monkeypatch.setattr(fuzz, "read", read)
    with pytest.raises(expected):
        fuzz.run_case(fuzz.Case(1, 1, str(tmp_path)))


def test_what_is_left_behind_is_seen(tmp_path, monkeypatch):
    def read(path):
        (path.parent / ".out.part.c3d").write_bytes(b"")
        raise FormatError("in.c3d: is bad; export it again")

    monkeypatch.setattr(fuzz, "read", read)
    with pytest.raises(AssertionError, match="left behind"):
        fuzz.run_case(fuzz.Case(1, 1, str(tmp_path)))
