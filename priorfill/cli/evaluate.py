"""``priorfill evaluate``: artificial gaps in recordings, filled by each method."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.completion import complete_groups, complete_methods, complete_protocols
from priorfill.cli.option_types import DURATION, as_names
from priorfill.cli.output import duration, print_json, print_line, print_table, print_wrapped
from priorfill.cli.path_types import FILE, FOLDER, PathArgument
from priorfill.cli.progress import progress
from priorfill.cli.reading import excluding_options, read_clip, reading_options
from priorfill.cli.reading_many import read_one_of_many, refuse_missing, with_path
from priorfill.errors import OptionError
from priorfill.runtime.option_texts import parse_duration

if TYPE_CHECKING:
    from priorfill.clip import Clip
    from priorfill.evaluation.evaluation_results import Evaluation
    from priorfill.evaluation.metrics import ErrorSummary
    from priorfill.evaluation.protocols import GapProtocol
    from priorfill.markers.marker_set import MarkerSet

__all__ = ["EXIT_REFUSED", "evaluate"]

EXIT_REFUSED = 3
"""Exit status: done, but a method could not work on some of the clips."""

_OF_PROTOCOL = (
    *("copies", "seconds", "number", "share", "period", "max_missing", "markers", "groups"),
)
"""Parameters that are options of the protocol."""

MAX_NAMES = 6
"""Maximum number of clips with a column of their own in the table."""


def _as_range(number: Callable[[str], Any]) -> Callable[[Any, Any, str | None], Any]:
    """Return a callback that parses ``LOW-HIGH``, or one number for both."""

    def read(ctx: Any, param: Any, value: str | None) -> tuple[Any, Any] | None:
        if value is None:
            return None
        low, _, high = value.partition("-")
        try:
            return number(low), number(high or low)
        except OptionError as error:
            raise click.BadParameter(str(error), ctx, param) from None
        except ValueError:
            raise click.BadParameter(f"{value!r} is not like 3 or 1-5", ctx, param) from None

    return read


def _ranged(name: str, target: str, number: Callable[[str], Any], text: str) -> Any:
    """Return an option whose value is a range."""
    return click.option(name, target, metavar="LOW-HIGH", callback=_as_range(number), help=text)


@click.command()
@click.argument("files", metavar="FILE...", nargs=-1, required=True, cls=PathArgument, type=FILE)
@click.option(
    "--methods",
    "-m",
    metavar="A,B,...",
    multiple=True,
    default=["all"],
    show_default=True,
    callback=as_names,
    shell_complete=complete_methods,
    help="Methods to compare, as `priorfill methods` lists them. Can be repeated.",
)
@click.option(
    "--protocol",
    "-p",
    metavar="NAME",
    shell_complete=complete_protocols,
    help="What to remove: random (default): random markers at random times; markers: each marker "
    "in turn; groups: arms and legs; periodic: gaps at regular intervals; frames: every marker at "
    "once; like: the gaps of the file of --like.",
)
@click.option(
    "--copies", metavar="N", type=int, help="Number of copies of each case; 10 for random."
)
@_ranged("--length", "seconds", parse_duration, "Length of the gaps (s, or frames as 10f).")
@_ranged("--number", "number", int, "Number of gaps; for periodic, of markers.")
@_ranged("--share", "share", float, "For random: share of the samples to remove.")
@click.option(
    "--period",
    metavar="SECONDS",
    type=DURATION,
    help="For periodic: time between the starts of gaps (s, or frames as 10f).",
)
@click.option(
    "--max-missing",
    metavar="N",
    type=int,
    help="For random: number of markers missing in the same frame at most; 7 by default.",
)
@click.option(
    "--markers",
    metavar="A,B,...",
    multiple=True,
    callback=as_names,
    help="For markers: these only; labels, or patterns, in any case. Can be repeated.",
)
@click.option(
    "--groups",
    metavar="A,B,...",
    multiple=True,
    callback=as_names,
    shell_complete=complete_groups,
    help="For groups: some of arms legs both left_arm right_arm left_leg right_leg.",
)
@click.option(
    "--like",
    metavar="OTHER.c3d",
    type=FILE,
    help="Copy the gaps of this file (protocol like).",
)
@click.option(
    "--database",
    "-d",
    metavar="DIR",
    type=FOLDER,
    help="Prior database to learn from, except from the recording itself.",
)
@excluding_options
@click.option(
    "--output",
    "-o",
    metavar="DIR",
    type=FOLDER,
    help="Folder for CSV and JSON files. It keeps each finished fill, so that the same command "
    "resumes an interrupted evaluation.",
)
@click.option("--plots", is_flag=True, help="Also draw plots into the folder.")
@click.option("--overwrite", is_flag=True, help="Start anew in a folder that holds an evaluation.")
@click.option(
    "--seed",
    metavar="N",
    type=int,
    default=0,
    show_default=True,
    help="Seed of the random choices.",
)
@click.option(
    "--jobs",
    "-j",
    metavar="N",
    type=click.IntRange(min=0),
    default=os.cpu_count() or 1,
    help="Number of fills at the same time; by default the number of cores.",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@reading_options
def evaluate(
    files: tuple[Path, ...],
    methods: tuple[str, ...],
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
    """Find the best method for recordings like FILE.

    Removes measured samples, fills them by each method, and compares the result with the removed
    samples. A file that cannot be read is reported, and the others are evaluated.

    Exit status 0: done; 3: done, but a method could not work on some cases; 1: failed, or a file
    could not be read; 2: wrong usage.
    """
    from priorfill.database import Selection
    from priorfill.evaluation import EvaluationOptions
    from priorfill.evaluation import evaluate as run
    from priorfill.evaluation.evaluation_plan import choose_methods
    from priorfill.evaluation.plots import draw_plots

    protocol_options = {name: options.pop(name) for name in _OF_PROTOCOL}
    in_output = {"--plots": plots, "--overwrite": overwrite}
    _check_options(methods, output, in_output, database, bool(not_names or not_subjects))
    made = _make_protocol(protocol, like, protocol_options, options)
    read, failures = _read_files(files, options)
    with progress(None, "evaluating") as show:
        evaluation = run(
            [clip for clip, _ in read],
            methods=methods,
            protocol=made,
            database=database,
            seed=seed,
            jobs=jobs,
            output=output,
            options=EvaluationOptions(
                overwrite=overwrite,
                marker_set=read[0][1],
                selection=Selection(not_names=not_names, not_subjects=not_subjects),
                progress=_announced(show, len(choose_methods(methods)), jobs),
            ),
        )
    drawn = draw_plots(output, evaluation) if plots and output is not None else []
    if as_json:
        print_json(evaluation.to_dict())
    else:
        _print(evaluation)
        if output is not None:
            print_line()
            print_line(f"results of every gap: {output}")
        for file in drawn:
            print_line(f"plot: {file}")
    _print_notes(evaluation)
    if failures:
        click.get_current_context().exit(1)
    if not evaluation.worked:
        click.get_current_context().exit(EXIT_REFUSED)


def _check_options(
    methods: tuple[str, ...],
    output: Path | None,
    in_output: dict[str, bool],
    database: Path | None,
    excluding: bool,
) -> None:
    """Refuse invalid options before any work is done."""
    from priorfill.evaluation.evaluation_plan import choose_methods
    from priorfill.report.figures import check_plots

    choose_methods(methods)
    for option, given in in_output.items():
        if given and output is None:
            raise click.UsageError(f"{option} needs a folder; give one (--output)")
    if in_output["--plots"]:
        check_plots()
    if excluding and database is None:
        raise click.UsageError("--exclude-... needs a database; give one (--database)")


def _announced(
    show: Callable[[int, int | None], None], methods: int, jobs: int
) -> Callable[[int, int], None]:
    """Return a function that shows progress, and prints first how many fills there will be."""
    first = True

    def report(done: int, total: int) -> None:
        nonlocal first
        if first:
            first = False
            cases = total // methods
            print_line(
                f"{_count(total, 'fill')}: {_count(methods, 'method')} on {_count(cases, 'case')}"
                + (f", {done} done before" if done else "")
                + (f"; up to {jobs} at a time" if jobs > 1 else ""),
                err=True,
            )
        show(done, total)

    return report


def _make_protocol(
    name: str | None, like: Path | None, given: dict[str, Any], options: dict[str, Any]
) -> GapProtocol:
    """Return the protocol that the options describe; `options` are those of reading files."""
    from priorfill.evaluation.protocols import DEFAULT_PROTOCOL, PROTOCOLS, make_protocol

    if name is None:
        name = DEFAULT_PROTOCOL if like is None else "like"
    if name not in PROTOCOLS:
        make_protocol(name)  # raises the error
    if like is not None and name != "like":
        raise OptionError(f"--like needs the protocol like, not {name}; leave one of them out")
    if like is not None:
        given["pattern"] = read_clip(like, **options)[0]
    # names that are not given are empty
    return make_protocol(
        name, **{key: None if value == () else value for key, value in given.items()}
    )


def _read_files(
    files: tuple[Path, ...], options: dict[str, Any]
) -> tuple[list[tuple[Clip, MarkerSet | None]], int]:
    """Read files; return clips with their marker sets, and the number of files that failed."""
    from priorfill.errors import ClipError, FormatError
    from priorfill.formats.file_bytes import is_there, no_such_file

    refuse_missing([str(no_such_file(file)) for file in files if not is_there(file)])
    read, failures = [], 0
    for file in files:
        try:
            read.append(read_clip(file, **options, read=read_one_of_many))
        except (ClipError, FormatError, OptionError) as error:
            if len(files) == 1:
                raise
            print_line(f"priorfill: {with_path(file, error)}", err=True)
            failures += 1
    if not read:
        raise FormatError(f"none of the {len(files)} files can be read; see above")
    return read, failures


def _print_notes(evaluation: Evaluation) -> None:
    """Print on stderr what was left out and where methods could not work."""
    for note in evaluation.notes:
        print_line(f"note: {note}", err=True)
    for row in evaluation.methods.values():
        for reason, count in row.refused.items():
            cases = "" if count == row.cases else f" on {count} of {row.cases} cases"
            print_line(f"{row.method} could not work{cases}: {reason}", err=True)


def _print(evaluation: Evaluation) -> None:
    """Print the tables of an evaluation."""
    cases, clips = evaluation.plan.cases, evaluation.clips
    gaps = sum(len(case.gaps) for case in cases)
    samples = sum(case.samples for case in cases)
    print_line(
        f"{_count(gaps, 'gap')}, {_count(samples, 'sample')}, in {_count(len(cases), 'case')} of "
        f"{_count(len(clips), 'clip')}; protocol {evaluation.settings['protocol']['name']}, "
        f"seed {evaluation.settings['seed']}"
    )
    print_line()
    _print_methods(evaluation)
    _print_comparison(evaluation)
    if 1 < len(clips) <= MAX_NAMES:
        print_line()
        columns = ("method", *(f"{name}>" for name in clips))
        rows = [
            (method, *(_with_share(rows[method].errors) for rows in clips.values()))
            for method in evaluation.methods
        ]
        print_table(columns, rows, "Mean error (mm) by clip; share filled in parentheses")
    lengths = list(dict.fromkeys(length for length, _ in evaluation.lengths))
    if len(lengths) > 1:
        print_line()
        counts = {length: count for (length, _), (count, _) in evaluation.lengths.items()}
        columns = ("method", *(f"{length}\n({counts[length]})>" for length in lengths))
        rows = [
            (method, *(_with_share(evaluation.lengths[n, method][1]) for n in lengths))
            for method in evaluation.methods
        ]
        print_table(
            columns, rows, "Mean error (mm) by length of the gap; number of gaps in parentheses"
        )


def _print_methods(evaluation: Evaluation) -> None:
    """Print the table of methods."""
    columns = [
        *("method", "filled>", "mean\nmm>", "rmse\nmm>", "median\nmm>", "p95\nmm>", "max\nmm>"),
        *("mae\nmm>", "time>", "velocity\nmm/s>", "acceleration\nm/s²>", "joint angle\n°>"),
        *("expected mean\nerror mm>", "error bound 90\ncoverage>"),
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
                duration(row.seconds),
                *(_number(v) for v in (errors.velocity, errors.acceleration, row.joint_angle)),
                _number(errors.expected_mean_error_mm),
                _percent(errors.error_bound_90_coverage),
            ]
        )
    # columns without a value are left out
    known = [i for i in range(len(columns)) if any(row[i] != "-" for row in rows)]
    print_table([columns[i] for i in known], [[row[i] for i in known] for row in rows])


def _print_comparison(evaluation: Evaluation) -> None:
    """Print the ranking of the methods, and the samples that it is based on."""
    comparison = evaluation.comparison
    left_out = f"; left out: {' '.join(comparison.left_out)}, which filled less than half"
    if comparison.best is None:
        print_line()
        print_line("No ranking: there is no sample that all methods filled.")
        return
    ranking = ", ".join(f"{name} {_number(one.mean)}" for name, one in comparison.methods.items())
    share = _percent(comparison.samples / comparison.of)
    over = f"the {share} of the samples that all of these filled"
    if comparison.samples == comparison.of:
        over = "all samples"
    print_line()
    print_wrapped(
        f"Mean error (mm) over {over}, best first: "
        f"{ranking}{left_out if comparison.left_out else ''}"
    )


def _count(number: int, word: str) -> str:
    """Return a number with a noun in the singular or plural."""
    return f"{number} {word}{'' if number == 1 else 's'}"


def _number(value: float) -> str:
    """Return a number with about three digits."""
    if value != value:  # NaN
        return "-"
    return f"{value:.0f}" if value >= 100 else f"{value:.1f}" if value >= 10 else f"{value:.2f}"


def _percent(share: float) -> str:
    """Return a share in percent."""
    if share != share:  # NaN
        return "-"
    # a share below 1 must not be rounded to 100 %
    return "100 %" if share == 1 else f"{min(100 * share, 99.9):.3g} %"


def _with_share(errors: ErrorSummary) -> str:
    """Return a mean error, with the share filled if it is below 1."""
    if errors.filled == errors.samples:
        return _number(errors.mean)
    return f"{_number(errors.mean)} ({_percent(errors.share)})"
