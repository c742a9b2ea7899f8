"""Case 1 of the paper, shortened, with the plant as an FMU, and the controller as one."""

from dataclasses import replace

import numpy as np
import pytest

from trussflow.blocks import (
    CoSimulator,
    Diagram,
    DisturbanceObserver,
    IntegralSlidingMode,
    Quintic,
    WeightedAllocation,
    simulate,
)
from trussflow.fmu import Fmu, export
from trussflow.models import NominalModel, SpaceTruss
from trussflow.models.transport.mission import Mission

pytestmark = pytest.mark.slow

DURATION = 1.0  # s
INNER = 2.5e-4  # s; inside the FMUs
LOGGED = 4e-3  # s

# As steep as in Case 1: 6 m in 60 s.
CASE = Mission.of_case(1)
MISSION = replace(CASE, duration=2.0, position=CASE.position * (2.0 / CASE.duration) ** 2)


def controller(truss):
    """Return all but the plant, with ports for what passes between the two."""
    diagram = Diagram("controller")
    trajectory, law, observer, model, allocation = diagram.add(
        trajectory=Quintic(MISSION.displacement(truss.rigid), MISSION.duration, unit=truss.task_units),
        law=IntegralSlidingMode(
            gamma=MISSION.rate_gain,
            mu=MISSION.error_gain,
            beta=MISSION.exponent,
            eta=MISSION.switching_gain,
            sigma=MISSION.reaching_gain,
            boundary_layer=MISSION.boundary_layer,
            unit=truss.task_units,
        ),
        observer=DisturbanceObserver(MISSION.observer_bandwidth, unit=truss.task_units),
        model=NominalModel(truss.dynamics),
        allocation=WeightedAllocation(truss.rigid, MISSION.actuator_weights(truss.robots, truss.joints)),
    )
    trajectory.position >> law.reference_position
    trajectory.velocity >> law.reference_velocity
    trajectory.acceleration >> law.reference_acceleration
    law.feedforward >> model.feedforward
    law.feedback >> model.feedback
    model.nominal_acceleration >> observer.nominal_acceleration
    observer.disturbance_estimate >> model.disturbance_estimate
    model.generalized_force >> allocation.demand
    model.actuation_matrix >> allocation.effectiveness
    diagram.expose(
        position=law.position,
        velocity=law.velocity,
        coordinates=model.coordinates,
        speeds=model.speeds,
        rigid_speeds=observer.velocity,
        command=allocation.command,
        error=law.error,
    )
    return diagram


def loop(truss, command):
    diagram = Diagram("transport")
    diagram.add(truss=truss, controller=command)
    for source, target in (
        ("task_position", "position"),
        ("task_velocity", "velocity"),
        ("coordinates", "coordinates"),
        ("speeds", "speeds"),
        ("rigid_speeds", "rigid_speeds"),
    ):
        diagram.connect(truss.port(source), command.port(target))
    diagram.connect(command.port("command"), truss.port("actuation"))
    return diagram


LOG = {"coordinates": "truss.coordinates", "error": "controller.error"}


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    return export(SpaceTruss.published(), tmp_path_factory.mktemp("plant") / "p.fmu", step=INNER)


@pytest.fixture(scope="module")
def command(tmp_path_factory):
    file = tmp_path_factory.mktemp("controller") / "c.fmu"
    return export(controller(SpaceTruss.published()), file, kind="python", step=INNER)


@pytest.fixture(scope="module")
def whole():
    truss = SpaceTruss.published()
    return simulate(loop(truss, controller(truss)), DURATION, step=INNER, log_step=LOGGED, log=LOG)


def error(result, whole):
    whole = whole.sel(time=result["time"])
    return float(abs(result["coordinates"] - whole["coordinates"]).max())


def check(diagram, step, whole, order, duration=DURATION, **settings):
    """Halve the step: the error falls with the order; the tracking error hardly changes."""
    errors = []
    for h in (step, step / 2):
        master = CoSimulator(diagram, step=h, log=LOG, log_step=LOGGED, **settings)
        result = master.run(duration)
        errors.append(error(result, whole))
        tracking, best = (float(abs(r["error"]).max()) for r in (result, whole.sel(time=result["time"])))
        assert tracking < 1.02 * best
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.1), errors


# The loop through plant and controller is as fast as 1300 1/s: held inputs are stable for steps
# below 1.5 ms, extrapolated ones below 0.75 ms; iteration has no such limit.
SCHEMES = [
    ({"coupling": "jacobi"}, 1e-3, 1),
    ({"coupling": "gauss-seidel"}, 1e-3, 1),
    ({"coupling": "jacobi", "extrapolation": 1}, 5e-4, 2),
]


@pytest.mark.parametrize(("settings", "step", "order"), SCHEMES)
def test_the_plant_as_a_native_fmu(settings, step, order, plant, whole):
    diagram = loop(Fmu(plant), controller(SpaceTruss.published()))
    check(diagram, step, whole, order, solver_step=INNER, **settings)


def test_iteration_is_second_order_at_steps_that_extrapolation_cannot_take(plant, whole):
    diagram = loop(Fmu(plant), controller(SpaceTruss.published()))
    check(diagram, 2e-3, whole, 2, duration=0.2, solver_step=INNER, coupling="iterate", extrapolation=1)


@pytest.mark.parametrize(
    ("settings", "step", "order"),
    [({"coupling": "jacobi"}, 1e-3, 1), ({"coupling": "gauss-seidel", "extrapolation": 1}, 5e-4, 2)],
)
def test_the_controller_as_a_pythonfmu_fmu(settings, step, order, plant, command, whole):
    diagram = loop(Fmu(plant), Fmu(command))
    check(diagram, step, whole, order, **settings)
