r"""The control laws as linear models, by describing functions at a chosen amplitude.

:math:`|x|^{0.9}\,\mathrm{sgn}(x)` has no derivative at zero, and its gain grows without bound as
the error shrinks. For errors :math:`e = a \sin \omega t` each nonlinear term is replaced by the
gain of its first harmonic, with the amplitude that its variable has: a for the error,
:math:`a \omega` for its rate, and what follows from both for the integral of the sliding
variable. That is the quasi-linear loop which margins and eigenvalues are computed from; near
frequency :math:`\omega` and amplitude a it is right. `trussflow.blocks.frequency_response`
balances all harmonics' amplitudes at each frequency instead.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import control
import numpy as np

from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.validation import positive
from trussflow.blocks.linear_analysis.linearize import Linearizer
from trussflow.blocks.linear_analysis.references import Reference
from trussflow.models.transport.mission import Mission
from trussflow.models.transport.wiring import control_law


@dataclass(frozen=True, slots=True, kw_only=True)
class Amplitude:
    """How the errors oscillate for which laws are made linear.

    Attributes
    ----------
    error : float
        Amplitude a of each error [m, rad].
    omega : float
        Frequency of the oscillation [rad/s]; it makes the amplitude of the rates.

    Raises
    ------
    SimulationError
        If one is not positive.
    """

    error: float
    omega: float = 1.0

    def __post_init__(self) -> None:
        positive(error=self.error, omega=self.omega)


def linear_mission(mission: Mission) -> Mission:
    """Return a mission whose sliding-mode laws are linear: exponents one, no switching.

    Parameters
    ----------
    mission : Mission
        The other gains.
    """
    return replace(mission, exponent=1.0, switching_gain=0.0, conventional_switching_gain=0.0)


def linear_law(
    mission: Mission, controller: str, size: int, amplitude: Amplitude | None
) -> control.StateSpace:
    """Return a control law as a linear model from position and velocity to its command.

    Parameters
    ----------
    mission : Mission
        The gains.
    controller : str
        ``"ismc"``, ``"smc"`` or ``"pd"``; the first two command an acceleration, PD a force.
    size : int
        Number of task coordinates [-].
    amplitude : Amplitude, optional
        Of the errors; by default the law is linear: exponents one, no switching.
    """
    if amplitude is None:
        mission = linear_mission(mission)
    diagram = Diagram("law")
    # One element oscillates at a time, the others rest: the law of one element, `size` times.
    law = diagram.add(law=control_law(mission, controller, shape=1))
    diagram.expose(position=law.position, velocity=law.velocity)
    for port in law.inputs():
        if port.name not in ("position", "velocity"):
            diagram.ground(port)
    command = "law.force" if controller == "pd" else "law.feedback"
    linearizer = Linearizer(diagram, ["position", "velocity"], [command])
    if amplitude is None:
        return _repeated(linearizer.at(), size)
    sizes: dict[Reference, float] = {
        "position": amplitude.error,
        "velocity": amplitude.error * amplitude.omega,
    }
    model = linearizer.at(amplitude=sizes)
    if model.nstates:
        by_position, by_velocity = model.B[0]  # of the rate of the integral
        rate = by_position / (1j * amplitude.omega) + by_velocity
        sizes["law.integral"] = float(abs(rate)) * amplitude.error
        model = linearizer.at(amplitude=sizes)
    return _repeated(model, size)


def _repeated(model: control.StateSpace, size: int) -> control.StateSpace:
    """Return the model of many equal elements, its inputs still one vector after the other."""
    many = np.eye(size)
    matrices = (np.kron(M, many) for M in (model.A, model.B, model.C, model.D))
    return control.StateSpace(*matrices, remove_useless_states=False)
