"""Frequency response matrix estimated from runs in which all inputs are excited by broadband signals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import ceil, lcm
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.clock import common_tick, exact
from trussflow.blocks.framework.layout import spans
from trussflow.blocks.framework.system import Indices, flatten
from trussflow.blocks.linear_analysis.frequency.excitation import Multisine, excited
from trussflow.blocks.linear_analysis.operating_point import (
    OperatingPoint,
    as_wired,
    completed,
)
from trussflow.blocks.linear_analysis.references import (
    References,
    all_named,
    distinct_labels,
)
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import (
    finite_array,
    frequencies,
    is_whole,
    positive,
    positive_whole,
    shown,
)

if TYPE_CHECKING:
    from trussflow.blocks.linear_analysis.frequency.response_estimate import (
        ResponseEstimate,
    )

MIN_STEPS = 10
"""Steps within a period of the highest frequency [-]."""

MOST_PERIODS = 64
"""Largest number of periods until the response must be periodic [-]."""

MOST_SAMPLES = 10**7
"""Steps in a period [-]."""

Spectra = NDArray[np.complex128]


def estimated_response(
    item: Block,
    inputs: References = None,
    outputs: References = None,
    *,
    omega: Sequence[float] | Vector,
    amplitude: npt.ArrayLike,
    step: float,
    at: OperatingPoint | None = None,
    realizations: int = 4,
    cycles: int = 5,
    sample_time: float | None = None,
    tolerance: float = 1e-3,
    solver: str = "rk4",
    seed: int = 0,
) -> ResponseEstimate:
    r"""Run a diagram under broadband excitation of its inputs, and return the frequency response matrix.

    The excitation has a period T. Runs last until the outputs are periodic, too; then

    .. math:: \hat G(j\omega_k) = Y(\omega_k)\, U(\omega_k)^{-1}, \qquad \omega_k T / 2 \pi = 1, 2, \dots

    with the discrete Fourier transforms, over one period, of m runs under different excitations of the
    m inputs. The excitations are sines of random phases at the wanted frequencies, in all inputs at once;
    those of different runs are orthogonal. Of a linear diagram the result is exact. Of any other it is the
    best linear approximation for this amplitude; distortions and noise are in the standard error [1]_.

    Parameters
    ----------
    item : Block
        A diagram, or a single block; sampled and Python blocks may be in it.
    inputs, outputs : Port, str or sequence of these, optional
        Ports that receive the excitation, and measured ports, as for `linearize`.
    omega : array_like
        Frequencies [rad/s]. They are moved to the nearest multiples of 2π/T, and each counts once.
    amplitude : array_like
        Amplitude of a sine with the power of the excitation, for each element of the inputs or one for all
        [unit of the input].
    step : float
        Step of the solver, and between samples [s].
    at : OperatingPoint, optional
        Initial operating point; by default the initial states. Its time is ignored; each run begins at 0.
    realizations : int
        Number of repetitions with other random phases [-].
    cycles : int
        Periods of the slowest frequency within T, at least [-].
    sample_time : float, optional
        Hold the excitation for as long and read the outputs as often [s]: the response of a sampled loop
        in discrete time, as `linearize` gives it with the same sample time. By default it is that of
        continuous time.
    tolerance : float
        Largest relative difference of two successive periods that counts as steady, for each output [-];
        infinite for diagrams with noise.
    solver : str
        As for `Simulator`.
    seed : int
        Seed of the random phases [-].

    Returns
    -------
    ResponseEstimate
        A ``control.FrequencyResponseData`` with its `standard_error`.

    Raises
    ------
    LinearAnalysisError
        If there is no input or output, an argument is invalid, or the outputs do not become periodic.
    ParameterError
        If the amplitude has another shape than the inputs.

    References
    ----------
    .. [1] Dobrowiecki, Schoukens, Guillaume (2006), "Optimized excitation signals for MIMO frequency
       response function measurements", IEEE Trans. Instrum. Meas. 55(6), 2072-2079.

    Examples
    --------
    >>> from trussflow.blocks import TransferFunction, estimated_response
    >>> lag = TransferFunction([1.0], [1.0, 1.0])
    >>> found = estimated_response(lag, omega=[0.5, 1.0, 2.0], amplitude=0.1, step=0.01)
    >>> bool(np.allclose(found.complex, 1 / (1 + 1j * found.omega), rtol=0, atol=1e-3))
    True
    """
    from trussflow.blocks.linear_analysis.frequency.response_estimate import (
        ResponseEstimate,
    )

    omega = frequencies(omega)
    read, often = (step, MIN_STEPS) if sample_time is None else (sample_time, 2)
    positive(LinearAnalysisError, step=step, sample_time=read)
    positive_whole(realizations=realizations, cycles=cycles)
    if not is_whole(seed) or seed < 0:
        raise LinearAnalysisError(
            f"seed = {shown(seed)} must be a whole number, 0 or above"
        )
    given: object = tolerance
    if not (isinstance(given, float | int) and given > 0):
        raise LinearAnalysisError(
            f"tolerance = {shown(tolerance)} must be positive; infinite under noise"
        )
    if not read * omega.max() < 2 * np.pi / often:
        raise LinearAnalysisError(
            f"the response is read every {read:g} s, less than {often} times within a period of "
            f"{omega.max():g} rad/s; take a shorter {'step' if sample_time is None else 'sample_time'}"
        )
    system = flatten(item, external=True)
    put_in = all_named(system, inputs, item.inputs())
    wanted = all_named(system, outputs, item.outputs())
    cannot = f"cannot estimate a response of '{item.name}'"
    input_labels = distinct_labels(cannot, "inputs", put_in)
    output_labels = distinct_labels(cannot, "outputs", wanted)
    size = len(input_labels)
    sizes = finite_array("amplitude", amplitude, (size,))
    positive(LinearAnalysisError, amplitude=float(sizes.min()))
    period = _period(
        [exact(read), exact(step), *(clock.period for clock in system.clocks)],
        cycles * 2 * np.pi / float(omega.min()),
    )
    samples = int(period / exact(read))
    lines = np.unique(np.round(omega * float(period) / (2 * np.pi))).astype(int)
    moved = 2 * np.pi * lines / float(period)
    parts = spans(one.port.elements().size for one in put_in)
    sources = [
        Multisine(one.port, moved, sizes[part])
        for one, part in zip(put_in, parts, strict=True)
    ]
    for number, source in enumerate(sources, 1):
        source.named(f"excitation {number}")
        if sample_time is not None:
            source.sampled(sample_time)
    point, _ = completed(as_wired(system), at, [], {})
    simulator = Simulator(
        excited(
            system,
            point,
            {one.port: source for one, source in zip(put_in, sources, strict=True)},
        ),
        step=step,
        solver=solver,
        log_step=read,
        log={f"in_{i}": source.y for i, source in enumerate(sources)}
        | {f"out_{i}": one.leaf for i, one in enumerate(wanted)},
    )
    runs = _Runs(simulator, point, sources, period, samples, lines, tolerance)
    rng = np.random.default_rng(seed)
    estimates = []
    for _ in range(realizations):
        phases = _phases(rng, size, lines.size)
        each = zip(*(runs.spectra(phase) for phase in phases), strict=True)
        # Of shape (frequencies, runs, signals): the runs are the equations for the rows of G.
        U, Y = (np.stack(spectra).transpose(2, 0, 1) for spectra in each)
        estimates.append(np.linalg.solve(U, Y).transpose(2, 1, 0))
    return ResponseEstimate(
        np.array(estimates), moved, inputs=input_labels, outputs=output_labels
    )


def _period(times: list[Fraction], least: float) -> Fraction:
    """Return the shortest multiple of all `times`, from the `least` time on [s]."""
    tick = common_tick(times)
    common = lcm(*(int(time / tick) for time in times)) * tick
    period = common * ceil(least / common)
    if period / min(times) > MOST_SAMPLES:
        raise LinearAnalysisError(
            f"the excitation repeats itself after {float(period):g} s, more than {MOST_SAMPLES:.0e} steps: "
            "leave out the lowest frequencies, or take a longer step that goes with the sample times"
        )
    return period


def _phases(rng: np.random.Generator, size: int, lines: int) -> Iterator[Vector]:
    """Yield the phases (lines, inputs) of each run, orthogonal by the columns of the Fourier matrix."""
    phase = rng.uniform(0.0, 2 * np.pi, (lines, size))
    count = np.arange(size)
    for run in count:
        # A random phase of each run, too: otherwise noise that is equal in all runs would
        # only disturb the estimate for the first input.
        own = rng.uniform(0.0, 2 * np.pi, (lines, 1))
        yield phase + own + 2 * np.pi * run * count / size


@dataclass(slots=True)
class _Runs:
    """Runs of increasing length, until the last two periods agree."""

    simulator: Simulator
    point: OperatingPoint
    sources: Sequence[Multisine]
    period: Fraction
    samples: int
    lines: Indices
    tolerance: float
    periods: int = 2

    def spectra(self, phase: Vector) -> tuple[Spectra, Spectra]:
        """Return the Fourier coefficients of the inputs and of the outputs, of shape (signals, lines)."""
        parameters = dict(self.point.parameters)
        first = phase.shape[1]
        for source, part in zip(
            self.sources, spans(source.size for source in self.sources), strict=True
        ):
            # Phases are parameters, so that all runs use the same compiled code.
            parameters[f"{source.path}.phase"] = phase[:, part]
        while self.periods <= MOST_PERIODS:
            result = self.simulator.run(
                float(self.periods * self.period),
                parameters=parameters,
                initial=self.point.states,
                progress=False,
            )
            rows = result["time"].size
            values = np.column_stack(
                [one.values.reshape(rows, -1) for one in result.data_vars.values()]
            )
            # The last row begins another period and is left out.
            halves = values[rows - 1 - 2 * self.samples : rows - 1].reshape(
                2, self.samples, -1
            )
            before, last = np.fft.rfft(halves, axis=1)[:, self.lines].swapaxes(1, 2)
            off = np.abs(last - before).max(axis=1)
            size = np.abs(last).max(axis=1)
            # Outputs only: the excitation repeats itself from the start.
            if np.all((off <= self.tolerance * size)[first:]):
                return last[:first], last[first:]
            # Kept for the runs that follow, as they have the same transients.
            self.periods *= 2
        raise LinearAnalysisError(
            f"the response is not periodic after {MOST_PERIODS} periods of {float(self.period):g} s: the two "
            f"last differ by {(off / size)[first:].max():.2g}; is the diagram stable, or lightly damped? "
            "Start at rest with at=trim(...), take more cycles, or a larger tolerance, infinite under noise"
        )
