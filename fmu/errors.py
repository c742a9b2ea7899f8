"""Errors of FMU exchange; every message names what, where, and what to do."""

from trussflow.blocks.framework.errors import RunEndedError, SimulationError, TrussflowError
from trussflow.blocks.framework.running import StepDiscardedError
from trussflow.blocks.framework.validation import positive_if_given


class ExportError(TrussflowError, ValueError):
    """A block or diagram cannot be exported as an FMU as it stands."""


class FmuError(TrussflowError, ValueError):
    """Something is wrong with an FMU that is imported, or with how it is used."""


class FmuArchiveError(FmuError):
    """The file is no FMU, or unpacking it would do harm."""


class FmuDescriptionError(FmuError):
    """The model description is missing, broken, hostile, or says what cannot be."""


class FmuBinaryError(FmuError):
    """The FMU has no binary for this machine, or it cannot be loaded."""


class FmuUnitError(FmuError):
    """A unit of the FMU is unknown here, or does not fit the one asked for."""


class FmuCallError(FmuError):
    """A function of the FMU failed; the message has what the FMU logged.

    Attributes
    ----------
    status : int
        What the function returned: 2 discard, 3 error, 4 fatal.
    """

    status: int = 3


class FmuDiscardError(FmuCallError, StepDiscardedError):
    """The FMU discarded a step, and parts of it."""

    status = 2


class FmuEndedError(FmuError, RunEndedError):
    """The FMU asked to end the run: the model says that it is over, which is no fault."""


class FmuEndedStepError(FmuDiscardError, FmuEndedError):
    """The FMU asked to end the run in a step that it discarded; a shorter one may do.

    Some tools ask for that whenever they discard a step.
    """


class FmuTimeoutError(FmuCallError):
    """The FMU did not return within its time limit, and its process was ended."""


class FmuCrashError(FmuCallError):
    """The FMU's process ended by itself while the FMU was running."""


class SspError(FmuError):
    """A system structure (SSP) is broken, or says what a diagram cannot do."""


def check_positive(kind: type[TrussflowError], where: str, **values: float | None) -> None:
    """Refuse `values` [any] that are given and not positive and finite, by an error of that `kind`.

    The message begins with `where`.
    """
    try:
        positive_if_given(**values)
    except SimulationError as error:
        raise kind(f"{where}: {error}") from None
