"""One exception class per cause; every message names what, where, and what to do."""

from __future__ import annotations

import functools
import importlib
from collections.abc import Callable
from types import TracebackType
from typing import Any, Concatenate, ParamSpec, TypeVar

P = ParamSpec("P")
D = TypeVar("D")
R = TypeVar("R")


class TrussflowError(Exception):
    """Base of every error that trussflow raises on purpose.

    Attributes
    ----------
    result : xarray.Dataset or None
        If a simulation was running: what was logged until then.
    """

    result: object = None


class BlockError(TrussflowError, ValueError):
    """A block is declared or constructed wrongly."""


class ParameterError(BlockError):
    """A parameter is unknown, missing, of the wrong size, or not physical."""


class NameLookupError(TrussflowError, AttributeError):
    """A port, parameter, state or block name does not exist."""


class DiagramError(TrussflowError, ValueError):
    """A diagram cannot be built as it stands.

    Attributes
    ----------
    diagram : Diagram or None
        The one at fault where that is known; a notebook shows its picture above the message.
    """

    diagram: Any = None

    def _render_traceback_(self) -> Any:
        """Show the picture, and return the lines that stand below it; notebooks call this."""
        shell, pictures = (importlib.import_module(name) for name in ("IPython", "IPython.display"))
        if self.diagram is not None:
            pictures.display(pictures.SVG(self.diagram.draw()))
        lines = shell.get_ipython().InteractiveTB.structured_traceback
        return lines(type(self), self, self.__traceback__)

    def __reduce__(self) -> tuple[Any, ...]:
        """Go to other processes without the diagram, which may hold what cannot."""
        return type(self), self.args, {k: v for k, v in vars(self).items() if k != "diagram"}


def pictured(method: Callable[Concatenate[D, P], R]) -> Callable[Concatenate[D, P], R]:
    """Let errors of a diagram's `method` know the diagram."""

    @functools.wraps(method)
    def call(self: D, /, *args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return method(self, *args, **kwargs)
        except DiagramError as error:
            error.diagram = self if error.diagram is None else error.diagram
            raise

    return call


class WiringError(DiagramError):
    """Two ports do not fit each other."""


class OpenInputError(DiagramError):
    """An input is driven by nothing."""


class AlgebraicLoopError(DiagramError):
    """Outputs depend on themselves within one instant."""


class TracingError(TrussflowError, ValueError):
    """The equations of a block cannot be traced."""


class SimulationError(TrussflowError, ValueError):
    """A simulation is asked for with arguments that make no sense."""


class LinearAnalysisError(TrussflowError, ValueError):
    """A linear model is asked for that does not exist."""


class TrimError(LinearAnalysisError):
    """No operating point meets the conditions; the message says which are violated.

    Attributes
    ----------
    best : object
        The best point found, an `OperatingPoint`.
    """

    best: object = None


class DivergenceError(TrussflowError, ArithmeticError):
    """A signal stopped being finite during a run; `result` ends with the last good step."""


class TimeLimitError(TrussflowError, TimeoutError):
    """A run took longer than it was allowed to; `result` has what was logged until then."""


class RunEndedError(TrussflowError):
    """A block ended the run before its time, as an FMU may; `result` has all rows before, status "ended"."""


class RunStoppedError(RunEndedError):
    """A block ended the run as it was asked to: `simulate` returns the result."""


class SimulationWarning(UserWarning):
    """A run went on to its end, but something about its result should be known."""


class SimulationInterrupted(KeyboardInterrupt):
    """The user stopped a run, a sweep or a search with Ctrl-C.

    Attributes
    ----------
    result : xarray.Dataset or Tuned
        What there was until then.
    """

    def __init__(self, message: str, result: object = None) -> None:
        super().__init__(message)
        self.result = result


class Explained:
    """A ``with`` block around code of others: our errors pass, any other is explained.

    Parameters
    ----------
    explain : callable
        Returns the error of ours that tells of another one.
    """

    def __init__(self, explain: Callable[[Exception], TrussflowError]) -> None:
        self._explain = explain

    def __enter__(self) -> None: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if isinstance(error, Exception) and not isinstance(error, TrussflowError):
            raise self._explain(error) from error
