"""Rounds: a process works on a database, is disturbed, and its traces are checked."""

from __future__ import annotations

import gc
import io
import random
import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, redirect_stdout, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from torture.children import COMMAND_LINE, SIGNALS, signal_name
from torture.clips import WrongError, check_nothing_left, contents, difference, is_unfinished
from torture.disturbances import (
    Disturbance,
    held,
    killed,
    killed_in_step,
    limited,
    tripped,
    undisturbed,
)
from torture.exchanges import FOREIGN, SWAPS, fingerprint
from torture.jobs import Job, remove_folder
from torture.materials import Materials
from torture.plans import KINDS_OF_STEPS, Step, drive, make_plan, plan_of_all, plan_until, written
from torture.processes import HAS_FORK, Inline, Processes, Run
from torture.readers import Reader

MANIFEST = "priorfill-database.json"

FILES = 200
"""Number of clips for ``db add``."""

KEPT_FOR = 3
"""Number of rounds with one database."""

ADD = (*COMMAND_LINE, "db", "add", "--verbose", "-d")

DB_ADD = "db add"

DURING = (DB_ADD, *KINDS_OF_STEPS)
"""What can be disturbed alone: the command, or a step of a plan."""

KINDS = (*SIGNALS, "swap", "full", "fsync", "held")


@dataclass
class Row:
    """A row of the table.

    Attributes
    ----------
    title : str
        What was done.
    rounds, disturbed, unfinished : int
        Numbers of rounds: all, with a disturbance, with unfinished files after it.
    reported, found : int
        Numbers of clips or steps that processes reported as done, and of clips compared.
    held : int
        Number of times that a reader which stayed open was compared.
    struck : Counter
        Numbers of disturbances by the kind of step.
    skipped : str
        Why it was skipped.
    faults : list of str
        What went wrong.
    seconds : float
        Its duration.
    """

    title: str
    rounds: int = 0
    disturbed: int = 0
    unfinished: int = 0
    reported: int = 0
    found: int = 0
    held: int = 0
    struck: Counter[str] = field(default_factory=Counter)
    skipped: str = ""
    faults: list[str] = field(default_factory=list)
    seconds: float = 0.0


class Torture:
    """All rounds, and what they share; a context manager that ends its processes.

    Parameters
    ----------
    work : Path
        An empty folder.
    seed : int
        Seed of the disturbances; the clips are always the same.
    files : int
        Number of clips for ``db add``.
    progress : callable, optional
        Called with a line about the progress.
    mounts : bool
        Whether to mount a tmpfs.
    forks : bool
        Whether processes killed at a random time may be copies of this one, as all others are.
        These start so fast that their start is not disturbed.
    reader : bool
        Whether a reader keeps each database open, with its segments mapped, through its rounds.
    workers : bool
        Whether processes are started without forking, as on Windows.
    """

    def __init__(
        self,
        work: Path,
        seed: int = 0,
        files: int = FILES,
        progress: Callable[[str], None] = lambda _: None,
        *,
        mounts: bool = True,
        forks: bool = False,
        reader: bool = False,
        workers: bool = not HAS_FORK,
    ) -> None:
        self.work = work
        self._seed = seed
        self._say = progress
        self._mounts = mounts and HAS_FORK
        self._forks = forks
        self.rows: list[Row] = []
        self._materials = Materials(work, files)
        self.known, self.own = self._materials.known, self._materials.own
        self._processes = Processes(self._materials.paths[0], forks=not workers)
        self._figures: dict[str, Job] = {}
        self._reader = Reader(self.known) if reader else None

    def __enter__(self) -> Torture:
        return self

    def __exit__(self, *error: object) -> None:
        self._processes.__exit__(*error)
        if self._reader is not None:
            self._reader.__exit__(*error)

    def run(self, kind: str, rounds: int, steps: Sequence[str] = ()) -> None:
        """Run the rounds of one of `KINDS`; ``none`` disturbs nothing.

        Parameters
        ----------
        kind : str
            How processes are disturbed.
        rounds : int
            Number of rounds for each row of the table.
        steps : sequence of str
            Of `DURING`: kill during these, in a row for each; by default, in ``db add`` and in
            plans of all steps.
        """
        if kind in SIGNALS:
            name = signal_name(kind)
            for step in steps:
                if step != DB_ADD:
                    self._planned(f"{name} in {step}", rounds, kind, step)
            if DB_ADD in steps or not steps:
                self._adding(f"{name} in db add", rounds, killed(kind))
            if not steps:
                title = f"{name} in remove, accept, compact, merge"
                self._planned(title, rounds, killed(kind))
        elif kind == "swap":
            self._swapped("exchanged files", rounds)
        elif kind == "full":
            what = "file-size limit" if HAS_FORK else "full disk"
            self._adding(f"{what} in db add", rounds, limited)
            self._planned(f"{what} in remove, ...", rounds, limited)
            if self._mounts:
                self._adding("full tmpfs in db add", rounds, undisturbed, on_tmpfs=True)
        elif kind == "fsync":
            self._adding("failing calls in db add", rounds, tripped)
            self._planned("failing calls in remove, ...", rounds, tripped)
        elif kind == "held":
            self._adding("files open elsewhere in db add", rounds, held)
            self._planned("files open elsewhere in remove, ...", rounds, held)
        elif kind == "none":
            self._planned("undisturbed", rounds, undisturbed)

    @contextmanager
    def _row(self, title: str) -> Iterator[tuple[Row, random.Random]]:
        row = Row(title)
        self.rows.append(row)
        began = time.monotonic()
        yield row, random.Random(f"{title} {self._seed}")
        row.seconds = time.monotonic() - began

    @contextmanager
    def _guarded(self, row: Row, folder: Path) -> Iterator[None]:
        """Note what is lost or wrong, and keep the database."""
        problem = ""
        try:
            yield
        except WrongError as error:
            problem = str(error)
        if problem:  # the error is gone, and with it the arrays that keep files mapped
            self._failed(row, folder, problem)

    def _report(self, row: Row, rounds: int) -> None:
        self._say(f"{row.title}: {row.rounds} of {rounds}, {len(row.faults)} faults")

    # --- db add

    def _adding(
        self, title: str, rounds: int, disturb: Disturbance, *, on_tmpfs: bool = False
    ) -> None:
        with self._row(title) as (row, rng):
            self._processes.prepare(adds=True)
            folder = self.work / "db"
            mount: Any = None
            if on_tmpfs:
                from torture.posix import Mount

                mount = Mount(self.work / "tmpfs")
                folder = mount.folder / "db"
                row.skipped = mount.why_not()
            files = [str(path) for path in self._materials.paths]
            rng.shuffle(files)
            job = Job(self._processes, folder, (*ADD, str(folder), *files), forks=self._forks)
            if not row.skipped:
                with mount or nullcontext():
                    job.take_over(self._measured("add", job, disturb))
                    remove_folder(folder)
            must: set[str] = set()
            for number in range(0 if row.skipped else rounds):
                if number % KEPT_FOR == 0 or len(must) == len(files) or on_tmpfs:
                    must = self._new_database(row, job, rng, files, on_tmpfs=on_tmpfs)
                job.share = 1 - len(must) / len(files)
                if mount:
                    mount.bytes = rng.randint(20_000, job.bytes + job.catalogue)
                row.rounds += 1
                before, must = must, set()
                with self._guarded(row, folder), mount or nullcontext():
                    must = self._add_round(row, job, rng, disturb, before, mount)
                self._report(row, rounds)
            self._let_go(row, folder)
            remove_folder(folder)

    def _new_database(
        self, row: Row, job: Job, rng: random.Random, files: list[str], *, on_tmpfs: bool
    ) -> set[str]:
        """Remove the database; with a reader, make one that it can hold. Return its clips."""
        self._let_go(row, job.folder)
        remove_folder(job.folder)
        rng.shuffle(files)
        job.arguments = (*ADD, str(job.folder), *files)
        if self._reader is None or on_tmpfs:  # the tmpfs is mounted later
            return set()
        first, names = files[0], {Path(files[0]).stem}
        self._processes.complete((*ADD, str(job.folder), first)).end()
        return names

    def _add_round(
        self,
        row: Row,
        job: Job,
        rng: random.Random,
        disturb: Disturbance,
        must: set[str],
        mount: Any,
    ) -> set[str]:
        """Run a round; return the names of the clips that the database must have afterwards."""
        if must:
            self._hold(job.folder, contents(job.folder, self.known))
        run, was_disturbed = disturb(job, rng)
        self._check_end(run, killed=_is_kill(row))
        row.disturbed += was_disturbed
        files = job.arguments[len(ADD) + 1 :]
        names = {f"added {file}": Path(file).stem for file in files}
        reported = {names[line] for line in run.lines if line in names}
        row.unfinished += is_unfinished(job.folder)
        found = contents(job.folder, self.known)
        row.reported += len(reported)
        row.found += len(found)
        self._check_reader(row)
        if missing := (must | reported) - set(found):
            raise WrongError(f"reported as added but missing: {', '.join(sorted(missing))}")
        # the next process adds some clips that exist and some that do not
        if mount:
            mount.grow()
        else:
            self._hold(job.folder, found)
        there = [file for file in files if Path(file).stem in found][:2]
        new = [file for file in files if Path(file).stem not in found][:2]
        if not there + new:
            return set(found)
        after = self._processes.complete((*ADD, str(job.folder), *there, *new))
        status = after.end()
        if status != 0:
            raise WrongError(f"the next db add ended with {status}: {after.errors[-400:]}")
        wanted = [f"added {file}" for file in new]
        if [line for line in after.lines if line in names] != wanted:
            raise WrongError(f"the next db add printed {after.lines} instead of {wanted}")
        now = set(contents(job.folder, self.known))
        if now != set(found) | {Path(file).stem for file in new}:
            raise WrongError("after the next db add the database has the wrong clips")
        self._check_reader(row)
        return now

    # --- plans

    def _planned(self, title: str, rounds: int, disturb: Disturbance | str, step: str = "") -> None:
        """Execute plans; with a kind of step, kill by a kind of signal during such a step."""
        with self._row(title) as (row, rng):
            folder = self.work / "planned"
            file = self.work / "plan.json"
            made = self._materials
            options = {"plan": file, "files": made.files, "other": made.to_merge}
            self._processes.prepare(adds=step not in ("remove", "compact", "merge"))
            for _ in range(rounds):
                plan = make_plan(rng, made.own, made.other)
                file.write_text(written(plan))
                job = Job(self._processes, folder, options=options, start=made.start)
                row.rounds += 1
                with self._guarded(row, folder):
                    if isinstance(disturb, str):
                        act = killed_in_step(step, disturb)
                        plan = self._prepared(job, rng, step, file)
                    else:
                        act = disturb
                        job.take_over(self._measured("plan", job, disturb))
                        job.reset()
                    self._plan_round(row, job, rng, act, plan, file)
                self._let_go(row, folder)
                self._report(row, rounds)
            remove_folder(folder)

    def _measured(self, kind: str, job: Job, disturb: Disturbance) -> Job:
        """Return a job of a kind with figures of an undisturbed run."""
        if kind not in self._figures:
            job.measure()
        measured = self._figures.setdefault(kind, job)
        if disturb is held:
            measured.measure_held()
        return measured

    def _prepared(self, job: Job, rng: random.Random, kind: str, file: Path) -> list[Step]:
        """Execute the steps before one of a kind; return the rest."""
        made = self._materials
        if "steps" not in self._figures:
            plan = plan_of_all(rng, made.own, made.other)
            file.write_text(written(plan))
            job.measure_steps([one.kind for one in plan])
        job.take_over(self._figures.setdefault("steps", job))
        job.reset()
        plan, aim = plan_until(rng, made.own, made.other, kind)
        self._hold(job.folder, made.own)
        file.write_text(written(plan[:aim]))
        run = self._processes.complete(job.with_faults())
        if run.end() != 0:
            raise WrongError(f"an undisturbed process failed: {run.errors[-400:]}")
        file.write_text(written(plan[aim:]))
        return plan[aim:]

    def _plan_round(
        self,
        row: Row,
        job: Job,
        rng: random.Random,
        disturb: Disturbance,
        plan: list[Step],
        file: Path,
    ) -> None:
        self._hold(job.folder, plan[0].before)
        run, was_disturbed = disturb(job, rng)
        self._check_end(run, killed=_is_kill(row))
        row.disturbed += was_disturbed
        row.unfinished += is_unfinished(job.folder)
        done = sum(line.startswith("done") for line in run.lines)
        begun = sum(line.startswith("begin") for line in run.lines)
        if was_disturbed:
            row.struck[plan[done].kind if begun > done else "between steps"] += 1
        found = contents(job.folder, self.known)
        row.reported += done
        row.found += len(found)
        self._check_reader(row)
        step = plan[min(done, len(plan) - 1)]
        fits = found == (step.before if done < len(plan) else step.after)
        # the process may have been killed between a commit and its line
        if not fits and not (done < len(plan) and step.admits(found)):
            raise WrongError(
                f"after {done} steps and in {step.kind} {step.names} ({begun} begun) there is "
                f"{difference(found, step.before)} against before and "
                f"{difference(found, step.after)} against after"
            )
        # the next process executes the remaining steps
        rest = plan[done:]
        if found == step.after and found != step.before:
            rest = rest[1:]
        file.write_text(written(rest))
        self._hold(job.folder, found)
        after = self._processes.complete(job.with_faults())
        status = after.end()
        if status != 0:
            raise WrongError(f"the next writer ended with {status}: {after.errors[-400:]}")
        now = contents(job.folder, self.known)
        if now != plan[-1].after:
            raise WrongError(f"the next writer left {difference(now, plan[-1].after)}")
        self._check_reader(row)

    # --- exchanged files

    def _swapped(self, title: str, rounds: int) -> None:
        """Exchange files of a database; nothing may change, and nothing be lost."""
        with self._row(title) as (row, rng):
            folder = self.work / "swapped"
            for _ in range(rounds):
                remove_folder(folder)
                row.rounds += 1
                with self._guarded(row, folder):
                    self._swap_round(row, folder, rng)
                self._report(row, rounds)

    def _swap_round(self, row: Row, folder: Path, rng: random.Random) -> None:
        """Exchange a file, run commands, put it back."""
        made = self._materials
        older = self.work / "older"
        remove_folder(older)
        shutil.copytree(made.start, folder)
        plan = make_plan(rng, made.own, made.other)[: rng.randint(1, 6)]
        middle = rng.randint(0, len(plan))
        for steps in (plan[:middle], plan[middle:]):
            if not older.exists():
                shutil.copytree(folder, older)
            file = self.work / "plan.json"
            file.write_text(written(steps))
            with redirect_stdout(io.StringIO()):
                drive(folder, file, made.files, made.to_merge)
            gc.collect()  # Windows exchanges no file that a forgotten array still maps
            if steps is plan[:middle]:
                remove_folder(older)
                shutil.copytree(folder, older)
        wanted = plan[-1].after
        sound = fingerprint(folder)
        swap = rng.choice(SWAPS)
        is_damage = swap(folder, older, made.to_merge, rng)
        if fingerprint(folder) == sound:
            is_damage = False
        row.disturbed += is_damage
        before = fingerprint(folder)
        new = next(path for path in reversed(made.paths) if path.stem not in wanted)
        for command in (["compact"], ["remove", sorted(wanted)[0]], ["verify"], ["add", str(new)]):
            if not is_damage and command[0] not in ("verify", "compact"):
                continue
            line = (*COMMAND_LINE, "db", command[0], "-d", str(folder), *command[1:])
            run = self._processes.complete(line)
            self._check_end(run, killed=False)
            if is_damage and run.end() == 0:
                raise WrongError(f"{swap.__name__}: db {command[0]} did not notice it")
            if is_damage and fingerprint(folder) != before:
                raise WrongError(f"{swap.__name__}: db {command[0]} changed the files")
        if not is_damage:
            found = contents(folder, self.known)
            if found != wanted:
                raise WrongError(f"{swap.__name__}: {difference(found, wanted)}")
            row.found += len(found)
            lost = [name for name in before if name not in fingerprint(folder) and name in FOREIGN]
            if lost:
                raise WrongError(f"{swap.__name__}: {lost} were removed")

    # --- readers, and results

    def _hold(self, folder: Path, found: dict[str, str]) -> None:
        """Let the reader, if there is one, open the database as it is, and keep it open."""
        if self._reader is not None:
            self._reader.open(folder, found)

    def _check_reader(self, row: Row) -> None:
        if self._reader is not None:
            row.held += self._reader.check()

    def _let_go(self, row: Row, folder: Path) -> None:
        """Close the reader; the next writer must then remove what is left."""
        with self._guarded(row, folder):
            if self._reader is not None:
                self._reader.close()
            if (folder / MANIFEST).exists():
                check_nothing_left(folder)

    def _check_end(self, run: Run | Inline, *, killed: bool) -> None:
        """Raise an error if a process that was not killed ended without a clean message."""
        status = run.end()
        if killed:
            return
        bad = [text for text in ("Traceback", "bug in priorfill") if text in run.errors]
        if status not in (0, 1) or bad:
            raise WrongError(f"ended with {status} and {run.errors[-600:]!r}")

    def _failed(self, row: Row, folder: Path, problem: str) -> None:
        kept = self.work / f"failed-{len(self.rows)}-{row.rounds}"
        if folder.exists():
            shutil.copytree(folder, kept, dirs_exist_ok=True)
            with suppress(WrongError):
                if self._reader is not None:
                    self._reader.close()
            remove_folder(folder)
        row.faults.append(f"round {row.rounds}: {problem} (the database is kept in {kept})")
        self._say(f"{row.title}: {row.faults[-1]}")

    @property
    def failed(self) -> bool:
        """Whether a round failed."""
        return any(row.faults for row in self.rows)


def _is_kill(row: Row) -> bool:
    return any(row.title.startswith(signal_name(kind)) for kind in SIGNALS)
