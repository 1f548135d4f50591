"""The scripting interface of QTM from another program on the same computer, over REST.

QTM answers at http://127.0.0.1:7979/api/scripting/qtm: a function is a path, its arguments are a
JSON array, and so is its result (https://qualisys.github.io/qtm-scripting/, versions 2024.2 to
2026.2). JSON holds numbers with 17 digits, so positions keep their bits.

This is the way for a QTM whose own Python cannot load priorfill.
"""

from __future__ import annotations

import http.client
import json
import urllib.error
import urllib.request
from typing import Any

from priorfill.errors import IntegrationError

__all__ = ["DEFAULT_PORT", "RestInterface"]

DEFAULT_PORT = 7979
"""Port at which QTM answers unless its project options name another one."""

_HOST = "127.0.0.1"
"""Where Windows resolves ``localhost`` to IPv6 first, each call would take seconds longer."""

_TIMEOUT_S = 60.0
"""QTM answers within seconds, unless a dialogue is open in it."""

_OPENER = urllib.request.build_opener(urllib.request.ProxyHandler({}))
"""Proxies of the environment are not for this computer."""


class RestInterface:
    """Has the attributes of the module ``qtm``; a call is sent to QTM.

    Parameters
    ----------
    port : int
        Port of the scripting interface.
    path : tuple of str
        Names of the modules and of the function.

    See Also
    --------
    priorfill.integrations.qtm.QtmMeasurement : What uses it.

    Examples
    --------
    >>> qtm = RestInterface()
    >>> qtm.gui.timeline.get_measured_range()  # doctest: +SKIP
    {'start': 0, 'end': 322}
    """

    def __init__(self, port: int = DEFAULT_PORT, path: tuple[str, ...] = ()) -> None:
        self._port = port
        self._path = path

    def __getattr__(self, name: str) -> RestInterface:
        """Return a module or function of the interface."""
        if name.startswith("__"):
            raise AttributeError(name)
        return RestInterface(self._port, (*self._path, name))

    def __call__(self, *arguments: Any) -> Any:
        """Call a function; RuntimeError where QTM reports an error, as inside QTM."""
        name = ".".join(self._path)
        request = urllib.request.Request(
            f"http://{_HOST}:{self._port}/api/scripting/qtm/{'/'.join(self._path)}/",
            data=json.dumps(arguments, allow_nan=False).encode(),
            headers={"Content-Type": "application/json", "Accept": "application/json"},
            method="POST",
        )
        try:
            with _OPENER.open(request, timeout=_TIMEOUT_S) as answer:
                content = answer.read()
        except urllib.error.HTTPError as error:
            with error:
                text = error.read().decode("utf-8", "replace").strip()
            raise RuntimeError(f"{name}: {text or error.reason}") from error
        except (OSError, http.client.HTTPException) as error:
            reason = getattr(error, "reason", error)
            raise IntegrationError(
                f"QTM cannot be reached at port {self._port} ({reason}); start QTM on this "
                "computer and open a captured file (docs/qtm.md)"
            ) from error
        try:
            return json.loads(content) if content.strip() else None
        except (ValueError, RecursionError) as error:
            raise IntegrationError(
                f"what answers at port {self._port} is not QTM ({name} returned no JSON)"
            ) from error
