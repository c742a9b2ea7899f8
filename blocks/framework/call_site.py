"""Which line of the user's code is meant, for messages and warnings."""

from __future__ import annotations

import sys
import warnings

from trussflow.blocks.framework.errors import SimulationWarning

_NOT_THE_USERS = ("trussflow.blocks", "trussflow.models", "trussflow.fmu", "functools", "contextlib")

_said: set[str] = set()
"""What this process has warned of once and for all."""


def call_site() -> str:
    """Return ``file:line`` of the user's code that led here."""
    frame = sys._getframe(1)
    while frame.f_back is not None and str(frame.f_globals.get("__name__", "")).startswith(_NOT_THE_USERS):
        frame = frame.f_back
    return f"{frame.f_code.co_filename}:{frame.f_lineno}"


def warn(message: str, category: type[Warning] = SimulationWarning) -> None:
    """Warn by a `message` of a `category` of what a run did, at the line that asked for it; each time."""
    file, _, line = call_site().rpartition(":")
    warnings.warn_explicit(message, category, file, int(line))


def warn_once(about: str, message: str) -> None:
    """Warn by a `message` of what this process has not been warned of yet: once `about` each thing."""
    if about not in _said:
        _said.add(about)
        warn(message, RuntimeWarning)
