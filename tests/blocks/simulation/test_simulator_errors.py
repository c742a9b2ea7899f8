"""Runs that make no sense or go wrong: told before they start, or with the log kept."""

import os
import signal
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Parameter, State
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.errors import (
    DiagramError,
    DivergenceError,
    NameLookupError,
    ParameterError,
    SimulationError,
    SimulationInterrupted,
)
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.simulation.simulator import Simulator, simulate

ROUND_OFF = 1e-14  # relative: a few operations of 1e-16 each
BACKENDS = ("numpy", "interpreted", "compiled")


class Grower(Block):
    """Blows up at a time of our choosing."""

    y = Output((2,))
    rate = Parameter(0.0)
    q = State((2,), initial=1.0)

    def output(self, t, x, u, p):
        return {"y": x.q}

    def derivative(self, t, x, u, p):
        blown = np.where(t > 0.45, np.sqrt(0.45 - t), 0.0)
        return {"q": np.stack([p.rate * x.q[0], blown])}


class Counter(Block):
    y = Output()
    n = State()
    step = Parameter(1.0)

    def output(self, t, x, u, p):
        return {"y": np.sqrt(3.5 - x.n)}

    def update(self, t, x, u, p):
        return {"n": x.n + p.step}


def grower(**parameters):
    diagram = Diagram("d")
    diagram.add(box=Grower(**parameters))
    return diagram


def counter(every=0.1):
    diagram = Diagram("d")
    diagram.add(count=Counter().sampled(every))
    return diagram


NOT_POSITIVE: list[tuple[str, object]] = [
    (name, value)
    for name in ("step", "log_step", "rtol", "atol", "duration")
    for value in (0.0, -1.0, np.nan, np.inf, "1", 1j)
]


@pytest.mark.parametrize(("name", "value"), [*NOT_POSITIVE, ("duration", None)])
def test_times_and_tolerances_are_positive_numbers(name, value):
    settings: dict[str, object] = {"step": 0.1, name: value}
    duration = settings.pop("duration", 1.0)
    with pytest.raises(SimulationError, match=f"{name} = .* must be a positive and finite number"):
        simulate(grower(), duration, **settings)  # type: ignore[arg-type]


def test_unknown_solver_and_backend_list_the_known():
    with pytest.raises(SimulationError, match="unknown solver 'ode45'; choose from: rk4, euler, RK"):
        Simulator(grower(), step=0.1, solver="ode45")
    with pytest.raises(SimulationError, match="unknown backend 'gpu'; choose from: auto, compiled"):
        Simulator(grower(), step=0.1, backend="gpu")
    with pytest.raises(SimulationError, match=r"solver 'rk4' needs a step, such as step=1e-3"):
        Simulator(grower())


@pytest.mark.parametrize(
    ("diagram", "settings", "message"),
    [
        (grower(), {"duration": 0.25}, r"the duration of 0\.25 s is not a whole number of steps of"),
        (grower(), {"log_step": 0.15}, r"log_step of 0\.15 s is not a whole number of steps of"),
        (grower(), {"log_step": 0.05}, r"log_step of 0\.05 s is not a whole number of steps of"),
        (counter(0.15), {}, r"the sample time of 0\.15 s is not a whole number of steps of 0\.1 s"),
    ],
)
def test_fixed_steps_must_divide_all_times(diagram, settings, message, tmp_path):
    """Found before anything runs: an old result file stays."""
    old = tmp_path / "old.nc"
    old.write_text("old")
    duration = settings.pop("duration", 1.0)
    with pytest.raises(SimulationError, match=message + r"(.|\n)*adaptive solver"):
        simulate(diagram, duration, step=0.1, stream_to=old, backend="numpy", **settings)
    assert old.read_text() == "old"
    assert list(tmp_path.iterdir()) == [old]


def test_adaptive_solvers_need_no_dividing_step():
    result = simulate(counter(0.15), 0.4, solver="RK45", log_step=0.1, backend="numpy")
    np.testing.assert_allclose(result.time, [0.0, 0.1, 0.2, 0.3, 0.4], rtol=ROUND_OFF)
    np.testing.assert_allclose(result["count.y"], np.sqrt([3.5, 3.5, 2.5, 1.5, 1.5]), rtol=ROUND_OFF)


@pytest.mark.parametrize("stream", [False, True])
@pytest.mark.parametrize("backend", BACKENDS)
def test_divergence_names_the_state_and_keeps_the_log(backend, stream, tmp_path):
    path = tmp_path / "run.nc" if stream else None
    with pytest.raises(DivergenceError) as error, np.errstate(invalid="ignore"):
        simulate(grower(), 1.0, step=0.1, backend=backend, stream_to=path)
    assert str(error.value).startswith(
        "'box.q' (element 1) stopped being finite at t = 0.5 s; the last good step is at t = 0.4 s"
    )
    result = error.value.result
    assert isinstance(result, xr.Dataset)
    np.testing.assert_allclose(result.time, [0.0, 0.1, 0.2, 0.3, 0.4], rtol=ROUND_OFF)
    np.testing.assert_array_equal(result["box.y"], np.ones((5, 2)))
    assert result.attrs["status"] == "diverged"
    if path is not None:
        result.close()
        with xr.open_dataset(path) as stored:
            assert stored.sizes["time"] == 5
            assert stored.attrs["status"] == "diverged"
        assert list(tmp_path.iterdir()) == [path]


def test_divergence_names_the_signal_that_caused_it():
    """The state that fails first in the layout is not where the fault is."""

    class Root(Block):
        y = Output()

        def output(self, t, x, u, p):
            return {"y": np.sqrt(0.45 - t)}

    class Double(Block):
        u = Input()
        y = Output()

        def output(self, t, x, u, p):
            return {"y": 2.0 * u.u}

    class Body(Double):
        v = State()

        def output(self, t, x, u, p):
            return {"y": x.v}

        def derivative(self, t, x, u, p):
            return {"v": u.u}

    diagram = Diagram("d")
    body, double, root = diagram.add(body=Body(), double=Double(), root=Root())
    root >> double >> body
    message = r"'body\.v' stopped being finite at t = 0\.5 s, because 'root\.y' did"
    with pytest.raises(DivergenceError, match=message):
        simulate(diagram, 1.0, step=0.1, backend="compiled")


@pytest.mark.parametrize("solver", ["RK45", "DOP853", "LSODA", "BDF", "Radau"])
@pytest.mark.parametrize("backend", ["numpy", "interpreted"])
def test_adaptive_solver_that_gives_up_keeps_the_log(solver, backend):
    with pytest.raises(DivergenceError, match=f"solver {solver} gave up after t = 0.4") as error:
        simulate(grower(rate=-1.0), 1.0, solver=solver, backend=backend, log_step=0.05)
    result = error.value.result
    assert isinstance(result, xr.Dataset)
    np.testing.assert_allclose(result.time[:9], 0.05 * np.arange(9), rtol=0, atol=1e-12)
    np.testing.assert_allclose(result["box.y"][:, 0], np.exp(-result.time), rtol=1e-6)
    assert result.sizes["time"] in (9, 10), "0.45 s itself may or may not be reached"


@pytest.mark.parametrize("solver", ["RK45", "LSODA", "BDF", "Radau"])
def test_derivative_that_is_not_finite_at_the_start(solver):
    class Bad(Block):
        q = State()

        def derivative(self, t, x, u, p):
            return {"q": np.log(x.q)}

    diagram = Diagram("d")
    diagram.add(bad=Bad())
    with pytest.raises(DivergenceError, match=r"after t = 0 s: .* derivative of 'bad\.q' is not"):
        simulate(diagram, 1.0, solver=solver, backend="interpreted")


@pytest.mark.parametrize("solver", ["rk4", "RK45"])
@pytest.mark.parametrize("backend", BACKENDS)
def test_divergence_of_a_sampled_block(backend, solver):
    with pytest.raises(DivergenceError) as error, np.errstate(invalid="ignore"):
        simulate(counter(), 1.0, step=0.1, log_step=0.1, backend=backend, solver=solver)
    assert str(error.value).startswith("'count.y' stopped being finite at t = 0.4 s")
    assert error.value.result.sizes["time"] == 4  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("settings", "cause", "message"),
    [
        ({"parameters": {"box.rat": 1}}, NameLookupError, "no parameter 'box.rat'; the parameters ar"),
        ({"parameters": {"rate": 1}}, NameLookupError, "no parameter 'rate'; .* box.rate"),
        ({"parameters": {"box.rate": np.nan}}, ParameterError, "'rate' of block 'box' is not finite"),
        ({"parameters": {"box.rate": [1, 2]}}, ParameterError, r"has shape \(2,\); it must have"),
        ({"initial": {"box.v": 0}}, NameLookupError, "no state 'box.v'; the states are: box.q"),
        ({"initial": {"box.q": np.ones(3)}}, ParameterError, r"'box.q' has shape \(3,\); it must"),
        ({"initial": {"box.q": [1, np.inf]}}, ParameterError, "'box.q' is not finite"),
        ({"initial": {"box.q": "one"}}, ParameterError, "'box.q' must be numeric, not 'one'"),
    ],
)
def test_overrides_are_checked(settings, cause, message):
    with pytest.raises(cause, match=message):
        simulate(grower(), 1.0, step=0.1, backend="numpy", **settings)


@pytest.mark.parametrize("what", [Grower(), "diagram", None])
def test_only_diagrams_can_be_simulated(what):
    with pytest.raises(DiagramError, match="it is no Diagram"):
        simulate(what, 1.0, step=0.1)


class Interrupting(Block):
    """Presses Ctrl-C."""

    traced = False
    u = Input()

    def update(self, t, x, u, p):
        return {}

    def output(self, t, x, u, p):
        if t > 0.35:
            raise KeyboardInterrupt
        return {}


@pytest.mark.parametrize("solver", ["rk4", "RK45"])
@pytest.mark.parametrize("stream", [False, True])
def test_interrupted_run_keeps_its_log(solver, stream, tmp_path):
    diagram = grower()
    block = diagram.add(block=Interrupting().sampled(0.1))
    diagram.box.y[0] >> block.u
    path = tmp_path / "run.nc" if stream else None
    with pytest.raises(SimulationInterrupted, match=r"stopped at t = 0\.4 s") as error:
        simulate(diagram, 1.0, step=0.1, log_step=0.1, solver=solver, backend="numpy", stream_to=path)
    result = error.value.result
    assert isinstance(result, xr.Dataset)
    np.testing.assert_allclose(result.time, [0.0, 0.1, 0.2, 0.3], rtol=0, atol=1e-12)
    assert result.attrs["status"] == "interrupted"
    assert isinstance(error.value, KeyboardInterrupt)


SCRIPT = """
import sys
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import State
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.errors import SimulationInterrupted
from trussflow.blocks.framework.port import Output
from trussflow.blocks.simulation.simulator import Simulator

class Spring(Block):
    y = Output()
    q = State(initial=1.0)
    v = State()
    def output(self, t, x, u, p):
        return {"y": x.q}
    def derivative(self, t, x, u, p):
        return {"q": x.v, "v": -x.q}

diagram = Diagram("d")
diagram.add(spring=Spring())
simulator = Simulator(diagram, step=1e-3, solver=sys.argv[1], backend="auto", log_step=0.1)
simulator.run(0.2)  # so that all imports are done
print("ready", flush=True)
try:
    simulator.run(1e7, progress=False)
except SimulationInterrupted as error:
    print("kept", error.result.sizes["time"] > 1, flush=True)
"""


@pytest.mark.parametrize("solver", ["rk4", "DOP853"])
def test_control_c_stops_a_long_run(solver):
    """A signal, as the terminal sends it, in the middle of compiled or solver code."""
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, solver], stdout=subprocess.PIPE, text=True, env=os.environ
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(1.0)
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=30)[0] == "kept True\n"
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 0
