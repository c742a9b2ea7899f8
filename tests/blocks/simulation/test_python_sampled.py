"""Python blocks: any code, run by the scheduler at its instants, between compiled steps."""

import _thread
import sys
import threading
import time

import numpy as np
import pytest
from systems import Time, assert_near, ports, ring, series

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    Input,
    Integrator,
    MatrixGain,
    Output,
    Parameter,
    PythonFunction,
    Session,
    Simulator,
    State,
    UnitDelay,
    simulate,
)
from trussflow.blocks.errors import (
    BlockError,
    DivergenceError,
    SimulationError,
    TimeLimitError,
)

ROUND_OFF = 1e-12  # some hundred additions of numbers near one


class Branching(Block):
    """What no tracer can follow."""

    traced = False
    u, y = Input(), Output(2)
    limit = Parameter(0.25)

    def output(self, t, x, u, p):
        assert isinstance(u.u, np.ndarray)
        y = np.zeros(2)
        if float(u.u) > float(p.limit):
            y[0] = float(u.u)
        else:
            y[1] = 1.0
        return {"y": y}


class Stepper(Block):
    """A plant that steps itself: its output does not depend on its input at once."""

    traced = False
    u, y = Input(2), Output(2)
    q = State(2, initial=1.0)

    def output(self, t, x, u, p):
        assert np.isnan(u.u).all()  # what it must not look at
        return {"y": x.q}

    def update(self, t, x, u, p):
        return {"q": x.q + 0.1 * u.u}

    def feedthrough(self):
        return {"y": ()}


class Faulty(Block):
    traced = False
    u, y = Input(), Output()
    n = State()

    def __init__(self, kind, where="output"):
        self.kind, self.where = kind, where
        super().__init__()

    def output(self, t, x, u, p):
        return {"y": self._value(t) if self.where == "output" else u.u}

    def update(self, t, x, u, p):
        return {"n": self._value(t) if self.where == "update" else x.n}

    def _value(self, t):
        if t < 0.25:
            return 0.0
        if self.kind == "raise":
            raise ZeroDivisionError("no such number")
        return {"nan": np.nan, "shape": np.ones(2)}[self.kind]


def test_python_code_sees_numbers_and_tunable_parameters(backend):
    diagram = series(time=Time(), python=Branching().sampled(0.1))
    simulator = Simulator(diagram, step=0.05, backend=backend)
    for limit in (0.25, 0.05):
        result = simulator.run(0.45, parameters={"python.limit": limit})
        t = np.floor(result.time.values / 0.1 + 1e-9) / 10
        expected = np.stack(
            [np.where(t > limit, t, 0), np.where(t > limit, 0, 1)], axis=1
        )
        assert_near(result["python.y"], expected, ROUND_OFF)


@pytest.mark.parametrize("backend", ["numpy", "interpreted"])
@pytest.mark.parametrize("python", [False, True])
def test_self_stepping_plant_may_stand_in_a_direct_loop(backend, python):
    """q(k+1) = 0.8 q(k), with a direct feedback of the same clock, traced or not."""

    class PythonGain(MatrixGain):
        traced = False

    diagram = Diagram("d")
    gain = (PythonGain if python else MatrixGain)(-2.0 * np.eye(2))
    plant, feedback = diagram.add(
        plant=Stepper().sampled(0.1), feedback=gain.sampled(0.1)
    )
    plant >> feedback >> plant
    result = simulate(diagram, 1.0, step=0.1, backend=backend)
    assert_near(result["plant.y"][:, 0], 0.8 ** np.arange(11), ROUND_OFF)
    assert_near(result["feedback.y"][:, 1], -2 * 0.8 ** np.arange(11), ROUND_OFF)


@pytest.mark.parametrize("where", ["output", "update"])
@pytest.mark.parametrize(
    "kind, cause, message",
    [
        (
            "raise",
            SimulationError,
            r"\(Faulty\) raised ZeroDivisionError at t = 0\.3 s: no such",
        ),
        (
            "shape",
            BlockError,
            r"is declared with shape \(\), but was returned with shape \(2,\)",
        ),
        ("nan", DivergenceError, r"'block\.[yn]' stopped being finite at t = 0\.3 s: "),
    ],
)
def test_fault_names_block_and_time_and_keeps_the_log(
    kind, cause, message, where, solver
):
    diagram = Diagram("d")
    time, after, block = diagram.add(
        time=Time(), after=UnitDelay(0.1), block=Faulty(kind, where).sampled(0.1)
    )
    time >> block >> after
    with pytest.raises(cause, match=message) as error:
        simulate(
            diagram, 1.0, step=0.1, log_step=0.1, backend="interpreted", solver=solver
        )
    assert "block" in str(error.value)
    assert where + "()" in str(error.value)
    assert_near(error.value.result.time, [0.0, 0.1, 0.2], ROUND_OFF)


def test_ctrl_c_ends_steps_in_c_between_python_blocks(monkeypatch):
    """Press Ctrl-C at any time: in C, in Python, and on the way between them."""
    end = threading.current_thread()

    def started(u):
        """Start the timer in the run, as a busy computer may take long to get there."""
        if end.ident is None:
            end.start()
        return abs(u)

    law = PythonFunction(started, 1e-2, **ports(u=(), y=()))
    diagram = ring(x=Integrator(1.0), law=law)
    lost = []
    monkeypatch.setattr(sys, "unraisablehook", lost.append)
    with Session(diagram, step=1e-5) as session:
        for k in range(30):
            session.start()
            end = threading.Timer(0.02 + 0.0013 * k, _thread.interrupt_main)
            with pytest.raises(KeyboardInterrupt):
                session.advance(1e9)
            end.join()
            assert "KeyboardInterrupt" in session.fault
            assert session.time < 1e9
    assert not lost


@pytest.mark.parametrize("backend", ["compiled", "interpreted"])
def test_a_time_limit_holds_if_a_block_becomes_slow(backend):
    slow = []

    def law(t):
        if t > 5.0:
            slow.append(t)
            time.sleep(0.03)
        return t

    slowing = PythonFunction(law, 0.01, **ports(t=(), y=()))
    diagram = series(one=Constant(1.0), clock=Integrator(), law=slowing)
    simulator = Simulator(diagram, step=0.01, backend=backend)
    with pytest.raises(TimeLimitError) as error:
        simulator.run(6.0, time_limit=0.5, progress=False)
    assert len(slow) < 50  # of 100
    if slow:
        assert error.value.result.time[-1] > slow[0]
