"""Check overrides without filling anything."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from priorfill.clip import Clip
from priorfill.filling.assign_overrides import apply_overrides
from priorfill.filling.overrides import Overrides
from priorfill.filling.run_settings import RunSettings, check_sources, settings_of_overrides
from priorfill.filling.swaps import check_swaps, swap_markers
from priorfill.methods import resolve

__all__ = ["check_overrides"]


def check_overrides(
    overrides: Overrides,
    clips: Sequence[Clip],
    *,
    method: str = "auto",
    database_clips: Iterable[str] | None = None,
    same_subject: bool = False,
) -> Overrides:
    """Check that overrides fit the clips of a file, as a fill does before it begins.

    Parameters
    ----------
    overrides : Overrides
        The overrides.
    clips : sequence of Clip
        The clip of each subject of the file.
    method : str
        The method for gaps without an override.
    database_clips : iterable of str, optional
        Names of the clips of the database; None: there is no database.
    same_subject : bool
        Whether there are other recordings of the same subject.

    Returns
    -------
    Overrides
        For these subjects; see `Overrides.for_subjects`.

    Raises
    ------
    OptionError
        Where a marker, subject, source, donor or option is unknown, frames are not the file's, or
        two overrides contradict each other.
    """
    fitting = overrides.for_subjects(clips)
    check_swaps(fitting, clips)
    check_sources(fitting, database_clips, same_subject=same_subject)
    for clip in clips:
        swapped = swap_markers(fitting, clip).clip
        settings_of_overrides(fitting, swapped, RunSettings(resolve(method)), set())
        apply_overrides(fitting, swapped)
    return fitting
