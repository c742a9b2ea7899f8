r"""Frequency response of a linearized diagram, with exact transport delays.

A delay T with the input u has the output :math:`w = e^{-j \omega T} u`. In the linear model its
approximant :math:`\dot z = A_p z + B_p u`, :math:`w = C_p z` has the same output if

.. math:: e^{j \omega T} z = v u, \qquad C_p v = 1

take the place of its equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.library.transport_delay import TransportDelay
from trussflow.blocks.linear_analysis.linearize import Linearizer
from trussflow.blocks.linear_analysis.opened_model import LocalJacobians
from trussflow.blocks.linear_analysis.operating_point import OperatingPoint
from trussflow.blocks.linear_analysis.references import References
from trussflow.blocks.support.interrupts import interruptible
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import frequencies

if TYPE_CHECKING:
    import control


@interruptible()
def frequency_response(
    item: Block,
    inputs: References = None,
    outputs: References = None,
    *,
    omega: Sequence[float] | Vector,
    at: OperatingPoint | None = None,
    cut: References = (),
) -> control.FrequencyResponseData:
    r"""Return the frequency response of `linearize`, with exact transport delays.

    Delays are :math:`e^{-j \omega T}` instead of their approximants. In a diagram with sampled blocks,
    delays of whole samples are exact and transport delays are approximants.

    Parameters
    ----------
    item : Block
        A diagram, or a single block.
    inputs, outputs, cut : Port, str or sequence of these, optional
        As for `linearize`.
    omega : array_like
        Frequencies [rad/s].
    at : OperatingPoint, optional
        Operating point; by default the initial states.

    Returns
    -------
    control.FrequencyResponseData

    Raises
    ------
    LinearAnalysisError
        If an argument is invalid, or there is an undamped resonance at a frequency.
    """
    import control

    omega = frequencies(omega)
    linearizer = Linearizer(item, inputs, outputs, cut=cut)
    model, point, (x, d, p) = linearizer.opened(at)
    if model.instants is not None:
        return linearizer.at(at).frequency_response(omega, squeeze=False)
    size = x.size
    factors = np.outer(1j * omega, np.ones(size))
    with LocalJacobians(model, point.time, p) as local:
        rates, rows = local.linear(x, d)
    for path, delay in model.plan.system.blocks.items():
        if type(delay) is not TransportDelay:
            continue
        # Rates (A_p z + B_p u) / tau of the approximant; the chain rule gave u by (x, d).
        states = model.plan.x.span_of(path)
        by_inputs = delay.delay * rates[states]
        by_inputs[:, states] -= np.kron(delay.A, np.eye(delay.size))
        by_inputs = (
            np.kron(delay.B / (delay.B @ delay.B), np.eye(delay.size)) @ by_inputs
        )
        # The shortest v with C_p v = 1; the output is the same for each.
        v = delay.C[:, None] / (delay.C @ delay.C)
        rates[states] = np.kron(v, by_inputs)
        turns = np.exp(1j * omega * delay.delay)
        factors[:, states] = turns[:, None]
    columns = model.input_columns
    A, B = rates[:, :size], rates[:, columns]
    C, D = rows[:, :size], rows[:, columns]
    each = []
    for w, factor in zip(omega, factors, strict=True):
        try:
            each.append(C @ np.linalg.solve(np.diag(factor) - A, B) + D)
        except np.linalg.LinAlgError:
            raise LinearAnalysisError(
                f"the response at {w:g} rad/s is not finite: undamped resonance"
            ) from None
    input_labels, output_labels = linearizer.labels()
    return control.FrequencyResponseData(
        np.stack(each, axis=-1),
        omega,
        inputs=input_labels,
        outputs=output_labels,
        smooth=omega.size > 3,
    )
