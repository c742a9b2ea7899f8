"""Where linear models put in and read out: fans, slices, nested diagrams, cuts, defaults."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import ports

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    Function,
    Gain,
    Input,
    Integrator,
    MatrixGain,
    OperatingPoint,
    Operation,
    Output,
    linearize,
)
from trussflow.blocks.errors import LinearAnalysisError


def two_readers():
    """One output that two blocks read; one of them only a part of it."""
    diagram = Diagram("two readers")
    source, first, second = diagram.add(
        source=Integrator([0.0, 0.0]), first=Gain(3.0), second=MatrixGain([[5.0]])
    )
    source >> first
    source.y[1:2] >> second
    diagram.expose(u=source.u, y=first.y, z=second.y)
    return diagram


def test_an_input_at_an_output_reaches_all_that_read_it_and_one_at_an_input_only_that():
    diagram = two_readers()
    both = linearize(diagram, "source.y", ["y", "z"])
    assert_array_equal(both.D, [[3, 0], [0, 3], [0, 5]])
    assert_array_equal(both.C, [[3, 0], [0, 3], [0, 5]])
    alone = linearize(diagram, "first.u", ["y", "z"])
    assert_array_equal(alone.D, [[3, 0], [0, 3], [0, 0]])
    source = linearize(diagram, "source.y", ["source.y", "first.u"])
    assert_array_equal(source.D, [[0, 0], [0, 0], [1, 0], [0, 1]])


def test_a_cut_output_no_longer_reaches_any_reader():
    diagram = two_readers()
    model = linearize(diagram, "source.y[1]", ["y", "z"], cut="source.y[1]")
    assert_array_equal(model.D, [[0], [3], [5]])
    assert_array_equal(model.C, [[3, 0], [0, 0], [0, 0]])
    frozen = linearize(diagram, "u", ["y", "z"], cut="source.y")
    assert not frozen.C.any()
    assert not frozen.D.any()
    one_wire = linearize(diagram, "source.y", ["y", "z"], cut="first.u")
    assert_array_equal(one_wire.D, [[0, 0], [0, 0], [0, 5]])


def test_a_cut_wire_keeps_the_value_it_has_at_the_point():
    diagram = Diagram()
    two, gain, product, rate = diagram.add(
        two=Constant(2.0),
        gain=Gain(7.0),
        product=Operation(np.multiply),
        rate=Integrator(3.0),
    )
    two >> gain >> product.u1
    rate >> product.u2
    diagram.expose(u=rate.u, y=product.y)
    wires = [product.u1, product.u2]
    cut = linearize(diagram, wires, "y", cut=wires)
    assert_array_equal(cut.D, [[3.0, 14.0]])
    assert not cut.C.any()
    assert_array_equal(linearize(diagram, "u", "y", cut="gain.y").C, [[14.0]])


def test_what_arrives_at_a_cut_input_can_be_read_there():
    diagram = two_readers()
    model = linearize(
        diagram, ["first.u[0]", "source.y[1]"], "first.u[0]", cut="first.u[0]"
    )
    assert_array_equal(model.C, [[1, 0]])
    assert_array_equal(model.D, [[0, 0]])


def nested():
    """Return a gain of 6 within a diagram within a diagram, and an input that fans out."""
    inner, middle, outer = Diagram("inner"), Diagram("middle"), Diagram("outer")
    g, h = inner.add(g=Gain([2.0, 4.0]), h=Gain([1.0, 10.0]))
    inner.expose(u=(g.u, h.u), y=g.y, z=h.y)
    middle.add(inner=inner, k=Gain([3.0, 3.0]))
    inner.y >> middle.k
    middle.expose(u=inner.u, y=middle.k.y, z=inner.z)
    outer.add(middle=middle, i=Integrator([0.0, 0.0]))
    outer.i >> middle.u
    outer.expose(u=outer.i.u, y=middle.y, z=middle.z)
    return outer


@pytest.mark.parametrize("where", ["middle.u", "middle.inner.u"])
@pytest.mark.parametrize("cut", [False, True])
def test_ports_of_nested_diagrams_stand_for_all_blocks_behind_them(where, cut):
    model = linearize(
        nested(), f"{where}[1]", ["y[1]", "z[1]"], cut=f"{where}[1]" if cut else ()
    )
    assert_array_equal(model.D, [[12], [10]])
    assert_array_equal(model.C, [[0, 0 if cut else 12], [0, 0 if cut else 10]])
    assert model.input_labels == [f"{where.replace('.', '/')}[1]"]
    one = linearize(nested(), "middle.inner.h.u", ["y", "middle.inner.h.y"])
    assert_array_equal(one.D, np.vstack([np.zeros((2, 2)), np.diag([1, 10])]))


def test_one_signal_under_two_names_is_one_signal():
    model = linearize(nested(), "middle.u", "y", cut="middle.inner.u")
    assert_array_equal(model.D, np.diag([6, 12]))
    assert not model.C.any()


class WithDefault(Block):
    """Multiplies two inputs; the second is 3 where nothing is wired."""

    a = Input(2)
    b = Input(2, default=3.0)
    y = Output(2)

    def output(self, t, x, u, p):
        return {"y": u.a * u.b}


def test_inputs_with_defaults_keep_them_where_they_are_not_cut():
    diagram = Diagram()
    source, block = diagram.add(source=Integrator([1.0, 2.0]), block=WithDefault())
    source >> block.a
    diagram.expose(u=source.u, y=block.y)
    added = linearize(diagram, ["source.y", "block.b"], "y")
    assert_array_equal(added.D, [[3, 0, 1, 0], [0, 3, 0, 2]])
    part = linearize(diagram, ["source.y", "block.b[0]"], "y", cut="block.b[0]")
    assert_array_equal(part.D, [[3, 0, 1], [0, 3, 0]])
    whole = linearize(diagram, ["source.y", "block.b"], "y", cut="block.b")
    assert_array_equal(whole.D, added.D)
    alone = linearize(WithDefault(), at=OperatingPoint(inputs={"a": [1.0, 2.0]}))
    assert_array_equal(alone.D, added.D)


def test_grounded_inputs_can_be_driven_too():
    diagram = Diagram()
    gain = diagram.add(gain=Gain([2.0, 5.0]))
    diagram.ground(gain.u[0])
    diagram.add(c=Constant([1.0])) >> gain.u[1:2]
    diagram.expose(y=gain.y)
    for cut in ((), "gain.u"):
        assert_array_equal(
            linearize(diagram, "gain.u", "y", cut=cut).D, np.diag([2.0, 5.0])
        )


def test_a_state_without_influence_stays_but_unused_inputs_may_have_no_derivative():
    block = Function(lambda a, b: a + np.sqrt(b), **ports(a=(), b=(), y=()))
    assert linearize(block, "a", "y").D == [[1.0]]
    with pytest.raises(
        LinearAnalysisError, match=r"no finite derivative by b at this point"
    ):
        linearize(block, ["a", "b"], "y")
    lonely = Diagram()
    lonely.add(i=Integrator(), g=Gain(2.0))
    lonely.expose(u=lonely.i.u, v=lonely.g.u, y=lonely.g.y)
    model = linearize(lonely)
    assert model.state_labels == ["i/integral"]
    assert_array_equal(model.D, [[0, 2]])


def test_a_state_without_derivative_is_named():
    diagram = Diagram()
    i, root = diagram.add(i=Integrator(), root=Function(np.sqrt))
    i >> root >> i
    with pytest.raises(
        LinearAnalysisError, match=r"no finite derivative by i/integral at this point"
    ):
        linearize(diagram, "i.u", "i.y")
