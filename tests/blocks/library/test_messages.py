"""What users of other tools did wrong in their first hours, and what each mistake is answered with."""

from __future__ import annotations

import copy
import re

import numpy as np
import pytest
from systems import ports, series

from trussflow.blocks import (
    PID,
    Block,
    Constant,
    Diagram,
    Function,
    Gain,
    Integrator,
    Output,
    Parameter,
    PythonFunction,
    Saturation,
    Simulator,
    State,
    StateMachine,
    StateSpace,
    Step,
    Sum,
    simulate,
)
from trussflow.blocks.errors import (
    BlockError,
    DiagramError,
    NameLookupError,
    OpenInputError,
    ParameterError,
    SimulationError,
    TracingError,
    WiringError,
)


def run(block, u=1.0, **settings):
    """Simulate a block with constants at its inputs."""
    diagram = series(b=block)
    for port in block.inputs():
        diagram.add(f"{port.name}_source", Constant(u)) >> port
    return simulate(diagram, 0.2, step=0.1, backend="numpy", **settings)


def function(law, u=1.0, **ports):
    return run(Function(law, **ports), u)


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


def time_as_input():
    diagram = series(f=Function(lambda t: np.sin(t)))
    simulate(diagram, 0.1, step=0.1)


def index_of_unknown_shape():
    return Diagram("d").add(s=Sum("+-"))[0]


def system():
    return StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])


UNTYPED = Diagram("d")


@pytest.mark.parametrize(
    "mistake, error, message",
    [
        (
            lambda: Diagram("d").add(b=Forgetful()),
            BlockError,
            r"must call super\(\)\.__init__\(\)",
        ),
        (
            Late,
            BlockError,
            r"cannot set 'size' of 'Late': .* set it before super\(\)\.__init__\(\)",
        ),
        (
            lambda: UNTYPED.add(Gain(1.0)),
            DiagramError,
            r"write diagram\.add\(name=Gain\(\.\.\.\)\)",
        ),
        (
            lambda: UNTYPED.add(Gain),
            DiagramError,
            r"write diagram\.add\(name=Gain\(\.\.\.\)\)",
        ),
        (
            lambda: UNTYPED.add(g=Gain),
            DiagramError,
            r"Gain is a class; write g=Gain\(\.\.\.\)",
        ),
        (
            lambda: PID(Kp=1),
            TypeError,
            "a PID: .*; there is no 'Kp'; did you mean 'kp'",
        ),
        (
            lambda: Saturation(0.0),
            TypeError,
            "a Saturation: missing a required argument: 'upper'",
        ),
        (
            lambda: Saturation("a", None),
            ParameterError,
            "parameter 'lower' of Saturation must be numeric",
        ),
        (
            lambda: run(Gain(1.0), log_step=0.1000000000001),
            SimulationError,
            "of 0.1000000000001 s is",
        ),
        (
            lambda: StateMachine(["a"], 0.1),
            NameLookupError,
            "modes must be given by name",
        ),
        (
            lambda: added().g << added().g,
            WiringError,
            "connections are source >> target",
        ),
        (
            index_of_unknown_shape,
            WiringError,
            r"cannot index 's\.y': its shape is not known yet",
        ),
        (
            lambda: run(Gain(1.0), dt=0.1),
            SimulationError,
            "unknown setting 'dt'; there are: step, solver",
        ),
        (
            lambda: run(Gain(1.0), parameters=[1]),
            NameLookupError,
            r"by name, as a dict, not as \[1\]",
        ),
        (
            lambda: run(Gain(1.0), parameters={"b.k": 1.0}),
            NameLookupError,
            "the parameters are: b.gain, ",
        ),
        (
            lambda: run(system(), [1.0], parameters={"b.A": [[1.0]]}),
            NameLookupError,
            r"'b\.A' \('A' is a structural attribute of 'b': build another block\)",
        ),
        (
            lambda: run(Step(0.1), parameters={"b.time": 0.0}),
            NameLookupError,
            "'time' is a structural attribute of 'b': build",
        ),
        (
            lambda: run(Integrator(), log=["b.x"]),
            NameLookupError,
            "has no port 'x'; inputs: u; outputs: y",
        ),
        (
            lambda: python(lambda _: None),
            ParameterError,
            "of Python block 'b' returned as 'y' must be num",
        ),
        (
            lambda: python(lambda _: "a"),
            ParameterError,
            "of Python block 'b' returned as 'y' must be num",
        ),
        (
            lambda: python(lambda u, v: u + v),
            BlockError,
            r"called with the inputs, \(u\): missing .* 'v'",
        ),
        (
            lambda: run(Counted()),
            TracingError,
            r"np\.trunc or np\.floor instead of int\(\)",
        ),
        (
            lambda: run(Derivatives()),
            BlockError,
            r"write derivative\(\) if they are continuous",
        ),
        (
            lambda: function(np.sum, [1.0, 2.0]),
            BlockError,
            r"declared with shape \(2,\), .* or declare outputs=\{'y': Output\(\(\)\)\}",
        ),
        (time_as_input, OpenInputError, "argument 't' is not the time: TimeFunction"),
        (
            lambda: added().add(h=copy.deepcopy(added().g)),
            DiagramError,
            "a copy of a block includes its diagram",
        ),
        (
            lambda: Constant(10**400),
            ParameterError,
            "parameter 'value' of Constant must be numeric",
        ),
        (
            lambda: Constant([[1], [1, 2]]),
            ParameterError,
            r"not \[\[1\], \[1, 2\]\]; give .* equal length",
        ),
        (lambda: run(Gain(1.0), log=[3]), SimulationError, "cannot log 3: give ports"),
        (
            lambda: run(Gain(1.0), log=3),
            SimulationError,
            r"must be a list, .* or a dict, not 3",
        ),
        # What stays Python's, as blocks/README.md says, and NumPy's own.
        (
            lambda: Step(1.0, time=0.5),
            TypeError,
            "a Step: multiple values for argument 'time'",
        ),
        (lambda: added().g.gain.__setitem__(..., 3.0), ValueError, "read-only"),
    ],
)
def test_a_mistake_is_answered(mistake, error, message):
    with pytest.raises(error, match=re.compile(message, re.DOTALL)):
        mistake()


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
