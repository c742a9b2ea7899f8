"""What an FMU has to say: its log messages, kept for error messages."""

from __future__ import annotations

import ctypes
import shutil
from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar, TextIO

STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
"""Names of the numbers that functions of FMI return."""

KEPT = 200
"""Messages kept; older ones are dropped."""

SHOWN = 12
"""Messages shown in an error."""


class Messages:
    """The log messages of one instance of an FMU, the latest ones.

    Attributes
    ----------
    messages : deque of (int, str, str)
        Status, category, text.
    """

    echo: ClassVar[TextIO | None] = None
    """Where messages are written besides, at once: a process that may crash sets it."""

    def __init__(self) -> None:
        self.messages: deque[tuple[int, str, str]] = deque(maxlen=KEPT)

    def add(self, status: int, category: bytes | None, text: bytes | None) -> None:
        """Keep a message; never raises, since the FMU's C code calls it.

        Parameters
        ----------
        status : int
            Status of FMI [-].
        category, text : bytes or None
            As the FMU gave them.
        """
        said, kind = ((part or b"").decode("utf-8", "replace").strip() for part in (text, category))
        self.messages.append((status, kind, said))
        if self.echo is not None:
            self.echo.write(f"[{status_name(status)}] {said}\n")
            self.echo.flush()

    def text(self) -> str:
        """Return the latest messages for an error message; empty if there are none."""
        worst = [m for m in self.messages if m[0] >= 1] or list(self.messages)
        if not worst:
            return "; the FMU logged nothing"
        lines = [f"\n  [{status_name(status)}] {text}" for status, _, text in worst[-SHOWN:]]
        return "; the FMU's own log:" + "".join(lines)


def status_name(status: int) -> str:
    """Return what FMI calls a `status` [-]."""
    return STATUS[status] if 0 <= status < len(STATUS) else str(status)


def callbacks2(log: Messages, folder: Path) -> Any:
    """Return the callbacks of FMI 2; keep them as long as the instance lives.

    FMI 2's logger takes a variable number of arguments, like C's ``printf``, which Python cannot
    read. fmpy has a small library that writes the text, but it keeps one receiver per process;
    so each instance gets a copy of it in its own folder.

    Parameters
    ----------
    log : Log
        Takes the messages.
    folder : pathlib.Path
        Of the unpacked FMU.
    """
    from fmpy import calloc, fmi2, free

    def logged(_: Any, __: Any, status: int, category: bytes, text: bytes) -> None:
        log.add(status, category, text)

    callbacks = fmi2.fmi2CallbackFunctions()
    callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(logged)
    callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(calloc)
    callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(free)
    with suppress(ImportError, OSError, AttributeError):  # no such library for this machine
        from fmpy import logging as proxy

        copy = folder / "trussflow-logger.bin"
        shutil.copyfile(proxy.logging._name, copy)
        library = ctypes.CDLL(str(copy))
        library.addLoggerProxy.argtypes = [ctypes.c_void_p]
        library.addLoggerProxy.restype = None
        library.addLoggerProxy(ctypes.byref(callbacks))
        callbacks.proxy = library
    return callbacks


def callback3(log: Messages) -> Any:
    """Return the logger of FMI 3; keep it as long as the instance lives.

    Parameters
    ----------
    log : Log
        Takes the messages.
    """
    from fmpy.fmi3 import fmi3LogMessageCallback

    def logged(_: Any, status: int, category: bytes, text: bytes) -> None:
        log.add(status, category, text)

    return fmi3LogMessageCallback(logged)
