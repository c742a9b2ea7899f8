"""Directional and adjoint derivatives equal the Jacobians of the graph."""

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from numpy.testing import assert_allclose
from systems import Ring, assert_near, ports

from trussflow.blocks import Block, Function, Input, Output, State
from trussflow.fmu.exporting.description.export_interface import ExportInterface

RELATIVE_TOLERANCE = 1e-12
"""Relative to the largest entry: the same derivatives, summed in another order."""


def jacobians(interface, x, u):
    """Return the Jacobian of (dx, y) with respect to (u, x), from CasADi."""
    programs = [
        interface.programs[name].function.expand() for name in ("derivative", "outputs")
    ]
    t, d, p = 0.0, np.asarray(u), interface.p
    blocks = []
    for f in programs:
        j = f.jacobian()(t, x, d, p, 0)
        blocks.append(np.hstack([np.asarray(j[2].full()), np.asarray(j[1].full())]))
    return np.vstack(blocks)


def check(one, interface, expected):
    """Compare products with Jacobian and transpose, relative to the largest entry, for random seeds."""
    unknown = [*interface.variables.derivatives, *interface.variables.outputs]
    known = [*interface.variables.inputs, *interface.variables.states]
    rows, columns = (
        [r for v in side for r in one.references[v.name]] for side in (unknown, known)
    )
    generator = np.random.default_rng(1)
    height, width = expected.shape
    allowed = RELATIVE_TOLERANCE * np.abs(expected).max()
    for _ in range(4):
        seed = generator.uniform(-1, 1, width)
        sizes = () if one.scalar else (height,)
        assert_near(
            one.getDirectionalDerivative(rows, columns, seed.tolist(), *sizes),
            expected @ seed,
            allowed,
        )
        if not one.scalar:
            weights = generator.uniform(-1, 1, height)
            back = one.getAdjointDerivative(rows, columns, weights.tolist(), width)
            assert_near(back, weights @ expected, allowed)


class Coupled(Ring):
    """A kernel in lanes, and a mass matrix that couples its results."""

    def derivative(self, t, x, u, p):
        forces = super().derivative(t, x, u, p)["x"]
        return {"x": np.linalg.solve(np.eye(7) + np.outer(x.x, x.x), forces)}


def test_kernel_and_mass_matrix(version, exported, instance):
    interface, x = ExportInterface.of(Coupled()), np.linspace(0.1, 0.9, 7)
    one = instance(exported(Coupled(), version)).start({"push": 0.7, "x": x})
    check(one, interface, jacobians(interface, x, [0.7]))


def test_during_initialization_states_follow_parameters(exported, instance, systems):
    """The output is the state, and the state is the parameter: the derivative is one."""
    block = systems.Oscillator(3)
    one = instance(exported(block, "2.0", "three"))
    one.setupExperiment()
    one.enterInitializationMode()
    names = ("position[2]", "position[1]", "q[2]", "der(v[2])", "initial_position[2]")
    *unknown, known = (one.references[name][0] for name in names)
    assert one.getDirectionalDerivative(unknown, [known], [2.0]) == [
        2.0,
        0.0,
        2.0,
        -2 * (4.0 + 3 * 0.5),
    ]
    one = instance(exported(block, "3.0", "three"))
    one.enterInitializationMode()
    places = one.references["position"], one.references["initial_position"]
    assert one.getAdjointDerivative(*places, [1.0, 2.0, 3.0], 3) == [1.0, 2.0, 3.0]


def two(a, b):
    """Return every operation at points where all are smooth."""
    return [
        a + b,
        a - b,
        a * b,
        a / b,
        -a,
        a**2,
        a + a,
        1 / a,
        np.sin(a),
        np.cos(a),
        np.tan(a),
        np.exp(a),
        np.log(a),
        a**b,
        a**1.7,
        np.sqrt(a),
        np.arcsin(a),
        np.arccos(a),
        np.arctan(a),
        np.arctan2(a, b),
        np.sinh(a),
        np.cosh(a),
        np.tanh(a),
        np.arcsinh(a),
        np.arccosh(1 + b),
        np.arctanh(a),
        np.log1p(a),
        np.expm1(a),
        np.hypot(a, b),
        np.abs(-a),
        np.sign(a) * a,
        np.minimum(a, b),
        np.maximum(a, b),
        np.floor(a) + a,
        np.ceil(a) * b,
        np.fmod(b, a),
        np.where(a < b, a * b, b),
        np.where(np.logical_and(a > b, b > 0), a, b * b),
        np.copysign(a, -b),
    ]


class Everything(Block):
    """All operations, at points where they are smooth."""

    u = Input(2)
    y = Output(len(two(0.3, np.float64(0.6))))
    state = State(initial=0.3)

    def output(self, t, x, u, p):
        return {"y": np.stack(two(u.u[0] * x.state / 0.3, u.u[1]))}

    def derivative(self, t, x, u, p):
        return {"state": u.u[0] * x.state}


def test_all_operations(exported, instance):
    """Each operation of the code generator, differentiated by C and by CasADi."""
    u = [0.6, 0.7]
    interface = ExportInterface.of(Everything(), start={"u": u})
    expected = jacobians(interface, [0.3], u)
    one = instance(exported(Everything(), "2.0", start={"u": u})).start(
        {"u": u, "state": 0.3}
    )
    rows = one.references["der(state)"] + one.references["y"]
    for column, reference in enumerate(one.references["u"] + one.references["state"]):
        found = one.getDirectionalDerivative(rows, [reference], [1.0])
        assert_allclose(found, expected[:, column], rtol=1e-13, atol=1e-14)


BEYOND = [
    np.sqrt,
    np.log,
    np.arccosh,
    lambda a: a**0.5,
    lambda a: a**-1.5,
    lambda a: 1 / a,
    lambda a: np.arctan2(a, a),
    lambda a: np.hypot(a, a),
    lambda a: np.arcsin(1 + a),
    lambda a: np.arccos(1 + a),
    lambda a: np.arctanh(1 + a),
    lambda a: np.exp(1 / a),
    lambda a: np.sqrt(np.log(a)),
]
"""Functions that have no finite slope at zero, or below."""


class Branches(Block):
    """Each of them above zero, and below a line of slope one; and a state that must stop at zero."""

    x, z = State(), State(initial=0.5)
    y = Output(len(BEYOND))

    def output(self, t, x, u, p):
        return {
            "y": np.stack(
                [np.where(x.x > 0.0, f(x.x) * x.z, x.x) + 2 * x.z for f in BEYOND]
            )
        }

    def derivative(self, t, x, u, p):
        size = np.abs(x.x)
        return {
            "x": np.where(size > 0.0, -np.sign(x.x) * size**0.5, -x.x) + x.z,
            "z": -x.z,
        }


@pytest.mark.parametrize("point", [0.0, -0.25])
def test_branches_that_are_not_taken_add_nothing(version, point, exported, instance):
    """Infinite slopes there, times seeds of zero, made NaN of all."""
    expected = np.vstack([[-1, 1], [0, -1], *[[1, 2]] * len(BEYOND)])
    one = instance(exported(Branches(), version)).start({"x": point})
    check(one, ExportInterface.of(Branches()), expected)


def test_slopes_that_are_infinite_are_refused(version, exported, instance):
    block = Function(np.sqrt, **ports(u=(), y=()))
    one = instance(exported(block, version, "root")).start()
    sizes = () if one.scalar else (1,)
    with pytest.raises(FMICallException, match="status 2"):
        one.getDirectionalDerivative(
            one.references["y"], one.references["u"], [1.0], *sizes
        )
    assert one.log == [(2, "a partial derivative is not finite at 0")]
