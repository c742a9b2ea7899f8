"""Figures of the modal analysis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import control
import numpy as np
import xarray as xr

from trussflow.blocks.framework.types import Vector
from trussflow.blocks.linear_analysis.margins import Complex, channel_responses, response, sensitivities
from trussflow.models.modal_analysis.linear_loop import OpenLoop
from trussflow.models.modal_analysis.margins import frequencies
from trussflow.models.modal_analysis.reduction import Reduction
from trussflow.models.reporting.figures import Curve, Panel, blank, draw_cells, drawing, save

SHOWN_CHANNELS = ("x", "y", "z", "phi", "theta", "psi", "theta_4_1")


def decibel(gain: Any) -> Vector:
    """Return 20 log10 of the size of a gain.

    Parameters
    ----------
    gain : array
        Real or complex [any].
    """
    return np.asarray(20 * np.log10(np.maximum(np.abs(gain), 1e-300)))


def _panel(curves: Sequence[Curve], y: str, **look: Any) -> Panel:
    """Return a panel over frequency."""
    return Panel(curves=curves, y=y, x="frequency [rad/s]", log_x=True, legend_inside=True, **look)


def draw_plant(groups: Mapping[str, control.StateSpace], modes: int, natural: Vector, folder: Path) -> None:
    """Draw the response of modal coordinates and grasp displacements to actuator groups.

    Parameters
    ----------
    groups : mapping
        Plant from each group of actuators to the modal coordinates, then the displacements of
        all grasp points.
    modes : int
        How many outputs are modal coordinates [-].
    natural : Vector
        Frequencies of the elastic modes, to be marked [rad/s].
    folder : pathlib.Path
        Where to write the figure.
    """
    omega = np.geomspace(1.0, 300.0, 3000)
    panels = []
    for i, (name, plant) in enumerate(groups.items()):
        gains = response(plant, omega)
        displacements = gains[:, modes:].reshape(len(omega), -1, 3, gains.shape[2])
        coordinates = [(f"mode {k + 1}", gains[:, k : k + 1]) for k in range(modes)]
        grasps = [(f"Robot {k + 1}", displacements[:, k]) for k in range(displacements.shape[1])]
        for title, y, curves in (
            (name, "modal coordinate [dB]", coordinates),
            ("", "grasp displacement [dB]", grasps),
        ):
            shown = [
                Curve(label if i == 0 else "", omega, decibel(np.linalg.norm(gain, 2, axis=(1, 2))), k)
                for k, (label, gain) in enumerate(curves)
                if np.any(gain)  # the root, where the truss frame is, does not move
            ]
            panels.append(_panel(shown, y, title=title, marks=natural))
    save(drawing(panels, width=9.5, row_height=3.0), folder / "bode_plant.png")


def draw_demand_loops(loops: Mapping[str, OpenLoop], natural: Vector, folder: Path) -> None:
    """Draw Bode plots of the loop gain at the demand, channel by channel, others closed.

    Parameters
    ----------
    loops : mapping
        Loops by name.
    natural : Vector
        Frequencies to be marked [rad/s].
    folder : pathlib.Path
        Where to write the figure.
    """
    found = {}
    for name, loop in loops.items():
        omega, names = frequencies(loop), loop.channel_names()
        gains = channel_responses(sensitivities(loop.demand_loop, omega))
        found[name] = omega, {c: gains[:, names.index(c)] for c in SHOWN_CHANNELS}
    _bode(found, natural, (-80, 120), folder / "bode_demand_loops.png")


def draw_modal_loops(loops: Mapping[str, OpenLoop], natural: Vector, folder: Path) -> None:
    """Draw Bode plots of the loop gain at the modal force of each mode, others closed.

    Parameters
    ----------
    loops : mapping
        Loops by name, in all of which actuators work on the modes.
    natural : Vector
        Frequencies to be marked [rad/s].
    folder : pathlib.Path
        Where to write the figure.
    """
    found = {}
    for name, loop in loops.items():
        omega = frequencies(loop, 0.1, 1e3)
        gains = channel_responses(sensitivities(loop.modal_loop, omega))
        found[name] = omega, {f"mode {k + 1}": gain for k, gain in enumerate(gains.T)}
    _bode(found, natural, (-80, 60), folder / "bode_modal_loops.png")


def _bode(
    loops: Mapping[str, tuple[Vector, dict[str, Complex]]],
    natural: Vector,
    decibels: tuple[float, float],
    file: Path,
) -> None:
    """Draw gain and phase of many curves, a column for each loop."""
    gains, phases = [], []
    for title, (omega, curves) in loops.items():
        last = title == list(loops)[-1]
        sizes = [Curve(name if last else "", omega, decibel(gain)) for name, gain in curves.items()]
        angles = [Curve("", omega, _phase(gain)) for gain in curves.values()]
        limits = {"ylim": (-185, 185), "yticks": range(-180, 181, 90)}
        shape = {"ylim": decibels}
        gains.append(_panel(sizes, "loop gain [dB]", title=title, levels=(0.0,), marks=natural, more=shape))
        phases.append(_panel(angles, "phase [deg]", marks=natural, more=limits))
    figure = drawing([*gains, *phases], len(loops), width=4.2 * len(loops), row_height=2.75)
    save(figure, file)


def _phase(gain: Complex) -> Vector:
    """Return the phase [deg], interrupted where it jumps by a turn."""
    phase = np.degrees(np.angle(gain))
    phase[np.abs(np.diff(phase, prepend=phase[0])) > 180] = np.nan
    return phase


def draw_singular_values(loops: Mapping[str, OpenLoop], natural: Vector, folder: Path) -> None:
    r"""Draw the singular values of loop gain, sensitivity and complementary sensitivity.

    The size of a demand u is :math:`\sqrt{u^T G^{-1} u}`: metres, radians and joints weigh in by
    the energy that they cost.

    Parameters
    ----------
    loops : mapping
        Loops by name.
    natural : Vector
        Frequencies to be marked [rad/s].
    folder : pathlib.Path
        Where to write the figure.
    """
    panels = []
    for name, loop in loops.items():
        omega = frequencies(loop)
        R = np.linalg.cholesky(loop.inertia)
        L = np.linalg.inv(R) @ response(loop.demand_loop, omega) @ R
        S = np.linalg.inv(np.eye(L.shape[1]) + L)
        L_values = np.linalg.svd(L, compute_uv=False)
        shown = {
            "L, largest": L_values[:, 0],
            "S, largest": np.linalg.norm(S, 2, axis=(1, 2)),
            "T, largest": np.linalg.norm(L @ S, 2, axis=(1, 2)),
            "L, smallest": L_values[:, -1],
        }
        last = name == list(loops)[-1]
        curves = [Curve(k if last else "", omega, decibel(v)) for k, v in shown.items()]
        look: dict[str, Any] = {"levels": (0.0,), "marks": natural, "more": {"ylim": (-80, 80)}}
        panels.append(_panel(curves, "singular values [dB]", title=name, **look))
    figure = drawing(panels, len(loops), width=4.2 * len(loops), row_height=3.4)
    save(figure, folder / "singular_values.png")


def draw_poles(loops: Mapping[str, OpenLoop], natural: Vector, folder: Path) -> None:
    """Draw the closed loops' poles near the imaginary axis.

    Parameters
    ----------
    loops : mapping
        Loops by name.
    natural : Vector
        Frequencies of the plant's own modes, to be marked [rad/s].
    folder : pathlib.Path
        Where to write the figure.
    """
    curves = []
    for name, loop in loops.items():
        values = np.linalg.eigvals(loop.closed_matrix)
        values = values[(values.imag > 0.1) & (values.real > -20)]
        curves.append(Curve(name, np.asarray(values.real), np.asarray(values.imag), width=0))
    panel = Panel(
        curves=curves,
        y="imaginary part [rad/s]",
        x="real part [1/s]",
        title="poles of the closed loop; dashed: the plant's modes",
        levels=natural,
        marks=(0.0,),
        more={"xmargin": 0.05},
    )
    figure = drawing([panel], 1, width=7.0, row_height=5.4)
    figure.axes[0].legend(
        fontsize="small", frameon=False, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.1)
    )
    save(figure, folder / "poles.png")


def draw_spillover(grid: xr.Dataset, folder: Path) -> None:
    """Draw the map of control spillover.

    Parameters
    ----------
    grid : xarray.Dataset
        From `spillover_map`.
    folder : pathlib.Path
        Where to write the figure.
    """
    from matplotlib.colors import SymLogNorm

    rates, numbers = grid["growth_rate"], grid["modes"].values
    rows, limit = len(grid["loop"]), float(np.abs(rates).max())
    figure, plots = blank(rows, len(numbers), width=1.4 + 2.3 * len(numbers), row_height=0.3 + 2.5)
    norm = SymLogNorm(0.1, vmin=-limit, vmax=limit)
    cases = [(loop, number) for loop in grid["loop"].values for number in numbers]
    for plot, (loop, number) in zip(plots, cases, strict=True):
        image = draw_cells(
            plot,
            rates.sel(loop=loop, modes=number).values,
            lambda v: f"{v:+.1f}" if abs(v) >= 0.05 else f"{v:+.2f}",
            lambda v: abs(v) > 0.3 * limit,
            [f"{v:g}" for v in grid["bandwidth"].values],
            [f"{100 * v:g}" for v in grid["damping"].values],
            norm=norm,
        )
        plot.set_title(f"{loop}, {number} modes", loc="left", fontsize="small")
        plot.set(xlabel="L [1/s], 0: no observer", ylabel="damping of the modes [%]")
        plot.label_outer()
    bar = figure.colorbar(image, ax=plots, pad=0.01)
    bar.set_label("rightmost real part [1/s]; above 0: unstable")
    save(figure, folder / "spillover.png")


def draw_reductions(full: control.StateSpace, reductions: Sequence[Reduction], folder: Path) -> None:
    """Draw the full elastic model, reduced ones, and their errors below their bounds.

    Parameters
    ----------
    full : control.StateSpace
        The full model.
    reductions : sequence of Reduction
        Of that model.
    folder : pathlib.Path
        Where to write the figure.
    """
    omega = np.geomspace(1.0, 1e3, 2500)
    gains = response(full, omega)
    sizes = [Curve(f"full, {full.nstates}", omega, decibel(np.linalg.norm(gains, 2, axis=(1, 2))), 6)]
    errors = []
    for k, one in enumerate(reductions):
        reduced = response(one.model, omega)
        label = f"{one.method}, {one.order}"
        sizes.append(Curve(label, omega, decibel(np.linalg.norm(reduced, 2, axis=(1, 2))), k))
        error = decibel(np.linalg.norm(gains - reduced, 2, axis=(1, 2)))
        bound = np.full(len(omega), float(decibel(one.bound)))
        errors += [Curve("", omega, error, k), Curve("", omega, bound, k, width=0.6)]
    titles = {"largest singular value": sizes, "error; thin: its bound": errors}
    y = "force of Robot 4 to all grasps [dB]"
    panels = [_panel(curves, y, title=title) for title, curves in titles.items()]
    save(drawing(panels, width=9.5, row_height=3.6), folder / "reduction.png")
