r"""The slowest mode of the truss in the closed loop, at the amplitudes that errors have.

The law's powers |x|^b with b < 1 have no derivative at zero, and their gain rises as errors
fall. So the loop is closed with describing functions in their place.

References
----------
Gelb, Vander Velde (1968), *Multiple-Input Describing Functions and Nonlinear System Design*.
"""

from __future__ import annotations

import inspect
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import xarray as xr
from study_tools.cache import Work

from reproduction.measures import late
from reproduction.runs import MissionRun
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.linear_analysis.linearize import linearize
from trussflow.models.transport.mission import Mission
from trussflow.models.transport.wiring import transport_diagram

if TYPE_CHECKING:
    from trussflow.blocks.linear_analysis.linear_model import LinearModel

SCALES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
"""Amplitudes, in units of those of the late errors."""

LEAST = 1e-14
"""Amplitude of channels that do not move [m, rad and their rates]."""

SLOW = (0.5, 4.0)
"""The slowest mode is near 2 rad/s, clamped or not; the next one near 4.5 [rad/s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SlowModeJob:
    """Pole of the slowest mode over the amplitude of the errors.

    Attributes
    ----------
    run : MissionRun
        The run whose late errors give the amplitudes.
    file : pathlib.Path
        Its result.
    """

    run: MissionRun
    file: Path

    @property
    def name(self) -> str:
        """Its name in the report."""
        return f"slow-mode-{self.run.name}"

    def work(self, folder: Path) -> Work:
        """Make the job ready.

        Parameters
        ----------
        folder : pathlib.Path
            Where computed modes are kept.
        """
        method = inspect.getsource(sys.modules[__name__])
        return Work((self.file.name, method), lambda: self.compute(folder))

    def compute(self, folder: Path) -> xr.Dataset:
        """Return the pole over the scale of the amplitudes.

        Parameters
        ----------
        folder : pathlib.Path
            Where computed modes are kept.
        """
        with xr.open_dataset(self.file, decode_cf=False) as raw:
            end = late(raw.load().astype(float))
        parts = ("position_error", "attitude_error", "joint_error")
        error, rate = (
            np.abs(np.hstack([end[f"{part}{end_of}"].values for part in parts])).max(axis=0)
            for end_of in ("", "_rate")
        )
        sliding = np.linalg.norm(end["sliding_variable"].values, axis=1).mean()
        sizes = Amplitudes(error, rate, float(sliding))
        mission, truss = self.run.mission(), self.run.space_truss(folder)
        diagram = transport_diagram(mission, truss, observer=self.run.observer)
        without_law = linearize(
            diagram,
            ["model.feedback"],
            ["truss.task_position", "truss.task_velocity"],
            cut=["model.feedback"],
        )
        poles = [slowest(closed(without_law, mission, sizes.scaled(k))) for k in SCALES]
        return xr.Dataset(
            {"pole_real": ("scale", np.real(poles)), "pole_imaginary": ("scale", np.imag(poles))},
            {"scale": list(SCALES)},
        )


class Amplitudes(NamedTuple):
    """How large the errors are.

    Attributes
    ----------
    error, rate : Vector
        Amplitude of each channel [m or rad, and per second].
    sliding : float
        Mean norm of the sliding variable [m/s and rad/s].
    """

    error: Vector
    rate: Vector
    sliding: float

    def scaled(self, scale: float) -> Amplitudes:
        """Return all of them times `scale` [-]."""
        error, rate = (np.maximum(a * scale, LEAST) for a in (self.error, self.rate))
        return Amplitudes(error, rate, self.sliding * scale)


def harmonic_gain(amplitude: Vector, exponent: float) -> Vector:
    r"""Return the describing function of :math:`|x|^b\,\mathrm{sgn}(x)` [unit^(b-1)].

    .. math:: N(a) = \frac{2}{\sqrt\pi}\frac{\Gamma(b/2 + 1)}{\Gamma(b/2 + 3/2)}\,a^{b-1}

    Parameters
    ----------
    amplitude : array
        a > 0 [unit of x].
    exponent : float
        b > 0 [-].
    """
    shape = math.gamma(exponent / 2 + 1) / math.gamma(exponent / 2 + 1.5)
    return np.asarray(2 / math.sqrt(math.pi) * shape * amplitude ** (exponent - 1))


def closed(model: LinearModel, mission: Mission, sizes: Amplitudes) -> Vector:
    r"""Return the state matrix of the loop, closed by the law at given amplitudes.

    With the gains :math:`\Gamma, \mathrm M` of the powers at these amplitudes and
    :math:`\kappa = \sigma + \eta / (\|s\| + \iota)`, the law (Eqs. 52-54, 62) is

    .. math:: \dot w = \Gamma\dot e + \mathrm M e,\qquad
              a = -\Gamma\dot e - \mathrm M e - \kappa(\dot e + w)

    Parameters
    ----------
    model : LinearModel
        From the acceleration asked for to task positions and velocities.
    mission : Mission
        The gains.
    sizes : Amplitudes
        Of errors and sliding variable.

    Returns
    -------
    array
        [1/s].
    """
    power = mission.exponent
    gamma = mission.rate_gain * harmonic_gain(sizes.rate, power)
    mu = mission.error_gain * harmonic_gain(sizes.error, power / (2 - power))
    kappa = mission.reaching_gain + mission.switching_gain / (sizes.sliding + mission.boundary_layer)
    position, velocity = np.split(model.C, 2)
    integrand = gamma[:, None] * velocity + mu[:, None] * position
    channels = len(gamma)
    return np.block(
        [
            [model.A - model.B @ (integrand + kappa * velocity), -kappa * model.B],
            [integrand, np.zeros((channels, channels))],
        ]
    )


def slowest(A: Vector) -> complex:
    """Return the least damped pole among those of the slowest mode.

    Parameters
    ----------
    A : array, shape (n, n)
        Of dx/dt = A x [1/s].
    """
    poles = np.linalg.eigvals(A)
    near = poles[(poles.imag > SLOW[0]) & (poles.imag < SLOW[1])]
    return complex(near[near.real.argmax()])
