"""Log messages of an FMU, stored for error messages."""

from __future__ import annotations

import ctypes
import logging
import shutil
from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar, TextIO

STATUS_WARNING, STATUS_DISCARD, STATUS_ERROR, STATUS_FATAL = 1, 2, 3, 4
"""FMI statuses that are handled; any other status above a warning is an error."""

STATUS_NAMES = dict(
    enumerate(("ok", "warning", "discard", "error", "fatal", "pending"))
)
"""Names of the FMI statuses, by number."""

MAX_KEPT_MESSAGES = 200
"""Maximum number of stored messages; older ones are dropped."""

MAX_SHOWN_MESSAGES = 12
"""Maximum number of messages in an error message."""


class Messages(logging.Handler):
    """The latest log messages of one instance of an FMU; also a handler of `PYTHON_LOGGER`.

    Attributes
    ----------
    messages : deque of (int, str)
        Status, and the line ``[status] text``.
    instance : str
        Name of the instance; empty until it exists.
    """

    echo: ClassVar[TextIO | None] = None
    """Stream to which messages are also written immediately; set in a process that may crash."""

    def __init__(self) -> None:
        super().__init__()
        self.instance = ""
        self.messages: deque[tuple[int, str]] = deque(maxlen=MAX_KEPT_MESSAGES)

    def add(self, status: int, text: bytes | None) -> None:
        """Store a message; it never raises, because the FMU's C code calls it.

        Parameters
        ----------
        status : int
            FMI status [-].
        text : bytes or None
            Text of the FMU's logger call.
        """
        decoded = (text or b"").decode("utf-8", "replace").strip()
        line = f"[{status_name(status)}] {decoded}"
        self.messages.append((status, line))
        if self.echo is not None:
            self.echo.write(f"{line}\n")
            self.echo.flush()

    def emit(self, record: logging.LogRecord) -> None:
        """Store an error of this instance; also one without a name, while it is created."""
        text = record.getMessage()
        if not self.instance or text.startswith(f"{self.instance}: "):
            self.add(STATUS_ERROR, text.encode())

    def text(self) -> str:
        """Return the latest warnings and errors, or else the latest messages, for an error message."""
        worst = [m for m in self.messages if m[0] >= STATUS_WARNING] or list(
            self.messages
        )
        if not worst:
            return "; the FMU logged nothing"
        lines = [f"\n  {line}" for _, line in worst[-MAX_SHOWN_MESSAGES:]]
        return "; the FMU's own log:" + "".join(lines)


def status_name(status: int) -> str:
    """Return the name of an FMI `status` [-]."""
    return STATUS_NAMES.get(status, str(status))


def callbacks2(log: Messages, folder: Path) -> Any:
    """Return the callbacks of FMI 2; they must exist as long as the instance.

    FMI 2's logger takes a variable number of arguments, like C's ``printf``, which Python cannot
    read. fmpy has a small library that formats the text, but supports one receiver per process.
    Therefore each instance loads a copy of this library from its own folder.

    Parameters
    ----------
    log : Messages
        Receiver of the messages.
    folder : pathlib.Path
        Folder of the unpacked FMU.
    """
    from fmpy import calloc, fmi2, free

    callbacks = fmi2.fmi2CallbackFunctions(
        logger=fmi2.fmi2CallbackLoggerTYPE(
            lambda _e, _i, status, _c, text: log.add(status, text)
        ),
        allocateMemory=fmi2.fmi2CallbackAllocateMemoryTYPE(calloc),
        freeMemory=fmi2.fmi2CallbackFreeMemoryTYPE(free),
    )
    with suppress(ImportError, OSError, AttributeError):
        # fmpy has no such library for this machine
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
    """Return the logger callback of FMI 3; it must exist as long as the instance.

    Parameters
    ----------
    log : Messages
        Receiver of the messages.
    """
    from fmpy.fmi3 import fmi3LogMessageCallback

    return fmi3LogMessageCallback(lambda _e, status, _c, text: log.add(status, text))
