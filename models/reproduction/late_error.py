"""Why the observer leaves a larger late error: a mode that nothing damps any more."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from trussflow.models.reproduction.ledger import Ledger
from trussflow.models.reproduction.markdown import table
from trussflow.models.reproduction.measures import late, peak
from trussflow.models.reproduction.results import Results
from trussflow.models.reproduction.style import Curve, Panel, drawing, save
from trussflow.models.transport.mission import CASES

if TYPE_CHECKING:
    import xarray as xr

RUNS = tuple(f"case{case}{suffix}" for case in CASES for suffix in ("", "-no-observer"))
LONG = ("case1-long", "case2-long")
FIGURE = "late-errors.png"


def measured_decay(result: xr.Dataset) -> float:
    """Return the growth rate of the first modal coordinate late in a run [1/s].

    Parameters
    ----------
    result : xarray.Dataset
        From `tidy`.
    """
    part = late(result)
    time, mode = part["time"].values, np.abs(part.modal_coordinate.values[:, 0])
    inner = np.flatnonzero((mode[1:-1] >= mode[:-2]) & (mode[1:-1] > mode[2:])) + 1
    return float(np.polyfit(time[inner], np.log(mode[inner]), 1)[0])


def section(results: Results, poles: dict[str, xr.Dataset], ledger: Ledger, folder: Path) -> str:
    """Write the figure and return the section of the report.

    Parameters
    ----------
    results : Results
        Finished runs.
    poles : dict of xarray.Dataset
        What the jobs found, by the run's name.
    ledger : Ledger
        Takes down the numbers.
    folder : pathlib.Path
        Of the report.
    """
    rows = []
    for run in RUNS:
        at = poles[run].sel(scale=1.0)
        shown = [
            ledger(f"{run}: late position error", peak(late(results[run]).position_error), "m",
                   runs=[run]),
            ledger(f"{run}: measured growth of mode 1", measured_decay(results[run]), "1/s",
                   runs=[run]),
            ledger(f"{run}: predicted growth of mode 1", float(at.pole_real), "1/s", runs=[run]),
            ledger(f"{run}: predicted frequency of mode 1", float(at.pole_imaginary), "rad/s",
                   runs=[run]),
        ]  # fmt: skip
        rows.append([f"`{run}`", *shown])
    ratios = [
        ledger(
            f"case{case}: late position error, with over without observer",
            peak(late(results[f"case{case}"]).position_error)
            / peak(late(results[f"case{case}-no-observer"]).position_error),
            runs=[f"case{case}", f"case{case}-no-observer"], digits=2,
        )
        for case in CASES
    ]  # fmt: skip
    ends = [
        ledger(f"{run}: late position error", peak(late(results[run]).position_error), "m",
               runs=[run])
        for run in LONG
    ]  # fmt: skip
    drifts = [
        ledger(f"{run}: measured growth of mode 1", measured_decay(results[run]), "1/s",
               runs=[run])
        for run in LONG
    ]  # fmt: skip
    durations = [
        ledger(f"{run}: duration", results.run(run).duration, "s", runs=[run]) for run in LONG
    ]
    save(drawing(_panels(results, poles)), folder / FIGURE)
    return TEXT.format(
        table=table(HEADER, rows), ratios=" and ".join(ratios), ends=" and ".join(ends),
        drifts=" and ".join(drifts), duration=durations[0], limit=_limit(poles), figure=FIGURE,
    )  # fmt: skip


def _limit(poles: dict[str, xr.Dataset]) -> str:
    """Say whether the mode is unstable at small amplitudes, where the gains are high."""
    grows = [run for run in RUNS if float(poles[run].pole_real[0]) > 0]
    if not grows:
        return "The mode stays damped down to the smallest amplitudes looked at."
    names = " and ".join(f"`{run}`" for run in grows)
    return (
        f"In {names} the pole crosses into the right half-plane as the amplitude falls: the errors "
        "do not converge to zero but to a limit cycle"
    )


def _panels(results: Results, poles: dict[str, xr.Dataset]) -> list[Panel]:
    found = []
    for case in CASES:
        runs = {"with observer": f"case{case}", "without observer": f"case{case}-no-observer"}
        curves = [
            Curve(k, p["scale"].values, p.pole_real.values)
            for k, p in ((k, poles[run]) for k, run in runs.items())
        ]
        found.append(
            Panel(
                curves=curves, x="amplitude per late amplitude", y="growth of mode 1 [1/s]",
                title=f"Case {case}: describing functions", levels=(0.0,), log_x=True,
            )
        )  # fmt: skip
        lasting = results[f"case{case}-long"]
        time, mode = lasting["time"].values, lasting.modal_coordinate.values[:, 0]
        after = time > results.mission(f"case{case}").duration
        found.append(
            Panel(
                curves=[Curve("", time[after], np.maximum(np.abs(mode[after]), 1e-9))],
                y="|mode 1| [kg^½·m]", title=f"Case {case}, held on, with observer", log=True,
            )
        )  # fmt: skip
    return found


HEADER = (
    "run", "late position error", "growth of mode 1, simulated", "from the describing functions",
    "frequency of that pole",
)  # fmt: skip

TEXT = """\
The late position error is {ratios} times larger with the observer than without, in Cases 1 and 2.
It is an oscillation in the lowest mode of the truss, and the observer takes away its damping:

{table}

Without the observer the motion of the mode moves the truss, the control answers with its rate
terms, and that takes energy out of the mode. The observer hands the controller the very force that
the mode exerts on the rigid motion; the control cancels it, the root of the truss hardly moves, and
the mode vibrates as if clamped, with next to no damping (the source has none in the structure). The
lag of the observer does the rest. The gains of the sgn^β law rise without bound as errors fall,
which makes the hold stiffer still. {limit}. In runs that hold on to {duration} the late position
error is {ends}, and mode 1 then grows at {drifts}.

![Late errors]({figure})

Poles: linear model with describing functions of |x|^β at the amplitudes that each channel has late
in the run, all scaled together; growth above zero is instability.
"""
