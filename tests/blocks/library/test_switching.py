"""Blocks with events: exact times with every solver, and values at jumps, limits and resets."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import assert_near, series

from trussflow.blocks import (
    Backlash,
    Block,
    Constant,
    Diagram,
    Event,
    Integrator,
    LimitedIntegrator,
    Parameter,
    Pulse,
    Ramp,
    Relay,
    Sine,
    State,
    Step,
    StopWhen,
    Switch,
    TimeFunction,
    simulate,
)

LOCATION_ERROR = 5e-8
"""Error of an integral over some switching times; DOP853 has rtol 1e-8 between them."""

SOLVERS = [{"step": 0.01}, {"step": 0.01, "backend": "numpy"}, {"solver": "DOP853"}]
over_solvers = pytest.mark.parametrize(
    "settings", SOLVERS, ids=["rk4", "numpy", "DOP853"]
)


def run(diagram, duration, settings, **more):
    return simulate(diagram, duration, log_step=0.01, **settings, **more)


def integrated(block, **inputs):
    """Return a diagram with a block, sources at its inputs, and the integral of its output."""
    d = Diagram("d")
    d.add("block", block) >> d.add("area", Integrator())
    for name, source in inputs.items():
        d.add(f"{name}_source", source) >> block.port(name)
        # so that solvers see it
        d.blocks[f"{name}_source"].y >> d.add(f"{name}_area", Integrator())
    return d


@pytest.mark.parametrize(
    "level, start_on, expected",
    [(1.0, False, 1.0), (-1.0, True, 0.0), (0.0, True, 1.0), (0.0, False, 0.0)],
)
def test_relay_at_the_start(level, start_on, expected, respond):
    assert (
        respond(Relay(0.5, -0.5, start_on=start_on), 0.01, u=level)["block.y"][0]
        == expected
    )


@over_solvers
def test_relay_oscillates_as_it_must(settings):
    """A lag under a relay: T ln((1 - a)/(1 - b)) up, the same down, exactly."""
    d = Diagram("thermostat")
    relay, lag = d.add(relay=Relay(0.2, -0.2, on=-1.0, off=1.0), lag=Integrator())
    (relay.y - lag.y) >> lag >> relay
    first, half = np.log(1 / 0.8), np.log(1.2 / 0.8)
    result, t = run(d, 3.0, settings), 0.01 * np.arange(301)
    ups = np.mod(t - first, 2 * half)
    expected = np.where(
        ups < half, 1.2 * np.exp(-ups) - 1.0, 1.0 - 1.2 * np.exp(half - ups)
    )
    expected = np.where(t < first, 1.0 - np.exp(-t), expected)
    assert_near(result["lag.y"], expected, LOCATION_ERROR)


@over_solvers
def test_switch_chooses_by_thresholds(settings):
    """A sine of 2 s is above 0.5 for 2/3 s, between for 2/3 s, below -0.5 for 2/3 s."""
    sources = {
        "u1": Constant([1.0, 0.0]),
        "u2": Constant([2.0, 5.0]),
        "u3": Constant([3.0, 7.0]),
    }
    d = integrated(Switch([-0.5, 0.5]), control=Sine(1.0, 0.5), **sources)
    area = run(d, 2.0, settings)["area.y"][-1]
    assert_near(area, [4.0, 8.0], LOCATION_ERROR)


@over_solvers
@pytest.mark.parametrize("start", [0.0, 5.3])
def test_pulses_are_exact(settings, start):
    """Edges lie on no step: high for two thirds of a period of 0.7 s, from 0.13 s on."""
    pulse = Pulse(0.7, 2 / 3, delay=0.13, high=[2.0, 3.0], low=[-1.0, 0.0])
    result = run(integrated(pulse), 1.5, settings, start=start)
    edges = 0.13 + 0.7 * np.arange(20)
    high = np.clip(result["time"].values[:, None] - edges, 0.0, 1.4 / 3).sum(axis=1)
    area = np.outer(high - high[0], [3.0, 3.0]) + np.outer(
        result["time"] - start, [-1.0, 0.0]
    )
    assert_near(result["area.y"], area, LOCATION_ERROR)


@over_solvers
def test_integral_between_limits(settings):
    """The rate cos(t): up to 0.5 at t = pi/6, held until pi/2, down by 2 to the lower limit -0.25."""
    d = integrated(LimitedIntegrator(lower=-0.25, upper=0.5), u=TimeFunction(np.cos))
    result = run(d, 6.0, settings)
    t = result["time"].values
    down = np.pi / 2 + np.arccos(1 - 0.75)
    expected = np.select(
        [t < np.pi / 6, t < np.pi / 2, t < down, t < 3 * np.pi / 2],
        [np.sin(t), 0.5, 0.5 + np.sin(t) - 1.0, -0.25],
        np.minimum(-0.25 + np.sin(t) + 1.0, 0.5),
    )
    # interpolation of DOP853
    assert_near(result["block.y"], expected, 1e-7)


def test_integral_that_starts_beyond_a_limit(respond):
    result = respond(
        LimitedIntegrator(5.0, upper=1.0),
        1.0,
        u=Step(0.5, initial_value=1.0, final_value=-1.0),
    )
    assert_near(result["block.y"][[0, 50, 100]], [1.0, 1.0, 0.5], LOCATION_ERROR)


@over_solvers
@pytest.mark.parametrize("signal", [lambda y: y - 1.0, lambda y: y > 1.0])
def test_run_ends_where_a_signal_rises(settings, signal):
    d = integrated(TimeFunction(lambda t: 1.0 / (1.0 - t)))
    signal(d.area.y) >> d.add("stop", StopWhen("blown up"))
    result = run(d, 2.0, settings)
    assert result.attrs["status"] == "ended"
    assert result.attrs["ended"].startswith("'stop' ended the run at t = 0.63212055")
    assert result.attrs["ended"].endswith(" s blown up")
    assert_near(result["time"][-1], 0.63, LOCATION_ERROR)


@over_solvers
def test_condition_that_holds_at_the_start_ends_a_run_when_it_holds_again(settings):
    """A cosine of 1 s is above a half until 1/6 s, and again from 5/6 s on."""
    d = integrated(Sine(phase=np.pi / 2))
    (d.block.y > 0.5) >> d.add("stop", StopWhen())
    ended = run(d, 2.0, settings).attrs["ended"]
    assert float(ended.split()[-2]) == pytest.approx(5 / 6, abs=LOCATION_ERROR)


@over_solvers
def test_signal_at_its_threshold_at_the_start_leaves_it(settings):
    """-t/2 puts a relay and a switch at zero off at once; an integral at its limit does not wind up."""
    for block in (Relay(), Switch(0.0)):
        d = integrated(block, **{block.inputs()[0].name: Ramp(-0.5)})
        if isinstance(block, Switch):
            d.ground(block.u1)
            d.add(one=Constant(1.0)) >> block.u2
        assert_near(run(d, 1.0, settings)["area.y"][-1], 0.0, LOCATION_ERROR)
    d = integrated(
        LimitedIntegrator(1.0, upper=1.0), u=TimeFunction(lambda t: t * (0.5 - t))
    )
    end = 1 - 1 / 12 - 1 / 48  # the integral of t^2 - t/2 from 1/2 to 1
    assert_near(run(d, 1.0, settings)["block.y"][-1], end, LOCATION_ERROR)


class Empty(Block):
    """A tank that ends the run when it is empty, with a parameter called as the text of `StopWhen`."""

    message, level = Parameter(3.0), State(initial=1.0)
    empty = Event("terminal")

    def derivative(self, t, x, u, p):
        return {"level": -p.message + 0.0 * x.level}

    def indicators(self, t, x, u, p):
        return {"empty": -x.level}


def test_a_parameter_is_no_text_of_a_terminal_event():
    ended = simulate(series(tank=Empty()), 1.0, step=0.01).attrs["ended"]
    assert ended == "'tank' ended the run at t = 0.333333333333 s"


def test_backlash_is_play(respond):
    """A sine of amplitude 1 and a gap of 0.5: the driven side lags by 0.25 and turns 0.25 late."""
    result = respond(Backlash(0.5, 0.01), 4.0, u=Sine(1.0, 0.5))
    y, u = result["block.y"].values, np.sin(np.pi * result["time"].values)
    assert (abs(y - u) <= 0.25 + LOCATION_ERROR).all()
    assert y.max() == pytest.approx(0.75, abs=LOCATION_ERROR)
    assert y[:9].max() == 0.0  # not before sin(pi t) = 0.25
    assert_array_equal(y[50:60], 0.75)


def test_time_functions():
    source = TimeFunction(
        lambda t: np.stack([t, np.exp(-t), np.where(t < 0.55, 0.0, 1.0)]),
        breakpoints=[0.55],
        unit="m",
    )
    d = integrated(source)
    result = simulate(d, 1.0, solver="DOP853")
    assert_near(result["area.y"][-1], [0.5, 1 - np.exp(-1.0), 0.45], LOCATION_ERROR)
    assert source.breakpoints() == (0.55,)
