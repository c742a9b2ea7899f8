"""What an FMU carries: the pickled block, and the facts of its interface."""

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

FOLDER, PICKLE, FACTS = "content", "item.pickle", "facts.json"
"""Where it is, within the private package."""

PRIVATE = __name__.partition(".fmu.")[0]
"""Name of the package this module is part of: a private one within an FMU."""


class Content:
    """The block of one FMU, loaded once per process.

    Parameters
    ----------
    pickled : bytes
        The block.
    facts : dict
        What `export` wrote down: solver, step, start values and names of all variables.
    compiled : bool
        Whether to use a C compiler where there is one.

    Attributes
    ----------
    notes : list of str
        What users should know about how it runs here.

    Raises
    ------
    RuntimeError
        If the pickle holds code for another version of Python.
    """

    def __init__(self, pickled: bytes, facts: dict[str, Any], *, compiled: bool = True) -> None:
        self.facts = facts
        self.notes: list[str] = []
        here = f"{sys.version_info.major}.{sys.version_info.minor}"
        if facts["python"] not in (None, here):
            raise RuntimeError(
                f"this FMU holds code of its author's, compiled for Python {facts['python']}; "
                f"this is Python {here}"
            )
        self._shared = self._prepared(Unpickler(pickled, PRIVATE).load(), compiled)

    @property
    def names(self) -> list[str]:
        """Names of the scalars, by value reference."""
        return list(self.facts["names"])

    def vector(self, name: str) -> Any:
        """Return one of the vectors among the facts."""
        return np.array(self.facts[name], dtype=float)

    def session(self) -> Session:
        """Return a session of its own for one instance; all share one plan."""
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
    """Load the content beside this package.

    Importers delete what they unpacked, and may unpack the same FMU again while this process
    keeps the modules of the first time: nothing may be left to be read later.

    Parameters
    ----------
    compiled : bool
        Whether to use a C compiler where there is one.
    """
    package = importlib.import_module(PRIVATE)
    folder = Path(str(package.__file__)).parent
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        blocks = importlib.import_module(f"{PRIVATE}.blocks")
        for module in pkgutil.walk_packages(blocks.__path__, f"{blocks.__name__}."):
            importlib.import_module(module.name)
    facts = json.loads((folder / FOLDER / FACTS).read_text(encoding="utf-8"))
    return Content((folder / FOLDER / PICKLE).read_bytes(), facts, compiled=compiled)


content = cache(load)
"""Returns the content beside this package, loaded once per process with everything it will need."""
