"""Exceptions, one class per cause; a message names the object, the place and the remedy."""

from __future__ import annotations

import functools
import importlib
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Concatenate, ParamSpec, TypeVar

P = ParamSpec("P")
D = TypeVar("D")
R = TypeVar("R")


class TrussflowError(Exception):
    """Base of all errors that trussflow raises intentionally.

    Attributes
    ----------
    result : xarray.Dataset or None
        Logged data up to the error, if a simulation was running.
    """

    result: object = None


class BlockError(TrussflowError, ValueError):
    """A declaration or an argument of a block is wrong."""


class ParameterError(BlockError):
    """A parameter is unknown, missing, of the wrong size, or not physical."""


class NameLookupError(TrussflowError, AttributeError):
    """A port, parameter, state or block name does not exist."""


class DiagramError(TrussflowError, ValueError):
    """A diagram cannot be built.

    Attributes
    ----------
    diagram : Diagram or None
        The faulty diagram, if known; a notebook shows its picture above the message.
    """

    diagram: Any = None

    def _render_traceback_(self) -> Any:
        """Show the picture, and return the lines of the traceback below it; notebooks call this method."""
        shell, pictures = (
            importlib.import_module(name) for name in ("IPython", "IPython.display")
        )
        if self.diagram is not None:
            pictures.display(pictures.SVG(self.diagram.draw()))
        lines = shell.get_ipython().InteractiveTB.structured_traceback
        return lines(type(self), self, self.__traceback__)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the error without the diagram, which may contain objects that cannot be pickled."""
        return (
            type(self),
            self.args,
            {k: v for k, v in vars(self).items() if k != "diagram"},
        )


def pictured(method: Callable[Concatenate[D, P], R]) -> Callable[Concatenate[D, P], R]:
    """Set the attribute `diagram` of errors that a diagram's `method` raises."""

    @functools.wraps(method)
    def call(self: D, /, *args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return method(self, *args, **kwargs)
        except DiagramError as error:
            error.diagram = self if error.diagram is None else error.diagram
            raise

    return call


class WiringError(DiagramError):
    """Two ports cannot be connected."""


class OpenInputError(DiagramError):
    """An input has no driver."""


class AlgebraicLoopError(DiagramError):
    """Outputs depend on themselves within one instant."""


class TracingError(TrussflowError, ValueError):
    """The equations of a block cannot be traced."""


class SimulationError(TrussflowError, ValueError):
    """A simulation has arguments that are not allowed."""


class LinearAnalysisError(TrussflowError, ValueError):
    """A linear model does not exist."""


class TrimError(LinearAnalysisError):
    """No operating point meets the conditions; the message lists the violated ones.

    Attributes
    ----------
    best : object
        The point with the smallest violation, an `OperatingPoint`.
    """

    best: object = None


class DivergenceError(TrussflowError, ArithmeticError):
    """A signal stopped being finite during a run; `result` ends with the last good step."""


class TimeLimitError(TrussflowError, TimeoutError):
    """A run exceeded its time limit; `result` has the data logged until then."""


class RunEndedError(TrussflowError):
    """A block, such as an FMU, ended the run early; `result` has all rows before, status "ended"."""


class RunStoppedError(RunEndedError):
    """A block ended the run as intended: `simulate` returns the result."""


class SimulationWarning(UserWarning):
    """A run was completed, but its result has a limitation that the user should know."""


class SimulationInterrupted(KeyboardInterrupt):
    """The user stopped a run, a sweep or a search with Ctrl-C.

    Attributes
    ----------
    result : xarray.Dataset or Tuned
        Result up to the interruption.
    """

    def __init__(self, message: str, result: object = None) -> None:
        super().__init__(message)
        self.result = result


@dataclass
class Explained(AbstractContextManager[None, None]):
    """Context manager around user code: it converts exceptions other than `TrussflowError`.

    Attributes
    ----------
    explain : callable
        Returns the `TrussflowError` for another exception.
    """

    explain: Callable[[Exception], TrussflowError]

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if isinstance(error, Exception) and not isinstance(error, TrussflowError):
            raise self.explain(error) from error
