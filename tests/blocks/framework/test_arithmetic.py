"""Port arithmetic: what is written with ports is what NumPy makes of their values."""

import operator
import pickle

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from trussflow.blocks import Constant, Diagram, Gain, Input, Operation, simulate
from trussflow.blocks.errors import BlockError, NameLookupError, WiringError

VALUES = {
    "a": 1.5,
    "b": -0.7,
    "v": [1.0, -2.0, 0.5],
    "w": [0.3, 0.4, -2.0],
    "m": [[1.0, 2.0, 3.0], [0.5, -1.0, 0.0]],
}
OPERATION_TOLERANCE = 1e-12
"""Round-off of some operations on numbers of size one."""

BINARY = [
    operator.add,
    operator.sub,
    operator.mul,
    operator.truediv,
    operator.lt,
    operator.ge,
    np.maximum,
    np.hypot,
]
UNARY = [
    operator.neg,
    abs,
    np.sin,
    np.tanh,
    lambda x: x**2,
    lambda x: 2.0 * x,
    lambda x: 1.0 / (3.0 + abs(x)),
]


def sources():
    diagram = Diagram("d")
    diagram.add(**{name: Constant(value) for name, value in VALUES.items()})
    return diagram


def value_of(port, backend="interpreted"):
    """Return the value of a port of constants."""
    return simulate(
        port.wiring_diagram(), 0.1, log={"y": port}, step=0.1, backend=backend
    )["y"].values[0]


@given(data=st.data())
def test_random_expressions_are_numpys(data):
    """Scalars and vectors broadcast, but in sums of two signals, which have one shape."""
    diagram = sources()
    pool = [(diagram.blocks[name].y, np.asarray(VALUES[name])) for name in "abvw"]
    for _ in range(data.draw(st.integers(1, 6))):
        port, value = data.draw(st.sampled_from(pool))
        if data.draw(st.booleans()):
            function = data.draw(st.sampled_from(UNARY))
            pool.append((function(port), function(value)))
            continue
        function = data.draw(st.sampled_from(BINARY))
        other, number = data.draw(st.sampled_from(pool))
        if function in (operator.add, operator.sub) and number.shape != value.shape:
            other = number = np.array(data.draw(st.floats(-2.0, 2.0)))
        with np.errstate(all="ignore"):
            pool.append((function(port, other), 1.0 * function(value, number)))
    assume(all(np.isfinite(value).all() for _, value in pool))
    port, expected = pool[-1]
    assert_allclose(
        value_of(port), expected, rtol=OPERATION_TOLERANCE, atol=OPERATION_TOLERANCE
    )


@pytest.mark.parametrize(
    "write, expected",
    [
        (lambda d: 1.0 - d.a, -0.5),
        (lambda d: d.v / 2, [0.5, -1.0, 0.25]),
        (lambda d: d.m @ d.v, [-1.5, 2.5]),
        (lambda d: np.eye(3)[:2] @ d.v, [1.0, -2.0]),
        (lambda d: d.m @ np.ones(3), [6.0, -0.5]),
        (lambda d: d.v @ d.w, -1.5),
        (lambda d: (d.v > 0.0) & (d.v < 0.7), [0.0, 0.0, 1.0]),
        (lambda d: ~(d.a > d.b) | (d.a >= 1.5), 1.0),
        (lambda d: 2.0**d.a, 2.0**1.5),
        (lambda d: d.a % 1.0, 0.5),
        (lambda d: -((d.a > 1.0) + (d.b < 1.0)), -2.0),
        (lambda d: d.a // 1.0, 1.0),
        (lambda d: d.v[0:2] * d.w[1:], [0.4, 4.0]),
    ],
)
def test_what_reads_as_a_formula(write, expected):
    for backend in ("interpreted", "numpy"):
        assert_allclose(
            value_of(write(sources()), backend), expected, rtol=OPERATION_TOLERANCE
        )


def test_units_follow():
    d = Diagram("d")
    force, arm, rate = d.add(
        force=Constant([1.0, 2.0], unit="N", frame="body"),
        arm=Constant(0.5, unit="m"),
        rate=Constant(1.0, unit="rad/s"),
    )
    assert [(2.0 * force.y).unit, (force.y / 3.0).frame, (force.y + 1.0).unit] == [
        "N",
        "body",
        "N",
    ]
    assert (arm.y * force.y).unit == "m*N"
    assert (arm.y * rate.y / arm.y).unit == "(m*(rad/s))/m"
    assert [(force.y > 1.0).unit, np.sin(arm.y).unit, (1.0 / arm.y).unit] == [
        None,
        None,
        None,
    ]
    (arm.y * force.y) >> d.add("motor", Gain(1.0, input_unit="N*m"))
    with pytest.raises(
        WiringError, match=r"unit 'm' does not fit 'N'(.|\n)*has its unit from"
    ):
        _ = force.y[0] > arm.y
    with pytest.raises(WiringError, match=r"shape \(\) does not fit \(2,\)"):
        force.y + arm.y
    assert not [name for name in d.blocks if name.startswith(("sum", "greater_2"))]


def test_shapes_that_wires_tell_later():
    d = Diagram("d")
    gain, other = d.add(gain=Gain(2.0), other=Gain(3.0))
    product = (gain.y * other.y) * d.add("k", Constant(0.5)).y
    with pytest.raises(
        WiringError, match="'matmul' needs operands of known shape: connect them first"
    ):
        gain.y @ other.y
    source = d.add("source", Constant([1.0, 2.0]))
    source >> gain
    source >> other
    assert_allclose(value_of(product), [3.0, 12.0], rtol=OPERATION_TOLERANCE)
    assert d.gain.y[1].wiring_diagram() is d


def test_what_is_computed_already_is_not_computed_again():
    """A cell of a notebook is run again."""
    d = sources()
    first, number = 2.0 * d.a - d.b, len(d.blocks)
    assert (2.0 * d.a - d.b) is not None
    assert (2.0 * d.a - d.b).block is first.block
    assert len(d.blocks) == number
    for other in (2.5 * d.a, d.a * 2.0, 2.0 * d.b, d.b - 2.0 * d.a):
        assert other.block is not first.block
    assert (d.v[0] * 1.0).block is (d.v[0] * 1.0).block
    assert (d.v[0] * 1.0).block is not (d.v[1] * 1.0).block


def test_constants_are_parameters():
    d = sources()
    y = 2.0 * d.a
    result = simulate(
        d, 0.1, step=0.1, parameters={"multiply_1.constant": 4.0}, log={"y": y}
    )
    assert result["y"].values[0] == 6.0


def test_operation_by_itself():
    d = sources()
    compare = d.add("compare", Operation(np.greater, Input(), 1.0))
    d.a >> compare
    assert value_of(compare.y) == 1.0
    both = pickle.loads(pickle.dumps(Operation(np.maximum)))
    assert [port.name for port in both.ports.values()] == ["u1", "u2", "y"]


@pytest.mark.parametrize(
    "build, message",
    [
        (
            lambda: Operation("^"),
            r"Operation has no function '\^'; give a universal function of NumPy",
        ),
        (lambda: Operation(np.divmod), "has no function <ufunc 'divmod'>"),
        (
            lambda: Operation(np.add, 1.0, 2.0),
            "takes 2 operands, at least one of them an Input",
        ),
        (lambda: Operation(np.logical_not, Input(), 2.0), "takes 1 operands"),
        (
            lambda: Operation(np.multiply, Input(3), Input(2)),
            r"'multiply' of shapes 3 and 2: operands could not be",
        ),
    ],
)
def test_operations_that_there_are_not(build, message):
    with pytest.raises(BlockError, match=message):
        build()


def test_what_is_no_arithmetic():
    d = sources()
    for attempt in (
        lambda: np.where(d.a, 1.0, 2.0),
        lambda: np.sum(d.v),
        lambda: np.add.reduce(d.v.y),
        lambda: np.divmod(d.a.y, 2.0),
        lambda: d.a.y << d.b.y,
        lambda: float(d.a.y),
    ):
        with pytest.raises(
            WiringError,
            match=r"cannot compute with the \w+ '\w(\.y)?' in this way: it is not a number",
        ):
            attempt()
    with pytest.raises(
        WiringError, match="the constant operand must be numeric, not 'x'"
    ):
        d.a * "x"
    two = d.add("two", Diagram("two"))
    gain, other = two.add(gain=Gain(1.0), other=Gain(1.0))
    two.expose(p=gain.y, q=other.y)
    with pytest.raises(NameLookupError, match="has 2 outputs"):
        two + 1.0
    with pytest.raises(
        WiringError, match=r"'c\.y' in diagram 'd': its block is in 'e'"
    ):
        d.a * Diagram("e").add("c", Constant(1.0))
    assert set(d.blocks) == {*VALUES, "two"}


@pytest.mark.parametrize("compare", [operator.eq, operator.ne])
@pytest.mark.parametrize(
    "combine", [operator.and_, operator.mul, operator.add, lambda a, b: b - a]
)
def test_identity_of_ports_is_no_operand(compare, combine):
    d = Diagram("d")
    port = d.add(a=Constant(1.0)).y
    assert {port: 1}[port] == 1
    with pytest.raises(WiringError, match=r"write np\.equal\(a, b\)"):
        combine(port > 0.5, compare(port, 1.0))
    assert value_of(np.equal(port, 1.0)) == 1.0
