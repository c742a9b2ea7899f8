"""Hooks for events that return what they must not: one clear error."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from trussflow.blocks import (
    Block,
    BlockError,
    Diagram,
    Output,
    ParameterError,
    SimulationError,
    State,
    TrussflowError,
    simulate,
)


class Falling(Block):
    traced = False
    y = Output()
    level = State(initial=1.0)

    def output(self, t: Any, x: Any, u: Any, p: Any) -> Any:
        return {"y": x.level}

    def derivative(self, t: Any, x: Any, u: Any, p: Any) -> Any:
        return {"level": -np.ones(())}

    def indicators(self, t: Any, x: Any, u: Any, p: Any) -> Any:
        return np.array([x.level - 0.5])


def run(**own: Any) -> None:
    diagram = Diagram("fall")
    diagram.add(fall=type("Own", (Falling,), own)())
    simulate(diagram, 1.0, step=0.1)


@pytest.mark.parametrize(
    ("hook", "returned", "error", "message"),
    [
        ("on_event", {"z": 1.0}, BlockError, r"on_event.* of block .fall. .*some of: level; .*: z"),
        ("on_event", {"level": np.ones(3)}, BlockError, r"on_event.*'level' is .*shape \(3,\)"),
        ("on_event", None, BlockError, r"on_event.* must return a dict of some of.*'NoneType'"),
        ("indicators", "up", ParameterError, r"indicators\(\) of block 'fall' must be numeric"),
        ("indicators", np.nan, ParameterError, r"indicators\(\) of block 'fall' is not finite"),
        ("next_event", None, SimulationError, r"next_event\(\) of block 'fall' returned None"),
        ("next_event", np.nan, SimulationError, r"next_event\(\) of block 'fall' returned nan"),
    ],
)
def test_what_hooks_return(hook: str, returned: Any, error: type[TrussflowError], message: str) -> None:
    with pytest.raises(error, match=message):
        run(**{hook: lambda *_: returned})


def test_hooks_that_would_never_be_called() -> None:
    with pytest.raises(BlockError, match=r"'fall' .* its hooks for events would never be called"):
        run(traced=True)
