"""Data of the studies in TOML files: runs, metrics, claims, tables."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any


def data_beside(module: str, name: str) -> dict[str, Any]:
    """Return the content of a TOML file in the folder of a module.

    Parameters
    ----------
    module : str
        ``__file__`` of the module.
    name : str
        Name of the TOML file.
    """
    return tomllib.loads(Path(module).with_name(name).read_text(encoding="utf-8"))
