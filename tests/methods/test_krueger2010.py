"""The frame-by-frame comparator: local models of the nearest poses, and ad hoc smoothness."""

from __future__ import annotations

from dataclasses import replace

import naive
import numpy as np
import pytest
from gappy import ARM, FOOT, error, fill_unchecked, person, straight, with_gaps
from hypothesis import given, settings
from hypothesis import strategies as st
from random_bodies import body, task_of

from priorfill.database import PriorDatabase
from priorfill.gaps import gap_groups
from priorfill.geometry.axes import from_upright
from priorfill.methods.baumann2011 import krueger2010, neighbour_votes
from priorfill.methods.baumann2011.krueger2010 import Krueger2010Options
from priorfill.methods.baumann2011.neighbour_votes import Baumann2011Options

HIDDEN = (6, 8)


def heading(points: np.ndarray, shape: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Origin and rotation of one pose, by a search over all angles with refinement."""
    origin = points.mean(axis=0)
    shape = shape - shape.mean(axis=0)

    def rotation(angle: float) -> np.ndarray:
        c, s = np.cos(angle), np.sin(angle)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def off(angle: float) -> float:
        return float(((points - origin - shape @ rotation(angle).T) ** 2).sum())

    at, step = min(np.linspace(-np.pi, np.pi, 73), key=off), np.pi / 36
    while step > 1e-10:
        at = min((at - step, at, at + step), key=off)
        step *= 0.6
    return origin, rotation(at)


def frame_by_frame(gappy, others, root, template, viable, options):
    """The method frame by frame: least squares over weights of the neighbours."""
    filled = gappy.copy()
    poses = np.concatenate([other[1:-1] for other in others])  # as a bank has them
    frames = [heading(pose[root], template) for pose in poses]
    local = np.array([(p - o) @ r for p, (o, r) in zip(poses, frames, strict=True)])
    for t in np.flatnonzero(np.isnan(gappy[..., 0]).any(axis=1)):
        missing = np.flatnonzero(np.isnan(gappy[t, :, 0]))
        origin, rotation = heading(gappy[t, root], template)
        seen = [m for m in viable if m not in missing]
        query = ((gappy[t] - origin) @ rotation)[seen]
        distance = np.sqrt(((local[:, seen] - query) ** 2).sum(axis=(1, 2)))
        near = local[np.argsort(distance, kind="stable")[: options.neighbours]]
        mean, scale = near.mean(axis=0), np.sqrt(max(len(near) - 1, 1))
        # a pose is mean + sum of w_i (near_i - mean) / scale, and E_prior is |w|²
        away = (near - mean) / scale
        rows, sides = [np.eye(len(near))], [np.zeros(len(near))]
        rows.append(away[:, seen].reshape(len(near), -1).T / options.control_error)
        sides.append((query - mean[seen]).ravel() / options.control_error)
        straight = (2.0 * filled[t - 1, missing] - filled[t - 2, missing] - origin) @ rotation
        rows.append(away[:, missing].reshape(len(near), -1).T / options.second_difference)
        sides.append((straight - mean[missing]).ravel() / options.second_difference)
        weights = np.linalg.lstsq(np.concatenate(rows), np.concatenate(sides), rcond=None)[0]
        found = mean + np.einsum("i,imj->mj", weights, away)
        filled[t, missing] = found[missing] @ rotation.T + origin
    return filled


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6), k=st.integers(1, 40))
def test_each_frame_minimises_its_energy(seed, k):
    truth, others = body(seed, 24), [body(seed + 1, 30), body(seed + 2, 20)]
    gappy = truth.copy()
    gappy[5:15, 6] = np.nan
    gappy[9:20, 8] = np.nan
    gappy[11:13, 4] = np.nan
    task = task_of(gappy, others, {0, 1, 2, 3, 4, 5, 7})
    options = Krueger2010Options(neighbours=k, control_error=30.0, second_difference=40.0)
    found = krueger2010.fill(task, options=options)
    group = task.root_among(np.array([0, 1, 2, 3]))
    viable = [0, 1, 2, 3, 4, 5, 7]
    expected = frame_by_frame(gappy, others, [0, 1, 2, 3], group.template, viable, options)
    np.testing.assert_allclose(found.positions, expected, atol=0.01)  # the bank is float32


def test_without_weight_on_smoothness_frames_are_independent():
    """With weight on it, a frame depends on the frames before it, not on later ones."""
    truth, others = body(4, 30), [body(5, 50)]
    gappy = truth.copy()
    gappy[3:25, 8] = np.nan
    later = gappy.copy()
    later[12:, :7] += 5.0
    earlier = gappy.copy()
    earlier[:3] += 5.0
    free, bound = Krueger2010Options(second_difference=1e6), Krueger2010Options()

    def fill(positions, options):
        task = task_of(positions, others, set(range(7)))
        return krueger2010.fill(task, options=options).positions[3:12, 8]

    np.testing.assert_allclose(fill(later, bound), fill(gappy, bound), atol=1e-6)
    assert np.abs(fill(earlier, bound) - fill(gappy, bound)).max() > 0.1
    np.testing.assert_allclose(fill(earlier, free), fill(gappy, free), atol=1e-3)


@pytest.mark.parametrize(
    ("module", "options"),
    [
        # smoothness couples the markers of a frame
        (krueger2010, Krueger2010Options(second_difference=1e6)),
        (neighbour_votes, Baumann2011Options()),
    ],
)
def test_only_the_markers_of_a_gap_group_are_filled(module, options):
    truth, others = body(0, 24), [body(1, 60)]
    gappy = truth.copy()
    gappy[5:15, list(HIDDEN)] = np.nan
    task = task_of(gappy, others, set(range(6)))
    missing = np.isnan(gappy[..., 0])
    both = module.fill(task, options=options).positions
    for marker in HIDDEN:
        wanted = missing & (np.arange(9) == marker)
        found = module.fill(replace(task, groups=tuple(gap_groups(wanted))), options=options)
        expected = np.where(wanted[..., None], both, gappy)
        np.testing.assert_allclose(found.positions, expected, atol=0.01)
        assert {note.marker for note in found.notes} == {marker}


def test_unreliable_markers_search_only_where_others_are_too_few():
    truth, others = body(0, 24), [body(1, 60)]
    gappy = truth.copy()
    gappy[5:15, 8] = np.nan
    options = Krueger2010Options(neighbours=3)
    some = krueger2010.fill(task_of(gappy, others, {0, 1, 2, 3}), options=options).positions
    few = krueger2010.fill(task_of(gappy, others, {0, 1, 2}), options=options).positions
    every = krueger2010.fill(task_of(gappy, others, set(range(9))), options=options).positions
    np.testing.assert_array_equal(few, every)
    assert np.abs(some - every)[5:15, 8].max() > 1.0


def test_the_deviation_is_that_of_the_local_model():
    truth, others = body(0, 24), [body(1, 40)]
    gappy = truth.copy()
    gappy[5:15, 8] = np.nan
    task = task_of(gappy, others, set(range(8)))
    loose = Krueger2010Options(neighbours=1000, control_error=1e6)
    found = krueger2010.fill(task, options=loose)
    root = task.root_among(np.arange(8))
    poses = others[0][1:-1]
    local = root.frames(poses).to_local(poses)[:, 8]  # every pose is a neighbour
    spread = np.sqrt(local.var(axis=0, ddof=1).sum())
    np.testing.assert_allclose(found.expected_rms[5:15, 8], spread, rtol=1e-4)
    bound = krueger2010.fill(task, options=Krueger2010Options(neighbours=1000))
    assert (bound.expected_rms[5:15, 8] < 0.9 * spread).all()
    (note,) = found.notes
    assert (note.marker, note.start, note.stop, note.training_poses) == (8, 5, 15, 38)
    assert note.source_clips == ("take 0",)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6), angle=st.floats(-3.0, 3.0), east=st.floats(-5000.0, 5000.0))
def test_filling_turns_and_moves_with_the_clip(seed, angle, east):
    gappy, others = body(seed, 20), [body(seed + 1, 60)]
    gappy[4:12, HIDDEN] = np.nan
    shift = np.array([east, 300.0, 0.0])
    moved = naive.turned(gappy, angle, shift)
    one = krueger2010.fill(
        task_of(gappy, others, set(range(6))), options=Krueger2010Options(neighbours=5)
    )
    two = krueger2010.fill(
        task_of(moved, others, set(range(6))), options=Krueger2010Options(neighbours=5)
    )
    np.testing.assert_allclose(two.positions, naive.turned(one.positions, angle, shift), atol=0.01)
    np.testing.assert_allclose(two.expected_rms, one.expected_rms, atol=0.01)


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory):
    """Two other subjects walking."""
    place = tmp_path_factory.mktemp("priors") / "db"
    with PriorDatabase.create(place) as made:
        for number in (11, 12):
            made.add(person(seconds=6.0, seed=number, body=number))
    return place


def check(clip, result):
    """Properties of any result."""
    np.testing.assert_array_equal(
        result.clip.positions[~clip.missing], clip.positions[~clip.missing]
    )
    assert np.isfinite(result.expected_rms_mm[result.filled]).all()
    assert (result.expected_rms_mm[result.filled] >= 0).all()
    for gap in result.gaps:
        assert sum(p.stop - p.start for p in gap.unfilled) == gap.frames - gap.filled
        assert all(p.reason and "no finite position" not in p.reason for p in gap.unfilled)


def test_a_limb_is_filled_from_other_people(database):
    clip = with_gaps(person(), (70, 160, ARM), (100, 190, FOOT), (120, 135, ("C7",)))
    result = fill_unchecked(clip, method="krueger2010", database=database)
    check(clip, result)
    assert result.complete
    truth = person().positions
    off = error(result.clip.positions, truth, result.filled)
    assert off < error(straight(clip), truth, result.filled)
    assert {gap.sources for gap in result.gaps} == {
        ("local models of 64 nearest poses, frame by frame",)
    }
    assert all(gap.filled == gap.frames for gap in result.gaps)


def test_energies_over_time_join_the_end_of_a_gap(database):
    """What `baumann2011` adds to the same search."""
    clip = with_gaps(person(), (70, 160, ARM))
    arm = clip.missing.any(axis=0)
    step = {}
    for method in ("krueger2010", "baumann2011"):
        result = fill_unchecked(clip, method=method, database=database)
        off = (result.clip.positions - person().positions)[:, arm]
        step[method] = np.linalg.norm(off[160] - off[159], axis=1).mean()
    assert step["baumann2011"] < 0.8 * step["krueger2010"]


def test_the_clip_itself_is_searched_without_a_database():
    clip = with_gaps(person(), (100, 130, ("LKNE",)))
    result = fill_unchecked(clip, method="krueger2010")
    check(clip, result)
    (gap,) = result.gaps
    assert gap.source_clips == (clip.name,)
    assert error(result.clip.positions, person().positions, result.filled) < 150.0


def test_dropouts_need_a_database(database):
    clip = with_gaps(person(), (0, 240, ("C7",)), (60, 100, ("LELB",)))
    alone = fill_unchecked(clip, method="krueger2010")
    check(clip, alone)
    (gap,) = [g for g in alone.gaps if g.label == "C7"]
    assert gap.filled == 0
    assert "no prior pose" in gap.unfilled[0].reason
    helped = fill_unchecked(clip, method="krueger2010", database=database)
    check(clip, helped)
    assert helped.complete


def test_blackouts_stay_missing(database):
    clip = with_gaps(person(), (60, 90, ARM), (70, 75, person().labels))
    result = fill_unchecked(clip, method="krueger2010", database=database)
    check(clip, result)
    assert not result.filled[70:75].any()
    assert result.filled[60:70][:, clip.missing[60]].all()
    assert result.filled[75:90][:, clip.missing[60]].all()


@pytest.mark.parametrize("frames", [1, 2, 20])
def test_short_clips(frames, database):
    clip = replace(person(), positions=person().positions[:frames])
    clip = with_gaps(clip, (frames // 2, frames // 2 + 1, ("LKNE",)), (0, frames, ("C7",)))
    check(clip, fill_unchecked(clip, method="krueger2010"))
    result = fill_unchecked(clip, method="krueger2010", database=database)
    check(clip, result)
    assert result.complete


@pytest.mark.parametrize("markers", [1, 2, 3])
def test_few_markers(markers, database):
    labels = person().labels[:markers]
    clip = replace(person(), positions=person().positions[:, :markers], labels=labels)
    clip = with_gaps(clip, (100, 110, labels[:1]))
    for priors in (None, database):
        check(clip, fill_unchecked(clip, method="krueger2010", database=priors))


def test_odd_clips(database):
    nothing = replace(person(), positions=np.full((30, 41, 3), np.nan))
    still = replace(person(), positions=np.repeat(person().positions[:1], 60, axis=0))
    heap = replace(person(), positions=np.repeat(person().positions[:, :1], 41, axis=1))
    gaps = [(30, 50, ARM), (0, 10, ("LKNE",)), (55, 60, ("LKNE",))]
    for clip in (nothing, with_gaps(still, *gaps), with_gaps(heap, *gaps)):
        for priors in (None, database):
            check(clip, fill_unchecked(clip, method="krueger2010", database=priors))
    same = fill_unchecked(with_gaps(still, *gaps), method="krueger2010")
    np.testing.assert_allclose(same.clip.positions, still.positions, atol=0.1)


def test_filling_does_not_depend_on_the_axes(database):
    clip = with_gaps(person(), (80, 170, ARM))
    turned = replace(clip, positions=from_upright(clip.positions, "+Y"), up="+Y")
    one = fill_unchecked(clip, method="krueger2010", database=database)
    two = fill_unchecked(turned, method="krueger2010", database=database)
    np.testing.assert_allclose(
        two.clip.positions, from_upright(one.clip.positions, "+Y"), atol=1e-3
    )


@pytest.mark.realdata
def test_an_arm_of_a_recording(data):
    """With similar poses in the clip, errors are below linear ones and like baumann2011's."""
    from priorfill.formats import read

    clip = read(data / "hdm05" / "HDM_bd_01-02_01_120.c3d")
    gappy = with_gaps(clip, (2400, 2640, ARM))
    off = {"line": error(straight(gappy), clip.positions, gappy.missing)}
    for method in ("krueger2010", "baumann2011"):
        result = fill_unchecked(gappy, method=method)
        check(gappy, result)
        assert result.complete
        off[method] = error(result.clip.positions, clip.positions, gappy.missing)
    assert off["krueger2010"] < 0.5 * off["line"]
    assert 0.8 < off["krueger2010"] / off["baumann2011"] < 1.5
