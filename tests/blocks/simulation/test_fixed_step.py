"""The fixed step means the same in C and in Python, wherever on the axis of time it lies."""

import warnings

import numpy as np
import pytest

from trussflow.blocks import Diagram, Integrator, Session, StateSpace, Step, simulate
from trussflow.blocks.errors import SimulationWarning
from trussflow.blocks.simulation.solver import FIXED_STEP


@pytest.mark.parametrize("solver", FIXED_STEP)
def test_a_signal_that_jumps_where_a_step_ends_belongs_to_the_step_after(
    solver, backend
):
    """The integral of a unit step, whose jump is on the grid, is exact: its last stage is before."""
    diagram, jumps = Diagram("jump"), {"early": -0.5, "now": 0.0, "late": 0.5}
    for name, jump in jumps.items():
        integral = diagram.add(f"force_{name}", Step(jump)) >> diagram.add(
            f"integral_{name}", Integrator()
        )
        diagram.expose(**{name: integral.y})
    with Session(diagram, step=0.1, solver=solver, backend=backend) as session:
        for start in (-1.0, 0.0, 0.2):
            session.start(time=start)
            session.advance(1.0)
            expected = 1.0 - np.maximum(start, [*jumps.values()])
            assert [*session.outputs.values()] == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize("solver", FIXED_STEP)
def test_steps_beyond_stability_are_told_from_a_plant_that_is_unstable(solver):
    """A lag of 1 ms in steps of 10 ms, which ends at 1e20 and more; and e^(10 t) at 5 s, as large."""

    def run(pole, duration):
        lag = StateSpace([[pole]], [[0.0]], [[1.0]], [[0.0]])
        diagram = Diagram("lag")
        diagram.ground(diagram.add(lag=lag).u)
        result = simulate(
            diagram, duration, initial={"lag.x": [1.0]}, step=0.01, solver=solver
        )
        return abs(result["lag.y"][-1, 0])

    with pytest.warns(
        SimulationWarning, match=r"'lag\.x' .*would change by more than itself"
    ):
        assert run(-1000.0, 0.3) > 1e20
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert run(10.0, 5.0) > 1e20
