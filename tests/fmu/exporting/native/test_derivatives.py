"""Directional and adjoint derivatives equal the Jacobians of the graph."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from trussflow.blocks import Block, Function, Input, Output, State
from trussflow.fmu.exporting.description.export_interface import ExportInterface

EXACT = 1e-12
"""Relative to the largest entry: the same derivatives, summed in another order."""


def jacobians(interface, x, u):
    """Return the Jacobian of (dx, y) with respect to (u, x), from CasADi."""
    programs = [interface.programs[name].function.expand() for name in ("derivative", "outputs")]
    t, d, p = 0.0, np.asarray(u), interface.p
    blocks = []
    for f in programs:
        j = f.jacobian()(t, x, d, p, 0)
        blocks.append(np.hstack([np.asarray(j[2].full()), np.asarray(j[1].full())]))
    return np.vstack(blocks)


def check(fmu, interface, expected, tolerance, *, scalar):
    """Compare products with the Jacobian and its transpose, for random seeds."""
    unknown = [*interface.variables.derivatives, *interface.variables.outputs]
    known = [*interface.variables.inputs, *interface.variables.states]
    rows = [r for v in unknown for r in (v.references if scalar else [v.reference])]
    columns = [r for v in known for r in (v.references if scalar else [v.reference])]
    generator = np.random.default_rng(1)
    height, width = expected.shape
    for _ in range(4):
        seed = generator.uniform(-1, 1, width)
        sizes = () if scalar else (height,)
        found = np.array(fmu.getDirectionalDerivative(rows, columns, seed.tolist(), *sizes))
        product = expected @ seed
        assert np.abs(found - product).max() <= tolerance * np.abs(product).max()
        if not scalar:
            weights = generator.uniform(-1, 1, height)
            back = np.array(fmu.getAdjointDerivative(rows, columns, weights.tolist(), width))
            product = weights @ expected
            assert np.abs(back - product).max() <= tolerance * np.abs(product).max()


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_small_block(version, exported, tmp_path, fmi, systems):
    block = systems.Oscillator(3)
    interface = ExportInterface.of(block)
    q, u = np.array([0.4, -0.9, 1.3]), np.array([0.1, -0.2, 0.3])
    expected = jacobians(interface, np.concatenate([q, np.zeros(3)]), u)
    with fmi.opened(exported(block, version, "three"), "cs", tmp_path) as fmu:
        start = {v.name: v.reference for v in interface.variables}
        fmi.started(fmu, {start["force"]: u, start["initial_position"]: q})
        check(fmu, interface, expected, EXACT, scalar=version == "2.0")


@pytest.fixture(scope="module")
def bent(plant):
    """Return a bent plant under load: its interface, coordinates, inputs and Jacobian."""
    interface = ExportInterface.of(plant)
    generator = np.random.default_rng(3)
    q, u = generator.uniform(-0.5, 0.5, plant.n), generator.uniform(-1, 1, plant.actuators)
    return interface, q, u, jacobians(interface, np.concatenate([q, np.zeros(plant.n)]), u)


def test_plant(plant_fmu, bent, tmp_path, fmi):
    """Accelerations are solved for with a mass matrix of condition number 1e8.

    CasADi's own Jacobians, made in three ways, differ by up to 4e-12 of the largest entry.
    """
    interface, q, u, expected = bent
    with fmi.opened(plant_fmu, "cs", tmp_path) as fmu:
        start = {v.name: v.reference for v in interface.variables}
        fmi.started(fmu, {start["actuation"]: u, start["initial_coordinates"]: q})
        check(fmu, interface, expected, 1e-11, scalar=plant_fmu.name.endswith("2.0.fmu"))


def test_during_initialization_states_follow_parameters(exported, tmp_path, fmi, systems):
    """The output is the state, and the state is the parameter: the derivative is one."""
    block = systems.Oscillator(3)
    interface = ExportInterface.of(block)
    places = {v.name: v.reference for v in interface.variables}
    output, parameter = places["position"] + 1, places["initial_position"] + 1
    with fmi.opened(exported(block, "2.0", "three"), "cs", tmp_path) as fmu:
        fmu.setupExperiment(startTime=0.0)
        fmu.enterInitializationMode()
        found = fmu.getDirectionalDerivative(
            [output, places["position"], places["q"] + 1, places["der(v)"] + 1], [parameter], [2.0]
        )
        assert found == [2.0, 0.0, 2.0, -2 * (4.0 + 3 * 0.5)]
    with fmi.opened(exported(block, "3.0", "three"), "cs", tmp_path) as fmu:
        fmu.enterInitializationMode(startTime=0.0)
        found = fmu.getAdjointDerivative(
            [places["position"]], [places["initial_position"]], [1.0, 2.0, 3.0], 3
        )
        assert found == [1.0, 2.0, 3.0]


def test_all_operations(exported, tmp_path, fmi):
    """Each operation that the code generator knows, differentiated by C and by CasADi."""
    u = np.array([0.6, 0.7])
    interface, x = ExportInterface.of(Everything(), start={"u": u}), np.array([0.3])
    expected = jacobians(interface, x, u)
    places = {v.name: v.reference for v in interface.variables}
    path = exported(Everything(), "2.0", "everything", start={"u": u})
    with fmi.opened(path, "cs", tmp_path) as fmu:
        fmi.started(fmu, {places["u"]: u, places["state"]: x})
        for column, reference in enumerate([places["u"], places["u"] + 1, places["state"]]):
            rows = [places["der(state)"], *range(places["y"], places["y"] + OPERATION_COUNT)]
            found = fmu.getDirectionalDerivative(rows, [reference], [1.0])
            np.testing.assert_allclose(found, expected[:, column], rtol=1e-13, atol=1e-14)


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


OPERATION_COUNT = len(two(np.float64(0.3), np.float64(0.6)))


def _everything():
    class Everything(Block):
        u = Input(2)
        y = Output(OPERATION_COUNT)
        state = State(initial=0.3)

        def output(self, t, x, u, p):
            return {"y": np.stack(two(u.u[0] * x.state / 0.3, u.u[1]))}

        def derivative(self, t, x, u, p):
            return {"state": u.u[0] * x.state}

    return Everything


Everything = _everything()


BEYOND: list[Callable[[Any], Any]] = [
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
        return {"y": np.stack([np.where(x.x > 0.0, f(x.x) * x.z, x.x) + 2 * x.z for f in BEYOND])}

    def derivative(self, t, x, u, p):
        size = np.abs(x.x)
        return {"x": np.where(size > 0.0, -np.sign(x.x) * size**0.5, -x.x) + x.z, "z": -x.z}


@pytest.mark.parametrize("version", ["2.0", "3.0"])
@pytest.mark.parametrize("point", [0.0, -0.25])
def test_branches_that_are_not_taken_add_nothing(version, point, exported, tmp_path, fmi):
    """Infinite slopes there, times seeds of zero, made NaN of all."""
    block = Branches()
    expected = np.vstack([[-1, 1], [0, -1], *[[1, 2]] * len(BEYOND)])
    interface = ExportInterface.of(block)
    with fmi.opened(exported(block, version, "branches"), "cs", tmp_path) as fmu:
        fmi.started(fmu, {interface.variables.states[0].reference: point})
        check(fmu, interface, expected, EXACT, scalar=version == "2.0")


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_slopes_that_are_infinite_are_not_called_good(version, exported, tmp_path, fmi):
    log: list[str] = []
    block = Function(np.sqrt, {"u": Input()}, {"y": Output()})
    places = {v.name: v.reference for v in ExportInterface.of(block).variables}
    with fmi.opened(exported(block, version, "root"), "cs", tmp_path, log) as fmu:
        fmi.started(fmu)
        sizes = () if version == "2.0" else (1,)
        with pytest.raises(FMICallException, match="status 2"):
            fmu.getDirectionalDerivative([places["y"]], [places["u"]], [1.0], *sizes)
    assert log == ["a partial derivative is not finite at 0"]
