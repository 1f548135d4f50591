"""``priorfill inspect``: the contents of a file, its gaps, and what could fill them."""

from __future__ import annotations

import re
from collections import Counter
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.artefacts import print_artefacts
from priorfill.cli.option_names import with_options
from priorfill.cli.option_types import every_row_option
from priorfill.cli.output import (
    MAX_ROWS,
    duration,
    print_json,
    print_line,
    print_table,
    print_wrapped,
)
from priorfill.cli.path_types import FILE, FOLDER, PathArgument
from priorfill.cli.reading import read_clips, reading_options

if TYPE_CHECKING:
    from collections.abc import Sequence

    from priorfill.clip import Clip
    from priorfill.database import PriorDatabase
    from priorfill.markers.marker_set import MarkerSet
    from priorfill.markers.phantoms import Phantom

__all__ = ["inspect"]

MIN_OTHERS = 3
"""Minimum number of other markers visible in a frame for it to determine where a marker is: three
points define a frame of reference."""

MAX_NAMES = 8
"""Number of markers named in a line."""

MIN_SECONDS = 0.5
"""Shortest time (s) for which a marker must be visible to be learnt from: about half a step."""

_DETAIL = re.compile(r"( \(.*\)| [A-Z0-9]+)$")
"""The part of a reason for leaving out a point that is specific to it, like the name of a group."""

_UP_FOUND_FROM = {
    "file": "from the file",
    "data": "found from the data",
    "option": "as given",
    "default": "assumed; correct it with --up",
}


@click.command()
@click.argument("file", cls=PathArgument, type=FILE)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option(
    "--database",
    "-d",
    "folder",
    metavar="DIR",
    type=FOLDER,
    help="Count for each marker the clips of this database that hold it.",
)
@every_row_option
@reading_options
def inspect(
    file: Path,
    as_json: bool,
    folder: Path | None,
    every_row: bool,
    **reading: Any,
) -> None:
    """Show the contents of FILE, its gaps, and what they could be filled from.

    The subjects of a file of several are shown one after the other.
    """
    from priorfill.database import PriorDatabase
    from priorfill.markers.definitions import recognise
    from priorfill.markers.describe import describe

    clips, given = read_clips(file, **reading)
    subjects = []
    with nullcontext() if folder is None else PriorDatabase.open(folder) as database:
        for clip in clips:
            definition = given or recognise(clip.labels)
            facts = _facts(clip, file, describe(clip, definition), definition)
            if database is not None:
                _count_clips(facts, database, clip, definition)
            subjects.append(facts)
    if as_json:
        one = len(subjects) == 1
        print_json(subjects[0] if one else {"file": str(file), "subjects": subjects})
        return
    print_line(str(file))
    for number, facts in enumerate(subjects):
        if number:
            print_line()
        _print(facts, None if every_row else MAX_ROWS)


def _count_clips(
    facts: dict[str, Any], database: PriorDatabase, clip: Clip, definition: MarkerSet | None
) -> None:
    """Add the number of clips of a database that hold each marker with gaps."""
    facts["database"] = str(database.path)
    counts = _clips_with(database, clip, [gap["marker"] for gap in facts["gaps"]], definition)
    for gap in facts["gaps"]:
        gap["database_clips"] = counts[gap["marker"]]


def _facts(
    clip: Clip, file: Path, described: MarkerSet, definition: MarkerSet | None
) -> dict[str, Any]:
    """Return the description of a clip in the form of the JSON output."""
    from priorfill.artefacts import find_artefacts
    from priorfill.artefacts.artefact_facts import artefact_facts
    from priorfill.markers.phantoms import find_phantoms

    missing = clip.missing
    source = clip.source
    left_out = source.left_out if source is not None else {}
    read_notes = source.notes if source is not None else ()
    names = () if definition is None else {*definition.labels, *definition.match(clip.labels)}
    phantoms = find_phantoms(clip, names)
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
        "notes": [
            with_options(note)
            for note in (*read_notes, *_recognition_notes(clip, definition, phantoms))
        ],
        "missing_samples": int(missing.sum()),
        "missing_percent": round(100 * float(missing.mean()), 3),
        "blackout_frames": int(missing.all(axis=1).sum()),
        "phantoms": [
            {"marker": clip.labels[phantom.marker], "reason": phantom.reason}
            for phantom in phantoms
        ],
        "gaps": _gaps(clip, described),
        "gap_groups": _groups(clip),
        "artefacts": artefact_facts(find_artefacts(clip), clip),
    }


def _recognition_notes(
    clip: Clip, definition: MarkerSet | None, phantoms: Sequence[Phantom]
) -> tuple[str, ...]:
    """Return notes on a marker set that fits poorly, and on trajectories that are no markers."""
    from priorfill.markers.marker_set_check import check_marker_set
    from priorfill.markers.phantoms import phantom_notes

    return (
        *check_marker_set(clip.labels, clip.positions, definition, given=True),
        *phantom_notes(clip, phantoms),
    )


def _gaps(clip: Clip, described: MarkerSet) -> list[dict[str, Any]]:
    """Return a row for each marker that has gaps."""
    from priorfill.gaps import find_gaps

    missing = clip.missing
    visible_count = (~missing).sum(axis=1)
    by_marker: dict[int, list[tuple[int, int]]] = {}
    for gap in find_gaps(missing):
        by_marker.setdefault(gap.marker, []).append((gap.start, gap.stop))
    rows = []
    for marker in sorted(by_marker):
        label = clip.labels[marker]
        gaps = by_marker[marker]
        lost = missing[:, marker]
        # the marker itself is among the visible ones
        usable = int((~lost & (visible_count > MIN_OTHERS)).sum())
        rows.append(
            {
                "marker": label,
                "segment": described.segment[label],
                "gaps": [
                    {"first_frame": clip.first_frame + start, "frames": stop - start}
                    for start, stop in gaps
                ],
                "frames": int(lost.sum()),
                "percent": round(100 * float(lost.mean()), 3),
                "longest_seconds": round(max(stop - start for start, stop in gaps) / clip.rate, 6),
                "dropout": bool(lost.all()),
                "clip_frames": usable,
            }
        )
    return rows


def _groups(clip: Clip) -> list[dict[str, Any]]:
    """Return a row for each gap group."""
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
    """Return for each marker the number of clips that show it with others of this clip."""
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


def _print(facts: dict[str, Any], rows: int | None) -> None:
    """Print the description of a clip, with tables of at most `rows` rows."""
    for name, value in _summary(facts):
        print_wrapped(f"  {name:<11} {value}", " " * 14)
    if facts["artefacts"]:
        print_line()
        print_artefacts(
            facts["artefacts"], "Artefacts: measured samples that are probably wrong", rows
        )
    if facts["gaps"]:
        print_line()
        _print_gaps(facts, rows)
        print_line()
        _print_groups(facts["gap_groups"], rows)
        print_line()
        for line in _fillable(facts):
            print_wrapped(line)


def _print_gaps(facts: dict[str, Any], rows: int | None) -> None:
    """Print the table of markers with gaps, those most often missing first."""
    gaps = sorted(facts["gaps"], key=lambda gap: -int(gap["frames"]))
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
            for gap in gaps[:rows]
        ),
        title="Gaps by marker",
    )
    if rows is not None and len(gaps) > rows:
        print_line(f"... and {len(gaps) - rows} more markers (--all prints them)")


def _print_groups(groups: list[dict[str, Any]], rows: int | None) -> None:
    """Print the table of gap groups."""
    shown = sorted(groups, key=lambda group: -float(group["seconds"]))[:rows]
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
        title="Gap groups"
        + (
            f", the {rows} longest of {len(groups)} (--all: all)"
            if len(shown) < len(groups)
            else ""
        ),
    )


def _summary(facts: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the name and the text of each line about the clip as a whole."""
    unit = facts["unit"] or "not given"
    if facts["mm_per_unit"] != 1:
        unit += f" (1 is {facts['mm_per_unit']:g} mm)"
    gaps = sum(len(gap["gaps"]) for gap in facts["gaps"])
    missing = "nothing"
    if gaps:
        missing = (
            f"{facts['missing_percent']:.1f} % of the samples, in {gaps} "
            f"gap{'s' if gaps > 1 else ''} of {len(facts['gaps'])} "
            f"marker{'s' if len(facts['gaps']) > 1 else ''}"
        )
    rows = [
        ("markers", _markers(facts)),
        ("subject", facts["subject"]),
        (
            "frames",
            f"{facts['frames']} at {facts['rate']:g} Hz, {duration(facts['seconds'])}; "
            f"numbered from {facts['first_frame']}",
        ),
        ("unit", unit),
        ("up", f"{facts['up']}, {_UP_FOUND_FROM[facts['up_found_from']]}"),
        ("marker set", _marker_set(facts)),
        ("missing", missing),
        (
            "zeros",
            f"{facts['zero_samples']} samples at exactly (0, 0, 0) are treated as missing "
            "(--keep-zeros treats them as measured)"
            if facts["zero_samples"]
            else "",
        ),
        *(("note", note) for note in facts["notes"]),
    ]
    return [(name, value) for name, value in rows if value]


def _markers(facts: dict[str, Any]) -> str:
    """Return the number of markers, and of points that are none."""
    left_out = sum(facts["left_out"].values())
    if not left_out:
        return str(facts["markers"])
    kinds: Counter[str] = Counter()
    for reason, count in facts["left_out"].items():
        kinds[_DETAIL.sub("", reason)] += count
    reasons = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
    points = facts["markers"] + left_out
    return f"{facts['markers']} of {points} points (left out: {reasons})"


def _marker_set(facts: dict[str, Any]) -> str:
    """Return the marker set, and how its markers differ from the clip's."""
    known = facts["marker_set"]
    if known is None:
        return f"not recognised; {len(facts['segments'])} segments found from the data"
    text = f"{known['name']}, {known['found']} of its {known['markers']} markers"
    if known["absent"]:
        text += f"; absent: {_names(known['absent'])}"
    if known["unknown"]:
        text += f"; not in the set: {_names(known['unknown'])}"
    return text


def _fillable(facts: dict[str, Any]) -> list[str]:
    """Return sentences on what the gaps can be filled from."""
    enough = MIN_SECONDS * facts["rate"]
    own, barely, database, never = [], [], [], []
    phantoms = [phantom["marker"] for phantom in facts["phantoms"]]
    for gap in facts["gaps"]:
        if gap["marker"] in phantoms:
            continue
        if gap["clip_frames"] >= enough:
            own.append(gap["marker"])
        elif gap.get("database_clips"):
            database.append(gap["marker"])
        elif gap["clip_frames"]:
            barely.append(gap["marker"])
        else:
            never.append(gap["marker"])
    more = (
        ""
        if "database" in facts
        else "; a database (--database) or another recording of the subject (--same-subject) "
        "can help"
    )
    lines = [
        f"{text}: {_names(labels)}{end}."
        for text, labels, end in (
            (f"From the clip itself (visible with {MIN_OTHERS} others or more)", own, ""),
            ("From the database only", database, ""),
            (
                f"Barely from the clip itself (visible for less than {MIN_SECONDS:g} s)",
                barely,
                more,
            ),
            ("Never visible, so at best from the contralateral marker", never, more),
            ("Fragments and phantoms, not filled unless --markers names them", phantoms, ""),
        )
        if labels
    ]
    if facts["blackout_frames"]:
        lines.append(
            f"No marker is visible in {facts['blackout_frames']} frames; the longer a blackout, "
            "the less certain its fill."
        )
    return lines


def _names(labels: list[str]) -> str:
    """Return the first labels in a line, and the number of the others."""
    shown = " ".join(labels[:MAX_NAMES])
    rest = len(labels) - MAX_NAMES
    return f"{shown} and {rest} more" if rest > 0 else shown
