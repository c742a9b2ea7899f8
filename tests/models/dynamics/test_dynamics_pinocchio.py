"""The rigid limit against a second library: Pinocchio, on the same tree of 33 bodies."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from trussflow.models import RobotArm, TrussDynamics
from trussflow.models.geometry.rotation import euler_rotation

# Two correct codes differ by round-off only: of the largest element, and of each element in its
# own scale. The latter is coarser: joints of grams are computed about an origin 10 m away.
TOLERANCE = 1e-12
SCALED_TOLERANCE = 1e-11

KINDS = {False: pin.JointModelRZ, True: pin.JointModelPZ}


def inertia_of(mass, moment, inertia):
    """Return Pinocchio's inertia, which is about the centre of mass, from one about the origin."""
    centre = moment / mass
    central = inertia - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    return pin.Inertia(mass, centre, central)


def tree(system):
    """Return the truss as a free-flying body with its robots as chains of joints."""
    modes = system.modes
    model = pin.Model()
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "truss")
    model.appendBodyToJoint(
        root, inertia_of(modes.mass, modes.static_moment, modes.inertia), pin.SE3.Identity()
    )
    for i, arm in enumerate(system.arms):
        hand = pin.SE3(arm.hand_rotation, modes.grasp_positions[i])
        bodies = [
            inertia_of(*body) for body in zip(arm.masses, arm.static_moments, arm.inertias, strict=True)
        ]
        model.appendBodyToJoint(root, bodies[0], hand)
        joint, placement = root, hand
        for j in range(arm.joints):
            placement = placement * pin.SE3(arm.joint_rotations[j], arm.joint_origins[j])
            joint = model.addJoint(joint, KINDS[arm.sliding[j]](), placement, f"C_{i},{j}")
            model.appendBodyToJoint(joint, bodies[j + 1], pin.SE3.Identity())
            placement = pin.SE3.Identity()
        mount = pin.SE3(arm.base_rotation, arm.base_origin + arm.base_rotation @ arm.base_centroid)
        base = pin.Inertia(arm.base_mass, np.zeros(3), arm.base_inertia)
        model.appendBodyToJoint(joint, base, placement * mount)
    model.gravity = pin.Motion.Zero()
    return model


@pytest.mark.parametrize("arm", [RobotArm.literal(), RobotArm.jaco()], ids=lambda arm: arm.name)
def test_rigid_limit_equals_pinocchio(arm, modes, rng):
    """Its free-flyer speeds are ours: velocity of the origin and angular velocity, body axes."""
    compare(TrussDynamics(modes=modes.rigid(), arms=(arm,) * 4, elastic_integrals=False), rng)


def test_any_arrangement_equals_pinocchio(random_system, arrangement, rng):
    compare(random_system(arrangement[0], 0, elastic_integrals=True), rng)


def compare(system, rng):
    """Compare mass matrix and bias at random points."""
    model, n = tree(system), system.coordinates
    data = model.createData()
    assert model.nv == n
    for _ in range(5):
        q = rng.uniform(-1.3, 1.3, n)
        v = rng.standard_normal(n)
        attitude = pin.Quaternion(euler_rotation(q[3:6])).coeffs()
        configuration = np.concatenate([q[:3], attitude, q[6:]])
        mass = np.triu(pin.crba(model, data, configuration))
        mass = mass + np.triu(mass, 1).T
        bias = pin.nonLinearEffects(model, data, configuration, v)
        terms = system.evaluate(q, v)
        assert np.max(np.abs(terms.mass_matrix - mass)) < TOLERANCE * np.max(mass)
        assert np.max(np.abs(terms.bias - bias)) < TOLERANCE * np.max(np.abs(bias))
        scale = 1.0 / np.sqrt(np.diag(mass))
        mass_error = np.max(np.abs((terms.mass_matrix - mass) * np.outer(scale, scale)))
        bias_error = np.max(np.abs((terms.bias - bias) * scale)) / np.max(np.abs(bias * scale))
        assert mass_error < SCALED_TOLERANCE
        assert bias_error < SCALED_TOLERANCE


def test_momentum_and_energy_equal_pinocchio(modes, rng):
    system = TrussDynamics(modes=modes.rigid(), arms=(RobotArm.jaco(),) * 4, elastic_integrals=False)
    model = tree(system)
    data = model.createData()
    q, v = rng.uniform(-1.3, 1.3, 34), rng.standard_normal(34)
    configuration = np.concatenate([q[:3], pin.Quaternion(euler_rotation(q[3:6])).coeffs(), q[6:]])
    about_centre = pin.computeCentroidalMomentum(model, data, configuration, v)
    centre = pin.centerOfMass(model, data, configuration)
    linear, angular = system.momentum(q, v)
    scale = np.linalg.norm(angular)
    assert np.linalg.norm(linear - about_centre.linear) < TOLERANCE * scale
    expected = about_centre.angular + np.cross(centre, about_centre.linear)
    assert np.linalg.norm(angular - expected) < TOLERANCE * scale
    energy = pin.computeKineticEnergy(model, data, configuration, v)
    assert abs(system.energy(q, v) / energy - 1.0) < TOLERANCE


def test_a_changed_mass_shows(modes, rng):
    """The comparison is sharp: 0.1 % of the lightest link's mass is far outside the tolerance."""
    arm = RobotArm.literal()
    masses = arm.masses.copy()
    masses[1] *= 1.001
    changed = replace(arm, masses=masses)
    q = rng.uniform(-1.3, 1.3, 34)
    one, other = (
        TrussDynamics(modes=modes.rigid(), arms=(a,) * 4, elastic_integrals=False).mass_matrix(q)
        for a in (arm, changed)
    )
    scale = 1.0 / np.sqrt(np.diag(one))
    assert np.max(np.abs((one - other) * np.outer(scale, scale))) > 1e4 * SCALED_TOLERANCE
