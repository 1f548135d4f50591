"""``priorfill inspect``: what is in a file, which gaps it has, and what could fill them."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.artefacts import artefact_facts, print_artefacts
from priorfill.cli.output import duration, print_json, print_table
from priorfill.cli.reading import read_clip, reading_options

if TYPE_CHECKING:
    from priorfill.clip import Clip
    from priorfill.database import PriorDatabase
    from priorfill.markers.marker_set import MarkerSet

__all__ = ["inspect"]

MIN_OTHERS = 3
"""Other markers that must be seen with a marker for a frame to say where it is: three points
make a frame of reference."""

MAX_GROUPS = 20
"""Gap groups in the table; ``--json`` has all."""

MAX_NAMES = 8
"""Markers named in a line."""

MIN_SECONDS = 0.5
"""A marker seen for less than this is hardly known: about half a step."""

_DETAIL = re.compile(r"( \(.*\)| [A-Z0-9]+)$")
"""What in a reason for leaving a point out is special to the point, like the name of a group."""

_UP_FOUND_FROM = {
    "file": "as the file says",
    "data": "found from the data",
    "option": "as given",
    "default": "assumed; give --up if it is another",
}


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option(
    "--database",
    "-d",
    "folder",
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="Say for each marker how many clips of this database hold it.",
)
@reading_options
def inspect(
    file: Path,
    as_json: bool,
    folder: Path | None,
    **reading: Any,
) -> None:
    """Show what is in a file, which gaps it has, and what they could be filled from."""
    from priorfill.database import PriorDatabase
    from priorfill.markers.definitions import recognise
    from priorfill.markers.describe import describe

    clip, definition = read_clip(file, **reading)
    described = describe(clip, definition)
    facts = _facts(clip, file, described, definition or recognise(clip.labels))
    if folder is not None:
        with PriorDatabase.open(folder) as database:
            counts = _clips_with(
                database,
                clip,
                [gap["marker"] for gap in facts["gaps"]],
                definition or recognise(clip.labels),
            )
        facts["database"] = str(folder)
        for gap in facts["gaps"]:
            gap["database_clips"] = counts[gap["marker"]]
    if as_json:
        print_json(facts)
    else:
        _print(facts)


def _facts(
    clip: Clip, file: Path, described: MarkerSet, definition: MarkerSet | None
) -> dict[str, Any]:
    """Return everything that is said of a clip, in the form of the JSON output."""
    from priorfill.artefacts import find_artefacts

    missing = clip.missing
    source = clip.source
    left_out = source.left_out if source is not None else {}
    known: dict[str, Any] | None = None
    if definition is not None:
        match = definition.match(clip.labels)
        needed = [label for label in definition.labels if label not in definition.optional]
        found = set(match.values())
        known = {
            "name": definition.name,
            "title": definition.title,
            "markers": len(needed),
            "found": len(found),
            "absent": [label for label in needed if label not in found],
            "unknown": [label for label in clip.labels if label not in match],
        }
    return {
        "file": str(file),
        "name": clip.name,
        "subject": clip.subject,
        "markers": len(clip.labels),
        "labels": list(clip.labels),
        "frames": clip.frames,
        "first_frame": clip.first_frame,
        "rate": clip.rate,
        "seconds": round(clip.duration, 6),
        "unit": source.unit if source is not None else "mm",
        "mm_per_unit": source.mm_per_unit if source is not None else 1.0,
        "up": clip.up,
        "up_found_from": source.up_found_from if source is not None else "default",
        "marker_set": known,
        "segments": {name: list(labels) for name, labels in described.segments.items()},
        "reliable": [label for label in clip.labels if described.reliable[label]],
        "left_out": dict(Counter(left_out.values()).most_common()),
        "zero_samples": source.zero_samples if source is not None else 0,
        "notes": list(source.notes) if source is not None else [],
        "missing_samples": int(missing.sum()),
        "missing_percent": round(100 * float(missing.mean()), 3),
        "blackout_frames": int(missing.all(axis=1).sum()),
        "gaps": _gaps(clip, described),
        "gap_groups": _groups(clip),
        "trouble": artefact_facts(find_artefacts(clip), clip),
    }


def _gaps(clip: Clip, described: MarkerSet) -> list[dict[str, Any]]:
    """Return a row for each marker that has gaps."""
    from priorfill.gaps import find_gaps

    missing = clip.missing
    seen_count = (~missing).sum(axis=1)
    by_marker: dict[int, list[tuple[int, int]]] = {}
    for gap in find_gaps(missing):
        by_marker.setdefault(gap.marker, []).append((gap.start, gap.stop))
    rows = []
    for marker in sorted(by_marker):
        label = clip.labels[marker]
        gaps = by_marker[marker]
        gone = missing[:, marker]
        # the marker itself is among those counted as seen
        usable = int((~gone & (seen_count > MIN_OTHERS)).sum())
        rows.append(
            {
                "marker": label,
                "segment": described.segment[label],
                "gaps": [
                    {"first_frame": clip.first_frame + start, "frames": stop - start}
                    for start, stop in gaps
                ],
                "frames": int(gone.sum()),
                "percent": round(100 * float(gone.mean()), 3),
                "longest_seconds": round(max(stop - start for start, stop in gaps) / clip.rate, 6),
                "dropout": bool(gone.all()),
                "clip_frames": usable,
            }
        )
    return rows


def _groups(clip: Clip) -> list[dict[str, Any]]:
    from priorfill.gaps import gap_groups

    return [
        {
            "first_frame": clip.first_frame + group.start,
            "last_frame": clip.first_frame + group.stop - 1,
            "seconds": round((group.stop - group.start) / clip.rate, 6),
            "gaps": len(group.gaps),
            "markers": [clip.labels[marker] for marker in group.markers],
            "at_start": group.start == 0,
            "at_end": group.stop == clip.frames,
        }
        for group in gap_groups(clip.missing)
    ]


def _clips_with(
    database: PriorDatabase, clip: Clip, markers: list[str], definition: MarkerSet | None
) -> dict[str, int]:
    """Return for each marker how many clips show it together with others of this clip."""
    from priorfill.markers.marker_set import same_markers

    counts = dict.fromkeys(markers, 0)
    for record in database.clips():
        here, there = same_markers(clip.labels, record.labels, definition)
        column = {clip.labels[i]: j for i, j in zip(here, there, strict=True)}
        if len(column) <= MIN_OTHERS:
            continue
        for label in markers:
            if label in column and record.measured[column[label]]:
                counts[label] += 1
    return counts


def _print(facts: dict[str, Any]) -> None:
    click.echo(facts["file"])
    for name, value in _summary(facts):
        click.echo(f"  {name:<11} {value}")
    if facts["trouble"]:
        click.echo()
        print_artefacts(
            facts["trouble"], "Trouble: samples that are hardly what they are labelled as"
        )
    if not facts["gaps"]:
        return
    click.echo()
    with_database = "database" in facts
    columns = ["marker", "segment", "gaps>", "frames>", "%>", "longest s>", "clip frames>"]
    print_table(
        [*columns, *(["database clips>"] if with_database else [])],
        (
            [
                gap["marker"],
                gap["segment"],
                "all" if gap["dropout"] else str(len(gap["gaps"])),
                str(gap["frames"]),
                f"{gap['percent']:.1f}",
                f"{gap['longest_seconds']:.2f}",
                str(gap["clip_frames"]),
                *([str(gap["database_clips"])] if with_database else []),
            ]
            for gap in facts["gaps"]
        ),
        title="Gaps by marker",
    )
    click.echo()
    groups = facts["gap_groups"]
    shown = sorted(groups, key=lambda group: -group["seconds"])[:MAX_GROUPS]
    rest = len(groups) - len(shown)
    print_table(
        ["frames>", "s>", "gaps>", "markers"],
        (
            [
                f"{group['first_frame']}-{group['last_frame']}",
                f"{group['seconds']:.2f}",
                str(group["gaps"]),
                _names(group["markers"])
                + (" (from the clip's start)" if group["at_start"] else "")
                + (" (to the clip's end)" if group["at_end"] else ""),
            ]
            for group in sorted(shown, key=lambda group: group["first_frame"])
        ),
        title="Gap groups" + (f", the {MAX_GROUPS} longest of {len(groups)}" if rest else ""),
    )
    click.echo()
    for line in _fillable(facts):
        click.echo(line)


def _summary(facts: dict[str, Any]) -> list[tuple[str, str]]:
    left_out = sum(facts["left_out"].values())
    markers = str(facts["markers"])
    if left_out:
        kinds: Counter[str] = Counter()
        for reason, count in facts["left_out"].items():
            kinds[_DETAIL.sub("", reason)] += count
        reasons = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
        markers += f" of {facts['markers'] + left_out} points (left out: {reasons})"
    unit = facts["unit"] or "not given"
    if facts["mm_per_unit"] != 1:
        unit += f" (1 is {facts['mm_per_unit']:g} mm)"
    known = facts["marker_set"]
    if known is None:
        marker_set = f"none known; {len(facts['segments'])} segments found from the data"
    else:
        marker_set = f"{known['name']}, {known['found']} of its {known['markers']} markers"
        if known["absent"]:
            marker_set += f"; absent: {_names(known['absent'])}"
        if known["unknown"]:
            marker_set += f"; not of the set: {_names(known['unknown'])}"
    gaps = sum(len(gap["gaps"]) for gap in facts["gaps"])
    missing = "nothing"
    if gaps:
        missing = (
            f"{facts['missing_percent']:.1f} % of the samples, in {gaps} "
            f"gap{'s' if gaps > 1 else ''} of {len(facts['gaps'])} "
            f"marker{'s' if len(facts['gaps']) > 1 else ''}"
        )
    rows = [
        ("markers", markers),
        ("subject", facts["subject"]),
        (
            "frames",
            f"{facts['frames']} at {facts['rate']:g} Hz, {duration(facts['seconds'])}; "
            f"the first has number {facts['first_frame']}",
        ),
        ("unit", unit),
        ("up", f"{facts['up']}, {_UP_FOUND_FROM[facts['up_found_from']]}"),
        ("marker set", marker_set),
        ("missing", missing),
        (
            "zeros",
            f"{facts['zero_samples']} samples are exactly (0, 0, 0) and taken as missing "
            "(--keep-zeros: as measured)"
            if facts["zero_samples"]
            else "",
        ),
        *(("note", note) for note in facts["notes"]),
    ]
    return [(name, value) for name, value in rows if value]


def _fillable(facts: dict[str, Any]) -> list[str]:
    """Return which gaps can be filled from what, in words."""
    enough = MIN_SECONDS * facts["rate"]
    own, hardly, database, nothing = [], [], [], []
    for gap in facts["gaps"]:
        if gap["clip_frames"] >= enough:
            own.append(gap["marker"])
        elif gap.get("database_clips"):
            database.append(gap["marker"])
        elif gap["clip_frames"]:
            hardly.append(gap["marker"])
        else:
            nothing.append(gap["marker"])
    more = (
        ""
        if "database" in facts
        else "; a database can help (--database), or another clip of the person"
    )
    lines = [
        f"{text}: {_names(labels)}{end}."
        for text, labels, end in (
            (f"From the clip itself (seen with {MIN_OTHERS} others or more)", own, ""),
            ("From the database only", database, ""),
            (f"Hardly from the clip itself (seen for less than {MIN_SECONDS:g} s)", hardly, more),
            ("Never seen, so at best from the partner on the other side", nothing, more),
        )
        if labels
    ]
    if facts["blackout_frames"]:
        lines.append(
            f"No marker at all is seen in {facts['blackout_frames']} frames: "
            "the longer they last, the more of it is a guess."
        )
    return lines


def _names(labels: list[str]) -> str:
    shown = " ".join(labels[:MAX_NAMES])
    rest = len(labels) - MAX_NAMES
    return f"{shown} and {rest} more" if rest > 0 else shown
