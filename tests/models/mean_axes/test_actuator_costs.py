"""Prices and preferences follow their formulas; unloading is nothing that the truss feels."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal
from systems import assert_near, respond

from trussflow.models import (
    ActuatorCosts,
    Hardware,
    MeanAxesAllocation,
    MeanAxesDesign,
    SpaceTruss,
)

TRUSS = SpaceTruss.consistent()
DYNAMICS, RIGID = TRUSS.dynamics, TRUSS.rigid
LIMITS = Hardware.flight().limits(TRUSS)
DESIGN = MeanAxesDesign.shipped()
TERMS = DYNAMICS.evaluate(DYNAMICS.rest, np.zeros(DYNAMICS.coordinates))
G, P = TERMS.mass_matrix[:RIGID, :RIGID], TERMS.actuation_matrix[:RIGID]
WANTED = G @ np.eye(RIGID)[2] * 5e-3


ECONOMY = ActuatorCosts(DYNAMICS, LIMITS, DESIGN)


def shared(**used):
    """Return the command for a rising truss whose economy has these inputs."""
    forces = {"slow_force": WANTED, "force": WANTED}
    allocation = MeanAxesAllocation(DYNAMICS, LIMITS, DESIGN)
    return respond(
        allocation, actuation_matrix=P, inertia=G, **forces, **respond(ECONOMY, **used)
    )["command"]


@given(
    used=arrays(float, 4, elements=st.floats(0.0, 5.0)),
    held=arrays(float, 12, elements=st.floats(-30.0, 30.0)),
)
def test_formulas(used, held):
    found = respond(ECONOMY, propellant=used, momentum=held)
    more = np.maximum(0.0, used - used.mean()) / DESIGN.propellant_spread
    torques = np.clip(held.reshape(4, 3) / DESIGN.unloading_time, -0.15, 0.15)
    for i in range(4):
        base = slice(6 * i, 6 * i + 6)
        assert_allclose(found["price"][base], [1 + more[i]] * 3 + [1] * 3, rtol=1e-12)
        assert_allclose(found["preferred"][base], [0, 0, 0, *torques[i]], rtol=1e-12)
    assert_array_equal(found["price"][24:], 1.0)
    assert_array_equal(found["preferred"][24:], 0.0)


def test_wheels_are_unloaded_and_the_truss_does_not_feel_it():
    idle = shared()
    held = np.array([3.0, -2.0, 1.0, *[0.0] * 9])
    loaded = shared(momentum=held)
    gained = (loaded - idle)[3:6]
    assert (gained * held[:3] > 0.0).all()  # a torque along the momentum takes it back
    assert np.abs(gained).max() > 0.3 * 3.0 / DESIGN.unloading_time
    missed = np.linalg.solve(G, P @ (loaded - idle))
    assert_near(missed[:6], 0.0, 1e-3 * 5e-3)


def test_a_base_that_has_used_more_thrusts_less():
    even, spent = (
        shared(propellant=np.array([1.0, 1.0, used, 1.0])) for used in (1.0, 1.4)
    )
    assert np.linalg.norm(spent[12:15]) < 0.8 * np.linalg.norm(even[12:15])
    assert_near((P @ spent)[:6], (P @ even)[:6], 1e-3 * np.abs(WANTED).max())
