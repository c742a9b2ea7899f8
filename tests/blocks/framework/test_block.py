"""Declaring and constructing blocks: names, shapes, parameters, states."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import Counter, Lag, series

from trussflow.blocks.errors import (
    BlockError,
    NameLookupError,
    ParameterError,
    TrussflowError,
)
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Attribute, Parameter, State
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.simulation.simulator import simulate
from trussflow.blocks.tracing.plan import Plan


class Plant(Block):
    """A block with parameters of every kind."""

    q = Output(("modes", 2), unit=Attribute("length"))
    mass = Parameter(unit="kg", above=0.0)
    damping = Parameter(0.0, unit="N*s/m", minimum=0.0)
    shape = Parameter(1.0, "modes")
    table = Parameter((1.0, 2.0), None)

    def __init__(self, modes=3, length="m", **parameters):
        self.modes = modes
        self.length = length
        super().__init__(**parameters)


def test_sizes_and_units_may_come_from_attributes():
    plant = Plant(4, "mm", mass=2)
    assert (plant.q.shape, plant.q.unit) == ((4, 2), "mm")
    assert_array_equal(plant.shape, np.ones(4))
    assert plant.table.shape == (2,)
    assert Plant(mass=1, table=3.0).table.shape == ()


@pytest.mark.parametrize(
    "given, message",
    [
        ({}, "Plant needs a value for its parameter 'mass'"),
        (
            {"mas": 1.0},
            "Plant has no parameter 'mas'; it has: mass, damping, shape, table",
        ),
        ({"mass": np.nan}, r"'mass' of Plant is not finite: nan"),
        ({"mass": 0.0}, r"'mass' of Plant is 0\.0; it must be above 0 \[kg\]"),
        ({"mass": 1, "damping": -1e-9}, r"is -1e-09; it must be at least 0"),
        (
            {"mass": [1.0, 2.0]},
            r"'mass' of Plant has shape \(2,\); it must have shape \(\)",
        ),
        ({"mass": "heavy"}, "'mass' of Plant must be numeric, not 'heavy'"),
        ({"mass": 1, "shape": [1, 2, np.inf]}, r"is not finite \(element 2\): inf"),
        (
            {"mass": 1, "shape": np.ones(2)},
            r"has shape \(2,\); it must have shape \(3,\)",
        ),
        ({"mass": 1, "table": [[1.0], [1.0, 2.0]]}, "must be numeric"),
    ],
)
def test_parameters_are_checked(given, message):
    with pytest.raises(ParameterError, match=message):
        Plant(**given)


def test_parameters_cannot_be_changed_in_place():
    values = np.ones(3)
    plant = Plant(mass=1.0, shape=values)
    values[0] = 7.0
    assert plant.shape[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        plant.shape[0] = 7.0


@pytest.mark.parametrize("size", [-1, 1.5, None, "three"])
def test_sizes_must_make_sense(size):
    with pytest.raises(BlockError, match=r"cannot have shape|has no such attribute"):
        Plant(size, mass=1.0)


@pytest.mark.parametrize(
    "name",
    [
        "output",
        "path",
        "name",
        "ports",
        "parameters",
        "sample_time",
        "inputs",
        "diagram",
    ],
)
@pytest.mark.parametrize("declaration", [Input(), Parameter(0.0), State()])
def test_names_of_every_block_are_taken(name, declaration):
    with pytest.raises(
        BlockError, match=f"Wrong declares '{name}', which every block already has"
    ):
        type("Wrong", (Block,), {name: declaration})


@pytest.mark.parametrize(
    "name", ["inputs", "outputs", "states", "declared", "named", "diagram"]
)
def test_methods_that_no_block_states_are_not_overridden(name):
    """The framework calls them: `outputs` for `output` would fail there."""
    with pytest.raises(
        BlockError, match=rf"Wrong declares '{name}', which .* \(equations are output, "
    ):
        type("Wrong", (Block,), {name: lambda *_: {}})


class Extra(Block):
    """A block with ports that are named when it is built."""

    def __init__(self, ports):
        self.extra_ports = ports
        super().__init__()


@pytest.mark.parametrize(
    "ports, message",
    [
        (5, "extra_ports of Extra must be given by name, as a dict, not as 5"),
        ({3: Input()}, "3 is no name"),
        (
            {"u": 3},
            r"Extra: extra port 'u' must be an Input\(...\) or an Output\(...\), not 3",
        ),
        (
            {"output": Input()},
            "Extra declares 'output', but the block has an attribute",
        ),
    ],
)
def test_extra_ports_are_ports_by_name(ports, message):
    with pytest.raises(TrussflowError, match=message):
        Extra(ports)


def test_declared_names_must_not_be_hidden_by_attributes():
    class Hidden(Block):
        gain = Parameter(1.0)

        def __init__(self):
            self.gain = 3.0
            super().__init__()

    with pytest.raises(
        BlockError, match="Hidden declares 'gain', but the block has an attribute"
    ):
        Hidden()


def test_declarations_are_inherited_from_all_bases():
    class First(Block):
        a = Input()

    class Second(Block):
        b = Input()

    class Both(First, Second):
        c = Input()

    assert {p.name for p in Both().inputs()} == {"a", "b", "c"}
    assert {p.name for p in First().inputs()} == {"a"}


def test_block_is_continuous_or_sampled():
    with pytest.raises(
        BlockError, match=r"Both has both derivative\(\) and update\(\)"
    ):
        type("Both", (Block,), {"derivative": lambda *_: {}, "update": lambda *_: {}})


@pytest.mark.parametrize(
    "every, offset",
    [(0, 0), (-1, 0), (np.nan, 0), (np.inf, 0), (1, 1), (1, -0.1), ("x", 0)],
)
def test_sample_times_make_sense(every, offset):
    with pytest.raises(
        BlockError, match="the sample time must be positive and finite, the offset"
    ):
        Block().sampled(every, offset)


def test_discrete_states_need_a_sample_time():
    diagram = series(b=Counter())
    with pytest.raises(
        BlockError,
        match=r"cannot run block 'b' .*discrete states need a sample time; add",
    ):
        Plan(diagram)


def test_continuous_states_cannot_be_sampled():
    with pytest.raises(
        BlockError, match="cannot sample 'Lag': it has continuous states"
    ):
        Lag().sampled(0.1)


@pytest.mark.parametrize(
    "initial, message",
    [
        ("missing", "block 'b' has no 'missing'; it has: start"),
        ((1.0, 2.0, 3.0), r"'x' of 'b' has shape \(3,\); it must have shape \(2,\)"),
    ],
)
def test_declared_initial_values_are_checked(initial, message):
    class Wrong(Lag):
        y = Output(2)
        x = State((2,), initial=initial)

    diagram = Diagram("d")
    diagram.ground(diagram.add(b=Wrong()).u)
    with pytest.raises((NameLookupError, ParameterError), match=message):
        simulate(diagram, 1.0, step=0.1, backend="numpy")


def test_initial_value_in_place_of_a_shape_is_told():
    """A mode has its initial value first, a state its shape."""
    with pytest.raises(
        BlockError, match=r"-1.0 is no shape of a state; .* is State\(initial=-1.0\)"
    ):
        State(-1.0)
