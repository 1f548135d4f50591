"""Artefacts: which are found, which are not, and what is rejected."""

from __future__ import annotations

from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from gappy import person, with_gaps
from hypothesis import given, settings
from hypothesis import strategies as st
from naive import half_third_differences, marker_distances

import priorfill as pf
from priorfill.artefacts import (
    KINDS,
    Artefact,
    ArtefactOptions,
    artefact_samples,
    find_artefacts,
    without_artefacts,
)
from priorfill.artefacts.discontinuities import (
    BreakOptions,
    find_breaks,
    path_steps,
    relative_step_sizes,
)
from priorfill.artefacts.distance_outliers import _too_far, distance_outliers
from priorfill.artefacts.label_swaps import find_label_swaps, swap_labels
from priorfill.artefacts.marker_path import (
    MarkerPath,
    OutlierRunOptions,
    PathSegment,
    TypicalDistances,
    cut_path,
    known_medians,
    medians_of_parts,
)
from priorfill.artefacts.mislabelled import find_mislabelled
from priorfill.artefacts.outlier_runs import is_wrong_side
from priorfill.artefacts.reference_markers import (
    ReferenceMarkers,
    choose_reference_markers,
    distances,
)
from priorfill.artefacts.spikes import _returns
from priorfill.artefacts.stuck import StuckOptions, find_stuck
from priorfill.clip import Clip
from priorfill.errors import OptionError

RATE = 120.0
CLEAN = person(rate=RATE, seconds=2.5)
FRAMES = CLEAN.frames
REFERENCES = choose_reference_markers(CLEAN.positions)


def column(*labels: str) -> list[int]:
    return [CLEAN.labels.index(label) for label in labels]


def displace(label: str, start: int, stop: int, by: np.ndarray | tuple[float, ...]) -> Clip:
    """The clean clip with a marker displaced in some frames."""
    positions = CLEAN.positions.copy()
    positions[start:stop, column(label)] += np.asarray(by, dtype=float)
    return CLEAN.with_positions(positions)


def swap(one: str, other: str, start: int, stop: int) -> Clip:
    positions = CLEAN.positions.copy()
    positions[start:stop, column(one, other)] = positions[start:stop, column(other, one)]
    return CLEAN.with_positions(positions)


def hold(label: str, start: int, stop: int) -> Clip:
    positions = CLEAN.positions.copy()
    positions[start:stop, column(label)] = positions[start, column(label)]
    return CLEAN.with_positions(positions)


def mislabel(label: str, other: str, start: int) -> Clip:
    positions = CLEAN.positions.copy()
    positions[start:, column(label)] = positions[start:, column(other)]
    positions[start:, column(other)] = np.nan
    return CLEAN.with_positions(positions)


def found_in(clip: Clip) -> list[tuple[str, tuple[str, ...], int, int]]:
    return [(one.kind, one.markers, one.start, one.stop) for one in find_artefacts(clip)]


def turned(clip: Clip) -> Clip:
    """The clip in another place and orientation."""
    turn, _ = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))
    return clip.with_positions(clip.positions @ turn + [300.0, -4000.0, 70.0])


AFFECTED = {
    "spike": displace("LWRA", 100, 103, (0, 60, 0)),
    "jump": displace("LKNE", 100, 160, (150, 0, 90)),
    "label swap": swap("LWRA", "LWRB", 120, 200),
    "stuck": hold("RTOE", 100, 120),
    "mislabelled": mislabel("RFIN", "RWRA", 250),
}


# ---- detection ----------------------------------------------------------------------------


@pytest.mark.parametrize("motion", ["running", "squatting"])
def test_a_clean_clip_gives_nothing(motion: str) -> None:
    clip = person(motion, rate=RATE, seconds=2.0)
    assert find_artefacts(clip) == ()
    gaps = with_gaps(clip, (30, 60, ("LWRA", "LWRB", "LFIN")), (0, 5, ("C7",)))
    assert find_artefacts(gaps) == ()


def test_each_kind_is_found_where_it_is() -> None:
    assert found_in(AFFECTED["spike"]) == [("spike", ("LWRA",), 100, 103)]
    assert found_in(AFFECTED["jump"]) == [("jump", ("LKNE",), 100, 160)]
    assert found_in(AFFECTED["label swap"]) == [("label swap", ("LWRA", "LWRB"), 120, 200)]
    assert found_in(AFFECTED["stuck"]) == [("stuck", ("RTOE",), 100, 120)]
    assert found_in(AFFECTED["mislabelled"]) == [("mislabelled", ("RFIN",), 250, FRAMES)]
    assert set(AFFECTED) == set(KINDS)


def test_evidence_has_figures() -> None:
    (spike,) = find_artefacts(AFFECTED["spike"])
    own, other = column("LWRA", spike.reference_marker)
    length = np.linalg.norm(CLEAN.positions[:, own] - CLEAN.positions[:, other], axis=1)
    assert spike.typical_distance == pytest.approx(np.median(length), abs=1.0)
    assert abs(spike.distance - spike.typical_distance) > 5 * spike.spread
    assert spike.evidence.startswith(
        f"LWRA-{spike.reference_marker} {spike.distance:.0f} mm, usually "
    )
    assert spike.size == pytest.approx(60, abs=5)
    (swap,) = find_artefacts(AFFECTED["label swap"])
    apart = np.linalg.norm(np.diff(CLEAN.positions[120, column("LWRA", "LWRB")], axis=0))
    assert swap.size == pytest.approx(apart, abs=10)
    (mislabelled,) = find_artefacts(AFFECTED["mislabelled"])
    assert mislabelled.reference_marker == "RWRA"
    assert "continues the path of RWRA" in mislabelled.evidence
    (frozen,) = find_artefacts(AFFECTED["stuck"])
    assert frozen.evidence == (
        f"exactly the same place while {frozen.reference_marker} moves by {frozen.size:.0f} mm"
    )


def test_labels_swapped_to_the_end_give_the_shorter_part() -> None:
    assert found_in(swap("LKNE", "RKNE", 250, FRAMES)) == [
        ("label swap", ("LKNE", "RKNE"), 250, FRAMES)
    ]
    assert found_in(swap("LKNE", "RKNE", 100, FRAMES)) == [("label swap", ("LKNE", "RKNE"), 0, 100)]


def test_each_spike_of_a_marker_begins_at_its_own_break() -> None:
    positions = displace("LWRA", 100, 103, (0, 60, 0)).positions.copy()
    positions[200:204, column("LWRA")] += [0, 0, 80.0]
    assert found_in(CLEAN.with_positions(positions)) == [
        ("spike", ("LWRA",), 100, 103),
        ("spike", ("LWRA",), 200, 204),
    ]


def test_a_swap_that_hides_a_spike_hides_nothing() -> None:
    positions = swap("LWRA", "LWRB", 120, 200).positions.copy()
    positions[150, column("LWRA")] += [0, 0, 90]  # where LWRB is
    assert set(found_in(CLEAN.with_positions(positions))) == {
        ("label swap", ("LWRA", "LWRB"), 120, 200),
        ("spike", ("LWRB",), 150, 151),
    }


def test_a_wrong_marker_between_gaps_is_found_by_its_distances() -> None:
    clip = displace("LKNE", 65, 110, (400, 0, 0))
    clip = with_gaps(clip, (60, 65, ("LKNE",)), (110, 115, ("LKNE",)))
    assert found_in(clip) == [("jump", ("LKNE",), 65, 110)]


def test_a_marker_that_leaves_smoothly_is_found_where_it_is_too_far() -> None:
    bump = 1500 * np.sin(np.pi * np.arange(80) / 80)[:, None] ** 2 * [0, 0, 1.0]
    positions = CLEAN.positions.copy()
    positions[100:180, column("RTOE")[0]] += bump
    clip = CLEAN.with_positions(positions)
    samples = artefact_samples(find_artefacts(clip), clip.labels, clip.frames)
    assert samples[125:155, column("RTOE")[0]].all()
    others = np.delete(samples, column("RTOE"), axis=1)
    assert not others.any()


def test_standing_still_is_no_artefact() -> None:
    still = CLEAN.with_positions(np.repeat(CLEAN.positions[:1], FRAMES, axis=0))
    assert find_artefacts(still) == ()
    # all markers stop at once, as in a replay
    halted = CLEAN.positions.copy()
    halted[100:130] = halted[100]
    halted[130:] = halted[100:-30]
    found = find_artefacts(CLEAN.with_positions(halted))
    assert all(one.kind != "stuck" for one in found)


def test_a_path_that_turns_in_a_frame_is_no_spike() -> None:
    positions = CLEAN.positions.copy()
    there_and_back = 18.0 * np.concatenate([np.arange(7), np.arange(5, 0, -1)])
    positions[150:162, column("LWRA")[0], 2] += there_and_back
    assert find_artefacts(CLEAN.with_positions(positions)) == ()
    # now its tip is a spike, and so are the frames that lead to it
    positions[156, column("LWRA")[0], 2] += 60.0
    ((kind, markers, start, stop),) = found_in(CLEAN.with_positions(positions))
    assert (kind, markers) == ("spike", ("LWRA",))
    assert 150 <= start <= 156 < stop <= 162


def test_a_hit_of_a_whole_segment_is_no_artefact() -> None:
    positions = CLEAN.positions.copy()
    foot = column("RANK", "RHEE", "RTOE", "RMT5")
    positions[150:156, foot] += [0, 0, 25.0]
    assert find_artefacts(CLEAN.with_positions(positions)) == ()


@pytest.mark.parametrize("frames", [1, 2, 3, 5])
@pytest.mark.parametrize("markers", [1, 2, 3])
def test_the_smallest_clips(frames: int, markers: int) -> None:
    clip = Clip(CLEAN.positions[:frames, :markers], CLEAN.labels[:markers], RATE)
    assert find_artefacts(clip) == ()
    gone = Clip(np.full((frames, markers, 3), np.nan), CLEAN.labels[:markers], RATE)
    assert find_artefacts(gone) == ()


# ---- invariances ---------------------------------------------------------------


@pytest.mark.parametrize("kind", AFFECTED)
def test_place_and_orientation_make_no_difference(kind: str) -> None:
    assert found_in(turned(AFFECTED[kind])) == found_in(AFFECTED[kind])


@pytest.mark.parametrize("kind", AFFECTED)
def test_the_direction_of_time_makes_no_difference(kind: str) -> None:
    clip = AFFECTED[kind]
    back = found_in(clip.with_positions(clip.positions[::-1]))
    assert back == [(k, m, FRAMES - stop, FRAMES - start) for k, m, start, stop in found_in(clip)]


@given(seed=st.integers(0, 2**16), kind=st.sampled_from(sorted(AFFECTED)))
@settings(max_examples=8, deadline=None)
def test_the_order_of_the_markers_makes_no_difference(seed: int, kind: str) -> None:
    clip = AFFECTED[kind]
    order = np.random.default_rng(seed).permutation(len(clip.labels))
    mixed = Clip(clip.positions[:, order], tuple(clip.labels[i] for i in order), clip.rate)
    assert [(k, frozenset(m), *part) for k, m, *part in found_in(mixed)] == [
        (k, frozenset(m), *part) for k, m, *part in found_in(clip)
    ]


@given(
    seed=st.integers(0, 2**16),
    size=st.floats(60, 800),
    length=st.integers(1, 10),
)
@settings(max_examples=10, deadline=None)
def test_spikes_of_all_sizes_are_found_as_they_are(seed: int, size: float, length: int) -> None:
    rng = np.random.default_rng(seed)
    label = CLEAN.labels[rng.integers(len(CLEAN.labels))]
    start = int(rng.integers(20, FRAMES - 30))
    by = rng.normal(size=3)
    clip = displace(label, start, start + length, size * by / np.linalg.norm(by))
    assert found_in(clip) == [("spike", (label,), start, start + length)]


@pytest.mark.parametrize("rate", [50.0, 240.0, 500.0])
def test_other_rates(rate: float) -> None:
    clip = person(rate=rate, seconds=2.0)
    assert find_artefacts(clip) == ()
    positions = clip.positions.copy()
    start = clip.frames // 2
    part = slice(start, start + max(1, round(0.05 * rate)))
    positions[part, clip.labels.index("LWRA")] += [0, 0, 90]
    assert found_in(clip.with_positions(positions)) == [("spike", ("LWRA",), part.start, part.stop)]


# ---- detectors ----------------------------------------------------------------------------------


@given(seed=st.integers(0, 2**16), share=st.floats(0, 0.4))
@settings(max_examples=25, deadline=None)
def test_steps_equal_those_of_a_loop(seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    positions = rng.normal(size=(int(rng.integers(3, 12)), 4, 3))
    positions[rng.random(positions.shape[:2]) < share] = np.nan
    others = np.array([[1, 2], [0, 3], [3, 0], [2, 2]])
    references = ReferenceMarkers(
        others, np.array([[True, True], [True, False], [True, True], [False] * 2])
    )
    step = path_steps(positions)
    np.testing.assert_allclose(step, half_third_differences(positions), atol=1e-12)
    frame, marker = np.indices(step.shape[:2]).reshape(2, -1)
    size = relative_step_sizes(step, references, frame, marker)
    for f, m, value in zip(frame, marker, size, strict=True):
        ways = [step[f, m]] + [step[f, m] - step[f, o] for o in references.of(m)]
        lengths = [np.linalg.norm(way) for way in ways if not np.isnan(way).any()]
        assert value == pytest.approx(min(lengths)) if lengths else np.isnan(value)


def test_breaks_are_where_steps_are() -> None:
    positions = displace("LWRA", 100, 140, (0, 60, 0)).positions
    references = choose_reference_markers(positions)
    breaks = find_breaks(positions, references, RATE)
    assert np.argwhere(breaks.broken).tolist() == [[99, *column("LWRA")], [139, *column("LWRA")]]
    assert breaks.size[breaks.broken] == pytest.approx(60, abs=5)
    with mock.patch("priorfill.artefacts.discontinuities.BATCH_SAMPLES", 9 * positions.shape[1]):
        np.testing.assert_array_equal(find_breaks(positions, references, RATE).size, breaks.size)


def test_reference_markers_are_on_the_same_segment() -> None:
    references = choose_reference_markers(CLEAN.positions)
    for label, neighbour in (("LFHD", "RFHD"), ("RTOE", "RMT5"), ("LFWT", "LBWT")):
        own, other = column(label, neighbour)
        assert other in references.of(own)
        assert own not in references.of(own)
    wrong = choose_reference_markers(mislabel("RTOE", "LFHD", FRAMES // 2 + 20).positions)
    assert set(wrong.of(column("RTOE")[0])[:2]) <= set(column("RMT5", "RHEE", "RANK", "LFHD"))


@given(seed=st.integers(0, 2**16))
@settings(max_examples=25, deadline=None)
def test_medians_of_parts_are_those_of_each_part(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lengths = rng.integers(1, 6, int(rng.integers(1, 40)))
    values = rng.normal(size=(int(lengths.sum()), 3))
    values[rng.random(values.shape) < 0.3] = np.nan
    expected = [known_medians(part) for part in np.split(values, np.cumsum(lengths)[:-1])]
    np.testing.assert_array_equal(medians_of_parts(values, lengths), expected)


def test_distances_equal_those_of_a_loop() -> None:
    positions = AFFECTED["mislabelled"].positions[240:260]
    others = np.array([3, 7, 11])
    np.testing.assert_allclose(
        distances(positions, 5, others), marker_distances(positions, 5, others)
    )


def test_exchanging_undoes_a_swap() -> None:
    clip = AFFECTED["label swap"]
    breaks = find_breaks(clip.positions, choose_reference_markers(clip.positions), RATE)
    swaps = find_label_swaps(clip.positions, breaks.broken, REFERENCES)
    np.testing.assert_array_equal(swap_labels(clip.positions, swaps), CLEAN.positions)


def test_markers_that_pass_each_other_are_not_swapped() -> None:
    t = np.linspace(-1, 1, 101)[:, None]
    one = np.concatenate([500 * t, 0 * t, 0 * t], axis=1)
    positions = np.stack([one, -one + [0, 8, 0]], axis=1)
    broken = np.ones((100, 2), dtype=bool)
    references = choose_reference_markers(positions)
    assert find_label_swaps(positions, broken, references) == []


@pytest.mark.parametrize(("start", "stop"), [(108, 120), (160, 172)])
@pytest.mark.parametrize("hidden", [1.0, 0.8])
def test_a_swap_ends_at_a_blackout(start: int, stop: int, hidden: float) -> None:
    """Labels wrong for some frames next to a blackout of 120 to 160; the rest is right."""
    positions = swap("LFIN", "LWRB", start, stop).positions.copy()
    rng = np.random.default_rng(3)
    black = rng.random(len(CLEAN.labels)) < hidden
    black[column("LFIN", "LWRB")] = True
    positions[120:160, black] = np.nan
    clip = CLEAN.with_positions(positions)
    wrong = np.zeros((FRAMES, len(CLEAN.labels)), dtype=bool)
    wrong[start:stop, column("LFIN", "LWRB")] = True
    found = artefact_samples(find_artefacts(clip), clip.labels, FRAMES)
    np.testing.assert_array_equal(found, wrong)


def test_labels_of_a_whole_body_permuted_after_a_blackout_are_found() -> None:
    rng = np.random.default_rng(4)
    positions = CLEAN.positions.copy()
    positions[120:150] = np.nan
    order = rng.permutation(len(CLEAN.labels))
    positions[150:165] = positions[150:165, order]
    clip = CLEAN.with_positions(positions)
    wrong = np.zeros((FRAMES, len(CLEAN.labels)), dtype=bool)
    wrong[150:165, order != np.arange(len(order))] = True
    found = artefact_samples(find_artefacts(clip), clip.labels, FRAMES)
    assert found[wrong].mean() > 0.95
    assert (found & ~wrong)[:150].sum() == 0
    assert (found & ~wrong).sum() < 10


def test_labels_that_are_wrong_while_the_body_enters_the_volume_are_found() -> None:
    """Markers appear one after the other; three labels of the arm are on others.

    The paths are smooth, as some programs write them, so that no break shows the change.
    """
    rng = np.random.default_rng(6)
    positions = CLEAN.positions.copy()
    wrong = np.zeros((FRAMES, len(CLEAN.labels)), dtype=bool)
    arm, others = column("LWRA", "LWRB", "LFIN"), column("LFHD", "RKNE", "LHEE")
    fade = np.clip((np.arange(FRAMES) - 60.0) / 30.0, 0.0, 1.0)[:, None, None]
    positions[:, arm] = (1 - fade) * CLEAN.positions[:, others] + fade * CLEAN.positions[:, arm]
    wrong[:80, arm] = True
    appears = rng.integers(20, 70, len(CLEAN.labels))
    appears[arm] = 30
    positions[np.arange(FRAMES)[:, None] < appears] = np.nan
    clip = CLEAN.with_positions(positions)
    found = artefact_samples(find_artefacts(clip), clip.labels, FRAMES)
    assert found[wrong & ~clip.missing].mean() > 0.8
    assert (found & ~wrong).sum() < 0.01 * (~clip.missing).sum()
    right = np.where(
        (appears[None] > np.arange(FRAMES)[:, None])[..., None], np.nan, CLEAN.positions
    )
    assert find_artefacts(CLEAN.with_positions(right)) == ()


def test_a_label_moves_only_to_a_marker_that_goes_missing() -> None:
    clip = AFFECTED["mislabelled"]
    size = find_breaks(clip.positions, choose_reference_markers(clip.positions), RATE).broken
    (run,) = find_mislabelled(clip.positions, size, REFERENCES)
    assert (run.start, run.stop) == (250, FRAMES)
    assert [run.marker, run.actual] == column("RFIN", "RWRA")
    shown = clip.positions.copy()
    shown[:, run.actual] = CLEAN.positions[:, run.actual]
    assert find_mislabelled(shown, size, REFERENCES) == ()


def test_a_foot_that_turns_about_a_marker_is_not_stuck() -> None:
    angle = np.linspace(0, 1, 40)
    arm = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    positions = np.zeros((40, 3, 3))
    positions[:, 1], positions[:, 2] = 100 * arm, 150 * arm
    references = ReferenceMarkers(np.array([[1, 2], [0, 2], [0, 1]]), np.ones((3, 2), dtype=bool))
    assert find_stuck(positions, references) == []
    positions[:, 1:] += 30 * angle[:, None, None] * [1, 0, 0]  # the foot moves as well
    assert [(run.marker, run.start, run.stop) for run in find_stuck(positions, references)] == [
        (0, 0, 40)
    ]


def test_distance_outliers_need_more_than_one_reference() -> None:
    positions = CLEAN.positions.copy()
    positions[50:70, column("RTOE")] += [0, 0, 900.0]
    far = distance_outliers(positions, choose_reference_markers(positions))
    assert list(far) == column("RTOE")
    assert np.flatnonzero(far[column("RTOE")[0]]).tolist() == list(range(50, 70))


@pytest.mark.parametrize(
    ("ratios", "expected"),
    [  # of each distance to its limit
        ([1.5, 1.5], True),
        ([1.5, 1.0], False),  # one of two
        ([1.5, 1.5, 1.0], True),
        ([1.5, 1.5, 0.5, 0.5], False),  # half of them
        ([3.0, np.nan], False),  # a single one must exceed three times its limit
        ([3.5, np.nan], True),
        ([np.nan, np.nan], False),
    ],
)
def test_most_distances_must_exceed_their_limits(ratios: list[float], expected: bool) -> None:
    limit = np.array([256.0, 512.0, 128.0, 64.0])[: len(ratios)]
    far = _too_far(limit * np.array(ratios), limit, 3.0)
    assert far == expected


@pytest.mark.parametrize(
    ("inside", "outside", "expected"),
    [  # by how many spreads each of some distances is off on either side of a break
        ([8.0, 8.0, 0.0], [0.0, 0.0, 0.0], True),
        ([8.0, 0.0, 0.0], [0.0, 0.0, 0.0], False),  # one distance of three
        ([8.0], [0.0], True),
        ([8.0, np.nan, np.nan], [0.0, 0.0, 0.0], True),  # the only distance known on both sides
        ([8.0, 8.0, 8.0], [np.nan, np.nan, 0.0], True),
        ([np.nan, np.nan], [0.0, 0.0], False),
        ([1.6, 1.6], [0.0, 0.0], True),  # more than half of `min_deviation`
        ([1.4, 1.4], [0.0, 0.0], False),
        ([6.1, 6.1], [4.0, 4.0], True),  # one and a half times as unusual
        ([5.9, 5.9], [4.0, 4.0], False),
        ([8.0, 8.0, 0.0, 0.0], [0.0, 0.0, 8.0, 8.0], True),  # as many for as against
        ([8.0, 8.0, 0.0, 0.0, 0.0], [0.0, 0.0, 8.0, 8.0, 8.0], False),
        ([8.0, 8.0, 0.0, 0.0, 0.0], [0.0, 0.0, 8.0, 8.0, 1.4], True),
        ([8.0, 8.0, 4.0, 4.0, 4.0], [0.0, 0.0, 5.9, 5.9, 5.9], True),
    ],
)
def test_which_side_of_a_break_is_the_wrong_one(
    inside: list[float], outside: list[float], expected: bool
) -> None:
    median = np.linspace(100.0, 300.0, len(inside))
    spread = np.linspace(4.0, 12.0, len(inside))
    after = median + spread * np.array(inside) * [[1.0], [-1.0], [1.0]]
    before = median - spread * np.array(outside) * [[1.0], [1.0], [-1.0]]
    far = np.full((20, len(inside)), 1e4)  # frames outside the two sides
    typical, options = TypicalDistances(median, spread), OutlierRunOptions()
    for direction in (1, -1):
        distance = np.concatenate([far, before, after, far])[::direction]
        assert is_wrong_side(distance, 23, direction, 3, typical, options) == expected


@pytest.mark.parametrize(("after", "expected"), [(40.0, True), (80.0, False)])
def test_a_path_returns_if_it_continues_nearer_than_it_went(after: float, expected: bool) -> None:
    positions = np.full((6, 1, 3), [1000.0, -500.0, 800.0])
    positions[2:4, 0, 2] += 60.0
    positions[1:5, 0, 0] += np.linspace(0.0, after, 4)
    no_references = np.array([], dtype=np.intp)
    path = MarkerPath(positions, 0, no_references, RATE, OutlierRunOptions())
    assert _returns(path, 2, 4) == expected


def test_a_path_is_cut_at_breaks_and_gaps() -> None:
    seen = np.array([True] * 6 + [False] * 2 + [True] * 3)
    size = np.zeros(10)
    size[2] = 40.0  # between frames 2 and 3
    assert cut_path(seen, size) == [
        PathSegment(0, 3, 0.0, 40.0),
        PathSegment(3, 6, 40.0, 0.0),
        PathSegment(8, 11, 0.0, 0.0),
    ]


@given(seed=st.integers(0, 2**16), frames=st.integers(0, 9), share=st.floats(0.0, 1.0))
@settings(max_examples=25, deadline=None)
def test_medians_of_known_values(seed: int, frames: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(frames, 4))
    values[rng.random(values.shape) < share] = np.nan
    expected = [
        np.median(known) if len(known := column[~np.isnan(column)]) else np.nan
        for column in values.T
    ]
    np.testing.assert_allclose(known_medians(values), expected)


def test_typical_distances_are_robust() -> None:
    distance = np.array([[100.0], [101.0], [99.0], [100.0], [900.0], [np.nan]])
    typical = TypicalDistances.of(distance, 0.5)
    assert typical.median == [100.0]
    assert typical.spread == pytest.approx([1.4826])
    assert TypicalDistances.of(distance, 4.0).spread == [4.0]


def test_options_reach_their_detectors() -> None:
    def kinds(name: str, options: ArtefactOptions) -> list[str]:
        return [artefact.kind for artefact in find_artefacts(AFFECTED[name], options=options)]

    assert kinds("spike", ArtefactOptions(breaks=BreakOptions(min_size=1e4))) == []
    brief = OutlierRunOptions(max_spike_seconds=0.01)  # one frame
    assert kinds("spike", ArtefactOptions(outlier_runs=brief)) == ["jump"]
    assert kinds("stuck", ArtefactOptions(stuck=StuckOptions(min_frames=30))) == []
    assert "label swap" not in kinds("label swap", ArtefactOptions(max_miss_ratio=0.0))
    with pytest.raises(OptionError, match=r"StuckOptions\.min_frames is 1"):
        StuckOptions(min_frames=1)


# ---- rejection and evidence ----------------------------------------------------------------------


def test_without_artefacts_only_their_samples_are_missing() -> None:
    sound, artefacts = without_artefacts(AFFECTED["jump"])
    assert artefacts == find_artefacts(AFFECTED["jump"])
    expected = np.zeros(sound.missing.shape, dtype=bool)
    expected[100:160, column("LKNE")] = True
    np.testing.assert_array_equal(sound.missing, expected)
    np.testing.assert_array_equal(sound.positions[~expected], AFFECTED["jump"].positions[~expected])
    assert without_artefacts(CLEAN) == (CLEAN, ())


def test_filling_with_outliers_rejected_comes_near_the_truth() -> None:
    clip = with_gaps(AFFECTED["spike"], (200, 220, ("LFIN",)))
    kept = pf.fill(clip, method="linear")
    assert [one.kind for one in kept.artefacts] == ["spike"]
    assert kept.doubtful is not None and kept.doubtful.sum() == 3  # nothing is learnt from them
    assert not kept.rejected.any()
    np.testing.assert_array_equal(kept.clip.positions[~kept.filled], clip.positions[~kept.filled])
    result = pf.fill(clip, method="linear", reject_artefacts=True)
    wrong = result.rejected
    assert wrong.sum() == 3
    np.testing.assert_array_equal(result.filled, wrong | clip.missing)
    off = np.linalg.norm(result.clip.positions - CLEAN.positions, axis=2)
    assert off[wrong].mean() < 5.0
    untouched = ~result.filled
    np.testing.assert_array_equal(result.clip.positions[untouched], clip.positions[untouched])
    assert [one.kind for one in result.artefacts] == ["spike"]


def test_what_is_rejected_but_not_to_be_filled_stays_as_measured() -> None:
    clip = AFFECTED["jump"]
    result = pf.fill(
        clip, method="linear", reject_artefacts=True, gap_filter=pf.GapFilter(markers=("RTOE",))
    )
    assert not result.filled.any()
    assert result.rejected.sum() == 60
    np.testing.assert_array_equal(result.clip.positions, clip.positions)


def test_evidence_names_distance_and_jump() -> None:
    jump = Artefact("jump", ("A",), 0, 9, 30.0, "B", 412.4, 395.1, 3.04)
    assert jump.evidence == "A-B 412 mm, usually 395 +- 3.0; its path jumps by 30 mm"
    assert Artefact("spike", ("A",), 0, 1, 30.0).evidence == "its path jumps by 30 mm"


@pytest.mark.realdata
def test_clean_recordings_give_nothing(data: Path) -> None:
    for name in ("hdm05/HDM_dg_06-03_03_120.c3d", "cmu/127_07.c3d", "gait/HC002D06.c3d"):
        assert find_artefacts(pf.read(data / name)) == (), name
    # a wrist marker on the other one's place for three frames, in a punch
    found = find_artefacts(pf.read(data / "cmu" / "80_10.c3d"))
    assert any(one.markers == ("LWRA",) and one.distance < 20 for one in found)
