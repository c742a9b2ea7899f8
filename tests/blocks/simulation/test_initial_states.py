"""Initial states that follow from inputs settle, or are refused; blocks may be wired to themselves."""

from itertools import pairwise

import numpy as np
import pytest
from systems import Follower, ring, series

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    Function,
    Input,
    OperatingPoint,
    Output,
    Session,
    cosimulate,
    linearize,
    simulate,
)
from trussflow.blocks.errors import SimulationError
from trussflow.blocks.framework.run_state import SelfStepping


class PythonFollower(Follower):
    traced = False


def followers(number, *, circle):
    """Return blocks in a row, added from the last to the first: the worst order to go through."""
    diagram = Diagram("followers")
    names = [f"f{i}" for i in range(number)]
    diagram.add(**{name: Follower() for name in reversed(names)})
    for first, second in pairwise(names):
        diagram.blocks[first] >> diagram.blocks[second]
    if circle:
        diagram.blocks[names[-1]] >> diagram.blocks[names[0]]
    else:
        diagram.ground(diagram.blocks[names[0]].port("u"))
    return diagram


@pytest.mark.parametrize("number", [1, 2, 7])
def test_a_chain_settles_in_whatever_order(number, backend):
    result = simulate(followers(number, circle=False), 0.1, step=0.1, backend=backend)
    assert [result[f"f{i}.y"][-1] for i in range(number)] == [
        i + 1.0 for i in range(number)
    ]


@pytest.mark.parametrize("number", [1, 3])
def test_a_circle_is_refused_wherever_it_is_run(number):
    diagram = followers(number, circle=True)
    message = r"initial states of 'followers' do not settle: .* 'f0'.* depend on each other in a circle"
    with pytest.raises(SimulationError, match=message):
        simulate(diagram, 0.1, step=0.1)
    with pytest.raises(SimulationError, match=message):
        linearize(diagram, "f0.u", "f0.y")
    with pytest.raises(SimulationError, match="do not settle"):
        cosimulate(diagram, 0.1, step=0.1, members=["f0"])


def test_a_circle_is_opened_by_a_value_that_is_given():
    result = simulate(followers(2, circle=True), 0.1, step=0.1, initial={"f0.x": 3.0})
    assert [result[f"f{i}.y"][-1] for i in range(2)] == [3.0, 4.0]


def test_held_outputs_in_a_circle_are_no_operating_point():
    """Each clock holds twice what the other holds, and one more: going through them never ends."""
    diagram = Diagram("holding")
    for name, offset in (("a", 0.0), ("b", 0.1)):
        diagram.add(**{name: Function(lambda u: 2.0 * u + 1.0).sampled(0.2, offset)})
    diagram.a >> diagram.b >> diagram.a
    with pytest.raises(
        SimulationError, match=r"hold at this operating point do not settle"
    ):
        linearize(diagram, "a.u", "a.y")
    model = linearize(
        diagram, "a.u", "a.y", at=OperatingPoint(held={"a.y": -1.0, "b.y": -1.0})
    )
    assert model.operating_point.held == {"a.y": -1.0, "b.y": -1.0}


class Asked(Block):
    """A Python block that shows twice its input, and how often it was asked."""

    u, y = Input(), Output()
    traced = False

    def __init__(self):
        self.times = []
        super().__init__()

    def output(self, t, x, u, p):
        self.times.append(t)
        return {"y": 2.0 * u.u}


@pytest.mark.parametrize("every", [None, 0.1])
@pytest.mark.parametrize("begin", [Follower, PythonFollower])
@pytest.mark.parametrize("runs", [simulate, cosimulate])
def test_python_blocks_are_asked_where_they_lead_to_initial_states(every, begin, runs):
    """They had shown nothing yet: what starts at their output started at zero."""
    diagram = Diagram("python")
    diagram.add(
        last=begin(),
        second=Asked(),
        middle=begin(),
        first=Asked(),
        source=Constant(1.5),
    )
    for block in (diagram.first, diagram.second):
        if every:
            block.sampled(every)
    diagram.source >> diagram.first >> diagram.middle >> diagram.second >> diagram.last
    result = runs(diagram, 0.2, step=0.1)
    assert (result["middle.y"] == 4.0).all()
    assert (result["last.y"] == 9.0).all()


class Doubled(SelfStepping):
    """Twice the input and one, the time, the other input, and the first input; it steps itself."""

    def start(self, time, inputs):
        self.time, self.inputs = time, np.nan_to_num(inputs)
        self.first = self.inputs[0]

    def set(self, inputs, rates=None):
        self.inputs = inputs

    def advance(self, now, until):
        self.time = until

    def outputs(self):
        u, later = self.inputs
        return np.array([2.0 * u + 1.0, 7.0 + self.time, later, self.first])

    def save(self):
        return self.time, self.inputs, self.first

    def restore(self, saved):
        self.time, self.inputs, self.first = saved


class Stepping(Block):
    traced = False
    steps_itself = True
    u, later = Input(), Input()
    y, clock, seen, first = Output(), Output(), Output(), Output()

    def feedthrough(self):
        return {"y": ("u",), "clock": (), "seen": (), "first": ("u",)}

    def open(self, p):
        return Doubled()


@pytest.mark.parametrize("begin", [Follower, PythonFollower])
@pytest.mark.parametrize("runs", [simulate, cosimulate])
def test_blocks_that_step_themselves_are_asked_where_they_lead_to_initial_states(
    begin, runs
):
    """It had shown nothing yet, in a simulation: what starts at its output started at zero."""
    diagram = Diagram("stepping")
    source, first, middle, second, last = diagram.add(
        source=Constant(1.5),
        first=Stepping(),
        middle=begin(),
        second=Stepping(),
        last=begin(),
    )
    for block in (first, second):
        block.sampled(0.1)
        last.y >> block.later  # on which nothing depends at once
    source >> first.u
    first.y >> middle >> second.u
    second.y >> last
    begun = diagram.add(begun=begin())
    first.clock >> begun
    result = runs(diagram, 0.2, step=0.1)
    assert (result["middle.y"] == 5.0).all()
    assert (result["second.y"] == 11.0).all()
    assert (result["last.y"] == 12.0).all()
    assert (result["begun.y"] == 8.0).all()


def test_blocks_that_step_themselves_begin_again_where_a_session_is_restored_to_its_start():
    """Asked for initial states, it knew but the inputs that its outputs depend on, and none for its step."""
    diagram = Diagram("restored")
    one, stepping, begin = diagram.add(
        one=Constant(1.5), stepping=Stepping(), begin=Follower()
    )
    stepping.sampled(0.1)
    one >> stepping.u
    one >> stepping.later
    stepping.y >> begin
    diagram.expose(y=begin.y, later=stepping.seen)
    with Session(diagram, step=0.1) as session:
        session.start()
        start = session.save()
        for _ in range(2):
            session.advance(0.2)
            assert session.outputs == {"y": 5.0, "later": 1.5}
            session.restore(start)


def test_blocks_that_step_themselves_begin_with_the_inputs_of_their_first_step():
    """Also if its outputs were read before these were set."""
    with Session(Stepping().sampled(0.1), step=0.1) as session:
        for until, u, first in ((0.0, 1.0, 1.0), (0.1, 2.0, 2.0), (0.2, 3.0, 2.0)):
            session.set(u=u)
            assert session.outputs["first"] == first
            assert session.outputs["y"] == 2.0 * u + 1.0
            session.advance(until)


def test_python_blocks_in_a_circle_are_asked_once():
    """Noise and counters never settle: nothing waits for that."""
    diagram = ring("circle", begin=Follower(), asked=Asked().sampled(0.1))
    result = simulate(diagram, 0.1, step=0.1)
    # 1, if the loop shows 0, so 1 + 2 * 1
    assert result["begin.y"].values.tolist() == [3.0, 3.0]
    assert diagram.blocks["asked"].times == [0.0, 0.0, 0.1]


def test_python_blocks_that_begin_later_show_nothing_yet():
    diagram = series(
        "later", source=Constant(1.0), asked=Asked().sampled(0.2, 0.1), begin=Follower()
    )
    assert simulate(diagram, 0.1, step=0.1)["begin.y"].values.tolist() == [1.0, 1.0]
    assert diagram.asked.times == [0.1]
