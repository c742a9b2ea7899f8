"""Design parameters of the mean-axes controller: bandwidths, noise densities, Kalman gain."""

from __future__ import annotations

from dataclasses import Field, dataclass, fields
from typing import Any

import numpy as np
import scipy

from trussflow.blocks.control.covariances import sampled_covariance, steady_covariance
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import is_whole, shown
from trussflow.models.errors import ModelError
from trussflow.models.layered_file import LayeredFile
from trussflow.models.mean_axes.free_modes import FreeModes
from trussflow.models.parameter_files import ParameterTable
from trussflow.models.validation import check_number, frozen_array

_OWNER = "mean-axes design"
_MAY_BE_ZERO = (
    "estimated_modes",
    "damped_modes",
    "neutral_modes",
    "modal_damping",
    "probe",
)

_TABLES = ("mean_axes", "estimator", "monitor")
"""Tables of a parameter file with design values."""


def _shape(one: Field[Any]) -> tuple[int, ...]:
    """Return the shape of a field: one number, or those of position, attitude and joints."""
    return (3,) if one.type == "Vector" else ()


@dataclass(frozen=True, slots=True, kw_only=True)
class MeanAxesDesign:
    """Design parameters of the mean-axes controller, in the groups position, attitude and joints.

    The process noise sets the bandwidth of the estimator. It is small, so that the loop gain is low at the
    frequencies of modes that are not in the estimator.

    Attributes
    ----------
    sample_time : float
        Sample time of measurements and commands [s]. A command acts one sample time after its measurements.
    bandwidth : Vector, shape (3,)
        Natural frequencies of the position, attitude and joint loops [rad/s].
    damping : float
        Damping ratio of these loops [-].
    estimated_modes, damped_modes, neutral_modes : int
        Numbers of free modes in the estimator, of modes with added damping, and of modes without other work
        by the feedback [-]. damped_modes must not exceed either of the others.
    modal_damping : float
        Damping ratio added to each damped mode [-].
    acceleration_noise : Vector, shape (3,)
        Process noise density of the acceleration model [m/s²/√Hz, rad/s²/√Hz].
    modal_noise : float
        Process noise density of each free mode [kg^½·m/s²/√Hz].
    disturbance_noise : Vector, shape (3,)
        Process noise density of the rate of disturbance accelerations [m/s³/√Hz, rad/s³/√Hz].
    sudden_noise_factor : float
        Factor of disturbance_noise in the estimator gain after a sudden disturbance [-].
    sudden_threshold : float
        Innovation of the rates of the truss frame above which a disturbance is sudden, in multiples of
        rate_noise [-].
    position_noise, rate_noise : float
        Standard deviations of measured positions and of measured rates [m and rad, m/s and rad/s].
    innovation_gate : float
        Largest innovation of the pose and its rates, in standard deviations of their noise [-].
    effort, neutrality : float
        Cost of an actuator at its limit, and of work on the neutral modes, relative to the energy of the
        motion that is missed [kg^½·m/s² squared, -].
    thrust_reluctance, joint_reluctance : float
        Square roots of the weight ratios, feedback to slow part, of thrusts and of joint torques [-]. Thrust
        has coarse steps. Large joint torques that cancel each other would make the loop sensitive to a
        single drive.
    slow_share : float
        Share of the actuator limits for feedforward and disturbance compensation (slow part) [-].
    resting_thrust : float
        Thrust limit of the feedback at rest [N]. Below one thrust step, only the slow part commands a second
        step. The shipped value is for `Hardware.flight`.
    resting_error : float
        Error, the norm of position and attitude, above which the thrust limit at rest is off [m and rad].
    propellant_spread : float
        Propellant use above the mean of all bases that doubles the cost of a base's thrust [kg].
    unloading_time : float
        Time constant of the unloading of the wheels [s].
    unknown_thrust, unknown_torque : float
        Standard deviations, for the fault detection, of unmodelled force steps on each axis of a base, which
        excite the modes, and of unmodelled joint torques, both per sample [N, N·m].
    structural_damping : float
        Damping ratio of the modes, for the fault detection [-].
    threshold : float
        Lost share of a base above which it has failed, in standard deviations [-].
    probe : float
        Effect of `ActuatorExcitation` on the joints per sample, in standard deviations; 0 for no excitation [-].
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
    sudden_noise_factor: float
    sudden_threshold: float
    position_noise: float
    rate_noise: float
    innovation_gate: float
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
    structural_damping: float
    threshold: float
    probe: float

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if one.type == "int" and not is_whole(value):
                raise ModelError(
                    f"{_OWNER}: {one.name} is {shown(value)}; it must be a whole number"
                )
            numbers = frozen_array(f"{_OWNER}: {one.name}", value, _shape(one))
            check_number(
                _OWNER, zero=one.name in _MAY_BE_ZERO, **{one.name: np.min(numbers)}
            )
        if self.slow_share > 1.0:
            raise ModelError(
                f"{_OWNER}: slow_share is {self.slow_share}; it must be at most 1"
            )
        least = min(self.estimated_modes, self.neutral_modes)
        if self.damped_modes > least:
            raise ModelError(
                f"{_OWNER}: {self.damped_modes} modes cannot be damped with "
                f"{self.estimated_modes} estimated and {self.neutral_modes} neutral ones; at most {least}"
            )

    @classmethod
    def shipped(cls) -> MeanAxesDesign:
        """Return the shipped design of ``parameters/mean_axes.toml``."""
        return cls.of(ParameterTable.shipped("mean_axes.toml"))

    @classmethod
    def of(cls, file: ParameterTable | LayeredFile) -> MeanAxesDesign:
        """Return the design of a parameter file.

        Parameters
        ----------
        file : ParameterTable or LayeredFile
            File with the tables of ``parameters/mean_axes.toml``, whose shipped file states the required units.

        Raises
        ------
        ModelError
            If a value is missing or out of range.
        """
        values: dict[str, Any] = {}
        kinds = {one.name: one for one in fields(cls)}
        shipped = ParameterTable.shipped("mean_axes.toml")
        for table in _TABLES:
            for name, entry in shipped.mapping(table).items():
                shape = _shape(kinds[name])
                value = file.table(table).array(name, entry["unit"], shape)
                values[name] = value if value.shape else float(value)
                if kinds[name].type == "int":
                    values[name] = int(value)
        return cls(**values)

    def of_groups(self, values: Vector, rigid: int) -> Vector:
        """Return one value per rigid coordinate from one per group.

        Parameters
        ----------
        values : Vector, shape (3,)
            Values of position, attitude and joints [any].
        rigid : int
            Number of rigid coordinates [-].
        """
        return np.repeat(values, (3, 3, rigid - 6))

    def estimator_gain(self, modes: FreeModes, noise_factor: float = 1.0) -> Vector:
        r"""Return the steady-state Kalman gain of the system at rest.

        The states are :math:`(y, \dot y, \eta, \dot\eta, w)` with :math:`G \ddot y = u + w`, the measurements
        :math:`y - S\eta` and its rate. The filter is designed for the acceleration :math:`G^{-1} w`.

        Parameters
        ----------
        modes : FreeModes
            Free modes, at least the estimated ones.
        noise_factor : float
            Factor of the process noise of disturbances [-].

        Returns
        -------
        Vector, shape (3 m + 2 h, 2 m)
            Gain from innovations to corrections of the predicted states.
        """
        m, h = len(modes.inertia), self.estimated_modes
        omega, motion = modes.frequencies[:h], modes.root_motion[:, :h]
        y, rate, eta, eta_rate, extra = np.split(
            np.arange(3 * m + 2 * h), np.cumsum([m, m, h, h])
        )
        A = np.zeros((3 * m + 2 * h,) * 2)
        # Small motions at rest: y'' = w (an acceleration here) and eta'' = -omega^2
        # eta.
        A[y, rate] = A[rate, extra] = 1.0
        A[eta, eta_rate] = 1.0
        A[eta_rate, eta] = -(omega**2)
        density = np.zeros(len(A))
        density[rate] = self.of_groups(self.acceleration_noise, m) ** 2
        density[eta_rate] = self.modal_noise**2
        density[extra] = self.of_groups(noise_factor * self.disturbance_noise, m) ** 2
        C = np.zeros((2 * m, len(A)))
        C[:m, y] = C[m:, rate] = np.eye(m)
        # Measured is the truss frame, which moves relative to the mean axes with the
        # modes.
        C[:m, eta] = C[m:, eta_rate] = -motion
        R = np.diag(np.repeat([self.position_noise, self.rate_noise], m) ** 2)
        sizes = {"y": m, "dy/dt": m, "eta": h, "deta/dt": h, "w": m}
        names = [f"{name}[{k}]" for name, size in sizes.items() for k in range(size)]
        Q = sampled_covariance(A, np.diag(density), self.sample_time)
        P = steady_covariance(scipy.linalg.expm(A * self.sample_time), C, Q, R, names)
        # P C^T (C P C^T + R)^-1; P and the sum are symmetric, so no inverse is needed.
        gain = np.linalg.solve(C @ P @ C.T + R, C @ P).T
        # The estimator has a generalized force as its disturbance, not an acceleration.
        gain[extra] = modes.inertia @ gain[extra]
        return np.asarray(gain)
