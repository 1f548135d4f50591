import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from priorfill.geometry.root_frames import RootGroup, root_group
from priorfill.search.bank import PoseBank, PoseBankCache
from priorfill.search.index import MAX_BRUTE_FORCE_POSES, WAYS, PoseIndex, choose_way
from priorfill.search.takes import own_take
from priorfill.signal.resample import Level


@st.composite
def recordings_and_queries(draw):
    """Recordings of some kind one after the other, where they start, and queries among them."""
    rng = np.random.default_rng(draw(st.integers(0, 2**31)))
    lengths = draw(st.lists(st.integers(1, 40), min_size=1, max_size=6))
    dimensions = draw(st.integers(1, 40))
    kind = draw(st.sampled_from(["smooth", "noise", "grid", "still"]))
    # few directions hold most of the variance, as in poses
    basis = np.geomspace(300, 1, dimensions)[:, None] * rng.normal(size=(dimensions, dimensions))
    parts = []
    for length in lengths:
        part = rng.normal(size=(length, dimensions)) @ basis
        if kind == "smooth":
            part = part[:1] + np.cumsum(part, axis=0) / 20
        elif kind == "grid":  # many are equally far away
            part = np.cumsum(rng.integers(-1, 2, (length, dimensions)), axis=0) % 3
        elif kind == "still":
            part[:] = part[0] if rng.integers(2) else 0.0
        parts.append(part)
    poses = np.concatenate(parts).astype(np.float32)
    size = draw(st.sampled_from([1.0, 1.0, 1e-24, 1e10]))
    starts = np.concatenate([[0], np.cumsum(lengths)[:-1]])
    queries = poses[rng.integers(len(poses), size=draw(st.integers(1, 40)))].astype(np.float64)
    if draw(st.booleans()):
        queries += rng.integers(-1, 2, queries.shape) * draw(st.sampled_from([0.5, 1.0, 100.0]))
    return poses * np.float32(size), starts, queries * size


@settings(max_examples=30, deadline=None)
@given(recordings_and_queries(), st.integers(1, 70), st.booleans())
def test_the_index_finds_the_same_as_brute_force_including_ties(problem, k, starts_known):
    poses, starts, queries = problem
    expected_distance, expected_rows = naive.nearest(poses, queries, k)
    for way in WAYS:
        index = PoseIndex(poses, starts if starts_known else None, way)
        distance, rows = index.nearest(queries, k)
        np.testing.assert_array_equal(rows, expected_rows)
        np.testing.assert_array_equal(distance, expected_distance)


@settings(max_examples=25, deadline=None)
@given(recordings_and_queries(), st.integers(1, 20), st.integers(0, 2**31))
def test_no_neighbour_is_excluded_by_bounds(problem, k, seed):
    poses, starts, queries = problem
    rng = np.random.default_rng(seed)
    with pytest.MonkeyPatch.context() as patch:
        # few seeds and short chunks, so that the bounds decide
        patch.setattr("priorfill.search.span_scan.MIN_SEED_SPANS", 1)
        patch.setattr("priorfill.search.span_scan.CHUNK_POSES", int(rng.integers(3, 20)))
        patch.setattr(
            "priorfill.search.span_scan.MAX_CHORD_ERROR", float(rng.choice([0.1, 5.0, 1e4]))
        )
        index = PoseIndex(poses, starts, way="scan")
        distance, rows = index.nearest(queries, k)
    expected_distance, expected_rows = naive.nearest(poses, queries, k)
    np.testing.assert_array_equal(rows, expected_rows)
    np.testing.assert_array_equal(distance, expected_distance)


def test_the_index_finds_the_same_among_many_blocks_of_spans(monkeypatch):
    monkeypatch.setattr("priorfill.search.span_scan.MIN_SEED_SPANS", 4)
    rng = np.random.default_rng(11)
    steps = rng.normal(0, 3, (9000, 7)) * rng.choice([0.1, 1.0, 20.0], (9000, 1))
    poses = np.cumsum(steps, axis=0).astype(np.float32)
    queries = poses[4000:4040] + rng.normal(0, 5, (40, 7)).astype(np.float32)
    index = PoseIndex(poses, np.array([0, 10, 4500]), way="scan")
    distance, rows = index.nearest(queries, 30)
    expected_distance, expected_rows = naive.nearest(poses, queries, 30)
    np.testing.assert_array_equal(rows, expected_rows)
    np.testing.assert_array_equal(distance, expected_distance)


@settings(max_examples=25, deadline=None)
@given(recordings_and_queries())
def test_bounds_of_query_segments_hold_for_every_pose_of_a_span(problem):
    from priorfill.search.kernels import BLOCK_SPANS
    from priorfill.search.span_scan import SpanScan, _bounds, _query_segment

    poses, starts, queries = problem
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("priorfill.search.span_scan.MAX_CHORD_ERROR", 1e4)
        spans = SpanScan(poses, np.append(starts, len(poses)))
    queries = queries[:16].astype(np.float32)
    segment, offset = _query_segment(spans._project(queries)[0])
    count = len(spans._vertices)
    bounds, block_minima = _bounds(spans._data, segment[None], spans._rounding)
    bounds = bounds.reshape(-1)
    away = np.linalg.norm(poses[:, None].astype(float) - queries.astype(float), axis=2).min(axis=1)
    scale = 1e-4 + 1e-6 * (np.abs(poses).max() + np.abs(queries).max())
    for span, (vertex, connected) in enumerate(
        zip(spans._vertices, spans._data.connected, strict=True)
    ):
        end = spans._vertices[span + 1] if connected else vertex + 1
        bound = bounds[span] - offset
        assert bound <= away[vertex:end].min() + scale * poses.shape[1]
    assert np.array_equal(
        block_minima[0],
        [bounds[at : at + BLOCK_SPANS].min() for at in range(0, count, BLOCK_SPANS)],
    )


@pytest.mark.parametrize("beyond", [0.25, 4.0])
def test_the_bound_of_a_pose_is_its_distance_from_the_query_segment(beyond):
    from priorfill.search.span_scan import _bounds, _SpanData

    half, across = 10.0, np.float32(0.5)
    along = np.array([half + beyond, -half - beyond, half - 1.0])
    projection = np.zeros((3, 4), dtype=np.float32)
    projection[:, 0], projection[:, 1] = along, across
    zeros = np.zeros(3, dtype=np.float32)
    poses = _SpanData(projection, np.zeros(3, dtype=bool), zeros, zeros)
    segment = np.array([[0, 0, 0, 0, 1, 0, 0, 0, half]], dtype=np.float32)
    bounds, _ = _bounds(poses, segment, 0.0)
    away = np.hypot(np.maximum(np.abs(along) - half, 0.0), across)
    np.testing.assert_allclose(bounds.ravel()[:3], away, rtol=1e-4)


def test_the_bound_of_a_parallel_span_is_its_distance_from_the_query_segment():
    from priorfill.search.span_scan import _bounds, _SpanData

    half, across = 10.0, np.float32(0.5)
    along = np.array([-half - 30.0, -half - 6.0, half + 2.0, half + 6.0])
    projection = np.zeros((4, 4), dtype=np.float32)
    projection[:, 0], projection[:, 1] = along, across
    squared_length = np.append(np.diff(along) ** 2, 0.0).astype(np.float32)
    connected = np.array([True, True, True, False])
    spans = _SpanData(projection, connected, squared_length, np.zeros(4, dtype=np.float32))
    segment = np.array([[0, 0, 0, 0, 1, 0, 0, 0, half]], dtype=np.float32)
    bounds, _ = _bounds(spans, segment, 0.0)
    np.testing.assert_allclose(
        bounds.ravel()[:4], np.hypot([6.0, 0.0, 2.0, 6.0], across), rtol=1e-3
    )


def test_the_query_segment_of_points_on_a_line_is_their_extent():
    from priorfill.search.span_scan import _query_segment

    direction = np.array([0.6, 0.0, 0.8, 0.0])
    first = np.array([900.0, -700.0, 500.0, 300.0])
    points = first + np.array([0.0, 30.0, 7.0, 12.0])[:, None] * direction
    segment, error = _query_segment(points.astype(np.float32))
    np.testing.assert_allclose(segment[:4], first + 15.0 * direction, atol=1e-3)
    np.testing.assert_allclose(np.abs(segment[4:8]), direction, atol=1e-4)
    np.testing.assert_allclose([segment[8], error], [15.0, 0.0], atol=1e-3)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 1e17])
@pytest.mark.filterwarnings("ignore:overflow encountered", "ignore:invalid value")
def test_the_index_rejects_missing_and_huge_coordinates(wrong):
    poses = np.zeros((9, 6), dtype=np.float32)
    queries = np.zeros((2, 6))
    assert PoseIndex(poses).nearest(queries, 3)[1].tolist() == [[0, 1, 2]] * 2
    assert PoseIndex(poses).nearest(queries[:0], 3)[1].shape == (0, 3)
    queries[1, 3] = wrong
    with pytest.raises(ValueError, match="coordinates are missing"):
        PoseIndex(poses).nearest(queries, 3)
    for starts in ([1, 4], [0, 4, 4], [0, 9]):
        with pytest.raises(ValueError, match="ascend from 0"):
            PoseIndex(poses, np.array(starts))


@pytest.mark.parametrize("threads", ["1", "3"])
@pytest.mark.parametrize("way", ["scan", "kd-tree"])
def test_the_index_is_the_same_on_any_number_of_threads(way, threads, monkeypatch):
    rng = np.random.default_rng(8)
    poses = np.cumsum(rng.normal(0, 5, (900, 9)), axis=0).astype(np.float32)
    monkeypatch.setenv("PRIORFILL_THREADS", threads)
    monkeypatch.setattr("os.cpu_count", lambda: 3)
    for limit in (
        "span_scan.POSES_PER_THREAD",
        "span_scan.PAIRS_PER_THREAD",
        "kd_tree.POSES_PER_THREAD",
        "kd_tree.QUERIES_PER_THREAD",
    ):
        monkeypatch.setattr(f"priorfill.search.{limit}", 10)
    distance, rows = PoseIndex(poses, way=way).nearest(poses[100:170], 20)
    expected, expected_rows = naive.nearest(poses, poses[100:170], 20)
    np.testing.assert_array_equal(rows, expected_rows)
    np.testing.assert_array_equal(distance, expected)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("size", [1e-23, 1e-18, 1e-10])
def test_coordinates_whose_squares_lose_digits_in_single_precision(way, size):
    rng = np.random.default_rng(3)
    poses = (size * np.cumsum(rng.integers(-2, 3, (300, 3)), axis=0)).astype(np.float32)
    queries = poses[50:90] + size * rng.normal(size=(40, 3))
    distance, rows = PoseIndex(poses, way=way).nearest(queries, 9)
    expected_distance, expected_rows = naive.nearest(poses, queries, 9)
    np.testing.assert_array_equal(rows, expected_rows)
    np.testing.assert_array_equal(distance, expected_distance)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("dimensions", [6, 300])
@pytest.mark.parametrize("steps", [2, 60])
def test_differences_next_to_the_rounding_errors_of_coordinates(way, dimensions, steps):
    rng = np.random.default_rng(21)
    # some units in the last place apart, in two places that are far from each other
    moved = np.cumsum(rng.integers(-1, 2, (900, dimensions)), axis=0) % steps
    poses = (2.0**23 + moved).astype(np.float32) * np.repeat(np.float32([1, -1]), 450)[:, None]
    queries = poses[rng.permutation(900)[:60]]
    queries += rng.integers(-1, 2, queries.shape).astype(np.float32)
    distance, rows = PoseIndex(poses, np.array([0, 450]), way).nearest(queries, 5)
    expected_distance, expected_rows = naive.nearest(poses, queries, 5)
    np.testing.assert_array_equal(rows, expected_rows)
    np.testing.assert_array_equal(distance, expected_distance)


@pytest.mark.parametrize("size", [1.0, 1e11])
@pytest.mark.parametrize(("poses", "steps"), [(1100, "noise"), (33_000, "walk"), (2100, "grid")])
def test_a_kd_tree_of_several_levels_finds_the_same(poses, steps, size):
    rng = np.random.default_rng(12)
    moved = {
        "noise": lambda: rng.normal(0, 5, (poses, 20)),
        "walk": lambda: np.cumsum(rng.normal(0, 5, (poses, 3)), axis=0),
        "grid": lambda: rng.integers(0, 3, (poses, 17)),
    }[steps]()
    stored = (size * moved).astype(np.float32)
    path = stored[[3, 4, 5, 5, 900, 7]] + (size * 0.1 * rng.normal(size=(6, stored.shape[1])))
    tree = PoseIndex(stored, way="kd-tree")
    distance, rows = tree.nearest(path, 33)
    expected_distance, expected_rows = naive.nearest(stored, path, 33)
    np.testing.assert_array_equal(rows, expected_rows)
    np.testing.assert_array_equal(distance, expected_distance)


def test_poses_are_searched_in_the_way_that_is_expected_to_be_fastest():
    assert choose_way(MAX_BRUTE_FORCE_POSES, 5000, 5000, None) == "brute force"
    million = 1_000_000
    assert choose_way(million, 10, 0, None) == "scan"
    assert choose_way(million, 1000, 0, None) == "kd-tree"
    assert choose_way(million, 10, 1000, "scan") == "kd-tree"  # searched again and again
    assert choose_way(million, 1, 0, "kd-tree") == "kd-tree"  # it is there
    # building a tree pays for so many queries, but not for these
    assert choose_way(10 * million, 500, 0, "scan") == "kd-tree"
    assert choose_way(100_000, 100, 0, "scan") == "scan"


def test_an_index_that_is_searched_again_builds_a_tree(monkeypatch):
    monkeypatch.setattr("priorfill.search.index.MAX_BRUTE_FORCE_POSES", 100)
    monkeypatch.setattr("priorfill.search.index.TREE_BUILT", 30.0)
    rng = np.random.default_rng(14)
    poses = np.cumsum(rng.normal(0, 5, (700, 9)), axis=0).astype(np.float32)
    index = PoseIndex(poses)
    assert index.nbytes == poses.nbytes
    ways = []
    for at in range(0, 600, 60):
        distance, rows = index.nearest(poses[at : at + 60], 4)
        expected, expected_rows = naive.nearest(poses, poses[at : at + 60], 4)
        np.testing.assert_array_equal(rows, expected_rows)
        np.testing.assert_array_equal(distance, expected)
        ways.append(type(index._made[1]).__name__)
    assert ways[0] == "SpanScan"
    assert ways[-1] == "KdTree"
    assert sorted(ways, reverse=True) == ways  # a tree that is built is kept
    assert index.nbytes > poses.nbytes


def as_takes(recordings, rate=30.0):
    return [
        own_take([Level(positions, rate, 1)], f"take{number}", "")
        for number, positions in enumerate(recordings)
    ]


def make_recordings(rng, lengths=(40, 30)):
    result = []
    for length in lengths:
        walk = np.cumsum(rng.normal(0, 5, (length, 1, 3)), axis=0)
        positions = (
            walk
            + rng.normal(0, 200, (1, 6, 3))
            + np.cumsum(rng.normal(0, 2, (length, 6, 3)), axis=0)
        )
        result.append(positions)
    return result


def test_a_pose_finds_itself_with_its_derivatives():
    rng = np.random.default_rng(3)
    priors = as_takes(make_recordings(rng))
    positions = priors[0].positions(0)
    root = root_group(positions, (0, 1, 2))
    bank = PoseBank(priors, root, np.array([0, 1, 2, 3]), np.array([4, 5]), 60.0)
    frame = np.array([17])
    frames = root.frames(positions[frame])
    found = bank.nearest(positions[frame], frames, 1)
    assert found.distance[0, 0] == pytest.approx(0, abs=1e-3)
    assert found.take[0, 0] == 0
    local = root.frames(positions).to_local(positions[:, [4, 5]])
    np.testing.assert_allclose(found.pose[0, 0], local[17], atol=1e-3)
    # the take steps at 30 Hz, the query at 60: displacements halve, second differences quarter
    np.testing.assert_allclose(found.velocity[0, 0], (local[18] - local[16]) / 4, atol=1e-3)
    np.testing.assert_allclose(
        found.acceleration[0, 0], (local[18] - 2 * local[17] + local[16]) / 4, atol=1e-3
    )


def test_a_bank_uses_only_poses_with_the_markers_it_needs():
    rng = np.random.default_rng(4)
    first, second = make_recordings(rng)
    first[10, 4] = np.nan  # wanted
    first[20, 1] = np.nan  # root
    first[30, 5] = np.nan  # not needed
    second[:, 4] = np.nan
    root = root_group(first, (0, 1, 2))
    bank = PoseBank(as_takes([first, second]), root, np.array([0, 1, 2, 3]), np.array([4]), 30.0)
    # the ends of a take, and the neighbours of a hole, have no derivatives
    holes = {0, 39, 9, 10, 11, 19, 20, 21}
    assert set(bank.rows) == set(range(40)) - holes


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**31), st.integers(2, 4), st.booleans())
def test_the_compiled_loop_gives_the_same_root_frames(seed, group, flat):
    rng = np.random.default_rng(seed)
    recordings = make_recordings(rng, (12, 9))
    recordings[0][4, rng.integers(6)] = np.nan
    root = root_group(recordings[1], tuple(rng.permutation(5)[:group]))
    if flat:  # markers on one vertical have no heading: it is then 0
        root = RootGroup(root.markers, root.template * [0.0, 0.0, 1.0])
    viable = np.sort(rng.permutation(6)[:4])
    given = (as_takes(recordings), root, viable, np.array([5]), 30.0)
    bank = PoseBank(*given)
    by_numpy = bank._local(viable)
    expected = naive.in_root_frames(
        bank.positions(bank.rows, viable),
        bank.positions(bank.rows, np.array(root.markers)),
        root.template,
    )
    np.testing.assert_allclose(by_numpy, expected, atol=1e-3)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("priorfill.search.bank.MAX_BRUTE_FORCE_POSES", 0)
        np.testing.assert_allclose(bank._local(viable), by_numpy, atol=1e-3)


def test_bank_without_poses_is_empty():
    rng = np.random.default_rng(5)
    recordings = make_recordings(rng)
    root = root_group(recordings[0], (0, 1, 2))
    for positions in recordings:
        positions[:, 5] = np.nan
    priors = as_takes(recordings)
    bank = PoseBank(priors, root, np.array([0, 1, 2]), np.array([5]), 30.0)
    assert len(bank) == 0
    with pytest.raises(ValueError, match="no pose"):
        bank.nearest(recordings[0], root.frames(recordings[0]), 3)


def test_banks_are_kept_while_they_fit():
    rng = np.random.default_rng(5)
    priors = as_takes(make_recordings(rng))
    root = root_group(priors[0].positions(0), (0, 1, 2))
    viable = np.array([0, 1, 2, 3])
    banks = PoseBankCache(priors)
    one = banks.get(root, viable, np.array([4]), 30.0)
    assert banks.get(root, viable, np.array([4]), 30.0) is one
    two = banks.get(root, viable, np.array([5]), 30.0)
    assert two is not one
    assert banks.get(root, viable, np.array([4]), 60.0) is not one

    banks = PoseBankCache(priors, max_bytes=one.nbytes + two.nbytes)
    one, two = (banks.get(root, viable, np.array([m]), 30.0) for m in (4, 5))
    assert banks.get(root, viable, np.array([4]), 30.0) is one
    banks.get(root, viable, np.array([4, 5]), 30.0)  # evicts the least recently used one
    assert banks.get(root, viable, np.array([5]), 30.0) is not two
    small = PoseBankCache(priors, max_bytes=1)
    last = small.get(root, viable, np.array([4]), 30.0)
    assert small.get(root, viable, np.array([4]), 30.0) is last


def test_a_large_bank_is_searched_in_part():
    rng = np.random.default_rng(6)
    recordings = make_recordings(rng)
    recordings[0][12, 1] = np.nan
    root = root_group(recordings[1], (0, 1, 2))
    viable = np.array([0, 1, 2, 3])
    complete = PoseBank(as_takes(recordings), root, viable, np.array([4]), 30.0)
    part = PoseBank(as_takes(recordings), root, viable, np.array([4]), 30.0, max_poses=20)
    assert len(part) == 20 < len(complete)
    assert set(part.rows) < set(complete.rows)
    assert part.nearest(recordings[0][:3], root.frames(recordings[0][:3]), 50).row.shape == (3, 20)
    # poses before and after are found all the same, within the take and where it is complete
    for bank in (complete, part):
        rows = np.array([5, 20, 9, 38, 42])
        assert bank.shifted(rows, 2).tolist() == [7, 22, 9, 38, 44]
        assert bank.shifted(rows, -2).tolist() == [3, 18, 7, 36, 42]


def test_the_distances_of_a_pose_from_all_rows_are_those_of_the_search():
    rng = np.random.default_rng(8)
    recordings = make_recordings(rng)
    root = root_group(recordings[0], (0, 1, 2))
    bank = PoseBank(as_takes(recordings), root, np.array([0, 1, 2, 3]), np.array([4]), 30.0)
    pose = rng.normal(0.0, 300.0, (1, 6, 3))
    distance, rows = bank.search(pose, root.frames(pose), len(bank))
    found = bank.distances(pose, root.frames(pose))
    np.testing.assert_allclose(found[np.searchsorted(bank.rows, rows[0])], distance[0], rtol=1e-5)


def test_usable_spans_are_complete_and_of_one_take():
    rng = np.random.default_rng(9)
    first, second = make_recordings(rng, (40, 30))
    first[20, 4] = np.nan
    root = root_group(first, (0, 1, 2))
    bank = PoseBank(as_takes([first, second]), root, np.array([0, 1, 2, 3]), np.array([4]), 30.0)
    usable = bank.usable_spans(np.arange(70), -2, 5)
    # the first and the last pose of a take have no velocity, nor have those next to a gap
    expected = [3 <= r <= 13 or 24 <= r <= 33 or 43 <= r <= 63 for r in range(70)]
    assert usable.tolist() == expected
