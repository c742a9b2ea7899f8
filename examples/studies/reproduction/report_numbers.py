"""Numbers of the report by name; a text quotes them in braces."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from study_tools.ledger import Ledger

from trussflow.models.reporting.tables import markdown_table

FIELD = re.compile(r"\{([^{}]+: [^{}]+)\}")
RUN = re.compile(r"case\d[^\s:]*")

Measures = Mapping[str, Mapping[str, Any]]
"""Numbers by name, keyed by the run or by another subject, such as ``"criterion"``."""

ROBOTS = (1, 2, 3, 4)
FORMATS: dict[str, tuple[str, int]] = {
    name: form
    for form, names in {
        ("m", 3): [
            "peak position error",
            "late position error",
            "peak sideways error",
            *(f"peak elastic displacement at grasp {i}" for i in ROBOTS),
            *(f"distance of grasp {i}" for i in ROBOTS),
        ],
        ("m", 2): ["predicted limit cycle", "diameter of the rods"],
        ("rad", 3): [
            "peak attitude error",
            "late attitude error",
            "peak joint error",
            "peak angle of C41",
        ],
        ("rad/s", 3): ["peak rate of C41", "predicted frequency of mode 1"],
        ("kg**0.5*m", 3): ["modal ripple"],
        ("N", 3): ["force ripple", "peak base force, Robot 3"],
        ("N*m", 3): [
            "peak base torque",
            "peak joint torque",
            "claimed base torque",
            "claimed joint torque",
            "claimed torque",
        ],
        ("N*m", 2): ["torque bound"],
        ("N*s", 3): ["impulse of the base forces"],
        ("m/s", 3): ["velocity ripple"],
        ("kg*m^2", 2): ["largest difference of inertias"],
        ("kg/m^3", 5): ["density"],
        ("s", 3): ["duration", "time of the claimed torque"],
        ("s", 1): ["ripple window", "step"],
        ("%", 3): [
            "share of Robots 1, 2, 4",
            "time of V above its bound",
            "time in which V must fall",
            "late part",
        ],
        ("%", 2): [
            *(f"share of Robot {i}" for i in ROBOTS),
            "excess over the torque bound",
            "largest frequency error",
            "largest frequency error, inner edge",
            "most",
            "largest relative difference",
            "stable damping",
            "stable damping for all mode counts",
        ],
        ("%", 1): ["nearly nothing", "smooth"],
        ("1/s", 3): [
            "L",
            "sigma",
            "least sigma",
            "rho",
            "pole",
            "simulated",
            "measured growth of mode 1",
            "predicted growth of mode 1",
        ],
        ("1/s", 2): ["largest difference near the axis"],
        ("1/s", 1): ["least distance from the axis"],
        ("", 2): [
            "largest jump of force per peak",
            "peak position error per displacement",
            "advantage",
            "late advantage",
        ],
        ("", 1): ["small", "notable"],
    }.items()
    for name in names
}
"""Unit and significant digits of each number; those of others are none and three, of integers all."""


class Numbers:
    """Numbers of the report.

    The name ``"case1: force ripple"`` is that of a measure of a run, ``"case1-smc / case1: force ripple"``
    the ratio of the measures of two runs. In the names of a claim, ``#`` is the number of its case.

    Parameters
    ----------
    measures : mapping
        All numbers.
    ledger : Ledger
        Record of the quoted numbers.
    case : int or str
        Case of a claim, or name of the run after "case" [-].

    Attributes
    ----------
    runs : dict
        Runs whose numbers were used, as keys.
    """

    def __init__(
        self, measures: Measures, ledger: Ledger, case: int | str = ""
    ) -> None:
        self.measures, self.ledger, self.case = measures, ledger, case
        self.runs: dict[str, None] = {}

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
