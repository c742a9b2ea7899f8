"""Errors of FMU import and export, and their logger; each message names the object, the fault and the remedy."""

import logging

from trussflow.blocks.errors import RunEndedError, TrussflowError
from trussflow.blocks.framework.run_state import StepDiscardedError

PYTHON_LOGGER = logging.getLogger("trussflow_fmu")
"""Python logger of the Python FMUs of trussflow, by default the standard error stream; their wrapper
drops messages unless logging is on."""


class ExportError(TrussflowError, ValueError):
    """A block or diagram cannot be exported."""


class FmuError(TrussflowError, ValueError):
    """An imported FMU is invalid or used wrongly."""


class FmuArchiveError(FmuError):
    """The file is not an FMU, or unpacking it would be unsafe."""


class FmuDescriptionError(FmuError):
    """The model description is missing, invalid, unsafe or contradictory."""


class FmuBinaryError(FmuError):
    """The FMU has no binary for this machine, or it cannot be loaded."""


class FmuUnitError(FmuError):
    """A unit of the FMU is unknown, or has another dimension than the requested one."""


class FmuCallError(FmuError):
    """A function of the FMU failed; the message includes the FMU's log.

    Attributes
    ----------
    status : int
        FMI status of the call: 2 discard, 3 error, 4 fatal.
    """

    status: int = 3


class FmuDiscardError(FmuCallError, StepDiscardedError):
    """The FMU discarded a step and all its subdivisions."""

    status = 2


class FmuEndedError(FmuError, RunEndedError):
    """The FMU requested the end of the run, which is not an error of the model."""


class FmuEndedStepError(FmuDiscardError, FmuEndedError):
    """The FMU requested the end of the run in a discarded step; a shorter step may succeed.

    Some tools request the end whenever they discard a step.
    """


class FmuTimeoutError(FmuCallError):
    """The FMU did not return within its time limit, and its process was ended."""


class FmuCrashError(FmuCallError):
    """The process of the FMU ended unexpectedly."""


class SspError(FmuError):
    """A system structure (SSP) is invalid, or uses features that diagrams do not support."""
