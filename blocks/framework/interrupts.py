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
from types import FrameType

RETRY = 0.005
"""After how long it is tried again [s]."""


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
    signal.signal(signal.SIGINT, _when_possible)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _when_possible(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, or come again soon."""
    above = frame
    while above is not None:
        if above.f_globals.get("__name__", "").startswith("casadi"):
            threading.Timer(RETRY, _thread.interrupt_main).start()
            return
        above = above.f_back
    signal.default_int_handler(number, frame)
