"""What the wrapper of pythonfmu calls: nothing may be raised into it.

The wrapper cannot return fmi2Error. A step that fails returns fmi2Discard; the cause is logged.
Calls that cannot fail by the wrapper's rules (setting a value, say) log the cause, and the next
step is discarded. An exception raised into the wrapper would corrupt memory.

This module loads without NumPy and CasADi, so that their absence can be logged too.
"""

from __future__ import annotations

import contextlib
import ctypes
import logging
import math
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pythonfmu.fmi2slave import Fmi2Slave  # of the copy beside this package, when in an FMU

CATEGORY = "logStatus"
"""The one category of log messages that the model description names."""

WARNING, ERROR = 1, 3
"""Values of fmi2Status."""

LOGGER = logging.getLogger("trussflow_fmu")
"""Errors go to Python's own log too, which by default is the standard error output."""


class Message:
    """A log message, as the wrapper reads it.

    Parameters
    ----------
    status : int
        A value of fmi2Status [-].
    text : str
        What to tell.
    """

    debug = False

    def __init__(self, status: int, text: str) -> None:
        self.status, self.category, self.text = status, CATEGORY, text
        self.msg = text.replace("%", "%%")  # importers take it for a format


def slave(namespace: dict[str, Any], needs: str) -> type:
    """Return the class that the wrapper is to instantiate.

    The wrapper runs the slave module again for each instance, keeps the classes it finds, and
    gives up a reference to the module's namespace that it never took. So there is one class for
    all instances, and each call adds the reference that will be missing.

    Parameters
    ----------
    namespace : dict
        ``globals()`` of the slave module.
    needs : str
        What the target must have installed, for the message if it has not.
    """
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(namespace))
    Slave.needs = needs
    return Slave


class Slave(Fmi2Slave):  # type: ignore[misc]
    """The class that the wrapper instantiates with its own `kwargs`, once for each instance."""

    needs = ""
    """What the target must have installed, for the message if it has not."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._model: Any = None
        self._broken = ""
        self._guarded("instantiate", self._load)

    def _load(self) -> None:
        # The wrapper puts the folder on the path at each instantiation, for all to see.
        with contextlib.suppress(KeyError, TypeError):
            resources = Path(self.resources)
            sys.path[:] = [p for p in sys.path if not p or Path(p) != resources]
        try:
            from trussflow.fmu.exporting.python.content import content
            from trussflow.fmu.exporting.python.instance import Instance
        except ImportError as error:
            raise RuntimeError(f"{error}; this FMU needs {self.needs}") from error
        carried = content()
        for note in carried.notes:
            self._tell(WARNING, note)
        self._model = Instance(carried)

    def _tell(self, status: int, text: str) -> None:
        message = Message(status, f"{self.instance_name}: {text}")
        self.log_queue.append(message)
        if status == ERROR:  # the wrapper drops all messages unless logging is on
            LOGGER.error("%s", message.text)

    def _guarded(self, what: str, function: Callable[[], Any]) -> Any:
        """Call a function; log what goes wrong, and return None then."""
        try:
            if self._broken:
                raise RuntimeError(self._broken)
            return function()
        except BaseException as error:  # noqa: BLE001 - the wrapper must never see one
            if self._model is None and not self._broken:
                self._broken = f"the model could not be loaded: {error}"
            self._tell(ERROR, f"{what} failed: {_explained(error)}")
            return None

    def _calling(self, what: str, method: str, *arguments: Any) -> Any:
        return self._guarded(what, lambda: getattr(self._model, method)(*arguments))

    def setup_experiment(self, start_time: float, *_others: Any) -> None:
        """Take the start time [s]; the internal solver needs neither end nor tolerance."""
        self._calling("setting up the experiment", "set_up", start_time)

    def exit_initialization_mode(self) -> None:
        """End the initialization."""
        self._calling("initialization", "initialize")

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Advance from `current_time` [s] by `step_size` [s]; False stands for fmi2Discard."""

        def step() -> bool:
            self._model.step(current_time, step_size)
            return True

        what = f"the step of {step_size:g} s from t = {current_time:g} s"
        return self._guarded(what, step) is not None

    def terminate(self) -> None:
        """End."""
        self._calling("termination", "terminate")

    def get_real(self, vrs: list[int]) -> list[float]:
        """Return values, NaN if there are none."""
        values = self._calling("reading values", "get", vrs)
        return [math.nan] * len(vrs) if values is None else list(values)

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        """Set `values` [as declared] by the value references `vrs`."""
        self._calling("setting values", "set", vrs, values)

    def _refuse(self, vrs: list[int], *_values: object) -> list[Any]:
        """Refuse: every variable is real."""
        self._tell(ERROR, f"every variable is Real; value references {vrs} were used otherwise")
        return [False] * len(vrs)

    get_integer = get_boolean = set_integer = set_boolean = set_string = _refuse

    def get_string(self, vrs: list[int]) -> list[str]:
        """Refuse: every variable is real."""
        return [""] * len(self._refuse(vrs))

    def _get_fmu_state(self) -> Any:
        return self._calling("saving the state", "save")

    def _set_fmu_state(self, state: Any) -> None:
        self._calling("restoring a state", "restore", state)

    @staticmethod
    def _fmu_state_to_bytes(state: Any) -> bytes:
        try:
            from trussflow.fmu.exporting.python import content, instance

            return instance.to_bytes(state, content.content().facts["token"])
        except BaseException:  # noqa: BLE001 - there is no instance to log to
            return b""

    @staticmethod
    def _fmu_state_from_bytes(data: bytes) -> Any:
        try:
            from trussflow.fmu.exporting.python import content, instance

            return instance.from_bytes(data, content.content().facts["token"])
        except BaseException as error:  # noqa: BLE001 - told when it is restored
            return str(error)

    def __del__(self) -> None:
        with contextlib.suppress(BaseException):
            if self._model is not None:
                self._model.close()


def _explained(error: BaseException) -> str:
    """Return the message of an error, with the traceback where it comes from users' code."""
    own = type(error).__module__.startswith(__name__.partition(".fmu.")[0] + ".")
    if own and error.__cause__ is None:
        return str(error)
    return "".join(traceback.format_exception(error)).rstrip()
