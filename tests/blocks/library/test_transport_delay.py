"""Transport delays: smooth signals, loops, every solver, and the Padé approximant in linear models."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from systems import assert_near, ring, series

from trussflow.blocks import (
    Constant,
    Diagram,
    Function,
    Integrator,
    OperatingPoint,
    Relay,
    Session,
    Sine,
    Step,
    TimeFunction,
    TransportDelay,
    VariableDelay,
    ZeroOrderHold,
    frequency_response,
    linearize,
    simulate,
)
from trussflow.blocks.errors import DiagramError, SimulationError
from trussflow.blocks.results.state_file import write_state

SMOOTH_ERROR = 3e-5
"""Cubic interpolation of a sine of 1 Hz between steps of 0.01 s."""


def loop(late, gain=1.0):
    """Return x' = -gain x(t - delay), x = 1 before."""
    d = Diagram("loop")
    x, late = d.add(x=Integrator(1.0), late=late)
    x >> late.u
    (-gain * late.y) >> x
    return d


@pytest.mark.parametrize(
    "settings",
    [
        {"step": 0.05},
        {"step": 0.05, "backend": "numpy"},
        {"step": 0.05, "backend": "compiled"},
        {"solver": "RK45", "rtol": 1e-9},
    ],
)
def test_loop_with_a_delay(settings):
    """1 - t for one delay, then + (t-1)^2/2 besides, then - (t-2)^3/6; interpolation errs at kinks only."""
    result = simulate(loop(TransportDelay(1.0, 1.0)), 3.0, log_step=0.05, **settings)
    t = result["time"].values
    exact = 1 - t + np.maximum(t - 1, 0) ** 2 / 2 - np.maximum(t - 2, 0) ** 3 / 6
    assert_near(result["x.y"], exact, SMOOTH_ERROR)


@pytest.mark.parametrize("delay", [0.005, 0.1234])
def test_smooth_signal_is_delayed(delay):
    d = Diagram("d")
    d.add("sine", Sine([1.0, 2.0])) >> d.add("late", TransportDelay(delay, [0.5, 0.5]))
    result = simulate(d, 1.0, step=0.01)
    t = result["time"].values - delay
    exact = np.where(t[:, None] < 0.0, 0.5, np.outer(np.sin(2 * np.pi * t), [1.0, 2.0]))
    assert_near(result["late.y"], exact, SMOOTH_ERROR)


SOLVERS = [
    {"step": 0.05},
    {"step": 0.05, "backend": "compiled"},
    {"solver": "RK45"},
    {"solver": "Rodas5P", "backend": "compiled"},
]
every_solver = pytest.mark.parametrize("settings", SOLVERS)


@pytest.mark.parametrize("settings", [*SOLVERS, {"step": 0.05, "backend": "numpy"}])
@pytest.mark.parametrize("beside", [0.0, 1e9])
def test_jump_of_a_source_is_delayed(settings, beside):
    """The output before is -1, jumps to 2 and at 0.5 s to 3; the integral shows the exact times."""
    jump = Step(0.5, initial_value=[2.0, beside], final_value=[3.0, beside])
    d = series(
        jump=jump, late=TransportDelay(0.237, [-1.0, 0.0]), area=Integrator([0.0, 0.0])
    )
    area = simulate(d, 2.0, log_step=0.5, **settings)["area.y"][-1, 0]
    assert area == pytest.approx(-0.237 + 2 * 0.5 + 3 * (2.0 - 0.737), abs=1e-9)


@every_solver
def test_jumps_of_a_sampled_block_are_delayed(settings):
    d = Diagram("d")
    sine, hold, late = d.add(
        sine=Sine(1.0, 1 / np.pi),
        hold=ZeroOrderHold(0.1),
        late=TransportDelay(0.237, -1.0),
    )
    sine >> hold >> late >> d.add("area", Integrator())
    result = simulate(d, 1.0, log_step=0.5, **settings)
    held = 0.1 * np.arange(10)
    exact = np.sin(2 * held) @ np.clip(1.0 - 0.237 - held, 0.0, 0.1) - 0.237
    assert result["area.y"][-1] == pytest.approx(exact, abs=1e-8)


@every_solver
def test_jumps_at_events_are_delayed(settings):
    """A relay in a delayed loop makes a triangle, as high as its threshold and the delay."""
    d = ring(
        x=Integrator(),
        relay=Relay(0.5, -0.5, on=-1.0, off=1.0),
        late=TransportDelay(0.25),
    )
    result = simulate(d, 4.5, log_step=0.05, **settings)
    t = result["time"].values[5:]  # the delay is over
    assert_near(result["x.y"][5:], 0.75 - abs((t - 2.5) % 3.0 - 1.5), 1e-8)


@pytest.mark.parametrize(
    "settings",
    [{"step": 0.01, "backend": "compiled"}, {"solver": "RK45", "log_step": 0.01}],
)
@pytest.mark.parametrize("periods", [1, 3])
def test_sample_at_the_instant_of_a_delayed_jump_is_the_new_value(periods, settings):
    """Rounding does not matter: 0.1 + 0.2 is more than 0.3."""
    d = series(
        time=TimeFunction(lambda t: t),
        first=ZeroOrderHold(0.1),
        late=TransportDelay(0.1 * periods),
        second=ZeroOrderHold(0.1),
    )
    result = simulate(d, 1.0, **settings)
    tenths = np.maximum(np.arange(101) // 10 - periods, 0)
    assert_allclose(result["second.y"], 0.1 * tenths, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("backend", ["interpreted", "compiled"])
def test_round_off_hides_no_point_at_the_instant_of_a_delayed_jump(backend):
    """The number 0.7 - 0.5 is less than 0.2."""
    assert 0.2 + 0.5 <= 0.7
    assert 0.7 - 0.5 < 0.2
    d = Diagram("d")
    jump = Step(0.2, initial_value=2.0, final_value=3.0)
    d.add("step", jump) >> d.add("late", TransportDelay(0.5, -1.0))
    result = simulate(d, 1.0, step=0.1, backend=backend)
    assert result["late.y"].values[4:9].tolist() == [-1.0, 2.0, 2.0, 3.0, 3.0]


@pytest.mark.parametrize("solver", ["RK45", "DOP853", "Rodas5P", "auto"])
def test_long_steps_see_the_whole_delayed_signal(solver):
    """The solution is polynomial between multiples of the delay, for which a solver would take few steps."""
    settings = {"solver": solver, "log_step": 5.0}
    end = simulate(loop(TransportDelay(1.0, 1.0)), 5.0, **settings)["x.y"][-1]
    exact = 1 - 5 + 16 / 2 - 27 / 6 + 16 / 24 - 1 / 120
    # The interpolation of the input between steps of a fifth of the delay has this error, at any tolerance.
    assert end == pytest.approx(exact, abs=5e-6)


def test_steps_of_an_adaptive_solver_are_no_longer_than_the_shortest_delay():
    """A solver would take the whole run of a constant at once."""
    d = loop(TransportDelay(0.1, 1.0), gain=0.0)
    other = d.add(other=TransportDelay(0.05))
    d.add("sine", Sine()) >> other.u
    result = simulate(d, 0.3, solver="RK45", log_step=0.01)
    exact = np.sin(2 * np.pi * (result["time"].values - 0.05))
    # steps of 0.01 s
    assert_near(result["other.y"][6:], exact[6:], 1e-3)


@pytest.mark.parametrize("backend", ["compiled", "numpy"])
@pytest.mark.parametrize("settings", [{"solver": "RK45"}, {"step": 0.01}])
def test_too_many_points_are_reported(settings, backend):
    d = loop(TransportDelay(1.0, points=20))
    d.add("often", ZeroOrderHold(0.01))
    d.x.y >> d.often
    time = "0.2" if "step" in settings else "0.04"
    message = f"'late' stores at most 20 points, .* at t = {time} s"
    with pytest.raises(SimulationError, match=message):
        simulate(d, 3.0, backend=backend, **settings)


def test_a_delay_that_needs_too_many_points_is_refused():
    with pytest.raises(DiagramError, match=r"'late' needs .* take a larger step"):
        simulate(loop(TransportDelay(1e6)), 1.0, step=1e-3)


@pytest.mark.parametrize("place, value", [(0, -1.0), (1, 1e9), (2, 50.0)])
def test_a_file_with_another_size_of_a_history_is_refused(place, value, tmp_path):
    """C code would read outside the memory."""
    file = tmp_path / "state"
    with Session(TransportDelay(0.1), step=0.01) as session:
        session.start(inputs={"u": 1.0})
        session.advance(0.05)
        good = session.save(file)
        session.restore(file)
        d = good.d.copy()
        d[session.prepared.plan.histories.span.start + place] = value
        write_state(file, replace(good, d=d), session.prepared.identity)
        with pytest.raises(SimulationError, match="d of the snapshot cannot be of"):
            session.restore(file)


def test_a_ring_of_points_is_used_many_times():
    d = Diagram("d")
    d.add("sine", Sine()) >> d.add("late", TransportDelay(0.1, points=20))
    result = simulate(d, 3.0, step=0.01, backend="compiled")
    t = result["time"].values
    exact = np.sin(2 * np.pi * (t - 0.1))
    assert_allclose(result["late.y"][20:], exact[20:], rtol=0.0, atol=1e-12)


def varied(signal, delay, duration, **settings):
    """Return a run with a variable delay from 0.05 s to 2 s, with -1 before, and its integral."""
    d = Diagram("varied")
    signal, delay, late = d.add(
        signal=signal, delay=delay, late=VariableDelay(0.05, 2.0, -1.0)
    )
    signal >> late.u
    delay >> late.tau
    late.y >> d.add("area", Integrator())
    return simulate(d, duration, **settings)


@every_solver
def test_a_growing_delay_stretches_a_signal(settings):
    """The delay 1/2 + t/5 slows the signal by 0.8."""
    settings = settings | ({"step": 0.01} if "step" in settings else {"log_step": 0.05})
    first, second = (TimeFunction(lambda t: 0.5 + 0.2 * t) for _ in range(2))
    result = varied(Sine(1.0, 0.5), first, 3.0, **settings)
    then = 0.8 * result["time"].values - 0.5
    exact = np.where(then < 0.0, -1.0, np.sin(np.pi * then))
    assert_near(result["late.y"], exact, SMOOTH_ERROR)
    jump = Step(0.5, initial_value=2.0, final_value=3.0)
    area = varied(jump, second, 3.0, **settings)["area.y"][-1]
    assert area == pytest.approx(-0.625 + 2 * 0.625 + 3 * 1.75, abs=1e-9)


@every_solver
def test_a_delay_that_grows_faster_than_time_plays_the_signal_backwards(settings):
    """The delayed time is t - 1/2 until 0.7 s, and then falls at one second per second to before zero."""
    delay = TimeFunction(
        lambda t: np.where(t < 1.2, 0.5, 0.5 + 2.0 * (t - 1.2)), breakpoints=(1.2,)
    )
    jump = Step(0.5, initial_value=2.0, final_value=3.0)
    area = varied(jump, delay, 2.0, log_step=0.5, **settings)["area.y"][-1]
    assert area == pytest.approx(-0.5 + 2 * 0.5 + 3 * 0.4 + 2 * 0.5 - 0.1, abs=1e-7)


@every_solver
def test_a_jump_of_the_delay_passes_several_jumps_of_the_signal(settings):
    """At 1 s the delay jumps from 0.9 s to 0.1 s."""
    d = Diagram("passes")
    time, stairs, late = d.add(
        time=TimeFunction(lambda t: t),
        stairs=ZeroOrderHold(0.2),
        late=VariableDelay(0.1, 1.0),
    )
    time >> stairs >> late.u
    d.add("delay", Step(1.0, initial_value=0.9, final_value=0.1)) >> late.tau
    late.y >> d.add("area", Integrator())
    area = simulate(d, 1.3, log_step=0.1, **settings)["area.y"][-1]
    assert area == pytest.approx(0.8 * 0.1 + 1.0 * 0.2, abs=1e-7)


def test_linear_model_of_a_variable_delay_is_that_of_the_present_one():
    point = OperatingPoint(inputs={"tau": 0.4})
    found, exact = (
        linearize(block, ["u"], ["y"], at=at)
        for block, at in ((VariableDelay(0.1, 1.0), point), (TransportDelay(0.4), None))
    )
    assert_allclose(found.A, exact.A, rtol=1e-13)
    assert_allclose(found.B, exact.B, rtol=1e-13)


@pytest.mark.parametrize("signal", [Constant(3.0), Sine(1.0, 0.1)])
def test_operating_point_of_a_run_has_the_delayed_signal(signal):
    """The gain of a square is twice its input, the delayed signal."""
    d = Diagram("square")
    signal, late, square = d.add(
        signal=signal, late=TransportDelay(0.237), square=Function(lambda u: u**2)
    )
    signal >> late >> square
    d.expose(y=late.y)
    with Session(d, step=0.01) as session:
        session.start()
        session.advance(2.0)
        point, y = OperatingPoint.of(session), session.outputs["y"]
    gain = linearize(d, ["square.u"], ["square.y"], at=point).D
    assert_allclose(gain, [[2.0 * y]], rtol=1e-9)


@pytest.mark.parametrize("delay", [1e-3, 0.5])
def test_linear_model_is_the_approximant(delay):
    model = linearize(TransportDelay(delay), ["u"], ["y"])
    omega = np.linspace(0.1, 2.5, 20) / delay
    response = np.array([model(1j * w) for w in omega]).ravel()
    assert_near(response, np.exp(-1j * omega * delay), 1e-6)


def test_interpolation_between_steps_is_of_fourth_order():
    def error(step):
        delay = 0.4 + step / 2  # halfway between two stored points
        d = Diagram("d")
        d.add("sine", Sine()) >> d.add("late", TransportDelay(delay))
        result = simulate(d, 2.0, step=step, log_step=0.04)
        exact = np.sin(2 * np.pi * (result["time"].values - delay))
        return np.abs(result["late.y"].values - exact)[result["time"] > 1.0].max()

    assert np.log2(error(0.02) / error(0.01)) == pytest.approx(4.0, abs=0.4)


TEST_FREQUENCIES = np.array([0.3, 4.0, 60.0])


def test_frequency_responses_have_the_exact_delay():
    """Closed, broken before and behind the delay, and the delay alone."""
    late = TransportDelay(0.7, 1.0)
    d = loop(late)
    settings = {"omega": TEST_FREQUENCIES}
    turn = np.exp(-0.7j * TEST_FREQUENCIES)
    for ends, cut, exact in (
        (("x.u", "x.y"), (), 1 / (1j * TEST_FREQUENCIES + turn)),
        (("late.u", "late.u"), "late.u", -turn / (1j * TEST_FREQUENCIES)),
        (("late.y", "late.y"), "late.y", -turn / (1j * TEST_FREQUENCIES)),
    ):
        found = frequency_response(d, *ends, cut=cut, **settings).frdata[0, 0]
        assert_allclose(found, exact, rtol=1e-12)
    found = frequency_response(late, **settings).frdata[0, 0]
    assert_allclose(found, turn, rtol=1e-12)
