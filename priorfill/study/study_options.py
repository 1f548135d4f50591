"""How a study is run: workers, limits, and what is written in addition."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import psutil

from priorfill.errors import OptionError
from priorfill.runtime.field_types import check_field_types
from priorfill.runtime.option_checks import check_at_least
from priorfill.study.job import JobLimits

__all__ = ["StudyOptions", "StudyProgress"]

_MEMORY_SHARE = 0.9
"""Share of the computer's memory that all workers together may use; the rest is the system's."""

_WORKER_MEMORY = 2 << 30
"""Memory (bytes) that a worker gets at least, where the number of workers is not given: a fill of
some minutes of 50 markers takes half of it."""

_LOCAL = "local"
"""Name of a cluster on this computer."""


@dataclass(frozen=True)
class StudyProgress:
    """How far a study is.

    Attributes
    ----------
    done, failed, total : int
        Numbers of jobs: finished ones, those of them that failed, and all.
    share : float
        Share of the work that is done, from 0 to 1.
    seconds_left : float or None
        Time that the rest takes, as far as is known (s).

    See Also
    --------
    priorfill.StudyOptions : Options of a study.

    Examples
    --------
    >>> StudyProgress(1, 0, 4, 0.25).total
    4
    """

    done: int
    failed: int
    total: int
    share: float
    seconds_left: float | None = None


@dataclass(frozen=True)
class StudyOptions:
    """Options of `priorfill.batch`.

    Attributes
    ----------
    workers : int, optional
        Number of fills at the same time. By default the number of cores, or fewer where the memory
        does not suffice. The results do not depend on it.
    report : bool
        Write a page for each file, ``NAME.html``.
    uncertainty : bool
        Write the expected error of each filled sample of each file, ``NAME.uncertainty.npz``.
    summary : Path or str, optional
        Page that sums up the study, .html; ``summary.html`` in the output folder by default. A
        table (.csv) and the outcomes (.json) are written next to it.
    same_session : bool
        Fill each file also from other recordings of the same subject in its folder, such as the
        static trial, which are found by the names of subjects and by body measures.
    grow : bool
        Add what was filled well enough to the database, so that files with more gaps profit.
    scheduler : str, optional
        Address of a Dask scheduler whose workers fill the files.
    cluster : str, optional
        ``local``: start Dask workers on this computer.
    index, of : int, optional
        Do only part `index` (1 to `of`) of the study, as one task of an array of tasks; without a
        summary.
    time_limit : float
        Wall time (s) after which a fill is ended.
    memory_limit : int, optional
        Memory (bytes) that a fill may use; by default its share of the computer's memory. With a
        scheduler, that of its worker.
    retry : bool
        Fill files again that failed before for reasons of their own.
    overwrite : bool
        Replace files in the output folder that are not of this study, or were changed since.
    flag_error : float
        mm. The summary lists files with a greater expected mean error in a gap.
    flag_gap : float, optional
        s. The summary lists files with longer gaps; by default, a length alone is no reason.
    check_only : bool
        Check everything and find what is to be done, but fill nothing.
    progress : callable, optional
        Called with a `StudyProgress` when a job is finished.

    Raises
    ------
    OptionError
        Where a number is out of its range, or options contradict each other.

    See Also
    --------
    priorfill.batch : Fill all files of a study.

    Examples
    --------
    >>> StudyOptions(workers=2, report=True).time_limit
    3600.0
    """

    workers: int | None = None
    report: bool = False
    uncertainty: bool = False
    summary: Path | str | None = None
    same_session: bool = True
    grow: bool = False
    scheduler: str | None = None
    cluster: str | None = None
    index: int | None = None
    of: int | None = None
    time_limit: float = 3600.0
    memory_limit: int | None = None
    retry: bool = False
    overwrite: bool = False
    flag_error: float = 10.0
    flag_gap: float | None = None
    check_only: bool = False
    progress: Callable[[StudyProgress], None] | None = field(
        default=None, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        """Check the options."""
        check_field_types(self)
        if self.workers is not None:
            check_at_least(self, 1, "workers")
        if not self.time_limit > 0:
            raise OptionError(f"`time_limit` is {self.time_limit:g} s; it must be above 0")
        if self.memory_limit is not None and not self.memory_limit > 0:
            raise OptionError(f"`memory_limit` is {self.memory_limit}; it must be above 0")
        if (self.index is None) != (self.of is None):
            raise OptionError("`index` and `of` belong together; give both")
        if self.index is not None and self.of is not None and not 1 <= self.index <= self.of:
            raise OptionError(f"`index` is {self.index}; it must be from 1 to `of`, {self.of}")
        if self.index is not None and self.grow:
            raise OptionError(
                "`grow` needs the outcomes of all files; it does not work with `index`"
            )
        if self.scheduler is not None and self.cluster is not None:
            raise OptionError("`scheduler` and `cluster` exclude each other; give one")
        if self.cluster not in (None, _LOCAL):
            raise OptionError(f"`cluster` is {self.cluster}; there is only {_LOCAL}")

    @property
    def uses_dask(self) -> bool:
        """Whether workers of Dask fill the files."""
        return self.scheduler is not None or self.cluster is not None

    @property
    def worker_count(self) -> int:
        """Number of fills at the same time."""
        if self.workers is not None:
            return self.workers
        by_memory = int(_MEMORY_SHARE * psutil.virtual_memory().total) // _WORKER_MEMORY
        return max(1, min(os.cpu_count() or 1, by_memory))

    @cached_property
    def limits(self) -> JobLimits:
        """What each job may use; with a scheduler, 0 is the share of its worker."""
        workers = self.worker_count
        memory = int(_MEMORY_SHARE * psutil.virtual_memory().total / workers)
        if self.scheduler is not None:
            memory = 0
        return JobLimits(
            self.time_limit,
            memory if self.memory_limit is None else self.memory_limit,
            max(1, (os.cpu_count() or 1) // workers),
        )
