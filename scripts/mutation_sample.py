#!/usr/bin/env python
"""Mutation testing: plants faults in the numeric modules and counts those that tests catch.

    python scripts/mutation_sample.py --count 50 --seed 1 [--jobs 2] [--only priorfill/search]

Each fault is planted in a private copy of the checkout, where the tests that execute the changed
statement run until one fails. Faults are drawn from all sites with equal probability; a seed draws
the same faults as long as their source lines stay the same. The first run records which lines each
test executes, which takes as long as the test suite; records are cached in ``--cache``. The output
is the outcome of each fault, the share caught by operator and by folder, and the survivors.

``--list`` prints the drawn faults without running them, ``--key KEY`` runs a single one. Faults in
``mutation/equivalents.toml`` change no result; they are skipped and counted separately. The
operators are in ``mutation/operators.py``.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import queue
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path
from typing import TypeVar

from mutation.reach import Reach, Readers, Record, Recorder, test_files
from mutation.run import HUNG, SURVIVED, Outcome, Workspace, run_fault
from mutation.sites import Site, sites

from priorfill.cli.encoding import replace_what_is_lacking

NOT_NUMERIC_FOLDERS = (
    *("cli", "formats", "database", "datasets", "integrations", "reviewing", "runtime", "study"),
)
"""Folders without numeric modules, directly below the package."""

NOT_NUMERIC = (
    *("__init__", "errors", "interop", "clip"),
    *("demo", "overrides", "uncertainty_file"),
    *("runner", "outcome_store", "evaluation_results", "plots"),  # of the evaluation
)
"""Modules that are not numeric, in any folder."""

HERE = Path(__file__).resolve().parent
T = TypeVar("T")


def numeric_modules(root: Path, package: str) -> list[str]:
    """Return the files of the numeric modules, relative to the checkout."""
    files = (file.relative_to(root) for file in (root / package).rglob("*.py"))
    return sorted(
        file.as_posix()
        for file in files
        if file.stem not in NOT_NUMERIC and file.parts[1] not in NOT_NUMERIC_FOLDERS
    )


def all_sites(root: Path, package: str) -> list[Site]:
    """Return every fault that can be planted."""
    found: list[Site] = []
    for path in numeric_modules(root, package):
        found += sites(path, (root / path).read_bytes())
    return found


def read_equivalents(file: Path) -> dict[str, str]:
    """Return the keys of faults that change no result, with the reasons."""
    if not file.exists():
        return {}
    entries = tomllib.loads(file.read_text(encoding="utf-8")).get("equivalent", [])
    return {entry["key"]: entry["reason"] for entry in entries}


def draw(
    candidates: Iterable[Site], count: int, seed: int, equivalents: Iterable[str] = ()
) -> tuple[list[Site], list[Site]]:
    """Draw faults, each site with equal probability.

    Sites are ordered by a hash of seed and key, so that a change of the code elsewhere hardly
    changes the drawn faults.

    Returns
    -------
    drawn : list of Site
        Faults to run.
    equivalent : list of Site
        Equivalent faults that were skipped.
    """

    def rank(site: Site) -> bytes:
        return hashlib.sha256(f"{seed}|{site.key}".encode()).digest()

    left_out = set(equivalents)
    drawn: list[Site] = []
    passed: list[Site] = []
    for site in sorted(candidates, key=rank):
        if len(drawn) == count:
            break
        (passed if site.key in left_out else drawn).append(site)
    return drawn, passed


def in_workspaces(
    workspaces: list[Workspace], work: Callable[[Workspace, T], object], items: list[T]
) -> None:
    """Process items in parallel, one at a time in each workspace."""
    free: queue.SimpleQueue[Workspace] = queue.SimpleQueue()
    for workspace in workspaces:
        free.put(workspace)

    def one(item: T) -> None:
        workspace = free.get()
        try:
            work(workspace, item)
        finally:
            free.put(workspace)

    with ThreadPoolExecutor(len(workspaces)) as pool:
        waiting = [pool.submit(one, item) for item in items]
        try:
            for done in as_completed(waiting):
                done.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for workspace in workspaces:
                workspace.kill()
            raise


def records_of(recorder: Recorder, workspaces: list[Workspace]) -> list[Record]:
    """Return the records of all test files, making those that are not in the cache."""
    files = test_files(recorder.root)
    found = {file: recorder.known(file) for file in files}
    missing = [file for file in files if found[file] is None]

    def make(workspace: Workspace, file: str) -> None:
        begin = time.monotonic()
        found[file] = recorder.record(file, workspace.run, workspace.scratch)
        print(f"recorded {file} in {time.monotonic() - begin:.0f} s", flush=True)

    if missing:
        print(f"recording coverage of {len(missing)} of {len(files)} test files", flush=True)
        in_workspaces(workspaces, make, missing)
    records = [record for record in found.values() if record is not None]
    for record in records:
        for node in record.failed:
            print(f"fails without a fault, skipped: {node}")
    return records


def describe(site: Site) -> str:
    """Return a fault as two lines of a diff."""
    return f"    - {site.text}\n    + {site.after}"


def title(site: Site) -> str:
    """Return the location and the operator of a fault."""
    return f"{site.path}:{site.line}  {site.operator}  in {site.function}"


def tests_run(outcome: Outcome) -> str:
    """Return how many tests a survivor has passed."""
    if outcome.selected == outcome.reached:
        return f"{outcome.reached} tests reach it"
    return f"{outcome.selected} of {outcome.reached} tests that reach it were run, see --limit"


def describe_outcome(outcome: Outcome, number: int, count: int) -> str:
    """Return the lines printed for a fault."""
    by = f"by {outcome.test}" if outcome.test else tests_run(outcome)
    return (
        f"[{number}/{count}] {outcome.result:8}  {outcome.seconds:.1f} s  {title(outcome.site)}\n"
        f"{describe(outcome.site)}\n    {by}"
    )


def shares(outcomes: list[Outcome], group: Callable[[Outcome], str]) -> str:
    """Return a table of the faults caught in each group."""
    planted = Counter(map(group, outcomes))
    caught = Counter(group(outcome) for outcome in outcomes if outcome.result != SURVIVED)
    return "\n".join(
        f"    {name:32} {caught[name]:4} of {planted[name]:4}  {caught[name] / planted[name]:4.0%}"
        for name in sorted(planted)
    )


def summary(outcomes: list[Outcome], equivalent: int) -> str:
    """Return the share caught, by operator and folder, and the survivors."""
    outcomes = sorted(outcomes, key=lambda outcome: (outcome.site.path, outcome.site.line))
    survivors = [outcome for outcome in outcomes if outcome.result == SURVIVED]
    hung = sum(outcome.result == HUNG for outcome in outcomes)
    caught = len(outcomes) - len(survivors)
    seconds = sum(outcome.seconds for outcome in outcomes) / max(1, len(outcomes))
    lines = [
        f"caught {caught} of {len(outcomes)} ({caught / max(1, len(outcomes)):.0%}), {hung} of them"
        f" by a timeout; {equivalent} equivalent skipped; {seconds:.0f} s a fault",
        "by operator",
        shares(outcomes, lambda outcome: outcome.site.operator),
        "by folder",
        shares(outcomes, lambda outcome: Path(outcome.site.path).parent.as_posix()),
        f"survivors: {len(survivors)}",
    ]
    for outcome in survivors:
        lines += [f"{title(outcome.site)}  ({tests_run(outcome)})", describe(outcome.site)]
        lines.append(f"    {outcome.site.key}")
    return "\n".join(lines)


def write_json(file: Path, outcomes: list[Outcome], equivalent: list[Site]) -> None:
    """Write all outcomes, with the keys of the faults."""
    found = [asdict(outcome) | {"key": outcome.site.key} for outcome in outcomes]
    content = {"faults": found, "equivalent": [site.key for site in equivalent]}
    file.write_text(json.dumps(content, indent=1, ensure_ascii=False), encoding="utf-8")


def run(options: argparse.Namespace, drawn: list[Site], equivalent: list[Site]) -> list[Outcome]:
    """Run the faults and print each outcome."""
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory(prefix="priorfill-mutations-") as folder:
        root = options.checkout
        workspaces = [
            Workspace(root, Path(folder) / f"{job}") for job in range(max(1, options.jobs))
        ]
        records = records_of(Recorder(root, options.package, options.cache), workspaces)
        readers = Readers(root, options.package)
        reach = Reach(root, readers, records)

        def one(workspace: Workspace, site: Site) -> None:
            tests = reach.tests(site)
            outcome = run_fault(workspace, site, tests, readers, options.timeout, options.limit)
            outcomes.append(outcome)
            print(describe_outcome(outcome, len(outcomes), len(drawn)), flush=True)
            if options.json:
                write_json(options.json, outcomes, equivalent)

        in_workspaces(workspaces, one, drawn)
    return outcomes


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--count", type=int, default=20, help="number of faults")
    parser.add_argument("--seed", type=int, default=1, help="seed of the draw")
    parser.add_argument("--jobs", type=int, default=1, help="copies that run in parallel")
    parser.add_argument("--only", default="", metavar="PREFIX", help="path of a module or folder")
    parser.add_argument(
        "--timeout",
        type=float,
        default=120.0,
        help="seconds allowed for a fault, in addition to three times the recorded duration of its"
        " tests; a timeout counts as caught",
    )
    parser.add_argument(
        "--limit",
        type=float,
        default=180.0,
        help="recorded duration (s) of the tests run for a fault, the module's own and the"
        " cheapest first; survivors that more tests reach are marked",
    )
    parser.add_argument("--json", type=Path, help="file to write the outcomes to")
    parser.add_argument("--list", action="store_true", help="print the faults without running them")
    parser.add_argument("--key", help="run only the fault with this key")
    parser.add_argument(
        "--equivalents", type=Path, default=HERE / "mutation" / "equivalents.toml", metavar="FILE"
    )
    cache = Path(tempfile.gettempdir()) / "priorfill-mutation-records"
    parser.add_argument("--cache", type=Path, default=cache, help="folder of records")
    parser.add_argument("--checkout", type=Path, default=HERE.parent)
    parser.add_argument("--package", default="priorfill")
    options = parser.parse_args(arguments)
    options.checkout = options.checkout.resolve()
    return options


def main(arguments: list[str] | None = None) -> int:
    """Draw and run faults, and print the summary."""
    options = parse(arguments)
    candidates = all_sites(options.checkout, options.package)
    equivalents = read_equivalents(options.equivalents)
    for key in sorted(equivalents.keys() - {site.key for site in candidates}):
        print(f"listed as equivalent, but not found: {key}")
    if options.key:
        drawn = [site for site in candidates if site.key == options.key]
        equivalent: list[Site] = []
    else:
        candidates = [site for site in candidates if site.path.startswith(options.only)]
        drawn, equivalent = draw(candidates, options.count, options.seed, equivalents)
    if not drawn:
        print("no such fault; see --list")
        return 2
    if options.list:
        for site in drawn:
            print(f"{title(site)}\n{describe(site)}\n    {site.key}")
        print(f"{len(drawn)} drawn of {len(candidates)}, {len(equivalent)} equivalent skipped")
        return 0
    print(summary(run(options, drawn, equivalent), len(equivalent)))
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    raise SystemExit(main())
