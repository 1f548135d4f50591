"""Recordings, gaps and errors for the tables of Li, Yu, Kieu, Vuong and Zhang 2020.

Neither the paper's recordings (Malay dances of the AniAge project, 15 joints at 30 Hz) nor its
text are available, only its abstract and its program
(github.com/lizhuorong/Mocap-Data-Completion), without masks and data. So every value of the paper
is a dash, and the assignment of experiments to tables is an interpretation, which each script
states. The experiments are those of the program, on long recordings of whole-body motion, reduced
to 15 markers near those joints, at 30 Hz.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from paper import Cell, find, options, print_table

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
    "COMPLETE_FRAMES",
    "PIECE",
    "RATE",
    "SAMPLE",
    "UNKNOWN",
    "Material",
    "Onward",
    "Several",
    "Throughout",
    "by_experiment",
    "by_part",
    "cell",
    "evaluated",
    "mae",
    "material",
    "parser_of",
    "print_data",
    "refusals",
    "seconds",
]

RATE = 30.0
"""Hz. Rate of the paper's recordings."""

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
)
"""Recordings used instead of the dances: karate, and other long recordings with these markers."""

SAMPLE = 200
"""Frames of a sample, and of the training stretch after it. The program tests on frames 1 to 200
of a recording and trains on recordings from frame 101 on."""

COMPLETE_FRAMES = 100
"""Complete frames of a sample before gaps that last to its end."""

PIECE = 100
"""Frames of a sample in the other programs, and of the training sequences of the paper."""

MIN_FRAMES = 30
"""Minimum number of frames of a training stretch: one second."""

FEW = 4
"""Samples filled without ``--full``."""

DEFAULT = "pca-train,pca-pieces,pca-frames,r1,r2,linear,lds,auto"
"""Methods of the paper, methods used for comparison, and the default of priorfill."""

UNKNOWN = "values of the paper are not available"

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

    def first(self, frames: int) -> Material:
        """Return the first frames of each sample; the others are not used for training either."""
        cut = [clip.with_positions(clip.positions[:frames]) for clip in self.samples]
        return Material(cut, self.training, self.files)


def parser_of(doc: str | None, full: str, methods: str = DEFAULT) -> argparse.ArgumentParser:
    """Return the parser of a script with its default methods."""
    parser = options(doc, recording=RECORDING, full=full)
    parser.add_argument(
        "--methods",
        metavar="NAMES",
        default=methods,
        help="methods, separated by commas; %(default)s if not given",
    )
    parser.add_argument(
        "--training",
        type=Path,
        metavar="DIR",
        help="folder of recordings with the same markers, used as training data instead",
    )
    return parser


def material(arguments: argparse.Namespace, *, few: int | None = FEW) -> Material:
    """Return samples and training data.

    Recordings are divided into stretches of `SAMPLE` frames. Every other one is a sample; the
    others and shorter rests are training data. Some complete samples are filled, recordings in
    turn, or all of them with ``--full``.

    With ``--training`` only the recordings below that folder are training data, without those that
    have the name of a filled one, which would contain the truth.

    Parameters
    ----------
    arguments : Namespace
        ``data``, ``recording``, ``training``, ``full``.
    few : int, optional
        Number of samples without ``--full``; all if None.
    """
    known = [file for name in NAMES if (file := _there(name, arguments.data)) is not None]
    own = arguments.recording
    if own is None and not known:
        find(NAMES, arguments.data)  # raises, with the names
    first = find((), arguments.data, own) if own is not None else known[0]
    markers = _markers(pf.read(first))
    files = [first, *(file for file in known if file.resolve() != first.resolve())]
    parts = {file: list(_stretches(file, markers)) for file in files}
    samples = [
        [part for part in parts[file][::2] if part.frames == SAMPLE and not part.missing.any()]
        for file in (files[:1] if own is not None else files)
    ]
    deepest = max(map(len, samples))
    chosen = [some[i] for i in range(deepest) for some in samples if i < len(some)]
    if not chosen:
        raise SystemExit(
            f"{first}: has no complete sample of {len(markers)} markers and "
            f"{SAMPLE / RATE:.1f} s; choose another --recording"
        )
    if arguments.training is not None:
        filled = {file.stem for file in (files[:1] if own is not None else files)}
        parts = _learnt(arguments.training, markers, filled)
        files = [*parts]
    names = {part.name for part in chosen}
    training = [
        part
        for file in files
        for part in parts[file]
        if part.name not in names and part.frames >= MIN_FRAMES and not part.missing.all()
    ]
    return Material(chosen if arguments.full else chosen[:few], training, files)


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


@dataclass(frozen=True)
class Onward:
    """Protocol: some markers are missing from a frame to the end of the clip.

    Attributes
    ----------
    numbers : tuple of int
        Numbers of missing markers, drawn for each clip; one case each.
    start : int
        First frame of the gaps.
    copies : int
        Number of copies of each clip, with different markers.
    """

    numbers: tuple[int, ...] = (1,)
    start: int = COMPLETE_FRAMES
    copies: int = 1

    def cases(
        self, clip: pf.Clip, parts: BodyParts, draw: Callable[[str, int], np.random.Generator]
    ) -> Iterator[GapMask | SkippedCase]:
        """Yield the cases of a clip."""
        del parts
        for copy in range(1, self.copies + 1):
            # a larger number includes the markers of a smaller one
            order = draw("onward", copy).permutation(len(clip.labels))
            for number in self.numbers:
                if number >= len(clip.labels):
                    yield SkippedCase(str(number), copy, "no marker would be left")
                    continue
                gone = np.zeros_like(clip.missing)
                gone[self.start :, order[:number]] = True
                yield GapMask(str(number), copy, gone)


@dataclass(frozen=True)
class Several:
    """Protocol: the cases of several protocols, under their names.

    Attributes
    ----------
    protocols : dict of str to protocol
        They draw alike: the same protocol with another length uses the same markers.
    """

    protocols: Mapping[str, GapProtocol]

    def cases(
        self, clip: pf.Clip, parts: BodyParts, draw: Callable[[str, int], np.random.Generator]
    ) -> Iterator[GapMask | SkippedCase]:
        """Yield the cases of a clip."""
        for name, protocol in self.protocols.items():
            for made in protocol.cases(clip, parts, draw):
                yield replace(made, name=name)


@dataclass(frozen=True)
class Throughout:
    """Protocol: each marker in turn is missing in the whole clip."""

    def cases(
        self, clip: pf.Clip, parts: BodyParts, draw: Callable[[str, int], np.random.Generator]
    ) -> Iterator[GapMask | SkippedCase]:
        """Yield the cases of a clip."""
        del parts, draw
        for marker, label in enumerate(clip.labels):
            gone = np.zeros_like(clip.missing)
            gone[:, marker] = True
            yield GapMask(label, 1, gone)


def evaluated(some: Material, protocol: GapProtocol, methods: str) -> Evaluation:
    """Evaluate methods on all samples, with a database of the training data."""
    method_names = [name.strip() for name in methods.split(",")]
    if not set(method_names) <= {"auto", *METHODS}:
        raise SystemExit(f"unknown method; use some of auto {' '.join(METHODS)}")
    with tempfile.TemporaryDirectory() as folder:
        path = None
        if some.training:
            path = Path(folder) / "priors"
            with pf.PriorDatabase.create(path, rate=RATE) as writer:
                for clip in some.training:
                    with suppress(ClipError):  # no motion in it
                        writer.add(clip)
        return pf.evaluate(
            some.samples, methods=method_names, protocol=protocol, database=path, jobs=processes()
        )


def processes() -> int:
    """Return the number of worker processes."""
    return os.cpu_count() or 1


def mae(evaluation: Evaluation, method: str, **where: str) -> tuple[float, float]:
    """Return the MAE (mm) of the published ``mae.m``, and the share of filled samples.

    This is the mean distance from the truth in each gap, averaged over gaps.

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


def seconds(evaluation: Evaluation, method: str) -> float:
    """Return the mean CPU time (s) of a method per case."""
    taken = [made.seconds for job, made in evaluation.outcomes.items() if job.method == method]
    return float(np.mean(taken)) if taken else float("nan")


def floored(share: float) -> int:
    """Return a share in percent, rounded down."""
    return int(100 * share)


def by_part(
    evaluation: Evaluation, key: str, title: str, head: str = "", *, together: bool = True
) -> None:
    """Print the MAE of each method for each clip, case or marker.

    Parameters
    ----------
    evaluation : Evaluation
        The evaluation.
    key : str
        ``clip``, ``case`` or ``marker``.
    title : str
        Title of the table.
    head : str
        Head of the first column; `key` if empty.
    together : bool
        Whether a last row has the mean over all.
    """
    methods = evaluation.plan.methods
    names = dict.fromkeys(getattr(row, key) for row in evaluation.gaps)
    rows: list[list[Cell]] = [
        [name, *(cell(evaluation, method, **{key: name}) for method in methods), None]
        for name in names
    ]
    if together:
        rows.append(["all", *(cell(evaluation, method) for method in methods), None])
    print_table(f"{title} ({UNKNOWN})", [head or key, *methods, "paper"], rows)


def by_experiment(evaluations: dict[str, Evaluation], head: str, title: str) -> None:
    """Print the MAE of each method in several experiments, one row each."""
    methods = next(iter(evaluations.values())).plan.methods
    rows: list[list[Cell]] = [
        [name, *(cell(evaluation, method) for method in methods), None]
        for name, evaluation in evaluations.items()
    ]
    print_table(f"{title} ({UNKNOWN})", [head, *methods, "paper"], rows)


def print_data(some: Material, paper: str) -> None:
    """Print samples and training data, and those of the paper."""
    print(f"Paper: {paper}")
    print(
        f"Here:  {len(some.samples)} samples of {some.samples[0].frames} frames at {RATE:.0f} Hz, "
        f"{len(some.samples[0].labels)} markers; training data: {len(some.training)} other "
        f"stretches of:\n       {', '.join(file.stem for file in some.files)}.\n"
        "       --recording fills one of yours. A dash: not available, or nothing filled;\n"
        "       (n %): share of filled samples."
    )


def refusals(evaluation: Evaluation) -> None:
    """Print which methods failed on how many cases."""
    for method in evaluation.plan.methods:
        reasons = [o.refused for job, o in evaluation.outcomes.items() if job.method == method]
        some = [text for text in reasons if text]
        if some:
            print(f"{method}: failed on {len(some)} of {len(reasons)} cases: {some[0]}")
