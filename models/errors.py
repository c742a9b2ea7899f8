"""The error of the physics: data that no model can be built from."""

from trussflow.blocks.framework.errors import TrussflowError


class ModelError(TrussflowError, ValueError):
    """The data of a truss, an arm or a system, or a file that holds them, cannot be used."""
