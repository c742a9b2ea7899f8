"""The truss and its robots as an Exudyn system, at a given state.

Exudyn sees a floating frame with modes, rigid bodies with absolute coordinates, and joints as
constraints; this file only finds the place and motion of each body that the state implies.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

import exudyn as exu
import numpy as np
from exudyn import itemInterface as items  # noqa: N813
from exudyn.FEM import FEMinterface, ObjectFFRFreducedOrderInterface
from exudyn.rigidBodyUtilities import GetRigidBodyNode
from pin_jointed_truss import DAMPING, WEIGHTS, Array
from scipy.sparse import csr_matrix
from scipy.spatial.transform import Rotation

PARAMETERS = Path(__file__).parents[4] / "models" / "parameters"
OUTPUT = exu.OutputVariableType
AXIS = np.array([0.0, 0.0, 1.0])
UNTURNED, ORIGIN = np.eye(3), np.zeros(3)


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """One state in the coordinates and speeds of `TrussDynamics`, and its actuator inputs.

    Attributes
    ----------
    q : array, shape (n,)
        Position and 3-1-2 Euler angles of the truss frame, joint angles, modal coordinates
        [m, rad, rad, kg^½·m].
    v : array, shape (n,)
        Velocity and angular velocity of the truss frame in its own axes, joint rates, modal
        rates [m/s, rad/s, rad/s, kg^½·m/s].
    actuation : array, shape (13 k,)
        Force and torque on each base in its own axes, then all joint torques [N, N·m].
    """

    q: Array
    v: Array
    actuation: Array

    @property
    def joints(self):
        """Place of the joints in `q` and `v`."""
        return slice(6, 6 + 7 * (len(self.actuation) // 13))

    @property
    def modes(self):
        """Place of the modes in `q` and `v`."""
        return slice(self.joints.stop, None)


@dataclass(frozen=True, slots=True)
class Pose:
    """Place and motion of a frame, in inertial axes."""

    rotation: Array
    position: Array
    velocity: Array
    spin: Array

    def moved(self, rotation, offset, spin=0.0):
        """Return a frame at an offset in this one, turning against it with `spin`, its own axes."""
        lever = self.rotation @ offset
        turned = self.rotation @ rotation
        own = turned @ np.broadcast_to(spin, (3,))
        velocity = self.velocity + np.cross(self.spin, lever)
        return Pose(turned, self.position + lever, velocity, self.spin + own)


def homogeneous(rotation, place):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, place
    return matrix


def attitude(angles):
    """Return the rotation of the truss frame: about z, then x, then y."""
    phi, theta, psi = angles
    return Rotation.from_euler("ZXY", [psi, phi, theta]).as_matrix()


def arm_file(name):
    with (PARAMETERS / f"robot_arm_{name}.toml").open("rb") as file:
        return tomllib.load(file)


def fixed_rotation(table):
    return Rotation.from_euler("XYZ", table["rotation"]["value"]).as_matrix()


def inertia_of(table):
    """Return mass, centre of mass and inertia about the frame's origin of a hand or link."""
    mass, centre = table["mass"]["value"], np.array(table["centre_of_mass"]["value"])
    if "inertia_about_origin" in table:
        return mass, centre, np.diag(table["inertia_about_origin"]["value"])
    central = np.diag(table["inertia_about_centre_of_mass"]["value"])
    return (
        mass,
        centre,
        central + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre)),
    )


class TrussSystem:
    """The Exudyn system; `arms` name the parameter files of the robots on the first grasps."""

    def __init__(self, truss, arms, state):
        self.truss, self.arms, self.state = truss, arms, state
        self.container = exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        turned = attitude(state.q[3:6])
        self.frame = Pose(
            turned, state.q[:3], turned @ state.v[:3], turned @ state.v[3:6]
        )
        self._add_truss()
        self.chains = [self._add_arm(i) for i in range(len(arms))]
        self.mbs.Assemble()

    def _add_truss(self):
        truss, state = self.truss, self.state
        modal, rates = state.q[state.modes], state.v[state.modes]
        fem = FEMinterface()
        fem.nodes["Position"] = truss.positions
        fem.massMatrix = csr_matrix(np.diag(np.repeat(truss.masses, 3)))
        fem.stiffnessMatrix = csr_matrix(truss.stiffness)
        fem.modeBasis = {"matrix": truss.shapes, "type": "NormalModes"}
        reduced = ObjectFFRFreducedOrderInterface(fem)
        added = reduced.AddObjectFFRFreducedOrder(
            self.mbs,
            positionRef=self.frame.position,
            initialVelocity=self.frame.velocity,
            rotationMatrixRef=self.frame.rotation,
            initialAngularVelocity=self.frame.spin,
            stiffnessProportionalDamping=DAMPING,
        )
        self.flexible = added["oFFRFreducedOrder"]
        self.frame_node, self.modal_node = added["nRigidBody"], added["nGenericODE2"]
        for name, value in (
            ("initialCoordinates", modal),
            ("initialCoordinates_t", rates),
        ):
            self.mbs.SetNodeParameter(self.modal_node, name, list(value))

    def _add_arm(self, i):
        """Add a robot at grasp i: bodies, joints, loads; return hand, links and base."""
        file, state = arm_file(self.arms[i]), self.state
        modal, rates = state.q[state.modes], state.v[state.modes]
        own = slice(7 * i, 7 * i + 7)
        point, translation, turning = self.truss.grasp(i)
        elastic = Rotation.from_rotvec(turning @ modal).as_matrix()
        held = self.frame.moved(UNTURNED, point + translation @ modal)
        drift = held.rotation @ (translation @ rates)
        held = Pose(held.rotation, held.position, held.velocity + drift, held.spin)
        # The angular velocity is c', as c = 0 or the axis of c is fixed in all states.
        held = held.moved(elastic, ORIGIN, elastic.T @ turning @ rates)

        rotation = fixed_rotation(file["hand"])
        body = self._body(inertia_of(file["hand"]), held.moved(rotation, ORIGIN))
        holding = self.mbs.AddMarker(
            items.MarkerSuperElementRigid(
                bodyNumber=self.flexible,
                meshNodeNumbers=list(self.truss.held[i]),
                weightingFactors=WEIGHTS,
                localHT=homogeneous(rotation, ORIGIN),
            )
        )
        self._join(items.ObjectJointGeneric, holding, self._marker(body))
        bodies, pose = [body], held.moved(rotation, ORIGIN)
        torques = state.actuation[6 * len(self.arms) :][own]
        for table, angle, rate, torque in zip(
            file["links"],
            state.q[state.joints][own],
            state.v[state.joints][own],
            torques,
            strict=True,
        ):
            rotation, origin = fixed_rotation(table), np.array(table["origin"]["value"])
            turn = Rotation.from_rotvec(angle * AXIS).as_matrix()
            pose = pose.moved(rotation @ turn, origin, rate * AXIS)
            before = self._marker(bodies[-1], rotation, origin)
            body = self._body(inertia_of(table), pose)
            after = self._marker(body)
            self._join(items.ObjectJointRevoluteZ, before, after)
            self._torque(after, torque * AXIS)
            self._torque(self._marker(bodies[-1]), -torque * (rotation @ AXIS))
            bodies.append(body)
        return [
            *bodies,
            self._base(
                file["base"], bodies[-1], pose, state.actuation[6 * i : 6 * i + 6]
            ),
        ]

    def _base(self, table, link, pose, wrench):
        """Add the base, its frame at the centroid, with the force and torque on it."""
        rotation = fixed_rotation(table)
        place = np.array(table["origin"]["value"]) + rotation @ np.array(
            table["centroid"]["value"]
        )
        inertia = np.diag(table["inertia_about_centroid"]["value"])
        body = self._body(
            (table["mass"]["value"], ORIGIN, inertia), pose.moved(rotation, place)
        )
        marker = self._marker(body)
        self._join(
            items.ObjectJointGeneric, self._marker(link, rotation, place), marker
        )
        force = items.LoadForceVector(
            markerNumber=marker, loadVector=wrench[:3], bodyFixed=True
        )
        self.mbs.AddLoad(force)
        self._torque(marker, wrench[3:])
        return body

    def _body(self, inertia, pose):
        mass, centre, matrix = inertia
        node = self.mbs.AddNode(
            GetRigidBodyNode(
                exu.NodeType.RotationEulerParameters,
                position=pose.position,
                velocity=pose.velocity,
                rotationMatrix=pose.rotation,
                angularVelocity=pose.spin,
            )
        )
        elements = [
            matrix[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
        ]
        return self.mbs.AddObject(
            items.ObjectRigidBody(
                nodeNumber=node, mass=mass, inertia=elements, centerOfMass=centre
            )
        )

    def _marker(self, body, rotation=UNTURNED, place=ORIGIN):
        frame = homogeneous(rotation, place)
        return self.mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=body, localHT=frame))

    def _join(self, joint, first, second):
        self.mbs.AddObject(joint(markerNumbers=[first, second]))

    def _torque(self, marker, torque):
        self.mbs.AddLoad(
            items.LoadTorqueVector(
                markerNumber=marker, loadVector=torque, bodyFixed=True
            )
        )

    def read(self, node, quantity):
        """Return a quantity of a node, in inertial axes."""
        return np.array(self.mbs.GetNodeOutput(node, quantity))

    def joint_accelerations(self):
        """Return the difference of the angular accelerations of two bodies, along each joint's axis.

        The part of the turning of the axes is perpendicular to the axis.
        """
        found = []
        for chain in self.chains:
            nodes = [self.mbs.GetObject(body)["nodeNumber"] for body in chain[:-1]]
            turning = [self.read(node, OUTPUT.AngularAcceleration) for node in nodes]
            for node, change in zip(nodes[1:], np.diff(turning, axis=0), strict=True):
                axis = self.read(node, OUTPUT.RotationMatrix).reshape(3, 3)[:, 2]
                found.append(axis @ change)
        return np.array(found)

    def accelerations(self):
        """Return dv/dt."""
        turned = self.read(self.frame_node, OUTPUT.RotationMatrix).reshape(3, 3)
        velocity, spin, acceleration, turning = (
            self.read(self.frame_node, quantity) @ turned
            for quantity in (
                OUTPUT.Velocity,
                OUTPUT.AngularVelocity,
                OUTPUT.Acceleration,
                OUTPUT.AngularAcceleration,
            )
        )
        return np.concatenate(
            [
                acceleration - np.cross(spin, velocity),
                turning,
                self.joint_accelerations(),
                self.read(self.modal_node, OUTPUT.Coordinates_tt),
            ]
        )
