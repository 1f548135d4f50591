"""``priorfill fill``: fill the gaps of a file."""

from __future__ import annotations

import math
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.add_result import (
    Kept,
    facts_of_keeping,
    is_to_be_made,
    keep,
    not_kept,
)
from priorfill.cli.artefacts import (
    artefact_facts,
    print_artefacts,
    print_left_as_measured,
    warn_of_artefacts,
)
from priorfill.cli.output import (
    json_number,
    print_json,
    print_table,
    some_names,
)
from priorfill.cli.progress import progress
from priorfill.cli.reading import excluding_options, read_clips, reading_options
from priorfill.errors import PriorfillError

if TYPE_CHECKING:
    from priorfill.artefacts import Artefact
    from priorfill.clip import Clip
    from priorfill.filling.overrides import Overrides
    from priorfill.filling.result import Result
    from priorfill.formats import WriteReport

__all__ = ["EXIT_INCOMPLETE", "fill", "print_left_missing"]

EXIT_INCOMPLETE = 3
"""Exit status: done, but not all gaps could be filled."""

MAX_GAPS = 40
"""Gaps in the table; ``--json`` has all."""


def _frames(
    context: click.Context, parameter: click.Parameter, value: str | None
) -> tuple[int | None, int | None] | None:
    """Understand ``A:B``, ``A:`` and ``:B``."""
    if value is None:
        return None
    try:
        first, last = (int(part) if part.strip() else None for part in value.split(":"))
    except ValueError:
        raise click.BadParameter(f"{value!r} is not of the form A:B, as in 100:250") from None
    return first, last


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--output",
    "-o",
    metavar="OUT",
    type=click.Path(path_type=Path),
    required=True,
    help="Where to write the filled clip: a copy of FILE with the gaps filled, or a new file if "
    "its suffix is of another format (.c3d .trc .npz .mat).",
)
@click.option(
    "--database",
    "-d",
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="Prior database to learn from, beside the clip itself.",
)
@click.option(
    "--same-subject",
    "same_subject",
    metavar="OTHER",
    type=click.Path(path_type=Path),
    multiple=True,
    help="Another clip of the same person with the same markers on, such as the static trial, "
    "to learn from; may be given again.",
)
@click.option(
    "--method",
    "-m",
    default="auto",
    show_default=True,
    help="auto, which is prior, or one that `priorfill methods` lists.",
)
@click.option(
    "--markers",
    metavar="PATTERN",
    multiple=True,
    help="Fill these markers only ('L*'); may be given again.",
)
@click.option(
    "--frames",
    metavar="A:B",
    callback=_frames,
    help="Fill frames A to B only, as the file numbers them; either may be left out.",
)
@click.option(
    "--max-gap",
    metavar="SECONDS",
    type=float,
    help="Leave longer gaps alone, each as a whole.",
)
@click.option("--skip-edges", is_flag=True, help="Leave gaps at the clip's start and end alone.")
@click.option(
    "--overrides",
    "overrides_file",
    metavar="FILE.toml",
    type=click.Path(path_type=Path),
    help="Do with single gaps as this file says.",
)
@click.option(
    "--reject-artefacts",
    is_flag=True,
    help="Treat samples in trouble (swapped, spikes, phantoms, frozen) as missing; says which.",
)
@excluding_options
@click.option(
    "--only-subject",
    "subjects",
    metavar="PATTERN",
    multiple=True,
    help="Learn from clips of these people only; may be given again.",
)
@click.option(
    "--trust-filled",
    is_flag=True,
    help="Learn from samples of the database that were filled, too, not only from measured ones.",
)
@click.option(
    "--add-to-database",
    "add",
    is_flag=True,
    help="Add the filled clip to the database, which is made if it is not there.",
)
@click.option(
    "--uncertainty",
    metavar="OUT.npz|OUT.csv",
    type=click.Path(path_type=Path),
    help="Write, too, how far off each filled sample may be.",
)
@click.option(
    "--rewrite",
    is_flag=True,
    help="Write the file anew, with float coordinates, instead of a copy; says what that changes.",
)
@click.option("--overwrite", is_flag=True, help="Replace what is to be written if it exists.")
@click.option(
    "--threads",
    metavar="N",
    type=click.IntRange(min=1),
    help="How many threads to use at most; all cores by default. The result is the same.",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@reading_options
def fill(
    file: Path,
    output: Path,
    database: Path | None,
    same_subject: tuple[Path, ...],
    method: str,
    markers: tuple[str, ...],
    frames: tuple[int | None, int | None] | None,
    max_gap: float | None,
    skip_edges: bool,
    overrides_file: Path | None,
    reject_artefacts: bool,
    not_names: tuple[str, ...],
    not_subjects: tuple[str, ...],
    subjects: tuple[str, ...],
    trust_filled: bool,
    add: bool,
    uncertainty: Path | None,
    rewrite: bool,
    overwrite: bool,
    threads: int | None,
    as_json: bool,
    **reading: Any,
) -> None:
    """Fill the gaps of FILE.

    Measured samples, and everything else that the file holds, come out as they went in (but for
    samples that --reject-artefacts rejects). The clip's own recording in the database, if it is
    there, is not learnt from. In a file of several people each is filled by itself.

    Exit status 0: done; 3: done, but not all gaps could be filled; 1: could not.
    """
    from priorfill import formats
    from priorfill.artefacts import find_artefacts
    from priorfill.database import Selection
    from priorfill.filling.gap_filter import GapFilter
    from priorfill.filling.multi_subject import merge_artefacts, merge_results
    from priorfill.filling.overrides import read_overrides
    from priorfill.filling.uncertainty_file import check_uncertainty, uncertainty_file
    from priorfill.methods import get_method
    from priorfill.runtime.memory import give_back
    from priorfill.runtime.threads import at_most

    if threads is not None:
        at_most(threads)
    for option, given in (
        ("--exclude-motion", not_names),
        ("--exclude-subject", not_subjects),
        ("--only-subject", subjects),
        ("--trust-filled", trust_filled),
        ("--add-to-database", add),
    ):
        if given and database is None:
            raise click.UsageError(f"{option} says something of a database; give one (--database)")
    # whatever would make the work be in vain is found out before it is done
    get_method(method)
    gap_filter = GapFilter(markers, frames, max_gap, skip_edges)
    overrides = None if overrides_file is None else read_overrides(overrides_file)
    formats.check_output(output, source=file, overwrite=overwrite, rewrite=rewrite)
    if uncertainty is not None:
        check_uncertainty(uncertainty, source=file, output=output, overwrite=overwrite)
    selection = Selection(subjects=subjects, not_names=not_names, not_subjects=not_subjects)
    keep_in = database if add else None
    if keep_in is not None and is_to_be_made(keep_in):
        database = None  # so far the clip itself is all there is to learn from
    clips, marker_set = read_clips(file, **reading)
    companions_of = _companions(same_subject, file, clips, reading)
    gap_filter = gap_filter.of_several(clips)
    overrides = None if overrides is None else overrides.of_several(clips)
    seen: tuple[Artefact, ...] = ()
    if not reject_artefacts:  # looked for first: beside what was filled it would take more memory
        seen = merge_artefacts(
            [clip.subject for clip in clips], [find_artefacts(clip) for clip in clips]
        )
        give_back()
    results = []
    for clip, others in zip(clips, companions_of, strict=True):
        whose = f" ({clip.subject})" if len(clips) > 1 else ""
        with progress(None, f"filling {clip.name}{whose}") as show:
            one = _fill_clip(
                clip,
                overrides,
                database=database,
                method=method,
                marker_set=marker_set,
                progress=show,
                selection=selection,
                trust_filled=trust_filled,
                same_subject=others,
                gap_filter=gap_filter,
                reject_artefacts=reject_artefacts,
            )
        results.append(one)
    result = merge_results(results)
    with ExitStack() as stack:
        if uncertainty is not None:  # both files appear, or none
            beside = uncertainty_file(uncertainty, result, overwrite=overwrite)
            stack.enter_context(beside)
        written = formats.write(
            output, result.clip, result.filled, overwrite=overwrite, rewrite=rewrite
        )
    kept: list[Kept | None] = []
    failure: PriorfillError | OSError | None = None
    if keep_in is not None:
        for clip, one in zip(clips, results, strict=True):
            whose_file = reading | ({"subject": clip.subject} if len(clips) > 1 else {})
            try:
                kept.append(keep(keep_in, clip, output, one, whose_file))
            except (PriorfillError, OSError) as error:
                failure = error  # what was filled is of use without the database
                reading = whose_file
                kept.append(None)
    artefacts = artefact_facts(result.artefacts if reject_artefacts else seen, result.clip)
    if as_json:
        facts = _facts(file, output, uncertainty, result, results, written, kept)
        print_json(facts | {"trouble": artefacts})
    else:
        _print(output, result, written)
        if result.rejected.any():
            click.echo()
            print_artefacts(artefacts, "Rejected, and treated as missing")
        if uncertainty is not None:
            click.echo(f"how far off each filled sample may be: {uncertainty}")
        for added in kept:
            if added is not None:
                click.echo(added.text)
    understood = result.clip.source.notes if result.clip.source is not None else ()
    for note in (
        *understood,
        *result.notes,
        *(f"rewritten: {change}" for change in written.changes),
    ):
        click.echo(f"note: {note}", err=True)
    if not reject_artefacts:
        warn_of_artefacts(artefacts, str(file))
    print_left_as_measured(result, file, output)
    print_left_missing(result)
    if failure is not None and keep_in is not None:
        raise not_kept(failure, keep_in, file, output, result.method, reading) from failure
    if not result.complete:
        click.get_current_context().exit(EXIT_INCOMPLETE)


def _fill_clip(clip: Clip, overrides: Overrides | None, **options: Any) -> Result:
    """Fill a clip, by what was decided if there are decisions."""
    from priorfill.filling.apply_overrides import fill_with_overrides
    from priorfill.filling.fill_clip import fill as fill_clip

    if overrides is None:
        return fill_clip(clip, **options)
    return fill_with_overrides(clip, overrides, **options)


def _companions(
    others: tuple[Path, ...], file: Path, clips: list[Clip], reading: dict[str, Any]
) -> list[list[Clip]]:
    """Read other recordings of the same people; return those of each clip's own.

    They are understood by themselves, but for what the options say of FILE's markers. Of several
    people, each OTHER must say whom it is of.
    """
    from priorfill import formats
    from priorfill.errors import OptionError, SeveralSubjectsError

    found: list[list[Clip]] = [[] for _ in clips]
    for other in others:
        if other.exists() and other.samefile(file):
            raise OptionError(
                f"{other}: is FILE itself; --same-subject takes another recording of the "
                "same person"
            )
        options: dict[str, Any] = {"zeros_missing": not reading["keep_zeros"]}
        subject = reading["subject"]
        if len(clips) == 1:
            found[0].append(formats.read(other, subject=subject, **options))
            continue
        try:
            there = [formats.read(other, **options)]
        except SeveralSubjectsError as several:
            there = [formats.read(other, subject=name, **options) for name in several.subjects]
        whose = {clip.subject: clip for clip in there}
        for clip, own in zip(clips, found, strict=True):
            own += [whose[clip.subject]] if clip.subject in whose else []
        if not whose.keys() & {clip.subject for clip in clips}:
            names = ", ".join(clip.subject for clip in clips)
            raise OptionError(
                f"{other}: does not say whether it is of {names}; fill one of them at a time "
                "(--subject)"
            )
    return found


def _facts(
    file: Path,
    output: Path,
    uncertainty: Path | None,
    result: Result,
    results: list[Result],
    written: WriteReport | None,
    kept: list[Kept | None],
) -> dict[str, Any]:
    """Return what is said of a fill, in the form of the JSON output."""
    first = result.clip.first_frame
    added = [facts_of_keeping(one) for one in kept]
    gaps = [(one.clip.subject, gap) for one in results for gap in one.gaps]
    return {
        "file": str(file),
        "output": str(output),
        "uncertainty": str(uncertainty) if uncertainty else None,
        "method": result.method,
        "database": str(result.database) if result.database else None,
        "marker_set": result.marker_set.name,
        "rate": result.clip.rate,
        "filled_samples": int(result.filled.sum()),
        "rejected_samples": int(result.rejected.sum()),
        "missing_samples": int(result.clip.missing.sum()),
        "complete": result.complete,
        "notes": list(result.notes),
        "rounding_mm": written.worst_error_mm if written else 0.0,
        "rewriting_changed": list(written.changes) if written else [],
        **(added[0] if len(added) == 1 else {}),
        "subjects": [
            {
                "subject": one.clip.subject,
                "marker_set": one.marker_set.name,
                "filled_samples": int(one.filled.sum()),
                "missing_samples": int(one.clip.missing.sum()),
                "complete": one.complete,
                **(added[number] if added else {}),
            }
            for number, one in enumerate(results)
        ],
        "gaps": [
            {
                "marker": gap.label,
                "subject": subject,
                "first_frame": first + gap.start,
                "last_frame": first + gap.stop - 1,
                "frames": gap.frames,
                "seconds": round(gap.frames / result.clip.rate, 4),
                "filled": gap.filled,
                "expected_error_mm": json_number(gap.expected_rms, 3),
                "expected_mean_error_mm": json_number(gap.expected_mean_error, 3),
                "bound_90_mm": json_number(gap.error_bound_90, 3),
                "method": gap.method,
                "from": list(gap.sources),
                "poses": gap.training_poses,
                "left_missing": [
                    {
                        "first_frame": first + piece.start,
                        "last_frame": first + piece.stop - 1,
                        "reason": piece.reason,
                        "asked": piece.requested,
                    }
                    for piece in gap.unfilled
                ],
                "prior_clips": list(gap.source_clips),
            }
            for subject, gap in sorted(gaps, key=lambda pair: pair[1].start)
        ],
    }


def _print_gaps(result: Result) -> None:
    """Print the table of a result's gaps."""
    clip = result.clip
    rows = [
        (
            gap.label,
            f"{clip.first_frame + gap.start}-{clip.first_frame + gap.stop - 1}",
            f"{gap.frames / clip.rate:.2f}",
            f"{100 * gap.filled / gap.frames:.0f} %",
            *(
                f"{x:.1f}" if math.isfinite(x) else "-"
                for x in (gap.expected_mean_error, gap.error_bound_90)
            ),
            "; ".join([*gap.sources, *dict.fromkeys(f"NOT: {p.reason}" for p in gap.unfilled)]),
        )
        for gap in result.gaps[:MAX_GAPS]
    ]
    columns = ("marker", "frames", "s>", "filled>", "expected error mm>", "90 % below mm>", "from")
    print_table(columns, rows)
    if len(result.gaps) > MAX_GAPS:
        click.echo(f"... and {len(result.gaps) - MAX_GAPS} more gaps (--json lists all)")


def _print(output: Path, result: Result, written: WriteReport | None) -> None:
    """Print what was done."""
    if not result.gaps:
        click.echo(f"{result.clip.name} has no gaps; {output} is a copy")
        return
    _print_gaps(result)
    click.echo()
    filled = int(result.filled.sum())
    asked = [
        gap for gap in result.gaps if gap.filled or any(part.requested for part in gap.unfilled)
    ]
    whole = sum(gap.complete for gap in asked)
    alone = len(result.gaps) - len(asked)
    click.echo(
        f"{filled} samples filled by {result.method}, {whole} of {len(asked)} gaps wholly"
        f"{f', {alone} left alone' if alone else ''}; written to {output}"
    )
    if written is not None and written.worst_error_mm > 0.001:
        click.echo(
            f"the file stores whole numbers: filled samples are rounded by up to "
            f"{written.worst_error_mm:.3f} mm"
        )


def print_left_missing(result: Result) -> None:
    """Say what stays missing: for each reason which markers, and in which frames."""
    left = [(piece, gap.label) for gap in result.gaps for piece in gap.unfilled]
    first = result.clip.first_frame
    for asked, reason in dict.fromkeys((piece.requested, piece.reason) for piece, _ in left):
        verb = "left missing" if asked else "left alone"
        some = [(piece, label) for piece, label in left if piece.reason == reason]
        labels = list(dict.fromkeys(label for _, label in some))
        samples = sum(piece.stop - piece.start for piece, _ in some)
        start = min(piece.start for piece, _ in some)
        stop = max(piece.stop for piece, _ in some)
        markers = f"{len(labels)} marker{'s' if len(labels) > 1 else ''}"
        click.echo(
            f"{verb}: {samples} samples of {markers} ({some_names(labels)}) "
            f"within frames {first + start}-{first + stop - 1}: {reason}",
            err=True,
        )
