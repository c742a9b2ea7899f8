"""Payload of a Python FMU: the pickled block and the facts of its interface."""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.block import Block
from trussflow.blocks.simulation.session import Session
from trussflow.blocks.support.types import Vector
from trussflow.blocks.tracing.compile_cache import CompilationError

PICKLE_FILE = "item.pickle"
"""File of the payload in the folder ``resources``."""

REQUIREMENTS_FILE = "requirements.txt"
"""File of the required packages in the folder ``resources``."""


class Payload:
    """The block of one FMU, loaded once per process.

    Parameters
    ----------
    pickled : bytes
        The block and the facts of its interface.
    compiled : bool
        Whether to use a C compiler if there is one.

    Attributes
    ----------
    identity : dict of str to str
        Identity of the saved states of this FMU.
    names : list of str
        Names of the scalars, by value reference.
    values : Vector
        Start values of the scalars, zero if they are calculated [units as declared].
    early, late : array of bool
        Whether each scalar may be set before and after the end of initialization.
    notes : list of str
        Messages for the user about the execution on this machine.
    """

    identity: dict[str, str]
    names: list[str]
    values: Vector
    early: NDArray[np.bool_]
    late: NDArray[np.bool_]
    settings: dict[str, Any]

    def __init__(self, pickled: bytes, *, compiled: bool = True) -> None:
        self.notes: list[str] = []
        item, facts = _Unpickler(io.BytesIO(pickled)).load()
        vars(self).update(facts)
        self._shared = self._prepared(item, compiled)

    def session(self) -> Session:
        """Return a new session for one instance; all sessions share one plan."""
        return self._shared.twin()

    def _prepared(self, item: Block, compiled: bool) -> Session:
        if compiled:
            try:
                return Session(item, backend="compiled", **self.settings)
            except CompilationError as error:
                self.notes.append(
                    f"the model runs in CasADi's interpreter, because {error}"
                )
        return Session(item, backend="interpreted", **self.settings)


class _Unpickler(pickle.Unpickler):
    """Unpickler that makes new classes for the user's code.

    cloudpickle alone would find the class of an earlier load, or of the exporting script, in the same
    process, and change it in place.
    """

    def find_class(self, module: str, name: str) -> Any:
        found = super().find_class(module, name)
        of_class = module.partition(".")[0] == "cloudpickle" and name.startswith(
            "_make_skeleton_"
        )
        return partial(_untracked, found) if of_class else found


def _untracked(make: Callable[..., type], *arguments: Any) -> type:
    """Call cloudpickle's maker of a class without the identifier of the class."""
    *shape, _identifier, extra = arguments
    return make(*shape, None, extra)
