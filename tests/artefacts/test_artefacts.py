"""Trouble in clips: what is found of it, what is not, and what is left out."""

from __future__ import annotations

from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from gappy import person, with_gaps
from hypothesis import given, settings
from hypothesis import strategies as st
from naive import partner_distances, path_steps

import priorfill as pf
from priorfill.artefacts import (
    KINDS,
    Artefact,
    artefact_samples,
    find_artefacts,
    without_artefacts,
)
from priorfill.artefacts.discontinuities import against_partners, find_breaks, steps
from priorfill.artefacts.distance_outliers import distance_outliers
from priorfill.artefacts.frozen import frozen_runs
from priorfill.artefacts.label_swaps import exchange, find_swaps
from priorfill.artefacts.label_takeovers import find_takeovers
from priorfill.artefacts.outlier_runs import _wrong_side
from priorfill.artefacts.reference_markers import (
    ReferenceMarkers,
    choose_reference_markers,
    distances,
)
from priorfill.clip import Clip

RATE = 120.0
CLEAN = person(rate=RATE, seconds=2.5)
FRAMES = CLEAN.frames


def column(*labels: str) -> list[int]:
    return [CLEAN.labels.index(label) for label in labels]


def moved(label: str, start: int, stop: int, by: np.ndarray | tuple[float, ...]) -> Clip:
    """The clean clip with a marker displaced in some frames."""
    positions = CLEAN.positions.copy()
    positions[start:stop, column(label)] += np.asarray(by, dtype=float)
    return CLEAN.with_positions(positions)


def swapped(one: str, other: str, start: int, stop: int) -> Clip:
    positions = CLEAN.positions.copy()
    positions[start:stop, column(one, other)] = positions[start:stop, column(other, one)]
    return CLEAN.with_positions(positions)


def held(label: str, start: int, stop: int) -> Clip:
    positions = CLEAN.positions.copy()
    positions[start:stop, column(label)] = positions[start, column(label)]
    return CLEAN.with_positions(positions)


def relabelled(label: str, other: str, start: int) -> Clip:
    positions = CLEAN.positions.copy()
    positions[start:, column(label)] = positions[start:, column(other)]
    positions[start:, column(other)] = np.nan
    return CLEAN.with_positions(positions)


def said(clip: Clip) -> list[tuple[str, tuple[str, ...], int, int]]:
    return [(one.kind, one.markers, one.start, one.stop) for one in find_artefacts(clip)]


def turned(clip: Clip) -> Clip:
    """The clip in another place and orientation."""
    turn, _ = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))
    return clip.with_positions(clip.positions @ turn + [300.0, -4000.0, 70.0])


TROUBLED = {
    "spike": moved("LWRA", 100, 103, (0, 60, 0)),
    "jump": moved("LKNE", 100, 160, (150, 0, 90)),
    "swapped": swapped("LWRA", "LWRB", 120, 200),
    "frozen": held("RTOE", 100, 120),
    "relabelled": relabelled("RFIN", "RWRA", 250),
}


# ---- what is found ----------------------------------------------------------------------------


@pytest.mark.parametrize("motion", ["running", "squatting"])
def test_a_clean_clip_gives_nothing(motion: str) -> None:
    clip = person(motion, rate=RATE, seconds=2.0)
    assert find_artefacts(clip) == ()
    gaps = with_gaps(clip, (30, 60, ("LWRA", "LWRB", "LFIN")), (0, 5, ("C7",)))
    assert find_artefacts(gaps) == ()


def test_each_kind_is_found_where_it_is() -> None:
    assert said(TROUBLED["spike"]) == [("spike", ("LWRA",), 100, 103)]
    assert said(TROUBLED["jump"]) == [("jump", ("LKNE",), 100, 160)]
    assert said(TROUBLED["swapped"]) == [("swapped", ("LWRA", "LWRB"), 120, 200)]
    assert said(TROUBLED["frozen"]) == [("frozen", ("RTOE",), 100, 120)]
    assert said(TROUBLED["relabelled"]) == [("relabelled", ("RFIN",), 250, FRAMES)]
    assert set(TROUBLED) == set(KINDS)


def test_evidence_has_figures() -> None:
    (spike,) = find_artefacts(TROUBLED["spike"])
    own, other = column("LWRA", spike.partner)
    length = np.linalg.norm(CLEAN.positions[:, own] - CLEAN.positions[:, other], axis=1)
    assert spike.usual == pytest.approx(np.median(length), abs=1.0)
    assert abs(spike.distance - spike.usual) > 5 * spike.spread
    assert spike.evidence.startswith(f"LWRA-{spike.partner} {spike.distance:.0f} mm, usually ")
    assert spike.size == pytest.approx(60, abs=5)
    (swap,) = find_artefacts(TROUBLED["swapped"])
    apart = np.linalg.norm(np.diff(CLEAN.positions[120, column("LWRA", "LWRB")], axis=0))
    assert swap.size == pytest.approx(apart, abs=10)
    (relabelling,) = find_artefacts(TROUBLED["relabelled"])
    assert relabelling.partner == "RWRA"
    assert "goes on with the path of RWRA" in relabelling.evidence
    (frozen,) = find_artefacts(TROUBLED["frozen"])
    assert frozen.evidence == (
        f"exactly the same place while {frozen.partner} moves by {frozen.size:.0f} mm"
    )


def test_two_sides_may_be_swapped_to_the_end_and_the_shorter_part_is_told() -> None:
    assert said(swapped("LKNE", "RKNE", 250, FRAMES)) == [
        ("swapped", ("LKNE", "RKNE"), 250, FRAMES)
    ]
    assert said(swapped("LKNE", "RKNE", 100, FRAMES)) == [("swapped", ("LKNE", "RKNE"), 0, 100)]


def test_a_swap_that_hides_a_spike_hides_nothing() -> None:
    positions = swapped("LWRA", "LWRB", 120, 200).positions.copy()
    positions[150, column("LWRA")] += [0, 0, 90]  # where LWRB is
    assert set(said(CLEAN.with_positions(positions))) == {
        ("swapped", ("LWRA", "LWRB"), 120, 200),
        ("spike", ("LWRB",), 150, 151),
    }


def test_a_wrong_marker_between_gaps_is_told_by_its_distances() -> None:
    clip = moved("LKNE", 65, 110, (400, 0, 0))
    clip = with_gaps(clip, (60, 65, ("LKNE",)), (110, 115, ("LKNE",)))
    assert said(clip) == [("jump", ("LKNE",), 65, 110)]


def test_a_path_led_smoothly_away_is_found_where_it_is_too_far() -> None:
    bump = 1500 * np.sin(np.pi * np.arange(80) / 80)[:, None] ** 2 * [0, 0, 1.0]
    positions = CLEAN.positions.copy()
    positions[100:180, column("RTOE")[0]] += bump
    clip = CLEAN.with_positions(positions)
    samples = artefact_samples(find_artefacts(clip), clip.labels, clip.frames)
    assert samples[125:155, column("RTOE")[0]].all()
    others = np.delete(samples, column("RTOE"), axis=1)
    assert not others.any()


def test_standing_still_is_no_trouble() -> None:
    still = CLEAN.with_positions(np.repeat(CLEAN.positions[:1], FRAMES, axis=0))
    assert find_artefacts(still) == ()
    # a whole clip that halts, as a replay does, and goes on
    halted = CLEAN.positions.copy()
    halted[100:130] = halted[100]
    halted[130:] = halted[100:-30]
    found = find_artefacts(CLEAN.with_positions(halted))
    assert all(one.kind != "frozen" for one in found)


def test_a_path_that_turns_in_a_frame_is_no_spike() -> None:
    positions = CLEAN.positions.copy()
    there_and_back = 18.0 * np.concatenate([np.arange(7), np.arange(5, 0, -1)])
    positions[150:162, column("LWRA")[0], 2] += there_and_back
    assert find_artefacts(CLEAN.with_positions(positions)) == ()
    positions[156, column("LWRA")[0], 2] += 60.0  # now its tip is one, and so is the way there
    ((kind, markers, start, stop),) = said(CLEAN.with_positions(positions))
    assert (kind, markers) == ("spike", ("LWRA",))
    assert 150 <= start <= 156 < stop <= 162


def test_a_hit_of_a_whole_segment_is_no_trouble() -> None:
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


# ---- what must make no difference ---------------------------------------------------------------


@pytest.mark.parametrize("kind", TROUBLED)
def test_place_and_orientation_make_no_difference(kind: str) -> None:
    assert said(turned(TROUBLED[kind])) == said(TROUBLED[kind])


@pytest.mark.parametrize("kind", TROUBLED)
def test_the_direction_of_time_makes_no_difference(kind: str) -> None:
    clip = TROUBLED[kind]
    back = said(clip.with_positions(clip.positions[::-1]))
    assert back == [(k, m, FRAMES - stop, FRAMES - start) for k, m, start, stop in said(clip)]


@given(seed=st.integers(0, 2**16), kind=st.sampled_from(sorted(TROUBLED)))
@settings(max_examples=8, deadline=None)
def test_the_order_of_the_markers_makes_no_difference(seed: int, kind: str) -> None:
    clip = TROUBLED[kind]
    order = np.random.default_rng(seed).permutation(len(clip.labels))
    mixed = Clip(clip.positions[:, order], tuple(clip.labels[i] for i in order), clip.rate)
    assert [(k, frozenset(m), *part) for k, m, *part in said(mixed)] == [
        (k, frozenset(m), *part) for k, m, *part in said(clip)
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
    clip = moved(label, start, start + length, size * by / np.linalg.norm(by))
    assert said(clip) == [("spike", (label,), start, start + length)]


@pytest.mark.parametrize("rate", [50.0, 240.0, 500.0])
def test_other_rates(rate: float) -> None:
    clip = person(rate=rate, seconds=2.0)
    assert find_artefacts(clip) == ()
    positions = clip.positions.copy()
    start = clip.frames // 2
    part = slice(start, start + max(1, round(0.05 * rate)))
    positions[part, clip.labels.index("LWRA")] += [0, 0, 90]
    assert said(clip.with_positions(positions)) == [("spike", ("LWRA",), part.start, part.stop)]


# ---- the parts ----------------------------------------------------------------------------------


@given(seed=st.integers(0, 2**16), share=st.floats(0, 0.4))
@settings(max_examples=25, deadline=None)
def test_steps_against_the_slow_twin(seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    positions = rng.normal(size=(int(rng.integers(3, 12)), 4, 3))
    positions[rng.random(positions.shape[:2]) < share] = np.nan
    others = np.array([[1, 2], [0, 3], [3, 0], [2, 2]])
    partners = ReferenceMarkers(
        others, np.array([[True, True], [True, False], [True, True], [False] * 2])
    )
    with mock.patch("priorfill.artefacts.discontinuities.AT_ONCE", int(rng.integers(1, 12))):
        step = steps(positions)
    np.testing.assert_allclose(step, path_steps(positions), atol=1e-12)
    frame, marker = np.indices(step.shape[:2]).reshape(2, -1)
    size = against_partners(step, partners, frame, marker)
    for f, m, value in zip(frame, marker, size, strict=True):
        ways = [step[f, m]] + [step[f, m] - step[f, o] for o in partners.of(m)]
        lengths = [np.linalg.norm(way) for way in ways if not np.isnan(way).any()]
        assert value == pytest.approx(min(lengths)) if lengths else np.isnan(value)


def test_breaks_are_where_steps_are() -> None:
    positions = moved("LWRA", 100, 140, (0, 60, 0)).positions
    breaks = find_breaks(positions, choose_reference_markers(positions), RATE)
    assert np.argwhere(breaks.broken).tolist() == [[99, *column("LWRA")], [139, *column("LWRA")]]
    assert breaks.size[breaks.broken] == pytest.approx(60, abs=5)


def test_partners_are_on_the_same_segment() -> None:
    partners = choose_reference_markers(CLEAN.positions)
    for label, beside in (("LFHD", "RFHD"), ("RTOE", "RMT5"), ("LFWT", "LBWT")):
        own, other = column(label, beside)
        assert other in partners.of(own)
        assert own not in partners.of(own)
    wrong = choose_reference_markers(relabelled("RTOE", "LFHD", FRAMES // 2 + 20).positions)
    assert set(wrong.of(column("RTOE")[0])[:2]) <= set(column("RMT5", "RHEE", "RANK", "LFHD"))


def test_distances_against_the_slow_twin() -> None:
    positions = TROUBLED["relabelled"].positions[240:260]
    others = np.array([3, 7, 11])
    np.testing.assert_allclose(
        distances(positions, 5, others), partner_distances(positions, 5, others)
    )


def test_exchanging_undoes_a_swap() -> None:
    clip = TROUBLED["swapped"]
    breaks = find_breaks(clip.positions, choose_reference_markers(clip.positions), RATE)
    swaps = find_swaps(clip.positions, breaks.broken)
    np.testing.assert_array_equal(exchange(clip.positions, swaps), CLEAN.positions)


def test_markers_that_pass_each_other_are_not_swapped() -> None:
    t = np.linspace(-1, 1, 101)[:, None]
    one = np.concatenate([500 * t, 0 * t, 0 * t], axis=1)
    positions = np.stack([one, -one + [0, 8, 0]], axis=1)
    broken = np.ones((100, 2), dtype=bool)
    assert find_swaps(positions, broken) == []


def test_a_label_goes_over_only_to_a_marker_that_goes_missing() -> None:
    clip = TROUBLED["relabelled"]
    size = find_breaks(clip.positions, choose_reference_markers(clip.positions), RATE).broken
    (takeover,) = find_takeovers(clip.positions, size)
    assert (takeover.start, takeover.stop) == (250, FRAMES)
    assert [takeover.marker, takeover.other] == column("RFIN", "RWRA")
    shown = clip.positions.copy()
    shown[:, takeover.other] = CLEAN.positions[:, takeover.other]
    assert find_takeovers(shown, size) == ()


def test_a_foot_that_turns_about_a_marker_is_not_frozen() -> None:
    angle = np.linspace(0, 1, 40)
    arm = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    positions = np.zeros((40, 3, 3))
    positions[:, 1], positions[:, 2] = 100 * arm, 150 * arm
    partners = ReferenceMarkers(np.array([[1, 2], [0, 2], [0, 1]]), np.ones((3, 2), dtype=bool))
    assert frozen_runs(positions, partners) == []
    positions[:, 1:] += 30 * angle[:, None, None] * [1, 0, 0]  # now it does not only turn
    assert [(run.marker, run.start, run.stop) for run in frozen_runs(positions, partners)] == [
        (0, 0, 40)
    ]


def test_far_samples_need_more_than_one_partner_to_say_so() -> None:
    positions = CLEAN.positions.copy()
    positions[50:70, column("RTOE")] += [0, 0, 900.0]
    far = distance_outliers(positions, choose_reference_markers(positions))
    assert list(far) == column("RTOE")
    assert np.flatnonzero(far[column("RTOE")[0]]).tolist() == list(range(50, 70))


@pytest.mark.parametrize(
    ("inside", "outside", "expected"),
    [  # by how many spreads each of some distances is off on either side of a break
        ([8.0, 8.0, 0.0], [0.0, 0.0, 0.0], True),
        ([8.0, 0.0, 0.0], [0.0, 0.0, 0.0], False),  # one distance of three
        ([8.0], [0.0], True),
        ([8.0, np.nan, np.nan], [0.0, 0.0, 0.0], True),  # the only distance known on both sides
        ([8.0, 8.0, 8.0], [np.nan, np.nan, 0.0], True),
        ([np.nan, np.nan], [0.0, 0.0], False),
        ([1.6, 1.6], [0.0, 0.0], True),  # more than half of `OFF`
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
    usual = np.linspace(100.0, 300.0, len(inside))
    spread = np.linspace(4.0, 12.0, len(inside))
    after = usual + spread * np.array(inside) * [[1.0], [-1.0], [1.0]]
    before = usual - spread * np.array(outside) * [[1.0], [1.0], [-1.0]]
    far = np.full((20, len(inside)), 1e4)  # frames outside the two sides
    for way in (1, -1):
        length = np.concatenate([far, before, after, far])[::way]
        assert _wrong_side(length, 23, way, 3, usual, spread) == expected


# ---- what is done about it ----------------------------------------------------------------------


def test_without_trouble_only_what_is_in_trouble_is_missing() -> None:
    sound, artefacts = without_artefacts(TROUBLED["jump"])
    assert artefacts == find_artefacts(TROUBLED["jump"])
    expected = np.zeros(sound.missing.shape, dtype=bool)
    expected[100:160, column("LKNE")] = True
    np.testing.assert_array_equal(sound.missing, expected)
    np.testing.assert_array_equal(sound.positions[~expected], TROUBLED["jump"].positions[~expected])
    assert without_artefacts(CLEAN) == (CLEAN, ())


def test_filling_with_outliers_rejected_comes_near_the_truth() -> None:
    clip = with_gaps(TROUBLED["spike"], (200, 220, ("LFIN",)))
    kept = pf.fill(clip, method="linear")
    assert kept.artefacts == ()
    assert not kept.rejected.any()
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
    clip = TROUBLED["jump"]
    result = pf.fill(
        clip, method="linear", reject_artefacts=True, gap_filter=pf.GapFilter(markers=("RTOE",))
    )
    assert not result.filled.any()
    assert result.rejected.sum() == 60
    np.testing.assert_array_equal(result.clip.positions, clip.positions)


def test_trouble_says_what_it_is() -> None:
    jump = Artefact("jump", ("A",), 0, 9, 30.0, "B", 412.4, 395.1, 3.04)
    assert jump.evidence == "A-B 412 mm, usually 395 +- 3.0; its path breaks by 30 mm"
    assert Artefact("spike", ("A",), 0, 1, 30.0).evidence == "its path breaks by 30 mm"


@pytest.mark.realdata
def test_clean_recordings_give_nothing(data: Path) -> None:
    for name in ("hdm05/HDM_dg_06-03_03_120.c3d", "cmu/127_07.c3d", "gait/HC002D06.c3d"):
        assert find_artefacts(pf.read(data / name)) == (), name
    # a wrist marker on the other one's place for three frames, in a punch
    found = find_artefacts(pf.read(data / "cmu" / "80_10.c3d"))
    assert any(one.markers == ("LWRA",) and one.distance < 20 for one in found)
