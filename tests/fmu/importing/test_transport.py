"""Case 1 of the paper, shortened, with the plant as an FMU, and the controller as one."""

from dataclasses import replace

import numpy as np
import pytest

from trussflow.blocks import CoSimulator, Diagram, simulate
from trussflow.fmu import Fmu, export
from trussflow.models import SpaceTruss
from trussflow.models.transport.mission import Mission
from trussflow.models.transport.wiring import transport_diagram

pytestmark = pytest.mark.campaign

RUN_DURATION = 1.0  # s
INNER_STEP = 2.5e-4  # s; inside the FMUs
LOG_STEP = 4e-3  # s

# As steep as in Case 1: 6 m in 60 s.
CASE = Mission.of_case(1)
MISSION = replace(
    CASE, duration=2.0, position=CASE.position * (2.0 / CASE.duration) ** 2
)
SIGNALS = ("task_position", "task_velocity", "coordinates", "speeds", "rigid_speeds")


def controller():
    """Return all but the plant, with ports for the signals between the two."""
    diagram = transport_diagram(MISSION, SpaceTruss.published())
    diagram.remove("truss")
    errors, model = diagram.errors, diagram.model
    inputs = (
        errors.position,
        errors.velocity,
        model.coordinates,
        model.speeds,
        diagram.blocks["observer"].velocity,
    )
    command = diagram.blocks["allocation"].command
    diagram.expose(
        **dict(zip(SIGNALS, inputs, strict=True)), command=command, error=errors.error
    )
    return diagram


def loop(truss, command):
    diagram = Diagram("transport")
    diagram.add(truss=truss, controller=command)
    for name in SIGNALS:
        truss.port(name) >> command.port(name)
    command.port("command") >> truss.port("actuation")
    return diagram


LOG = {"coordinates": "truss.coordinates", "error": "controller.error"}


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    return export(
        SpaceTruss.published(),
        tmp_path_factory.mktemp("plant") / "p.fmu",
        step=INNER_STEP,
    )


@pytest.fixture(scope="module")
def command(tmp_path_factory):
    file = tmp_path_factory.mktemp("controller") / "c.fmu"
    return export(controller(), file, kind="python", step=INNER_STEP)


@pytest.fixture(scope="module")
def whole():
    return simulate(
        loop(SpaceTruss.published(), controller()),
        RUN_DURATION,
        step=INNER_STEP,
        log_step=LOG_STEP,
        log=LOG,
    )


def error(result, whole):
    whole = whole.sel(time=result["time"])
    return np.abs(result["coordinates"].values - whole["coordinates"].values).max()


def check(diagram, steps, whole, duration=RUN_DURATION, **settings):
    """Halve the step: the error falls by half in the end; the tracking error hardly changes."""
    errors = []
    for h in steps:
        master = CoSimulator(diagram, step=h, log=LOG, log_step=LOG_STEP, **settings)
        result = master.run(duration)
        errors.append(error(result, whole))
        tracking, best = (
            float(abs(r["error"]).max())
            for r in (result, whole.sel(time=result["time"]))
        )
        assert tracking < 1.02 * best
    assert np.log2(errors[-2] / errors[-1]) == pytest.approx(1, abs=0.1), errors


# The loop through plant and controller is as fast as 1300 1/s: held inputs are stable for steps
# below 1.5 ms; iteration has no such limit.
@pytest.mark.parametrize(
    "coupling, steps, duration",
    [
        ("jacobi", (1e-3, 5e-4), RUN_DURATION),
        ("gauss-seidel", (1e-3, 5e-4), RUN_DURATION),
        ("iterate", (2e-3, 1e-3, 5e-4), 0.2),
    ],
)
def test_the_plant_as_a_native_fmu(coupling, steps, duration, plant, whole):
    diagram = loop(Fmu(plant, declared_starts=True), controller())
    check(diagram, steps, whole, duration, coupling=coupling, solver_step=INNER_STEP)


@pytest.mark.parametrize(
    "coupling, steps", [("jacobi", (1e-3, 5e-4)), ("gauss-seidel", (5e-4, 2.5e-4))]
)
def test_the_controller_as_a_pythonfmu_fmu(coupling, steps, plant, command, whole):
    diagram = loop(Fmu(plant, declared_starts=True), Fmu(command))
    check(diagram, steps, whole, coupling=coupling)
