"""Margins of the flown loop: the linear map is the derivative of the flight, with the thrust on."""

from typing import Any

import numpy as np
import pytest
import scipy

from trussflow.blocks import Session
from trussflow.blocks.linear_analysis.sampled_loop import SampledLoop, spectral_radius
from trussflow.blocks.simulation.snapshot import Snapshot
from trussflow.models import SpaceTruss
from trussflow.models.flight.margins import (
    BUCKLING,
    LoopMargins,
    disks,
    first_limit,
    greatest_gain_ratio,
    loops_along,
    with_arms,
    worst,
)
from trussflow.models.transport import Mission, mean_axes_transport

pytestmark = pytest.mark.slow
Loops = dict[str, tuple[SampledLoop, Snapshot]]


@pytest.fixture(scope="module")
def session():
    return Session(mean_axes_transport(Mission.of_case(1), SpaceTruss.consistent()), outputs=[], step=2e-3)


@pytest.fixture(scope="module")
def loops(session):
    """Return the loop at two instants, and what the flight was there."""
    instants = {"at rest": 0.0, "peak acceleration": 0.2113}
    along = loops_along(session, 60.0, {"controller.probe.strength": 1.0}, instants)  # of no account
    return {name: (loop, session.save()) for name, loop in along}


def test_arms_buckle_under_thrust_and_are_held(loops):
    """Without thrust nothing leaves rest by itself; at 3.4 N joints leave at 21 1/s, and the loop holds."""
    rest, thrust = loops["at rest"][0], loops["peak acceleration"][0]
    fastest = [np.linalg.eigvals(loop.plant.A).real.max() for loop in (rest, thrust)]
    assert fastest[0] < 0.01
    assert fastest[1] == pytest.approx(BUCKLING, rel=0.02)  # in FLIGHT, of the feedforward alone
    assert spectral_radius(rest.closed()) < 1.0
    assert spectral_radius(thrust.closed()) < 1.0


@pytest.mark.parametrize("instant", ["at rest", "peak acceleration"])
def test_the_map_predicts_the_flight(session, loops, instant, rng):
    """A pushed flight leaves the other as the map says: the error falls with the square of the push."""
    loop, start = loops[instant]
    plan = session.prepared.plan
    states = ("y", "nu", "eta", "eta_rate", "w", "posture")
    places = [plan.place("controller.estimator", name) for name in states]
    own = np.r_[: start.x.size, *places]
    pushed = rng.standard_normal(own.size)

    def flown(push):
        z = np.concatenate([start.x, start.d])
        z[own] += push
        x, d = np.split(z, [start.x.size])
        session.restore(Snapshot(start.layout, start.now, start.origin, x, d, start.p))
        session.advance(float(start.now) + 0.02)
        now = session.save()
        return np.concatenate([now.x, now.d])[own]

    errors = []
    for size in 1e-5 * 0.5 ** np.arange(4):  # at rest the feedback may not ask for much thrust
        found = (flown(size * pushed) - flown(np.zeros(own.size))) / size
        errors.append(np.abs(found - loop.closed() @ pushed).max())
    slopes = np.diff(np.log2(errors))
    assert np.abs(slopes + 1.0).max() < 0.1


def test_margins_of_one_loop(loops):
    """The loop is stable up to the delay, and not beyond; what is worst of two is the worse of them."""
    loop = loops["peak acceleration"][0]
    found = LoopMargins.of(loop)
    assert found.radii["nominal"] == spectral_radius(loop.closed()) < 1.0
    assert 0.0 < found.delay < 0.05
    for delay, stable in ((0.98 * found.delay, True), (1.02 * found.delay, False)):
        assert (spectral_radius(loop.closed(delay=delay)) < 1.0) == stable
    where, number = found.weakest.split()
    assert disks(loop)[f"{where}s"][int(number)][0] == found.disk
    rest = LoopMargins.of(loops["at rest"][0])
    both = worst([rest, found])
    assert (both.disk, both.delay) == (min(rest.disk, found.disk), min(rest.delay, found.delay))
    assert both.radii["+20 ms"] == max(rest.radii["+20 ms"], found.radii["+20 ms"])


@pytest.mark.parametrize("factors", [{"mass": 1.05}, {"length": 0.95}])
def test_arms_of_other_mass_and_length(factors):
    """Masses scale together; an arm of another length reaches as far as it is long."""
    dynamics = SpaceTruss.consistent().dynamics
    for before, after in zip(dynamics.arms, with_arms(dynamics, **factors).arms, strict=True):
        assert after.masses == pytest.approx(factors.get("mass", 1.0) * before.masses, rel=1e-12)
        assert after.joint_origins == pytest.approx(
            factors.get("length", 1.0) * before.joint_origins, rel=1e-12
        )
        assert after.base_mass == before.base_mass


def test_limits_are_found_up_and_down():
    values = np.arange(0.0, 5.0)
    assert first_limit(lambda v: v / 2.5, values) == pytest.approx(2.5, abs=0.01)
    assert first_limit(lambda v: 2.5 / (5.0 - v), values) == pytest.approx(2.5, abs=0.01)
    assert first_limit(lambda v: 1.5 - v, values[::-1]) == pytest.approx(0.5, abs=0.01)
    assert first_limit(lambda _: 0.5, values) == np.inf
    assert first_limit(lambda _: 1.5, values) == 0.0


def widest_gains(late, growth=BUCKLING, time=0.02):
    """Search feedback of angle, rate and `late` last commands that stands the widest range of gains."""
    steps = scipy.linalg.expm(np.array([[0.0, 1.0, 0.0], [growth**2, 0.0, 1.0], [0.0, 0.0, 0.0]]) * time)
    size = 2 + late

    def grows(gain, feedback):
        flow, push = np.zeros((size, size)), np.zeros(size)
        flow[:2, :2] = steps[:2, :2]
        if late:
            flow[:2, 2], push[-1] = gain * steps[:2, 2], 1.0
        else:
            push[:2] = gain * steps[:2, 2]
        return bool(np.abs(np.linalg.eigvals(flow - np.outer(push, feedback))).max() >= 1.0)

    def ratio(feedback):
        if grows(1.0, feedback):
            return 1.0
        ends = []
        for factor in (0.98, 1.02):
            gain = 1.0
            while not grows(gain * factor, feedback):
                gain *= factor
            inside, outside = gain, gain * factor
            for _ in range(20):
                middle = (inside + outside) / 2.0
                inside, outside = (inside, middle) if grows(middle, feedback) else (middle, outside)
            ends.append(inside)
        return ends[1] / ends[0]

    guess = np.append([2.0 * growth**2, 2.0 * growth], np.zeros(late))
    tried = [guess * f for f in np.linspace(0.6, 1.4, 5)]
    method: Any = {"method": "Nelder-Mead", "options": {"maxiter": 800, "xatol": 1e-6, "fatol": 1e-6}}

    def narrow(feedback):
        return -ratio(feedback)

    return -min(float(scipy.optimize.minimize(narrow, k, **method).fun) for k in tried)


def test_gains_farther_apart_than_the_bound_nothing_stands():
    """Acting at once, feedback of the state reaches the bound; a sample later it stays 0.58 of it."""
    at_once, later = (greatest_gain_ratio(BUCKLING, 0.02 * (1 + late)) for late in (0, 1))
    widest, widest_later = (widest_gains(late) for late in (0, 1))
    assert widest == pytest.approx(at_once, rel=1e-2)
    assert widest < at_once * (1.0 + 1e-4)
    assert widest_later == pytest.approx(3.6, rel=0.02)  # as docs/flight says
    assert widest_later < later < 6.3
