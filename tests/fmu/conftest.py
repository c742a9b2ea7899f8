"""What the tests of FMU exchange share: small systems, and the plant exported once."""

from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Model, FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import FMU3Model, FMU3Slave

from trussflow.blocks import (
    Attribute,
    Block,
    Diagram,
    Input,
    Output,
    Parameter,
    State,
    UnitDelay,
    ZeroOrderHold,
)
from trussflow.fmu.exporting.export import export
from trussflow.models import SpaceTruss


class Oscillator(Block):
    """Masses on springs that harden: q'' = f - k q - c q^3 - d q'."""

    force = Input("masses", unit="N", meaning="force on each mass")
    position = Output("masses", unit="m", frame="wall", meaning="elongation")
    angle = Output(unit="rad/s", meaning="a rate of turn")
    total = Output(unit="J", meaning="energy")
    q = State("masses", unit="m", initial="initial_position")
    v = State("masses", unit="m/s")
    stiffness = Parameter(4.0, ("masses",), unit="N/m", above=0.0, meaning="spring rates")
    cubic = Parameter(0.5, meaning="hardening")
    damping = Parameter(0.1, unit="N*s/m", minimum=0.0)
    initial_position = Parameter(1.0, ("masses",), unit="m")

    def __init__(self, masses=2, **parameters):
        self.masses = masses
        super().__init__(**parameters)

    def output(self, t, x, u, p):
        return {
            "position": x.q,
            "angle": x.v[0] + np.sin(t),
            "total": (x.v @ x.v + x.q @ (p.stiffness * x.q)) / 2,
        }

    def derivative(self, t, x, u, p):
        return {"q": x.v, "v": u.force - p.stiffness * x.q - p.cubic * x.q**3 - p.damping * x.v}


class Rotor(Block):
    """What has an input with a default, and an output that is a matrix."""

    torque = Input(unit="N*m", default=2.5)
    axes = Output((2, 2), unit=Attribute("axis_unit"))
    rate = State(unit="rad/s")

    def __init__(self):
        self.axis_unit = ("m", "m", "rad", "rad")
        super().__init__()

    def output(self, t, x, u, p):
        return {"axes": np.stack([np.stack([x.rate, u.torque]), np.stack([2 * x.rate, t])])}

    def derivative(self, t, x, u, p):
        return {"rate": u.torque}


def hybrid():
    """Return a plant under sampled control with two sample times, and an input from outside."""
    diagram = Diagram("hybrid")
    plant, hold, delay = diagram.add(
        plant=Oscillator(1, damping=0.3),
        hold=ZeroOrderHold(0.02),
        delay=UnitDelay(0.05, initial_value=0.25).sampled(every=0.05, offset=0.01),
    )
    plant.position[0:1] >> hold.u
    hold.y >> delay.u
    goal = diagram.add(goal=Difference())
    delay.y >> goal.feedback
    goal.force >> plant.force
    diagram.expose(target=goal.target, position=plant.position, held=hold.y, force=goal.force)
    return diagram


class Difference(Block):
    """A proportional law."""

    target = Input(1, unit="m")
    feedback = Input(1, unit="m")
    force = Output(1, unit="N")
    gain = Parameter(0.8, unit="N/m")

    def output(self, t, x, u, p):
        return {"force": p.gain * (u.target - u.feedback)}


class Wide(Block):
    """A thousand sines, whose derivatives need much work space."""

    u = Input()
    y = Output(1000)

    def output(self, t, x, u, p):
        return {"y": np.stack([np.sin(k * u.u) for k in range(1000)])}


@contextmanager
def opened(path, kind, tmp, log=None):
    """Yield an instance of an FMU, not yet initialized; `log` collects its messages."""
    description = read_model_description(str(path))
    folder = extract(str(path), str(tmp / f"unzipped{len(list(tmp.glob('unzipped*')))}"))
    makers: dict[tuple[str, str], Any] = {
        ("2.0", "cs"): FMU2Slave,
        ("2.0", "me"): FMU2Model,
        ("3.0", "cs"): FMU3Slave,
        ("3.0", "me"): FMU3Model,
    }
    fmu = makers[description.fmiVersion, kind](
        guid=description.guid,
        unzipDirectory=folder,
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="one",
    )
    keep = _instantiate(fmu, description.fmiVersion, log if log is not None else [])
    try:
        yield fmu
    finally:
        fmu.terminated = True
        fmu.freeInstance()
        del keep


def _instantiate(fmu, version, log):
    """Instantiate with a logger that writes to a list; return what must be kept alive."""
    if version == "3.0":

        def message(_environment, _status, _category, text):
            log.append(text.decode())

        fmu.instantiate(loggingOn=True, logMessage=message)
        return message

    def logger(_c, _name, _status, _category, text):
        log.append(text.decode())

    callbacks = fmi2CallbackFunctions()
    callbacks.logger = fmi2CallbackLoggerTYPE(logger)
    fmu.instantiate(callbacks=callbacks, loggingOn=True)
    return callbacks


def started(fmu, values=None, stop=None, begin=0.0):
    """Initialize an instance, with values by value reference set before."""
    if hasattr(fmu, "setupExperiment"):
        fmu.setupExperiment(startTime=begin, stopTime=stop)
        fmu.enterInitializationMode()
    else:
        fmu.enterInitializationMode(startTime=begin, stopTime=stop)
    for reference, value in (values or {}).items():
        write(fmu, reference, value)
    fmu.exitInitializationMode()


def write(fmu, reference, value):
    """Set an array."""
    flat = np.ravel(value).astype(float).tolist()
    if hasattr(fmu, "setReal"):
        fmu.setReal(range(reference, reference + len(flat)), flat)
    else:
        fmu.setFloat64([reference], flat)


def read(fmu, reference, size):
    """Get an array."""
    if hasattr(fmu, "getReal"):
        return np.array(fmu.getReal(range(reference, reference + size)))
    return np.array(fmu.getFloat64([reference], nValues=size))


@pytest.fixture(scope="session")
def fmi():
    """Return the functions that open, start, set and get."""
    return SimpleNamespace(opened=opened, started=started, write=write, read=read)


@pytest.fixture(scope="session")
def systems():
    """Return the small systems."""
    return SimpleNamespace(
        Oscillator=Oscillator, Rotor=Rotor, Difference=Difference, Wide=Wide, hybrid=hybrid
    )


@pytest.fixture(scope="session")
def plant():
    return SpaceTruss.consistent()


@pytest.fixture(scope="session", params=["2.0", "3.0"])
def plant_fmu(request, plant, exported):
    return Path(exported(plant, request.param))


@pytest.fixture(scope="session")
def exported(tmp_path_factory):
    """Return a function that exports a system, once per version and name."""
    folder = tmp_path_factory.mktemp("exported")
    done: dict[tuple[str, str], Path] = {}

    def make(item, version="2.0", name="", **settings):
        key = (name or item.name, version)
        if key not in done:
            path = folder / f"{key[0]}-{version}.fmu"
            done[key] = export(item, path, version=version, **settings)
        return done[key]

    return make
