"""Detection of artefacts: plant artefacts in clean recordings and count those detected.

    python scripts/studies/artefact_study.py [--data FOLDER] [--seed N] [--count N] [--fill N]

Prints by kind and size the recall (planted artefacts with at least half of their samples detected)
and the precision (detected samples that were planted), and the same for a fixed speed limit, the
common practice, at the limit that is best for these artefacts. ``--fill N`` fills N artefacts of
each kind with ``reject_artefacts`` and prints their errors before and after.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.cli.encoding import replace_what_is_lacking

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from method_alone import method_alone
from recordings import add_data_option

from priorfill import Clip, fill, read
from priorfill.artefacts import artefact_samples, find_artefacts
from priorfill.gaps import runs

CLEAN = (
    "hdm05/HDM_bd_01-02_01_120.c3d",
    "hdm05/HDM_bd_05-01_01_120.c3d",
    "hdm05/HDM_dg_06-03_03_120.c3d",
    "cmu/127_07.c3d",
    "cmu/132_43.c3d",
    "cmu/85_02.c3d",
    "cmu/141_04.c3d",
    "gait/HC002D06.c3d",
    "gait/HC036A23.c3d",
    "gait/HC21A06.c3d",
    "walkl/WalkL.c3d",
)
"""Recordings of fast and slow motion in which no artefacts are found, or (walkl) hardly any."""

SPEEDS = (2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0)
"""m/s. Fixed limits; the best one is used."""

MAX_ARTEFACT_SECONDS = 1.0
"""s. Longest ghost marker that is planted."""

TOLERANCE = 2
"""Frames next to a planted artefact that may be reported too: a break is between frames."""

MAX_FRAMES = 2600
"""Frames of a clip that are used, to limit the time."""

MIRROR = {"L": "R", "R": "L"}


@dataclass(frozen=True)
class Plant:
    """A clip with an artefact: its positions, and the samples concerned."""

    kind: str
    positions: NDArray[np.float64]
    wrong: NDArray[np.bool_]


def spike(size: float) -> Callable[[Clip, np.random.Generator], Plant | None]:
    """Return a planter of spikes of 1 to 10 frames at 120 Hz, steep or round."""

    def plant(clip: Clip, rng: np.random.Generator) -> Plant | None:
        length = max(1, round(rng.integers(1, 11) * clip.rate / 120))
        marker, part = _place(clip, rng, length)
        shape = np.ones(length)
        if rng.random() < 0.5:
            shape = np.sin(np.pi * (np.arange(length) + 1) / (length + 1))
        moved = clip.positions.copy()
        moved[part, marker] += size * shape[:, None] * _direction(rng)
        return Plant(f"spike {size:g} mm", moved, _wrong(clip, part, marker))

    return plant


def ghost_marker(size: float) -> Callable[[Clip, np.random.Generator], Plant | None]:
    """Return a planter of jumps to a reflection at rest, for 0.1 to 1 s."""

    def plant(clip: Clip, rng: np.random.Generator) -> Plant | None:
        marker, part = _place(clip, rng, round(rng.uniform(0.11, 1.0) * clip.rate))
        moved = clip.positions.copy()
        moved[part, marker] = moved[part.start, marker] + size * _direction(rng)
        moved[part, marker] += rng.normal(0.0, 0.2, (part.stop - part.start, 3))
        return Plant(f"ghost marker {size:g} mm", moved, _wrong(clip, part, marker))

    return plant


def mislabelled(near: bool) -> Callable[[Clip, np.random.Generator], Plant | None]:
    """Return a planter of labels that move to another marker until the end of the clip."""

    def plant(clip: Clip, rng: np.random.Generator) -> Plant | None:
        marker = int(rng.integers(len(clip.labels)))
        other = _nearest(clip, marker) if near else int(rng.integers(len(clip.labels)))
        part = slice(int(rng.uniform(0.55, 0.9) * clip.frames), clip.frames)
        if other == marker or np.isnan(clip.positions[:, [marker, other]]).any():
            return None
        moved = clip.positions.copy()
        moved[part, marker], moved[part, other] = moved[part, other].copy(), np.nan
        kind = f"mislabelled, {'nearest' if near else 'any'} marker"
        return Plant(kind, moved, _wrong(clip, part, marker))

    return plant


def swap(which: str) -> Callable[[Clip, np.random.Generator], Plant | None]:
    """Return a planter of label swaps with the nearest or the contralateral marker."""

    def plant(clip: Clip, rng: np.random.Generator) -> Plant | None:
        marker, part = _place(clip, rng, round(rng.uniform(0.05, 0.6) * clip.rate))
        if "end" in which:
            part = slice(int(rng.uniform(0.55, 0.9) * clip.frames), clip.frames)
        other = _nearest(clip, marker)
        if "sides" in which:
            label = clip.labels[marker]
            across = MIRROR.get(label[0], "") + label[1:]
            if across == label[1:] or across not in clip.labels:
                return None
            other = clip.labels.index(across)
        if np.isnan(clip.positions[:, [marker, other]]).any():
            return None
        moved = clip.positions.copy()
        moved[part, [marker, other]] = moved[part, [other, marker]]
        wrong = _wrong(clip, part, marker) | _wrong(clip, part, other)
        return Plant(f"label swap, {which}", moved, wrong)

    return plant


def stuck(shortest: int, longest: int) -> Callable[[Clip, np.random.Generator], Plant | None]:
    """Return a planter of stuck markers whose true path moves by more than 15 mm."""

    def plant(clip: Clip, rng: np.random.Generator) -> Plant | None:
        for _ in range(50):
            marker, part = _place(clip, rng, int(rng.integers(shortest, longest + 1)))
            path = clip.positions[part, marker]
            if np.linalg.norm(path - path[:1], axis=1).max() > 15.0:
                moved = clip.positions.copy()
                moved[part, marker] = moved[part.start, marker]
                wrong = _wrong(clip, part, marker)
                return Plant(f"stuck {shortest}-{longest} frames", moved, wrong)
        return None

    return plant


def permuted(where: str) -> Callable[[Clip, np.random.Generator], Plant | None]:
    """Return a planter of permuted labels in 1 to 30 frames next to a blackout or at an end."""

    def plant(clip: Clip, rng: np.random.Generator) -> Plant | None:
        length, gap = int(rng.integers(1, 31)), int(rng.integers(5, 61))
        moved = clip.positions.copy()
        start = {"first frames": 0, "last frames": clip.frames - length}.get(where, -1)
        if start < 0:
            begin = int(rng.integers(clip.frames // 4, clip.frames * 3 // 4 - gap))
            moved[begin : begin + gap] = np.nan
            start = begin + gap if where == "after a blackout" else begin - length
        part = slice(start, start + length)
        count = min(int(rng.choice([2, 3, 6, 15, 200])), len(clip.labels))
        markers = rng.choice(len(clip.labels), count, replace=False)
        order = np.roll(markers, 1)
        moved[part, markers] = moved[part, order]
        wrong = np.zeros(clip.missing.shape, dtype=bool)
        wrong[part, markers] = ~np.isnan(moved[part, markers, 0])
        return Plant(f"permuted, {where}", moved, wrong) if wrong.any() else None

    return plant


PLANTERS = (
    *(spike(size) for size in (20.0, 50.0, 100.0, 500.0)),
    *(ghost_marker(size) for size in (30.0, 50.0, 150.0, 500.0)),
    mislabelled(near=True),
    mislabelled(near=False),
    swap("neighbours"),
    swap("sides"),
    swap("neighbours, to the end"),
    swap("sides, to the end"),
    stuck(5, 20),
    stuck(21, 100),
    permuted("first frames"),
    permuted("last frames"),
    permuted("before a blackout"),
    permuted("after a blackout"),
)


def _place(clip: Clip, rng: np.random.Generator, length: int) -> tuple[int, slice]:
    """Draw a marker and an interval in which it is measured."""
    length = min(length, clip.frames // 3)
    for _ in range(100):
        marker = int(rng.integers(len(clip.labels)))
        start = int(rng.integers(10, clip.frames - length - 10))
        if not np.isnan(clip.positions[start - 5 : start + length + 5, marker]).any():
            break
    return marker, slice(start, start + length)


def _nearest(clip: Clip, marker: int) -> int:
    """Return the marker that is nearest on average."""
    apart = np.linalg.norm(clip.positions - clip.positions[:, marker : marker + 1], axis=2)
    mean = np.nanmean(apart[::10], axis=0)
    mean[marker] = np.inf
    return int(np.argmin(np.where(np.isnan(mean), np.inf, mean)))


def _direction(rng: np.random.Generator) -> NDArray[np.float64]:
    """Return a random direction."""
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def _wrong(clip: Clip, part: slice, marker: int) -> NDArray[np.bool_]:
    """Return a mask of some samples."""
    wrong = np.zeros(clip.missing.shape, dtype=bool)
    wrong[part, marker] = True
    return wrong


def too_fast(clip: Clip, limit: float) -> NDArray[np.bool_]:
    """Return the samples reported by a fixed limit of speed (m/s).

    Samples between two violations count too, up to `MAX_ARTEFACT_SECONDS` apart.
    """
    speed = np.linalg.norm(np.diff(clip.positions, axis=0), axis=2) * clip.rate / 1000.0
    fast = np.nan_to_num(speed) > limit
    found = np.zeros(clip.missing.shape, dtype=bool)
    for marker in np.flatnonzero(fast.any(axis=0)):
        at = np.flatnonzero(fast[:, marker]) + 1
        found[at, marker] = True
        for start, stop in pairwise(at):
            if stop - start <= MAX_ARTEFACT_SECONDS * clip.rate:
                found[start:stop, marker] = True
    return found


def widened(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return a mask with some frames more at the ends of each run."""
    wide = np.zeros_like(mask)
    for marker in np.flatnonzero(mask.any(axis=0)):
        for start, stop in runs(mask[:, marker]):
            wide[max(0, start - TOLERANCE) : stop + TOLERANCE, marker] = True
    return wide


def planted(data: Path, seed: int, count: int) -> Iterator[tuple[Clip, Clip, Plant]]:
    """Yield clips, clips with artefacts, and the planted artefact."""
    rng = np.random.default_rng(seed)
    for name in CLEAN:
        clip = read(data / name)
        clip = Clip(clip.positions[:MAX_FRAMES], clip.labels, clip.rate, clip.up, clip.name)
        for planter in PLANTERS:
            for _ in range(count):
                plant = planter(clip, rng)
                if plant is not None:
                    yield clip, clip.with_positions(plant.positions), plant


@dataclass
class Tally:
    """How often a kind was planted and found, and how many samples were reported."""

    plants: int = 0
    found: int = 0
    called: int = 0
    right: int = 0

    def add(self, called: NDArray[np.bool_], before: NDArray[np.bool_], plant: Plant) -> None:
        """Count a planted artefact; samples reported before it was planted do not count."""
        called = called & ~before
        self.plants += 1
        self.found += int(called[plant.wrong].mean() >= 0.5)
        self.called += int(called.sum())
        self.right += int((called & widened(plant.wrong)).sum())

    @property
    def recall(self) -> float:
        """Share of planted artefacts that were detected."""
        return self.found / max(self.plants, 1)

    @property
    def precision(self) -> float:
        """Share of the reported samples that were planted."""
        return self.right / self.called if self.called else float("nan")


def score(tallies: dict[str, Tally]) -> float:
    """Return the harmonic mean of the mean recall and the precision of all samples."""
    recall = float(np.mean([tally.recall for tally in tallies.values()]))
    called = sum(tally.called for tally in tallies.values())
    precision = sum(tally.right for tally in tallies.values()) / max(called, 1)
    return 2 * recall * precision / max(recall + precision, 1e-9)


def study(data: Path, seed: int, count: int) -> None:
    """Plant, detect, count and print."""
    ours: dict[str, Tally] = {}
    limits: dict[float, dict[str, Tally]] = {limit: {} for limit in SPEEDS}
    known: dict[str, NDArray[np.bool_]] = {}
    for clip, bad, plant in planted(data, seed, count):
        if clip.name not in known:
            known[clip.name] = artefact_samples(find_artefacts(clip), clip.labels, clip.frames)
        called = artefact_samples(find_artefacts(bad), clip.labels, clip.frames) & ~bad.missing
        ours.setdefault(plant.kind, Tally()).add(called, known[clip.name], plant)
        for limit, tallies in limits.items():
            tally = tallies.setdefault(plant.kind, Tally())
            # its false positives count: they are not known beforehand in practice
            tally.add(too_fast(bad, limit), np.zeros_like(plant.wrong), plant)
    best = max(SPEEDS, key=lambda limit: score(limits[limit]))
    naive = limits[best]
    print(
        f"{'kind':32}{'plants':>7}{'recall':>8}{'prec.':>8}   "
        f"speed above {best:g} m/s: recall, precision"
    )
    for kind, tally in ours.items():
        other = naive[kind]
        print(
            f"{kind:32}{tally.plants:7}{tally.recall:8.0%}{tally.precision:8.0%}"
            f"{other.recall:20.0%}{other.precision:8.0%}"
        )
    print(f"score {score(ours):.2f}, of a speed limit {score(naive):.2f}: ", end="")
    print(f"{score(ours) / max(score(naive), 1e-9):.2f} times")


def filling(data: Path, seed: int, count: int) -> None:
    """Fill with detected samples rejected, and print errors before and after."""
    errors: dict[str, list[tuple[float, float]]] = {}
    for clip, bad, plant in planted(data, seed, 1):
        if len(errors.get(plant.kind, [])) >= count or clip.frames > 1000:
            continue
        result = fill(bad, reject_artefacts=True, options=method_alone())
        before, after = (
            float(np.nanmean(np.linalg.norm(p - clip.positions, axis=2)[plant.wrong]))
            for p in (bad.positions, result.clip.positions)
        )
        errors.setdefault(plant.kind, []).append((before, after))
    print(f"\n{'kind':32}{'fills':>7}{'before':>9}{'filled mm':>11}{'worst mm':>10}")
    for kind, pairs in errors.items():
        before, after = np.array(pairs).T
        print(
            f"{kind:32}{len(pairs):7}{np.mean(before):9.1f}{np.median(after):11.1f}{after.max():10.1f}"
        )


def main() -> None:
    """Read the options and run."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    add_data_option(parser)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=4, help="artefacts of each kind in each clip")
    parser.add_argument(
        "--fill", type=int, default=0, help="artefacts of each kind that are filled"
    )
    options = parser.parse_args()
    study(options.data, options.seed, options.count)
    if options.fill:
        filling(options.data, options.seed, options.fill)


if __name__ == "__main__":
    replace_what_is_lacking()
    main()
