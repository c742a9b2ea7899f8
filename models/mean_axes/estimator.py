"""Estimator of the mean axes, of the lowest free modes, and of slow disturbances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals, State
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.types import Array, Vector
from trussflow.blocks.tracing.linear_algebra import solve_positive_definite
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.dynamics.task_space import normalized, to_body, way_to
from trussflow.models.errors import ModelError
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.mean_axes.free_modes import FreeModes
from trussflow.models.plant.space_truss import MODAL_UNIT, SpaceTruss


class MeanAxesBlock(Block):
    """What the blocks of the loop share: the rigid dynamics they believe in, sizes and units.

    Parameters
    ----------
    dynamics : TrussDynamics
        What is believed.
    design : MeanAxesDesign
        Sample time, and number of modes.
    **parameters
        Values of the block's own.

    Raises
    ------
    ModelError
        If there are no robots.
    """

    def __init__(self, dynamics: TrussDynamics, design: MeanAxesDesign, **parameters: object) -> None:
        if not dynamics.arms:
            raise ModelError("a truss without robots has nothing to be controlled by; give it robots")
        self.dynamics, self.design = replace(dynamics, modes=dynamics.modes.rigid()), design
        self.rigid_q, self.rigid = dynamics.rigid_coordinates, dynamics.rigid_freedoms
        self.actuators = dynamics.actuators
        self.joints, self.modes = dynamics.joints, design.estimated_modes
        plant = SpaceTruss(self.dynamics)
        self.position_units, self.task_rate_units = plant.position_units, plant.task_rate_units
        self.acceleration_units, self.rigid_speed_units = plant.disturbance_units, plant.rigid_speed_units
        self.actuator_units = plant.actuator_units
        self.joint_units = plant.joint_units
        self.force_units = ("N",) * 3 + ("N*m",) * 3 + plant.effort_units
        super().__init__(**parameters)
        self.sampled(design.sample_time)


def thrusts_of(dynamics: TrussDynamics) -> NDArray[np.bool_]:
    """Return which actuators are thrusts: of each base three forces, then three torques; then all joints."""
    each = np.arange(dynamics.actuators)
    return (each < 6 * len(dynamics.arms)) & (each % 6 < 3)


class MeanAxesEstimator(MeanAxesBlock):
    r"""Observe the mean axes from the pose of the root and the joints, one sample ahead.

    Believed are the equations of the rigid system in its mean axes, and its free modes at rest:

    .. math:: \dot y = N(y)\,\nu, \quad G(\theta)\,\dot\nu = P_r(\theta)\,Q + w - c(\theta, \nu), \quad
              \ddot\eta + \Omega^2 \eta = B Q, \quad \dot w = 0

    The joints :math:`\theta` in G, P and c are those measured, moved on with the rates measured. For with
    thrust on the bases the arms buckle (poles to +21 1/s at 3.4 N), and an estimate that could follow
    them would be too fast for the modes. So the buckling is a known input, and the estimator may be slow.

    At each sample the estimate is corrected by the constant gain times what is measured beyond
    :math:`y - S\eta` and its rate, in axes of the body, and predicted to the next sample (to first order,
    and exactly for the modes) with the actuation that acts until then. The prediction is what the outputs
    show: a command computed from it acts one sample after the newest measurement it knows, which leaves
    the computer that long, and it is the state at that very time that it is computed for.

    Parameters
    ----------
    dynamics : TrussDynamics
        What is believed: robots, truss, and its free modes.
    design : MeanAxesDesign
        Sample time and noise.
    start : Vector, optional
        Rigid coordinates at the start [m, rad]; by default those at rest.

    Raises
    ------
    ModelError
        If the truss has fewer modes than the design estimates.

    See Also
    --------
    trussflow.models.mean_axes.free_modes : What S, Ω and B are.
    """

    position = Input(
        "rigid_q", unit=Attribute("position_units"), meaning="measured x_1: pose of the root, joints"
    )
    velocity = Input("rigid", unit=Attribute("rigid_speed_units"), meaning="measured x_2")
    actuation = Input(
        "actuators", unit=Attribute("actuator_units"), meaning="Q that acts until the next sample"
    )
    mean_position = Output("rigid_q", unit=Attribute("position_units"), meaning="y")
    mean_speeds = Output("rigid", unit=Attribute("rigid_speed_units"), meaning="nu")
    modal_coordinate = Output("modes", unit=MODAL_UNIT, meaning="eta")
    modal_rate = Output("modes", unit=f"{MODAL_UNIT}/s", meaning="d eta/dt")
    disturbance = Output("rigid", unit=Attribute("force_units"), meaning="w, a generalized force")
    joint_angles = Output(
        "joints", unit=Attribute("joint_units"), meaning="joints in the middle of the next sample time"
    )

    y = State("rigid_q", initial="initial_position", meaning="mean axes")
    nu = State("rigid", meaning="their speeds")
    eta = State("modes", meaning="free modes")
    eta_rate = State("modes", meaning="their rates")
    w = State("rigid", meaning="disturbance")
    posture = State("joints", initial="initial_posture", meaning="joints half a sample time ahead")

    initial_position = Parameter(shape=("rigid_q",), meaning="y at the start")
    initial_posture = Parameter(shape=("joints",), meaning="joints at the start")
    gain = Parameter(shape=("estimated", "measured"), meaning="correction per innovation")

    def __init__(self, dynamics: TrussDynamics, design: MeanAxesDesign, start: Vector | None = None) -> None:
        start = dynamics.rest[: dynamics.rigid_coordinates] if start is None else start
        free = FreeModes.of(dynamics, design.estimated_modes)
        self.root_motion = free.root_motion
        h, actuators = design.estimated_modes, dynamics.actuators
        oscillators = np.zeros((2 * h + actuators,) * 2)
        oscillators[:h, h : 2 * h] = np.eye(h)
        oscillators[h : 2 * h, :h] = -np.diag(free.frequencies**2)
        oscillators[h : 2 * h, 2 * h :] = free.influence
        flow = np.asarray(scipy.linalg.expm(oscillators * design.sample_time))
        self.modal_flow, self.modal_input = flow[: 2 * h, : 2 * h], flow[: 2 * h, 2 * h :]
        self.measured = 2 * dynamics.rigid_freedoms
        self.estimated = 3 * dynamics.rigid_freedoms + 2 * h
        super().__init__(
            dynamics,
            design,
            initial_position=start,
            initial_posture=start[dynamics.attitude.end :],
            gain=design.estimator_gain(free),
        )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the prediction for this sample."""
        return {
            "mean_position": x.y,
            "mean_speeds": x.nu,
            "modal_coordinate": x.eta,
            "modal_rate": x.eta_rate,
            "disturbance": x.w,
            "joint_angles": x.posture,
        }

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Correct by the measurements, and predict."""
        m, h, time = self.rigid, self.modes, self.design.sample_time
        kind, joints = self.dynamics.attitude, u.position[self.dynamics.attitude.end :]
        innovation = np.concatenate(
            [
                to_body(kind, x.y, way_to(kind, x.y, u.position)) + self.root_motion @ x.eta,
                u.velocity - x.nu + self.root_motion @ x.eta_rate,
            ]
        )
        step = p.gain @ innovation
        y = normalized(kind, x.y + self.dynamics.kinematics(x.y, step[:m]))
        nu, w = x.nu + step[m : 2 * m], x.w + step[2 * m + 2 * h :]
        modal = np.concatenate([x.eta, x.eta_rate]) + step[2 * m : 2 * m + 2 * h]
        modal = self.modal_flow @ modal + self.modal_input @ u.actuation
        # The posture is measured: the estimate is too slow for arms that buckle under thrust.
        middle = np.concatenate([y[: kind.end], joints + time / 2 * u.velocity[6:]])
        terms = self.dynamics.evaluate(middle, nu)
        force = terms.actuation_matrix @ u.actuation + w - terms.bias
        acceleration = solve_positive_definite(terms.mass_matrix, force)
        return {
            "y": normalized(kind, y + time * self.dynamics.kinematics(y, nu + time / 2 * acceleration)),
            "nu": nu + time * acceleration,
            "eta": modal[:h],
            "eta_rate": modal[h:],
            "w": w,
            "posture": joints + 1.5 * time * u.velocity[6:],
        }
