"""Algebraic loops: found per port, through hierarchy, whatever runs and whatever is logged."""

import pytest
from systems import here, ring

from trussflow.blocks import (
    Block,
    Diagram,
    Function,
    Gain,
    Input,
    MatrixGain,
    Output,
    Simulator,
    State,
    simulate,
)
from trussflow.blocks.errors import AlgebraicLoopError


class PythonGain(Gain):
    traced = False


class Plant(Block):
    """Passes nothing on directly in ``position``; ``acceleration`` is direct."""

    force = Input()
    position, acceleration = Output(), Output()
    q = State(initial=1.0)

    def output(self, t, x, u, p):
        return {"position": x.q, "acceleration": u.force - x.q}

    def derivative(self, t, x, u, p):
        return {"q": u.force}


def test_loop_of_gain_and_sum_is_printed_with_its_path():
    diagram = Diagram("loop")
    one, gain = diagram.add(one=Plant(), gain=Gain(0.5))
    diagram.ground(one.force)
    total = one.position + gain.y
    first, line = here(1), here(2)
    total >> gain
    with pytest.raises(AlgebraicLoopError) as error:
        Simulator(diagram, step=0.1, log=[one.position])
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


def test_loop_through_a_nested_diagram():
    outer, inner = Diagram("outer"), Diagram("inner")
    gain = inner.add(gain=Gain(0.5))
    inner.expose(u=gain.u, y=gain.y)
    box, other = outer.add(box=inner, other=Gain(0.5))
    box.y >> other
    other.y >> box.u
    with pytest.raises(
        AlgebraicLoopError, match=r"other\.y --wire--> box\.gain\.u ==feedthrough"
    ):
        Simulator(outer, step=0.1)


def test_direct_output_fed_back_is_a_loop_but_the_other_one_is_not(backend):
    diagram = Diagram("plant")
    plant, gain = diagram.add(plant=Plant(), gain=Gain(-1.0))
    plant.position >> gain
    gain.y >> plant.force
    result = simulate(diagram, 0.1, step=0.1, backend=backend)
    assert result["plant.acceleration"][0] == -2.0
    other = Diagram("other")
    plant, gain = other.add(plant=Plant(), gain=Gain(0.5))
    plant.acceleration >> gain
    gain.y >> plant.force
    with pytest.raises(
        AlgebraicLoopError, match=r"plant\.acceleration --wire--> gain\.u"
    ):
        simulate(other, 0.1, step=0.1, backend=backend)


def test_feedthrough_is_per_pair_of_ports(backend):
    """B -> u is legal: a depends on u, b on v only."""
    crossed = Function(
        lambda u, v: (2.0 * u, 3.0 * v),
        {"u": Input(), "v": Input()},
        {"a": Output(), "b": Output()},
    )
    diagram = Diagram("crossed")
    crossed, one = diagram.add(crossed=crossed, one=Plant())
    diagram.ground(one.force)
    one.position >> crossed.v
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


@pytest.mark.parametrize("python", [False, True])
def test_loop_through_python_blocks(python):
    diagram = Diagram("python")
    a, b = diagram.add(a=PythonGain(0.5), b=(PythonGain if python else Gain)(0.5))
    for block in (a, b):
        block.sampled(0.1)
    a >> b >> a
    with pytest.raises(
        AlgebraicLoopError, match=r"through Python blocks: a -> (b -> )?a|b -> a -> b"
    ):
        Simulator(diagram, step=0.1)
