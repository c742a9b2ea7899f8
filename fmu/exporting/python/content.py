"""Content of an FMU: the pickled block and the facts of its interface."""

from __future__ import annotations

import importlib
import json
import pkgutil
import sys
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from trussflow.blocks.framework.block import Block
from trussflow.blocks.simulation.session import Session
from trussflow.blocks.tracing.compile_cache import CompilationError
from trussflow.blocks.tracing.compiler import find_compiler
from trussflow.fmu.exporting.python.unpickling import Unpickler

CONTENT_FOLDER, PICKLE_FILE, FACTS_FILE = "content", "item.pickle", "facts.json"
"""Folder and files of the content, within the private package."""

PRIVATE_PACKAGE = __name__.partition(".fmu.")[0]
"""Name of the package of this module, which is a private one within an FMU."""


class Content:
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
    notes : list of str
        Messages for the user about the execution on this machine.

    Raises
    ------
    RuntimeError
        If the pickle contains code for another version of Python.
    """

    def __init__(self, pickled: bytes, facts: dict[str, Any], *, compiled: bool = True) -> None:
        self.facts = facts
        self.notes: list[str] = []
        here = f"{sys.version_info.major}.{sys.version_info.minor}"
        if facts["python"] not in (None, here):
            raise RuntimeError(
                f"this FMU contains its author's code, compiled for Python {facts['python']}; "
                f"this is Python {here}"
            )
        self._shared = self._prepared(Unpickler(pickled, PRIVATE_PACKAGE).load(), compiled)

    @property
    def names(self) -> list[str]:
        """Names of the scalars, by value reference."""
        return list(self.facts["names"])

    def vector(self, name: str) -> Any:
        """Return a vector of the facts."""
        return np.array(self.facts[name], dtype=float)

    def session(self) -> Session:
        """Return a new session for one instance; all sessions share one plan."""
        return self._shared.twin()

    def _prepared(self, item: Block, compiled: bool) -> Session:
        settings = {"step": self.facts["step"], "solver": self.facts["solver"]}
        if compiled and find_compiler() is None:
            self.notes.append("there is no C compiler here: the model runs in CasADi's interpreter")
        elif compiled:
            try:
                return Session(item, backend="compiled", **settings)
            except CompilationError as error:
                self.notes.append(f"the model runs in CasADi's interpreter, because {error}")
        return Session(item, backend="interpreted", **settings)


def load(*, compiled: bool = True) -> Content:
    """Load the content of this package, and all its modules.

    Importers delete the unpacked files, and may unpack the same FMU again while this process keeps
    the modules that it has loaded. Therefore no file may be read later.

    Parameters
    ----------
    compiled : bool
        Whether to use a C compiler if there is one.
    """
    package = importlib.import_module(PRIVATE_PACKAGE)
    folder = Path(str(package.__file__)).parent
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        blocks = importlib.import_module(f"{PRIVATE_PACKAGE}.blocks")
        for module in pkgutil.walk_packages(blocks.__path__, f"{blocks.__name__}."):
            importlib.import_module(module.name)
    facts = json.loads((folder / CONTENT_FOLDER / FACTS_FILE).read_text(encoding="utf-8"))
    return Content((folder / CONTENT_FOLDER / PICKLE_FILE).read_bytes(), facts, compiled=compiled)


content = cache(load)
"""Cached `load`: the content is loaded once per process."""
