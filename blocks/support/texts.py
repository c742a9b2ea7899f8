"""Texts of files in the packages, and JSON in scripts of pages."""

from __future__ import annotations

import json
from functools import cache
from html import escape
from importlib.resources import files
from string import Template
from typing import Any


@cache
def package_text(name: str, package: str) -> str:
    """Return the text of the file with that `name` in the folder of a `package`."""
    return files(package).joinpath(name).read_text(encoding="utf-8")


def page_text(package: str, title: str, **parts: str) -> str:
    """Return the page of a `package` with a `title` and further `parts`; all pages share charts and style.

    Parameters
    ----------
    package : str
        Package with the files ``page.html``, ``page.css`` and ``page.js``.
    title : str
        Title.
    **parts : str
        Texts for the other places of ``page.html``.
    """
    shared = __package__ or ""
    return Template(package_text("page.html", package)).substitute(
        title=escape(title),
        style=package_text("base.css", shared) + package_text("page.css", package),
        script=package_text("chart.js", shared) + package_text("page.js", package),
        **parts,
    )


def script_json(data: Any, **settings: Any) -> str:
    """Return `data` as JSON that cannot end the script element around it, with `settings` of `json.dumps`."""
    text = json.dumps(data, separators=(",", ":"), **settings)
    return text.replace("<", "\\u003c")
