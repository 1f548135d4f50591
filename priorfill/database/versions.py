"""Which of two versions of one recording a database keeps.

A recording may be added as it was captured, with gaps, and again with its gaps filled. A database
keeps one version: the one with more samples, provided that no measured sample is replaced by a
filled one.
"""

from __future__ import annotations

from priorfill.database.record import ClipRecord

__all__ = ["reason_to_keep"]


def reason_to_keep(old: ClipRecord, new: ClipRecord, *, accepted: bool) -> str:
    """Return why a database keeps the version it has; empty if the new one replaces it.

    Parameters
    ----------
    old, new : ClipRecord
        Versions of one recording.
    accepted : bool
        Whether the user accepts the new version's filled samples.

    Returns
    -------
    str
        The end of a sentence about the new version.
    """
    as_name = f"(as {old.name})"
    if old.content == new.content:
        if accepted and new.measured != old.measured:
            return ""  # the mask of filled samples is new
        return f"is in the database already {as_name}; nothing to do"
    if not new.has_filled:
        if old.has_filled:
            return f"is in the database already, filled {as_name}; nothing to do"
        if sum(new.present) > sum(old.present):
            return (
                f"is in the database already with more gaps {as_name}; if they were filled since, "
                "accept it (priorfill db accept), otherwise remove the other first"
            )
        return f"is in the database already {as_name}, with as many samples or more; nothing to do"
    if any(o > n for o, n in zip(old.measured, new.measured, strict=False)):
        return (
            f"is in the database already {as_name}, with samples measured that are filled here; "
            "nothing to do"
        )
    if old.has_filled and not accepted:
        return (
            f"is in the database already, filled {as_name}; "
            "to put this one in its place, accept it (priorfill db accept)"
        )
    return ""
