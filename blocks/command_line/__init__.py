"""Block diagrams for guidance and control: import from trussflow.blocks, trussflow.models, trussflow.fmu.

This package holds nothing but its version and the command `trussflow`; it imports none of the others.
"""

from importlib.metadata import PackageNotFoundError as _NotInstalled
from importlib.metadata import version as _version

try:
    __version__ = _version("trussflow")
except _NotInstalled:  # the folders are used as they are
    __version__ = "unknown"


def __getattr__(name: str) -> None:
    """Say where things are that are looked for here."""
    raise AttributeError(
        f"module 'trussflow' has no '{name}': blocks, diagrams and simulation are in trussflow.blocks, the "
        f"space truss in trussflow.models, FMUs in trussflow.fmu; write 'from trussflow.blocks import {name}'"
    )
