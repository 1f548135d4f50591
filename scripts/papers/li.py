"""Recordings, gaps and errors for the tables of Li, Yu, Kieu, Vuong and Zhang 2020.

The paper fills samples of 200 frames of South-East Asian dances, 15 markers, which are not
available. Its protocol is applied to other recordings of whole-body motion, reduced to 15 markers
near those joints, at 30 Hz. Recordings are divided into stretches of 200 frames. Every complete one
is a sample, and all others are training data: the paper's training sequences are from the same
recordings, too. Gaps begin at frame 101, in markers that are evenly distributed, the same in all
samples. Table 3 and the right half of figure 8 have two-dimensional tracking data in pixels, which
are out of scope.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from paper import Cell, Comparison, error, find, method_alone, options, print_table

import priorfill as pf
from priorfill.errors import ClipError
from priorfill.evaluation import Evaluation
from priorfill.evaluation.body_parts import BodyParts
from priorfill.evaluation.gap_generator import measured_in
from priorfill.evaluation.protocols import GapMask, GapProtocol, SkippedCase
from priorfill.formats import SUFFIXES
from priorfill.methods import METHODS
from priorfill.signal.resample import resample

__all__ = [
    "GAP_START",
    "METHODS_OF_TABLE_1",
    "OTHER_RECORDINGS",
    "OURS",
    "PAPER",
    "RATE",
    "SAMPLE",
    "EvenGaps",
    "Material",
    "by_case",
    "by_recording",
    "cell",
    "database_of",
    "evaluated",
    "evenly_distributed",
    "filled_by",
    "mae",
    "material",
    "parser_of",
    "print_data",
    "refusals",
]

RATE = 30.0
"""Hz. Rate of the samples; the paper does not state its own, the authors' program has 30 Hz."""

JOINTS = (
    *("LFHD", "C7", "STRN"),
    *("LSHO", "LELB", "LWRA", "RSHO", "RELB", "RWRA"),
    *("LFWT", "LKNE", "LANK", "RFWT", "RKNE", "RANK"),
)
"""Fifteen of the 41 markers, one near each joint of the paper's skeleton."""

NAMES = (
    "cmu/135_07.c3d",
    "hdm05/HDM_bd_05-01_01_120.c3d",
    "cmu/135_02.c3d",
    "hdm05/HDM_bd_01-02_01_120.c3d",
    "cmu/01_01.c3d",
    "cmu/85_02.c3d",
    "cmu/132_43.c3d",
    "cmu/80_10.c3d",
    "cmu/132_32.c3d",
    "cmu/141_04.c3d",
    "cmu/02_01.c3d",
)
"""Recordings used instead of the dances, the long ones first: karate, sports, walks, acrobatics."""

SAMPLE = 200
"""Frames of a sample, as in the paper."""

GAP_START = 100
"""Complete frames of a sample before its gaps, which begin at frame 101."""

ASIDE = 1000.0
"""mm. Translation of copies; the mean of visible markers is subtracted from each frame."""

MIN_FRAMES = 30
"""Minimum number of frames of a training stretch: one second."""

METHODS_OF_TABLE_1 = {
    "WPCA": "wpca",
    "LGRNN": "lgrnn",
    "GLR": "glr",
    "LPR": "lpr",
    "LI": "li",
    "PMA": "pma",
    "Eq. (4)": "pca-pieces",
}
"""Methods by their names in the paper."""

OURS = "gpr"
"""The default method of priorfill, which is not in the paper."""

OTHER_RECORDINGS = "other recordings"
"""Why values differ: none of the paper's recordings is available."""

PAPER = "20 samples of 200 frames of South-East Asian dances, 15 markers (not available)"

RECORDING = "a recording to fill instead, longer than 7 s, of the 41 markers or of any others"


@dataclass(frozen=True)
class Material:
    """Samples and training data.

    Attributes
    ----------
    samples : list of Clip
        Each of `SAMPLE` frames at `RATE`.
    training : list of Clip
        Training data: the rest of their recordings, or others.
    files : list of Path
        Source recordings.
    """

    samples: list[pf.Clip]
    training: list[pf.Clip]
    files: list[Path]


def parser_of(doc: str | None, methods: Collection[str]) -> argparse.ArgumentParser:
    """Return the parser of a script with its default methods."""
    parser = options(doc, recording=RECORDING)
    parser.add_argument(
        "--methods",
        metavar="NAMES",
        default=",".join(methods),
        help="methods, separated by commas; %(default)s if not given",
    )
    parser.add_argument(
        "--training",
        type=Path,
        metavar="DIR",
        help="folder of recordings with the same markers, used as training data instead",
    )
    return parser


def material(arguments: argparse.Namespace) -> Material:
    """Return samples and training data.

    Recordings are divided into stretches of `SAMPLE` frames. All complete ones are samples, and all
    stretches are training data, each for the other samples.

    With ``--training`` only the recordings below that folder are training data, without those that
    have the name of a filled one, which would contain the truth.

    Parameters
    ----------
    arguments : Namespace
        ``data``, ``recording``, ``training``.
    """
    known = [file for name in NAMES if (file := _there(name, arguments.data)) is not None]
    own = arguments.recording
    if own is None and not known:
        find(NAMES, arguments.data)  # raises, with the names
    first = find((), arguments.data, own) if own is not None else known[0]
    markers = _markers(pf.read(first))
    files = [first, *(file for file in known if file.resolve() != first.resolve())]
    parts = {file: list(_stretches(file, markers)) for file in files}
    filled = files[:1] if own is not None else files
    samples = [
        part
        for file in filled
        for part in parts[file]
        if part.frames == SAMPLE and not part.missing.any()
    ]
    if not samples:
        raise SystemExit(
            f"{first}: has no complete sample of {len(markers)} markers and "
            f"{SAMPLE / RATE:.1f} s; choose another --recording"
        )
    if arguments.training is not None:
        parts = _learnt(arguments.training, markers, {file.stem for file in filled})
    training = [
        part
        for some in parts.values()
        for part in some
        if part.frames >= MIN_FRAMES and not part.missing.all()
    ]
    return Material(samples, training, list(parts))


def _learnt(
    folder: Path, markers: Sequence[str], filled: Collection[str]
) -> dict[Path, list[pf.Clip]]:
    """Read the recordings below a folder that have the markers and are not filled."""
    parts = {}
    for file in sorted(folder.rglob("*")):
        if file.suffix.lower() in SUFFIXES and file.stem not in filled:
            found = list(_stretches(file, markers))
            if found:
                parts[file] = found
    if not parts:
        raise SystemExit(
            f"{folder}: contains no other recording with all of {' '.join(markers)}; "
            "choose another --training"
        )
    return parts


def _there(name: str, data: Path) -> Path | None:
    """Return a file of the folder, or None."""
    try:
        return find((name,), data)
    except SystemExit:
        return None


def _markers(clip: pf.Clip) -> tuple[str, ...]:
    """Return the fifteen markers, or all measured ones if any of them is absent."""
    if set(JOINTS) <= set(clip.labels):
        return JOINTS
    seen = measured_in(clip).any(axis=0)
    return tuple(label for label, shown in zip(clip.labels, seen, strict=True) if shown)


def _stretches(file: Path, markers: Sequence[str]) -> Iterator[pf.Clip]:
    """Divide a recording into stretches; none if a marker is absent."""
    clip = pf.read(file)
    if not set(markers) <= set(clip.labels):
        return
    positions = np.where(measured_in(clip)[..., None], clip.positions, np.nan)
    at = [clip.labels.index(label) for label in markers]
    positions = resample(positions[:, at], clip.rate, RATE)
    for number, start in enumerate(range(0, len(positions), SAMPLE)):
        yield pf.Clip(
            positions=positions[start : start + SAMPLE],
            labels=tuple(markers),
            rate=RATE,
            up=clip.up,
            name=f"{file.stem} {number + 1}",
            subject=clip.subject,
        )


def evenly_distributed(number: int, markers: int) -> list[int]:
    """Return some of all markers, with the same interval between them.

    Examples
    --------
    >>> evenly_distributed(5, 15)
    [1, 4, 7, 10, 13]
    """
    return [int((i + 0.5) * markers / number) for i in range(number)]


@dataclass(frozen=True)
class EvenGaps:
    """Protocol: gaps from frame 101 on, in evenly distributed markers (Fig. 2 of the paper).

    Attributes
    ----------
    numbers : tuple of int
        Numbers of markers.
    lengths : tuple of int
        Numbers of frames. A case for each pair of both is called ``5 x 100``.
    """

    numbers: tuple[int, ...]
    lengths: tuple[int, ...]

    def cases(
        self, clip: pf.Clip, parts: BodyParts, draw: Callable[[str, int], np.random.Generator]
    ) -> Iterator[GapMask | SkippedCase]:
        """Yield the cases of a clip."""
        del parts, draw
        yield from self._masks(clip)

    def copies(self, clip: pf.Clip) -> Iterator[tuple[str, pf.Clip]]:
        """Yield the name of each case, and the clip without its gaps."""
        for made in self._masks(clip):
            if isinstance(made, GapMask):
                positions = np.where(made.mask[..., None], np.nan, clip.positions)
                yield made.name, clip.with_positions(positions)

    def _masks(self, clip: pf.Clip) -> Iterator[GapMask | SkippedCase]:
        for number in self.numbers:
            for length in self.lengths:
                name = f"{number} x {length}"
                if number > len(clip.labels):
                    yield SkippedCase(name, 1, "there are fewer markers")
                    continue
                gone = np.zeros_like(clip.missing)
                markers = evenly_distributed(number, len(clip.labels))
                gone[GAP_START : GAP_START + length, markers] = True
                yield GapMask(name, 1, gone)


@contextmanager
def database_of(training: Sequence[pf.Clip]) -> Iterator[Path | None]:
    """Make a database of clips for a while; None without any."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "priors" if training else None
        if path is not None:
            with pf.PriorDatabase.create(path, rate=RATE) as writer:
                for clip in training:
                    with suppress(ClipError):  # no motion in it
                        writer.add(clip)
        yield path


def evaluated(some: Material, protocol: GapProtocol, methods: str) -> Evaluation:
    """Evaluate methods on all samples, with a database of the training data.

    No sample is filled from its own complete version.
    """
    method_names = [name.strip() for name in methods.split(",")]
    if not set(method_names) <= {"auto", *METHODS}:
        raise SystemExit(f"unknown method; use some of auto {' '.join(METHODS)}")
    with database_of(some.training) as path:
        return pf.evaluate(
            some.samples, methods=method_names, protocol=protocol, database=path, jobs=processes()
        )


def filled_by(
    some: Material, protocol: EvenGaps, method: str, *, truth: bool = False, **changed: object
) -> dict[str, float]:
    """Return the MAE (mm) of a method with changed options, by case.

    Parameters
    ----------
    some : Material
        Samples and training data.
    protocol : EvenGaps
        The gaps.
    method : str
        Name of the method.
    truth : bool
        Whether the frames of the sample that have gaps are training data, too: moved by a metre,
        so that they are not recognised.
    **changed
        Options of the method.
    """
    moved = {
        sample.name: replace(
            sample,
            name=f"{sample.name} moved",
            positions=sample.positions[GAP_START:] + ASIDE,
        )
        for sample in some.samples
        if truth
    }
    errors: dict[str, list[float]] = {}
    with database_of([*some.training, *moved.values()]) as path:
        for sample in some.samples:
            others = (copy.name for name, copy in moved.items() if name != sample.name)
            alone = method_alone(pf.Selection(not_names=(sample.name, *others)))
            chosen = replace(alone, method_options=changed)
            for case, gappy in protocol.copies(sample):
                found = pf.fill(gappy, method=method, database=path, options=chosen)
                errors.setdefault(case, []).append(error(found.clip, sample, gappy))
    return {case: float(np.mean(values)) for case, values in errors.items()}


def processes() -> int:
    """Return the number of worker processes."""
    return os.cpu_count() or 1


def mae(evaluation: Evaluation, method: str, **where: str) -> tuple[float, float]:
    """Return the MAE (mm) of Eq. (17), and the share of filled samples.

    This is the mean Euclidean distance from the truth over the frames of a gap, averaged over gaps.
    The divisor of Eq. (17) as printed, n2 - (n1 + 1), would be the number of frames less two.

    Parameters
    ----------
    evaluation : Evaluation
        The evaluation.
    method : str
        Name of the method.
    where : str
        Restriction to a ``clip``, ``case`` or ``marker``.

    Returns
    -------
    (float, float)
        MAE over filled frames, NaN without any; their share of all frames.
    """
    rows = [
        row.errors
        for row in evaluation.gaps
        if row.method == method and all(getattr(row, key) == name for key, name in where.items())
    ]
    means = [errors.mean for errors in rows if errors.filled]
    samples = sum(errors.samples for errors in rows)
    share = sum(errors.filled for errors in rows) / samples if samples else 0.0
    return (float(np.mean(means)) if means else float("nan")), share


def cell(evaluation: Evaluation, method: str, **where: str) -> Cell:
    """Return the MAE for a table, with the filled share if it is not complete."""
    error, share = mae(evaluation, method, **where)
    return error if share in (0.0, 1.0) else f"{error:.1f} ({floored(share)} %)"


def floored(share: float) -> int:
    """Return a share in percent, rounded down."""
    return int(100 * share)


def by_case(
    evaluation: Evaluation,
    title: str,
    head: str,
    entries: Mapping[str, str],
    published: Mapping[tuple[str, str], str] | None = None,
) -> Comparison:
    """Print the MAE of each method in each case, with the paper's value in brackets.

    Parameters
    ----------
    evaluation : Evaluation
        The evaluation.
    title : str
        Title of the table.
    head : str
        Head of the first column.
    entries : mapping of str to str
        The first column's entry for each case.
    published : mapping, optional
        The paper's values, as printed, by case and method.

    Returns
    -------
    Comparison
        With the paper's values.
    """
    published = published or {}
    methods = evaluation.plan.methods
    comparison = Comparison()
    rows: list[list[Cell]] = []
    for case, entry in entries.items():
        row: list[Cell] = [entry]
        for method in methods:
            ours = cell(evaluation, method, case=case)
            paper = published.get((case, method))
            if paper is not None:
                value, _ = mae(evaluation, method, case=case)
                comparison.add(f"{entry}, {method}", value, paper, OTHER_RECORDINGS)
                shown = ours if isinstance(ours, str) else f"{ours:.1f}"
                ours = f"{shown} ({float(paper):.1f})"
            row.append(ours)
        rows.append(row)
    print_table(title, [head, *methods], rows)
    return comparison


def by_recording(evaluation: Evaluation, case: str) -> None:
    """Print the MAE of each method in a case by recording, with the speed of the samples."""
    methods = evaluation.plan.methods
    clips = [source.clip for source in evaluation.plan.sources]
    samples: dict[str, list[pf.Clip]] = {}
    for clip in clips:
        samples.setdefault(recording_of(clip), []).append(clip)
    rows: list[list[Cell]] = []
    for name, some in samples.items():
        errors = [
            np.nanmean([mae(evaluation, method, case=case, clip=clip.name)[0] for clip in some])
            for method in methods
        ]
        rows.append([name, len(some), float(np.mean([*map(speed, some)])), *map(float, errors)])
    columns = ["recording", "samples", "mm/s", *methods]
    print_table(f"MAE in mm of {case} frames by recording, with the mean speed", columns, rows)


def recording_of(clip: pf.Clip) -> str:
    """Return the name of a stretch's recording."""
    return clip.name.rsplit(" ", 1)[0]


def speed(clip: pf.Clip) -> float:
    """Return the mean speed of all markers (mm/s)."""
    steps = np.linalg.norm(np.diff(clip.positions, axis=0), axis=2)
    return float(steps.mean() * clip.rate)


def print_data(some: Material, paper: str) -> None:
    """Print samples and training data, and those of the paper."""
    sources = dict.fromkeys(map(recording_of, some.samples))
    print(
        f"Paper: {paper}\n"
        f"Here:  {len(some.samples)} samples of {SAMPLE} frames at {RATE:.0f} Hz, "
        f"{len(some.samples[0].labels)} markers, of {', '.join(sources)};\n"
        f"       training data: the others, and in all {len(some.training)} stretches of "
        f"{len(some.files)} recordings. (n %): share of filled samples."
    )


def refusals(evaluation: Evaluation) -> None:
    """Print which methods failed on how many cases."""
    for method in evaluation.plan.methods:
        reasons = [o.refused for job, o in evaluation.outcomes.items() if job.method == method]
        some = [text for text in reasons if text]
        if some:
            print(f"{method}: failed on {len(some)} of {len(reasons)} cases: {some[0]}")
