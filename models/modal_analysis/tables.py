"""Tables of the modal analysis, for people to read."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
import xarray as xr

from trussflow.blocks.framework.errors import LinearAnalysisError
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.linear_analysis.margins import Margins, channel_responses, disk_margin, sensitivities
from trussflow.models.modal_analysis.linear_loop import OpenLoop
from trussflow.models.modal_analysis.margins import demand_margins, frequencies, modal_margins
from trussflow.models.modal_analysis.participation import POLE_HEADER, pole_rows, poles
from trussflow.models.modal_analysis.reduction import Reduction
from trussflow.models.reporting.tables import text_table


def _number(value: float, form: str = ".3g") -> str:
    """Return a number, a dash where there is none."""
    return "-" if not np.isfinite(value) else f"{value:{form}}"


def _gain(factor: float) -> str:
    """Return a factor in decibel, a dash where there is no limit."""
    return _number(20 * np.log10(factor) if factor > 0 else np.inf, ".1f")


MARGINS: dict[str, Callable[[Margins], str]] = {
    "channel": lambda m: m.channel,
    "crossover [rad/s]": lambda m: _number(m.crossover),
    "gain down [dB]": lambda m: _gain(m.gain_down),
    "gain up [dB]": lambda m: _gain(m.gain_up),
    "phase [deg]": lambda m: _number(m.phase, ".1f"),
    "delay [ms]": lambda m: _number(1e3 * m.delay),
    "disk": lambda m: _number(m.disk, ".2f"),
}
"""Columns of the tables of margins."""


def margin_row(m: Margins) -> tuple[str, ...]:
    """Return the row of one channel."""
    return tuple(column(m) for column in MARGINS.values())


def _joint_channels(loop: OpenLoop, robots: int) -> list[range]:
    """Return the channels of each robot's joints."""
    joints = (loop.rigid - 6) // robots
    return [range(6 + i * joints, 6 + (i + 1) * joints) for i in range(robots)]


def demand_table(loop: OpenLoop, omega: Vector, robots: int = 4) -> tuple[str, list[Margins]]:
    """Return the table of margins at the demand, and all the margins.

    Of each robot the table has the joint of least disk margin only.

    Parameters
    ----------
    loop : OpenLoop
        A stable loop.
    omega : array
        Frequencies to look at [rad/s].
    robots : int
        Number of robots [-].
    """
    found = demand_margins(loop, omega)
    weakest = [min((found[k] for k in own), key=lambda m: m.disk) for own in _joint_channels(loop, robots)]
    return text_table(list(MARGINS), [margin_row(m) for m in (*found[:6], *weakest)]), found


def disk_table(loop: OpenLoop, omega: Vector, robots: int = 4, *, quick: bool = False) -> str:
    """Return the table of multi-loop disk margins.

    Parameters
    ----------
    loop : OpenLoop
        A stable loop.
    omega : array
        Frequencies to look at [rad/s].
    robots : int
        Number of robots [-].
    quick : bool
        Leave out the group of all channels, which takes longest.
    """
    groups: dict[str, Sequence[int]] = {
        "translation": range(3),
        "rotation": range(3, 6),
        "translation and rotation": range(6),
    }
    for i, own in enumerate(_joint_channels(loop, robots), 1):
        groups[f"joints of Robot {i}"] = own
    if not quick:
        groups["all channels"] = range(loop.rigid)
    rows = []
    for name, numbers in groups.items():
        disk, gain, phase, at = disk_margin(loop.closed_but(numbers), omega)
        rows.append((name, f"{disk:.2f}", f"±{gain:.1f}", f"±{phase:.0f}", f"{at:.3g}"))
    header = "all at the same time", "disk", "gain [dB]", "phase [deg]", "least at [rad/s]"
    return text_table(header, rows)


def modal_table(loop: OpenLoop) -> str:
    """Return the table of the loops at each mode's modal force.

    Parameters
    ----------
    loop : OpenLoop
        The loop; if it is unstable, its unstable poles take the place of the margins.
    """
    omega = frequencies(loop, 0.1, 1e3)
    gains = channel_responses(sensitivities(loop.modal_loop, omega))
    header = ("mode", "largest gain [dB]", "at [rad/s]", "phase there [deg]", *list(MARGINS)[2:])
    margins: Sequence[Margins | None]
    try:
        margins, note = modal_margins(loop, omega), ""
    except LinearAnalysisError as error:
        margins, note = [None] * loop.modes, f"\n\n{error}"
    rows = []
    for k, (gain, m) in enumerate(zip(gains.T, margins, strict=True)):
        i = int(np.argmax(np.abs(gain)))
        rest = margin_row(m)[2:] if m is not None else ("unstable",) + ("-",) * 4
        peak = 20 * np.log10(max(abs(gain[i]), 1e-300))
        first = (str(k + 1), f"{peak:.1f}", f"{omega[i]:.3g}", f"{np.degrees(np.angle(gain[i])):.0f}")
        rows.append(first + rest if peak > -120 else (str(k + 1), "no loop", *("-",) * 7))
    return text_table(header, rows) + note


def pole_table(loops: Mapping[str, OpenLoop], number: int) -> str:
    """Return the tables of the rightmost oscillating poles.

    Parameters
    ----------
    loops : mapping
        Loops by name.
    number : int
        How many poles of each [-].
    """
    return "\n\n".join(
        f"{name}\n{text_table(POLE_HEADER, pole_rows(poles(loop, number), loop))}"
        for name, loop in loops.items()
    )


def spillover_table(grid: xr.Dataset) -> str:
    """Return the least damping with which the loop is stable, over modes and bandwidth.

    Parameters
    ----------
    grid : xarray.Dataset
        From `spillover_map`.
    """
    header = ["loop", "modes", *(f"L = {v:g}" for v in grid["bandwidth"].values)]
    rows = []
    for name in grid["loop"].values:
        for number in grid["modes"].values:
            rates = grid["growth_rate"].sel(loop=name, modes=number)
            cells = [_least_damping(rates.sel(bandwidth=v)) for v in grid["bandwidth"].values]
            rows.append([str(name), str(number), *cells])
    return text_table(header, rows)


def _least_damping(rates: xr.DataArray) -> str:
    """Return the least damping from which on all are stable."""
    stable = rates.values < 0
    if not stable[-1]:
        return f"> {100 * float(rates['damping'][-1]):g} %"
    first = len(stable) - int(np.argmin(stable[::-1])) if not stable.all() else 0
    return f"{100 * float(rates['damping'][first]):g} %"


def reduction_table(reductions: Iterable[Reduction], full: float) -> str:
    """Return the table of reduced models.

    Parameters
    ----------
    reductions : iterable of Reduction
        Of one model.
    full : float
        Largest gain of the full model [unit of the response].
    """
    rows = [
        (r.method, str(r.order), f"{100 * r.error / full:.2f} %", f"{100 * r.bound / full:.2f} %")
        for r in reductions
    ]
    return text_table(("method", "states", "error", "bound, of the largest gain"), rows)
