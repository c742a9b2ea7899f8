"""All hardware between a controller and the truss, as two diagrams: actuators and sensors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Self

import numpy as np

from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.types import Array, Vector
from trussflow.blocks.library.algebra import Function, Gain
from trussflow.blocks.library.discrete import sampled_delay
from trussflow.models.dynamics.task_space import normalized, task_velocity
from trussflow.models.errors import ModelError
from trussflow.models.hardware.accelerations import PointAccelerations
from trussflow.models.hardware.measurement import Measurement, derived_seed
from trussflow.models.hardware.motors import JointDrives, ReactionWheels
from trussflow.models.hardware.thrusters import ThrusterSet
from trussflow.models.layered_file import LayeredFile
from trussflow.models.parameter_files import ParameterTable
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.robots.joint import Joint
from trussflow.models.validation import check_choice, check_number

SENSORS = {
    "metrology": "m",
    "star_tracker": "rad",
    "encoder": "rad",
    "velocimeter": "m/s",
    "gyro": "rad/s",
    "tachometer": "rad/s",
}
"""Units of the sensors of root position, attitude and joint angles, and of their rates in truss axes."""

GYROSCOPIC = ("off", "on", "cancelled")


def _made(make: Any, robot: int) -> Any:
    """Return what a robot carries, by what makes it for all or for each."""
    return make[robot]() if isinstance(make, tuple) else make()


@dataclass(frozen=True, slots=True, kw_only=True)
class Hardware:
    """What the robots carry, made anew for each.

    Attributes
    ----------
    sample_time, delay : float
        Of the computer: how long a command is held, and how late it comes [s].
    thrusters : callable, or tuple of callable
        Returns the `ThrusterSet` of a base; one for all, or one for each.
    wheels : callable, or tuple of callable, optional
        Returns the `ReactionWheels` of a base, likewise. Without wheels its torques are the thrusters' task;
        with them the thrusters only make up for unloading.
    drives : callable
        Takes the joints of all robots together, as `JointDrives` does, and returns their drives.
    metrology, star_tracker, velocimeter, gyro : Measurement
        Of the root's position [m], attitude [rad], velocity [m/s] and angular velocity [rad/s].
    encoder, tachometer : Measurement
        Of the joints' angles [rad] and rates [rad/s].
    accelerometer : Measurement, optional
        At each grasp point and each base [m/s^2].
    gyroscopic : str
        Whether the momentum of wheels and other rotors resists the turning of their bases, ω × A h:
        ``"off"``; ``"on"``; or ``"cancelled"`` by the drives of the wheels, which know their momentum and
        the rate of their base, once a sample. Unless off, the actuators take the `rates` of the truss.
    """

    sample_time: float
    delay: float
    thrusters: Callable[[], ThrusterSet] | tuple[Callable[[], ThrusterSet], ...]
    wheels: Callable[[], ReactionWheels] | tuple[Callable[[], ReactionWheels], ...] | None
    drives: Callable[[int | Sequence[Joint]], JointDrives]
    metrology: Measurement
    star_tracker: Measurement
    velocimeter: Measurement
    gyro: Measurement
    encoder: Measurement
    tachometer: Measurement
    accelerometer: Measurement | None = None
    gyroscopic: str = "off"

    def __post_init__(self) -> None:
        check_choice("gyroscopic torque", self.gyroscopic, GYROSCOPIC)

    @classmethod
    def flight(cls, *, torque: float | None = None) -> Self:
        """Return the hardware that a flown loop is designed for, from ``parameters/hardware.toml``.

        A hold of 20 ms and a delay of 20 ms; 5 N in steps of 0.1 N, sigma-delta modulated, and 0.3 N·m for
        each axis of a base; 0.3 N·m for each joint, without friction; noise of 1e-4 m, rad, m/s and rad/s.

        Parameters
        ----------
        torque : float, optional
            Of wheels and joints in place of 0.3 N·m; what the wheels hold grows in proportion [N·m].
        """
        return cls.of(ParameterTable.shipped("hardware.toml"), torque=torque)

    @classmethod
    def of(cls, file: ParameterTable | LayeredFile, *, torque: float | None = None) -> Self:
        """Return the hardware that a file states: throttled thrusters, wheels, joint drives, sensors.

        Parameters
        ----------
        file : ParameterTable or LayeredFile
            With the tables of ``parameters/hardware.toml``.
        torque : float, optional
            As of `flight` [N·m].

        Raises
        ------
        ModelError
            If a value is missing or makes no sense.
        """

        def numbers(table: str, **units: str) -> dict[str, Any]:
            return file.table(table).scalars(**units)

        thrusters = numbers("thrusters", maximum="N", quantum="N", period="s", specific_impulse="s")
        wheels = numbers("wheels", sample_time="s", torque="N*m", momentum="N*m*s")
        joints = numbers("joints", torque="N*m")
        if torque is not None:
            check_number("hardware", torque=torque)
            wheels["momentum"] *= torque / wheels["torque"]
            wheels["torque"] = joints["torque"] = torque
        sensors: dict[str, Any] = {
            name: Measurement(**numbers(name, sample_time="s", noise=unit)) for name, unit in SENSORS.items()
        }
        return cls(
            gyroscopic=file.table("wheels").choice("gyroscopic", GYROSCOPIC),
            **numbers("computer", sample_time="s", delay="s"),
            thrusters=partial(ThrusterSet.axial, **thrusters),
            wheels=partial(ReactionWheels, np.eye(3), **wheels),
            drives=partial(JointDrives, **joints),
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
        """Return hardware that holds and delays, and does nothing else unless asked.

        Parameters
        ----------
        sample_time, delay : float
            Of the computer [s].
        noise : float
            Standard deviation of all sensors [m, rad, m/s, rad/s].
        quantum, thrust : float
            Step between thrusts, and their limit: by default out of sight [N].
        torque : float
            Limit of wheels and joints, likewise [N·m].
        """
        thrusters = {"maximum": thrust, "quantum": quantum, "period": sample_time, "specific_impulse": 70.0}
        wheels = {"sample_time": sample_time, "torque": torque, "momentum": 1e6}
        sensors: dict[str, Any] = dict.fromkeys(SENSORS, Measurement(sample_time=sample_time, noise=noise))
        return cls(
            sample_time=sample_time,
            delay=delay,
            thrusters=partial(ThrusterSet.axial, **thrusters),
            wheels=partial(ReactionWheels, np.eye(3), **wheels),
            drives=partial(JointDrives, torque=torque),
            **sensors,
        )

    def limits(self, truss: SpaceTruss) -> Vector:
        """Return how much each actuator of a truss can do in either direction, alone [N, N·m].

        Parameters
        ----------
        truss : SpaceTruss
            The plant; it is only looked at.

        Raises
        ------
        ModelError
            If nothing makes torques on the bases.
        """
        bases = np.zeros((truss.robots, 6))
        for robot, base in enumerate(bases):
            base[:] = _made(self.thrusters, robot).reach
            if self.wheels is not None:
                wheels = _made(self.wheels, robot)
                base[3:] = 1.0 / np.max(np.abs(wheels.sharing) / wheels.maximum_torque[:, None], axis=0)
        if not np.all(np.isfinite(bases)):
            raise ModelError(
                "nothing makes torques on the bases: the hardware has no wheels, and its thrusters make "
                "none; give it wheels, or thrusters such as ThrusterSet.pairs"
            )
        joints = truss.dynamics.joint_data
        torques = self.drives(joints).maximum if joints else np.zeros(0)
        return np.concatenate([bases.ravel(), torques])

    def actuators(self, truss: SpaceTruss) -> Diagram:
        """Return all actuators of a truss, behind the computer that commands them.

        Parameters
        ----------
        truss : SpaceTruss
            The plant; it is only looked at.

        Returns
        -------
        Diagram
            Inputs: `command` as `SpaceTruss.actuation` has it, and what may stay open: `base_effectiveness`
            of each base and `joint_effectiveness` of each joint, from 0 (dead) to 1; `joint_rates`, for
            friction; `brake`, torques that hold joints (all three if there are joints); with wheels,
            `unloading` [1/s]; unless `gyroscopic` is off, `rates`, which are `actuator_rates` of the truss.
            Outputs: `actuation`, what acts on the truss, `ordered`, thrust as limited and rounded but of
            healthy thrusters, and torques as commanded, and the `propellant` that each base has used, and
            with wheels the `momentum` that they hold, in base axes.

        Raises
        ------
        ModelError
            If there are no robots.
        """
        robots, units, joints = truss.robots, truss.actuator_units, truss.dynamics.joint_data
        if not robots:
            raise ModelError("the truss has no robots, which carry the hardware; leave the actuators out")
        diagram = Diagram("actuators")
        computer, health = diagram.add(
            computer=sampled_delay(self.sample_time, self.delay, shape=truss.actuators),
            health=Function(lambda u: u, {"u": Input(robots, default=1.0)}, {"y": Output(robots)}),
        )
        drives = diagram.add(drives=self.drives(joints)) if joints else None
        total, orders, used = diagram.add(
            total=Gain(np.ones(truss.actuators), input_unit=units, output_unit=units),
            orders=Gain(np.ones(truss.actuators), input_unit=units, output_unit=units),
            used=Gain(np.ones(robots), input_unit="kg", output_unit="kg"),
        )
        if self.wheels is not None:
            held = "N*m*s"
            stored = diagram.add(stored=Gain(np.ones(3 * robots), input_unit=held, output_unit=held))
            diagram.expose(momentum=stored.y)
            if self.gyroscopic != "off":
                per, size = truss.actuator_rate_units, np.ones(truss.actuators)
                turning = diagram.add(turning=Gain(size, input_unit=per, output_unit=per))
                diagram.expose(rates=turning.u)
        unloading = []
        for i in range(robots):
            thrusters = diagram.add(**{f"thrusters_{i + 1}": _made(self.thrusters, i)})
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
            wheels = diagram.add(**{f"wheels_{i + 1}": _made(self.wheels, i)})
            health.y[i] >> wheels.effectiveness
            -wheels.unloading_torque >> thrusters.demand[3:]
            felt, wanted = wheels.torque + thrusters.wrench[3:], computer.y[torque]
            if self.gyroscopic != "off":  # held for a sample, as the wheels would, it would drive nutation
                gyroscope = diagram.add(
                    **{
                        f"gyroscope_{i + 1}": Function(
                            np.cross,
                            {"held": Input(3, unit="N*m*s"), "rate": Input(3, unit="rad/s")},
                            {"torque": Output(3, unit="N*m")},
                        )
                    }
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
        if drives is not None:
            computer.y[6 * robots :] >> drives.command
            computer.y[6 * robots :] >> orders.u[6 * robots :]
            drives.torque >> total.u[6 * robots :]
            diagram.expose(joint_rates=drives.rate, brake=drives.brake)
            diagram.expose(joint_effectiveness=drives.effectiveness)
        diagram.expose(actuation=total.y, ordered=orders.y, propellant=used.y)
        return diagram

    def sensors(self, truss: SpaceTruss, *, seed: int) -> Diagram:
        """Return all sensors of a truss.

        Parameters
        ----------
        truss : SpaceTruss
            The plant; it is only looked at.
        seed : int
            Which noise, at least 0 [1].

        Returns
        -------
        Diagram
            Inputs: `coordinates` and `speeds` of the truss. Outputs, as they are seen: `task_position`,
            `task_velocity` and `rigid_speeds`, and with accelerometers `grasp_acceleration` and
            `base_acceleration`. No sensor shows the modes.

        Raises
        ------
        ModelError
            If there are accelerometers, and the truss is a tunable one.
        """
        if self.accelerometer is not None and isinstance(truss, TunableTruss):
            raise ModelError(
                "accelerometers of a TunableTruss would feel another truss than the one that flies; use a "
                "SpaceTruss, or hardware without accelerometers"
            )
        places, rigid, rest = truss.rigid_q, truss.rigid, truss.parameters["initial_coordinates"]
        where, rates, attitude = truss.coordinate_units, truss.speed_units, truss.dynamics.attitude

        def seen(position: Array, speeds: Array) -> tuple[Array, Array, Array]:
            position = normalized(attitude, position)
            return position, task_velocity(attitude, position, speeds), speeds

        diagram, still = Diagram("sensors"), np.zeros(rigid)
        true, moving, shown = diagram.add(
            true=Gain(np.ones(truss.nq), input_unit=where, output_unit=where),
            moving=Gain(np.ones(truss.n), input_unit=rates, output_unit=rates),
            shown=Function(
                seen,
                {"position": Input(places, unit=where[:places]), "speeds": Input(rigid, unit=rates[:rigid])},
                {
                    "task_position": Output(places, unit=where[:places]),
                    "task_velocity": Output(rigid, unit=truss.task_rate_units),
                    "rigid_speeds": Output(rigid, unit=rates[:rigid]),
                },
            ),
        )
        for k, name in enumerate(SENSORS):
            first, last = (attitude.end, places) if k < 3 else (6, rigid)
            part = (slice(0, 3), slice(3, first), slice(first, last))[k % 3]
            if first == last and k % 3 == 2:
                continue  # no joints
            source, start, target = (true, rest, shown.position) if k < 3 else (moving, still, shown.speeds)
            kind: Measurement = getattr(self, name)
            if name == "star_tracker":
                kind = kind.scaled(attitude.per_radian)
            sensor = kind.sensor(start[part].shape, seed=derived_seed(seed, k), initial_value=start[part])
            source.y[part] >> diagram.add(**{name: sensor}).u
            sensor.y >> target[part]
        if self.accelerometer is not None:
            points = diagram.add(points=PointAccelerations(truss.dynamics, self.accelerometer.sample_time))
            true.y >> points.coordinates
            moving.y >> points.speeds
            for k, port in enumerate(points.outputs(), len(SENSORS)):
                sensor = self.accelerometer.sensor(port.shape, seed=derived_seed(seed, k))
                port >> diagram.add(**{f"{port.name}_sensor": sensor}).u
                diagram.expose(**{f"{port.name}_acceleration": sensor.y})
        diagram.expose(coordinates=true.u, speeds=moving.u)
        diagram.expose(**{port.name: port for port in shown.outputs()})
        return diagram
