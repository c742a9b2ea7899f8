"""An FMU in a process of its own, for one that is not trusted to return, or to stay alive."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import weakref
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from typing import Any, Self

from trussflow.fmu.errors import FmuCallError, FmuCrashError, FmuError, FmuTimeoutError
from trussflow.fmu.runtime.file import FmuFile
from trussflow.fmu.runtime.loaded_co_simulation import LoadedCoSimulation
from trussflow.fmu.runtime.loaded_model_exchange import LoadedModelExchange

STARTUP = 60.0
"""Time [s] that a child process may take to import what it needs, over the time limit."""

TAIL = 2000
"""Characters of what the child wrote that an error shows."""


class RemoteInstance:
    """A loaded FMU of either kind in a child process, with the same methods and values.

    Each call waits at most for the time limit; then the process is ended, so nothing goes on
    running. A call takes some 0.1 ms longer than in this process.

    Parameters
    ----------
    kind : type
        `LoadedCoSimulation` or `LoadedModelExchange`.
    file : FmuFile, str or pathlib.Path
        The FMU.
    time_limit : float
        Time that each call may take [s].
    **arguments : object
        Those of `LoadedFmu`.

    Raises
    ------
    FmuTimeoutError
        If a call takes longer.
    FmuCrashError
        If the process ends by itself.
    FmuError
        If the FMU fails, as in this process.
    """

    def __init__(
        self,
        kind: type[LoadedCoSimulation | LoadedModelExchange],
        file: FmuFile | str | Path,
        time_limit: float,
        **arguments: Any,
    ) -> None:
        if sys.platform == "win32":
            raise FmuError("child processes for FMUs need a POSIX system; leave out time_limit")
        file = file if isinstance(file, FmuFile) else FmuFile.read(file)
        self._limit, self._name = float(time_limit), file.path.name
        self._folder = tempfile.TemporaryDirectory(prefix="trussflow-fmu-")
        self._output = Path(self._folder.name, "output").open("w+b")  # noqa: SIM115 - `_end` closes it
        self._pipe, theirs = Pipe()
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
            "TMPDIR": self._folder.name,
        }
        command = [sys.executable, "-m", f"{__package__}.child_main", str(theirs.fileno())]
        self._process = subprocess.Popen(
            command,
            pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=self._output,
            env=environment,
            start_new_session=True,
        )
        theirs.close()
        self._finalizer = weakref.finalize(self, _end, self._process, self._pipe, self._folder, self._output)
        self._waiting = False
        try:
            self._call("open", (kind.__name__, file, arguments), extra=STARTUP)
            fixed = ("description", "capabilities", "inputs", "outputs")
            self.description, self.capabilities, self.inputs, self.outputs = self._call("get", fixed)
        except BaseException:
            self.close()
            raise

    def _call(self, what: str, arguments: Any, extra: float = 0.0) -> Any:
        """Let the child do something, and return what comes of it."""
        if not self._finalizer.alive:
            raise FmuError(f"the process of FMU '{self._name}' has ended; set it up anew")
        if self._waiting:  # another thread, or a saved state that is freed meanwhile
            raise FmuError(f"FMU '{self._name}' is called before its last call has returned")
        doing = arguments[0] if what == "call" else what
        self._waiting = True
        try:
            self._pipe.send((what, arguments))
            answered = self._pipe.poll(self._limit + extra)
            reply = self._pipe.recv() if answered else None
        except (EOFError, OSError):
            code = self._process.wait()
            how = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
            raise self._ended(
                FmuCrashError, f"the process of FMU '{self._name}' ended by itself in '{doing}' with {how}"
            ) from None
        except BaseException:
            self.close()
            raise
        finally:
            self._waiting = False
        if reply is None:
            raise self._ended(
                FmuTimeoutError,
                f"FMU '{self._name}' did not return from '{doing}' within {self._limit:g} s; its "
                "process was ended",
            )
        done, value = reply
        if done:
            return value
        raise value

    def _ended(self, kind: type[FmuCallError], message: str) -> FmuCallError:
        """End the child; return an error with the end of what it wrote, the FMU's log included."""
        size = self._output.seek(0, os.SEEK_END)
        self._output.seek(max(0, size - TAIL))
        text = self._output.read().decode("utf-8", "replace").strip()
        self.close()
        return kind(message + (f"; it wrote:\n  {text}" if text else "; it wrote nothing"))

    def __getattr__(self, name: str) -> Any:
        """Return a method, or the present value of an attribute, of what is in the child."""
        if name.startswith("_"):
            raise AttributeError(name)
        if any(callable(getattr(kind, name, None)) for kind in (LoadedCoSimulation, LoadedModelExchange)):
            return lambda *given, **named: self._call("call", (name, given, named))
        return self._call("get", (name,))[0]

    def close(self) -> None:
        """End the process and delete what it unpacked."""
        self._finalizer()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _end(
    process: subprocess.Popen[bytes],
    pipe: Connection[Any, Any],
    folder: tempfile.TemporaryDirectory[str],
    output: Any,
) -> None:
    """End a child, without asking it: whatever it holds is in its own folder."""
    pipe.close()
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)  # its session is its own, so are its children
    process.wait()
    output.close()
    folder.cleanup()


def open_instance(
    kind: type[LoadedCoSimulation | LoadedModelExchange],
    file: FmuFile | str | Path,
    *,
    time_limit: float | None = None,
    **arguments: Any,
) -> Any:
    """Load an FMU in this process, or with a time limit in one of its own.

    Parameters
    ----------
    kind : type
        `LoadedCoSimulation` or `LoadedModelExchange`.
    file : FmuFile, str or pathlib.Path
        The FMU.
    time_limit : float, optional
        Time that each call may take [s]; None stays in this process.
    **arguments : object
        Those of `LoadedFmu`.

    Raises
    ------
    FmuError
        If the FMU is refused.
    """
    if time_limit is None:
        return kind(file, **arguments)
    return RemoteInstance(kind, file, time_limit, **arguments)
