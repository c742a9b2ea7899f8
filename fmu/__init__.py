"""Exchange of blocks and diagrams with other tools as FMUs."""

from trussflow.fmu.errors import ExportError as ExportError
from trussflow.fmu.export import export as export
