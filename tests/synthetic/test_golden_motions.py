"""Synthetic recordings are those that were stored: see scripts/golden_motions.py."""

from __future__ import annotations

import pytest
from scripted import load_script

golden = load_script("golden_motions")


@pytest.mark.parametrize("name", golden.names())
def test_motions_are_reproduced(name: str) -> None:
    away = golden.difference(golden.samples(name), golden.stored_samples().get(name))
    assert away <= golden.MILLIMETRES, (
        f"{name} differs by {away:.3f} mm; if that is meant, store it: "
        "python scripts/golden_motions.py --write"
    )


def test_a_difference_is_seen() -> None:
    stored = golden.stored_samples()["walking plain"]
    changed = [stored[0] + 2.0 * golden.MILLIMETRES, *stored[1:]]
    assert golden.difference(changed, stored) > golden.MILLIMETRES
    assert golden.difference(stored, None) > golden.MILLIMETRES
