"""Whose markers of a file are read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from priorfill.errors import ClipError, MultipleSubjectsError

__all__ = ["choose_subject"]


def choose_subject(
    owners: Mapping[int, str], subject: str | None, declared: Sequence[str], name: str
) -> tuple[str, dict[int, str]]:
    """Choose the subject whose markers are read.

    C3DParameters
    ----------
    owners : mapping of int to str
        Whose marker each point is by its label's prefix; empty where it has none.
    subject : str or None
        Who is asked for.
    declared : sequence of str
        Whom the file names apart from the labels.
    name : str
        Of the file, for messages.

    Returns
    -------
    chosen : str
        The subject; empty where nothing tells.
    left_out : dict of int to str
        Why the points of others are not read.

    Raises
    ------
    ClipError
        Where several are there and none is asked for (MultipleSubjectsError), or the one asked for
        is not there.
    """
    present = sorted({owner for owner in owners.values() if owner})
    if subject is None:
        if len(present) > 1:
            raise MultipleSubjectsError(
                f"{name}: holds {len(present)} subjects ({', '.join(present)}); "
                "choose one (--subject NAME)",
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
    known = ", ".join(present or declared)
    raise ClipError(f"{name}: has no subject {subject}; it holds {known}")
