"""FMUs by generators that are not ours: CasADi, pythonfmu and pythonfmu3, with known solutions."""

import contextlib
import math
import subprocess
import sys
from pathlib import Path

import casadi as ca
import fmpy
import numpy as np
import pytest
from systems import Oscillator, assert_near, series

from trussflow.blocks import Constant, Diagram, Sine, linearize, simulate
from trussflow.fmu import Fmu

ROUND_OFF = 1e-12


@pytest.fixture(scope="module")
def casadi_fmu(tmp_path_factory):
    """Return an FMU (FMI 3, model exchange) by CasADi's own exporter."""
    dae = ca.DaeBuilder("oscillator")
    q, w = (
        dae.add("q", "output", {"start": 0.5, "unit": "m"}),
        dae.add("w", {"start": 0.0}),
    )
    force = dae.add("u", "input")
    damping = dae.add("damping", "parameter", "tunable", {"start": 0.1})
    dae.eq(dae.der(q), w)
    dae.eq(dae.der(w), force - 4.0 * q - damping * w)
    folder = tmp_path_factory.mktemp("casadi")
    with contextlib.chdir(folder):
        headers = str(Path(fmpy.__file__).parent / "c-code")
        files = dae.compile_fmu(dae.export_fmu({}), {"include_dirs": [headers]})
        return folder / dae.pack_fmu(files, {"path": "oscillator.fmu"})


def run(plant, solver, **options):
    diagram = Diagram("driven")
    diagram.add(plant=plant, drive=Sine(amplitude=2.0, frequency=3.0))
    diagram.drive >> diagram.plant.u
    return simulate(diagram, 5.0, step=0.01, solver=solver, log_step=0.1, **options)


@pytest.mark.parametrize("solver", ["rk4", "euler"])
def test_casadi_model_exchange_equals_the_block_in_process(casadi_fmu, solver):
    """Runs are equal to round-off, with parameters and initial states by name."""
    plant = Fmu(casadi_fmu, parameters={"damping": 0.4})
    theirs = run(plant, solver, initial={"plant.q_state": 0.2})
    ours = run(Oscillator(damping=0.4, start=0.2), solver)
    assert_near(theirs["plant.q"], ours["plant.y"][:, 0], ROUND_OFF)
    assert theirs["plant.q"].attrs["units"] == "m"
    model = linearize(plant)
    assert set(model.derivatives.values()) == {"its own"}
    assert_near(model.A, [[0.0, 1.0], [-4.0, -0.4]], ROUND_OFF)


def built(folder, text, name):
    """Return an FMU that pythonfmu3 makes of a script."""
    # a module of its own for each FMU of this process
    script = folder / f"{name.lower()}.py"
    script.write_text(text)
    command = [
        sys.executable,
        "-m",
        "pythonfmu3",
        "build",
        "-f",
        str(script),
        "-d",
        str(folder),
    ]
    subprocess.run(command, check=True, capture_output=True)
    return folder / f"{name}.fmu"


LAG = '''
import numpy as np
from pythonfmu3 import (
    Dimension, Fmi3Causality, Fmi3Slave, Fmi3Status, Fmi3StepResult, Fmi3Variability, Float64
)


class Lag(Fmi3Slave):
    """Three first-order lags, y' = rate (u - y), stepped exactly with the input held."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time = 0.0
        self.rate = 2.0
        self.u = np.zeros(3)
        self.y = np.array([0.0, 1.0, 2.0])
        three = [Dimension(start="3")]
        cause, kind, add = Fmi3Causality, Fmi3Variability, self.register_variable
        add(Float64("time", causality=cause.independent, variability=kind.continuous))
        add(Float64("rate", causality=cause.parameter, variability=kind.fixed, start=2.0))
        add(
            Float64("u", causality=cause.input, variability=kind.continuous, dimensions=three,
                    setter=lambda v: self.u.__setitem__(slice(None), v), start=[0.0, 0.0, 0.0])
        )
        add(
            Float64("y", causality=cause.output, variability=kind.continuous, dimensions=three)
        )

    def do_step(self, time, step):
        decay = np.exp(-self.rate * step)
        self.y = self.u + (self.y - self.u) * decay
        return Fmi3StepResult(status=Fmi3Status.ok, earlyReturn=False)
'''


def test_arrays_by_pythonfmu3(tmp_path):
    """Arrays of FMI 3, in and out, and a parameter, against exponentials."""
    block = Fmu(
        built(tmp_path, LAG, "Lag"), step=0.01, parameters={"rate": 3.0}, delayed=True
    )
    assert block.u.shape == block.y.shape == (3,)
    diagram = Diagram("lag")
    diagram.add(lag=block, goal=Constant([1.0, -1.0, 4.0]))
    diagram.goal >> diagram.lag.u
    result = simulate(diagram, 1.0, step=0.01)
    goal, begin = np.array([1.0, -1.0, 4.0]), np.array([0.0, 1.0, 2.0])
    expected = goal + (begin - goal) * math.exp(-3.0)
    assert_near(result["lag.y"][-1].values, expected, 1e-12)


DECAY = """
from pythonfmu3 import (
    Fmi3Causality, Fmi3Initial, Fmi3SlaveBase, Fmi3Variability, Float64, ModelExchange
)


class Decay(Fmi3SlaveBase, ModelExchange):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time, self.k, self.x, self.derx = 0.0, 1.0, 1.0, 0.0
        cause, kind, add = Fmi3Causality, Fmi3Variability, self.register_variable
        add(Float64("time", causality=cause.independent, variability=kind.continuous))
        add(
            Float64("x", causality=cause.output, start=1, variability=kind.continuous,
                    initial=Fmi3Initial.exact)
        )
        add(
            Float64("derx", causality=cause.local, variability=kind.continuous, derivative=1)
        )
        add(Float64("k", causality=cause.parameter, variability=kind.fixed, start=1.0))

    def get_continuous_state_derivatives(self):
        self.derx = -self.k * self.x
        return [self.derx]
"""


def test_model_exchange_by_pythonfmu3(tmp_path):
    diagram = series(
        "decay", decay=Fmu(built(tmp_path, DECAY, "Decay"), parameters={"k": 2.0})
    )
    result = simulate(
        diagram, 1.0, solver="DOP853", rtol=1e-10, atol=1e-12, log_step=0.5
    )
    assert result["decay.x"][-1].item() == pytest.approx(math.exp(-2.0), abs=1e-9)
