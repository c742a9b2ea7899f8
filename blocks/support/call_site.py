"""Place in the user's code, for messages and warnings."""

from __future__ import annotations

import sys
import warnings

from trussflow.blocks.errors import SimulationWarning

_NOT_THE_USERS = (
    "trussflow.blocks",
    "trussflow.models",
    "trussflow.fmu",
    "functools",
    "contextlib",
)

_said: set[str] = set()
"""Subjects of the warnings that this process shows only once."""


def call_site() -> str:
    """Return ``file:line`` of the innermost call in the user's code."""
    # functools and contextlib lie between the user and this package if
    # a function is wrapped.
    frame = sys._getframe(1)
    while frame.f_back is not None and str(
        frame.f_globals.get("__name__", "")
    ).startswith(_NOT_THE_USERS):
        frame = frame.f_back
    return f"{frame.f_code.co_filename}:{frame.f_lineno}"


def warn(message: str, category: type[Warning] = SimulationWarning) -> None:
    """Issue a warning of a `category` with a `message`, at the line of the user's code."""
    file, _, line = call_site().rpartition(":")
    # warn_explicit(), as a stacklevel would have to be counted for
    # each way to get here.
    warnings.warn_explicit(message, category, file, int(line))


def warn_once(about: str, message: str) -> None:
    """Issue a warning with a `message` once per process for each subject `about`."""
    if about not in _said:
        _said.add(about)
        warn(message, RuntimeWarning)
