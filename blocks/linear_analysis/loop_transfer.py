"""Loop gains, sensitivities and margins at a wire of a closed loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.signal_injection import readers
from trussflow.blocks.framework.system import System, flatten
from trussflow.blocks.linear_analysis.linearize import Linearizer
from trussflow.blocks.linear_analysis.margins import (
    Margins,
    channel_disks,
    channel_margins,
    channel_responses,
    disk_margin,
    frequencies_about,
    real_sensitivities,
    sensitivities,
    sensitivity_matrices,
    stable_poles,
)
from trussflow.blocks.linear_analysis.operating_point import OperatingPoint
from trussflow.blocks.linear_analysis.references import (
    Named,
    Reference,
    References,
    listed,
    named,
)
from trussflow.blocks.support.call_site import warn
from trussflow.blocks.support.summary import Described, Description
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import frequencies
from trussflow.blocks.tracing.sorted_order import components

if TYPE_CHECKING:
    from trussflow.blocks.linear_analysis.linear_model import LinearModel


def loop_transfer(
    diagram: Diagram,
    port: Reference,
    *,
    openings: References = (),
    at: OperatingPoint | None = None,
) -> LinearModel:
    """Return the loop transfer function with the loop broken at a wire.

    A signal w that is injected at the broken end returns through the rest of the diagram as
    -L w. L is the loop gain for negative feedback, as ``control.margin``,
    ``control.nyquist_plot`` and ``control.disk_margins`` expect it.

    Parameters
    ----------
    diagram : Diagram
        The closed loop.
    port : Port or str
        Wire to open: an input of a block (that wire alone), or an output (every wire from
        it); whole or sliced. Loops through elements that are not in the slice stay closed.
    openings : Port, str or sequence of these
        Other wires that are cut: the loops through them are open as well.
    at : OperatingPoint, optional
        Operating point; by default the initial states.

    Returns
    -------
    LinearModel
        Square model from the broken elements to the returned signals with reversed sign.

    Raises
    ------
    LinearAnalysisError
        If no loop passes there; the message lists the ports that loops pass through.
    NameLookupError
        If there is no such port; the message lists those there are.

    Warns
    -----
    SimulationWarning
        If the loop gain is identically zero.
    """
    one = refuse_open(diagram, port)
    # As input and output at the same cut: sent into the one end, read at the other.
    linearizer = Linearizer(diagram, [port], [port], cut=[port, *listed(openings)])
    model = linearizer.at(at)
    # An injected signal returns as -L times itself.
    model.C, model.D = -model.C, -model.D
    model.set_outputs([f"{name}_returned" for name in model.output_labels])
    if not _passes(model):
        warn(
            f"the loop gain at '{one.port.full_path}' is identically zero: at this operating point no signal "
            "comes back around the loop; name another wire or fewer openings, or another "
            "operating point with at=..."
        )
    return model


def refuse_open(diagram: Diagram, port: Reference) -> Named:
    """Return the wire that a user names; a loop must pass through it.

    Parameters
    ----------
    diagram : Diagram
        The closed loop.
    port : Port or str
        The wire.

    Raises
    ------
    LinearAnalysisError
        If no loop passes there; the message lists the ports that loops pass through.
    NameLookupError
        If there is no such port.
    """
    system = flatten(diagram, external=True)
    one = named(system, port)
    looping = _looping(system)
    read = {
        (reader.block.path, reader.name) for reader, _, _ in readers(system, one.port)
    }
    if read.isdisjoint({(path, name) for _, path, name in looping}):
        through = sorted({f"'{source.path}'" for source, _, _ in looping})
        raise LinearAnalysisError(
            f"no loop passes through '{one.port.full_path}'; "
            + (
                f"loops pass through: {', '.join(through)}"
                if through
                else "there is no loop"
            )
        )
    return one


def _passes(model: LinearModel) -> bool:
    """Return whether any input has an influence on any output, by the pattern of non-zeros."""
    # States that an input reaches through non-zero elements of A. Products of matrices
    # would show round-off instead of zeros.
    reached = np.any(model.B, axis=1)
    before = -1
    # The left operand is the previous number: repeat until no state is added.
    while before != (before := int(reached.sum())):
        reached |= np.any(model.A[:, reached], axis=1)
    return bool(np.any(model.D) or np.any(model.C[:, reached]))


def sensitivity(
    diagram: Diagram,
    port: Reference,
    *,
    complementary: bool = False,
    openings: References = (),
    at: OperatingPoint | None = None,
) -> LinearModel:
    r"""Return the sensitivity function of a loop at a wire, from an added disturbance to the signal.

    .. math:: S = (I + L)^{-1}, \qquad T = I - S

    Parameters
    ----------
    diagram : Diagram
        The closed loop.
    port : Port or str
        Wire of the loop, as for `loop_transfer`.
    complementary : bool
        Whether to return T instead of S.
    openings : Port, str or sequence of these
        Wires to cut: the loops through them are open.
    at : OperatingPoint, optional
        Operating point; by default the initial states.

    Returns
    -------
    LinearModel
        Square.

    Raises
    ------
    LinearAnalysisError
        If no loop passes there; the message lists the ports that loops pass through.
    NameLookupError
        If there is no such port; the message lists those there are.
    """
    model = loop_transfer(diagram, port, openings=openings, at=at)
    model.A, model.B, C, D = sensitivity_matrices(model)
    # T = I - S has the output matrix -C and the feedthrough I - (I + D_L)^-1 = (I +
    # D_L)^-1 D_L; `model.D` is still that of L here.
    model.C, model.D = (-C, D @ model.D) if complementary else (C, D)
    model.set_outputs(model.input_labels)
    return model


@dataclass(frozen=True, slots=True, repr=False)
class LoopMargins(Described):
    """Margins of a loop in one or several channels; they print as a table.

    Attributes
    ----------
    channels : dict of str to Margins
        Margins of each channel, the others closed.
    disk : float
        Disk margin for changes in all channels at once, balanced [1].
    gain, phase : float
        Gain and phase margins that it guarantees in all channels at once [dB, deg].
    frequency : float
        Frequency of the smallest disk margin [rad/s].
    """

    channels: dict[str, Margins]
    disk: float
    gain: float
    phase: float
    frequency: float

    def _described(self) -> Description:
        facts = {"": ("gain", "phase", "delay", "crossover", "disk")}
        for name, channel in self.channels.items():
            with np.errstate(divide="ignore"):  # without a limit the factor is zero
                gains = 20.0 * np.log10([channel.gain_down, channel.gain_up])
            facts[name] = (
                f"{gains[0]:.1f} to {gains[1]:.1f} dB",
                f"{channel.phase:.1f}°",
                f"{channel.delay:.3g} s",
                f"{channel.crossover:.3g} rad/s".replace("nan rad/s", "none"),
                f"{channel.disk:.3f}",
            )
        together = (
            f"disk {self.disk:.3f} (±{self.gain:.1f} dB, ±{self.phase:.1f}°) "
            f"at {self.frequency:.3g} rad/s"
        )
        return Description(f"margins; all channels at once: {together}", facts)


def loop_margins(
    diagram: Diagram,
    port: Reference,
    *,
    openings: References = (),
    at: OperatingPoint | None = None,
    omega: npt.ArrayLike | None = None,
) -> LoopMargins:
    """Return gain, phase, delay and disk margins of each channel of a loop, and the disk margin of all.

    Parameters
    ----------
    diagram : Diagram
        The closed loop; sampled blocks may be in it.
    port : Port or str
        Wire to open, as for `loop_transfer`; each element is a channel.
    openings, at
        As for `loop_transfer`.
    omega : array_like, optional
        Frequencies, close enough for interpolation [rad/s]; by default from a thousandth of the slowest to
        a thousand times the fastest pole, dense around resonances.

    Returns
    -------
    LoopMargins
        The margins.

    Raises
    ------
    LinearAnalysisError
        If no loop passes there, the closed loop is unstable (it has no margins), or slycot is missing for the
        disk margin of several channels.

    Warns
    -----
    SimulationWarning
        If the diagram has unstable poles that the loop hides: its margins are those of the other poles.
    """
    given = None if omega is None else frequencies(np.unique(frequencies(omega)), 2)
    return margins_of(loop_transfer(diagram, port, openings=openings, at=at), given)


def margins_of(loop: LinearModel, omega: Vector | None = None) -> LoopMargins:
    """Return the margins of a loop gain.

    Parameters
    ----------
    loop : LinearModel
        Loop gain, square.
    omega : array, shape (k,), optional
        Frequencies [rad/s]; by default dense around the poles.

    Raises
    ------
    LinearAnalysisError
        If the closed loop is unstable.
    """
    channels, grid, S = _channels(loop, omega)
    return LoopMargins(channels, *disk_margin(loop, grid, S))


def channels_of(loop: LinearModel) -> dict[str, Margins]:
    """Return the margins of each channel of a `loop` gain, the others closed; errors as of `margins_of`."""
    return _channels(loop, None)[0]


def _channels(
    loop: LinearModel, omega: Vector | None
) -> tuple[dict[str, Margins], Vector, NDArray[np.complex128]]:
    """Return the margins of the channels, the frequencies, and the sensitivities there."""
    poles = stable_poles(loop, loop.input_labels[0])
    sampled = loop.isdtime(strict=True)
    both = np.concatenate([loop.poles(), poles])
    # Integrators have no frequency, and dead beat (a pole at z = 0) has no logarithm.
    both = both[np.abs(both) > 0.0]
    # Continuous-time equivalents s = log(z) / T of sampled poles.
    rates = np.log(both) / loop.dt if sampled else both
    sizes = np.abs(rates)[np.abs(rates) > 0.0]
    low, high = 1e-3 * sizes.min(initial=1.0), 1e3 * sizes.max(initial=1.0)
    # The response of a sampled loop repeats above half the sampling frequency.
    high = np.pi / loop.dt if sampled else high
    grid = frequencies_about(rates, low, high) if omega is None else omega
    S = sensitivities(loop, grid)
    gains = channel_responses(S)
    ends = real_sensitivities(loop, sizes.min(initial=1.0))
    disks, _ = channel_disks(loop, grid)
    channels = {
        label: channel_margins(gains[:, k], grid, ends[:, k], float(disks[k]))
        for k, label in enumerate(loop.input_labels)
    }
    return channels, grid, S


def _looping(system: System) -> list[tuple[Port, str, str]]:
    """Return the wires that loops pass through: source, path of the reader, and its input.

    A loop passes through a wire if the blocks at both ends lead to each other.
    """
    wires = [
        (driver.source, path, name)
        for (path, name), drivers in system.drivers.items()
        for driver in drivers
        if driver.source is not None
    ]
    graph: dict[str, list[str]] = {path: [] for path in system.blocks}
    for source, path, _ in wires:
        graph[path].append(source.block.path)
    # Blocks that lead to each other are in one strongly connected component. Reversing
    # all edges, as `graph` does, does not change the components.
    group = {path: k for k, paths in enumerate(components(graph)) for path in paths}
    return [wire for wire in wires if group[wire[0].block.path] == group[wire[1]]]
