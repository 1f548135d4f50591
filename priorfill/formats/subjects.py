"""Choice of the subject whose markers are read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from priorfill.errors import MultipleSubjectsError, OptionError
from priorfill.runtime.option_texts import close_or_all

__all__ = ["choose_subject"]


def choose_subject(
    owners: Mapping[int, str], subject: str | None, declared: Sequence[str], name: str
) -> tuple[str, dict[int, str]]:
    """Choose the subject whose markers are read.

    Parameters
    ----------
    owners : mapping of int to str
        Subject of each point according to the prefix of its label; empty if it has none.
    subject : str or None
        The subject requested.
    declared : sequence of str
        Subjects that the file names apart from the labels.
    name : str
        The file's name in messages.

    Returns
    -------
    chosen : str
        The subject; empty if unknown.
    left_out : dict of int to str
        The points of other subjects, with the reason for leaving them out.

    Raises
    ------
    MultipleSubjectsError
        If the file holds several subjects and none is requested.
    OptionError
        If the file does not hold the requested subject.
    """
    present = sorted({owner for owner in owners.values() if owner})
    if subject is None:
        if len(present) > 1:
            raise MultipleSubjectsError(
                f"{name}: holds {len(present)} subjects ({', '.join(present)}); "
                "choose one (`subject`)",
                present,
            )
        only = declared[0] if len(declared) == 1 else ""
        return (present[0] if present else only), {}
    if subject in present:
        return subject, {
            point: f"belongs to {owner}" if owner else "belongs to no subject"
            for point, owner in owners.items()
            if owner != subject
        }
    if not present and (subject in declared or not declared):
        return subject, {}
    known = close_or_all(subject, present or declared)
    raise OptionError(f"{name}: has no subject {subject!r}; {known}")
