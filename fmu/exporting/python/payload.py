"""Payload of a Python FMU: the pickled block and the facts of its interface."""

from __future__ import annotations

import io
import json
import pickle
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np

from trussflow.blocks.framework.block import Block
from trussflow.blocks.simulation.session import Session
from trussflow.blocks.tracing.compile_cache import CompilationError
from trussflow.blocks.tracing.compiler import find_compiler

PICKLE_FILE, FACTS_FILE = "item.pickle", "facts.json"
"""Files of the payload in the folder ``resources``."""

REQUIREMENTS_FILE = "requirements.txt"
"""File of the required packages in the folder ``resources``."""


class Payload:
    """The block of one FMU, loaded once per process.

    Parameters
    ----------
    pickled : bytes
        The block.
    facts : dict
        Settings from the export: solver, step, start values and names of all variables.
    compiled : bool
        Whether to use a C compiler if there is one.

    Attributes
    ----------
    identity : dict of str to str
        Identity of the saved states of this FMU.
    names : list of str
        Names of the scalars, by value reference.
    notes : list of str
        Messages for the user about the execution on this machine.

    Raises
    ------
    RuntimeError
        If the pickle contains code for another version of Python.
    """

    def __init__(
        self, pickled: bytes, facts: dict[str, Any], *, compiled: bool = True
    ) -> None:
        self.facts = facts
        self.identity = {"FMU": facts["token"]}
        self.names: list[str] = facts["names"]
        self.notes: list[str] = []
        here = f"{sys.version_info.major}.{sys.version_info.minor}"
        if facts["python"] not in (None, here):
            raise RuntimeError(
                f"this FMU contains its author's code, compiled for Python {facts['python']}; "
                f"this is Python {here}"
            )
        self._shared = self._prepared(_Unpickler(io.BytesIO(pickled)).load(), compiled)

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Return the payload in the folder ``resources`` of an unpacked FMU."""
        facts = json.loads((folder / FACTS_FILE).read_text(encoding="utf-8"))
        return cls((folder / PICKLE_FILE).read_bytes(), facts)

    def vector(self, name: str) -> Any:
        """Return a vector of the facts."""
        return np.array(self.facts[name], dtype=float)

    def session(self) -> Session:
        """Return a new session for one instance; all sessions share one plan."""
        return self._shared.twin()

    def _prepared(self, item: Block, compiled: bool) -> Session:
        settings = {"step": self.facts["step"], "solver": self.facts["solver"]}
        if compiled and find_compiler() is None:
            self.notes.append(
                "there is no C compiler here: the model runs in CasADi's interpreter"
            )
        elif compiled:
            try:
                return Session(item, backend="compiled", **settings)
            except CompilationError as error:
                self.notes.append(
                    f"the model runs in CasADi's interpreter, because {error}"
                )
        return Session(item, backend="interpreted", **settings)


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
