"""Methods: functions that turn a task into an estimate of the missing markers.

`METHODS` lists them by name. A method's module is imported when the method is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

from priorfill.errors import OptionError
from priorfill.runtime.option_texts import close_or_all

if TYPE_CHECKING:
    from priorfill.methods.task import Method

__all__ = ["DEFAULT_METHOD", "METHODS", "MethodEntry", "get_method", "get_options", "resolve"]


@dataclass(frozen=True)
class MethodEntry:
    """A method's function, description and options.

    Attributes
    ----------
    place : str
        ``module:function`` below `priorfill.methods`.
    summary : str
        The method in one line.
    source : str
        Its publication or authors.
    options_class : str or None
        ``module:class`` below `priorfill.methods` of the options that its function accepts as
        ``options=``; None for a method without options. See `get_options`.
    without_clip : bool
        Whether it can learn from other recordings alone (`Task.learn_from_clip`).
    predicts_errors : bool
        Whether it predicts its errors. Those of other methods are found from artificial gaps.
    """

    place: str
    summary: str
    source: str
    options_class: str | None = None
    without_clip: bool = False
    predicts_errors: bool = False


METHODS = {
    "gpr": MethodEntry(
        "gpr.gpr_fill:fill",
        "Gaussian-process regression on the clip's own poses and the database's",
        "priorfill",
        "gpr.options:GPROptions",
        without_clip=True,
        predicts_errors=True,
    ),
    "neighbours": MethodEntry(
        "baumann2011.weighted_votes:fill",
        "baumann2011 with distance-weighted votes, the clip itself searched too",
        "priorfill, after Tautges et al. 2011",
        "baumann2011.weighted_votes:NeighboursOptions",
        without_clip=True,
        predicts_errors=True,
    ),
    "baumann2011": MethodEntry(
        "baumann2011.neighbour_votes:fill",
        "energy with targets from the nearest poses of a database",
        "Baumann et al. 2011",
        "baumann2011.neighbour_votes:Baumann2011Options",
        without_clip=True,
        predicts_errors=True,
    ),
    "krueger2010": MethodEntry(
        "baumann2011.krueger2010:fill",
        "local models of the nearest poses of a database, frame by frame",
        "Krüger et al. 2010",
        "baumann2011.krueger2010:Krueger2010Options",
        without_clip=True,
        predicts_errors=True,
    ),
    "linear": MethodEntry(
        "interpolation:linear",
        "linear interpolation over time",
        "SciPy",
    ),
    "pchip": MethodEntry(
        "interpolation:pchip",
        "monotone cubic interpolation over time",
        "SciPy",
    ),
    "spline": MethodEntry(
        "interpolation:spline",
        "cubic splines over time",
        "SciPy",
    ),
    "rigid": MethodEntry(
        "rigid_body:fill",
        "moves with markers at constant distances",
        "Kabsch 1976",
        "rigid_body:RigidBodyOptions",
    ),
    "r1": MethodEntry(
        "gloersen2016:r1",
        "weighted PCA, all markers at once",
        "Gløersen and Federolf 2016",
        "gloersen2016.strategies:Gloersen2016Options",
    ),
    "r2": MethodEntry(
        "gloersen2016:r2",
        "weighted PCA, marker by marker",
        "Gløersen and Federolf 2016",
        "gloersen2016.strategies:Gloersen2016Options",
    ),
    "li": MethodEntry(
        "tits2018:li",
        "linear interpolation in the frame of three reference markers",
        "Tits et al. 2018",
        "tits2018.tits2018_options:Tits2018Options",
    ),
    "lpr": MethodEntry(
        "tits2018:lpr",
        "polynomial regression on the shape of three reference markers",
        "Tits et al. 2018",
        "tits2018.tits2018_options:Tits2018Options",
    ),
    "lgrnn": MethodEntry(
        "tits2018:lgrnn",
        "mean of frames in which three reference markers have a similar shape",
        "Tits et al. 2018",
        "tits2018.tits2018_options:Tits2018Options",
    ),
    "glr": MethodEntry(
        "tits2018:glr",
        "linear regression on all markers visible throughout a gap",
        "Tits et al. 2018",
        "tits2018.tits2018_options:Tits2018Options",
    ),
    "wpca": MethodEntry(
        "tits2018:wpca",
        "weighted PCA with constrained distances from three reference markers",
        "Tits et al. 2018",
        "tits2018.tits2018_options:Tits2018Options",
    ),
    "pma": MethodEntry(
        "tits2018:pma",
        "average of li, lpr, lgrnn, glr and wpca, weighted by probability",
        "Tits et al. 2018",
        "tits2018.tits2018_options:Tits2018Options",
    ),
    "pca-train": MethodEntry(
        "li2020:pca_train",
        "eigenspaces of complete and of all masked training data; a variant of pca-pieces",
        "Li et al. 2020",
        "li2020.li2020_options:Li2020Options",
    ),
    "pca-pieces": MethodEntry(
        "li2020:pca_pieces",
        "eigenspaces of complete and of each masked training piece",
        "Li et al. 2020",
        "li2020.li2020_options:Li2020Options",
    ),
    "pca-frames": MethodEntry(
        "li2020:pca_frames",
        "eigenspaces of trajectories; fills whole frames",
        "Li et al. 2020",
        "li2020.li2020_options:Li2020Options",
    ),
    "lds": MethodEntry(
        "lds:fill",
        "linear dynamical system, fitted by EM",
        "Li et al. 2009",
        "lds:LdsOptions",
    ),
}
"""The methods by name."""

DEFAULT_METHOD = "gpr"
"""The method that ``auto`` chooses."""

ALIASES = {"auto": DEFAULT_METHOD, "prior": DEFAULT_METHOD}
"""Other names that are accepted for methods."""


def resolve(name: str) -> str:
    """Return the name of a method; ``auto`` and ``prior`` give that of the default.

    Raises
    ------
    OptionError
        Where there is no such method.
    """
    name = ALIASES.get(name, name)
    if name not in METHODS:
        raise OptionError(f"there is no method {name!r}; {close_or_all(name, ['auto', *METHODS])}")
    return name


def get_method(name: str) -> Method:
    """Return a method by its name.

    Raises
    ------
    OptionError
        Where there is no such method.
    """
    module, function = METHODS[resolve(name)].place.split(":")
    method: Method = getattr(import_module(f"{__name__}.{module}"), function)
    if module == "interpolation":  # marker by marker anyway
        return method
    from priorfill.methods.many_markers import by_neighbourhoods

    return by_neighbourhoods(method)


def get_options(name: str) -> Any:
    """Return the default options of a method; None where it has none.

    They are a frozen dataclass. `priorfill.methods.options` sets its fields by dotted name.

    Raises
    ------
    OptionError
        Where there is no such method.

    Examples
    --------
    >>> get_options("linear") is None
    True
    >>> get_options("r1").sigma
    200.0
    """
    options_class = METHODS[resolve(name)].options_class
    if options_class is None:
        return None
    module, name_of_class = options_class.split(":")
    return getattr(import_module(f"{__name__}.{module}"), name_of_class)()
