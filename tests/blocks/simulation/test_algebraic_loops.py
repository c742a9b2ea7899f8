"""Algebraic loops: found per port, through hierarchy, whatever runs and whatever is logged."""

import numpy as np
import pytest
from systems import assert_near, here, ring, series

from trussflow.blocks import (
    Constant,
    Diagram,
    Function,
    Gain,
    Input,
    Integrator,
    MatrixGain,
    Output,
    Simulator,
    simulate,
)
from trussflow.blocks.errors import AlgebraicLoopError


def test_loop_of_gain_and_sum_is_printed_with_its_path():
    diagram = Diagram("loop")
    one, gain = diagram.add(one=Constant(1.0), gain=Gain(0.5))
    total = one.y + gain.y
    first, line = here(1), here(2)
    total >> gain
    with pytest.raises(AlgebraicLoopError) as error:
        Simulator(diagram, step=0.1, log=[one.y])
    hops = [
        f"  gain.y --wire--> sum_1.u2 ==feedthrough==> sum_1.y   [{here(-6)}]",
        f"  sum_1.y --wire--> gain.u ==feedthrough==> gain.y   [{first}]",
    ]
    text = str(error.value).splitlines()
    assert line != first
    assert text[0] == (
        "algebraic loop of 2 wires: within one instant each signal depends on itself"
    )
    assert text[1:3] in (hops, hops[::-1])
    assert text[3].startswith(
        "break it with a state (Integrator, TransferFunction), a UnitDelay"
    )


def test_feedthrough_is_per_pair_of_ports(backend):
    """B -> u is legal: a depends on u, b on v only."""
    crossed = Function(
        lambda u, v: (2.0 * u, 3.0 * v),
        {"u": Input(), "v": Input()},
        {"a": Output(), "b": Output()},
    )
    diagram = Diagram("crossed")
    crossed, one = diagram.add(crossed=crossed, one=Constant(1.0))
    one >> crossed.v
    crossed.b >> crossed.u
    result = simulate(diagram, 0.1, step=0.1, backend=backend)
    assert result["crossed.a"][0] == 6.0


def test_slices_do_not_hide_a_loop():
    diagram = Diagram("pair")
    pair = diagram.add(pair=MatrixGain([[1.0, 0.0], [0.0, 1.0]]))
    pair.y[0] >> pair.u[0]
    diagram.ground(pair.u[1])
    with pytest.raises(
        AlgebraicLoopError, match=r"pair\.y --wire--> pair\.u ==feedthrough"
    ):
        Simulator(diagram, step=0.1)


def test_sampled_blocks_break_loops_of_other_instants_only(backend):
    """Two sampled gains in a ring: legal while they never tick together."""

    def gains(offset):
        return ring(a=Gain(0.5).sampled(0.2), b=Gain(0.5).sampled(0.2, offset))

    simulate(gains(0.1), 0.2, step=0.1, backend=backend)
    with pytest.raises(AlgebraicLoopError, match="algebraic loop of 2 wires"):
        simulate(gains(0.0), 0.2, step=0.1, backend=backend)


@pytest.mark.parametrize("loops", ["refuse", "solve"])
def test_feedback_of_the_indirect_output_of_a_subsystem_is_no_loop(backend, loops):
    """github.com/petercorke/bdsim/issues/84: one output is direct, the other is fed back; it is exp(-t)."""
    inner = Diagram("inner")
    state, direct = inner.add(state=Integrator(1.0), direct=Gain(2.0))
    inner.expose(u=(state.u, direct.u), passed=direct.y, integral=state.y)
    middle = series(inner=inner)
    middle.expose(u=inner.u, passed=inner.passed, integral=inner.integral)
    diagram = Diagram("outer", loops=loops)
    diagram.add(middle=middle)
    (-1.0 * middle.integral) >> middle.u
    result = simulate(diagram, 1.0, step=0.01, backend=backend)
    exact = np.exp(-result.time)
    assert_near(result["middle.inner.state.y"], exact, 1e-10)
    assert_near(result["middle.inner.direct.y"], -2.0 * exact, 2e-10)
