"""Which of two versions of one recording a database keeps.

A recording comes as it was captured, with gaps, and then with its gaps filled, perhaps more than
once. A database counts it once: the version that has more, as long as nothing that was measured
is lost for something that was synthesised.
"""

from __future__ import annotations

from priorfill.database.record import ClipRecord

__all__ = ["reason_to_keep"]


def reason_to_keep(old: ClipRecord, new: ClipRecord, *, accepted: bool) -> str:
    """Return why a database keeps the version that it has; empty where the new one replaces it.

    Parameters
    ----------
    old, new : ClipRecord
        Versions of one recording.
    accepted : bool
        Whether a user says that the new one's filled samples shall count.
    """
    as_what = f"(as {old.name})"
    if old.content == new.content:
        if accepted and new.measured != old.measured:
            return ""  # now it is known which samples were synthesised
        return f"is in the database already {as_what}; nothing to do"
    if not new.has_filled:
        if old.has_filled:
            return f"is in the database already, filled {as_what}; nothing to do"
        if sum(new.present) > sum(old.present):
            return (
                f"is in the database already with more gaps {as_what}; if they were filled since, "
                "accept it (priorfill db accept), otherwise remove the other first"
            )
        return f"is in the database already {as_what}, with as many samples or more; nothing to do"
    if any(o > n for o, n in zip(old.measured, new.measured, strict=False)):
        return (
            f"is in the database already {as_what}, with samples measured that are filled here; "
            "nothing to do"
        )
    if old.has_filled and not accepted:
        return (
            f"is in the database already, filled {as_what}; "
            "to put this one in its place, accept it (priorfill db accept)"
        )
    return ""
