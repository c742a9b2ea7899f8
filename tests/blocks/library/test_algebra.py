"""Algebraic blocks compute what NumPy computes, and carry units through."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from trussflow.blocks import (
    BlockError,
    Concatenate,
    Constant,
    Diagram,
    Function,
    Gain,
    Input,
    MatrixGain,
    Output,
    ParameterError,
    Product,
    Select,
    Sum,
    Terminator,
    WiringError,
    simulate,
)

ROUND_OFF = 1e-14  # relative: a few operations of 1e-16 each
Evaluate = Callable[..., dict[str, Any]]
u = np.array([1.0, -2.0, 4.0])
v = np.array([2.0, 5.0, 0.5])


def test_gain_multiplies_element_by_element(evaluate):
    np.testing.assert_array_equal(evaluate(Gain(3.0), u=u)["y"], 3.0 * u)
    np.testing.assert_array_equal(evaluate(Gain(v), u=u)["y"], v * u)


def test_gain_keeps_the_unit_unless_told_otherwise():
    diagram = Diagram()
    force, same, other = diagram.add(
        force=Constant(1.0, unit="N"), same=Gain(2.0), other=Gain(1e3, input_unit="N", output_unit="mN")
    )
    force.y >> same.u
    same.y >> other.u
    assert same.y.unit == "N"
    assert other.y.unit == "mN"


def test_matrix_gain_multiplies_by_the_matrix(evaluate):
    K = np.arange(6.0).reshape(2, 3)
    np.testing.assert_array_equal(evaluate(MatrixGain(K), u=u)["y"], K @ u)


def test_sum_adds_and_subtracts(evaluate):
    found = evaluate(Sum("+-+"), u1=u, u2=v, u3=u)["y"]
    np.testing.assert_array_equal(found, u - v + u)


def test_product_multiplies_and_divides(evaluate):
    found = evaluate(Product("*/*"), u1=u, u2=v, u3=u)["y"]
    np.testing.assert_allclose(found, u / v * u, rtol=ROUND_OFF)
    np.testing.assert_allclose(evaluate(Product("/"), u1=v)["y"], 1.0 / v, rtol=ROUND_OFF)


def test_product_derives_its_unit():
    diagram = Diagram()
    product, power = diagram.add(
        product=Product("**/", units=("N", "m", "s")), power=Gain(1.0, input_unit="W")
    )
    product.y >> power.u  # N m / s are watts; the wire checks it
    other = diagram.add(other=Gain(1.0, input_unit="N"))
    with pytest.raises(WiringError, match="does not fit 'N'"):
        product.y >> other.u


def test_select_picks_elements(evaluate):
    block = Select([2, 0, -1], size=3)
    np.testing.assert_array_equal(evaluate(block, u=u)["y"], [4.0, 1.0, 4.0])


def test_concatenate_keeps_order_and_units(evaluate):
    block = Concatenate([2, 3], units=("m", "rad"))
    np.testing.assert_array_equal(evaluate(block, u1=v[:2], u2=u)["y"], [*v[:2], *u])
    assert block.y.unit == ("m", "m", "rad", "rad", "rad")


def test_function_wraps_any_numpy_function(respond):
    block = Function(
        lambda force, velocity: (force @ velocity, np.cross(force, velocity)),
        inputs={"force": Input(3), "velocity": Input(3)},
        outputs={"power": Output(), "moment": Output(3)},
    )
    result = respond(block, 0.01, force=u, velocity=v)
    assert float(result["block.power"][0]) == u @ v
    np.testing.assert_allclose(result["block.moment"][0], np.cross(u, v), rtol=ROUND_OFF)
    np.testing.assert_array_equal(respond(Function(np.abs), 0.01, u=u)["block.y"][0], np.abs(u))


def test_terminator_takes_any_signal(respond):
    result = respond(Terminator(), 0.01, u=Constant(u, unit="N", frame="truss"))
    assert set(result) == {"u_source.y"}


def test_select_refuses_what_does_not_fit_once_wired():
    def run(value):
        diagram = Diagram()
        source, block = diagram.add(source=Constant(value), select=Select([3]))
        source.y >> block.u
        simulate(diagram, 1.0, step=1.0, backend="numpy")

    with pytest.raises(BlockError, match="element 3 of a vector of size 3; indices go from 0 to 2"):
        run(u)
    with pytest.raises(BlockError, match=r"'select' picks .* vector; its input has shape \(\)"):
        run(1.0)


def test_function_that_returns_too_little_is_refused(evaluate):
    block = Function(np.abs, {"u": Input()}, {"a": Output(), "b": Output()})
    with pytest.raises(BlockError, match="must return a tuple of 2 arrays, for: a, b; it returned"):
        evaluate(block, u=1.0)


@pytest.mark.parametrize(
    ("build", "error", "message"),
    [
        (lambda: Gain(np.eye(2)), BlockError, r"gain of shape \(2, 2\); .* use MatrixGain\(K\)"),
        (lambda: Gain(u, shape=2), ParameterError, r"'gain' of Gain has shape \(3,\), but .* \(2,\)"),
        (lambda: MatrixGain(2.0), BlockError, r"MatrixGain needs a matrix; got shape \(\)"),
        (lambda: Product("*+"), BlockError, r"Product needs operations such as .* got '\*\+'"),
        (
            lambda: Product("**", units=("N",)),
            BlockError,
            "Product has 2 inputs; give a list of as many units",
        ),
        (lambda: Select([]), BlockError, "Select needs at least one index"),
        (lambda: Select([5], size=3), BlockError, "element 5 of a vector of size 3"),
        (lambda: Concatenate([]), BlockError, "Concatenate needs the size of at least one input"),
        (lambda: Concatenate([1, 2], units=("N",)), BlockError, "2 inputs; give a list of as many units"),
        (
            lambda: Function(np.abs, {"u": 3}),  # type: ignore[dict-item]
            BlockError,
            r"input 'u' must be an Input\(...\), not 3",
        ),
        (lambda: Function(np.abs, {"u": Input()}, {"u": Output()}), BlockError, "an input and as"),
        (lambda: Function(np.abs, outputs={}), BlockError, "Function needs at least one output"),
    ],
)
def test_nonsense_is_refused(build, error, message):
    with pytest.raises(error, match=message):
        build()
