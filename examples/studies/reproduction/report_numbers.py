"""Numbers of the report by name; a text quotes them in braces."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from study_tools.data_files import data_beside
from study_tools.ledger import Ledger

from trussflow.models.reporting.tables import markdown_table

FIELD = re.compile(r"\{([^{}]+: [^{}]+)\}")
RUN = re.compile(r"case\d[^\s:]*")

Measures = Mapping[str, Mapping[str, Any]]
"""Numbers by name, keyed by the run or by another subject, such as ``"criterion"``."""

ROBOTS = (1, 2, 3, 4)

TABLES = data_beside(__file__, "tables.toml")
"""Columns of the tables, meanings of the changed assumptions, and formats of the numbers."""

FORMATS: dict[str, tuple[str, int]] = {
    name: (form["unit"], form["digits"])
    for form in TABLES["formats"]
    for name in form["names"]
}
"""Unit and significant digits of each number; those of others are none and three, of integers all."""


@dataclass
class Numbers:
    """Numbers of the report.

    The name ``"case1: force ripple"`` is that of a measure of a run, ``"case1-smc / case1: force ripple"``
    the ratio of the measures of two runs. In the names of a claim, ``#`` is the number of its case.

    Attributes
    ----------
    measures : mapping
        All numbers.
    ledger : Ledger
        Record of the quoted numbers.
    case : int or str
        Case of a claim, or name of the run after "case" [-].
    runs : dict
        Runs whose numbers were used, as keys.
    """

    measures: Measures
    ledger: Ledger
    case: int | str = ""
    runs: dict[str, None] = field(default_factory=dict)

    def __getitem__(self, name: str) -> float:
        """Return the value of a number [as in `FORMATS`]."""
        subjects, measure = self._parts(name)
        self.runs |= dict.fromkeys(RUN.findall(name.replace("#", str(self.case))))
        values = [self.measures[each][measure] for each in subjects]
        found = values[0] / values[1] if len(values) > 1 else values[0]
        return found if isinstance(found, int) else float(found)

    def text(self, name: str, *, show_unit: bool = True) -> str:
        """Return a number as text, and record it; a number that is not finite is ``none``.

        Parameters
        ----------
        name : str
            Name of the number.
        show_unit : bool
            Whether the unit follows.
        """
        value = self[name]
        if not math.isfinite(value):
            return "none"
        subjects, measure = self._parts(name)
        ratio = len(subjects) > 1
        unit, digits = ("", 2) if ratio else FORMATS.get(measure, ("", 3))
        name = f"{' / '.join(subjects)}: {measure}"
        runs = RUN.findall(name)
        return self.ledger(
            name, value, unit, runs=runs, digits=digits, show_unit=show_unit
        )

    def filled(self, template: str) -> str:
        """Return a text with the numbers that it names in braces.

        Parameters
        ----------
        template : str
            Text such as ``"the peak is {case1: peak position error}"``.
        """
        return FIELD.sub(lambda field: self.text(field[1]), template)

    def table(
        self, corner: str, rows: Mapping[str, str], columns: Mapping[str, str]
    ) -> str:
        """Return a Markdown table of measures.

        Parameters
        ----------
        corner : str
            Heading of the first column.
        rows : mapping
            Label of each row, keyed by the run.
        columns : mapping
            Measure of each column, keyed by its heading; a heading with a unit replaces those of the cells.
        """
        cells = [
            [
                label,
                *(
                    self.text(f"{run}: {name}", show_unit="[" not in head)
                    for head, name in columns.items()
                ),
            ]
            for run, label in rows.items()
        ]
        return markdown_table((corner, *columns), cells)

    def _parts(self, name: str) -> tuple[list[str], str]:
        """Return the subjects and the measure of a name."""
        subjects, _, measure = name.replace("#", str(self.case)).partition(": ")
        return subjects.split(" / "), measure
