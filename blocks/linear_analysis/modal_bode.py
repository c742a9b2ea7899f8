"""Bode plot of the loops through the modes of a structure."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.system import flatten
from trussflow.blocks.linear_analysis.linearize import linearize
from trussflow.blocks.linear_analysis.loop_transfer import channels_of, loop_transfer
from trussflow.blocks.linear_analysis.margins import (
    channel_responses,
    frequencies_about,
    sensitivities,
)
from trussflow.blocks.linear_analysis.modal_table import (
    OscillatingMode,
    oscillating_modes,
)
from trussflow.blocks.linear_analysis.references import Reference, named
from trussflow.blocks.support.types import Vector

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from trussflow.blocks.linear_analysis.linear_model import LinearModel


def modal_bode(
    diagram: Diagram,
    port: Reference,
    *,
    loop: LinearModel | None = None,
    omega: npt.ArrayLike | None = None,
) -> Figure:
    r"""Return the Bode plot of the loop through each element of a port, the other elements closed.

    .. math:: L_k = 1 / [(I + L)^{-1}]_{kk} - 1

    The legend names for each element the mode of the plant, at its initial state, that it drives most, with
    frequency and damping ratio, and the gain and phase margins. If the closed loop is unstable, there are
    no margins, and the title lists the unstable poles.

    Parameters
    ----------
    diagram : Diagram
        The closed loop.
    port : Port or str
        Input of the plant with the modal forces, such as ``"truss.modal_force"``.
    loop : LinearModel, optional
        Loop gain at the port, from `loop_transfer`, such as one at another operating point; by default that
        at the initial states.
    omega : array_like, optional
        Frequencies [rad/s]; by default around the poles.

    Returns
    -------
    matplotlib.figure.Figure
        Magnitude [dB] and phase [deg] over frequency [Hz].

    Raises
    ------
    LinearAnalysisError
        If the port is an output, no loop passes through it, or the given loop has another number of channels.
    """
    import matplotlib.pyplot as plt  # slow to import

    from trussflow.blocks.support.figures import NotebookFigure

    opened = named(flatten(diagram, external=True), port).port
    if not opened.is_input:
        raise LinearAnalysisError(
            f"'{opened.full_path}' is an output; name the input with the modal forces"
        )
    loop = loop_transfer(diagram, port) if loop is None else loop
    plant = linearize(opened.block, [opened], [opened])
    if loop.ninputs != plant.ninputs:
        raise LinearAnalysisError(
            f"the given loop has {loop.ninputs} channels, but '{opened.full_path}' has {plant.ninputs} "
            "elements; take the loop from loop_transfer(diagram, port) with the same port"
        )
    modes = oscillating_modes(plant)
    effects = np.array([np.abs(left @ plant.B) for _, left, _ in modes])
    grid = _grid(loop) if omega is None else np.asarray(omega)
    gains = channel_responses(sensitivities(loop, grid))
    title = f"{diagram.name}: loops at {opened.full_path}"
    margins = {}
    try:
        margins = channels_of(loop)
    except LinearAnalysisError as error:
        title = fill(str(error), 90)
    figure, (upper, lower) = plt.subplots(
        2,
        sharex=True,
        figsize=(9.0, 7.0),
        layout="constrained",
        FigureClass=NotebookFigure,
    )
    for k, label in enumerate(loop.input_labels):
        text = label
        if modes:
            number = int(np.argmax(effects[:, k]))
            mode = OscillatingMode(modes[number][0], {})
            text += f": drives mode {number + 1}, {mode.frequency:.3g} Hz, ζ = {mode.damping_ratio:z.2%}"
        if label in margins:
            gain = 20.0 * np.log10(margins[label].gain_up)
            found = f"; margins {gain:.1f} dB, {margins[label].phase:.0f}°"
            text += found.replace("inf", "∞")
        upper.semilogx(
            grid / (2.0 * np.pi), 20.0 * np.log10(np.abs(gains[:, k])), label=text
        )
        lower.semilogx(
            grid / (2.0 * np.pi), np.degrees(np.unwrap(np.angle(gains[:, k])))
        )
    upper.axhline(0.0, color="grey", linewidth=0.8)
    upper.set(title=title, ylabel="magnitude [dB]")
    lower.set(xlabel="frequency [Hz]", ylabel="phase [deg]")
    upper.legend(fontsize="small")
    return figure


def _grid(loop: LinearModel) -> Vector:
    """Return frequencies from a tenth of the slowest to ten times the fastest oscillating pole [rad/s]."""
    poles = np.array([pole for pole, _, _ in oscillating_modes(loop)])
    sizes = np.abs(poles) if poles.size else np.ones(1)
    return frequencies_about(poles, 0.1 * sizes.min(), 10.0 * sizes.max())
