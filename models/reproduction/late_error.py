"""Why the observer leaves a larger late error: a mode that nothing damps any more."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from trussflow.blocks.framework.types import Vector
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
    time, peaks = envelope(late(result))
    return float(np.polyfit(time, np.log(peaks), 1)[0])


def envelope(result: xr.Dataset) -> tuple[Vector, Vector]:
    """Return the times and values of the maxima of the first modal coordinate's size.

    Parameters
    ----------
    result : xarray.Dataset
        From `tidy`.
    """
    mode = np.abs(result.modal_coordinate.values[:, 0])
    inner = np.flatnonzero((mode[1:-1] >= mode[:-2]) & (mode[1:-1] > mode[2:])) + 1
    return result["time"].values[inner], mode[inner]


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
            ledger(f"{run}: late position error", peak(late(results[run]).position_error), "m", runs=[run]),
            ledger(f"{run}: measured growth of mode 1", measured_decay(results[run]), "1/s", runs=[run]),
            ledger(f"{run}: predicted growth of mode 1", float(at.pole_real), "1/s", runs=[run]),
            ledger(f"{run}: predicted frequency of mode 1", float(at.pole_imaginary), "rad/s", runs=[run]),
        ]
        rows.append([f"`{run}`", *shown])
    ratios = {
        when: " and ".join(
            ledger(
                f"case{case}: {when} position error, with over without observer",
                _error(results, f"case{case}", when) / _error(results, f"case{case}-no-observer", when),
                runs=[f"case{case}", f"case{case}-no-observer"],
                digits=2,
            )
            for case in CASES
        )
        for when in ("peak", "late")
    }
    save(drawing(_panels(results, poles)), folder / FIGURE)
    return TEXT.format(
        table=table(HEADER, rows),
        late=ratios["late"],
        peak=ratios["peak"],
        figure=FIGURE,
        limit=_limit(results, poles, ledger),
    )


def _error(results: Results, run: str, when: str) -> float:
    result = results[run]
    return peak((late(result) if when == "late" else result).position_error)


def _limit(results: Results, poles: dict[str, xr.Dataset], ledger: Ledger) -> str:
    """Say where the pole crosses the imaginary axis, and what the long runs find."""
    sentences = []
    for case in CASES:
        run, lasting = f"case{case}", f"case{case}-long"
        growth = poles[run].pole_real.values
        crossing = np.flatnonzero((growth[:-1] > 0) & (growth[1:] <= 0))
        if not len(crossing):
            sentences.append(f"In Case {case} the pole does not cross the imaginary axis.")
            continue
        i = int(crossing[0])
        part = growth[i] / (growth[i] - growth[i + 1])
        scale = np.exp(np.interp(part, [0, 1], np.log(poles[run]["scale"].values[i : i + 2])))
        expected = float(scale) * peak(late(results[run]).position_error)
        found = peak(late(results[lasting]).position_error)
        sentences.append(
            f"In Case {case} the pole crosses into the right half-plane where the position error "
            f"is {ledger(f'{run}: predicted limit cycle', expected, 'm', runs=[run], digits=2)}; "
            f"after {ledger(f'{lasting}: duration', results.run(lasting).duration, 's', digits=3)} "
            f"it is {ledger(f'{lasting}: late position error', found, 'm', runs=[lasting])} and "
            "mode 1 changes at "
            + ledger(
                f"{lasting}: measured growth of mode 1",
                measured_decay(results[lasting]),
                "1/s",
                runs=[lasting],
            )
            + "."
        )
    return " ".join(sentences)


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
                curves=curves,
                x="amplitude per late amplitude",
                y="growth of mode 1 [1/s]",
                title=f"Case {case}",
                levels=(0.0,),
                log_x=True,
            )
        )
        lasting = results[f"case{case}-long"]
        time, mode = envelope(lasting)
        after = time > results.mission(f"case{case}").duration
        found.append(
            Panel(
                curves=[Curve("", time[after], mode[after])],
                y="amplitude of mode 1 [kg$^{1/2}$·m]",
                log=True,
                title=f"Case {case}, with observer",
            )
        )
    return found


HEADER = (
    "run",
    "late position error",
    "growth of mode 1, simulated",
    "from the describing functions",
    "frequency of that pole",
)

TEXT = """\
With the observer the peak position error is {peak} times that without, in Cases 1 and 2, but the
late one {late} times. What remains is an oscillation in the lowest mode of the truss, and the
observer takes away its damping:

{table}

Without the observer the motion of the mode moves the truss, the control answers with its rate
terms, and that takes energy out of the mode. The observer hands the controller the very force that
the mode exerts on the rigid motion; the control cancels it, the root of the truss hardly moves, and
the mode vibrates as if clamped, with next to no damping (the source has none in the structure). The
lag of the observer does the rest. The gains of the sgn^β law rise without bound as errors fall,
which makes the hold stiffer still, until the mode is unstable: the errors do not converge to zero
but to a limit cycle. {limit}

![Late errors]({figure})

Left: real part of the mode's pole, from the linear model with describing functions of |x|^β at the
amplitudes that each channel has late in the run, all scaled together; above zero is unstable.
Right: runs that hold on.
"""
