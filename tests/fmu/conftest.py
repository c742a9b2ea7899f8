"""Small systems and exported FMUs that the tests of FMU exchange share, and their instances in FMPy."""

import math
import re
from types import SimpleNamespace

import campaign
import fmpy
import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.fmi2 import (
    FMU2Model,
    FMU2Slave,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)
from fmpy.fmi3 import FMU3Model, FMU3Slave

from trussflow.blocks import (
    Attribute,
    Block,
    Diagram,
    Gain,
    Input,
    Output,
    Parameter,
    State,
    Sum,
    UnitDelay,
    ZeroOrderHold,
)
from trussflow.fmu.exporting.export import export
from trussflow.models import SpaceTruss

ERROR_STATUS = 3  # the status of both versions of FMI


class Oscillator(Block):
    """Masses on springs that harden: q'' = f - k q - c q^3 - d q'."""

    force = Input("masses", unit="N", meaning="force on each mass")
    position = Output("masses", unit="m", frame="wall", meaning="elongation")
    angle = Output(unit="rad/s", meaning="a rate of turn")
    total = Output(unit="J", meaning="energy")
    q = State("masses", unit="m", initial="initial_position")
    v = State("masses", unit="m/s")
    stiffness = Parameter(
        4.0, ("masses",), unit="N/m", above=0.0, meaning="spring rates"
    )
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
        return {
            "q": x.v,
            "v": u.force - p.stiffness * x.q - p.cubic * x.q**3 - p.damping * x.v,
        }


class Rotor(Block):
    """A block with a default input and a matrix as output."""

    torque = Input(unit="N*m", default=2.5)
    axes = Output((2, 2), unit=Attribute("axis_unit"))
    rate = State(unit="rad/s")

    def __init__(self):
        self.axis_unit = ("m", "m", "rad", "rad")
        super().__init__()

    def output(self, t, x, u, p):
        return {
            "axes": np.stack([np.stack([x.rate, u.torque]), np.stack([2 * x.rate, t])])
        }

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
    error, law = diagram.add(error=Sum("+-"), law=Gain(0.8, output_unit="N"))
    delay.y >> error.u2
    error.y >> law.u
    law.y >> plant.force
    diagram.expose(target=error.u1, position=plant.position, held=hold.y, force=law.y)
    return diagram


class Instance:
    """An instance of an FMU in FMPy. Variables go by their names, a whole array by the name without indices.

    Other functions are those of FMPy's object, under the names of FMI 3.
    """

    def __init__(self, path, folder, kind, **settings):
        about = read_model_description(str(path), validate=False)
        self.folder = folder
        self.log = []
        self.scalar = about.fmiVersion == "2.0"
        self.references = {}
        self.sizes = {}
        for variable in about.modelVariables:
            name, reference = variable.name, variable.valueReference
            self.references.setdefault(re.sub(r"\[[\d,]+\]", "", name), []).append(
                reference
            )
            self.references[name] = [reference]
            self.sizes[name] = math.prod(int(d.start) for d in variable.dimensions)
        kinds = {"cs": (FMU2Slave, FMU3Slave), "me": (FMU2Model, FMU3Model)}
        make = kinds[kind][not self.scalar]
        self.fmu = make(
            guid=about.guid,
            unzipDirectory=str(folder),
            modelIdentifier=about.coSimulation.modelIdentifier,
            instanceName="one",
        )
        if not self.scalar:
            self.fmu.instantiate(loggingOn=True, logMessage=self._record, **settings)
            return
        callbacks = fmi2CallbackFunctions()
        callbacks.logger = fmi2CallbackLoggerTYPE(
            lambda _component, *message: self._record(*message)
        )
        callbacks.allocateMemory = fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
        callbacks.freeMemory = fmi2CallbackFreeMemoryTYPE(fmpy.free)
        self.fmu.instantiate(callbacks=callbacks, loggingOn=True)

    def _record(self, _source, status, _category, text):
        self.log.append((status, text.decode()))

    def __getattr__(self, name):
        return getattr(self.fmu, name)

    @property
    def errors(self):
        """Everything logged with status Error."""
        return "\n".join(text for status, text in self.log if status == ERROR_STATUS)

    def start(self, values=None, begin=0.0, stop=None):
        """Initialize, with values of variables."""
        if self.scalar:
            self.setupExperiment(startTime=begin, stopTime=stop)
            self.enterInitializationMode()
        else:
            self.enterInitializationMode(startTime=begin, stopTime=stop)
        self.set(values or {})
        self.exitInitializationMode()
        return self

    def set(self, values):
        """Set variables."""
        write = self.setReal if self.scalar else self.setFloat64
        for name, value in values.items():
            write(self.references[name], np.ravel(value).astype(float).tolist())

    def get(self, *names):
        """Return the elements of variables, of all if none is named."""
        values = []
        for name in names or self.sizes:
            if self.scalar:
                values += self.getReal(self.references[name])
            else:
                values += self.getFloat64(
                    self.references[name], nValues=self.sizes[name]
                )
        return np.array(values)

    def step(self, first, last, length):
        """Take steps; return all variables after each."""
        rows = []
        for k in range(first, last):
            self.doStep(k * length, length)
            rows.append(self.get())
        return np.array(rows)

    def free(self):
        """Free the instance, once."""
        if self.fmu is not None:
            self.fmu.freeInstance()
            self.fmu = None


@pytest.fixture(params=["2.0", "3.0"])
def version(request):
    """Return each version of FMI in turn."""
    return request.param


@pytest.fixture
def instance(tmp_path_factory):
    """Return a function that instantiates an FMU; all instances are freed at the end."""
    alive = []
    folders = {}

    def make(path, kind="cs", **settings):
        if path not in folders:
            folders[path] = extract(str(path), str(tmp_path_factory.mktemp("unpacked")))
        alive.append(Instance(path, folders[path], kind, **settings))
        return alive[-1]

    yield make
    for one in alive:
        one.free()


@pytest.fixture(scope="session")
def systems():
    """Return the small systems."""
    return SimpleNamespace(Oscillator=Oscillator, Rotor=Rotor, hybrid=hybrid)


@pytest.fixture(scope="session")
def plant():
    return SpaceTruss.consistent()


@pytest.fixture(scope="session", params=["2.0", campaign.only("3.0")])
def plant_fmu(request, plant, exported):
    return exported(plant, request.param)


@pytest.fixture(scope="session")
def exported(tmp_path_factory):
    """Return a function that exports a system, once per version and name."""
    folder = tmp_path_factory.mktemp("exported")
    done = {}

    def make(item, version="2.0", name="", **settings):
        key = (name or item.name, version)
        if key not in done:
            path = folder / f"{key[0]}-{version}.fmu"
            done[key] = export(item, path, version=version, **settings)
        return done[key]

    return make
