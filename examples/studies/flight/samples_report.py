"""The report on many samples of what is uncertain, flown by each law."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr
from study_tools.cache import code_digest, write_atomically
from study_tools.evidence import write_evidence
from study_tools.ledger import Ledger

from flight.draws import HEAVIEST_DAMPING, HEAVIEST_PAYLOAD, LIGHTEST_DAMPING, UNCERTAIN
from flight.ladder import DURATION, JOINTS, LATE, LAWS, POSITION
from flight.measures import column
from flight.samples import FIRST, UNCERTAINTIES, UNITS, Study, share, what_matters
from flight.sections import SHOWN
from flight.tuned import Tuning
from flight.tuned_section import section
from trussflow.models.reporting.figures import Curve, Panel, drawing, save
from trussflow.models.reporting.metrics import DEFINITIONS
from trussflow.models.reporting.tables import markdown_table

TEXT = """\
# Samples of what is uncertain

How often each law flies Case 1, of {count} trusses drawn around the nominal one, which alone the
controllers know: mass and frequencies within {spread:.0%}, shapes at the grasps by a deviation of
up to {spread:.0%}, damping from {lightest:.1%} to {heaviest:.0%}, up to {payload:g} kg at the far
tip. *Exact*: exact states, held for 1 ms, on the plant that suits the law. *Hardware of the
flight*: a command every 20 ms, 20 ms late, noise, steps and limits of thrust and torque
([docs/flight](../flight/README.md)); the mean axes fly the accurate plant there. A sample flies if
the root errs by at most {position:g} mm and no joint by more than {joints:g} rad, and the root in
the last seconds of {duration:g} s by less than {late:g} mm.

Written by `python -m flight --samples {count} --output docs/sweep` (`make sweep`
flies 1000); every number stands with its full value in [`evidence.json`](evidence.json). Made by
the code of digest `{digest}`; the same with `--check` tells whether that is the code at hand.

## How often each law flies

{shares}

Intervals are of 95 %, by Wilson. Below, the greatest errors of the samples that fly.

{definitions}

{errors}

![Which part of the samples errs by less](samples.png)

## What tuning brings

{tuned}

## What matters

Rank correlations (Spearman) of what was drawn with the greatest error of the root, and with its late error,
of the samples that fly; beyond ±{accident} they are no accident.

{matters}

## The worst

The samples whose root errs most, of those that fly, or else of all: what was drawn, and how far it goes.
A seed makes its truss again (`truss_of`), and its noise (`noise_of`).

{worst}
"""


def write(found: Mapping[Study, xr.Dataset], tuned: tuple[Tuning, xr.Dataset], folder: Path) -> Path:
    """Write report, figure and evidence; return the report's file.

    Parameters
    ----------
    found : mapping
        What `Study.fly` returned, by study.
    tuned : tuple of Tuning and xarray.Dataset
        The study of a tuned design, and what its `fly` returned.
    folder : pathlib.Path
        Of the report.
    """
    folder.mkdir(parents=True, exist_ok=True)
    ledger, count = Ledger(), next(iter(found.values())).sizes["sample"]
    shares, errors, matters, worst, curves = [], [], [], [], []
    for study, swept in found.items():
        note = ledger.of(study.name)
        part, low, high = share(swept["flies"].values)
        number = ledger.count(f"{study.name}: flown", int(swept["flies"].sum()))
        between = f"{note('share, from', low, '%')} to {note('share, to', high, '%', digits=4)}"
        shares.append((study.name, LAWS[study.law].label, number, note("share", part, "%"), between))
        flown = swept.sel(sample=swept["sample"][swept["flies"].values])
        if flown.sizes["sample"]:
            cells = []
            for name, plain in UNITS.items():
                unit, factor = SHOWN[plain]
                for word, value in (("median", flown[name].median()), ("greatest", flown[name].max())):
                    cells.append(note(f"{name}, {word}", factor * float(value), unit, show_unit=False))
            errors.append((study.name, *cells))
            for measure in ("position", "late position"):
                found_here = what_matters(swept, measure)
                cells = [note(f"{measure} by {what}", one, digits=2) for what, one in found_here.items()]
                matters.append((study.name, f"{measure} (norm)", *cells))
        most = flown if flown.sizes["sample"] else swept
        one = most.isel(sample=int(np.argmax(most["position"].fillna(np.inf).values)))
        drawn = [
            note(f"worst: {name}", float(one[name]), unit.strip("1")) for name, unit in UNCERTAINTIES.items()
        ]
        seed = ledger.count(f"{study.name}: worst", FIRST + int(one["sample"]))
        worst.append((study.name, seed, *drawn, note("worst: position", 1e3 * float(one["position"]), "mm")))
        values = np.sort(1e3 * swept["position"].fillna(np.inf).values)
        curves.append(Curve(study.name, values, np.arange(1, count + 1) / count))
    panel = Panel(
        curves=curves,
        x="greatest error of the root [mm]",
        y="share of samples [-]",
        log_x=True,
        marks=[1e3 * POSITION],
        legend_inside=True,
    )
    save(drawing([panel], row_height=3.2), folder / "samples.png", small=True)
    words = ("median", "worst")
    header = [f"{column(name, SHOWN[unit][0])}: {word}" for name, unit in UNITS.items() for word in words]
    text = TEXT.format(
        count=count,
        spread=UNCERTAIN,
        lightest=LIGHTEST_DAMPING,
        heaviest=HEAVIEST_DAMPING,
        payload=HEAVIEST_PAYLOAD,
        position=1e3 * POSITION,
        joints=JOINTS,
        late=1e3 * LATE,
        duration=DURATION,
        digest=code_digest(),
        accident=f"{2 / np.sqrt(count):.2f}",
        shares=markdown_table(("law", "plant", "fly", "share", "surely"), shares),
        errors=markdown_table(("law", *header), errors),
        tuned=section(*tuned, ledger),
        matters=markdown_table(("law", "error", *UNCERTAINTIES), matters),
        worst=markdown_table(("law", "seed", *UNCERTAINTIES, "position (norm)"), worst),
        definitions=DEFINITIONS,
    )
    write_atomically(folder / "README.md", text)
    write_evidence(folder, ledger, {"samples": count})
    return folder / "README.md"
