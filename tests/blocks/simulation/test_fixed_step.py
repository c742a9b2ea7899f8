"""The fixed step means the same in C and in Python, wherever on the axis of time it lies."""

import pytest

from trussflow.blocks import Diagram, Integrator, Session, Step


@pytest.mark.parametrize("backend", ["numpy", "interpreted", "compiled"])
@pytest.mark.parametrize("solver", ["rk4", "euler"])
@pytest.mark.parametrize("jump", [-0.5, 0.0, 0.5])
@pytest.mark.parametrize("start", [-1.0, 0.0, 0.2])
def test_a_signal_that_jumps_where_a_step_ends_belongs_to_the_step_after(
    start: float, jump: float, solver: str, backend: str
) -> None:
    """The integral of a unit step, whose jump is on the grid, is exact: its last stage is before."""
    diagram = Diagram("jump")
    force, integral = diagram.add(force=Step(jump), integral=Integrator())
    force >> integral
    diagram.expose(y=integral.y)
    with Session(diagram, step=0.1, solver=solver, backend=backend) as session:
        session.start(time=start)
        session.advance(1.0)
        assert session.outputs["y"] == pytest.approx(1.0 - max(start, jump), abs=1e-14)
