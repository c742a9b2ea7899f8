"""Frequency response measured on the simulated nonlinear diagram, sine by sine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.clock import exact
from trussflow.blocks.framework.errors import LinearAnalysisError
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import flatten
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.framework.validation import by_name, frequencies, positive, shown
from trussflow.blocks.library.sources import Sine
from trussflow.blocks.linear_analysis.frequency.excitation import excited
from trussflow.blocks.linear_analysis.operating_point import OperatingPoint, Surroundings
from trussflow.blocks.linear_analysis.references import Reference, References, all_labels, all_named, named
from trussflow.blocks.simulation.simulator import Simulator

if TYPE_CHECKING:
    import control

FEWEST_SAMPLES = 10
"""Steps within a period [-]."""

MOST_WINDOWS = 200
"""Windows to wait for a steady response."""


def measured_response(
    item: Block,
    input: Reference,
    outputs: References = None,
    *,
    omega: Sequence[float] | Vector,
    amplitude: float,
    step: float,
    at: OperatingPoint | None = None,
    initial: Sequence[dict[str, Any]] | None = None,
    cycles: int = 5,
    tolerance: float = 1e-3,
    solver: str = "rk4",
) -> control.FrequencyResponseData:
    r"""Simulate the response to small sines, and return gain and phase of the first harmonic.

    At each frequency the input gets :math:`a \sin \omega t` added, and the outputs are fitted
    by :math:`c_0 + c_1 t + c_s \sin \omega t + c_c \cos \omega t` over `cycles` periods at a
    time, until two fits in a row agree.

    Parameters
    ----------
    item : Block
        A diagram, or a single block; sampled and Python blocks may be in it.
    input : Port or str
        Port that receives the sine; one element.
    outputs : Port, str or sequence of these, optional
        Measured ports; by default the exposed ports of the diagram, or those of the block.
    omega : array_like
        Frequencies [rad/s].
    amplitude : float
        a [unit of the input].
    step : float
        Step of the solver, and between samples [s]. Signals that jump at instants are sampled
        after the jump, and so seem half a step early.
    at : OperatingPoint, optional
        Initial operating point; by default the initial states. Its time is ignored; each simulation begins
        at 0.
    initial : sequence of dict, optional
        For each frequency, initial states that differ from those of the point, such as those
        of the oscillation that a linear model predicts: it shortens the wait.
    cycles : int
        Periods in a window [-].
    tolerance : float
        Relative difference between two windows that is steady enough [-].
    solver : str
        As for `Simulator`.

    Returns
    -------
    control.FrequencyResponseData

    Raises
    ------
    LinearAnalysisError
        If the input is not one element, an argument makes no sense, or the response does not
        become steady.
    """
    import control

    omega = frequencies(omega)
    positive(LinearAnalysisError, amplitude=amplitude, step=step, cycles=cycles, tolerance=tolerance)
    if step * omega.max() > 2 * np.pi / FEWEST_SAMPLES:
        raise LinearAnalysisError(
            f"step = {step} s is less than {FEWEST_SAMPLES} times within a period of "
            f"{omega.max():g} rad/s; take a shorter one"
        )
    given: object = initial
    if given is not None and (not isinstance(given, Sequence) or len(given) != omega.size):
        raise LinearAnalysisError(
            f"initial = {shown(given)} does not fit {omega.size} frequencies; give a list of one dict each"
        )
    system = flatten(item, external=True)
    source = named(system, input)
    if source.port.elements().size != 1:
        raise LinearAnalysisError(
            f"'{source.port.full_path}' has {source.port.elements().size} elements; name one, "
            "such as 'block.port[0]'"
        )
    wanted = all_named(system, outputs, item.outputs())
    labels = all_labels(wanted)
    point, _ = Surroundings(system).complete(at, [], {})
    response = np.zeros((len(labels), 1, omega.size), dtype=np.complex128)
    simulator = Simulator(
        excited(system, point, {source.port: _sine(source.port)}),
        step=step,
        solver=solver,
        log_step=step,
        log={f"output_{i}": one.leaf for i, one in enumerate(wanted)},
    )
    for k, frequency in enumerate(omega):
        start = dict(point.states) | dict(by_name("initial states", initial[k] if initial else None))
        response[:, 0, k] = _steady(
            simulator, point, start, float(frequency), amplitude, step, cycles, tolerance
        )
    return control.FrequencyResponseData(
        response, omega, inputs=source.labels(), outputs=labels, smooth=omega.size > 3
    )


SINE = "added sine"


def _sine(port: Port) -> Sine:
    """Return the sine that is added at a port."""
    shape = port.shape or ()
    sine = Sine(np.zeros(shape), np.zeros(shape), unit=port.element_units()[0])
    sine.named(SINE)
    return sine


def _steady(
    simulator: Simulator,
    point: OperatingPoint,
    start: dict[str, Any],
    omega: float,
    amplitude: float,
    step: float,
    cycles: int,
    tolerance: float,
) -> NDArray[np.complex128]:
    """Simulate until two windows agree; return the gain."""
    window = cycles * 2 * np.pi / omega
    parameters = dict(point.parameters) | {
        f"{SINE}.amplitude": amplitude,
        f"{SINE}.frequency": omega / (2 * np.pi),
    }
    length = 4
    while length <= MOST_WINDOWS:
        duration = exact(step) * int(np.ceil(length * window / step))
        result = simulator.run(float(duration), parameters=parameters, initial=start, progress=False)
        time = result["time"].values
        values = np.column_stack([result[name].values.reshape(time.size, -1) for name in result.data_vars])
        last, before = (
            _first_harmonic(time, values, omega, time[-1] - (n + 1) * window, window) for n in (0, 1)
        )
        if np.abs(last - before).max() <= tolerance * np.abs(last).max():
            return last / amplitude
        length *= 2
    raise LinearAnalysisError(
        f"the response at {omega:g} rad/s is not steady after {MOST_WINDOWS // 2} windows of "
        f"{cycles} periods; is the diagram stable, or lightly damped? start at the oscillation "
        "with initial=, or allow a larger tolerance"
    )


def _first_harmonic(
    time: Vector, values: Vector, omega: float, begin: float, window: float
) -> NDArray[np.complex128]:
    """Return the complex amplitude, relative to a sine, within a window of time."""
    inside = (time >= begin) & (time < begin + window)
    t = time[inside]
    basis = np.column_stack([np.sin(omega * t), np.cos(omega * t), np.ones_like(t), t - t.mean()])
    fit = np.linalg.lstsq(basis, values[inside], rcond=None)[0]
    return np.asarray(fit[0] + 1j * fit[1])
