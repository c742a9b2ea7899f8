"""Diagrams: names, nesting, exposed ports, sums."""

from functools import partial

import pytest
from systems import series

from trussflow.blocks import Constant, Gain, Sum
from trussflow.blocks.errors import BlockError, DiagramError, WiringError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Input
from trussflow.blocks.simulation.simulator import simulate
from trussflow.blocks.tracing.plan import Plan

Length = partial(Constant, unit="m")
Gained = partial(Gain, input_unit="m", output_unit="m", shape=())


class Wide(Block):
    u = Input((3,), unit="m")
    s = Input(unit="s")
    n = Input()


def test_blocks_are_added_under_their_keywords():
    diagram = Diagram("d")
    one, two = diagram.add(one=Length(1.0), two=Gained(2.0))
    three = diagram.add(three=Gained(2.0))
    assert [diagram.one, diagram.two, diagram.three] == [one, two, three]
    assert [b.path for b in diagram.blocks.values()] == ["one", "two", "three"]
    diagram.expose(out=two.y)
    with pytest.raises(DiagramError, match="'d' cannot have a 'out': it already has"):
        diagram.add(out=Gained(2.0))


@pytest.mark.parametrize(
    "name", ["add", "name", "blocks", "output", "parent", "sampled"]
)
def test_names_must_not_hide_attributes(name):
    diagram = series("d", block=Length(1.0))
    with pytest.raises(
        DiagramError, match=f"'{name}': every diagram has an attribute of that"
    ):
        diagram.add(**{name: Length(1.0)})
    with pytest.raises(
        DiagramError, match=f"'{name}': every diagram has an attribute of that"
    ):
        diagram.expose(**{name: diagram.block.y})


@pytest.mark.parametrize("name", ["a.b", "a/b", "", "1a"])
def test_names_are_identifiers(name):
    with pytest.raises(
        DiagramError, match="names consist of letters, digits and underscores"
    ):
        Diagram("d").add(**{name: Length(1.0)})


@pytest.mark.parametrize("value", [1.0, int, None])
def test_only_blocks_can_be_added(value):
    with pytest.raises(
        DiagramError, match=r"cannot add 'x' to diagram 'd': .* is not a block"
    ):
        Diagram("d").add(x=value)


def test_block_is_in_one_diagram_only():
    first, second = Diagram("first"), Diagram("second")
    block = first.add(block=Length(1.0))
    for diagram in (first, second):
        with pytest.raises(
            DiagramError, match="this Constant is already in diagram 'first' as 'bl"
        ):
            diagram.add(again=block)


def test_diagram_cannot_contain_itself():
    outer, middle, inner = Diagram("outer"), Diagram("middle"), Diagram("inner")
    outer.add(middle=middle)
    middle.add(inner=inner)
    for around in (outer, inner):
        with pytest.raises(
            DiagramError, match=r"a diagram cannot contain itself|already in diagram"
        ):
            inner.add(again=around)
    with pytest.raises(DiagramError, match="a diagram cannot contain itself"):
        outer.add(again=outer)


def test_diagram_has_no_clock():
    with pytest.raises(
        BlockError, match="cannot sample diagram 'd': sample the blocks in it"
    ):
        Diagram("d").sampled(0.1)


def test_two_levels_of_nesting():
    outer, middle, inner = Diagram("outer"), Diagram("middle"), Diagram("inner")
    first, second = inner.add(first=Gained(2.0), second=Gained(3.0))
    inner.expose(u=(first.u, second.u), low=first.y, high=second.y)
    middle.add(box=inner, extra=Gained(5.0))
    middle.box.high >> middle.extra
    middle.expose(u=middle.box.u, low=middle.box.low, high=middle.extra.y)
    one, box = outer.add(one=Length(1.0), box=middle)
    one >> box.u
    result = simulate(
        outer, 0.1, step=0.1, log=["box.box.first.y", box.high, "box.low"]
    )
    assert {n: v[-1] for n, v in result.items()} == {
        "box.box.first.y": 2.0,
        "box.high": 15.0,
        "box.low": 2.0,
    }
    assert result["box.high"].attrs["source"] == "box.extra.y"


def test_slices_pass_through_exposed_ports():
    outer, inner = Diagram("outer"), Diagram("inner")
    vector = inner.add(vector=Gain([1.0, 2.0, 3.0]))
    inner.expose(u=vector.u, y=vector.y)
    box, two, last = outer.add(
        box=inner, two=Constant([10.0, 20.0]), last=Gain([1.0, 2.0, 3.0])
    )
    two.y >> box.u[1:]
    outer.ground(box.u[0])
    box.y[::-1] >> last.u
    result = simulate(outer, 0.1, step=0.1, log={"all": last.y, "end": box.y[2]})
    assert [*result["all"].values[0]] == [60.0, 40.0, 0.0]
    assert result["end"].values[0] == 60.0


def test_exposing_what_cannot_be_exposed():
    diagram = Diagram("d")
    one, gain, other, wide = diagram.add(
        one=Length(1.0), gain=Gained(2.0), other=Gained(2.0), wide=Wide()
    )
    diagram.expose(u=gain.u, y=gain.y)
    diagram.expose(again=gain.y)  # an output may be seen under two names
    for fault, port in {
        "it is already exposed as 'u'": gain.u,
        "give whole ports of blocks in diagram 'd'": wide.u[0],
        "only inputs can be grouped": (one.y, gain.y),
        "cannot expose 3 as 'x': give whole ports": 3,
        "cannot expose an empty tuple as 'x'": (),
        "it is in the group twice": (other.u, other.u),
    }.items():
        with pytest.raises(DiagramError, match=fault):
            diagram.expose(x=port)
    with pytest.raises(DiagramError, match="cannot have a 'u': it already has"):
        diagram.expose(u=other.u)
    with pytest.raises(
        WiringError, match=r"'gain.u' .*: it is exposed as 'u' and driven from outside"
    ):
        one >> gain
    one >> other
    with pytest.raises(
        DiagramError, match=r"cannot expose 'other.u' .*: it is driven inside"
    ):
        diagram.expose(x=other.u)


@pytest.mark.parametrize(
    "name, fault",
    [("u", r"shape \(\) does not fit \(3,\)"), ("s", "'m' does not fit 's'")],
)
def test_grouped_inputs_must_fit_each_other(name, fault):
    diagram = Diagram("d")
    gain, wide = diagram.add(gain=Gained(2.0), wide=Wide())
    with pytest.raises(
        WiringError, match=rf"cannot group 'gain.u' .* and 'wide.{name}'(.|\n)*{fault}"
    ):
        diagram.expose(both=(gain.u, wide.port(name)))


def test_grounding_what_is_no_input():
    diagram = series("d", one=Length(1.0))
    for what in (diagram.one.y, 3, Gained(2.0).u):
        with pytest.raises(
            WiringError, match=r"cannot ground .* it is not an input of a block in diag"
        ):
            diagram.ground(what)


@pytest.mark.parametrize("signs", ["", "+*", "1"])
def test_signs_of_a_sum(signs):
    with pytest.raises(BlockError, match=r"Sum needs signs such as '\+\+-'"):
        Sum(signs)


def test_diagram_without_blocks():
    outer = series("outer", empty=Diagram("empty"))
    with pytest.raises(DiagramError, match="diagram 'outer' has no blocks"):
        Plan(outer)


@pytest.mark.parametrize("inside_out", [True, False])
def test_nesting_has_a_limit(inside_out):
    outer = inner = Diagram("outer")
    for _ in range(1200):
        other = Diagram("other")
        if inside_out:
            other.add(inner=outer)
            outer = other
        else:
            inner = inner.add(inner=other)
    inner.add(one=Length(1.0))
    with pytest.raises(DiagramError, match=r"inside 401 other diagrams; at most 400"):
        Plan(outer)


def test_deep_nesting_below_the_limit():
    outer = series(one=Length(1.0))
    for level in range(1, 401):
        deeper, outer = outer, Diagram(str(level))
        outer.add(inner=deeper)
    assert [*Plan(outer).system.blocks] == ["inner." * 400 + "one"]
