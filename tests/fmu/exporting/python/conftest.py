"""What the tests of the pythonfmu export share: exporting, and instances that keep their log."""

from itertools import count
from pathlib import Path
from typing import Any

import fmpy
import fmpy.fmi2
import numpy as np
import pytest

from trussflow.blocks import INFERRED, Block, Diagram, Input, Output, Parameter, PythonFunction, State
from trussflow.blocks.framework.running import Running
from trussflow.fmu.exporting.export import export as fmu_export

STEP = 1e-3


class Pendulum(Block):
    """Two pendulums, stiff as the user likes."""

    torque = Input((2,), unit="N*m")
    angle = Output((2,), unit="rad", meaning="from the vertical")
    load = Output((2,), unit="N*m")
    q = State((2,), initial="release", unit="rad")
    v = State((2,), unit="rad/s")
    release = Parameter((0.3, -0.2), (2,), unit="rad", meaning="angle at the start")
    stiffness = Parameter(9.0, above=0.0, unit="N*m")

    def output(self, t, x, u, p):
        return {"angle": x.q, "load": u.torque - p.stiffness * np.sin(x.q)}

    def derivative(self, t, x, u, p):
        return {"q": x.v, "v": u.torque - p.stiffness * np.sin(x.q) + 0.1 * np.cos(3 * t)}


class Controller(Block):
    """A sampled law with memory, and ports that take the unit of what they are wired to."""

    goal = Input((2,), unit="rad")
    angle = Input((2,), unit=INFERRED)
    torque = Output((2,), unit="N*m")
    total = State((2,))
    gain = Parameter(2.0)

    def output(self, t, x, u, p):
        return {"torque": p.gain * (u.goal - u.angle) + x.total}

    def update(self, t, x, u, p):
        return {"total": x.total + 0.1 * (u.goal - u.angle)}


class AverageRun(Running):
    def __init__(self):
        self.hidden: dict[str, Any] = {"sum": np.zeros(2), "count": 0}

    def save(self):
        return dict(self.hidden)

    def restore(self, saved):
        self.hidden.update(saved)

    def output(self, t, x, u, p):
        return {"y": self.hidden["sum"] / max(1, self.hidden["count"])}

    def update(self, t, x, u, p):
        self.hidden.update(sum=self.hidden["sum"] + u.u, count=self.hidden["count"] + 1)
        return {}


class Average(Block):
    """A Python block that hides the mean of what it read."""

    traced = False
    u = Input((2,))
    y = Output((2,))

    def open(self, p):
        return AverageRun()

    def feedthrough(self):
        return {"y": ()}


LIMIT = 0.4


def limited(torque):
    """Cut off what is beyond a global of the user's file, as no tracer can follow."""
    for i in range(2):
        if abs(torque[i]) > LIMIT:
            torque = torque.copy()
            torque[i] = np.sign(torque[i]) * LIMIT
    return torque


def loop(*, python):
    """Return a controlled pendulum, with Python blocks in the loop or without."""
    diagram = Diagram("loop")
    law, plant = diagram.add(law=Controller().sampled(0.02), plant=Pendulum())
    plant.angle >> law.angle
    diagram.expose(goal=law.goal, angle=plant.angle, load=plant.load, torque=law.torque)
    if not python:
        law.torque >> plant.torque
        return diagram
    limit, average = diagram.add(
        limit=PythonFunction(
            limited, 0.02, inputs={"torque": Input((2,), unit="N*m")}, outputs={"y": Output((2,), unit="N*m")}
        ),
        average=Average().sampled(0.05),
    )
    law.torque >> limit.torque
    limit.y >> plant.torque
    plant.angle >> average.u
    diagram.expose(mean=average.y)
    return diagram


class Slave:
    """An instance of an FMU, by variable names, with everything that it logged.

    Parameters
    ----------
    fmu : Path
        The file.
    folder : Path
        Where to unpack it.
    """

    def __init__(self, fmu, folder):
        self.log: list[tuple[int, str]] = []
        self.folder = folder
        if not folder.exists():
            fmpy.extract(str(fmu), str(folder))
        about = fmpy.read_model_description(str(folder), validate=False)
        self.references = {v.name: v.valueReference for v in about.modelVariables}
        callbacks = fmpy.fmi2.fmi2CallbackFunctions()
        callbacks.logger = fmpy.fmi2.fmi2CallbackLoggerTYPE(self._take)
        callbacks.allocateMemory = fmpy.fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
        callbacks.freeMemory = fmpy.fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
        self.fmu: Any = fmpy.fmi2.FMU2Slave(
            guid=about.guid,
            unzipDirectory=str(folder),
            instanceName="it",
            modelIdentifier=about.coSimulation.modelIdentifier,
        )
        self.fmu.instantiate(callbacks=callbacks, loggingOn=True)

    def _take(self, _component, _name, status, _kind, text):
        self.log.append((status, text.decode()))

    @property
    def errors(self):
        """Everything logged with status fmi2Error."""
        return "\n".join(text for status, text in self.log if status == 3)

    def start(self, values=None, time=0.0):
        """Initialize."""
        self.fmu.setupExperiment(startTime=time)
        self.set(values or {})
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        return self

    def set(self, values):
        """Set variables by name."""
        if values:
            self.fmu.setReal([self.references[name] for name in values], list(values.values()))

    def get(self, *names):
        """Return variables by name; all of them if none is named."""
        wanted = names or tuple(self.references)
        return np.array(self.fmu.getReal([self.references[name] for name in wanted]))

    def step(self, first, last, length):
        """Take steps; return all variables after each."""
        rows = []
        for k in range(first, last):
            self.fmu.doStep(k * length, length)
            rows.append(self.get())
        return np.array(rows)

    def free(self):
        """End, once."""
        if self.fmu is not None:
            self.fmu.freeInstance()
            self.fmu = None


@pytest.fixture(scope="session")
def export(tmp_path_factory):
    """Return what exports a block to a file of its own."""
    numbers = count()

    def exported(item, **settings):
        path = tmp_path_factory.mktemp("fmu") / f"it_{next(numbers)}.fmu"
        return fmu_export(item, path, kind="python", **({"step": STEP} | settings))

    return exported


@pytest.fixture
def slave(tmp_path_factory):
    """Return what instantiates an FMU; what is left over is freed."""
    alive: list[Slave] = []
    folders: dict[Path, Path] = {}

    def instance(fmu, *, folder=None):
        if folder is None and fmu not in folders:
            folders[fmu] = tmp_path_factory.mktemp("unpacked") / "fmu"
        alive.append(Slave(fmu, folder or folders[fmu]))
        return alive[-1]

    yield instance
    for one in alive:
        one.free()


@pytest.fixture(scope="session")
def make_loop():
    """Return what builds the controlled pendulum."""
    return loop


@pytest.fixture(scope="session", params=["traced", "python"])
def loop_fmu(request, export):
    """Return the FMU of the controlled pendulum, with Python blocks and without."""
    return export(loop(python=request.param == "python"), parameters={"plant.stiffness": 7.0})
