"""Write a long synthetic C3D file with several kinds of gaps, for the memory benchmark.

    python scripts/bench/long_clip.py OUT.c3d [--minutes 10] [--rate 240] [--markers 60]

The 41 markers of the generator walk, reach, turn and squat. Further markers lie between two of them
on the same segment, so that they move like markers.
"""

from __future__ import annotations

import argparse
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np

from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.synthetic import MARKER_SEGMENTS, Body, synthesise

sys.path.append(str(Path(__file__).resolve().parents[2] / "tests" / "support"))
from c3d_bytes import C3DFile

SEED = 6
"""Of the motion."""

BETWEEN = (0.35, 0.65)
"""Where on the line between two markers an added one sits."""

OUTWARDS = 15.0
"""mm. How far it is off that line."""

WORD_BITS = 16
WORD = 2**WORD_BITS - 1
"""The greatest number of frames that a word holds."""

ARM = ("LUPA", "LELB", "LFRM", "LWRA", "LWRB", "LFIN")
LEG = ("RTHI", "RKNE", "RSHN", "RANK", "RHEE", "RTOE", "RMT5")
FOREARM = ("RELB", "RFRM", "RWRA", "RWRB", "RFIN")

GAPS: tuple[tuple[float, float, tuple[str, ...]], ...] = (
    (0.02, 0.5, ("LFHD",)),
    (0.05, 3.0, ("RKNE",)),
    (0.10, 20.0, ("CLAV",)),
    (0.20, 3.0, ARM),
    (0.30, 10.0, LEG),
    (0.40, 60.0, FOREARM),
    (0.60, 5.0, ARM),
    (0.602, 5.0, LEG),
    (0.604, 5.0, FOREARM),
    (0.75, 60.0, ("LHEE",)),
    (0.90, 0.1, ("STRN",)),
)
"""Start of a gap (as part of the clip), its length (s), and its markers:
single ones, limbs, three limbs at once, and a minute."""


def more_markers(positions: np.ndarray, count: int) -> np.ndarray:
    """Return markers between two of one segment [shape=(frames, count, 3), mm]."""
    by_segment: dict[str, list[int]] = {}
    for marker, segment in enumerate(MARKER_SEGMENTS):
        by_segment.setdefault(segment, []).append(marker)
    pairs = [
        (one, other, share)
        for share in BETWEEN
        for some in by_segment.values()
        for one, other in pairwise(some)
    ]
    if count > len(pairs):
        raise SystemExit(f"{count} more markers are too many; at most {len(pairs)}")
    added = np.empty((len(positions), count, 3))
    for place, (one, other, share) in enumerate(pairs[:count]):
        along = positions[:, other] - positions[:, one]
        across = np.cross(along, (0.0, 0.0, 1.0))
        across *= OUTWARDS / np.linalg.norm(across, axis=1, keepdims=True).clip(1.0)
        added[:, place] = positions[:, one] + share * along + across
    return added


class LongFile(C3DFile):
    """A C3D file with any number of frames: `TRIAL` holds counts beyond 16 bits."""

    def words(self, values: np.ndarray) -> bytes:
        """Return the bytes of all samples at once."""
        return values.astype("<f4").tobytes()


def write(path: Path, positions: np.ndarray, labels: tuple[str, ...], rate: float) -> None:
    """Write positions [shape=(frames, markers, 3), mm], NaN where missing."""
    records = np.zeros((*positions.shape[:2], 4), dtype=np.float32)
    records[..., :3] = np.nan_to_num(positions)
    records[..., 3] = np.where(np.isnan(positions[..., 0]), -1.0, 0.0)
    last = [len(records) & WORD, len(records) >> WORD_BITS]
    trial = {"ACTUAL_START_FIELD": [1, 0], "ACTUAL_END_FIELD": last}
    file = LongFile(records, list(labels), rate=rate, parameters={"TRIAL": trial})
    path.write_bytes(file.bytes())


def main() -> None:
    """Make the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("output", type=Path)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--rate", type=float, default=240.0)
    parser.add_argument("--markers", type=int, default=60)
    arguments = parser.parse_args()
    seconds = 60.0 * arguments.minutes
    first = synthesise("mixed", seconds=seconds, rate=arguments.rate, body=Body(seed=1), seed=SEED)
    positions = first.positions
    extra = max(0, arguments.markers - len(first.labels))
    positions = np.concatenate([positions, more_markers(positions, extra)], axis=1)
    labels = (*first.labels, *(f"X{i:02d}" for i in range(extra)))
    for begin, length, gone in GAPS:
        start = round(begin * len(positions))
        stop = start + round(min(length, 0.1 * seconds) * arguments.rate)
        positions[start:stop, [labels.index(label) for label in gone]] = np.nan
    write(arguments.output, positions, labels, arguments.rate)
    print(f"{len(positions)} frames, {len(labels)} markers")


if __name__ == "__main__":
    replace_what_is_lacking()
    main()
