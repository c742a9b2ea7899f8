"""What Python blocks keep in a run: opened, closed, saved and restored with it, never shared."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from systems import HiddenSum, HiddenSumRun, Time

from trussflow.blocks import (
    Block,
    Diagram,
    Input,
    Integrator,
    Output,
    Parameter,
    Session,
    Simulator,
    StateSpace,
    cosimulate,
    estimated_response,
    simulate,
)
from trussflow.blocks.errors import BlockError, SimulationError
from trussflow.blocks.framework.run_state import Running, SelfStepping

ROUND_OFF = 1e-14  # relative: a few operations of 1e-16 each
STEP = 0.01


class CounterRun(HiddenSumRun):
    def __init__(self, block):
        super().__init__(())
        self.block = block
        block.happened("open")

    def close(self):
        self.block.happened("close")

    def output(self, t, x, u, p):
        if t > 0.3:
            self.block.happened("output")
        return super().output(t, x, u, p)


class Counter(HiddenSum):
    """A Python block that hides a number, and notes when it is opened and closed."""

    def __init__(self, *, fails="", run=CounterRun):
        self.fails, self.run = fails, run
        self.events = []
        super().__init__(())

    def open(self, p):
        return self.run(self)

    def happened(self, what):
        if what != "output":
            self.events.append(what)
        if self.fails == what:
            raise RuntimeError(f"no {what} today")


def loop(python):
    diagram = Diagram("loop")
    time, python = diagram.add(time=Time(), python=python.sampled(0.1))
    time.y >> python.port("u")
    return diagram


@pytest.mark.parametrize("where", ["open", "output", "close"])
def test_opened_blocks_are_closed_whatever_ends_the_run(where):
    """Once each, the block that failed and the one beside it; one that did not open cannot be."""
    python, beside = Counter(fails=where), Counter()
    diagram = loop(beside)
    diagram.add(failing=python.sampled(0.1))
    diagram.ground(python.port("u"))
    message = rf"{where}\(\) of block 'failing' \(Counter\) raised RuntimeError.*: no {where} today"
    with pytest.raises(SimulationError, match=message):
        Simulator(diagram, step=STEP, backend="numpy").run(0.5)
    expected = ["open", "close"][: 1 if where == "open" else 2]
    assert (python.events, beside.events) == (expected, ["open", "close"])
    session = Session(diagram, step=STEP, backend="numpy")
    with pytest.raises(SimulationError, match=message), session:
        session.advance(0.5)
    assert (python.events, beside.events) == (expected * 2, ["open", "close"] * 2)


def test_sessions_of_one_diagram_do_not_touch_each_other(backend):
    """Interleaved, twins and others, while the diagram is co-simulated and simulated besides."""
    diagram = loop(Counter())

    first = Session(diagram, step=STEP, backend=backend, outputs=["python.y"])
    second = first.twin()
    assert second.prepared.plan is first.prepared.plan

    def interleaved(sessions):
        rows = []
        for k in range(1, 6):
            values = []
            for session in sessions:
                session.advance(0.1 * k + STEP)
                values.append(session.outputs["python.y"])
            rows.append(values)
            if k == 3 and len(sessions) > 1:
                whole = cosimulate(
                    diagram, 0.5, step=0.1, members=["time"], backend=backend
                )
                assert_allclose(whole["python.y"][1:], expected, rtol=1e-12)
                other = Simulator(diagram, step=STEP, backend=backend).run(0.5)
                assert_array_equal(other["python.y"][11::10], expected[:4])
        return np.transpose(rows)

    with first:
        (expected,) = interleaved([first])
    assert np.ptp(expected) > 0.5
    with first, second:
        assert_array_equal(interleaved([first, second]), [expected] * 2)


@pytest.mark.parametrize("python", [False, True])
def test_one_simulator_runs_in_many_threads_at_once(backend, python):
    """With parameters of their own; compiled steps run outside Python's lock."""
    diagram = loop(Counter()) if python else Diagram("feedback")
    rate = diagram.add(rate=Integrator(1.0))
    rate >> rate
    simulator = Simulator(
        diagram, step=1e-3 if backend == "compiled" else 0.02, backend=backend
    )
    duration = 20.0 if backend == "compiled" else 0.4
    starts = np.linspace(0.5, 2.0, 8)

    def run(start):
        return simulator.run(duration, initial={"rate.integral": start})

    expected = [run(start) for start in starts]
    for _ in range(3):
        with ThreadPoolExecutor(len(starts)) as pool:
            found = list(pool.map(run, starts))
        assert all(
            one.equals(other) for one, other in zip(expected, found, strict=True)
        )


class Scaled(Counter):
    scale = Parameter(1.0)

    def open(self, p):
        return ScaledRun(self, p)


class ScaledRun(CounterRun):
    """It counts by a parameter, and notes each value it is tuned to."""

    def __init__(self, block, p):
        super().__init__(block)
        self.p = p

    def update(self, t, x, u, p):
        self.sum = self.p.scale
        return {}

    def tuned(self):
        self.block.events.append(float(self.p.scale))


def test_a_parameter_that_is_tuned_or_restored_is_seen_by_an_open_block():
    block = Scaled()
    with Session(
        loop(block), step=STEP, backend="numpy", outputs=["python.y"]
    ) as session:
        session.advance(0.2 + STEP)
        assert session.outputs["python.y"] == 1.0
        snapshot = session.save()
        session.tune({"python.scale": 3.0})
        session.advance(0.4 + STEP)
        assert session.outputs["python.y"] == 3.0
        session.restore(snapshot)
    assert block.events == ["open", 3.0, 1.0, "close"]


@pytest.mark.parametrize(
    "returned, steps_itself",
    [(None, False), (3, False), (Running(), True), (SelfStepping(), False)],
)
def test_what_open_must_return(returned, steps_itself):
    class Odd(Counter):
        def open(self, p):
            return returned

        @property
        def steps_itself(self):
            return steps_itself

    message = r"open\(\) of block 'python' \(Odd\) returned .*must (set steps_itself = True to )?be a"
    with pytest.raises(SimulationError, match=message):
        Simulator(loop(Odd()), step=STEP, backend="numpy").run(0.5)


class SwitchingRun(CounterRun):
    """It has events, which its block does not say."""

    def indicators(self, t, x, u, p):
        return {"hit": 0.0}


class Traced(Block):
    """Its open() would never be called."""

    y = Output()

    def open(self, p):
        return Running()

    def output(self, t, x, u, p):
        return {"y": t}


def test_an_open_that_would_go_wrong_silently_is_refused():
    kept = []

    class Shared(Counter):
        def open(self, p):
            kept[:] = kept or [CounterRun(self)]
            return kept[0]

    simulator = Simulator(loop(Shared()), step=STEP, backend="numpy")
    simulator.run(0.5)
    with pytest.raises(
        SimulationError, match="it was opened before; each run needs a new one"
    ):
        simulator.run(0.5)
    with pytest.raises(SimulationError, match="the block must declare them"):
        Simulator(loop(Counter(run=SwitchingRun)), step=STEP, backend="numpy").run(0.5)
    with pytest.raises(
        BlockError, match=r"open\(\) would never be called: only Python blocks"
    ):
        Session(Traced(), step=STEP)


class StepsRun(SelfStepping):
    """Its output is how many steps it took."""

    def __init__(self, block):
        self.shown, self.fails, self.size = 0.0, block.fails, block.size

    @property
    def messages(self):
        return (f"{self.shown:g} steps",)

    def start(self, time, inputs):
        self.shown = 0.0

    def set(self, inputs, rates=None):
        pass

    def advance(self, now, until):
        assert until > now, "there is no step of no length"
        if until > self.fails:
            raise RuntimeError("no step today")
        self.shown += 1.0

    def outputs(self):
        return np.full(self.size, self.shown)


class Steps(Block):
    """A block that steps itself."""

    traced = False
    steps_itself = True
    u, y = Input(), Output()

    def __init__(self, fails=np.inf, size=1):
        self.fails, self.size = fails, size
        super().__init__()

    def feedthrough(self):
        return {"y": ()}

    def open(self, p):
        return StepsRun(self)


def test_a_block_that_steps_itself_takes_no_step_while_what_is_held_settles():
    """Beside it, 1 / (s + 1) at 1 rad/s."""
    diagram = loop(Steps())
    lag = diagram.add(lag=StateSpace([[-1.0]], [[1.0]], [[1.0]]))
    diagram.expose(u=lag.u)
    found = estimated_response(
        diagram, "u", "lag.y", omega=[1.0], amplitude=1.0, step=STEP
    )
    # twice the tolerance
    assert_allclose(np.ravel(found.complex), 1 / (1j * found.omega + 1), rtol=2e-3)


def test_errors_name_the_member_and_keep_its_messages():
    message = r"member 'python' raised RuntimeError at t = 0.2 s: no"
    with pytest.raises(SimulationError, match=message) as info:
        cosimulate(loop(Steps(fails=0.25)), 0.5, step=0.1)
    assert "2 steps" in info.value.result.attrs["messages"]
    assert "5 steps" in cosimulate(loop(Steps()), 0.5, step=0.1).attrs["messages"]


@pytest.mark.parametrize("run", [cosimulate, simulate])
def test_outputs_of_another_size_are_refused(run):
    with pytest.raises(
        SimulationError,
        match=r"outputs\(\) of 'python' returned .* one vector of 1 numbers",
    ):
        run(loop(Steps(size=3)), 0.5, step=0.1)


class BrokenRun(CounterRun):
    def restore(self, saved):
        raise RuntimeError("lost it")


def test_a_session_that_could_not_go_back_says_so_from_then_on():
    """Some of its blocks have gone back, others have not."""
    with Session(loop(Counter(run=BrokenRun)), step=STEP, backend="numpy") as session:
        snapshot = session.save()
        session.advance(0.1)
        for _ in range(2):
            with pytest.raises(SimulationError, match="lost it"):
                session.restore(snapshot)
        with pytest.raises(SimulationError, match="lost it"):
            session.advance(0.2)
