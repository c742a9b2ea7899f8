"""What is said of the tuned design, in the report on samples."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr
from study_tools.ledger import Ledger

from flight.measures import UNITS, column
from flight.sections import GOALS, SHOWN
from flight.tuned import DISK, Tuning
from trussflow.blocks.framework.types import Vector
from trussflow.models.reporting.metrics import LATE_WINDOW
from trussflow.models.reporting.tables import markdown_table

TEXT = """\
Bandwidths of position and attitude of the mean axes, and the acceleration noise in both, which says how far
the model is trusted, were chosen by hand first, and then by sweeps of both cases: that design is shipped.
Here `tune(derivatives=False)` begins with what was chosen by hand and flies Case 1, seeds {first} to {last},
for {duration:g} s behind the hardware. A design costs the share of a goal that a flight takes, the mean of
all goals of [docs/flight](../flight/README.md) ({goals})
and of all flights. No flight may take more than the whole of a goal, and no actuator or sensor have a disk
margin below {disk} on the nominal truss at rest. {runs} flights{ended}
took the cost from {before} to {cost}; the goal taken most is taken to {most}.

{designs}

Seeds {begin} to {end}, on which nothing was tuned, fly with each design:

{flights}

Seed by seed the tuned design takes {by_hand} of the goals less than the one chosen by hand, and
{shipped} less than the shipped one (95 %; what is negative is more). A second step is more than
one step of thrust, 0.1 N, of any base in the last {settled:g} s."""

SECOND = 0.15
"""More thrust than this is more than one step [N]."""

GROUPS = "position", "attitude"
CHOSEN = (
    "bandwidth of position [rad/s]",
    "of attitude [rad/s]",
    "acceleration noise of position [m/s²/√Hz]",
    "of attitude [rad/s²/√Hz]",
)
MEASURES = "position", "attitude", "late position"
WORDS: dict[str, Callable[[Vector], Any]] = {"median": np.median, "worst": np.max}
COUNTS = "second step", "all goals met"


def section(tuning: Tuning, found: xr.Dataset, ledger: Ledger) -> str:
    """Return what is said of a study.

    Parameters
    ----------
    tuning : Tuning
        The study.
    found : xarray.Dataset
        What its `fly` returned.
    ledger : Ledger
        Takes down all numbers.
    """
    note, count = ledger.of("tuning"), found.sizes["seed"]
    designs, flights, gains = [], [], {}
    for name in found["design"].values.tolist():
        one, own = found.sel(design=name), ledger.of(f"tuning, {name}")
        values = [float(one[f"{group}_bandwidth"]) for group in GROUPS]
        values += [10.0 ** float(one[f"{group}_noise"]) for group in GROUPS]
        chosen = [own(title, value) for title, value in zip(CHOSEN, values, strict=True)]
        designs.append((name, *chosen, own("disk margin", float(one["disk"]))))
        cells = [own("share of the goals", one["share"].values.mean())]
        for measure in MEASURES:
            errors = SHOWN[UNITS[measure]][1] * one[measure].values
            cells += [own(f"{measure}, {word}", make(errors)) for word, make in WORDS.items()]
        met = np.all([one[goal] <= most for goal, most in GOALS.items()], axis=0)
        for what, those in zip(COUNTS, (one["late force"].values > SECOND, met), strict=True):
            cells.append(ledger.count(f"tuning, {name}: {what}", int(those.sum())))
        flights.append((name, *cells))
        if name != "tuned":
            gain = found["share"].sel(design=name).values - found["share"].sel(design="tuned").values
            wide = 1.96 * gain.std(ddof=1) / np.sqrt(count)
            gains[name.replace(" ", "_")] = f"{own('gain', gain.mean())} ± {own('gain, ±', wide, digits=2)}"
    errors_of = [f"{column(m, SHOWN[UNITS[m]][0])}: {word}" for m in MEASURES for word in WORDS]
    return TEXT.format(
        first=tuning.seeds[0],
        last=tuning.seeds[-1],
        begin=tuning.others[0],
        end=tuning.others[-1],
        duration=tuning.duration,
        goals=", ".join(GOALS),
        disk=DISK,
        runs=ledger.count("tuning: flights", found.attrs["runs"]),
        ended=f" ({found.attrs['message'].rstrip('.').lower()})" if found.attrs["message"] else "",
        settled=LATE_WINDOW,
        **{name: note(name, found.attrs[name]) for name in ("before", "cost", "most")},
        **gains,
        designs=markdown_table(("design", *CHOSEN, "disk margin"), designs),
        flights=markdown_table(
            (
                "design",
                "share of the goals",
                *errors_of,
                f"second step, of {count}",
                f"all goals met, of {count}",
            ),
            flights,
        ),
    )
