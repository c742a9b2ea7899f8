"""Taps and injections: new systems in which a signal is added to, replaced, or kept for reading."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import series

from trussflow.blocks import Constant
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.external_inputs import External
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.signal_injection import Adder, injected, probed, readers
from trussflow.blocks.framework.system import flatten
from trussflow.blocks.tracing.plan import Plan


class Reader(Block):
    u = Input((3,), unit="N", frame="body", default=7.0)
    y = Output((3,))

    def output(self, t, x, u, p):
        return {"y": u.u}


def wired():
    """Return a source with two readers: one whole, one of two elements turned round."""
    diagram = series(source=Constant([1.0, 2.0, 3.0], unit="N", frame="body"))
    whole, part, _ = diagram.add(whole=Reader(), part=Reader(), alone=Reader())
    diagram.source.y >> whole.u
    diagram.source.y[2:0:-1] >> part.u[0:2]
    diagram.ground(part.u[2])
    diagram.expose(out=whole.y)
    return diagram


def seen(system, name, values=None):
    """Return what a block of the system reads, with the sources from outside at values."""
    plan = Plan(system)
    p = plan.parameters({})
    x, d = plan.initial(p, {}, values or {})
    evaluation = plan.evaluate(0.0, x, d, p)
    return evaluation.value(plan.system.blocks[name].port("u"))


def put_in(system, port, *, cut, number=1):
    """Return the system with a source from outside at a port, and the name of the source."""
    source = External(port, f"source {number}", start=0.0)
    return injected(system, port, source, cut=cut), source.name


@pytest.mark.parametrize("cut", [False, True])
@pytest.mark.parametrize(
    "name, index",
    [
        ("source", [0, 1, 2]),
        ("source", [2, 0]),
        ("part", [1, 2]),
        ("alone", 1),
        ("alone", [0, 1, 2]),
    ],
)
def test_elements_are_added_to_or_replaced_for_all_that_read_them(name, index, cut):
    """At an output for each of its readers, at an input there alone; defaults and ground included."""
    signals = {
        "source": [1.0, 2.0, 3.0],
        "part": [3.0, 2.0, 0.0],
        "alone": [7.0, 7.0, 7.0],
    }
    expected = {each: np.array(values) for each, values in signals.items()}
    more = 10.0 * (1.0 + np.arange(3))[index]
    expected[name][index] = more + (0.0 if cut else expected[name][index])
    expected["whole"] = expected.pop("source")
    if name == "source":
        expected["part"][:2] = expected["whole"][[2, 1]]
    diagram = wired()
    before = flatten(diagram)
    block = diagram.blocks[name]
    system, source = put_in(
        before, (block.only_output() if name == "source" else block.u)[index], cut=cut
    )
    for reader, values in expected.items():
        assert_array_equal(seen(system, reader, {source: more}), values)
    assert_array_equal(seen(before, "whole"), [1, 2, 3])
    assert_array_equal(seen(before, "part"), [3, 2, 0])


def test_a_whole_output_is_replaced():
    diagram = wired()
    system, name = put_in(flatten(diagram), diagram.source.y, cut=True)
    assert_array_equal(
        seen(system, "part", {name: np.array([10.0, 20.0, 30.0])}), [30, 20, 0]
    )


def test_injections_add_up_and_a_probe_keeps_what_came_before_them():
    diagram = wired()
    system, tap = probed(flatten(diagram), diagram.whole.u[1:3])
    system, first = put_in(system, diagram.whole.u, cut=False)
    system, second = put_in(system, diagram.whole.u[0], cut=False, number=2)
    values = {first: np.array([10.0, 20.0, 30.0]), second: np.array(100.0)}
    assert_array_equal(seen(system, "whole", values), [111, 22, 33])
    plan = Plan(system)
    x, d = plan.initial(plan.parameters({}), {}, values)
    evaluation = plan.evaluate(0.0, x, d, plan.parameters({}))
    whole = evaluation.output(tap.block.port("y"))
    assert_array_equal(whole[tap.elements()], [2, 3])
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
    assert_array_equal(source.start_value(), [7, 7])
    assert_array_equal(External(diagram.alone.u, start=1.5).start_value(), [1.5] * 3)
    assert source.feedthrough() == {"y": ()}
    junction = Adder(diagram.alone.u)
    assert junction.u.unit == "N"
