r"""Slowest mode of the truss in the closed loop, at the amplitudes of the late errors.

The powers |x|^b of the law with b < 1 have no derivative at zero, and their gain rises as the errors
fall. Describing functions replace them in the linear loop.

References
----------
Gelb, Vander Velde (1968), *Multiple-Input Describing Functions and Nonlinear System Design*.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from study_tools.stability import harmonic_gain, rightmost

from reproduction.figures import Results
from reproduction.measures import envelope
from reproduction.runs import mission
from trussflow.blocks.linear_analysis.linear_model import LinearModel
from trussflow.blocks.linear_analysis.linearize import linearize
from trussflow.blocks.support.types import Vector
from trussflow.models.reporting.figures import Curve, Panel, drawing, save
from trussflow.models.transport.mission import CASES, Mission

SCALES = np.array([0.03, 0.1, 0.3, 1.0, 3.0, 10.0])
"""Amplitudes relative to those of the late errors [-]."""

MIN_AMPLITUDE = 1e-14
"""Amplitude of coordinates at rest [m, rad and their rates]."""

SLOW_BAND = (0.5, 4.0)
"""Band of the slowest mode [rad/s]: it is near 2 rad/s, clamped or not, the next one near 4.5 rad/s."""


def predicted_poles(run: str, late: Mapping[str, Any], folder: Path) -> Vector:
    """Return the pole of the slowest mode at each of `SCALES` [1/s].

    Parameters
    ----------
    run : str
        Name of the run.
    late : mapping
        Its measures ``late error`` and ``late rate``, shape (34,) [m or rad, per second], and the mean norm
        ``late sliding`` [m/s and rad/s].
    folder : pathlib.Path
        Folder of the computed modes.
    """
    file = mission(run, folder)
    without_law = linearize(
        file.diagram(),
        ["model.feedback"],
        ["truss.task_position", "truss.task_velocity"],
        cut=["model.feedback"],
    )
    error, rate, sliding = (
        late[f"late {name}"] for name in ("error", "rate", "sliding")
    )
    matrices = [
        closed(without_law, file.mission, k * error, k * rate, float(k * sliding))
        for k in SCALES
    ]
    return np.array([rightmost(A, *SLOW_BAND)[0] for A in matrices])


def closed(
    model: LinearModel, gains: Mission, error: Vector, rate: Vector, sliding: float
) -> Vector:
    r"""Return the state matrix of the loop that the law closes at given amplitudes [1/s].

    With the gains :math:`\Gamma, \mathrm M` of the powers at these amplitudes and
    :math:`\kappa = \sigma + \eta / (\|s\| + \iota)`, the law (Eqs. 52-54, 62) is

    .. math:: \dot w = \Gamma\dot e + \mathrm M e,\qquad
              a = -\Gamma\dot e - \mathrm M e - \kappa(\dot e + w)

    Parameters
    ----------
    model : LinearModel
        Model from the feedback acceleration to task positions and velocities.
    gains : Mission
        Gains of the law.
    error, rate : array, shape (n,)
        Amplitudes of each task coordinate [m or rad, per second].
    sliding : float
        Mean norm of the sliding variable [m/s and rad/s].
    """
    power = gains.exponent
    gamma = gains.rate_gain * harmonic_gain(np.maximum(rate, MIN_AMPLITUDE), power)
    mu = gains.error_gain * harmonic_gain(
        np.maximum(error, MIN_AMPLITUDE), power / (2 - power)
    )
    kappa = gains.reaching_gain + gains.switching_gain / (
        sliding + gains.boundary_layer
    )
    position, velocity = np.split(model.C, 2)
    integrand = gamma[:, None] * velocity + mu[:, None] * position
    channels = len(gamma)
    return np.block(
        [
            [model.A - model.B @ (integrand + kappa * velocity), -kappa * model.B],
            [integrand, np.zeros((channels, channels))],
        ]
    )


def limit_cycle(growth: Vector) -> float:
    """Return the scale at which a growth rate over `SCALES` crosses zero downwards, NaN if it does not [-].

    Parameters
    ----------
    growth : array, shape (n,)
        Growth rate at each scale [1/s].
    """
    crossing = np.flatnonzero((growth[:-1] > 0) & (growth[1:] <= 0))
    if not len(crossing):
        return np.nan
    i = int(crossing[0])
    part = growth[i] / (growth[i] - growth[i + 1])
    return float(np.exp(np.interp(part, [0, 1], np.log(SCALES[i : i + 2]))))


def draw_late_errors(results: Results, poles: Mapping[str, Vector], file: Path) -> None:
    """Draw the growth rates of the slowest mode, and its amplitude in the long runs.

    Parameters
    ----------
    results : callable
        Function that returns the result of a run.
    poles : mapping
        Poles by `predicted_poles`, keyed by the run [1/s].
    file : pathlib.Path
        Figure to write.
    """
    panels = []
    for case in CASES:
        runs = {"observer": f"case{case}", "no observer": f"case{case}-no-observer"}
        panels.append(
            Panel(
                curves=[
                    Curve(label, SCALES, poles[run].real) for label, run in runs.items()
                ],
                x="amplitude per late amplitude",
                y="growth of mode 1 [1/s]",
                title=f"Case {case}",
                levels=(0.0,),
                log_x=True,
            )
        )
        long = results(f"case{case}-long")
        time, mode = envelope(long["time"].values, long.modal_coordinate.values[:, 0])
        after = time > Mission.of_case(case).duration
        panels.append(
            Panel(
                curves=[Curve("", time[after], mode[after])],
                y="amplitude of mode 1 [kg$^{1/2}$·m]",
                log=True,
                title=f"Case {case}, with observer",
            )
        )
    save(drawing(panels), file, small=True)
