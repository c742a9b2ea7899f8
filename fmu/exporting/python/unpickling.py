"""Loading a pickled block in an FMU, where this package has another name."""

from __future__ import annotations

import importlib
import io
import pickle
from types import ModuleType
from typing import Any

PACKAGE = "trussflow"
"""The name that the package had when the block was pickled."""

BESIDE = ("cloudpickle",)
"""Packages bundled under the private name too: another version could not read the pickle."""


class Unpickler(pickle.Unpickler):
    """Takes everything of this package, and of those bundled with it, from the private copies.

    Parameters
    ----------
    data : bytes
        The pickle.
    private : str
        Name of the package that holds the copies.
    """

    def __init__(self, data: bytes, private: str) -> None:
        super().__init__(io.BytesIO(data))
        self._private = private

    def find_class(self, module: str, name: str) -> Any:
        """Return the class or function that was pickled by this `name` in this `module`."""
        if module.partition(".")[0] == "cloudpickle" and name == "subimport":
            return self._module
        return super().find_class(self.renamed(module), name)

    def renamed(self, module: str) -> str:
        """Return the name of a module in this process."""
        top, dot, rest = module.partition(".")
        if top == PACKAGE:
            return self._private + dot + rest
        return f"{self._private}.{module}" if top in BESIDE else module

    def _module(self, name: str) -> ModuleType:
        return importlib.import_module(self.renamed(name))
