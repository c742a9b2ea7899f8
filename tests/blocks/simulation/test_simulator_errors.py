"""Runs that make no sense or go wrong: told before they start, or with the log kept."""

import signal
import subprocess
import sys

import numpy as np
import pytest
import systems
import xarray as xr
from numpy.testing import assert_allclose, assert_array_equal
from systems import assert_near, ring, series

from trussflow.blocks import (
    Block,
    Diagram,
    Function,
    Gain,
    Integrator,
    Output,
    Parameter,
    Session,
    State,
    TimeFunction,
    cosimulate,
    simulate,
)
from trussflow.blocks.errors import (
    DiagramError,
    DivergenceError,
    NameLookupError,
    ParameterError,
    SimulationError,
)

ROUND_OFF = 1e-14  # relative: a few operations of 1e-16 each


class Grower(Block):
    """Blows up at a time of our choosing."""

    y = Output(2)
    rate = Parameter(0.0)
    q = State(2, initial=1.0)

    def output(self, t, x, u, p):
        return {"y": x.q}

    def derivative(self, t, x, u, p):
        blown = np.where(t > 0.45, np.sqrt(0.45 - t), 0.0)
        return {"q": np.stack([p.rate * x.q[0], blown])}


class Counter(systems.Counter):
    """It shows the root of what is left of 3.5."""

    def output(self, t, x, u, p):
        return {"y": np.sqrt(3.5 - x.n)}


def grower(**parameters):
    return series(box=Grower(**parameters))


def counter(every=0.1):
    return series(count=Counter().sampled(every))


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf, "1", 1j])
@pytest.mark.parametrize("name", ["step", "log_step", "rtol", "atol", "duration"])
def test_times_and_tolerances_are_positive_numbers(name, value):
    settings = {"step": 0.1, "duration": 1.0, name: value}
    with pytest.raises(
        SimulationError, match=f"{name} = .* must be a positive and finite number"
    ):
        simulate(grower(), **settings)


@pytest.mark.parametrize(
    "diagram, settings, message",
    [
        (
            grower(),
            {"duration": 0.25},
            r"the duration of 0\.25 s is not a whole number of steps of",
        ),
        (
            grower(),
            {"log_step": 0.15},
            r"log_step of 0\.15 s is not a whole number of steps of",
        ),
        (
            grower(),
            {"log_step": 0.05},
            r"log_step of 0\.05 s is not a whole number of steps of",
        ),
        (
            counter(0.15),
            {},
            r"the sample time of block '\w+' of 0\.15 s is not a whole number of steps of 0\.1 s",
        ),
    ],
)
def test_fixed_steps_must_divide_all_times(diagram, settings, message, tmp_path):
    """Found before anything runs: an old result file stays."""
    old = tmp_path / "old.nc"
    old.write_text("old")
    duration = settings.pop("duration", 1.0)
    with pytest.raises(SimulationError, match=message + r"(.|\n)*adaptive solver"):
        simulate(
            diagram, duration, step=0.1, stream_to=old, backend="numpy", **settings
        )
    assert old.read_text() == "old"
    assert list(tmp_path.iterdir()) == [old]


def session(start, end):
    with Session(grower(), step=0.01) as running:
        running.start(time=start)
        running.advance(end)


@pytest.mark.parametrize(
    "run",
    [
        lambda: simulate(grower(), 1.0, step=0.01, start=1e13),
        lambda: simulate(grower(), 1.0, step=0.01, start=-1e300),
        lambda: simulate(grower(), 1e300, step=0.01),
        lambda: simulate(grower(), 1.0, solver="RK45", start=1e16),
        lambda: simulate(
            counter(0.01), 100.0, solver="RK45", log_step=100.0, start=1e14
        ),
        lambda: cosimulate(grower(), 1e300, step=0.01),
        lambda: session(1e16, 2e16),
        lambda: session(0.0, 1e16),
    ],
)
def test_times_that_cannot_be_told_apart_are_refused(run):
    message = r"steps of .* too short at t = 1e\+.* s apart: keep nearer to t = 0, or take steps of at least"
    with pytest.raises(SimulationError, match=message):
        run()


def test_steps_of_a_tenth_of_a_millisecond_at_the_time_of_the_clock():
    """Seconds since 1970."""
    assert (
        simulate(systems.approach(), 1e-3, step=1e-4, start=1.8e9).sizes["time"] == 11
    )


def test_divergence_names_the_state_and_keeps_the_log(backend, tmp_path):
    path = tmp_path / "run.nc"
    with pytest.raises(DivergenceError) as error, np.errstate(invalid="ignore"):
        simulate(grower(), 1.0, step=0.1, backend=backend, stream_to=path)
    assert str(error.value).startswith(
        "'box.q' (element 1) stopped being finite at t = 0.5 s; the last good step is at t = 0.4 s"
    )
    error.value.result.close()
    with xr.open_dataset(path) as result:
        assert_allclose(result.time, [0.0, 0.1, 0.2, 0.3, 0.4], rtol=ROUND_OFF)
        assert_array_equal(result["box.y"], np.ones((5, 2)))
        assert result.attrs["status"] == "diverged"
    assert list(tmp_path.iterdir()) == [path]


def test_divergence_names_the_signal_that_caused_it():
    """The state that fails first in the layout is not where the fault is."""
    diagram = Diagram("d")
    root = TimeFunction(lambda t: np.sqrt(0.45 - t))
    body, double, root = diagram.add(body=Integrator(), double=Gain(2.0), root=root)
    root >> double >> body
    message = r"'body\.integral' stopped being finite at t = 0\.5 s; the first non-finite signal is 'root\.y'"
    with pytest.raises(DivergenceError, match=message):
        simulate(diagram, 1.0, step=0.1, backend="compiled")


@pytest.mark.parametrize("solver", ["RK45", "DOP853", "Rodas5P", "auto"])
@pytest.mark.parametrize("backend", ["numpy", "interpreted"])
def test_adaptive_solver_that_gives_up_keeps_the_log(solver, backend):
    with pytest.raises(
        DivergenceError, match=f"solver {solver} gave up after t = 0.4"
    ) as error:
        simulate(grower(rate=-1.0), 1.0, solver=solver, backend=backend, log_step=0.05)
    result = error.value.result
    assert_near(result.time[:9], 0.05 * np.arange(9), 1e-12)
    assert_allclose(result["box.y"][:, 0], np.exp(-result.time), rtol=1e-6)
    assert result.sizes["time"] in (9, 10)  # 0.45 s itself may or may not be reached


@pytest.mark.parametrize("solver", ["RK45", "Rodas5P", "auto"])
def test_derivative_that_is_not_finite_at_the_start(solver):
    diagram = ring(bad=Integrator(), log=Function(np.log))
    with pytest.raises(
        DivergenceError, match=r"after t = 0 s: .* derivative of 'bad\.integral' is not"
    ):
        simulate(diagram, 1.0, solver=solver, backend="interpreted")


def test_divergence_of_a_sampled_block(backend, solver):
    with pytest.raises(DivergenceError) as error, np.errstate(invalid="ignore"):
        simulate(counter(), 1.0, step=0.1, log_step=0.1, backend=backend, solver=solver)
    assert str(error.value).startswith("'count.y' stopped being finite at t = 0.4 s")
    assert error.value.result.sizes["time"] == 4


@pytest.mark.parametrize(
    "settings, cause, message",
    [
        (
            {"parameters": {"box.rat": 1}},
            NameLookupError,
            "no parameter 'box.rat'; the parameters ar",
        ),
        (
            {"parameters": {"rate": 1}},
            NameLookupError,
            "no parameter 'rate'; .* box.rate",
        ),
        (
            {"parameters": {"box.rate": np.nan}},
            ParameterError,
            "'rate' of block 'box' is not finite",
        ),
        (
            {"parameters": {"box.rate": [1, 2]}},
            ParameterError,
            r"has shape \(2,\); it must have",
        ),
        (
            {"initial": {"box.v": 0}},
            NameLookupError,
            "no state 'box.v'; the states are: box.q",
        ),
        (
            {"initial": {"box.q": np.ones(3)}},
            ParameterError,
            r"'box.q' has shape \(3,\); it must",
        ),
        ({"initial": {"box.q": [1, np.inf]}}, ParameterError, "'box.q' is not finite"),
        (
            {"initial": {"box.q": "one"}},
            ParameterError,
            "'box.q' must be numeric, not 'one'",
        ),
    ],
)
def test_overrides_are_checked(settings, cause, message):
    with pytest.raises(cause, match=message):
        simulate(grower(), 1.0, step=0.1, backend="numpy", **settings)


@pytest.mark.parametrize("what", [Grower(), "diagram", None])
def test_only_diagrams_can_be_simulated(what):
    with pytest.raises(DiagramError, match="it is not a Diagram"):
        simulate(what, 1.0, step=0.1)


SCRIPT = """
import sys
from trussflow.blocks import Diagram, Simulator, StateSpace
from trussflow.blocks.errors import SimulationInterrupted

diagram = Diagram("d")
spring = diagram.add(spring=StateSpace([[0, 1], [-1, 0]], [0, 1], [1, 0], initial_value=[1, 0]))
diagram.ground(spring.u)
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
    with subprocess.Popen(
        [sys.executable, "-c", SCRIPT, solver], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "ready\n"
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(0.5)
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=60)[0] == "kept True\n"
    assert process.returncode == 0
