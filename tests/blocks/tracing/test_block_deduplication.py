"""Blocks share one check and one trace exactly where no equation can tell them apart."""

import numpy as np
import pytest

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    DiscreteStateSpace,
    Input,
    Output,
    Parameter,
    Saturation,
    StateSpace,
    TransferFunction,
    UnitDelay,
    simulate,
)
from trussflow.blocks.errors import TracingError
from trussflow.blocks.framework.port import INFERRED
from trussflow.blocks.tracing import block_check
from trussflow.blocks.tracing.block_check import isolate
from trussflow.blocks.tracing.block_deduplication import equations_key
from trussflow.blocks.tracing.kernels import is_traced
from trussflow.blocks.tracing.plan import Plan
from trussflow.blocks.tracing.quantities import derivative, outputs, sample

DOUBLE, TRIPLE = (lambda u: 2.0 * u), (lambda u: 3.0 * u)


class Made(Block):
    """A block with any attribute, which it reads; it counts how often its equations are traced."""

    u = Input(INFERRED)
    y = Output(INFERRED)
    slope = Parameter(1.0)
    traces = 0

    def __init__(self, made=1.0, reads=lambda made: made, **parameters):
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


DIFFERENT_ATTRIBUTES = {
    "a number": (1.0, 1.0 + 2**-52, lambda made: made),
    "the sign of a zero": (0.0, -0.0, bits),
    "whole or not": (1, 1.0, kind),
    "true or one": (True, 1, kind),
    "an element of an array": (np.array([1.0, 2.0]), np.array([1.5, 2.0]), first),
    "the type of an array": (
        np.array([1]),
        np.array([1.0]),
        lambda made: 2.0 if made.dtype == float else 3.0,
    ),
    "the shape of an array": (
        np.ones((2, 3)),
        np.ones((3, 2)),
        lambda made: 1.0 * len(made),
    ),
    "something nested": ({"k": [0.0, (1.0,)]}, {"k": [0.0, (2.0,)]}, nested),
    "a list or a tuple": (
        [1.0],
        (1.0,),
        lambda made: 2.0 if isinstance(made, list) else 3.0,
    ),
    "a function": (DOUBLE, TRIPLE, called),
    "an order": (
        {"a": 1.0, "b": 2.0},
        {"b": 2.0, "a": 1.0},
        lambda made: next(iter(made.values())),
    ),
    "text": ("fast", "slow", lambda made: 2.0 if made == "fast" else 3.0),
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
    diagram = Diagram("many")
    source = diagram.add(source=Constant(0.7))
    for block in diagram.add(**blocks) if len(blocks) > 1 else [diagram.add(**blocks)]:
        source.y >> block.u
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


LINEAR_BLOCKS = {
    "ones": lambda k: [TransferFunction([k - 2.0, 1.0], [1.0, k - 3.0, 1.0, k - 4.0])],
    "state space": lambda k: [
        StateSpace(
            *(
                np.random.default_rng(k).integers(-2, 3, s) * 0.5
                for s in ((3, 3), 3, 3, ())
            )
        )
    ],
    "sampled": lambda k: [
        DiscreteStateSpace([[0.1 * k]], [1.0], [0.3 * k], 0.1 * k, sample_time=0.1)
    ],
    "others": lambda k: [
        Saturation(-k, k),
        UnitDelay(0.1),
        TransferFunction([1.0], [0.1 * k, 1.0]),
    ],
}


@pytest.mark.parametrize("which", LINEAR_BLOCKS)
def test_what_is_shared_is_the_same_program_to_the_bit(which, monkeypatch):
    def codes():
        blocks = [block for k in range(1, 9) for block in LINEAR_BLOCKS[which](k)]
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


def test_linear_blocks_share_where_they_have_the_same_zeros():
    lags = [TransferFunction([k], [0.1 * k, 1.0]) for k in range(1, 4)]
    assert len({equations_key(block) for block in lags}) == 1
    direct = [
        TransferFunction([0.5, 1.0], [0.1, 1.0]),
        TransferFunction([0.0, 1.0], [0.1, 1.0]),
    ]
    assert len({equations_key(block) for block in [*lags, *direct]}) == 2
    many(**{f"b{k}": block for k, block in enumerate([*lags, *direct])})
    shared = {}
    depends = [isolate(block, shared).feedthrough["y"] for block in (*lags, *direct)]
    assert depends == [frozenset()] * 3 + [frozenset("u"), frozenset()]
    assert len(shared) == 2


class Stiff(StateSpace):
    """A linear system whose output is a choice by its numbers."""

    def output(self, t, x, u, p):
        """Return the state, or its opposite."""
        return {"y": x.x[0] if self.A[0, 0] < -5.0 else -x.x[0]}


def test_a_linear_block_with_equations_of_its_own_keeps_its_numbers():
    slow, stiff = (
        Stiff([[a]], [1.0], [1.0], initial_value=[1.0]) for a in (-1.0, -10.0)
    )
    assert equations_key(slow) != equations_key(stiff)
    found = shown(
        many(slow=slow, stiff=stiff), initial={"slow.x": [1.0], "stiff.x": [1.0]}
    )
    assert found["slow"] < 0.0 < found["stiff"]
