"""Hardware between controller and truss, as two diagrams: actuators and sensors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Self, TypeVar

import numpy as np

from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.signal_operators import Wired
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.library.algebra import Function, Gain
from trussflow.blocks.library.discrete import UnitDelay, ZeroOrderHold, sampled_delay
from trussflow.blocks.support.types import Array, Vector
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.dynamics.task_space import normalized, task_velocity
from trussflow.models.errors import ModelError
from trussflow.models.hardware.joint_servo import ServoDesign
from trussflow.models.hardware.measurement import Measurement, derived_seed
from trussflow.models.hardware.motors import BrakeLatch, JointDrives, ReactionWheels
from trussflow.models.hardware.thrusters import ThrusterSet
from trussflow.models.layered_file import LayeredFile
from trussflow.models.parameter_files import ParameterTable
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.validation import check_choice, check_number

SENSOR_UNITS = {
    "metrology": "m",
    "star_tracker": "rad",
    "encoder": "rad",
    "velocimeter": "m/s",
    "gyro": "rad/s",
    "tachometer": "rad/s",
}
"""Units of the sensors of position and attitude of the truss frame, of joints, and of their rates."""

JOINT_CONTROLS = ("servo", "torque")
"""Control of the joints: by the local servo of geared drives, or by torque commands to gearless ones."""

GYROSCOPIC_CHOICES = ("off", "on", "cancelled")


Plant = TypeVar("Plant", bound=SpaceTruss)


def _made(make: Any, robot: int) -> Any:
    """Return the hardware of a robot, from its factory or the common one."""
    return make[robot]() if isinstance(make, tuple) else make()


def _bus(size: int, unit: Unit) -> Gain:
    """Return a block that joins slices of a signal, or divides it, unchanged."""
    return Gain(np.ones(size), input_unit=unit, output_unit=unit)


@dataclass(frozen=True, slots=True, kw_only=True)
class Hardware:
    """Hardware of the robots, as factories of blocks and as measurement errors.

    Attributes
    ----------
    sample_time, delay : float
        Hold and delay of the commands by the computer [s].
    thrusters : callable, or tuple of callable
        Factory of the `ThrusterSet` of a base; one for all, or one each.
    wheels : callable, or tuple of callable, optional
        Factory of the `ReactionWheels` of a base; one for all, or one each. Without wheels the thrusters make
        the torques of the base; with wheels they only compensate the unloading.
    drives : functools.partial
        Factory of the `JointDrives` of the joints of all robots, its argument.
    metrology, star_tracker, velocimeter, gyro : Measurement
        Measurements of position [m], attitude [rad], velocity [m/s] and rate [rad/s] of the truss frame.
    encoder, tachometer : Measurement
        Measurements of joint angles [rad] and rates [rad/s].
    servo : ServoDesign, optional
        Local servo of the joints, with power-off brakes. The torque commands are then its feedforward. By
        default the drives follow the torque commands.
    gyroscopic : str
        Gyroscopic torque ω × A h of the wheels on their base: ``"off"``; ``"on"``; or ``"cancelled"`` by
        feedforward of the wheel torques once a sample. Unless off, the actuators have the input `rates`.
    """

    sample_time: float
    delay: float
    thrusters: Callable[[], ThrusterSet] | tuple[Callable[[], ThrusterSet], ...]
    wheels: (
        Callable[[], ReactionWheels] | tuple[Callable[[], ReactionWheels], ...] | None
    )
    drives: partial[JointDrives]
    metrology: Measurement
    star_tracker: Measurement
    velocimeter: Measurement
    gyro: Measurement
    encoder: Measurement
    tachometer: Measurement
    servo: ServoDesign | None = None
    gyroscopic: str = "off"

    def __post_init__(self) -> None:
        check_choice("gyroscopic torque", self.gyroscopic, GYROSCOPIC_CHOICES)

    @classmethod
    def flight(cls, *, torque: float | None = None, control: str | None = None) -> Self:
        """Return the reference hardware of ``parameters/hardware.toml``.

        Commands are held for 20 ms and delayed by 20 ms. Each axis of a base has a thrust of 5 N in steps of
        0.1 N, sigma-delta modulated, and a torque of 0.3 N·m. Joints have geared drives with a local servo and
        power-off brakes. The noise is 1e-4 m, rad, m/s and rad/s.

        Parameters
        ----------
        torque : float, optional
            Maximum torque of wheels and gearless joints instead of 0.3 N·m; the momentum of the wheels scales
            with it [N·m].
        control : str, optional
            ``"servo"``, the default, or ``"torque"``: gearless joints without friction that follow their
            torque commands.
        """
        file = ParameterTable.shipped("hardware.toml")
        return cls.of(file, torque=torque, control=control)

    @classmethod
    def of(
        cls,
        file: ParameterTable | LayeredFile,
        *,
        torque: float | None = None,
        control: str | None = None,
    ) -> Self:
        """Return the hardware of a file: throttled thrusters, wheels, joint drives, sensors.

        Parameters
        ----------
        file : ParameterTable or LayeredFile
            File with the tables of ``parameters/hardware.toml``.
        torque : float, optional
            As for `flight` [N·m].
        control : str, optional
            ``"servo"`` or ``"torque"``, see `flight`; by default that of the file.

        Raises
        ------
        ModelError
            If a value is missing or out of range.
        """

        def numbers(table: str, **units: str) -> dict[str, Any]:
            return file.table(table).scalars(**units)

        thrusters = numbers(
            "thrusters", maximum="N", quantum="N", period="s", specific_impulse="s"
        )
        wheels = numbers("wheels", sample_time="s", torque="N*m", momentum="N*m*s")
        joints = numbers("joints", torque="N*m")
        geared = numbers(
            "drives",
            torque="N*m",
            viscous="N*m*s/rad",
            coulomb="N*m",
            brake_stiffness="N*m/rad",
            brake_damping="N*m*s/rad",
        )
        rotor = numbers("drives", gear="1", rotor_inertia="kg*m^2")
        geared["reflected_inertia"] = rotor["gear"] ** 2 * rotor["rotor_inertia"]
        loop = numbers(
            "servo",
            sample_time="s",
            proportional_gain="N*m/rad",
            derivative_gain="N*m*s/rad",
        )
        seen = numbers("servo", encoder_quantum="rad", tachometer_noise="rad/s")
        step = loop["sample_time"]
        servo = ServoDesign(
            **loop,
            encoder=Measurement(sample_time=step, quantum=seen["encoder_quantum"]),
            tachometer=Measurement(sample_time=step, noise=seen["tachometer_noise"]),
        )
        control = control or file.table("joints").choice("control", JOINT_CONTROLS)
        check_choice("control of the joints", control, JOINT_CONTROLS)
        local = control == "servo"
        if torque is not None:
            check_number("hardware", torque=torque)
            # The time until saturation at full torque does not change.
            wheels["momentum"] *= torque / wheels["torque"]
            wheels["torque"] = joints["torque"] = torque
        sensors: dict[str, Any] = {
            name: Measurement(**numbers(name, sample_time="s", noise=unit))
            for name, unit in SENSOR_UNITS.items()
        }
        return cls(
            gyroscopic=file.table("wheels").choice("gyroscopic", GYROSCOPIC_CHOICES),
            **numbers("computer", sample_time="s", delay="s"),
            thrusters=partial(ThrusterSet.axial, **thrusters),
            wheels=partial(ReactionWheels, np.eye(3), **wheels),
            drives=partial(JointDrives, **(geared if local else joints)),
            servo=servo if local else None,
            **sensors,
        )

    @classmethod
    def exact(
        cls,
        sample_time: float,
        delay: float = 0.0,
        *,
        noise: float = 0.0,
        quantum: float = 1e-9,
        thrust: float = 100.0,
        torque: float = 100.0,
    ) -> Self:
        """Return nearly ideal hardware, with hold and delay only by default.

        Parameters
        ----------
        sample_time, delay : float
            Hold and delay of the commands by the computer [s].
        noise : float
            Standard deviation of all sensors [m, rad, m/s, rad/s].
        quantum, thrust : float
            Step and limit of the thrusts, by default negligible and large [N].
        torque : float
            Limit of wheels and joints, by default large [N·m].
        """
        thrusters = {
            "maximum": thrust,
            "quantum": quantum,
            "period": sample_time,
            "specific_impulse": 70.0,
        }
        wheels = {"sample_time": sample_time, "torque": torque, "momentum": 1e6}
        sensors: dict[str, Any] = dict.fromkeys(
            SENSOR_UNITS, Measurement(sample_time=sample_time, noise=noise)
        )
        return cls(
            sample_time=sample_time,
            delay=delay,
            thrusters=partial(ThrusterSet.axial, **thrusters),
            wheels=partial(ReactionWheels, np.eye(3), **wheels),
            drives=partial(JointDrives, torque=torque),
            **sensors,
        )

    def mounted(self, truss: Plant) -> Plant:
        """Return a plant with the reflected inertia of the drives.

        Parameters
        ----------
        truss : SpaceTruss
            Plant.
        """
        dynamics = truss.dynamics
        return truss.changed(
            dynamics=dynamics.with_drives(self.drive_inertias(dynamics))
        )

    def drive_inertias(self, dynamics: TrussDynamics) -> Vector:
        """Return the reflected inertia of the drive of each joint [kg·m²; kg of sliding joints].

        Parameters
        ----------
        dynamics : TrussDynamics
            Truss and robots.
        """
        joints = dynamics.joint_data
        return self.drives(joints).reflected_inertia if joints else np.zeros(0)

    def limits(self, truss: SpaceTruss) -> Vector:
        """Return the limit of each actuator of a truss in either direction, alone [N, N·m].

        Parameters
        ----------
        truss : SpaceTruss
            Plant.

        Raises
        ------
        ModelError
            If the hardware makes no torques on the bases.
        """
        bases = np.zeros((truss.robots, 6))
        for robot, base in enumerate(bases):
            base[:] = _made(self.thrusters, robot).reach
            if self.wheels is not None:
                wheels = _made(self.wheels, robot)
                # The first wheel at its limit determines the torque along an axis.
                base[3:] = 1.0 / np.max(
                    np.abs(wheels.sharing) / wheels.maximum_torque[:, None], axis=0
                )
        if not np.all(np.isfinite(bases)):
            raise ModelError(
                "the hardware makes no torques on the bases: it has no wheels, and its thrusters make no "
                "torques; add wheels, or use thrusters such as ThrusterSet.pairs"
            )
        joints = truss.dynamics.joint_data
        torques = self.drives(joints).maximum if joints else np.zeros(0)
        return np.concatenate([bases.ravel(), torques])

    def actuators(self, truss: SpaceTruss, *, seed: int = 0) -> Diagram:
        """Return all actuators of a truss, with the hold and delay of the computer.

        Parameters
        ----------
        truss : SpaceTruss
            Plant.
        seed : int
            Seed of the noise of the servo's sensors, zero or positive [1].

        Returns
        -------
        Diagram
            Input `command`, as `SpaceTruss.actuation`. With a servo also `joint_reference`,
            `joint_reference_rate`, `joint_angles` and `joint_rates`. Optional inputs: `base_effectiveness` of
            each base and `joint_effectiveness` of each joint, their health from 0 to 1; `joint_rates`, for
            friction; with a servo `brake`, above 0.5 for joints to be braked; with wheels `unloading` [1/s];
            unless `gyroscopic` is off, `rates`, the `actuator_rates` of the truss. Outputs: `actuation` of the
            truss; `ordered`, thrusts of healthy thrusters and commanded torques, with a servo the expected
            joint torques; with a servo also `servo_torque`, its mean joint torques in the last sample time
            without the commands; `propellant` by the orders to each base; with wheels their `momentum`, in base axes.

        Raises
        ------
        ModelError
            If the truss has no robots.
        """
        robots, units, joints = (
            truss.robots,
            truss.actuator_units,
            truss.dynamics.joint_data,
        )
        if not robots:
            raise ModelError(
                "the truss has no robots, so there are no actuators; omit them"
            )
        diagram = Diagram("actuators")
        computer, health = diagram.add(
            computer=sampled_delay(self.sample_time, self.delay, shape=truss.actuators),
            health=Function(
                lambda u: u, {"u": Input(robots, default=1.0)}, {"y": Output(robots)}
            ),
        )
        total, orders, used = diagram.add(
            total=_bus(truss.actuators, units),
            orders=_bus(truss.actuators, units),
            used=_bus(robots, "kg"),
        )
        if self.wheels is not None:
            stored = diagram.add(stored=_bus(3 * robots, "N*m*s"))
            diagram.expose(momentum=stored.y)
            if self.gyroscopic != "off":
                turning = _bus(truss.actuators, truss.actuator_rate_units)
                diagram.add(turning=turning)
                diagram.expose(rates=turning.u)
        unloading = []
        for i in range(robots):
            thrusters = diagram.add(f"thrusters_{i + 1}", _made(self.thrusters, i))
            force, torque = slice(6 * i, 6 * i + 3), slice(6 * i + 3, 6 * i + 6)
            computer.y[force] >> thrusters.demand[:3]
            health.y[i] >> thrusters.effectiveness
            thrusters.wrench[:3] >> total.u[force]
            thrusters.ordered[:3] >> orders.u[force]
            thrusters.propellant >> used.u[i]
            if self.wheels is None:
                computer.y[torque] >> thrusters.demand[3:]
                thrusters.wrench[3:] >> total.u[torque]
                thrusters.ordered[3:] >> orders.u[torque]
                continue
            wheels = diagram.add(f"wheels_{i + 1}", _made(self.wheels, i))
            health.y[i] >> wheels.effectiveness
            # The thrusters balance the torque by which the wheels lose their momentum.
            -wheels.unloading_torque >> thrusters.demand[3:]
            felt, wanted = wheels.torque + thrusters.wrench[3:], computer.y[torque]
            if self.gyroscopic != "off":
                # continuous, since a hold would add energy to the nutation
                gyroscope = diagram.add(
                    f"gyroscope_{i + 1}",
                    Function(
                        np.cross,
                        {
                            "held": Input(3, unit="N*m*s"),
                            "rate": Input(3, unit="rad/s"),
                        },
                        {"torque": Output(3, unit="N*m")},
                    ),
                )
                wheels.stored >> gyroscope.held
                turning.y[torque] >> gyroscope.rate
                felt = felt + gyroscope.torque
                if self.gyroscopic == "cancelled":
                    wanted = wanted - gyroscope.torque
            wanted >> wheels.demand
            felt >> total.u[torque]
            wheels.stored >> stored.u[3 * i : 3 * i + 3]
            computer.y[torque] >> orders.u[torque]
            unloading.append(wheels.unloading)
        if unloading:
            diagram.expose(unloading=tuple(unloading))
        diagram.expose(command=computer.u, base_effectiveness=health.u)
        if joints:
            drives = diagram.add(drives=self.drives(joints))
            drives.torque >> total.u[6 * robots :]
            commands = computer.y[6 * robots :]
            if self.servo is None:
                commands >> drives.command
                commands >> orders.u[6 * robots :]
                diagram.expose(joint_rates=drives.rate)
                diagram.expose(joint_effectiveness=drives.effectiveness)
            else:
                rest = truss.start_position[truss.dynamics.attitude.end :]
                self._add_servo(diagram, commands, rest, seed) >> orders.u[6 * robots :]
        diagram.expose(actuation=total.y, ordered=orders.y, propellant=used.y)
        return diagram

    def _add_servo(
        self, diagram: Diagram, commands: Wired, rest: Vector, seed: int
    ) -> Wired:
        """Add servo and brakes of the drives to the actuators; return the expected joint torques.

        The torques of the next sample time are unknown to a controller. They are expected to be its
        commands plus the mean difference from them in the sample time before.
        """
        drives, servo, step = diagram.blocks["drives"], self.servo, self.sample_time
        assert servo is not None
        joints = drives.joint_data
        local, brakes, places, rates, past, impulse = diagram.add(
            servo=servo.diagram(
                joints,
                drives.parameters["maximum"],
                rest,
                seed=derived_seed(seed, len(SENSOR_UNITS)),
            ),
            brakes=BrakeLatch(joints, servo.sample_time),
            references=sampled_delay(step, self.delay, rest),
            reference_rates=sampled_delay(step, self.delay, np.zeros_like(rest)),
            past=UnitDelay(step, np.zeros_like(rest)),
            impulse=ZeroOrderHold(step),
        )
        places.y >> local.reference
        rates.y >> local.reference_rate
        commands >> local.feedforward
        local.torque >> drives.command
        brakes.engaged >> drives.engaged
        brakes.held >> drives.held
        diagram.expose(
            joint_reference=places.u,
            joint_reference_rate=rates.u,
            joint_angles=(local.angle, brakes.angle, drives.angle),
            joint_rates=(local.rate, drives.rate),
            joint_effectiveness=(brakes.effectiveness, drives.effectiveness),
            brake=brakes.command,
        )
        local.impulse >> impulse
        mean = impulse / step
        mean + commands >> past.u
        own = mean - past.y
        diagram.expose(servo_torque=own)
        expected: Wired = commands + own
        return expected

    def sensors(self, truss: SpaceTruss, *, seed: int) -> Diagram:
        """Return all sensors of a truss.

        Parameters
        ----------
        truss : SpaceTruss
            Plant.
        seed : int
            Seed of the noise, zero or positive [1].

        Returns
        -------
        Diagram
            Inputs: `coordinates` and `speeds` of the truss. Outputs, as measured: `task_position`,
            `task_velocity` and `rigid_speeds`. The modes are not measured.
        """
        places, rigid, attitude = truss.rigid_q, truss.rigid, truss.dynamics.attitude
        where, rates = truss.position_units, truss.task_rate_units

        def seen(position: Array, speeds: Array) -> tuple[Array, Array, Array]:
            # Noise changes the length of a measured quaternion.
            position = normalized(attitude, position)
            return position, task_velocity(attitude, position, speeds), speeds

        diagram = Diagram("sensors")
        true, moving, shown = diagram.add(
            true=_bus(truss.nq, truss.coordinate_units),
            moving=_bus(truss.n, truss.speed_units),
            shown=Function(
                seen,
                {
                    "position": Input(places, unit=where),
                    "speeds": Input(rigid, unit=rates),
                },
                {
                    "task_position": Output(places, unit=where),
                    "task_velocity": Output(rigid, unit=rates),
                    "rigid_speeds": Output(rigid, unit=rates),
                },
            ),
        )
        rest = truss.parameters["initial_coordinates"]
        signals = [
            (true.y, rest, shown.position, attitude.end),
            (moving.y, np.zeros(rigid), shown.speeds, 6),
        ]
        for k, name in enumerate(SENSOR_UNITS):
            source, start, target, joints = signals[k // 3]
            part = (slice(3), slice(3, joints), slice(joints, target.size))[k % 3]
            # The third sensor of each group of three measures joints.
            if not truss.joints and k % 3 == 2:
                continue
            kind: Measurement = getattr(self, name)
            if name == "star_tracker":
                # The components of a quaternion change by half the angle.
                kind = kind.scaled(attitude.per_radian)
            sensor = kind.sensor(
                start[part].shape, seed=derived_seed(seed, k), initial_value=start[part]
            )
            source[part] >> diagram.add(name, sensor).u
            sensor.y >> target[part]
        diagram.expose(coordinates=true.u, speeds=moving.u)
        diagram.expose(**{port.name: port for port in shown.outputs()})
        return diagram
