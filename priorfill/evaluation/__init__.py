"""Test methods on one's own recordings: make artificial gaps, fill them, compare with the truth.

Gløersen and Federolf 2016 recommend testing gap fillers in this way. docs/evaluation.md defines the
protocols and the measures.
"""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral
from pathlib import Path

from priorfill.clip import Clip
from priorfill.database import PriorDatabase
from priorfill.errors import OptionError
from priorfill.evaluation.evaluation_plan import (
    ALL_METHODS,
    EvaluationOptions,
    make_plan,
)
from priorfill.evaluation.evaluation_results import Evaluation, write_results
from priorfill.evaluation.metrics import ErrorSummary
from priorfill.evaluation.outcome_store import OutcomeStore
from priorfill.evaluation.protocols import (
    DEFAULT_PROTOCOL,
    PROTOCOLS,
    GapProtocol,
    make_protocol,
)
from priorfill.evaluation.runner import check_processes, run_plan
from priorfill.runtime.argument_types import check_path, check_type

__all__ = [
    "PROTOCOLS",
    "ErrorSummary",
    "Evaluation",
    "EvaluationOptions",
    "evaluate",
    "make_protocol",
]


def evaluate(
    clips: Sequence[Clip] | Clip,
    *,
    methods: Sequence[str] | str = ALL_METHODS,
    protocol: GapProtocol | str = DEFAULT_PROTOCOL,
    database: PriorDatabase | str | Path | None = None,
    output: str | Path | None = None,
    seed: int = 0,
    jobs: int = 0,
    options: EvaluationOptions | None = None,
) -> Evaluation:
    """Remove samples from clips, fill them by several methods, and compare with the truth.

    Only measured samples are removed and compared; the clips' own gaps stay gaps. Versions of a
    clip in the database are never learnt from.

    Parameters
    ----------
    clips : Clip or sequence of Clip
        The recordings, with or without gaps of their own.
    methods : sequence of str, or str
        Names in `priorfill.methods.METHODS`, or ``all``; a string may have several, separated by
        commas.
    protocol : GapProtocol or str
        Which samples are removed: a name in `PROTOCOLS`, or a protocol with other options, from
        `make_protocol`.
    database : PriorDatabase or path, optional
        Recordings to learn from, in addition to the clip itself.
    output : path, optional
        Folder for the results. Finished fills are kept there at once; the same call resumes an
        interrupted evaluation.
    seed : int
        Seed of the random choices. The same seed makes the same gaps in a clip, whatever else is
        evaluated.
    jobs : int
        Number of worker processes; 0: fill in this process. The errors do not depend on it. Worker
        processes are spawned, so a script that uses them needs ``if __name__ == "__main__":``.
    options : EvaluationOptions, optional
        Marker set, selection of the database, and others that few evaluations need.

    Returns
    -------
    Evaluation
        Errors (mm) by method, clip, marker and length of gap.

    Raises
    ------
    OptionError
        Where a method or the protocol is unknown, the seed or the number of jobs is negative, or
        the folder has an evaluation with other settings.
    OutputError
        Where the folder has other contents, or cannot be written.
    ClipError
        Where no gap can be made in the clips.
    EvaluationError
        Where a worker process was killed; finished fills are kept. Also where the script lacks
        ``if __name__ == "__main__":``, which worker processes need.
    DatabaseError
        Where the database cannot be read.

    See Also
    --------
    make_protocol : Protocols with other options.
    priorfill.fill : Fill the gaps of a clip.

    Examples
    --------
    >>> import priorfill as pf
    >>> from priorfill.synthetic import synthesise
    >>> clip = synthesise("walking", seconds=2.0)
    >>> found = pf.evaluate(clip, methods="linear,spline", protocol="frames")
    >>> found.best
    'spline'
    >>> found.methods["spline"].errors.filled
    5699
    """
    for name, value in (("seed", seed), ("jobs", jobs)):
        check_type(name, value, Integral, "a whole number")
        if value < 0:
            raise OptionError(f"`{name}` is {value}; give 0 or more")
    if jobs:
        check_processes()
    check_type("options", options, (EvaluationOptions, type(None)), "EvaluationOptions")
    options = options or EvaluationOptions()
    if output is not None:
        check_path("output", output)
    if not isinstance(database, PriorDatabase | None):
        check_path("database", database)
    path = database.path if isinstance(database, PriorDatabase) else database
    plan = make_plan(
        [clips] if isinstance(clips, Clip) else clips,
        methods=methods,
        protocol=protocol,
        database=None if path is None else Path(path),
        seed=seed,
        options=options,
    )
    folder = None if output is None else Path(output)
    store = None if folder is None else OutcomeStore(folder, plan, overwrite=options.overwrite)
    outcomes = run_plan(plan, jobs=jobs, store=store, progress=options.progress)
    evaluation = Evaluation(plan, outcomes)
    if folder is not None:
        write_results(folder, evaluation)
    return evaluation
