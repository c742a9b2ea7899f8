"""Figures of the modal analysis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.framework.types import Vector
from trussflow.models.modal_analysis.linear_loop import OpenLoop
from trussflow.models.modal_analysis.margins import Complex, channel_responses, frequencies, response
from trussflow.models.modal_analysis.reduction import Reduction
from trussflow.models.reporting.figure_style import (
    COLOURS,
    DIVERGING,
    STYLES,
    finish,
    legend_above,
    line,
    new_figure,
    save_figure,
)

if TYPE_CHECKING:
    import control
    import xarray as xr
    from matplotlib.axes import Axes

SHOWN_CHANNELS = ("x", "y", "z", "phi", "theta", "psi", "theta_4_1")


def decibel(gain: Any) -> Vector:
    """Return 20 log10 of the size of a gain.

    Parameters
    ----------
    gain : array
        Real or complex [any].
    """
    return np.asarray(20 * np.log10(np.maximum(np.abs(gain), 1e-300)))


def _mark(plot: Axes, omega: Vector) -> None:
    """Draw a thin line at the frequency of each of the plant's elastic modes."""
    for w in omega:
        plot.axvline(w, color="0.75", linewidth=0.7, zorder=0)


def draw_plant(groups: Mapping[str, control.StateSpace], modes: int, natural: Vector, folder: Path) -> Path:
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
    figure = new_figure(9.5, 3.0 * len(groups))
    for i, (name, plant) in enumerate(groups.items()):
        gains = response(plant, omega)
        coordinates, displacements = gains[:, :modes], gains[:, modes:]
        robots = displacements.shape[1] // 3
        parts = displacements.reshape(len(omega), robots, 3, -1)
        for j, (title, ylabel, curves) in enumerate(
            [
                (
                    f"{name}",
                    "modal coordinate [dB]",
                    [(f"mode {k + 1}", coordinates[:, k : k + 1]) for k in range(modes)],
                ),
                ("", "grasp displacement [dB]", [(f"Robot {k + 1}", parts[:, k]) for k in range(robots)]),
            ]
        ):
            plot = figure.add_subplot(len(groups), 2, 2 * i + j + 1)
            for k, (label, gain) in enumerate(curves):
                if np.any(gain):  # the root, where the truss frame is, does not move
                    line(plot, omega, decibel(np.linalg.norm(gain, 2, axis=(1, 2))), k, label)
            _mark(plot, natural)
            finish(plot, title, xscale="log", ylabel=ylabel, xlabel="frequency [rad/s]")
            if i == 0:
                legend_above(plot, 3 if j == 0 else 2)
    return save_figure(figure, folder, "bode_plant")


def draw_demand_loops(loops: Mapping[str, OpenLoop], natural: Vector, folder: Path) -> Path:
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
        gains = channel_responses(response(loop.demand_loop, omega))
        found[name] = omega, {c: gains[:, names.index(c)] for c in SHOWN_CHANNELS}
    return _bode(found, natural, (-80, 120), folder, "bode_demand_loops")


def draw_modal_loops(loops: Mapping[str, OpenLoop], natural: Vector, folder: Path) -> Path:
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
        gains = channel_responses(response(loop.modal_loop, omega))
        found[name] = omega, {f"mode {k + 1}": gain for k, gain in enumerate(gains.T)}
    return _bode(found, natural, (-80, 60), folder, "bode_modal_loops")


def _bode(
    loops: Mapping[str, tuple[Vector, dict[str, Complex]]],
    natural: Vector,
    decibels: tuple[float, float],
    folder: Path,
    name: str,
) -> Path:
    """Draw gain and phase of many curves, a column for each loop."""
    figure = new_figure(4.2 * len(loops), 5.5)
    grid = figure.subplots(2, len(loops), sharex=True, sharey="row", squeeze=False)
    for j, (title, (omega, curves)) in enumerate(loops.items()):
        for k, (label, gain) in enumerate(curves.items()):
            line(grid[0, j], omega, decibel(gain), k, label)
            phase = np.degrees(np.angle(gain))
            phase[np.abs(np.diff(phase, prepend=phase[0])) > 180] = np.nan
            line(grid[1, j], omega, phase, k)
        grid[0, j].axhline(0, color="black", linewidth=0.7)
        for i in range(2):
            _mark(grid[i, j], natural)
        finish(grid[0, j], title, xscale="log", ylim=decibels)
        finish(grid[1, j], xscale="log", xlabel="frequency [rad/s]")
    grid[0, 0].set_ylabel("loop gain [dB]")
    grid[1, 0].set(ylabel="phase [deg]", yticks=range(-180, 181, 90), ylim=(-185, 185))
    grid[0, -1].legend(fontsize="small", frameon=False, ncols=2)
    return save_figure(figure, folder, name)


def draw_singular_values(loops: Mapping[str, OpenLoop], natural: Vector, folder: Path) -> Path:
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
    figure = new_figure(4.2 * len(loops), 3.4)
    grid = figure.subplots(1, len(loops), sharey=True, squeeze=False)[0]
    for plot, (name, loop) in zip(grid, loops.items(), strict=True):
        omega = frequencies(loop)
        R = np.linalg.cholesky(loop.inertia)
        L = np.linalg.inv(R) @ response(loop.demand_loop, omega) @ R
        S = np.linalg.inv(np.eye(L.shape[1]) + L)
        L_values = np.linalg.svd(L, compute_uv=False)
        line(plot, omega, decibel(L_values[:, 0]), 0, "L, largest")
        line(plot, omega, decibel(L_values[:, -1]), 5, "L, smallest")
        line(plot, omega, decibel(np.linalg.norm(S, 2, axis=(1, 2))), 1, "S, largest")
        line(plot, omega, decibel(np.linalg.norm(L @ S, 2, axis=(1, 2))), 2, "T, largest")
        plot.axhline(0, color="black", linewidth=0.7)
        _mark(plot, natural)
        finish(plot, name, xscale="log", xlabel="frequency [rad/s]", ylim=(-80, 80))
    grid[0].set_ylabel("singular values [dB]")
    grid[-1].legend(fontsize="small", frameon=False)
    return save_figure(figure, folder, "singular_values")


def draw_poles(loops: Mapping[str, OpenLoop], natural: Vector, folder: Path) -> Path:
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
    figure = new_figure(7.0, 5.4)
    plot = figure.add_subplot()
    for k, (name, loop) in enumerate(loops.items()):
        values = np.linalg.eigvals(loop.closed_matrix)
        values = values[(values.imag > 0.1) & (values.real > -20)]
        plot.plot(
            values.real,
            values.imag,
            linestyle="none",
            marker="ox+sd^v"[k % 7],
            markersize=6,
            markerfacecolor="none",
            color=COLOURS[k % 7],
            label=name,
        )
    for w in natural:
        plot.axhline(w, color="0.75", linewidth=0.7, zorder=0)
    plot.axvline(0, color="black", linewidth=0.8)
    finish(
        plot,
        "poles of the closed loop; thin lines: the plant's modes",
        xlabel="real part [1/s]",
        ylabel="imaginary part [rad/s]",
    )
    plot.margins(x=0.05)
    figure.legend(fontsize="small", frameon=False, loc="outside lower center", ncols=2)
    return save_figure(figure, folder, "poles")


def draw_spillover(grid: xr.Dataset, folder: Path) -> Path:
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
    figure = new_figure(1.4 + 2.3 * len(numbers), 0.8 + 2.5 * rows)
    plots = figure.subplots(rows, len(numbers), sharex=True, sharey=True, squeeze=False)
    norm = SymLogNorm(0.1, vmin=-limit, vmax=limit)
    image = None
    for i, loop in enumerate(grid["loop"].values):
        for j, number in enumerate(numbers):
            plot, values = plots[i, j], rates.sel(loop=loop, modes=number).values
            image = plot.imshow(values, cmap=DIVERGING, norm=norm, origin="lower", aspect="auto")
            for (y, x), value in np.ndenumerate(values):
                plot.text(
                    x,
                    y,
                    f"{value:+.1f}" if abs(value) >= 0.05 else f"{value:+.2f}",
                    ha="center",
                    va="center",
                    fontsize=6,
                    color="white" if abs(value) > 0.3 * limit else "black",
                )
            plot.set_title(f"{loop}, {number} modes", loc="left", fontsize="small")
            plot.set_xticks(range(values.shape[1]), [f"{v:g}" for v in grid["bandwidth"].values])
            plot.set_yticks(range(values.shape[0]), [f"{100 * v:g}" for v in grid["damping"].values])
            if i == rows - 1:
                plot.set_xlabel("L [1/s], 0: no observer", fontsize="small")
            if j == 0:
                plot.set_ylabel("damping of the modes [%]", fontsize="small")
    assert image is not None
    bar = figure.colorbar(image, ax=plots, pad=0.01)
    bar.set_label("rightmost real part [1/s]; above 0: unstable")
    return save_figure(figure, folder, "spillover")


def draw_reductions(full: control.StateSpace, reductions: Sequence[Reduction], folder: Path) -> Path:
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
    figure = new_figure(9.5, 3.6)
    left, right = figure.subplots(1, 2, sharex=True)
    line(left, omega, decibel(np.linalg.norm(gains, 2, axis=(1, 2))), 6, f"full, {full.nstates}")
    for k, one in enumerate(reductions):
        reduced = response(one.model, omega)
        label = f"{one.method}, {one.order}"
        line(left, omega, decibel(np.linalg.norm(reduced, 2, axis=(1, 2))), k, label)
        line(right, omega, decibel(np.linalg.norm(gains - reduced, 2, axis=(1, 2))), k, label)
        right.axhline(float(decibel(one.bound)), color=COLOURS[k % 7], linestyle=STYLES[k % 7], linewidth=0.6)
    finish(
        left,
        "largest singular value",
        xscale="log",
        xlabel="frequency [rad/s]",
        ylabel="force of Robot 4 to all grasps [dB]",
    )
    finish(right, "error; thin: its bound", xscale="log", xlabel="frequency [rad/s]")
    left.legend(fontsize="small", frameon=False)
    return save_figure(figure, folder, "reduction")
