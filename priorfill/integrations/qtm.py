"""Fill the measurement that is open in Qualisys Track Manager (QTM).

The calls follow the QTM Scripting Interface, versions 2024.2 to 2026.2
(https://qualisys.github.io/qtm-scripting/ and https://github.com/qualisys/qtm-scripting):

* sample indices of ``_3d`` and of the timeline count from 0 at the start of the capture, ranges
  include their end, positions are in mm;
* ``_3d.get_samples(id, range)`` returns ``{"position", "residual"}`` for each sample, or None where
  there is none;
* ``_3d.get_gap_ranges(id)`` returns the ranges without samples;
* ``_3d.set_samples(id, range, samples)`` replaces exactly the samples of a range; None deletes one;
* computed samples get the residual 0, as in Qualisys' own scripts;
* a trajectory whose label is None is unidentified, and is not read.

Not confirmed by the documentation: whether ``get_gap_ranges`` includes the ends of the
measurement, so gaps inside a trajectory must be in both this list and the samples; the type
(measured, filled, virtual) that QTM gives parts that were set; whether frame numbers in the window
are sample indices plus 1, as in exports, which tables assume. All calls of the interface are in
`QtmMeasurement` and `add_menu`.

The interface is either the module ``qtm`` inside QTM (`open_qtm`), or its REST counterpart
(`priorfill.integrations.qtm_rest`).
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path, PureWindowsPath
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import IntegrationError, OptionError, PriorfillError
from priorfill.filling.fill_options import FillKeywords
from priorfill.gaps import runs
from priorfill.integrations.answers import asking
from priorfill.integrations.open_trial import TrialOptions, fill_trial
from priorfill.integrations.trial_report import report_lines

__all__ = ["QtmMeasurement", "add_menu", "open_qtm"]

_NUMBERED_FROM = 1
"""Number of the frame with index 0, in exports of QTM."""

_RESIDUAL = 0.0
"""Residual (mm) of computed samples."""

_MEASURED = "measured"
"""Type of a part that cameras have measured; others are filled, virtual, or of later versions."""

_MENU = "priorfill"
_BUTTONS = {
    "priorfill_fill_gaps": ("Fill gaps", False),
    "priorfill_preview_gaps": ("Preview (set nothing)", True),
}
"""Text of the button of each command, and whether nothing is to be set."""


def open_qtm() -> QtmMeasurement:
    """Return the measurement that is open in QTM, from a script that QTM runs.

    Returns
    -------
    QtmMeasurement
        For `priorfill.integrations.open_trial.fill_trial`.

    Raises
    ------
    IntegrationError
        Where the script does not run in QTM, or no measurement is open.

    See Also
    --------
    add_menu : A menu in QTM.
    priorfill.integrations.open_trial.fill_trial : Fill the measurement.

    Examples
    --------
    >>> open_qtm().name  # doctest: +SKIP
    'Walk 01'
    """
    return QtmMeasurement(_embedded())


def _embedded() -> Any:
    """Return the module ``qtm``, which exists inside QTM only."""
    try:
        api = importlib.import_module("qtm")
    except ImportError as error:
        raise IntegrationError(
            f"the module of QTM cannot be imported ({error}); run this in QTM, or `priorfill qtm` "
            "next to it (docs/qtm.md)"
        ) from error
    if not hasattr(api, "data"):
        raise IntegrationError(
            "the module `qtm` is not that of QTM, but the streaming package of that name; run this "
            "in QTM, or `priorfill qtm` next to it (docs/qtm.md)"
        )
    return api


class QtmMeasurement:
    """The measurement that is open in QTM: all calls that read and set samples are here.

    Parameters
    ----------
    api : module qtm, or object with the same functions
        The scripting interface.

    Raises
    ------
    IntegrationError
        Where no measurement is open.

    See Also
    --------
    priorfill.integrations.open_trial.OpenTrial : What the methods do.

    Examples
    --------
    >>> import qtm  # doctest: +SKIP
    >>> QtmMeasurement(qtm).markers(())  # doctest: +SKIP
    [('', ['Q_HeadL', 'Q_HeadR'])]
    """

    program = "QTM"
    gaps_only = True

    @asking("QTM", "the open measurement")
    def __init__(self, api: Any) -> None:
        self._api = api
        self.notes: list[str] = []
        self._path, start, end = self._state()
        self.name = PureWindowsPath(self._path).stem or "measurement"
        self._start = start
        self.frames = end - start + 1
        self.first_frame = start + _NUMBERED_FROM
        self._ids: dict[str, int] = {}
        selected = api.gui.timeline.get_selected_range()
        first, last = max(int(selected["start"]), start), min(int(selected["end"]), end)
        first, last = (first, last) if first <= last else (start, end)
        self.selected = (first + _NUMBERED_FROM, last + _NUMBERED_FROM)
        self.rate = float(api.gui.timeline.get_frequency())

    def _state(self) -> tuple[str, int, int]:
        """Return path, and first and last sample index of the open measurement."""
        try:
            measured = self._api.gui.timeline.get_measured_range()
            start, end = int(measured["start"]), int(measured["end"])
        except PriorfillError:
            raise
        except Exception as error:
            raise IntegrationError(
                f"QTM has no measurement open ({error}); open a captured file"
            ) from error
        if end < start:
            raise IntegrationError("QTM has no measurement open; open a captured file")
        return str(_optional(lambda: self._api.file.get_path(), "") or ""), start, end

    def check_same(self) -> None:
        """Raise IntegrationError unless QTM still has the measurement open."""
        now = self._state()
        if now != (self._path, self._start, self._start + self.frames - 1):
            raise IntegrationError(
                f"QTM has another measurement or range open than {self.name}, which was filled; "
                "nothing was set"
            )

    @asking("QTM", "its trajectories")
    def markers(self, subjects: Sequence[str]) -> list[tuple[str, list[str]]]:
        """Return the labels of all trajectories that are identified and not discarded.

        Parameters
        ----------
        subjects : sequence of str
            Must be empty: QTM has no subjects.

        Raises
        ------
        OptionError
            Where it is not.
        IntegrationError
            Where two trajectories have the same label, or another frequency than the timeline.
        """
        if subjects:
            raise OptionError("QTM has no subjects; leave `subject` out, and use `markers`")
        trajectory, series = self._api.data.object.trajectory, self._api.data.series._3d
        ids: dict[str, int] = {}
        computed: list[str] = []
        for number in trajectory.get_trajectory_ids():
            label = trajectory.get_label(number)
            if label is None or self._is_discarded(number):
                continue
            if label in ids:
                raise IntegrationError(
                    f"{self.name}: two trajectories are called {label}; rename or join them"
                )
            if float(series.get_frequency(number)) != self.rate:
                raise IntegrationError(
                    f"{self.name}: {label} has {series.get_frequency(number):g} Hz, the timeline "
                    f"{self.rate:g} Hz"
                )
            ids[str(label)] = int(number)
            if any(part["type"] != _MEASURED for part in trajectory.get_parts(number)):
                computed.append(str(label))
        self._ids = ids
        if computed:
            self.notes = [
                f"samples of {', '.join(computed)} that QTM has filled or computed are taken as "
                "measured"
            ]
        return [("", list(ids))]

    def _is_discarded(self, number: int) -> bool:
        """Return whether a trajectory is discarded; no version before 2024.2 can."""
        return bool(
            _optional(lambda: self._api.data.object.trajectory.get_is_discarded(number), False)
        )

    @asking("QTM", "the samples of a trajectory")
    def read(self, subject: str, marker: str) -> NDArray[np.float64]:
        """Return the positions of a trajectory [shape=(frames, 3), mm]; NaN where missing.

        Raises
        ------
        IntegrationError
            Where the trajectory has lost its label, or there is not an entry for each frame.
        """
        number = self._ids[marker]
        if self._api.data.object.trajectory.get_label(number) != marker:
            raise IntegrationError(f"{self.name}: {marker} was renamed or deleted in QTM")
        samples = self._api.data.series._3d.get_samples(number, self._range(0, self.frames))
        if len(samples) != self.frames:
            raise IntegrationError(
                f"{self.name}: QTM returned {len(samples)} samples of {marker} for "
                f"{self.frames} frames"
            )
        positions = np.full((self.frames, 3), np.nan)
        for frame, sample in enumerate(samples):
            if sample is not None and sample.get("position") is not None:
                x, y, z = sample["position"]  # a single number would be taken for all three
                positions[frame] = x, y, z
        positions[~np.isfinite(positions).all(axis=1)] = np.nan
        return positions

    def set_filled(
        self,
        subject: str,
        marker: str,
        positions: NDArray[np.float64],
        filled: NDArray[np.bool_],
    ) -> None:
        """Set the filled samples, a call for each run of frames.

        Parameters
        ----------
        subject, marker : str
            The trajectory.
        positions : ndarray [shape=(frames, 3), mm]
            All samples.
        filled : ndarray of bool [shape=(frames,)]
            Which of them are set.

        Raises
        ------
        IntegrationError
            Where QTM does not list these frames as gaps.
        """
        number, series = self._ids[marker], self._api.data.series._3d
        self._check_gaps(marker, positions, filled)
        for start, stop in runs(filled):
            samples = [
                {"position": position, "residual": _RESIDUAL}
                for position in positions[start:stop].tolist()
            ]
            series.set_samples(number, self._range(start, stop), samples)

    def take_back(
        self,
        subject: str,
        marker: str,
        measured: NDArray[np.float64],
        filled: NDArray[np.bool_],
    ) -> None:
        """Delete the filled samples again."""
        for start, stop in runs(filled):
            self._api.data.series._3d.set_samples(
                self._ids[marker], self._range(start, stop), [None] * (stop - start)
            )

    def _range(self, start: int, stop: int) -> dict[str, int]:
        """Return frames ``start <= frame < stop`` of the clip as a range of sample indices."""
        return {"start": self._start + start, "end": self._start + stop - 1}

    def _check_gaps(
        self, marker: str, positions: NDArray[np.float64], filled: NDArray[np.bool_]
    ) -> None:
        """Raise IntegrationError where frames inside a trajectory are no gap in QTM."""
        gaps = np.zeros(self.frames, dtype=bool)
        for gap in self._api.data.series._3d.get_gap_ranges(self._ids[marker]):
            first = max(int(gap["start"]) - self._start, 0)
            gaps[first : max(int(gap["end"]) - self._start + 1, 0)] = True
        present = np.flatnonzero(~np.isnan(positions[:, 0]) & ~filled)
        inside = np.zeros(self.frames, dtype=bool)
        if present.size:  # whether QTM lists the ends of the measurement is not documented
            inside[present[0] : present[-1]] = True
        wrong = np.flatnonzero(filled & inside & ~gaps)
        if wrong.size:
            raise IntegrationError(
                f"QTM does not list frame {self.first_frame + int(wrong[0])} of {marker} as a gap"
            )


def add_menu(
    database: Path | str | None = None,
    trial_options: TrialOptions | None = None,
    **arguments: Unpack[FillKeywords],
) -> None:
    r"""Add a menu to QTM that fills the gaps of the open measurement.

    For a script file of a QTM project. Reloading the scripts (F5) does not add it twice.

    Parameters
    ----------
    database : Path or str, optional
        Folder of the prior database to learn from.
    trial_options : TrialOptions, optional
        Up axis, range and files.
    **arguments
        ``method``, ``gap_filter``, ``overrides`` and ``options`` of `priorfill.fill`.

    Raises
    ------
    IntegrationError
        Where the script does not run in QTM.

    See Also
    --------
    open_qtm : The open measurement.

    Examples
    --------
    >>> add_menu(database=r"D:\lab-priors")  # doctest: +SKIP
    """
    gui = _embedded().gui
    options = trial_options or TrialOptions()
    commands = gui.get_commands()
    for command, (_, preview) in _BUTTONS.items():
        if command not in commands:
            gui.add_command(command)
        own = options if not preview else _previewing(options)
        gui.set_command_execute_function(command, partial(_run, database, own, arguments))
    menus = [item for item in gui.get_menu_items() if item and item.get("text") == _MENU]
    if menus:
        return
    menu = gui.insert_menu_submenu(None, _MENU)
    for command, (text, _) in _BUTTONS.items():
        gui.insert_menu_button(menu, text, command)


def _previewing(options: TrialOptions) -> TrialOptions:
    """Return options that set nothing."""
    return TrialOptions(options.subject, options.up, options.whole_trial, dry_run=True)


def _run(database: Path | str | None, options: TrialOptions, arguments: FillKeywords) -> None:
    """Fill the open measurement and report in the terminal and the messages of QTM."""
    api = _embedded()
    try:
        done = fill_trial(
            QtmMeasurement(api), trial_options=options, database=database, **arguments
        )
    except (PriorfillError, OSError) as error:
        text = str(error)
        api.gui.terminal.write(f"priorfill: {text}\n")
        _optional(lambda: api.gui.message.add_message("priorfill failed", text, "error"), None)
        return
    lines = report_lines(done)
    for line in lines:
        api.gui.terminal.write(f"{line}\n")
    kind = "info" if done.result.complete else "warning"
    _optional(
        lambda: api.gui.message.add_message(f"priorfill: {lines[-1]}", "\n".join(lines), kind), None
    )


def _optional(call: Callable[[], Any], default: Any) -> Any:
    """Return what a function of some versions of QTM returns, or a default where it is not there.

    What a version does not have is an AttributeError in the module and an error of REST.
    """
    try:
        return call()
    except Exception:
        return default
