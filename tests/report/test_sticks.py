"""Lines between markers: as in a body where the set is known, by stiffness elsewhere."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

import priorfill as pf
from priorfill.markers.marker_set import MarkerSet
from priorfill.report.sticks import MAX_MARKERS, _sticks, sticks_of
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
    two = cast("pf.Result", SimpleNamespace(by_subject=(result, result)))
    count = len(walk.labels)
    assert sticks_of(two) == sticks + [[count + i, count + j] for i, j in sticks]


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


def joined(
    places: object, *, other: object = None, known: bool = False, **segments: list[int]
) -> set[tuple[int, int]]:
    """Sticks of markers at some places, of shape (markers, 3) or (frames, markers, 3)."""
    positions = np.asarray(places, dtype=float)
    if positions.ndim == 2:
        positions = np.repeat(positions[None], 12, axis=0)
    none = np.full(positions.shape[1], -1)
    return set(_sticks(positions, segments, none if other is None else other, known=known))


def test_what_is_too_long_or_changes_too_much_is_not_joined() -> None:
    assert joined([[0, 0, 0], [0, 0, 999]]) == {(0, 1)}
    assert joined([[0, 0, 0], [0, 0, 1001]]) == set()
    apart = np.zeros((20, 2, 3))
    for spread, pairs in ((149.0, {(0, 1)}), (151.0, set())):
        apart[::2, 1, 0], apart[1::2, 1, 0] = 500.0 - spread, 500.0 + spread
        assert joined(apart) == pairs
    apart[:, 1, 0] = 500.0
    for poses, pairs in ((3, {(0, 1)}), (2, set())):
        apart[poses:, 1] = np.nan
        assert joined(apart) == pairs


def test_legs_hang_on_the_trunk_and_not_on_each_other() -> None:
    legs = [[0, 50, 0], [0, -50, 0], [0, 50, -120], [0, -50, -120]]
    assert {(0, 2), (1, 3)} <= joined(legs, other=np.array([1, 0, 3, 2]))
    assert {(0, 1), (2, 3)} <= joined(legs)


def test_segments_are_joined_first_and_closed() -> None:
    square = [[0, 0, 0], [100, 0, 0], [100, 100, 0], [0, 100, 0], [50, 50, 80]]
    lines = {(0, 1), (1, 2), (2, 3), (0, 3)}
    assert lines <= joined(square, thigh=[0, 2, 1, 3])
    assert (0, 2) not in joined(square, thigh=[0, 2, 1, 3])
    assert joined(np.multiply(square, 20), thigh=[0, 1, 2]) == set()  # not of a body
    # a marker of the segment is twice as far away as that of another
    row = [[0, 0, 0], [150, 0, 0], [300, 0, 0]]
    assert joined(row) == {(0, 1), (1, 2)}
    assert (0, 2) in joined(row, known=True, thigh=[0, 2], pelvis=[1])


def test_only_bodies_are_joined() -> None:
    places = np.zeros((1, MAX_MARKERS + 1, 3))
    assert joined(places) == set()


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
