"""Algebraic blocks compute what NumPy computes, and carry units through."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from trussflow.blocks import (
    Constant,
    Diagram,
    Function,
    Gain,
    Input,
    MatrixGain,
    Output,
    Sum,
)
from trussflow.blocks.errors import BlockError

ROUND_OFF = 1e-14  # relative: a few operations of 1e-16 each
u = np.array([1.0, -2.0, 4.0])
v = np.array([2.0, 5.0, 0.5])


@pytest.mark.parametrize(
    "block, inputs, expected",
    [
        (Gain(3.0), [u], 3.0 * u),
        (Gain(v), [u], v * u),
        (
            MatrixGain(np.arange(6.0).reshape(2, 3)),
            [u],
            np.arange(6.0).reshape(2, 3) @ u,
        ),
        (Sum("+-+"), [u, v, u], u - v + u),
    ],
)
def test_outputs_are_those_of_numpy(block, inputs, expected, evaluate):
    ports = [port.name for port in block.inputs()]
    y = evaluate(block, **dict(zip(ports, inputs, strict=True)))["y"]
    assert_allclose(y, expected, rtol=ROUND_OFF)


def test_gain_keeps_the_unit_unless_told_otherwise():
    diagram = Diagram()
    force, same, other = diagram.add(
        force=Constant(1.0, unit="N"),
        same=Gain(2.0),
        other=Gain(1e3, input_unit="N", output_unit="mN"),
    )
    force.y >> same.u
    same.y >> other.u
    assert same.y.unit == "N"
    assert other.y.unit == "mN"


def test_function_wraps_any_numpy_function(respond):
    block = Function(
        lambda force, velocity: (force @ velocity, np.cross(force, velocity)),
        inputs={"force": Input(3), "velocity": Input(3)},
        outputs={"power": Output(), "moment": Output(3)},
    )
    result = respond(block, 0.01, force=u, velocity=v)
    assert result["block.power"][0] == u @ v
    assert_allclose(result["block.moment"][0], np.cross(u, v), rtol=ROUND_OFF)
    assert_array_equal(respond(Function(np.abs), 0.01, u=u)["block.y"][0], np.abs(u))


def test_function_that_returns_too_little_is_refused(evaluate):
    block = Function(np.abs, {"u": Input()}, {"a": Output(), "b": Output()})
    with pytest.raises(
        BlockError, match="must return a tuple of 2 arrays, for: a, b; it returned"
    ):
        evaluate(block, u=1.0)
