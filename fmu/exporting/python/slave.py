"""Class that pythonfmu's wrapper instantiates and calls; its methods never raise an exception.

An exception while the class is loaded or instantiated makes the importer's instantiation fail, with
the exception in its log. Later, an exception raised into the wrapper would corrupt memory, and the
wrapper cannot return fmi2Error. A step that fails returns fmi2Discard; the cause is logged. The
wrapper's other calls, such as setting a value, cannot report a failure. They log the cause, and the
next step is discarded.
"""

from __future__ import annotations

import contextlib
import ctypes
import math
import sys
import traceback
from pathlib import Path
from typing import Any, ClassVar

from pythonfmu.enums import Fmi2Status
from pythonfmu.fmi2slave import Fmi2Slave

from trussflow.blocks.results.state_file import decode, encode
from trussflow.fmu.errors import PYTHON_LOGGER
from trussflow.fmu.exporting.description.model_description import LOG_CATEGORY
from trussflow.fmu.exporting.python.instance import Instance
from trussflow.fmu.exporting.python.payload import (
    PICKLE_FILE,
    REQUIREMENTS_FILE,
    Payload,
)


def slave(namespace: dict[str, Any]) -> type:
    """Return the class that the wrapper must instantiate.

    The wrapper runs the slave module again for each instance and keeps its classes. It also
    releases a reference to the module's namespace that it does not own. Therefore one class serves
    all instances, and each call adds the missing reference.

    Parameters
    ----------
    namespace : dict
        ``globals()`` of the slave module.
    """
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(namespace))
    return _CLASSES.setdefault(namespace["__name__"], type("Slave", (Slave,), {}))


_CLASSES: dict[str, type] = {}
"""Classes by the names of their modules, which contain a digest of the payload."""


class Slave(Fmi2Slave):  # type: ignore[misc]
    """Class that the wrapper instantiates with its own `kwargs`, once for each instance."""

    payload: ClassVar[Any] = None
    """Payload, read by the first instance; later its files may be gone."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        # The wrapper adds the folder to sys.path, which other modules of this process share.
        resources = Path(self.resources)
        sys.path[:] = [path for path in sys.path if not path or Path(path) != resources]
        try:
            payload = self.payload or Payload((resources / PICKLE_FILE).read_bytes())
            self._model = Instance(payload)
        except Exception as error:
            needs = (resources / REQUIREMENTS_FILE).read_text(encoding="utf-8").split()
            text = f"{error}; this FMU needs {', '.join(needs)}"
            PYTHON_LOGGER.error("%s: %s", self.instance_name, text)
            raise ImportError(text) from error
        type(self).payload = payload
        for note in payload.notes:
            self._report(Fmi2Status.warning, note)

    def _report(self, status: Fmi2Status, text: str) -> None:
        text = f"{self.instance_name}: {text}"
        # importers treat it as a printf format
        self.log(text.replace("%", "%%"), status, LOG_CATEGORY)
        if status == Fmi2Status.error:
            # the wrapper drops all messages unless logging is on
            PYTHON_LOGGER.error("%s", text)

    def _calling(self, what: str, method: str, *arguments: Any) -> Any:
        """Call a method of the model; if it fails, log the error and return None."""
        try:
            return getattr(self._model, method)(*arguments)
        except BaseException as error:  # noqa: BLE001 - no exception may reach the wrapper
            self._report(Fmi2Status.error, f"{what} failed: {_explained(error)}")
            return None

    def setup_experiment(self, start_time: float, *_others: Any) -> None:
        """Set the start time [s]; the internal solver needs neither stop time nor tolerance."""
        self._calling("setting up the experiment", "set_up", start_time)

    def exit_initialization_mode(self) -> None:
        """End the initialization."""
        self._calling("initialization", "initialize")

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Advance from `current_time` [s] by `step_size` [s]; the wrapper maps False to fmi2Discard."""
        what = f"the step of {step_size:g} s from t = {current_time:g} s"
        return bool(self._calling(what, "step", current_time, step_size))

    def terminate(self) -> None:
        """Terminate the run."""
        self._calling("termination", "terminate")

    def get_real(self, vrs: list[int]) -> list[float]:
        """Return values, or NaN if reading fails."""
        return self._calling("reading values", "get", vrs) or [math.nan] * len(vrs)

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        """Set `values` [as declared] by the value references `vrs`."""
        self._calling("setting values", "set", vrs, values)

    def _refuse(self, vrs: list[int], *_values: object) -> list[Any]:
        """Log an error, because all variables are of type Real."""
        self._report(
            Fmi2Status.error,
            f"all variables are of type Real; value references {vrs} were used otherwise",
        )
        return [False] * len(vrs)

    get_integer = get_boolean = set_integer = set_boolean = set_string = _refuse

    def get_string(self, vrs: list[int]) -> list[str]:
        """Log an error, because all variables are of type Real."""
        return [""] * len(self._refuse(vrs))

    def _get_fmu_state(self) -> Any:
        return self._calling("saving the state", "save")

    def _set_fmu_state(self, state: Any) -> None:
        self._calling("restoring a state", "restore", state)

    @classmethod
    def _fmu_state_to_bytes(cls, state: Any) -> bytes:
        try:
            return encode(state, cls.payload.identity)
        except BaseException:  # noqa: BLE001 - a class method has no instance to log with
            return b""

    @classmethod
    def _fmu_state_from_bytes(cls, data: bytes) -> Any:
        try:
            return decode(data, cls.payload.identity)
        except BaseException as error:  # noqa: BLE001 - logged when the state is restored
            return str(error)

    def __del__(self) -> None:
        with contextlib.suppress(BaseException):
            self._model.close()


def _explained(error: BaseException) -> str:
    """Return the message of an error, with the traceback if the user's code raised it."""
    own = type(error).__module__.startswith(__name__.partition(".fmu.")[0] + ".")
    if own and error.__cause__ is None:
        return str(error)
    return "".join(traceback.format_exception(error)).rstrip()
