"""The equations of motion against sums over particles, from positions alone.

The model here knows positions only: where each particle is, as a function of the coordinates.
Jacobians come from it by complex steps, their rate of change by high-order differences, and
mass matrix, bias and actuation from M = sum m J^T J, b = sum m J^T (dJ/dt) v, P = J^T. It
shares no code with the package, uses no spatial vectors, no recursion of velocities and no
integrals over the truss. A rigid body is four particles in homogeneous coordinates: the
eigenvectors of its 4×4 pseudo-inertia.
"""

import numpy as np
import pytest
from systems import assert_near, jacobian, relative_error

# Of each element in its own scale, the square root of the mass matrix's diagonal. Sixth-order
# differences over the step below leave 1e-13 to 1e-11 of truncation and round-off.
TOLERANCE = 1e-10
ROUND_OFF = 1e-13  # of positions of some 10 m
STEP = 5e-3


def turn(axis, angle):
    """Return the rotation about a coordinate axis."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3, dtype=complex)
    matrix[i, i] = matrix[j, j] = np.cos(angle)
    matrix[j, i] = np.sin(angle)
    matrix[i, j] = -matrix[j, i]
    return matrix


def attitude(angles):
    phi, theta, psi = angles
    return turn(2, psi) @ turn(0, phi) @ turn(1, theta)


def cayley(c):
    """Return the rotation (I - c×/2)^-1 (I + c×/2)."""
    cross = np.array([[0, -c[2], c[1]], [c[2], 0, -c[0]], [-c[1], c[0], 0]])
    return np.linalg.solve(np.eye(3) - cross / 2, np.eye(3) + cross / 2)


def frames(system, q):
    """Yield rotation and origin of each frame on the robots, in inertial axes.

    The last item counts the frames of a robot from its hand; -1 is the base's centroid.
    """
    turned = attitude(q[3:6])
    tau = q[6 + system.joints :]
    joint = 6
    for i, arm in enumerate(system.arms):
        local = (
            system.modes.grasp_positions[i] + system.modes.grasp_translations[i] @ tau
        )
        origin = q[:3] + turned @ local
        rotation = (
            turned @ cayley(system.modes.grasp_rotations[i] @ tau) @ arm.hand_rotation
        )
        yield rotation, origin, arm, 0
        for j in range(arm.joints):
            origin = origin + rotation @ arm.joint_origins[j]
            rotation = rotation @ arm.joint_rotations[j] @ turn(2, q[joint])
            joint += 1
            yield rotation, origin, arm, j + 1
        origin = origin + rotation @ (
            arm.base_origin + arm.base_rotation @ arm.base_centroid
        )
        yield rotation @ arm.base_rotation, origin, arm, -1


def particles_of(mass, moment, inertia):
    """Return weights (4,) and homogeneous places (4, 4) equivalent to a rigid body."""
    spread = np.trace(inertia) / 2 * np.eye(3) - inertia
    pseudo = np.block([[spread, moment[:, None]], [moment[None], np.array([[mass]])]])
    weights, vectors = np.linalg.eigh(pseudo)
    return weights, vectors.T


def positions(system, q):
    """Return the places of all particles, shape (N, 3), and their weights."""
    modes, tau = system.modes, q[6 + system.joints :]
    places = [q[:3] + (modes.positions + modes.shapes @ tau) @ attitude(q[3:6]).T]
    weights = [modes.masses]
    for rotation, origin, arm, k in frames(system, q):
        if k < 0:
            weight, points = particles_of(arm.base_mass, np.zeros(3), arm.base_inertia)
        else:
            weight, points = particles_of(
                arm.masses[k], arm.static_moments[k], arm.inertias[k]
            )
        places.append(points[:, :3] @ rotation.T + points[:, 3:] * origin)
        weights.append(weight)
    return np.concatenate(places), np.concatenate(weights)


def axial(matrix):
    return np.array([matrix[2, 1], matrix[0, 2], matrix[1, 0]])


def spins(rotation, derivatives):
    """Return the angular velocities in body axes, R^T dR/dt = w×, a column for each derivative."""
    return np.array(
        [axial(rotation.T @ column.reshape(3, 3)) for column in derivatives.T]
    ).T


def rates(system, q):
    """Return N of dq/dt = N v, from the definition of the angular velocity."""
    turned = np.real(attitude(q[3:6]))
    matrix = np.eye(system.coordinates)
    matrix[:3, :3] = turned
    matrix[3:6, 3:6] = np.linalg.inv(
        spins(turned, jacobian(lambda angles: attitude(angles).ravel(), q[3:6]))
    )
    return matrix


def brute_force(system, q, v):
    """Return mass matrix and bias from the particles."""

    def place(q):
        return positions(system, q)[0].ravel()

    def velocity(q):
        return jacobian(lambda s: place(q + s * (rates(system, q) @ v)), np.zeros(1))[
            :, 0
        ]

    to_rates = rates(system, q)
    step = STEP * (to_rates @ v)
    bias = sum(
        c * (velocity(q + k * step) - velocity(q - k * step))
        for k, c in ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60))
    )
    places = jacobian(place, q) @ to_rates
    weighted = places.T * np.repeat(positions(system, q)[1], 3)
    return weighted @ places, weighted @ bias / STEP


def brute_force_actuation(system, q):
    """Return the actuation matrix by virtual power of forces and torques on the bases."""
    columns = []
    for i in range(len(system.arms)):

        def base(q, i=i):
            rotation, origin, *_ = [f for f in frames(system, q) if f[3] < 0][i]
            return np.concatenate([origin, rotation.ravel()])

        turned = np.real(base(q)[3:].reshape(3, 3))
        motions = jacobian(base, q) @ rates(system, q)
        columns += [motions[:3].T @ turned, spins(turned, motions[3:]).T]
    torques = np.eye(system.coordinates)[:, 6 : 6 + system.joints]
    return np.concatenate([*columns, torques], axis=1)


def assert_agrees(system, q, v):
    terms = system.evaluate(q, v)
    mass, bias = brute_force(system, q, v)
    scale = 1.0 / np.sqrt(np.diag(mass))
    rows = scale[:, None]
    assert (
        relative_error(rows * terms.mass_matrix * scale, rows * mass * scale)
        < TOLERANCE
    )
    assert relative_error(scale * terms.bias, scale * bias) < TOLERANCE
    assert (
        relative_error(
            rows * terms.actuation_matrix, rows * brute_force_actuation(system, q)
        )
        < TOLERANCE
    )


def test_published_equations_are_exact_where_the_truss_is_undeformed(
    published, random_state
):
    """At tau = 0 nothing is neglected in Eq. 19, whatever the modal rates."""
    q, v = random_state(published)
    q[published.rigid_coordinates :] = 0.0
    assert_agrees(published, q, v)


def test_consistent_equations_are_exact_at_large_deformation(consistent, random_state):
    q, v = random_state(consistent)
    assert_agrees(consistent, q, v)


@pytest.mark.parametrize("joints, modes", [((1,), 1), ((3, 2), 0), ((2, 4, 1), 3)])
def test_any_truss_and_any_arms(random_system, random_state, joints, modes):
    system = random_system(joints, modes, elastic_integrals=True)
    assert_agrees(system, *random_state(system))


def test_grasp_displacement_is_where_the_hands_are(modes, consistent, random_state):
    q, _ = random_state(consistent)
    q[:6] = 0.0
    hands = np.real([origin for _, origin, _, k in frames(consistent, q) if k == 0])
    error = modes.grasp_positions + consistent.grasp_displacement(q) - hands
    assert_near(error, 0.0, ROUND_OFF)


def test_base_frames_are_where_the_chain_leads(consistent, random_state):
    q, v = random_state(consistent)
    q[:6] = 0.0
    bases = [(np.real(r), np.real(p)) for r, p, _, k in frames(consistent, q) if k < 0]
    terms = consistent.evaluate(q, v)
    assert_near(terms.base_positions, [p for _, p in bases], ROUND_OFF)
    assert_near(np.array(terms.base_rotations), [r for r, _ in bases], ROUND_OFF)
