"""Error of the models: data from which no model can be built."""

from trussflow.blocks.errors import TrussflowError


class ModelError(TrussflowError, ValueError):
    """Invalid data of a truss, an arm or a system, or an invalid file with such data."""
