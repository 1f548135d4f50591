"""What the processes do that are disturbed: a command, or a plan, with faults."""

from __future__ import annotations

import io
import json
import os
import signal
import sys
import tempfile
import traceback
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from functools import partial
from pathlib import Path
from typing import Any

from torture.clips import DATABASE_RATE, LEVELS
from torture.faults import Fault, Faults
from torture.plans import drive

SCRIPT = Path(__file__).resolve().parents[1] / "torture_database.py"
"""The script that the processes run."""

COMMAND_LINE = ("-c", "from priorfill.cli import main; main()")
"""Python's arguments for the command line as users run it."""

SIGNALS: dict[str, signal.Signals] = (
    {"kill": signal.SIGTERM}  # TerminateProcess, which no program can catch
    if sys.platform == "win32"
    else {"kill": signal.SIGKILL, "term": signal.SIGTERM, "hup": signal.SIGHUP}
)
"""Signals that end a process, by the kind of disturbance."""


def signal_name(kind: str) -> str:
    """Return the name of what ends a process."""
    return "TerminateProcess" if sys.platform == "win32" else SIGNALS[kind].name


def execute(arguments: Sequence[str]) -> int:
    """Run what Python would run with these arguments, and return the exit status.

    Parameters
    ----------
    arguments : sequence of str
        `COMMAND_LINE` and arguments of priorfill, or `SCRIPT`, ``--child``, options of `child`, and
        arguments of priorfill.
    """
    status: object = 0
    try:
        if arguments[0] == "-c":
            from priorfill.cli import main

            main(list(arguments[2:]))
        else:
            child(json.loads(arguments[2]), list(arguments[3:]))
    except SystemExit as error:
        status = error.code or 0
        if isinstance(status, str):
            print(status, file=sys.stderr)
    except BaseException:
        traceback.print_exc()
        status = 1
    with suppress(OSError):
        sys.stdout.flush()
        sys.stderr.flush()
    return status if isinstance(status, int) else 1


def kill_myself(number: int) -> None:
    """Send this process a signal; SIGKILL, and on Windows SIGTERM, ends it immediately."""
    os.kill(os.getpid(), number)


def child(options: dict[str, Any], arguments: list[str]) -> None:
    """Run the command line or a plan with faults.

    Parameters
    ----------
    options : dict
        ``folder``: the database; fields of `Fault`; ``kill``: the signal that the fault sends;
        ``segment_bytes``: size of segments; ``plan``, ``files``, ``other``: parameters of
        `drive`; ``step``: the step of the plan that begins the count of calls; ``save``: decisions
        that a review saves as soon as its page can be opened, and ends.
    arguments : list of str
        Arguments of priorfill, unless there is a plan.
    """
    from priorfill.database import segments
    from priorfill.errors import PriorfillError
    from priorfill.runtime import held_files

    fault = Fault(
        options.get("at", 0),
        late=options.get("late", False),
        for_ever=options.get("for_ever", False),
        only=options.get("only", ""),
        held=options.get("held", False),
        full=options.get("full", False),
        strike=partial(kill_myself, options["kill"]) if options.get("kill") else None,
    )
    step = options.get("step")
    faults = Faults(Path(options["folder"]), fault if step is None else None)

    def begin(number: int) -> int:
        if number == step:
            faults.arm(fault)
        return faults.calls

    if "save" in options:
        from priorfill.reviewing.server import ReviewServer

        def save(server: ReviewServer) -> None:
            server.session.save(options["save"])

        ReviewServer.wait = save  # type: ignore[method-assign]
    usual = segments.SEGMENT_BYTES
    segments.SEGMENT_BYTES = options.get("segment_bytes", usual)
    windows, pauses = held_files.WINDOWS, held_files._PAUSES_S
    if fault.held:  # on every system, take a refusal for that of Windows
        held_files.WINDOWS, held_files._PAUSES_S = True, (0.0,)
    try:
        with faults:
            if options.get("plan"):
                paths = [Path(options[key]) for key in ("folder", "plan", "files", "other")]
                try:
                    drive(*paths, begin)
                except (PriorfillError, OSError) as error:
                    sys.exit(f"priorfill: {error}")
            else:
                from priorfill.cli import main

                main(arguments)
    finally:
        segments.SEGMENT_BYTES = usual
        held_files.WINDOWS, held_files._PAUSES_S = windows, pauses
        print(f"calls {faults.calls} {faults.struck}", file=sys.stderr)


READY = b"ready"
"""What a worker prints when it has imported everything."""


def work(sample: str, rehearsal: str) -> None:
    """Import what is needed, then execute the arguments in the next line of stdin.

    Parameters
    ----------
    sample : str
        A C3D file that is read and prepared, so that everything which adds clips is imported; or
        empty.
    rehearsal : str
        Arguments of priorfill as JSON, which are executed in a temporary folder before; or empty.
    """
    if sample:
        import priorfill.cli.db.add
        import priorfill.cli.db.adding  # noqa: F401
        from priorfill import formats
        from priorfill.database.ingest import ingest

        ingest(formats.read(sample), DATABASE_RATE, LEVELS, None, "")
    if rehearsal:
        rehearse(json.loads(rehearsal))
    print(READY.decode(), flush=True)
    line = sys.stdin.readline()
    if line:
        os._exit(execute(json.loads(line)))


def rehearse(arguments: list[str]) -> None:
    """Execute arguments of priorfill in a temporary folder, and print nothing."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(io.StringIO()):
        os.chdir(folder)
        try:
            with redirect_stderr(io.StringIO()):
                execute((*COMMAND_LINE, *arguments))
        finally:
            os.chdir(before)
