"""Memoized results of equations: computed memoized for equal arguments, and anew for others."""

import numpy as np
from numpy.testing import assert_array_equal

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Signals, State
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.tracing.kernels import repeated, symbol, tracing
from trussflow.blocks.tracing.memoized import memoized


class Shared(Block):
    """A block whose equations share the square of its input."""

    u = Input(2)
    y = Output(2)
    q = State(2)

    def __init__(self):
        self.asked = []
        super().__init__()

    @memoized
    def _square(self, x, u):
        self.asked.append(1)
        (first,), (second,) = repeated(lambda a: (a * a,), [(u.u[0],), (u.u[1],)])
        return np.stack([first, second]) + x.q

    def output(self, t, x, u, p):
        """Return the square."""
        return {"y": self._square(x, u)}

    def derivative(self, t, x, u, p):
        """Return the square."""
        return {"q": self._square(x, u)}


def given(u, q=None):
    """Return state, input and no parameters."""
    state = np.zeros(2) if q is None else q
    return Signals("x", {"q": state}), Signals("u", {"u": u}), Signals("p", {})


def test_equations_with_the_same_arguments_share_the_work_and_others_do_not():
    block, other = Shared(), Shared()
    u = np.array([2.0, 3.0])
    x, inputs, p = given(u)
    for each in (
        block.output(0.0, x, inputs, p)["y"],
        block.derivative(0.0, x, inputs, p)["q"],
    ):
        assert_array_equal(each, [4.0, 9.0])
        each[:] = 7.0  # changes this result alone
    assert len(block.asked) == 1
    u[0] = 1.0  # the same array with another number
    assert_array_equal(block.derivative(0.0, x, inputs, p)["q"], [1.0, 9.0])
    assert_array_equal(block.output(0.0, *given(u, np.ones(2)))["y"], [2.0, 10.0])
    assert_array_equal(block.output(0.0, *given(-0.0 * u))["y"], [0.0, 0.0])
    assert_array_equal(other.output(0.0, x, inputs, p)["y"], [1.0, 9.0])


def test_expressions_are_shared_within_a_trace_and_each_trace_has_its_kernel_calls():
    block, arguments = Shared(), given(symbol("u", (2,)), symbol("q", (2,)))
    traces = []
    for _ in range(2):
        with tracing() as trace:
            both = (
                block.output(0.0, *arguments)["y"],
                block.derivative(0.0, *arguments)["q"],
            )
        assert both[0] is both[1]
        traces.append(trace)
    assert [len(trace) for trace in traces] == [1, 1]
    assert len(block.asked) == 2
    with tracing():
        block.output(0.0, *given(symbol("u", (2,)), symbol("q", (2,))))
    assert len(block.asked) == 3
