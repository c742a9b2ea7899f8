r"""Frequency response at a chosen amplitude, by harmonic balance.

All states oscillate, :math:`x = x_0 + \mathrm{Re}(X e^{j \omega t})`; of what the nonlinear
equations make of that, the first harmonic is kept:

.. math:: j \omega X = F_1(X, U), \qquad Y = G_1(X, U)

with :math:`F_1(X, U) = \frac{1}{\pi}\int_0^{2\pi} f(x_0 + \mathrm{Re}(X e^{j\varphi}),
u_0 + \mathrm{Re}(U e^{j\varphi}))\, e^{-j\varphi} d\varphi`. So every signal has the amplitude
that it has in the loop, and every nonlinearity the describing function of that amplitude.
Source: Gelb, Vander Velde (1968), *Multiple-Input Describing Functions and Nonlinear System
Design*, chapter 3. The mean values stay at the operating point.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.errors import LinearAnalysisError
from trussflow.blocks.framework.interrupts import interruptible
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.framework.validation import frequencies, positive
from trussflow.blocks.linear_analysis.describing_function import PHASES, columns
from trussflow.blocks.linear_analysis.linearize import Linearizer
from trussflow.blocks.linear_analysis.operating_point import OperatingPoint
from trussflow.blocks.linear_analysis.references import References
from trussflow.blocks.simulation.prepared import Assembly
from trussflow.blocks.tracing.quantities import derivative, outputs

if TYPE_CHECKING:
    import control

Complex = NDArray[np.complex128]

TOLERANCE = 1e-9
"""Of the balance, relative to the largest amplitude [-]: states that move a thousand times less are
still right to 1e-6, and leaving out harmonics costs more. One scale for all, because small states
that depend on powers below one would otherwise hold up the solver."""

SMALLEST = 1e-9
"""Amplitude, relative to the largest, at which a state that stays still is looked at."""


@interruptible()
def frequency_response(
    item: Block,
    inputs: References = None,
    outputs: References = None,
    *,
    omega: Sequence[float] | Vector,
    amplitude: float,
    at: OperatingPoint | None = None,
    cut: References = (),
) -> control.FrequencyResponseData:
    """Return the frequency response at an amplitude: the first harmonic, by harmonic balance.

    For small amplitudes and smooth equations it is the frequency response of `linearize`.

    Parameters
    ----------
    item : Block
        A diagram without sampled blocks, or a single block.
    inputs, outputs, cut : Port, str or sequence of these, optional
        As for `linearize`; each element of the inputs is excited by itself.
    omega : array_like
        Frequencies [rad/s].
    amplitude : float
        Amplitude of the input [unit of the input].
    at : OperatingPoint, optional
        Around which; it should be an equilibrium.

    Returns
    -------
    control.FrequencyResponseData

    Raises
    ------
    LinearAnalysisError
        If there are sampled blocks, an argument makes no sense, or no balance is found.
    """
    import control

    omega = frequencies(omega)
    positive(LinearAnalysisError, amplitude=amplitude)
    balance = Balance(Linearizer(item, inputs, outputs, cut=cut), at)
    size = len(balance.output_labels), len(balance.input_labels), omega.size
    response = np.zeros(size, dtype=complex)
    for k, frequency in enumerate(omega):
        for j in range(size[1]):
            response[:, j, k] = balance.solve(float(frequency), j, amplitude)[1] / amplitude
    return control.FrequencyResponseData(
        response, omega, inputs=balance.input_labels, outputs=balance.output_labels, smooth=omega.size > 3
    )


class Balance:
    """The harmonic balance of a diagram around one point.

    Parameters
    ----------
    linearizer : Linearizer
        The diagram, its inputs and outputs.
    at : OperatingPoint, optional
        Around which.

    Attributes
    ----------
    input_labels, output_labels : list of str
        Names of the elements.
    """

    def __init__(self, linearizer: Linearizer, at: OperatingPoint | None = None) -> None:
        model, point, (x, d, p) = linearizer.rewired(at)
        model.refuse_harmonics(f"balance harmonics of '{linearizer.item.name}'")
        self.input_labels, self.output_labels = linearizer.labels()
        self._time, self._model, self._size, self._p = point.time, model, x.size, p
        self._z = np.concatenate([x, d])
        self._executor = Assembly(model.plan, [derivative(), outputs(model.taps)], "auto").open(p)

    def _value(self, name: str, z: Vector) -> Vector:
        x, d = z[: self._size].copy(), z[self._size :].copy()
        return self._executor.call(name, self._time, x, d, self._p)

    def _first_harmonic(self, name: str, X: Complex, column: int, amplitude: float) -> Complex:
        """Return F_1 (of "derivative") or G_1 (of "outputs")."""
        total: Complex | float = 0.0
        for phase in PHASES:
            turn = np.exp(1j * phase)
            z = self._z.copy()
            z[: self._size] += np.real(X * turn)
            z[column] += amplitude * np.cos(phase)
            total = total + self._value(name, z) * np.conj(turn)
        return np.asarray(2 * total / PHASES.size)

    def _quasi_linear(self, amplitudes: Vector, column: int, amplitude: float) -> tuple[Any, Any]:
        """Return A and a column of B, of describing functions at these amplitudes."""
        wanted = {i: float(a) for i, a in enumerate(amplitudes)} | {column: amplitude}
        found = columns(lambda z: self._value("derivative", z), self._z, wanted)
        return np.column_stack([found[i] for i in range(self._size)]), found[column]

    def solve(self, omega: float, number: int, amplitude: float) -> tuple[Complex, Complex]:
        """Return the states' and the outputs' complex amplitudes X and Y.

        Parameters
        ----------
        omega : float
            Frequency [rad/s].
        number : int
            Which input is excited [-].
        amplitude : float
            Its amplitude [unit of the input].

        Raises
        ------
        LinearAnalysisError
            If no balance is found.
        """
        column, size = int(self._model.input_columns[number]), self._size
        X = self._states(omega, column, amplitude) if size else np.zeros(0, dtype=np.complex128)
        Y = self._first_harmonic("outputs", X, column, amplitude)
        return X, Y[self._model.output_rows - size]

    def _states(self, omega: float, column: int, amplitude: float) -> Complex:
        """Solve the balance: describing functions of single states first, then all together."""
        from scipy.optimize import NoConvergence, newton_krylov

        size, sizes = self._size, np.full(self._size, amplitude)
        for _ in range(3):
            A, B = self._quasi_linear(sizes, column, amplitude)
            try:
                resolvent = np.linalg.inv(1j * omega * np.eye(size) - A)
            except np.linalg.LinAlgError:
                raise LinearAnalysisError(
                    f"the response at {omega:g} rad/s is not finite: undamped resonance"
                ) from None
            X = resolvent @ B * amplitude
            sizes = np.maximum(np.abs(X), SMALLEST * np.abs(X).max(initial=amplitude))
        scale = np.abs(X).max(initial=0.0) or amplitude

        def residual(parts: Vector) -> Any:
            now = np.asarray(scale * (parts[:size] + 1j * parts[size:]))
            F = self._first_harmonic("derivative", now, column, amplitude)
            step = resolvent @ (F - A @ now) - now
            return np.concatenate([step.real, step.imag]) / scale

        start = np.concatenate([X.real, X.imag]) / scale
        if np.abs(residual(start)).max() <= TOLERANCE:
            return np.asarray(X)  # linear, or near enough
        try:
            found = newton_krylov(residual, start, f_tol=TOLERANCE, maxiter=100)
        except (NoConvergence, ValueError):  # the latter where no step leads anywhere
            raise LinearAnalysisError(
                f"no harmonic balance found at {omega:g} rad/s with an amplitude of "
                f"{amplitude:g}; try another amplitude"
            ) from None
        return np.asarray(scale * (found[:size] + 1j * found[size:]))
