"""Real-time pacing: no instant comes before its wall time, and what comes later is counted."""

import numpy as np
import pytest
from systems import ports, series

from trussflow.blocks import (
    Constant,
    Integrator,
    PythonFunction,
    Session,
    Sine,
    simulate,
)
from trussflow.blocks.errors import SimulationError
from trussflow.blocks.simulation import pacing
from trussflow.blocks.simulation.pacing import PACED_SECONDS


class Wall:
    """A clock that only waits, and `work`, advance."""

    def __init__(self):
        self.now = 100.0
        self.waits = []

    def perf_counter(self):
        return self.now

    def sleep(self, seconds):
        self.waits.append(seconds)
        self.now += seconds

    def work(self, seconds):
        self.now += seconds


@pytest.fixture
def wall(monkeypatch):
    clock = Wall()
    monkeypatch.setattr(pacing, "time", clock)
    return clock


def watched(wall, sample_time, busy=lambda _: 0.0):
    """Return a diagram whose block notes simulated and wall time, and works for some wall time."""
    seen = []

    def note(t):
        seen.append((float(t), wall.now - 100.0))
        wall.work(busy(float(t)))
        return t

    note = PythonFunction(note, sample_time, **ports(t=(), y=()))
    return series("watched", one=Constant(1.0), clock=Integrator(), note=note), seen


@pytest.mark.parametrize("solver", [{"step": 0.05}, {"solver": "RK45"}])
@pytest.mark.parametrize("pace", [0.5, 1.0, 4.0])
def test_instants_come_at_their_wall_time(wall, pace, solver):
    diagram, seen = watched(wall, 0.1)
    result = simulate(diagram, 1.0, pace=pace, **solver)
    for simulated, walls in seen[2:]:  # behind the evaluation at the start
        assert walls == pytest.approx(simulated / pace, abs=1e-9)
    assert wall.now - 100.0 == pytest.approx(1.0 / pace)
    assert (result.attrs["overruns"], result.attrs["largest_delay"]) == (0, 0.0)
    assert simulate(diagram, 1.0, **solver).equals(result)


@pytest.mark.filterwarnings("ignore:'watched' was too slow")
def test_a_delay_is_counted_and_made_up_for(wall):
    diagram, seen = watched(wall, 0.1, lambda t: 0.25 if abs(t - 0.3) < 0.01 else 0.02)
    result = simulate(diagram, 1.0, step=0.1, pace=1.0)
    late = {round(t, 1): w - t for t, w in seen[1:]}
    assert late[0.4] == pytest.approx(0.15)
    assert late[0.5] == pytest.approx(0.07)
    assert late[0.6] == pytest.approx(0.0, abs=1e-9)
    assert result.attrs["overruns"] == 2
    assert result.attrs["largest_delay"] == pytest.approx(0.15)


def test_a_late_run_warns(wall):
    diagram, _ = watched(wall, 0.1, lambda _: 0.2)
    with pytest.warns(
        match=r"'watched' was too slow for pace=1 10 times, by up to 1 s"
    ):
        simulate(diagram, 1.0, step=0.1, pace=1.0)


@pytest.mark.parametrize("settings", [{"step": 0.05}, {"solver": "RK45"}])
def test_each_step_waits(wall, settings):
    diagram = series("steps", sine=Sine(1.0, 20.0), x=Integrator())
    result = simulate(diagram, 1.0, pace=1.0, **settings)
    assert len(wall.waits) == result.attrs.get("steps", 20)
    assert sum(wall.waits) == pytest.approx(1.0)


def test_short_steps_are_taken_in_groups_of_a_millisecond(wall):
    diagram = series("short", one=Constant(1.0), x=Integrator())
    simulate(diagram, 0.1, step=1e-4, pace=np.float32(2.0))
    assert len(wall.waits) == pytest.approx(0.05 / PACED_SECONDS, abs=1)
    assert sum(wall.waits) == pytest.approx(0.05)


@pytest.mark.parametrize("settings", [{"step": 0.01}, {"solver": "RK45"}])
def test_a_session_keeps_pace_from_its_start_and_from_a_snapshot(wall, settings):
    diagram = series("session", one=Constant(1.0), x=Integrator())
    with Session(diagram, **settings) as session:
        assert session.pacer is None
        session.start(pace=2.0, time=3.0)
        wall.work(0.0005)
        session.advance(4.0)
        assert wall.now == pytest.approx(100.5)
        assert session.pacer.overruns == 0
        saved = session.save()
        wall.work(7.0)
        session.restore(saved)
        session.advance(4.005)  # between two steps
        assert wall.now == pytest.approx(107.5025)
        wall.work(0.5)
        session.advance(4.1)
        assert session.pacer.overruns >= 1
        assert session.pacer.largest_delay == pytest.approx(0.5, abs=0.05)


def test_a_pace_is_a_positive_number():
    diagram = series("d", one=Constant(1.0), x=Integrator())
    with pytest.raises(SimulationError, match="pace = 0 must be a positive"):
        simulate(diagram, 1.0, step=0.1, pace=0)
    with pytest.raises(SimulationError, match="pace = -1 must be a positive"):
        Session(diagram, step=0.1).start(pace=-1)
