#!/usr/bin/env python
"""Check that no damaged C3D file crashes or hangs priorfill, or leaves files behind.

    python scripts/checks/fuzz_c3d.py [--count 20000] [--seed 1] [--minutes 10] [--keep DIR]
    [--rewrite]

Small C3D files of all kinds (processors, number formats, subjects, long lists, model outputs) are
damaged at random: bits and bytes, counts and floats of the header, parameter values, sections
removed, duplicated, truncated or inserted. Each is read and, if that succeeds, filled and written,
in a process limited to 5 s of CPU time and 1 GB. A file must be filled, or rejected with a
`PriorfillError` of one line, without leaving any file behind. Everything else, warnings included,
is a failure. Exit status 1 if there was one. Equal seeds produce equal files, `--keep` keeps those
that failed. `--rewrite` writes through ezc3d instead of patching a copy.
"""

from __future__ import annotations

import re
import struct
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.errors import PriorfillError
from priorfill.filling.fill_clip import fill
from priorfill.filling.fill_options import FillOptions
from priorfill.filling.plausibility_options import UNCHECKED
from priorfill.formats import read, write

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
sys.path.append(str(Path(__file__).resolve().parents[2] / "tests" / "support"))
from c3d_bytes import BLOCK, DEC, INTEL, LABELS, MIPS, C3DFile, standing
from fuzzing import Tally, fuzz_parser, run_cases

PRELOADED = ("priorfill.filling.fill_clip", "priorfill.formats", "priorfill.methods.interpolation")
"""Modules that a new process finds imported."""

MAX_MUTATIONS = 4
"""Maximum mutations of one file; more would be hidden by the first."""

MAX_SLICE_BYTES = 64
"""Maximum bytes that are removed, duplicated or inserted."""

EXTREME_BYTES = (0, 1, 2, 0x7F, 0x80, 0x81, 0xFE, 0xFF)
EXTREME_WORDS = (0, 1, 2, 255, 256, 0x7FFF, 0x8000, 0x8001, 0xFFFE, 0xFFFF)
EXTREME_FLOATS = (0.0, -0.0, 1.0, -1.0, 1e9, -1e9, 3e38, -3e38, 1e-38, 1e-45)
EXTREME_FLOATS += (float("inf"), float("-inf"), float("nan"), 0.5, 32767.5)
"""Values at which programs break."""

HEADER_WORDS = 12
"""Words of the header that say something of points and frames."""

NAMES = (
    *(b"USED", b"FRAMES", b"DATA_START", b"SCALE", b"RATE", b"LABELS", b"UNITS", b"LABELS2"),
    *(b"LONG_FRAMES", b"ACTUAL_START_FIELD", b"ACTUAL_END_FIELD", b"LABEL_PREFIXES", b"NAMES"),
    *(b"GEN_SCALE", b"OFFSET", b"Y_SCREEN", b"TYPE_GROUPS", b"ANGLES", b"POINT", b"ANALOG"),
)
"""Parameters and groups whose records are edited."""

RECORD = 16
"""Bytes after a name in which its type, dimensions and first values are."""


class Case(NamedTuple):
    """One damaged file: which seed makes it, where it is put, and whether it is written anew."""

    seed: int
    number: int
    folder: str
    rewrite: bool = False


@cache
def fixtures() -> tuple[bytes, ...]:
    """Return the whole files that are damaged."""
    files = []
    for processor in (INTEL, DEC, MIPS):
        for is_float in (True, False):
            records = standing(6, step=None if is_float else 0.1)
            records[2:4, 3, 3] = -1
            analog = np.ones((6, 2, 3))
            files.append(
                C3DFile(records, LABELS, processor=processor, is_float=is_float, analog=analog)
            )
    two = np.concatenate([standing(6), standing(6, seed=1)], axis=1)
    labels = [f"Anna:{name}" for name in LABELS]
    subjects = {"SUBJECTS": {"NAMES": ["Anna"], "LABEL_PREFIXES": ["Anna:"], "USED": 1}}
    files += [
        C3DFile(standing(6), labels, parameters=subjects),
        C3DFile(two, [*labels, *(f"X{name}" for name in LABELS)]),
        C3DFile(standing(6), [*LABELS[:-1], b"Fu\xdf"], units=None),
        C3DFile(
            standing(6),
            [*LABELS[:-3], "PELO", "PELA", "LHipAngles"],
            parameters={"POINT": {"ANGLES": ["LHipAngles"], "TYPE_GROUPS": ["ANGLES"]}},
        ),
        C3DFile(np.full((1, 300, 4), 9.0), [f"M{i}" for i in range(300)], is_float=False),
        C3DFile(
            standing(6),
            LABELS,
            first_frame=9,
            header={"last": 65535},
            parameters={
                "TRIAL": {"ACTUAL_START_FIELD": [9, 0], "ACTUAL_END_FIELD": [14, 0]},
                "POINT": {"LONG_FRAMES": 6.0, "Y_SCREEN": ["+Z"], "X_SCREEN": ["+X"]},
            },
        ),
    ]
    return tuple(file.bytes() for file in files)


def mutate(seed: int, number: int) -> bytes:
    """Return the damaged file of a seed and a number."""
    rng = np.random.default_rng((seed, number))
    content = bytearray(fixtures()[rng.integers(len(fixtures()))])
    for _ in range(rng.integers(1, MAX_MUTATIONS + 1)):
        if content:
            MUTATIONS[rng.integers(len(MUTATIONS))](content, rng)
    return bytes(content)


def _place(content: bytearray, rng: np.random.Generator) -> int:
    """Return a byte, as likely in the header and the parameters as anywhere."""
    end = min(len(content), 4 * BLOCK) if rng.random() < 0.5 else len(content)
    return int(rng.integers(end))


def _put(content: bytearray, at: int, piece: bytes) -> None:
    """Overwrite some bytes, if there are any."""
    content[at : at + len(piece)] = piece[: max(0, len(content) - at)]


def _order(content: bytearray) -> str:
    """Return the byte order of a file, if it is still legible."""
    return ">" if len(content) > BLOCK + 3 and content[BLOCK + 3] == MIPS else "<"


def _flip_bit(content: bytearray, rng: np.random.Generator) -> None:
    content[_place(content, rng)] ^= 1 << int(rng.integers(8))


def _set_byte(content: bytearray, rng: np.random.Generator) -> None:
    content[_place(content, rng)] = int(rng.choice(EXTREME_BYTES))


def _set_header_word(content: bytearray, rng: np.random.Generator) -> None:
    word = int(rng.choice(EXTREME_WORDS))
    _put(content, 2 * int(rng.integers(HEADER_WORDS)), struct.pack(_order(content) + "H", word))


def _set_float(content: bytearray, rng: np.random.Generator) -> None:
    value = EXTREME_FLOATS[rng.integers(len(EXTREME_FLOATS))]
    _put(content, _place(content, rng) & ~1, struct.pack(_order(content) + "f", value))


def _edit_record(content: bytearray, rng: np.random.Generator) -> None:
    name = NAMES[rng.integers(len(NAMES))]
    at = content.find(name)
    if at < 0:
        return
    at += len(name) + int(rng.integers(RECORD))
    if rng.random() < 0.5:
        _put(content, at, bytes([int(rng.choice(EXTREME_BYTES))]))
    elif rng.random() < 0.5:
        _put(content, at, struct.pack(_order(content) + "H", int(rng.choice(EXTREME_WORDS))))
    else:
        value = EXTREME_FLOATS[rng.integers(len(EXTREME_FLOATS))]
        _put(content, at, struct.pack(_order(content) + "f", value))


def _cut_off(content: bytearray, rng: np.random.Generator) -> None:
    del content[int(rng.integers(len(content))) :]


def _cut_out(content: bytearray, rng: np.random.Generator) -> None:
    at = _place(content, rng)
    del content[at : at + int(rng.integers(1, MAX_SLICE_BYTES))]


def _double(content: bytearray, rng: np.random.Generator) -> None:
    at = _place(content, rng)
    content[at:at] = content[at : at + int(rng.integers(1, MAX_SLICE_BYTES))]


def _insert(content: bytearray, rng: np.random.Generator) -> None:
    at = _place(content, rng)
    content[at:at] = rng.bytes(int(rng.integers(1, MAX_SLICE_BYTES)))


def _extend(content: bytearray, rng: np.random.Generator) -> None:
    content += bytes(BLOCK * int(rng.integers(1, 8)))


MUTATIONS: tuple[Callable[[bytearray, np.random.Generator], None], ...] = (
    *(_flip_bit, _set_byte, _set_header_word, _set_float, _edit_record, _edit_record),
    *(_cut_off, _cut_out, _double, _insert, _extend),
)
"""Ways to damage a file; edits of parameters twice, as most of what is believed is there."""


UNCHECKED_FILL = FillOptions(plausibility=UNCHECKED)
"""Options with which noisy positions of a few frames are filled, so that something is written."""


def run_case(case: Case) -> tuple[str, float]:
    """Read, fill and write a damaged file; return how it ended, and the processor time (s)."""
    folder = Path(case.folder)
    source, output = folder / "in.c3d", folder / "out.c3d"
    source.write_bytes(mutate(case.seed, case.number))
    start = time.process_time()
    written = False
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            clip = read(source)
            result = fill(clip, method="linear", options=UNCHECKED_FILL)
            write(output, result.clip, result.filled, rewrite=case.rewrite)
        written = True
        end = "filled" if result.filled.any() else "read, nothing filled"
    except PriorfillError as error:
        end = f"refused: {kind_of(str(error))}"
        if "\n" in str(error):
            raise AssertionError(f"a message of several lines: {error!r}") from error
    seconds = time.process_time() - start
    if output.exists() != written:
        raise AssertionError("an output that should not be there, or is not there")
    output.unlink(missing_ok=True)
    left = [path.name for path in folder.iterdir() if path != source]
    if left:
        raise AssertionError(f"files are left behind: {left}")
    return end, seconds


def kind_of(message: str) -> str:
    """Return a message without what is particular to one file: names, numbers, the remedy."""
    text = message.partition(": ")[2].partition("; ")[0]
    text = re.sub(r"parameter .* is damaged", "parameter X is damaged", text)
    text = re.sub(r"(labelled|marker|position of|subject) .*", r"\1 X", text)
    text = re.sub(r"subjects? \(.*", "subjects", text)
    return re.sub(r"-?\d[\d.e+-]*|\binf\b|\bnan\b", "N", text)


def fuzz(
    count: int,
    seed: int,
    *,
    minutes: float = float("inf"),
    keep: Path | None = None,
    rewrite: bool = False,
) -> Tally:
    """Run cases."""

    def save(case: Case) -> None:
        if keep is not None:
            path = keep / f"{case.seed}-{case.number}.c3d"
            path.write_bytes(mutate(case.seed, case.number))

    return run_cases(
        run_case,
        lambda number, folder: Case(seed, number, folder, rewrite),
        count,
        save,
        minutes=minutes,
        preload=PRELOADED,
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Damage files and see."""
    parser = fuzz_parser(__doc__)
    parser.add_argument("--rewrite", action="store_true", help="write through ezc3d")
    options = parser.parse_args(arguments)
    if options.keep is not None:
        options.keep.mkdir(parents=True, exist_ok=True)
    start = time.monotonic()
    tally = fuzz(
        options.count,
        options.seed,
        minutes=options.minutes,
        keep=options.keep,
        rewrite=options.rewrite,
    )
    tally.show(time.monotonic() - start)
    return int(bool(tally.faults))


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
