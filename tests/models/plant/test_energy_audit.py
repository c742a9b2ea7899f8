"""What the actuators do on the truss is stored or damped away; a wrong sign anywhere in it is found."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from trussflow.blocks import Diagram, Input, Output, energy_audit
from trussflow.blocks.library.algebra import Function
from trussflow.models import SpaceTruss, TrussDynamics

STEP = 2e-3
"""The fastest mode has 0.5 Hz, arms of some kg are light: the fourth order leaves some 1e-9."""


def audit(dynamics, *, wire=1.0, modal_actuation=True):
    """Return the audit of a tumbling truss whose bases are held back by rate feedback, through a wire."""
    truss = SpaceTruss(dynamics, modal_actuation=modal_actuation)
    rng = np.random.default_rng(5)
    start = {"truss.q": truss.dynamics.rest + 0.1 * rng.standard_normal(truss.n)}
    start["truss.v"] = 0.1 * rng.standard_normal(truss.n)
    size = truss.actuators
    loop = Diagram("truss loop")
    ports = (
        {"rates": Input(size, unit=truss.actuator_rate_units)},
        {"force": Output(size, unit=truss.actuator_units)},
    )
    law = Function(lambda rates: 0.3 * np.sin(np.arange(size)) - 2.0 * rates, *ports)
    plant, feedback = loop.add(truss=truss, feedback=law)
    plant.actuator_rates >> feedback.rates
    (wire * feedback.force) >> plant.actuation
    settings: dict[str, Any] = {"step": STEP, "backend": "numpy"}
    supplied = [(feedback.force, plant.actuator_rates)]
    return energy_audit(loop, 0.04, initial=start, supplied=supplied, log_step=0.01, **settings)


@pytest.fixture
def dynamics(random_system):
    damped = random_system(("RR", "P"), 2, elastic_integrals=True)
    object.__setattr__(damped.modes, "damping_ratios", np.full(2, 0.3))
    return damped


def test_supplied_is_stored_or_damped_away(dynamics):
    found = audit(dynamics)
    found.raise_for_missing(1e-9)
    energies = found.result.isel(time=-1).sel(account="truss")
    assert float(energies["dissipated"]) > 1e-4
    assert abs(float(energies["supplied"])) > 1e-3


def driving(self, q, v, frequency, damping_ratio):
    """Return the elastic force, with damping of the wrong sign."""
    return TRUE_FORCE(self, q, v, frequency, -damping_ratio)


def turned(self, *given):
    """Return the terms of the equations, with inertial forces of the wrong sign."""
    terms = TRUE_TERMS(self, *given)
    return terms._replace(bias=-terms.bias)


TRUE_FORCE, TRUE_TERMS = TrussDynamics.elastic_force, TrussDynamics.evaluate
PLANTED = {"elastic_force": driving, "evaluate": turned}


@pytest.mark.parametrize("planted", ["elastic_force", "evaluate", "modal rows", "wire"])
def test_a_wrong_sign_is_found_where_it_is(dynamics, planted, monkeypatch):
    """In the plant, the plant does not balance; in a wire around it, only the whole does not."""
    if planted in PLANTED:
        monkeypatch.setattr(TrussDynamics, planted, PLANTED[planted])
    drift = audit(
        dynamics, wire=-1.0 if planted == "wire" else 1.0, modal_actuation=planted != "modal rows"
    ).drift
    assert drift["truss loop"] > 1e-4
    assert drift["truss"] < 1e-9 if planted == "wire" else drift["truss"] > 1e-4
