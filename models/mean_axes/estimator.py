"""Estimator of the mean axes, the lowest free modes, and slow disturbances."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import scipy
from numpy.typing import NDArray

from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals, State
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.library.piecewise import limited
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.tracing.linear_algebra import solve_positive_definite
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.dynamics.task_space import normalized, to_body, way_to
from trussflow.models.errors import ModelError
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.mean_axes.free_modes import FreeModes
from trussflow.models.plant.truss_block import (
    ACTUATOR_UNITS,
    FORCE_UNITS,
    MODAL_RATE_UNIT,
    MODAL_UNIT,
    POSITION_UNITS,
    RATE_UNITS,
    TrussBlock,
)

MAX_SPEED, MAX_DISTURBANCE = 10.0, 100.0
"""Bounds on each element of estimated speeds [m/s, rad/s] and disturbances [N, N·m]."""


class MeanAxesBlock(TrussBlock):
    """Base of the controller's blocks: nominal rigid dynamics, sizes and units.

    Parameters
    ----------
    dynamics : TrussDynamics
        Nominal dynamics of truss and robots.
    design : MeanAxesDesign
        Sample time, number of modes, and the parameters with the names of design values.
    **parameters
        Other parameter values of the derived block.

    Raises
    ------
    ModelError
        If the truss has no robots.
    """

    def __init__(
        self, dynamics: TrussDynamics, design: MeanAxesDesign, **parameters: object
    ) -> None:
        if not dynamics.arms:
            raise ModelError(
                "a truss without robots has no actuators to control it; add robots"
            )
        self.design = design
        designed = {
            one.name: getattr(design, one.name)
            for one in fields(design)
            if isinstance(getattr(type(self), one.name, None), Parameter)
        }
        super().__init__(dynamics.without_modes(), **designed | parameters)
        self.sampled(design.sample_time)

    def set_dynamics(self, dynamics: TrussDynamics) -> None:
        """Set also the number of estimated modes.

        Parameters
        ----------
        dynamics : TrussDynamics
            Nominal dynamics, rigid.
        """
        super().set_dynamics(dynamics)
        self.modes = self.design.estimated_modes


def thrusts_of(dynamics: TrussDynamics) -> NDArray[np.bool_]:
    """Return whether each actuator is a thrust; each base has three forces and three torques."""
    each = np.arange(dynamics.actuators)
    return (each < 6 * len(dynamics.arms)) & (each % 6 < 3)


class MeanAxesEstimator(MeanAxesBlock):
    r"""Estimator of the mean axes from the pose of the truss frame and the joints, one sample ahead.

    The model has the equations of the rigid system in its mean axes, and its free modes at rest:

    .. math:: \dot y = N(y)\,\nu, \quad G(\theta)\,\dot\nu = P_r(\theta)\,Q + w - c(\theta, \nu), \quad
              \ddot\eta + \Omega^2 \eta = B Q, \quad \dot w = 0

    The joint angles :math:`\theta` in G, P and c are the measured ones, extrapolated with the measured rates.
    Thrust on the bases makes arms with gearless joints unstable (buckling, poles up to +21 1/s). An estimate with
    the bandwidth of this motion would destabilize the modes. With measured joints the estimator can be slow.

    At each sample the constant gain times the innovation, the difference of the measurements and
    :math:`y - S\eta` and its rate in body axes, corrects the estimate. The prediction to the next sample
    (to first order, exact for the modes) uses the actuation until then. The outputs are the prediction. So a
    command acts one sample after its last measurement, at the time for which it is computed.

    An innovation of the rates of the truss frame far above noise shows a sudden disturbance, such as a failed
    base or an open valve. In such samples the gain is that for a larger process noise of the disturbance
    (adjustable level of process noise).

    Speeds and disturbances are bounded, so that no finite measurement makes the estimate diverge.

    Parameters
    ----------
    dynamics : TrussDynamics
        Nominal dynamics of truss and robots.
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
    trussflow.models.mean_axes.free_modes : Definitions of S, Ω and B.

    References
    ----------
    Bar-Shalom, Li, Kirubarajan (2001), *Estimation with Applications to Tracking and Navigation*, section 11.2.
    """

    position = Input(
        "rigid_q",
        unit=POSITION_UNITS,
        meaning="measured x_1: pose of the truss frame, joints",
    )
    velocity = Input("rigid", unit=RATE_UNITS, meaning="measured x_2")
    actuation = Input(
        "actuators", unit=ACTUATOR_UNITS, meaning="Q until the next sample"
    )
    mean_position = Output("rigid_q", unit=POSITION_UNITS, meaning="y")
    mean_speeds = Output("rigid", unit=RATE_UNITS, meaning="nu")
    modal_coordinate = Output("modes", unit=MODAL_UNIT, meaning="eta")
    modal_rate = Output("modes", unit=MODAL_RATE_UNIT, meaning="d eta/dt")
    disturbance = Output("rigid", unit=FORCE_UNITS, meaning="w, a generalized force")
    joint_angles = Output(
        "joints",
        unit=Attribute("joint_units"),
        meaning="joints in the middle of the next sample time",
    )

    y = State("rigid_q", initial="initial_position", meaning="mean axes")
    nu = State("rigid", meaning="speeds of the mean axes")
    eta = State("modes", meaning="free modes")
    eta_rate = State("modes", meaning="rates of the free modes")
    w = State("rigid", meaning="disturbance")
    posture = State(
        "joints", initial="initial_posture", meaning="joints half a sample time ahead"
    )

    initial_position = Parameter(shape=("rigid_q",), meaning="y at the start")
    initial_posture = Parameter(shape=("joints",), meaning="joints at the start")
    gain = Parameter(
        shape=("estimated", "measured"), meaning="correction per innovation"
    )
    sudden_gain = Parameter(
        shape=("estimated", "measured"), meaning="gain after a sudden disturbance"
    )
    sudden_innovation = Parameter(
        above=0.0,
        unit="m/s",
        meaning="innovation of frame rates above which sudden_gain applies [m/s, rad/s]",
    )

    def __init__(
        self,
        dynamics: TrussDynamics,
        design: MeanAxesDesign,
        start: Vector | None = None,
    ) -> None:
        start = dynamics.rest[: dynamics.rigid_coordinates] if start is None else start
        free = FreeModes.of(dynamics, design.estimated_modes)
        self.root_motion = free.root_motion
        h, actuators = design.estimated_modes, dynamics.actuators
        # Inputs as constant states: one exponential is exact for commands held a
        # sample.
        oscillators = np.zeros((2 * h + actuators,) * 2)
        oscillators[:h, h : 2 * h] = np.eye(h)
        oscillators[h : 2 * h, :h] = -np.diag(free.frequencies**2)
        oscillators[h : 2 * h, 2 * h :] = free.influence
        flow = np.asarray(scipy.linalg.expm(oscillators * design.sample_time))
        self.modal_flow, self.modal_input = (
            flow[: 2 * h, : 2 * h],
            flow[: 2 * h, 2 * h :],
        )
        self.measured = 2 * dynamics.rigid_freedoms
        self.estimated = 3 * dynamics.rigid_freedoms + 2 * h
        super().__init__(
            dynamics,
            design,
            initial_position=start,
            initial_posture=start[dynamics.attitude.end :],
            gain=design.estimator_gain(free),
            sudden_gain=design.estimator_gain(free, design.sudden_noise_factor),
            sudden_innovation=design.sudden_threshold * design.rate_noise,
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
                to_body(kind, x.y, way_to(kind, x.y, u.position))
                + self.root_motion @ x.eta,
                u.velocity - x.nu + self.root_motion @ x.eta_rate,
            ]
        )
        sudden = np.max(np.abs(innovation[m : m + 6])) > p.sudden_innovation
        step = np.where(sudden, p.sudden_gain, p.gain) @ innovation
        # The correction is in truss axes, as speeds are; `kinematics` maps it to
        # coordinates.
        y = normalized(kind, x.y + self.dynamics.kinematics(x.y, step[:m]))
        fastest, most = np.full(m, MAX_SPEED), np.full(m, MAX_DISTURBANCE)
        nu = limited(x.nu + step[m : 2 * m], -fastest, fastest)
        w = limited(x.w + step[2 * m + 2 * h :], -most, most)
        modal = np.concatenate([x.eta, x.eta_rate]) + step[2 * m : 2 * m + 2 * h]
        modal = self.modal_flow @ modal + self.modal_input @ u.actuation
        # The joints are measured, since the estimate is too slow for arms that buckle under thrust.
        middle = np.concatenate([y[: kind.end], joints + time / 2 * u.velocity[6:]])
        terms = self.dynamics.evaluate(middle, nu)
        force = terms.actuation_matrix @ u.actuation + w - terms.bias
        acceleration = solve_positive_definite(terms.mass_matrix, force)
        return {
            "y": normalized(
                kind,
                # The speed in the middle of the sample makes the position second-order
                # accurate.
                y + time * self.dynamics.kinematics(y, nu + time / 2 * acceleration),
            ),
            "nu": limited(nu + time * acceleration, -fastest, fastest),
            "eta": modal[:h],
            "eta_rate": modal[h:],
            "w": w,
            # From the instant of the measurement to the middle of the next sample time.
            "posture": joints + 1.5 * time * u.velocity[6:],
        }
