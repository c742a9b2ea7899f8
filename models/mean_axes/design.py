"""How fast the loop of the mean axes is: bandwidths, noise, and the gain of its estimator."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import scipy

from trussflow.blocks.control.covariances import sampled_covariance, steady_covariance
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.framework.validation import is_whole, shown
from trussflow.models.errors import ModelError
from trussflow.models.layered_file import LayeredFile
from trussflow.models.mean_axes.free_modes import FreeModes
from trussflow.models.parameter_files import ParameterTable


@dataclass(frozen=True, slots=True, kw_only=True)
class MeanAxesDesign:
    """What the loop of the mean axes is made from, in the groups position, attitude and joints.

    Process noise says how far the model is trusted, and so how fast the estimator is. It is small, so
    that the loops have rolled off where the modes are that the estimator does not know.

    Attributes
    ----------
    sample_time : float
        Between measurements, and between commands; a command acts one sample time after the
        measurements that it is computed from [s].
    bandwidth : Vector, shape (3,)
        Natural frequencies of the three groups [rad/s].
    damping : float
        Of all of them, fraction of critical damping [-].
    estimated_modes, damped_modes, neutral_modes : int
        Free modes in the estimator, those to which damping is added, and those on which the feedback
        does no work besides [-]; damped_modes are at most as many as each of the others.
    modal_damping : float
        What is added to the damping of each damped mode, fraction of critical [-].
    acceleration_noise : Vector, shape (3,)
        Of the model, density [m/s²/√Hz, rad/s²/√Hz].
    modal_noise : float
        The same for each free mode [kg^½·m/s²/√Hz].
    disturbance_noise : Vector, shape (3,)
        Of the rate at which disturbing accelerations change, density [m/s³/√Hz, rad/s³/√Hz].
    position_noise, rate_noise : float
        Standard deviations of measured pose and joints, and of their rates [m and rad, m/s and rad/s].
    effort, neutrality : float
        Cost of an actuator at its limit, and of work on the neutral modes, beside the energy of the
        motion that is missing [kg^½·m/s² squared, -].
    thrust_reluctance, joint_reluctance : float
        How much dearer thrust, and joint torques, are for the feedback than for what changes slowly, by its
        root: thrust, as its steps are coarse; joints, as torques that cancel each other to leave the modes
        alone would make the loop depend on each drive alone [-].
    slow_share : float
        Share of the actuators' limits for what changes slowly: feedforward and the compensation of
        disturbances [-].
    resting_thrust : float
        To where the feedback may take a thrust while the path rests: less than a step of thrust, so that a
        second one is called for only by what changes slowly. The shipped one suits `Hardware.flight` [N].
    resting_error : float
        Up to what error of the truss, the norm of position and attitude [m and rad]: far from the path
        thrust is what brings it back.
    propellant_spread : float
        By how much more propellant than the mean a base must have used, until its thrust costs twice [kg].
    unloading_time : float
        In which the wheels are unloaded [s].
    unknown_thrust, unknown_torque : float
        For the monitor of the actuators: standard deviations of what shakes the modes, along each axis of
        each base, and of joint torques that the model does not know, from sample to sample [N, N·m].
    unknown_share : float
        Likewise: standard deviation of what a base or the drives of an arm do, by what is believed [-].
    structural_damping : float
        Likewise: that by which the modes ring down, fraction of critical [-].
    calm : float
        Likewise: least variance of what is measured, by the expected one [-].
    drift, threshold, doubt : float
        How much less likely than by its model the loss of an actuator is taken to be, from 0.5; from what
        evidence on it is believed; and from what share of this on others are not ruled out; see
        `ActuatorMonitor` [-].
    settling : float
        For how long no other robot is suspected after a loss [s].
    probe : float
        By how many standard deviations what `ActuatorProbe` does to the joints stands out in each sample; 0
        for no probe [-].
    """

    sample_time: float
    bandwidth: Vector
    damping: float
    estimated_modes: int
    damped_modes: int
    neutral_modes: int
    modal_damping: float
    acceleration_noise: Vector
    modal_noise: float
    disturbance_noise: Vector
    position_noise: float
    rate_noise: float
    effort: float
    neutrality: float
    thrust_reluctance: float
    joint_reluctance: float
    slow_share: float
    resting_thrust: float
    resting_error: float
    propellant_spread: float
    unloading_time: float
    unknown_thrust: float
    unknown_torque: float
    unknown_share: float
    structural_damping: float
    calm: float
    drift: float
    threshold: float
    doubt: float
    settling: float
    probe: float

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if field.type == "int" and not is_whole(value):
                raise ModelError(
                    f"mean-axes design: {field.name} is {shown(value)}; it must be a whole number"
                )
            positive = field.name not in (
                "estimated_modes",
                "damped_modes",
                "neutral_modes",
                "modal_damping",
                "probe",
            )
            shape = (3,) if field.type == "Vector" else ()
            try:
                good = np.greater(value, 0.0) if positive else np.greater_equal(value, 0.0)
                good = np.shape(value) == shape and np.all(good & np.isfinite(value))
            except (TypeError, ValueError):  # no numbers, or lists of different lengths
                good = False
            if not good:
                raise ModelError(
                    f"mean-axes design: {field.name} is {shown(value)}; it must be finite and "
                    + ("above 0" if positive else "not negative")
                    + (": three numbers, of position, attitude and joints" if shape else ": one number")
                )
        if self.slow_share > 1.0:
            raise ModelError(f"mean-axes design: slow_share is {self.slow_share}; it must be at most 1")
        least = min(self.estimated_modes, self.neutral_modes)
        if self.damped_modes > least:
            raise ModelError(
                f"mean-axes design: {self.damped_modes} modes cannot be damped with "
                f"{self.estimated_modes} estimated and {self.neutral_modes} neutral ones; at most {least}"
            )

    @classmethod
    def shipped(cls) -> MeanAxesDesign:
        """Return the design that comes with the package, from ``parameters/mean_axes.toml``."""
        return cls.of(ParameterTable.shipped("mean_axes.toml"))

    @classmethod
    def of(cls, file: ParameterTable | LayeredFile) -> MeanAxesDesign:
        """Return the design that a file states.

        Parameters
        ----------
        file : ParameterTable or LayeredFile
            With the tables of ``parameters/mean_axes.toml``.

        Raises
        ------
        ModelError
            If a value is missing or makes no sense.
        """
        control, estimator, monitor = (file.table(name) for name in ("mean_axes", "estimator", "monitor"))
        counts = {
            name: int(table.scalar(name, "1"))
            for table, name in (
                (estimator, "estimated_modes"),
                (control, "damped_modes"),
                (control, "neutral_modes"),
            )
        }
        return cls(
            **counts,
            bandwidth=control.array("bandwidth", "rad/s", (3,)),
            acceleration_noise=estimator.array("acceleration_noise", "m/s^2/Hz^0.5", (3,)),
            disturbance_noise=estimator.array("disturbance_noise", "m/s^3/Hz^0.5", (3,)),
            **control.scalars(
                sample_time="s",
                damping="1",
                modal_damping="1",
                effort="kg*m^2/s^4",
                neutrality="1",
                thrust_reluctance="1",
                joint_reluctance="1",
                slow_share="1",
                resting_thrust="N",
                resting_error="m",
                propellant_spread="kg",
                unloading_time="s",
            ),
            **monitor.scalars(
                unknown_thrust="N",
                unknown_torque="N*m",
                unknown_share="1",
                structural_damping="1",
                calm="1",
                drift="1",
                threshold="1",
                doubt="1",
                settling="s",
                probe="1",
            ),
            **estimator.scalars(modal_noise="kg^0.5*m/s^2/Hz^0.5", position_noise="m", rate_noise="m/s"),
        )

    def of_groups(self, values: Vector, rigid: int) -> Vector:
        """Return one value per rigid coordinate from one per group.

        Parameters
        ----------
        values : Vector, shape (3,)
            Of position, attitude and joints [any].
        rigid : int
            Number of rigid coordinates [-].
        """
        return np.repeat(values, (3, 3, rigid - 6))

    def estimator_gain(self, modes: FreeModes) -> Vector:
        r"""Return the steady gain of the estimator, that of a Kalman filter of the system at rest.

        Its states are :math:`(y, \dot y, \eta, \dot\eta, w)` with :math:`G \ddot y = u + w`, and it measures
        :math:`y - S\eta` and its rate. It is designed for :math:`G^{-1} w`, an acceleration, in place of w.

        Parameters
        ----------
        modes : FreeModes
            At least the estimated ones.

        Returns
        -------
        Vector, shape (3 m + 2 h, 2 m)
            Correction of the predicted states per innovation.
        """
        m, h = len(modes.inertia), self.estimated_modes
        omega, motion = modes.frequencies[:h], modes.root_motion[:, :h]
        y, rate, eta, eta_rate, extra = np.split(np.arange(3 * m + 2 * h), np.cumsum([m, m, h, h]))
        A = np.zeros((3 * m + 2 * h,) * 2)
        A[y, rate] = A[rate, extra] = 1.0
        A[eta, eta_rate] = 1.0
        A[eta_rate, eta] = -(omega**2)
        density = np.zeros(len(A))
        density[rate] = self.of_groups(self.acceleration_noise, m) ** 2
        density[eta_rate] = self.modal_noise**2
        density[extra] = self.of_groups(self.disturbance_noise, m) ** 2
        C = np.zeros((2 * m, len(A)))
        C[:m, y] = C[m:, rate] = np.eye(m)
        C[:m, eta] = C[m:, eta_rate] = -motion
        R = np.diag(np.repeat([self.position_noise, self.rate_noise], m) ** 2)
        sizes = {"y": m, "dy/dt": m, "eta": h, "deta/dt": h, "w": m}
        names = [f"{name}[{k}]" for name, size in sizes.items() for k in range(size)]
        Q = sampled_covariance(A, np.diag(density), self.sample_time)
        P = steady_covariance(scipy.linalg.expm(A * self.sample_time), C, Q, R, names)
        gain = np.linalg.solve(C @ P @ C.T + R, C @ P).T
        gain[extra] = modes.inertia @ gain[extra]
        return np.asarray(gain)
