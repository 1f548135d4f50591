#!/usr/bin/env python
"""Speed of the pose search: kd-tree, scan and brute force, and SciPy's kd-tree.

    python scripts/bench/search.py [--data DIR] [--poses 1e6] [--takes 135_02,02_01,...]
                                   [--threads 1] [--noise] [--check 0] [--no-scipy]

Builds sets of poses of 18 markers from recordings (`search_poses.py`), one for each number in
``--poses`` (as ``1e4,1e5,1e6``), and searches the 64 nearest poses of 300 consecutive frames of a
take that is not part of it, with

kd-tree   priorfill's kd-tree
scan      priorfill's bounds of all poses
compare   all squared distances by a matrix product in single precision, block by block, with the
          candidates measured in double precision
scipy     scipy.spatial.cKDTree on the coordinates as they are; up to 10^6 poses

Each runs in a process of its own, whose peak resident memory, poses included, is printed. *First*
is the search for one gap, including building; *again* is another search in the same poses; the best
of several repetitions counts. The last columns are the time of the kd-tree relative to that of each
other method. ``--noise`` uses unrelated random poses. ``--check`` compares that many random queries
with brute force: rows and distances must be equal bit by bit.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.cli.encoding import replace_what_is_lacking

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from recordings import add_data_option

K, QUERIES = 64, 300
OURS = ("kd-tree", "scan")
MAX_SCIPY_POSES = 1_000_000
"""Beyond, SciPy takes minutes."""
REPEATS = 3

FOLDER = {"135_02": "cmu", "85_02": "cmu", "02_01": "cmu", "HDM_bd_05-01_01_120": "hdm05"}
"""Folders of the query takes: karate, acrobatics, a walk, and mixed motion."""

BLOCK = 8192
"""Poses compared at a time, so that products stay in the cache."""

SPARE, CHECK_SPARE = 2, 16
"""Candidates measured in double precision, as multiples of k. More for random queries: some are
poses of the database, whose neighbours are hard to distinguish in single precision."""


class BruteForce:
    """Compares all poses with each query."""

    def __init__(self, poses: NDArray[np.float32], spare: int = SPARE) -> None:
        self._poses, self._spare = poses, spare
        self._centre = poses[::1009].mean(axis=0)

    def nearest(self, queries: NDArray[np.float32], k: int) -> tuple[NDArray, NDArray]:
        """Return distances and rows of the nearest poses; ties are ordered by row."""
        centred = queries - self._centre
        keep = min(self._spare * k, len(self._poses))
        best = [np.empty(0, np.float32)] * len(queries)
        rows = [np.empty(0, np.intp)] * len(queries)
        limit = np.full(len(queries), np.inf, dtype=np.float32)
        largest = 0.0
        for at in range(0, len(self._poses), BLOCK):
            block = self._poses[at : at + BLOCK] - self._centre
            norms = np.einsum("pd,pd->p", block, block)
            largest = max(largest, float(norms.max()))
            square = centred @ (-2.0 * block.T)
            square += norms
            for query in np.flatnonzero(square.min(axis=1) < limit):
                near = np.flatnonzero(square[query] < limit[query])
                value = np.concatenate([best[query], square[query, near]])
                row = np.concatenate([rows[query], near + at])
                if len(value) > keep:
                    chosen = np.argpartition(value, keep - 1)[:keep]
                    value, row = value[chosen], row[chosen]
                    limit[query] = value.max()
                best[query], rows[query] = value, row
        distance = np.empty((len(queries), min(k, len(self._poses))))
        found = np.empty(distance.shape, dtype=np.intp)
        for query, row in enumerate(rows):
            square, order = self._measured(queries[query], np.sort(row), k)
            norm = float(centred[query] @ centred[query])
            # bound of the rounding error: poses that were not measured must be farther
            lost = 4.0 * queries.shape[1] * 2.0**-24 * (largest + norm)
            if limit[query] + norm - lost < square[-1]:
                square, order = self._measured(queries[query], np.arange(len(self._poses)), k)
            distance[query], found[query] = np.sqrt(square), order
        return distance, found

    def _measured(
        self, query: NDArray[np.float32], rows: NDArray[np.intp], k: int
    ) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        """Return squared distances and rows of the nearest of some poses, in double precision."""
        square = np.zeros(len(rows))
        for d in range(len(query)):  # same order of summation as in the index
            square += (self._poses[rows, d].astype(np.float64) - np.float64(query[d])) ** 2
        order = np.argsort(square, kind="stable")[:k]
        return square[order], rows[order]


def work(method: str, folder: Path, repeats: int, threads: int) -> None:
    """Search with one method and print wall and CPU seconds of both searches, and MB."""
    poses, starts = np.load(folder / "poses.npy"), np.load(folder / "starts.npy")
    queries = np.load(folder / "queries.npy")

    def first() -> tuple[object, tuple[NDArray, NDArray]]:
        if method in OURS:
            from priorfill.search.index import PoseIndex

            index = PoseIndex(poses, starts, method)
            return index, index.nearest(queries, K)
        if method == "scipy":
            from scipy.spatial import cKDTree

            tree = cKDTree(poses)
            return tree, tree.query(queries, K, workers=threads)
        compare = BruteForce(poses)
        return compare, compare.nearest(queries, K)

    if method in OURS:  # compile, or load from the cache
        from priorfill.search.index import PoseIndex

        PoseIndex(poses[:100], way=method).nearest(queries[:1], 1)
    times = []
    for _ in range(repeats):
        wall, cpu = time.perf_counter(), time.process_time()
        searcher, found = first()
        one = (time.perf_counter() - wall, time.process_time() - cpu)
        wall, cpu = time.perf_counter(), time.process_time()
        if method == "scipy":
            searcher.query(queries, K, workers=threads)
        else:
            searcher.nearest(queries, K)
        times.append((*one, time.perf_counter() - wall, time.process_time() - cpu))
    np.savez(folder / f"{method}.npz", distance=found[0], rows=found[1])
    print(*np.min(times, axis=0), peak_bytes() / 2**20)


def peak_bytes() -> int:
    """Return the most resident memory that this process has had."""
    try:
        import resource
    except ImportError:  # Windows
        import psutil

        return int(psutil.Process().memory_info().peak_wset)
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def in_a_process(method: str, folder: Path, threads: int) -> list[float]:
    """Run `work` in a new process and return the numbers that it prints."""
    limits = dict.fromkeys(("PRIORFILL_THREADS", "OPENBLAS_NUM_THREADS"), str(threads))
    if method in OURS:
        limits["OPENBLAS_NUM_THREADS"] = "1"  # as in a fill
    done = subprocess.run(
        [sys.executable, __file__, "--work", method, "--folder", folder, "--threads", str(threads)],
        check=True,
        capture_output=True,
        encoding="utf-8",
        env={**os.environ, **limits},
    )
    return [float(word) for word in done.stdout.split()]


def check(folder: Path, count: int) -> None:
    """Compare both ways with brute force for random queries."""
    from priorfill.search.index import PoseIndex

    poses, starts = np.load(folder / "poses.npy"), np.load(folder / "starts.npy")
    rng = np.random.default_rng(1)
    queries = poses[rng.integers(len(poses), size=count)]
    # a third are poses of the database, a third near them, a third between two of them
    queries[count // 3 :] += rng.normal(0, 20, queries[count // 3 :].shape).astype(np.float32)
    middle = 2 * count // 3
    queries[middle:] = (queries[middle:] + poses[rng.integers(len(poses), size=count - middle)]) / 2
    indices = [PoseIndex(poses, starts, way) for way in OURS]
    compare = BruteForce(poses, CHECK_SPARE)
    same = 0
    for at in range(0, count, 1000):
        expected, expected_rows = compare.nearest(queries[at : at + 1000], K)
        equal = np.ones(len(expected), dtype=bool)
        for index in indices:
            distance, rows = index.nearest(queries[at : at + 1000], K)
            equal &= ((distance == expected) & (rows == expected_rows)).all(axis=1)
        same += int(equal.sum())
    print(f"\n{same} of {count} random queries: equal to brute force bit by bit")


def poses_and_queries(
    data: Path, take: str, count: int
) -> tuple[NDArray[np.float32], NDArray[np.intp], NDArray[np.float32]] | None:
    """Return poses, where their clips start, and queries; None without the take's file."""
    if take == "noise":
        rng = np.random.default_rng(0)
        poses = rng.standard_normal((count, 54), dtype=np.float32) * 300
        queries = rng.standard_normal((QUERIES, 54), dtype=np.float32) * 300
        return poses, np.zeros(1, dtype=np.intp), queries
    import search_poses

    file = data / FOLDER[take] / f"{take}.c3d"
    recording = search_poses.read(file) if file.exists() else None
    if recording is None:
        print(f"{file}: file not found; name the folder of recordings with --data")
        return None
    at = (len(recording[0]) - QUERIES) // 2
    poses, starts = search_poses.database(search_poses.pieces(data, take), count, seed=0)
    return poses, starts, recording[0][at : at + QUERIES]


def compare_methods(take: str, count: int, arguments: argparse.Namespace, folder: Path) -> bool:
    """Print a row for each method; return whether all of ours found what brute force finds."""
    methods = [*OURS, "compare"]
    if count <= MAX_SCIPY_POSES and not arguments.no_scipy:
        methods.append("scipy")
    times: dict[str, list[float]] = {}
    for method in methods:
        times[method] = one = in_a_process(method, folder, arguments.threads)
        tree = times["kd-tree"]
        ratios = [tree[part] / one[part] for part in (1, 3)]  # CPU
        print(
            f"{take:20s} {count:9d} {method:8s} {one[0]:10.3f} {one[1]:7.3f} {one[2]:10.3f} "
            f"{one[3]:7.3f} {one[4]:6.0f} {ratios[0]:10.4f} {ratios[1]:7.4f}",
            flush=True,
        )
    with np.load(folder / "compare.npz") as expected:
        for method in OURS:
            with np.load(folder / f"{method}.npz") as found:
                if not all(np.array_equal(found[name], expected[name]) for name in found.files):
                    print(f"{take}: the results of {method} and brute force differ")
                    return False
    return True


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_data_option(parser)
    parser.add_argument("--poses", default="1e6", help="numbers of poses, separated by commas")
    parser.add_argument("--takes", default=",".join(FOLDER))
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--noise", action="store_true")
    parser.add_argument("--check", type=int, default=0)
    parser.add_argument("--no-scipy", action="store_true")
    parser.add_argument("--work", help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help="folder of the poses")
    parser.add_argument(
        "--repeats", type=int, default=REPEATS, help="repetitions, but of SciPy's tree"
    )
    arguments = parser.parse_args()
    if arguments.work:
        repeats = 1 if arguments.work == "scipy" else arguments.repeats
        work(arguments.work, arguments.folder, repeats, arguments.threads)
        return 0

    print(f"k = {K}, {QUERIES} queries, {arguments.threads} threads; s and MB\n")
    print(
        f"{'take':20s} {'poses':>9s} {'method':8s} {'first wall':>10s} {'cpu':>7s} "
        f"{'again wall':>10s} {'cpu':>7s} {'MB':>6s} {'tree/this':>10s} {'again':>7s}"
    )
    with tempfile.TemporaryDirectory(dir=arguments.folder) as temporary:
        folder = Path(temporary)
        for take in ["noise"] if arguments.noise else arguments.takes.split(","):
            for count in (int(float(number)) for number in arguments.poses.split(",")):
                made = poses_and_queries(arguments.data, take, count)
                if made is None:
                    return 1
                for name, array in zip(("poses", "starts", "queries"), made, strict=True):
                    np.save(folder / f"{name}.npy", array)
                del made, array
                if not compare_methods(take, count, arguments, folder):
                    return 1
        if arguments.check:
            check(folder, arguments.check)
    print(
        "\ntree/this: CPU time of the first search with the kd-tree relative to that with the "
        "method;\nagain: the same of the second search."
    )
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
