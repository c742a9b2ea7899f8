"""Taps and injections: new systems in which a signal is added to, replaced, or kept for reading."""

import numpy as np
import pytest

from trussflow.blocks import Constant
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.errors import ParameterError
from trussflow.blocks.framework.external import External
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.rewiring import Adder, injected, probed, readers
from trussflow.blocks.framework.system import flatten
from trussflow.blocks.framework.validation import finite_array
from trussflow.blocks.tracing.plan import Plan


class Reader(Block):
    u = Input((3,), unit="N", frame="body", default=7.0)
    y = Output((3,))

    def output(self, t, x, u, p):
        return {"y": u.u}


def wired():
    """Return a source with two readers: one whole, one of two elements turned round."""
    diagram = Diagram("wired")
    source = diagram.add(source=Constant([1.0, 2.0, 3.0], unit="N", frame="body"))
    whole, part, _ = diagram.add(whole=Reader(), part=Reader(), alone=Reader())
    source.y >> whole.u
    source.y[2:0:-1] >> part.u[0:2]
    diagram.ground(part.u[2])
    diagram.expose(out=whole.y)
    return diagram


def seen(system, name, values=None):
    """Return what a block of the system reads, with the sources from outside at values."""
    plan = Plan(system)
    p = plan.parameters({})
    x, d = plan.initial(p, {}, values or {})
    evaluation = plan.evaluate(0.0, x, d, p)
    return evaluation.input(plan.system.blocks[name], "u")


def put_in(system, port, *, cut, number=1):
    """Return the system with a source from outside at a port, and the name of the source."""
    source = External(port, f"source {number}", start=0.0)
    return injected(system, port, source, cut=cut), source.name


@pytest.mark.parametrize("cut", [False, True])
def test_a_signal_is_added_or_replaced_for_all_that_read_it(cut):
    diagram = wired()
    before = flatten(diagram)
    system, name = put_in(before, diagram.source.y, cut=cut)
    own = np.zeros(3) if cut else np.array([1.0, 2.0, 3.0])
    more = np.array([10.0, 20.0, 30.0])
    np.testing.assert_array_equal(seen(system, "whole", {name: more}), own + more)
    turned = (own + more)[[2, 1]]
    np.testing.assert_array_equal(seen(system, "part", {name: more}), [*turned, 0.0])
    np.testing.assert_array_equal(seen(before, "whole"), [1, 2, 3])  # the first one stays
    np.testing.assert_array_equal(seen(before, "part"), [3, 2, 0])


@pytest.mark.parametrize("cut", [False, True])
def test_slices_reach_only_the_elements_they_name(cut):
    diagram = wired()
    system, name = put_in(flatten(diagram), diagram.source.y[[2, 0]], cut=cut)
    own = np.array([0.0, 2.0, 0.0]) if cut else np.array([1.0, 2.0, 3.0])
    values = {name: np.array([30.0, 10.0])}
    np.testing.assert_array_equal(seen(system, "whole", values), own + np.array([10, 0, 30]))
    np.testing.assert_array_equal(seen(system, "part", values), [own[2] + 30, 2, 0])


@pytest.mark.parametrize("cut", [False, True])
def test_one_input_is_reached_alone_grounded_elements_included(cut):
    diagram = wired()
    system, name = put_in(flatten(diagram), diagram.part.u[1:3], cut=cut)
    values = {name: np.array([20.0, 30.0])}
    np.testing.assert_array_equal(seen(system, "part", values), [3, (0 if cut else 2) + 20, 30])
    np.testing.assert_array_equal(seen(system, "whole", values), [1, 2, 3])


@pytest.mark.parametrize("cut", [False, True])
def test_an_input_that_reads_its_default_goes_on_reading_it_elsewhere(cut):
    diagram = wired()
    system, name = put_in(flatten(diagram), diagram.alone.u[1], cut=cut)
    np.testing.assert_array_equal(seen(system, "alone", {name: np.array(0.5)}), [7, 0.5 if cut else 7.5, 7])
    system, name = put_in(flatten(diagram), diagram.alone.u, cut=cut)
    np.testing.assert_array_equal(seen(system, "alone", {name: np.ones(3)}), np.full(3, 1.0 if cut else 8.0))


def test_injections_add_up_and_a_probe_keeps_what_came_before_them():
    diagram = wired()
    system, tap = probed(flatten(diagram), diagram.whole.u[1:3])
    system, first = put_in(system, diagram.whole.u, cut=False)
    system, second = put_in(system, diagram.whole.u[0], cut=False, number=2)
    values = {first: np.array([10.0, 20.0, 30.0]), second: np.array(100.0)}
    np.testing.assert_array_equal(seen(system, "whole", values), [111, 22, 33])
    plan = Plan(system)
    x, d = plan.initial(plan.parameters({}), {}, values)
    evaluation = plan.evaluate(0.0, x, d, plan.parameters({}))
    whole = evaluation.output(tap.block.port("y"))
    np.testing.assert_array_equal(whole[tap.elements()], [2, 3])
    unchanged, output = probed(system, diagram.source.y)
    assert unchanged is system
    assert output.path == "source.y"


def test_readers_are_named_with_their_elements():
    diagram = wired()
    found = {
        port.path: (given.tolist(), taken.tolist())
        for port, given, taken in readers(flatten(diagram), diagram.source.y[1:3])
    }
    assert found == {"whole.u": ([1, 2], [0, 1]), "part.u": ([0, 1], [1, 0])}
    assert readers(flatten(diagram), diagram.whole.y) == []


def test_a_source_from_outside_takes_over_what_the_input_declares():
    diagram = wired()
    source = External(diagram.alone.u[0:2])
    assert (source.y.shape, source.y.unit, source.y.frame) == ((2,), "N", "body")
    assert source.path == "(u)"
    np.testing.assert_array_equal(source.start_value(), [7, 7])
    np.testing.assert_array_equal(External(diagram.alone.u, start=1.5).start_value(), [1.5] * 3)
    assert source.feedthrough() == {"y": ()}
    junction = Adder(diagram.alone.u)
    assert junction.u.unit == "N"


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("much", r"x must be numeric, not 'much'"),
        ([1.0, 2.0], r"x has shape \(2,\); it must have shape \(3,\)"),
        ([1.0, np.inf, 2.0], r"x is not finite"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(value, message):
    with pytest.raises(ParameterError, match=message):
        finite_array("x", value, (3,))


def test_numbers_are_spread_over_the_shape_wanted():
    np.testing.assert_array_equal(finite_array("x", 2, (2, 2)), np.full((2, 2), 2.0))
