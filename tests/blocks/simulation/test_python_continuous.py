"""Continuous Python blocks: one solver with the traced ones, and events located exactly."""

import numpy as np
import pytest
import systems
from numpy.testing import assert_array_equal
from systems import assert_near, ports, series

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    Event,
    Gain,
    Integrator,
    Output,
    PythonFunction,
    Session,
    State,
    Sum,
    ZeroOrderHold,
    simulate,
)
from trussflow.blocks.errors import SimulationError
from trussflow.blocks.framework.run_state import Running

SOLVERS = ("rk4", "euler", "RK45", "DOP853", "Rodas5P", "auto")


class Oscillator(systems.Oscillator):
    """The oscillator in Python."""

    traced = False

    def feedthrough(self):
        return {"y": ()}


def closed_loop(plant):
    loop = Diagram("loop")
    loop.add(
        plant=plant,
        gain=Gain(0.7, output_unit="N"),
        integral=Integrator(),
        total=Sum("--"),
    )
    loop.plant.y[1] >> loop.gain >> loop.total.u1
    loop.plant.y[0] >> loop.integral >> loop.total.u2
    loop.total >> loop.plant
    return loop


@pytest.mark.parametrize("solver", ["rk4", "euler", "DOP853", "Rodas5P"])
@pytest.mark.parametrize("backend", ["compiled", "numpy"])
def test_it_is_integrated_together_with_traced_blocks(solver, backend):
    """A closed loop at the level of solver stages: the same numbers as the traced twin."""
    python, traced = (
        simulate(
            closed_loop(plant),
            0.5,
            step=0.01,
            solver=solver,
            backend=backend,
            log_step=0.1,
        )
        for plant in (Oscillator(), systems.Oscillator())
    )
    # Rodas5P's Jacobian is by differences in one
    tolerance = 1e-12 if solver != "Rodas5P" else 1e-6
    for name in ("plant.y", "integral.y"):
        assert_near(python[name], traced[name], tolerance)


class StairRun(Running):
    """Keeps the times that are still to come."""

    def __init__(self, due):
        self.due = list(due)

    def output(self, t, x, u, p):
        return {"y": x.level}

    def derivative(self, t, x, u, p):
        return {"level": np.zeros(())}

    def indicators(self, t, x, u, p):
        return {"step": self.due[0]}

    def on_event(self, t, x, u, p, fired):
        assert t == self.due.pop(0)
        return {"level": x.level + 1}


class Stair(Block):
    """A state that jumps by one at 0.35, 0.7, ... s."""

    traced = False
    continuous = True
    y = Output()
    level = State()
    step = Event("time")

    def __init__(self, period=0.35):
        self.due = [period * k for k in range(1, 10)]
        super().__init__()

    def open(self, p):
        return StairRun(self.due)


class Impatient(Oscillator):
    """Asks for an event after every step."""

    steps = 0

    def on_step(self, t, x, u, p):
        type(self).steps += 1
        return True

    def on_event(self, t, x, u, p, fired):
        return {"q": 1.0, "v": 0.0}


def test_a_block_may_ask_for_an_event_after_a_step():
    Impatient.steps = 0
    diagram = Diagram("impatient")
    block, zero = diagram.add(block=Impatient(), zero=Constant(0.0))
    zero >> block
    result = simulate(diagram, 1.0, step=0.25)
    assert Impatient.steps == 4
    assert_array_equal(result["block.y"][1:], [[1.0, 0.0]] * 4)


class EndlessRun(StairRun):
    def indicators(self, t, x, u, p):
        return {"step": 0.5}

    def on_event(self, t, x, u, p, fired):
        return {}


class Endless(Stair):
    def open(self, p):
        return EndlessRun([])


def test_events_without_end_are_refused(solver):
    diagram = series(stair=Endless())
    with pytest.raises(SimulationError, match=r"events without end at t = 0\.5 s"):
        simulate(diagram, 1.0, step=0.1, solver=solver)


@pytest.mark.parametrize("solver", SOLVERS)
def test_time_events_at_instants_come_before_what_is_sampled_and_logged(solver):
    """A stair that jumps with the clock of what reads it: as with a traced source that jumps."""
    diagram = series("stair", stair=Stair(0.5), hold=ZeroOrderHold(0.25))
    expected = [0.0, 0.0, 1.0, 1.0, 2.0]
    result = simulate(diagram, 1.0, step=0.25, solver=solver, log_step=0.25)
    assert_array_equal(result["stair.y"], expected)
    assert_array_equal(result["hold.y"], expected)

    alone = series("stair", stair=Stair(0.5))
    result = simulate(alone, 1.0, step=0.25, solver=solver, log_step=0.25)
    assert_array_equal(result["stair.y"], expected)  # within the span of a solver
    with Session(Stair(0.5), step=0.25, solver=solver) as session:
        session.advance(0.5)
        assert session.outputs["y"] == 1.0


@pytest.mark.parametrize("solver", ["rk4", "euler", "RK45"])
def test_an_indicator_that_is_zero_at_the_end_of_a_step_is_an_event(solver):
    """A ball whose steps, powers of two, end exactly at its bounce."""
    diagram = series(ball=systems.PythonBall(gravity=0.0, restitution=1.0))
    diagram.ball.height >> diagram.add(hold=ZeroOrderHold(0.25))
    result = simulate(diagram, 1.5, step=0.25, solver=solver, initial={"ball.v": -1.0})
    assert result["ball.height"].values[-1] == pytest.approx(0.5, abs=1e-12)


def test_equations_are_evaluated_in_the_order_of_their_dependencies():
    """Two Python blocks in a row, the second with direct feedthrough of the first's output, and a sampled one."""

    class Direct(Oscillator):
        def output(self, t, x, u, p):
            return {"y": np.array([u.u, 2 * u.u])}

        def feedthrough(self):
            return {"y": ("u",)}

    diagram = Diagram("row")
    second, first, gain, zero = diagram.add(
        second=Direct(),
        first=Oscillator(),
        gain=Gain(3.0, output_unit="N"),
        zero=Constant(0.0),
    )
    zero >> first
    reader = PythonFunction(lambda u: u, 0.01, **ports(u=2, y=2))
    first.y[0] >> gain >> second >> diagram.add(reader=reader)
    result = simulate(diagram, 1.0, step=0.01)
    assert_array_equal(result["second.y"][:, 0], 3 * result["first.y"][:, 0])
    assert_array_equal(result["reader.y"], result["second.y"])
