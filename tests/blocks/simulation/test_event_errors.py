"""Hooks for events that return what they must not: one clear error."""

import numpy as np
import pytest
from systems import Counter, series

from trussflow.blocks import Block, Event, Mode, Output, State, simulate
from trussflow.blocks.errors import (
    BlockError,
    DivergenceError,
    ParameterError,
    SimulationError,
)


class Falling(Block):
    traced = False
    y = Output()
    level = State(initial=1.0)
    half = Event()

    def output(self, t, x, u, p):
        return {"y": x.level}

    def derivative(self, t, x, u, p):
        return {"level": -1.0}

    def indicators(self, t, x, u, p):
        return {"half": x.level - 0.5}


def run(**own):
    diagram = series("fall", fall=type("Own", (Falling,), own)())
    simulate(diagram, 1.0, step=0.1)


@pytest.mark.parametrize(
    "hook, returned, error, message",
    [
        (
            "on_event",
            {"z": 1.0},
            BlockError,
            r"on_event.* of block .fall. .*some of: level; .*: z",
        ),
        (
            "on_event",
            {"level": np.ones(3)},
            BlockError,
            r"on_event.*'level' is .*shape \(3,\)",
        ),
        (
            "on_event",
            None,
            BlockError,
            r"on_event.* must return a dict of some of.*'NoneType'",
        ),
        (
            "indicators",
            {"half": "up"},
            ParameterError,
            r"indicators\(\) of Python block 'fall' .* be numeric",
        ),
        (
            "indicators",
            {"half": np.nan},
            SimulationError,
            r"indicator 'fall.half' is not a number at t = 0 s",
        ),
        (
            "indicators",
            {},
            BlockError,
            r"indicators\(\) of block 'fall' .* a dict of: half; it returned: $",
        ),
        (
            "on_event",
            {"level": np.nan},
            DivergenceError,
            r"'fall.level' stopped being finite at t = 0.5 s: on_e",
        ),
    ],
)
def test_what_hooks_return(hook, returned, error, message):
    with pytest.raises(error, match=message):
        run(**{hook: lambda *_: returned})


@pytest.mark.parametrize(
    "base, own, message",
    [
        (
            Counter,
            {"on_event": lambda *_: {}},
            "event methods would never be called: declare an event",
        ),
        (
            Counter,
            {"stuck": Mode()},
            r"declares events or modes, but has no indicators",
        ),
        (
            Counter,
            {"hit": Event(), "indicators": lambda *_: {"hit": 1.0}},
            "a sampled block cannot have events",
        ),
        (
            Falling,
            {"traced": True, "on_step": lambda *_: True},
            r"on_step\(\) would never be called",
        ),
    ],
)
def test_hooks_that_would_never_be_called(base, own, message):
    diagram = series("odd", odd=type("Own", (base,), own)())
    if base is Counter:
        diagram.odd.sampled(0.1)
    with pytest.raises(BlockError, match=f"cannot run block 'odd' .Own.: .*{message}"):
        simulate(diagram, 1.0, step=0.1)


def test_a_kind_of_event_that_there_is_not():
    with pytest.raises(
        BlockError,
        match="an event of kind 'up'; the kinds are: both, rising, falling, time",
    ):
        Event("up")


@pytest.mark.parametrize("backend", ["compiled", "interpreted"])
@pytest.mark.parametrize(
    "solver, time",
    [({"step": 0.1}, r"0\.[45]"), ({"solver": "RK45"}, r"(0\.4[5-9]|0\.[5-9]|1 )")],
    ids=["rk4", "RK45"],
)
def test_an_indicator_that_is_no_number_is_named(backend, solver, time):
    """A root of a negative number once the level, which falls by 1 per second, is below 0.55."""

    class Dividing(Falling):
        traced = True

        def indicators(self, t, x, u, p):
            return {"half": np.sqrt(x.level - 0.55)}

    diagram = series("fall", fall=Dividing())
    with pytest.raises(
        SimulationError, match=rf"indicator 'fall.half' is not a number at t = {time}"
    ):
        simulate(diagram, 1.0, **solver, backend=backend)
