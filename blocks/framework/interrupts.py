"""Ctrl-C that is not lost while CasADi works.

CasADi clears exceptions that come up while it calls back into Python, to convert an argument for
instance: a KeyboardInterrupt that falls there is swallowed, or comes out as another error. So while our
functions work, Ctrl-C waits until no function of CasADi is on the stack.
"""

from __future__ import annotations

import _thread
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from traceback import walk_stack
from types import FrameType

RETRY = 0.005
"""After how long it is tried again [s]."""

PATIENCE = 1.0
"""After how long it comes again where it was raised, but nothing ended: finalizers swallow it as well [s]."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Let Ctrl-C end what is done within; also a decorator.

    Elsewhere than in the main thread, where Ctrl-C never comes, and where the user has a handler of
    his own, nothing is changed.
    """
    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    raised: list[threading.Timer] = []

    def when_possible(number: int, frame: FrameType | None) -> None:
        """Raise KeyboardInterrupt, and come again in case that somebody swallows it."""
        waits = _is_casadi_above(frame)
        again = threading.Timer(RETRY if waits else PATIENCE, _thread.interrupt_main)
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
        if raised:  # other C code, such as that of an import, made another error of it
            raise KeyboardInterrupt from error
        raise
    finally:
        for again in raised:
            again.cancel()
        signal.signal(signal.SIGINT, signal.default_int_handler)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Let Ctrl-C wait until what is done within is done, so that no lock of a library stays taken.

    Nor a module half imported, nor files half deleted. Elsewhere than in the main thread, where Ctrl-C
    never comes, and where it raises nothing, nothing is changed.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
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
    """Tell whether a function of CasADi is on the stack."""
    callers = (caller.f_globals.get("__name__") for caller, _ in walk_stack(frame))
    return any(str(name).startswith("casadi") for name in callers)
