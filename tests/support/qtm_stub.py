"""A stub of the QTM Scripting Interface (2024.2 to 2026.2) that behaves as documented.

Ranges are dictionaries that include their end, samples are dictionaries or None, parts have types,
and wrong arguments raise RuntimeError or TypeError.
"""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from itertools import pairwise
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from priorfill.clip import Clip

Sample = dict[str, Any]

MEASURED_RESIDUAL = 0.75


class Trajectory:
    """Samples of a trajectory by index, and the type of each."""

    def __init__(self, label: str | None) -> None:
        self.label = label
        self.discarded = False
        self.samples: dict[int, Sample] = {}
        self.types: dict[int, str] = {}


class Measurement:
    """An open measurement, the state behind the stub.

    Attributes
    ----------
    writes : list of tuple
        Every call of ``set_samples``: label, first and last index.
    before_get, before_set : callable
        Called with the label: what the user does meanwhile, or an exception.
    """

    def __init__(self, clip: Clip, start: int = 0, selected: tuple[int, int] | None = None) -> None:
        self.path: str | None = "C:\\Users\\lab\\Project\\Data\\Gång 01.qtm"
        self.rate = clip.rate
        self.measured = {"start": start, "end": start + clip.frames - 1}
        first, last = selected or (start, start + clip.frames - 1)
        self.selected = {"start": first, "end": last}
        self.trajectories: dict[int, Trajectory] = {}
        self.writes: list[tuple[str | None, int, int]] = []
        self.terminal: list[str] = []
        self.messages: list[tuple[str, str, str]] = []
        self.commands: dict[str, Callable[[], None] | None] = {"save_file_as": None}
        self.menus: list[dict[str, Any]] = [{"text": "&File", "command": None, "submenu": 7}]
        self.buttons: list[tuple[int, str, str]] = []
        self.before_get: Callable[[str | None], None] = lambda label: None
        self.before_set: Callable[[str | None], None] = lambda label: None
        for k, label in enumerate(clip.labels):
            self.add(label, clip.positions[:, k], 106038 + 5 * k)
        self.add(None, clip.positions[:, 0], 99)  # unidentified

    def add(self, label: str | None, positions: np.ndarray, number: int) -> Trajectory:
        """Add a measured trajectory."""
        made = Trajectory(label)
        for frame in np.flatnonzero(~np.isnan(positions[:, 0])).tolist():
            index = self.measured["start"] + frame
            made.samples[index] = {
                "position": positions[frame].tolist(),
                "residual": MEASURED_RESIDUAL,
            }
            made.types[index] = "measured"
        self.trajectories[number] = made
        return made

    def find(self, label: str) -> Trajectory:
        """The trajectory of a label."""
        return next(one for one in self.trajectories.values() if one.label == label)

    def clip(self, like: Clip) -> np.ndarray:
        """Positions in the order of a clip; NaN where there is no sample."""
        positions = np.full(like.positions.shape, np.nan)
        for k, label in enumerate(like.labels):
            for index, sample in self.find(label).samples.items():
                positions[index - self.measured["start"], k] = sample["position"]
        return positions


def scripting_interface(state: Measurement) -> SimpleNamespace:
    """The functions of the module ``qtm`` that exist in all versions from 2024.2 on."""

    def of(number: int) -> Trajectory:
        if type(number) is not int or number not in state.trajectories:
            raise RuntimeError(f"invalid identifier {number}")
        return state.trajectories[number]

    def indices(span: dict[str, int]) -> range:
        if set(span) != {"start", "end"} or any(type(v) is not int for v in span.values()):
            raise TypeError(f"expected a range, got {span}")
        if not 0 <= span["start"] <= span["end"] <= state.measured["end"]:
            raise RuntimeError(f"range {span} is out of bounds")
        return range(span["start"], span["end"] + 1)

    def get_samples(number: int, span: dict[str, int] | None = None) -> list[Sample | None]:
        one = of(number)
        state.before_get(one.label)
        found = [one.samples.get(i) for i in indices(span or state.measured)]
        return [None if sample is None else _copied(sample) for sample in found]

    def set_samples(number: int, span: dict[str, int], samples: list[Sample | None]) -> None:
        one = of(number)
        state.before_set(one.label)
        places = indices(span)
        if type(samples) is not list or len(samples) != len(places):
            raise RuntimeError("the number of samples differs from the range")
        for sample in samples:
            if sample is not None:
                position, residual = sample["position"], sample["residual"]
                if type(position) is not list or [type(v) for v in position] != [float] * 3:
                    raise TypeError("expected a vec3f")
                if type(residual) is not float or not np.isfinite(position).all():
                    raise TypeError("expected finite floats")
        state.writes.append((one.label, span["start"], span["end"]))
        for index, sample in zip(places, samples, strict=True):
            one.samples.pop(index, None)
            one.types.pop(index, None)
            if sample is not None:
                one.samples[index] = _copied(sample)
                one.types[index] = "virtual"

    def ranges(there: dict[int, Any], kind: Callable[[int], Any]) -> list[tuple[int, int]]:
        found: list[list[int]] = []
        for index in sorted(there):
            if found and found[-1][1] == index - 1 and kind(index) == kind(index - 1):
                found[-1][1] = index
            else:
                found.append([index, index])
        return [(first, last) for first, last in found]

    def get_gap_ranges(number: int) -> list[dict[str, int]]:
        spans = ranges(of(number).samples, lambda index: True)
        return [{"start": last + 1, "end": first - 1} for (_, last), (first, _) in pairwise(spans)]

    def get_parts(number: int) -> list[dict[str, Any]]:
        one = of(number)
        return [
            {"range": {"start": first, "end": last}, "type": one.types[first]}
            for first, last in ranges(one.samples, lambda index: one.types[index])
        ]

    def add_command(command: str) -> None:
        if command in state.commands:
            raise RuntimeError(f"command {command} exists")
        state.commands[command] = lambda: None

    def set_execute(command: str, function: Callable[[], None] | None) -> None:
        if state.commands.get(command) is None:
            raise RuntimeError(f"{command} is no user command")
        state.commands[command] = function

    def insert_submenu(menu: int | None, text: str, index: int | None = None) -> int:
        state.menus.append({"text": text, "command": None, "submenu": 12345})
        return 12345

    def insert_button(menu: int | None, text: str, command: str, index: int | None = None) -> None:
        if command not in state.commands:
            raise RuntimeError(f"there is no command {command}")
        assert menu is not None
        state.buttons.append((menu, text, command))

    def get_measured_range() -> dict[str, int]:
        if not state.trajectories:
            raise RuntimeError("no measurement is open")
        return dict(state.measured)

    return SimpleNamespace(
        data=SimpleNamespace(
            series=SimpleNamespace(
                _3d=SimpleNamespace(
                    get_samples=get_samples,
                    set_samples=set_samples,
                    get_gap_ranges=get_gap_ranges,
                    get_frequency=lambda number: of(number) and state.rate,
                )
            ),
            object=SimpleNamespace(
                trajectory=SimpleNamespace(
                    get_trajectory_ids=lambda: list(state.trajectories),
                    get_label=lambda number: of(number).label,
                    get_parts=get_parts,
                    get_is_discarded=lambda number: of(number).discarded,
                )
            ),
        ),
        gui=SimpleNamespace(
            timeline=SimpleNamespace(
                get_measured_range=get_measured_range,
                get_selected_range=lambda: dict(state.selected),
                get_frequency=lambda: state.rate,
            ),
            terminal=SimpleNamespace(write=state.terminal.append),
            message=SimpleNamespace(add_message=lambda *texts: state.messages.append(texts)),
            get_commands=lambda kind=None: list(state.commands),
            add_command=add_command,
            set_command_execute_function=set_execute,
            get_menu_items=lambda menu=None: list(state.menus),
            insert_menu_submenu=insert_submenu,
            insert_menu_button=insert_button,
        ),
        file=SimpleNamespace(get_path=lambda: state.path),  # since 2025.1
    )


def _copied(sample: Sample) -> Sample:
    return {"position": list(sample["position"]), "residual": sample["residual"]}


def install(monkeypatch: pytest.MonkeyPatch, state: Measurement) -> None:
    """Make ``qtm`` importable."""
    module = ModuleType("qtm")
    vars(module).update(vars(scripting_interface(state)))
    monkeypatch.setitem(sys.modules, "qtm", module)


@contextmanager
def served(state: Measurement) -> Iterator[int]:
    """Serve the stub over REST on this computer; yield the port."""
    interface = scripting_interface(state)

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            found: Any = interface
            try:
                prefix, _, path = self.path.partition("/api/scripting/qtm/")
                assert not prefix
                for name in path.strip("/").split("/"):
                    found = getattr(found, name)
                length = int(self.headers["Content-Length"])
                status, answer = 200, json.dumps(found(*json.loads(self.rfile.read(length))))
            except Exception as error:
                status, answer = 400, f"{type(error).__name__}: {error}"
            self.send_response(status)
            self.send_header("Content-Length", str(len(answer.encode())))
            self.end_headers()
            self.wfile.write(answer.encode())

        def log_message(self, *arguments: Any) -> None:
            pass

    server = HTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield server.server_port
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
