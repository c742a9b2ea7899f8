r"""Multisines: periodic signals that excite all frequencies of a response at once.

Periodic signals need no window: over a whole period, in the steady state, the discrete Fourier
transforms of input and output of a linear system have the ratio :math:`G(j\omega_k)` exactly.
Source: Pintelon, Schoukens (2012), *System Identification: A Frequency Domain Approach*,
chapters 2 and 5.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals
from trussflow.blocks.framework.port import Output, Port
from trussflow.blocks.framework.signal_injection import injected, readers
from trussflow.blocks.framework.system import System
from trussflow.blocks.library.sources import Constant
from trussflow.blocks.linear_analysis.operating_point import OperatingPoint
from trussflow.blocks.support.types import Array, Vector


class Multisine(Block):
    r"""Sines of equal amplitude, with phases of its own for each element of a port.

    .. math:: y = a \frac{1}{\sqrt K} \sum_{k=1}^{K} \sin(\omega_k t + \varphi_k)

    so that its mean square is :math:`a^2 / 2`, as that of one sine.

    Parameters
    ----------
    port : Port
        Port that receives it; its shape and unit are used.
    omega : Vector
        Frequencies [rad/s].
    amplitude : Vector
        a of each element [unit of the port].
    """

    y = Output("extent", unit=Attribute("own_unit"))
    amplitude = Parameter(shape="extent", meaning="a")
    # Parameters, not constants of the compiled code, so that all responses share it.
    omega = Parameter(shape="lines", unit="rad/s", meaning="ω")
    phase = Parameter(shape=("lines", "size"), unit="rad", meaning="φ")

    def __init__(self, port: Port, omega: Vector, amplitude: Vector) -> None:
        self.extent = port.shape or ()
        self.size, self.lines = amplitude.size, omega.size
        units = port.element_units()
        self.own_unit = units[0] if len(set(units)) == 1 else None
        super().__init__(
            amplitude=amplitude.reshape(self.extent),
            omega=omega,
            phase=np.zeros((self.lines, self.size)),
        )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the sum of the sines."""
        sines = np.sum(
            np.sin(np.reshape(p.omega, (self.lines, 1)) * t + p.phase), axis=0
        ) / np.sqrt(self.lines)
        return {"y": p.amplitude * np.reshape(sines, self.extent)}


def excited(
    system: System, point: OperatingPoint, sources: Mapping[Port, Block]
) -> System:
    """Return a system with signals added, and with all inputs from outside constant.

    Parameters
    ----------
    system : System
        The system; it stays as it is.
    point : OperatingPoint
        Values of the external inputs.
    sources : mapping of Port to Block
        Excitations, keyed by port.

    Raises
    ------
    LinearAnalysisError
        If nothing reads such a port.
    """
    for port in system.root.inputs():
        if port.name in system.external:
            constant = Constant(point.inputs[port.name], unit=port.unit).named(
                f"(constant {port.name})"
            )
            system = injected(system, port, constant, cut=True)
    outside = {block.path for block in system.external.values()}
    system = replace(
        system,
        blocks={path: b for path, b in system.blocks.items() if path not in outside},
    )
    for port, source in sources.items():
        if not readers(system, port):
            raise LinearAnalysisError(
                f"nothing reads '{port.full_path}', so it cannot be excited"
            )
        system = injected(system, port, source)
    return system
