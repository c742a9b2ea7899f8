"""Margins of the flown loop: the linear map is the derivative of the flight, with the thrust on."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from flight.loops import with_arms
from flight.margins import (
    BUCKLING_RATE,
    VARIATIONS,
    first_unstable,
    loops_along,
    margins_of,
    max_gain_ratio,
    min_disk,
)
from flight.sampled_loop import spectral_radius
from systems import assert_near

from trussflow.blocks import Session
from trussflow.models import SpaceTruss
from trussflow.models.transport import Mission, mean_axes_transport

# The paper's path of 60 s, scaled down in time and, with the same accelerations, in displacement.
DURATION = 6.0  # s
MISSION = replace(
    Mission.of_case(1), position=np.array([0.0, 0.0, 0.06]), duration=DURATION
)


@pytest.fixture(scope="module")
def session():
    return Session(
        mean_axes_transport(MISSION, SpaceTruss.consistent()), outputs=[], step=2e-3
    )


@pytest.fixture(scope="module")
def loops(session):
    """Return the loop at two instants, and what the flight was there."""
    instants = {"at rest": 0.0, "peak acceleration": 0.2113}
    # of no account
    along = loops_along(session, DURATION, {"controller.probe.strength": 1.0}, instants)
    return {name: (loop, session.save()) for name, loop in along}


def test_arms_buckle_under_thrust_and_are_held(loops):
    """Without thrust nothing leaves rest by itself; at 3.4 N joints leave at 21 1/s, and the loop holds."""
    fastest = [np.linalg.eigvals(loop.plant.A).real.max() for loop, _ in loops.values()]
    assert fastest == pytest.approx([0.0, BUCKLING_RATE], rel=0.02, abs=0.01)
    assert all(spectral_radius(loop.closed()) < 1.0 for loop, _ in loops.values())


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
    for size in 1e-5 * 0.5 ** np.arange(4):
        # at rest the feedback may not ask for much thrust
        found = (flown(size) - flown(0.0)) / size
        errors.append(np.abs(found - loop.closed() @ pushed).max())
    slopes = np.diff(np.log2(errors))
    assert_near(slopes, -1.0, 0.1)


def test_margins_of_one_loop(loops):
    """The loop is stable up to the delay, and not beyond; growth is the logarithm of the spectral radius."""
    loop = loops["peak acceleration"][0]
    found = margins_of(loop)
    growth = dict(zip(VARIATIONS, found["growth"], strict=True))
    assert growth["nominal"] == np.log(spectral_radius(loop.closed())) / 0.02 < 0.0
    assert 0.0 < found["delay"] < 0.05
    for delay, stable in (
        (0.98 * found["delay"], True),
        (1.02 * found["delay"], False),
    ):
        assert (spectral_radius(loop.closed(delay=delay)) < 1.0) == stable
    assert found["disk"] == min_disk(loop) < min_disk(loops["at rest"][0])


def test_arms_of_other_mass_and_length():
    """Masses scale together; an arm of another length reaches as far as it is long."""
    dynamics = SpaceTruss.consistent().dynamics
    for before, after in zip(
        dynamics.arms, with_arms(dynamics, mass=1.05, length=0.95).arms, strict=True
    ):
        assert after.masses == pytest.approx(1.05 * before.masses, rel=1e-12)
        assert after.joint_origins == pytest.approx(
            0.95 * before.joint_origins, rel=1e-12
        )
        assert after.base_mass == before.base_mass


def test_the_first_unstable_value_is_found_up_and_down():
    values = np.arange(0.0, 5.0)
    assert first_unstable(lambda v: v / 2.5, values) == pytest.approx(2.5, abs=0.01)
    assert first_unstable(lambda v: 2.5 / (5.0 - v), values) == pytest.approx(
        2.5, abs=0.01
    )
    assert first_unstable(lambda v: 1.5 - v, values[::-1]) == pytest.approx(
        0.5, abs=0.01
    )
    assert first_unstable(lambda _: 0.5, values) == np.inf
    assert first_unstable(lambda _: 1.5, values) == 0.0


@pytest.mark.parametrize(
    "feedback, bound, ratio",
    [([1972.718, 19.437], 22.92, 22.92), ([1087.631, 28.840, 1.266], 6.24, 3.62)],
)
def test_a_searched_feedback_nearly_reaches_the_bound_of_gains(feedback, bound, ratio):
    """Feedback of angle, rate and last command, found by a search for the widest range of gains.

    Acting at once it reaches the bound; a sample later it stays 0.58 of it.
    """
    time, size = 0.02, len(feedback)
    steps = scipy.linalg.expm(
        np.array([[0.0, 1.0, 0.0], [BUCKLING_RATE**2, 0.0, 1.0], [0.0, 0.0, 0.0]])
        * time
    )

    def stable(gain):
        plant = np.eye(3, k=3)
        plant[:2] = steps[:2] * [1.0, 1.0, gain]
        push = plant[:size, 2] if size == 2 else np.eye(3)[2]
        return spectral_radius(plant[:size, :size] - np.outer(push, feedback)) < 1.0

    gains = [gain for gain in np.geomspace(0.05, 20.0, 4000) if stable(gain)]
    found = max_gain_ratio(BUCKLING_RATE, time * (size - 1))
    assert found == pytest.approx(bound, rel=1e-3)
    assert gains[-1] / gains[0] == pytest.approx(ratio, rel=1e-2)
    assert gains[-1] / gains[0] < found * (1.0 + 1e-4)
