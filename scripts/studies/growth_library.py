"""Value of a large prior database: errors with random parts of it, from one take to all.

`growth_study.py --library` runs it. Gaps of several kinds are cut in the middle of takes that are
held out; each is filled without a database, and with nested random parts of the library, with the
takes of the same subject in them and without.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from method_alone import method_alone
from numpy.typing import NDArray
from process_pool import process_pool

import priorfill as pf
from priorfill.database import ClipRecord
from priorfill.evaluation.body_parts import parts_of

KINDS = ("single", "arm", "leg", "arms", "legs", "frames")
LIMB_KINDS = KINDS[1:5]
SOURCES = ("with the subject", "strangers")

GAP_SECONDS = (0.5, 2.0)
"""s. Shortest and longest gap; it is at most half of the take, in its middle."""

BRIEF_SECONDS = (0.15, 1.5)
"""s. The same for whole frames."""

MIN_TAKE_SECONDS = 1.5


class PartOfDatabase(pf.PriorDatabase):
    """A database of which only some takes are used."""

    kept: frozenset[str] = frozenset()

    def clips(self) -> tuple[ClipRecord, ...]:
        """Return the rows of these takes."""
        return tuple(record for record in super().clips() if record.content in self.kept)


@dataclass(frozen=True, eq=False)
class Case:
    """A take with a gap, and whose it is."""

    name: str
    kind: str
    subject: str
    clip: pf.Clip
    gone: NDArray[np.bool_]  # (frames, markers)


class Row(NamedTuple):
    """The outcome of one fill; ``takes`` is 0 without a database."""

    name: str
    kind: str
    source: str
    takes: int
    error: float


def held_out(
    records: Sequence[ClipRecord], database: pf.PriorDatabase, per_kind: int, seed: int
) -> list[tuple[ClipRecord, Case]]:
    """Return some takes, each with a gap of one kind; a take is used once."""
    rng = np.random.default_rng(seed)
    order = iter(rng.permutation(len(records)))
    found = []
    for kind in KINDS:
        for record in _taken(order, records, per_kind):
            clip = _clip(record, database)
            gone = _gap(kind, clip, rng)
            if gone is not None:
                found.append((record, Case(record.name, kind, record.subject, clip, gone)))
    return found


def _taken(order: Iterator[int], records: Sequence[ClipRecord], count: int) -> list[ClipRecord]:
    """Return the next records of an order that are long enough."""
    found: list[ClipRecord] = []
    while len(found) < count and (at := next(order, None)) is not None:
        if records[at].frames[0] >= MIN_TAKE_SECONDS * records[at].rate:
            found.append(records[at])
    return found


def _clip(record: ClipRecord, database: pf.PriorDatabase) -> pf.Clip:
    positions = database.positions(record).astype(np.float64)
    return pf.Clip(positions, record.labels, record.rate, name=record.name, subject=record.subject)


def _gap(kind: str, clip: pf.Clip, rng: np.random.Generator) -> NDArray[np.bool_] | None:
    """Return the mask of a gap of a kind in the middle of a clip; None without such markers."""
    shortest, longest = BRIEF_SECONDS if kind == "frames" else GAP_SECONDS
    frames = min(round(rng.uniform(shortest, longest) * clip.rate), clip.frames // 2)
    parts = parts_of(clip)
    limbs = dict(zip(parts.limb_names, parts.limbs, strict=True))
    side = rng.permutation(["left", "right"])
    markers = {
        "single": [int(rng.integers(len(clip.labels)))],
        "frames": list(range(len(clip.labels))),
        "arm": limbs.get(f"{side[0]}_arm", []),
        "leg": limbs.get(f"{side[0]}_leg", []),
        "arms": limbs.get("left_arm", []) + limbs.get("right_arm", []),
        "legs": limbs.get("left_leg", []) + limbs.get("right_leg", []),
    }[kind]
    start = (clip.frames - frames) // 2
    gone = np.zeros_like(clip.missing)
    gone[start : start + frames, markers] = True
    return gone if gone.any() and not clip.missing[gone].any() else None


def error_of(case: Case, database: pf.PriorDatabase | None, selection: pf.Selection) -> float:
    """Remove and fill; return the mean error (mm), NaN where the fill is not complete."""
    gappy = np.where(case.gone[..., None], np.nan, case.clip.positions)
    result = pf.fill(
        case.clip.with_positions(gappy), database=database, options=method_alone(selection)
    )
    off = result.clip.positions[case.gone] - case.clip.positions[case.gone]
    return float(np.linalg.norm(off, axis=1).mean())


def errors(case: Case, path: Path, parts: Sequence[frozenset[str]]) -> list[Row]:
    """Fill a case without a database, and with each part of it, from both sources."""
    everyone, strangers = pf.Selection(), pf.Selection(not_subjects=(case.subject,))
    rows = [Row(case.name, case.kind, "none", 0, error_of(case, None, everyone))]
    with PartOfDatabase.open(path) as database:
        for part in parts:
            database.kept = part
            for source, selection in zip(SOURCES, (everyone, strangers), strict=True):
                error = error_of(case, database, selection)
                rows.append(Row(case.name, case.kind, source, len(part), error))
    return rows


def ratios(rows: Iterable[Row], kinds: Sequence[str], source: str) -> dict[int, float]:
    """Return the geometric mean of error / error without a database, by number of takes."""
    rows = list(rows)
    alone = {row.name: row.error for row in rows if row.source == "none"}
    logs: dict[int, list[float]] = {}
    for row in rows:
        if row.kind in kinds and row.source == source and row.error > 0 and alone[row.name] > 0:
            logs.setdefault(row.takes, []).append(float(np.log(row.error / alone[row.name])))
    return {takes: float(np.exp(np.mean(some))) for takes, some in sorted(logs.items())}


def table(rows: Sequence[Row]) -> str:
    """Return the ratios as a table in Markdown."""
    sizes = sorted({row.takes for row in rows if row.takes})
    lines = [
        "| kind (cases) | | " + " | ".join(f"{size:,}" for size in sizes) + " |",
        "|---|---|" + "---|" * len(sizes),
    ]
    groups = {kind: (kind,) for kind in KINDS} | {"limbs": LIMB_KINDS}
    for group, kinds in groups.items():
        count = len({row.name for row in rows if row.kind in kinds})
        for source in SOURCES if count else ():
            found = ratios(rows, kinds, source)
            values = " | ".join(f"{found.get(size, np.nan):.2f}" for size in sizes)
            lines.append(f"| {group} ({count}) | {source} | {values} |")
    return "\n".join(lines)


def plot(rows: Sequence[Row], file: Path) -> None:
    """Plot the ratios over the number of takes, one panel for each source."""
    try:
        from matplotlib.figure import Figure  # not of pyplot, which keeps figures open
    except ImportError:
        print("no plot: matplotlib is not installed (pip install matplotlib)", file=sys.stderr)
        return
    figure = Figure(figsize=(9, 4), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, source in zip(panels, SOURCES, strict=True):
        for kind in KINDS:
            found = ratios(rows, (kind,), source)
            axes.plot(list(found), list(found.values()), "o-", label=kind, linewidth=1, ms=3)
        limbs = ratios(rows, LIMB_KINDS, source)
        axes.plot(list(limbs), list(limbs.values()), "k-", label="limbs", linewidth=2.5)
        axes.axhline(1, color="0.6", linewidth=0.8)
        axes.set(xscale="log", yscale="log", xlabel="takes in the database", title=source)
        axes.set_yticks([0.3, 0.4, 0.5, 0.7, 1.0], ["0.3", "0.4", "0.5", "0.7", "1.0"])
        axes.minorticks_off()
    panels[0].set_ylabel("error / error without a database")
    panels[0].legend(fontsize="small")
    figure.savefig(file, dpi=110)
    print(f"plot: {file}")


def _opened(library: Path, temporary: Path) -> Path:
    """Return the path of the library; of a folder of recordings, that of a new database of them."""
    files = sorted(library.rglob("*.c3d"))
    if not files:
        return library
    with pf.PriorDatabase.create(temporary / "db") as database:
        for file in files:
            clip = pf.read(file)
            database.add(clip, pf.ClipOrigin(subject=clip.subject or file.parent.name))
    return temporary / "db"


def run(
    library: Path, sizes: Sequence[int], per_kind: int, seed: int, processes: int, output: Path
) -> int:
    """Run the study; write the rows as JSON, the table and the plot."""
    with tempfile.TemporaryDirectory() as temporary:
        path = _opened(library, Path(temporary))
        with pf.PriorDatabase.open(path) as database:
            records = database.clips()
            some = held_out(records, database, per_kind, seed)
        cases = [case for _, case in some]
        used = {record.content for record, _ in some}
        rest = [record.content for record in records if record.content not in used]
        order = np.random.default_rng(seed + 1).permutation(len(rest))
        known = sorted({min(size, len(rest)) for size in (*sizes, len(rest))})
        parts = [frozenset(rest[i] for i in order[:size]) for size in known]
        rows: list[Row] = []
        with process_pool(processes) as pool:
            for found in pool.map(errors, cases, [path] * len(cases), [parts] * len(cases)):
                rows += found
                print(".", end="", file=sys.stderr, flush=True)
        print(file=sys.stderr)
    print(f"{len(cases)} cases, {len(rest)} takes, error / error without a database\n")
    print(table(rows))
    output.mkdir(parents=True, exist_ok=True)
    (output / "growth.json").write_text(
        json.dumps([row._asdict() for row in rows], indent=1), encoding="utf-8"
    )
    plot(rows, output / "growth.png")
    return 0
