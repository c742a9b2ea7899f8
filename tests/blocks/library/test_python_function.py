"""Python functions run as they are, at their samples."""

import pickle

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import assert_near, ports, ring

from trussflow.blocks import (
    Constant,
    Diagram,
    Function,
    Input,
    Integrator,
    Output,
    PythonFunction,
    Ramp,
    as_block,
    simulate,
)
from trussflow.blocks.errors import BlockError, WiringError


def decide(u, v):
    """Do what cannot be traced."""
    if u > 0.25:
        return v, float("".join(["4", "2"]))
    return -v, 0.0


def test_function_may_do_anything(respond):
    block = PythonFunction(
        decide,
        0.1,
        inputs={"u": Input(), "v": Input(2)},
        outputs={"y": Output(2), "n": Output()},
    )
    result = respond(block, 0.5, {"log_step": 0.1}, u=Ramp(), v=[1.0, 2.0])
    signs = np.array([-1, -1, -1, 1, 1, 1])
    assert_array_equal(result["block.y"], np.outer(signs, [1.0, 2.0]))
    assert_array_equal(result["block.n"], np.where(signs > 0, 42.0, 0.0))


FOURTH_ORDER = 1e-7
"""Of RK4 with steps of 0.01 s, of a lag of 1 s; SciPy's solvers keep to their own tolerance."""


@pytest.mark.parametrize(
    "settings",
    [{"step": 0.01}, {"step": 0.01, "backend": "numpy"}, {"solver": "DOP853"}],
)
def test_continuous_function_without_memory(settings):
    """A lag whose law is Python: exact, in a loop, with its slope in linear models."""
    diagram = ring(
        "lag",
        law=PythonFunction(lambda u: float(str(float(-u))), **ports(u=(), y=())),
        lag=Integrator(1.0),
    )
    result = simulate(diagram, 2.0, **settings)
    assert_near(result["lag.y"], np.exp(-result["time"]), FOURTH_ORDER)
    assert_array_equal(result["law.y"], -result["lag.y"])


@as_block
def doubled(u):
    return 2.0 * u


def test_decorated_function_can_be_pickled():
    """As sweeps over processes do, and FMUs."""
    assert pickle.loads(pickle.dumps(doubled()))._function(3.0) == 6.0


def test_argument_of_a_decorated_function_may_be_y():
    @as_block
    def turned(x, y):
        return x - 2.0 * y

    diagram = Diagram("both")
    x, y = diagram.add(x=Constant(5.0), y=Constant(1.0))
    turned(x, y)
    assert simulate(diagram, 0.1, step=0.1)["turned_1.value"][0] == 3.0


def test_shapes_of_a_decorated_function_are_those_of_its_ports():
    """Each its own; what the function returns has a shape of its own, too."""
    diagram = Diagram("shapes")
    vector, number, matrix = diagram.add(
        vector=Constant([1.0, 2.0]),
        number=Constant(3.0),
        matrix=Constant(np.diag([2.0, 4.0])),
    )
    total = as_block(lambda x, y: np.concatenate([x, np.stack([y])]).sum())(
        vector, number
    )
    solved = as_block(lambda a, b: np.linalg.solve(a, b))(matrix, vector)
    assert (total.value.shape, solved.y.shape) == ((), (2,))
    result = simulate(diagram, 0.1, step=0.1)
    assert result["function_1.value"][0] == 6.0
    assert_array_equal(result["function_2.y"][0], [0.5, 0.5])
    with pytest.raises(
        BlockError, match=r"<lambda> of arrays of shapes \[\(2,\), \(2, 2\)\]: .*index"
    ):
        as_block(lambda x, m: x[3] * m)(vector, matrix)


def test_decorated_functions_are_blocks():
    @as_block
    def limited(u, gain=3.0):
        return np.clip(gain * u, -1.0, 1.0)

    @as_block(
        force=Input(3, unit="N"), velocity=Input(3, unit="m/s"), power=Output(unit="W")
    )
    def power(force, velocity):
        return force @ velocity

    @as_block(traced=False, sample_time=0.5)
    def decided(u):
        return 1.0 if u > 0.4 else 0.0

    diagram = Diagram("decorated")
    ramp, force = diagram.add(ramp=Ramp(), force=Constant([1.0, 2.0, 3.0]))
    (2.0 * limited(ramp) + decided(ramp.y)) >> diagram.add("sum", Integrator())
    assert (power(force, force).power.unit, limited.__name__) == ("W", "limited")
    assert isinstance(diagram.add("own", limited()), Function)
    ramp >> diagram.own
    result = simulate(diagram, 1.0, step=0.1)
    assert_array_equal(result["own.y"], result["limited_1.y"])
    assert_array_equal(result["decided_1.y"], np.arange(11) >= 5)
    assert result["power_1.power"][0] == 14.0
    # a lambda has no name
    assert as_block(lambda x: 2.0 * x)(ramp).path == "function_1"
    with pytest.raises(
        WiringError,
        match=r"power takes 2 ports \(force, velocity\), or none, not \(<output",
    ):
        power(force.y)
    with pytest.raises(
        WiringError, match=r"limited takes 1 ports \(u\), or none, not \(1\.0,\)"
    ):
        limited(1.0)
    with pytest.raises(
        BlockError, match="as_block makes blocks of functions, not of 3"
    ):
        as_block(3)
