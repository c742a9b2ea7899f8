"""Loading of a pickled block in an FMU, where this package has another name."""

from __future__ import annotations

import importlib
import io
import pickle
from types import ModuleType
from typing import Any

PUBLIC_PACKAGE = "trussflow"
"""Name of this package when the block was pickled."""

BUNDLED_PACKAGES = ("cloudpickle",)
"""Packages copied under the private name, because other versions may not read the pickle."""


class Unpickler(pickle.Unpickler):
    """Unpickler that loads this package and the bundled packages from the private copies.

    Parameters
    ----------
    data : bytes
        The pickle.
    private : str
        Name of the package with the copies.
    """

    def __init__(self, data: bytes, private: str) -> None:
        super().__init__(io.BytesIO(data))
        self._private = private

    def find_class(self, module: str, name: str) -> Any:
        """Return the class or function pickled as `name` of `module`."""
        if module.partition(".")[0] == "cloudpickle" and name == "subimport":
            return self._module
        return super().find_class(self.renamed(module), name)

    def renamed(self, module: str) -> str:
        """Return the name of a module in this process."""
        top, dot, rest = module.partition(".")
        if top == PUBLIC_PACKAGE:
            return self._private + dot + rest
        return f"{self._private}.{module}" if top in BUNDLED_PACKAGES else module

    def _module(self, name: str) -> ModuleType:
        return importlib.import_module(self.renamed(name))
