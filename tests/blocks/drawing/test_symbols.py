"""Symbols of blocks: numbers, polynomials and texts say what the block computes."""

import functools
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
import systems
from hypothesis import given
from hypothesis import strategies as st
from systems import series

from trussflow.blocks import (
    PD,
    PID,
    Block,
    Constant,
    Diagram,
    DisturbanceObserver,
    Function,
    Gain,
    Input,
    IntegralSlidingMode,
    Integrator,
    Operation,
    Output,
    Parameter,
    Relay,
    Saturation,
    StateSpace,
    Step,
    Sum,
    Symbol,
    Table,
    TransferFunction,
    TransportDelay,
    VariableDelay,
)
from trussflow.blocks.errors import DiagramError
from trussflow.blocks.framework.symbol import number, polynomial, value_text

SVG = "{http://www.w3.org/2000/svg}"


def value(text, **variables):
    """Return the number of a text with superscripts, minus signs and products without a sign."""
    text = text.replace("−", "-").replace("·", "*").replace("^(", "**(")
    return eval(re.sub(r"(?<=[\d)]) (?=[a-z])", "*", text), {}, variables)


@given(st.floats(-1e90, 1e90))
def test_number_has_four_digits(exact):
    assert value(number(exact)) == pytest.approx(exact, rel=5e-4, abs=1e-300)


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=4), st.floats(-2.0, 2.0))
def test_polynomial_is_that_of_its_coefficients(coefficients, s):
    rounded = [float(f"{c:.4g}") for c in coefficients]
    text = polynomial(coefficients, "s")
    if not text.startswith("order"):
        exact = np.polyval(rounded, s)
        scale = np.polyval(np.abs(rounded), abs(s)) + 1e-300
        assert abs(value(text, s=s) - exact) <= 1e-12 * scale


def test_large_values_are_named_by_their_size():
    assert value_text(np.eye(2)) == "[1 0; 0 1]"
    assert value_text(np.arange(30.0)) == "30 values"
    assert value_text(np.ones((4, 5)), "K") == "K"
    assert value_text(np.full(30, 2.5)) == "2.5"
    assert polynomial(np.arange(1.0, 40.0), "s") == "order 38 in s"
    assert value_text(1e300) == "∞"


def drawn(block):
    """Return the texts of a picture of a `block`, superscripts on the line."""
    diagram = series(own=block)
    root = ET.fromstring(diagram.draw())
    for title in root.iter(f"{SVG}title"):
        title.text = ""
    return ["".join(text.itertext()) for text in root.iter(f"{SVG}text")]


class Spring(Block):
    """A block with a symbol of its own."""

    x = Input()
    force = Output()
    stiffness = Parameter(4.0, unit="N/m")
    _symbol = Symbol("{stiffness} x^(<1>)", caption="soft & <linear>")


class Private(systems.Ball):
    """A block with an equation that says nothing."""

    def derivative(self, t, x, u, p):
        """Return the rates."""
        return {"z": self._rate(x), "v": -9.5}


def long_law_of_many_inputs(stress, strain, time):
    total = stress + strain
    return total + time


def one_line(u):
    """Return a difference."""
    return u - np.sin(u)


def two_lines(u):
    double = 2.0 * u
    return double + u


def with_a_loop(u):
    for _ in range(3):
        u = u * u
    return u


@functools.wraps(one_line)
def doubled(u):
    return 2.0 * one_line(u)


@(lambda function: function)
def decorated(u):
    return 3.0 * u + 1.0


@pytest.mark.parametrize(
    "block, texts",
    [
        (Gain(-2.5e-6), ["−2.5·10−6"]),
        (Constant([1.0, -2.0], unit="m/s**2"), ["[1 −2] m/s²"]),
        (Integrator(3.0), ["1", "s", "from 3"]),
        (TransferFunction([2.0], [1.0, 0.5, 4.0]), ["2", "s2 + 0.5·s + 4"]),
        (
            StateSpace([[0.0, 1.0], [-4.0, -0.2]], [0.0, 1.0], [1.0, 0.0]),
            ["ẋ = [0 1; −4 −0.2] x + [0 1] u", "y = [1 0] x + 0 u"],
        ),
        (
            StateSpace(np.diag(np.arange(1.0, 10.0)), np.ones(9), np.ones(9)),
            ["ẋ = A x + [1 1 1 1 1 1 1 1 1] u"],
        ),
        (TransportDelay(0.25), ["e−0.25·s"]),
        (VariableDelay(0.25, 1.0), ["e−τ·s"]),
        (Saturation(-1.0, 2.0), ["limits −1, 2"]),
        (PID(3.0, 2.0, 0.5), ["3 + 2/s + 0.5·s"]),
        (PID(3.0, -2.0), ["3 − 2/s"]),
        (PID(0.0), ["0"]),
        (Function(np.tanh), ["tanh(u)"]),
        (
            Function(
                long_law_of_many_inputs,
                inputs={name: Input() for name in ("stress", "strain", "time")},
            ),
            ["total = stress + strain", "total + time"],
        ),
        (Function(lambda u: -3.0 * u**2), ["−3·u2"]),
        (Function(one_line), ["u − sin(u)"]),
        (Function(two_lines), ["double = 2·u", "double + u"]),
        (Function(with_a_loop), ["with_a_loop(u)"]),
        (Function(decorated), ["3·u + 1"]),
        (Function(doubled), ["one_line(u)"]),
        (Function(eval("lambda u: u")), ["f(u)"]),
        (DisturbanceObserver(2.0), ["d̂ = z + 2 v", "ż = −2 (d̂ + a)"]),
        (PD(3.0, 2.0), ["−3 e − 2 ė"]),
        (
            IntegralSlidingMode(
                gamma=2.0, mu=3.0, beta=0.9, eta=4.0, sigma=5.0, boundary_layer=0.1
            ),
            ["e = x − x_d, s = ė + ∫(2 sgnβė + 3 sgnβ′e) dt"],
        ),
        (Operation(np.subtract, 3.0, Input()), ["3 − u"]),
        (Operation(np.divide, Input(), Input()), ["u1 / u2", "u1", "u2"]),
        (Operation(np.multiply, 2.5, Input()), ["2.5"]),
        (Operation(np.multiply), ["×"]),
        (Operation(np.arctan2), ["arctan2(u1, u2)"]),
        (Sum("+-"), ["+", "−"]),
        (Spring(), ["4 x<1>", "soft & <linear>"]),
        (
            systems.Ball(),
            [
                *("z′ = v", "v′ = −gravity", "height = z", "floor when 0 = z"),
                *("then z+ = 0", "then bounces+ = bounces + 1"),
            ],
        ),
        (Private(), ["A block with an equation that says nothing."]),
        (Step(initial_value=1.0, final_value=0.0, unit="m"), ["1 to 0 m at 1 s"]),
        (Relay(2.0, 1.0, on=-3.0), ["−3 above 2", "0 below 1"]),
    ],
)
def test_symbol_shows_the_equation(block, texts):
    assert set(drawn(block)) >= {*texts, "own"}


def test_a_function_of_an_edited_file_is_not_shown_as_another(tmp_path):
    file, names = tmp_path / "edited.py", {}
    exec(compile("def old(u): return 2.0 * u", file, "exec"), names)
    file.write_text("def new(u): return 7.0 * u", encoding="utf-8")
    assert "old(u)" in drawn(Function(names["old"]))


def test_a_symbol_of_another_kind_is_refused():
    class Wrong(Block):
        y = Output()
        _symbol = "k x"

    with pytest.raises(DiagramError, match="'own': _symbol of Wrong must be a Sym"):
        drawn(Wrong())


def test_curve_of_a_table_and_no_caption_without_limits():
    picture = series("curve", table=Table([0.0, 1.0], [0.0, 1.0]))
    assert picture.draw().count('class="curve"') == 1
    assert not any("∞" in text for text in drawn(PID(1.0)))
    assert not any("from" in text for text in drawn(Integrator()))


@pytest.mark.parametrize("low, high", [(-1.0, 2.0), (2.0, -1.0)])
def test_curves_of_steps_and_relays_rise_if_their_values_do(low, high):
    for block in (
        Step(initial_value=low, final_value=high),
        Relay(1.0, 0.0, on=high, off=low),
    ):
        text = series("ends", own=block).draw()
        (start, end) = re.findall(r'class="curve".* d="M2 (\d+)h\d+V(\d+)', text)[0]
        # In SVG, y points down.
        assert (int(start) > int(end)) == (high > low)


def test_names_of_inputs_are_not_in_triangles():
    diagram = Diagram("slices")
    diagram.add(a=Constant(np.arange(2.0)), gain=Gain(3.0, shape=2))
    diagram.a.y[0] >> diagram.gain.u[1]
    diagram.a.y[1] >> diagram.gain.u[0]
    text = diagram.draw()
    assert ">3<" in text
    assert "u[" not in text


def test_names_of_port_arithmetic_are_in_tooltips_only():
    diagram = Diagram("arithmetic")
    a, b, end = diagram.add(a=Constant(1.0), b=Constant(2.0), sum_of=Gain(1.0))
    (2.0 * (a.y - b.y)) >> end.u
    diagram.add(error_1=Sum("+-"))
    text = diagram.draw()
    for name, kind in (("sum_1", "Sum"), ("multiply_1", "Operation")):
        assert f">{name}<" not in text
        assert f"{name}: {kind}" in text
    assert ">sum_of<" in text
    assert ">error_1<" in text


def test_a_port_may_have_the_name_symbol():
    class Named(Block):
        symbol = Output()

    assert "Named" in drawn(Named())


def test_function_with_a_hostile_name_does_no_harm():
    function = eval("lambda u: u")
    function.__name__ = "{0.__class__}</text><script>"
    assert "{0.__class__}</text><script>(u)" in drawn(Function(function))
