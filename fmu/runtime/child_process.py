"""An FMU in a child process, with limits of time and memory, and protection from crashes."""

from __future__ import annotations

import os
import pickle
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import weakref
from contextlib import ExitStack
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from trussflow.blocks.errors import Explained
from trussflow.blocks.results.state_file import decode
from trussflow.blocks.support.processes import end
from trussflow.blocks.support.temporary_folders import process_folder
from trussflow.fmu import errors
from trussflow.fmu.errors import FmuCallError, FmuCrashError, FmuError, FmuTimeoutError
from trussflow.fmu.runtime.archive import unpack
from trussflow.fmu.runtime.file import FmuFile
from trussflow.fmu.runtime.library import Step
from trussflow.fmu.runtime.loaded import KnownFmu
from trussflow.fmu.runtime.loaded_co_simulation import LoadedCoSimulation
from trussflow.fmu.runtime.loaded_model_exchange import LoadedModelExchange

Loaded = LoadedCoSimulation | LoadedModelExchange

STARTUP_TIMEOUT = 60.0
"""Maximum time [s] for the imports of a child process, before the FMU is loaded."""

EXIT_TIMEOUT = 1.0
"""Maximum time [s] for a child process to end after its answer is missing."""

MAX_TIME_LIMIT, MAX_MEMORY_LIMIT = 1e6, 1e15
"""Maximum limits that operating systems support [s, B]; longer and larger ones are reduced to these."""

MAX_ANSWER_BYTES = 1_000_000_000
"""Maximum size of an answer [B]; the largest answers are saved states."""

MAX_SHOWN_BYTES = 2000
"""Maximum size [B] of the child's output in an error message."""

ERROR_CLASSES = {
    name: kind for name, kind in vars(errors).items() if name.startswith("Fmu")
}
"""Error classes that a child process may report, by name."""


class RemoteInstance(KnownFmu):
    """A loaded FMU of either kind in a child process, with the methods and attributes of that kind.

    Each call waits at most for the time limit; then the process is ended. A call takes about
    0.1 ms longer than in this process.

    Parameters
    ----------
    kind : type
        `LoadedCoSimulation` or `LoadedModelExchange`.
    file : FmuFile, str or pathlib.Path
        The FMU.
    time_limit : float
        Maximum time of each call, and of loading [s].
    memory_limit : float, optional
        Maximum memory of the FMU [B].
    **arguments : object
        Further arguments of `LoadedFmu`.

    Raises
    ------
    FmuTimeoutError
        If a call exceeds the time limit.
    FmuCrashError
        If the process ends unexpectedly.
    FmuError
        If the FMU fails, as for an FMU in this process.
    """

    def __init__(
        self,
        kind: type[Loaded],
        file: FmuFile | str | Path,
        time_limit: float,
        *,
        memory_limit: float | None = None,
        **arguments: Any,
    ) -> None:
        if sys.platform == "win32":
            raise FmuError(
                "child processes for FMUs need a POSIX system; leave out time_limit"
            )
        # The description is read here: the child process is not trusted to report it.
        super().__init__(kind.kind, file)
        self._limit = min(float(time_limit), MAX_TIME_LIMIT)
        self._kind = kind
        self._name = self.file.path.name
        self._waiting = False
        self._fault = FmuError(
            f"the process of FMU '{self._name}' has ended; set it up again"
        )
        cannot = Explained(
            lambda error: FmuError(
                f"cannot start a process for FMU '{self._name}': {error}"
            )
        )
        with cannot, ExitStack() as stack:
            folder = Path(tempfile.mkdtemp(prefix="fmu-", dir=process_folder()))
            stack.callback(shutil.rmtree, folder, ignore_errors=True)
            self._output = stack.enter_context((folder / "output").open("w+b"))
            ours, theirs = socket.socketpair()
            self._socket = stack.enter_context(ours)
            # A copy, because both `Connection` and the socket close their descriptor.
            self._connection = stack.enter_context(Connection(os.dup(ours.fileno())))
            # Closed here too, so that the end of the child closes the connection.
            with theirs:
                environment = {
                    "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
                    "TMPDIR": str(folder),
                }
                self._process = subprocess.Popen(
                    [
                        sys.executable,
                        "-m",
                        f"{__package__}.child_main",
                        str(theirs.fileno()),
                    ],
                    pass_fds=[theirs.fileno()],
                    stdin=subprocess.DEVNULL,
                    stdout=self._output,
                    stderr=self._output,
                    env={**os.environ, **environment},
                    start_new_session=True,
                )
            # The process is killed without a request: all its files are in its own folder.
            stack.callback(end, self._process, mark=str(folder))
            self._finalizer = weakref.finalize(self, stack.pop_all().close)
        try:
            self._set_timeout(STARTUP_TIMEOUT)
            self._answer("start", STARTUP_TIMEOUT)
            self._set_timeout(self._limit)
            unpacked = unpack(self.file.path, folder)
            memory = memory_limit and int(min(memory_limit, MAX_MEMORY_LIMIT))
            self._call("open", kind, self.file, memory, folder=unpacked, **arguments)
        except BaseException:
            self.close()
            raise

    def _set_timeout(self, seconds: float) -> None:
        """Limit the time of each read and write, also in the middle of a message."""
        whole = int(seconds)
        microseconds = max(int((seconds - whole) * 1e6), 1)  # zero would mean no limit
        for option in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):
            self._socket.setsockopt(
                socket.SOL_SOCKET, option, struct.pack("@ll", whole, microseconds)
            )

    def _call(self, name: str, /, *given: Any, **named: Any) -> Any:
        """Call a method of the FMU in the child, or read its attribute."""
        if not self._finalizer.alive:
            raise self._fault
        if self._waiting:  # by another thread, or by the finalizer of a saved state
            raise FmuError(
                f"FMU '{self._name}' is called before its last call has returned"
            )
        done, value = self._answer(name, self._limit, (name, given, named))
        if done:
            return Step(*value) if name == "do_step" else value
        cause, text, status = value
        error = ERROR_CLASSES.get(cause, FmuError)(text)
        # The class and the text alone crossed the process boundary.
        if isinstance(error, FmuCallError):
            error.status = status
        raise error

    def _answer(self, doing: str, seconds: float, request: Any = None) -> Any:
        """Send a request, if any, and return the answer; end the child process on any failure."""
        self._waiting = True
        try:
            if request is not None:
                # Not `send`: its view of the pickle, kept alive by the error of a broken
                # connection, makes the garbage collector of CPython 3.12 and 3.13 fail.
                self._connection.send_bytes(pickle.dumps(request))
            # The process of an FMU is not trusted: its answers are decoded, not unpickled.
            return decode(self._connection.recv_bytes(MAX_ANSWER_BYTES), {})
        except (ValueError, EOFError, OSError) as error:
            raise self._ended(*self._explained(error, doing, seconds)) from None
        except BaseException:
            self.close()
            raise
        finally:
            self._waiting = False

    def _explained(
        self, error: Exception, doing: str, seconds: float
    ) -> tuple[type[FmuCallError], str]:
        """Return the class and the text of the error for a call without an answer."""
        # A process forked by the FMU may keep the descriptor open: no end of file arrives then.
        if isinstance(error, BlockingIOError) and self._process.poll() is None:
            text = (
                f"FMU '{self._name}' did not return from '{doing}' within {seconds:g} s"
            )
            return FmuTimeoutError, f"{text}; its process was ended"
        try:
            code = self._process.wait(EXIT_TIMEOUT)
        except subprocess.TimeoutExpired:
            how = f"wrote into the descriptor reserved for answers in '{doing}', or closed it, and was ended"
        else:
            how = f"exit code {code}"
            if code < 0:
                how = f"signal {-code} ({signal.strsignal(-code)})"
            how = f"ended by itself in '{doing}' with {how}"
        return FmuCrashError, f"the process of FMU '{self._name}' {how}"

    def _ended(self, kind: type[FmuCallError], message: str) -> FmuError:
        """End the child; return an error with the end of its output, which includes the FMU's log."""
        size = self._output.seek(0, os.SEEK_END)
        self._output.seek(max(0, size - MAX_SHOWN_BYTES))
        text = self._output.read().decode("utf-8", "replace").strip()
        self.close()
        self._fault = kind(
            message + (f"; it wrote:\n  {text}" if text else "; it wrote nothing")
        )
        return self._fault

    def __getattr__(self, name: str) -> Any:
        """Return a method, or the current value of an attribute, of the FMU in the child process."""
        if name.startswith("_"):
            raise AttributeError(name)
        if callable(getattr(self._kind, name, None)):
            return partial(self._call, name)
        return self._call(name)

    def close(self) -> None:
        """End the process and delete the unpacked files."""
        self._finalizer()


def open_instance(
    kind: type[Loaded],
    file: FmuFile | str | Path,
    *,
    time_limit: float | None = None,
    memory_limit: float | None = None,
    **arguments: Any,
) -> Any:
    """Load an FMU in this process or, if a time limit is given, in a child process.

    Parameters
    ----------
    kind : type
        `LoadedCoSimulation` or `LoadedModelExchange`.
    file : FmuFile, str or pathlib.Path
        The FMU.
    time_limit : float, optional
        Maximum time of each call, and of loading [s]; None loads the FMU in this process.
    memory_limit : float, optional
        Maximum memory of the FMU [B], in a child process.
    **arguments : object
        Further arguments of `LoadedFmu`.

    Raises
    ------
    FmuError
        If the FMU is refused.
    """
    if time_limit is None:
        return kind(file, **arguments)
    return RemoteInstance(
        kind, file, time_limit, memory_limit=memory_limit, **arguments
    )
