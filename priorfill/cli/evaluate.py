"""``priorfill evaluate``: artificial gaps in one's own recordings, filled by each method."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.batch import read_one_of_many, with_path
from priorfill.cli.output import duration, print_json, print_table
from priorfill.cli.progress import progress
from priorfill.cli.reading import excluding_options, read_clip, reading_options

if TYPE_CHECKING:
    from priorfill.evaluation.evaluation_results import Evaluation
    from priorfill.evaluation.metrics import ErrorSummary

__all__ = ["EXIT_REFUSED", "evaluate"]

EXIT_REFUSED = 3
"""Exit status: done, but a method could not work on some of the clips."""

MAX_NAMES = 6
"""Clips that have a column each in the table."""


def _as_range(number: type[int] | type[float]) -> Callable[[Any, Any, str | None], Any]:
    """Return what reads ``LOW-HIGH``, or one number for both."""

    def read(ctx: Any, param: Any, value: str | None) -> tuple[Any, Any] | None:
        if value is None:
            return None
        low, _, high = value.partition("-")
        try:
            return number(low), number(high or low)
        except ValueError:
            raise click.BadParameter(f"{value!r} is not like 3 or 1-5", ctx, param) from None

    return read


def _as_names(ctx: Any, param: Any, value: str | None) -> tuple[str, ...] | None:
    """Read names with commas between them."""
    del ctx, param
    return None if value is None else tuple(n.strip() for n in value.split(",") if n.strip())


def _ranged(name: str, target: str, number: type[int] | type[float], text: str) -> Any:
    """Return an option whose value is a range."""
    return click.option(name, target, metavar="LOW-HIGH", callback=_as_range(number), help=text)


@click.command()
@click.argument(
    "files", metavar="FILE...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
@click.option(
    "--methods",
    "-m",
    metavar="A,B,...",
    default="all",
    show_default=True,
    help="Methods to compare, as `priorfill methods` lists them.",
)
@click.option(
    "--protocol",
    "-p",
    metavar="NAME",
    help="What is removed (random by default): random markers at random times; markers, each in "
    "turn; groups, arms and legs; periodic, again and again; frames, every marker at once; like, "
    "as --like says.",
)
@click.option("--copies", metavar="N", type=int, help="How often; of random 10.")
@_ranged("--length", "seconds", float, "Lengths of gaps (s).")
@_ranged("--number", "number", int, "Numbers of gaps; of periodic, of markers.")
@_ranged("--share", "share", float, "Of random: shares of the samples to remove.")
@click.option("--period", metavar="S", type=float, help="Of periodic: from gap to gap (s).")
@click.option("--markers", metavar="A,B,...", callback=_as_names, help="Of markers: these only.")
@click.option(
    "--groups",
    metavar="A,B,...",
    callback=_as_names,
    help="Of groups: of arms legs both left_arm right_arm left_leg ...",
)
@click.option(
    "--like",
    metavar="OTHER.c3d",
    type=click.Path(path_type=Path),
    help="Copy the gaps of this file (protocol like).",
)
@click.option(
    "--database",
    "-d",
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="Prior database to learn from; never from the clip's own recording there.",
)
@excluding_options
@click.option(
    "--output",
    "-o",
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="Folder for CSV and JSON files. What is finished is kept there at once: the same command "
    "goes on where it was interrupted.",
)
@click.option("--plots", is_flag=True, help="Draw plots too, into the folder.")
@click.option("--overwrite", is_flag=True, help="Begin anew in a folder that has an evaluation.")
@click.option(
    "--seed", metavar="N", type=int, default=0, show_default=True, help="Of what is drawn."
)
@click.option(
    "--jobs",
    "-j",
    metavar="N",
    type=click.IntRange(min=0),
    default=os.cpu_count() or 1,
    help="Fills at the same time; as many as there are cores by default.",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@reading_options
def evaluate(
    files: tuple[Path, ...],
    methods: str,
    protocol: str | None,
    like: Path | None,
    database: Path | None,
    not_names: tuple[str, ...],
    not_subjects: tuple[str, ...],
    output: Path | None,
    plots: bool,
    overwrite: bool,
    seed: int,
    jobs: int,
    as_json: bool,
    **options: Any,
) -> None:
    """Find out which method is right for recordings like FILE.

    Removes measured samples, fills them by each method, and compares with what was removed.

    A file that cannot be read is named, and the others go on.

    Exit status 0: done; 3: done, but a method could not work on some of the files; 1: could not, or
    not with all files.
    """
    from priorfill.database import Selection
    from priorfill.errors import ClipError, FormatError, OptionError
    from priorfill.evaluation import evaluate as run
    from priorfill.evaluation.evaluation_plan import choose_methods
    from priorfill.evaluation.plots import check_plots, draw_plots
    from priorfill.evaluation.protocols import DEFAULT_PROTOCOL, PROTOCOLS, make_protocol

    names = ("copies", "seconds", "number", "share", "period", "markers", "groups")
    of_protocol = {name: options.pop(name) for name in names}
    # whatever would make the work be in vain is found out before it is done
    choose_methods(methods)
    if protocol is None:
        protocol = DEFAULT_PROTOCOL if like is None else "like"
    if protocol not in PROTOCOLS:
        make_protocol(protocol)  # which says so
    if like is not None and protocol != "like":
        raise OptionError(f"--like goes with the protocol like, not with {protocol}")
    if plots and output is None:
        raise click.UsageError("--plots are drawn into a folder; give one (--output)")
    if plots:
        check_plots()
    if (not_names or not_subjects) and database is None:
        raise click.UsageError("--exclude-... says something of a database; give one (--database)")
    if protocol == "like" and like is not None:
        of_protocol["pattern"] = read_clip(like, **options)[0]
    made = make_protocol(protocol, **of_protocol)
    read, failures = [], 0
    for file in files:
        try:
            read.append(read_clip(file, **options, read=read_one_of_many))
        except (ClipError, FormatError) as error:
            if len(files) == 1:
                raise
            click.echo(f"priorfill: {with_path(file, error)}", err=True)
            failures += 1
    if not read:
        raise FormatError(f"none of the {len(files)} files can be read; see above")
    with progress(None, "evaluating") as show:
        evaluation = run(
            [clip for clip, _ in read],
            methods=methods,
            protocol=made,
            database=database,
            seed=seed,
            jobs=jobs,
            output=output,
            overwrite=overwrite,
            marker_set=read[0][1],
            selection=Selection(not_names=not_names, not_subjects=not_subjects),
            progress=show,
        )
    drawn = draw_plots(output, evaluation) if plots and output is not None else []
    if as_json:
        print_json(evaluation.to_dict())
    else:
        _print(evaluation)
        if output is not None:
            click.echo(f"\nevery gap, and what was done: {output}")
        for file in drawn:
            click.echo(f"plot: {file}")
    for note in evaluation.notes:
        click.echo(f"note: {note}", err=True)
    for row in evaluation.methods.values():
        for reason, count in row.refused.items():
            of = "" if count == row.cases else f" on {count} of {row.cases} cases"
            click.echo(f"{row.method} could not work{of}: {reason}", err=True)
    if failures:
        click.get_current_context().exit(1)
    if not evaluation.worked:
        click.get_current_context().exit(EXIT_REFUSED)


def _print(evaluation: Evaluation) -> None:
    """Print what the methods made of it."""
    cases, clips = evaluation.plan.cases, evaluation.clips
    gaps = sum(len(case.gaps) for case in cases)
    samples = sum(case.samples for case in cases)
    click.echo(
        f"{_count(gaps, 'gap')}, {_count(samples, 'sample')}, in {_count(len(cases), 'case')} of "
        f"{_count(len(clips), 'clip')}; protocol {evaluation.settings['protocol']['name']}, "
        f"seed {evaluation.settings['seed']}\n"
    )
    _print_methods(evaluation)
    _print_comparison(evaluation)
    if 1 < len(clips) <= MAX_NAMES:
        click.echo("")
        columns = ("method", *(f"{name}>" for name in clips))
        rows = [
            (method, *(_with_share(rows[method].errors) for rows in clips.values()))
            for method in evaluation.methods
        ]
        print_table(columns, rows, "Mean error (mm) by clip; in brackets the share filled")
    lengths = list(dict.fromkeys(length for length, _ in evaluation.lengths))
    if len(lengths) > 1:
        click.echo("")
        counts = {length: count for (length, _), (count, _) in evaluation.lengths.items()}
        columns = ("method", *(f"{length} ({counts[length]})>" for length in lengths))
        rows = [
            (method, *(_with_share(evaluation.lengths[n, method][1]) for n in lengths))
            for method in evaluation.methods
        ]
        print_table(columns, rows, "Mean error (mm) by length of gap (gaps)")


def _print_methods(evaluation: Evaluation) -> None:
    """Print a line for each method."""
    columns = [
        *("method", "filled>", "mean mm>", "rmse>", "median>", "95 %>", "max>", "MAE>"),
        *("velocity mm/s>", "acceleration m/s²>", "joint °>", "expected>", "in bound>", "time>"),
    ]
    rows = []
    for method, row in evaluation.methods.items():
        errors = row.errors
        mm = (errors.mean, errors.rmse, errors.median, errors.p95, errors.maximum, errors.mae)
        rows.append(
            [
                method,
                _percent(errors.share),
                *(_number(value) for value in mm),
                *(_number(v) for v in (errors.velocity, errors.acceleration, row.joint_angle)),
                _number(errors.expected),
                _percent(errors.cover),
                duration(row.seconds),
            ]
        )
    # what no method says anything of has no column
    told = [i for i in range(len(columns)) if any(row[i] != "-" for row in rows)]
    print_table([columns[i] for i in told], [[row[i] for i in told] for row in rows])


def _print_comparison(evaluation: Evaluation) -> None:
    """Say which method is the best, over which samples."""
    comparison = evaluation.comparison
    left_out = f"; left out: {' '.join(comparison.left_out)}, which fill less than half"
    if comparison.best is None:
        click.echo("\nNo samples that all methods filled: none is the best.")
        return
    ranking = ", ".join(f"{name} {_number(one.mean)}" for name, one in comparison.methods.items())
    share = _percent(comparison.samples / comparison.of)
    over = f"the {share} of the samples that all of these filled"
    if comparison.samples == comparison.of:
        over = "all samples"
    click.echo(
        f"\nMean error (mm) over {over}, the best first: "
        f"{ranking}{left_out if comparison.left_out else ''}"
    )


def _count(number: int, word: str) -> str:
    return f"{number} {word}{'' if number == 1 else 's'}"


def _number(value: float) -> str:
    if value != value:  # NaN
        return "-"
    return f"{value:.0f}" if value >= 100 else f"{value:.1f}" if value >= 10 else f"{value:.2f}"


def _percent(share: float) -> str:
    if share != share:  # NaN
        return "-"
    # what is not all must not look like it
    return "100 %" if share == 1 else f"{min(100 * share, 99.9):.3g} %"


def _with_share(errors: ErrorSummary) -> str:
    """Return a mean error, and where not all was filled the share that was."""
    if errors.filled == errors.samples:
        return _number(errors.mean)
    return f"{_number(errors.mean)} ({_percent(errors.share)})"
