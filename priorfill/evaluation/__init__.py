"""Artificial gaps in one's own recordings, filled by each method, and compared with the truth.

Gløersen and Federolf 2016 recommend that fillers are tested so. docs/evaluation.md says what is
computed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from priorfill.clip import Clip
from priorfill.database import PriorDatabase, Selection
from priorfill.errors import OptionError
from priorfill.evaluation.evaluation_plan import ALL_METHODS, make_plan
from priorfill.evaluation.evaluation_results import Evaluation, write_results
from priorfill.evaluation.metrics import ErrorSummary
from priorfill.evaluation.outcome_store import OutcomeStore
from priorfill.evaluation.protocols import (
    DEFAULT_PROTOCOL,
    PROTOCOLS,
    GapProtocol,
    make_protocol,
)
from priorfill.evaluation.runner import run_plan
from priorfill.markers.marker_set import MarkerSet

__all__ = ["PROTOCOLS", "ErrorSummary", "Evaluation", "evaluate", "make_protocol"]


def evaluate(
    clips: Sequence[Clip] | Clip,
    *,
    methods: Sequence[str] | str = ALL_METHODS,
    protocol: GapProtocol | str = DEFAULT_PROTOCOL,
    database: PriorDatabase | str | Path | None = None,
    seed: int = 0,
    jobs: int = 0,
    output: str | Path | None = None,
    overwrite: bool = False,
    marker_set: MarkerSet | None = None,
    selection: Selection | None = None,
    trust_filled: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Evaluation:
    """Remove samples from clips, fill them by methods, and compare with what was removed.

    Only measured samples are removed and scored; the clips' own gaps stay gaps. A clip's own
    recording in the database is not learnt from.

    Parameters
    ----------
    clips : Clip or sequence of Clip
        The recordings, with gaps of their own or without.
    methods : sequence of str, or str
        Names of `priorfill.methods.METHODS`, or ``all``; as one text with commas between them.
    protocol : str or protocol
        What is removed: a name of `PROTOCOLS`, or one with other options
        (`make_protocol`).
    database : PriorDatabase or path, optional
        Recordings to learn from beside the clip itself.
    seed : int
        Of what is drawn. The same seed makes the same gaps, whatever else is evaluated.
    jobs : int
        Processes that fill at the same time; 0: none but this one. The result does not depend on
        it. Processes are spawned, so a script that asks for some begins with
        ``if __name__ == "__main__":``.
    output : path, optional
        Folder for the results, in which what is finished is kept at once: the same call goes on
        where it was interrupted.
    overwrite : bool
        Begin anew in a folder that holds an evaluation.
    marker_set : MarkerSet, optional
        Of all clips; recognised or found from the data if not given.
    selection : Selection, optional
        Which clips of the database to learn from.
    trust_filled : bool
        Learn from samples of the database that were themselves synthesised, too.
    progress : callable, optional
        Called with the fills done and all of them.

    Returns
    -------
    Evaluation
        Errors by method, clip, marker and length of gap; see `Evaluation`.

    Raises
    ------
    OptionError
        Where there is no such method or protocol, or the folder holds an evaluation of other
        settings.
    ClipError
        Where no gap can be made in the clips.
    EvaluationError
        Where a process was killed; what is finished is kept.
    DatabaseError
        Where the database cannot be read.
    """
    if seed < 0 or jobs < 0:
        raise OptionError(f"seed {seed} and jobs {jobs}: give 0 or more")
    name = protocol if isinstance(protocol, str) else _name_of(protocol)
    made = make_protocol(protocol) if isinstance(protocol, str) else protocol
    place = database.path if isinstance(database, PriorDatabase) else database
    plan = make_plan(
        [clips] if isinstance(clips, Clip) else clips,
        methods=methods,
        protocol=made,
        protocol_name=name,
        database=None if place is None else Path(place),
        seed=seed,
        marker_set=marker_set,
        selection=selection,
        trust_filled=trust_filled,
    )
    folder = None if output is None else Path(output)
    store = None if folder is None else OutcomeStore(folder, plan, overwrite=overwrite)
    evaluation = Evaluation(plan, run_plan(plan, jobs=jobs, store=store, progress=progress))
    if folder is not None:
        write_results(folder, evaluation)
    return evaluation


def _name_of(protocol: GapProtocol) -> str:
    """Return what a protocol is called."""
    return next((n for n, kind in PROTOCOLS.items() if isinstance(protocol, kind)), "other")
