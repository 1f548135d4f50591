"""Lines between markers: as in a body where the set is known, by stiffness elsewhere."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

import numpy as np
import pytest

import priorfill as pf
from priorfill.markers.marker_set import MarkerSet
from priorfill.report.sticks import sticks_of
from priorfill.synthetic import synthesise

QUICK = pf.FillOptions(estimate_errors=False)


@pytest.fixture(scope="module")
def walk() -> pf.Clip:
    """A recording of a walk."""
    return synthesise("walking", seconds=2.0, rate=50.0)


def names(clip: pf.Clip) -> set[frozenset[str]]:
    result = pf.fill(clip, method="linear", options=QUICK)
    return {frozenset(result.clip.labels[one] for one in pair) for pair in sticks_of(result)}


def connected(sticks: list[list[int]], markers: int) -> int:
    """Number of parts into which sticks divide the markers."""
    part = list(range(markers))
    for i, j in sticks:
        part = [part[i] if one == part[j] else one for one in part]
    return len(set(part))


def test_a_known_set_is_joined_as_a_body(walk: pf.Clip) -> None:
    result = pf.fill(walk, method="linear", options=QUICK)
    sticks = sticks_of(result)
    assert connected(sticks, len(walk.labels)) == 1
    segment = result.marker_set.segment
    joined = {
        frozenset(segment[walk.labels[one]] for one in pair)
        for pair in sticks
        if segment[walk.labels[pair[0]]] != segment[walk.labels[pair[1]]]
    }
    for side in ("left", "right"):
        assert frozenset((f"{side}_thigh", f"{side}_shank")) in joined
        assert frozenset((f"{side}_forearm", f"{side}_hand")) in joined
        assert frozenset((f"{side}_hand", "pelvis")) not in joined
    assert frozenset(("left_thigh", "right_thigh")) not in joined
    assert frozenset(("pelvis", "thorax")) in joined


def test_an_elbow_that_stays_at_the_hip_hangs_on_the_arm(walk: pf.Clip) -> None:
    still = np.repeat(walk.positions[:1], 60, axis=0)
    hip, elbow = (walk.labels.index(label) for label in ("RFWT", "RELB"))
    still[:, elbow] = still[:, hip] + [0.0, 0.0, 15.0]
    found = names(replace(walk, positions=still))
    assert frozenset(("RFWT", "RELB")) not in found
    assert any("RELB" in pair and pair & {"RFRM", "RWRA", "RWRB"} for pair in found)


def test_an_unknown_set_is_joined_by_stiffness(walk: pf.Clip) -> None:
    anonymous = replace(walk, labels=tuple(f"M{i:02d}" for i in range(len(walk.labels))))
    result = pf.fill(anonymous, method="linear", options=QUICK)
    sticks = sticks_of(result)
    assert connected(sticks, len(walk.labels)) == 1
    spread = [
        np.linalg.norm(walk.positions[:, i] - walk.positions[:, j], axis=1).std() for i, j in sticks
    ]
    assert np.median(spread) < 10.0
    assert max(spread) < 60.0


def test_an_object_that_moves_by_itself_is_left_alone(walk: pf.Clip) -> None:
    away = np.linspace(0, 3000, walk.frames)[:, None, None] + [[500.0, 900.0, 0.0]]
    together = np.concatenate([walk.positions, walk.positions[:, :1] * 0 + away], axis=1)
    clip = replace(walk, positions=together, labels=(*walk.labels, "ball"))
    assert not any("ball" in pair for pair in names(clip))


def test_markers_that_are_never_seen_together_are_not_joined() -> None:
    positions = np.zeros((40, 2, 3))
    positions[:20, 0], positions[20:, 1] = np.nan, np.nan
    clip = pf.Clip(positions, ("A", "B"), 100.0)
    result = pf.fill(clip, method="linear", gap_filter=pf.GapFilter(("A",)), options=QUICK)
    assert sticks_of(replace(result, clip=clip)) == []


def test_many_markers_are_fast(walk: pf.Clip) -> None:
    rng = np.random.default_rng(0)
    positions = rng.normal(0, 300, (1, 1200, 3)) + rng.normal(0, 1, (60, 1200, 3)).cumsum(axis=0)
    labels = tuple(f"M{i}" for i in range(1200))
    unknown = MarkerSet("discovered", labels, dict(zip(labels, labels, strict=False)), {}, {}, ())
    result = pf.fill(walk, method="linear", options=QUICK)
    result = replace(result, clip=pf.Clip(positions, labels, 100.0), marker_set=unknown)
    before = perf_counter()
    sticks = sticks_of(result)
    assert perf_counter() - before < 10.0
    assert 1100 < len(sticks) < 1200
