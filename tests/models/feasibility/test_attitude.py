"""The attitude in which every single failure is survived: no other is better, and a truss starts in it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from refused import check_refused, over_calls
from scipy.spatial.transform import Rotation
from systems import assert_near

from trussflow import models
from trussflow.blocks import Quintic, simulate
from trussflow.models import Hardware, SpaceTruss
from trussflow.models.feasibility import (
    ActuatorFailure,
    attitude_along,
    best_attitude,
    single_failures,
    survey,
)
from trussflow.models.geometry.rotation import euler_rotation
from trussflow.models.transport import Mission, mean_axes_transport, path_of

TRUSS = SpaceTruss.consistent(modes=0)
DYNAMICS = TRUSS.dynamics
LIMITS = Hardware.flight(control="torque").limits(TRUSS)
ALONG_Z = path_of(Mission.of_case(1), TRUSS)
BASES = single_failures(DYNAMICS)[:5]
EXACT = 1e-6  # of a linear programme, relative


def worst(direction, limits=LIMITS, failures=BASES):
    """Return the least duration of 6 m along a direction of the truss after each failure [s]."""
    way = np.concatenate([6.0 * direction / np.linalg.norm(direction), np.zeros(31)])
    path = Quintic(way, 60.0, start=DYNAMICS.rest)
    return max(
        each.least_duration
        for each in survey(DYNAMICS, path, limits, failures, instants=2)
    )


@pytest.mark.parametrize("normal", [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
def test_no_direction_is_better(normal, rng):
    """The duration said is that of the path, failure by failure; in 30 other directions it is more."""
    best = best_attitude(DYNAMICS, ALONG_Z, LIMITS, BASES, normal=normal)
    assert abs(best.direction @ normal) < EXACT
    assert worst(best.direction) == pytest.approx(best.least_duration, rel=EXACT)
    climbed = best_attitude(
        DYNAMICS, ALONG_Z, LIMITS, BASES, normal=normal, directions=1
    )
    assert climbed.least_duration == pytest.approx(best.least_duration, rel=EXACT)
    for size in (0.01, 0.1, 10.0):
        for _ in range(10):
            other = best.direction + size * rng.standard_normal(3)
            assert worst(
                other - (other @ normal) * np.array(normal)
            ) > best.least_duration * (1.0 - EXACT)


def test_every_single_failure_is_survived():
    best = best_attitude(DYNAMICS, ALONG_Z, LIMITS, normal=[1.0, 0.0, 0.0])
    assert best.least_duration == pytest.approx(58.3, abs=0.05)
    assert_near(np.degrees(best.attitude), [-68.0, 0.0, 0.0], 0.05)
    turned = TRUSS.turned(best.attitude)
    found = survey(DYNAMICS, path_of(Mission.of_case(1), turned), LIMITS)
    assert all(each.feasible for each in found)
    assert max(each.least_duration for each in found) == pytest.approx(
        best.least_duration, rel=EXACT
    )


def test_attitude_along_a_direction(rng):
    for _ in range(20):
        own, way, spin = (
            rng.standard_normal(3),
            rng.standard_normal(3),
            rng.uniform(-3.0, 3.0),
        )
        turned, spun = (
            euler_rotation(attitude_along(own, way, spin=each)) for each in (0.0, spin)
        )
        for rotation in (turned, spun):
            along = rotation @ own / np.linalg.norm(own)
            assert_near(along, way / np.linalg.norm(way), 1e-12)
        cosine = own @ way / np.linalg.norm(own) / np.linalg.norm(way)
        # the smallest turn
        assert_near(np.trace(turned), 1.0 + 2.0 * cosine, 1e-12)
        about = Rotation.from_rotvec(spin * way / np.linalg.norm(way)).as_matrix()
        assert_near(spun, about @ turned, 1e-12)


ALONE = [ActuatorFailure(name="alone", health=np.eye(DYNAMICS.actuators)[0])]


@over_calls(__file__)
def test_bad_input(call, error, message):
    check_refused(call, error, message, vars(models) | globals())


def test_everything_starts_where_the_truss_does():
    """Path, sensors (late ones too, but for noise of 1e-4) and estimator; and there it stays."""
    attitude = attitude_along([0.0, -0.927, 0.375], [0.0, 0.0, 6.0])
    truss = SpaceTruss.consistent().turned(attitude)
    flight = Hardware.flight(control="torque")
    flight = replace(flight, star_tracker=replace(flight.star_tracker, delay=0.02))
    diagram = mean_axes_transport(Mission.of_case(1), truss, hardware=flight, seed=1)
    blocks = [diagram.blocks[name] for name in ("trajectory", "controller", "sensors")]
    ports = [
        b.port(n)
        for b, n in zip(
            blocks, ("position", "mean_position", "task_position"), strict=True
        )
    ]
    log = [truss.task_position, *ports]
    result = simulate(diagram, 0.1, step=5e-3, log=log, backend="interpreted")
    start = truss.parameters["initial_coordinates"][: truss.rigid]
    assert_array_equal(start[3:6], attitude)
    for variable in result.data_vars.values():
        assert_near(variable.values, [start] * len(variable), 1e-3)
