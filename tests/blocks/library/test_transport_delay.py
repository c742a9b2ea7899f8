"""Transport delay: smooth signals, loops, every solver, and its approximant in linear models."""

import numpy as np
import pytest

from trussflow.blocks import (
    BlockError,
    Diagram,
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
    linearize,
    simulate,
)

SMOOTH = 3e-5
"""Cubic interpolation of a sine of 1 Hz between steps of 0.01 s."""


def delayed_loop(gain, delay):
    """Return dx/dt = -gain x(t - delay), x = 1 before."""
    d = Diagram("loop")
    x, late = d.add(x=Integrator(1.0), late=TransportDelay(delay, 1.0))
    x >> late
    (-gain * late.y) >> x
    return d


@pytest.mark.parametrize(
    "settings", [{"step": 0.01}, {"step": 0.01, "backend": "numpy"}, {"solver": "RK45", "rtol": 1e-9}]
)
def test_loop_with_a_delay_step_by_step(settings):
    """By steps: 1 - t, then 1 - t + (t-1)^2/2, then with -(t-2)^3/6 besides."""
    result = simulate(delayed_loop(1.0, 1.0), 3.0, log_step=0.01, progress=False, **settings)
    t = result["time"].values
    exact = 1 - t + np.maximum(t - 1, 0) ** 2 / 2 - np.maximum(t - 2, 0) ** 3 / 6
    np.testing.assert_allclose(result["x.y"], exact, rtol=0, atol=SMOOTH)


@pytest.mark.parametrize("delay", [0.005, 0.1, 0.1234, 1.0])
def test_smooth_signal_comes_out_later(delay):
    d = Diagram("d")
    d.add("sine", Sine([1.0, 2.0])) >> d.add("late", TransportDelay(delay, [0.5, 0.5]))
    result = simulate(d, 2.0, step=0.01, progress=False)
    t = result["time"].values - delay
    exact = np.where(t[:, None] < 0.0, 0.5, np.outer(np.sin(2 * np.pi * t), [1.0, 2.0]))
    np.testing.assert_allclose(result["late.y"], exact, rtol=0, atol=SMOOTH)


every_solver = pytest.mark.parametrize("settings", [{"step": 0.05}, {"solver": "RK45"}, {"solver": "BDF"}])


@every_solver
def test_jump_of_a_source_comes_out_as_one(settings):
    """The first value jumps to 2 at the start, and that to 3 at 0.5 s; the integral tells when exactly."""
    d = Diagram("d")
    d.add("step", Step(0.5, initial_value=2.0, final_value=3.0)) >> d.add("late", TransportDelay(0.237, -1.0))
    d.late.y >> d.add("area", Integrator())
    result = simulate(d, 2.0, log_step=0.5, progress=False, **settings)
    assert result["area.y"][-1] == pytest.approx(-0.237 + 2 * 0.5 + 3 * (2.0 - 0.737), rel=0, abs=1e-9)


@every_solver
def test_jumps_of_a_sampled_block_come_out_as_such(settings):
    d = Diagram("d")
    sine, hold, late = d.add(
        sine=Sine(1.0, 1 / np.pi), hold=ZeroOrderHold(0.1), late=TransportDelay(0.237, -1.0)
    )
    sine >> hold >> late >> d.add("area", Integrator())
    result = simulate(d, 2.0, log_step=0.5, progress=False, **settings)
    held = 0.1 * np.arange(20)
    exact = np.sin(2 * held) @ np.clip(2.0 - 0.237 - held, 0.0, 0.1) - 0.237
    assert result["area.y"][-1] == pytest.approx(exact, rel=0, abs=1e-8)


@every_solver
def test_jumps_at_events_come_out_as_such(settings):
    """A relay in a late loop makes a triangle, as high as its threshold and the delay."""
    d = Diagram("relay")
    x, relay, late = d.add(
        x=Integrator(), relay=Relay(0.5, -0.5, on=-1.0, off=1.0), late=TransportDelay(0.25)
    )
    x >> relay >> late >> x
    result = simulate(d, 12.0, log_step=0.05, progress=False, **settings)
    t = result["time"].values[5:]  # nothing comes out before
    np.testing.assert_allclose(result["x.y"][5:], 0.75 - abs((t - 2.5) % 3.0 - 1.5), rtol=0, atol=1e-8)


@pytest.mark.parametrize("settings", [{"step": 0.01}, {"solver": "RK45", "log_step": 0.01}])
@pytest.mark.parametrize("periods", [1, 2, 3, 7])
def test_what_is_sampled_when_a_jump_comes_out_sees_it(periods, settings):
    """Though 0.1 + 0.2 is more than 0.3, where numbers are rounded."""
    d = Diagram("sampled again")
    time, first, late, second = d.add(
        time=TimeFunction(lambda t: t),
        first=ZeroOrderHold(0.1),
        late=TransportDelay(0.1 * periods),
        second=ZeroOrderHold(0.1),
    )
    time >> first >> late >> second
    result = simulate(d, 3.0, **settings)
    tenths = np.maximum(np.arange(301) // 10 - periods, 0)
    np.testing.assert_allclose(result["second.y"], 0.1 * tenths, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("solver", ["RK45", "DOP853", "LSODA", "BDF"])
def test_long_steps_see_all_of_what_comes_out(solver):
    """By steps, as above: polynomials, of which a solver would take few."""
    end = simulate(delayed_loop(1.0, 1.0), 5.0, solver=solver, log_step=5.0, progress=False)["x.y"][-1]
    assert end == pytest.approx(1 - 5 + 16 / 2 - 27 / 6 + 16 / 24 - 1 / 120, rel=0, abs=1e-6)


def test_steps_are_no_longer_than_the_delay():
    """One of an adaptive solver, which would take the whole run at once."""
    d = delayed_loop(0.0, 0.1)
    d.add("sine", Sine()) >> d.add("other", TransportDelay(0.05))
    result = simulate(d, 2.0, solver="RK45", log_step=0.01, progress=False)
    exact = np.sin(2 * np.pi * (result["time"].values - 0.05))
    np.testing.assert_allclose(result["other.y"][6:], exact[6:], rtol=0, atol=1e-3)  # steps of 0.05 s


def test_session_goes_back():
    with Session(delayed_loop(1.0, 0.5), outputs=["x.y"], step=0.01) as session:
        session.advance(0.8)
        saved = session.save()
        session.advance(2.0)
        there = session.outputs["x.y"]
        session.restore(saved)
        session.advance(2.0)
        assert session.outputs["x.y"] == there


@pytest.mark.parametrize("delay", [1e-3, 0.5])
def test_linear_model_is_the_approximant(delay):
    model = linearize(TransportDelay(delay), ["u"], ["y"])
    omega = np.linspace(0.1, 2.5, 20) / delay
    found = np.array([model(1j * w) for w in omega]).ravel()
    np.testing.assert_allclose(found, np.exp(-1j * omega * delay), rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"delay": 0.0}, "'delay' of TransportDelay is 0; it must be above 0"),
        ({"delay": 1.0, "pade": 0}, "from 1 to 10"),
    ],
)
def test_nonsense_is_refused(arguments, message):
    with pytest.raises(BlockError, match=message):
        TransportDelay(**arguments)


def varying(delay, shortest=0.05, longest=3.0):
    """Return a sine of 1 Hz that is delayed by a function of time."""
    d = Diagram("d")
    late = d.add(late=VariableDelay(shortest, longest, 0.5))
    d.add("sine", Sine()) >> late.u
    d.add("delay", TimeFunction(delay, unit="s")) >> late.delay
    return d


@pytest.mark.parametrize("settings", [{"step": 0.01}, {"step": 0.01, "backend": "numpy"}])
def test_a_varying_delay_reads_the_signal_of_that_time(settings):
    result = simulate(varying(lambda t: 0.6 + 0.4 * np.sin(3 * t)), 3.0, progress=False, **settings)
    t = result["time"].values
    then = t - 0.6 - 0.4 * np.sin(3 * t)
    exact = np.where(then < 0.0, 0.5, np.sin(2 * np.pi * then))
    np.testing.assert_allclose(result["late.y"], exact, rtol=0, atol=SMOOTH)


@pytest.mark.parametrize("growth", [0.3, -0.2])
def test_a_delay_that_grows_evenly_lowers_a_tone(growth):
    """By the factor 1 - d', as a siren that drives away."""
    result = simulate(varying(lambda t: 1.5 + growth * t), 4.5, step=0.01, progress=False)
    after = result.sel(time=slice(2.5, None))
    t, y = after["time"].values, after["late.y"].values
    tone = 2 * np.pi * (1 - growth)
    basis = np.column_stack([np.sin(tone * t), np.cos(tone * t)])
    fit, left, _, _ = np.linalg.lstsq(basis, y, rcond=None)
    assert np.hypot(*fit) == pytest.approx(1.0, abs=SMOOTH)
    assert float(left[0]) < SMOOTH**2 * t.size


def test_interpolation_between_steps_is_of_fourth_order():
    def error(step):
        diagram = varying(lambda t: 0.5 + 0.3 * t, shortest=0.4)
        result = simulate(diagram, 2.0, step=step, log_step=0.04, progress=False)
        t = result["time"].values
        exact = np.sin(2 * np.pi * (0.7 * t - 0.5))
        return float(np.abs(result["late.y"].values - exact)[t > 1.0].max())

    assert np.log2(error(0.02) / error(0.01)) == pytest.approx(4.0, abs=0.4)


@pytest.mark.parametrize("settings", [{"step": 0.01}, {"solver": "RK45", "log_step": 0.01}])
def test_a_delay_that_jumps_up_leads_back_behind_a_jump(settings):
    """A step at 0.5 s is out from 0.7 s to 1 s, and again from 1.5 s; before, it is what it was at first."""
    d = Diagram("back")
    jump, length, late, total = d.add(
        jump=Step(0.5, final_value=1.0),
        length=Step(1.0, initial_value=0.2, final_value=1.0),
        late=VariableDelay(0.1, 2.0),
        total=Integrator(),
    )
    jump >> late.u
    length >> late.delay
    late >> total
    result = simulate(d, 2.0, **settings)
    t = result["time"].values
    exact = np.clip(t, 0.7, 1.0) - 0.7 + np.maximum(t - 1.5, 0.0)
    np.testing.assert_allclose(result["total.y"], exact, rtol=0, atol=1e-9)


def test_a_delay_beyond_its_bounds_counts_as_the_bound():
    diagram = varying(lambda t: 0.2 + 0.0 * t, shortest=0.4, longest=0.6)
    result = simulate(diagram, 2.0, step=0.01, progress=False)
    t = result["time"].values
    np.testing.assert_allclose(result["late.y"][45:], np.sin(2 * np.pi * (t - 0.4))[45:], rtol=0, atol=SMOOTH)
    diagram = varying(lambda t: 5.0 + 0.0 * t, shortest=0.4, longest=0.6)
    result = simulate(diagram, 2.0, step=0.01, progress=False)
    np.testing.assert_allclose(result["late.y"][65:], np.sin(2 * np.pi * (t - 0.6))[65:], rtol=0, atol=SMOOTH)


def test_steps_of_an_adaptive_solver_are_no_longer_than_the_shortest_delay():
    result = simulate(varying(lambda t: 0.05 + 0.1 * t), 2.0, solver="RK45", log_step=0.01, progress=False)
    t = result["time"].values
    exact = np.sin(2 * np.pi * (0.9 * t - 0.05))
    np.testing.assert_allclose(result["late.y"][6:], exact[6:], rtol=0, atol=1e-3)  # steps of 0.05 s


def test_linear_models_freeze_the_delay_where_it_is():
    d = Diagram("d")
    late = d.add(late=VariableDelay(0.01, 2.0))
    d.expose(u=late.u, delay=late.delay, y=late.y)
    at = OperatingPoint(inputs={"delay": np.array(0.7)})
    model = linearize(d, at=at)
    omega = np.linspace(0.1, 2.5, 20) / 0.7
    found = model.frequency_response(omega).complex[0]
    np.testing.assert_allclose(found[0], np.exp(-0.7j * omega), rtol=0, atol=1e-6)
    np.testing.assert_allclose(found[1], 0.0, rtol=0, atol=1e-9)  # at rest all times are alike
    fixed = linearize(TransportDelay(0.7), "u", "y")
    np.testing.assert_allclose(model.A, fixed.A, rtol=1e-7, atol=1e-9)


def test_a_loop_with_a_varying_delay_goes_back_in_a_session():
    d = Diagram("loop")
    x, late = d.add(x=Integrator(1.0), late=VariableDelay(0.1, 1.0, 1.0))
    x >> late.u
    d.add("delay", TimeFunction(lambda t: 0.3 + 0.1 * t, unit="s")) >> late.delay
    (-1.0 * late.y) >> x
    with Session(d, outputs=["x.y"], step=0.01) as session:
        session.advance(0.8)
        saved = session.save()
        session.advance(2.0)
        there = session.outputs["x.y"]
        session.restore(saved)
        session.advance(2.0)
        assert session.outputs["x.y"] == there


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0.0, 1.0), "'shortest' of VariableDelay is 0; it must be above 0"),
        ((1.0, 1.0), "'longest' of VariableDelay is 1; it must be above 1"),
    ],
)
def test_nonsense_of_a_varying_delay_is_refused(arguments, message):
    with pytest.raises(BlockError, match=message):
        VariableDelay(*arguments)
