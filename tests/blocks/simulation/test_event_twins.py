"""Events in C and in Python are twins: a random hybrid system takes the same course in both."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from trussflow.blocks import (
    Block,
    Event,
    Input,
    Mode,
    Output,
    Parameter,
    Simulator,
    State,
    ZeroOrderHold,
)
from trussflow.blocks.framework.diagram import Diagram

KINDS = ("rising", "falling", "both")


class Wild(Block):
    """Two states that turn and are thrown about by events of every kind, at zero to the bit or not."""

    u, y = Input(), Output(5)
    q = State(2)
    count, following, sense = Mode(0.0, 3), Mode("period"), Mode(1.0)
    rising, falling, both = Event("rising"), Event("falling"), Event("both")
    tick = Event("time")
    level, period, turn = Parameter(shape=(3,)), Parameter(), Parameter()
    kick = Parameter(shape=(3,))

    def output(self, t, x, u, p):
        return {"y": np.concatenate([x.q, x.count])}

    def derivative(self, t, x, u, p):
        return {"q": np.stack([x.sense * x.q[1] + u.u, -p.turn * x.q[0] + x.sense])}

    def indicators(self, t, x, u, p):
        values = {"rising": x.q[0], "falling": x.q[1], "both": x.q[0] + x.q[1]}
        return {n: v - p.level[i] for i, (n, v) in enumerate(values.items())} | {
            "tick": x.following
        }

    def on_event(self, t, x, u, p, fired):
        happened = np.stack([np.where(fired[kind], 1.0, 0.0) for kind in KINDS])
        kicked = np.sum(happened * p.kick)
        return {
            "q": np.where(fired.both, x.q, x.q + kicked),
            "count": x.count + happened,
            "following": np.where(fired.tick, x.following + p.period, x.following),
            "sense": np.where(fired.both, -x.sense, x.sense),
        }


def system():
    diagram = Diagram("wild")
    wild, hold = diagram.add(
        wild=Wild(level=np.zeros(3), period=1.0, turn=1.0, kick=np.zeros(3)),
        hold=ZeroOrderHold(0.25),
    )
    wild.y[0] >> hold.u
    hold.y >> wild.u
    return diagram


@pytest.fixture(scope="module")
def both():
    return [
        Simulator(system(), step=0.0625, backend=b, log=["wild.y"])
        for b in ("compiled", "interpreted")
    ]


numbers = st.sampled_from([-1.0, -0.5, -0.25, 0.0, 0.125, 0.5, 0.7, 1.1])
triples = st.lists(numbers, min_size=3, max_size=3)
pairs = st.lists(numbers, min_size=2, max_size=2)


@given(
    level=triples,
    kick=triples,
    period=st.sampled_from([0.25, 0.3, 1.0]),
    turn=numbers,
    q=pairs,
)
def test_twins(both, level, kick, period, turn, q):
    parameters = {
        "wild.level": level,
        "wild.kick": kick,
        "wild.period": period,
        "wild.turn": turn,
    }
    courses = []
    for simulator in both:
        try:
            result = simulator.run(2.0, parameters=parameters, initial={"wild.q": q})
            courses.append(result["wild.y"].values)
        except Exception as error:  # noqa: BLE001 - twins fail alike
            courses.append(
                np.array(
                    [ord(c) for c in f"{type(error).__name__}: {error}"[:60]],
                    dtype=float,
                )
            )
    assert_allclose(courses[0], courses[1], rtol=1e-9, atol=1e-9)
