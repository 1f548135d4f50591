"""``priorfill demo``: make a clip with gaps, fill it, and compare with the ground truth."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from priorfill.cli.completion import complete_methods
from priorfill.cli.exit_status import EXIT_INCOMPLETE
from priorfill.cli.fill_report import print_unfilled
from priorfill.cli.output import print_line, print_table
from priorfill.cli.path_types import FOLDER
from priorfill.cli.progress import fill_progress

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from priorfill.clip import Clip
    from priorfill.filling.result import Result

__all__ = ["demo"]


@click.command()
@click.option(
    "--output",
    "-o",
    "folder",
    metavar="DIR",
    type=FOLDER,
    default=Path("demo-output"),
    show_default=True,
    help="Folder for the demo's files; existing ones are replaced.",
)
@click.option(
    "--method",
    "-m",
    default="auto",
    show_default=True,
    shell_complete=complete_methods,
    help="As for fill.",
)
def demo(folder: Path, method: str) -> None:
    """Make a clip with gaps, fill it from the starter database, and compare with the ground truth.

    The clip and the starter database are synthetic, computed from a model of the body. They show
    how priorfill is used, not how well it fills real recordings.
    """
    from priorfill import formats
    from priorfill.errors import OutputError
    from priorfill.filling.fill_clip import fill
    from priorfill.filling.fill_options import FillOptions
    from priorfill.methods import get_method
    from priorfill.runtime.display import shell_command
    from priorfill.runtime.resources import resource_path
    from priorfill.synthetic.demo import make_demo_clip

    get_method(method)  # refuses an unknown method before anything is written
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be created ({error.strerror}); choose another folder with -o"
        ) from error
    truth, gappy = make_demo_clip()
    complete, gaps, filled = (folder / f"demo_{name}.c3d" for name in ("truth", "gaps", "filled"))
    formats.write(complete, truth, overwrite=True)
    formats.write(gaps, gappy, overwrite=True)
    # from here on as `priorfill fill` does, from the file
    clip = formats.read(gaps)
    starter = resource_path("starter")
    with fill_progress("the demo") as show:
        options = FillOptions(progress=show)
        result = fill(clip, database=starter, method=method, options=options)
    formats.write(filled, result.clip, result.filled, overwrite=True)

    print_line("Demo with synthetic motion (computed from a model of the body, not recorded)")
    print_line()
    _print_errors(truth, result)
    print_line()
    print_line(f"without gaps   {complete}")
    print_line(f"with gaps      {gaps}")
    print_line(f"filled         {filled}   with {result.method} from itself and {starter}")
    print_line()
    fill_gaps = ("priorfill", "fill", gaps, "-o", "filled.c3d", "--database", starter)
    print_line(f"Try it:        {shell_command(('priorfill', 'inspect', gaps))}")
    print_line(f"               {shell_command(fill_gaps)}")
    print_unfilled(result)
    if not result.complete:
        click.get_current_context().exit(EXIT_INCOMPLETE)


def _print_errors(truth: Clip, result: Result) -> None:
    """Print the error relative to the ground truth by gap, and that of linear interpolation."""
    import numpy as np

    clip = result.clip
    order = [truth.labels.index(label) for label in clip.labels]
    true = truth.positions[:, order]
    error = np.linalg.norm(clip.positions - true, axis=2)  # (frames, markers)
    straight = true.copy()
    frames = np.arange(clip.frames)
    for marker in range(len(clip.labels)):
        known = ~result.filled[:, marker] & ~clip.missing[:, marker]
        for i in range(3):
            straight[:, marker, i] = np.interp(frames, frames[known], true[known, marker, i])
    straight_error = np.linalg.norm(straight - true, axis=2)

    def rms(values: NDArray[np.float64]) -> float:
        filled = values[np.isfinite(values)]
        return float(np.sqrt(np.mean(filled**2))) if len(filled) else math.nan

    def shown(value: float) -> str:
        return f"{value:.1f}" if math.isfinite(value) else "-"

    rows = []
    for gap in result.gaps:
        inside = slice(gap.start, gap.stop), clip.labels.index(gap.label)
        rows.append(
            (
                gap.label,
                f"{gap.start / clip.rate:.2f}-{gap.stop / clip.rate:.2f}",
                shown(rms(error[inside])),
                shown(gap.expected_rms_mm),
                shown(rms(straight_error[inside])),
            )
        )
    fill, line = rms(error[result.filled]), rms(straight_error[result.filled])
    rows.append(("all", "", shown(fill), "", shown(line)))
    print_table(("marker", "s>", "rms error mm>", "expected rms mm>", "linear mm>"), rows)
