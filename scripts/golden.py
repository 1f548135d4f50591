"""Golden accuracies: errors of fixed gaps, compared with stored results.

    python scripts/golden.py [--only NAME,...] [--write] [--data FOLDER]

Each row of `CASES` removes samples from a clip, fills the gaps, and compares the result with the
truth. `tests/golden/accuracy.json` stores the results, and `tests/test_golden.py` compares new ones
with them. Use ``--write`` after a change that is meant to alter results: rows that still reproduce
keep their stored numbers, and old and new numbers of all others are printed.

Clips are synthetic and seeded, or recordings from the folder that PRIORFILL_DATA or ``--data``
names. Recordings are not part of the project: their rows store errors only, no coordinates.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from priorfill.cli.encoding import replace_what_is_lacking

sys.path.append(str(Path(__file__).resolve().parent / "support"))
from recordings import add_data_option

import priorfill as pf
from priorfill.filling.plausibility_options import UNCHECKED, PlausibilityOptions
from priorfill.methods import METHODS
from priorfill.synthetic import Body, synthesise

STORED = Path(__file__).resolve().parent.parent / "tests" / "golden" / "accuracy.json"
"""Where results are stored."""

WRITE = "python scripts/golden.py --write --only"
"""Command that stores new results; names of rows follow."""

SAMPLES = 40
"""Number of coordinates stored per row; errors for recordings."""

MAX_RATIO = 1.02
"""A mean error above this multiple of the stored one counts as worse."""

RELATIVE = 1e-3
"""Relative tolerance of expected errors, bounds and mean errors."""

MILLIMETRES = 0.002
"""mm. Tolerance of a coordinate."""

COVERAGE = 0.005
"""Tolerance of a coverage."""

EXTRAPOLATE = 1.0
"""s. How far blackouts at a clip's end are filled."""

Gaps = tuple[tuple[int, int, tuple[str, ...]], ...]
"""First frame, frame after the last, and labels of each gap; no labels means all markers."""


@dataclass(frozen=True)
class Synthetic:
    """A synthetic clip; attributes as for `priorfill.synthetic.synthesise`."""

    motion: str = "walking"
    seconds: float = 4.0
    seed: int = 3
    body: int = 0
    rate: float = 60.0


@dataclass(frozen=True)
class Recorded:
    """Part of a recording.

    Attributes
    ----------
    file : str
        Path below the folder of recordings.
    start, stop : int
        First frame, and the frame after the last; None for the end.
    step : int
        Every `step`-th frame is used, which lowers the rate.
    """

    file: str
    start: int = 0
    stop: int | None = None
    step: int = 1


Source = Synthetic | Recorded


@dataclass(frozen=True)
class Case:
    """One row.

    Attributes
    ----------
    name : str
        Name of the row.
    source : Synthetic or Recorded
        The clip whose samples are removed.
    gaps : tuple
        Removed samples.
    database : tuple of Synthetic or Recorded
        Clips of a database built for this row; no database if empty.
    same_subject : tuple of Synthetic or Recorded
        Other clips of the same subject.
    method : str
        Fill method.
    change : callable or None
        Modification of the source clip, including the truth.
    virtual_markers : bool
        Whether the clips of the database count as virtual markers.
    anonymous : bool
        Whether the clips of the database have no subject.
    reject : bool
        Whether artefacts are rejected.
    """

    name: str
    source: Source
    gaps: Gaps
    database: tuple[Source, ...] = ()
    same_subject: tuple[Source, ...] = ()
    method: str = "auto"
    change: Callable[[pf.Clip], pf.Clip] | None = None
    virtual_markers: bool = False
    anonymous: bool = False
    reject: bool = False

    @property
    def recorded(self) -> bool:
        """Whether the row needs recordings."""
        return isinstance(self.source, Recorded)


# --------------------------------------------------------------------------------------------------
# changes of clips


def _renamed(clip: pf.Clip) -> pf.Clip:
    """Return a clip with labels of no known marker set."""
    return replace(clip, labels=tuple(f"M{i:02d}" for i in range(1, len(clip.labels) + 1)))


def _with_jitter(clip: pf.Clip) -> pf.Clip:
    """Return a clip with jitter in the markers of the left shoulder, the trunk and a knee."""
    rng = np.random.default_rng(5)
    positions = clip.positions.copy()
    for label in ("LSHO", "CLAV", "STRN", "T10", "C7", "RBAC", "LSHN", "LTHI"):
        positions[:, clip.labels.index(label)] += rng.normal(0.0, 4.0, (clip.frames, 3))
    return clip.with_positions(positions)


def _stepped_down(clip: pf.Clip) -> pf.Clip:
    """Return a clip in which the subject stands 250 mm lower in the middle."""
    frames = np.arange(clip.frames)
    depth = 1.0 / (1.0 + np.exp(-(frames - 80) / 3.0)) - 1.0 / (1.0 + np.exp(-(frames - 160) / 3.0))
    return clip.with_positions(clip.positions - 250.0 * depth[:, None, None] * [0.0, 0.0, 1.0])


def _sloping(clip: pf.Clip) -> pf.Clip:
    """Return a clip on a slope of 6 %."""
    positions = clip.positions.copy()
    positions[..., 2] += 0.06 * positions[..., 0]
    return clip.with_positions(positions)


def _y_up(clip: pf.Clip) -> pf.Clip:
    """Return a clip whose second axis points up."""
    x, y, z = np.moveaxis(clip.positions, 2, 0)
    return replace(clip, positions=np.stack([x, z, -y], axis=2), up="+Y")


def _spiked(clip: pf.Clip) -> pf.Clip:
    """Return a clip in which two markers jump away for some frames."""
    positions = clip.positions.copy()
    for start, stop, label in ((40, 48, "LKNE"), (150, 158, "RELB")):
        positions[start:stop, clip.labels.index(label)] += [150.0, -120.0, 90.0]
    return clip.with_positions(positions)


# --------------------------------------------------------------------------------------------------
# gaps

ARM = ("LUPA", "LELB", "LFRM", "LWRA", "LWRB", "LFIN")
FOOT = ("RANK", "RHEE", "RTOE", "RMT5")
LEFT_FOOT = ("LANK", "LHEE", "LTOE", "LMT5")
LEG = ("RKNE", "RSHN", *FOOT)


def _scattered(labels: Sequence[str], frames: int, count: int, longest: int, seed: int) -> Gaps:
    """Return seeded gaps of single markers, the same number for each marker."""
    rng = np.random.default_rng(seed)
    gaps = []
    for number in range(count):
        length = int(rng.integers(1, longest + 1))
        start = int(rng.integers(0, frames - length))
        gaps.append((start, start + length, (labels[number % len(labels)],)))
    return tuple(gaps)


def _flickering(start: int, stop: int) -> Gaps:
    """Return frequent short gaps of the markers near an arm."""
    gaps: list[tuple[int, int, tuple[str, ...]]] = []
    for number, label in enumerate(("LSHO", "CLAV", "STRN", "C7", "T10")):
        first = start + 7 * number
        gaps += [(at, at + 14, (label,)) for at in range(first, stop - 14, 35)]
    return tuple(gaps)


# --------------------------------------------------------------------------------------------------
# the table

_WALK = Synthetic()
_ANOTHER_TAKE = Synthetic(seed=9, seconds=5.0)
_OTHERS = (Synthetic(seed=11, body=11, seconds=5.0), Synthetic(seed=12, body=12, seconds=5.0))
_MORE = (*_OTHERS, Synthetic(seed=13, body=13, seconds=4.0))
_STATIC = Synthetic(seed=9, seconds=0.04)
_LABELS = synthesise("walking", seconds=0.1).labels
_METHOD_GAPS: Gaps = ((60, 90, ("LKNE",)), (100, 130, ("LFRM", "LWRA")))
_SEARCHES = ("baumann2011", "neighbours", "krueger2010")
_DATABASE_METHODS = (*_SEARCHES, "pca-train")

_SYNTHETIC = (
    # single markers
    Case("single", _WALK, ((100, 130, ("LKNE",)),)),
    Case("single_short", _WALK, ((100, 106, ("RWRA",)), (180, 186, ("LTHI",)))),
    Case("single_tight", Synthetic("reaching"), ((70, 130, ("RFIN",)), (150, 200, ("LFHD",)))),
    Case("interpolated", _WALK, ((0, 100, ("C7",)), (105, 110, ("C7",)), (115, 240, ("C7",)))),
    Case("interpolated_brief", Synthetic(seconds=0.25), ((5, 10, ("LKNE",)),)),
    Case("interpolated_short_clip", Synthetic(seconds=0.4), ((5, 19, ("LKNE",)),)),
    Case("scattered", _WALK, _scattered(_LABELS, 240, 41, 12, seed=1)),
    # limbs
    Case("limb", _WALK, ((80, 140, ARM),)),
    Case("limb_120hz", Synthetic("reaching", 3.0, rate=120.0), ((150, 230, ARM),)),
    Case("limb_y_up", _WALK, ((100, 140, ("LFRM", "LWRA", "LFIN")),), change=_y_up),
    Case("limb_database", _WALK, ((80, 140, ARM),), database=_OTHERS),
    Case("limb_database_few_own", _WALK, ((40, 240, ARM),), database=_OTHERS),
    Case("limb_database_short_clip", Synthetic(seconds=2.0), ((50, 90, ARM),), database=_OTHERS),
    Case(
        "limb_virtual_markers_database",
        _WALK,
        ((60, 150, ARM),),
        database=_OTHERS,
        virtual_markers=True,
    ),
    Case(
        "limb_same_subject_database",
        _WALK,
        ((60, 150, ARM),),
        database=(_ANOTHER_TAKE, _OTHERS[0]),
    ),
    Case("limb_same_subject", _WALK, ((60, 150, ARM),), _OTHERS[:1], (_ANOTHER_TAKE,)),
    Case("limb_of_unknown_markers", _WALK, ((90, 140, ("M12", "M13", "M14")),), change=_renamed),
    Case("two_limbs", _WALK, ((70, 140, ARM), (110, 170, FOOT))),
    Case("two_limbs_together", _WALK, ((80, 120, ARM), (80, 120, FOOT))),
    Case("clip_ends", _WALK, ((0, 40, ("RWRA", "RFIN")), (200, 240, ("LANK", "LHEE")))),
    Case("flickering", _WALK, ((60, 160, ARM), *_flickering(60, 160))),
    Case("jitter", _WALK, ((70, 130, ARM), (150, 200, ("LKNE",))), change=_with_jitter),
    Case("limb_into_blackout", _WALK, ((70, 140, ARM), (100, 112, ()))),
    Case("rejected", _WALK, ((90, 120, ("LKNE",)),), change=_spiked, reject=True),
    # feet and floors
    Case("foot_standing", Synthetic("squatting"), ((80, 170, FOOT),)),
    Case("foot_walking", Synthetic("walking", 4.0, seed=5), ((100, 160, LEG),)),
    Case(
        "foot_step_down",
        Synthetic("reaching"),
        ((70, 170, (*FOOT, *LEFT_FOOT)),),
        change=_stepped_down,
    ),
    Case("foot_slope", Synthetic("walking", 3.0), ((70, 110, FOOT),), change=_sloping),
    # dropouts
    Case("dropout_mirror", _WALK, ((0, 240, ("LELB",)),)),
    Case("dropout_database", _WALK, ((0, 240, ("C7",)),), database=_MORE),
    Case("dropout_two_database", _WALK, ((0, 240, ("RANK", "RHEE")),), database=_MORE),
    Case("dropout_same_subject", _WALK, ((0, 240, ("C7", "RELB")),), same_subject=(_ANOTHER_TAKE,)),
    Case("dropout_static_trial", _WALK, ((0, 240, ("C7",)),), same_subject=(_STATIC,)),
    Case(
        "dropout_same_subject_database",
        _WALK,
        ((0, 240, ("C7", "RELB")),),
        database=(_ANOTHER_TAKE, _OTHERS[0]),
    ),
    Case(
        "dropout_anonymous_database",
        _WALK,
        ((0, 240, ("C7", "RELB")),),
        database=(_ANOTHER_TAKE, _OTHERS[0]),
        anonymous=True,
    ),
    Case("dropout_few_own", _WALK, ((0, 100, ("LELB",)), (108, 240, ("LELB",)))),
    Case(
        "dropout_few_own_apart",
        _WALK,
        tuple((at + 1, at + 30, ("LELB",)) for at in range(0, 240, 30)),
    ),
    Case(
        "dropout_few_own_database",
        _WALK,
        ((0, 100, ("LELB",)), (108, 240, ("LELB",))),
        database=_MORE,
    ),
    # blackouts
    Case("blackout", Synthetic(seconds=5.0), ((140, 165, ()),)),
    Case("blackout_brief", Synthetic(seconds=5.0), ((140, 146, ()),)),
    Case(
        "blackout_two_seen",
        Synthetic(seconds=3.0),
        (
            (80, 105, tuple(label for label in _LABELS if label not in ("LFHD", "RFHD"))),
            (80, 90, ("LFHD", "RFHD")),
            (95, 105, ("LFHD", "RFHD")),
        ),
    ),
    Case("blackout_reaching", Synthetic("reaching", seconds=5.0), ((140, 180, ()),)),
    Case("blackout_database", Synthetic(seconds=2.5), ((70, 100, ()),), database=_OTHERS),
    Case(
        "blackout_same_subject",
        Synthetic(seconds=2.5),
        ((70, 95, ()),),
        same_subject=(_ANOTHER_TAKE,),
    ),
    Case("blackout_end", _WALK, ((220, 240, ()),)),
    Case("blackout_short_clip", Synthetic(seconds=1.2), ((24, 48, ()),)),
    Case("blackout_short_clip_database", Synthetic(seconds=1.2), ((24, 48, ()),), _OTHERS),
)

_METHODS = tuple(
    Case(
        f"method_{name}",
        Synthetic(seconds=3.0),
        _METHOD_GAPS,
        database=_OTHERS if name in _DATABASE_METHODS else (),
        method=name,
    )
    for name in METHODS
)

_KARATE = Recorded("cmu/135_07.c3d", 200, 680, 2)
_RECORDED = (
    Case("cmu_single", _KARATE, ((100, 160, ("LKNE",)), (60, 120, ("RFIN",)))),
    Case(
        "cmu_limb_database",
        Recorded("cmu/80_10.c3d", 0, 480, 2),
        ((90, 150, ARM),),
        database=(_KARATE, Recorded("cmu/141_04.c3d")),
    ),
    Case("hdm05_limb", Recorded("hdm05/HDM_bd_05-01_01_120.c3d", 2000, 2480, 2), ((80, 140, LEG),)),
    Case(
        "hdm05_blackout",
        Recorded("hdm05/HDM_bd_05-01_01_120.c3d", 2000, 2600, 2),
        ((140, 170, ()),),
    ),
    Case(
        "gait_dropout_same_subject",
        Recorded("gait/HC002D06.c3d"),
        ((0, 222, ("LTIB", "C7")),),
        same_subject=(Recorded("gait/HC002D25.c3d"),),
    ),
    Case(
        "walkl_scattered",
        Recorded("walkl/WalkL.c3d", 0, 1200, 4),
        _scattered([f"M{i:02d}" for i in range(1, 38)], 300, 37, 20, seed=2),
    ),
)

CASES: Mapping[str, Case] = {case.name: case for case in (*_SYNTHETIC, *_METHODS, *_RECORDED)}
"""The rows by name."""


# --------------------------------------------------------------------------------------------------
# filling and measuring


@dataclass(frozen=True)
class Row:
    """Stored results of a case. Means are over filled samples with known truth.

    Attributes
    ----------
    filled : int
        Number of filled samples.
    error : float
        Mean distance from the truth (mm).
    expected_rms : float or None
        Mean expected rms error (mm); None for methods without one.
    bound : float or None
        Mean 90 % bound (mm).
    coverage : float or None
        Share of samples with an error within the bound.
    samples : tuple of float
        Evenly spaced coordinates (mm) of filled samples; errors (mm) for recordings.
    """

    filled: int
    error: float
    expected_rms: float | None
    bound: float | None
    coverage: float | None
    samples: tuple[float, ...]

    @classmethod
    def of(cls, stored: Mapping[str, Any]) -> Row:
        """Return the row of a JSON object."""
        return cls(**{**stored, "samples": tuple(stored["samples"])})


@lru_cache(maxsize=16)
def _clip(source: Source, folder: Path | None) -> pf.Clip:
    """Return the clip of a source."""
    if isinstance(source, Synthetic):
        body = Body(seed=source.body)
        return synthesise(
            source.motion, seconds=source.seconds, rate=source.rate, seed=source.seed, body=body
        )
    if folder is None:
        raise ValueError(f"{source.file}: there is no folder of recordings")
    clip = pf.read(folder / source.file)
    some = clip.positions[source.start : source.stop : source.step]
    return replace(clip, positions=some, rate=clip.rate / source.step, source=None)


def _with_gaps(clip: pf.Clip, gaps: Gaps) -> pf.Clip:
    """Remove samples from a clip."""
    positions = clip.positions.copy()
    for start, stop, labels in gaps:
        columns = [clip.labels.index(label) for label in labels or clip.labels]
        positions[start:stop, columns] = np.nan
    return clip.with_positions(positions)


def _fill(case: Case, clip: pf.Clip, folder: Path | None) -> pf.Result:
    """Fill a clip with the settings of a case."""
    with ExitStack() as stack:
        database = None
        if case.database:
            memory = Path("/dev/shm")  # faster, without waiting for a disk
            made = tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None)
            database = Path(stack.enter_context(made)) / "database"
            with pf.PriorDatabase.create(database) as new:
                for source in case.database:
                    known = _clip(source, folder)
                    subject = "" if case.anonymous else known.subject
                    new.add(
                        known, pf.ClipOrigin(subject=subject, virtual_markers=case.virtual_markers)
                    )
        return pf.fill(
            clip,
            database=database,
            method=case.method,
            same_subject=[_clip(source, folder) for source in case.same_subject],
            reject_artefacts=case.reject,
            options=pf.FillOptions(
                extrapolate=EXTRAPOLATE,
                # methods are compared on all samples that they fill
                plausibility=PlausibilityOptions() if case.method == "auto" else UNCHECKED,
            ),
        )


def run(case: Case, folder: Path | None = None) -> Row:
    """Fill the gaps of a case, and compare with the truth.

    Parameters
    ----------
    case : Case
        The row.
    folder : Path or None
        The folder of recordings.
    """
    truth = _clip(case.source, folder)
    if case.reject:
        # the truth is the clip without the artefacts
        assert case.change is not None
        gappy = _with_gaps(case.change(truth), case.gaps)
    else:
        truth = case.change(truth) if case.change else truth
        gappy = _with_gaps(truth, case.gaps)
    result = _fill(case, gappy, folder)
    scored = result.filled & ~truth.missing
    off = np.linalg.norm(result.clip.positions - truth.positions, axis=2)[scored]
    bound = result.error_bound_90_mm[scored]
    values = off if case.recorded else result.clip.positions[scored].ravel()
    # evenly spaced, cycling through the coordinates
    some = np.unique(np.linspace(0, len(values) - 1, SAMPLES).round().astype(np.intp))
    known = bool(len(bound)) and bool(np.isfinite(bound).any())
    return Row(
        int(result.filled.sum()),
        round(float(off.mean()), 6),
        _mean(result.expected_rms_mm[scored]),
        _mean(bound),
        round(float((off[np.isfinite(bound)] <= bound[np.isfinite(bound)]).mean()), 6)
        if known
        else None,
        tuple(round(float(value), 4) for value in values[some]),
    )


def _mean(values: np.ndarray) -> float | None:
    """Return the mean of the known values; None where there is none."""
    known = values[np.isfinite(values)]
    return round(float(known.mean()), 6) if len(known) else None


# --------------------------------------------------------------------------------------------------
# comparing and storing


def regressions(stored: Row, found: Row) -> list[str]:
    """Return how a result is worse than a stored one."""
    worse = []
    if not found.error <= MAX_RATIO * stored.error:
        worse.append(
            f"mean error {found.error:.4f} mm, stored {stored.error:.4f} mm "
            f"({_ratio(found.error, stored.error)})"
        )
    if found.filled < stored.filled:
        worse.append(f"{found.filled} samples filled, stored {stored.filled}")
    return worse


def differing(stored: Row, found: Row) -> list[str]:
    """Return how a result differs from a stored one.

    Parameters
    ----------
    stored, found : Row
        The results.
    """
    differences = []
    if found.filled != stored.filled:
        differences.append(f"{found.filled} samples filled, stored {stored.filled}")
    for name in ("error", "expected_rms", "bound"):
        new, old = getattr(found, name), getattr(stored, name)
        if (new is None) != (old is None) or (
            old is not None and not abs(new - old) <= max(RELATIVE * abs(old), 1e-5)
        ):
            differences.append(f"{name} {new} mm, stored {old} mm ({_ratio(new, old)})")
    new, old = found.coverage, stored.coverage
    if (new is None) != (old is None) or (old is not None and not abs(new - old) <= COVERAGE):
        differences.append(f"coverage {new}, stored {old}")
    if len(found.samples) != len(stored.samples):
        differences.append(f"{len(found.samples)} sampled values, stored {len(stored.samples)}")
    else:
        away = np.abs(np.subtract(found.samples, stored.samples))
        beyond = int((~(away <= MILLIMETRES)).sum())  # NaN is beyond
        if beyond:
            differences.append(
                f"{beyond} of {len(away)} sampled values differ by more "
                f"than {MILLIMETRES:g} mm, at most by {away.max():.4f} mm"
            )
    return differences


def message(name: str, differences: Sequence[str]) -> str:
    """Return the message of a failing test."""
    return (
        f"row {name}: {'; '.join(differences)}\nif intended, store the new result: {WRITE} {name}"
    )


def stored_rows(path: Path = STORED) -> dict[str, Row]:
    """Return the stored rows by name; empty without a file."""
    if not path.exists():
        return {}
    return {name: Row.of(row) for name, row in json.loads(path.read_text("utf-8")).items()}


def write_rows(rows: Mapping[str, Row], path: Path = STORED) -> None:
    """Store rows in the order of `CASES`, the sampled values of each on one line."""
    parts = []
    for name in (name for name in CASES if name in rows):
        values = {**vars(rows[name]), "samples": list(rows[name].samples)}
        lines = ",\n".join(f"  {json.dumps(k)}: {json.dumps(v)}" for k, v in values.items())
        parts.append(f"{json.dumps(name)}: {{\n{lines}\n}}")
    path.parent.mkdir(exist_ok=True)
    path.write_text("{\n" + ",\n".join(parts) + "\n}\n", "utf-8", newline="\n")


def _ratio(new: float | None, old: float | None) -> str:
    """Return the ratio of a new and an old value as text."""
    return "-" if new is None or not old else f"{new / old:.4f} x"


def _number(value: float | None) -> str:
    """Return a value for the table."""
    return "-" if value is None else f"{value:.3f}"


def _print_row(case: Case, found: Row, old: Row | None, seconds: float) -> None:
    """Print a line of the table: each value, followed by the stored one."""
    cells = [f"{case.name:28}", f"{found.filled:6}{old.filled if old else '-':>6}"]
    for name in ("error", "expected_rms", "bound", "coverage"):
        stored = getattr(old, name) if old else None
        cells.append(f"{_number(getattr(found, name)):>9}{_number(stored):>9}")
        if name == "error":
            cells.append(f"{_ratio(found.error, stored):>9}")
    if old is None:
        cells.append("not stored")
    else:
        cells.append("differs" if differing(old, found) else "same")
    print("  ".join([*cells, f"{seconds:.1f} s"]), flush=True)


def _chosen(only: str | None, parser: argparse.ArgumentParser) -> list[Case]:
    """Return the selected cases."""
    names = only.split(",") if only else list(CASES)
    unknown = [name for name in names if name not in CASES]
    if unknown:
        parser.error(f"there is no row {', '.join(unknown)}; the rows are {', '.join(CASES)}")
    return [CASES[name] for name in names]


def main() -> int:
    """Print the table, and store it with ``--write``."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", metavar="NAME,...", help="rows, all by default")
    parser.add_argument("--write", action="store_true", help=f"store results in {STORED.name}")
    add_data_option(parser)
    options = parser.parse_args()
    folder = options.data if options.data.is_dir() else None
    stored, kept = stored_rows(), {}
    two = f"{'new':>9}{'stored':>9}"
    print(
        f"{'':28}  {'filled':>12}  {'mean error (mm)':>18}  {'ratio':>9}  "
        f"{'expected rms (mm)':>18}  {'90 % bound (mm)':>18}  {'coverage':>18}"
    )
    print(f"{'row':28}  {'new':>6}{'stored':>6}  {two}  {'':>9}  {two}  {two}  {two}")
    skipped, changed = [], []
    for case in _chosen(options.only, parser):
        if case.recorded and folder is None:
            skipped.append(case.name)
            continue
        began = time.perf_counter()
        found = run(case, folder)
        old = stored.get(case.name)
        _print_row(case, found, old, time.perf_counter() - began)
        if old is None or differing(old, found):
            changed.append((case.name, found, old))
    if skipped:
        print(f"skipped, because there is no folder {options.data}: {', '.join(skipped)}")
    if options.write:
        for name, found, old in changed:
            why = differing(old, found) if old else ["new row"]
            print(f"stored {name}: {'; '.join(why)}")
        kept = {**stored, **{name: found for name, found, _ in changed}}
        gone = [name for name in kept if name not in CASES]
        if gone:
            print(f"removed, because the table has no such row: {', '.join(gone)}")
        if changed or gone:
            write_rows(kept)
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
