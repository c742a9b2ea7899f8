"""Blocks share one check and one trace exactly where no equation can tell them apart."""

import numpy as np
import pytest
from systems import series

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    DiscreteStateSpace,
    Input,
    Output,
    Parameter,
    Saturation,
    TransferFunction,
    UnitDelay,
    simulate,
)
from trussflow.blocks.errors import TracingError
from trussflow.blocks.framework.port import INFERRED
from trussflow.blocks.tracing import block_check
from trussflow.blocks.tracing.block_check import equations_key
from trussflow.blocks.tracing.kernels import is_traced
from trussflow.blocks.tracing.plan import Plan
from trussflow.blocks.tracing.quantities import derivative, outputs, sample


def itself(made):
    return made


def double(u):
    return 2.0 * u


def triple(u):
    return 3.0 * u


class Made(Block):
    """A block with any attribute, which it reads; it counts how often its equations are traced."""

    u = Input(INFERRED)
    y = Output(INFERRED)
    slope = Parameter(1.0)
    traces = 0

    def __init__(self, made=1.0, reads=itself, **parameters):
        self.made, self._reads = made, reads
        super().__init__(**parameters)

    def output(self, t, x, u, p):
        """Return the input times what is read of the attribute."""
        Made.traces += is_traced(u.u)
        return {"y": u.u * p.slope * self._reads(self.made)}


def first(made):
    return made[0]


def second(made):
    return made[1]


def nested(made):
    return made["k"][1][0]


def bits(made):
    return np.copysign(2.0, made)


def kind(made):
    return 2.0 if isinstance(made, bool) else 3.0 if isinstance(made, int) else 4.0


def called(made):
    return made(1.0)


def of_type(made):
    return 2.0 if made.dtype == float else 3.0


def rows(made):
    return 1.0 * len(made)


def is_list(made):
    return 2.0 if isinstance(made, list) else 3.0


def first_value(made):
    return next(iter(made.values()))


def is_fast(made):
    return 2.0 if made == "fast" else 3.0


DIFFERENT_ATTRIBUTES = {
    "a number": (1.0, 1.0 + 2**-52, itself),
    "the sign of a zero": (0.0, -0.0, bits),
    "whole or not": (1, 1.0, kind),
    "true or one": (True, 1, kind),
    "an element of an array": (np.array([1.0, 2.0]), np.array([1.5, 2.0]), first),
    "the type of an array": (np.array([1]), np.array([1.0]), of_type),
    "the shape of an array": (np.ones((2, 3)), np.ones((3, 2)), rows),
    "something nested": ({"k": [0.0, (1.0,)]}, {"k": [0.0, (2.0,)]}, nested),
    "a list or a tuple": ([1.0], (1.0,), is_list),
    "a function": (double, triple, called),
    "an order": ({"a": 1.0, "b": 2.0}, {"b": 2.0, "a": 1.0}, first_value),
    "text": ("fast", "slow", is_fast),
}


def shown(diagram, **settings):
    """Return the outputs of a run at its end, by the name of the block."""
    result = simulate(diagram, 0.1, step=0.1, **settings)
    return {
        str(n).removesuffix(".y"): float(np.ravel(v.values[-1])[0])
        for n, v in result.items()
    }


def many(**blocks):
    """Return a diagram of blocks that all have the same input."""
    diagram = series(source=Constant(0.7))
    for block in diagram.add(**blocks) if len(blocks) > 1 else [diagram.add(**blocks)]:
        diagram.source.y >> block.u
    return diagram


def test_equal_blocks_are_traced_once_and_keep_their_own_parameters():
    Made.traces = 0
    slopes = {f"b{k}": 0.1 * k for k in range(30)}
    found = shown(
        many(
            **{
                name: Made([0.0, 2.0], second, slope=slope)
                for name, slope in slopes.items()
            }
        )
    )
    assert Made.traces == 1
    for name, slope in slopes.items():
        assert found[name] == 0.7 * slope * 2.0


@pytest.mark.parametrize("what", DIFFERENT_ATTRIBUTES)
def test_blocks_that_differ_in_an_attribute_keep_their_own_equations(what):
    a, b, reads = DIFFERENT_ATTRIBUTES[what]
    blocks = {"a": Made(a, reads), "b": Made(b, reads), "again": Made(a, reads)}
    found = shown(many(**blocks))
    marks = {name: equations_key(block) for name, block in blocks.items()}
    assert marks["a"] != marks["b"]
    assert marks["a"] == marks["again"]
    for name, block in blocks.items():
        assert found[name] == 0.7 * reads(block.made)
    assert found["a"] != found["b"]


GAIN_TABLE = {"a": 2.0, "b": 3.0}


class Asking(Block):
    """A block that asks who and where it is."""

    u = Input()
    y = Output()
    gain = Parameter(1.0)

    def __init__(self, asks, gain):
        self._asks = asks
        super().__init__(gain=gain)

    def output(self, t, x, u, p):
        """Return the input times the answer."""
        return {"y": u.u * self._asks(self)}


IDENTITY_READERS = {
    "its name": lambda block: GAIN_TABLE[block.name],
    "its path": lambda block: GAIN_TABLE[block.path],
    "the path of its port": lambda block: GAIN_TABLE[block.ports["u"].path[0]],
    "what is beside it": lambda block: GAIN_TABLE[
        next(n for n, b in block.parent.blocks.items() if b is block)
    ],
    "its parameter": lambda block: block.gain,
    "all its parameters": lambda block: block.parameters["gain"],
}


@pytest.mark.parametrize("asks", IDENTITY_READERS)
def test_blocks_that_ask_who_they_are_are_told_it(asks):
    found = shown(
        many(
            a=Asking(IDENTITY_READERS[asks], 2.0), b=Asking(IDENTITY_READERS[asks], 3.0)
        )
    )
    assert found == {"source": 0.7, "a": 1.4, "b": 0.7 * 3.0}


class Slotted(Block):
    """A block with an attribute that is not in its dictionary."""

    __slots__ = ("hidden",)
    u = Input()
    y = Output()

    def __init__(self, hidden):
        object.__setattr__(self, "hidden", hidden)
        super().__init__()

    def output(self, t, x, u, p):
        """Return the input times the attribute."""
        return {"y": u.u * self.hidden}


def test_what_is_not_in_the_dictionary_of_a_block_counts_too():
    assert equations_key(Slotted(2.0)) is None
    assert shown(many(a=Slotted(2.0), b=Slotted(3.0))) == {
        "source": 0.7,
        "a": 1.4,
        "b": 0.7 * 3.0,
    }


class Ported(Block):
    """A block that reads what is declared of its port."""

    u = Input(INFERRED, unit=INFERRED)
    y = Output(INFERRED)

    def output(self, t, x, u, p):
        """Return the input, in metres."""
        port = self.ports["u"]
        return {"y": u.u * (1e-3 if port.unit == "mm" else 1.0) * port.size}


def test_blocks_that_differ_in_their_ports_keep_their_own_equations():
    diagram = Diagram("ports")
    blocks = diagram.add(a=Ported(), b=Ported(), c=Ported())
    values = [([1.0, 2.0], "m"), ([1.0, 2.0, 3.0], "m"), ([1.0, 2.0], "mm")]
    for number, (block, (value, unit)) in enumerate(zip(blocks, values, strict=True)):
        diagram.add(f"source{number}", Constant(value, unit=unit)).y >> block.u
    found = shown(diagram)
    assert [found[name] for name in "abc"] == [2.0, 3.0, 2e-3]


def test_a_fault_is_told_of_the_first_block_that_has_it():
    faulty = {name: Made([1.0], called) for name in "xy"}
    with pytest.raises(TracingError, match="block 'x'"):
        shown(many(**faulty))


def test_what_is_shared_is_the_same_program_to_the_bit(monkeypatch):
    def codes():
        blocks = []
        for k in range(1, 9):
            blocks += [
                TransferFunction([1.0, 2.0], [1.0, 0.0, 1.0, -1.0]),
                DiscreteStateSpace([[0.1]], [1.0], [0.3], 0.1, sample_time=0.1),
                Saturation(-k, k),
                UnitDelay(0.1),
            ]
        diagram = many(**{f"b{k}": block for k, block in enumerate(blocks)})
        plan = Plan(diagram)
        ports = [block.ports["y"] for block in plan.system.blocks.values()]
        quantities = [
            derivative(),
            outputs(ports),
            *(sample(k, frozenset({c})) for k, c in enumerate(plan.system.clocks)),
        ]
        return [program.code for program in plan.trace(quantities)]

    shared, anew = codes(), []
    monkeypatch.setattr(block_check, "equations_key", lambda block: anew.append(block))
    assert codes() == shared
    assert len(anew) > 1
