"""Groups: while not enabled nothing moves."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from refused import check_refused, over_calls
from systems import assert_near, ports, series

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    Event,
    Input,
    Integrator,
    LimitedIntegrator,
    Mode,
    Noise,
    Output,
    PythonFunction,
    Relay,
    Sine,
    Step,
    Sum,
    TimeFunction,
    TransferFunction,
    UnitDelay,
    enabled,
    linearize,
    simulate,
)

TOLERANCE = 1e-9  # round-off, and times located to round-off


def timer():
    """Return a group that integrates 1."""
    group = series(one=Constant(1.0), count=Integrator())
    group.expose(y=group.count.y)
    return group


def counter():
    """Return a group, two diagrams deep, that counts the instants at which it computes, every 0.1 s."""
    inner, group = Diagram("inner"), Diagram("counter")
    one, total, before = inner.add(
        one=Constant(1.0), total=Sum("++"), before=UnitDelay(0.1)
    )
    one >> total.u1
    before >> total.u2
    total >> before
    inner.expose(y=total.y)
    group.add(inner=inner)
    group.expose(y=inner.y)
    return group


def pulses():
    """Return a signal above a half from 0.25 to 0.65 s, and again after each whole second."""
    return TimeFunction(
        lambda t: (t - 1.0 * (t >= 1.0) - 0.25) * (0.65 - t + 1.0 * (t >= 1.0)) + 0.5
    )


def values(result, times):
    return result["y"].sel(time=times, method="nearest").values


def run(group, duration, **sources):
    """Simulate a group with sources at its ports; log its output."""
    diagram = series(group=group)
    for name, source in sources.items():
        diagram.add(name, source) >> group.port(name)
    return simulate(diagram, duration, log={"y": group.y}, step=0.01)


def output(group, times):
    """Return the output of a group that pulses switch on."""
    return values(run(group, max(times), enable=pulses()), times)


TIMES = [0.2, 0.45, 0.9, 1.45, 1.9]


@pytest.mark.parametrize(
    "settings, exact",
    [
        ({}, [0.0, 0.2, 0.4, 0.6, 0.8]),
        ({"states": "reset"}, [0.0, 0.2, 0.4, 0.2, 0.4]),
        ({"outputs": "reset"}, [0.0, 0.2, 0.0, 0.6, 0.0]),
        ({"states": "reset", "outputs": "reset"}, [0.0, 0.2, 0.0, 0.2, 0.0]),
    ],
)
def test_an_enabled_group_runs_while_it_is_enabled(settings, exact):
    assert_near(output(enabled(timer(), **settings), TIMES), exact, TOLERANCE)


@pytest.mark.parametrize(
    "states, exact",
    [("held", [0.0, 2.0, 4.0, 6.0, 8.0]), ("reset", [0.0, 2.0, 4.0, 2.0, 4.0])],
)
def test_sampled_blocks_count_the_instants_at_which_they_are_enabled(states, exact):
    """0.3 to 0.6 s, and 1.3 to 1.6 s; what is shown at 0.45 s was computed at 0.4 s."""
    times = [0.2, 0.45, 0.85, 1.45, 1.85]
    counts = output(enabled(counter(), states=states), times)
    assert_near(counts, exact, TOLERANCE)


def test_a_group_is_enabled_where_it_is_the_outermost_diagram_too():
    """Its state is the integral of 1 where a sine is above a half: a third of each period."""
    group = enabled(timer())
    around = Diagram("around")
    wave, group = around.add(wave=Sine(1.0, 1.0), group=group)
    wave >> group.enable
    again = pickle.loads(pickle.dumps(around))
    for diagram in (around, again):
        result = simulate(diagram, 3.0, log=["group.count.integral"], step=0.01)
        assert result["group.count.integral"][-1] == pytest.approx(1.0, abs=TOLERANCE)


def test_crossing_while_a_group_is_off_is_an_event_when_it_is_enabled():
    """The relay would see the step at 0.9 s, but is off from 0.75 to 1.25 s."""
    group = series("group", relay=Relay(0.5), total=Integrator())
    group.expose(u=group.relay.u, y=group.total.y)
    wave = TimeFunction(lambda t: np.where(t < 1.0, 1.25 - t, t - 0.75))
    result = run(enabled(group), 2.0, enable=wave, u=Step(0.9))
    assert_near(values(result, [1.2, 2.0]), [0.0, 0.75], TOLERANCE)


def test_limits_of_an_integrator_wait_for_the_group():
    """It rises from 0.25 to its limit, at 0.55 s."""
    group = Diagram("group")
    one, total = group.add(one=Constant(1.0), total=LimitedIntegrator(upper=0.3))
    one >> total.u
    group.expose(y=total.y)
    group = enabled(group)
    for same in (copy.deepcopy(group), group):
        y = values(run(same, 1.6, enable=pulses()), [0.45, 0.6, 1.2, 1.6])
        assert_near(y, [0.2, 0.3, 0.3, 0.3], TOLERANCE)


class Rises(Block):
    """Counter of the rising zero crossings of a signal."""

    u, y = Input(), Output()
    count, rise = Mode(), Event("rising")

    def output(self, t, x, u, p):
        return {"y": x.count}

    def indicators(self, t, x, u, p):
        return {"rise": u.u}

    def on_event(self, t, x, u, p, fired):
        return {"count": x.count + 1.0}


def test_signal_above_zero_when_a_group_is_first_enabled_has_not_risen():
    group = Diagram("group")
    rises = group.add(rises=Rises())
    group.expose(u=rises.u, y=rises.y)
    result = run(enabled(group), 0.5, enable=Step(0.25), u=Constant(1.0))
    assert result["y"][-1] == 0.0


def test_linear_models_keep_a_group_as_it_is():
    """Enabled, a lag is a lag; disabled, it has an eigenvalue of zero and passes nothing."""
    for signal, pole in ((1.0, -2.0), (0.0, 0.0)):
        group, diagram = Diagram("group"), Diagram("test")
        lag = group.add(lag=TransferFunction([1.0], [0.5, 1.0]))
        group.expose(u=lag.u, y=lag.y)
        on, group = diagram.add(on=Constant(signal), group=enabled(group))
        on >> group.enable
        diagram.ground(group.u)
        model = linearize(diagram, [group.u], [group.y])
        assert_near(model.poles(), [pole], 1e-12)


def python():
    return series(function=PythonFunction(float, **ports(u=(), y=())))


def noise():
    return series("noise", noise=Noise(1.0, 0.1, seed=1))


def within(group):
    return series("around", inner=group)


@over_calls(__file__)
def test_diagrams_that_cannot_be_groups(call, error, message):
    check_refused(call, error, message, globals())
