"""Margins of the flown loop: the linear map is the derivative of the flight, with the thrust on."""

from dataclasses import replace

import numpy as np
import pytest
from flight.loops import flight_simulator, with_arms
from flight.margins import VARIATIONS, loop_session, loops_along, margins_of
from flight.sampled_loop import spectral_radius
from numpy.testing import assert_array_equal
from systems import assert_near

from trussflow.blocks import Session
from trussflow.models import SpaceTruss
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.transport import Mission, mean_axes_transport

# The paper's path of 60 s, scaled down in time and, with the same accelerations, in displacement.
DURATION = 6.0  # s
MISSION = replace(
    Mission.of_case(1), position=np.array([0.0, 0.0, 0.06]), duration=DURATION
)


INSTANTS = {"at rest": 0.0, "peak acceleration": 0.2113}


@pytest.fixture(scope="module")
def session():
    return loop_session(MISSION, TunableTruss.consistent())


@pytest.fixture(scope="module")
def loops(session):
    """Return the loop at two instants, and the state of the run there."""
    along = loops_along(session, DURATION, {}, INSTANTS)
    return {name: (loop, session.save()) for name, loop in along}


def test_the_controller_is_that_of_the_runs(session):
    flown = flight_simulator(backend="numpy").prepared.plan
    own = session.prepared.plan
    values = flown.p.named(flown.parameters(None))
    assert values["controller.monitor.dispensable"].tolist() == [1.0, 1.0, 1.0, 0.0]
    for name in ("allocation.limits", "economy.limits", "law.bandwidth"):
        values = [
            plan.p.named(plan.parameters(None))[f"controller.{name}"]
            for plan in (own, flown)
        ]
        assert_array_equal(*values)


def test_a_servo_prevents_the_buckling_under_thrust(loops):
    """At 3.4 N gearless arms buckle at 21 1/s, and the loop holds them; with drives and servo none does."""

    def fastest(found):
        return [np.linalg.eigvals(loop.plant.A).real.max() for loop in found]

    diagram = mean_axes_transport(MISSION, SpaceTruss.consistent())
    with Session(diagram, outputs=[], step=2e-3) as free:
        gearless = [loop for _, loop in loops_along(free, DURATION, {}, INSTANTS)]
    assert fastest(gearless) == pytest.approx([0.0, 21.2], rel=0.02, abs=0.01)
    driven = [loop for loop, _ in loops.values()]
    assert fastest(driven) == pytest.approx([0.0, 0.0], abs=1e-4)
    assert all(spectral_radius(loop.closed()) < 1.0 for loop in gearless + driven)


@pytest.mark.parametrize("instant", ["at rest", "peak acceleration"])
def test_the_map_predicts_the_flight(session, loops, instant, rng):
    """A pushed flight leaves the other as the map says: the error falls with the square of the push."""
    loop, start = loops[instant]
    plan = session.prepared.plan
    states = ("y", "nu", "eta", "eta_rate", "w", "posture")
    own = np.r_[
        : start.x.size, *(plan.place("controller.estimator", name) for name in states)
    ]
    pushed = rng.standard_normal(own.size)

    def flown(size):
        z = np.concatenate([start.x, start.d])
        z[own] += size * pushed
        session.restore(replace(start, x=z[: start.x.size], d=z[start.x.size :]))
        session.advance(float(start.now) + 0.02)
        now = session.save()
        return np.concatenate([now.x, now.d])[own]

    errors = []
    for size in 4e-5 * 0.5 ** np.arange(3):
        # at rest the feedback may not ask for much thrust
        found = (flown(size) - flown(0.0)) / size
        errors.append(np.abs(found - loop.closed() @ pushed).max())
    slopes = np.diff(np.log2(errors))
    assert_near(slopes, -1.0, 0.1)


def test_margins_of_one_loop(loops):
    """The loop is stable up to the delay, and not beyond; an unstable one has no margins."""
    loop = loops["peak acceleration"][0]
    found = margins_of(loop, 24)
    growth = dict(zip(VARIATIONS, found["growth"], strict=True))
    assert growth["nominal"] == np.log(spectral_radius(loop.closed())) / 0.02 < 0.0
    halved = loop.closed(actuators=np.repeat([0.5, 1.0], [24, 28]))
    assert growth["base gain 0.5"] == np.log(spectral_radius(halved)) / 0.02
    late = round(found["delay"] / 0.02)
    for count, stable in ((late, True), (late + 1, False)):
        assert (spectral_radius(loop.closed(late=count)) < 1.0) == stable
    unstable = margins_of(replace(loop, controller=-loop.controller), 24)
    assert unstable["disk"] == 0.0
    assert np.isnan(unstable["delay"])


def test_arms_of_other_mass_and_length():
    """Masses scale together; an arm of another length reaches as far as it is long."""
    dynamics = SpaceTruss.consistent().dynamics
    for before, after in zip(
        dynamics.arms, with_arms(dynamics, 1.05).arms, strict=True
    ):
        assert after.masses == pytest.approx(1.05 * before.masses, rel=1e-12)
        assert after.joint_origins == pytest.approx(
            1.05 * before.joint_origins, rel=1e-12
        )
        assert after.base_mass == before.base_mass
