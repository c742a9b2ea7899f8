"""Derivatives of Python blocks: their own where offered, else differences under control."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import HiddenSum, assert_near, ports

from trussflow.blocks import (
    Block,
    Diagram,
    Input,
    Integrator,
    Output,
    Parameter,
    PythonFunction,
    State,
    linearize,
    trim,
)
from trussflow.blocks.errors import BlockError, LinearAnalysisError
from trussflow.blocks.framework.run_state import Running


class Steps(Block):
    """A step of size 1e-12 in every value: no differences can be taken of it."""

    traced = False
    u = Input(2)
    y = Output(2)
    z = State(initial=0.3)
    gain = Parameter(5.0)

    def output(self, t, x, u, p):
        return {"y": np.floor(1e3 * p.gain * u.u * x.z) / 1e3}

    def update(self, t, x, u, p):
        return {"z": np.floor(1e3 * np.sum(u.u**2)) / 1e3 + x.z}


class Knowing(Steps):
    """The same, but it knows its slopes."""

    def __init__(self):
        self.calls = []
        super().__init__()

    def directional_derivative(self, kind, t, x, u, p, dx, du):
        self.calls.append(kind)
        if kind == "output":
            return {"y": p.gain * (du.u * x.z + u.u * dx.z)}
        return {"z": np.sum(2 * u.u * du.u) + dx.z}


def alone(block):
    """Return a diagram of the block between an integrator and the outside."""
    diagram = Diagram("alone")
    diagram.add(source=Integrator([0.5, -2.0]), block=block)
    diagram.source >> diagram.block
    diagram.expose(u=diagram.source.u, y=diagram.block.y)
    return diagram


def test_a_block_that_knows_its_derivatives_is_asked_for_them():
    block = Knowing()
    model = linearize(alone(block.sampled(0.1)))
    assert model.derivatives == {"block": "its own"}
    assert set(block.calls) == {"output", "update"}
    assert model.state_labels == ["source/integral[0]", "source/integral[1]", "block/z"]
    assert_near(model.A, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, -4.0, 1.0]], 1e-14)
    assert_near(model.C, [[1.5, 0.0, 2.5], [0.0, 1.5, -10.0]], 1e-14)


def test_steps_and_kinks_are_refused_rather_than_guessed():
    message = (
        r"cannot differentiate Python block 'block' \(Steps\): differences .* disagree"
    )
    with pytest.raises(LinearAnalysisError, match=message):
        linearize(alone(Steps().sampled(0.1)))


def function(law):
    """Return a diagram with a Python function of two values."""
    return alone(PythonFunction(law, 0.1, **ports(u=2, y=2)))


@pytest.mark.parametrize(
    "law, slopes",
    [
        (lambda u: np.exp(u[::-1]), [[0, np.exp(-2)], [np.exp(0.5), 0]]),
        (
            lambda u: np.array([1e6 * np.sin(u[0]), 1e-6 * u[1] ** 3]),
            [[1e6 * np.cos(0.5), 0], [0, 1.2e-5]],
        ),
        (lambda u: np.array([7.0, 0.0 * u[0]]), np.zeros((2, 2))),
        (
            lambda u: np.array([np.arctan(50 * (u[0] - 0.51)), np.linalg.norm(u)]),
            [[50 / 1.25, 0], [0.5 / np.sqrt(4.25), -2 / np.sqrt(4.25)]],
        ),
    ],
)
def test_differences_are_as_good_as_they_say(law, slopes):
    model = linearize(function(law))
    claimed = float(
        model.derivatives["block"].removeprefix("differences, relative error ")
    )
    scale = np.abs(slopes).max(axis=1, keepdims=True)
    assert claimed < 1e-6
    assert np.all(
        np.abs(model.C - slopes) <= max(1e-8, 10 * claimed) * np.maximum(scale, 1e-3)
    )


def test_a_kink_of_a_small_value_is_seen_beside_a_large_one():
    with pytest.raises(
        LinearAnalysisError, match=r"cannot differentiate Python block 'block'"
    ):
        linearize(function(lambda u: np.array([1e9 * u[0], abs(u[1] + 2.0 + 1e-9)])))


def test_own_derivatives_are_checked():
    class Wrong(Knowing):
        def directional_derivative(self, *args):
            return {"y": np.zeros(3)}

    with pytest.raises(
        BlockError, match=r"block 'block' \(Wrong\): 'y' is declared with shape"
    ):
        linearize(alone(Wrong().sampled(0.1)))


def test_an_output_without_inputs_and_states_has_no_derivatives():
    class Fixed(Block):
        traced = False
        u = Input(2)
        y = Output(2)

        def output(self, t, x, u, p):
            return {"y": np.ones(2)}

        def feedthrough(self):
            return {"y": ()}

        def directional_derivative(self, kind, t, x, u, p, dx, du):
            return {"y": np.zeros(2)}

    assert_array_equal(
        linearize(alone(Fixed().sampled(0.1))).C[:, :2], np.zeros((2, 2))
    )


class HiddenSumWithSlopes(HiddenSum):
    def directional_derivative(self, kind, t, x, u, p, dx, du):
        return {"y": 2 * du.u} if kind == "output" else {}

    def feedthrough(self):
        return {"y": ("u",)}


def test_blocks_with_hidden_states_need_their_own_derivatives():
    hidden = alone(HiddenSum(2).sampled(0.1))
    message = r"cannot linearize Python block 'block' \(HiddenSum\): it keeps something besides"
    with pytest.raises(LinearAnalysisError, match=message):
        linearize(hidden)
    with pytest.raises(
        LinearAnalysisError, match=r"cannot trim: Python block 'block' \(HiddenSum\)"
    ):
        trim(hidden)
    model = linearize(alone(HiddenSumWithSlopes(2).sampled(0.1)))
    assert_array_equal(model.C, 2 * np.eye(2))
    assert model.derivatives == {"block": "its own"}


def test_python_blocks_without_outputs_do_not_matter():
    class Looker(Block):
        traced = False
        u = Input(2)

        def open(self, p):
            return Running()

    diagram = Diagram()
    source, look = diagram.add(
        source=Integrator([0.5, -2.0]), look=Looker().sampled(0.1)
    )
    source >> look
    diagram.expose(u=source.u, y=source.y)
    model = linearize(diagram)
    assert_near(model.A, np.eye(2), 1e-15)
    assert model.derivatives == {}
