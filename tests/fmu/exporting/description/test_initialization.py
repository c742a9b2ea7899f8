"""Initial states that blocks set from their inputs: in any order, but not in a circle."""

from itertools import pairwise

import numpy as np
import pytest
from systems import Follower

from trussflow.blocks import Diagram, Gain, Input, Output, State
from trussflow.fmu.errors import ExportError
from trussflow.fmu.exporting.description.export_interface import ExportInterface


class Pair(Follower):
    """Two levels: the first starts at three, the second one above the first input."""

    u, y = Input(2), Output(2)
    x = State(2)

    def initial_state(self, u, p):
        return {"x": np.stack([3.0 + 0.0 * u.u[0], u.u[0] + 1])}


def circle(*blocks):
    """Return blocks each of which reads the one before; the first reads the last, doubled."""
    diagram = Diagram("circle")
    double = diagram.add(double=Gain(2.0), **dict(zip("abcd", blocks, strict=False)))[0]
    for before, block in pairwise((double, *blocks, double)):
        before.port("y") >> block.port("u")
    diagram.expose(**{f"{block.name}_y": block.port("y") for block in blocks})
    return diagram


@pytest.mark.parametrize(
    "number, text",
    [
        (1, r"the initial states of 'a' \(Follower\) depend on themselves in a cycle"),
        (
            2,
            r"the initial states of '[ab]' \(Follower\), '[ab]' \(Follower\) depend on themselves",
        ),
    ],
)
def test_initial_states_in_a_circle_are_refused(number, text):
    """A block outside the circle is not blamed."""
    diagram = circle(*(Follower() for _ in range(number)))
    beside = diagram.add(beside=Follower())
    diagram.blocks["a"].port("y") >> beside.u
    with pytest.raises(
        ExportError, match=f"cannot export 'circle': {text}.*let one of them start"
    ) as caught:
        ExportInterface.of(diagram)
    assert "beside" not in str(caught.value)


def test_a_chain_starts_right_in_whatever_order_it_was_added(
    version, exported, instance
):
    """From the input 2 to 3, 4 and 5; set again before the end of initialization, from 7."""
    diagram = Diagram("chain")
    c, b, a = diagram.add(c=Follower(), b=Follower(), a=Follower())
    a.y >> b.u
    b.y >> c.u
    diagram.expose(u=a.u, one=a.y, two=b.y, three=c.y)
    path = exported(diagram, version, start={"u": 2.0})
    for values, begin in (({}, 2.0), ({"u": 7.0}, 7.0)):
        one = instance(path).start(values)
        assert one.get("one", "two", "three").tolist() == [
            begin + 1,
            begin + 2,
            begin + 3,
        ]


def test_a_circle_of_blocks_whose_elements_make_none_starts_right(
    version, exported, instance
):
    one = instance(exported(circle(Pair(), Pair()), version)).start()
    assert one.get("a_y", "b_y").tolist() == [3.0, 7.0, 3.0, 4.0]
