r"""Frequency response of a diagram, linear or at a chosen amplitude by harmonic balance.

All states oscillate, :math:`x = x_0 + \mathrm{Re}(X e^{j \omega t})`; of what the nonlinear
equations make of that, the first harmonic is kept:

.. math:: j \omega X = F_1(X, U), \qquad Y = G_1(X, U)

with :math:`F_1(X, U) = \frac{1}{\pi}\int_0^{2\pi} f(x_0 + \mathrm{Re}(X e^{j\varphi}),
u_0 + \mathrm{Re}(U e^{j\varphi}))\, e^{-j\varphi} d\varphi`. So every signal has the amplitude
that it has in the loop, and every nonlinearity the describing function of that amplitude.
Source: Gelb, Vander Velde (1968), *Multiple-Input Describing Functions and Nonlinear System
Design*, chapter 3. The mean values stay at the operating point.

The output of a delay T is one more unknown W beside the states, with :math:`e^{j \omega T} W = Z` for its
input Z. So an integrator stands for the delay, and :math:`e^{j \omega T}` takes the place of
:math:`j \omega` in its equation.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.system import flatten
from trussflow.blocks.library.transport_delay import TransportDelay
from trussflow.blocks.linear_analysis.describing_function import SAMPLE_PHASES, columns
from trussflow.blocks.linear_analysis.linearize import Linearizer
from trussflow.blocks.linear_analysis.operating_point import OperatingPoint
from trussflow.blocks.linear_analysis.references import References
from trussflow.blocks.simulation.executor import Executor
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.solver import Solver
from trussflow.blocks.support.interrupts import interruptible
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import frequencies, positive
from trussflow.blocks.tracing.quantities import derivative, outputs

if TYPE_CHECKING:
    import control

Complex = NDArray[np.complex128]

BALANCE_TOLERANCE = 1e-9
"""Tolerance of the balance, relative to the largest amplitude [-]. States with a thousandth of this amplitude
are right to 1e-6; omitted harmonics cost more. All states have one scale, because small states under
powers below one would slow down the solver."""

MIN_AMPLITUDE_RATIO = 1e-9
"""Amplitude, relative to the largest, that replaces the zero amplitude of a state at rest."""


@interruptible()
def frequency_response(
    item: Block,
    inputs: References = None,
    outputs: References = None,
    *,
    omega: Sequence[float] | Vector,
    amplitude: float | None = None,
    at: OperatingPoint | None = None,
    cut: References = (),
) -> control.FrequencyResponseData:
    r"""Return the frequency response, linear or at an amplitude.

    Without an amplitude it is the frequency response of `linearize`, with exact transport delays
    :math:`e^{-j \omega T}` in the place of their approximants. In a diagram with sampled blocks, delays
    of whole samples are exact and transport delays are approximants. At an amplitude it is the first
    harmonic by harmonic balance, with exact delays too.

    Parameters
    ----------
    item : Block
        A diagram, or a single block; without sampled blocks if an amplitude is given.
    inputs, outputs, cut : Port, str or sequence of these, optional
        As for `linearize`; each element of the inputs is excited by itself.
    omega : array_like
        Frequencies [rad/s].
    amplitude : float, optional
        Amplitude of the input [unit of the input].
    at : OperatingPoint, optional
        Around which; it should be an equilibrium.

    Returns
    -------
    control.FrequencyResponseData

    Raises
    ------
    LinearAnalysisError
        If an argument makes no sense, there are sampled blocks beside an amplitude, or no balance is found.
    """
    import control

    omega = frequencies(omega)
    system = flatten(item, external=True)
    if amplitude is None and system.clocks:
        return (
            Linearizer(item, inputs, outputs, cut=cut)
            .at(at)
            .frequency_response(omega, squeeze=False)
        )
    delays = [
        block for block in system.blocks.values() if isinstance(block, TransportDelay)
    ]
    override = {block.path: _integrator(block) for block in delays}
    linearizer = Linearizer(item, inputs, outputs, cut=cut, override=override)
    balance = Balance(linearizer, at, delays)
    if amplitude is None:
        response = balance.linear(omega)
    else:
        positive(LinearAnalysisError, amplitude=amplitude)
        number = len(balance.input_labels)
        columns = [
            [balance.solve(w, j, amplitude)[1] / amplitude for j in range(number)]
            for w in omega
        ]
        response = np.transpose(columns)
    return control.FrequencyResponseData(
        response,
        omega,
        inputs=balance.input_labels,
        outputs=balance.output_labels,
        smooth=omega.size > 3,
    )


def _integrator(delay: TransportDelay) -> control.StateSpace:
    """Return an integrator of the signal of a delay."""
    import control

    one = np.eye(delay.size)
    return control.ss(0.0 * one, one, one, 0.0)


class Balance:
    """The harmonic balance of a diagram around one point.

    Parameters
    ----------
    linearizer : Linearizer
        The diagram, its inputs and outputs.
    at : OperatingPoint, optional
        Around which.
    delays : sequence of TransportDelay
        Delays that integrators stand for.

    Attributes
    ----------
    input_labels, output_labels : list of str
        Names of the elements.
    """

    def __init__(
        self,
        linearizer: Linearizer,
        at: OperatingPoint | None = None,
        delays: Sequence[TransportDelay] = (),
    ) -> None:
        model, point, (x, d, p) = linearizer.opened(at)
        self.input_labels, self.output_labels = linearizer.labels()
        self._time = point.time
        self._model = model
        self._size = x.size
        self._p = p
        self._z = np.concatenate([x, d])
        self._name = linearizer.item.name
        self._delays = list[tuple[slice, float]]()
        for delay in delays:
            place = model.plan.place(delay.path, "z")
            self._delays.append((place, delay.delay))

    @cached_property
    def _executor(self) -> Executor:
        self._model.refuse_harmonics(f"balance harmonics of '{self._name}'")
        found = [derivative(), outputs(self._model.taps)]
        return Prepared(self._model.plan, found, Solver(solver="RK45")).open(self._p)

    def _resolvent(self, omega: float, A: Vector) -> Complex:
        """Return (j omega - A)^-1, with exp(j omega T) in the place of j omega for delays."""
        factors = np.full(self._size, 1j * omega)
        for place, length in self._delays:
            factors[place] = np.exp(1j * omega * length)
        try:
            return np.asarray(np.linalg.inv(np.diag(factors) - A))
        except np.linalg.LinAlgError:
            raise LinearAnalysisError(
                f"the response at {omega:g} rad/s is not finite: undamped resonance"
            ) from None

    def linear(self, omega: Vector) -> Complex:
        """Return the linear frequency response, of shape (outputs, inputs, frequencies).

        Parameters
        ----------
        omega : Vector
            Frequencies [rad/s].

        Raises
        ------
        LinearAnalysisError
            If there is an undamped resonance at a frequency.
        """
        size = self._size
        columns = self._model.input_columns
        with self._model.at(self._time, self._p) as local:
            rates, rows = self._model.linear(local, self._z[:size], self._z[size:], {})
        C, D = rows[:, :size], rows[:, columns]
        each = [
            C @ self._resolvent(w, rates[:, :size]) @ rates[:, columns] + D
            for w in omega
        ]
        return np.stack(each, axis=-1)

    def _value(self, name: str, z: Vector) -> Vector:
        x = z[: self._size].copy()
        d = z[self._size :].copy()
        return self._executor.call(name, self._time, x, d, self._p)

    def _first_harmonic(
        self, name: str, X: Complex, column: int, amplitude: float
    ) -> Complex:
        """Return F_1 (of "derivative") or G_1 (of "outputs")."""
        total: Complex | float = 0.0
        for phase in SAMPLE_PHASES:
            turn = np.exp(1j * phase)
            z = self._z.copy()
            z[: self._size] += np.real(X * turn)
            z[column] += amplitude * np.cos(phase)
            total = total + self._value(name, z) * np.conj(turn)
        return np.asarray(2 * total / SAMPLE_PHASES.size)

    def _quasi_linear(
        self, amplitudes: Vector, column: int, amplitude: float
    ) -> tuple[Any, Any]:
        """Return A and a column of B, of describing functions at these amplitudes."""
        wanted = {i: float(a) for i, a in enumerate(amplitudes)} | {column: amplitude}
        found = columns(lambda z: self._value("derivative", z), self._z, wanted)
        return np.column_stack([found[i] for i in range(self._size)]), found[column]

    def solve(
        self, omega: float, number: int, amplitude: float
    ) -> tuple[Complex, Complex]:
        """Return the states' and the outputs' complex amplitudes X and Y.

        Parameters
        ----------
        omega : float
            Frequency [rad/s].
        number : int
            Number of the excited input [-].
        amplitude : float
            Its amplitude [unit of the input].

        Raises
        ------
        LinearAnalysisError
            If no balance is found.
        """
        column = int(self._model.input_columns[number])
        size = self._size
        X = (
            self._states(omega, column, amplitude)
            if size
            else np.zeros(0, dtype=np.complex128)
        )
        Y = self._first_harmonic("outputs", X, column, amplitude)
        return X, Y[self._model.output_rows - size]

    def _states(self, omega: float, column: int, amplitude: float) -> Complex:
        """Solve the balance: describing functions of single states first, then all together."""
        from scipy.optimize import NoConvergence, newton_krylov

        size = self._size
        sizes = np.full(self._size, amplitude)
        for _ in range(3):
            A, B = self._quasi_linear(sizes, column, amplitude)
            resolvent = self._resolvent(omega, A)
            X = resolvent @ B * amplitude
            sizes = np.maximum(
                np.abs(X), MIN_AMPLITUDE_RATIO * np.abs(X).max(initial=amplitude)
            )
        scale = np.abs(X).max(initial=0.0) or amplitude

        def residual(parts: Vector) -> Any:
            now = np.asarray(scale * (parts[:size] + 1j * parts[size:]))
            F = self._first_harmonic("derivative", now, column, amplitude)
            step = resolvent @ (F - A @ now) - now
            return np.concatenate([step.real, step.imag]) / scale

        start = np.concatenate([X.real, X.imag]) / scale
        if np.abs(residual(start)).max() <= BALANCE_TOLERANCE:
            return np.asarray(X)  # linear, or near enough
        try:
            found = newton_krylov(residual, start, f_tol=BALANCE_TOLERANCE, maxiter=100)
        except (NoConvergence, ValueError):  # the latter where no step leads anywhere
            raise LinearAnalysisError(
                f"no harmonic balance found at {omega:g} rad/s with an amplitude of "
                f"{amplitude:g}; try another amplitude"
            ) from None
        return np.asarray(scale * (found[:size] + 1j * found[size:]))
