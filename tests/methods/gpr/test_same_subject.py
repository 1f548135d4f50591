"""Takes of a database that are of the clip's own subject, recognised by distances of markers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gappy import person, with_gaps

import priorfill as pf
from priorfill.database import PriorDatabase
from priorfill.filling.fill_options import FillOptions
from priorfill.gp.ensemble import Regression, regress
from priorfill.gp.problem import PoseSamples, RegressionProblem
from priorfill.methods.gpr.training.same_subject import body_differences
from priorfill.methods.task import THIS_CLIP

LEG = ("RTHI", "RKNE", "RSHN", "RANK", "RHEE", "RTOE", "RMT5")


def folding(rng: np.random.Generator, poses: int, length: float) -> np.ndarray:
    """Two rigid groups of four markers that move relative to each other, and as a whole."""
    groups = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) * length
    positions = np.concatenate([np.tile(groups, (poses, 1, 1)) for _ in range(2)], axis=1)
    positions[:, 4:] += rng.uniform(300.0, 900.0, (poses, 1, 3))
    return positions + rng.uniform(-1e3, 1e3, (poses, 1, 3))


def test_bodies_are_compared_by_the_distances_that_stay_constant() -> None:
    rng = np.random.default_rng(0)
    own, same = folding(rng, 20, 200.0), folding(rng, 20, 200.0)
    other = folding(rng, 20, 230.0)
    found = body_differences(own, np.concatenate([other, same]), np.repeat([7, 3], 20))
    np.testing.assert_allclose(found[20:], 0.0, atol=1e-9)
    # edges of 200 and 230 mm, diagonals of 283 and 325 mm
    assert (found[:20] > 25.0).all()


def test_a_clip_without_movement_is_compared_by_what_is_constant_in_the_others() -> None:
    rng = np.random.default_rng(1)
    own = np.tile(folding(rng, 1, 200.0), (20, 1, 1))
    found = body_differences(own, folding(rng, 20, 200.0), np.zeros(20, dtype=np.intp))
    np.testing.assert_allclose(found, 0.0, atol=1e-9)


def test_takes_of_the_same_subject_are_recognised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The database has two takes of other people, and one of the clip's own subject."""
    with PriorDatabase.create(tmp_path / "db") as made:
        for body in (11, 0, 12):
            made.add(person(seconds=4.0, rate=30.0, seed=20 + body, body=body))
    seen: list[PoseSamples] = []

    def spy(problems: Sequence[RegressionProblem], *others: Any) -> Regression:
        seen.append(problems[-1].train)
        return regress(problems, *others)

    monkeypatch.setattr("priorfill.methods.gpr.predict.regress", spy)
    clip = with_gaps(person(seconds=2.0, seed=1), (40, 100, LEG))
    dense = FillOptions(method_options={"training.database.gap_share": 1.0})
    pf.fill(clip, database=tmp_path / "db", options=dense)
    (train,) = seen
    assert train.subject is not None and train.correlation is not None
    own = train.correlation == 1.0
    assert (train.subject[own] == THIS_CLIP).all()
    take = [n for n in np.unique(train.recording[own]) if n != THIS_CLIP]
    assert len(take) == 1 and (train.recording == take[0]).sum() == 58  # all of its poses
    others = train.correlation == 0.9
    assert others.any() and THIS_CLIP not in train.subject[others]
