"""Properties of the equations as such: traced like computed, symmetric, sizes, messages."""

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import assert_near

from trussflow.blocks.tracing.kernels import symbol, to_expression, tracing
from trussflow.blocks.tracing.program import lower
from trussflow.models import ModelError, RobotArm, TrussDynamics

# Two orders of evaluation of the same expressions.
ROUND_OFF = 1e-12


def flat(terms):
    return [*terms[:4], *terms.base_rotations]


def assert_traced_equals_computed(system, q, v, *, kernels=True):
    symbols = symbol("q", q.shape), symbol("v", v.shape)
    with tracing() as trace:
        if kernels:
            terms = flat(system.evaluate(*symbols))
    if not kernels:
        terms = flat(system.evaluate(*symbols))
    outputs = ca.vertcat(*map(to_expression, terms))
    program = lower("f", [to_expression(s) for s in symbols], outputs, trace)
    expected = [np.ravel(term) for term in flat(system.evaluate(q, v))]
    ends = np.cumsum([part.size for part in expected])
    parts = np.split(np.asarray(program.function(q, v)).ravel(), ends)
    for traced, computed in zip(parts, expected, strict=False):
        scale = np.max(np.abs(computed), initial=0.0)
        assert_near(traced, computed, ROUND_OFF * scale)
    return trace


@pytest.mark.parametrize("kernels, elastic_integrals", [(True, True), (False, False)])
def test_traced_equations_equal_computed_ones(
    random_system, random_state, arrangement, kernels, elastic_integrals
):
    system = random_system(*arrangement, elastic_integrals=elastic_integrals)
    assert_traced_equals_computed(system, *random_state(system), kernels=kernels)


def test_equal_arms_share_one_kernel(modes, random_state):
    """Two kinds of arm, interleaved: two kernels."""
    a, b = RobotArm.literal(), RobotArm.jaco()
    system = TrussDynamics(modes=modes, arms=(a, b, a, b), elastic_integrals=True)
    assert system.groups == ((0, 2), (1, 3))
    trace = assert_traced_equals_computed(system, *random_state(system))
    assert [call.inputs.size2() for call in trace] == [2, 2]
    assert_array_equal(
        system.rest,
        np.concatenate(
            [np.zeros(6), *(2 * [a.rest_angles, b.rest_angles]), np.zeros(6)]
        ),
    )


def test_structural_zeros_survive_tracing(published):
    """Joints of different robots do not couple: their blocks are zeros, not expressions."""
    mass = ca.SX(published.evaluate(symbol("q", (40,))).mass_matrix)
    assert ca.sparsify(mass[6:13, 13:34]).nnz() == 0
    assert ca.sparsify(mass[6:13, 6:13]).nnz() > 40


def test_one_arm_per_grasp_point(modes):
    with pytest.raises(ModelError, match="4 grasp points but 3 arms"):
        TrussDynamics(
            modes=modes, arms=(RobotArm.literal(),) * 3, elastic_integrals=False
        )


@pytest.mark.parametrize(
    "method", ["evaluate", "kinematics", "elastic_force", "momentum"]
)
def test_sizes_are_checked(published, method):
    with pytest.raises(
        ModelError, match=r"q has shape \(34,\); it must be \(40,\): 6 for the"
    ):
        getattr(published, method)(np.zeros(34), np.zeros(40))
    with pytest.raises(ModelError, match=r"v has shape \(40, 1\); it must be \(40,\)"):
        getattr(published, method)(np.zeros(40), np.zeros((40, 1)))


@pytest.mark.parametrize("method", ["evaluate", "grasp_displacement"])
def test_sizes_of_coordinates_alone_are_checked(published, method):
    with pytest.raises(ModelError, match=r"q has shape \(\); it must be \(40,\)"):
        getattr(published, method)(np.array(0.0))
