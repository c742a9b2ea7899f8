"""Why the observer leaves a larger late error: a mode that nothing damps any more."""

from __future__ import annotations

import numpy as np
import xarray as xr
from study_tools.ledger import Ledger

from reproduction.context import Context
from reproduction.measures import error_size, late
from reproduction.results import Results
from reproduction.slow_mode import SlowModeJob
from trussflow.blocks.framework.types import Vector
from trussflow.models.reporting.figures import Curve, Panel, drawing, save
from trussflow.models.reporting.tables import markdown_table
from trussflow.models.transport.mission import CASES

RUNS = tuple(f"case{case}{suffix}" for case in CASES for suffix in ("", "-no-observer"))
LONG = ("case1-long", "case2-long")
FIGURE = "late-errors.png"


def measured_decay(result: xr.Dataset) -> float:
    """Return the growth rate of the first modal coordinate late in a run [1/s].

    Parameters
    ----------
    result : xarray.Dataset
        Result of a run.
    """
    time, peaks = envelope(late(result))
    return float(np.polyfit(time, np.log(peaks), 1)[0])


def envelope(result: xr.Dataset) -> tuple[Vector, Vector]:
    """Return the times and values of the maxima of the first modal coordinate's size.

    Parameters
    ----------
    result : xarray.Dataset
        Result of a run.
    """
    mode = np.abs(result.modal_coordinate.values[:, 0])
    inner = np.flatnonzero((mode[1:-1] >= mode[:-2]) & (mode[1:-1] > mode[2:])) + 1
    return result["time"].values[inner], mode[inner]


def jobs(results: Results | None) -> list[SlowModeJob]:
    """Return the jobs that follow from finished missions; none before."""
    return [] if results is None else [SlowModeJob(run=results.run(n), file=results.file(n)) for n in RUNS]


def section(context: Context) -> str:
    """Write the figure and return the section of the report."""
    results, ledger = context.results, context.ledger
    poles = {run: context.maps[f"slow-mode-{run}"] for run in RUNS}
    rows = []
    for run in RUNS:
        at, n = poles[run].sel(scale=1.0), ledger.of(run)
        shown = [
            n("late position error", error_size(results[run], "position_error", "late"), "m"),
            n("measured growth of mode 1", measured_decay(results[run]), "1/s"),
            n("predicted growth of mode 1", float(at.pole_real), "1/s"),
            n("predicted frequency of mode 1", float(at.pole_imaginary), "rad/s"),
        ]
        rows.append([f"`{run}`", *shown])
    ratios: dict[str, list[str]] = {"peak": [], "late": []}
    for when, shown in ratios.items():
        for run in ("case1", "case2"):
            without = f"{run}-no-observer"
            with_it, bare = (error_size(results[r], "position_error", when) for r in (run, without))
            name = f"{when} position error, with over without observer"
            shown.append(ledger.of(run, without)(name, with_it / bare, digits=2))
    save(drawing(_panels(results, poles)), context.folder / FIGURE, small=True)
    return TEXT.format(
        table=markdown_table(HEADER, rows),
        late=" and ".join(ratios["late"]),
        peak=" and ".join(ratios["peak"]),
        figure=FIGURE,
        limit=_limit(results, poles, ledger),
    )


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
        usual, found = (error_size(results[r], "position_error", "late") for r in (run, lasting))
        n = ledger.of(lasting)
        sentences.append(
            f"In Case {case} the pole crosses into the right half-plane where the position error "
            f"is {ledger.of(run)('predicted limit cycle', float(scale) * usual, 'm', digits=2)}; "
            f"after {ledger(f'{lasting}: duration', results.run(lasting).duration, 's', digits=3)} "
            f"it is {n('late position error', found, 'm')} and mode 1 changes at "
            f"{n('measured growth of mode 1', measured_decay(results[lasting]), '1/s')}."
        )
    return " ".join(sentences)


def _panels(results: Results, poles: dict[str, xr.Dataset]) -> list[Panel]:
    found = []
    for case in CASES:
        runs = {"observer": f"case{case}", "no observer": f"case{case}-no-observer"}
        curves = [Curve(k, poles[r]["scale"].values, poles[r].pole_real.values) for k, r in runs.items()]
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
    "late position error (component)",
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
