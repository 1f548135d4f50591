"""Fill the trial that is open in Vicon Nexus.

The calls follow the Nexus API 1.0.3, the Python package ``viconnexusapi`` that comes with Nexus
2.12 and later, as documented in its own docstrings (published with pyCGM2 4.2,
https://pycgm2.readthedocs.io/en/version4.2.0/Pages/thirdParty/NexusAPI.html):

* the constructor connects to Nexus on the same computer, and raises OSError if it is not running;
* ``GetTrajectory(subject, marker)`` returns lists x, y, z (mm) and exists of all frames of the
  trial, whatever the region of interest; where ``exists`` is false, coordinates have no meaning;
* ``SetTrajectory(subject, marker, x, y, z, exists)`` replaces all frames of a marker. It changes
  the lists that it is given, and sets a sample with NaN to zeros and not existing;
* most functions report an error on stderr instead of raising it, so what was set is read again;
* ``SaveTrial`` cannot be called from a script that Nexus runs; this module never saves.

Not confirmed by the documentation: that the first entry of the lists is the first frame of
``GetTrialRange`` where the trial does not start at frame 1 (pyCGM2 relies on it). Lists of another
length than the trial are refused. All calls of the API are in `NexusTrial`.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import IntegrationError, OptionError
from priorfill.integrations.answers import asking
from priorfill.runtime.option_texts import close_or_all

__all__ = ["NexusTrial", "open_nexus"]

_WHERE = r"C:\Program Files\Vicon\Nexus2.x\SDK\Win64\Python"
r"""Where Nexus keeps its package; older versions in ``C:\Program Files (x86)``."""


def open_nexus(host: str = "localhost") -> NexusTrial:
    """Connect to Nexus and return the trial that it has open.

    Parameters
    ----------
    host : str
        The computer that runs Nexus.

    Returns
    -------
    NexusTrial
        For `priorfill.integrations.open_trial.fill_trial`.

    Raises
    ------
    IntegrationError
        Where the package of Nexus is not installed, Nexus is not running, or has no trial open.

    See Also
    --------
    priorfill.integrations.open_trial.fill_trial : Fill the trial.

    Examples
    --------
    >>> open_nexus().name  # doctest: +SKIP
    'Walk 01'
    """
    try:
        api = importlib.import_module("viconnexusapi.ViconNexus")
    except ModuleNotFoundError as error:
        raise IntegrationError(
            f"the Python package of Nexus cannot be imported ({error}); install it into the Python "
            f'that runs priorfill: in "{_WHERE}", run `python -m pip install ./viconnexusapi` '
            "(docs/nexus.md)"
        ) from error
    except ImportError as error:
        raise IntegrationError(
            f"the Python package of Nexus does not work with this version of Python ({error}); use "
            "a version that it supports (docs/nexus.md)"
        ) from error
    try:
        # older versions take no host
        vicon = api.ViconNexus() if host == "localhost" else api.ViconNexus(host)
    except Exception as error:
        raise IntegrationError(
            f"Nexus cannot be reached ({error}); start it on {host} and open a trial"
        ) from error
    return NexusTrial(vicon)


class NexusTrial:
    """The trial that is open in Nexus: all calls of the Nexus API are here.

    Parameters
    ----------
    vicon : viconnexusapi.ViconNexus.ViconNexus
        A connection.

    Raises
    ------
    IntegrationError
        Where Nexus has no trial open, or describes it in a way that is not documented.

    See Also
    --------
    priorfill.integrations.open_trial.OpenTrial : What the methods do.

    Examples
    --------
    >>> trial = NexusTrial(ViconNexus.ViconNexus())  # doctest: +SKIP
    >>> trial.markers(())  # doctest: +SKIP
    [('Anna', ['LASI', 'RASI'])]
    """

    program = "Nexus"
    gaps_only = False

    @asking("Nexus", "the open trial")
    def __init__(self, vicon: Any) -> None:
        self._vicon = vicon
        self.notes: list[str] = []
        self._folder, self.name, self.frames, self.first_frame = self._state()
        self.rate = float(vicon.GetFrameRate())
        whole = (self.first_frame, self.first_frame + self.frames - 1)
        first, last = (int(frame) for frame in vicon.GetTrialRegionOfInterest())
        first, last = max(first, whole[0]), min(last, whole[1])
        self.selected = (first, last) if first <= last else whole

    def _state(self) -> tuple[str, str, int, int]:
        """Return folder, name, number of frames and first frame of the open trial."""
        folder, name = (str(text) for text in self._vicon.GetTrialName())
        frames = int(self._vicon.GetFrameCount())
        if not name or frames < 1:
            raise IntegrationError("Nexus has no trial open; open one and load its data")
        first, last = (int(frame) for frame in self._vicon.GetTrialRange())
        if last - first + 1 != frames:
            if frames < last:
                raise IntegrationError(
                    f"{name}: Nexus reports {frames} frames in the range {first}-{last}; their "
                    "numbers are not clear, so nothing is done"
                )
            first = 1  # the range is a part of the trial, whose frames are counted from 1
        return folder, name, frames, first

    @asking("Nexus", "the open trial")
    def check_same(self) -> None:
        """Raise IntegrationError unless Nexus still has the trial open."""
        known = (self._folder, self.name, self.frames, self.first_frame)
        now = self._state()
        if now != known:
            raise IntegrationError(
                f"Nexus has {now[1]} open ({now[2]} frames), not {self.name} ({self.frames} "
                "frames), which was filled; nothing was set"
            )

    @asking("Nexus", "subjects and markers")
    def markers(self, subjects: Sequence[str]) -> list[tuple[str, list[str]]]:
        """Return subjects with the labels of their markers.

        Parameters
        ----------
        subjects : sequence of str
            Names of subjects; if empty, those that are ticked in Nexus.

        Raises
        ------
        OptionError
            Where the trial does not have such a subject.
        IntegrationError
            Where it has none, or none is ticked.
        """
        known = [str(name) for name in self._vicon.GetSubjectNames()]
        if not known:
            raise IntegrationError(f"{self.name}: has no subject; label the trial first")
        for name in subjects:
            if name not in known:
                raise OptionError(
                    f"{self.name}: has no subject {name!r}; {close_or_all(name, known)}"
                )
        chosen = list(dict.fromkeys(subjects)) or self._active(known)
        if not chosen:
            raise IntegrationError(
                f"{self.name}: none of its subjects ({', '.join(known)}) is ticked in Nexus; tick "
                "one, or name it (`subject`)"
            )
        return [
            (name, [str(label) for label in self._vicon.GetMarkerNames(name)]) for name in chosen
        ]

    def _active(self, known: list[str]) -> list[str]:
        """Return the subjects that are ticked in Nexus; all before version 2.6, which has none."""
        if not hasattr(self._vicon, "GetSubjectInfo"):
            return known
        names, _, active = self._vicon.GetSubjectInfo()
        return [str(name) for name, ticked in zip(names, active, strict=True) if ticked]

    @asking("Nexus", "the samples of a marker")
    def read(self, subject: str, marker: str) -> NDArray[np.float64]:
        """Return the positions of a marker [shape=(frames, 3), mm]; NaN where it does not exist.

        Raises
        ------
        IntegrationError
            Where the lists have another length than the trial.
        """
        x, y, z, exists = self._vicon.GetTrajectory(subject, marker)
        if not len(x) and not len(exists):  # a marker that was never labelled in this trial
            return np.full((self.frames, 3), np.nan)
        lengths = {len(x), len(y), len(z), len(exists)}
        if lengths != {self.frames}:
            raise IntegrationError(
                f"{self.name}: Nexus returned {sorted(lengths)} samples of {marker} of {subject} "
                f"for {self.frames} frames"
            )
        positions = np.column_stack([np.asarray(one, dtype=np.float64) for one in (x, y, z)])
        positions[~np.asarray(exists, dtype=bool)] = np.nan
        positions[~np.isfinite(positions).all(axis=1)] = np.nan
        return positions

    def set_filled(
        self,
        subject: str,
        marker: str,
        positions: NDArray[np.float64],
        filled: NDArray[np.bool_],
    ) -> None:
        """Set a marker: samples that are present exist, the others are zeros that do not.

        Parameters
        ----------
        subject, marker : str
            The marker.
        positions : ndarray [shape=(frames, 3), mm]
            All samples; NaN where still missing.
        filled : ndarray of bool [shape=(frames,)]
            Which are filled; not needed, because Nexus takes all samples of a marker at once.
        """
        there = ~np.isnan(positions[:, 0])
        # new lists of Python's own types: the API changes them, and takes no others
        x, y, z = np.where(there[:, None], positions, 0.0).T.tolist()
        self._vicon.SetTrajectory(subject, marker, x, y, z, there.tolist())

    def take_back(
        self,
        subject: str,
        marker: str,
        measured: NDArray[np.float64],
        filled: NDArray[np.bool_],
    ) -> None:
        """Set a marker to what it was before."""
        self.set_filled(subject, marker, measured, filled)
