"""The rigid limit against a second library: Pinocchio, on the same tree of 33 bodies."""

import numpy as np
import pytest
from systems import assert_near, relative_error

from trussflow.models.geometry.rotation import euler_rotation

pin = pytest.importorskip("pinocchio", reason="Pinocchio has no wheels for Windows")

# Two correct codes differ by round-off only: of the largest element, and of each element in its
# own scale. The latter is coarser: joints of grams are computed about an origin 10 m away.
TOLERANCE = 1e-12
SCALED_TOLERANCE = 1e-11

JOINT_MODELS = {False: pin.JointModelRZ, True: pin.JointModelPZ}


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
        root,
        inertia_of(modes.mass, modes.static_moment, modes.inertia),
        pin.SE3.Identity(),
    )
    for i, arm in enumerate(system.arms):
        hand = pin.SE3(arm.hand_rotation, modes.grasp_positions[i])
        bodies = list(map(inertia_of, arm.masses, arm.static_moments, arm.inertias))
        model.appendBodyToJoint(root, bodies[0], hand)
        joint, placement = root, hand
        for j in range(arm.joints):
            placement = placement * pin.SE3(
                arm.joint_rotations[j], arm.joint_origins[j]
            )
            joint = model.addJoint(
                joint, JOINT_MODELS[arm.sliding[j]](), placement, f"C_{i},{j}"
            )
            model.appendBodyToJoint(joint, bodies[j + 1], pin.SE3.Identity())
            placement = pin.SE3.Identity()
        mount = pin.SE3(
            arm.base_rotation, arm.base_origin + arm.base_rotation @ arm.base_centroid
        )
        base = pin.Inertia(arm.base_mass, np.zeros(3), arm.base_inertia)
        model.appendBodyToJoint(joint, base, placement * mount)
    model.gravity = pin.Motion.Zero()
    return model


def test_any_arrangement_equals_pinocchio(random_system, arrangement, rng):
    """Its free-flyer speeds are ours: velocity of the origin and angular velocity, body axes."""
    system = random_system(arrangement[0], 0, elastic_integrals=True)
    model, n = tree(system), system.coordinates
    data = model.createData()
    q, v = rng.uniform(-1.3, 1.3, n), rng.standard_normal(n)
    configuration = np.concatenate(
        [q[:3], pin.Quaternion(euler_rotation(q[3:6])).coeffs(), q[6:]]
    )
    mass = np.triu(pin.crba(model, data, configuration))
    mass = mass + np.triu(mass, 1).T
    bias = pin.nonLinearEffects(model, data, configuration, v)
    terms = system.evaluate(q, v)
    assert relative_error(terms.mass_matrix, mass) < TOLERANCE
    assert relative_error(terms.bias, bias) < TOLERANCE
    scale = 1.0 / np.sqrt(np.diag(mass))
    assert_near(
        (terms.mass_matrix - mass) * np.outer(scale, scale), 0.0, SCALED_TOLERANCE
    )
    assert relative_error(terms.bias * scale, bias * scale) < SCALED_TOLERANCE
    about_centre = pin.computeCentroidalMomentum(model, data, configuration, v)
    centre = pin.centerOfMass(model, data, configuration)
    linear, angular = system.momentum(q, v)
    size = np.linalg.norm(angular)
    assert np.linalg.norm(linear - about_centre.linear) < TOLERANCE * size
    expected = about_centre.angular + np.cross(centre, about_centre.linear)
    assert np.linalg.norm(angular - expected) < TOLERANCE * size
