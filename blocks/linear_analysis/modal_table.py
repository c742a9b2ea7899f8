r"""Modes of a linear model: frequency, damping, and the inputs that drive each.

With right and left eigenvectors r and l, :math:`l^T r = 1`, of the state matrix, the modal coordinate
:math:`\eta = l^T x` of a pole :math:`\lambda` follows :math:`\dot\eta = \lambda \eta + l^T B u`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.linear_analysis.linearize import linearize
from trussflow.blocks.linear_analysis.operating_point import OperatingPoint
from trussflow.blocks.linear_analysis.references import References
from trussflow.blocks.support.summary import Described, Description

if TYPE_CHECKING:
    import control

LEAST_OSCILLATION = 0.1
"""Least ratio of imaginary part to size of a pole that counts as oscillating [1]."""

SHOWN_INPUTS = 3
"""Strongest inputs of a mode that its line shows [-]."""

Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class OscillatingMode:
    r"""One oscillating pole, or the upper one of a pair.

    Attributes
    ----------
    pole : complex
        λ; of a sampled model the logarithm of its pole by the period [1/s].
    shares : dict of str to float
        Share of each input in the excitation of the mode, :math:`|l^T B_j|^2 / \sum_k |l^T B_k|^2`, with the
        inputs in their declared units [1].
    """

    pole: complex
    shares: dict[str, float]

    @property
    def frequency(self) -> float:
        """Natural frequency [Hz]."""
        return abs(self.pole) / (2.0 * np.pi)

    @property
    def damping_ratio(self) -> float:
        """Fraction of critical damping; negative if unstable [1]."""
        return -self.pole.real / abs(self.pole)


@dataclass(frozen=True, slots=True, repr=False)
class ModalTable(Described):
    """Modes of a linear model in ascending order of frequency; it prints as a table.

    Attributes
    ----------
    name : str
        Name of the model.
    modes : tuple of OscillatingMode
        The modes.
    """

    name: str
    modes: tuple[OscillatingMode, ...]

    def _described(self) -> Description:
        facts = {"": ("frequency", "damping ratio", "driven by")}
        for number, mode in enumerate(self.modes, 1):
            strongest = sorted(mode.shares.items(), key=lambda item: -item[1])[
                :SHOWN_INPUTS
            ]
            driven = ", ".join(
                f"{name} {share:.0%}" for name, share in strongest if share >= 0.005
            )
            facts[f"mode {number}"] = (
                f"{mode.frequency:.4g} Hz",
                f"{mode.damping_ratio:z.3%}",
                driven or "no input",
            )
        return Description(f"oscillating modes of {self.name}", facts)


def modal_table(
    item: Block | control.StateSpace,
    inputs: References = None,
    *,
    at: OperatingPoint | None = None,
) -> ModalTable:
    """Return the oscillating modes of a plant or a closed loop.

    Poles at zero and poles with more than 99.5 % of critical damping are left out.

    Parameters
    ----------
    item : Block or control.StateSpace
        A diagram, a block, or a linear model of one.
    inputs : Port, str or sequence of these, optional
        Ports whose influence is shown, as for `linearize`.
    at : OperatingPoint, optional
        Operating point; by default the initial states.

    Returns
    -------
    ModalTable
        The modes.

    Raises
    ------
    LinearAnalysisError
        If there are no inputs, or a linear model is given with inputs or an operating point.

    Examples
    --------
    >>> from trussflow.blocks import TransferFunction, modal_table
    >>> modal_table(TransferFunction([1.0], [1.0, 0.04, 4.0, 0.0]))
    oscillating modes of TransferFunction
              frequency  damping ratio  driven by
      mode 1  0.3183 Hz  1.000%         u 100%
    """
    if isinstance(item, Block):
        ports = item.inputs() if inputs is None else inputs
        model = linearize(item, ports, ports, at=at)
    elif inputs is None and at is None:
        model = item
    else:
        raise LinearAnalysisError(
            "a linear model has its inputs and operating point; leave out inputs and at"
        )
    modes = []
    for pole, left, _ in oscillating_modes(model):
        # A mode that no input drives has shares of zero instead of 0 / 0.
        effects = np.abs(left @ model.B) ** 2
        shares = effects / (effects.sum() or 1.0)
        driven = dict(zip(model.input_labels, shares.tolist(), strict=True))
        modes.append(OscillatingMode(pole, driven))
    return ModalTable(model.name, tuple(modes))


def oscillating_modes(
    model: control.StateSpace,
) -> list[tuple[complex, Complex, Complex]]:
    """Return the oscillating poles, one of each pair, by frequency, with left and right eigenvectors.

    Parameters
    ----------
    model : control.StateSpace
        Any; if sampled, the poles are the logarithms of its own by the period [1/s].
    """
    from scipy.linalg import eig

    found: Any = eig(model.A, left=True, right=True)
    modes = []
    # SciPy's left eigenvectors have l^H A = λ l^H: conjugated they are rows with l^T A.
    for value, left, right in zip(found[0], found[1].T.conj(), found[2].T, strict=True):
        pole = complex(value)
        if model.isdtime(strict=True) and pole:
            pole = complex(np.log(pole)) / model.dt
        # Of a pair, the pole in the upper half plane.
        if pole.imag > LEAST_OSCILLATION * abs(pole):
            modes.append((pole, left / (left @ right), right))
    return sorted(modes, key=lambda mode: abs(mode[0]))
