"""Groups: while not enabled nothing moves, and a triggered group computes at edges, once."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from trussflow.blocks import (
    Constant,
    Diagram,
    DiagramError,
    Gain,
    Integrator,
    LimitedIntegrator,
    PythonFunction,
    Ramp,
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
    triggered,
)
from trussflow.blocks.framework.port import Input, Output

SETTINGS: dict[str, Any] = {"step": 0.01, "backend": "interpreted", "progress": False}
TOLERANCE = 1e-9  # round-off, and times located to round-off


def timer():
    """Return a group that integrates 1."""
    group = Diagram("timer")
    one, count = group.add(one=Constant(1.0), count=Integrator())
    one >> count
    group.expose(y=count.y)
    return group


def counter():
    """Return a group, two diagrams deep, that counts the instants at which it computes, every 0.1 s."""
    inner, group = Diagram("inner"), Diagram("counter")
    one, total, before = inner.add(one=Constant(1.0), total=Sum("++"), before=UnitDelay(0.1))
    one >> total.u1
    before >> total.u2
    total >> before
    inner.expose(y=total.y)
    group.add(inner=inner)
    group.expose(y=inner.y)
    return group


def found(group, times, port="enable"):
    """Return what a group shows that a pulse switches on from 0.25 to 0.65 s, and after each whole second."""
    diagram = Diagram("test")
    wave = TimeFunction(lambda t: (t - 1.0 * (t >= 1.0) - 0.25) * (0.65 - t + 1.0 * (t >= 1.0)) + 0.5)
    pulse, group = diagram.add(pulse=wave, group=group)
    pulse.y >> group.port(port)
    result = simulate(diagram, max(times), log={"y": group.y}, **SETTINGS)
    return [float(result["y"].sel(time=t, method="nearest")) for t in times]


TIMES = [0.2, 0.45, 0.9, 1.45, 1.9]


@pytest.mark.parametrize(
    ("settings", "exact"),
    [
        ({}, [0.0, 0.2, 0.4, 0.6, 0.8]),
        ({"states": "reset"}, [0.0, 0.2, 0.4, 0.2, 0.4]),
        ({"outputs": "reset"}, [0.0, 0.2, 0.0, 0.6, 0.0]),
        ({"states": "reset", "outputs": "reset"}, [0.0, 0.2, 0.0, 0.2, 0.0]),
    ],
)
def test_an_enabled_group_runs_while_it_is_enabled(settings, exact):
    np.testing.assert_allclose(found(enabled(timer(), **settings), TIMES), exact, rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize(
    ("states", "exact"), [("held", [0.0, 2.0, 4.0, 6.0, 8.0]), ("reset", [0.0, 2.0, 4.0, 2.0, 4.0])]
)
def test_sampled_blocks_count_the_instants_at_which_they_are_enabled(states, exact):
    """0.3 to 0.6 s, and 1.3 to 1.6 s; what is shown at 0.45 s was computed at 0.4 s."""
    times = [0.2, 0.45, 0.85, 1.45, 1.85]
    values = found(enabled(counter(), states=states), times)
    np.testing.assert_allclose(values, exact, rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize(
    ("edge", "exact"), [("rising", [0, 1, 1, 2, 2]), ("falling", [0, 0, 1, 1, 2]), ("both", [0, 1, 2, 3, 4])]
)
def test_a_triggered_group_computes_once_at_each_edge(edge, exact):
    assert found(triggered(counter(), edge=edge), TIMES, "trigger") == exact


def test_a_group_is_enabled_where_it_is_the_outermost_diagram_too():
    """Its state is the integral of 1 where a sine is above a half: a third of each period."""
    group = enabled(timer())
    around = Diagram("around")
    wave, group = around.add(wave=Sine(1.0, 1.0), group=group)
    wave >> group.enable
    again = pickle.loads(pickle.dumps(around))
    for diagram in (around, again):
        result = simulate(diagram, 3.0, log=["group.count.integral"], **SETTINGS)
        assert float(result["group.count.integral"][-1]) == pytest.approx(1.0, abs=TOLERANCE)


def test_what_has_crossed_while_a_group_was_off_is_an_event_when_it_is_enabled():
    """The relay would see the step at 0.9 s, but is off from 0.75 to 1.25 s."""
    group = Diagram("group")
    relay, total = group.add(relay=Relay(0.5), total=Integrator())
    relay >> total
    group.expose(u=relay.u, y=total.y)
    diagram = Diagram("test")
    wave = TimeFunction(lambda t: np.where(t < 1.0, 1.25 - t, t - 0.75))
    enable, jump, group = diagram.add(enable=wave, jump=Step(0.9), group=enabled(group))
    enable.y >> group.enable
    jump >> group.u
    result = simulate(diagram, 2.0, log={"y": group.y}, **SETTINGS)
    assert float(result["y"].sel(time=1.2, method="nearest")) == pytest.approx(0.0, abs=TOLERANCE)
    assert float(result["y"][-1]) == pytest.approx(0.75, abs=TOLERANCE)


def test_limits_and_resets_of_an_integrator_wait_for_the_group():
    """It rises from 0.25 to its limit, at 0.55 s; is reset at 0.8 s while off, which it learns at 1.25 s."""
    group = Diagram("group")
    one, total = group.add(one=Constant(1.0), total=LimitedIntegrator(upper=0.3, reset="rising"))
    one >> total.u
    group.expose(reset=total.reset, y=total.y)
    diagram = Diagram("test")
    wave = TimeFunction(lambda t: (t - 1.0 * (t >= 1.0) - 0.25) * (0.65 - t + 1.0 * (t >= 1.0)) + 0.5)
    enable, jump, group = diagram.add(enable=wave, jump=Step(0.8, initial_value=-1.0), group=enabled(group))
    enable.y >> group.enable
    jump >> group.reset
    for made in (diagram, copy.deepcopy(diagram)):
        result = simulate(made, 1.6, log={"y": "group.total.y"}, **SETTINGS)
        found = [float(result["y"].sel(time=t, method="nearest")) for t in (0.45, 0.6, 1.2, 1.45, 1.6)]
        np.testing.assert_allclose(found, [0.2, 0.3, 0.3, 0.2, 0.3], rtol=0, atol=TOLERANCE)


def test_what_is_above_zero_when_a_group_is_first_enabled_has_not_risen():
    """The integral began at the start of its ramp, 0, and a reset would set it to 0.25."""
    group = Diagram("group")
    zero, total = group.add(
        zero=Constant(0.0), total=LimitedIntegrator(reset="rising", start_from_input=True)
    )
    zero >> total.u
    group.expose(reset=total.reset, start=total.start, y=total.y)
    diagram = Diagram("test")
    enable, jump, ramp, group = diagram.add(
        enable=Step(0.25), jump=Constant(1.0), ramp=Ramp(), group=enabled(group)
    )
    enable >> group.enable
    jump >> group.reset
    ramp >> group.start
    assert float(simulate(diagram, 0.5, log={"y": group.y}, **SETTINGS)["y"][-1]) == 0.0


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
        np.testing.assert_allclose(model.poles(), [pole], rtol=0, atol=1e-12)


def test_what_cannot_be_a_group_is_refused():
    python = Diagram("python")
    python.add(function=PythonFunction(float, inputs={"u": Input()}, outputs={"y": Output()}))
    twice: Any = enabled(timer())
    around = Diagram("around")
    around.add(inner=enabled(timer()))
    no_diagram: Any = Gain(1.0)
    refused: list[tuple[Callable[[], Any], str]] = [
        (
            lambda: enabled(python),
            r"cannot put 'function' \(PythonFunction\) into a group: it is a Python block",
        ),
        (lambda: enabled(twice), "cannot make a group of .*: it has a port 'enable' already"),
        (lambda: enabled(around), "cannot put 'inner.count' into a group: it is in one"),
        (lambda: enabled(no_diagram), "it is no Diagram"),
        (lambda: triggered(timer()), r"cannot trigger 'count' \(Integrator\): it has continuous states"),
        (lambda: enabled(timer(), states="kept"), "states of a group"),
        (lambda: enabled(timer(), outputs="kept"), "outputs of a group"),
        (lambda: triggered(counter(), edge="up"), "edge"),
    ]
    for make, message in refused:
        with pytest.raises(DiagramError, match=message):
            make()
