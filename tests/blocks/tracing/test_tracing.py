"""Repeated structure becomes kernels; the numbers stay those of plain calls."""

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from systems import ring, series

from trussflow.blocks import Constant, Gain, Integrator, simulate
from trussflow.blocks.errors import TracingError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Parameter, State
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.tracing.block_check import isolate
from trussflow.blocks.tracing.kernels import (
    repeated,
    shape_of,
    symbol,
    to_expression,
    tracing,
)
from trussflow.blocks.tracing.plan import Plan
from trussflow.blocks.tracing.program import lower
from trussflow.blocks.tracing.quantities import derivative, outputs

ROUND_OFF = 1e-13  # relative, of fused multiply-add and of another order of sums


def arm(q, m):
    """Return a matrix with constants and a symmetric part, a vector, and a scalar."""
    c, s = np.cos(q[0]), np.sin(q[0])
    zero, one = 0.0 * c, 1.0 + 0.0 * s
    rotation = np.reshape(np.stack([c, -s, zero, s, c, zero, zero, zero, one]), (3, 3))
    return rotation @ m @ rotation.T, m @ q, q @ q


def evaluate(result, leaves, values, trace):
    """Return the value of a traced result."""
    inputs = [to_expression(leaf) for leaf in leaves]
    program = lower("program", inputs, to_expression(result), trace)
    found = program.function(*[np.ravel(v) for v in values])
    return found.full().reshape(shape_of(result))


def symbols_and_numbers(count):
    """Return symbols and numbers for the arguments of so many arms."""
    rng = np.random.default_rng(0)
    leaves, values = [], []
    for i in range(count):
        leaves += [symbol(f"q{i}", (3,)), symbol(f"m{i}", (3, 3))]
        m = rng.standard_normal((3, 3))
        values += [rng.standard_normal(3), m + m.T]
    return leaves, values


def pairs(flat):
    return list(zip(flat[::2], flat[1::2], strict=True))


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_repeated_equals_plain_calls(count):
    leaves, values = symbols_and_numbers(count)
    expected = [arm(*arguments) for arguments in pairs(values)]
    with tracing() as trace:
        found = repeated(arm, pairs(leaves))
    assert len(trace) == (count > 1), "one instance alone needs no kernel"
    for results, numbers in zip(found, expected, strict=True):
        for result, number in zip(results, numbers, strict=True):
            assert shape_of(result) == np.shape(number)
            got = evaluate(result, leaves, values, trace)
            assert_allclose(got, number, rtol=ROUND_OFF, atol=ROUND_OFF)
    assert [r[2] for r in repeated(arm, pairs(values))] == [r[2] for r in expected]


def test_equal_calls_are_shared():
    leaves, _ = symbols_and_numbers(2)
    with tracing() as trace:
        first = repeated(arm, pairs(leaves))
        second = repeated(lambda q, m: arm(q, m), pairs(leaves))
        assert len(trace) == 1
        for a, b in zip(first, second, strict=True):
            assert to_expression(a[0] - b[0]).is_zero()
        repeated(arm, pairs(leaves)[::-1])
        assert len(trace) == 2, "other arguments"
        repeated(lambda q, m: (m @ q,), pairs(leaves))
        assert len(trace) == 3, "another function"


def test_constants_and_symmetric_duplicates_are_preserved():
    """Equations behind a kernel still see its zeros, ones and symmetry."""

    def kernel(a, b):
        zero = 0.0 * a
        return (
            np.reshape(np.stack([a * b, a + b, zero, a + b, b, zero + 1.0]), (2, 3)),
        )

    with tracing() as trace:
        results = repeated(
            kernel, [(symbol("a", ()), symbol("b", ())) for _ in range(3)]
        )
    for (result,) in results:
        elements = to_expression(result)
        assert elements[2].is_zero()
        assert elements[5].is_one()
        assert ca.is_equal(elements[1], elements[3])
    assert trace[0].symbols.shape == (3, 3)


@pytest.mark.parametrize(
    "kernel",
    [
        lambda _: (np.ones(2), 2.0 * np.ones((2, 2))),
        lambda a: (a, np.zeros(3)),
        lambda a: (np.zeros((0,)), a * a),
        lambda _: (),
    ],
)
def test_kernels_with_constant_or_empty_results(kernel):
    leaves = [symbol(f"a{i}", ()) for i in range(3)]
    values = [np.array(float(i)) for i in range(3)]
    with tracing() as trace:
        found = repeated(kernel, [(leaf,) for leaf in leaves])
    for results, value in zip(found, values, strict=True):
        for result, expected in zip(results, kernel(value), strict=True):
            got = evaluate(result, leaves, values, trace)
            assert_allclose(got, expected, rtol=ROUND_OFF)


def test_kernels_within_kernels_are_written_out():
    def inner(a):
        return (np.sin(a),)

    def outer(a):
        (first,), (second,) = repeated(inner, [(a[0],), (a[1],)])
        return (first * second,)

    leaves = [symbol(f"a{i}", (2,)) for i in range(3)]
    values = list(np.random.default_rng(3).standard_normal((3, 2)))
    with tracing() as trace:
        found = repeated(outer, [(leaf,) for leaf in leaves])
    assert len(trace) == 1
    for (result,), value in zip(found, values, strict=True):
        got = evaluate(result, leaves, values, trace)
        assert_allclose(got, np.prod(np.sin(value)), rtol=ROUND_OFF)


class Arms(Block):
    """Two arms that move and two that stand still, by one kernel each."""

    q = Input((2, 3))
    inertia = Output((2, 3, 3))
    energy = Output()
    rate = Output((2, 3))
    m = Parameter(np.diag([1.0, 2.0, 3.0]) + 0.1, (3, 3))
    x = State((2, 3), initial=0.5)

    def _arms(self, q, m):
        return repeated(arm, [(q[0], m), (q[1], m)])

    def output(self, t, x, u, p):
        moved, still = self._arms(u.q, p.m), self._arms(x.x, p.m)
        return {
            "inertia": np.stack([r[0] for r in moved]),
            "energy": moved[0][2],  # of the first arm alone
            "rate": np.stack([r[1] for r in still]),
        }

    def derivative(self, t, x, u, p):
        return {"x": -self.output(t, x, u, p)["rate"]}


def test_only_the_kernels_that_are_needed_are_called():
    diagram = series(arms=Arms())
    diagram.ground(diagram.arms.q)
    plan = Plan(diagram)
    ports = [plan.system.port(f"arms.{name}") for name in ("inertia", "rate")]
    calls = [len(plan.trace([outputs([p])])[0].calls) for p in ports]
    assert calls == [1, 1]
    assert len(plan.trace([outputs(ports)])[0].calls) == 2


def test_feedthrough_is_seen_through_kernels():
    block = Diagram("d").add(arms=Arms())
    assert isolate(block).feedthrough == {
        "inertia": frozenset({"q"}),
        "energy": frozenset({"q"}),
        "rate": frozenset(),
    }


def test_what_differs_between_instances_must_be_an_argument():
    class Captured(Block):
        u = Input((2,))
        y = Output((2,))

        def output(self, t, x, u, p):
            def kernel(a):
                return (a * u.u[0],)

            return {
                "y": np.stack([r for (r,) in repeated(kernel, [(u.u[0],), (u.u[1],)])])
            }

    with pytest.raises(
        TracingError, match=r"block 'b' .*repeated\(\) .* must be an argument"
    ):
        isolate(Diagram("d").add(b=Captured()))


class TwoOutputs(Block):
    """One output depends on one input, the other on both; one kernel computes both."""

    u, v = Input(3), Input(3)
    y, z = Output(3), Output(3)

    def output(self, t, x, u, p):
        def both(a, b):
            return np.sin(a), np.sin(b) * a

        parts = zip(*repeated(both, list(zip(u.u, u.v, strict=True))), strict=True)
        return dict(zip("yz", map(np.stack, parts), strict=True))


@pytest.mark.parametrize("seed", range(4))
def test_a_kernel_is_called_once_in_whatever_order_blocks_are_added(seed):
    diagram = Diagram("any order")
    blocks = {
        "both": TwoOutputs(),
        "state": Integrator(np.ones(3)),
        "last": Integrator(np.zeros(3)),
        "first": Gain(2.0 * np.ones(3)),
        "second": Gain(3.0 * np.ones(3)),
    }
    for name in np.random.default_rng(seed).permutation(list(blocks)):
        diagram.add(str(name), blocks[name])
    both = blocks["both"]
    blocks["state"] >> blocks["first"] >> both.u
    blocks["state"].y >> blocks["second"].u
    blocks["second"] >> both.v
    both.y >> blocks["last"].u
    both.z >> blocks["state"].u
    (program,) = Plan(diagram).trace([derivative()])
    assert len(program.calls) == 1


def test_a_plan_is_evaluated_with_numbers_while_another_is_traced():
    inner = ring(state=Integrator(2.0), gain=Gain(-1.0))
    plan = Plan(inner)

    class Inner(Block):
        u, y = Input(), Output()

        def output(self, t, x, u, p):
            given = plan.parameters(None)
            point = plan.initial(given, None)
            evaluation = plan.evaluate(0.0, *point, given, frozenset())
            return {"y": u.u * float(evaluation.output(inner.gain.y))}

    outer = series(source=Constant(3.0), block=Inner())
    assert simulate(outer, 0.1, step=0.1)["block.y"][-1] == -6.0
