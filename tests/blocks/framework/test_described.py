"""Descriptions of objects, as text and in notebooks."""

import pytest
from systems import series

from trussflow.blocks import (
    Block,
    Constant,
    CoSimulator,
    Diagram,
    Gain,
    Input,
    Integrator,
    Session,
    Simulator,
    UnitDelay,
    simulate,
)
from trussflow.blocks.errors import DiagramError
from trussflow.blocks.support.summary import MAX_LINE_LENGTH


def loop():
    """Return a sampled loop with a diagram in it."""
    diagram, inner = Diagram("loop"), Diagram("inner")
    inner.expose(u=inner.add(state=Integrator()).u, y=inner.state.y)
    law, delay, _ = diagram.add(law=Gain(-2.0), delay=UnitDelay(0.1), plant=inner)
    law >> delay >> diagram.plant.u
    diagram.plant.y >> law
    return diagram


def test_diagram_is_a_tree():
    diagram = loop()
    assert repr(diagram).splitlines() == [
        "loop: Diagram, 3 blocks, 3 wires",
        "├─ law: Gain; in u (?); out y (?); parameters gain = -2",
        "├─ delay: UnitDelay; sampled every 0.1 s; in u (?); out y (?); states previous; "
        "parameters initial_value = 0",
        "└─ plant: Diagram, 1 blocks, 0 wires; in u (?); out y (?)",
        "   └─ state: Integrator; in u (?); out y (?); states integral; parameters initial_value = 0",
    ]
    for i in range(30):
        diagram.law.y >> diagram.add(f"gain_{i}", Gain(1.0)).u
    outer = Diagram("outer")
    outer.add(
        a_very_long_name_of_a_block_that_leaves_little_room=UnitDelay(0.1, shape=3),
        loop=diagram,
    )
    assert max(map(len, repr(outer).splitlines())) == MAX_LINE_LENGTH


def test_block_tells_its_facts():
    assert repr(UnitDelay(0.1, shape=2)).splitlines() == [
        "UnitDelay",
        "  sampled     every 0.1 s",
        "  in          u (2,)",
        "  out         y (2,)",
        "  states      previous",
        "  parameters  initial_value = 0",
    ]


@pytest.mark.parametrize("fault", [False, True])
def test_block_that_is_not_built_has_a_text(fault):
    class Half(Block):
        u = Input()

        def __init__(self):
            self.text = repr(self)
            if not fault:
                super().__init__()

    assert Half().text == "Half, not built yet"
    assert repr(Half()).startswith("Half")


def test_messages_show_the_title_only():
    with pytest.raises(
        DiagramError, match=r"cannot simulate law: Gain: it is not a Diagram"
    ):
        simulate(loop().law, 1.0, step=0.1)


def test_runs_tell_solver_and_sizes():
    text = repr(Simulator(loop(), step=0.05, backend="numpy", log=["law.y"]))
    assert "rk4, step 0.05 s, backend numpy" in text
    with Session(Integrator(), solver="RK45", rtol=1e-6, backend="numpy") as session:
        session.advance(0.5)
        assert repr(session).startswith("Session of 'Integrator' at 0.5 s")
    diagram = series(one=Constant(1.0), state=Integrator())
    text = repr(CoSimulator(diagram, step=0.1, members=["state"], backend="numpy"))
    assert "jacobi, step 0.1 s" in text
