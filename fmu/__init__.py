"""FMU import and export of blocks and diagrams."""

from trussflow.fmu.errors import ExportError as ExportError
from trussflow.fmu.errors import FmuArchiveError as FmuArchiveError
from trussflow.fmu.errors import FmuBinaryError as FmuBinaryError
from trussflow.fmu.errors import FmuCallError as FmuCallError
from trussflow.fmu.errors import FmuCrashError as FmuCrashError
from trussflow.fmu.errors import FmuDescriptionError as FmuDescriptionError
from trussflow.fmu.errors import FmuError as FmuError
from trussflow.fmu.errors import FmuTimeoutError as FmuTimeoutError
from trussflow.fmu.errors import FmuUnitError as FmuUnitError
from trussflow.fmu.errors import SspError as SspError
from trussflow.fmu.exporting.export import export as export
from trussflow.fmu.importing.block import Fmu as Fmu
