r"""Periodic signals that excite all frequencies of a response at once: multisines and sweeps.

Whatever repeats itself needs no window: over a whole period, in the steady state, the discrete
Fourier transforms of input and output of a linear system have the ratio :math:`G(j\omega_k)`
exactly. Source: Pintelon, Schoukens (2012), *System Identification: A Frequency Domain
Approach*, chapters 2 and 5.
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

SWEEP_MARGIN = 1.2
"""Factor by which a sweep exceeds the frequency range, because it excites half as much at its ends [-]."""


class Excitation(Block):
    """Base of the signals: one for each element of a port, by an amplitude that may change.

    Parameters
    ----------
    port : Port
        Port that receives it; its shape and unit are used.
    **parameters : Vector
        Further parameters of the signal [as declared].
    """

    y = Output("extent", unit=Attribute("own_unit"))
    amplitude = Parameter(0.0, shape="extent")

    def __init__(self, port: Port, **parameters: Vector) -> None:
        self.extent = port.shape or ()
        self.size = port.elements().size
        self.own_unit = (
            port.element_units()[0] if len(set(port.element_units())) == 1 else None
        )
        super().__init__(amplitude=np.zeros(self.extent), **parameters)


class Multisine(Excitation):
    r"""Sines of equal amplitude.

    .. math:: y = a \frac{1}{\sqrt K} \sum_{k=1}^{K} \sin(\omega_k t + \varphi_k)

    so that its mean square is :math:`a^2 / 2`, as that of one sine.

    Parameters
    ----------
    port : Port
        Port that receives it.
    omega : Vector
        Frequencies [rad/s].
    """

    # not compiled: responses share code
    omega = Parameter(shape="lines", unit="rad/s", meaning="ω")
    phase = Parameter(shape=("lines", "size"), unit="rad", meaning="φ")

    def __init__(self, port: Port, omega: Vector) -> None:
        self.lines = omega.size
        super().__init__(
            port, omega=omega, phase=np.zeros((self.lines, port.elements().size))
        )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the sum of the sines."""
        sines = np.sum(
            np.sin(np.reshape(p.omega, (self.lines, 1)) * t + p.phase), axis=0
        ) / np.sqrt(self.lines)
        return {"y": p.amplitude * np.reshape(sines, self.extent)}


class Sweep(Excitation):
    r"""A sine whose frequency rises exponentially within a period, again and again: a periodic chirp.

    .. math:: y = a \sin\left(\frac{\omega_0 T}{\ln r} (r^{\tau / T} - 1)\right), \quad
        \tau = (t + s) \bmod T, \quad r = \omega_1 / \omega_0

    Frequencies are moved a little, for whole cycles in a period: it has no jump, only a bend.

    Parameters
    ----------
    port : Port
        Port that receives it.
    lowest, highest : float
        ω_0 and ω_1 [rad/s].
    period : float
        T [s].
    """

    shift = Parameter(shape="extent", unit="s", meaning="s")

    def __init__(
        self, port: Port, lowest: float, highest: float, period: float
    ) -> None:
        self.ratio = np.log(highest / lowest)
        self.period = period
        cycles = np.round(
            lowest * period * (highest / lowest - 1.0) / self.ratio / (2 * np.pi)
        )
        self.rise = 2 * np.pi * max(cycles, 1.0) / (highest / lowest - 1.0)
        super().__init__(port, shift=np.zeros(port.shape or ()))

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the sine."""
        turns = (t + p.shift) / self.period
        return {
            "y": p.amplitude
            * np.sin(self.rise * np.expm1(self.ratio * (turns - np.floor(turns))))
        }


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
                f"nothing reads '{port.full_path}', so nothing can be put in there"
            )
        system = injected(system, port, source)
    return system
