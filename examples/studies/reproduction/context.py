"""What the sections of the report are written from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import xarray as xr
from study_tools.ledger import Ledger

from reproduction.results import Results


@dataclass(frozen=True, slots=True)
class Context:
    """What sections are written from.

    Attributes
    ----------
    results : Results
        Finished missions.
    maps : mapping
        Other finished jobs, by name.
    ledger : Ledger
        Takes down the numbers.
    folder : pathlib.Path
        Of the report; sections put their figures there.
    claims : list of dict
        Filled by the section on claims.
    """

    results: Results
    maps: Mapping[str, xr.Dataset]
    ledger: Ledger
    folder: Path
    claims: list[dict[str, Any]] = field(default_factory=list)
