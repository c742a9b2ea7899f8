"""What holds of the equations as such: traced like computed, symmetric, sizes, messages."""

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from trussflow.blocks.framework.types import Vector
from trussflow.blocks.tracing.program import lower
from trussflow.blocks.tracing.tracing import symbol, to_expression, tracing
from trussflow.models import ModelError, RobotArm, TrussDynamics

# Two orders of evaluation of the same expressions.
ROUND_OFF = 1e-12

State = Callable[[TrussDynamics], tuple[Vector, Vector]]
System = Callable[..., TrussDynamics]


def traced(system, *, kernels):
    """Return the compiled expression graph of the equations: (q, v) to all terms."""
    q, v = symbol("q", (system.coordinates,)), symbol("v", (system.coordinates,))
    with tracing() as trace:
        terms = flat(system.evaluate(q, v)) if kernels else None
    if terms is None:
        terms = flat(system.evaluate(q, v))
    inputs, outputs = [to_expression(q), to_expression(v)], [to_expression(t) for t in terms]
    program = lower("f", inputs, ca.vertcat(*outputs), trace)
    arguments = [ca.MX.sym(n, system.coordinates) for n in ("q", "v")]
    ends = np.cumsum([0, *(o.numel() for o in outputs)]).tolist()
    return ca.Function("f", arguments, ca.vertsplit(program.function(*arguments), ends))


def flat(terms):
    return [*terms[:4], *terms.base_rotations]


def relative(found, expected):
    found, expected = np.asarray(found).ravel(), np.asarray(expected).ravel()
    return float(np.max(np.abs(found - expected)) / np.max(np.abs(expected)))


@pytest.mark.parametrize("kernels", [True, False])
@pytest.mark.parametrize("elastic_integrals", [True, False])
def test_traced_equations_equal_computed_ones(modes, random_state, elastic_integrals, kernels):
    system = TrussDynamics(modes=modes, arms=(RobotArm.literal(),) * 4, elastic_integrals=elastic_integrals)
    function = traced(system, kernels=kernels)
    q, v = random_state(system)
    for found, expected in zip(function(q, v), flat(system.evaluate(q, v)), strict=True):
        assert relative(found, expected) < ROUND_OFF


@pytest.mark.parametrize(("joints", "modes"), [((3,) * 6, 2), ((2, 3), 1), ((1,), 0), ((2, 2), 0)])
def test_other_numbers_of_robots_joints_and_modes(random_system, random_state, joints, modes):
    system = random_system(joints, modes, elastic_integrals=True)
    assert system.joints == sum(joints)
    assert system.coordinates == 6 + sum(joints) + modes
    assert system.actuators == 6 * len(joints) + sum(joints)
    q, v = random_state(system)
    terms = system.evaluate(q, v)
    assert terms.mass_matrix.shape == (system.coordinates,) * 2
    assert terms.actuation_matrix.shape == (system.coordinates, system.actuators)
    function = traced(system, kernels=True)
    for found, expected in zip(function(q, v), flat(terms), strict=True):
        assert relative(found, expected) < ROUND_OFF


def test_equal_arms_share_one_kernel(modes):
    """Two kinds of arm, interleaved: two kernels."""
    a, b = RobotArm.literal(), RobotArm.jaco()
    system = TrussDynamics(modes=modes, arms=(a, b, a, b), elastic_integrals=True)
    assert system.groups == ((0, 2), (1, 3))
    q, v = symbol("q", (40,)), symbol("v", (40,))
    with tracing() as trace:
        system.evaluate(q, v)
    assert [call.inputs.size2() for call in trace.calls] == [2, 2]


def test_structural_zeros_survive_tracing(published):
    """Joints of different robots do not couple: their blocks are zeros, not expressions."""
    q = symbol("q", (40,))
    mass = ca.SX(published.mass_matrix(q))
    assert ca.sparsify(mass[6:13, 13:34]).nnz() == 0
    assert ca.sparsify(mass[6:13, 6:13]).nnz() > 40


def test_numbering_of_the_robots_does_not_matter(random_system, random_state):
    """Listing grasp points and arms in another order permutes rows and columns only."""
    system = random_system((2, 4, 3), 2, elastic_integrals=True)
    order = [2, 0, 1]
    modes = system.modes
    other = TrussDynamics(
        modes=replace(
            modes,
            grasp_positions=modes.grasp_positions[order],
            grasp_translations=modes.grasp_translations[order],
            grasp_rotations=modes.grasp_rotations[order],
        ),
        arms=tuple(system.arms[i] for i in order),
        elastic_integrals=True,
    )
    joints = [[6, 7], [8, 9, 10, 11], [12, 13, 14]]
    index = [*range(6), *joints[2], *joints[0], *joints[1], 15, 16]
    q, v = random_state(system)
    one, two = system.evaluate(q, v), other.evaluate(q[index], v[index])
    assert relative(two.mass_matrix, one.mass_matrix[np.ix_(index, index)]) < ROUND_OFF
    assert relative(two.bias, one.bias[index]) < ROUND_OFF


@pytest.mark.parametrize("elastic_integrals", [True, False])
def test_mass_matrix_is_symmetric_and_positive_definite(modes, random_state, elastic_integrals):
    for arm in (RobotArm.literal(), RobotArm.jaco()):
        system = TrussDynamics(modes=modes, arms=(arm,) * 4, elastic_integrals=elastic_integrals)
        for q in (system.rest, random_state(system)[0]):
            mass = system.mass_matrix(q)
            assert relative(mass, mass.T) < ROUND_OFF
            assert np.min(np.linalg.eigvalsh(mass)) > 1e-5


def test_position_and_attitude_do_not_enter_the_equations(consistent, random_state):
    """Space is homogeneous and isotropic."""
    q, v = random_state(consistent)
    moved = np.concatenate([q[:6] + 0.7, q[6:]])
    for one, two in zip(flat(consistent.evaluate(q, v)), flat(consistent.evaluate(moved, v)), strict=True):
        assert np.array_equal(one, two)


def test_bias_is_quadratic_in_the_speeds(published, random_state):
    q, v = random_state(published)
    assert not np.any(published.bias(q, 0.0 * v))
    assert relative(published.bias(q, 3.0 * v), 9.0 * published.bias(q, v)) < ROUND_OFF


def test_convenience_methods_are_parts_of_one_evaluation(consistent, random_state):
    q, v = random_state(consistent)
    terms = consistent.evaluate(q, v)
    assert np.array_equal(consistent.mass_matrix(q), terms.mass_matrix)
    assert np.array_equal(consistent.bias(q, v), terms.bias)
    assert np.array_equal(consistent.actuation_matrix(q), terms.actuation_matrix)


def test_elastic_force_is_that_of_damped_oscillators(published):
    """Free modes alone obey tau'' = -w² tau - 2 zeta w tau'."""
    system = replace(published, modes=published.modes.damped(0.005))
    w = 2.0 * np.pi * np.array([0.3593, 0.97, 1.4392, 2.0239, 2.6408, 4.7984])
    q, v = np.zeros(40), np.zeros(40)
    q[34:], v[34:] = np.arange(1.0, 7.0), np.arange(6.0, 0.0, -1.0)
    force = system.elastic_force(q, v)
    assert not np.any(force[:34])
    assert relative(force[34:], -(w**2) * q[34:] - 2 * 0.005 * w * v[34:]) < ROUND_OFF
    stiffer = system.elastic_force(q, v, 2 * system.modes.frequencies, np.full(6, 0.01))
    assert relative(stiffer[34:], -4 * (w**2) * q[34:] - 2 * 0.01 * 2 * w * v[34:]) < ROUND_OFF


def test_base_forces_push_the_whole_system(published, random_state):
    """A force on any base is the total force: the truss rows of P_Q are rotations."""
    q, _ = random_state(published)
    actuation = published.actuation_matrix(q)
    for i in range(4):
        rotation = actuation[:3, 6 * i : 6 * i + 3]
        assert np.max(np.abs(rotation.T @ rotation - np.eye(3))) < ROUND_OFF
        assert not np.any(actuation[:3, 6 * i + 3 : 6 * i + 6])
    assert np.array_equal(actuation[6:34, 24:], np.eye(28))
    assert not np.any(actuation[:6, 24:])
    assert not np.any(actuation[34:, 24:])


def test_rest_is_at_the_arms_rest_angles(modes):
    arms = (RobotArm.literal(), RobotArm.jaco(), RobotArm.literal(), RobotArm.jaco())
    rest = TrussDynamics(modes=modes, arms=arms, elastic_integrals=False).rest
    assert rest.shape == (40,)
    assert np.array_equal(rest[13:20], RobotArm.jaco().rest_angles)
    assert not np.any(rest[:13])


def test_one_arm_per_grasp_point(modes):
    with pytest.raises(ModelError, match="4 grasp points but 3 arms"):
        TrussDynamics(modes=modes, arms=(RobotArm.literal(),) * 3, elastic_integrals=False)


@pytest.mark.parametrize("method", ["evaluate", "bias", "kinematics", "elastic_force"])
def test_sizes_are_checked(published, method):
    with pytest.raises(ModelError, match=r"q has shape \(34,\); it must be \(40,\): 6 for the"):
        getattr(published, method)(np.zeros(34), np.zeros(40))
    with pytest.raises(ModelError, match=r"v has shape \(40, 1\); it must be \(40,\)"):
        getattr(published, method)(np.zeros(40), np.zeros((40, 1)))


@pytest.mark.parametrize("method", ["mass_matrix", "actuation_matrix", "grasp_displacement"])
def test_sizes_of_coordinates_alone_are_checked(published, method):
    with pytest.raises(ModelError, match=r"q has shape \(\); it must be \(40,\)"):
        getattr(published, method)(np.array(0.0))


@pytest.mark.parametrize("method", ["energy", "momentum"])
def test_sizes_are_checked_by_energy_and_momentum(published, method):
    with pytest.raises(ModelError, match="q has shape"):
        getattr(published, method)(np.zeros(41), np.zeros(40))
    with pytest.raises(ModelError, match="v has shape"):
        getattr(published, method)(np.zeros(40), np.zeros(41))
