r"""How much loop delay and how long a control period each controller stands.

Delay: the same in all demand channels of a continuous loop (`delay_margin`). Period: all
measurements are taken at its start, the controller's states advance exactly for held
measurements, the demand is held (`largest_sample_time`), without computing time and with a
computing time of one period.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from trussflow.blocks.framework.types import Vector
from trussflow.blocks.linear_analysis.frequency.delays import delay_margin, largest_sample_time
from trussflow.models.modal_analysis.linear_loop import OpenLoop
from trussflow.models.modal_analysis.margins import is_stable

SHORTEST, LONGEST = 1e-8, 1.0
"""Periods searched [s]; PD's fastest pole lies near 1e7 1/s."""


@dataclass(frozen=True, slots=True)
class Timing:
    """What one controller stands; zero if its loop is not stable at all.

    Attributes
    ----------
    name : str
        The loop.
    delay : float
        Largest delay [s].
    oscillation : float
        Frequency at which the loop oscillates with that delay [rad/s].
    period : float
        Longest control period without computing time [s].
    period_with_computing : float
        The same with a computing time of one period [s].
    """

    name: str
    delay: float = 0.0
    oscillation: float = np.nan
    period: float = 0.0
    period_with_computing: float = 0.0


def timing(name: str, loop: OpenLoop, *, omega: Vector | None = None, points: int = 50) -> Timing:
    """Return what delay and period a loop stands.

    Parameters
    ----------
    name : str
        Of the loop.
    loop : OpenLoop
        The loop.
    omega : array, optional
        Frequencies to search for the delay margin [rad/s].
    points : int
        Periods looked at, evenly in logarithm [-].
    """
    if not is_stable(loop.closed_matrix):
        return Timing(name=name)
    delay, oscillation = delay_margin(loop.demand_loop, omega=omega)
    search: dict[str, Any] = {"shortest": SHORTEST, "longest": LONGEST, "points": points}
    period, with_computing = (
        largest_sample_time(loop.measured_plant, loop.controller, delay=part, **search) for part in (0.0, 1.0)
    )
    return Timing(name, delay, oscillation, period, with_computing)


TIMINGS: dict[str, Callable[[Timing], str]] = {
    "controller": lambda t: t.name,
    "delay [ms]": lambda t: f"{1e3 * t.delay:.3g}" if t.delay else "unstable",
    "oscillates at [rad/s]": lambda t: f"{t.oscillation:.3g}",
    "period [ms]": lambda t: f"{1e3 * t.period:.3g}" if t.period else "-",
    "period, one period to compute [ms]": lambda t: (
        f"{1e3 * t.period_with_computing:.3g}" if t.period_with_computing else "-"
    ),
}
"""Columns of the table of timings."""


def timing_rows(timings: Iterable[Timing]) -> list[tuple[str, ...]]:
    """Return the rows of a table of timings.

    Parameters
    ----------
    timings : iterable of Timing
        From `timing`.
    """
    return [tuple(column(t) for column in TIMINGS.values()) for t in timings]
