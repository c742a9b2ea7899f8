"""Prices and preferences follow their formulas; unloading is nothing that the truss feels."""

from types import SimpleNamespace
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from trussflow.blocks import Constant, Diagram, simulate
from trussflow.models import ActuatorEconomy, Hardware, MeanAxesAllocation, MeanAxesDesign, SpaceTruss

TRUSS = SpaceTruss.consistent()
DYNAMICS, RIGID = TRUSS.dynamics, TRUSS.rigid
LIMITS = Hardware.flight().limits(TRUSS)
DESIGN = MeanAxesDesign.shipped()
TERMS = DYNAMICS.evaluate(DYNAMICS.rest, np.zeros(DYNAMICS.coordinates))
G, P = TERMS.mass_matrix[:RIGID, :RIGID], TERMS.actuation_matrix[:RIGID]
WANTED = G @ np.eye(RIGID)[2] * 5e-3


def shared(propellant, momentum):
    """Return what economy and allocation say when the truss is to rise."""
    diagram = Diagram("d")
    economy, allocation = diagram.add(
        economy=ActuatorEconomy(DYNAMICS, LIMITS, DESIGN),
        allocation=MeanAxesAllocation(DYNAMICS, LIMITS, DESIGN),
    )
    values = {
        economy.propellant: propellant,
        economy.momentum: momentum,
        allocation.slow_force: WANTED,
        allocation.force: WANTED,
        allocation.actuation_matrix: P,
        allocation.inertia: G,
        allocation.modal_force: np.zeros(DESIGN.neutral_modes),
    }
    for k, (port, value) in enumerate(values.items()):
        diagram.add(**{f"of_{k}": Constant(value)}).y >> port
    economy.price >> allocation.price
    economy.preferred >> allocation.preferred
    log = [economy.price, economy.preferred, allocation.command]
    return simulate(diagram, 0.02, step=0.02, log=log, backend="interpreted", progress=False).isel(time=-1)


@given(
    used=arrays(float, 4, elements=st.floats(0.0, 5.0)),
    held=arrays(float, 12, elements=st.floats(-30.0, 30.0)),
)
def test_formulas(used, held):
    block = ActuatorEconomy(DYNAMICS, LIMITS, DESIGN)
    nothing: Any = None
    inputs: Any = SimpleNamespace(propellant=used, momentum=held)
    parameters: Any = SimpleNamespace(**block.parameters)
    found = block.output(np.zeros(()), nothing, inputs, parameters)
    more = np.maximum(0.0, used - used.mean()) / DESIGN.propellant_spread
    torques = np.clip(held.reshape(4, 3) / DESIGN.unloading_time, -0.15, 0.15)
    for i in range(4):
        base = slice(6 * i, 6 * i + 6)
        np.testing.assert_allclose(found["price"][base], [1 + more[i]] * 3 + [1] * 3, rtol=1e-12)
        np.testing.assert_allclose(found["preferred"][base], [0, 0, 0, *torques[i]], rtol=1e-12)
    np.testing.assert_array_equal(found["price"][24:], 1.0)
    np.testing.assert_array_equal(found["preferred"][24:], 0.0)


def test_wheels_are_unloaded_and_the_truss_does_not_feel_it():
    idle = shared(np.zeros(4), np.zeros(12))["allocation.command"].values
    held = np.array([3.0, -2.0, 1.0, *[0.0] * 9])
    loaded = shared(np.zeros(4), held)["allocation.command"].values
    gained = (loaded - idle)[3:6]
    assert (gained * held[:3] > 0.0).all()  # a torque along the momentum takes it back
    assert np.abs(gained).max() > 0.3 * 3.0 / DESIGN.unloading_time
    missed = np.linalg.solve(G, P @ (loaded - idle))
    assert np.abs(missed[:6]).max() < 1e-3 * 5e-3


def test_a_base_that_has_used_more_thrusts_less():
    even, spent = (
        shared(used, np.zeros(12))["allocation.command"].values
        for used in (np.full(4, 1.0), np.array([1.0, 1.0, 1.4, 1.0]))
    )
    assert np.linalg.norm(spent[12:15]) < 0.8 * np.linalg.norm(even[12:15])
    np.testing.assert_allclose((P @ spent)[:6], (P @ even)[:6], rtol=0, atol=1e-3 * np.abs(WANTED).max())
