"""What users of other tools did wrong in their first hours, and what each mistake is answered with."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import pytest
from refused import check_refused, over_calls
from systems import ports, series

from trussflow.blocks import (
    Block,
    Constant,
    Function,
    Gain,
    Output,
    Parameter,
    PythonFunction,
    Simulator,
    State,
    simulate,
)
from trussflow.blocks.errors import SimulationError


def run(block, u=1.0, **settings):
    """Simulate a block with constants at its inputs."""
    diagram = series(b=block)
    for port in block.inputs():
        diagram.add(f"{port.name}_source", Constant(u)) >> port
    return simulate(diagram, 0.2, step=0.1, backend="numpy", **settings)


def python(law):
    return run(PythonFunction(law, 0.1, **ports(u=(), y=())))


class Forgetful(Block):
    y = Output()

    def __init__(self):
        self.size = 1


class Late(Block):
    y = Output()

    def __init__(self):
        super().__init__()
        self.size = 1


class Counted(Block):
    n = Parameter(3.0)
    y = Output()

    def output(self, t, x, u, p):
        return {"y": np.sum(np.ones(int(p.n)))}


class Derivatives(Block):
    x, y = State(), Output()

    def output(self, t, x, u, p):
        return {"y": x.x}

    def derivatives(self, t, x, u, p):
        return {"x": 1.0}


def added():
    return series(g=Gain(1.0))


@over_calls(__file__)
def test_a_mistake_is_answered(call, error, message):
    names = globals() | {"deepcopy": deepcopy}
    check_refused(call, error, message, names)


def test_folders_that_are_missing_are_named(tmp_path):
    with pytest.raises(SimulationError, match=r"No such file or directory: '.*nowhere"):
        run(Gain(1.0), stream_to=tmp_path / "nowhere" / "run.nc")


def test_what_is_frozen_is_frozen_on_purpose():
    """A function is traced once: what it reads besides its inputs is read then, as the README says."""
    factor = [2.0]
    diagram = series(one=Constant(1.0), law=Function(lambda u: factor[0] * u))

    simulator = Simulator(diagram, step=0.1, backend="interpreted")
    factor[0] = 5.0
    assert simulator.run(0.1)["law.y"][-1] == 2.0
