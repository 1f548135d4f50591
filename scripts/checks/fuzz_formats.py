#!/usr/bin/env python
"""Check that no damaged file crashes or hangs priorfill: tables, arrays, skeletons, TOML, errors.

    python scripts/checks/fuzz_formats.py [--count 20000] [--seed 1] [--minutes 10] [--keep DIR]
    [--kinds trc,npz]

Small files of each kind are damaged at random: bytes, cells, lines, separators and encodings of
text; shapes, types and headers of arrays; values of TOML and of a provenance. Each is used as
priorfill uses it (recordings are read, filled and written, skeletons get markers, definitions are
applied, expected errors are shown), in a process limited to 5 s of CPU time and 1 GB. It must
succeed, or be rejected with a `PriorfillError` of one line without control characters, leave no
other file behind, and change no measured sample. Everything else, warnings included, is a failure.
Exit status 1 if there was one. Equal seeds produce equal files, `--keep` keeps those that failed.
"""

from __future__ import annotations

import io
import json
import re
import sys
import time
import unicodedata
import warnings
import zipfile
import zlib
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from scipy.io import savemat

from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.clip import Clip
from priorfill.datasets.dataset_definitions import find_dataset
from priorfill.errors import PriorfillError
from priorfill.filling.fill_clip import fill
from priorfill.filling.fill_options import FillOptions
from priorfill.filling.overrides_file import read_overrides
from priorfill.filling.read_uncertainty import read_uncertainty
from priorfill.filling.result import Result
from priorfill.filling.result_from_files import result_from_clips
from priorfill.filling.uncertainty_file import write_uncertainty
from priorfill.formats import is_recording, read, write
from priorfill.formats.skeletons.asf_amc import read_amc, read_asf
from priorfill.formats.skeletons.bvh import parse_bvh, read_bvh
from priorfill.markers.definitions import available, load
from priorfill.report.report_data import page_data
from priorfill.runtime.resources import resource_path
from priorfill.skeleton.joints_file import read_joint_names
from priorfill.skeleton.virtual_markers import compute_virtual_markers

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
sys.path.append(str(Path(__file__).resolve().parents[2] / "tests" / "support"))
import bids_files
import skeleton_files
import text_files
from fuzzing import Tally, fuzz_parser, run_cases
from method_alone import method_alone

PRELOADED = (
    *("priorfill.filling.fill_clip", "priorfill.formats", "priorfill.methods.interpolation"),
    *("priorfill.skeleton.virtual_markers", "priorfill.datasets.dataset_definitions", "scipy.io"),
)
"""Modules that a new process finds imported."""

MAX_MUTATIONS = 4
"""Maximum mutations of one file; more would be hidden by the first."""

MAX_SLICE_BYTES = 64
"""Maximum bytes that are removed, duplicated or inserted."""

FRAMES = 8
"""Frames of each recording."""

Rng = np.random.Generator
Damage = Callable[[bytes, Rng], bytes]


class Case(NamedTuple):
    """One damaged file: which seed makes it, what it is, and where it is put."""

    seed: int
    number: int
    folder: str
    kind: str


class Kind(NamedTuple):
    """A kind of file: its suffix, whole files, ways to damage them, and how one is used."""

    suffix: str
    whole: Callable[[], tuple[bytes, ...]]
    damages: tuple[Damage, ...]
    use: Callable[[Path, bytes, Rng], str]


def _pick(rng: Rng, values: Sequence[bytes]) -> bytes:
    return values[int(rng.integers(len(values)))]


def _flip_bit(content: bytes, rng: Rng) -> bytes:
    at = int(rng.integers(len(content)))
    return content[:at] + bytes([content[at] ^ 1 << int(rng.integers(8))]) + content[at + 1 :]


def _set_byte(content: bytes, rng: Rng) -> bytes:
    at = int(rng.integers(len(content)))
    return content[:at] + _pick(rng, BYTES) + content[at + 1 :]


def _cut_off(content: bytes, rng: Rng) -> bytes:
    return content[: int(rng.integers(len(content)))]


def _cut_out(content: bytes, rng: Rng) -> bytes:
    at = int(rng.integers(len(content)))
    return content[:at] + content[at + int(rng.integers(1, MAX_SLICE_BYTES)) :]


def _double(content: bytes, rng: Rng) -> bytes:
    at = int(rng.integers(len(content)))
    end = at + int(rng.integers(1, MAX_SLICE_BYTES))
    return content[:end] + content[at:end] + content[end:]


def _insert(content: bytes, rng: Rng) -> bytes:
    at = int(rng.integers(len(content)))
    piece = rng.bytes(int(rng.integers(1, MAX_SLICE_BYTES)))
    return content[:at] + piece + content[at:]


BYTES = (b"\0", b"\n", b"\r", b'"', b",", b"\t", b"\x1b", b"\x7f", b"\x80", b"\xff")

RAW: tuple[Damage, ...] = (_flip_bit, _set_byte, _cut_off, _cut_out, _double, _insert)

WORDS = (
    *(b"", b" ", b"0", b"-1", b"1", b"nan", b"-inf", b"Infinity", b"1e999", b"-1e300", b"1e-320"),
    *(b"9" * 5000, b"-0", b"0x10", b"1_000", b"1,5", b"1;5", b"1.234,5", b"1 234.5", b"--1", b"+"),
    *(b'"', b'""', b'"1.5"', b'"a,b"', b"'a'", b"=1+1", b"@x", b"a\x1b[31mb", b"\xff\xfe", b"\0"),
    *("\u202eabc".encode(), "\u0661\u0662".encode(), "膝".encode(), b"-1.#IND00", b"a" * 100_000),
    *(b"2147483648", b"1e5", b"0.0001", b"true", b"[red]", b"2020-01-01", b"../../a", b"a:b", b"*"),
    *(b"[" * 3000, b"{a=" * 500, b"a." * 3000, b"99999999999999999999", b"#", b":root", b"}", b"{"),
)
"""Words at which programs break."""

_SEPARATORS = re.compile(rb"[\t,;= ]+|[\r\n]+")


def _replace_word(content: bytes, rng: Rng) -> bytes:
    """Replace what is between two separators."""
    places = [match.span() for match in _SEPARATORS.finditer(content)]
    if len(places) < 2:
        return content
    end = len(places) - 1 if rng.random() < 0.5 else min(40, len(places) - 1)  # often the header
    at = int(rng.integers(end))
    return content[: places[at][1]] + _pick(rng, WORDS) + content[places[at + 1][0] :]


def _drop_word(content: bytes, rng: Rng) -> bytes:
    places = [match.span() for match in _SEPARATORS.finditer(content)]
    if len(places) < 2:
        return content
    at = int(rng.integers(len(places) - 1))
    return content[: places[at][0]] + content[places[at + 1][0] :]


def _double_separator(content: bytes, rng: Rng) -> bytes:
    places = [match.span() for match in _SEPARATORS.finditer(content)]
    if not places:
        return content
    start, end = places[int(rng.integers(len(places)))]
    return content[:end] + content[start:end] + content[end:]


def _drop_line(content: bytes, rng: Rng) -> bytes:
    lines = content.splitlines(keepends=True)
    del lines[int(rng.integers(len(lines)))]
    return b"".join(lines)


def _double_line(content: bytes, rng: Rng) -> bytes:
    lines = content.splitlines(keepends=True)
    at = int(rng.integers(len(lines)))
    return b"".join([*lines[: at + 1], *lines[at:]])


def _swap_lines(content: bytes, rng: Rng) -> bytes:
    lines = content.splitlines(keepends=True)
    one, two = (int(rng.integers(len(lines))) for _ in range(2))
    lines[one], lines[two] = lines[two], lines[one]
    return b"".join(lines)


def _recode(content: bytes, rng: Rng) -> bytes:
    """Change line ends, separators or the encoding of a text."""
    text = content.decode("utf-8", "replace")
    ways = (
        lambda: text.replace("\r\n", "\n").replace("\n", "\r").encode(),
        lambda: text.replace("\n", "\n\n").encode(),
        lambda: text.replace("\t", ",").encode(),
        lambda: text.replace(",", ";").encode(),
        lambda: text.replace(".", ",").encode(),
        lambda: text.replace("\t", " ").encode(),
        lambda: b"\xef\xbb\xbf" + content,
        lambda: text.encode("utf-16"),
        lambda: re.sub(r"[^\t,\r\n]+", lambda cell: f'"{cell[0]}"', text).encode(),
    )
    return ways[int(rng.integers(len(ways)))]()


TEXT: tuple[Damage, ...] = (
    *RAW,
    *(_replace_word, _replace_word, _replace_word, _drop_word, _double_separator),
    *(_drop_line, _double_line, _swap_lines, _recode),
)


def _gappy() -> np.ndarray:
    positions = text_files.standing(FRAMES)
    positions[3:5, 2] = np.nan
    return positions


@cache
def _trc() -> tuple[bytes, ...]:
    return (
        text_files.trc(_gappy()),
        text_files.trc(_gappy(), newline="\n", trailing_tab=True, first=10),
        text_files.trc(_gappy() / 1000, unit="m", missing="nan", blank_line=False),
    )


@cache
def _nexus() -> tuple[bytes, ...]:
    return (
        text_files.nexus(_gappy()),
        text_files.nexus(_gappy(), delimiter=";", comma=True),
        text_files.nexus(_gappy(), delimiter="\t", first=100),
    )


@cache
def _qualisys() -> tuple[bytes, ...]:
    return (
        text_files.qualisys(_gappy()),
        text_files.qualisys(_gappy(), numbers=False, titles=False, missing=""),
        text_files.qualisys(_gappy(), trailing_tab=True, missing="NaN"),
    )


@cache
def _bids() -> tuple[bytes, ...]:
    columns = bids_files.columns_of(_gappy()) + bids_files.other_columns(len(_gappy()))
    return tuple(bids_files.motion_text(columns, missing=text).encode() for text in ("n/a", "NaN"))


@cache
def _bids_channels() -> tuple[bytes, ...]:
    columns = bids_files.columns_of(_gappy()) + bids_files.other_columns(len(_gappy()))
    return (bids_files.channels_text(columns).encode(),)


@cache
def _bids_json() -> tuple[bytes, ...]:
    fields = {"SamplingFrequency": 100, "SamplingFrequencyEffective": 99.5, "MissingValues": "-1"}
    return (json.dumps(fields, indent=1).encode(), json.dumps(fields).encode())


@cache
def _motive() -> tuple[bytes, ...]:
    return (
        text_files.motive(_gappy() / 1000),
        text_files.motive(_gappy() / 1000, timecode=True, body=False),
    )


def _arrays() -> dict[str, object]:
    return {
        "positions": _gappy(),
        "labels": np.array(text_files.LABELS),
        "rate": 100.0,
        "unit": "mm",
        "up": "+Z",
        "first_frame": 1,
        "filled": np.zeros((FRAMES, 6), dtype=bool),
    }


VALUES: tuple[object, ...] = (
    *(np.nan, np.inf, 0, -1, 1e300, -1e300, 1e-300, 2**63 - 1, "x", "", "a\x1b[31mb", b"\xff"),
    *(
        np.zeros(0),
        np.zeros((0, 6, 3)),
        np.zeros((1, 6, 3)),
        np.zeros((FRAMES, 18), dtype=np.uint8),
    ),
    *(np.zeros((FRAMES, 6, 3), dtype=complex), np.zeros((FRAMES, 6, 3), dtype="f2")),
    *(np.zeros((FRAMES, 6, 3), dtype=">f8"), np.asfortranarray(_gappy()), _gappy().T),
    *(np.zeros((6, 3)), np.zeros((3000, 3000), dtype=np.uint8), np.full((FRAMES, 6, 3), 1e12)),
    *(np.array(["a"] * 6), np.array(["a", "b"]), np.array([b"a\xff"] * 6), np.array(["x" * 9999])),
    *(np.array(["a\ud800", "=1+1", "[red]", "\u202e", "a\nb", "c"]), np.ones((FRAMES, 6))),
)
"""Values of variables at which programs break."""


def _changed(rng: Rng) -> dict[str, object]:
    """Return the arrays of a recording, some of them replaced."""
    arrays = _arrays()
    for _ in range(int(rng.integers(0, 3))):
        name = list(arrays)[int(rng.integers(len(arrays)))]
        if rng.random() < 0.2:
            del arrays[name]
        else:
            arrays[name] = VALUES[int(rng.integers(len(VALUES)))]
    if rng.random() < 0.1:
        arrays["more"] = np.array([{"a": 1}, None], dtype=object)
    return arrays


@cache
def _npz() -> tuple[bytes, ...]:
    file = io.BytesIO()
    np.savez_compressed(file, **_arrays())  # type: ignore[arg-type]
    return (file.getvalue(),)


def _other_arrays(content: bytes, rng: Rng) -> bytes:
    file = io.BytesIO()
    save = np.savez_compressed if rng.random() < 0.5 else np.savez
    save(file, **_changed(rng))  # type: ignore[arg-type]
    return file.getvalue()


def _damage_members(content: bytes, rng: Rng) -> bytes:
    """Damage the arrays of an archive, or what their headers say, under right checksums."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = [(info.filename, archive.read(info)) for info in archive.infolist()]
    except Exception:  # it is damaged already
        return content
    file = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        warnings.simplefilter("ignore")
        chosen = int(rng.integers(len(members) or 1))
        for number, (name, data) in enumerate(members):
            if number == chosen and data:
                damage = RAW[int(rng.integers(len(RAW)))]
                data = damage(data, rng) if rng.random() < 0.5 else _edit_header(data, rng)
            archive.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED)  # without the time
    return file.getvalue()


def _edit_header(data: bytes, rng: Rng) -> bytes:
    """Change the type or the shape of an array in its header, of equal length."""
    found = list(re.finditer(rb"'descr': '[^']*'|'shape': \([^)]*\)|False", data[:200]))
    if not found:
        return data
    one = found[int(rng.integers(len(found)))]
    new = _pick(rng, HEADER_WORDS).ljust(len(one[0]))
    end = data.index(b"}", one.end()) if b"}" in data[one.end() : 200] else one.end()
    spare = len(new) - len(one[0])
    return data[: one.start()] + new + data[one.end() : end + 1] + data[end + 1 + spare :]


HEADER_WORDS = (
    *(b"'descr': '<f8'", b"'descr': '|O'", b"'descr': '<U9'", b"'descr': '<c16'", b"True"),
    *(b"'descr': '<M8[s]'", b"'descr': 'f2'", b"'descr': '<U0'", b"'shape': (9999999999,)"),
    *(b"'shape': ()", b"'shape': (-1,)", b"'shape': (0, 6, 3)", b"'shape': (8, 6)", b"True"),
)


@cache
def _mat() -> tuple[bytes, ...]:
    cells = np.array(text_files.LABELS, dtype=object)[:, None]
    toolbox = {"type": "MoCap data", "freq": 100.0, "markerName": cells, "timederOrder": 0.0}
    data = np.concatenate([_gappy(), np.zeros((FRAMES, 6, 1))], axis=2).transpose(1, 2, 0)
    labelled = {"Labels": cells.T, "Data": data, "Count": 6}
    qtm = {"FrameRate": 100.0, "StartFrame": 1.0, "Trajectories": {"Labeled": labelled}}
    files = [
        _saved(_arrays(), False),
        _saved(_arrays() | {"labels": cells}, True),
        _saved({"d": toolbox | {"data": _gappy().reshape(FRAMES, 18)}}, False),
        _saved({"walk": qtm}, False),
    ]
    plain = {k: v for k, v in _arrays().items() if k not in ("positions", "filled")}
    file = io.BytesIO()
    savemat(file, plain | {"positions": _gappy().reshape(FRAMES, 18)}, format="4")
    return (*files, file.getvalue())


def _saved(variables: dict[str, object], compressed: bool) -> bytes:
    file = io.BytesIO()
    savemat(file, variables, do_compression=compressed)
    return file.getvalue()


def _other_variables(content: bytes, rng: Rng) -> bytes:
    variables = {
        key: np.zeros(3) if isinstance(value, np.ndarray) and value.dtype.kind == "S" else value
        for key, value in _changed(rng).items()
        if not (isinstance(value, str) and any(letter >= "\ud800" for letter in value))
    }
    variables.pop("more", None)
    try:
        return _saved({"s": variables} if rng.random() < 0.5 else variables, rng.random() < 0.5)
    except (UnicodeEncodeError, TypeError, ValueError):  # MATLAB has no such value
        return content


def _set_word(content: bytes, rng: Rng) -> bytes:
    """Set one of the words that hold types, sizes and shapes."""
    at = 128 + 4 * int(rng.integers(max(1, (len(content) - 128) // 4)))
    word = NUMBERS[int(rng.integers(len(NUMBERS)))]
    return content[:at] + (word % 2**32).to_bytes(4, "little") + content[at + 4 :]


NUMBERS = (0, 1, 2, 3, 4, 5, 6, 8, 9, 14, 15, 17, 255, 1000, 65536, 2**30, 2**31 - 1, -1, -8)


def _pack(content: bytes, rng: Rng) -> bytes:
    """Compress what follows the header."""
    packed = zlib.compress(content[128:])
    return content[:128] + (15).to_bytes(4, "little") + len(packed).to_bytes(4, "little") + packed


@cache
def _asf() -> tuple[bytes, ...]:
    return (skeleton_files.asf().encode(),)


@cache
def _amc() -> tuple[bytes, ...]:
    return (skeleton_files.amc(5).encode(),)


@cache
def _bvh() -> tuple[bytes, ...]:
    return (skeleton_files.bvh(5).encode(),)


@cache
def _marker_sets() -> tuple[bytes, ...]:
    folder = resource_path("markersets")
    return tuple(path.read_bytes() for path in sorted(folder.glob("*.toml")))


@cache
def _overrides() -> tuple[bytes, ...]:
    text = (
        '[[gap]]\nmarker = "LKNE"\nframes = "4:5"\ndo = "linear"\n'
        '[[gap]]\nmarker = ["C7", "L*"]\nframes = 2\ndo = "missing"\n'
        '[[gap]]\nmarker = "RTOE"\nsubject = "Ann"\ndo = "leave"\n'
    )
    chosen = (
        '[made_for]\nfile = "a.c3d"\nmethod = "linear"\n'
        '[[gap]]\nmarker = "LKNE"\nwith = "RKNE"\ndo = "swap"\nframes = "3:4"\n'
        '[[gap]]\nmarker = "C7"\ndo = "r1"\ndonors = ["LTOE", "RTOE", "LKNE"]\n'
        'sources = ["clip"]\noptions = { sigma = 80.0 }\n'
        '[[gap]]\nmarker = "R*"\ndo = "accept"\nnote = "seen"\n'
    )
    return text.encode(), chosen.encode()


@cache
def _joints() -> tuple[bytes, ...]:
    lines = ["[parts]", 'pelvis = "hip"', 'head = "head"', 'left_shank = "lShin"']
    return ("\n".join([*lines, 'right_shank = "rShin"', 'left_foot = "lFoot"', ""]).encode(),)


@cache
def _datasets() -> tuple[bytes, ...]:
    folder = resource_path("datasets")
    return tuple(path.read_bytes() for path in sorted(folder.glob("*.toml")))


def _use_recording(path: Path, content: bytes, rng: Rng) -> str:
    """Read, fill and write a recording; what was measured must stay."""
    path.write_bytes(content)
    is_recording(path)
    clip = read(path)
    result = fill(clip, method="linear", options=method_alone())
    out = path.with_name("out" + path.name.removeprefix("in"))
    write(out, result.clip, result.filled)
    try:
        again = read(out)
        same = again.positions.shape == clip.positions.shape
        if not same or not np.array_equal(
            again.positions[~result.filled], clip.positions[~result.filled], equal_nan=True
        ):
            raise AssertionError("a measured sample changed")
    except PriorfillError as error:
        raise AssertionError(f"the output cannot be read: {error}") from error
    finally:
        out.unlink()
    return "filled" if result.filled.any() else "read, nothing filled"


def _use_motion(path: Path, content: bytes, rng: Rng) -> str:
    return _use_dataset_files(path, content, _bids_channels()[0], _bids_json()[0], rng)


def _use_channels(path: Path, content: bytes, rng: Rng) -> str:
    return _use_dataset_files(path, _bids()[0], content, _bids_json()[0], rng)


def _use_motion_json(path: Path, content: bytes, rng: Rng) -> str:
    return _use_dataset_files(path, _bids()[0], _bids_channels()[0], content, rng)


def _use_dataset_files(
    path: Path, recording: bytes, channels: bytes, fields: bytes, rng: Rng
) -> str:
    """Fill a recording of Motion-BIDS with its side files."""
    side = {path.with_name("channels.tsv"): channels, path.with_name("motion.json"): fields}
    try:
        for other, content in side.items():
            other.write_bytes(content)
        return _use_recording(path, recording, rng)
    finally:
        for other in side:
            other.unlink(missing_ok=True)


def _use_asf(path: Path, content: bytes, rng: Rng) -> str:
    path.write_bytes(content)
    motion = path.with_suffix(".amc")
    motion.write_bytes(_amc()[0])
    return _use_skeleton(motion, path)


def _use_amc(path: Path, content: bytes, rng: Rng) -> str:
    path.write_bytes(content)
    skeleton = path.with_suffix(".asf")
    skeleton.write_bytes(_asf()[0])
    return _use_skeleton(path, skeleton)


def _use_skeleton(motion: Path, skeleton: Path) -> str:
    try:
        clip = read_amc(motion, read_asf(skeleton))
        compute_virtual_markers(clip, available()["baumann41"], name="a", file=str(motion))
    finally:
        motion.unlink()
        skeleton.unlink()
    return "markers placed"


def _use_bvh(path: Path, content: bytes, rng: Rng) -> str:
    path.write_bytes(content)
    motion = read_bvh(path)
    compute_virtual_markers(motion, available()["baumann41"], name="a", file=str(path))
    return "markers placed"


def _clip() -> Clip:
    return Clip(_gappy(), text_files.LABELS, 100.0, "+Z", "a", "Ann")


@cache
def _filled() -> Result:
    return fill(_clip(), method="linear")


@cache
def _errors(suffix: str) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder, f"errors{suffix}")
        write_uncertainty(path, _filled())
        return path.read_bytes()


def _other_provenance(content: bytes, rng: Rng) -> bytes:
    """Damage the text of a provenance, or one of its values."""
    with np.load(io.BytesIO(_errors(".npz"))) as archive:
        arrays = dict(archive)
    text = str(arrays["provenance"])
    if rng.random() < 0.5:
        values = json.loads(text)
        other = (None, 5, 1e308, "\x1b[31m", [], [5], {}, {"a": None}, True, "\u202e")
        values[list(values)[int(rng.integers(len(values)))]] = other[int(rng.integers(len(other)))]
        text = json.dumps(values)
    else:
        text = TEXT[int(rng.integers(len(TEXT)))](text.encode(), rng).decode("latin-1")
    file = io.BytesIO()
    np.savez(file, **arrays | {"provenance": np.array(text)})
    return file.getvalue()


def _use_errors(path: Path, content: bytes, rng: Rng) -> str:
    """Read expected errors, and make the data of a page of them."""
    path.write_bytes(content)
    page_data(result_from_clips([_clip()], [_filled().clip], read_uncertainty(path)))
    return "applied"


def _use_marker_set(path: Path, content: bytes, rng: Rng) -> str:
    path.write_bytes(content)
    fill(_clip(), method="linear", options=FillOptions(marker_set=load(path)))
    return "applied"


def _use_overrides(path: Path, content: bytes, rng: Rng) -> str:
    path.write_bytes(content)
    fill(_clip(), method="linear", overrides=read_overrides(path))
    return "applied"


def _use_joints(path: Path, content: bytes, rng: Rng) -> str:
    path.write_bytes(content)
    motion = parse_bvh(_bvh()[0], "a.bvh")
    names = read_joint_names(path)
    compute_virtual_markers(motion, available()["baumann41"], name="a", file="a.bvh", joints=names)
    return "applied"


def _use_dataset(path: Path, content: bytes, rng: Rng) -> str:
    path.write_bytes(content)
    dataset = find_dataset(str(path))
    dataset.subject("HDM_bd_05-01_01_120.c3d")
    dataset.subject("a" * 60 + "\udcff")
    return "applied"


KINDS: dict[str, Kind] = {
    "trc": Kind(".trc", _trc, TEXT, _use_recording),
    "nexus": Kind(".csv", _nexus, TEXT, _use_recording),
    "qualisys": Kind(".tsv", _qualisys, TEXT, _use_recording),
    "motive": Kind(".csv", _motive, TEXT, _use_recording),
    "bids": Kind("_motion.tsv", _bids, TEXT, _use_motion),
    "bids channels": Kind("_motion.tsv", _bids_channels, TEXT, _use_channels),
    "bids json": Kind("_motion.tsv", _bids_json, TEXT, _use_motion_json),
    "npz": Kind(".npz", _npz, (*RAW, *[_damage_members] * 5, *[_other_arrays] * 4), _use_recording),
    "mat": Kind(
        ".mat", _mat, (*RAW, *[_set_word] * 5, *[_other_variables] * 2, _pack), _use_recording
    ),
    "asf": Kind(".asf", _asf, TEXT, _use_asf),
    "amc": Kind(".amc", _amc, TEXT, _use_amc),
    "bvh": Kind(".bvh", _bvh, TEXT, _use_bvh),
    "marker set": Kind(".toml", _marker_sets, TEXT, _use_marker_set),
    "overrides": Kind(".toml", _overrides, TEXT, _use_overrides),
    "joints": Kind(".toml", _joints, TEXT, _use_joints),
    "errors": Kind(".csv", lambda: (_errors(".csv"),), TEXT, _use_errors),
    "errors npz": Kind(
        ".npz",
        lambda: (_errors(".npz"),),
        (*RAW, *[_damage_members] * 5, *[_other_provenance] * 8),
        _use_errors,
    ),
    "data set": Kind(".toml", _datasets, TEXT, _use_dataset),
}


def mutate(kind: str, seed: int, number: int) -> bytes:
    """Return the damaged file of a kind, a seed and a number."""
    rng = np.random.default_rng((seed, number))
    whole, damages = KINDS[kind].whole(), KINDS[kind].damages
    content = whole[int(rng.integers(len(whole)))]
    for _ in range(min(int(rng.geometric(0.6)), MAX_MUTATIONS)):
        if content:
            content = damages[int(rng.integers(len(damages)))](content, rng)
    return content


def run_case(case: Case) -> tuple[str, float]:
    """Use a damaged file; return how it ended, and the processor time (s)."""
    kind, folder = KINDS[case.kind], Path(case.folder)
    content = mutate(case.kind, case.seed, case.number)
    rng = np.random.default_rng((case.seed, case.number, 1))
    path = folder / f"in{kind.suffix}"
    start = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            end = kind.use(path, content, rng)
    except PriorfillError as error:
        end = "refused"
        if any(unicodedata.category(c) in ("Cc", "Cf", "Cs", "Zl", "Zp") for c in str(error)):
            raise AssertionError(f"a message with control characters: {error!r}") from error
    seconds = time.process_time() - start
    path.unlink(missing_ok=True)
    left = [other.name for other in folder.iterdir()]
    if left:
        raise AssertionError(f"files are left behind: {left}")
    return f"{case.kind}: {end}", seconds


def fuzz(
    count: int,
    seed: int,
    *,
    minutes: float = float("inf"),
    keep: Path | None = None,
    kinds: Sequence[str] = tuple(KINDS),
) -> Tally:
    """Run cases, in turn of each kind."""

    def save(case: Case) -> None:
        if keep is not None:
            name = f"{case.kind.replace(' ', '_')}-{case.seed}-{case.number}"
            content = mutate(case.kind, case.seed, case.number)
            (keep / f"{name}{KINDS[case.kind].suffix}").write_bytes(content)

    return run_cases(
        run_case,
        lambda number, folder: Case(seed, number, folder, kinds[number % len(kinds)]),
        count,
        save,
        minutes=minutes,
        preload=PRELOADED,
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Damage files and see."""
    parser = fuzz_parser(__doc__)
    parser.add_argument("--kinds", default=",".join(KINDS), help="some of the kinds")
    options = parser.parse_args(arguments)
    kinds = options.kinds.split(",")
    if unknown := [kind for kind in kinds if kind not in KINDS]:
        parser.error(f"kind {unknown[0]} is unknown; use some of {', '.join(KINDS)}")
    if options.keep is not None:
        options.keep.mkdir(parents=True, exist_ok=True)
    start = time.monotonic()
    tally = fuzz(
        options.count, options.seed, minutes=options.minutes, keep=options.keep, kinds=kinds
    )
    tally.show(time.monotonic() - start)
    return int(bool(tally.faults))


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
