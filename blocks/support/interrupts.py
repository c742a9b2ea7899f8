"""Handling of Ctrl-C during functions of CasADi.

CasADi calls back into Python, for instance to convert an argument, and clears exceptions that occur there.
A KeyboardInterrupt in such a call is lost, or becomes another error. Therefore Ctrl-C is delayed until no
function of CasADi is on the stack.
"""

from __future__ import annotations

import _thread
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from traceback import walk_stack
from types import FrameType

RETRY_INTERVAL = 0.005
"""Time until the next attempt while a function of CasADi is on the stack [s]."""

REPEAT_INTERVAL = 1.0
"""Time until KeyboardInterrupt is raised again if it had no effect, as in finalizers [s]."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Make Ctrl-C end the body reliably; also a decorator.

    It has no effect outside the main thread, which never receives Ctrl-C, or if the user has installed
    another signal handler.
    """
    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    raised: list[threading.Timer] = []

    def when_possible(number: int, frame: FrameType | None) -> None:
        """Raise KeyboardInterrupt, now or after a delay, and again later in case that it gets lost."""
        waits = _is_casadi_above(frame)
        # If a function of CasADi would clear the exception, the next attempt follows.
        # Otherwise it is raised again after a second, if a finalizer has lost it.
        again = threading.Timer(
            RETRY_INTERVAL if waits else REPEAT_INTERVAL, _thread.interrupt_main
        )
        again.daemon = True
        again.start()
        if waits:
            return
        raised.append(again)
        signal.default_int_handler(number, frame)

    signal.signal(signal.SIGINT, when_possible)
    try:
        yield
    except Exception as error:
        if raised:  # other C code, such as an import, has converted it to another error
            raise KeyboardInterrupt from error
        raise
    finally:
        for again in raised:
            again.cancel()
        signal.signal(signal.SIGINT, signal.default_int_handler)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Delay Ctrl-C to the end of the body.

    This prevents locks of a library that are never released, partly imported modules, and partly deleted
    files. It has no effect outside the main thread, or if the signal handler is not callable.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(
        before
    ):
        yield
        return
    came: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if came:
            signal.raise_signal(signal.SIGINT)


def _is_casadi_above(frame: FrameType | None) -> bool:
    """Return whether a function of CasADi is on the stack."""
    callers = (caller.f_globals.get("__name__") for caller, _ in walk_stack(frame))
    return any(str(name).startswith("casadi") for name in callers)
