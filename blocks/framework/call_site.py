"""Which line of the user's code is meant, for messages and warnings."""

from __future__ import annotations

import sys
import warnings

from trussflow.blocks.framework.errors import SimulationWarning

_PACKAGE_PREFIXES = ("trussflow.blocks", "trussflow.models", "trussflow.fmu")


def call_site() -> str:
    """Return ``file:line`` of the user's code that led here."""
    frame = sys._getframe(1)
    while frame.f_back is not None and str(frame.f_globals.get("__name__", "")).startswith(_PACKAGE_PREFIXES):
        frame = frame.f_back
    return f"{frame.f_code.co_filename}:{frame.f_lineno}"


def warn(message: str) -> None:
    """Warn of what a run did, at the line that asked for it; said each time."""
    file, _, line = call_site().rpartition(":")
    warnings.warn_explicit(message, SimulationWarning, file, int(line))
