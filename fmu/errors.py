"""Errors of FMU exchange; every message names what, where, and what to do."""

from trussflow.blocks.framework.errors import TrussflowError


class ExportError(TrussflowError, ValueError):
    """A block or diagram cannot be exported as an FMU as it stands."""
