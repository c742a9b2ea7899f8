"""Texts of files in the packages, and JSON in scripts of pages."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import Any


@cache
def package_text(name: str, package: str) -> str:
    """Return the text of the file with that `name` in the folder of a `package`."""
    return files(package).joinpath(name).read_text(encoding="utf-8")


def script_json(data: Any, **settings: Any) -> str:
    """Return `data` as JSON that cannot end the script element around it, with `settings` of `json.dumps`."""
    text = json.dumps(data, separators=(",", ":"), **settings)
    return text.replace("<", "\\u003c")
